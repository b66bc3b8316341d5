"""The face of an engine, which moves bodies, as the drive's loop uses it."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, NavGraph
from mrp_sumo.core.visits import Visits

WHOLE_WAY = 2**62  # rank of a visit above all others


def has_limits(graph: NavGraph, fleet: Fleet) -> bool:
    """True if robots may be slower on some lanes, or at bends, than their types' top speed."""
    return bool(np.isfinite(graph.speed_mps).any() or fleet.vehicle_of_kind)


class Bodies(Protocol):
    """R robots as a controller sees them."""

    driven_m: FloatArray  # [R] how far each robot has driven since its start
    routed: IntArray  # [R] rank of the last visit that the engine knows the way to; WHOLE_WAY where it knows all of it


class Engine(Bodies, Protocol):
    """R robots in a running simulation. Nothing but its steps makes time pass."""

    def place(self, visits: Visits) -> None:
        """Put robots on their first vertices."""

    def command(self, robots: Sequence[int], speed_mps: FloatArray) -> None:
        """Have some robots drive at these speeds [R] from the next step on."""

    def lengthen(self, robots: Sequence[int], visits: Visits) -> None:
        """Tell the engine more of the way of robots that may soon be at the end of what it knows."""

    def divert(self, robots: Sequence[int], visits: Visits) -> None:
        """Robots go on another way from the last visit that they have been granted."""

    def turn_back(self, robot: int, visits: Visits) -> None:
        """A robot that stands on a lane turns round and drives on the opposite one to the next visit of its way."""

    def load(self, fleet: Fleet) -> None:
        """Robots have these limits from the next step on; those that change stand."""

    def step(self, moving: BoolArray) -> list[str]:
        """Let one step pass; robots that are not moving [R] stand still in it. Returns what the engine itself finds wrong."""

    def positions(self) -> FloatArray:
        """[R, 2] where the engine has the robots, m."""
