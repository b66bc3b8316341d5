"""Buildings as Open-RMF's Traffic Editor has them, made of maps of any format: documents that `yaml_edit` writes.

`{"levels": {"L1": {"vertices": [[x, y, 0, name, {"is_charger": [4, true]}], ...]}}}`, in pixels from the upper left corner.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mrp_sumo.maps.building import Level
from mrp_sumo.maps.curves import COURSES
from mrp_sumo.maps.drawing import METERS_PER_PIXEL, type_tag
from mrp_sumo.maps.map import Map

MARGIN_M = 1.0  # around what a map of another format has
OF_LANES = {
    "orientation_constraint": "orientation",
    "speed_limit": "speed_limit",
    "mutex": "mutex",
    "class": "class",
    "width": "width",
}  # option -> parameter of a drawn lane
OF_READERS = frozenset({"lift", "is_bend", "load", *COURSES})  # options that a drawing has no parameter for


def building_document(map_: Map, *, picture: tuple[str, int, int] | None = None, with_lanes: bool = True) -> dict[str, Any]:
    """A map of any format as a drawing in pixels, with a measurement that says what a pixel is.

    Walls and doors come along, and lanes with their vertices if wanted; shafts of lifts do not. `picture` is name, width and height of the
    picture that the map was made of, whose lower left corner is (0, 0) m; `map_.floor` says its scale.
    """
    nav, building = map_.nav, map_.building
    names = list(dict.fromkeys([*(nav.level_names if with_lanes else ()), *(building.levels if building else ())])) or ["L1"]
    shift = {name: np.array(map_.level_shift_m.get(name, (0.0, 0.0))) for name in names}
    ends = [lv.xy - shift[name] for name, lv in building.levels.items()] if building else []
    if with_lanes:
        ends += [nav.xy[nav.level == k] - shift[name] for k, name in enumerate(nav.level_names)]
    places = np.concatenate([*ends, np.zeros((0, 2))])
    low, high = (places.min(0), places.max(0)) if len(places) else (np.zeros(2), np.zeros(2))
    unit_m, low, high = METERS_PER_PIXEL, low - MARGIN_M, high + MARGIN_M
    if picture is not None and map_.floor is not None:
        unit_m = map_.floor.resolution_m
        low = np.array(map_.floor.origin_m)
        high = low + np.array(picture[1:]) * unit_m
    levels = {}
    for name in names:
        pen = _Pen(low, high, unit_m, shift[name])
        lanes = _lanes(pen, map_, nav.level_names.index(name)) if with_lanes and name in nav.level_names else []
        level: dict[str, Any] = {"elevation": building.levels[name].elevation_m if building and name in building.levels else 0.0}
        if picture is not None:
            level["drawing"] = {"filename": picture[0]}
        if len(names) > 1:
            level["fiducials"] = [[*pen.pixels(low + shift[name]), "southwest"], [*pen.pixels(high + shift[name]), "northeast"]]
        storey = building.levels.get(name) if building else None
        walls, doors = (_walls(pen, storey), _doors(pen, storey)) if storey else ([], [])
        corners = [shift[name] + (x, low[1]) for x in (low[0], high[0])]
        ruler = [*map(pen.vertex, corners), _parameters(distance=float(high[0] - low[0]))]
        level |= {"lanes": lanes, "measurements": [ruler], "vertices": pen.vertices, "walls": walls}
        level |= {"doors": doors} if doors else {}
        level |= {key: _rounded((high - low)[k]) for k, key in enumerate(("x_meters", "y_meters"))}
        levels[name] = level
    return {"coordinate_system": "reference_image", "graphs": {}, "levels": levels, "lifts": {}, "name": map_.name}


class _Pen:
    """Vertices of a level, each place once."""

    def __init__(self, low: np.ndarray, high: np.ndarray, unit_m: float, shift: np.ndarray) -> None:
        self.vertices: list[list[Any]] = []
        self._corner: dict[tuple[float, float], int] = {}
        self._left, self._top, self._unit_m, self._shift = low[0], high[1], unit_m, shift

    def pixels(self, xy: np.ndarray) -> tuple[float, float]:
        x, y = np.asarray(xy) - self._shift
        return _rounded((x - self._left) / self._unit_m), _rounded((self._top - y) / self._unit_m)

    def add(self, xy: np.ndarray, name: str, options: Mapping[str, Any]) -> int:
        """A vertex of lanes."""
        written = _parameters(**{key: value for key, value in options.items() if key not in OF_READERS})
        self.vertices.append([*self.pixels(xy), 0, name, *([written] if written else [])])
        return len(self.vertices) - 1

    def vertex(self, xy: np.ndarray) -> int:
        """A corner of walls."""
        at = self.pixels(xy)
        if at not in self._corner:
            self._corner[at] = len(self.vertices)
            self.vertices.append([*at, 0, ""])
        return self._corner[at]


def _lanes(pen: _Pen, map_: Map, level: int) -> list[list[Any]]:
    nav = map_.nav
    number = {}
    for v in np.flatnonzero(nav.level == level).tolist():
        options = nav.vertex_options[v]
        number[v] = pen.add(nav.xy[v], nav.vertex_name[v] or str(options.get("station", "")), options)
    lanes = []
    for k, (a, b) in enumerate(zip(nav.tail.tolist(), nav.head.tolist())):
        if a not in number or b not in number:
            continue  # a ride
        back = int(nav.reverse[k])
        same = back >= 0 and nav.speed_mps[k] == nav.speed_mps[back] and _options(map_, k) == _options(map_, back)
        if same and back < k:
            continue
        lanes.append([number[a], number[b], _parameters(bidirectional=bool(same), graph_idx=0, **_options(map_, k))])
    return lanes


def _walls(pen: _Pen, level: Level) -> list[list[Any]]:
    return [[pen.vertex(a), pen.vertex(b), _parameters(alpha=1.0, texture_name="default")] for a, b in level.wall_xy]


def _doors(pen: _Pen, level: Level) -> list[list[Any]]:
    return [
        [pen.vertex(level.xy[d.start]), pen.vertex(level.xy[d.end]), _parameters(name=d.name, plugin="normal", type=d.kind or "hinged")]
        for d in level.doors
    ]


def _options(map_: Map, lane: int) -> dict[str, Any]:
    nav = map_.nav
    options = {drawn: nav.lane_options[lane][key] for key, drawn in OF_LANES.items() if key in nav.lane_options[lane]}
    if np.isfinite(nav.speed_mps[lane]):
        options["speed_limit"] = float(nav.speed_mps[lane])
    return {"orientation": "", **options}


def _parameters(**values: Any) -> dict[str, Any]:
    return {key: [type_tag(value), value] for key, value in sorted(values.items()) if isinstance(value, bool | int | float | str)}


def _rounded(value: float) -> float:
    return round(float(value), 3)
