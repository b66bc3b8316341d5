"""Findings of a check about a drawing, with the places that they name, in units of the drawing.

The same findings and notes as `mrp-sumo import --check`, which names places in words.
"""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import MapError
from mrp_sumo.maps.building import Building, Level
from mrp_sumo.maps.check import check_building, findings_of
from mrp_sumo.maps.clearance import barriers, narrow, point_distances, segment_distances
from mrp_sumo.maps.finding import CURE, MapFinding, ordered
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.oddities import oddities
from mrp_sumo.maps.readers.rmf.building_yaml import building_of
from mrp_sumo.maps.readers.rmf.reader import map_of_building
from mrp_sumo.maps.yaml_text import Text

MOST_PLACES = 200  # of a finding
VERTICES = re.compile(r"\b(?:vertex|vertices) (\d+(?:(?:, | and )\d+)*)")
LANES = re.compile(r"\blanes? (\d+(?:(?:, | and )\d+)*)")
WALLS = re.compile(r"\bwall (\d+)")
AT = re.compile(r"at \((-?[\d.]+), (-?[\d.]+)\)")
NAMED = re.compile(r"'([^']+)'")
Place = list[Any]  # level, x, y
DRAWN_HERE = ("no_lanes",)  # findings whose cure is this workbench


def check(document: Any, path: Path, robot: RobotType) -> dict[str, Any]:
    """Findings and notes about the document of a building, and how large it is as a graph; `robot` needs room beside the walls."""
    building: Building | None = None
    map_: Map | None = None
    try:
        building = building_of(document, Text(path, ""))
        map_ = map_of_building(building)
        findings = map_.findings
    except MapError as error:
        findings = findings_of(error)
        if building is not None and not findings:
            findings = ordered(building.findings + check_building(building))
    lines = [line for finding in findings for line in _of_finding(finding, building)]
    if building is not None:
        notes = [note for note in oddities(building) if map_ is None or len(building.graphs) > 1 or "goes through wall" not in note]
        lines += [{"severity": "note", "text": note, "places": list(_places(note, building))} for note in notes]  # of walls see below
    if map_ is not None:
        lines += _of_clearance(map_, robot)
    size = {"vertices": map_.nav.num_vertices, "lanes": map_.nav.num_lanes} if map_ is not None else {}
    return {"findings": lines, "refused": map_ is None, **size}


def drawn(xy: FloatArray, document: Any, path: Path) -> list[Place]:
    """Places [N, 2] m of a map as those of its drawing, each on the level nearest to it. Raises MapError as `map_of_building`."""
    building = map_of_building(building_of(document, Text(path, ""))).building
    assert building is not None
    levels = [level for level in building.levels.values() if len(level.xy)]
    middles = np.array([(level.xy.min(0) + level.xy.max(0)) / 2 for level in levels])
    halves = np.array([np.ptp(level.xy, axis=0) / 2 for level in levels])
    away = np.maximum(np.abs(xy[:, None] - middles) - halves, 0).sum(2) if len(xy) else np.zeros((0, len(levels)))
    fits = [_to_file(level, building) for level in levels]
    return [[levels[k].name, *_from(fits[k], place)] for place, k in zip(xy, away.argmin(1).tolist())]


def _of_finding(finding: MapFinding, building: Building | None) -> Iterator[dict[str, Any]]:
    """A line for each place, so that each can be gone to."""
    name, cure = finding.kind.replace("_", " "), CURE.get(finding.kind, "") if finding.kind not in DRAWN_HERE else ""
    for detail in finding.details[:MOST_PLACES] or ("",):
        text = f"{name}: {detail}" if detail else name
        places = list(_places(detail, building)) if building is not None else []
        yield {"severity": finding.severity, "kind": finding.kind, "text": text, "cure": cure, "places": places}


def _of_clearance(map_: Map, robot: RobotType) -> list[dict[str, Any]]:
    """A line on lanes and one on vertices without room beside walls."""
    building = map_.building
    if building is None:
        return []
    room, nav = narrow(map_.nav, building, robot), map_.nav
    of_level = {name: _to_file(level, building) for name, level in building.levels.items()}

    def place(xy: np.ndarray, vertex: int) -> Place:
        name = nav.level_names[nav.level[vertex]]
        return [name, *(_from(of_level[name], xy) if name in of_level else (0.0, 0.0))]

    walls = {name: barriers(building, name) for name in nav.level_names}

    def nearest(lane: int) -> Place:
        a, b = nav.tail[lane], nav.head[lane]
        return place(_nearest(nav.xy[a], nav.xy[b], walls[nav.level_names[nav.level[a]]]), a)

    lines = []
    lanes, vertices = room.lanes[:MOST_PLACES].tolist(), room.vertices[:MOST_PLACES].tolist()
    slim = set(room.slim.tolist())
    crossing = [lane for lane in lanes if room.lane_m[lane] == 0]
    beside = [lane for lane in lanes[len(crossing) :] if lane not in slim]
    kinds = (
        (crossing, f"lead through {room.limit}"),
        (beside, f"too near {room.limit} for '{robot.name}'"),
        (slim, f"narrower than '{robot.name}'"),
    )
    for some, many in kinds:
        if some:
            middles = some is slim
            places = [place((nav.xy[nav.tail[x]] + nav.xy[nav.head[x]]) / 2, nav.tail[x]) if middles else nearest(x) for x in some]
            lines.append({"severity": "note", "kind": "narrow_lanes", "text": f"lanes {many}: {len(some)}", "places": places})
    if vertices:
        text = f"vertices too near {room.limit} for '{robot.name}' to turn: {len(vertices)}"
        lines.append({"severity": "note", "kind": "narrow_vertices", "text": text, "places": [place(nav.xy[v], v) for v in vertices]})
    return lines


def _nearest(a: FloatArray, b: FloatArray, walls: FloatArray) -> FloatArray:
    """The place of a-b, [2] m, that is nearest to a wall [W, 2, 2]."""
    from_a, to_b = (np.broadcast_to(end, (len(walls), 2)) for end in (a, b))
    c, d = walls[segment_distances(from_a, to_b, walls[:, 0], walls[:, 1]).argmin()]
    along, across = b - a, d - c
    det = along[0] * across[1] - along[1] * across[0]
    meets = ((c - a)[0] * across[1] - (c - a)[1] * across[0]) / (det or np.inf)
    shares = np.clip([meets, *((end - a) @ along / (along @ along) for end in (c, d)), 0, 1], 0, 1)
    places: FloatArray = a + shares[:, None] * along
    nearest: FloatArray = places[point_distances(places, np.broadcast_to(c, places.shape), np.broadcast_to(d, places.shape)).argmin()]
    return nearest


def _places(text: str, building: Building) -> Iterator[Place]:
    """Places that a text names: vertices, lanes and walls by number, coordinates in metres, names of vertices and lifts."""
    named = [name for name in building.levels if re.search(rf"\blevel {re.escape(name)}(?:\W|$)", text)]
    levels = [building.levels[max(named, key=len)]] if named else list(building.levels.values())
    if named or len(levels) == 1:
        level = levels[0]
        drawn = _file_xy(level, building)
        lines = [(x.start, x.end) for x in level.lanes], level.walls.tolist(), [(v,) for v in range(len(drawn))]
        for pattern, ends in zip((LANES, WALLS, VERTICES), lines):
            numbers = [int(number) for match in pattern.findall(text) for number in re.findall(r"\d+", match)]
            yield from ([level.name, *drawn[list(ends[k])].mean(axis=0).round(3).tolist()] for k in numbers if k < len(ends))
        for x, y in AT.findall(text):
            yield [level.name, *_from(_to_file(level, building, world=True), np.array([float(x), float(y)]))]
    for lift in (lift for lift in building.lifts.values() if re.search(rf"\blifts? '?{re.escape(lift.name)}(?:\W|$)", text)):
        at = np.array([lift.x_m, lift.y_m])
        yield from ([x.name, *_from(_to_file(x, building, world=True), at)] for x in levels if x.name in lift.level_doors)
    for name in NAMED.findall(text):
        for level in levels:
            drawn = _file_xy(level, building)
            yield from ([level.name, *drawn[v].tolist()] for v, other in enumerate(level.vertex_name) if str(other) == name)


def _file_xy(level: Level, building: Building) -> np.ndarray:
    """[N, 2] as the file has them."""
    return level.raw_xy * (1.0, -1.0 if building.coordinate_system == "reference_image" else 1.0)


def _to_file(level: Level, building: Building, *, world: bool = False) -> np.ndarray:
    """[3, 2] the affine map from metres to units of the file, fitted to the level's vertices."""
    metres = level.world_xy if world else level.xy
    fit: np.ndarray = np.linalg.lstsq(np.column_stack((metres, np.ones(len(metres)))), _file_xy(level, building), rcond=None)[0]
    return fit


def _from(fit: np.ndarray, xy: np.ndarray) -> list[float]:
    return [round(float(value), 3) for value in np.array([*xy, 1.0]) @ fit]
