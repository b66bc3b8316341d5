"""Reading XML written by strangers: in bounded memory, with line numbers for complaints.

Builds elements straight from expat's events. Nothing outside the file is read: the DTD that a document type names is not looked for.
Refuses a document type with declarations of its own, and with it entities; elements nested deeper than 30; and more than two million of
them.
"""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, NoReturn
from xml.parsers import expat

from mrp_sumo.errors import MapError, nearest
from mrp_sumo.files.reading import shortened
from mrp_sumo.maps.readers.json_fields import NOTHING
from mrp_sumo.maps.readers.rmf.level import FARTHEST
from mrp_sumo.maps.yaml_text import MAX_DEPTH, Text

MAX_ELEMENTS = 2_000_000
_ROOT = re.compile(r"(?:<\?[^>]*\?>|<!--.*?-->|<!DOCTYPE[^\[>]*(?:\[[^\]]*\][^>]*)?>|\s)*<([A-Za-z_][\w.:-]*)", re.DOTALL)


@dataclass
class Element:
    """An element, its attributes and its children in order."""

    source: Text
    name: str
    attributes: Mapping[str, str]
    line: int
    children: list["Element"] = field(default_factory=list)

    def all(self, name: str) -> Iterator["Element"]:
        return (child for child in self.children if child.name == name)

    def get(self, key: str, default: str) -> str:
        return self.attributes.get(key, default)

    def text(self, key: str) -> str:
        """An attribute that must be there."""
        value = self.attributes.get(key)
        if value is None:
            raise self.fault(f"<{self.name}> has no '{key}'{nearest(key, self.attributes, limit=0).replace('did you mean', 'there is')}")
        return value

    def number(self, key: str, default: Any = NOTHING) -> float:
        """An attribute as a finite number."""
        if key not in self.attributes and default is not NOTHING:
            return float(default)
        text = self.text(key)
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not abs(value) < FARTHEST:
            raise self.fault(f"{key} of <{self.name}> is '{text[:40]}', expected a number")
        return value

    def fault(self, message: str) -> MapError:
        """The error to raise about this element."""
        return MapError(f"{shortened(self.source.path)}:{self.line}: {message}")


def root_name(text: str) -> str:
    """The name of the first element of a text, '' where it is no XML."""
    match = _ROOT.match(text[:4000])
    return match[1] if match and text.lstrip()[:1] == "<" else ""


def parse_xml(source: Text) -> Element:
    """The root element of a text. Raises MapError as the module refuses; with the line."""
    parser = expat.ParserCreate("utf-8")  # what the text was read as, whatever it says
    parser.SetParamEntityParsing(expat.XML_PARAM_ENTITY_PARSING_NEVER)
    roots: list[Element] = []
    stack: list[Element] = []
    count = 0

    def fault(message: str) -> MapError:
        return MapError(f"{shortened(source.path)}:{parser.CurrentLineNumber}: {message}")

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if len(stack) >= MAX_DEPTH:
            raise fault(f"nested deeper than {MAX_DEPTH} elements")
        if count > MAX_ELEMENTS:
            raise fault(f"more than {MAX_ELEMENTS:.0e} elements")
        element = Element(source, name, attributes, parser.CurrentLineNumber)
        (stack[-1].children if stack else roots).append(element)
        stack.append(element)

    def end(name: str) -> None:
        stack.pop()

    def refuse(*_: object) -> NoReturn:
        raise fault("a document type with declarations, or an entity, which is not read")

    def document_type(_name: str, _system: str | None, _public: str | None, has_declarations: bool) -> None:
        if has_declarations:
            refuse()

    parser.StartElementHandler = begin
    parser.EndElementHandler = end
    parser.StartDoctypeDeclHandler = document_type
    parser.SkippedEntityHandler = refuse
    parser.EntityDeclHandler = refuse
    parser.ExternalEntityRefHandler = refuse
    try:
        parser.Parse(source.text.encode(), True)
    except expat.ExpatError as error:
        raise MapError(f"{shortened(source.path)}:{error.lineno}: not XML: {expat.ErrorString(error.code)}") from None
    return roots[0]
