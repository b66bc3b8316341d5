"""Streams of tasks: what arrives when, drawn from a seed of the stream's own, so that any fleet meets the same tasks.

A stream is an endless or a finite series of `Task`s; the n-th depends on the seed and on n alone, not on when or by whom those before were
done. Draws are in a fixed order (arrival, route, service times), each kind from its own generator, so that another rate changes no route.
"""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from math import inf
from operator import attrgetter
from typing import Protocol

import numpy as np

from mrp_sumo.core.arrivals import HOUR_S, Arrivals, ServiceTime
from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.task import NOBODY, Station, Stop, Task

TASKS = 41  # purpose of the streams of chance
ARRIVALS, ROUTES, SERVICE = range(3)


class TaskSource(Protocol):
    """A source of tasks."""

    @property
    def num_open(self) -> int:
        """Number of its tasks that are always known and not done; 0 where tasks have times of their own."""

    def tasks(self) -> Iterator[Task]:
        """The tasks by release."""

    def stations(self) -> Iterator[Station]:
        """Stations at which their stops are made."""


@dataclass(frozen=True)
class TaskList:
    """Tasks that are listed one by one, by release; or in order, if so many are always known and not done."""

    listed: tuple[Task, ...]
    num_open: int = 0  # see TaskSource

    def tasks(self) -> Iterator[Task]:
        """See TaskSource."""
        return iter(self.listed)

    def stations(self) -> Iterator[Station]:
        """See TaskSource."""
        return (stop.station for task in self.listed for stop in task.stops if stop.station)


@dataclass(frozen=True, eq=False)
class TaskStream:
    """Tasks of P routes, each a series of stations, drawn by weight."""

    name: str
    arrivals: Arrivals
    routes: tuple[tuple[Station, ...], ...]  # [P]
    weight: FloatArray  # [P]
    service: tuple[ServiceTime, ...]  # of the stops of a route; the last also of those after it
    actions: tuple[str, ...] = ()  # of the stops, likewise
    count: int = 0  # 0: without end
    due_after_s: float = inf
    priority: int = 0
    robot_type: str = ""  # that the tasks need
    load_kg: float = 0.0  # what each weighs
    robot: int = NOBODY  # that does them all
    seed: int = 0
    number: int = 0  # of the stream in its scenario
    step_s: float = 1.0  # of the plan

    @property
    def num_open(self) -> int:
        """See TaskSource."""
        return self.arrivals.open or 0

    def stations(self) -> Iterator[Station]:
        """See TaskSource."""
        return chain.from_iterable(self.routes)

    def tasks(self) -> Iterator[Task]:
        """The tasks by release. Their ids count from 0 within the stream."""
        rngs = [np.random.default_rng([self.seed, TASKS, self.number, purpose]) for purpose in (ARRIVALS, ROUTES, SERVICE)]
        share = np.cumsum(self.weight) / np.sum(self.weight)
        for n, release_s in enumerate(self.arrivals.times(rngs[ARRIVALS], self.step_s)):
            if self.count and n >= self.count:
                return
            route = self.routes[min(int(np.searchsorted(share, rngs[ROUTES].random(), side="right")), len(share) - 1)]
            stops = tuple(self._stop(k, station, rngs[SERVICE]) for k, station in enumerate(route))
            due_s, name = release_s + self.due_after_s, f"{self.name}_{n}"
            yield Task(n, stops, release_s, due_s, self.priority, self.robot, name, robot_type=self.robot_type, load_kg=self.load_kg)

    def _stop(self, k: int, station: Station, rng: np.random.Generator) -> Stop:
        service_s = self.service[min(k, len(self.service) - 1)].draw(rng) if self.service else 0.0
        action = self.actions[min(k, len(self.actions) - 1)] if self.actions else ""
        return Stop(station.places[0], station.service_factor * service_s, action, station)


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """The tasks of several sources in the order of their arrival, of which so many are always known and not done."""

    sources: tuple[TaskSource, ...]
    num_open: int

    def tasks(self) -> Iterator[Task]:
        """See TaskSource. Sources without times of their own take turns, in proportion to how many of their tasks are open."""
        return heapq.merge(*(self._spread(source) for source in self.sources), key=attrgetter("release_s"))

    def stations(self) -> Iterator[Station]:
        """See TaskSource."""
        return chain.from_iterable(source.stations() for source in self.sources)

    @staticmethod
    def _spread(source: TaskSource) -> Iterator[Task]:
        if not source.num_open:
            return source.tasks()
        spread_s = HOUR_S / source.num_open
        return (replace(t, release_s=k * spread_s, due_s=k * spread_s + t.due_s) for k, t in enumerate(source.tasks()))


def zipf_weights(num: int, exponent: float) -> FloatArray:
    """[num] weights 1 / rank ** exponent."""
    weights: FloatArray = 1.0 / np.arange(1, num + 1, dtype=np.float64) ** exponent
    return weights
