"""Writer of the VDMA's Layout Interchange Format, version 1.0.0 (LIF.md, section 8): a layout a level, an edge a lane.

Types of vehicles are types of robots that are named, else those of the map, else one for all. A curve is a NURBS of Bezier curves, a
polyline one of degree 1. Coordinates are those of the map's file, not of levels laid side by side.
"""

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mrp_sumo.core.graph import STATIONS, FloatArray, NavGraph
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.files.names import distinct
from mrp_sumo.maps.chains import chains_of
from mrp_sumo.maps.curves import COURSES, nurbs_of
from mrp_sumo.maps.levels import shifts_of
from mrp_sumo.maps.map import Map

VEHICLE_TYPE = "mrp_sumo.robot"
KEPT = ("station", "actions", "is_charger", "theta_rad", "is_bend", "lift", *COURSES)  # options of vertices that LIF can hold
RIDE = ("lift", "ride_s", "close_s", "open_s")
TURNS = (("turns_at_start", "rotationAtStartNodeAllowed"), ("turns_at_end", "rotationAtEndNodeAllowed"))
KEPT_OF_LANES = (
    "edge_id",
    "path",
    "load",
    "orientation_constraint",
    "turns_at_start",
    "turns_at_end",
    "turns_on_way",
    "vehicle_types",
    *RIDE,
)


class _VehicleType(NamedTuple):
    """A type of vehicle: its name, and the type of robots where it is one."""

    name: str
    robot: RobotType | None = None


def write_lif(map_: Map, path: Path, robots: Sequence[RobotType] = ()) -> None:
    """Write the graph of a map, for some types of robots."""
    types = [_VehicleType(robot.in_layouts, robot) for robot in robots] or [
        _VehicleType(name) for name in map_.vehicle_types or (VEHICLE_TYPE,)
    ]
    drawn = map_.nav
    chains = chains_of(drawn)
    nav = chains.nav if chains else drawn
    shift = shifts_of(nav.level_names, map_.level_shift_m)
    xy = nav.xy - shift[nav.level] + np.array(map_.origin_m)
    names = vertex_names(nav)
    bends = drawn.having("is_bend")

    def trajectory(lane: int) -> dict[str, Any] | None:
        """The trajectory of a curve, None of a lane that is straight."""
        pieces = chains.piece[chains.first[lane] : chains.first[lane + 1]].tolist() if chains else []
        if len(pieces) < 2:
            return None
        degree, knots, points = nurbs_of(drawn, pieces, xy)
        return {"degree": degree, "knotVector": knots, "controlPoints": [_point(p) for p in points]}

    layouts = []
    for k, level in enumerate(nav.level_names):
        vertices = [v for v in np.flatnonzero(nav.level == k).tolist() if not bends[v]]
        lanes = np.flatnonzero(nav.level[nav.tail] == k).tolist()
        layouts.append(
            {
                "layoutId": level,
                "layoutVersion": "1",
                "layoutLevelId": level,
                "nodes": [_node(nav, v, names[v], xy[v], level, types) for v in vertices],
                "edges": [edge for lane in lanes if (edge := _edge(nav, lane, names, trajectory(lane), types))],
                "stations": _stations(nav, vertices, names),
            }
        )
    modified = datetime.fromtimestamp(map_.path.stat().st_mtime, UTC) if map_.path.is_file() else datetime.fromtimestamp(0, UTC)
    about = {
        "projectIdentification": map_.name,
        "creator": "mrp_sumo",
        "exportTimestamp": modified.strftime("%Y-%m-%dT%H:%M:%S.00Z"),
        "lifVersion": "1.0.0",
    }
    path.write_text(json.dumps({"metaInformation": about, "layouts": layouts}, indent=1) + "\n", encoding="utf-8")


def vertex_names(nav: NavGraph) -> list[str]:
    """[V] a name for every vertex, each another."""
    return distinct(map(nav.label, range(nav.num_vertices)))


def stations_of(options: Mapping[str, Any]) -> list[str]:
    """The names of the stations at a vertex."""
    return str(options["station"]).split(STATIONS) if "station" in options else []


def _node(nav: NavGraph, v: int, name: str, xy: FloatArray, level: str, types: Sequence[_VehicleType]) -> dict[str, Any]:
    options = nav.vertex_options[v]
    properties: dict[str, Any] = {}
    if "theta_rad" in options:
        properties["theta"] = float(options["theta_rad"])
    kinds = [kind for kind in str(options.get("actions", "")).split(", ") if kind]
    if options.get("is_charger") and not any("charg" in kind.lower() for kind in kinds):
        kinds.append("startCharging")
    if kinds:
        properties["actions"] = [{"actionType": kind, "requirementType": "OPTIONAL", "blockingType": "HARD"} for kind in kinds]
    return {
        "nodeId": name,
        "mapId": level,
        "nodePosition": _point(xy),
        "vehicleTypeNodeProperties": [{"vehicleTypeId": each.name, **properties} for each in types],
    }


def _edge(
    nav: NavGraph, lane: int, names: list[str], trajectory: dict[str, Any] | None, types: Sequence[_VehicleType]
) -> dict[str, Any] | None:
    """An edge, None where it is for none of the types."""
    tail, head, options = int(nav.tail[lane]), int(nav.head[lane]), nav.lane_options[lane]
    is_back = options.get("orientation_constraint") == "backward"
    only = str(options["vehicle_types"]).split(", ") if "vehicle_types" in options else None
    allowed = [each for each in types if each.robot is not None or only is None or each.name in only]
    if is_back:  # which vehicles that do not reverse may not drive
        allowed = [each for each in allowed if each.robot is None or not each.robot.is_vehicle or each.robot.kinematics.reverse]
    if not allowed:
        return None
    properties: dict[str, Any] = {"rotationAllowed": bool(options.get("turns_on_way", False))}
    if math.isfinite(nav.speed_mps[lane]):
        properties["maxSpeed"] = float(nav.speed_mps[lane])
    if is_back:
        properties |= {"vehicleOrientation": math.pi, "orientationType": "TANGENTIAL"}
    for option, key in TURNS:
        if option in options:
            properties[key] = options[option]
    if "load" in options:
        properties["loadRestriction"] = {"unloaded": options["load"] == "unloaded", "loaded": options["load"] == "loaded"}
    if trajectory is not None:
        properties["trajectory"] = trajectory
    ends = {"startNodeId": names[tail], "endNodeId": names[head]}
    return {"edgeId": f"{names[tail]}-{names[head]}", **ends, "vehicleTypeEdgeProperties": [_of_type(each, properties) for each in allowed]}


def _of_type(vehicle: _VehicleType, properties: dict[str, Any]) -> dict[str, Any]:
    """Properties of an edge for a type, which does not turn at its ends if it cannot turn in place."""
    own: dict[str, Any] = {"vehicleTypeId": vehicle.name, **properties}
    if (robot := vehicle.robot) is None:
        return own
    if robot.is_vehicle:
        own |= {"rotationAllowed": False} | {key: "NONE" for _, key in TURNS}
    elif robot.turn_rate_rad_s is not None:
        own["maxRotationSpeed"] = robot.turn_rate_rad_s
    return own


def _stations(nav: NavGraph, vertices: Iterable[int], names: list[str]) -> list[dict[str, Any]]:
    nodes: dict[str, list[str]] = {}
    for v in vertices:
        for station in stations_of(nav.vertex_options[v]):
            nodes.setdefault(station, []).append(names[v])
    return [{"stationId": station, "interactionNodeIds": of} for station, of in nodes.items()]


def _point(xy: Any) -> dict[str, float]:
    return {"x": round(float(xy[0]), 6), "y": round(float(xy[1]), 6)}
