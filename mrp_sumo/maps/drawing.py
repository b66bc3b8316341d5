"""Draw a `building.yaml` in metres: stations, lanes, walls, floors and doors of levels, as the RMF Traffic Editor would save it.

The drawing's frame has its origin at the lower left of the building, x right, y up. The file is in pixels from the upper left corner
of an empty canvas with a margin around the building, and carries two measurements, so that every importer finds the metres again.
Refuses two stations on one spot or of one name, and lanes between unknown stations.
"""

import json
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from mrp_sumo.errors import MapError
from mrp_sumo.files.writing import written_whole

Point = tuple[float, float]

METERS_PER_PIXEL = 0.05  # the editor's own scale for a canvas without a drawing
MARGIN_M = 1.0  # around the building
PLAIN = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
NOT_TEXT = frozenset({"y", "n", "yes", "no", "on", "off", "true", "false", "null"})

WALL = "{alpha: [3, 1], texture_name: [1, default]}"
FLOOR = (
    "{ceiling_scale: [3, 1], ceiling_texture: [1, blue_linoleum], indoor: [2, 0], texture_name: [1, %s], "
    "texture_rotation: [3, 0], texture_scale: [3, 1]}"
)
LANE = '{bidirectional: [4, %s], graph_idx: [2, 0], orientation: [1, ""]}'
DOOR = (
    "{motion_axis: [1, start], motion_degrees: [3, 90], motion_direction: [2, %d], name: [1, %s], plugin: [1, normal], "
    "right_left_ratio: [3, 1], type: [1, %s]}"
)


class Drawing:
    """A level, or a building of one, under the pen. Coordinates are metres; whatever is drawn is written in the order it was drawn."""

    def __init__(self, name: str, width_m: float, height_m: float) -> None:
        """`width_m` and `height_m` are the building's, and what the measurements span."""
        self.name = name
        self.width_m, self.height_m = width_m, height_m
        self.stations: list[tuple[float, float, str, str]] = []
        self.lanes: list[tuple[int, int, bool]] = []
        self.walls: list[tuple[int, int]] = []
        self.floors: list[tuple[list[int], str]] = []
        self.doors: list[tuple[int, int, str, str, int]] = []
        self._corners: list[Point] = []
        self._corner_at: dict[Point, int] = {}
        self._taken: set[str | Point] = set()

    def station(self, x: float, y: float, name: str = "", **properties: bool | int | float | str) -> int:
        """A vertex for lanes; returns its number. Properties have RMF's names: `is_charger=True`, `dock_name="dock_1"`."""
        at = (round(x, 6), round(y, 6))
        for taken in (at, name):
            if taken and taken in self._taken:
                raise MapError(f"{self.name}: there is already a station {taken!r}")
            self._taken.add(taken)
        written = ", ".join(f"{key}: [{type_tag(value)}, {scalar(value)}]" for key, value in sorted(properties.items()))
        self.stations.append((x, y, name, written))
        return len(self.stations) - 1

    def lane(self, *stations: int, one_way: bool = False) -> int:
        """Lanes from station to station; returns the last, so that a further lane may go on from there."""
        for a, b in pairwise(stations):
            if not (0 <= a < len(self.stations) and 0 <= b < len(self.stations) and a != b):
                raise MapError(f"{self.name}: a lane cannot join stations {a} and {b} of {len(self.stations)}")
            self.lanes.append((a, b, one_way))
        return stations[-1]

    def wall(self, *points: Point, gaps: Sequence[tuple[float, float]] = ()) -> None:
        """A wall along the points. `gaps` (centre, width) open the first stretch, which must be level or upright, at these x or y."""
        corners = [self._corner(p) for p in points]
        pieces = list(pairwise(corners))
        if gaps:
            (x0, y0), (x1, y1) = points[:2]
            upright = x0 == x1
            low, high = sorted((y0, y1) if upright else (x0, x1))
            stops = [low, *(c + side * w / 2 for c, w in sorted(gaps) for side in (-1, 1)), high]
            ends = [self._corner((x0, s) if upright else (s, y0)) for s in stops]
            pieces[:1] = [(a, b) for a, b in zip(ends[::2], ends[1::2]) if a != b]
        self.walls += pieces

    def box(self, x0: float, y0: float, x1: float, y1: float) -> None:
        """Four walls around a rectangle: a desk, a counter, a pallet."""
        self.wall((x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0))

    def floor(self, *points: Point, texture: str = "blue_linoleum") -> None:
        self.floors.append(([self._corner(p) for p in points], texture))

    def door(self, a: Point, b: Point, name: str, kind: str = "hinged", direction: int = 1) -> None:
        """A door from a (the hinge) to b: hinged, double_hinged, sliding or double_sliding."""
        self.doors.append((self._corner(a), self._corner(b), name, kind, direction))

    def text(self) -> str:
        """The file of a building of one level, L1."""
        return _text(self.name, [*self.level("L1", 0.0), "lifts: {}"])

    def level(self, name: str, elevation_m: float, fiducials: bool = False) -> list[str]:
        """The lines of a level; with fiducials at two corners, which levels of one building share."""
        first = len(self.stations)
        rulers = [self._corner((x, y)) for x, y in ((0, -0.5), (self.width_m, -0.5), (-0.5, 0), (-0.5, self.height_m))]
        lines = [f"  {name}:"]
        if self.doors:
            lines.append("    doors:")
            lines += [f"      - [{first + a}, {first + b}, {DOOR % (turn, scalar(name), kind)}]" for a, b, name, kind, turn in self.doors]
        lines.append(f"    elevation: {_number(elevation_m)}")
        if fiducials:
            lines.append("    fiducials:")
            lines += [
                f"      - [{self._pixels(x, y)}, {name}]"
                for x, y, name in ((0, 0, "southwest"), (self.width_m, self.height_m, "northeast"))
            ]
        lines.append("    floors:")
        for corners, texture in self.floors:
            lines += [f"      - parameters: {FLOOR % texture}", f"        vertices: [{', '.join(str(first + c) for c in corners)}]"]
        lines.append("    lanes:")
        both, single = LANE % "true", LANE % "false"
        lines += [f"      - [{a}, {b}, {single if one_way else both}]" for a, b, one_way in self.lanes]
        lines += ["    layers:", "      {}", "    measurements:"]
        for k, distance_m in ((0, self.width_m), (2, self.height_m)):
            lines.append(f"      - [{first + rulers[k]}, {first + rulers[k + 1]}, {{distance: [3, {round(distance_m, 6):.10g}]}}]")
        lines.append("    vertices:")
        for x, y, name, properties in self.stations:
            lines.append(f"      - [{self._pixels(x, y)}, 0, {scalar(name)}{f', {{{properties}}}' if properties else ''}]")
        lines += [f'      - [{self._pixels(x, y)}, 0, ""]' for x, y in self._corners]
        if self.walls:
            lines.append("    walls:")
            lines += [f"      - [{first + a}, {first + b}, {WALL}]" for a, b in self.walls]
        return [*lines, f"    x_meters: {_number(self.width_m + 2 * MARGIN_M)}", f"    y_meters: {_number(self.height_m + 2 * MARGIN_M)}"]

    def pixels(self, x: float, y: float) -> tuple[float, float]:
        """From the upper left corner, y down."""
        return (x + MARGIN_M) / METERS_PER_PIXEL, (self.height_m + MARGIN_M - y) / METERS_PER_PIXEL

    def write(self, path: Path) -> None:
        """Write the file, whole or not at all."""
        with written_whole(path) as part:
            part.write_text(self.text(), encoding="utf-8")

    def _corner(self, point: Point) -> int:
        """Number of the point among those that walls, floors, doors and measurements share."""
        key = (round(point[0], 6), round(point[1], 6))
        if key not in self._corner_at:
            self._corner_at[key] = len(self._corners)
            self._corners.append(key)
        return self._corner_at[key]

    def _pixels(self, x: float, y: float) -> str:
        """In pixels from the upper left corner, y down."""
        return ", ".join(map(_number, self.pixels(x, y)))


def _text(name: str, lines: Sequence[str]) -> str:
    return "\n".join(["coordinate_system: reference_image", "graphs:", "  {}", "levels:", *lines, f"name: {scalar(name)}"]) + "\n"


def _number(value: float) -> str:
    """At most three decimals: a thousandth of a pixel is below what anything here can see."""
    return f"{value:.3f}".rstrip("0").rstrip(".")


def type_tag(value: bool | int | float | str) -> int:
    """RMF's type tag: 1 string, 2 integer, 3 number, 4 boolean."""
    return 4 if isinstance(value, bool) else 2 if isinstance(value, int) else 3 if isinstance(value, float) else 1


def scalar(value: bool | int | float | str) -> str:
    """As the editor writes it; text in quotes where YAML could take it for something else."""
    if isinstance(value, str):
        return value if PLAIN.match(value) and value.lower() not in NOT_TEXT else json.dumps(value)
    return str(value).lower() if isinstance(value, bool) else str(value)
