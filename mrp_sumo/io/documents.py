"""YAML documents with line numbers, checked against pydantic models, with one line per fault.

Refuses what is not UTF-8, not YAML, not a mapping, what the reader of maps refuses (tags, merge keys, deep nesting, aliases that swell
the document), and keys given twice (YAML itself keeps the last).
"""

import difflib
import os
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked_dataclass
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from mrp_sumo.core.options import Options
from mrp_sumo.errors import MapError, ScenarioError, nearest
from mrp_sumo.files.reading import read_text, shortened
from mrp_sumo.maps.yaml_text import Place as Place
from mrp_sumo.maps.yaml_text import Text, parse, places

MAX_BYTES = 4_000_000
EXPECTED = ", expected "  # between what was found and what it may be instead
SCALARS = ("str", "bool")  # kinds in the place of keys and values
UNITS = {  # end of a key -> its unit, and what others are of it
    "_s": ("seconds", {"s": 1.0, "sec": 1.0, "min": 60.0, "m": 60.0, "h": 3600.0, "ms": 0.001}),
    "_m": ("metres", {"m": 1.0, "cm": 0.01, "mm": 0.001}),
}
KINDS = (  # what pydantic says was expected begins so -> what is said
    ("a valid integer", "a whole number"),
    ("a valid number", "a number"),
    ("a valid boolean", "true or false"),
    ("a valid list", "a list"),
    ("a valid tuple", "a list"),
    ("a valid string", "text"),
    ("a valid dictionary", "keys and values"),
)
SHORT = {"robots": "a number of robots, such as 4, or ", "map": "a map's name or file, or "}  # what may stand for keys and values
Model = TypeVar("Model", bound=BaseModel | Options)


class Document:
    """A parsed YAML mapping that knows the line of each of its keys."""

    def __init__(self, path: Path, content: dict[str, Any], line: dict[Place, int]) -> None:
        self.path = path
        self.content = content
        self._line = line

    def at(self, place: Place) -> str:
        """`file:line: key.path[3]` of a place, or of the nearest place above it that is in the file."""
        known = place
        while known and known not in self._line:
            known = known[:-1]
        line = f":{self._line[known]}" if known in self._line else ""
        return f"{self.path.name}{line}: {_dotted(place)}" if place else f"{self.path.name}{line}"


def read_document(path: Path) -> Document:
    """Read a YAML file that holds one mapping. Raises ScenarioError: one line with file and line number."""
    try:
        text = read_text(path, MAX_BYTES, ScenarioError)
    except ScenarioError as error:
        if path.parent.is_dir() and not os.path.lexists(path):
            known = nearest(path.name, sorted(p.name for p in path.parent.glob("*.yaml")))
            raise ScenarioError(f"{shortened(path)}: no such file{known}") from None
        raise error from None
    return document_from(path, text)


def document_from(path: Path, text: str) -> Document:
    """A YAML text that holds one mapping; errors as of `read_document`, with the name of the path."""
    try:
        content = parse(Text(path, text))  # nothing nested deep, no aliases that swell
    except MapError as error:
        raise ScenarioError(str(error)) from None
    if not isinstance(content, dict):
        raise ScenarioError(f"{path.name}: found {_kind(content)}, expected keys and values")
    numbers: dict[Place, int] = {}
    for place, line, _ in places(text):
        if place in numbers:
            raise ScenarioError(f"{path.name}:{line}: key '{place[-1]}' is given twice")
        if place:
            numbers[place] = line
    return Document(path, content, numbers)


def validated(document: Document, model: type[Model], content: Any = None, options: Mapping[Place, str] | None = None) -> Model:
    """The document, or other content with its line numbers, as a model. Raises ScenarioError: one line per fault.

    `options` has what to call a place instead of its line in the file: the command line option that set it.
    """
    content = document.content if content is None else content
    try:
        result = TypeAdapter(model).validate_python(content)
        faults = list(_switches_for_numbers(content, result))
    except ValidationError as error:
        faults = _of_keys(error.errors())
    if not faults:
        return result
    lines = dict[str, list[str]]()  # what was found at a key -> what it may be instead
    for each in faults:
        line, _, expected = _fault(document, model, options or {}, each).partition(EXPECTED)
        lines.setdefault(line, []).append(expected)
    raise ScenarioError(*(f"{line}{EXPECTED}{' or '.join(kinds)}" if kinds[0] else line for line, kinds in lines.items()))


def _switches_for_numbers(content: Any, result: Any, place: Place = ()) -> Iterator[ErrorDetails]:
    """Numbers that are true or false in the document, such as the `yes` of YAML, which pydantic takes for 1 and 0."""
    if isinstance(content, bool) and type(result) in (int, float):
        kind = "int_type" if isinstance(result, int) else "float_type"
        yield {"type": kind, "loc": place, "msg": "", "input": content}
    elif isinstance(content, Mapping):
        for key, value in content.items():
            inner = result.get(key) if isinstance(result, Mapping) else getattr(result, str(key), None)
            yield from _switches_for_numbers(value, inner, (*place, key))
    elif isinstance(content, list | tuple):
        inner = result if isinstance(result, list | tuple) else getattr(result, "fleet", None) or ()  # a list of robots is short for it
        for k, pair in enumerate(zip(content, inner)):
            yield from _switches_for_numbers(*pair, (*place, k))


def _of_keys(errors: list[ErrorDetails]) -> list[ErrorDetails]:
    """Faults by key: what may be of several kinds is judged as keys and values if it is such; what a section lacks is one fault."""
    for scalar in [error for error in errors if error["loc"][-1:] and error["loc"][-1] in SCALARS]:
        place = scalar["loc"][:-1]
        others = [error for error in errors if error is not scalar and error["loc"][: len(place)] == place]
        if others and isinstance(scalar["input"], Mapping):
            errors = [error for error in errors if error is not scalar]
        elif others:
            scalar["loc"] = place
        for error in others:
            error["loc"] = (*place, *error["loc"][len(place) + 1 :])
    lacking = dict[Place, ErrorDetails]()
    for error in [error for error in errors if error["type"] == "missing"]:
        first = lacking.setdefault(error["loc"][:-1], error)
        if first is not error:
            errors.remove(error)
            if isinstance(error["loc"][-1], str):  # of a list the first place says enough
                first["loc"] = (*first["loc"][:-1], f"{first['loc'][-1]}, {error['loc'][-1]}")
    return errors


@cache
def keys_of(declared: type) -> Mapping[str, FieldInfo]:
    """Keys of a model, or of a dataclass that declares options."""
    return declared.model_fields if issubclass(declared, BaseModel) else checked_dataclass(frozen=True)(declared).__pydantic_fields__


def declared_in(annotation: Any) -> Iterator[type]:
    """The models and the dataclasses of options that an annotation names, however deep."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel | Options):
        yield annotation
    for part in get_args(annotation):
        yield from declared_in(part)


def _fault(document: Document, model: type, options: Mapping[Place, str], error: ErrorDetails) -> str:
    place = tuple(error["loc"])
    above = (f"{options[place[:k]]}: {_dotted(place[k:])}" for k in range(len(place) - 1, 0, -1) if place[:k] in options)
    where = options.get(place) or next(above, "") or document.at(place)
    value = error.get("input")
    match error["type"]:
        case "extra_forbidden" | "unexpected_keyword_argument":
            parent = _declared_at(model, error["loc"][:-1])
            known = list(keys_of(parent)) if parent else []
            return f"{where}: unknown key{nearest(str(place[-1]), known, limit=20)}"
        case "missing":
            return f"{where}: missing"
        case "literal_error":
            expected = error["ctx"]["expected"].replace(" or ", ", ").replace("'", "").split(", ")
            meant = difflib.get_close_matches(str(value).lower(), expected, n=1)
            hint = f"did you mean '{meant[0]}'?" if meant else f"known: {', '.join(expected)}"
            return f"{where}: unknown value {value!r} ({hint})"
        case "model_type" | "dataclass_type" | "dict_type":
            return f"{where}: found {_kind(value)}, expected {SHORT.get(str(place[-1]), '') if place else ''}keys and values"
        case "string_pattern_mismatch":
            like = re.sub(r"[^\w.+-]+", "_", str(value)).strip("_")
            return f"{where}: found {_kind(value)}, expected letters, digits and _ . + - only{f', such as {like!r}' if like else ''}"
        case "float_parsing" | "int_parsing" | "int_parsing_size" | "float_type" | "int_type" | "int_from_float":
            return f"{where}: found {_kind(value)}, expected {_number(str(place[-1]), str(value), error['type'].startswith('int'))}"
        case "value_error":
            return f"{where}: {error['ctx']['error']}"
        case "invalid_key":
            where = document.at((*place[:-1], str(value))) if type(value) is int else document.at(place[:-1])
            return f"{where}: found {_kind(value)} as a key, expected a text, in quotes if it looks like something else"
        case "tuple_type":
            return f"{where}: found {_kind(value)}, expected a list"
        case _:
            return f"{where}: found {_kind(value)}, {in_words(error['msg'])}"


def in_words(message: str) -> str:
    """A message of pydantic as the end of a line of ours."""
    if least := re.match(r"(?:List|Tuple) should have at least (\d+) item", message):
        return f"expected {least[1]} or more"
    if (expected := message.removeprefix("Input should be ")) == message:
        return message.removeprefix("Value error, ").replace("Field required", "missing")
    for begin, words in KINDS:
        if expected.startswith(begin):
            return f"expected {words}"
    expected = re.sub("greater than or equal to (.*)", r"\1 or more", re.sub("less than or equal to (.*)", r"\1 or less", expected))
    return f"expected {expected.removeprefix('a valid ')}"


def _number(key: str, text: str, whole: bool) -> str:
    """The number that a key takes, in words, worked out where the text has another unit."""
    for suffix, (name, factors) in UNITS.items():
        if key.endswith(suffix):
            match = re.fullmatch(r"(\d{1,9}(?:\.\d{1,9})?)\s*([a-z]+)", text)
            value = f", such as {float(match[1]) * factors[match[2]]:g}" if match and match[2] in factors else ""
            return f"a number of {name}{value}"
    return "a whole number" if whole else "a number"


def _dotted(place: Place) -> str:
    """A place as `key.path[3]`."""
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in place).lstrip(".")


def _declared_at(model: type, place: Place) -> type | None:
    at: type | None = model
    for key in place:
        if at is None or key not in keys_of(at):
            return None
        at = next(declared_in(keys_of(at)[str(key)].annotation), None)
    return at


def _kind(value: Any) -> str:
    if value is None:
        return "nothing"
    if isinstance(value, dict):
        return "keys and values"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    text = repr(value)
    return text if len(text) < 60 else text[:57] + "..."
