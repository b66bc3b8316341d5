"""The building around the lanes, for pictures of a run: walls, floors, doors and lift cabins as `building.json`.

Only levels that are driven on, in the frame of the trajectory, rounded to a millimetre. Refuses files of another schema.
"""

import json
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.files.reading import read_json
from mrp_sumo.maps.building import Building

SCHEMA_VERSION = 1
FARTHEST_M = 1e7  # a coordinate beyond is none of a building


@dataclass(frozen=True, eq=False)
class Outline:
    """Strokes and polygons in m, all levels in one frame where they do not overlap."""

    walls: FloatArray  # [W, 2, 2]
    doors: FloatArray  # [D, 2, 2]
    floors: tuple[FloatArray, ...]  # [N, 2] each
    holes: tuple[FloatArray, ...]
    lifts: tuple[FloatArray, ...]  # [4, 2] corners of each cabin on each of its levels


def outline_of(building: Building, level_names: Collection[str]) -> Outline:
    """The outline of some levels; names that the building does not have are ignored."""
    levels = [level for name, level in building.levels.items() if name in level_names]
    lifts = []
    for level in levels:
        shift = level.xy[0] - level.world_xy[0] if len(level.xy) else np.zeros(2)
        for lift in building.lifts.values():
            if lift.level_doors and lift.lowest_m <= level.elevation_m <= lift.highest_m:
                across = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * (lift.width_m / 2, lift.depth_m / 2)
                c, s = np.cos(lift.yaw_rad), np.sin(lift.yaw_rad)
                lifts.append(across @ np.array([(c, s), (-s, c)]) + (lift.x_m, lift.y_m) + shift)
    none = np.zeros((0, 2, 2))
    return Outline(
        walls=np.concatenate([none, *(part for level in levels for part in (level.wall_xy, level.zone_sides_xy))]),
        doors=np.concatenate([none, *(level.xy[[(d.start, d.end)]] for level in levels for d in level.doors)]),
        floors=tuple(level.xy[list(polygon)] for level in levels for polygon in level.floors if len(polygon) > 2),
        holes=tuple(level.xy[list(polygon)] for level in levels for polygon in level.holes if len(polygon) > 2),
        lifts=tuple(lifts),
    )


def write_outline(path: Path, outline: Outline) -> None:
    """Write `building.json`."""

    def plain(part: FloatArray | tuple[FloatArray, ...]) -> Any:
        return [plain(p) for p in part] if isinstance(part, tuple) else part.round(3).tolist()

    document = {"schema_version": SCHEMA_VERSION, "units": "m", **{key: plain(part) for key, part in vars(outline).items()}}
    path.write_text(json.dumps(document, separators=(",", ":"), allow_nan=False) + "\n", encoding="utf-8")


def read_outline(path: Path) -> Outline | None:
    """Read `building.json` back; None where there is none. Raises MrpSumoError for a file that is damaged, or of another schema."""
    if not path.exists():
        return None
    document = read_json(path)
    try:
        if document["schema_version"] != SCHEMA_VERSION:
            raise MrpSumoError(f"{path}: schema version {document['schema_version']}, expected {SCHEMA_VERSION}")
        return Outline(
            walls=_points(document["walls"]).reshape(-1, 2, 2),
            doors=_points(document["doors"]).reshape(-1, 2, 2),
            **{key: tuple(_points(p).reshape(-1, 2) for p in document[key]) for key in ("floors", "holes", "lifts")},
        )
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        raise MrpSumoError(f"{path}: not the outline of a building: {error}") from None


def _points(values: Any) -> FloatArray:
    array = np.array(values, np.float64)
    if not (np.abs(array) <= FARTHEST_M).all():
        raise ValueError(f"a coordinate beyond {FARTHEST_M:g} m")
    return array
