"""Plant models of openTCS (`model-7.0.0.xsd` and those before it, from 0.0.2 on): points, paths, locations, blocks.

Lengths are millimetres, velocities mm/s. A point is a vertex, a path a lane; where vehicles may drive a path in reverse, a lane back along
it on which they drive backwards. A location is a station at the points it is linked to, with the operations of its type; parking
positions and chargers keep that. A block for a single vehicle is a mutex group. The drawing counts: Bezier curves and polylines are
flattened within 1 cm, and lengths that differ from them are reported. Of vehicles size and speeds are read, and the least room that
points keep for their envelopes. Refuses paths between unknown points, names given twice, and documents with a DTD: neither entities nor
anything outside the file is read.

Before version 6 coordinates are called `xPosition` and `yPosition`; before 0.0.4 what is drawn stands apart, in the `visualLayout`, whose
points may lie elsewhere than those of the model. Curves are drawn between the places of the layout; where these are not the model's, a
curve is turned and scaled to join the model's. Points that the model puts all at one place lie where the layout has them.
"""

import math
import re
from dataclasses import dataclass, field, replace

import numpy as np

from mrp_sumo.errors import nearest
from mrp_sumo.maps.curves import Line, bezier_knots, flattened
from mrp_sumo.maps.map import ListedVehicle, Map
from mrp_sumo.maps.readers.draft import SAME_PLACE_M, Draft
from mrp_sumo.maps.readers.reader import MapFile, Selection, refuse_choice
from mrp_sumo.maps.readers.rmf.level import FARTHEST
from mrp_sumo.maps.readers.xml_text import Element, parse_xml, root_name

MM = 1e-3
TYPE_KEY = "mrp-sumo:type"  # property of a vehicle with the text of its type
OFF_LENGTH = 0.05  # share by which a path's length may differ from its drawing
OFF_POINT_M = 0.01
COORDINATES = (("positionX", "positionY"), ("xPosition", "yPosition"))  # of points, since version 6 and before
NOT_READ = {"group": "groups", "staticRoute": "static routes"}  # elements of models before version 6


class OpenTcs:
    """openTCS's plant models."""

    name = "openTCS plant model"
    suffixes = (".xml",)

    def detects(self, file: MapFile) -> bool:
        """Its root, with the version that every model states."""
        return root_name(file.text) == "model" and re.search(r"<model\s[^>]*\bversion=", file.text) is not None

    def read(self, file: MapFile, selection: Selection) -> Map:
        """All of it: a model has one level."""
        refuse_choice(file.source, selection)
        return _Model(parse_xml(file.source), Draft(file.source)).read()


@dataclass
class _Model:
    root: Element
    draft: Draft
    pair_of: dict[str, tuple[int, int]] = field(default_factory=dict)  # ends of each path
    layout: dict[str, dict[str, str]] = field(default_factory=dict)  # what a visualLayout says of the objects by their names
    drawn_at: dict[int, tuple[float, float]] = field(default_factory=dict)  # m, of vertices, where the layout names a place

    def read(self) -> Map:
        self._version()
        for layout in self.root.all("visualLayout"):
            for drawn in layout.all("modelLayoutElement"):
                about = {about.get("name", ""): about.get("value", "") for about in drawn.all("property")}
                self.layout.setdefault(drawn.get("visualizedObjectName", ""), about)
        self._points()
        self._paths()
        self._locations()
        self._blocks()
        clear_m = self._clearances()
        vehicles = tuple(_listed(vehicle, clear_m.get(vehicle.get("envelopeKey", ""), 0.0)) for vehicle in self.root.all("vehicle"))
        return replace(self.draft.to_map(), vehicles=vehicles)

    def _clearances(self) -> dict[str, float]:
        """The least distance from a point to the envelope that it has for vehicles of each key, in m."""
        clear_m: dict[str, float] = {}
        for point in self.root.all("point"):
            xy = np.array(self._place(point))
            for envelope in point.all("vehicleEnvelope"):
                corners = np.array([(v.number("x") * MM, v.number("y") * MM) for v in envelope.all("vertex")]).reshape(-1, 2)
                key = envelope.text("key")
                if len(corners) > 2:
                    clear_m[key] = min(clear_m.get(key, math.inf), _distance_m(xy, corners))
        return clear_m

    def _version(self) -> None:
        """Note a version that is not known, and what older ones say that is not read."""
        version = self.root.get("version", "")
        known = re.fullmatch(r"0\.0\.[2-5]|[4-7](\..*)?", version)
        if not known:
            self.draft.notes.add("unknown_version", f"version '{version[:40]}', read as 7")
        lost = [f"its {name} ({count})" for key, name in NOT_READ.items() if (count := sum(1 for _ in self.root.all(key)))]
        costs = [path.number("routingCost", 0.0) for path in self.root.all("path")]
        if len(set(costs)) > 1 and any(cost != path.number("length", 0.0) for cost, path in zip(costs, self.root.all("path"))):
            lost.append(f"the routing costs of {len(costs)} paths")
        if lost:
            self.draft.notes.add("old_model_in_part", f"version '{version[:40]}', without {', '.join(lost)}")

    def _points(self) -> None:
        points = list(self.root.all("point"))
        place = [self._place(point) for point in points]
        drawn = [self._drawn(point) for point in points]
        if len(points) > 1 and len(set(place)) == 1 and len(set(drawn) - {None}) > 1:
            self.draft.notes.add(
                "places_of_the_layout", f"all points are at ({place[0][0]:g}, {place[0][1]:g}) m: they lie as they are drawn"
            )
            place = [at or there for at, there in zip(drawn, place)]
        for point, xy, at in zip(points, place, drawn):
            name = self._named(point)
            kind = point.get("type", "")
            angle = point.get("vehicleOrientationAngle", "NaN")
            v = self.draft.add_vertex(name, name, xy, is_parking_spot=kind == "PARK_POSITION")
            self.drawn_at[v] = xy if at is None else at
            if angle != "NaN":
                self.draft.set_options(v, theta_rad=math.radians(point.number("vehicleOrientationAngle")))

    def _place(self, point: Element) -> tuple[float, float]:
        x, y = next((keys for keys in COORDINATES if keys[0] in point.attributes), COORDINATES[0])
        return point.number(x) * MM, point.number(y) * MM

    def _drawn(self, point: Element) -> tuple[float, float] | None:
        """Where a layout before version 6 has a point, in m; None where it does not say."""
        own = next(point.all("pointLayout"), None)
        if own is not None and "xPosition" in own.attributes:
            return own.number("xPosition") * MM, own.number("yPosition") * MM
        try:
            about = self.layout[point.get("name", "")]
            return float(about["POSITION_X"]) * MM, float(about["POSITION_Y"]) * MM
        except (KeyError, ValueError):
            return None

    def _paths(self) -> None:
        scale = self._scale()
        for path in self.root.all("path"):
            name = self._named(path)
            ends = [self.draft.vertex.get(path.text(key), -1) for key in ("sourcePoint", "destinationPoint")]
            if -1 in ends:
                key = "sourcePoint" if ends[0] < 0 else "destinationPoint"
                missing = path.text(key)
                what = f"{key} of path '{name}': no point '{missing[:60]}'{self.draft.nearest(missing)}"
                self.draft.note_nowhere(f"line {path.line}", what)
                continue
            if path.get("locked", "false") == "true":
                self.draft.notes.add("locked_path", f"'{name}' is left out")
                continue
            tail, head = ends
            self.pair_of[name] = (tail, head)
            line = self._line(path, name, tail, head, scale)
            forward, back = path.number("maxVelocity", 0.0) * MM, path.number("maxReverseVelocity", 0.0) * MM
            kinds = [about.text("value") for about in path.all("property") if about.get("name", "") == "class"]
            options = {"path": name, **({"class": kinds[0]} if kinds else {})}
            if forward > 0:
                self.draft.add_lane(tail, head, speed_mps=forward, options=options, line=line)
            if back > 0:
                options = {**options, "orientation_constraint": "backward"}
                self.draft.add_lane(head, tail, speed_mps=back, options=options, line=line.back)
            drawn = float(np.hypot(*np.diff(line.xy, axis=0).T).sum())
            length_m = path.number("length", 0.0) * MM
            if length_m > 0 and abs(length_m - drawn) > OFF_LENGTH * drawn + OFF_POINT_M:
                self.draft.notes.add("path_length_disagrees", f"'{name}': {length_m:.2f} m, drawn {drawn:.2f} m")

    def _line(self, path: Element, name: str, tail: int, head: int, scale: tuple[float, float]) -> Line:
        ends = np.array([self.draft.place(tail), self.draft.place(head)])
        kind, points = self._control_points(path, name, scale)
        if not points or kind in ("DIRECT", "ELBOW", "SLANTED"):
            return Line(ends)
        drawn = np.array([self.drawn_at[tail], self.drawn_at[head]])
        between = _joining(np.array(points), drawn, ends)
        if between is None:
            self.draft.notes.add("trajectory_unusable", f"'{name}': its ends are drawn at one place; read as straight")
            return Line(ends)
        line = np.concatenate([ends[:1], between, ends[1:]])
        if kind in ("BEZIER", "BEZIER_3") and len(points) in (1, 2, 5):
            degree, pieces = (2, 1) if len(points) == 1 else (3, (len(points) + 1) // 3)
            return flattened(degree, bezier_knots(degree, pieces), line)
        if kind != "POLYPATH":
            self.draft.notes.add("trajectory_unusable", f"'{name}': {kind} with {len(points)} control points; read as a polyline")
        return Line(line)

    def _control_points(self, path: Element, name: str, scale: tuple[float, float]) -> tuple[str, list[tuple[float, float]]]:
        """The kind of line that a path is drawn as, and the places between its ends, in m of the layout."""
        if (layout := next(path.all("pathLayout"), None)) is not None:
            points = [(c.number("x"), c.number("y")) for c in layout.all("controlPoint")]
            kind = layout.get("connectionType", "DIRECT")
        else:
            about = self.layout.get(name, {})
            kind = about.get("CONN_TYPE", "DIRECT").upper()
            try:
                points = [_pair(pair) for pair in about.get("CONTROL_POINTS", "").split(";") if pair.strip()]
            except ValueError:
                self.draft.notes.add("trajectory_unusable", f"'{name}': CONTROL_POINTS '{about['CONTROL_POINTS'][:40]}'; read as straight")
                return "DIRECT", []
        return kind, [(x * scale[0], -y * scale[1]) for x, y in points]

    def _scale(self) -> tuple[float, float]:
        """Metres for a unit of the layout, in which control points are."""
        layout = next(self.root.all("visualLayout"), None)
        return (layout.number("scaleX", 50.0) * MM, layout.number("scaleY", 50.0) * MM) if layout else (0.05, 0.05)

    def _locations(self) -> None:
        operations = {kind.text("name"): [o.text("name") for o in kind.all("allowedOperation")] for kind in self.root.all("locationType")}
        for location in self.root.all("location"):
            name, kind = self._named(location), location.text("type")
            if kind not in operations:
                message = f"line {location.line}: location '{name}' is of no type '{kind[:60]}'{nearest(kind, operations)}"
                self.draft.notes.add("dangling_reference", message)
            for link in location.all("link"):
                point = link.text("point")
                v = self.draft.vertex.get(point, -1)
                if v < 0:
                    self.draft.notes.add("dangling_reference", f"line {link.line}: link of location '{name}' to no point '{point[:60]}'")
                    continue
                allowed = [o.text("name") for o in link.all("allowedOperation")] or operations.get(kind, [])
                allowed = [o for o in allowed if o != "NOP"]
                charges = any("charg" in o.lower() for o in allowed)
                self.draft.add_station(v, name, actions=", ".join(allowed) or None, is_charger=charges)

    def _blocks(self) -> None:
        for block in self.root.all("block"):
            name, points, paths = self._named(block), [], []
            for member in block.all("member"):
                of = member.text("name")
                if of in self.pair_of:
                    tail, head = self.pair_of[of]
                    paths += [(tail, head), (head, tail)]
                elif of in self.draft.vertex:
                    points.append(self.draft.vertex[of])
                elif of not in self.draft.path_of:
                    self.draft.notes.add(
                        "dangling_reference", f"line {member.line}: member '{of[:60]}' of block '{name}' is nothing in the model"
                    )
            if block.get("type", "SINGLE_VEHICLE_ONLY") == "SAME_DIRECTION_ONLY":
                self.draft.notes.add("same_direction_block", f"'{name}': not kept, robots here may meet where its paths allow it")
                continue
            self.draft.set_mutex(name, points, paths)

    def _named(self, element: Element) -> str:
        name = element.text("name")
        if name in self.draft.path_of:
            raise element.fault(f"the name '{name[:60]}' is taken by {self.draft.path_of[name]}")
        self.draft.path_of[name] = f"line {element.line}"
        return name


def _pair(text: str) -> tuple[float, float]:
    x, y = map(float, text.split(","))
    if not max(abs(x), abs(y)) < FARTHEST:
        raise ValueError(text)
    return x, y


def _joining(points: np.ndarray, drawn: np.ndarray, ends: np.ndarray) -> np.ndarray | None:
    """Places [N, 2] drawn between two ends [2, 2], turned and scaled to lie between two others; None where the first two are one place."""
    if np.abs(drawn - ends).max() < SAME_PLACE_M:
        return points
    z, (a, b), (c, d) = points @ (1, 1j), drawn @ (1, 1j), ends @ (1, 1j)
    if abs(b - a) < SAME_PLACE_M:
        return None
    there = c + (z - a) * (d - c) / (b - a)
    return np.stack([there.real, there.imag], axis=1)


def _listed(vehicle: Element, clear_m: float) -> ListedVehicle:
    """A vehicle's size, which version 6 and later say in its bounding box, and its speeds; 0 where the model does not say."""
    box = next(vehicle.all("boundingBox"), None)
    width_mm = 0.0 if box is None else box.number("width", 0.0)
    length_mm = (vehicle if box is None else box).number("length", 0.0)
    speeds = (vehicle.number(key, 0.0) for key in ("maxVelocity", "maxReverseVelocity"))
    width_m, length_m, top_mps, back_mps = (round(each * MM, 6) for each in (width_mm, length_mm, *speeds))
    as_type = next((about.get("value", "") for about in vehicle.all("property") if about.get("name", "") == TYPE_KEY), "")
    return ListedVehicle(vehicle.get("name", ""), length_m, width_m or None, top_mps, back_mps, clear_m, as_type)


def _distance_m(xy: np.ndarray, corners: np.ndarray) -> float:
    """Distance of a place from the border of a polygon [N, 2]."""
    side = np.roll(corners, -1, axis=0) - corners
    share = np.clip(((xy - corners) * side).sum(1) / np.maximum((side**2).sum(1), 1e-12), 0, 1)
    return float(np.hypot(*(corners + share[:, None] * side - xy).T).min())
