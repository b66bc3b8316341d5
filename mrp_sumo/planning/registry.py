"""Finds planners and assigners by name and makes them with their parameters.

Plug-ins are tables of strings, `{"planners": {name: "module:class"}, "assigners": {...}}`, that packages
register under the entry-point group `mrp_sumo.planners`; the module is loaded when its name is first used.
A plug-in is a frozen dataclass: its fields are its parameters. Refuses unknown names and parameters, and
values of another type than the field's.
"""

import inspect
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from types import NoneType, UnionType
from typing import Any, Literal, Union, cast, get_args, get_origin, get_type_hints

from mrp_sumo.errors import MrpSumoError, ScenarioError, nearest
from mrp_sumo.planning.protocol import Assigner, Planner
from mrp_sumo.search.kernel_cache import drop_stale_kernels

GROUP = "mrp_sumo.planners"
KINDS = ("planners", "assigners")


def planner(name: str, parameters: Mapping[str, Any]) -> Planner:
    """The planner of this name.

    Parameters
    ----------
    name
        As registered: 'cbs', 'pibt', ...
    parameters
        Values for fields of its dataclass.

    Raises
    ------
    ScenarioError
        For an unknown name or parameter (with the nearest right one), or a value that does not fit.
    """
    drop_stale_kernels()
    return cast(Planner, _made("planners", name, parameters))


def assigner(name: str, parameters: Mapping[str, Any]) -> Assigner:
    """The assigner of this name; as `planner`."""
    return cast(Assigner, _made("assigners", name, parameters))


def planner_names() -> tuple[str, ...]:
    """All registered planners, sorted."""
    return tuple(sorted(_registered("planners")))


def assigner_names() -> tuple[str, ...]:
    """All registered assigners, sorted."""
    return tuple(sorted(_registered("assigners")))


def planner_class(name: str) -> type:
    """The class behind a name, to read its `guarantee` or its fields.

    Raises
    ------
    ScenarioError
        For an unknown name.
    """
    return _class("planners", name)


@cache
def _registered(kind: str) -> Mapping[str, str]:
    """name -> 'module:class', of all packages; the first to claim a name has it."""
    found: dict[str, str] = {}
    for entry in sorted(entry_points(group=GROUP), key=lambda e: (e.name != "bundled", e.name)):
        table = entry.load()
        if not isinstance(table, Mapping) or set(table) - set(KINDS):
            raise ScenarioError(f"plug-in '{entry.name}' ({entry.value}): expected a table with {' and '.join(KINDS)}")
        for name, place in table.get(kind, {}).items():
            found.setdefault(name, place)
    return found


def _class(kind: str, name: str) -> type:
    known = _registered(kind)
    if name not in known:
        raise ScenarioError(f"unknown {kind[:-1]} '{name}'{nearest(name, sorted(known), limit=20)}")
    module, _, attribute = known[name].partition(":")
    try:
        found = getattr(import_module(module), attribute)
    except (ImportError, AttributeError) as error:
        raise ScenarioError(f"{kind[:-1]} '{name}' ({known[name]}) cannot be loaded: {error}") from error
    if not (inspect.isclass(found) and is_dataclass(found)):
        raise ScenarioError(f"{kind[:-1]} '{name}' ({known[name]}) is not a dataclass")
    return cast(type, found)


def _made(kind: str, name: str, parameters: Mapping[str, Any]) -> Any:
    made = _class(kind, name)
    known: dict[str, Field[Any]] = {f.name: f for f in fields(made) if f.init}
    hints = get_type_hints(made)
    values = {}
    for key, value in parameters.items():
        if key not in known:
            expected = nearest(str(key), known, limit=20) or " (it has no parameters)"
            raise ScenarioError(f"{kind[:-1]} '{name}': unknown parameter '{key}'{expected}")
        fits, value = _fitted(value, hints[key])
        if not fits:
            raise ScenarioError(f"{kind[:-1]} '{name}': {key} is {value!r}, expected {_told(hints[key])}")
        values[key] = value
    for key, field in known.items():
        if key not in values and field.default is MISSING and field.default_factory is MISSING:
            raise ScenarioError(f"{kind[:-1]} '{name}': parameter '{key}' is missing")
    try:
        return made(**values)
    except MrpSumoError as error:
        raise ScenarioError(f"{kind[:-1]} '{name}': {error}") from None


def _fitted(value: Any, hint: Any) -> tuple[bool, Any]:
    """Whether a value from a file is of the field's type, and the value as that type."""
    if hint is Any:
        return True, value
    origin, inside = get_origin(hint), get_args(hint)
    if origin is Literal:
        return value in inside, value
    if origin in (Union, UnionType):
        for choice in inside:
            fits, fitted = _fitted(value, choice)
            if fits:
                return True, fitted
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
        return True, float(value)
    return isinstance(value, origin or hint), value


def _told(hint: Any) -> str:
    """A type in words a person expects."""
    origin, inside = get_origin(hint), get_args(hint)
    if origin is Literal:
        return "one of " + ", ".join(repr(v) for v in inside)
    if origin in (Union, UnionType):
        return " or ".join(_told(h) for h in inside)
    if origin is tuple:
        return "a list"
    words = {int: "a whole number", float: "a number", bool: "true or false", str: "a text", NoneType: "null"}
    return words.get(hint, str(hint))
