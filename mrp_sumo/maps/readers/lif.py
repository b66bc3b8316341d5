"""The VDMA's Layout Interchange Format (LIF), as integrators of vehicles hand it over: 1.0, and the draft of 2.

1.0.0 is that of the VDMA's repository (LIF.md, section 8). Of 2 two states are read: the branch dev/V2 of January 2026 (`origins`,
`vehicleTypeIds`), and its text of autumn 2026 (`mobileRobotTypes` with manufacturer and series, `requiredActions`). Lengths are metres,
angles radians; angles above a turn are taken for degrees and reported.

A node is a vertex, an edge a lane, a station an option of its nodes, a layout's level (`layoutLevelId`, else the nodes' `mapId`) a
level; an edge between levels is a lift. Edges for some types of vehicles only have the option `vehicle_types`, those for vehicles with a
load only, or without one, the option `load`, which robots with orders keep. What robots here do not know is kept as an option of the lane
and reported: turns that are not allowed. Trajectories are flattened within 1 cm. Refuses edges between unknown nodes, and identifiers that
are given twice.
"""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mrp_sumo.errors import nearest
from mrp_sumo.maps.curves import Line, fault_of_curve, flattened
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.readers.draft import Draft
from mrp_sumo.maps.readers.json_fields import Fields
from mrp_sumo.maps.readers.reader import MapFile, Selection, refuse_choice

OFF_NODE_M = 0.05  # a trajectory that begins further from its node does not lead from node to node
MAX_POINTS = 1000  # control points of a trajectory
NODE_TYPES = ("vehicleTypeNodeProperties", "mobileRobotTypeNodeProperties")
EDGE_TYPES = ("vehicleTypeEdgeProperties", "mobileRobotTypeEdgeProperties")
ACTIONS = ("actions", "requiredActions", "feasibleActions")
FREE_TURNS = (None, "BOTH")


class Lif:
    """The VDMA's layouts."""

    name = "LIF"
    suffixes = (".lif.json",)

    def detects(self, file: MapFile) -> bool:
        """Layouts, or origins with layouts, and the format's version or its nodes."""
        document = file.document
        if not isinstance(document, Mapping):
            return False
        about = document.get("metaInformation")
        named = isinstance(about, Mapping) and "lifVersion" in about
        return named or ("metaInformation" in document and ("layouts" in document or "origins" in document))

    def read(self, file: MapFile, selection: Selection) -> Map:
        """The lanes of all types of vehicles, or of the selection's."""
        refuse_choice(file.source, selection, "level", "vehicle_type")
        return _Layouts(Fields(file.source), Draft(file.source), selection.vehicle_type, selection.driven).read(
            file.document, selection.level
        )


@dataclass
class _Layouts:
    fields: Fields
    draft: Draft
    wanted: str | None
    driven: tuple[str, ...] = ()
    types: Counter[str] = field(default_factory=Counter)  # lanes of each type of vehicle
    usable: dict[int, set[str]] = field(default_factory=dict)  # types that may be at each vertex
    restricted: list[str] = field(default_factory=list)  # lanes whose ends restrict turns
    known: set[str] = field(default_factory=set)  # types of all lanes
    slowed: list[str] = field(default_factory=list)  # lanes on which types that are driven have several limits of speed

    def read(self, document: Mapping[str, Any], level: str | None) -> Map:
        about = self.fields.object(document, "metaInformation", "")
        version = self.fields.text(about, "lifVersion", "metaInformation", "")
        if version.split(".")[0] not in ("0", "1", "2"):
            self.draft.notes.add("unknown_version", f"lifVersion '{version[:40]}', read as 1 or 2")
        layouts = list(self._layouts(document))
        self._choose(layouts)
        for at, layout in layouts:
            self._nodes(layout, at)
        for at, layout in layouts:
            self._edges(layout, at)
        for at, layout in layouts:
            self._stations(layout, at)
        self._note_types()
        return replace(self.draft.to_map(level), vehicle_types=tuple(sorted(self.known)))

    def _choose(self, layouts: Sequence[tuple[str, Mapping[str, Any]]]) -> None:
        """Take the lanes of the one type that is driven, where the layouts know it; of several, those that they know count."""
        edges = (edge for at, layout in layouts for edge in self.fields.each(layout, "edges", at))
        self.known = {kind for at, edge in edges for _, types, _ in self._properties(edge, EDGE_TYPES, at) for kind in types}
        if self.wanted is None and len(set(self.driven)) == 1 and self.driven[0] in self.known:
            self.wanted = self.driven[0]
        self.driven = tuple(kind for kind in self.driven if kind in self.known)

    def _layouts(self, document: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
        holders = [("", document)]
        if "origins" in document:
            holders = list(self.fields.each(document, "origins", ""))
        if len(holders) > 1:
            self.draft.notes.add("several_origins", f"{len(holders)} origins, whose frames the format does not relate, in one")
        known: dict[Any, str] = {}
        for above, holder in holders:
            for _, at, layout in self.fields.identified(holder, "layouts", above, "layoutId", known):
                yield at, layout

    def _nodes(self, layout: Mapping[str, Any], above: str) -> None:
        fields, draft = self.fields, self.draft
        floor = fields.text(layout, "layoutLevelId", above, None)
        for name, at, node in fields.identified(layout, "nodes", above, "nodeId", draft.path_of):
            place = fields.object(node, "nodePosition", at)
            level = floor or fields.text(node, "mapId", at, None) or layout["layoutId"]
            xy = (fields.number(place, "x", f"{at}.nodePosition"), fields.number(place, "y", f"{at}.nodePosition"))
            v = draft.add_vertex(name, name, xy, level)
            self.usable[v] = set()
            for where, types, properties in self._properties(node, NODE_TYPES, at):
                self.usable[v].update(types)
                if not self._chosen(types):
                    continue
                theta = fields.number(properties, "theta", where, None)
                if theta is not None:
                    degrees = draft.note_angle(f"theta of '{name}'", theta)
                    draft.set_options(v, theta_rad=math.radians(theta) if degrees else theta)
                draft.set_options(v, **self._of_actions(properties, where))

    def _edges(self, layout: Mapping[str, Any], above: str) -> None:
        fields, draft = self.fields, self.draft
        for name, at, edge in fields.identified(layout, "edges", above, "edgeId", {}):
            ends = [draft.vertex.get(fields.text(edge, key, at), -1) for key in ("startNodeId", "endNodeId")]
            if -1 in ends:
                key = "startNodeId" if ends[0] < 0 else "endNodeId"
                draft.note_nowhere(f"{at}.{key}", f"no node '{edge[key][:60]}'{draft.nearest(edge[key])}")
                continue
            self._edge(name, ends[0], ends[1], self._properties(edge, EDGE_TYPES, at))

    def _edge(self, name: str, tail: int, head: int, properties: Iterable[tuple[str, list[str], Mapping[str, Any]]]) -> None:
        """A lane for the chosen types.

        Where they differ, it is as the first of them has it, with the lowest limit of speed of those that are driven, else the highest.
        """
        several: list[tuple[bool, str, Mapping[str, Any]]] = []  # True for types that are not driven, path, properties
        limits: dict[str, float] = {}
        loads, allowed = set[str](), set[str]()
        if not (properties := list(properties)):
            self.draft.notes.add("edge_of_no_type", f"'{name}'")
        for where, types, own in properties:
            barred = [kind for kind in types if kind not in self.usable[tail] or kind not in self.usable[head]]
            if barred:
                self.draft.notes.add("edge_without_its_nodes", f"'{name}' is for {', '.join(barred)}, one of its nodes is not")
            self.types.update(types)
            if not self._chosen(types) or self.wanted in barred:
                continue
            limit = self.fields.number(own, "maxSpeed" if "maxSpeed" in own else "maximumSpeed", where, math.inf)
            if limit <= 0:
                self.draft.notes.add("speed_of_nothing", f"'{name}': {limit:g} m/s; read as no limit")
                limit = math.inf
            limits |= dict.fromkeys(types, limit)
            allowed.update(set(types).difference(barred))
            loads.add(self._load(own, where))
            several.append((not any(kind in self.driven for kind in types), where, own))
        if not several:
            return
        _, where, own = min(several, key=lambda one: one[0])
        options: dict[str, Any] = {"edge_id": name}
        if len(loads) == 1 and "" not in loads:
            options["load"] = loads.pop()
        if self.wanted is None and allowed and allowed != self.known:
            options["vehicle_types"] = ", ".join(sorted(allowed))
        options |= self._orientation(name, own, where)
        line = self._line(name, tail, head, own, where)
        driven = [limits[kind] for kind in self.driven if kind in limits]
        if len(set(driven)) > 1:
            self.slowed.append(name)
        self.draft.add_lane(tail, head, speed_mps=min(driven) if driven else max(limits.values()), options=options, line=line)

    def _orientation(self, name: str, properties: Mapping[str, Any], where: str) -> dict[str, Any]:
        """Options for how vehicles are turned on an edge, and may turn at its ends."""
        fields, options = self.fields, dict[str, Any]()
        angles = [fields.number(properties, "vehicleOrientation", where, None)]
        for key in ("vehicleOrientations", "mobileRobotOrientations"):
            angles += [fields.finite(a, f"{where}.{key}[{i}]") for i, a in enumerate(fields.list(properties, key, where, []))]
        known = [a for a in angles if a is not None]
        if known and fields.text(properties, "orientationType", where, "TANGENTIAL") == "TANGENTIAL":
            turned = [math.radians(a) if self.draft.note_angle(f"orientation of '{name}'", a) else a for a in known]
            if all(abs(abs(math.remainder(a, 2 * math.pi)) - math.pi) < 0.01 for a in turned):
                options["orientation_constraint"] = "backward"
        for key, option in (("rotationAtStartNodeAllowed", "turns_at_start"), ("rotationAtEndNodeAllowed", "turns_at_end")):
            allowed = properties.get(key)
            if isinstance(allowed, bool):  # as older files have it
                allowed = "BOTH" if allowed else "NONE"
            if allowed not in FREE_TURNS:
                options[option] = fields.text({key: allowed}, key, where)
        if properties.get("rotationAllowed") is True:
            options["turns_on_way"] = True
        if "turns_at_start" in options or "turns_at_end" in options:
            self.restricted.append(name)
        return options

    def _load(self, properties: Mapping[str, Any], where: str) -> str:
        """'loaded' or 'unloaded' where an edge is for these only, else ''."""
        rule = self.fields.object(properties, "loadRestriction", where, None)
        if rule is None or bool(rule.get("loaded")) == bool(rule.get("unloaded")):
            return ""
        return "loaded" if rule.get("loaded") else "unloaded"

    def _line(self, name: str, tail: int, head: int, properties: Mapping[str, Any], where: str) -> Line | None:
        """The line of an edge's trajectory, where it has one that leads from node to node."""
        fields = self.fields
        curve = fields.object(properties, "trajectory", where, None)
        if curve is None:
            return None
        at = f"{where}.trajectory"
        points = fields.list(curve, "controlPoints", at)
        knots = fields.list(curve, "knotVector", at)
        if len(points) > MAX_POINTS or len(knots) > 2 * MAX_POINTS:
            raise fields.fault(f"{at}.controlPoints", f"{len(points)} points, more than {MAX_POINTS} are not read")
        degree = fields.number(curve, "degree", at, 1)
        knots = [fields.finite(k, f"{at}.knotVector[{i}]") for i, k in enumerate(knots)]
        places, weights = [], []
        for on, point in fields.each(curve, "controlPoints", at):
            places.append((fields.number(point, "x", on), fields.number(point, "y", on)))
            weights.append(fields.number(point, "weight", on, 1.0))
        fault = fault_of_curve(degree, knots, len(places))
        if not fault and min(weights) <= 0:
            fault = "a weight that is not above 0"
        if fault:
            self.draft.notes.add("trajectory_unusable", f"'{name}': {fault}; read as straight")
            return None
        even = all(w == weights[0] for w in weights)
        line = flattened(int(degree), knots, np.array(places), None if even else np.array(weights))
        off = max(math.dist(line.xy[0], self.draft.place(tail)), math.dist(line.xy[-1], self.draft.place(head)))
        if off > OFF_NODE_M:
            self.draft.notes.add("trajectory_off_its_nodes", f"'{name}': {off:.2f} m; read as straight")
            return None
        return line

    def _stations(self, layout: Mapping[str, Any], above: str) -> None:
        fields, draft = self.fields, self.draft
        for name, at, station in fields.identified(layout, "stations", above, "stationId", {}, []):
            nodes = fields.list(station, "interactionNodeIds", at)
            if not nodes:
                draft.notes.add("dangling_reference", f"{at}.interactionNodeIds: '{name}' has no node")
            for j, node in enumerate(nodes):
                v = draft.vertex.get(node, -1) if isinstance(node, str) else -1
                if v < 0:
                    where = f"{at}.interactionNodeIds[{j}]"
                    draft.notes.add("dangling_reference", f"{where}: no node '{str(node)[:60]}'{draft.nearest(str(node))}")
                else:
                    draft.add_station(v, name)

    def _of_actions(self, properties: Mapping[str, Any], where: str) -> dict[str, Any]:
        """Options for what vehicles do at a node."""
        kinds: list[str] = []
        for key in ACTIONS:
            kinds += [self.fields.text(action, "actionType", at) for at, action in self.fields.each(properties, key, where, [])]
        options: dict[str, Any] = {"actions": ", ".join(kinds)} if kinds else {}
        if any("charg" in kind.lower() for kind in kinds):
            options["is_charger"] = True
        return options

    def _properties(self, holder: Mapping[str, Any], keys: tuple[str, ...], at: str) -> Iterator[tuple[str, list[str], Mapping[str, Any]]]:
        """What a node or edge says of types of vehicles: path, the types, and their properties."""
        fields = self.fields
        key = keys[1] if keys[1] in holder else keys[0]
        for where, properties in fields.each(holder, key, at):
            if "vehicleTypeId" in properties:
                yield where, [fields.text(properties, "vehicleTypeId", where)], properties
                continue
            several = "mobileRobotTypes" if "mobileRobotTypes" in properties else "vehicleTypeIds"
            names = fields.list(properties, several, where) if several in properties else [fields.text(properties, "vehicleTypeId", where)]
            yield where, [self._type(kind, f"{where}.{several}[{j}]") for j, kind in enumerate(names)], properties

    def _type(self, properties: Any, at: str) -> str:
        """A type by name, or by manufacturer and series."""
        if isinstance(properties, str):
            return properties
        kind = self.fields.mapping(properties, at)
        return f"{self.fields.text(kind, 'manufacturer', at)}.{self.fields.text(kind, 'seriesName', at)}"

    def _chosen(self, types: Iterable[str]) -> bool:
        return self.wanted is None or self.wanted in types

    def _note_types(self) -> None:
        notes, types = self.draft.notes, self.types
        if self.wanted is not None and self.wanted not in types:
            raise self.fields.fault("", f"no edge for vehicle type '{self.wanted}'{nearest(self.wanted, types)}")
        if self.slowed:
            text = f"{len(self.slowed)} lanes have several limits of speed for {', '.join(self.driven)}; the lowest holds for all of them"
            notes.add("limits_by_vehicle_type", text, len(self.slowed))
        if len(types) > 1 and self.wanted is None and not self.driven:
            counts = ", ".join(f"{name} {count}" for name, count in sorted(types.items()))
            notes.add("several_vehicle_types", f"edges for {counts}; all are read, --vehicle-type chooses one", len(types))
        if self.restricted:
            notes.add(
                "turns_restricted",
                f"at ends of {len(self.restricted)} lanes; types that turn in place may do so at every vertex here",
                len(self.restricted),
            )
