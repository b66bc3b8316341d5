"""Large neighbourhood search: some robots lose their ways and look for others in another order; the better ones are kept.

Searches take ways that are a little longer than the shortest, which they find much sooner.

Sources: Li, Chen, Harabor, Stuckey, Koenig, "Anytime multi-agent path finding via large neighborhood search", IJCAI 2021; the choice
among neighbourhoods by their success after Ropke, Pisinger, "An adaptive large neighborhood search heuristic", 2006.
"""

from functools import partial
from time import process_time

import numpy as np

from planners.safe_interval.timetable import Timetable

MOST = 1_000  # entries a search looks at
WEIGHT = 1.5  # of a search, see `_search.find`
LIKELY = 0.6  # that a robot in the way of a late one is planned again with it
ANY = 0.5  # that these are any, not those that are in its way first
FIRST = 0.7  # that the late one looks for its way first
A_TRY = 50  # what a neighbourhood costs beside the entries
REACTION = 0.05  # how fast the choice follows success
KINDS = 3


class Improvement:
    """A timetable whose ways get shorter."""

    def __init__(self, timetable: Timetable, size: int, rng: np.random.Generator) -> None:
        self.timetable, self.tries = timetable, 0
        self._size, self._rng = min(size, timetable.num_robots), rng
        self._weight = np.ones(KINDS)

    def until(self, deadline_s: float, most_work: int) -> None:
        """Go on until the deadline (process_time), until so much work has been done since the beginning, or nothing is left to gain."""
        timetable = self.timetable
        begin = timetable.work
        while timetable.delay.sum() > 0 and process_time() < deadline_s:
            if timetable.work - begin + A_TRY * self.tries > most_work:
                break
            self.tries += 1
            kind = int(self._rng.choice(KINDS, p=self._weight / self._weight.sum()))
            gain = self._replan((self._by_delay, self._by_place, partial(self._filled, []))[kind](), deadline_s)
            self._weight[kind] = max(0.05, (1 - REACTION) * self._weight[kind] + REACTION * 10 * (gain > 0))

    def _replan(self, robots: list[int], deadline_s: float) -> int:
        """Other ways for these robots, found in this order, if they are no worse. Returns the steps that are gained."""
        timetable = self.timetable
        alone = timetable.alone
        before = [(robot, path) for robot in robots if (path := timetable.remove(robot)) is not None]
        room = sum(path.steps - int(alone[robot]) for robot, path in before)
        gained = room
        placed: list[int] = []
        for robot in robots:
            path = timetable.search(robot, MOST, int(alone[robot]) + gained, WEIGHT)
            if path is None or process_time() > deadline_s:
                for other in placed:
                    timetable.remove(other)
                for other, old in before:
                    timetable.add(other, old)
                return 0
            gained -= path.steps - int(alone[robot])
            timetable.add(robot, path)
            placed.append(robot)
        return gained

    def _by_delay(self) -> list[int]:
        """A robot that is late, and some of those in its way where it loses time."""
        timetable, rng = self.timetable, self._rng
        delay = timetable.delay
        robot = int(rng.choice(len(delay), p=delay / delay.sum()))
        lost = np.maximum(np.diff(timetable.delay_at_stops(robot), prepend=0), 0)
        stop = int(rng.choice(len(lost), p=lost / lost.sum()))
        blockers = timetable.hinders(robot, timetable.ideal_from(robot, stop))
        if rng.random() < ANY:
            blockers = rng.permutation(blockers)
        chosen = blockers[rng.random(len(blockers)) < LIKELY][: self._size - 1].tolist()
        others = rng.permutation(chosen).astype(int).tolist()
        return self._filled([robot, *others] if rng.random() < FIRST else rng.permutation([robot, *others]).tolist())

    def _by_place(self) -> list[int]:
        """Robots that need one place one after the other."""
        timetable, rng = self.timetable, self._rng
        chosen: list[int] = []
        robot = int(rng.integers(timetable.num_robots))
        path = timetable.path[robot]
        assert path is not None
        for q in rng.permutation(path.resource)[:4].tolist():
            passing = timetable.passing(q)
            at = int(np.flatnonzero(passing == robot)[0])
            begin = max(0, at - self._size // 2)
            chosen += [r for r in passing[begin : begin + self._size].tolist() if r not in chosen]
        return self._filled(rng.permutation(chosen[: self._size]).tolist())

    def _filled(self, robots: list[int]) -> list[int]:
        """With others, by chance, as many as a neighbourhood has."""
        others = self._rng.permutation(self.timetable.num_robots).tolist()
        return (robots + [r for r in others if r not in robots])[: self._size] if len(robots) < 2 else robots[: self._size]
