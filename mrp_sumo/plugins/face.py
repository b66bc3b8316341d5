"""The check of a plug-in's face: does it have what its kind's Protocol asks for?

Works for objects of any class and for functions. What is missing is one line with the file, the line and the name.
"""

import inspect
from pathlib import Path
from typing import Any, get_type_hints

from mrp_sumo.errors import PlugInError


def check_methods(target: type, face: type, one: str) -> None:
    """Refuse a class that lacks a method of a Protocol, before anything is made of it.

    Raises PlugInError: naming the class's file and line, and the method.
    """
    for name, method in _methods(face).items():
        member = getattr(target, name, None)
        if not callable(member) or member is method:  # one that it has of the Protocol itself does nothing
            raise PlugInError(f"{place_of(target)}: {target.__name__} is no {one}: it has no method {_call(name, method)}")


def check_face(made: Any, face: type, one: str) -> None:
    """Refuse an object that lacks a method, property or annotated name of a Protocol, or a function where that has `__call__`.

    Raises PlugInError: one line with file and line of the class, method or function, and what is missing or takes other arguments.
    """
    what = getattr(made, "__name__", type(made).__name__)
    for name, method in _methods(face).items():
        member = made if name == "__call__" else getattr(made, name, None)
        if not callable(member):
            raise PlugInError(f"{place_of(made)}: {what} is no {one}: it has no method {_call(name, method)}")
        try:
            inspect.signature(member).bind(*_arguments(method))
        except TypeError:
            taken = f"{what if name == '__call__' else name}{inspect.signature(member)}"
            raise PlugInError(f"{place_of(member)}: {what} is no {one}: it has {taken}, expected {_call(name, method)}") from None
        except ValueError:  # a function in C, which does not tell
            continue
    for name, kind in attributes_of(face).items():
        if not hasattr(made, name):
            raise PlugInError(f"{place_of(made)}: {what} is no {one}: it has no attribute '{name}'")
        value = getattr(made, name)
        fits = isinstance(value, int | float if kind is float else kind) if kind in (bool, int, float, str) else True
        if not fits or (isinstance(value, bool) and kind in (int, float)):
            raise PlugInError(f"{place_of(made)}: {what} is no {one}: '{name}' is {value!r}, expected {kind.__name__}")


def attributes_of(face: type) -> dict[str, Any]:
    """The attributes that a Protocol asks for, with their types; None for one without a hint."""
    hints = get_type_hints(face)
    attributes = {name: kind for name, kind in hints.items() if not name.startswith("_")}
    for name, value in _members(face).items():
        if isinstance(value, property) and value.fget:
            attributes[name] = get_type_hints(value.fget).get("return")
    return attributes


def place_of(target: Any) -> str:
    """`file:line` of a function, a class, or an object's class; the file as seen from the current folder."""
    target = inspect.unwrap(target) if callable(target) else target
    code = getattr(getattr(target, "__func__", target), "__code__", None)
    if code is not None:
        return f"{shown(Path(code.co_filename))}:{code.co_firstlineno}"
    definition = target if isinstance(target, type) else type(target)
    try:
        lines, line = inspect.findsource(definition)
        while not lines[line].lstrip().startswith("class "):  # below its decorators
            line += 1
        return f"{shown(Path(inspect.getfile(definition)))}:{line + 1}"
    except (OSError, TypeError, IndexError):
        return definition.__module__


def shown(path: Path) -> str:
    """A path relative to the current folder, where it is inside."""
    return str(path.relative_to(Path.cwd())) if path.is_relative_to(Path.cwd()) else str(path)


def _members(face: type) -> dict[str, Any]:
    """The Protocol's own and inherited members, without those of every object."""
    members: dict[str, Any] = {}
    for part in reversed([c for c in face.__mro__ if getattr(c, "_is_protocol", False) and c.__module__ != "typing"]):
        members |= {name: value for name, value in vars(part).items() if not name.startswith("_") or name == "__call__"}
    return members


def _methods(face: type) -> dict[str, Any]:
    return {name: value for name, value in _members(face).items() if inspect.isfunction(value)}


def _arguments(method: Any) -> list[str]:
    """Names of what a method is called with, without self."""
    return [p.name for p in inspect.signature(method).parameters.values() if p.default is p.empty][1:]


def _call(name: str, method: Any) -> str:
    return f"{name}({', '.join(_arguments(method))})"
