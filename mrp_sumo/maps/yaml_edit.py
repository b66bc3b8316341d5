"""YAML files as people edit them: what is touched changes, and everything else keeps its bytes, comments and order included.

A document is what the YAML says, with text as keys. An item of a list is written on a line of its own, as the Traffic Editor does.
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from difflib import SequenceMatcher
from typing import Any

import yaml

from mrp_sumo.errors import MapError
from mrp_sumo.maps.drawing import scalar
from mrp_sumo.maps.yaml_text import Text, parse

BLOCK_DEPTH = 4  # mappings that are written on several lines: a building, its levels, a level, its drawing
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
    return "".join(f"{line}\n" for line in _block(document, 0, 0))


def _block(value: Mapping[str, Any], indent: int, depth: int) -> Iterator[str]:
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
        lines = "\n".join(_block(added, column, min(column // 2, 2)))
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
            item, was, is_now = items[a + k], old[a + k], new[c + k]
            if isinstance(was, Mapping) and isinstance(is_now, Mapping) and not item.flow_style:
                yield from _edits_of_mapping(text, item, was, is_now)
            else:
                yield item.start_mark.index, _end(item), _flow(is_now)
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
