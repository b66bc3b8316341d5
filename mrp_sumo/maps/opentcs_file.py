"""Writer of openTCS plant models (`model-7.0.0.xsd`): points and paths in whole millimetres, locations, blocks.

A lane and the lane back on which robots drive backwards are one path. A curve is a path along the pieces it is drawn with, in steps of a
centimetre, as control points of a layout are whole numbers. Levels lie side by side: a model has one.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from mrp_sumo.core.graph import NavGraph
from mrp_sumo.maps.chains import Chains, chains_of
from mrp_sumo.maps.lif_file import stations_of, vertex_names
from mrp_sumo.maps.map import Map

SCALE = 10  # millimetres for a unit of the layout
NO_LIMIT_MPS = 10.0  # of lanes without a limit: a path has one
BOX = '<maxVehicleBoundingBox length="1000" width="1000" height="1000" referenceOffsetX="0" referenceOffsetY="0"/>'
KEPT = ("station", "actions", "is_charger", "is_parking_spot", "theta_rad", "mutex", "is_bend")  # options of vertices that a model can hold
KEPT_OF_LANES = ("edge_id", "path", "mutex", "orientation_constraint")


def write_opentcs(map_: Map, path: Path) -> None:
    """Write the graph of a map."""
    chains = chains_of(map_.nav)
    nav = chains.nav if chains else map_.nav
    with path.open("w", encoding="utf-8") as out:
        out.write('<?xml version="1.0" encoding="UTF-8" standalone="yes"?>\n')
        out.write(f'<model version="7.0.0" name={quoteattr(map_.name)}>\n')
        out.writelines(f"    {line}\n" for line in _lines(map_.nav, nav, chains))
        out.write("</model>\n")


def _lines(drawn: NavGraph, nav: NavGraph, chains: Chains | None) -> Iterator[str]:
    names, bends = vertex_names(nav), drawn.having("is_bend")
    points = [v for v in range(nav.num_vertices) if not bends[v]]
    paths = _paths(nav)
    outgoing: dict[int, list[str]] = {}
    for lane, ways in paths.items():
        outgoing.setdefault(_ends(nav, lane, ways)[0], []).append(_path_name(nav, lane, ways, names))
    for v in points:
        options = nav.vertex_options[v]
        kind = "PARK_POSITION" if options.get("is_parking_spot") else "HALT_POSITION"
        angle = f"{math.degrees(float(options['theta_rad'])):.4f}" if "theta_rad" in options else "NaN"
        x, y = _mm(nav.xy[v])
        place = f'positionX="{x}" positionY="{y}" positionZ="0"'
        leaving = "".join(f"<outgoingPath name={quoteattr(name)}/>" for name in outgoing.get(v, ()))
        layout = '<pointLayout labelOffsetX="-10" labelOffsetY="-20" layerId="0"/>'
        yield f'<point name={quoteattr(names[v])} {place} vehicleOrientationAngle="{angle}" type="{kind}">{BOX}{leaving}{layout}</point>'
    for lane, ways in paths.items():
        yield _path(drawn, nav, chains, lane, ways, names)
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


def _path(drawn: NavGraph, nav: NavGraph, chains: Chains | None, lane: int, ways: tuple[int, int], names: list[str]) -> str:
    source, destination = _ends(nav, lane, ways)
    ends = f"sourcePoint={quoteattr(names[source])} destinationPoint={quoteattr(names[destination])}"
    forward, back = (_limit(nav, one) if one >= 0 else 0 for one in ways)
    pieces = chains.piece[chains.first[lane] : chains.first[lane + 1]] if chains else np.zeros(0, np.int64)
    inner = drawn.xy[drawn.head[pieces[:-1]]] if len(pieces) > 1 else drawn.xy[:0]
    inner = inner if source == nav.tail[lane] else inner[::-1]
    kind = "POLYPATH" if len(inner) else "DIRECT"
    controls = "".join(f'<controlPoint x="{x}" y="{y}"/>' for x, y in (np.rint(inner * [1, -1] * 1000 / SCALE)).astype(int).tolist())
    length = max(1, round(1000 * float(nav.length_m[lane])))
    about = f'length="{length}" maxVelocity="{forward}" maxReverseVelocity="{back}" locked="false"'
    layout = f'<pathLayout connectionType="{kind}" layerId="0">{controls}</pathLayout>'
    return f"<path name={quoteattr(_path_name(nav, lane, ways, names))} {ends} {about}>{layout}</path>"


def _ends(nav: NavGraph, lane: int, ways: tuple[int, int]) -> tuple[int, int]:
    """The vertices where a path begins and ends."""
    tail, head = int(nav.tail[lane]), int(nav.head[lane])
    return (tail, head) if ways[0] >= 0 else (head, tail)


def _locations(nav: NavGraph, points: list[int], names: list[str]) -> Iterator[str]:
    """Stations, and chargers that are none, by what vehicles do there."""
    links: dict[str, tuple[tuple[str, ...], list[int]]] = {}
    for v in points:
        options = nav.vertex_options[v]
        operations = [o for o in str(options.get("actions", "")).split(", ") if o]
        if options.get("is_charger") and not any("charg" in o.lower() for o in operations):
            operations.append("CHARGE")
        stations = stations_of(options) or ([f"{names[v]} station"] if operations else [])
        for station in stations:
            links.setdefault(station, (tuple(operations), []))[1].append(v)
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
