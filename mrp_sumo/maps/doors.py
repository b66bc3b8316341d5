"""Doors that open for robots: how long they take, and where on a plan graph robots need one open.

A robot needs a door open wherever its body would reach it: on every lane nearer to the door than its radius. Doors are shut at
first; `drive._facilities` opens them.
"""

from dataclasses import replace

import numpy as np

from mrp_sumo.core.graph import PlanGraph, Properties
from mrp_sumo.core.motion import rest_to_rest_s
from mrp_sumo.maps.building import Building
from mrp_sumo.maps.clearance import point_distances, segment_distances

SLIDING_MPS, SLIDING_MPS2 = 0.2, 0.2  # of a leaf, in Open-RMF's simulations (traffic_editor, door.py)
HINGED_RAD_S, HINGED_RAD_S2 = 0.5, 0.3
TURN_RAD = np.pi / 2  # of a hinged leaf


def opening_s(kind: str, width_m: float) -> float:
    """Time that a door takes to open, or to close: hinged, double_hinged, sliding, double_sliding; one of no known kind slides."""
    if kind.endswith("hinged"):
        return rest_to_rest_s(TURN_RAD, HINGED_RAD_S, HINGED_RAD_S2)
    return rest_to_rest_s(width_m / 2 if kind.startswith("double") else width_m, SLIDING_MPS, SLIDING_MPS2)


def with_doors(graph: PlanGraph, building: Building | None, radius_m: float) -> PlanGraph:
    """The plan graph with its doors: the option `door` on vertices and lanes that a robot of this radius touches them from.

    Lanes also say how long the door takes (`door_s`), and whether only people open it (`door_manual`). Of two doors, the nearer one counts.
    """
    if building is None:
        return graph
    vertex_options: list[Properties] = list(graph.vertex_options)
    lane_options: list[Properties] = list(graph.lane_options)
    lane_m, vertex_m = np.full(graph.num_lanes, np.inf), np.full(graph.num_vertices, np.inf)  # from the door that each has so far
    names: set[str] = set()
    tail, head = graph.xy[graph.tail], graph.xy[graph.head]
    for k, level_name in enumerate(graph.level_names):
        if (level := building.levels.get(level_name)) is None:
            continue
        vertices = np.flatnonzero(graph.level == k)
        lanes = np.flatnonzero((graph.level[graph.tail] == k) & (graph.level[graph.head] == k) & ~graph.is_ride)
        for door in level.doors:
            a, b = level.xy[[door.start, door.end]]
            ends = [np.tile(end, (len(lanes), 1)) for end in (a, b)]
            away_m = segment_distances(tail[lanes], head[lanes], *ends)
            if not (away_m == 0).any():  # no lane leads through it
                continue
            name = door.name if door.name and door.name not in names else f"{door.name or 'door'} {level_name} {door.start}-{door.end}"
            names.add(name)
            seconds = opening_s(door.kind, float(np.hypot(*(b - a))))
            of_lane: Properties = {"door": name, "door_s": seconds} | ({"door_manual": True} if door.is_manual else {})
            nearer = away_m < np.minimum(radius_m, lane_m[lanes])
            lane_m[lanes[nearer]] = away_m[nearer]
            for lane in lanes[nearer].tolist():
                lane_options[lane] = {**lane_options[lane], **of_lane}
            away_m = point_distances(graph.xy[vertices], *(np.tile(end, (len(vertices), 1)) for end in (a, b)))
            nearer = away_m < np.minimum(radius_m, vertex_m[vertices])
            vertex_m[vertices[nearer]] = away_m[nearer]
            for vertex in vertices[nearer].tolist():
                vertex_options[vertex] = {**vertex_options[vertex], "door": name}
    if not names:
        return graph
    return replace(graph, vertex_options=tuple(vertex_options), lane_options=tuple(lane_options))
