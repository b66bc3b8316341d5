"""Lifts and doors: their names, and their states in a run."""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.graph import NO_PROPERTIES, FloatArray, IntArray, NavGraph

LIFT_STATES = ("closed", "coming", "open", "taken", "held")
"""Of lifts: one that is coming closes its doors, travels, and opens them again; a robot takes one, people hold its doors open."""
LIFT_MODES = ("agv", "human", "fire", "offline")  # for whom a lift runs; offline: out of service
LIFT_DOORS = ("closed", "moving", "open")  # of cabins
MOTIONS = ("stopped", "up", "down")
DOOR_STATES = ("closed", "opening", "open", "closing")
PEOPLE = -2  # in the place of a robot
CABIN_M = 0.05  # outside a cabin that is taken for inside, as Open-RMF does


@dataclass(frozen=True, eq=False)
class FacilityLog:
    """N changes of F lifts and M changes of D doors, by time. What was before the first is the first."""

    lift_name: tuple[str, ...]  # [F]
    lift_t_s: FloatArray  # [N]
    lift: IntArray  # [N]
    lift_state: IntArray  # [N] in LIFT_STATES
    lift_level: IntArray  # [N] of the cabin, in the order of the graph's names
    lift_target: IntArray  # [N] to which it comes, or its level
    lift_robot: IntArray  # [N] for which it comes or that is in it, -1: none, or PEOPLE
    lift_doors: IntArray  # [N] in LIFT_DOORS
    lift_motion: IntArray  # [N] in MOTIONS
    lift_mode: IntArray  # [N] in LIFT_MODES
    door_name: tuple[str, ...]  # [D]
    door_t_s: FloatArray  # [M]
    door: IntArray  # [M]
    door_state: IntArray  # [M] in DOOR_STATES
    door_robot: IntArray  # [M] for whom it is open, -1: nobody, or PEOPLE


def lift_names(graph: NavGraph) -> list[str]:
    """Of the lifts that robots can ride."""
    return sorted({str(graph.lane_options[k]["lift"]) for k in np.flatnonzero(graph.is_ride).tolist()})


def door_names(graph: NavGraph) -> list[str]:
    """Of the doors that open for robots."""
    if graph.lane_options.count(NO_PROPERTIES) == graph.num_lanes:  # the common case, quickly
        return []
    return sorted({str(options["door"]) for options in graph.lane_options if options.get("door")})


def beyond_cabin_m(cabins: FloatArray, x_m: float, y_m: float, yaw_rad: float, length_m: float, width_m: float) -> FloatArray:
    """[C] how far a body stands out of each cabin, m, negative where it is wholly inside.

    Cabins are [C, 6]: level, x and y of the centre in m, yaw in rad, width and depth in m.
    """
    turned_rad = yaw_rad - cabins[:, 3]
    c, s = np.abs(np.cos(turned_rad)), np.abs(np.sin(turned_rad))
    dx, dy, along, across = x_m - cabins[:, 1], y_m - cabins[:, 2], np.cos(cabins[:, 3]), np.sin(cabins[:, 3])
    beyond: FloatArray = np.maximum(
        np.abs(along * dx + across * dy) + (c * length_m + s * width_m) / 2 - cabins[:, 4] / 2,
        np.abs(along * dy - across * dx) + (s * length_m + c * width_m) / 2 - cabins[:, 5] / 2,
    )
    return beyond
