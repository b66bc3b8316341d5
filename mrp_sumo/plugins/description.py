"""A plug-in described for people: its summary, its parameters with defaults, and what it says of itself."""

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from mrp_sumo.plugins.face import attributes_of
from mrp_sumo.plugins.kinds import Kind
from mrp_sumo.plugins.parameters import REQUIRED, parameters_of
from mrp_sumo.plugins.registry import face_of, loaded
from mrp_sumo.plugins.source import Source


@dataclass(frozen=True)
class Described:
    """A plug-in in words and simple values."""

    name: str
    summary: str  # the first sentence of its docstring
    parameters: tuple[tuple[str, str, Any, str], ...]  # name, type in words, default (`REQUIRED` in words where there is none), meaning
    attributes: Mapping[str, Any]  # of its face, and of simple types
    source: str  # '' for ours


def describe(kind: Kind, source: Source) -> Described:
    """Load a plug-in and describe it; nothing is made of it. Raises PlugInError when it cannot be loaded, or lacks what its kind needs."""
    plug_in = loaded(kind, source)
    face = face_of(kind)
    is_record = is_dataclass(plug_in) and not isinstance(plug_in, type)
    names = attributes_of(face) if face else {f.name: None for f in fields(plug_in)} if is_record else {}
    parameters = parameters_of(plug_in) if kind.made else ()
    known = {parameter.name for parameter in parameters}
    values = {name: getattr(plug_in, name, None) for name in names if name not in known | {"name"}}
    supports = ", ".join(sorted(getattr(plug_in, "supports", None) or ()))
    said = {name: _simple(value) for name, value in values.items() if isinstance(value, bool | int | float | str)}
    return Described(
        source.name,
        _first_sentence(plug_in),
        tuple((p.name, p.expected, str(REQUIRED) if p.default is REQUIRED else _simple(p.default), p.meaning) for p in parameters),
        {**said, "supports": supports} if supports else said,
        "" if source.ours else source.package or str(source.path or source.module),
    )


def _first_sentence(plug_in: Any) -> str:
    """Of its docstring, not that of a class it comes from; of an object the function's that it holds, or nothing."""
    held = plug_in if isinstance(plug_in, type) or inspect.isfunction(plug_in) else getattr(plug_in, "function", None)
    text = inspect.cleandoc(getattr(held, "__doc__", None) or "")
    if isinstance(held, type) and is_dataclass(held) and text.startswith(f"{held.__name__}("):  # made by dataclass
        return ""
    paragraph = " ".join(text.split("\n\n")[0].split())
    return paragraph.split(". ")[0].rstrip(".")


def _simple(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_simple(each) for each in value]
    return value if value is None or isinstance(value, int | float) else str(value)
