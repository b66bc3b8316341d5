"""The kinematic engine: bodies on their ways, moved by the robots' limits alone.

It takes the same Euler steps as SUMO, so that both drive a run alike; it knows neither lanes' widths nor followers, which the
controller keeps apart in both. Nothing is looked up in a network, so none is needed.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import BoolArray, FloatArray, PlanGraph
from mrp_sumo.core.visits import Visits
from mrp_sumo.engines.protocol import WHOLE_WAY, has_limits
from mrp_sumo.engines.sumo.network import SHORTEST_M
from mrp_sumo.search._bodies import lane_limits, move_bodies


class Moving(NamedTuple):
    """R bodies as kernels see them, on L lanes."""

    s_m: FloatArray  # [R] driven
    speed_mps: FloatArray  # [R]
    wanted_mps: FloatArray  # [R] commanded
    cap_mps: FloatArray  # [R] what lanes allow
    accel_mps2: FloatArray  # [R]
    has_limits: bool


class KinematicEngine:
    """See `engines.protocol.Engine`."""

    def __init__(self, graph: PlanGraph, fleet: Fleet, step_length_s: float) -> None:
        num_robots = fleet.num_robots
        self.driven_m = np.zeros(num_robots)
        self.routed = np.full(num_robots, WHOLE_WAY)  # it asks the ledger's visits, and never runs out of them
        self._graph, self._fleet, self._dt = graph, fleet, step_length_s
        self._has_limits, self._cap_mps = has_limits(graph, fleet), np.full(num_robots, np.inf)
        self._wanted_mps, self._speed_mps = np.zeros(num_robots), np.zeros(num_robots)

    def place(self, visits: Visits) -> None:
        """See Engine."""
        self._visits = visits

    def command(self, robots: Sequence[int], speed_mps: FloatArray) -> None:
        """See Engine."""
        self._wanted_mps[robots] = speed_mps[robots]

    def lengthen(self, robots: Sequence[int], visits: Visits) -> None:
        """See Engine."""

    def divert(self, robots: Sequence[int], visits: Visits) -> None:
        """See Engine."""
        self._visits = visits

    def turn_back(self, robot: int, visits: Visits) -> None:
        """See Engine."""
        self._visits = visits

    def load(self, fleet: Fleet) -> None:
        """See Engine."""
        self._fleet = fleet

    def step(self, moving: BoolArray) -> list[str]:
        """See Engine."""
        fleet, speed, driven = self._fleet, self._speed_mps, self.driven_m
        if self._has_limits:
            lane_limits(self._dt, fleet.decel_mps2, self._visits, speed, driven, self._cap_mps)
        move_bodies(self._dt, self._wanted_mps, fleet.accel_mps2, fleet.decel_mps2, self._cap_mps, speed, driven)
        return []

    @property
    def bodies(self) -> Moving:
        """For whoever takes steps in the engine's place."""
        return Moving(self.driven_m, self._speed_mps, self._wanted_mps, self._cap_mps, self._fleet.accel_mps2, self._has_limits)

    def positions(self) -> FloatArray:
        """See Engine."""
        visits, graph = self._visits, self._graph
        ahead = visits.next[visits.reached]
        to = np.where(ahead >= 0, ahead, visits.reached)
        lane = visits.lane[to]
        away = graph.xy[graph.tail[lane]] - graph.xy[graph.head[lane]]
        share = np.where(lane >= 0, (visits.at_m[to] - self.driven_m) / np.maximum(graph.length_m[lane], SHORTEST_M), 0.0)
        xy: FloatArray = graph.xy[visits.vertex[to]] + share[:, None] * away
        return xy
