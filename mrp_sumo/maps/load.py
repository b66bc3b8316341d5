"""Loading any map file: the reader that recognises it by content makes one `Map` of it.

Refuses formats that no reader recognises, maps with nothing to drive on, and graphs and levels that do not exist.
"""

from pathlib import Path
from typing import Any, cast

import numpy as np

from mrp_sumo.core.graph import NavGraph
from mrp_sumo.errors import MapError, MrpSumoError, PlugInError
from mrp_sumo.files.names import fault_of
from mrp_sumo.files.reading import shortened
from mrp_sumo.maps.cache import remembered
from mrp_sumo.maps.finding import MapFinding
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.readers.reader import MapFile, Reader, Selection, map_file
from mrp_sumo.maps.readers.registry import OF_TEXT, OURS
from mrp_sumo.maps.readers.strangers import advice, lacking
from mrp_sumo.plugins import registry
from mrp_sumo.plugins.face import place_of
from mrp_sumo.plugins.source import calling, digest

__all__ = ["Map", "MapFinding", "files_of", "load_map"]

LARGE = 1_000_000  # characters; larger YAML files are remembered


def load_map(path: Path, *, reader: str | None = None, beside: Path | None = None, **chosen: Any) -> Map:
    """Load a map of any format that `mrp-sumo list readers` names; `chosen` are fields of a `Selection`, the part of it that is taken.

    The reader is named, or `FILE.py:CLASS` relative to the folder `beside`; by default it is the first that recognises the file. Raises
    MapError as the module and the format's reader refuse, and PlugInError for a reader from outside that breaks its contract.
    """
    selection = Selection(**chosen)
    file = map_file(Path(path))
    if reader is not None or len(file.text) < LARGE or any(_reader(name).detects(file) for name in OF_TEXT):
        return _named(file, _read(reader or _detected(file), file, selection, beside))
    outside = [digest(registry.find("readers", name)) for name in registry.names("readers") if name not in OURS]
    choice = (str(file.path.resolve()), str(file.path), *vars(selection).values(), *outside)
    map_ = remembered("map", f"{choice}\n{file.text}".encode(), lambda: _read(_detected(file), file, selection))
    _read_only(map_.nav)
    return _named(file, map_)


def files_of(path: Path, reader: str | None = None, beside: Path | None = None) -> tuple[Path, ...]:
    """The files that a map is read from: itself, the `.map` of a problem set, the image of an occupancy map.

    Raises MapError when one is missing, or no reader recognises the map.
    """
    file = map_file(path)
    if reader is None and len(file.text) >= LARGE:
        return (path,)
    files = getattr(_reader(reader or _detected(file), beside), "files", None)
    return (path, *files(file)[1:]) if files else (path,)


def _detected(file: MapFile) -> str:
    """The reader that recognises a file: a bundled one, or one of a package."""
    for name in OURS:
        if _reader(name).detects(file):
            return name
    for name in registry.names("readers"):
        if name not in OURS:
            reader = _reader(name)
            with calling(registry.find("readers", name), type(reader)):
                if reader.detects(file):
                    return name
    if stranger := advice(file.head):
        raise file.source.fault(stranger)
    if file.fault:
        raise file.fault
    if missing := lacking(file.path.name):
        raise file.source.fault(missing)
    known = ", ".join(dict.fromkeys(f"{reader.name} ({' '.join(reader.suffixes)})" for reader in map(_reader, registry.names("readers"))))
    raise file.source.fault(
        f"not a map this program reads: {known}; a table of lanes or a plan of the floor (DXF, PNG) can be made of most drawings"
    )


def _reader(name: str, beside: Path | None = None) -> Reader:
    return cast(Reader, registry.make("readers", name, {}, beside))


def _read(name: str, file: MapFile, selection: Selection, beside: Path | None = None) -> Map:
    """The map, checked where the reader is from outside."""
    reader, source = _reader(name, beside), registry.find("readers", name, beside)
    if source.ours:
        return reader.read(file, selection)
    with calling(source, type(reader), MrpSumoError):
        map_ = reader.read(file, selection)
    if not isinstance(map_, Map):
        raise PlugInError(f"{place_of(type(reader))}: read gives {type(map_).__name__}, expected a Map")
    if not map_.nav.num_lanes:
        raise MapError(f"{file.path.name}: no lanes: nothing to drive on ({map_.nav.num_vertices} vertices)")
    return map_


def _named(file: MapFile, map_: Map) -> Map:
    """The map, whose names can be shown."""
    for what, names in (("map", (map_.name,)), ("level", map_.nav.level_names), ("vertex", set(map_.nav.vertex_name))):
        for name in names:
            if fault := fault_of(name):
                raise MapError(f"{shortened(file.path)}: name of a {what}: {fault}")
    return map_


def _read_only(nav: NavGraph) -> None:
    """Pickling forgets that a graph's arrays must not be written to."""
    for value in vars(nav).values():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
