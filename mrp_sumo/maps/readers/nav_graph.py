"""Open-RMF's nav graphs: read, turned into a NavGraph, made of a map, and written.

A document is the nested dict of a `<graph>.yaml`: every map becomes such documents first, so that a
building and the nav graphs Open-RMF makes of it give the same NavGraph. Lanes of no length and repeated
lanes are left out of the NavGraph. Refuses documents whose lanes name vertices that do not exist.
"""

import re
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from mrp_sumo.core.graph import FloatArray, NavGraph, Properties, nav_graph
from mrp_sumo.errors import MapError
from mrp_sumo.files.names import free_name
from mrp_sumo.files.reading import is_number
from mrp_sumo.maps.finding import Notes
from mrp_sumo.maps.levels import shifts_of
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.readers.rmf.level import FARTHEST
from mrp_sumo.maps.readers.rmf.placement import origin_of

Document = Mapping[str, Any]

SHORTEST_LANE_M = 1e-3
PLAIN_NAME = re.compile(
    r"(?!(?:y|n|yes|no|on|off|true|false|null)\Z)[A-Za-z][A-Za-z0-9_-]{0,40}\Z", re.IGNORECASE
)  # needs no quotes in YAML
SHORT_LINE = 64  # characters that always fit on a line, however deep
NUMBERS = ("speed_limit", "merge_radius", "width")


class Misplaced(MapError):
    """A fault at a place of a document; `keys` lead there from the top."""

    def __init__(self, message: str, *keys: Any) -> None:
        super().__init__(message)
        self.keys = keys


def write_nav_graph(document: Document, path: Path) -> None:
    """Write a document as Open-RMF does (generator.py, generate_nav): keys sorted, innermost collections on one line."""
    path.write_text("".join(_lines(document)), encoding="utf-8")


def graph_of_documents(
    documents: Collection[Document], name: str, *, levels: Iterable[str], origin_m: tuple[float, float] = (0.0, 0.0), source: str = ""
) -> NavGraph:
    """The NavGraph of nav graph documents. Raises MapError for lanes between vertices that do not exist, and values of a wrong type.

    Of several, vertices follow graph by graph, as MRP-Bench unites them: those at equal places once for every graph; a lane joins the last
    vertex at the place of each of its ends. So a repeated vertex may have no lane. Of vertices of one graph with one name the later ones
    get a number: dock, dock_2. `levels` are those to take, `origin_m` is subtracted from coordinates.
    """
    wanted, is_united = set(levels), len(documents) > 1
    level_names: list[str] = []
    xy: list[FloatArray] = [np.zeros((0, 2))]
    level: list[int] = []
    vertex_options: list[dict[str, Any]] = []
    lanes: list[tuple[int, int, dict[str, Any]]] = []
    for document in documents:
        for level_name, (places, of_vertices, pairs) in _levels(document, wanted).items():
            if level_name not in level_names:
                level_names.append(level_name)
            first = len(vertex_options)
            xy.append(places)
            level += [level_names.index(level_name)] * len(places)
            vertex_options += of_vertices
            lanes += [(a + first, b + first, o) for a, b, o in pairs]
    places = np.concatenate(xy)
    if is_united:
        last = {(lv, *p): v for v, (lv, p) in enumerate(zip(level, places.tolist()))}
        at = [last[(lv, *p)] for lv, p in zip(level, places.tolist())]
        lanes = [(at[a], at[b], o) for a, b, o in lanes]
    options_of: dict[tuple[int, int], dict[str, Any]] = {}
    for a, b, options in lanes:
        if (a, b) not in options_of and np.hypot(places[a, 0] - places[b, 0], places[a, 1] - places[b, 1]) >= SHORTEST_LANE_M:
            options_of[a, b] = options
    limits = [o.get("speed_limit", 0.0) for o in options_of.values()]
    return nav_graph(
        name=name,
        xy=places - origin_m,
        lanes=list(options_of),
        level_names=level_names or ["L1"],
        level=level,
        vertex_name=_names(vertex_options, distinct=not is_united),
        vertex_options=vertex_options,
        speed_mps=[limit if limit > 0 else np.inf for limit in limits],
        lane_options=list(options_of.values()),
        source=source,
    )


def note_what_changes(document: Document, levels: Collection[str], notes: Notes) -> None:
    """Names that a graph of these levels gives to later vertices with a number, and lanes that it leaves out."""
    names: Counter[str] = Counter()
    for level_name, (xy, options, lanes) in _levels(document, set(levels)).items():
        names.update(each["name"] for each in options if each.get("name"))
        for k, (a, b, _) in enumerate(lanes):
            if np.hypot(*(xy[a] - xy[b])) < SHORTEST_LANE_M:
                notes.add("lane_without_length", f"level {level_name} lane {k} from vertex {a} to {b}")
    for name, times in names.items():
        if times > 1:
            notes.add("name_twice_in_graph", f"'{name}' names {times} vertices")


def origin_of_document(document: Document) -> tuple[float, float]:
    """The document's offset, where its coordinates contain it; else zeros."""
    offset = document.get("offset")
    if not (isinstance(offset, list) and len(offset) == 2 and all(is_number(c, FARTHEST) for c in offset)):
        return (0.0, 0.0)
    places = [xy for xy, _, _ in _levels(document, None).values()]
    return origin_of(np.concatenate([*places, np.zeros((0, 2))]), (float(offset[0]), float(offset[1])))


def document_of_map(map_: Map) -> dict[str, Any]:
    """The nav graph of a map as a document: what its file says where nothing was changed, else made of its graph.

    Lanes through lifts are left out: the option `lift` of the vertices stands for them.
    """
    if len(map_.documents) == 1 and not map_.changes:
        (document,) = map_.documents.values()
        levels = {str(name): level for name, level in document["levels"].items()}
        return {**document, "levels": {name: levels[name] for name in map_.nav.level_names if name in levels}}
    nav = map_.nav
    document = {"building_name": map_.building.name if map_.building else map_.name, "doors": {}, "lifts": {}}
    for source in map_.documents.values():
        document |= {key: value for key, value in source.items() if key != "levels"}
    shift = shifts_of(nav.level_names, map_.level_shift_m)
    places = (nav.xy - shift[nav.level] + map_.origin_m).tolist()
    number = np.zeros(nav.num_vertices, np.int64)
    vertices: list[list[Any]] = [[] for _ in nav.level_names]
    lanes: list[list[Any]] = [[] for _ in nav.level_names]
    for v, level in enumerate(nav.level.tolist()):
        number[v] = len(vertices[level])
        vertices[level].append([*places[v], {"name": nav.vertex_name[v], **nav.vertex_options[v]}])
    for k in np.argsort(nav.source_lane).tolist():
        options = dict(nav.lane_options[k])
        if "lift" not in options:
            if nav.reverse[k] < 0:
                options["is_bidirectional"] = False
            lanes[nav.level[nav.tail[k]]].append([int(number[nav.tail[k]]), int(number[nav.head[k]]), options])
    document["levels"] = {name: {"vertices": v, "lanes": e} for name, v, e in zip(nav.level_names, vertices, lanes)}
    return document


def _lines(document: Document) -> Iterator[str]:
    """The YAML text; vertices and lanes without the general emitter, which takes ten times as long for them."""
    flow: dict[str, str] = {"{}": "{}"}

    def options(mapping: Properties) -> str:
        key = repr(mapping)
        if key not in flow and (plain := _plain(mapping)):
            return plain
        if key not in flow:  # as deep as in the document, for long lines break by their indentation
            text = _dumped({"levels": {"L": {"vertices": [[0, mapping]]}}})
            flow[key] = text.split("      - ", 1)[1].rstrip("\n")
        return flow[key]

    before = {key: value for key, value in document.items() if str(key) < "levels"}
    after = {key: value for key, value in document.items() if str(key) > "levels"}
    yield _dumped(before)
    yield "levels:\n" if document["levels"] else "levels: {}\n"
    for name, level in sorted(document["levels"].items(), key=lambda item: str(item[0])):
        yield "  " + _dumped({name: 0}).replace(": 0\n", ":\n")
        for kind in ("lanes", "vertices"):
            yield f"    {kind}:\n" if level.get(kind) else f"    {kind}: []\n"
            for first, second, *rest in level.get(kind) or ():
                yield f"    - - {_scalar(first)}\n      - {_scalar(second)}\n"
                if rest:
                    yield f"      - {options(rest[0] or {})}\n"
    yield _dumped(after)


def _plain(options: Properties) -> str:
    """Options that need neither quotes nor a second line; '' for others."""
    parts = []
    for key in sorted(options, key=str):
        value = options[key]
        if not PLAIN_NAME.match(str(key)) or not (isinstance(value, bool) or (isinstance(value, str) and PLAIN_NAME.match(value))):
            return ""
        parts.append(f"{key}: {str(value).lower() if isinstance(value, bool) else value}")
    text = ", ".join(parts)
    return f"{{{text}}}" if 0 < len(text) < SHORT_LINE else ""


def _dumped(document: Document) -> str:
    if not document:
        return ""
    nested = any(isinstance(value, Mapping | list) for value in document.values())
    return yaml.dump(dict(document), default_flow_style=None if nested else False, Dumper=_Dumper)


def _scalar(value: float) -> str:
    text = repr(value)
    return text.replace("e", ".0e", 1) if "e" in text and "." not in text else text


_Dumper = type("_Dumper", (getattr(yaml, "CSafeDumper", yaml.SafeDumper),), {"ignore_aliases": lambda *_: True})


def _levels(
    document: Document, wanted: Iterable[str] | None
) -> dict[str, tuple[FloatArray, list[dict[str, Any]], list[tuple[int, int, dict[str, Any]]]]]:
    """Coordinates, vertex options and lanes of each wanted level, with types checked."""
    levels = document.get("levels")
    if not isinstance(levels, Mapping):
        raise Misplaced("'levels' is no mapping, so this is no nav graph", "levels")
    level_of = {}
    for key, level in levels.items():
        name = str(key)
        if wanted is not None and name not in wanted:
            continue
        if not isinstance(level, Mapping):
            raise Misplaced(f"level '{name}' is a {type(level).__name__}, expected a mapping", "levels", key)
        xy, options = [], []
        for v, vertex in enumerate(_list(level, "vertices", key)):
            at = ("levels", key, "vertices", v)
            if not isinstance(vertex, list) or not 2 <= len(vertex) <= 3 or not all(is_number(c, FARTHEST) for c in vertex[:2]):
                raise Misplaced(f"level {name} vertex {v} is {str(vertex)[:40]}, expected [x, y, {{options}}]", *at)
            xy.append(vertex[:2])
            options.append(_coerced(vertex[2] if len(vertex) == 3 else None, f"level {name} vertex {v}", at))
        lanes = []
        for k, lane in enumerate(_list(level, "lanes", key)):
            at = ("levels", key, "lanes", k)
            if not isinstance(lane, list) or not 2 <= len(lane) <= 3 or not all(type(v) is int for v in lane[:2]):
                raise Misplaced(f"level {name} lane {k} is {str(lane)[:40]}, expected [vertex, vertex, {{options}}]", *at)
            if not all(0 <= v < len(xy) for v in lane[:2]):
                raise Misplaced(f"level {name} lane {k} joins vertices {lane[0]} and {lane[1]}, but there are {len(xy)}", *at)
            lanes.append((lane[0], lane[1], _coerced(lane[2] if len(lane) == 3 else None, f"level {name} lane {k}", at)))
        level_of[name] = (np.array(xy, np.float64).reshape(-1, 2), options, lanes)
    return level_of


def _names(vertex_options: Sequence[dict[str, Any]], distinct: bool) -> list[str]:
    """Takes the names out of the options; one that occurs again gets a number: dock, dock_2."""
    names = [options.pop("name", "") for options in vertex_options]
    taken = set(names)
    seen: set[str] = set()
    for v, name in enumerate(names) if distinct else ():
        if name and name in seen:
            names[v] = free_name(name, taken)
            taken.add(names[v])
        seen.add(name)
    return names


def _coerced(options: Any, what: str, at: tuple[str | int, ...]) -> dict[str, Any]:
    """Options with the types their names promise; numbers written as names become text."""
    if options is None:
        return {}
    if not isinstance(options, Mapping):
        raise Misplaced(f"{what} has {str(options)[:40]} for options, expected a mapping", *at)
    plain: dict[str, Any] = {}
    for key, value in options.items():
        name = str(key)
        if isinstance(value, list | dict):
            raise Misplaced(f"{what}: '{name}' is {str(value)[:40]}, expected one value", *at)
        if name.startswith("is_"):
            plain[name] = value.lower() == "true" if isinstance(value, str) else bool(value)
        elif name in NUMBERS:
            try:
                plain[name] = float(value)
            except (TypeError, ValueError, OverflowError):
                raise Misplaced(f"{what}: '{name}' is '{str(value)[:40]}', expected a number", *at) from None
        else:
            plain[name] = "" if value is None else str(value)
    return plain


def _list(level: Mapping[str, Any], kind: str, key: Any) -> list[Any]:
    value = level.get(kind)
    if value is not None and not isinstance(value, list):
        raise Misplaced(f"level {key}: {kind} is {str(value)[:40]}, expected a list", "levels", key, kind)
    return value or []
