"""Dispatchers that look at several tasks and robots at once: `hungarian`, `regret` and `token_passing`.

All have the ways of all robots planned anew by the run's planner when a task comes or a stop is made; they differ in who gets what.
Times are estimates: steps along shortest ways, each the planned time of a step, and service times.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.request import Request
from mrp_sumo.core.task import Stop, Task
from mrp_sumo.drive.reroute import Replan
from mrp_sumo.drive.surroundings import Surroundings
from mrp_sumo.search.distance import UNREACHABLE, distances


@dataclass(frozen=True)
class Hungarian:
    """Robots and the most urgent tasks are matched so that the sum of times to pick-ups is least, busy robots included."""

    reassign: bool = True  # tasks may go to others until their first stops are made

    def finished(self, now_s: float, around: Surroundings) -> bool:
        """See Dispatcher."""
        return around.work.all_done

    def due(self, now_s: float, around: Surroundings) -> Iterable[Request]:
        """See Dispatcher."""
        from scipy.optimize import linear_sum_assignment

        if not around.work.news:
            return
        start, tasks = _starts(around), _candidates(around, self.reassign)
        times_s = _pick_up_times(now_s, around, start, tasks, self.reassign)
        # as many tasks as robots at most, so that all are matched: then least times to pick-ups are least finish times, too
        matched = zip(*(side.tolist() for side in linear_sum_assignment(np.minimum(times_s, FAR_S)))) if len(tasks) else ()
        given = {r: tasks[k] for r, k in matched if times_s[r, k] < FAR_S and _can_take(around, r, self.reassign)}
        yield around.work.request(now_s, start, around.closed, _changes(around, given))

    def answer(self, request: Request, around: Surroundings) -> Replan | None:
        """See Dispatcher."""
        return around.plan(request)


@dataclass(frozen=True)
class Regret:
    """Task by task: the one that would lose most if it did not get its best free robot, but the second best, is given first."""

    def finished(self, now_s: float, around: Surroundings) -> bool:
        """See Dispatcher."""
        return around.work.all_done

    def due(self, now_s: float, around: Surroundings) -> Iterable[Request]:
        """See Dispatcher."""
        work = around.work
        if not work.news:
            return
        start, tasks, given = _starts(around), _candidates(around, False), dict[int, int]()
        free = work.free.tolist()
        tasks = tasks[: len(free)]
        times_s = _pick_up_times(now_s, around, start, tasks, False)
        left = list(range(len(tasks)))
        while left and free:
            ranked = {k: sorted((float(times_s[r, k]), r) for r in free) for k in left}
            second = {k: min(of[1][0], FAR_S) if len(of) > 1 else FAR_S for k, of in ranked.items()}
            k = max(left, key=lambda k: (second[k] - ranked[k][0][0], -k))
            left.remove(k)
            if ranked[k][0][0] < FAR_S:
                given[ranked[k][0][1]] = tasks[k]
                free.remove(ranked[k][0][1])
        yield work.request(now_s, start, around.closed, given)

    def answer(self, request: Request, around: Surroundings) -> Replan | None:
        """See Dispatcher."""
        return around.plan(request)


@dataclass(frozen=True)
class TokenPassing:
    """Free robots in turn take the nearest task of whose stations none is where another robot's task ends or begins.

    The choice of token passing: Ma, Li, Kumar and Koenig, "Lifelong multi-agent path finding for online pickup and delivery tasks",
    AAMAS 2017, algorithm 1; ways are those of the run's planner instead of one search for each robot.
    """

    def finished(self, now_s: float, around: Surroundings) -> bool:
        """See Dispatcher."""
        return around.work.all_done

    def due(self, now_s: float, around: Surroundings) -> Iterable[Request]:
        """See Dispatcher."""
        work = around.work
        if not work.news:
            return
        start, given, steps = _starts(around), dict[int, int](), distances(around.graph)
        waiting = list(work.unassigned)
        ends = [stop for r, k in enumerate(work.current.tolist()) if k >= 0 for stop in work.tasks[k].stops[int(work.stop[r]) :]]
        taken = {v for stop in ends if len(stop.places) == 1 for v in stop.places}
        for r in work.free.tolist():
            allowed = [k for k in waiting if not taken & {v for stop in work.tasks[k].stops if len(stop.places) == 1 for v in stop.places}]
            away = {k: min(int(steps.to(v)[start[r]]) for v in work.tasks[k].stops[0].places) for k in allowed}
            best = min(allowed, key=lambda k: (-work.tasks[k].priority, away[k], k), default=None)
            if best is not None and away[best] < UNREACHABLE:
                given[r] = best
                waiting.remove(best)
                taken |= {v for stop in work.tasks[best].stops if len(stop.places) == 1 for v in stop.places}
        yield work.request(now_s, start, around.closed, given)

    def answer(self, request: Request, around: Surroundings) -> Replan | None:
        """See Dispatcher."""
        return around.plan(request)


FAR_S = 1e9  # of what cannot be reached


def _starts(around: Surroundings) -> IntArray:
    """[R] vertices that robots are committed to reach."""
    visits = around.ledger.visits
    start: IntArray = visits.vertex[visits.granted]
    return start


def _candidates(around: Surroundings, reassign: bool) -> Sequence[int]:
    """Tasks to be given: the most urgent, no more than there are robots; with `reassign`, first those that wait for their first stop."""
    work = around.work
    pending = [int(work.current[r]) for r in range(len(work.current)) if work.may_pass_on(r)] if reassign else []
    return [*pending, *work.unassigned][: len(work.current)]


def _can_take(around: Surroundings, robot: int, reassign: bool) -> bool:
    """Whether a robot can be given a task now."""
    return bool(around.work.current[robot] < 0) or (reassign and around.work.may_pass_on(robot))


def _changes(around: Surroundings, given: dict[int, int]) -> dict[int, int]:
    """What is given without what robots have already."""
    return {r: k for r, k in given.items() if int(around.work.current[r]) != k}


def _pick_up_times(now_s: float, around: Surroundings, start: IntArray, tasks: Sequence[int], reassign: bool) -> FloatArray:
    """[R, K] s until each robot would be at the first stop of each task, when it has done what it has; `FAR_S` where it never is."""
    work, steps, step_s = around.work, distances(around.graph), around.ledger.problem.step_s
    ready_s, at = np.zeros(len(start)), start.copy()
    for r, k in enumerate(work.current.tolist()):
        if k >= 0 and not _can_take(around, r, reassign):
            ready_s[r], at[r] = _remaining(now_s, around, r, work.tasks[k])
    times_s = np.full((len(start), len(tasks)), FAR_S)
    for column, k in enumerate(tasks):
        away = steps.to_all(np.array(work.tasks[k].stops[0].places)).min(0)[at]
        times_s[:, column] = np.where(away < UNREACHABLE, ready_s + away * step_s, FAR_S)
    return times_s


def _remaining(now_s: float, around: Surroundings, robot: int, task: Task) -> tuple[float, int]:
    """Time in s until a robot is done with its task, and where that is."""
    work, steps, step_s = around.work, distances(around.graph), around.ledger.problem.step_s
    at, left_s = int(_starts(around)[robot]), 0.0
    stops: Sequence[Stop] = task.stops[int(work.stop[robot]) :]
    if work.serving[robot]:
        left_s, stops = work.serving_until_s(robot) - now_s, stops[1:]
    for stop in stops:
        away, place = min((int(steps.to(v)[at]), v) for v in stop.places)
        left_s, at = left_s + min(away * step_s, FAR_S) + stop.service_s, place
    return left_s, at
