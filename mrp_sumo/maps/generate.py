"""Maps of any size for scale studies: rack warehouses, street grids, rings and random road maps, as building drawings.

Every map is connected, with one-way lanes strongly so; lanes cross at vertices only; the same arguments give the same map. Sizes are
least sizes: the last row or aisle is completed. Refuses sizes below what a shape needs or above a quarter of a million vertices.
"""

from collections.abc import Callable
from math import ceil, log, pi, sqrt

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.errors import MapError
from mrp_sumo.maps.drawing import Drawing

VERTICES_A_ROBOT = 10  # room to move: about 30 cells of 0.4 m a robot in a warehouse
MAX_VERTICES = 250_000
LEAST_SPACING_M = 0.8  # between vertices: two cells

PITCH_M = 2.8  # of aisles: 1.6 m to drive and pick, 1.2 m of racks back to back
BAY_M = 1.2
SPUR_M = 1.6  # from a lane to the station beside it
SHIFT_M = 0.2  # half a cell: puts the outermost lanes off the lattice, so that no lane lies between two cells


def rack_warehouse(num_vertices: int, *, one_way: bool = False, cross_aisles: int | None = None, bays: int = 8) -> Drawing:
    """Aisles between racks, joined by cross aisles; docks to the south, chargers and parking to the north. At least so many vertices.

    `one_way` aisles go north and south by turns, cross aisles west and east; the ways to docks, chargers and parking stay two-way. There
    are two cross aisles or more, for one-way lanes an even number; by default as many as make the building about as deep as it is wide.
    `bays` are places to pick from in an aisle between two cross aisles, 1.2 m each. Raises MapError as the module refuses.
    """
    _check_size("warehouse", num_vertices, least=12)
    if bays < 1:
        raise MapError(f"a warehouse needs 1 bay or more between cross aisles, not {bays}")
    if cross_aisles is not None and (cross_aisles < 2 or (one_way and cross_aisles % 2)):
        wanted = "2, 4, 6, ... cross aisles with one-way lanes" if one_way else "2 or more cross aisles"
        raise MapError(f"a warehouse has {wanted}, not {cross_aisles}")
    block_m = 3.2 + BAY_M * (bays - 1)
    num_cross, num_aisles = _warehouse_shape(num_vertices, one_way, cross_aisles, bays, block_m)
    width_m, height_m = PITCH_M * (num_aisles + 1), 4.8 + block_m * (num_cross - 1) + 3.2
    d = Drawing("warehouse", width_m, height_m)

    aisle_x = [PITCH_M * (i + 1) - (SHIFT_M if i == 0 else 0) for i in range(num_aisles)]
    cross_y = [4.8 + block_m * k for k in range(num_cross)]
    junction = [[d.station(x, y) for x in aisle_x] for y in cross_y]
    for k, row in enumerate(junction):
        # the southernmost goes west, the northernmost east: with the outer aisles they make a loop
        d.lane(*(row if k % 2 or not one_way else row[::-1]), one_way=one_way)
    for i, x in enumerate(aisle_x):
        for k in range(num_cross - 1):
            picks = [d.station(x, cross_y[k] + 1.6 + BAY_M * b, f"pick_{i + 1}_{k + 1}_{b + 1}") for b in range(bays)]
            aisle = [junction[k][i], *picks, junction[k + 1][i]]
            d.lane(*(aisle[::-1] if i % 2 and one_way else aisle), one_way=one_way)
        d.lane(junction[0][i], d.station(x, 1.8, f"dock_{i + 1}", dock_name=f"dock_{i + 1}"))
        charger = i % 3 == 0
        d.lane(junction[-1][i], d.station(x, cross_y[-1] + SPUR_M, f"{'charger' if charger else 'parking'}_{i + 1}", **_place(charger)))

    _outer_walls(d)
    for y in cross_y[:-1]:
        for i in range(num_aisles - 1):
            middle = (aisle_x[i] + aisle_x[i + 1]) / 2
            d.box(middle - 0.6, y + 1.0, middle + 0.6, y + block_m - 1.0)
    return d


def street_grid(num_vertices: int, *, one_way: bool = False, spacing_m: float = 2.0) -> Drawing:
    """Streets that cross at right angles on an open floor, as in a sorting centre; one-way streets alternate."""
    _check_size("grid", num_vertices, least=4, spacing_m=spacing_m)
    step = 2 if one_way else 1
    num_columns = max(2, step * ceil(sqrt(1.4 * num_vertices) / step))
    num_rows = max(2, step * ceil(num_vertices / num_columns / step))
    margin_m = max(1.2, spacing_m / 2)
    d = Drawing("grid", 2 * margin_m + spacing_m * (num_columns - 1), 2 * margin_m + spacing_m * (num_rows - 1))
    xs, ys = ([margin_m + spacing_m * i - (SHIFT_M if i == 0 else 0) for i in range(n)] for n in (num_columns, num_rows))
    at = [[d.station(x, y, f"crossing_{i + 1}_{j + 1}") for i, x in enumerate(xs)] for j, y in enumerate(ys)]
    for j, row in enumerate(at):
        d.lane(*(row if j % 2 or not one_way else row[::-1]), one_way=one_way)
    for i in range(num_columns):
        column = [row[i] for row in at]
        d.lane(*(column[::-1] if i % 2 and one_way else column), one_way=one_way)
    _outer_walls(d)
    return d


def ring(num_vertices: int, *, one_way: bool = False, spacing_m: float = 2.0) -> Drawing:
    """A loop with a station beside each of its vertices; one-way, it turns counter-clockwise."""
    _check_size("ring", num_vertices, least=12, spacing_m=spacing_m)
    num_stations = ceil(num_vertices / 2)
    radius_m = spacing_m / (2 * np.sin(pi / num_stations))
    middle_m = radius_m + SPUR_M + 1.2
    d = Drawing("ring", 2 * middle_m, 2 * middle_m)
    angle = 2 * pi * np.arange(num_stations) / num_stations
    ends = [np.stack([middle_m + r * np.cos(angle), middle_m + r * np.sin(angle)], axis=1).tolist() for r in (radius_m, radius_m + SPUR_M)]
    loop = [d.station(x, y) for x, y in ends[0]]
    d.lane(*loop, loop[0], one_way=one_way)
    for k, (x, y) in enumerate(ends[1]):
        charger = k % 10 == 0
        d.lane(loop[k], d.station(x, y, f"{'charger' if charger else 'station'}_{k + 1}", **(_place(charger) if charger else {})))
    _outer_walls(d)
    return d


def random_roads(num_vertices: int, *, seed: int = 0, spacing_m: float = 4.0) -> Drawing:
    """A road map of places scattered over a floor, with the lanes of a spanning tree and half of the other sensible ones.

    Sensible are the lanes of the Gabriel graph (Gabriel and Sokal, Systematic Zoology 18, 1969): no third vertex in the circle over
    the lane, so that lanes neither cross nor pass close by a vertex. It contains the minimum spanning tree.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import minimum_spanning_tree

    _check_size("random", num_vertices, least=8, spacing_m=spacing_m)
    rng = np.random.default_rng([seed, 0x67656E])
    num_columns = ceil(sqrt(1.4 * num_vertices))
    num_rows = ceil(num_vertices / num_columns)
    lattice = np.stack(np.meshgrid(np.arange(num_columns), np.arange(num_rows)), axis=-1).reshape(-1, 2)[:num_vertices]
    xy = (lattice + 0.5 + rng.uniform(-0.25, 0.25, lattice.shape)) * spacing_m  # no two nearer than half the spacing
    xy = np.round(xy, 3)
    pairs = _gabriel_pairs(xy)
    length_m = np.hypot(*(xy[pairs[:, 0]] - xy[pairs[:, 1]]).T)
    tree = minimum_spanning_tree(coo_array((length_m, pairs.T), shape=(num_vertices, num_vertices))).tocoo()
    in_tree = set(zip(tree.row.tolist(), tree.col.tolist()))
    wanted = rng.random(len(pairs)) < 0.5

    d = Drawing("random", spacing_m * num_columns, spacing_m * num_rows)
    for k, (x, y) in enumerate(xy.tolist()):
        charger = k % 25 == 0
        d.station(x, y, f"{'charger' if charger else 'place'}_{k + 1}", **(_place(charger) if charger else {}))
    for k, (a, b) in enumerate(pairs.tolist()):
        if wanted[k] or (a, b) in in_tree:
            d.lane(a, b)
    _outer_walls(d)
    return d


GENERATORS: dict[str, Callable[..., Drawing]] = {
    "warehouse": rack_warehouse,
    "grid": street_grid,
    "ring": ring,
    "random": random_roads,
}


def _check_size(kind: str, num_vertices: int, least: int, spacing_m: float = LEAST_SPACING_M) -> None:
    if not least <= num_vertices <= MAX_VERTICES:
        raise MapError(f"a map of kind '{kind}' has {least} to {MAX_VERTICES} vertices, not {num_vertices}")
    if not LEAST_SPACING_M <= spacing_m <= 100:
        raise MapError(
            f"a spacing of {spacing_m:g} m: expected {LEAST_SPACING_M:g} m or more, so that robots can stand on neighbours, and up to 100 m"
        )


def _warehouse_shape(num_vertices: int, one_way: bool, cross_aisles: int | None, bays: int, block_m: float) -> tuple[int, int]:
    """Numbers of cross aisles and of aisles: enough vertices, and a floor about 1.4 times as wide as deep."""
    step = 2 if one_way else 1

    def aisles(num_cross: int) -> int:
        return max(2, step * ceil(num_vertices / (num_cross + (num_cross - 1) * bays + 2) / step))

    def flaw(num_cross: int) -> float:
        return abs(log(PITCH_M * (aisles(num_cross) + 1) / (8.0 + block_m * (num_cross - 1)) / 1.4))

    choices = [cross_aisles] if cross_aisles else range(2, 3 + ceil(sqrt(num_vertices)), step)
    num_cross = min(choices, key=flaw)
    return num_cross, aisles(num_cross)


def _gabriel_pairs(xy: FloatArray) -> IntArray:
    """[E, 2] pairs a < b of the Gabriel graph, in ascending order."""
    from scipy.spatial import Delaunay, cKDTree

    corners = Delaunay(xy).simplices
    pairs = np.unique(np.sort(np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1), axis=0)
    a, b = xy[pairs[:, 0]], xy[pairs[:, 1]]
    nearest_m, _ = cKDTree(xy).query((a + b) / 2)
    gabriel: IntArray = pairs[nearest_m >= np.hypot(*(b - a).T) / 2 - 1e-9].astype(np.int64)
    return gabriel


def _place(charger: bool) -> dict[str, bool]:
    return {"is_charger": True, "is_parking_spot": True} if charger else {"is_parking_spot": True}


def _outer_walls(d: Drawing) -> None:
    corners = [(0.0, 0.0), (d.width_m, 0.0), (d.width_m, d.height_m), (0.0, d.height_m)]
    d.floor(*corners)
    d.wall(*corners, corners[0])
