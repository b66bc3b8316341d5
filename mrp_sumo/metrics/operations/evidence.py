"""Evidence of the operations audit, the logs of a run and what its scenario asks for, and its findings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from itertools import takewhile
from typing import Any, NamedTuple

import numpy as np

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import FloatArray, IntArray, PlanGraph
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.robot_states import BROKEN, EMPTY
from mrp_sumo.core.stream import TaskSource
from mrp_sumo.core.task import NOBODY, StopLog, Task, TaskLog
from mrp_sumo.metrics.metric import TOGETHER

EPS_S = 1e-6  # of times that are one in the logs
LOST = (BROKEN, EMPTY)  # states of robots that others have to stand in for
STANDS_MPS = 1e-3  # slower is standing


@dataclass(frozen=True, eq=False)
class Terms:
    """Terms of a run's scenario, beside what stands in the logs."""

    sources: tuple[TaskSource, ...]  # of orders
    fleet: Fleet  # whose types are known
    seed: int
    swap_s: float | None = None  # of batteries, instead of charging
    charges: frozenset[str] = frozenset()  # stations where robots charge while they are served
    start_level: tuple[float, float] = (0.0, 1.0)  # of batteries
    waits_s: float = 0.0  # for which nothing is decided, since planners take their time
    doors_xy: FloatArray = field(default_factory=lambda: np.zeros((0, 2, 2)))  # [D, 2, 2] m, of the building


class Finding(NamedTuple):
    """A place in the logs that cannot be."""

    rule: str
    t_s: float
    text: str
    robot: str | None = None
    place: str | None = None
    order: str | None = None


@dataclass(frozen=True, eq=False)
class Logs:
    """All that is judged."""

    execution: Execution
    fleet: Fleet
    graph: PlanGraph
    terms: Terms
    plan: Plan | None = None  # the first one
    metrics: Mapping[str, Any] = field(default_factory=dict)  # as recorded

    @property
    def tasks(self) -> TaskLog:
        assert self.execution.tasks is not None
        return self.execution.tasks

    @property
    def stops(self) -> StopLog:
        assert self.execution.stops is not None
        return self.execution.stops

    @property
    def end_s(self) -> float:
        return self.execution.sim_time_s

    @property
    def period_s(self) -> float:
        """Between samples."""
        return self.execution.period_s

    @cached_property
    def ordered(self) -> Mapping[int, Task]:
        """By their numbers in the log, the orders as the scenario asks for them; those of which it knows nothing are left out."""
        number = {name: k for k, name in enumerate(self.tasks.name)}
        return {number[task.name]: task for known in self.known for task in known if task.name in number}

    @cached_property
    def known(self) -> Sequence[Sequence[Task]]:
        """The tasks of each source that have to be known by the end of the run; of closed loops those that are."""
        names = set(self.tasks.name)

        def goes_on(source: TaskSource, task: Task) -> bool:
            return task.name in names if source.num_open else task.release_s <= self.end_s - EPS_S

        return [list(takewhile(partial(goes_on, source), source.tasks())) for source in self.terms.sources]

    @cached_property
    def capacity(self) -> Sequence[int]:
        """[R] orders that robots can have on board at once."""
        return (1,) * self.fleet.num_robots if self.terms.fleet.capacity is None else self.terms.fleet.capacity.tolist()

    def robot(self, number: int) -> str | None:
        """A robot's name; None for nobody."""
        return None if number == NOBODY else self.fleet.robot_name[number]

    def is_for(self, robot: int, order: Task) -> bool:
        """True if an order needs no robot, or no type of robot, other than that."""
        if order.load_kg > self.terms.fleet.max_load_kg[robot]:
            return False
        return order.robot in (NOBODY, robot) and (not order.robot_type or self.terms.fleet.type_name[robot] == order.robot_type)

    def was_in(self, states: Sequence[int], robot: int, begin_s: float, end_s: float) -> bool | None:
        """True for a robot that was in one of some states within a time; None where states are not known."""
        log = self.execution.robot_states
        if log is None:
            return None
        mine = (log.robot == robot) & np.isin(log.state, states)
        return bool((mine & (log.begin_s <= end_s + EPS_S) & (log.end_s >= begin_s - EPS_S)).any())

    def times_in(self, states: Sequence[int], robot: int) -> list[tuple[float, float]]:
        """From when until when a robot was in one of some states, ascending; none where states are not known."""
        log = self.execution.robot_states
        if log is None:
            return []
        rows = np.flatnonzero((log.robot == robot) & np.isin(log.state, states)).tolist()
        return sorted((float(log.begin_s[k]), float(log.end_s[k])) for k in rows)

    def place(self, stop: int) -> str:
        """The name of a stop's station, or of its vertex."""
        return self.stops.station[stop] or self.graph.known_as(int(self.stops.vertex[stop]))

    def of_stop(self, rule: str, stop: int, text: str, t_s: float | None = None) -> Finding:
        """A finding at a row of the stops; by default when its service begins."""
        at_s = float(self.stops.begin_s[stop]) if t_s is None else t_s
        who, order = self.robot(int(self.stops.robot[stop])), self.tasks.name[int(self.stops.task[stop])]
        return Finding(rule, at_s, f"{who}, order '{order}' at {self.place(stop)}: {text}", who, self.place(stop), order)

    def of_order(self, rule: str, task: int, text: str, t_s: float | None = None) -> Finding:
        """A finding about an order; by default when it became known."""
        who, name = self.robot(int(self.tasks.robot[task])), self.tasks.name[task]
        at_s = float(self.tasks.released_s[task]) if t_s is None else t_s
        return Finding(rule, at_s, f"order '{name}': {text}", who, None, name)

    def xy_at(self, robot: IntArray, t_s: FloatArray) -> FloatArray:
        """[N, 2] where robots [N] were at times [N], straight between samples; NaN outside the run."""
        t, x, y = self.execution.t_s, self.execution.x_m, self.execution.y_m
        if not len(t):
            return np.full((len(t_s), 2), np.nan)
        at = np.where(np.isfinite(t_s), t_s, -1.0) / self.period_s
        k = np.clip(np.floor(at + 1e-9).astype(np.int64), 0, len(t) - 1)
        share = np.clip(at - k, 0.0, 1.0)
        after = np.minimum(k + (share > 1e-9), len(t) - 1)  # at a sample the next one, at which the robot may be gone, is no matter
        values = np.stack([column[k, robot] + share * (column[after, robot] - column[k, robot]) for column in (x, y)], 1)
        values[~((t_s >= -EPS_S) & (t_s <= t[-1] + self.period_s))] = np.nan
        return values

    def samples_between(self, begin_s: float, end_s: float) -> slice:
        """Those within a time, both ends left out where they are samples."""
        first = int(np.floor(begin_s / self.period_s + 1e-6)) + 1
        return slice(max(first, 0), max(first, int(np.ceil(min(end_s, self.end_s) / self.period_s - 1e-6))))

    def strays_m(self, robot: int, begin_s: float, end_s: float, xy: FloatArray) -> tuple[float, float]:
        """Distance of a robot from a point, at most, at the samples within a time, and when; 0 where there is none."""
        some = self.samples_between(begin_s, end_s)
        x, y = self.execution.x_m[some, robot], self.execution.y_m[some, robot]
        if not len(x):
            return 0.0, begin_s
        away = np.nan_to_num(np.hypot(x - xy[0], y - xy[1]), nan=np.inf)
        worst = int(away.argmax())
        return float(away[worst]), float(self.execution.t_s[some][worst])

    @cached_property
    def standing(self) -> list[FloatArray]:
        """[R] of [N, 2] times from and until which each robot stands, ascending."""
        t, speed, ends = self.execution.t_s, self.execution.speed_mps, list[tuple[FloatArray, FloatArray]]()
        if not len(t):
            return [np.zeros((0, 2))] * self.fleet.num_robots
        before = np.zeros(speed.shape[1], np.bool_)
        begins, overs = ([list[FloatArray]() for _ in range(speed.shape[1])] for _ in range(2))
        for first in range(0, len(t), TOGETHER):
            still = np.abs(speed[first : first + TOGETHER]) < STANDS_MPS
            change = np.diff(np.concatenate([before[None], still]).astype(np.int8), axis=0)
            for r in np.flatnonzero(change.any(0)).tolist():
                begins[r].append(t[first + np.flatnonzero(change[:, r] > 0)])
                overs[r].append(t[first + np.flatnonzero(change[:, r] < 0)])
            before = still[-1]
        for r, stands in enumerate(before.tolist()):
            overs[r] += [t[-1:]] if stands else []
            ends.append((np.concatenate([np.zeros(0), *begins[r]]), np.concatenate([np.zeros(0), *overs[r]])))
        return [np.stack(each, 1) for each in ends]


def end_of(logs: Logs, task: int) -> float:
    """Time at which an order has ended, s; at the latest that of the end of the run."""
    return float(np.fmin(logs.tasks.ended_s[task], logs.end_s))
