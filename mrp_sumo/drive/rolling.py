"""Requests to the planner while robots drive, and its answers. All in simulated time.

What is asked for at t takes effect at t + budget: what robots will be granted until then is frozen (`Ledger.cut`), and the plan
begins at its ends. The planner works on it at once, with an effort that is counted and not timed, so that every machine gives the same
plans. Plans may reach no further than a window; robots keep clear of each other within it, and before they come to its end there is
another.

Where there is no plan, or none that can be driven, robots keep what they have; where the next request fails, too, PIBT moves them for
a window, step by step and however crowded they are; where even that fails they stop at the ends of what they have. All is counted.
Where a plan would let robots stand on that have not got on for a minute, LaCAM plans instead until a stop is made, and to the end: there it
is complete.
"""

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from resource import RUSAGE_CHILDREN, getrusage
from time import perf_counter, process_time

import numpy as np

from mrp_sumo.core.digraph import weak_components
from mrp_sumo.core.execution import Event, PlannerCalls
from mrp_sumo.core.graph import BoolArray, PlanGraph
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.request import Request
from mrp_sumo.drive.controller import Controller
from mrp_sumo.drive.dispatcher import Dispatcher
from mrp_sumo.drive.replanning import AnswerLimits, LatePlanError, planned, supports_of
from mrp_sumo.drive.reroute import Replan
from mrp_sumo.drive.robot_work import Condition
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.drive.surroundings import Surroundings
from mrp_sumo.drive.work_request import WorkRequest
from mrp_sumo.errors import PlanError, ScenarioError
from mrp_sumo.plugins.registry import find

WINDOW_STEPS = 20  # at least, by default
LOOK_S = 1.0  # at least, between looks at how far robots have come
BEYOND_STEPS = 10  # the way into the longest aisle and back
STEPWISE = "pibt"  # what answers where the planner has failed twice running
COMPLETE = "lacam"  # what answers to the end where the planner lets robots stand for good
PAUSE_S = 60.0  # before that is asked again after it had no way out either; twice as long each time
FIRST_EFFORT = 1 / 8  # of an answer's, for its first try; twice as much each time


@dataclass(frozen=True, eq=False)
class WindowAnswer:
    """Ways that are to take effect at `ready_s`; None: there are none."""

    request: Request
    ways: Replan | None
    ready_s: float
    is_counted: bool  # as late or failed, since another planner's ways are in their place


class Rolling:
    """Asks the planner of a run, again and again."""

    def __init__(self, settings: ExecutionSettings, context: Surroundings, dispatcher: Dispatcher, controller: Controller) -> None:
        self._settings, self._around, self._dispatcher, self._controller = settings, context, dispatcher, controller
        self.calls = PlannerCalls(cpu_time_s=0.0 if _is_in_this_process(settings.planner) else None)
        self.answer: WindowAnswer | None = None  # that has not taken effect yet
        self._window_steps = window_of(settings, context.ledger.problem)
        self._next_s = 0.0  # no request before
        self.window_over_s = np.inf  # a new plan is to be there by then, or may have to be
        self._half_over_s = np.inf  # at the latest
        self._failures = 0  # running
        self._led_since_s = -np.inf  # the last stop before LaCAM took over; it leads until the next
        self._tried = -np.inf, 0  # the last stop, and how many robots were broken, when it was asked
        self._again_s, self._pause_s = -np.inf, PAUSE_S
        self._events: list[Event] = []
        self._serves = False  # whether anybody has been served
        self.refused_since_s = np.inf  # since when there have been no plans; inf: the last request had one

    def ask(self, now_s: float, report: Callable[[str], None]) -> None:
        """Have what is due answered, if nothing is under way; `report` hears why there is no plan."""
        planning, context = self._settings.planning, self._around
        if self.answer is not None or now_s < self._next_s - 1e-9:
            return
        if now_s >= self.window_over_s - 1e-9:
            self.window_over_s = self._over_s(now_s)
            context.crew.is_changed |= now_s >= self.window_over_s - 1e-9
        if self._settings.tasks and not context.crew.is_changed:
            return
        context.ledger.give_back(np.flatnonzero(context.world.broken & (context.ledger.state.motion.speed_mps == 0.0)))
        if planning.budget_s:
            stays = context.world.broken | context.entering
            context.ledger.cut(planning.budget_s, self._controller.kinematics, context.closed, stays)
        request = next(iter(self._dispatcher.due(now_s, context)), None)
        if request is None:
            context.ledger.lift()
            return
        began, cpu_began_s, without = perf_counter(), _cpu_s(), self.calls.late + self.calls.failed
        try:
            ways = self._dispatcher.answer(request, context)
            if ways is not None and ways.planner:
                plans_of = self.calls.plans_of
                self.calls = replace(self.calls, plans_of={**plans_of, ways.planner: plans_of.get(ways.planner, 0) + 1})
        except PlanError as error:
            ways = None
            report(str(error))
            if self.calls.late + self.calls.failed == without:
                self._count(late=isinstance(error, LatePlanError), failed=not isinstance(error, LatePlanError))
        self._count(requests=1, wall_time_s=perf_counter() - began)
        if self.calls.cpu_time_s is not None:
            self._count(cpu_time_s=_cpu_s() - cpu_began_s)
        self.answer = WindowAnswer(request, ways, now_s + planning.budget_s, self.calls.late + self.calls.failed > without)
        self._serves = self._serves or bool(context.crew.busy.any())
        at_once = planning.period_s is None and self._serves  # who has been served waits for its way
        self._next_s = now_s + (0.0 if at_once else planning.least_period_s(request.site.num_robots, request.site.step_s))

    def plan(self, request: Request, begin_s: float) -> Replan:
        """The answer of the planner of this run; of PIBT where that has failed before, and fails again. Raises PlanError."""
        settings, context = self._settings, self._around
        limits = AnswerLimits(
            settings.planning.effort if settings.tasks else AnswerLimits().effort, self._window_steps if settings.tasks else 0
        )
        begin_s += settings.planning.budget_s
        try:
            ways = planned(request, begin_s, context, settings.planner, settings.planner_parameters, limits)
            return self._led_out(request, begin_s, ways, limits) if settings.tasks else ways
        except PlanError as error:
            if not self._failures:
                raise
            late = isinstance(error, LatePlanError)
            self._count(late=late, failed=not late)
        try:
            ways = planned(request, begin_s, context, STEPWISE, {}, replace(limits, window_steps=self._window_steps or WINDOW_STEPS))
        except PlanError as error:
            self._count(stopped=1)
            raise PlanError(f"{error}; robots stop at the ends of their ways") from error
        self._count(stepped=1)
        return ways

    def _led_out(self, request: Request, begin_s: float, ways: Replan, limits: AnswerLimits) -> Replan:
        """The ways, or LaCAM's to the end where robots that have stood for long would stand on, and from then on until a stop is made."""
        made_s, num_staying = self._around.crew.made_s, self._staying(request, ways)
        if self._tried != (tried := (made_s, int(self._around.world.broken.sum()))):
            self._tried, self._again_s, self._pause_s = tried, -np.inf, PAUSE_S
        if request.now_s < self._again_s or (self._led_since_s != made_s and not num_staying):
            return ways
        effort = math.ceil(min(1.0, FIRST_EFFORT * self._pause_s / PAUSE_S) * limits.effort)
        with suppress(PlanError):
            led = planned(request, begin_s, self._around, COMPLETE, {}, AnswerLimits(effort))
            if self._staying(request, led) <= max(0, num_staying - 1):
                self._led_since_s = made_s
                return led
        self._again_s, self._pause_s = request.now_s + self._pause_s, 2 * self._pause_s
        return ways

    def _staying(self, request: Request, ways: Replan) -> int:
        """Robots that have stalled and are sent nowhere, though their orders end elsewhere."""
        context, vertex = self._around, self._around.ledger.visits.vertex

        def is_left(r: int, end: int) -> bool:
            is_sent = r in ways.reroute and len(ways.reroute[r].vertex) > 0
            return context.crew.robots[r].condition is Condition.STALLED and not is_sent and end != vertex[context.granted(r)]

        return sum(map(is_left, request.robot.tolist(), request.end.tolist()))

    def due(self, now_s: float) -> WindowAnswer | None:
        """The answer that is to take effect now."""
        answer = self.answer
        return answer if answer is not None and now_s >= answer.ready_s - 1e-9 else None

    def taken(self, answer: WindowAnswer, now_s: float) -> None:
        """The ledger has an answer."""
        self.answer, work = None, self._around.work
        self._end_series(now_s)
        if isinstance(answer.request, WorkRequest):
            work.accepted(answer.request, now_s)
        short = not self._around.state.home.all()
        window_s = self._window_steps * self._around.ledger.problem.step_s
        self._half_over_s = now_s + window_s / 2 - self._settings.planning.budget_s if short and window_s else np.inf
        self.window_over_s = self._over_s(now_s)

    def _over_s(self, now_s: float) -> float:
        """When half of the window is over; now, where a robot that is ahead of its plan comes to its end; or when to look again."""
        if self._half_over_s == np.inf:
            return np.inf
        state, visits, kinematics = self._around.state, self._around.ledger.visits, self._controller.kinematics
        left_m = visits.at_m[visits.last] - state.motion.s_m - kinematics.reach_m - kinematics.speed_mps * self._settings.planning.budget_s
        drives = ~state.home & (visits.last != visits.reached)
        if (drives & (left_m <= 0) & (visits.arrive_s[visits.reached] > now_s)).any():
            return now_s
        soonest_s = float((left_m / kinematics.speed_mps)[drives].min(initial=np.inf))
        return min(self._half_over_s, now_s + max(soonest_s, LOOK_S))

    def drop(self, now_s: float, *, failed: bool) -> None:
        """An answer does not take effect: there is none, it cannot be driven, or robots have been sent other ways meanwhile."""
        if self.answer is None:
            return
        answer, self.answer = self.answer, None
        self._around.ledger.lift()
        self._failures += failed
        if failed:
            self.refused_since_s = min(self.refused_since_s, answer.request.now_s)
        if failed and answer.ways is not None and not answer.is_counted:
            self._count(failed=1)
        if failed and self._settings.planning.period_s is None:
            self._next_s = now_s
        if failed:
            self._around.work.failed(now_s)
        else:
            self._around.crew.is_changed = True

    def close(self, now_s: float) -> list[Event]:
        """The run is over. Returns what has not been reported yet."""
        self._end_series(now_s)
        return self.drain()

    def drain(self) -> list[Event]:
        """Events since this was last asked."""
        events, self._events = self._events, []
        return events

    def _end_series(self, now_s: float) -> None:
        """Requests that had no plan one after the other, if there were several."""
        if self._failures > 1:
            duration_s = round(now_s - self.refused_since_s, 9)
            text = f"{self._failures} requests in a row without a plan"
            self._events.append(Event(self.refused_since_s, "no_plan", -1, duration_s=duration_s, text=text))
        self._failures, self.refused_since_s = 0, np.inf

    def _count(self, **counts: float) -> None:
        calls = self.calls
        self.calls = replace(calls, **{name: getattr(calls, name) + count for name, count in counts.items()})


def _is_in_this_process(planner: str) -> bool:
    """True if a planner answers here: one of ours, or an object that was handed over from Python, which has no registered name."""
    try:
        return find("planners", planner).ours
    except ScenarioError:
        return True


def _cpu_s() -> float:
    """CPU time of all threads of this process, and of programs that it has waited for."""
    ended = getrusage(RUSAGE_CHILDREN)
    return process_time() + ended.ru_utime + ended.ru_stime


def window_of(settings: ExecutionSettings, problem: Problem) -> int:
    """Steps for which robots keep clear of each other; 0: to the end.

    Robots that see less than the way into the longest aisle and back drive into it against others, and are sent back again and again.
    """
    window_s = settings.planning.window_s
    if window_s is None:
        return max(WINDOW_STEPS, 2 * longest_aisle(problem.for_any().graph) + BEYOND_STEPS)
    return max(1, round(window_s / problem.step_s)) if window_s else 0


def longest_aisle(graph: PlanGraph) -> int:
    """The most lanes in a row that lead both ways and from which none branches off; rings, which have no ends, do not count."""
    count = partial(np.bincount, minlength=graph.num_vertices)
    ends, both = np.stack([graph.tail, graph.head]), (graph.reverse >= 0) & (graph.tail < graph.head)
    narrow: BoolArray = count(ends[:, both | (graph.reverse < 0)].ravel()) <= 2
    two_way = ends[:, both]
    inner = two_way[:, narrow[two_way].all(0)]
    piece = weak_components(graph.num_vertices, *inner)
    of_lane = np.where(narrow[two_way[0]], piece[two_way[0]], piece[two_way[1]])[narrow[two_way].any(0)]
    has_ends = count(piece[inner[0]]) < count(piece[narrow])
    return int(count(of_lane)[has_ends].max(initial=0))


def steps_ahead(settings: ExecutionSettings, problem: Problem) -> int:
    """Steps for which the planner wants to know the stops of robots that they need not stay at; 0: it knows each robot's next one."""
    if not settings.tasks or "stops" not in supports_of(settings.planner, settings.planner_parameters):
        return 0
    return window_of(settings, problem)
