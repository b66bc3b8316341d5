"""Vehicles that cannot turn in place, and small worlds for them."""

from itertools import pairwise

import numpy as np

from mrp_sumo.core.fleet import fleet_of_types
from mrp_sumo.core.graph import nav_graph
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType, Trailer, Wheels
from mrp_sumo.maps.curves import Line, bezier_knots, flattened
from mrp_sumo.maps.roadmap import cut_lanes

LIMITS = {"max_speed_mps": 1.0, "accel_mps2": 0.5, "decel_mps2": 0.5, "gap_m": 0.1}
TRICYCLE = RobotType(
    "tricycle", length_m=1.0, width_m=0.6, kinematics=Wheels(kind="tricycle", wheelbase_m=0.6, steering_max_rad=1.0, reverse=True), **LIMITS
)
CAR = RobotType("car", length_m=1.4, width_m=0.6, kinematics=Wheels(kind="ackermann", wheelbase_m=0.9, steering_max_rad=0.7), **LIMITS)
TUGGER = RobotType(
    "tugger",
    length_m=1.0,
    width_m=0.6,
    kinematics=Wheels(kind="tugger", wheelbase_m=0.7, steering_max_rad=0.6),
    trailers=(Trailer(length_m=0.7, hitch_m=0.4), Trailer(length_m=0.7, hitch_m=0.4)),
    **LIMITS,
)
CART = RobotType("cart", length_m=0.8, width_m=0.6, turn_rate_rad_s=1.0, **LIMITS)


def roads(xy, pairs=(), one_way=(), cell_m=4.0):
    """Two-way lanes between pairs and one-way lanes, each one step."""
    lanes = [lane for a, b in pairs for lane in ((a, b), (b, a))] + list(one_way)
    return cut_lanes(nav_graph(name="roads", xy=xy, lanes=lanes), cell_m)


def corner(length_m=4.0):
    """Vertices 0, 1, 2: east, then north."""
    return roads([(0.0, 0.0), (length_m, 0.0), (length_m, length_m)], [(0, 1), (1, 2)], cell_m=length_m)


def squares(n, cell_m):
    """Vertex y * n + x, with lanes between neighbours."""
    index = np.arange(n * n).reshape(n, n)
    pairs = [*zip(index[:, :-1].flat, index[:, 1:].flat), *zip(index[:-1].flat, index[1:].flat)]
    return roads([(x * cell_m, y * cell_m) for y in range(n) for x in range(n)], pairs, cell_m=cell_m)


def vehicles_on(graph, start, goal, types, **more):
    """Robots, each of a type of its own or all of one."""
    kinds = list(dict.fromkeys(types if isinstance(types, list) else [types]))
    kind = [kinds.index(each) for each in (types if isinstance(types, list) else [types] * len(start))]
    fleet = fleet_of_types(kinds, np.array(kind))
    step_s = 2 * graph.cell_m + 3.0
    return Problem(graph, fleet, np.array(start), np.array(goal), np.arange(len(start)), step_s, drivable=True, **more)


def curve(degree, points, weights=None):
    """The line along one Bezier curve, rational where there are weights."""
    return flattened(degree, bezier_knots(degree), np.array(points, float), None if weights is None else np.array(weights))


def quarter(radius_m, at=(0.0, 0.0)):
    """The line along an exact quarter of a circle, from a place to the east and then to the north."""
    corners = radius_m * np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)]) + at
    return curve(2, corners, [1.0, np.sqrt(0.5), 1.0])


def along(*lines, cell_m=4.0, both_ways=True):
    """Vertices 0, 1, ... at the ends of lines, one after the other, each a lane: two places, or what `curve` makes."""
    xy, options, chains = [tuple(lines[0].xy[0])], [{}], []
    for end, line in enumerate(lines, 1):
        xy.append(tuple(line.xy[-1]))
        options.append({})
        chains.append([end - 1, end])
    for line, chain in zip(lines, chains):
        bends = range(len(xy), len(xy) + len(line.xy) - 2)
        xy += [tuple(place) for place in line.xy[1:-1]]
        options += [{"is_bend": True, **line.courses_at(k)} for k in range(1, len(line.xy) - 1)]
        chain[1:1] = bends
    lanes = [lane for chain in chains for lane in pairwise(chain)]
    lanes += [(b, a) for a, b in lanes] if both_ways else []
    return cut_lanes(nav_graph(name="curves", xy=xy, lanes=lanes, vertex_options=options), cell_m)


def straight(a, b):
    """The line from a place to another."""
    return Line(np.array([a, b], float))
