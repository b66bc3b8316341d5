"""Timetable of robots: their paths, found one by one, each around those that are there, taken out again, and made a Plan."""

from dataclasses import dataclass, replace
from weakref import WeakKeyDictionary

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray, PlanGraph, frozen
from mrp_sumo.core.plan import Plan, plan_of_visits
from mrp_sumo.core.problem import Problem
from mrp_sumo.search._records import FOREVER, NO_PATH, OK, SCRATCH_FULL
from mrp_sumo.traffic.resources import Resources, resources_of
from planners.safe_interval import _search, _table
from planners.safe_interval._rays import ARRIVED_M, steps_of_last_turn, steps_of_turn
from planners.safe_interval.moves import Moves, moves_of

WHOLE = 1 << 40  # more entries than any search has


@dataclass(frozen=True, eq=False)
class TimedPath:
    """Path of one robot: its runs, and what it holds."""

    runs: IntArray  # [K, 3] first lane, number of lanes, step at which it sets out
    resource: IntArray  # [H]
    begin: IntArray  # [H] steps, half-open
    end: IntArray  # [H]
    steps: int  # until it stands at its goal, turned as it is to stay there


class Timetable:
    """The ways of R robots around each other."""

    def __init__(self, problem: Problem, dt: float) -> None:
        graph, fleet = problem.graph, problem.fleet
        self.problem, self.dt = problem, dt
        self.resources = resources_of(graph, fleet.apart_m)
        limits = np.stack([fleet.max_speed_mps, fleet.accel_mps2, fleet.decel_mps2, fleet.turn_rate_rad_s, fleet.kind], 1)
        kinds, kind = np.unique(limits, axis=0, return_inverse=True)
        self.kind = kind.reshape(-1)  # [R]
        self.moves = [known_moves(problem, self.resources, tuple(row[:4].tolist()), dt, int(row[4])) for row in kinds]
        num_robots, num_lanes = problem.num_robots, graph.num_lanes
        self.at_rest = np.full((num_robots, num_lanes), _search.FAR, np.int32)
        self.facing = np.full((num_robots, num_lanes), _search.FAR, np.int32)
        self.alone = np.zeros(num_robots, np.int64)  # [R] steps without others, FAR: no way
        self.path: list[TimedPath | None] = [None] * num_robots
        self._start, self._goal = problem.start.tolist(), problem.target.tolist()
        self._start_rad, self._goal_rad = problem.heading_at_start.tolist(), problem.heading_at_target.tolist()
        self.table = _table.empty_table(graph.num_vertices + self.resources.num_zones, 64 * graph.num_vertices)
        self.scratch = _search.new_scratch(1 << 10, num_lanes)
        self.work = 0  # entries that searches have looked at
        self.exhausted = False  # whether the last search has looked at everything
        self._protected_steps = 0
        self._nobody = _table.empty_table(len(self.table.row), 0)
        self._heap = np.zeros(64 * num_lanes + 64, np.int64)
        self._lanes, self._stack = np.zeros(num_lanes, np.int64), np.zeros(num_lanes + 1, np.int64)

    @property
    def num_robots(self) -> int:
        return self.problem.num_robots

    @property
    def steps(self) -> IntArray:
        """[R] until each robot stands at its goal, -1 where it has no way."""
        return np.array([-1 if path is None else path.steps for path in self.path], np.int64)

    @property
    def steps_of_a_lane(self) -> int:
        """From rest to rest on the longest one."""
        return max((int(moves.time[moves.run_first[:-1]].max(initial=1)) for moves in self.moves), default=1)

    @property
    def delay(self) -> IntArray:
        """[R] steps that each robot takes longer than alone."""
        return self.steps - self.alone

    def look_back(self, robot: int) -> None:
        """Find out how far it is to a robot's goal from everywhere, without others."""
        moves, start, goal = self.moves[self.kind[robot]], self._start[robot], self._goal[robot]
        room = self.at_rest[robot], self.facing[robot], self._lanes, self._stack
        while not _search.steps_left(moves, (goal, self._goal_rad[robot]), *room, self._heap):
            self._heap = np.zeros(2 * len(self._heap), np.int64)
        ahead, at_start = self.facing[robot], self._start_rad[robot]
        steps = [
            int(ahead[lane]) + steps_of_turn(moves.heading_rad[lane] - at_start, moves.turn_rad)
            for lane in range(moves.first[start], moves.first[start + 1])
        ]
        if start == goal:
            steps.append(steps_of_last_turn(self._goal_rad[robot] - at_start, moves.turn_rad))
        self.alone[robot] = min(steps, default=_search.FAR)

    def search(self, robot: int, most: int = WHOLE, latest: int = FOREVER, weight: float = 1.0) -> TimedPath | None:
        """The earliest way of a robot that is not in the table; None where there is none, or it takes too long to find."""
        self._expose(robot)
        path = self._search(self.table, robot, most, latest, weight)
        self._protect(robot)
        return path

    def ideal(self, robot: int) -> TimedPath:
        """The way of a robot without others."""
        path = self._search(self._nobody, robot, WHOLE, FOREVER, 1.0)
        assert path is not None
        return path

    def delay_at_stops(self, robot: int) -> IntArray:
        """[K] of the stops at the ends of a robot's runs, how many steps it will be later than alone if nothing delays it from there on."""
        moves, path = self.moves[self.kind[robot]], self.path[robot]
        assert path is not None
        steps = [left + int(moves.time[run]) + int(self.at_rest[robot, lane]) for lane, run, left in self._ends(robot, path)]
        delay: IntArray = np.array(steps, np.int64) - self.alone[robot]
        return delay

    def ideal_from(self, robot: int, run: int) -> TimedPath:
        """The way of a robot without others from where one of its runs begins, when it has come to stand there."""
        moves, path = self.moves[self.kind[robot]], self.path[robot]
        assert path is not None
        if not run:
            return self.ideal(robot)
        lane, driven, left = self._ends(robot, path)[run - 1]
        at = int(moves.head[lane]), float(moves.heading_rad[lane]), left + int(moves.time[driven])
        rest = self._search(self._nobody, robot, WHOLE, FOREVER, 1.0, at)
        assert rest is not None
        return rest

    def _ends(self, robot: int, path: TimedPath) -> list[tuple[int, int, int]]:
        """Of each run its last lane, its number, and the step at which the robot sets out."""
        moves, ends = self.moves[self.kind[robot]], []
        for ray, lanes, left in path.runs.tolist():
            lane = ray
            for _ in range(lanes - 1):
                lane = moves.onward.item(lane)
            ends.append((lane, moves.run_first.item(moves.course.item(ray)) + lanes - 1, left))
        return ends

    def search_without(self, robot: int, resource: IntArray, begin: IntArray, end: IntArray) -> TimedPath | None:
        """The earliest way of a robot that holds none of some resources from some step on until another [H]. The table has only these."""
        self.clear()
        self._reserve(-1, (resource, begin, end))
        return self._search(self.table, robot, WHOLE, FOREVER, 1.0)

    def passing(self, resource: int) -> IntArray:
        """The robots that hold a resource, in order."""
        begin = int(self.table.row[resource])
        robots: IntArray = self.table.robot[begin : begin + int(self.table.count[resource])]
        return robots.copy()

    def _search(
        self, table: _table.ReservationTable, robot: int, most: int, latest: int, weight: float, begin: tuple[int, float, int] | None = None
    ) -> TimedPath | None:
        """From a vertex, a heading and a step on; by default from the robot's start at step 0."""
        moves = self.moves[self.kind[robot]]
        start, heading, since = begin or (self._start[robot], self._start_rad[robot], 0)
        trip = _search.Trip(start, heading, self._goal[robot], self._goal_rad[robot])
        code = SCRATCH_FULL
        while code == SCRATCH_FULL:
            before = int(self.scratch.work[1])
            ground = _search.RunGround(moves, table, self.at_rest[robot], self.facing[robot], weight)
            code, state = _search.find(ground, trip, most, latest, self.scratch)
            self.work += int(self.scratch.work[1]) - before
            if code == SCRATCH_FULL:
                self.scratch = _search.new_scratch(4 * len(self.scratch.lane), len(self.scratch.seen))
        self.exhausted = code == NO_PATH
        if code != OK:
            return None
        runs = _search.runs_to(state, self.scratch)
        runs[:, 2] += since
        resource, begin, end = _search.needs_along(moves, start, runs)
        steps = int(self.scratch.arrived[state]) + int(self.scratch.work[4]) + since
        return TimedPath(runs, resource, np.maximum(begin, since), end, steps)

    def hinders(self, robot: int, path: TimedPath) -> IntArray:
        """The robots in the table that a way would get in conflict with, in the order of the conflicts."""
        since = np.full(self.num_robots, FOREVER)
        _table.holders(self.table, path.resource, path.begin, path.end, robot, since)
        order = np.argsort(since, kind="stable")
        return order[since[order] < FOREVER]

    def add(self, robot: int, path: TimedPath) -> None:
        """Put a way into the table."""
        self._expose(robot)
        self._reserve(robot, (path.resource, path.begin, path.end))
        self.path[robot] = path

    def _expose(self, robot: int) -> None:
        if self._protected_steps and self.path[robot] is None:
            resource = self._start_of(robot)[0]
            _table.release(self.table, resource, robot)

    def _reserve(self, robot: int, held: tuple[IntArray, IntArray, IntArray]) -> None:
        while not _table.reserve(self.table, *held, robot):
            larger = _table.empty_table(len(self.table.row), 2 * len(self.table.begin))
            _table.copied(self.table, larger)
            self.table = larger

    def remove(self, robot: int) -> TimedPath | None:
        """Take a robot's way out of the table."""
        path = self.path[robot]
        if path is not None:
            _table.release(self.table, path.resource, robot)
            self.path[robot] = None
            self._protect(robot)
        return path

    def clear(self, protected_steps: int = 0) -> None:
        """Nobody has a way. The starts of robots without ways are nobody's for others for so many steps."""
        _table.clear(self.table)
        self.path = [None] * self.num_robots
        self._protected_steps = protected_steps
        for robot in range(self.num_robots):
            self._protect(robot)

    def _protect(self, robot: int) -> None:
        if self._protected_steps:
            self._reserve(robot, self._start_of(robot))

    def _start_of(self, robot: int) -> tuple[IntArray, IntArray, IntArray]:
        """What a robot holds at its start as long as it is protected."""
        resource = self.needed_at(robot, int(self.problem.start[robot]))
        return resource, np.zeros(len(resource), np.int64), np.full(len(resource), self._protected_steps)

    def needed_at(self, robot: int, vertex: int) -> IntArray:
        """The resources that a robot at a vertex holds."""
        moves = self.moves[self.kind[robot]]
        needed: IntArray = moves.at[moves.at_first[vertex] : moves.at_first[vertex + 1]]
        return needed

    def plan(self) -> Plan:
        """The ways as timed visits; all robots have one."""
        visits = []
        for robot, path in enumerate(self.path):
            assert path is not None
            visits.append(self._visits(robot, path))
        plan = plan_of_visits(visits)
        if self.problem.goal_heading_rad is None:
            return plan
        turned_s = np.round(self.steps * self.dt, 9)
        need_not_turn = turned_s - plan.end_s < self.dt - 1e-9  # arrivals are within their steps
        return replace(plan, turned_s=frozen(np.where(need_not_turn, plan.end_s, turned_s)))

    def _visits(self, robot: int, path: TimedPath) -> tuple[IntArray, FloatArray, FloatArray]:
        """Vertices with the times at which a robot arrives and sets out."""
        moves, dt = self.moves[self.kind[robot]], self.dt
        vertex, arrive, depart = [int(self.problem.start[robot])], [0.0], [np.inf]
        for ray, lanes, left in path.runs.tolist():
            course = int(moves.course[ray])
            run = int(moves.run_first[course]) + np.arange(lanes)
            brake, time, begin = int(moves.brake[run[-1]]), int(moves.time[run[-1]]), int(moves.along_first[course])
            tail = int(moves.tail_first[run[-1]])
            s = np.concatenate([moves.along_m[begin : begin + brake], moves.tail_m[tail : tail + time - brake + 1]])
            at = moves.end_m[run] - ARRIVED_M
            step = np.searchsorted(s, at)
            t = (left + step - (s[step] - at) / (s[step] - s[step - 1])) * dt
            depart[-1] = left * dt
            lane = int(ray)
            for _ in range(lanes):
                vertex.append(int(moves.head[lane]))
                lane = int(moves.onward[lane])
            arrive += np.round(t, 9).tolist()
            depart += np.round(t, 9).tolist()
        depart[-1] = np.inf
        return np.array(vertex, np.int64), np.array(arrive), np.round(np.array(depart), 9)


_known: WeakKeyDictionary[PlanGraph, dict[tuple[float, ...], Moves]] = WeakKeyDictionary()


def known_moves(problem: Problem, resources: Resources, limits: tuple[float, ...], dt: float, kind: int) -> Moves:
    """The moves of a type of robots on its lanes, laid out once for as long as these live."""
    graph = problem.graph_of_kind[kind]
    moves_by_key = _known.setdefault(graph, {})
    key = (kind, *resources.apart_m.reshape(-1).tolist(), dt, *limits)
    if key not in moves_by_key:
        top, accel, decel, turn_rate = limits
        own = resources if graph is problem.graph or problem.barred is None else resources.on_lanes(~problem.barred[kind])
        moves_by_key[key] = moves_of(graph, own, (top, accel, decel, turn_rate), dt, kind)
    return moves_by_key[key]
