"""Lifts as robots use them: how long rides take, and the rides of a plan graph, in which one robot at a time may be.

A ride is a lane from the stop of a lift on one level to that on another. It takes as long as it takes to close the doors, to travel, and to
open the doors again: the lane is driven at a speed at which it lasts that long, so that planners, schedules and engines need to know
nothing else of it. For planners in steps it is cut into as many lanes as it takes steps. The robot in the cabin has it to
himself (option `cabin`, a group of capacity one).
"""

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from mrp_sumo.core.graph import FloatArray, PlanGraph, Properties, relaid
from mrp_sumo.core.motion import rest_to_rest_s
from mrp_sumo.maps.building import Building, Lift

DOOR_MPS, DOOR_MPS2 = 0.3, 0.2  # of the two leaves of a lift's door, in Open-RMF's simulations (traffic_editor, lift.py)
CABIN_MPS, CABIN_MPS2 = 2.0, 1.2
DOOR_WIDTH_M = 1.0  # where nothing is known
LEAST_TRAVEL_M = 1.0  # between two levels that are drawn at one height
PIECE_M = 0.1  # of a ride, as driven: the shortest that SUMO knows
BESIDE_M = 0.05  # outside a cabin that is taken for inside, as Open-RMF does (level.py, is_in_lift)
APART_M = 0.02  # between the vertices in a shaft, so that no two are at one place

Shift = Mapping[str, tuple[float, float]]


def door_s(width_m: float) -> float:
    """Time that the two leaves of a lift's door take to open or close."""
    return rest_to_rest_s(width_m / 2, DOOR_MPS, DOOR_MPS2)


def travel_s(height_m: float) -> float:
    """Time that a cabin takes from one level to another."""
    return rest_to_rest_s(height_m, CABIN_MPS, CABIN_MPS2)


def ride_of(name: str, lift: Lift | None, levels: tuple[str, str], height_m: float) -> Properties:
    """The options of the lane for a ride between two levels, which take `ride_s`: doors close, the cabin travels, doors open."""
    close_s, open_s = (door_s(_door_width_m(lift, level)) for level in levels)
    return {"lift": name, "ride_s": close_s + travel_s(max(height_m, LEAST_TRAVEL_M)) + open_s, "close_s": close_s, "open_s": open_s}


def _door_width_m(lift: Lift | None, level: str) -> float:
    """Of the widest door that a lift opens on a level."""
    if lift is None:
        return DOOR_WIDTH_M
    return max((lift.door_width_m[door] for door in lift.level_doors.get(level, ()) if door in lift.door_width_m), default=DOOR_WIDTH_M)


def with_rides(graph: PlanGraph, step_s: float, radius_m: float, building: Building | None, shift_m: Shift) -> PlanGraph:
    """The plan graph with its rides, lanes of one step, cut into steps, and its cabins marked; the graph itself where no lift is.

    Its vertices keep their numbers; those in shafts follow. Vertices and lanes on which one robot at a time may be have the option `cabin`,
    those inside also `in_lift`. Planners plan `step_s` for a lane; `radius_m` is that of the largest robot, which rides this far from the
    walls of a cabin where there is room, and this near to one it is in the way of the doors.
    """
    if not graph.is_ride.any():
        return graph
    graph = _stopping_inside(graph, radius_m, building, shift_m)
    driven = np.flatnonzero(~graph.is_ride)
    xy, level = [*graph.xy], graph.level.tolist()
    pairs = list(zip(graph.tail[driven].tolist(), graph.head[driven].tolist()))
    length_m, speed_mps = graph.length_m[driven].tolist(), graph.speed_mps[driven].tolist()
    lane_options, vertex_options = [graph.lane_options[k] for k in driven.tolist()], list(graph.vertex_options)
    inside, beside = _cabins(graph, radius_m, building, shift_m)
    for lane in np.flatnonzero(graph.is_ride & graph.is_once).tolist():
        ends, ride = (int(graph.tail[lane]), int(graph.head[lane])), _timed(graph, lane)
        name, steps = str(ride["lift"]), max(1, math.ceil(ride["ride_s"] / step_s - 1e-9))
        shaft = [ends[0], *range(len(xy), len(xy) + steps - 1), ends[1]]
        for k in range(1, steps):  # the first half is on the level where the ride begins
            stop, away = (ends[0], k) if 2 * k < steps else (ends[1], steps - k)
            xy.append(graph.xy[stop] + (APART_M * away, 0.0))
            level.append(int(graph.level[stop]))
            vertex_options.append({})
            inside[shaft[k]] = name
        for direction, of in ((shaft, lane), (shaft[::-1], int(graph.reverse[lane]))):
            if of < 0:
                continue
            options = _timed(graph, of)
            pairs += pairwise(direction)
            length_m += [PIECE_M] * steps
            speed_mps += [PIECE_M * steps / options["ride_s"]] * steps
            lane_options += [options] * steps
    for v, name in (beside | inside).items():
        vertex_options[v] = {**vertex_options[v], "cabin": name, **({"in_lift": name} if v in inside else {})}
        if v in inside and building and name in building.lifts and building.lifts[name].initial_level == graph.level_names[level[v]]:
            vertex_options[v] = {**vertex_options[v], "car_at_first": True}
    for k, (a, b) in enumerate(pairs):
        if cabin := inside.get(a) or inside.get(b) or beside.get(a) or beside.get(b):
            lane_options[k] = {**lane_options[k], "cabin": cabin}
    return relaid(
        graph,
        lanes=pairs,
        length_m=length_m,
        speed_mps=speed_mps,
        lane_options=lane_options,
        xy=xy,
        level=level,
        vertex_options=vertex_options,
    )


def cabins_of(building: Building, level_names: Sequence[str], shift_m: Shift) -> FloatArray:
    """[C, 6] every cabin on every level, as the graph has them: level, x and y of its centre in m, yaw in rad, width and depth in m."""
    moved = enumerate(shift_m.get(name, (0.0, 0.0)) for name in level_names)
    rows = [
        (k, lift.x_m - building.origin_m[0] + x, lift.y_m - building.origin_m[1] + y, lift.yaw_rad, lift.width_m, lift.depth_m)
        for k, (x, y) in moved
        for lift in building.lifts.values()
    ]
    return np.array(rows, np.float64).reshape(-1, 6)


def _stopping_inside(graph: PlanGraph, radius_m: float, building: Building | None, shift_m: Shift) -> PlanGraph:
    """The graph with rides from cabin to cabin: a vertex where a robot stands out of the cabin gets one at the cabin's centre beside it.

    Robots drive there from the cell, over a lane as long as it is far.
    """
    if building is None:
        return graph
    rides, inside, xy = np.flatnonzero(graph.is_ride), dict[tuple[int, str], int](), [*graph.xy]
    for k in rides.tolist():
        name = str(graph.lane_options[k]["lift"])
        if (lift := building.lifts.get(name)) is None:
            continue
        for v in {int(graph.tail[k]), int(graph.head[k])}:
            shift = np.array(shift_m.get(graph.level_names[graph.level[v]], (0.0, 0.0))) - building.origin_m
            needed_m = min(radius_m, min(lift.width_m, lift.depth_m) / 2)  # from the walls; no more is there at the centre
            if (v, name) not in inside and lift.room_m(graph.xy[[v]] - shift)[0] < needed_m - BESIDE_M:
                inside[v, name] = len(xy)
                xy.append(shift + np.array([lift.x_m, lift.y_m]))
    if not inside:
        return graph
    pairs = list(zip(graph.tail.tolist(), graph.head.tolist()))
    for k in rides.tolist():
        name = str(graph.lane_options[k]["lift"])
        a, b = pairs[k]
        pairs[k] = inside.get((a, name), a), inside.get((b, name), b)
    ways = [pair for (v, _), w in inside.items() for pair in ((v, w), (w, v))]
    return relaid(
        graph,
        lanes=pairs + ways,
        length_m=[*graph.length_m.tolist(), *(float(np.hypot(*(xy[a] - xy[b]))) for a, b in ways)],
        speed_mps=[*graph.speed_mps.tolist(), *[np.inf] * len(ways)],
        lane_options=[*graph.lane_options, *[{}] * len(ways)],
        xy=xy,
        level=[*graph.level.tolist(), *(int(graph.level[v]) for v, _ in inside)],
        vertex_options=[*graph.vertex_options, *[{}] * len(inside)],
    )


def _timed(graph: PlanGraph, lane: int) -> Properties:
    """The options of a ride, with its times where a map gives none."""
    options = graph.lane_options[lane]
    return options if "ride_s" in options else ride_of(str(options["lift"]), None, ("", ""), float(graph.length_m[lane]))


def _cabins(graph: PlanGraph, radius_m: float, building: Building | None, shift_m: Shift) -> tuple[dict[int, str], dict[int, str]]:
    """The lift of each vertex in a cabin, and of each so near to one that a robot there is in the way of its doors."""
    rides = np.flatnonzero(graph.is_ride).tolist()
    inside = {int(v): str(graph.lane_options[k]["lift"]) for k in rides for v in (graph.tail[k], graph.head[k])}
    beside: dict[int, str] = {}
    if building is None:
        return inside, beside
    for name in sorted(set(inside.values())):
        if (lift := building.lifts.get(name)) is None:
            continue
        for k in {int(graph.level[v]) for v, other in inside.items() if other == name}:
            on = np.flatnonzero(graph.level == k)
            shift = np.array(shift_m.get(graph.level_names[k], (0.0, 0.0)))
            away_m = lift.distance_m(graph.xy[on] - shift + building.origin_m)
            inside = {int(v): name for v in on[away_m <= 0]} | inside
            beside = {int(v): name for v in on[away_m <= radius_m]} | beside
    return inside, beside
