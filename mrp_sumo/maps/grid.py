"""The grid discretisation: square cells, 4-connected; from the lanes of a nav graph as MRP-Bench does, or from any occupancy.

MRP-Bench's recipe frees one line of cells a lane and widens it so that two robots can pass. Its counts are
those of the paper to the cell, so its oddities are kept: coordinates are single precision, and the last two
widening passes look at the wrong row and column. Several levels have a grid each. Refuses grids too large to use.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mrp_sumo.core.graph import (
    NO_PROPERTIES,
    BoolArray,
    FloatArray,
    IntArray,
    NavGraph,
    PlanGraph,
    frozen,
    nav_graph,
    nav_like,
    plan_graph,
)
from mrp_sumo.errors import MapError
from mrp_sumo.maps.roadmap import check_cell

MAX_CELLS = 20_000_000
MAX_FREE = 2_000_000  # vertices of a grid; cells along the lanes of a nav graph, both ways counted
NEIGHBOURS = ((0, 1), (1, 0), (0, -1), (-1, 0))  # (dx, dy) in the order the walk tries them


def paper_grid(nav: NavGraph, cell_m: float = 0.4) -> PlanGraph:
    """The occupancy grid MRP-Bench makes of a nav graph, as a graph of its free cells; a graph that is a grid stays as it is.

    Vertices are in the order of the nav graph files. Raises MapError for cells that are too small.
    """
    if isinstance(nav, PlanGraph):
        return nav
    levels = np.unique(nav.level)
    if len(levels) > 1:
        return _grids(nav, cell_m, levels)
    free, cell, origin = paper_cells(nav, cell_m)
    grid = grid_graph(free, cell_m, origin, name=nav.name, source=nav.source)
    vertex = vertex_of_cell(free)[cell[:, 1], cell[:, 0]]
    vertex_name, vertex_options = list(grid.vertex_name), list(grid.vertex_options)
    for v, name, options in zip(vertex.tolist(), nav.vertex_name, nav.vertex_options):  # the first of several in a cell
        vertex_name[v], vertex_options[v] = vertex_name[v] or name, vertex_options[v] or options
    return replace(
        grid,
        level_names=_one_level(nav),
        vertex_name=tuple(vertex_name),
        vertex_options=tuple(vertex_options),
        vertex_of_station=frozen(vertex),
    )


def _grids(nav: NavGraph, cell_m: float, levels: IntArray) -> PlanGraph:
    """A grid a level, joined by rides between the cells of the stops of lifts."""
    station, first = np.zeros(nav.num_vertices, np.int64), 0
    parts: list[PlanGraph] = []
    for k in levels.tolist():
        mine = np.flatnonzero(nav.level == k)
        lanes = np.flatnonzero((nav.level[nav.tail] == k) & (nav.level[nav.head] == k))
        number = np.cumsum(nav.level == k) - 1
        alone = nav_like(
            nav,
            xy=nav.xy[mine],
            lanes=np.stack([number[nav.tail[lanes]], number[nav.head[lanes]]], 1),
            level_names=(nav.level_names[k],),
            level=None,
            vertex_name=[nav.vertex_name[v] for v in mine.tolist()],
            vertex_options=[nav.vertex_options[v] for v in mine.tolist()],
        )
        part = paper_grid(alone, cell_m)
        station[mine] = first + part.vertex_of_station
        first += part.num_vertices
        parts.append(part)
    begin = np.cumsum([0, *(part.num_vertices for part in parts)])
    rides = np.flatnonzero(nav.is_ride)
    cells = [np.stack([part.tail, part.head], 1) + at for part, at in zip(parts, begin.tolist())]
    num_lanes = sum(map(len, cells))
    graph = nav_like(
        nav,
        xy=np.concatenate([part.xy for part in parts]),
        lanes=np.concatenate([*cells, np.stack([station[nav.tail[rides]], station[nav.head[rides]]], 1)]),
        level=np.repeat(levels, np.diff(begin)),
        vertex_name=[name for part in parts for name in part.vertex_name],
        vertex_options=[options for part in parts for options in part.vertex_options],
        length_m=np.concatenate([np.full(num_lanes, float(cell_m)), nav.length_m[rides]]),
        lane_options=[*([NO_PROPERTIES] * num_lanes), *(nav.lane_options[k] for k in rides.tolist())],
    )
    return plan_graph(graph, kind="grid", cell_m=cell_m, vertex_of_station=station)


def paper_cells(nav: NavGraph, cell_m: float) -> tuple[BoolArray, IntArray, FloatArray]:
    """Free cells [H, W] of the recipe, the cell (column, row) of each vertex [V, 2], and the lower left corner [2]."""
    _one_level(nav)
    if reason := too_large(nav, cell_m):
        raise MapError(reason)
    low, high = _corners(nav)
    width, height = (np.ceil((high - low) / cell_m) + 1).astype(np.int64).tolist()
    cell = np.floor((_single_precision(nav.xy) - low) / cell_m).astype(np.int64)
    free = np.zeros((height, width), np.bool_)
    is_vertex = np.zeros_like(free)
    for a, b in zip(nav.tail[nav.is_once].tolist(), nav.head[nav.is_once].tolist()):
        start, end = cell[a].tolist(), cell[b].tolist()
        is_vertex[start[1], start[0]] = is_vertex[end[1], end[0]] = True
        _walk(free, start, end)
    free |= is_vertex
    free[cell[:, 1], cell[:, 0]] = True
    _widen(free, is_vertex)
    return free, cell, low


def grid_facts(nav: NavGraph, cell_m: float = 0.4, free: BoolArray | None = None) -> dict[str, Any]:
    """Counts of the paper's Table I: cell_m, width, height, total, free, blocked; `free` are the cells [H, W] of a map that is a grid."""
    if isinstance(nav, PlanGraph):
        cell_m = nav.cell_m
    else:
        free, _, _ = paper_cells(nav, cell_m)
    if free is None:
        width, height = (np.rint(np.ptp(nav.xy, axis=0) / cell_m) + 1).astype(int).tolist()
    else:
        height, width = free.shape
    num_free, total = nav.num_vertices if free is None else int(np.count_nonzero(free)), width * height
    return {"cell_m": cell_m, "width": width, "height": height, "total": total, "free": num_free, "blocked": total - num_free}


def too_large(nav: NavGraph, cell_m: float) -> str:
    """Why the grid of a nav graph would be of no use; '' if it is of use."""
    check_cell(cell_m)
    low, high = _corners(nav)
    width, height = np.ceil((high - low) / cell_m) + 1
    if width * height > MAX_CELLS:
        return f"cells of {cell_m:g} m would make a grid of {width:.0f} x {height:.0f} on '{nav.name}', more than {MAX_CELLS:.0e} cells"
    steps = np.abs(nav.xy[nav.tail] - nav.xy[nav.head]).sum() / cell_m
    return f"the lanes of '{nav.name}' cover more than {MAX_FREE:.0e} cells of {cell_m:g} m" if steps > MAX_FREE else ""


def grid_graph(
    free: BoolArray,
    cell_m: float,
    origin: Sequence[float] | FloatArray,
    *,
    name: str = "grid",
    source: str = "",
    passages: tuple[BoolArray, BoolArray] | None = None,
) -> PlanGraph:
    """The 4-connected graph of a grid's free cells, numbered row by row from the lowest y. Every cell is a station.

    `free` is [H, W], row 0 has the lowest y; `origin` (x, y) m is the lower left corner of cell (0, 0). `passages` [H, W - 1] and [H - 1,
    W] say whether one can drive from a cell to the right and up; by default where both cells are free.
    """
    check_cell(cell_m)
    if np.count_nonzero(free) > MAX_FREE:
        raise MapError(f"grid '{name}' has {np.count_nonzero(free)} free cells; more than {MAX_FREE:.0e} are not planned on")
    number = vertex_of_cell(free)
    row, column = np.nonzero(free)
    xy = np.asarray(origin, np.float64) + (np.stack([column, row], axis=1) + 0.5) * cell_m
    right, up = passages or (free[:, :-1] & free[:, 1:], free[:-1] & free[1:])
    pairs = np.concatenate(
        [
            np.stack([number[:, :-1][right], number[:, 1:][right]], axis=1),
            np.stack([number[:-1][up], number[1:][up]], axis=1),
        ]
    )
    lanes = np.concatenate([pairs, pairs[:, ::-1]])
    graph = nav_graph(name=name, xy=xy, lanes=lanes, length_m=np.full(len(lanes), float(cell_m)), source=source)
    corners_m = np.asarray(origin, np.float64) + cell_m * np.array([(0, 0), free.shape[::-1]])
    return plan_graph(graph, kind="grid", cell_m=cell_m, frame_m=frozen(corners_m))


def vertex_of_cell(free: BoolArray) -> IntArray:
    """[H, W] vertices of free cells in the graph of a grid; of other cells the one before."""
    number: IntArray = np.cumsum(free.ravel()).reshape(free.shape) - 1
    return number


def _one_level(nav: NavGraph) -> tuple[str, ...]:
    driven = np.unique(nav.level)
    if len(driven) > 1:
        names = ", ".join(nav.level_names[k] for k in driven)
        raise MapError(f"a grid holds one level, but graph '{nav.name}' is on {names}: choose one")
    return (nav.level_names[driven[0]],) if len(driven) else nav.level_names[:1]


def _corners(nav: NavGraph) -> tuple[FloatArray, FloatArray]:
    if not nav.num_vertices:
        raise MapError(f"'{nav.name}' has no vertex to make a grid of")
    xy = _single_precision(nav.xy)
    return xy.min(axis=0), xy.max(axis=0)


def _single_precision(xy: FloatArray) -> FloatArray:
    return xy.astype(np.float32).astype(np.float64)


def _walk(free: BoolArray, start: list[int], end: list[int]) -> None:
    """Free a 4-connected line of cells, each nearer to the end than the one before."""
    x, y = start
    free[y, x] = True
    line_x, line_y = end[0] - x, end[1] - y
    while [x, y] != end:
        left = (x - end[0]) ** 2 + (y - end[1]) ** 2
        nearer = [(x + dx, y + dy) for dx, dy in NEIGHBOURS if (x + dx - end[0]) ** 2 + (y + dy - end[1]) ** 2 <= left]
        if len(nearer) > 1:
            first, second = (abs(line_x * (cy - start[1]) - line_y * (cx - start[0])) for cx, cy in nearer[:2])
            nearer = nearer[:1] if first < second else nearer[1:2]
        x, y = nearer[0]
        free[y, x] = True


def _widen(free: BoolArray, is_vertex: BoolArray) -> None:
    """Free the left and lower neighbours of cells between blocked corners, in place."""
    height, width = free.shape

    def is_narrow(x: int, y: int) -> bool:
        low, high, left, right = max(y - 1, 0), min(y + 1, height - 1), max(x - 1, 0), min(x + 1, width - 1)
        return int(free[low, left]) + int(free[low, right]) + int(free[high, left]) + int(free[high, right]) < 3

    for y, x in np.argwhere(free & ~is_vertex).tolist():
        if x > 0 and y > 0 and is_narrow(x, y):
            free[y, x - 1] = free[y - 1, x] = True
    for x in range(width):
        if height > 1 and free[0, x] and not is_vertex[0, x] and is_narrow(x, height - 1):
            free[1, x] = True
    for y in range(height):
        if width > 1 and free[y, 0] and not is_vertex[y, 0] and is_narrow(width - 1, y):
            free[y, 1] = True
