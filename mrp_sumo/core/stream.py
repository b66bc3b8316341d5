"""Streams of tasks: what arrives when, drawn from a seed of the stream's own, so that any fleet meets the same tasks.

A stream is an endless or a finite series of `Task`s; the n-th depends on the seed and on n alone, not on when or by whom those before were
done. Draws are in a fixed order (arrival, route, service times), each kind from its own generator, so that another rate changes no route.
"""

import heapq
from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import inf
from typing import Annotated, Protocol

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.options import Options, Within, option
from mrp_sumo.core.task import Station, Stop, Task
from mrp_sumo.errors import OptionError

TASKS = 41  # purpose of the streams of chance
ARRIVALS, ROUTES, SERVICE = range(3)
HOUR_S = 3600.0
DAY_S = 24 * HOUR_S
MAX_OPEN = 100_000
Positive = Annotated[float, Within(gt=0)]
NotNegative = Annotated[float, Within(ge=0)]


class TaskSource(Protocol):
    """A source of tasks."""

    @property
    def num_open(self) -> int:
        """Number of its tasks that are always known and not done; 0 where tasks have times of their own."""

    def tasks(self) -> Iterator[Task]:
        """The tasks by release."""


@dataclass(frozen=True)
class TaskList:
    """Tasks that are listed one by one."""

    listed: tuple[Task, ...]  # by release

    @property
    def num_open(self) -> int:
        """None: they have times of their own."""
        return 0

    def tasks(self) -> Iterator[Task]:
        """See TaskSource."""
        return iter(self.listed)


@dataclass(frozen=True)
class TaskPool:
    """Tasks that are listed in order, of which so many are always known and not done."""

    listed: tuple[Task, ...]
    num_open: int

    def tasks(self) -> Iterator[Task]:
        """See TaskSource."""
        return iter(self.listed)


@dataclass(frozen=True, kw_only=True)
class ServiceTime(Options):
    """Duration of a stop; a number is short for constant_s."""

    constant_s: float | None = option(None, "Always as long.", ge=0)
    triangular_s: tuple[NotNegative, NotNegative, NotNegative] | None = option(None, "Least, usual and most.")
    lognormal: tuple[Positive, NotNegative] | None = option(None, "Median in s, and sigma of the logarithm.")

    def __post_init__(self) -> None:
        super().__post_init__()
        keys = [key for key in ("constant_s", "triangular_s", "lognormal") if getattr(self, key) is not None]
        if len(keys) != 1:
            raise OptionError(f"give one of constant_s, triangular_s, lognormal; found {', '.join(keys) or 'none'}")
        if self.triangular_s and not self.triangular_s[0] <= self.triangular_s[1] <= self.triangular_s[2]:
            raise OptionError(f"triangular_s is {list(self.triangular_s)}, expected least, usual and most in ascending order")

    def draw(self, rng: np.random.Generator) -> float:
        """A time in s, from one number of the generator."""
        if self.lognormal:
            return float(rng.lognormal(np.log(self.lognormal[0]), self.lognormal[1]))
        if self.triangular_s is None:
            return self.constant_s or 0.0
        least, usual, most = self.triangular_s
        span, u = most - least, float(rng.random())
        if span <= 0:
            return usual
        if u < (usual - least) / span:
            return least + float(np.sqrt(u * span * (usual - least)))
        return most - float(np.sqrt((1 - u) * span * (most - usual)))


@dataclass(frozen=True, kw_only=True)
class Arrivals(Options):
    """Arrivals of tasks; exactly one kind."""

    rate_per_h: float | None = option(None, "Poisson arrivals.", gt=0, le=1e6)
    profile: tuple[NotNegative, ...] = option((), "Of Poisson arrivals: factors on the rate in equal parts of a day.")
    open: int | None = option(None, "So many are always known and not done: a closed loop.", ge=1, le=MAX_OPEN)
    per_step: float | None = option(None, "Tasks in a planned step; below 1 one with that probability.", gt=0, le=1e3)
    at_once: bool = option(False, "All at 0; needs count.")

    def __post_init__(self) -> None:
        super().__post_init__()
        keys = [key for key in ("rate_per_h", "open", "per_step") if getattr(self, key) is not None] + ["at_once"] * self.at_once
        if len(keys) != 1:
            raise OptionError(f"give one of rate_per_h, open, per_step, at_once; found {', '.join(keys) or 'none'}")
        if self.profile and (self.rate_per_h is None or max(self.profile) <= 0):
            raise OptionError("profile goes with rate_per_h, and needs a factor above 0")
        if self.per_step is not None and self.per_step > 1 and self.per_step != round(self.per_step):
            raise OptionError(f"per_step is {self.per_step:g}, expected a whole number, or one below 1")

    def times(self, rng: np.random.Generator, step_s: float = 1.0, clock_s: float = 0.0) -> Iterator[float]:
        """Ascending times, without end. Those of `open` are 0: such a task is released when one before it is done.

        Parameters
        ----------
        step_s
            Of the plan, for `per_step`.
        clock_s
            How much of the day is over at 0, for `rate_per_h`.
        """
        t_s = 0.0
        if self.rate_per_h is not None:
            profile = self.profile or (1.0,)
            most = self.rate_per_h * max(profile) / HOUR_S
            while True:  # thinning: Lewis and Shedler, "Simulation of nonhomogeneous Poisson processes by thinning", 1979
                t_s += float(rng.exponential(1 / most))
                part = int((t_s + clock_s) % DAY_S / DAY_S * len(profile))
                if float(rng.random()) * max(profile) < profile[part]:
                    yield t_s
        elif self.per_step is not None:
            whole = max(1, round(self.per_step))
            while True:
                if self.per_step >= 1 or float(rng.random()) < self.per_step:
                    yield from [t_s] * whole
                t_s += step_s
        else:
            while True:
                yield 0.0


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
    seed: int = 0
    number: int = 0  # of the stream in its scenario
    step_s: float = 1.0  # of the plan

    @property
    def num_open(self) -> int:
        """See TaskSource."""
        return self.arrivals.open or 0

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
            yield Task(n, stops, release_s, due_s, self.priority, name=name, robot_type=self.robot_type)

    def _stop(self, k: int, station: Station, rng: np.random.Generator) -> Stop:
        service_s = self.service[min(k, len(self.service) - 1)].draw(rng) if self.service else 0.0
        action = self.actions[min(k, len(self.actions) - 1)] if self.actions else ""
        return Stop(station.places[0], service_s, action, station)


@dataclass(frozen=True, eq=False)
class ClosedLoop:
    """The tasks of several sources in the order of their arrival, of which so many are always known and not done."""

    sources: tuple[TaskSource, ...]
    num_open: int

    def tasks(self) -> Iterator[Task]:
        """See TaskSource. Sources without times of their own take turns, in proportion to how many of their tasks are open."""
        return heapq.merge(*(self._spread(source) for source in self.sources), key=_release)

    @staticmethod
    def _spread(source: TaskSource) -> Iterator[Task]:
        if not source.num_open:
            return source.tasks()
        spread_s = HOUR_S / source.num_open
        return (replace(t, release_s=k * spread_s, due_s=k * spread_s + t.due_s) for k, t in enumerate(source.tasks()))


def _release(task: Task) -> float:
    return task.release_s


def zipf_weights(num: int, exponent: float) -> FloatArray:
    """[num] weights 1 / rank ** exponent."""
    weights: FloatArray = 1.0 / np.arange(1, num + 1, dtype=np.float64) ** exponent
    return weights
