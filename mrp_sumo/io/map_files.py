"""Writing a map in any format that holds its graph; the suffix chooses. What the format cannot hold is reported.

Refuses suffixes it does not know, and several levels in formats that have one.
"""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mrp_sumo.core.graph import NavGraph, PlanGraph
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import MapError, count, nearest, sentence
from mrp_sumo.files.reading import shortened
from mrp_sumo.files.writing import written_whole
from mrp_sumo.io.scenario.robots import text_of_type
from mrp_sumo.maps import lif_file, opentcs_file
from mrp_sumo.maps.curves import TANGENT
from mrp_sumo.maps.geojson import write_geojson
from mrp_sumo.maps.grid import paper_cells
from mrp_sumo.maps.lif_file import write_lif
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.opentcs_file import write_opentcs
from mrp_sumo.maps.readers.movingai import write_grid
from mrp_sumo.maps.readers.nav_graph import document_of_map, write_nav_graph

SUFFIXES = (".nav.yaml", ".map", ".geojson", ".net.xml", ".lif.json", ".xml")


def write_map(map_: Map, path: Path, cell_m: float = 0.4, robots: Sequence[RobotType] = ()) -> list[str]:
    """Write a map, whole or not at all; returns what the format cannot hold, in words. Raises MapError as the module refuses.

    The path ends in .nav.yaml (RMF nav graph), .map (MovingAI, of cells of `cell_m` where it is made of a nav graph), .geojson, .net.xml
    (SUMO), .lif.json (LIF 1.0) or .xml (openTCS); the last two know the types of `robots`.
    """
    suffix = next((suffix for suffix in SUFFIXES if path.name.endswith(suffix) and path.name != suffix), None)
    if suffix is None:
        ending = "".join(path.suffixes[-2:]) or path.name
        raise MapError(f"{path.name}: no map format ends in '{ending}'{nearest(ending, SUFFIXES)}")
    if robots and suffix not in _WRITE_WITH_TYPES:
        raise MapError(f"{path.name}: has no types of vehicles, expected a name that ends in {' or '.join(_WRITE_WITH_TYPES)} for robots")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with written_whole(path) as part:
            lost = _WRITE_WITH_TYPES[suffix](map_, part, robots) if suffix in _WRITE_WITH_TYPES else _WRITE[suffix](map_, part, cell_m)
            return [*_graphs_left_out(map_), *filter(None, lost)]
    except OSError as error:
        raise MapError(f"{shortened(path)}: {sentence(error)}") from None


def _write_nav_graph(map_: Map, path: Path, cell_m: float) -> list[str]:
    write_nav_graph(document_of_map(map_), path)
    is_grid = [f"that it is a grid of {map_.nav.cell_m:g} m cells"] if isinstance(map_.nav, PlanGraph) else []
    return _drawing_losses(map_, "walls", "floors") + is_grid


def _write_grid(map_: Map, path: Path, cell_m: float) -> list[str]:
    nav = map_.nav
    if map_.free is not None:
        write_grid(map_.free, path)
        return [f"the cell length, {nav.cell_m:g} m"] if isinstance(nav, PlanGraph) else []
    free, _, origin = paper_cells(nav, cell_m)
    write_grid(free, path)
    return [
        f"the cell length, {cell_m:g} m, and the place of the lower left corner, ({origin[0]:.3f}, {origin[1]:.3f}) m",
        "where exactly vertices and lanes are",
        *_vertex_losses(nav),
        _count(int(np.count_nonzero(nav.reverse < 0)), "one-way lane", "one-way lanes: cells have no direction"),
        _door_losses(nav),
        _count(int(np.count_nonzero(np.isfinite(nav.speed_mps))), "speed limit"),
        *_drawing_losses(map_, "walls", "floors"),
    ]


def _write_geojson(map_: Map, path: Path, cell_m: float) -> list[str]:
    write_geojson(map_, path)
    return _drawing_losses(map_, "floors", "doors", "lifts")


def _write_network(map_: Map, path: Path, cell_m: float) -> list[str]:
    from mrp_sumo.engines.sumo.network import backdrop_of, build_network

    try:
        build_network(map_.nav, path, None)
    finally:
        backdrop_of(path).unlink(missing_ok=True)
    losses = [*_vertex_losses(map_.nav), _door_losses(map_.nav), *_drawing_losses(map_, "walls", "floors", "lifts")]
    return [*losses, _level_losses(map_, "an edge")]


def _write_lif(map_: Map, path: Path, robots: Sequence[RobotType]) -> list[str]:
    write_lif(map_, path, robots)
    losses = _option_losses(map_.nav, lif_file.KEPT, lif_file.KEPT_OF_LANES) + _drawing_losses(map_, "walls", "floors", "doors")
    if len(map_.vehicle_types) > 1:
        losses.append("limits, directions and loads that differ by type of vehicle on one edge")
    return [*losses, "the cell length" if isinstance(map_.nav, PlanGraph) else ""]


def _write_opentcs(map_: Map, path: Path, robots: Sequence[RobotType]) -> list[str]:
    write_opentcs(map_, path, robots, {robot.name: text_of_type(robot) for robot in robots})
    nav = map_.nav
    losses = _option_losses(nav, opentcs_file.KEPT, opentcs_file.KEPT_OF_LANES) + _drawing_losses(map_, "walls", "floors", "doors", "lifts")
    curves = any(TANGENT in options for options in nav.vertex_options)
    losses.append("the courses of curves, which are polylines within 1 cm of them" if curves else "")
    free = int(np.count_nonzero(np.isinf(nav.speed_mps)))
    losses.append(_count(free, "lane") + f" without a speed limit, for which {opentcs_file.NO_LIMIT_MPS:g} m/s is written" if free else "")
    return [*losses, _level_losses(map_, "a point")]


_WRITE = {".nav.yaml": _write_nav_graph, ".map": _write_grid, ".geojson": _write_geojson, ".net.xml": _write_network}
_WRITE_WITH_TYPES = {".lif.json": _write_lif, ".xml": _write_opentcs}


def _option_losses(nav: NavGraph, of_vertices: tuple[str, ...], of_lanes: tuple[str, ...]) -> list[str]:
    """How many vertices and lanes have each property that is lost."""
    losses = []
    for one, more, held, all_options in (
        ("vertex", "vertices", of_vertices, nav.vertex_options),
        ("lane", "lanes", of_lanes, nav.lane_options),
    ):
        lost = Counter(name for options in all_options for name in options if name not in held)
        losses += [_count(number, f"{one} with {name}", f"{more} with {name}") for name, number in lost.items()]
    return losses


def _graphs_left_out(map_: Map) -> list[str]:
    left = [str(graph) for graph in map_.graphs if graph not in map_.chosen]
    return [f"graph{'s' if len(left) > 1 else ''} {', '.join(left)}; --graph chooses"] if left else []


def _drawing_losses(map_: Map, *kinds: str) -> list[str]:
    """How many walls, floors, doors, lifts of the building are lost."""
    if map_.building is None:
        return []
    levels = [map_.building.levels[name] for name in map_.nav.level_names if name in map_.building.levels]
    num = {"lifts": len(map_.building.lifts)} | {
        kind: sum(len(getattr(lv, kind)) for lv in levels) for kind in ("walls", "floors", "doors")
    }
    return [_count(num[kind], kind.removesuffix("s")) for kind in kinds]


def _vertex_losses(nav: NavGraph) -> list[str]:
    with_properties = sum(bool(options) for options in nav.vertex_options)
    names = _count(sum(bool(name) for name in nav.vertex_name), "name")
    return [names, _count(with_properties, "vertex with properties", "vertices with properties")]


def _door_losses(nav: NavGraph) -> str:
    return _count(sum("door_name" in options for options in nav.lane_options), "lane with a door", "lanes with a door")


def _level_losses(map_: Map, what: str) -> str:
    num = len(map_.level_shift_m)
    return f"which of the {num} levels {what} is on; they are laid out on one plane" if num > 1 else ""


def _count(number: int, one: str, more: str = "") -> str:
    return count(number, one, more) if number else ""
