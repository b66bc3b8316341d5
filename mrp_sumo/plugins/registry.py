"""Finds plug-ins by name, checks their faces, and makes them with their parameters.

A plug-in is ours, or of a package that names it under an entry point, or of a file: `./mine.py:OneByOne`. A package's entry point in
the group `mrp_sumo.plugins` is a table of tables, `{"planners": {name: "module:class"}, "policies": {...}}`, by the kinds of
`kinds.KINDS`; its modules are loaded when a name is first used. Refuses unknown names and parameters, values of another type than the
parameter's, and plug-ins without the face of their kind.
"""

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrp_sumo.errors import MrpSumoError, PlugInError, ScenarioError, nearest
from mrp_sumo.plugins.face import check_face, check_methods, place_of
from mrp_sumo.plugins.kinds import KINDS, Kind
from mrp_sumo.plugins.limit import limited
from mrp_sumo.plugins.parameters import fitted
from mrp_sumo.plugins.source import Source, blamed, load, place_in_file, source_in_file, source_in_module

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

TABLES = ("mrp_sumo.plugins", "mrp_sumo.planners")  # groups whose entry points are tables by kind
MANY = 20  # names that a line can hold
SINGLE = {"policies": "mrp_sumo.policies"}  # groups whose entry points are plug-ins of a kind


def names(kind: str) -> tuple[str, ...]:
    """All registered plug-ins of a kind, sorted."""
    return tuple(sorted(_registered(kind)))


def find(kind: str, name: str, beside: Path | None = None) -> Source:
    """The source of a plug-in of a kind in `KINDS`, by its name or `FILE.py:NAME`, `beside` a folder. A file's is read, not executed.

    Raises ScenarioError for an unknown name, with the nearest right one, and for a file that is not there or has no such name.
    """
    one = KINDS[kind].one
    if place_in_file(name):
        try:
            return source_in_file(name, beside or Path())
        except ScenarioError as error:
            raise ScenarioError(f"{one} {error}") from None
    if name in (ours := _ours(kind)):  # without a look at what is installed, which takes a while
        return ours[name]
    known = _registered(kind)
    if name not in known and name.endswith(".py"):
        raise ScenarioError(f"{one} '{name}' is a file: expected the name in it, too, as in {name}:NAME")
    if name not in known:
        listed = nearest(name, sorted(known), limit=0 if len(known) > MANY else MANY) or f"; `mrp-sumo list {kind}` names them all"
        raise ScenarioError(f"unknown {one} '{name}'{listed}")
    return known[name]


def target(kind: str, name: str, beside: Path | None = None) -> Any:
    """The class, function or object of a plug-in, loaded and checked; as `find`.

    Raises ScenarioError as `find`, and PlugInError when it cannot be loaded, or lacks what its kind needs.
    """
    return loaded(KINDS[kind], find(kind, name, beside))


def make(kind: str, name: str, parameters: Mapping[str, Any], beside: Path | None = None) -> Any:
    """A plug-in with its parameters, checked; as `find`.

    Raises ScenarioError as `find`, and for an unknown parameter (with the nearest right one) or a value that does not fit, and PlugInError
    when it cannot be loaded or made, or lacks what its kind needs.
    """
    return made(KINDS[kind], find(kind, name, beside), parameters)


def loaded(kind: Kind, source: Source) -> Any:
    """The class, function or object at a source, as `target`."""
    entry = _our_table(kind).get(source.name) if source.ours else None
    plug_in = load(source) if entry is None or isinstance(entry, str) else entry
    face = None if source.ours else face_of(kind)  # ours are checked by a test: some are made in every replanning
    if kind.made:
        if not isinstance(plug_in, type):
            raise PlugInError(f"{place_of(plug_in)}: {source.attribute} is {type(plug_in).__name__}, expected a class, the {kind.one}'s")
        if face:
            check_methods(plug_in, face, kind.one)
    elif face:
        check_face(plug_in, face, kind.one)
    return plug_in


def made(kind: Kind, source: Source, parameters: Mapping[str, Any]) -> Any:
    """The plug-in at a source with its parameters, as `make`."""
    plug_in = loaded(kind, source)
    what = f"{kind.one} '{source.name}'"
    values = fitted(what, plug_in, parameters)
    try:
        with limited():
            result = plug_in(**values)
    except KeyboardInterrupt:
        raise
    except BaseException as error:
        if isinstance(error, MrpSumoError):  # a parameter's value that it refuses
            raise ScenarioError(f"{what}: {error}") from None
        if source.ours:
            raise
        raise blamed(error, source, plug_in) from error
    if not source.ours and (face := face_of(kind)):
        check_face(result, face, kind.one)
    return result


def face_of(kind: Kind) -> type | None:
    """The Protocol of a kind; None for one without."""
    face: type | None = _named(kind.face) if kind.face else None
    return face


def forget() -> None:
    """Look at the entry points again, since packages were installed."""
    _registered.cache_clear()
    _table.cache_clear()


@cache
def _ours(kind: str) -> Mapping[str, Source]:
    """Where those are that come with this program, by name."""
    place_of_table = KINDS[kind].ours
    if not place_of_table:
        return {}
    table = _our_table(KINDS[kind])
    return {name: source_in_module(name, place if isinstance(place, str) else place_of_table, ours=True) for name, place in table.items()}


def _our_table(kind: Kind) -> Mapping[str, Any]:
    table = _named(kind.ours)
    entries: Mapping[str, Any] = table.get(kind.name, table)
    return entries


@cache
def _registered(kind: str) -> Mapping[str, Source]:
    """Where the plug-ins of a kind are, by name, of all packages; the first to claim a name has it, ours before others'."""
    from importlib.metadata import entry_points

    entries = dict(_ours(kind))
    tables = [entry for group in TABLES for entry in entry_points(group=group)]
    for entry in sorted(tables, key=lambda e: e.name):
        for name, place in _table(entry).get(kind, {}).items():
            entries.setdefault(name, source_in_module(name, place, ours=False, package=_package(entry)))
    for entry in sorted(entry_points(group=SINGLE.get(kind, "")), key=lambda e: e.name):
        entries.setdefault(entry.name, source_in_module(entry.name, entry.value, ours=False, package=_package(entry)))
    return entries


def _package(entry: "EntryPoint") -> str:
    return f"{entry.dist.name} {entry.dist.version}" if entry.dist else ""


@cache
def _table(entry: "EntryPoint") -> Mapping[str, Mapping[str, str]]:
    table = load(source_in_module(entry.name, entry.value, ours=False))
    if not isinstance(table, Mapping) or set(table) - set(KINDS):
        raise ScenarioError(f"plug-in '{entry.name}' ({entry.value}): expected a table by kind: {', '.join(KINDS)}")
    for kind, listed in table.items():
        if not isinstance(listed, Mapping) or not all(isinstance(place, str) and ":" in place for place in listed.values()):
            raise ScenarioError(
                f"plug-in '{entry.name}' ({entry.value}): {kind}: expected names with places, such as 'my_package.mine:Mine'"
            )
    return table


def _named(place: str) -> Any:
    """What stands at 'module:attribute' of ours."""
    module, _, attribute = place.partition(":")
    return getattr(import_module(module), attribute)
