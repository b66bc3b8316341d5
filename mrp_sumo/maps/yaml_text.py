"""Reading YAML written by strangers: safely, in bounded memory, with line numbers for complaints.

Builds plain dicts, lists and scalars (YAML 1.1, as PyYAML's safe loader does) straight from the parser's
events. Refuses files above 64 MB, text that is not UTF-8, Git conflict markers, HTML, binary data, tags,
merge keys, nesting deeper than 30 and aliases that would swell the document.
"""

import gc
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path
from typing import Any

import yaml

from mrp_sumo.errors import MapError
from mrp_sumo.files.reading import json_value, read_bytes
from mrp_sumo.maps.finding import MapFinding, RefusedMap

MAX_BYTES = 64 * 2**20
MAX_DEPTH = 30
MAX_ALIASED = 100_000  # values that aliases repeat, all together
NO_BRACKETS = bytes(set(range(256)) - set(b"[]{}"))
BRACKETS = bytes.maketrans(b"[{]}", b"\2\2\0\0")  # one more than what they add to the depth

_Loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_CONFLICT = re.compile(r"^(?:<<<<<<<|>>>>>>>)(?: |\r?$)", re.MULTILINE)
_INT = re.compile(r"[-+]?(?:0|[1-9][0-9]*)\Z")
_FLOAT = re.compile(r"[-+]?[0-9]+\.[0-9]*\Z")
_resolver = yaml.resolver.Resolver()
_constructor = yaml.constructor.SafeConstructor()


Place = tuple[str | int, ...]  # keys and list positions from the top of a document


@dataclass(frozen=True)
class Text:
    """A file's name and text, to point at a place in it."""

    path: Path
    text: str

    def fault(self, message: str, *keys: str | int) -> MapError:
        """The error to raise about the value found by following `keys` from the top: `FILE:LINE: message`."""
        return MapError(f"{self.path.name}:{line_of(self.text, keys)}: {message}" if keys else f"{self.path.name}: {message}")


def read_text(path: Path) -> Text:
    """The text of a map file. Raises MapError for a missing file, a folder, a file above 64 MB, binary data and text that is not UTF-8."""
    data = read_bytes(path, MAX_BYTES, MapError)
    if not data.strip():
        raise MapError(f"{path.name}: the file is empty")
    if b"\0" in data[:4096]:
        raise MapError(f"{path.name}: binary data, not a map file")
    try:
        return Text(path, data.decode("utf-8-sig"))
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise MapError(f"{path.name}:{line}: not UTF-8 text") from None


def parse(source: Text) -> Any:
    """The document of a YAML text. Raises MapError as the module refuses; with the line."""
    if conflict := _CONFLICT.search(source.text):  # within a long text it would go unnoticed
        line = source.text.count("\n", 0, conflict.start()) + 1
        raise _not_yaml(source, f":{line}: not YAML: git conflict marker '{conflict[0][:7]}'")
    was_collecting = gc.isenabled()
    gc.disable()  # nothing of a growing document is garbage yet
    try:
        return _build(source)
    except yaml.YAMLError as error:
        raise _not_yaml(source, _complaint(source.text, error)) from None
    except UnicodeEncodeError:  # of the command line, where bytes may be any
        raise MapError(f"{source.path.name}: not UTF-8 text") from None
    finally:
        if was_collecting:
            gc.enable()


def parse_json(text: str) -> Any:
    """The object of a JSON text, many times faster than as YAML; None for what is not one, which `parse` then explains."""
    if text.lstrip()[:1] != "{" or _deepest(text) > MAX_DEPTH:
        return None
    try:
        document = json_value(text, finite=True)
    except (ValueError, RecursionError):
        return None
    return document if isinstance(document, dict) else None


def _deepest(text: str) -> int:
    """How deep brackets are nested, those in strings counted too."""
    brackets = text.encode(errors="replace").translate(BRACKETS, NO_BRACKETS)
    return max(accumulate(byte - 1 for byte in brackets), default=0)


def line_of(text: str, keys: Place) -> int:
    """Line (from 1) of the value found by following mapping keys and list positions; of the deepest one that exists."""
    wanted, best, depth = tuple(map(str, keys)), 1, -1
    for place, _, line in places(text):
        if len(place) <= depth:  # behind the deepest one
            break
        if tuple(map(str, place)) == wanted[: len(place)]:
            best, depth = line, len(place)
    return best


def places(text: str) -> Iterator[tuple[Place, int, int]]:
    """The values of a YAML text that can be parsed, in order: place, line of the key or list item, line where the value itself begins."""
    above: list[Place] = []  # of each list and mapping that is open
    names: list[Any] = []  # in it: position of the next value, or its key, None where a key comes first
    line_of_key = 0
    event: Any
    for event in yaml.parse(text, Loader=_Loader):
        if isinstance(event, yaml.CollectionEndEvent):
            above.pop()
            names.pop()
        elif isinstance(event, yaml.NodeEvent):
            assert event.start_mark is not None  # what a parser yields has one
            line = event.start_mark.line + 1
            if names and names[-1] is None:
                names[-1], line_of_key = getattr(event, "value", event.anchor), line
                continue
            place: Place = (*above[-1], names[-1]) if names else ()
            is_item = not names or isinstance(names[-1], int)
            yield place, line if is_item else line_of_key, line
            if names:
                names[-1] = names[-1] + 1 if is_item else None
            if isinstance(event, yaml.CollectionStartEvent):
                above.append(place)
                names.append(0 if isinstance(event, yaml.SequenceStartEvent) else None)


def _build(source: Text) -> Any:  # noqa: C901  one pass over events, which come in the hundred thousands
    anchors: dict[str, tuple[Any, int]] = {}  # name -> value, number of values in it
    scalars: dict[str, Any] = {}  # plain text -> value; most of a map's are the same few words
    stack: list[tuple[Any, list[Any] | None, str | None, int]] = []  # container, pending key of a mapping, anchor, count at its start
    top: list[Any] = []
    count = aliased = documents = 0
    container: Any = top
    pending: list[Any] | None = None  # the key a mapping's next value belongs to

    event: Any  # PyYAML's stubs know no attributes of events
    for event in yaml.parse(source.text, Loader=_Loader):
        kind = type(event)
        if kind is yaml.ScalarEvent:
            text = event.value
            if event.tag is not None and event.tag != "!":
                raise _at(source, event, f"tag '{event.tag}' is not read")
            if not event.implicit[0]:
                value = text
            elif text in scalars:
                value = scalars[text]
            else:
                value = scalars[text] = _scalar(source, event)
            count += 1
            if event.anchor:
                anchors[event.anchor] = (value, 1)
        elif kind is yaml.SequenceStartEvent or kind is yaml.MappingStartEvent:
            if event.tag is not None and event.tag != "!":
                raise _at(source, event, f"tag '{event.tag}' is not read")
            if len(stack) >= MAX_DEPTH:
                raise _at(source, event, f"nested deeper than {MAX_DEPTH} levels")
            if pending is not None and not pending:
                raise _at(source, event, "a list or mapping as a key")
            stack.append((container, pending, event.anchor, count))
            container, pending = ([], None) if kind is yaml.SequenceStartEvent else ({}, [])
            count += 1
            continue
        elif kind is yaml.SequenceEndEvent or kind is yaml.MappingEndEvent:
            value = container
            container, pending, anchor, before = stack.pop()
            if anchor:
                anchors[anchor] = (value, count - before)
        elif kind is yaml.AliasEvent:
            if event.anchor not in anchors:
                raise _at(source, event, f"alias '*{event.anchor}' has no anchor before it")
            value, size = anchors[event.anchor]
            count += size  # what holds an alias is as large as what it repeats
            aliased += size
            if aliased > MAX_ALIASED:
                raise _at(source, event, f"aliases repeat more than {MAX_ALIASED} values")
        elif kind is yaml.DocumentStartEvent:
            documents += 1
            if documents > 1:
                raise _at(source, event, "a second YAML document")
            continue
        else:
            continue
        if pending is None:
            container.append(value)
        elif pending:
            container[pending.pop()] = value
        else:
            if type(value) in (list, dict):
                raise _at(source, event, "a list or mapping as a key")
            pending.append(value)
    return top[0] if top else None


def _scalar(source: Text, event: Any) -> Any:
    text = event.value
    if _FLOAT.match(text):
        return float(text)
    if len(text) < 100 and _INT.match(text):
        return int(text)
    tag = _resolver.resolve(yaml.ScalarNode, text, (True, False))
    if tag in ("tag:yaml.org,2002:str", "tag:yaml.org,2002:value", "tag:yaml.org,2002:timestamp"):
        return text
    if tag == "tag:yaml.org,2002:merge":
        raise _at(source, event, "merge keys are not read")
    try:
        return _constructor.construct_object(yaml.ScalarNode(tag, text))
    except (ValueError, IndexError, KeyError, OverflowError):
        raise _at(source, event, f"'{text[:40]}' is not a number") from None


def _at(source: Text, event: Any, message: str) -> MapError:
    return MapError(f"{source.path.name}:{event.start_mark.line + 1}: {message}")


def _not_yaml(source: Text, complaint: str) -> RefusedMap:
    return RefusedMap(f"{source.path.name}{complaint}", (MapFinding("not_yaml", "refuse", 1, (f"line {complaint[1:]}",)),))


def _complaint(text: str, error: yaml.YAMLError) -> str:
    if looks_like_html(text):
        return ":1: not YAML: an HTML page"
    mark = getattr(error, "problem_mark", None)
    where = f":{mark.line + 1 if mark is not None else 1}"
    problem = getattr(error, "problem", None) or getattr(error, "reason", None) or "cannot be parsed"
    lines = text.splitlines()
    line = lines[mark.line] if mark is not None and mark.line < len(lines) else ""
    if "cannot start any token" in problem and line[:1].isspace() and "\t" in line[: len(line) - len(line.lstrip())]:
        problem = "found a tab, expected spaces"
    if "mapping values are not allowed" in problem and mark is not None:
        joined = next((n for n in range(mark.line, max(-1, mark.line - 3), -1) if re.match(r"\s*[\w.]+:[^\s/]", lines[n])), None)
        problem += f"; line {joined + 1} has no space after its colon" if joined is not None else ""
    return f"{where}: not YAML: {problem}"


def looks_like_html(text: str) -> bool:
    """True for a page that was saved instead of the file."""
    return text.lstrip()[:200].lower().startswith(("<!doctype html", "<html", "<head", "<!--"))
