"""Binary costmaps: of a level, the cells its walls cover, what a robot's range sensor would see; of a plan, all but its floor.

Refuses levels that do not exist and resolutions that make too many cells.
"""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.graph import BoolArray, frozen
from mrp_sumo.errors import MapError, nearest
from mrp_sumo.maps.building import WALL_THICKNESS_M, Building

MARGIN_M = 0.5  # free cells around everything
MAX_CELLS = 200_000_000
RESOLUTION_M = 0.05  # side of a cell


@dataclass(frozen=True, eq=False)
class Costmap:
    """Cells in the map's frame."""

    origin_m: tuple[float, float]  # lower left corner of cell (0, 0)
    resolution_m: float
    occupied: BoolArray  # [H, W], row 0 has the lowest y


def costmap(building: Building, level: str) -> Costmap:
    """Rasterise the walls of a level; they are 0.1 m thick. Raises MapError as the module refuses."""
    if level not in building.levels:
        raise MapError(f"{building.path.name} has no level '{level}'{nearest(level, building.levels)}")
    storey = building.levels[level]
    walls = storey.wall_xy
    points = np.concatenate([walls.reshape(-1, 2), storey.xy[storey.lane_vertices]])
    if not len(points):
        points = np.zeros((1, 2))
    low = np.floor((points.min(axis=0) - MARGIN_M) / RESOLUTION_M) * RESOLUTION_M
    width, height = np.ceil((points.max(axis=0) + MARGIN_M - low) / RESOLUTION_M).astype(np.int64).tolist()
    if width * height > MAX_CELLS:
        raise MapError(
            f"level '{level}' of {building.path.name} would need {width} x {height} cells of {RESOLUTION_M:g} m, too many for a costmap"
        )
    occupied = np.zeros((height, width), np.bool_)
    half = WALL_THICKNESS_M / 2 + 1e-9
    for a, b in (walls - low) / RESOLUTION_M:
        _fill(occupied, a, b, half / RESOLUTION_M)
    return Costmap((float(low[0]), float(low[1])), RESOLUTION_M, frozen(occupied))


def _fill(occupied: BoolArray, a: np.ndarray, b: np.ndarray, half: float) -> None:
    """Occupy the cells whose centres are at most `half` from the segment a-b; all in cells."""
    height, width = occupied.shape
    x0, y0 = np.maximum(np.floor(np.minimum(a, b) - half), 0).astype(int)
    x1, y1 = np.minimum(np.ceil(np.maximum(a, b) + half), (width, height)).astype(int)
    x, y = np.arange(x0, x1) + 0.5 - a[0], (np.arange(y0, y1) + 0.5 - a[1])[:, None]
    dx, dy = b - a
    long = dx * dx + dy * dy
    t = np.clip((x * dx + y * dy) / long, 0, 1) if long > 0 else 0.0
    occupied[y0:y1, x0:x1] |= (x - t * dx) ** 2 + (y - t * dy) ** 2 <= half * half
