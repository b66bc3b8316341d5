"""Sites of Open-RMF's site editor (`site.json`, format 0.1; rmf_site_format): anchors, lanes, locations, walls, doors, lifts.

An anchor with lanes is a vertex, on its level, in metres. A lane has a way back unless `reverse` says `Disable`; `graphs` says which
nav graphs it is in, and one graph is read: the first of the ranking, or the one that is chosen. A location names its anchor. An anchor
in a lift's cabin stands on the level of the lane that leads to it. Refuses lanes between unknown anchors, and coordinates other than
flat ones.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from mrp_sumo.errors import MapError
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.readers.draft import Draft, building_of_walls
from mrp_sumo.maps.readers.json_fields import Fields
from mrp_sumo.maps.readers.reader import MapFile, Selection, refuse_choice

WALL_M = 0.1  # of a cabin
TAGS = {"Charger": "is_charger", "ParkingSpot": "is_parking_spot", "HoldingPoint": "is_holding_point"}
UNNAMED = "<Unnamed>"
Anchors = dict[str, tuple[float, float]]


class RmfSite:
    """Open-RMF's sites."""

    name = "RMF site"
    suffixes = (".site.json",)

    def detects(self, file: MapFile) -> bool:
        """A version of the format, or anchors, beside levels."""
        document = file.document
        return isinstance(document, Mapping) and "levels" in document and ("format_version" in document or "anchors" in document)

    def read(self, file: MapFile, selection: Selection) -> Map:
        """The chosen graph of all levels, or of one."""
        refuse_choice(file.source, selection, "graph", "level")
        if not (selection.graph is None or isinstance(selection.graph, int)):
            raise file.source.fault("of a site one graph is read: choose it by its number")
        return _Site(Fields(file.source), Draft(file.source), file.document).read(selection.graph, selection.level)


@dataclass
class _Site:
    fields: Fields
    draft: Draft
    document: Mapping[str, Any]
    level_name: dict[str, str] = field(default_factory=dict)  # by identifier
    elevation_m: dict[str, float] = field(default_factory=dict)  # by name
    place: dict[str, tuple[str, tuple[float, float]]] = field(default_factory=dict)  # level and coordinates of anchors of levels
    shared: Anchors = field(default_factory=dict)  # of the site, on no level
    cabin: dict[str, tuple[str, tuple[float, float]]] = field(default_factory=dict)  # lift and place of anchors in cabins

    def read(self, number: int | None, level: str | None) -> Map:
        fields, document = self.fields, self.document
        self.shared = self._anchors(fields.object(document, "anchors", "", {}), "anchors")
        for key, at, storey in fields.members(document, "levels", ""):
            about = fields.object(storey, "properties", at)
            name = fields.text(about, "name", f"{at}.properties")
            if name in self.elevation_m:
                raise fields.fault(f"{at}.properties.name", f"'{name[:60]}' is the name of another level, too")
            self.level_name[key] = name
            self.elevation_m[name] = fields.number(about, "elevation", f"{at}.properties", 0.0)
            for anchor, xy in self._anchors(fields.object(storey, "anchors", at, {}), f"{at}.anchors").items():
                self.place[anchor] = (name, xy)
        self._lifts()
        guided = fields.object(fields.object(document, "navigation", "", {}), "guided", "navigation", {})
        graph = self._graph(guided, number)
        self._lanes(guided, graph)
        self._locations(guided, graph)
        walls, doors = self._drawing()
        return self.draft.to_map(level, building_of_walls(self.draft, walls, doors, self.elevation_m))

    def _graph(self, guided: Mapping[str, Any], chosen: int | None) -> str | None:
        """The identifier of the graph to read; None where the site has none."""
        at = "navigation.guided"
        graphs = self.fields.object(guided, "graphs", at, {})
        ranking = [str(g) for g in self.fields.list(guided, "ranking", at, [])]
        order = [g for g in ranking if g in graphs] + [g for g in graphs if g not in ranking]
        if chosen is not None and chosen >= max(len(order), 1):
            raise MapError(f"{self.draft.source.path.name}: no graph {chosen}; there are {len(order)}, from 0")
        number = chosen or 0
        if len(order) > 1:
            names = [self.fields.text(self.fields.object(graphs, g, f"{at}.graphs"), "name", f"{at}.graphs.{g}", g) for g in order]
            for k, name in enumerate(names):
                self.draft.notes.add("several_graphs", f"graph {k}: {name}" + (", which is read" if k == number else ""))
        return order[number] if order else None

    def _included(self, document: Mapping[str, Any], graph: str | None, at: str) -> bool:
        """True if a lane or location is in a graph."""
        rule = document.get("graphs", "All")
        if rule == "All" or graph is None:
            return True
        if isinstance(rule, Mapping) and len(rule) == 1:
            ((kind, members),) = rule.items()
            if kind in ("Only", "AllExcept") and isinstance(members, list):
                return (graph in map(str, members)) is (kind == "Only")
        raise self.fields.fault(f"{at}.graphs", f"found {str(rule)[:40]}, expected All, Only or AllExcept")

    def _lanes(self, guided: Mapping[str, Any], graph: str | None) -> None:
        fields = self.fields
        for _, at, lane in fields.members(guided, "lanes", "navigation.guided", {}):
            if not self._included(lane, graph, at):
                continue
            ends = fields.list(lane, "anchors", at)
            if len(ends) != 2:
                raise fields.fault(f"{at}.anchors", f"found {len(ends)} anchors, expected two")
            pair = self._ends(str(ends[0]), str(ends[1]), at)
            if pair is None:
                continue
            forward, reverse = fields.object(lane, "forward", at, {}), lane.get("reverse", "Same")
            self._lane(*pair, forward, f"{at}.forward")
            if isinstance(reverse, Mapping) and isinstance(reverse.get("Different"), Mapping):
                self._lane(*pair[::-1], reverse["Different"], f"{at}.reverse.Different")
            elif reverse == "Same":
                self._lane(*pair[::-1], forward, f"{at}.forward")
            elif reverse != "Disable":
                raise fields.fault(f"{at}.reverse", f"found {str(reverse)[:40]}, expected Same, Disable or Different")

    def _lane(self, tail: int, head: int, motion: Mapping[str, Any], at: str) -> None:
        speed = self.fields.number(motion, "speed_limit", at, math.inf)
        options: dict[str, Any] = {}
        constraint = motion.get("orientation_constraint", "None")
        if constraint in ("Forwards", "Backwards"):
            options["orientation_constraint"] = constraint.lower().removesuffix("s")
        dock = self.fields.object(motion, "dock", at, None)
        if dock is not None:
            options["dock_name"] = self.fields.text(dock, "name", f"{at}.dock")
        self.draft.add_lane(tail, head, speed_mps=speed if speed > 0 else math.inf, options=options)

    def _ends(self, start: str, end: str, at: str) -> tuple[int, int] | None:
        """The vertices of a lane; an anchor in a cabin is the one on the level of the other."""
        for k, anchor in enumerate((start, end)):
            if anchor not in self.place and anchor not in self.cabin:
                where = " stands on no level" if anchor in self.shared else " is not there"
                self.draft.note_nowhere(f"{at}.anchors[{k}]", f"anchor {anchor[:20]}{where}")
                return None
        level = self.place[start][0] if start in self.place else self.place[end][0] if end in self.place else None
        if level is None:
            self.draft.notes.add("lane_without_length", f"{at} is within a cabin")
            return None
        return self._vertex(start, level), self._vertex(end, level)

    def _vertex(self, anchor: str, level: str) -> int:
        if anchor in self.cabin:
            lift, xy = self.cabin[anchor]
            key = (anchor, level)
            return self.draft.vertex[key] if key in self.draft.vertex else self.draft.add_vertex(key, "", xy, level, lift=lift)
        own, xy = self.place[anchor]
        return self.draft.vertex[anchor] if anchor in self.draft.vertex else self.draft.add_vertex(anchor, "", xy, own)

    def _locations(self, guided: Mapping[str, Any], graph: str | None) -> None:
        fields, draft = self.fields, self.draft
        for _, at, location in fields.members(guided, "locations", "navigation.guided", {}):
            if not self._included(location, graph, at):
                continue
            anchor = str(location.get("anchor"))
            name = fields.text(location, "name", at, "")
            if anchor not in self.place:
                draft.notes.add("dangling_reference", f"{at}.anchor: {anchor[:20]} is on no level")
                continue
            v = self._vertex(anchor, self.place[anchor][0])
            if name and name != UNNAMED:
                draft.rename(v, name)
            for tag in fields.list(location, "tags", at, []):
                if isinstance(tag, str) and tag in TAGS:
                    draft.set_options(v, **{TAGS[tag]: True})
            if location.get("mutex") is not None:
                draft.set_options(v, mutex=f"mutex {location['mutex']}")

    def _lifts(self) -> None:
        """Anchors in cabins, in the frame of the site: a cabin lies behind the line of its two reference anchors."""
        fields = self.fields
        for key, at, lift in fields.members(self.document, "lifts", "", {}):
            about = fields.object(lift, "properties", at)
            inside = fields.object(lift, "cabin_anchors", at, {})
            ends = [self._flat(str(a)) for a in fields.list(about, "reference_anchors", f"{at}.properties")]
            if len(ends) != 2 or None in ends:
                raise fields.fault(f"{at}.properties.reference_anchors", "expected two anchors that are there")
            (ax, ay), (bx, by) = (end for end in ends if end is not None)
            yaw = math.atan2(-(ax - bx), ay - by)
            shape = fields.object(fields.object(about, "cabin", f"{at}.properties", {}), "Rect", f"{at}.properties.cabin", {})
            back = fields.number(shape, "depth", f"{at}.properties.cabin.Rect", 1.5) / 2 + WALL_M
            x0, y0 = (ax + bx) / 2 - back * math.cos(yaw), (ay + by) / 2 - back * math.sin(yaw)
            name = fields.text(about, "name", f"{at}.properties", f"lift {key}")
            for anchor, (u, v) in self._anchors(inside, f"{at}.cabin_anchors").items():
                xy = (x0 + u * math.cos(yaw) - v * math.sin(yaw), y0 + u * math.sin(yaw) + v * math.cos(yaw))
                self.cabin[anchor] = (name, xy)

    def _drawing(self) -> tuple[dict[str, list[Any]], dict[str, list[Any]]]:
        fields = self.fields
        walls: dict[str, list[Any]] = {}
        doors: dict[str, list[Any]] = {}
        for key, level in fields.object(self.document, "levels", "").items():
            name = self.level_name[key]
            for kind, lines in (("walls", walls), ("doors", doors)):
                for _, at, what in fields.members(level, kind, f"levels.{key}", {}):
                    ends = [self._flat(str(a)) for a in fields.list(what, "anchors", at)]
                    if len(ends) != 2 or None in ends:
                        self.draft.notes.add("dangling_reference", f"{at}.anchors: expected two anchors that are there")
                        continue
                    title = fields.text(what, "name", at, "")
                    lines.setdefault(name, []).append(ends if kind == "walls" else (*ends, "" if title == UNNAMED else title, _door(what)))
        return walls, doors

    def _flat(self, anchor: str) -> tuple[float, float] | None:
        return self.place[anchor][1] if anchor in self.place else self.shared.get(anchor)

    def _anchors(self, document: Mapping[str, Any], at: str) -> Anchors:
        return {str(key): self._anchor(value, f"{at}.{key}") for key, value in document.items()}

    def _anchor(self, document: Any, at: str) -> tuple[float, float]:
        """The place of an anchor; of one with several for different uses, the general one."""
        fields = self.fields
        for kind, value in fields.mapping(document, at).items():
            if kind == "Translate2D":
                return fields.point(value, f"{at}.Translate2D")
            if kind == "CategorizedTranslate2D":
                return fields.point(fields.mapping(value, f"{at}.{kind}").get("General"), f"{at}.{kind}.General")
            if kind == "Pose3D":
                return fields.point(fields.mapping(value, f"{at}.{kind}").get("trans"), f"{at}.{kind}.trans")
            raise fields.fault(at, f"an anchor of kind '{str(kind)[:40]}', expected Translate2D")
        raise fields.fault(at, "an anchor without a place")


def _door(document: Mapping[str, Any]) -> str:
    """The kind of a door by Open-RMF's older names."""
    kind = document.get("kind")
    name = next(iter(kind), "") if isinstance(kind, Mapping) else str(kind or "")
    known = {"SingleSliding": "sliding", "DoubleSliding": "double_sliding", "SingleSwing": "hinged", "DoubleSwing": "double_hinged"}
    return known.get(str(name), "")
