"""The nav graphs of a building, exactly as Open-RMF's generator makes them: same vertices, lanes, order and options."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mrp_sumo.core.graph import Properties
from mrp_sumo.maps.building import Building, Door, Lane, Level

BACKWARD = {"forward": "backward", "backward": "forward"}


def nav_graph_documents(building: Building) -> dict[int, dict[str, Any]]:
    """The nav graph of every graph index with lanes (building.py, generate_nav_graphs).

    Values are as in the building file; coordinates are in the frame of Open-RMF, nothing subtracted.
    """
    door_of_lane = {name: _doors_on_lanes(level) for name, level in building.levels.items()}
    lift_of_vertex = {name: building.lift_of_vertex(level) for name, level in building.levels.items()}
    documents = {}
    for graph in building.graphs:
        document: dict[str, Any] = {"building_name": building.name}
        if building.crs_name:
            document["crs_name"] = building.crs_name
        if building.offset is not None:
            document["offset"] = list(building.offset)
        document["doors"] = {
            door.name: {"endpoints": level.world_xy[[door.start, door.end]].tolist(), "map": level.name}
            for level in building.levels.values()
            for door in level.doors
        }
        document["lifts"] = {
            lift.name: {"position": [lift.x_m, lift.y_m, lift.yaw_rad], "dims": [lift.width_m, lift.depth_m]}
            for lift in building.lifts.values()
        }
        document["levels"] = {
            name: _level_document(level, graph, door_of_lane[name], lift_of_vertex[name]) for name, level in building.levels.items()
        }
        documents[graph] = document
    return documents


def _level_document(level: Level, graph: int, door_of_lane: Mapping[int, Door], lift_of_vertex: Mapping[int, str]) -> dict[str, Any]:
    order = list(dict.fromkeys(v for lane in level.lanes if lane.graph == graph for v in (lane.start, lane.end)))
    number = {v: i for i, v in enumerate(order)}
    vertices = []
    for v in order:
        options = {"name": level.vertex_name[v], **level.vertex_options[v]}
        if v in lift_of_vertex:
            options["lift"] = lift_of_vertex[v]
        vertices.append([*level.world_xy[v].tolist(), options])
    lanes: list[list[Any]] = []
    for i, lane in enumerate(level.lanes):
        if lane.graph == graph:
            lanes += _directed(lane, number, level.vertex_options, door_of_lane.get(i))
    return {"vertices": vertices, "lanes": lanes}


def _directed(lane: Lane, number: Mapping[int, int], vertex_options: Sequence[Properties], door: Door | None) -> list[list[Any]]:
    """The one or two lanes that a drawn lane becomes (level.py, generate_nav_graph)."""
    forth: dict[str, Any] = {"door_name": door.name} if door else {}
    forth |= lane.options
    back = dict(forth)
    if "orientation_constraint" in back:
        back["orientation_constraint"] = BACKWARD[back["orientation_constraint"]]
    begin, end = (vertex_options[v].get("dock_name") for v in (lane.start, lane.end))
    for options, ahead, behind in ((forth, end, begin), (back, begin, end)):
        if ahead:
            options["dock_name"] = ahead
        if behind:
            options["undock_name"] = behind
    a, b = number[lane.start], number[lane.end]
    if lane.is_bidirectional:
        return [[a, b, forth], [b, a, back]]
    return [[a, b, forth | {"is_bidirectional": False}]]


def _doors_on_lanes(level: Level) -> dict[int, Door]:
    """The door of each lane that goes through one; of several, the last in the file (level.py, segments_intersect).

    In units of the file, where the generator's threshold makes it deaf for doors drawn in degrees.
    """
    if not level.doors or not level.lanes:
        return {}
    ends = np.array([(lane.start, lane.end) for lane in level.lanes])
    a, b = level.raw_xy[ends[:, 0]], level.raw_xy[ends[:, 1]]  # [L, 2]
    door_of: dict[int, Door] = {}
    for door in level.doors:
        c, d = level.raw_xy[door.start], level.raw_xy[door.end]
        ab, cd, ac = a - b, c - d, a - c
        det = ab[:, 0] * cd[1] - ab[:, 1] * cd[0]
        crosses = np.abs(det) >= 0.01
        safe = np.where(crosses, det, 1.0)
        t = (ac[:, 0] * cd[1] - ac[:, 1] * cd[0]) / safe
        u = -(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0]) / safe
        crosses &= (t >= 0) & (t <= 1) & (u >= 0) & (u <= 1)
        door_of |= dict.fromkeys(np.flatnonzero(crosses).tolist(), door)
    return door_of
