"""People who ride lifts and go through doors: seeded requests beside those of robots.

They come at random (Poisson), each lift and each door with its own stream of chance, and keep doors open for an exponential time. Robots
wait until they are done; who asks first is served first.
"""

from collections import deque
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from mrp_sumo.core.disturbances import Disturbances
from mrp_sumo.drive._facilities import IN_SERVICE, ask_for_ride
from mrp_sumo.drive.state import Facilities

RIDES, PASSAGES = 37, 38  # purposes of the streams of chance, beside those of the world
HOUR_S = 3600.0


@dataclass(frozen=True)
class RideRequest:
    """A ride that people want."""

    since_s: float
    begin: int  # level
    end: int
    hold_s: float


class Visitors:
    """People of one execution. Lifts out of service are not asked for, nor are locked doors."""

    def __init__(self, what: Disturbances, facilities: Facilities, seed: int) -> None:
        self._what, self._facilities = what, facilities
        ride_s = facilities.ride_s
        levels = [np.flatnonzero(np.isfinite(reach).any(1)).tolist() for reach in ride_s]
        self._rides = [[(a, b) for a, b in permutations(each, 2) if np.isfinite(reach[a, b])] for each, reach in zip(levels, ride_s)]
        self._queue: list[deque[RideRequest]] = [deque() for _ in self._rides]
        self._of_lift = [np.random.default_rng([seed, RIDES, f]) for f in range(len(self._rides))]
        self._of_door = [np.random.default_rng([seed, PASSAGES, d]) for d in range(len(facilities.doors.move_s))]
        self._next_ride_s = [_gap_s(rng, what.lift_rides_per_h) for rng in self._of_lift]
        self._next_passage_s = [_gap_s(rng, what.door_passages_per_h) for rng in self._of_door]

    def update(self, now: float) -> None:
        """Have those ask who come now."""
        what, facilities, doors = self._what, self._facilities, self._facilities.doors
        for f, rng in enumerate(self._of_lift):
            while self._next_ride_s[f] <= now:
                begin, end = self._rides[f][int(rng.integers(len(self._rides[f])))]
                wish = RideRequest(self._next_ride_s[f], begin, end, float(rng.exponential(what.lift_hold_s)))
                self._next_ride_s[f] += _gap_s(rng, what.lift_rides_per_h)
                if facilities.lifts.service[f] == IN_SERVICE:
                    self._queue[f].append(wish)
            if self._queue[f] and facilities.lifts.ride_since_s[f] == np.inf:
                self._ask(f, self._queue[f].popleft())
        for d, rng in enumerate(self._of_door):
            while self._next_passage_s[d] <= now:
                until_s = self._next_passage_s[d] + float(doors.move_s[d]) + float(rng.exponential(what.door_hold_s))
                doors.held_until_s[d] = max(doors.held_until_s[d], until_s)
                self._next_passage_s[d] += _gap_s(rng, what.door_passages_per_h)

    def _ask(self, lift: int, wish: RideRequest) -> None:
        ask_for_ride(self._facilities.lifts, lift, (wish.begin, wish.end), wish.since_s, wish.hold_s)


def _gap_s(rng: np.random.Generator, rate_per_h: float) -> float:
    """Until the next one comes."""
    return float(rng.exponential(HOUR_S / rate_per_h)) if rate_per_h else np.inf
