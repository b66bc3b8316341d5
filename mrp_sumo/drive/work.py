"""Work: which robot has which order, and how far it is with it; when robots charge, and what becomes of the orders of those that are lost.

A robot makes its task's stops one after the other, each at a place of the stop's station that no other robot is at or on its way to. It
stays there for the service time, and goes by where that is none. Who comes to a station first is served first, unless orders differ in
priority; others drive up behind (`drive.places`). Robots without work stay where they are, unless somebody has to come there.

What a robot is at changes by the table of `drive.duties`, the state of an order by that of `drive.orders`.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import dropwhile
from typing import NamedTuple

import numpy as np

from mrp_sumo.core.battery import Charging
from mrp_sumo.core.digraph import strong_components
from mrp_sumo.core.execution import BOOKINGS, Event
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, frozen
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.request import Request, with_stops_before
from mrp_sumo.core.robot_states import RobotStateLog
from mrp_sumo.core.robot_type import Battery
from mrp_sumo.core.stream import TaskSource
from mrp_sumo.core.task import CHARGE, NOBODY, Station, Stop, StopLog, Task, TaskLog
from mrp_sumo.core.visits import Visits
from mrp_sumo.drive._causes import FACILITY, PLANNED
from mrp_sumo.drive.duties import (
    BROKEN,
    CHARGING,
    EMPTY,
    IDLE,
    IN_SERVICE,
    LEAVING,
    LOST,
    STALLED,
    TO_CHARGER,
    TO_STOP,
    Duties,
)
from mrp_sumo.drive.orders import KEPT, OrderRules, Orders
from mrp_sumo.drive.places import RobotPlaces
from mrp_sumo.drive.state import State
from mrp_sumo.errors import PlugInError
from mrp_sumo.search.distance import distances

NONE = -1
STANDS = [BOOKINGS.index(name) for name in ("planned_wait", "dependency_wait", "yielding", "blocked", "disturbed")]
AT_GOAL = BOOKINGS.index("at_goal")
STALLED_S = 60.0  # for which a robot with work has not got on, nor stood for the work's sake
STANDS_S = 360.0  # for which a robot has not got on, or no stop was made, in a run that counts as stalled
PATIENCE = 2  # who set out later and are served first, until one that waits no longer lets by whom it can pass
LATE = 3.0  # so many times the longest way to a stop is more than robots need for it
SLACK_S = 0.5  # so much earlier than a robot would have to brake for a stop without service, its way on is asked for
LEAST_CHARGE_S = 60.0  # for less nobody goes to charge that need not
PLACES_TO_HAND_OVER = 4  # beside a robot that is lost
WHY_LOST = {BROKEN: "broke down", EMPTY: "ran empty"}
STEP_S = 1.0  # more than between two looks: so much before a battery may be empty, every look counts
TRY_AGAIN_S = 2.0  # after a request that had no answer


@dataclass(frozen=True, eq=False)
class WorkRequest(Request):
    """A request for ways to the stops of tasks."""

    given: Mapping[int, int] = field(default_factory=dict)  # tasks, by the robots that are to have them
    legs: Mapping[int, Sequence["Leg"]] = field(default_factory=dict)  # stops on the ways of its robots
    waits: Mapping[int, int] = field(default_factory=dict)  # vertices where robots are to wait for a place
    at_once: frozenset[int] = frozenset()  # robots that may begin with what they are given as soon as they are done with what they have


class Leg(NamedTuple):
    """A stop to which the way of a robot leads."""

    task: int
    nth: int  # of the task's stops
    vertex: int


class StopRow(NamedTuple):
    """A row of the `StopLog`."""

    task: int
    robot: int
    station: str
    vertex: int
    since_s: float
    begin_s: float
    end_s: float
    stood_s: float
    queued_s: float
    due_s: float


class Work:
    """The work of R robots."""

    def __init__(
        self,
        sources: Sequence[TaskSource],
        problem: Problem,
        lead_s: float = 0.0,
        *,
        rules: OrderRules = KEPT,
        parking: Sequence[int] = (),
        batteries: Sequence[Battery] = (),
        charging: Charging | None = None,
        ahead_steps: int = 0,
    ) -> None:
        """`ahead_steps` is how far the planner wants to know stops at which nothing is to be done; with 0 robots stop at each."""
        num_robots = problem.num_robots
        self.problem, self.lead_s = problem, lead_s  # what is asked for takes effect so much later
        self.orders = Orders(sources, rules)
        self.duties = Duties(num_robots)
        self._places = RobotPlaces(problem, parking)
        self._batteries, self._charging = batteries, charging
        first = (np.arange(num_robots + 1) * (charging.first_share if charging else 0.0) + 0.5).astype(np.int64)
        self._charges_first: BoolArray = np.diff(first) > 0  # [R] robots that go to charge whatever their level
        self._ahead_steps = ahead_steps
        self.current = np.full(num_robots, NONE)  # [R] the task of each robot
        self.then = np.full(num_robots, NONE)  # [R] the one that it goes on with, whose way begins where this one's last stop is
        self.stop = np.zeros(num_robots, np.int64)  # [R] the stop of its task that is to be made next, or is being made
        self.level = np.ones(num_robots)  # [R] states of charge
        self.news = True  # whether something has changed since the last request
        self.wake_s = 0.0  # when something will have changed that is known already
        self.seen = np.arange(num_robots)  # [R] the last visit of each robot that has been looked at
        self._legs: list[list[Leg]] = [[] for _ in range(num_robots)]  # stops that each robot's way leads to, in their order
        self._wait_at = np.full(num_robots, NONE)  # [R] vertex where it is to wait for a place
        self._came_s = np.full(num_robots, np.inf)  # [R] since when it has waited as near as there
        self._num_before = np.zeros(num_robots, np.int64)  # [R] who set out later, and were served where it waits
        self._until_s = np.full(num_robots, np.inf)  # [R] when the service is over that it is at
        self._over_s = np.full(num_robots, -np.inf)  # [R] when its last one was
        self._since_s = np.zeros(num_robots)  # [R] when it was given the task, or was done with the stop before
        self._earliest_s = np.zeros(num_robots)  # [R] before which the next stop cannot begin
        self._moved_s = np.zeros(num_robots)  # [R] when it last got on, or stood for the work's sake
        self._made_s = 0.0  # when a stop was last made, or none was to be
        self._work_stands = False  # whether that is too long ago
        self._resumes = np.full(num_robots, IDLE)  # [R] what a broken robot goes on with
        self._idle = np.zeros((num_robots, 2))  # [R, 2] s that each had stood on its way, and where it was sent, when it set out
        self._row = np.zeros(num_robots, np.int64)  # [R] that of each robot's last stop in the log
        self._stops: list[StopRow | None] = []  # of the `StopLog`
        self._events: list[Event] = []
        self._num_charges = 0
        self._again_s = 0.0
        self._looked_s = self._looked_before_s = -np.inf
        self._piece: dict[int, IntArray] = {}  # [V] strong components of the graphs of types

    @property
    def tasks(self) -> Sequence[Task]:
        """Those that are known by now, numbered by release."""
        return self.orders.tasks

    @property
    def unassigned(self) -> Sequence[int]:
        """Tasks that no robot has: the most urgent first, then the oldest."""
        return sorted(self.orders.waiting, key=lambda k: (-self.tasks[k].priority, k))

    @property
    def free(self) -> IntArray:
        """Robots without a task, ascending; also those that will be done with theirs when what is asked for now takes effect."""
        return np.array([r for r, duty in enumerate(self.duties.of) if duty == IDLE or (duty == LEAVING and self._is_last(r))], np.int64)

    @property
    def serving(self) -> BoolArray:
        """[R] robots that are at a stop, or at a charger."""
        serving: BoolArray = np.isfinite(self._until_s)
        return serving

    @property
    def busy(self) -> BoolArray:
        """[R] who is being served, and still will be when what is asked for now takes effect."""
        busy: BoolArray = self.serving & (self.duties.of != LEAVING)
        return busy

    @property
    def out(self) -> BoolArray:
        """[R] robots that are empty, or broken for a while or for good."""
        return self.duties.are(*LOST)

    @property
    def all_done(self) -> bool:
        """Whether no task is left, and none will come."""
        orders = [k for k in (*self.current.tolist(), *self.then.tolist()) if k != NONE and self.orders.is_order(k)]
        return not self.orders.waiting and not orders and not self.orders.endless

    @property
    def endless(self) -> bool:
        """Whether more tasks will come."""
        return self.orders.endless

    @property
    def at_charger(self) -> BoolArray:
        """[R] robots that are being charged."""
        return self.serving & ~self.out & np.array([self._is_charge(r) for r in range(len(self.current))], np.bool_)

    def update(
        self, now_s: float, visits: Visits, state: State, level: FloatArray | None = None, down_until_s: FloatArray | None = None
    ) -> None:
        """Note what robots have done by now; reveal tasks; see who has to charge.

        Parameters
        ----------
        level
            [R] states of charge, where robots have batteries.
        down_until_s
            [R] until when robots are broken, inf: for good.
        """
        booked_s = state.waits.booked_s
        for r in np.flatnonzero(self.current != NONE).tolist():
            self._note(r, now_s, visits, booked_s[r])
        if down_until_s is not None:  # what was over by then is
            self._see_who_is_broken(now_s, down_until_s, visits)
        self.seen[:] = visits.reached
        self._see_who_waits(visits)
        self._cancel(now_s)
        for task in self.orders.reveal(now_s):
            self._fail_if_nobody_can(task, now_s)
            self.news |= self._some_could_take_it
        if level is not None:
            self.level = level
            if self._charging is not None:
                self._see_who_charges(now_s, self._charging, booked_s)
        self._see_who_leaves(now_s, visits, state)
        self._see_who_stalls(now_s, visits, state)
        if now_s >= self._again_s:
            self.news, self._again_s = True, np.inf
        self._looked_before_s, self._looked_s = self._looked_s, now_s
        self.wake_s = self._next_change_s(now_s, visits, state)

    def is_quiet(self, now_s: float, visits: Visits, state: State) -> bool:
        """Whether `update` changes nothing before `wake_s` but the time since which robots have got on (see `pass_over`), as long as no
        robot stands but those that `rests` has, nor goes on that is `watched`.
        """
        if self.news or self._charging is not None or self.duties.are(STALLED, *LOST).any() or self._work_stands:
            return False
        if any(state.motion.speed_mps[r] == 0 for r in self._passing(visits)):  # nobody knows when they are near
            return False
        return now_s - self._made_s < STANDS_S / 2 or self._gets_done

    @property
    def rests(self) -> BoolArray:
        """[R] robots that stand for the work's sake, or without any."""
        rests: BoolArray = self.serving | (self.current == NONE)
        return rests

    @property
    def watched(self) -> BoolArray:
        """[R] robots that make a stop in passing, or come to wait in line, on their way."""
        passes = [any(not self._takes_s(leg) for leg in legs) for legs in self._legs]
        watched: BoolArray = np.array(passes, np.bool_) | ((self._wait_at != NONE) & np.isinf(self._came_s))
        return watched

    def empty_wake_s(self, now_s: float, most_per_s: FloatArray) -> float:
        """Until when no battery runs empty, as robots draw at most so much a second [R]; for robots that nobody charges."""
        left = np.where(~self.out & (self.level > 0), self.level, np.inf)
        return now_s + float((left / most_per_s).min(initial=np.inf)) - STEP_S

    def pass_over(self, looks_s: Sequence[float], level: FloatArray | None) -> None:
        """`update` was not called at some times, of which these are the last two, since it `is_quiet`; with states of charge [R] then."""
        if level is not None and len(looks_s):
            self.level = level
        for now_s in looks_s:
            self._moved_s[:] = now_s
            if self._gets_done:
                self._made_s = now_s
            self._looked_before_s, self._looked_s = self._looked_s, now_s

    def request(self, now_s: float, committed: Sequence[Sequence[int]], closed: BoolArray, given: Mapping[int, int]) -> WorkRequest:
        """The request for the ways of all robots that are not at work.

        Parameters
        ----------
        committed
            [R] vertices that robots are to pass whatever comes, from where they are, to where their new ways begin.
        closed
            [L] lanes that nobody may use.
        given
            Tasks for robots that have none, or have one that they may pass on. It goes back to those that wait, if nobody is given it.

        Raises
        ------
        PlugInError
            For a task that needs a robot of another type.
        """
        if (wrong := next(((r, k) for r, k in given.items() if not self.can_do(r, k)), None)) is not None:
            name, needs = self.problem.fleet.robot_name[wrong[0]], self.tasks[wrong[1]]
            if self._has_room(*wrong):
                raise PlugInError(f"task '{needs.name}' needs a robot of type '{needs.robot_type}', {name} is none")
            raise PlugInError(f"task '{needs.name}' is nothing for {name}, which has no room on the way")
        self.news = False
        start = np.array([way[-1] for way in committed], np.int64)
        goes, passed_on = ~self.busy & ~self.out, set(given.values())
        robots = np.flatnonzero(goes)
        kept: dict[int, list[Leg]] = {}  # stops that robots make on what they are committed to
        legs: dict[int, list[Leg]] = {}  # and on their new ways
        stop: dict[int, Stop] = {}
        for r in robots.tolist():
            kept[r], task, nth = self._after_committed(r, committed[r])
            if r in given or task in passed_on:
                task, nth = given.get(r, NONE), 0
            legs[r] = []
            if task != NONE:
                legs[r] = [Leg(task, n, v) for n, v in self._in_passing(start[r], task, nth)]
                nth += len(legs[r])
                stop[r] = self.tasks[task].stops[nth]
                legs[r].append(Leg(task, nth, NONE))
        turn = self._turn(start, stop, {r: legs[r][-1].task for r in stop}, ~goes)
        vertex, makes = self._places.choose(start, ~goes, stop, turn)
        via = [list(dropwhile(start[r].__eq__, (leg.vertex for leg in legs[r][:-1]))) for r in robots.tolist()]
        for r in stop:
            last = legs[r].pop()
            if makes[r]:
                legs[r].append(last._replace(vertex=int(vertex[r])))
        request = WorkRequest(
            now_s=now_s,
            site=self.problem,
            robot=frozen(robots),
            start=frozen(start[robots]),
            stop_first=np.arange(len(robots) + 1),
            stop=frozen(vertex[robots]),
            closed=closed.copy(),
            reason="tasks",
            given=dict(given),
            legs={r: (*kept[r], *legs[r]) for r in robots.tolist()},
            waits={r: int(vertex[r]) for r in stop if not makes[r]},
            at_once=frozenset(r for r in given if self.duties.of[r] == LEAVING or self._is_just_done(r)),
        )
        return with_stops_before(request, via)

    def fits(self, request: WorkRequest, moved: Collection[int]) -> bool:
        """Whether those robots of a request that are sent on may still leave: a service may have begun, or a robot be lost."""
        stays = self.busy | self.out
        return not any(stays[r] or self._has_begun(r, request.now_s) for r in request.robot.tolist() if r in moved)

    def accepted(self, request: WorkRequest, now_s: float, visits: Visits, state: State) -> None:
        """Robots are on the ways that were asked for."""
        booked_s = state.waits.booked_s
        given = {r: k for r, k in request.given.items() if self._may_take(r, k)}
        taken_back = {other for r, task in given.items() for other in (r, self.orders.robot[task]) if other != NOBODY}
        freed = [self._take_back(r, now_s) for r in sorted(taken_back) if self.may_pass_on(r)]
        for r, task in given.items():
            self._give(r, task, now_s, request, booked_s[r])
        self.news |= len(given) < len(request.given) or any(self.orders.robot[k] == NOBODY for k in freed)
        for r in request.robot.tolist():
            if self.serving[r] or self.out[r]:
                continue
            if self._is_charge(r):  # nobody charges before the answer is there, even at a charger
                self._earliest_s[r] = max(float(self._earliest_s[r]), now_s)
            self._legs[r] = [leg for leg in request.legs[r] if self._is_ahead(r, leg)]
            self._wait_at[r] = request.waits.get(r, NONE) if self.current[r] != NONE else NONE
            if self.duties.of[r] == LEAVING:
                self.duties.enter(r, TO_STOP, now_s, int(self.current[r]))
            self._note(r, now_s, visits, booked_s[r])
        self._see_who_leaves(now_s, visits, state)
        self.wake_s = self._next_change_s(now_s, visits, state)

    def failed(self, now_s: float) -> None:
        """There was no answer to a request: it is made again in a while."""
        self._again_s = now_s + TRY_AGAIN_S
        self.wake_s = min(self.wake_s, self._again_s)

    def add(self, task: Task) -> None:
        """Have a task that nobody knew of, among those that are listed with times of their own."""
        self.orders.add(task)
        self.wake_s = min(self.wake_s, task.release_s)

    def log(self) -> TaskLog:
        """What has become of the tasks."""
        return self.orders.log()

    def robot_states(self, end_s: float) -> RobotStateLog:
        """What the robots were at."""
        return self.duties.log(end_s)

    def stops_made(self) -> StopLog:
        """The stops that were made, by task."""
        rows = sorted((row for row in self._stops if row is not None), key=lambda row: (row.task, row.begin_s))
        task, robot, station, vertex, *times = zip(*rows) if rows else [()] * len(StopRow._fields)
        numbers = [frozen(np.array(column, np.int64)) for column in (task, robot, vertex)]
        return StopLog(numbers[0], numbers[1], station, numbers[2], *(frozen(np.array(column, np.float64)) for column in times))

    def has_stalled(self, now_s: float) -> bool:
        """Whether orders are open, and no stop was made or a robot stalled for long, or nobody has been at work for a while.

        Who charges for it, or is broken for a while only, counts as at work.
        """
        open_since_s = self.orders.open_since_s
        if self._work_stands or (now_s - self._moved_s[self.duties.are(STALLED)] >= STANDS_S).any():
            return True
        if np.isinf(open_since_s) or (self.duties.are(BROKEN) & (self._resumes < BROKEN)).any():
            return False
        if self.duties.are(TO_STOP, IN_SERVICE, LEAVING, TO_CHARGER, CHARGING).any():
            return False
        return bool(self.duties.are(STALLED).any() or now_s - max(open_since_s, self.duties.changed_s) >= STALLED_S)

    def drain(self) -> list[Event]:
        """What happened to orders since this was last asked."""
        events, self._events = self._events, []
        return events

    def can_do(self, robot: int, task: int) -> bool:
        """Whether a robot is of the type that a task needs, and has room on the way to its stops."""
        needed, types = self.tasks[task].robot_type, self.problem.fleet.type_name
        return (not needed or types[robot] == needed) and self._has_room(robot, task)

    def some_cannot(self, task: int) -> bool:
        """Whether a task is not for every robot."""
        return bool(self.tasks[task].robot_type) or self.problem.barred is not None

    def may_pass_on(self, robot: int) -> bool:
        """Whether a robot has a task and has not come to its first stop, nor is about to, nor waits in line for it."""
        return self._has_yet_to_begin(robot) and bool(np.isinf(self._came_s[robot]))

    def _has_yet_to_begin(self, robot: int) -> bool:
        """Whether a robot has a task and has not come to its first stop, nor is about to."""
        if self.current[robot] == NONE or self._is_charge(robot) or self.duties.of[robot] == LEAVING:
            return False
        return bool(self.stop[robot] == 0 and not self.serving[robot])

    def lose(self, robot: int, now_s: float, duty: int, visits: Visits) -> None:
        """A robot will never go on, being `EMPTY` or `BROKEN`: what it has goes to others, or fails, by the rules of the orders."""
        task, why = int(self.current[robot]), f"{self.problem.fleet.robot_name[robot]} {WHY_LOST[duty]} with it on board"
        self.duties.enter(robot, duty, now_s)
        self._resumes[robot] = duty
        begun = bool(self.serving[robot])
        if begun:
            self._stops[self._row[robot]] = None if not self._is_charge(robot) else self._stops[self._row[robot]]
        self._give_up_next(robot)
        if task != NONE and self._is_charge(robot):
            self.orders.fail(task, now_s, why.removesuffix(" with it on board"))
        elif task != NONE and self.stop[robot] == 0:
            self.orders.take_back(task)
        elif task != NONE:
            self._lose_load(robot, task, now_s, why, visits)
        self.current[robot] = self._wait_at[robot] = NONE
        self._until_s[robot], self._came_s[robot], self._legs[robot] = np.inf, np.inf, []
        self.news = True
        for waiting in list(self.orders.waiting):
            self._fail_if_nobody_can(waiting, now_s)

    def serving_until_s(self, robot: int) -> float:
        """When the service that a robot is at will be over; inf: it is at none."""
        return float(self._until_s[robot])

    def _lose_load(self, robot: int, task: int, now_s: float, why: str, visits: Visits) -> None:
        """What becomes of an order whose robot is lost after its first stop."""
        orders, retry, stops = self.orders, self.orders.rules.retry, self.tasks[task].stops
        name = self.tasks[task].name
        if retry and retry.hand_over:
            fetch = self._place_to_hand_over(robot, stops[0], visits)
            orders.hand_over(task, (fetch, *stops[int(self.stop[robot]) :]), why)
            self._events.append(Event(now_s, "handed_over", robot, fetch.vertex, text=f"order '{name}': {why}; another is to fetch it"))
        elif retry and orders.tries[task] < retry.times:
            orders.begin_anew(task, why)
            self._events.append(Event(now_s, "begun_anew", robot, text=f"order '{name}': {why}; it is begun anew"))
        else:
            self._fail(task, now_s, why, robot)

    def _fail(self, task: int, now_s: float, why: str, robot: int = NOBODY) -> None:
        self.orders.fail(task, now_s, why)
        self._events.append(Event(now_s, "failed", robot, text=f"order '{self.tasks[task].name}': {why}"))

    def _fail_if_nobody_can(self, task: int, now_s: float) -> None:
        """An order that is for none of the robots that are left will not be done; without any left the run has come to a stand."""
        left = np.flatnonzero(self._resumes < BROKEN).tolist()
        if left and self.some_cannot(task) and not any(self.can_do(r, task) for r in left):
            self._fail(task, now_s, "no robot that can do it is left")

    def _place_to_hand_over(self, robot: int, first: Stop, visits: Visits) -> Stop:
        """A stop beside a robot that stands for good, which takes as long as the first."""
        graph, fleet = self.problem.graph, self.problem.fleet
        apart_m = 2 * float(fleet.radius_m.max()) + float(fleet.gap_m.max())
        here = int(visits.reached[robot])
        ahead = int(visits.next[here])
        stands = graph.xy[visits.vertex[[here, ahead if ahead >= 0 else here]]]
        away_m = np.hypot(*(graph.xy[:, None] - stands[None]).transpose(2, 0, 1))
        near = np.argsort(np.where((away_m >= apart_m).all(1), away_m.sum(1), np.inf), kind="stable")[:PLACES_TO_HAND_OVER]
        station = Station(f"beside {fleet.robot_name[robot]}", tuple(near.tolist()))
        return Stop(station.places[0], first.service_s, "pickup", station)

    def _has_room(self, robot: int, task: int) -> bool:
        """Whether a robot's type can come from its start to the stops of a task and back."""
        if self.problem.barred is None:
            return True
        kind = int(self.problem.fleet.kind[robot])
        if kind not in self._piece:
            graph = self.problem.graph_of_kind[kind]
            self._piece[kind] = strong_components(graph.num_vertices, graph.tail, graph.head)
        piece, start = self._piece[kind], int(self.problem.start[robot])
        return all(any(piece[v] == piece[start] for v in stop.places) for stop in self.tasks[task].stops)

    def _is_charge(self, robot: int) -> bool:
        return bool(self.current[robot] != NONE and not self.orders.is_order(int(self.current[robot])))

    def _is_last(self, robot: int) -> bool:
        """Whether nothing is left for a robot that is leaving, after what it is about to have made."""
        made = 1 if self.serving[robot] else len(self._legs[robot])
        return bool(int(self.stop[robot]) + made == len(self.tasks[int(self.current[robot])].stops) and self.then[robot] == NONE)

    def _is_ahead(self, robot: int, leg: Leg) -> bool:
        """Whether a stop is still to be made."""
        return leg.task == self.then[robot] or bool(leg.task == self.current[robot] and leg.nth >= self.stop[robot])

    def _has_begun(self, robot: int, since_s: float) -> bool:
        """Whether a robot is at a stop, but was not at a time; if its service is short, it may be leaving already."""
        row = self._stops[self._row[robot]] if self.serving[robot] else None
        return row is not None and row.begin_s > since_s

    def _is_just_done(self, robot: int) -> bool:
        """Whether a robot's last service ended since the look before, and what is asked for now takes effect now."""
        return bool(not self.lead_s and self._over_s[robot] > self._looked_before_s)

    def _may_take(self, robot: int, task: int) -> bool:
        """Whether a robot may still be given a task: both may have come to a first stop since it was decided, or be gone."""
        holder = self.orders.robot[task]
        if self.out[robot] or not (task in self.orders.waiting or (holder != NOBODY and self.may_pass_on(holder))):
            return False
        about_to_end = self.duties.of[robot] == LEAVING and self.then[robot] == NONE
        return bool(self.current[robot] == NONE or about_to_end or self.may_pass_on(robot))

    def _give(self, r: int, task: int, now_s: float, request: WorkRequest, booked_s: FloatArray) -> None:
        """A robot has a task, or will have it when it comes to the last stop of the one it has."""
        if self.current[r] != NONE:
            self.then[r] = task
            self.orders.assign(task, r, now_s)
            return
        since_s = max(float(self._over_s[r]), self.orders.released_s(task)) if r in request.at_once else request.now_s
        self.orders.assign(task, r, since_s)
        self._begin_task(r, task, since_s, since_s if r in request.at_once else now_s, booked_s)

    def _begin_task(self, r: int, task: int, since_s: float, earliest_s: float, booked_s: FloatArray) -> None:
        self.current[r], self.stop[r], self._since_s[r], self._earliest_s[r] = task, 0, since_s, earliest_s
        self._came_s[r], self._moved_s[r], self._idle[r] = np.inf, earliest_s, _idle(booked_s)
        if self.orders.is_order(task):
            self.duties.enter(r, TO_STOP, earliest_s, task)
        else:
            self.duties.enter(r, TO_CHARGER, earliest_s)

    def _take_back(self, robot: int, now_s: float) -> int:
        """The robot's task, which has not been begun, waits again."""
        task = int(self.current[robot])
        self.orders.take_back(task)
        self._free(robot, now_s)
        return task

    def _free(self, robot: int, now_s: float) -> None:
        """A robot has nothing to do."""
        self.current[robot] = self._wait_at[robot] = NONE
        self._legs[robot], self._came_s[robot] = [], np.inf
        self.duties.enter(robot, IDLE, now_s)

    def _give_up_next(self, robot: int) -> None:
        """The task that a robot was to go on with waits again."""
        if self.then[robot] != NONE:
            self.orders.take_back(int(self.then[robot]))
            self.then[robot] = NONE

    def _turn(self, start: IntArray, stops: Mapping[int, Stop], task: Mapping[int, int], stays: BoolArray) -> list[int]:
        """Robots in the order in which they choose where to make their stops.

        The most urgent first; then who came first and waits; then who is nearest. Nobody comes before those who stand on its way there,
        but for those who set out when it waited already, if they can let it pass.
        """
        stands = set(start[stays].tolist())
        away = {r: self._places.away(r, int(start[r]), stop) for r, stop in stops.items()}
        wished = sorted(stops, key=lambda r: (-self.tasks[task[r]].priority, self._came_s[r], away[r], task[r]))
        order: list[int] = []
        for n, r in enumerate(wished):
            if r in order:
                continue
            nearer = [s for s in wished[n + 1 :] if s not in order and away[s] < away[r] and stops[s].places == stops[r].places]
            if nearer:
                way = self._places.way(r, int(start[r]), stops[r])
                aged = self._num_before[r] >= PATIENCE
                new = [s for s in nearer if aged or np.isinf(self._came_s[s])]
                later = [s for s in new if self._sets_out_s(s, task[s]) > self._came_s[r]]
                ahead = [s for s in nearer if int(start[s]) in way]
                stuck = [s for s in ahead if s not in later or not self._places.can_let_pass(s, int(start[s]), way, stands)]
                order += sorted(stuck, key=lambda s: away[s])
            order.append(r)
        return order

    def _sets_out_s(self, robot: int, task: int) -> float:
        """Since when a robot has been on the way to the stop of a task, inf: not yet."""
        return float(self._since_s[robot]) if self.current[robot] == task else np.inf

    def _after_committed(self, r: int, committed: Sequence[int]) -> tuple[list[Leg], int, int]:
        """Stops that a robot makes on what it is committed to; then the task that it goes on with, and which of its stops."""
        task, nth, kept = int(self.current[r]), int(self.stop[r]), list[Leg]()
        if task == NONE:
            return kept, NONE, 0
        leaves, at = self.duties.of[r] == LEAVING, 0
        if leaves and self.serving[r]:
            nth += 1
        else:
            for leg in self._legs[r][: len(self._legs[r]) - (not leaves)]:
                if leg.vertex not in committed[at:]:
                    break
                at = list(committed).index(leg.vertex, at)
                kept.append(leg)
                task, nth = leg.task, leg.nth + 1
        if nth == len(self.tasks[task].stops):
            task, nth = int(self.then[r]) if task == self.current[r] else NONE, 0
        return kept, task, nth

    def _in_passing(self, at: int, task: int, nth: int) -> list[tuple[int, int]]:
        """Stops of a task that are made in passing, from a vertex and one of its stops on, and their vertices."""
        stops, passed, left = self.tasks[task].stops, [], self._ahead_steps
        while left > 0 and nth + 1 < len(stops) and not stops[nth].service_s and len(stops[nth].places) == 1:
            v = stops[nth].places[0]
            left -= int(distances(self.problem.graph).to(v)[at])
            if left > 0:
                passed.append((nth, v))
                at, nth = v, nth + 1
        return passed

    def _note(self, r: int, now_s: float, visits: Visits, booked_s: FloatArray) -> None:
        """Services that are over, and stops to which a robot has come."""
        if self.duties.of[r] in LOST:
            return
        if self.serving[r]:
            if self._until_s[r] > now_s + 1e-9:
                return
            self._end_stop(r, booked_s)
        reached, k = int(visits.reached[r]), int(self.seen[r])
        stands = k == reached == int(visits.granted[r])
        here = k if stands else int(visits.next[k]) if k != reached else NONE
        while here != NONE and self._legs[r]:
            while self._legs[r] and self._comes_to(r, here, visits):
                self._begin_stop(r, here, now_s, visits, booked_s)
                if self._until_s[r] > now_s + 1e-9:
                    return
                self._end_stop(r, booked_s)
            here = int(visits.next[here]) if here != reached else NONE

    def _comes_to(self, r: int, visit: int, visits: Visits) -> bool:
        """Whether a robot makes the next stop on its way at a visit."""
        leg = self._legs[r][0]
        if leg.vertex != visits.vertex[visit] or leg.task != self.current[r]:
            return False
        return bool(visit == visits.last[r] or not self.tasks[leg.task].stops[leg.nth].service_s)

    def _begin_stop(self, r: int, visit: int, now_s: float, visits: Visits, booked_s: FloatArray) -> None:
        """A service begins, also one that takes no time."""
        leg = self._legs[r].pop(0)
        begins_s, task = max(float(visits.arrived_s[visit]), float(self._earliest_s[r])), leg.task
        if leg.nth == 0:
            self.orders.pick(task, begins_s)
        takes_s = self._service_s(r)
        self._until_s[r] = begins_s + takes_s
        self._moved_s[r], self._came_s[r], self._wait_at[r] = begins_s, np.inf, NONE
        self._made_s = max(self._made_s, begins_s)
        places = self.tasks[task].stops[leg.nth].places
        self._num_before[[s for s in self._in_line(places) if self._came_s[s] < self._since_s[r]]] += 1
        self._note_stop(r, leg.vertex, begins_s, now_s, booked_s)
        if takes_s:
            if self._is_charge(r):
                self.duties.enter(r, CHARGING, begins_s)
            else:
                self.duties.enter(r, IN_SERVICE, begins_s, task)

    def _in_line(self, places: Sequence[int]) -> list[int]:
        """Robots that wait for some places."""
        waiting = np.flatnonzero(np.isfinite(self._came_s)).tolist()
        return [s for s in waiting if self.tasks[int(self.current[s])].stops[int(self.stop[s])].places == places]

    def _end_stop(self, r: int, booked_s: FloatArray) -> None:
        """A service is over; so is the task with its last."""
        over_s, task = float(self._until_s[r]), int(self.current[r])
        if self._is_charge(r):  # which may have been cut short
            self._set_end(r, over_s)
        self._until_s[r] = np.inf
        self._over_s[r] = self._since_s[r] = self._earliest_s[r] = self._moved_s[r] = over_s
        self._came_s[r], self._idle[r] = np.inf, _idle(booked_s)
        self.stop[r] += 1
        self.news |= bool(self.duties.of[r] != LEAVING)  # else what comes next has been asked for
        if self.stop[r] < len(self.tasks[task].stops):
            if self.duties.of[r] != TO_STOP:
                self.duties.enter(r, TO_STOP, over_s, task)
            return
        self.orders.finish(task, over_s)
        self.current[r] = NONE
        self.duties.enter(r, IDLE, over_s)
        if self.then[r] != NONE:
            task, self.then[r] = int(self.then[r]), NONE
            self.orders.begin(task, over_s)
            self._begin_task(r, task, over_s, over_s, booked_s)

    def _service_s(self, r: int) -> float:
        """How long the service at a robot's next stop takes."""
        if not self._is_charge(r):
            return self.tasks[int(self.current[r])].stops[int(self.stop[r])].service_s
        assert self._charging is not None
        return max(self._charging.least_s, self._charge_s(r, max(self._charging.maximum - float(self.level[r]), 0.0)))

    def _charge_s(self, r: int, share: float) -> float:
        """How long charging by a share of the capacity takes a robot."""
        return self._batteries[int(self.problem.fleet.kind[r])].charge_s(share) if self._batteries else 0.0

    def _set_end(self, r: int, end_s: float) -> None:
        """The stop that a robot makes ends at another time."""
        row = self._stops[self._row[r]]
        if row is not None:
            self._stops[self._row[r]] = row._replace(end_s=end_s)

    def _note_stop(self, r: int, vertex: int, begin_s: float, now_s: float, booked_s: FloatArray) -> None:
        """A service has begun. What was booked since then, until now, is none of the way there."""
        task, since_s = self.tasks[int(self.current[r])], float(self._since_s[r])
        stop = task.stops[int(self.stop[r])]
        stood_s, queued_s = (_idle(booked_s) - self._idle[r]).tolist()
        queued_s = min(max(queued_s - (now_s - begin_s), 0.0), begin_s - since_s)
        stood_s = min(stood_s, begin_s - since_s - queued_s)
        station, end_s = stop.station.name if stop.station else "", float(self._until_s[r])
        self._row[r] = len(self._stops)
        self._stops.append(StopRow(task.id, r, station, vertex, since_s, begin_s, end_s, stood_s, queued_s, task.due_s))

    def _see_who_charges(self, now_s: float, charging: Charging, booked_s: FloatArray) -> None:
        """Send robots to chargers whose batteries are low, and with `opportunity` those that have nothing to do; call others off."""
        level, charges = self.level, np.array([self._is_charge(r) for r in range(len(self.current))], np.bool_)
        due = (level <= charging.critical) | self._charges_first
        self._charges_first = np.zeros(len(level), np.bool_)
        for r in np.flatnonzero(due & ~charges & ~self.out).tolist():
            if self._has_yet_to_begin(r):
                self._take_back(r, now_s)
            if self.current[r] == NONE:
                self._charge(r, now_s, charging, booked_s)
        if not charging.opportunity:
            return
        free = np.flatnonzero((self.current == NONE) & ~self.out).tolist()
        idle = max(0, len(free) - len(self.orders.waiting))
        room = len(charging.station.places) - sum(self._is_charge(r) for r in range(len(self.current)))
        for r in sorted(free, key=lambda r: (level[r], r))[: max(0, min(idle, room))]:
            if self._charge_s(r, charging.maximum - float(level[r])) >= max(charging.least_s, LEAST_CHARGE_S):
                self._charge(r, now_s, charging, booked_s)
        ready = np.flatnonzero(self.at_charger & (level >= charging.minimum)).tolist()
        wanted = max(0, len(self.orders.waiting) - len(free))
        for r in sorted((r for r in ready if now_s - self._begun_s(r) >= charging.least_s), key=lambda r: (-level[r], r))[:wanted]:
            self._until_s[r] = now_s
            self._end_stop(r, booked_s[r])

    def _charge(self, r: int, now_s: float, charging: Charging, booked_s: FloatArray) -> None:
        """A robot gets the task to charge."""
        stop = Stop(charging.station.places[0], self._charge_s(r, 1.0 - float(self.level[r])), CHARGE, charging.station)
        task = self.orders.charge(r, stop, f"{CHARGE}_{self._num_charges}", now_s)
        self._num_charges += 1
        self._begin_task(r, task, now_s, now_s, booked_s[r])
        self.news = True

    def _begun_s(self, r: int) -> float:
        return self.orders.opened_s(int(self.current[r]))

    @property
    def _some_could_take_it(self) -> bool:
        """Whether a new order changes anything now: a robot is free, or may change the order it has for another."""
        return bool(len(self.free)) or any(self.may_pass_on(r) for r in range(len(self.current)))

    def _cancel(self, now_s: float) -> None:
        """Withdraw orders that nobody has picked in time."""
        late = [k for k in self.orders.not_picked if self.orders.last_chance_s(k) <= now_s]
        for task in late:
            robot, at_s = self.orders.robot[task], self.orders.last_chance_s(task)
            if robot != NOBODY and self.then[robot] == task:
                self.then[robot] = NONE
            elif robot != NOBODY:
                self._free(robot, now_s)
            why = f"not picked up by {at_s:g} s"
            self.orders.cancel(task, at_s, why)
            self._events.append(Event(at_s, "cancelled", robot, text=f"order '{self.tasks[task].name}': {why}"))
            self.news = True

    def _see_who_is_broken(self, now_s: float, down_until_s: FloatArray, visits: Visits) -> None:
        """Robots break down, for a while or for good, and go on."""
        broken = self.duties.are(BROKEN)
        for r in np.flatnonzero((down_until_s > now_s) & ~self.out).tolist():
            if down_until_s[r] == np.inf:
                self.lose(r, now_s, BROKEN, visits)
                continue
            if self._has_yet_to_begin(r):
                self._take_back(r, now_s)
            self._give_up_next(r)
            charge, task = self._is_charge(r), int(self.current[r])
            if self.serving[r]:
                self._until_s[r] += down_until_s[r] - now_s
                self._set_end(r, float(self._until_s[r]))
                self._resumes[r] = CHARGING if charge else IN_SERVICE
            else:
                self._resumes[r] = IDLE if task == NONE else TO_CHARGER if charge else TO_STOP
            self.duties.enter(r, BROKEN, now_s, NONE if charge else task)
            self.news = True
        for r in np.flatnonzero(broken & (down_until_s <= now_s) & (self._resumes < BROKEN)).tolist():
            self.duties.enter(r, int(self._resumes[r]), float(down_until_s[r]), NONE if self._is_charge(r) else int(self.current[r]))
            self._moved_s[r], self.news = now_s, True

    def _see_who_waits(self, visits: Visits) -> None:
        """Note since when robots have been as near to a place as where they were sent to wait, though they make room for others there."""
        for r in np.flatnonzero((self._wait_at != NONE) & np.isinf(self._came_s)).tolist():
            reached, stop = int(visits.reached[r]), self.tasks[int(self.current[r])].stops[int(self.stop[r])]
            away, at_most = (self._places.away(r, int(v), stop) for v in (visits.vertex[reached], self._wait_at[r]))
            if away <= at_most:
                self._came_s[r], self._num_before[r] = max(float(visits.arrived_s[reached]), float(self._since_s[r])), 0

    def _see_who_leaves(self, now_s: float, visits: Visits, state: State) -> None:
        """Robots whose ways on can be asked for: they will be done with what they are at when what is asked for now takes effect."""
        for r in np.flatnonzero(self.duties.are(IN_SERVICE, CHARGING) & (self._until_s <= now_s + self.lead_s + 1e-9)).tolist():
            self.duties.enter(r, LEAVING, now_s)
            self.news = True
        for r in self._passing(visits):
            if visits.granted[r] == visits.last[r] and self._is_near(r, visits, state):
                self.duties.enter(r, LEAVING, now_s)
                self.news = True

    def _passing(self, visits: Visits) -> list[int]:
        """Robots on the way to stops without service, at the last of which their ways end."""
        to_stop = (r for r in np.flatnonzero(self.duties.are(TO_STOP)).tolist() if self._legs[r] and self.then[r] == NONE)
        return [r for r in to_stop if self._legs[r][-1].vertex == visits.vertex[visits.last[r]] and not self._takes_s(self._legs[r][-1])]

    def _takes_s(self, leg: Leg) -> float:
        return self.tasks[leg.task].stops[leg.nth].service_s

    def _is_near(self, r: int, visits: Visits, state: State) -> bool:
        """Whether a robot would have to brake soon after what is asked for now takes effect, if it had to stop."""
        return bool(visits.at_m[visits.last[r]] - state.motion.s_m[r] <= self._near_m(r) + 1e-9)

    def _near_m(self, r: int) -> float:
        top, decel = float(self.problem.fleet.max_speed_mps[r]), float(self.problem.fleet.decel_mps2[r])
        return top * (self.lead_s + SLACK_S) + top**2 / (2 * decel)

    def _see_who_stalls(self, now_s: float, visits: Visits, state: State) -> None:
        """Robots with work that have not got on for long, for nothing that the work itself asks for."""
        gets_on = (state.motion.speed_mps > 0) | state.motion.turning | self.serving | (self.current == NONE)
        self._moved_s[gets_on] = now_s
        self._see_whether_work_stands(now_s)
        lost_at, gone_at = (set(visits.vertex[visits.reached[lost]].tolist()) for lost in (self.out, self._resumes >= BROKEN))
        for r in np.flatnonzero(self.duties.are(TO_STOP, TO_CHARGER, STALLED)).tolist():
            task = NONE if self._is_charge(r) else int(self.current[r])
            if self.duties.of[r] == STALLED:
                if self._moved_s[r] == now_s:
                    self.duties.enter(r, TO_CHARGER if self._is_charge(r) else TO_STOP, now_s, task)
            elif now_s - self._moved_s[r] >= STALLED_S:
                if self._waits_for_work(r, state, lost_at):
                    self._moved_s[r] = now_s
                    continue
                self.duties.enter(r, STALLED, now_s, task)
                if task != NONE and gone_at.issuperset(self.tasks[task].stops[int(self.stop[r])].places):
                    self._free(r, now_s)
                    self._fail(task, now_s, "a robot that is lost stands where its next stop is", r)
                    self.news = True
                    continue
                doing = "its way to a charger" if task == NONE else f"order '{self.tasks[task].name}'"
                self._events.append(Event(now_s, "stalled", r, text=f"has not got on with {doing} for {STALLED_S:g} s"))

    def _see_whether_work_stands(self, now_s: float) -> None:
        """Say once that no stop has been made for long, though robots have orders and none is served or about to be mended."""
        at_work = np.flatnonzero((self.current != NONE) & ~self.out).tolist()
        if self._gets_done:
            self._made_s = now_s
        stood_s = now_s - self._made_s
        if stood_s < STANDS_S or self._work_stands:
            self._work_stands &= stood_s >= STANDS_S
            return
        stops = (self.tasks[int(self.current[r])].stops[int(self.stop[r])] for r in at_work)
        drives_s = self.problem.step_s * max(self._places.farthest(r, stop) for r, stop in zip(at_work, stops))
        if stood_s >= STANDS_S + LATE * drives_s:
            self._work_stands = True
            text = f"no stop has been made since {self._made_s:.0f} s, and {self.orders.num_open} orders are open"
            self._events.append(Event(now_s, "stalled", NOBODY, text=text))

    @property
    def _gets_done(self) -> bool:
        """Whether robots are being served, will be mended, or have no orders."""
        mended_later = (self.duties.are(BROKEN) & (self._resumes < BROKEN)).any()
        at_work = (self.current != NONE) & ~self.out
        return bool(self.serving.any() or mended_later or np.isinf(self.orders.open_since_s) or not at_work.any())

    def _waits_for_work(self, robot: int, state: State, lost_at: set[int]) -> bool:
        """Whether a robot that stands will get on by itself: the last of those that it waits for gets on, or is being served."""
        r, seen, other, cause = robot, set[int](), state.grants.other, state.grants.cause
        while r not in seen:
            seen.add(r)
            if self.duties.of[r] in LOST or (r != robot and self.current[r] == NONE):
                return False
            if r != robot and self._moved_s[r] > self._looked_s - STALLED_S / 2:
                return True
            if np.isfinite(self._came_s[r]):  # in line: for one of those who are at the places
                stop = self.tasks[int(self.current[r])].stops[int(self.stop[r])]
                return self._places.can_come(r, int(self._wait_at[r]), stop, lost_at)
            if cause[r] in (PLANNED, FACILITY):
                return True
            if other[r] < 0:
                return False
            r = int(other[r])
        return False

    def _next_change_s(self, now_s: float, visits: Visits, state: State) -> float:
        """When something will have changed that is known by now."""
        ends_s = np.where(self.busy & ~self.out, self._until_s - self.lead_s, self._until_s)
        times = [self._again_s, self.orders.next_release_s, *ends_s[~self.out].tolist()]
        if self.orders.rules.cancel:
            times += [self.orders.last_chance_s(k) for k in self.orders.not_picked]
        for r in self._passing(visits):
            if state.motion.speed_mps[r] > 0:
                left_m = float(visits.at_m[visits.last[r]] - state.motion.s_m[r]) - self._near_m(r)
                times.append(now_s + max(left_m / float(self.problem.fleet.max_speed_mps[r]), 1e-6))
        return min((t for t in times if t > now_s), default=np.inf)


def _idle(booked_s: FloatArray) -> FloatArray:
    """[2] of a robot's time: s stood on its way, and where it was sent."""
    return np.array([booked_s[STANDS].sum(), booked_s[AT_GOAL]])
