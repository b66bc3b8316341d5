"""Files of Open-RMF buildings as people edit them: new ones, and changed ones whose untouched parts stay as they are, to the byte.

A document is what YAML says, with text as keys: `{"levels": {"L1": {"vertices": [[x, y, 0, name, {"is_charger": [4, true]}], ...]}}}`.
An item of a list is written on a line of its own, as the Traffic Editor does; comments, order and what nobody here knows stay.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from typing import Any

import numpy as np
import yaml

from mrp_sumo.errors import MapError
from mrp_sumo.maps.drawing import METERS_PER_PIXEL, scalar, type_tag
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.yaml_text import Text, parse

MARGIN_M = 1.0  # around what a map of another format has
BLOCK_DEPTH = 4  # mappings that are written on several lines: the building, its levels, a level, its drawing
OF_LANES = {"orientation_constraint": "orientation", "speed_limit": "speed_limit", "mutex": "mutex"}  # option -> parameter of a drawn lane
OF_READERS = frozenset({"lift", "is_bend", "load"})  # options that a drawing has no parameter for
SAME_PX = 1e-3
_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
Edit = tuple[int, int, str]  # from, to, text that stands there instead


def document_of(source: Text) -> Any:
    """The document of a file. Raises MapError as `parse`, and for numbers that JSON does not have."""
    try:
        return json.loads(json.dumps(parse(source), allow_nan=False))
    except ValueError:
        raise source.fault("holds a number that is none (.nan or .inf)") from None
    except TypeError as error:
        raise source.fault(f"holds what no drawing does: {error}") from None


def edited(source: Text, document: Any) -> str:
    """The text of a file with another document; what is alike in both keeps its text."""
    before = document_of(source)
    if before == document:
        return source.text
    edits = sorted(_edits(source.text, yaml.compose(source.text, Loader=_Loader), before, document, 0))
    text, end = "", 0
    for start, stop, part in edits:
        text += source.text[end:start] + part
        end = max(end, stop)
    text += source.text[end:]
    try:
        if document_of(Text(source.path, text)) == document:
            return text
    except MapError:
        pass  # such as an alias whose anchor has gone
    return text_of(document)


def text_of(document: Mapping[str, Any]) -> str:
    """A document as the text of a file."""
    return "".join(f"{line}\n" for line in _block(document, 0, 0))


def building_document(map_: Map, *, picture: tuple[str, int, int] | None = None, with_lanes: bool = True) -> dict[str, Any]:
    """A map of any format as a drawing in pixels, with a measurement that says what a pixel is.

    Parameters
    ----------
    map_
        Lanes, walls and doors come along; shafts of lifts do not.
    picture
        Name, width and height of the picture that the map was made of, whose lower left corner is (0, 0) m; `map_.floor` says its scale.
    with_lanes
        With the lanes and their vertices, not only the walls.
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
        walls = [
            [pen.vertex(a), pen.vertex(b), _parameters(alpha=1.0, texture_name="default")] for a, b in (storey.wall_xy if storey else ())
        ]
        doors = [
            [
                pen.vertex(storey.xy[d.start]),
                pen.vertex(storey.xy[d.end]),
                _parameters(name=d.name, plugin="normal", type=d.kind or "hinged"),
            ]
            for d in (storey.doors if storey else ())
        ]
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


def _block(value: Mapping[str, Any], indent: int, depth: int) -> Iterator[str]:
    """The lines of a mapping."""
    for key, content in value.items():
        name = f"{' ' * indent}{scalar(key)}:"
        if isinstance(content, Mapping) and content and depth < BLOCK_DEPTH - 1:
            yield name
            yield from _block(content, indent + 2, depth + 1)
        elif isinstance(content, list) and content:
            yield name
            yield from (f"{' ' * (indent + 2)}- {_flow(item)}" for item in content)
        else:
            yield f"{name} {_flow(content)}"


def _flow(value: Any) -> str:
    """A value on one line."""
    if isinstance(value, Mapping):
        return f"{{{', '.join(f'{scalar(key)}: {_flow(content)}' for key, content in value.items())}}}"
    if isinstance(value, list):
        return f"[{', '.join(map(_flow, value))}]"
    if value is None:
        return "null"
    if isinstance(value, float):
        text = repr(value)
        return text if "e" not in text else f"{value:.17f}".rstrip("0") if abs(value) < 1 else f"{value:.1f}"  # 1e-05 is text in YAML 1.1
    return scalar(value)


def _edits(text: str, node: Any, old: Any, new: Any, indent: int) -> Iterator[Edit]:
    """What makes the text of one value that of another."""
    if old == new:
        return
    is_block = isinstance(node, yaml.CollectionNode) and not node.flow_style
    if is_block and isinstance(old, Mapping) and isinstance(new, Mapping):
        yield from _edits_of_mapping(text, node, old, new)
    elif is_block and isinstance(old, list) and isinstance(new, list) and new and _has_lines(text, node):
        yield from _edits_of_list(text, node, old, new)
    else:
        yield _replaced(text, node, new, indent)


def _edits_of_mapping(text: str, node: Any, old: Mapping[str, Any], new: Mapping[str, Any]) -> Iterator[Edit]:
    column = node.start_mark.column
    for key, value in node.value:
        if key.value in new:
            yield from _edits(text, value, old[key.value], new[key.value], column)
        else:
            yield _line_start(text, key.start_mark.index), _line_end(text, _end(value)), ""
    added = {key: value for key, value in new.items() if key not in old}
    if added:
        lines = "\n".join(_block(added, column, 0 if column == 0 else 1 if column == 2 else 2))
        end = _line_end(text, _end(node), with_break=False)
        yield end, end, f"\n{lines}"


def _edits_of_list(text: str, node: Any, old: Sequence[Any], new: Sequence[Any]) -> Iterator[Edit]:
    items = node.value
    indent = text[_line_start(text, items[0].start_mark.index) : items[0].start_mark.index]
    before, after = ([json.dumps(item, sort_keys=True) for item in items_] for items_ in (old, new))
    if len(old) == len(new):
        blocks = [("replace", k, k + 1, k, k + 1) for k in range(len(old)) if before[k] != after[k]]
    else:
        blocks = [block for block in SequenceMatcher(None, before, after, autojunk=False).get_opcodes() if block[0] != "equal"]
    for _, a, b, c, d in blocks:
        both = min(b - a, d - c)
        for k in range(both):
            yield items[a + k].start_mark.index, _end(items[a + k]), _flow(new[c + k])
        for k in range(a + both, b):
            yield _line_start(text, items[k].start_mark.index), _line_end(text, _end(items[k])), ""
        if c + both < d:
            lines = [f"{indent}{_flow(item)}" for item in new[c + both : d]]
            if a + both == 0:  # before the first
                start = _line_start(text, items[0].start_mark.index)
                yield start, start, "".join(f"{line}\n" for line in lines)
            else:
                end = _line_end(text, _end(items[a + both - 1]), with_break=False)
                yield end, end, "".join(f"\n{line}" for line in lines)


def _replaced(text: str, node: Any, new: Any, indent: int) -> Edit:
    start, end = node.start_mark.index, _end(node)
    if isinstance(new, list) and new:
        lines = "".join(f"\n{' ' * (indent + 2)}- {_flow(item)}" for item in new)
        at = text.rfind(":", 0, start) + 1
        return at, end, lines
    gap = "" if start and text[start - 1] in " \n" else " "
    return start, end, f"{gap}{_flow(new)}"


def _has_lines(text: str, node: Any) -> bool:
    """Each item begins on a line of its own."""
    starts = (item.start_mark.index for item in node.value)
    return all(text[_line_start(text, start) : start].strip() == "-" for start in starts)


def _end(node: Any) -> int:
    """Where a value's text ends; the parser sees the end of a block only where the next begins."""
    if isinstance(node, yaml.CollectionNode) and not node.flow_style and node.value:
        last = node.value[-1]
        return _end(last[1] if isinstance(last, tuple) else last)
    return int(node.end_mark.index)


def _line_start(text: str, at: int) -> int:
    return text.rfind("\n", 0, at) + 1


def _line_end(text: str, at: int, *, with_break: bool = True) -> int:
    end = text.find("\n", at)
    return len(text) if end < 0 else end + with_break
