"""Finds deadlocks in who waits for whom."""

from dataclasses import dataclass, field

import numpy as np

from mrp_sumo.core.graph import IntArray
from mrp_sumo.drive import _observe
from mrp_sumo.drive._causes import ARRIVED_M
from mrp_sumo.drive.state import State
from mrp_sumo.search._bodies import TIE_M

LOOK_EVERY_S = 0.5  # simulated; so a deadlock is in the log within a second of its making


@dataclass
class DeadlockWatch:
    """Knows the deadlocks there are, so that each is reported once."""

    known: set[tuple[int, ...]] = field(default_factory=set)

    def look(self, state: State) -> list[tuple[int, ...]]:
        """Wait-for cycles that were not there at the last look: robots, each waiting for the next, the lowest first."""
        stands = state.motion.s_m >= state.grants.allowed_m - ARRIVED_M - TIE_M  # others go on when they have heard that they may
        other, since_s = state.grants.other, np.where(stands, state.waits.since_s, np.inf)
        if not (since_s < np.inf).any():
            self.known.clear()
            return []
        label = _observe.waiting_cycles(other, since_s)
        cycles = {_cycle(label, other, number) for number in range(1, int(label.max()) + 1)}
        new = sorted(cycles - self.known)
        self.known = cycles
        return new

    def forget(self, robots: set[int]) -> None:
        """Cycles with these robots are over: they go other ways."""
        self.known = {ring for ring in self.known if not set(ring) & robots}


def _cycle(label: IntArray, other: IntArray, number: int) -> tuple[int, ...]:
    start = at = int(np.flatnonzero(label == number)[0])
    robots = [start]
    while (at := int(other[at])) != start:
        robots.append(at)
    return tuple(robots)
