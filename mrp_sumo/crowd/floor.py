"""The free space of a map: where people have room, as cells of 0.2 m, and the walls that they keep away from.

Where a building is drawn, that is what its walls leave open, lifts excepted; on a grid of cells, the free ones; elsewhere corridors
along the lanes. Levels lie side by side, as in the map's frame, and nobody walks from one to another.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, PlanGraph, frozen
from mrp_sumo.crowd import _floor
from mrp_sumo.crowd.state import ASIDE_M, BODY_M, CELL_M
from mrp_sumo.errors import ScenarioError
from mrp_sumo.maps.building import Building, Level
from mrp_sumo.maps.clearance import segment_distances, standing_walls
from mrp_sumo.maps.map import Map

WALLS_WITHIN_M = 1.2  # walls farther away matter to nobody
CORRIDOR_M = 2.0  # width of the way along a lane where no walls are known
SNAP_M, BEFORE_LIFT_M = 1.0, 2.5  # from a vertex at which people may be instead, where it is too close to a wall, or in a lift
MOST_CELLS = 40_000_000


@dataclass(frozen=True, eq=False)
class Floor:
    """C = width x height cells; walls [W, 4] are x, y of both ends. Read-only."""

    corner_m: tuple[float, float]
    width: int
    height: int
    walls: FloatArray
    first: IntArray  # [C + 1] CSR: the walls near each cell
    near: IntArray
    away_m: FloatArray  # [C] distance of the centre from the nearest wall, inf where none is near
    free: BoolArray  # [C] whether a person has room there

    @cached_property
    def region(self) -> IntArray:
        """[C] the connected piece of free space that a cell is in, from 1 up; 0 where there is no room."""
        from scipy.ndimage import label

        pieces: IntArray = label(self.free.reshape(self.height, self.width))[0].ravel().astype(np.int64)
        return frozen(pieces)

    @cached_property
    def back(self) -> NDArray[np.uint8]:
        """[C] from a cell without room, which way leads to the nearest one with room (as `_floor.march` counts); NO_WAY elsewhere."""
        from scipy.ndimage import distance_transform_edt

        shape = self.height, self.width
        angles = np.full(shape, _floor.NO_WAY, np.uint8)
        if self.free.any():
            rows, columns = distance_transform_edt(~self.free.reshape(shape), return_distances=False, return_indices=True)
            dy, dx = rows - np.arange(self.height)[:, None], columns - np.arange(self.width)
            angle = np.rint(np.arctan2(dy, dx) * (_floor.NUM_ANGLES / (2 * np.pi))).astype(np.int64) % _floor.NUM_ANGLES
            angles = np.where((dx != 0) | (dy != 0), angle, _floor.NO_WAY).astype(np.uint8)
        return frozen(angles.ravel())

    def cell_of(self, xy: FloatArray) -> IntArray:
        """[N] the cells of points [N, 2], -1 beyond the edge."""
        column, row = np.floor((xy - np.array(self.corner_m)) / CELL_M).astype(np.int64).T
        inside = (column >= 0) & (column < self.width) & (row >= 0) & (row < self.height)
        return np.where(inside, row * self.width + column, -1)

    def centre_of(self, cell: IntArray) -> FloatArray:
        """[..., 2] m, the places of cells [...]."""
        place: FloatArray = np.array(self.corner_m) + (np.stack([cell % self.width, cell // self.width], axis=-1) + 0.5) * CELL_M
        return place

    def place_at(self, xy: FloatArray, within_m: float = SNAP_M) -> int:
        """The free cell nearest to a point [2], with no wall in between; -1 where there is none so near."""
        reach = int(within_m / CELL_M) + 1
        column, row = np.floor((xy - np.array(self.corner_m)) / CELL_M).astype(np.int64).tolist()
        rows = np.arange(max(row - reach, 0), min(row + reach + 1, self.height))
        columns = np.arange(max(column - reach, 0), min(column + reach + 1, self.width))
        cells = (rows[:, None] * self.width + columns).ravel()
        cells = cells[self.free[cells]] if len(cells) else cells
        away_m = np.hypot(*(self.centre_of(cells) - xy).T)
        for k in np.argsort(away_m, kind="stable").tolist():
            if away_m[k] > within_m:
                break
            if not _crosses(xy, self.centre_of(cells[k]), self.walls):
                return int(cells[k])
        return -1


def corridor_beside(half_width_m: float, side_m: float) -> float:
    """Width of a corridor in which people have room beside a robot, and out of its field: whole cells of it."""
    return max(CORRIDOR_M, 2 * (half_width_m + side_m + ASIDE_M + 2 * BODY_M + CELL_M))


def floor_of(map_: Map, graph: PlanGraph, corridor_m: float = CORRIDOR_M) -> Floor:
    """The free space of a map. Raises ScenarioError for a map that is too large.

    Parameters
    ----------
    map_
        With a building, a grid of cells, or neither.
    graph
        That robots drive on, in the map's frame.
    corridor_m
        Width of the ways along lanes, where there are neither walls nor cells.
    """
    parts = [_part(map_, graph, k, corridor_m) for k in range(len(graph.level_names))]
    low = np.floor(np.min([part.low for part in parts], axis=0) / CELL_M) * CELL_M
    size = np.ceil((np.max([part.high for part in parts], axis=0) - low) / CELL_M) + 1
    width, height = size.astype(np.int64).tolist()
    if width * height > MOST_CELLS:
        raise ScenarioError(f"'{graph.name}' is {width} x {height} cells of {CELL_M:g} m, too large for people (at most {MOST_CELLS})")
    inside, walls = np.zeros((height, width), np.bool_), [np.zeros((0, 2, 2))]
    for part in parts:
        first = np.ceil((part.low - low) / CELL_M - 0.5).astype(np.int64)
        last = np.floor((part.high - low) / CELL_M - 0.5).astype(np.int64) + 1
        window = slice(first[1], last[1]), slice(first[0], last[0])
        x, y = (low[k] + (np.arange(first[k], last[k]) + 0.5) * CELL_M for k in range(2))
        mask = part.inside(x, y)
        inside[window] |= mask
        walls.append(part.walls if len(part.walls) else _edges(mask) * CELL_M + low + first * CELL_M)
    flat = np.ascontiguousarray(np.concatenate(walls).reshape(-1, 4))
    near = _floor.walls_near(flat, float(low[0]), float(low[1]), CELL_M, width, height, WALLS_WITHIN_M)
    free = inside.ravel() & (near[2] >= BODY_M)
    return Floor((float(low[0]), float(low[1])), width, height, *map(frozen, (flat, *near, free)))


@dataclass(frozen=True, eq=False)
class _Part:
    """A level."""

    low: FloatArray  # [2] m, its lower left corner
    high: FloatArray
    walls: FloatArray  # [W, 2, 2] m
    inside: Callable[[FloatArray, FloatArray], BoolArray]  # x [W], y [H] of cells: [H, W] whether it is floor, walls aside


def _part(map_: Map, graph: PlanGraph, level: int, corridor_m: float) -> _Part:
    name, nav = graph.level_names[level], map_.nav
    walls = standing_walls(map_.building, (name,)) if map_.building else np.zeros((0, 2, 2))
    if map_.building is not None and len(walls):
        points = np.concatenate([walls.reshape(-1, 2), graph.xy[graph.level == level]])
        return _Part(points.min(axis=0), points.max(axis=0), walls, partial(_outside_lifts, map_.building, map_.building.levels[name]))
    if map_.free is not None and isinstance(nav, PlanGraph) and nav.frame_m is not None:
        low, high = nav.frame_m
        return _Part(low, high, walls, partial(_free_cells, map_.free, low, nav.cell_m))
    lanes = np.flatnonzero((graph.level[graph.tail] == level) & (graph.level[graph.head] == level) & ~graph.is_ride)
    ends = np.stack([graph.xy[graph.tail[lanes]], graph.xy[graph.head[lanes]]], axis=1)
    points = ends.reshape(-1, 2) if len(lanes) else graph.xy[graph.level == level]
    if not len(points):
        points = graph.xy[:1]
    return _Part(points.min(axis=0) - corridor_m, points.max(axis=0) + corridor_m, walls, partial(_corridors, ends, corridor_m))


def _outside_lifts(building: Building, level: Level, x: FloatArray, y: FloatArray) -> BoolArray:
    """Everywhere but in the cabins of lifts; the walls say the rest."""
    mask = np.ones((len(y), len(x)), np.bool_)
    moved_m = (level.world_xy - level.xy)[0] if len(level.xy) else np.zeros(2)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2) + moved_m
    for lift in building.lifts.values():
        if lift.level_doors:
            mask &= ~lift.holds(points, level.elevation_m).reshape(mask.shape)
    return mask


def _free_cells(free: BoolArray, corner: FloatArray, cell_m: float, x: FloatArray, y: FloatArray) -> BoolArray:
    row, column = ((y - corner[1]) / cell_m).astype(np.int64), ((x - corner[0]) / cell_m).astype(np.int64)
    mask: BoolArray = free[np.clip(row, 0, free.shape[0] - 1)[:, None], np.clip(column, 0, free.shape[1] - 1)]
    return mask


def _corridors(lanes: FloatArray, width_m: float, x: FloatArray, y: FloatArray) -> BoolArray:
    """Within half a width of lanes [L, 2, 2]."""
    corner = float(x[0]) - CELL_M / 2, float(y[0]) - CELL_M / 2
    away_m = _floor.walls_near(np.ascontiguousarray(lanes.reshape(-1, 4)), *corner, CELL_M, len(x), len(y), width_m / 2)[2]
    mask: BoolArray = np.isfinite(away_m).reshape(len(y), len(x))
    return mask


def _edges(mask: BoolArray) -> FloatArray:
    """[W, 2, 2] the edges between what is floor and what is not, in cells from the lower left corner; straight runs are one."""
    segments = []
    for axis in range(2):  # edges along x, then along y
        cells = np.pad(mask if axis == 0 else mask.T, 1)
        differs = (cells[1:] != cells[:-1])[:, 1:-1].astype(np.int8)  # [lines, cells along]
        steps = np.diff(np.pad(differs, ((0, 0), (1, 1))), axis=1)
        (line, begin), (_, end) = np.nonzero(steps == 1), np.nonzero(steps == -1)
        ends = np.stack([np.stack([begin, line], 1), np.stack([end, line], 1)], 1).astype(np.float64)
        segments.append(ends if axis == 0 else ends[..., ::-1])
    edges: FloatArray = np.concatenate(segments)
    return edges


def _crosses(a: FloatArray, b: FloatArray, walls: FloatArray) -> bool:
    """True if the way from a to b [2] leads through one of some walls [W, 4]."""
    if not len(walls):
        return False
    ends = walls.reshape(-1, 2, 2)
    many = np.broadcast_to(np.stack([a, b]), ends.shape)
    return bool((segment_distances(many[:, 0], many[:, 1], ends[:, 0], ends[:, 1]) == 0.0).any())
