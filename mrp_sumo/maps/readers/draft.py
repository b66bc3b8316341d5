"""A nav graph while a reader gathers it from a file of the industry: vertices by their identifiers, lanes, curves, stations, findings.

Of lanes that join the same two vertices straight in the same direction the first stays. A curve becomes a chain of lanes over vertices
with the option `is_bend`, which `cut_lanes` cuts as one lane; a curve back along the same line shares them.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from mrp_sumo.core.digraph import strong_components
from mrp_sumo.core.graph import NO_PROPERTIES, STATIONS, FloatArray, NavGraph, Properties, nav_graph
from mrp_sumo.errors import nearest
from mrp_sumo.files.names import free_name
from mrp_sumo.files.reading import shortened
from mrp_sumo.maps.building import Building, Door, Level
from mrp_sumo.maps.check import check_graph
from mrp_sumo.maps.curves import Line
from mrp_sumo.maps.finding import Notes, RefusedMap, ordered
from mrp_sumo.maps.levels import joined_by_lifts, laid_out, level_choice
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.readers.reader import map_name
from mrp_sumo.maps.yaml_text import Text

LEVEL = "L1"  # of files that name none
SAME_PLACE_M = 1e-3  # ends and bends closer than this are one
LARGE_M = 1000.0  # a site that is larger is probably drawn in another unit
MOST_COMPARED = 2000  # names
TURN_RAD = 2 * np.pi + 1e-3  # angles beyond are degrees


class _Lane(NamedTuple):
    tail: int
    head: int
    speed_mps: float
    options: Properties


@dataclass
class Draft:
    """A map under construction. Vertices are numbered as they come, bends among them."""

    source: Text
    notes: Notes = field(default_factory=Notes)
    level_names: list[str] = field(default_factory=list)
    vertex: dict[Any, int] = field(default_factory=dict)  # by the identifier in the file
    path_of: dict[Any, str] = field(default_factory=dict)  # where in the file each identifier stands
    _xy: list[tuple[float, float]] = field(default_factory=list)
    _level: list[int] = field(default_factory=list)
    _name: list[str] = field(default_factory=list)
    _names: set[str] = field(default_factory=set)  # given by `rename`
    _options: list[dict[str, Any]] = field(default_factory=list)
    _lanes: dict[tuple[int, int], _Lane] = field(default_factory=dict)
    _chains: dict[tuple[int, int], list[list[int]]] = field(default_factory=dict)  # bends of curves from a vertex to another
    _nowhere: list[str] = field(default_factory=list)
    _twin: dict[int, int] = field(default_factory=dict)  # vertex -> the one at its place that stands for both
    _riders: dict[str, set[int]] = field(default_factory=dict)  # vertices that a lift joins

    def add_vertex(self, key: Any, name: str, xy: tuple[float, float], level: str = LEVEL, **options: Any) -> int:
        """A vertex; options that are None or false are left out."""
        if level not in self.level_names:
            self.level_names.append(level)
        self.vertex[key] = v = len(self._xy)
        self._xy.append(xy)
        self._level.append(self.level_names.index(level))
        self._name.append(name)
        self._options.append({})
        self.set_options(v, **options)
        return v

    def add_lane(
        self, tail: int, head: int, *, speed_mps: float = np.inf, options: Properties = NO_PROPERTIES, line: Line | None = None
    ) -> None:
        """A lane, straight or along a line with bends; lanes without length are noted and left out."""
        if tail == head:
            self.notes.add("lane_without_length", f"from '{self.label(tail)}' to itself")
            return
        if self._level[tail] != self._level[head]:
            self._ride(tail, head)
            return
        (ax, ay), (bx, by) = self._xy[tail], self._xy[head]
        line = None if line is None else simplified(line)
        bends = np.zeros((0, 2)) if line is None else line.xy[1:-1]
        if not len(bends) and abs(ax - bx) < SAME_PLACE_M and abs(ay - by) < SAME_PLACE_M:
            self._join(tail, head)
            return
        if line is None or not len(bends):
            self._add(tail, head, speed_mps, options)
            return
        chain = self._chain_back(tail, head, bends) or self._new_chain(tail, head, line)
        for a, b in zip([tail, *chain], [*chain, head]):
            self._add(a, b, speed_mps, options)

    def add_station(self, v: int, name: str, **options: Any) -> None:
        """A station of this name at a vertex, with options for the vertex."""
        held = self._options[self._root(v)]
        names = [*held["station"].split(STATIONS), name] if "station" in held else [name]
        held["station"] = STATIONS.join(dict.fromkeys(names))  # once, where two nodes of a station are at one place
        self.set_options(self._root(v), **options)

    def set_options(self, v: int, **options: Any) -> None:
        """More options of a vertex; None and false are left out."""
        self._options[v] |= {key: value for key, value in options.items() if value is not None and value is not False}

    def set_mutex(self, group: str, vertices: Iterable[int], lanes: Sequence[tuple[int, int]]) -> None:
        """Make vertices and lanes between vertices members of a group for one robot at a time; a lane with all its pieces."""
        bends = {v for pair in lanes for chain in self._chains.get(pair, []) for v in chain}
        for v in (*vertices, *sorted(bends)):
            if self._options[v].setdefault("mutex", group) != group:
                self.notes.add("several_groups", f"'{self.label(v)}' is in '{self._options[v]['mutex']}' and '{group}'")
        for pair in lanes:
            for key in self._pieces(*pair):
                options = dict(self._lanes[key].options)
                if options.setdefault("mutex", group) != group:
                    self.notes.add(
                        "several_groups", f"lane '{self.label(pair[0])}' - '{self.label(pair[1])}': '{options['mutex']}', '{group}'"
                    )
                self._lanes[key] = self._lanes[key]._replace(options=options)

    def rename(self, v: int, name: str) -> None:
        """Give a vertex a name; one that another has gets a number: dock, dock_2."""
        free = free_name(name, self._names)
        if free != name:
            self.notes.add("duplicate_vertex_name", name)
        self._names.add(free)
        self._name[v] = free

    def note_nowhere(self, at: str, what: str) -> None:
        """An edge that ends at a vertex that is not there: refused at the end, with all others of the kind."""
        self._nowhere.append(f"{at}: {what}")

    def note_angle(self, what: str, angle: float) -> bool:
        """True for an angle that must be degrees, since no turn in radians is so large; that is noted."""
        if abs(angle) > TURN_RAD:
            self.notes.add("theta_in_degrees", f"{what} is {angle:g}")
            return True
        return False

    def nearest(self, name: str) -> str:
        """The end of a message about a vertex that is not there; '' where too many are to be compared with."""
        known = [str(key) for key in self.vertex if not isinstance(key, tuple)]  # such as of bends
        return nearest(name, known) if len(known) <= MOST_COMPARED else ""

    def label(self, v: int) -> str:
        return self._name[v] or f"v{v}"

    def place(self, v: int) -> tuple[float, float]:
        return self._xy[v]

    def to_map(self, level: str | None = None, building: Building | None = None) -> Map:
        """The map of one level or of all, side by side, checked; the building is drawn around the lanes, in the same coordinates.

        Raises RefusedMap for edges that end nowhere, and for maps without lanes.
        """
        for detail in self._nowhere:
            self.notes.add("edge_to_nowhere", detail)
        if self._nowhere:
            more = f"; and {len(self._nowhere) - 1} more, which --check lists" if len(self._nowhere) > 1 else ""
            raise RefusedMap(f"{shortened(self.source.path)}: {self._nowhere[0]}{more}", self.notes.findings())
        if not self._lanes:  # lanes without length make none
            findings = self.notes.findings()
            left_out = next((f"; {finding.line}" for finding in findings if finding.kind == "edge_of_no_type"), "")
            self.notes.add("no_lanes", f"{len(self._xy)} vertices")
            message = f"{shortened(self.source.path)}: no lanes: nothing to drive on ({len(self._xy)} vertices){left_out}"
            raise RefusedMap(message, self.notes.findings())
        nav = self._nav(map_name(self.source.path), level)
        shift = laid_out(nav, building)
        elevation_m = {k: lv.elevation_m for k, lv in building.levels.items()} if building else {}
        width, height = np.ptp(nav.xy, axis=0).tolist()
        if max(width, height) > LARGE_M:
            self.notes.add("extent_above_1_km", f"{width:.0f} x {height:.0f} m: is the file in millimetres?")
        joined = joined_by_lifts(nav, shift, elevation_m, building.lifts if building else {})
        self._note_stations(joined)
        return Map(
            name=nav.name,
            path=self.source.path,
            nav=joined,
            building=building.moved(shift) if building else None,
            findings=ordered(self.notes.findings() + check_graph(joined)),
            level_shift_m=shift,
        )

    def _nav(self, name: str, level: str | None) -> NavGraph:

        wanted = level_choice(dict.fromkeys(self.level_names), level, shortened(self.source.path))
        lanes = self._joined_lanes() if self._twin else list(self._lanes.values())
        driven = {self.level_names[self._level[lane.tail]] for lane in lanes}
        for empty in [name for name in wanted if name not in driven]:
            self.notes.add("level_without_lanes", f"level {empty}")
            wanted.remove(empty)
        if not wanted:
            raise self.source.fault(f"level '{level}' has no lane")
        vertices = [v for v, k in enumerate(self._level) if self.level_names[k] in wanted and v not in self._twin]
        number = {v: i for i, v in enumerate(vertices)}
        lanes = [lane for lane in lanes if lane.tail in number]
        return nav_graph(
            name=name,
            xy=[self._xy[v] for v in vertices],
            lanes=[(number[lane.tail], number[lane.head]) for lane in lanes],
            level_names=wanted,
            level=[wanted.index(self.level_names[self._level[v]]) for v in vertices],
            vertex_name=[self._name[v] for v in vertices],
            vertex_options=[self._options[v] for v in vertices],
            speed_mps=[lane.speed_mps for lane in lanes],
            lane_options=[lane.options for lane in lanes],
            source=str(self.source.path),
        )

    def _join(self, tail: int, head: int) -> None:
        """An edge of no length: both ends are one vertex, at which vehicles turn. The earlier stays, with the options of both."""
        stays, goes = sorted((self._root(tail), self._root(head)))
        if stays == goes:
            return
        self.notes.add("vertices_at_one_place", f"'{self.label(goes)}' is '{self.label(stays)}'")
        self._twin[goes] = stays
        options = self._options[goes]
        if "station" in options and "station" in self._options[stays]:
            options = {**options, "station": f"{self._options[stays]['station']}{STATIONS}{options['station']}"}
        self._options[stays] |= options

    def _root(self, v: int) -> int:
        while v in self._twin:
            v = self._twin[v]
        return v

    def _joined_lanes(self) -> list[_Lane]:
        joined: dict[tuple[int, int], _Lane] = {}
        for lane in self._lanes.values():
            tail, head = self._root(lane.tail), self._root(lane.head)
            if tail != head:
                joined.setdefault((tail, head), lane._replace(tail=tail, head=head))
        return list(joined.values())

    def _add(self, tail: int, head: int, speed_mps: float, options: Properties) -> None:
        before = self._lanes.get((tail, head))
        if before is None:
            self._lanes[tail, head] = _Lane(tail, head, speed_mps, options)
            return
        self.notes.add("parallel_lanes", f"from '{self.label(tail)}' to '{self.label(head)}'")
        if before.options.get("load") != options.get("load"):  # one of them serves those with a load, another those without
            remaining = {key: value for key, value in before.options.items() if key != "load"}
            self._lanes[tail, head] = before._replace(options=remaining, speed_mps=max(before.speed_mps, speed_mps))
        elif before.options.get("vehicle_types") != options.get("vehicle_types"):  # each is for types of its own
            types = {kind for each in (before.options, options) for kind in str(each.get("vehicle_types", "")).split(", ")}
            joined = {**before.options, "vehicle_types": ", ".join(sorted(types))} if "" not in types else before.options
            self._lanes[tail, head] = before._replace(options=joined, speed_mps=min(before.speed_mps, speed_mps))

    def _ride(self, tail: int, head: int) -> None:
        """A lane between levels: the lift that both ends are in."""
        named = [self._options[v]["lift"] for v in (tail, head) if "lift" in self._options[v]]
        lift = named[0] if named else f"lift {self.label(min(tail, head))}"
        riders = {tail, head}.union(*(self._riders.pop(name, set()) for name in {*named, lift}))
        self._riders[lift] = riders
        for v in riders:
            self._options[v]["lift"] = lift

    def _chain_back(self, tail: int, head: int, bends: FloatArray) -> list[int]:
        """The bends of a curve from head to tail along the same line, in reverse."""
        for chain in self._chains.get((head, tail), []):
            back = chain[::-1]
            if len(back) == len(bends) and np.abs(np.array([self._xy[v] for v in back]) - bends).max() < SAME_PLACE_M:
                self._chains.setdefault((tail, head), []).append(back)
                return back
        return []

    def _new_chain(self, tail: int, head: int, line: Line) -> list[int]:
        chain: list[int] = []
        level = self.level_names[self._level[tail]]
        for k, (x, y) in enumerate(line.xy[1:-1].tolist()):
            chain.append(self.add_vertex(("bend", len(self._xy)), "", (x, y), level, is_bend=True, **line.courses_at(k + 1)))
        self._chains.setdefault((tail, head), []).append(chain)
        return chain

    def _pieces(self, tail: int, head: int) -> list[tuple[int, int]]:
        """The lanes that stand for all lanes from a vertex to another."""
        pieces = [(tail, head)] if (tail, head) in self._lanes else []
        for chain in self._chains.get((tail, head), []):
            pieces += [pair for pair in zip([tail, *chain], [*chain, head]) if pair in self._lanes]
        return pieces

    def _note_stations(self, nav: NavGraph) -> None:
        """Stations outside the largest part in which every vertex can be reached from every other."""
        strong = strong_components(nav.num_vertices, nav.tail, nav.head)
        largest = int(np.bincount(strong).argmax())
        for v, options in enumerate(nav.vertex_options):
            if strong[v] != largest and ("station" in options or options.get("is_charger") or options.get("is_parking_spot")):
                what = f"'{options['station']}' at '{nav.label(v)}'" if "station" in options else f"'{nav.label(v)}'"
                self.notes.add("station_out_of_reach", what)


def building_of_walls(
    draft: Draft,
    walls: Mapping[str, Sequence[Any]],
    doors: Mapping[str, Sequence[Any]] = MappingProxyType({}),
    elevation_m: Mapping[str, float] = MappingProxyType({}),
) -> Building:
    """The building that is drawn around the lanes of a draft.

    By level: walls are pairs of ends, each (x, y) in m, doors (end, end, name, kind of door), elevations 0 by default.
    """
    levels = {}
    for name in dict.fromkeys([*draft.level_names, *walls, *doors]):
        strokes, openings = walls.get(name, ()), doors.get(name, ())
        ends = [place for stroke in strokes for place in stroke[:2]] + [place for door in openings for place in door[:2]]
        xy = np.array(ends, np.float64).reshape(-1, 2)
        first = 2 * len(strokes)
        levels[name] = Level(
            name=name,
            elevation_m=elevation_m.get(name, 0.0),
            raw_xy=xy,
            world_xy=xy,
            xy=xy,
            vertex_name=("",) * len(xy),
            vertex_options=(NO_PROPERTIES,) * len(xy),
            walls=np.arange(first).reshape(-1, 2),
            doors=tuple(Door(first + 2 * i, first + 2 * i + 1, str(door[2]), str(door[3])) for i, door in enumerate(openings)),
        )
    return Building(
        name=map_name(draft.source.path),
        path=draft.source.path,
        coordinate_system="cartesian_meters",
        levels=levels,
        lifts={},
    )


def simplified(line: Line) -> Line:
    """The line without bends where it is straight, and without those that lie on others."""
    xy, ends = line.xy, np.array([0, -1])
    if len(xy) < 3:
        return Line(xy)
    chord = xy[-1] - xy[0]
    length = float(np.hypot(*chord))
    off = xy[1:-1] - xy[0]
    if length > 0:
        along = off @ chord / length
        if (np.abs(off[:, 0] * chord[1] - off[:, 1] * chord[0]) / length < SAME_PLACE_M).all() and (
            np.diff(along, prepend=0, append=length) >= 0
        ).all():
            return Line(xy[ends])
    apart = np.hypot(*(xy[1:] - xy[:-1]).T) >= SAME_PLACE_M
    keep = np.concatenate([[True], apart[:-1] & apart[1:], [True]])
    return Line(xy[keep], None if line.course_rad is None else line.course_rad[keep])


def plain_options(members: Mapping[str, Any], taken: Iterable[str] = ()) -> dict[str, Any]:
    """Members of a JSON object that options can hold: one value each."""
    left = set(taken)
    return {str(k): v for k, v in members.items() if k not in left and isinstance(v, str | int | float | bool)}
