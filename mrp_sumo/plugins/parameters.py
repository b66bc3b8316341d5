"""Parameters of plug-ins: which there are, and values from files fitted to their types.

A dataclass's parameters are its fields, any other class's or function's those of its signature.
"""

import inspect
import sys
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from mrp_sumo.errors import ScenarioError, nearest


class Required:
    """The default of a parameter without one."""

    def __repr__(self) -> str:
        return "required"


REQUIRED = Required()


@dataclass(frozen=True)
class Parameter:
    """A parameter of a plug-in."""

    name: str
    type: Any  # a type hint; Any where there is none
    default: Any  # REQUIRED where there is none
    meaning: str = ""  # that the metadata of a dataclass's field says as `description`

    @property
    def expected(self) -> str:
        """Its type in words: 'a number', "one of 'a', 'b'"."""
        return in_words(self.type)


def parameters_of(target: Callable[..., Any]) -> tuple[Parameter, ...]:
    """The parameters that a class or function can be called with by name."""
    hints = _hints(target)
    if isinstance(target, type) and is_dataclass(target):
        parameters = []
        for field in fields(target):
            default = field.default if field.default is not MISSING else REQUIRED
            if field.default_factory is not MISSING:
                default = field.default_factory()
            if field.init:
                parameters.append(Parameter(field.name, hints.get(field.name, Any), default, field.metadata.get("description", "")))
        return tuple(parameters)
    try:
        signature = inspect.signature(target)
    except (TypeError, ValueError):  # a class in C
        return ()
    named = (p for p in signature.parameters.values() if p.kind in (p.POSITIONAL_OR_KEYWORD, p.KEYWORD_ONLY))
    return tuple(Parameter(p.name, hints.get(p.name, Any), REQUIRED if p.default is p.empty else p.default) for p in named)


def fitted(what: str, target: Callable[..., Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """Values from a file as the parameters' types.

    Raises ScenarioError for an unknown name (with the nearest right one), a value of another type, or a missing parameter.
    """
    known = {parameter.name: parameter for parameter in parameters_of(target)}
    fitting = {}
    for key, value in values.items():
        if key not in known:
            expected = nearest(str(key), known, limit=20) or " (it has no parameters)"
            raise ScenarioError(f"{what}: unknown parameter '{key}'{expected}")
        fits, fitting[key] = _fitted(value, known[key].type)
        if not fits:
            raise ScenarioError(f"{what}: {key} is {value!r}, expected {known[key].expected}")
    for key, parameter in known.items():
        if key not in fitting and parameter.default is REQUIRED:
            raise ScenarioError(f"{what}: parameter '{key}' is missing")
    return fitting


def in_words(hint: Any) -> str:
    """A type in plain words."""
    origin, inside = get_origin(hint), get_args(hint)
    if origin is Literal:
        return "one of " + ", ".join(repr(v) for v in inside)
    if origin in (Union, UnionType):
        return " or ".join(in_words(h) for h in inside)
    if origin in (tuple, list):
        return "a list"
    words = {int: "a whole number", float: "a number", bool: "true or false", str: "a text", NoneType: "null", Any: "anything"}
    return words.get(hint) or str(getattr(hint, "__name__", hint))


def _hints(target: Callable[..., Any]) -> dict[str, Any]:
    """Type hints by name; none where they name what cannot be found."""
    try:
        return get_type_hints(target if not isinstance(target, type) or is_dataclass(target) else target.__init__)  # type: ignore[misc]
    except (NameError, TypeError, AttributeError):
        return {}


def _fitted(value: Any, hint: Any) -> tuple[bool, Any]:
    """True if a value from a file is of a type, and the value as that type."""
    if hint is Any:
        return True, value
    origin, inside = get_origin(hint), get_args(hint)
    if origin is Literal:
        return value in inside, value
    if origin in (Union, UnionType):
        for choice in inside:
            fits, converted = _fitted(value, choice)
            if fits:
                return True, converted
        return False, value
    if hint in (None, NoneType):
        return value is None, value
    if origin is tuple and isinstance(value, list | tuple):
        wanted = [inside[0]] * len(value) if len(inside) == 2 and inside[1] is Ellipsis else list(inside)
        if len(wanted) != len(value):
            return False, value
        pairs = [_fitted(v, h) for v, h in zip(value, wanted)]
        return (True, tuple(v for _, v in pairs)) if all(fits for fits, _ in pairs) else (False, value)
    if hint is bool or isinstance(value, bool):
        return hint is bool and isinstance(value, bool), value
    if hint is float and isinstance(value, int | float):
        return (False, value) if isinstance(value, int) and abs(value) > sys.float_info.max else (True, float(value))
    kind = origin or hint
    return isinstance(value, kind) if isinstance(kind, type) else True, value
