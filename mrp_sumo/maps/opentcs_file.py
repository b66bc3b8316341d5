"""Writer of openTCS plant models (`model-7.0.0.xsd`): points and paths in whole millimetres, locations, blocks.

A lane and the lane back on which robots drive backwards are one path. A curve is a path along the pieces it is drawn with, in steps of a
centimetre, as control points of a layout are whole numbers. Levels lie side by side: a model has one. Of types of robots that are named
there is a vehicle each, whose envelope at a point is around the circle that keeps it and half of its gap; along a path it is their hull.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from mrp_sumo.core.graph import FloatArray, NavGraph
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.maps.chains import Chains, chains_of
from mrp_sumo.maps.curves import COURSES
from mrp_sumo.maps.lif_file import stations_of, vertex_names
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.readers.opentcs import TYPE_KEY

SCALE = 10  # millimetres for a unit of the layout
NO_LIMIT_MPS = 10.0  # of lanes without a limit: a path has one
SIZE_M = 1.0  # of vehicles, where no type of robots is named, and the height of all
CORNERS = 16  # of envelopes, which are around circles
LEVELS = 'energyLevelCritical="30" energyLevelGood="90" energyLevelFullyRecharged="95" energyLevelSufficientlyRecharged="45"'
KEPT = (
    "station",
    "actions",
    "is_charger",
    "is_parking_spot",
    "theta_rad",
    "mutex",
    "is_bend",
    *COURSES,
)  # options of vertices that a model can hold
KEPT_OF_LANES = ("edge_id", "path", "mutex", "orientation_constraint")
NO_TEXTS: Mapping[str, str] = {}


def write_opentcs(map_: Map, path: Path, robots: Sequence[RobotType] = (), as_type: Mapping[str, str] = NO_TEXTS) -> None:
    """Write the graph of a map, and a vehicle of each of some types of robots, with its envelopes at points and along paths.

    `as_type` are the texts of the types' files, by name, which vehicles have as a property.
    """
    chains = chains_of(map_.nav)
    nav = chains.nav if chains else map_.nav
    with path.open("w", encoding="utf-8") as out:
        out.write('<?xml version="1.0" encoding="UTF-8" standalone="yes"?>\n')
        out.write(f'<model version="7.0.0" name={quoteattr(map_.name)}>\n')
        out.writelines(f"    {line}\n" for line in _lines(map_.nav, nav, chains, robots, as_type))
        out.write("</model>\n")


def _lines(drawn: NavGraph, nav: NavGraph, chains: Chains | None, robots: Sequence[RobotType], as_type: Mapping[str, str]) -> Iterator[str]:
    names, bends = vertex_names(nav), drawn.having("is_bend")
    points = [v for v in range(nav.num_vertices) if not bends[v]]
    paths = _paths(nav)
    outgoing: dict[int, list[str]] = {}
    for lane, ways in paths.items():
        outgoing.setdefault(_ends(nav, lane, ways)[0], []).append(_path_name(nav, lane, ways, names))
    bodies = [robot.with_load for robot in robots]
    largest = [max((getattr(body, key) for body in bodies), default=SIZE_M) for key in ("length_m", "width_m")]
    box = _box("maxVehicleBoundingBox", *largest)
    for v in points:
        options = nav.vertex_options[v]
        kind = "PARK_POSITION" if options.get("is_parking_spot") else "HALT_POSITION"
        angle = f"{math.degrees(float(options['theta_rad'])):.4f}" if "theta_rad" in options else "NaN"
        x, y = _mm(nav.xy[v])
        place = f'positionX="{x}" positionY="{y}" positionZ="0"'
        leaving = "".join(f"<outgoingPath name={quoteattr(name)}/>" for name in outgoing.get(v, ()))
        envelopes = "".join(_envelope(robot, nav.xy[[v]]) for robot in robots)
        layout = '<pointLayout labelOffsetX="-10" labelOffsetY="-20" layerId="0"/>'
        about = f'{place} vehicleOrientationAngle="{angle}" type="{kind}"'
        yield f"<point name={quoteattr(names[v])} {about}>{box}{envelopes}{leaving}{layout}</point>"
    for lane, ways in paths.items():
        yield _path(drawn, nav, chains, lane, ways, names, robots)
    for robot in robots:
        top = round(1000 * robot.max_speed_mps)
        back = (
            round(1000 * (robot.kinematics.reverse_mps or robot.max_speed_mps)) if robot.kinematics.reverse or not robot.is_vehicle else 0
        )
        about = f'name={quoteattr(robot.name)} {LEVELS} maxVelocity="{top}" maxReverseVelocity="{back}"'
        body = _box("boundingBox", robot.length_m, robot.width_m)
        body += f"<property name={quoteattr(TYPE_KEY)} value={quoteattr(as_type[robot.name])}/>" if robot.name in as_type else ""
        yield f'<vehicle {about} envelopeKey={quoteattr(robot.name)}>{body}<vehicleLayout color="#00FF00"/></vehicle>'
    yield from _locations(nav, points, names)
    yield from _blocks(nav, points, paths, names)
    yield f'<visualLayout name="layout" scaleX="{SCALE}.0" scaleY="{SCALE}.0">'
    yield '    <layer id="0" ordinal="0" visible="true" name="layer" groupId="0"/><layerGroup id="0" name="group" visible="true"/>'
    yield "</visualLayout>"


def _paths(nav: NavGraph) -> dict[int, tuple[int, int]]:
    """The lanes that are paths, each with the lane that is driven forwards along it, and the one driven in reverse; -1: none.

    A lane on which robots drive backwards and that has no other in its direction is a path against it, in reverse only.
    """
    paths: dict[int, tuple[int, int]] = {}
    backward = [options.get("orientation_constraint") == "backward" for options in nav.lane_options]
    for lane in range(nav.num_lanes):
        back = int(nav.reverse[lane])
        if not backward[lane]:
            paths[lane] = lane, back if back >= 0 and backward[back] else -1
        elif back < 0 or backward[back]:
            paths[lane] = -1, lane
    return paths


def _box(name: str, length_m: float, width_m: float) -> str:
    """A bounding box around the middle of a vehicle."""
    size = f'length="{round(1000 * length_m)}" width="{round(1000 * width_m)}" height="{round(1000 * SIZE_M)}"'
    return f'<{name} {size} referenceOffsetX="0" referenceOffsetY="0"/>'


def _envelope(robot: RobotType, xy: FloatArray) -> str:
    """The room that a type needs at places [N, 2], with half of the gap between two: the hull of polygons around circles."""
    from scipy.spatial import ConvexHull

    angle = (np.arange(CORNERS) + 0.5) * 2 * np.pi / CORNERS
    reach_m = (robot.radius_m + robot.gap_m / 2) / np.cos(np.pi / CORNERS)
    corners = (xy[:, None] + reach_m * np.stack([np.cos(angle), np.sin(angle)], 1)).reshape(-1, 2)
    hull = corners[ConvexHull(corners).vertices]
    vertices = "".join(f'<vertex x="{x}" y="{y}"/>' for x, y in np.rint(1000 * np.concatenate([hull, hull[:1]])).astype(int).tolist())
    return f"<vehicleEnvelope key={quoteattr(robot.name)}>{vertices}</vehicleEnvelope>"


def _path(
    drawn: NavGraph,
    nav: NavGraph,
    chains: Chains | None,
    lane: int,
    ways: tuple[int, int],
    names: list[str],
    robots: Sequence[RobotType],
) -> str:
    source, destination = _ends(nav, lane, ways)
    ends = f"sourcePoint={quoteattr(names[source])} destinationPoint={quoteattr(names[destination])}"
    forward, back = (_limit(nav, one) if one >= 0 else 0 for one in ways)
    pieces = chains.piece[chains.first[lane] : chains.first[lane + 1]] if chains else np.zeros(0, np.int64)
    inner = drawn.xy[drawn.head[pieces[:-1]]] if len(pieces) > 1 else drawn.xy[:0]
    inner = inner if source == nav.tail[lane] else inner[::-1]
    along = np.concatenate([nav.xy[[source]], inner, nav.xy[[destination]]])
    envelopes = "".join(_envelope(robot, along) for robot in robots)
    kind = "POLYPATH" if len(inner) else "DIRECT"
    controls = "".join(f'<controlPoint x="{x}" y="{y}"/>' for x, y in (np.rint(inner * [1, -1] * 1000 / SCALE)).astype(int).tolist())
    length = max(1, round(1000 * float(nav.length_m[lane])))
    about = f'length="{length}" maxVelocity="{forward}" maxReverseVelocity="{back}" locked="false"'
    layout = f'<pathLayout connectionType="{kind}" layerId="0">{controls}</pathLayout>'
    return f"<path name={quoteattr(_path_name(nav, lane, ways, names))} {ends} {about}>{envelopes}{layout}</path>"


def _ends(nav: NavGraph, lane: int, ways: tuple[int, int]) -> tuple[int, int]:
    """The vertices where a path begins and ends."""
    tail, head = int(nav.tail[lane]), int(nav.head[lane])
    return (tail, head) if ways[0] >= 0 else (head, tail)


def _locations(nav: NavGraph, points: list[int], names: list[str]) -> Iterator[str]:
    """Stations, and chargers that are none, by what vehicles do there."""
    links: dict[str, tuple[tuple[str, ...], list[int]]] = {}
    for v in points:
        options = nav.vertex_options[v]
        actions = tuple(o for o in str(options.get("actions", "")).split(", ") if o)
        if options.get("is_charger") and not any("charg" in o.lower() for o in actions):
            actions = (*actions, "CHARGE")
        stations = stations_of(options) or ([f"{names[v]} station"] if actions else [])
        for station in stations:
            links.setdefault(station, (actions, []))[1].append(v)
    kinds = {operations: f"Type {k}" for k, operations in enumerate(dict.fromkeys(operations for operations, _ in links.values()), 1)}
    for operations, kind in kinds.items():
        allowed = "".join(f"<allowedOperation name={quoteattr(o)}/>" for o in (*operations, "NOP"))
        yield f'<locationType name="{kind}">{allowed}<locationTypeLayout locationRepresentation="WORKING_GENERIC"/></locationType>'
    layout = '<locationLayout labelOffsetX="-10" labelOffsetY="-20" locationRepresentation="DEFAULT" layerId="0"/>'
    for station, (operations, at) in links.items():
        x, y = _mm(nav.xy[at[0]])
        to = "".join(f"<link point={quoteattr(names[v])}/>" for v in at)
        name = quoteattr(station if station not in names else f"{station} (location)")
        place = f'positionX="{x}" positionY="{y}" positionZ="0"'
        yield f'<location name={name} {place} locked="false" type="{kinds[operations]}">{to}{layout}</location>'


def _blocks(nav: NavGraph, points: list[int], paths: dict[int, tuple[int, int]], names: list[str]) -> Iterator[str]:
    members: dict[str, list[str]] = {}
    for lane, ways in paths.items():
        if "mutex" in nav.lane_options[lane]:
            members.setdefault(str(nav.lane_options[lane]["mutex"]), []).append(_path_name(nav, lane, ways, names))
    for v in points:
        if "mutex" in nav.vertex_options[v]:
            members.setdefault(str(nav.vertex_options[v]["mutex"]), []).append(names[v])
    for group, of in members.items():
        listed = "".join(f"<member name={quoteattr(name)}/>" for name in of)
        yield f'<block name={quoteattr(group)} type="SINGLE_VEHICLE_ONLY">{listed}<blockLayout color="#FF0000"/></block>'


def _path_name(nav: NavGraph, lane: int, ways: tuple[int, int], names: list[str]) -> str:
    source, destination = _ends(nav, lane, ways)
    return f"{names[source]} --- {names[destination]}"


def _limit(nav: NavGraph, lane: int) -> int:
    """Speed limit in mm/s."""
    limit = float(nav.speed_mps[lane])
    return max(1, round(1000 * (limit if math.isfinite(limit) else NO_LIMIT_MPS)))


def _mm(xy: np.ndarray) -> tuple[int, int]:
    return round(1000 * float(xy[0])), round(1000 * float(xy[1]))
