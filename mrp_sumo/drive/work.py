"""Work: the tasks of a run as they become known and are done, who has which, and how far it is.

A robot makes its task's stops one after the other, each at a place of the stop's station that no other robot is at or on its way to; it
stays there for the service time, or goes by where that is none and the planner knows stops ahead. Where no place is free it goes to one of
the station's places to wait, or near them. Robots without work stay where they are, unless somebody has to come there.
"""

import heapq
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

import numpy as np

from mrp_sumo.core.battery import Battery, Charging
from mrp_sumo.core.digraph import strong_components
from mrp_sumo.core.execution import BOOKINGS
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, PlanGraph, frozen
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.request import Request, with_stops_before
from mrp_sumo.core.stream import TaskList, TaskSource
from mrp_sumo.core.task import CHARGE, NOBODY, Stop, StopLog, Task, TaskLog
from mrp_sumo.core.visits import Visits
from mrp_sumo.errors import PlugInError
from mrp_sumo.search.distance import UNREACHABLE, distances

NONE = -1
STANDS = [BOOKINGS.index(name) for name in ("planned_wait", "dependency_wait", "yielding", "blocked", "disturbed")]
AT_GOAL = BOOKINGS.index("at_goal")
LEAST_CHARGE_S = 60.0  # for less nobody goes to charge that need not
TRY_AGAIN_S = 2.0  # after a request that had no answer


@dataclass(frozen=True, eq=False)
class WorkRequest(Request):
    """A request for ways to the stops of tasks."""

    given: Mapping[int, int] = field(default_factory=dict)  # tasks, by the robots that are to have them
    task: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))  # [K] whose stop each robot is to make, -1: none
    nth: IntArray = field(default_factory=lambda: np.zeros(0, np.int64))  # [K] and which of the task's


class Work:
    """Tasks of R robots; `tasks` are those that are known by now, numbered by release."""

    def __init__(
        self,
        sources: Sequence[TaskSource],
        problem: Problem,
        lead_s: float = 0.0,
        *,
        parking: Sequence[int] = (),
        batteries: Sequence[Battery] = (),
        charging: Charging | None = None,
        ahead_steps: int = 0,
    ) -> None:
        """`ahead_steps` is how far the planner wants to know stops at which nothing is to be done; with 0 robots stop at each."""
        num_robots = problem.num_robots
        self.out = np.zeros(num_robots, np.bool_)  # [R] robots that will never go on
        self._parking, self._batteries, self._charging = parking, batteries, charging
        self._charges = np.zeros(num_robots, np.bool_)  # [R] whether the task is to charge
        self.level = np.ones(num_robots)  # [R] states of charge
        self._num_charges = 0
        self._row = np.zeros(num_robots, np.int64)  # [R] that of each robot's last stop in the log
        self.problem = problem
        self.tasks: list[Task] = []
        self.current = np.full(num_robots, NONE)  # [R] the task of each robot
        self.stop = np.zeros(num_robots, np.int64)  # [R] its stop that is to be made next
        self.serving = np.zeros(num_robots, np.bool_)  # [R] whether it is being made
        self.lead_s = lead_s  # what is asked for takes effect so much later: services that are over by then count as over
        self._leaving = np.zeros(num_robots, np.bool_)  # [R] whether it is being made, and will be over by then
        self.news = True  # whether something has changed since the last request
        self._until_s = np.full(num_robots, np.inf)  # [R] when the service is over
        self._since_s = np.zeros(num_robots)  # [R] before which the stop cannot have been made
        self._aim = np.full(num_robots, NONE)  # [R] vertex where it is to be made; -1: the robot is on its way to no stop
        self._aims_at = np.zeros(num_robots, np.int64)  # [R] and which of its task's stops that is
        self._ahead_steps = ahead_steps
        self.seen = np.arange(num_robots)  # [R] the last visit of each robot that has been looked at
        self._idle = np.zeros((num_robots, 2))  # [R, 2] s that each had stood on its way, and where it was sent, when it set out
        self._stops: list[tuple[int, int, str, int, float, float, float, float, float, float]] = []  # rows of the `StopLog`
        self._robot: list[int] = []
        self._times: dict[str, list[float]] = {"released_s": [], "assigned_s": [], "opened_s": [], "done_s": []}
        self._waiting: list[int] = []  # tasks that nobody has, by urgency
        listed = bool(sources) and isinstance(sources[0], TaskList)
        self._sources = [_Source(source.tasks(), source.num_open) for source in (sources if listed else (TaskList(()), *sources))]
        self._listed = self._sources[0]  # in which tasks may be put that are added while robots drive
        self._again_s = 0.0
        self._outwards: dict[tuple[PlanGraph, int], tuple[int, ...]] = {}  # vertices by their distance from one, found once
        self._piece: dict[int, IntArray] = {}  # [V] strong components of the graphs of types

    @property
    def unassigned(self) -> Sequence[int]:
        """Tasks that no robot has: the most urgent first, then the oldest."""
        return sorted(self._waiting, key=lambda k: (-self.tasks[k].priority, k))

    @property
    def free(self) -> IntArray:
        """Robots without a task, ascending; also those whose last service will be over when what is asked for now takes effect."""
        last = [bool(self._leaving[r]) and self._is_last(r) for r in range(len(self.current))]
        return np.flatnonzero(((self.current == NONE) | np.array(last, np.bool_)) & ~self.out)

    @property
    def busy(self) -> BoolArray:
        """[R] who is being served, and still will be when what is asked for now takes effect."""
        return self.serving & ~self._leaving

    @property
    def endless(self) -> bool:
        """Whether more tasks will come."""
        return any(source.next is not None for source in self._sources)

    @property
    def all_done(self) -> bool:
        """Whether no task is left, and none will come."""
        return not self._waiting and bool(((self.current == NONE) | self._charges).all()) and not self.endless

    @property
    def at_charger(self) -> BoolArray:
        """[R] robots that are being charged."""
        return self._charges & self.serving

    def update(self, now_s: float, visits: Visits, booked_s: FloatArray, level: FloatArray | None = None) -> None:
        """Note what robots have done by now; reveal tasks; see who has to charge.

        Parameters
        ----------
        booked_s
            [R, 8] what their time was spent on (`core.execution.BOOKINGS`).
        level
            [R] states of charge, where robots have batteries.
        """
        if level is not None:
            self.level = level
        for r in np.flatnonzero(self.current != NONE).tolist():
            if self._ahead_steps:
                self._pass_stops(r, now_s, visits, booked_s[r])
            self._note(r, now_s, visits, booked_s[r])
        self.seen[:] = visits.reached
        self._reveal(now_s)
        if level is not None and self._charging is not None:
            self._see_who_charges(now_s, self._charging, booked_s)
        if now_s >= self._again_s:
            self.news, self._again_s = True, np.inf

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
        passed_on = np.isin(self.current, list(given.values())) | np.isin(np.arange(len(self.current)), list(given))
        keeps = (self.current != NONE) & ~passed_on
        nth = self.stop + self._leaving
        for r in np.flatnonzero(keeps & self._leaving).tolist():
            keeps[r] = not self._is_last(r)
        nth[~keeps] = 0
        stop: dict[int, Stop] = {}
        via: dict[int, Sequence[int]] = {}
        for r in (*given, *np.flatnonzero(keeps & ~self.busy & ~self.out).tolist()):
            stops = self.tasks[given.get(r, int(self.current[r]))].stops
            nth[r], via[r] = self._ahead(committed[r], stops, int(nth[r]))
            stop[r] = stops[int(nth[r])]
        vertex, made = self._aims(start, stop, given)
        robots = np.flatnonzero(~self.busy & ~self.out)
        task = np.array([given.get(r, int(self.current[r]) if keeps[r] else NONE) for r in robots.tolist()], np.int64)
        nth = nth[robots]
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
            task=np.where(made[robots], task, NONE),
            nth=nth,
        )
        return with_stops_before(request, [via.get(r, ()) for r in robots.tolist()])

    def accepted(self, request: WorkRequest, now_s: float, booked_s: FloatArray) -> None:
        """Robots are on the ways that were asked for; `booked_s` as for `update`."""
        given = {r: k for r, k in request.given.items() if self._may_take(r, k)}
        taken_back = {other for r, task in given.items() for other in (r, self._robot[task]) if other != NOBODY}
        freed = [self._take_back(robot) for robot in sorted(taken_back) if self.current[robot] != NONE]
        for r, task in given.items():
            self.current[r], self.stop[r], self._since_s[r] = task, 0, request.now_s
            self._idle[r] = _idle(booked_s[r])
            self._robot[task], self._times["assigned_s"][task] = r, request.now_s
            self._waiting.remove(task)
        self.news |= len(given) < len(request.given) or any(self._robot[k] == NOBODY for k in freed)
        for r, vertex, task, nth in zip(*(column.tolist() for column in (request.robot, request.end, request.task, request.nth))):
            if not self.serving[r]:
                asked = task != NONE and task == self.current[r] and nth >= self.stop[r]
                self._aim[r], self._aims_at[r] = vertex if asked else NONE, nth

    def failed(self, now_s: float) -> None:
        """There was no answer to a request: it is made again in a while."""
        self._again_s = now_s + TRY_AGAIN_S

    def add(self, task: Task) -> None:
        """Have a task that nobody knew of, among those that are listed with times of their own."""
        self._listed.add(task)

    def log(self) -> TaskLog:
        """What has become of the tasks."""
        times = {name: frozen(np.array(column, np.float64)) for name, column in self._times.items()}
        names, kinds = (tuple(getattr(task, key) for task in self.tasks) for key in ("name", "kind"))
        return TaskLog(names, frozen(np.array(self._robot, np.int64)), **times, kind=kinds)

    def stops_made(self) -> StopLog:
        """The stops that were made, by task."""
        rows = sorted(self._stops, key=lambda row: (row[0], row[4]))
        task, robot, station, vertex, *times = zip(*rows) if rows else [()] * 10
        numbers = [frozen(np.array(column, np.int64)) for column in (task, robot, vertex)]
        return StopLog(numbers[0], numbers[1], station, numbers[2], *(frozen(np.array(column, np.float64)) for column in times))

    def can_do(self, robot: int, task: int) -> bool:
        """Whether a robot is of the type that a task needs, and has room on the way to its stops."""
        needed, types = self.tasks[task].robot_type, self.problem.fleet.type_name
        return (not needed or types[robot] == needed) and self._has_room(robot, task)

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

    def some_cannot(self, task: int) -> bool:
        """Whether a task is not for every robot."""
        return bool(self.tasks[task].robot_type) or self.problem.barred is not None

    def may_pass_on(self, robot: int) -> bool:
        """Whether a robot has a task and has not come to its first stop."""
        return bool(self.current[robot] != NONE and self.stop[robot] == 0 and not self.serving[robot] and not self._charges[robot])

    def lose(self, robot: int) -> None:
        """A robot will never go on: a task that it has not begun goes to others."""
        if self.may_pass_on(robot):
            self._take_back(robot)
        self.out[robot] = self.news = True

    def serving_until_s(self, robot: int) -> float:
        """When the service that a robot is at will be over; inf: it is at none."""
        return float(self._until_s[robot])

    def _may_take(self, robot: int, task: int) -> bool:
        """Whether a robot may still be given a task: both may have come to a first stop since it was decided."""
        holder = self._robot[task]
        held = holder != NOBODY and self.current[holder] == task
        return (self.current[robot] == NONE or self.may_pass_on(robot)) and (not held or self.may_pass_on(holder))

    def _take_back(self, robot: int) -> int:
        """The robot's task, which has not been begun, waits again."""
        task = int(self.current[robot])
        self.current[robot], self._aim[robot], self._robot[task] = NONE, NONE, NOBODY
        self._times["assigned_s"][task] = np.nan
        self._waiting.append(task)
        return task

    def _is_last(self, robot: int) -> bool:
        """Whether its next stop is its task's last."""
        return int(self.stop[robot]) + 1 == len(self.tasks[int(self.current[robot])].stops)

    def _next(self, robot: int) -> Stop:
        return self.tasks[int(self.current[robot])].stops[int(self.stop[robot])]

    def _ahead(self, committed: Sequence[int], stops: Sequence[Stop], nth: int) -> tuple[int, Sequence[int]]:
        """Which of its task's stops a robot's way is to end at, and the vertices of those that it makes in passing before."""
        via: list[int] = []
        for v in committed:
            while self._is_passed(stops, nth) and stops[nth].places[0] == v:
                nth += 1
        at, left = committed[-1], self._ahead_steps
        while self._is_passed(stops, nth):
            v = stops[nth].places[0]
            left -= int(distances(self.problem.graph).to(v)[at])
            if left <= 0:
                break
            via.append(v)
            at, nth = v, nth + 1
        return nth, via

    def _is_passed(self, stops: Sequence[Stop], nth: int) -> bool:
        """Whether a stop of a task is made in passing: at one place, for no time, and not its last."""
        return bool(self._ahead_steps) and nth + 1 < len(stops) and not stops[nth].service_s and len(stops[nth].places) == 1

    def _pass_stops(self, r: int, now_s: float, visits: Visits, booked_s: FloatArray) -> None:
        """Note stops that were made in passing."""
        stops, reached, k = self.tasks[int(self.current[r])].stops, int(visits.reached[r]), int(self.seen[r])
        stands = k == reached == int(visits.granted[r])
        here = k if stands else int(visits.next[k]) if k != reached else NONE
        while here != NONE:
            while self._is_passed(stops, int(self.stop[r])) and stops[int(self.stop[r])].places[0] == visits.vertex[here]:
                begins_s = max(float(visits.arrived_s[here]), float(self._since_s[r]))
                if np.isnan(self._times["opened_s"][int(self.current[r])]):
                    self._times["opened_s"][int(self.current[r])] = begins_s
                self._until_s[r] = begins_s
                self._note_stop(r, int(visits.vertex[here]), begins_s, now_s, booked_s)
                self._since_s[r], self._until_s[r], self._idle[r] = begins_s, np.inf, _idle(booked_s)
                self.stop[r] += 1
                self.news = True
            here = int(visits.next[here]) if here != reached else NONE

    def _note(self, r: int, now_s: float, visits: Visits, booked_s: FloatArray) -> None:
        """Arrivals, and services that are over."""
        last = visits.last[r]
        aims = self._aim[r] != NONE and self._aims_at[r] == self.stop[r]
        if not self.serving[r] and aims and visits.reached[r] == last and visits.vertex[last] == self._aim[r]:
            begins_s = max(float(visits.arrived_s[last]), float(self._since_s[r]))
            opened_s = self._times["opened_s"]
            if np.isnan(opened_s[self.current[r]]):
                opened_s[self.current[r]] = begins_s
            self.serving[r], self._until_s[r] = True, begins_s + self._service_s(r)
            self._note_stop(r, int(visits.vertex[last]), begins_s, now_s, booked_s)
        if self.serving[r] and not self._leaving[r] and self._until_s[r] <= now_s + self.lead_s + 1e-9:
            self._leaving[r] = self.news = True
        if not self.serving[r] or self._until_s[r] > now_s:
            return
        over_s, task = float(self._until_s[r]), int(self.current[r])
        self.serving[r], self._leaving[r], self._until_s[r], self._since_s[r], self._aim[r] = False, False, np.inf, over_s, NONE
        if self._charges[r]:  # which may have been cut short
            row = self._stops[self._row[r]]
            self._stops[self._row[r]] = (*row[:6], over_s, *row[7:])
        self.stop[r] += 1
        self._charges[r] = False
        self._idle[r] = _idle(booked_s)
        if self.stop[r] == len(self.tasks[task].stops):
            self._times["done_s"][task] = over_s
            self.current[r] = NONE
            for source in self._sources:
                source.done(task)

    def _service_s(self, r: int) -> float:
        """How long the service at a robot's next stop takes."""
        if not self._charges[r]:
            return self._next(r).service_s
        assert self._charging is not None
        return max(self._charging.least_s, self._charge_s(r, max(self._charging.maximum - float(self.level[r]), 0.0)))

    def _charge_s(self, r: int, share: float) -> float:
        """How long charging by a share of the capacity takes a robot."""
        return self._batteries[int(self.problem.fleet.kind[r])].charge_s(share) if self._batteries else 0.0

    def _see_who_charges(self, now_s: float, charging: Charging, booked_s: FloatArray) -> None:
        """Send robots to chargers whose batteries are low, and with `opportunity` those that have nothing to do; call others off."""
        level = self.level
        for r in np.flatnonzero((level <= charging.critical) & ~self._charges & ~self.out).tolist():
            if self.may_pass_on(r):
                self._take_back(r)
            if self.current[r] == NONE:
                self._charge(r, now_s, charging, booked_s)
        if not charging.opportunity:
            return
        free = np.flatnonzero((self.current == NONE) & ~self.out).tolist()
        idle = max(0, len(free) - len(self._waiting))
        room = len(charging.station.places) - int(self._charges.sum())
        for r in sorted(free, key=lambda r: (level[r], r))[: max(0, min(idle, room))]:
            if self._charge_s(r, charging.maximum - float(level[r])) >= max(charging.least_s, LEAST_CHARGE_S):
                self._charge(r, now_s, charging, booked_s)
        ready = np.flatnonzero(self.at_charger & (level >= charging.minimum)).tolist()
        wanted = max(0, len(self._waiting) - len(free))
        for r in sorted((r for r in ready if now_s - self._begun_s(r) >= charging.least_s), key=lambda r: (-level[r], r))[:wanted]:
            self._until_s[r] = now_s  # noted when robots are looked at next

    def _charge(self, r: int, now_s: float, charging: Charging, booked_s: FloatArray) -> None:
        """A robot gets the task to charge."""
        number = len(self.tasks)
        stop = Stop(
            charging.station.places[0],
            self._charge_s(r, 1.0 - float(self.level[r])),
            CHARGE,
            charging.station,
        )
        self.tasks.append(Task(number, (stop,), now_s, robot=r, name=f"{CHARGE}_{self._num_charges}", kind=CHARGE))
        self._num_charges += 1
        self._robot.append(r)
        for name, column in self._times.items():
            column.append(now_s if name in ("released_s", "assigned_s") else np.nan)
        self.current[r], self.stop[r], self._since_s[r], self._aim[r], self._charges[r] = number, 0, now_s, NONE, True
        self._idle[r] = _idle(booked_s[r])
        self.news = True

    def _begun_s(self, r: int) -> float:
        return self._times["opened_s"][int(self.current[r])]

    def _note_stop(self, r: int, vertex: int, begin_s: float, now_s: float, booked_s: FloatArray) -> None:
        """A service has begun. What was booked since then, until now, is none of the way there."""
        task, stop, since_s = self.tasks[int(self.current[r])], self._next(r), float(self._since_s[r])
        stood_s, queued_s = (_idle(booked_s) - self._idle[r]).tolist()
        queued_s = min(max(queued_s - (now_s - begin_s), 0.0), begin_s - since_s)
        stood_s = min(stood_s, begin_s - since_s - queued_s)
        station, end_s = stop.station.name if stop.station else "", float(self._until_s[r])
        self._row[r] = len(self._stops)
        self._stops.append((task.id, r, station, vertex, since_s, begin_s, end_s, stood_s, queued_s, task.due_s))

    def _reveal(self, now_s: float) -> None:
        for source in self._sources:
            while (task := source.take(now_s, len(self.tasks))) is not None:
                known_s = now_s if source.num_open else task.release_s  # a due time goes with it
                self.tasks.append(replace(task, id=len(self.tasks), release_s=known_s, due_s=task.due_s - task.release_s + known_s))
                self._robot.append(NOBODY)
                for name, column in self._times.items():
                    column.append(known_s if name == "released_s" else np.nan)
                self._waiting.append(len(self.tasks) - 1)
                self.news = True

    def _aims(self, start: IntArray, stops: Mapping[int, Stop], given: Mapping[int, int]) -> tuple[IntArray, BoolArray]:
        """[R] where robots are to go, all different, and whether they can make their stops there. Who is near chooses first."""
        known = [distances(graph) for graph in self.problem.graph_of_kind]
        of, vertex, made = [known[k] for k in self.problem.fleet.kind.tolist()], start.copy(), np.zeros(len(start), np.bool_)
        stays = self.busy | self.out
        taken = set(start[stays].tolist())
        away = {r: min(int(of[r].to(v)[start[r]]) for v in stop.places) for r, stop in stops.items()}
        around: dict[int, int] = {r: int(start[r]) for r in range(len(start)) if not stays[r]}  # vertices to be near to
        for r in sorted(stops, key=lambda r: (away[r], given.get(r, int(self.current[r])))):
            for makes, choice in ((True, stops[r].places), (False, stops[r].queue)):
                free = [(int(of[r].to(v)[start[r]]), v) for v in choice if v not in taken]
                if free and min(free)[0] < UNREACHABLE:
                    vertex[r], made[r] = min(free)[1], makes
                    taken.add(int(vertex[r]))
                    del around[r]
                    break
            else:
                around[r] = stops[r].places[0] if away[r] < UNREACHABLE else int(start[r])
        for r in sorted(set(around) - set(stops)):
            parking = [(int(of[r].to(v)[start[r]]), v) for v in self._parking if v not in taken]
            if parking and min(parking)[0] < UNREACHABLE:
                vertex[r] = min(parking)[1]
                taken.add(int(vertex[r]))
                del around[r]
        stood_on = set(start.tolist())
        for r, centre in sorted(around.items(), key=lambda item: item[0] not in stops):  # without a place, then without work
            vertex[r] = self._resting_place(r, int(start[r]), centre, taken, stood_on)
            taken.add(int(vertex[r]))
        return vertex, made

    def _resting_place(self, r: int, at: int, centre: int, taken: set[int], stood_on: set[int]) -> int:
        """The vertex nearest to another that nobody needs, where best nobody is; not before its doorstep, if a robot waits for it."""
        if at == centre and at not in taken:
            return at
        graph, doorstep = self.problem.graph_of_kind[int(self.problem.fleet.kind[r])], set[int]()
        if at != centre:
            doorstep = {centre, *graph.head[graph.first[centre] : graph.first[centre + 1]].tolist()}
        if (graph, centre) not in self._outwards:
            self._outwards[graph, centre] = tuple(_outwards(graph, centre))
        free = (v for v in self._outwards[graph, centre] if v not in taken)
        nearest = next(free)
        passed = graph.vertex_options
        clear = (v for v in chain((nearest,), free) if v not in doorstep and not passed[v].get("is_passthrough_point"))
        return next((v for v in clear if v == at or v not in stood_on), nearest)


class _Source:
    """A stream, the task that it gives next, and how many of its tasks are known and not done."""

    def __init__(self, tasks: Iterator[Task], num_open: int) -> None:
        self._tasks, self.num_open = tasks, num_open  # 0: tasks have times of their own
        self._known: set[int] = set()
        self.next = next(tasks, None)

    def take(self, now_s: float, number: int) -> Task | None:
        """The next task, if it is to be known by now; `number` is what it is called."""
        task = self.next
        if task is None or (len(self._known) >= self.num_open if self.num_open else task.release_s > now_s + 1e-9):
            return None
        self._known.add(number)
        self.next = next(self._tasks, None)
        return task

    def add(self, task: Task) -> None:
        """Add one to a finite source without an open number, by its time."""
        rest = [] if self.next is None else [self.next, *self._tasks]
        self._tasks = iter(sorted([*rest, task], key=lambda each: each.release_s))
        self.next = next(self._tasks)

    def done(self, number: int) -> None:
        self._known.discard(number)


def _idle(booked_s: FloatArray) -> FloatArray:
    """[2] of a robot's time: s stood on its way, and where it was sent."""
    return np.array([booked_s[STANDS].sum(), booked_s[AT_GOAL]])


def _outwards(graph: PlanGraph, start: int) -> Iterator[int]:
    """Vertices by their distance from one, then all others."""
    seen, heap = set[int](), [(0.0, start)]
    while heap:
        cost, v = heapq.heappop(heap)
        if v in seen:
            continue
        seen.add(v)
        yield v
        for lane in range(int(graph.first[v]), int(graph.first[v + 1])):
            heapq.heappush(heap, (cost + float(graph.length_m[lane]), int(graph.head[lane])))
    yield from (v for v in range(graph.num_vertices) if v not in seen)
