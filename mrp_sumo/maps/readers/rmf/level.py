"""A level of an RMF building file, checked and in the file's own units; and how values of such files are checked.

Refuses vertices, lanes and parameters of a wrong form, indices out of range, and numbers that are none.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.maps.building import Door, Lane, Level, Model
from mrp_sumo.maps.finding import Notes
from mrp_sumo.maps.yaml_text import Text

NUM_GRAPHS = 9  # 0..8; 9 is for human lanes, which are never exported
FARTHEST = 1e8  # no building is larger, in pixels or metres; SUMO computes with 6 decimals


@dataclass(frozen=True, eq=False, kw_only=True)
class LevelDraft(Level):
    """A level that has no place yet: positions, and those of models, are in units of its file, y up."""

    measurements: tuple[tuple[int, int, float], ...]
    fiducials: tuple[tuple[float, float, str], ...]
    is_mapping: bool

    def level(self, world_xy: FloatArray, origin_m: tuple[float, float], models: tuple[Model, ...]) -> Level:
        drawn = {each.name: getattr(self, each.name) for each in fields(Level)}
        return Level(**drawn | {"world_xy": world_xy, "xy": world_xy - origin_m, "models": models})


class LevelReader:
    """Checks values of the document; knows the file, to point at faults, and gathers findings."""

    def __init__(self, source: Text, notes: Notes) -> None:
        self.source, self.notes = source, notes

    def number(self, value: Any, what: str, keys: tuple[str | int, ...]) -> float:
        if isinstance(value, str):  # 1e-05 is text in YAML 1.1
            try:
                value = float(value)
            except ValueError:
                raise self.source.fault(f"{what} is '{value[:40]}', expected a number", *keys) from None
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.source.fault(f"{what} is {shown(value)}, expected a number", *keys)
        if not abs(value) < FARTHEST:  # NaN too
            raise self.source.fault(f"{what} is {min(max(value, -1e308), 1e308):.6g}, expected a number of sensible size", *keys)
        return float(value)

    def items(self, value: Any, what: str, keys: tuple[str | int, ...]) -> list[Any]:
        if value is None:
            return []
        if not isinstance(value, list):
            raise self.source.fault(f"{what} is {shown(value)}, expected a list", *keys)
        return value

    def options(self, value: Any, what: str, keys: tuple[str | int, ...]) -> dict[str, Any]:
        """Typed values `[tag, value]` by name; the values as they are written."""
        if not value:
            return {}
        if not isinstance(value, Mapping):
            raise self.source.fault(f"the parameters of {what} are {shown(value)}, expected a mapping", *keys)
        plain = {}
        for name, typed in value.items():
            if not isinstance(typed, list) or len(typed) != 2 or isinstance(typed[1], list | dict):
                raise self.source.fault(f"{what}: '{name}' is {shown(typed)}, expected [type, value]", *keys)
            tag, content = typed
            if type(content) not in _TYPES.get(tag if isinstance(tag, int) else -1, ()):
                self.notes.add("type_tag_mismatch", f"{what}: {name} [{tag}, {content}]")
            plain[str(name)] = content
        return plain

    def edge(self, value: Any, what: str, num_vertices: int, keys: tuple[str | int, ...]) -> tuple[int, int, dict[str, Any]]:
        """`[start, end, {parameters}]`."""
        if not isinstance(value, list) or len(value) not in (2, 3):
            raise self.source.fault(f"{what} is {shown(value)}, expected [start vertex, end vertex, {{parameters}}]", *keys)
        start, end = (self.vertex(value[i], what, num_vertices, keys) for i in (0, 1))
        return start, end, self.options(value[2] if len(value) == 3 else None, what, keys)

    def polygons(
        self, value: Any, what: str, num_vertices: int, keys: tuple[str | int, ...], *, zones: bool
    ) -> tuple[tuple[int, ...], ...]:
        """Corners of floors and holes, or of zones, which are floors that no robot may be on: `no_robots: [4, true]`."""
        outlines = []
        for i, one in enumerate(self.items(value, what, keys)):
            each, at = f"{what[:-1]} {i}", (*keys, i)
            if not isinstance(one, Mapping):
                raise self.source.fault(f"{each} is {shown(one)}, expected a mapping", *at)
            parameters = one.get("parameters")
            is_zone = isinstance(parameters, Mapping) and parameters.get("no_robots") in ([4, True], True)
            if is_zone == zones:
                corners = self.items(one.get("vertices"), f"{each}: vertices", at)
                outlines.append(tuple(self.vertex(v, each, num_vertices, at) for v in corners))
        return tuple(outlines)

    def vertex(self, value: Any, what: str, num_vertices: int, keys: tuple[str | int, ...]) -> int:
        if type(value) is not int:
            raise self.source.fault(f"{what} names vertex {value!r:.40}, expected a number from 0", *keys)
        if not 0 <= value < num_vertices:
            known = f"{num_vertices} (0 to {num_vertices - 1})" if num_vertices else "none"
            raise self.source.fault(f"{what} names vertex {value}, but the level has {known}", *keys)
        return value


_TYPES: Mapping[int, tuple[type, ...]] = {0: (str, int, float, bool, type(None)), 1: (str,), 2: (int,), 3: (float, int), 4: (bool,)}


def draft_of(reader: LevelReader, name: str, document: Any, key: Any, system: str) -> LevelDraft:
    at: tuple[str | int, ...] = ("levels", key)
    if document is None:
        document = {}
    is_mapping = isinstance(document, Mapping)
    if not is_mapping:
        reader.notes.add("level_not_a_mapping", f"level '{name}' is a {type(document).__name__}")
        document = {}
    up = -1.0 if system == "reference_image" else 1.0
    xy, names, options = [], [], []
    for i, value in enumerate(reader.items(document.get("vertices"), f"level {name}: vertices", (*at, "vertices"))):
        what, keys = f"level {name} vertex {i}", (*at, "vertices", i)
        if not isinstance(value, list) or not 4 <= len(value) <= 5:
            raise reader.source.fault(f"{what} is {shown(value)}, expected [x, y, z, name, {{parameters}}]", *keys)
        xy.append((reader.number(value[0], f"{what}: x", keys), up * reader.number(value[1], f"{what}: y", keys)))
        if isinstance(value[3], list | dict):
            raise reader.source.fault(f"{what}: the name is {shown(value[3])}", *keys)
        if isinstance(value[3], bool):
            reader.notes.add("boolean_name", f"{what}: name {str(value[3]).lower()}, put it in quotes")
        names.append("" if value[3] is None else value[3])
        options.append(reader.options(value[4] if len(value) == 5 else None, what, keys))
    num = len(xy)

    def edges(kind: str, singular: str) -> Any:
        for i, value in enumerate(reader.items(document.get(kind), f"level {name}: {kind}", (*at, kind))):
            what, keys = f"level {name} {singular} {i}", (*at, kind, i)
            yield what, keys, reader.edge(value, what, num, keys)

    def polygons(kind: str, *, zones: bool = False) -> tuple[tuple[int, ...], ...]:
        return reader.polygons(document.get(kind), f"level {name} {kind}", num, (*at, kind), zones=zones)

    lanes = [_lane(reader, what, keys, *edge) for what, keys, edge in edges("lanes", "lane")]
    raw_xy = np.array(xy, np.float64).reshape(-1, 2)
    return LevelDraft(
        name=name,
        elevation_m=reader.number(document.get("elevation", 0) or 0, f"level {name}: elevation", (*at, "elevation")),
        raw_xy=raw_xy,
        world_xy=raw_xy,
        xy=raw_xy,
        vertex_name=tuple(names),
        vertex_options=tuple(options),
        lanes=tuple(lane for lane in lanes if lane is not None),
        walls=np.array([edge[:2] for _, _, edge in edges("walls", "wall")], np.int64).reshape(-1, 2),
        doors=tuple(
            Door(a, b, str(o.get("name", "null")), str(o.get("type", "")), o.get("plugin") == "none")
            for _, _, (a, b, o) in edges("doors", "door")
        ),
        floors=polygons("floors"),
        holes=polygons("holes"),
        zones=polygons("floors", zones=True),
        measurements=tuple(_measurement(reader, *m) for m in edges("measurements", "measurement")),
        fiducials=_fiducials(reader, name, document.get("fiducials"), (*at, "fiducials"), up),
        models=_models(document.get("models"), up),
        is_mapping=is_mapping,
    )


def _models(document: Any, up: float) -> tuple[Model, ...]:
    """Models with a name and a place; others, which nothing here needs, are left out."""
    models = []
    for model in document if isinstance(document, list) else ():
        place = [model.get(key, 0.0) for key in ("x", "y", "yaw")] if isinstance(model, Mapping) else []
        if place and "model_name" in model and all(type(v) in (int, float) and abs(v) <= FARTHEST for v in place):
            models.append(Model(str(model["model_name"]), float(place[0]), up * float(place[1]), float(place[2])))
    return tuple(models)


def _lane(reader: LevelReader, what: str, keys: tuple[str | int, ...], start: int, end: int, members: dict[str, Any]) -> Lane | None:
    if "graph_idx" not in members:
        raise reader.source.fault(f"{what} has no graph_idx", *keys)
    graph = reader.number(members["graph_idx"], f"{what}: graph_idx", keys)
    if graph != int(graph):
        raise reader.source.fault(f"{what}: graph_idx is {graph}, expected a whole number", *keys)
    if not 0 <= graph < NUM_GRAPHS:
        reader.notes.add("graph_out_of_range", f"{what}: graph_idx {graph:.0f} is never exported, expected 0 to {NUM_GRAPHS - 1}")
        return None
    if "bidirectional" not in members:
        reader.notes.add("lane_without_bidirectional", what)
    both_ways = members.get("bidirectional", False)
    if isinstance(both_ways, str) and both_ways.lower() in ("true", "false"):
        both_ways = both_ways.lower() == "true"
    if both_ways not in (True, False):
        raise reader.source.fault(f"{what}: bidirectional is {shown(both_ways)}, expected true or false", *keys)
    orientation = members.get("orientation", "") or ""
    if orientation not in ("", "forward", "backward"):
        raise reader.source.fault(f"{what}: orientation is '{orientation}', expected forward, backward or nothing", *keys)
    options: dict[str, Any] = {"orientation_constraint": orientation} if orientation else {}
    if reader.number(members.get("speed_limit") or 0, f"{what}: speed_limit", keys) > 0:
        options["speed_limit"] = members["speed_limit"]
    if (width_m := reader.number(members.get("width") or 0, f"{what}: width", keys)) > 0:
        options["width"] = width_m
    options |= {k: members[k] for k in ("mutex", "class", "demo_mock_floor_name", "demo_mock_lift_name") if members.get(k)}
    return Lane(start, end, int(graph), bool(both_ways), options)


def _measurement(
    reader: LevelReader, what: str, keys: tuple[str | int, ...], edge: tuple[int, int, dict[str, Any]]
) -> tuple[int, int, float]:
    start, end, options = edge
    if "distance" not in options:
        raise reader.source.fault(f"{what} has no distance", *keys)
    return start, end, reader.number(options["distance"], f"{what}: distance", keys)


def _fiducials(
    reader: LevelReader, level: str, document: Any, keys: tuple[str | int, ...], up: float
) -> tuple[tuple[float, float, str], ...]:
    fiducials = []
    for i, value in enumerate(reader.items(document, f"level {level}: fiducials", keys)):
        what = f"level {level} fiducial {i}"
        if not isinstance(value, list) or len(value) < 3 or isinstance(value[2], list | dict):
            raise reader.source.fault(f"{what} is {shown(value)}, expected [x, y, name]", *keys, i)
        x, y = (reader.number(value[k], f"{what}: {'xy'[k]}", (*keys, i)) for k in (0, 1))
        fiducials.append((x, up * y, "" if value[2] is None else str(value[2])))
    return tuple(fiducials)


def shown(value: Any) -> str:
    """A wrong value in words, for a message."""
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, list):
        return f"{str(value)[:40]}, a list" if len(value) > 0 else "an empty list"
    return "nothing" if value is None else f"'{str(value)[:40]}'"
