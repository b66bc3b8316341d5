"""The robots of a run at their tasks: who has which, and what becomes of both as stops are made and robots are lost.

A robot makes its task's stops one after the other. It stays for the service time, and goes by where that is none.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mrp_sumo.core.execution import BOOKINGS, Event
from mrp_sumo.core.fleet import with_loads
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, frozen
from mrp_sumo.core.handling import load_change, stop_s
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.shifts import opens_s
from mrp_sumo.core.task import ASSIGNED, CHARGE, NOBODY, Station, Stop, Task
from mrp_sumo.drive.ledger import Ledger
from mrp_sumo.drive.orders import Orders
from mrp_sumo.drive.places import RobotPlaces
from mrp_sumo.drive.robot_work import NONE, Change, Leg, RobotWork, StopRow, TourStop
from mrp_sumo.drive.settings import ExecutionSettings

STANDS = [BOOKINGS.index(name) for name in ("planned_wait", "dependency_wait", "blocked", "disturbed")]
AT_GOAL = BOOKINGS.index("at_goal")
INTO_M = 0.05  # a robot that has come this far into a lane has left the vertex, for SUMO too
PATIENCE = 2  # who set out later and are served first, until one in line goes before all that can let it pass, or passes its order on
PLACES_TO_HAND_OVER = 4  # beside a robot that is lost
WHY_LOST = {Change.LOST: "broke down", Change.EMPTIED: "ran empty"}


class Crew:
    """R robots and the tasks that are known by now."""

    def __init__(self, ledger: Ledger, settings: ExecutionSettings, ahead_steps: int = 0) -> None:
        """`ahead_steps` is how far the planner wants to know stops at which nothing is to be done; with 0 robots stop at each."""
        num_robots = ledger.problem.num_robots
        self.ledger, self.problem, self.settings, self.ahead_steps = ledger, ledger.problem, settings, ahead_steps
        self.orders = Orders(settings.tasks, settings.cancel)
        self._max_load_kg, self._batteries = ledger.problem.fleet.max_load_kg, ledger.problem.fleet.batteries
        self.places = RobotPlaces(self.problem, settings.parking)
        self.robots = [RobotWork(r) for r in range(num_robots)]
        self.seen = np.arange(num_robots)  # [R] the last visit of each robot that has been looked at
        self.level: FloatArray = np.ones(num_robots)  # [R] states of charge
        self.is_changed = True  # whether something has changed since the last request
        self.num_lifts = np.zeros(num_robots, np.int64)  # [R] loads that each has taken on board
        self.set_down: dict[int, int] = {}  # loads that stay at places, by vertex
        self.made_s = 0.0  # when a stop was last made
        self.looks_s = (-np.inf, -np.inf)  # the last two
        self.events: list[Event] = []
        self._num_charges = 0
        stations = (station for source in settings.tasks for station in source.stations())
        self._heading_at = {v: each.heading_rad for each in stations if each.heading_rad is not None for v in each.places}

    def end_heading_rad(self, robots: IntArray, end: IntArray, comes: BoolArray) -> FloatArray | None:
        """[K] headings in which vehicles come to the stations at which their ways end, NaN: any; for those that come to a place."""
        if not self._heading_at:
            return None
        wanted = np.array([self._heading_at.get(v, np.nan) for v in end.tolist()])
        return frozen(np.where(comes & self.problem.fleet.is_vehicle[robots], wanted, np.nan))

    @property
    def tasks(self) -> Sequence[Task]:
        """Those that are known by now, numbered by release."""
        return self.orders.tasks

    @property
    def unassigned(self) -> Sequence[int]:
        """Tasks that no robot has: the most urgent first, then the oldest."""
        return sorted(self.orders.waiting, key=lambda k: (-self.tasks[k].priority, k))

    @property
    def free(self) -> list[int]:
        """Robots without a task, ascending; also those that will be done with theirs when what is asked for now takes effect."""
        return [robot.number for robot in self.robots if robot.is_free or (robot.leaves and self._is_last(robot) and not robot.is_called)]

    @property
    def holder(self) -> dict[int, int]:
        """Robots that may pass on their orders, by these."""
        return {robot.task: robot.number for robot in self.robots if self.may_pass_on(robot)}

    @property
    def loads(self) -> IntArray:
        """[R] loads on board."""
        return np.array([robot.loads for robot in self.robots], np.int64)

    @property
    def loads_ahead(self) -> IntArray:
        """[R] loads on board when what is asked for now takes effect."""
        leaves = (load_change(self.tasks[r.task], r.stop) if r.leaves and r.making else 0 for r in self.robots)
        return self.loads + np.fromiter(leaves, np.int64, len(self.robots))

    @property
    def site(self) -> Problem:
        """The problem with the robots as they are loaded then."""
        fleet = self.problem.fleet
        return self.problem if fleet.loaded is None else replace(self.problem, fleet=with_loads(fleet, self.loads_ahead > 0))

    @property
    def serving(self) -> BoolArray:
        """[R] robots that are at a stop, or at a charger."""
        return np.array([robot.making is not None for robot in self.robots], np.bool_)

    @property
    def rests(self) -> BoolArray:
        """[R] robots that stand for the work's sake, or without any."""
        return np.array([robot.making is not None or robot.task == NONE for robot in self.robots], np.bool_)

    @property
    def held(self) -> BoolArray:
        """[R] robots that stand broken on their way."""
        motion = self.ledger.state.motion
        return np.array([robot.is_broken for robot in self.robots], np.bool_) & ~self.rests & ~(motion.speed_mps > 0) & ~motion.turning

    @property
    def busy(self) -> BoolArray:
        """[R] who is being served, and still will be when what is asked for now takes effect."""
        return np.array([robot.is_busy for robot in self.robots], np.bool_)

    @property
    def since_s(self) -> FloatArray:
        """[R] since when each robot has been on its way to its next stop, inf: it has no work."""
        return np.array([np.inf if robot.task == NONE else robot.since_s for robot in self.robots])

    @property
    def at_charger(self) -> BoolArray:
        """[R] robots that are being charged."""
        return np.array([self.is_charging(robot) or self._charges_in_service(robot) for robot in self.robots], np.bool_)

    def is_charging(self, robot: RobotWork) -> bool:
        """True if a robot is being charged, and does not wait for the next shift there."""
        return robot.is_charging and robot.making is not None and (not self.has_shifts or robot.making.begin_s <= self.looks_s[-1])

    @property
    def has_shifts(self) -> bool:
        """True if people charge robots, in shifts."""
        return self.settings.charging is not None and bool(self.settings.charging.spans_s)

    def _charges_in_service(self, robot: RobotWork) -> bool:
        """True if a robot is being served at a station where robots charge meanwhile."""
        if robot.making is None or robot.is_out or robot.making.begin_s > self.looks_s[-1]:
            return False
        station = self.next_stop(robot).station
        return station is not None and station.charges

    @property
    def all_done(self) -> bool:
        """True if no task is left, and none will come."""
        has_order = any(k != NONE and self.orders.is_order(k) for robot in self.robots for k in (robot.task, robot.then))
        return not self.orders.waiting and not has_order and not self.orders.endless

    def drain(self) -> list[Event]:
        """Events of orders and robots since this was last called."""
        events, self.events = self.events, []
        return events

    def next_stop(self, robot: RobotWork) -> Stop:
        """The stop that a robot with a task is to make next, or makes."""
        return self.tasks[robot.task].stops[robot.stop]

    def stop_s(self, robot: int, task: int, nth: int) -> float:
        """Time in s for which a robot is at a stop of an order; 0: it goes by."""
        return stop_s(self.problem.fleet, self.problem.seed, robot, self.tasks[task], nth)

    def can_do(self, robot: int, task: int) -> bool:
        """True if a task is for a robot, which has room on the way to its stops."""
        return self.is_for(robot, task) and self.places.has_room(robot, self.tasks[task].stops)

    def is_for(self, robot: int, task: int) -> bool:
        """True if a task needs no robot, or no type of robot, other than that."""
        needs, types = self.tasks[task], self.problem.fleet.type_name
        can_carry = needs.load_kg <= float(self._max_load_kg[robot])
        return can_carry and needs.robot in (NOBODY, robot) and (not needs.robot_type or types[robot] == needs.robot_type)

    def some_cannot(self, task: int) -> bool:
        """True if a task is not for every robot."""
        needs = self.tasks[task]
        is_heavy = needs.load_kg > float(self._max_load_kg.min(initial=np.inf))
        return is_heavy or needs.robot != NOBODY or bool(needs.robot_type) or self.problem.barred is not None

    def has_yet_to_begin(self, robot: RobotWork) -> bool:
        """True if a robot has an order and has not come to its first stop, nor is about to."""
        has_one = robot.task != NONE and len(robot.orders) == 1
        return has_one and not (robot.charges or robot.leaves) and robot.stop == 0 and robot.making is None

    def has_room_for_more(self, robot: RobotWork) -> bool:
        """True if a robot with orders can be given another beside them."""
        capacity = self.problem.fleet.capacity
        if capacity is None or robot.is_out or robot.is_called or robot.charges or robot.task == NONE or self.is_low(robot):
            return False
        over = robot.leaves and robot.making is not None and robot.stop == len(self.tasks[robot.task].stops) - 1
        return len(robot.orders) - over < int(capacity[robot.number])

    def is_low(self, robot: RobotWork) -> bool:
        """True if a robot goes to charge as soon as it has no order."""
        charging = self.settings.charging if self.settings.chargers else None
        return charging is not None and bool(self.level[robot.number] <= charging.critical)

    def goes_on_here(self, robot: RobotWork) -> bool:
        """True if a robot with several orders makes the next of its stops where it makes one now."""
        if robot.making is None or len(robot.tour) == 1 or not self.problem.fleet.carries_several:
            return False
        task, nth = robot.tour[1]
        vertex, stop = robot.making.vertex, self.tasks[task].stops[nth]
        return vertex in stop.places and vertex not in self.not_free(task, nth) and not (stop.station and stop.station.holds)

    def not_free(self, task: int, nth: int) -> set[int]:
        """Places of a stop at which a load cannot be set down, since others stay there, or be picked up, since it is at another."""
        station, change = self.tasks[task].stops[nth].station, load_change(self.tasks[task], nth)
        if station is None or not station.holds or not change:
            return set()
        count = {v: self.set_down.get(v, 0) for v in station.places}
        if change < 0:
            return {v for v, loads in count.items() if loads >= station.holds}
        return {v for v, loads in count.items() if not loads} if any(count.values()) else set()

    def stops_of(self, task: int) -> list[TourStop]:
        """All stops of a task, in their order."""
        return [(task, nth) for nth in range(len(self.tasks[task].stops))]

    def may_pass_on(self, robot: RobotWork) -> bool:
        """True if a robot has an order and has not come to its first stop, nor is about to, nor waits in line for it, but in vain."""
        return self.has_yet_to_begin(robot) and (robot.in_line_since_s == np.inf or robot.num_before >= PATIENCE)

    def _is_last(self, robot: RobotWork) -> bool:
        """True if nothing is left for a robot that leaves, after what it is about to have made."""
        return len(robot.tour) == (1 if robot.making else len(robot.legs)) and robot.then == NONE

    def follow(self, robot: RobotWork, now_s: float) -> None:
        """End a robot's service that is over, and have it make the stops to which it has come."""
        if robot.is_down:
            return
        if robot.making is not None:
            if robot.making.begin_s <= now_s + 1e-9:
                self._pick(robot)
            if robot.making.end_s > now_s + 1e-9:
                return
            self.end_stop(robot)
        visits, r = self.ledger.visits, robot.number
        reached, k = int(visits.reached[r]), int(self.seen[r])
        s_m = self.ledger.state.motion.s_m
        stands = k == reached == int(visits.granted[r]) and s_m[r] - visits.at_m[k] < INTO_M  # else it waits on the lane behind
        here = k if stands else int(visits.next[k]) if k != reached else NONE
        while here != NONE and robot.legs:
            while robot.legs and self._comes_to(robot, here):
                if self._begin_stop(robot, here, now_s) > now_s + 1e-9:
                    return
                self.end_stop(robot)
            here = int(visits.next[here]) if here != reached else NONE

    def give(self, robot: RobotWork, task: int, since_s: float, earliest_s: float) -> None:
        """A robot has a task from a time on; its first stop begins no earlier than another."""
        charges = not self.orders.is_order(task)
        robot.begin(self.stops_of(task), since_s, earliest_s, self._idle_s(robot), charges=charges)

    def charge(self, robot: RobotWork, station: Station, now_s: float) -> None:
        """A robot gets the task to charge."""
        stop = Stop(station.places[0], self.charge_s(robot, 1.0 - float(self.level[robot.number])), CHARGE, station)
        task = self.orders.charge(robot.number, stop, f"{CHARGE}_{self._num_charges}", now_s)
        self._num_charges += 1
        self.give(robot, task, now_s, now_s)
        self.is_changed = True

    def charge_s(self, robot: RobotWork, share: float) -> float:
        """Time in s that charging by a share of the capacity takes a robot."""
        charging = self.settings.charging
        if charging is not None and charging.swap_s is not None:
            return charging.swap_s
        return self._batteries[int(self.problem.fleet.kind[robot.number])].charge_s(share) if self._batteries else 0.0

    def set_free(self, robot: RobotWork, at_s: float) -> None:
        """A robot has nothing to do; the task that it was to go on with waits again."""
        self.give_up_next(robot)
        robot.legs = []
        robot.drop(Change.FREED, at_s)

    def drop_order(self, robot: RobotWork, task: int, at_s: float) -> None:
        """A robot has an order no more, and goes on with the others that it has."""
        nth, rest = dict(reversed(robot.tour))[task], [each for each in robot.tour if each[0] != task]
        robot.loads -= nth > 0 and len(self.tasks[task].stops) > 1
        if not rest:
            self.set_free(robot, at_s)
            return
        is_next, robot.tour = robot.task == task, rest
        if is_next:
            robot.legs, robot.wait_at, robot.since_s, robot.idle_s = [], NONE, at_s, self._idle_s(robot)
            robot.on(Change.ONWARD, at_s)

    def take_back(self, robot: RobotWork, now_s: float) -> int:
        """The robot's task, which has not been begun, waits again."""
        task = robot.task
        self.orders.take_back(task)
        self.set_free(robot, now_s)
        return task

    def give_up_next(self, robot: RobotWork) -> None:
        """The task that a robot was to go on with waits again, and so do others beside that of its next stop which it has not begun."""
        for task in [k for k, nth in robot.tour if nth == 0 and k != robot.task]:
            self.orders.take_back(task)
            robot.tour = [each for each in robot.tour if each[0] != task]
        if robot.then != NONE:
            self.orders.take_back(robot.then)
            robot.then, self.is_changed = NONE, True

    def end_stop(self, robot: RobotWork, cut_s: float | None = None) -> None:
        """A service is over, or cut short; so is the task with its last."""
        assert robot.making is not None
        here = robot.making.vertex if self.goes_on_here(robot) and not robot.leaves else NONE
        over_s, (task, nth) = robot.making.end_s if cut_s is None else cut_s, robot.tour.pop(0)
        robot.made.append(robot.making._replace(end_s=over_s))
        robot.making, robot.num_before = None, 0
        change, station, at = load_change(self.tasks[task], nth), self.tasks[task].stops[nth].station, robot.made[-1].vertex
        robot.loads += change
        self.num_lifts[robot.number] += change > 0
        if station is not None and station.holds:
            self.set_down[at] = max(self.set_down.get(at, 0) - change, 0)
            self.is_changed |= bool(change)
        robot.over_s = robot.since_s = robot.earliest_s = robot.moved_s = over_s
        robot.idle_s = self._idle_s(robot)
        self.is_changed |= not robot.leaves  # else what comes next has been asked for
        if nth == len(self.tasks[task].stops) - 1:
            self.orders.finish(task, over_s)
        if robot.tour:
            if here != NONE and (not robot.legs or robot.legs[0][:2] != robot.tour[0]):
                robot.legs = [Leg(*robot.tour[0], here)]
            robot.on(Change.ONWARD, over_s)
            return
        robot.drop(Change.FREED, over_s)
        if robot.then != NONE:
            task, robot.then = robot.then, NONE
            self.orders.begin(task, over_s)
            self.give(robot, task, over_s, over_s)

    def cancel(self, task: int, why: str) -> None:
        """Withdraw an order that nobody has picked."""
        robot, at_s = self.orders.robot[task], self.orders.last_chance_s(task)
        if robot != NOBODY and self.robots[robot].then == task:
            self.robots[robot].then = NONE
        elif robot != NOBODY:
            self.drop_order(self.robots[robot], task, at_s)
        self.orders.cancel(task, at_s, why)
        self._say("cancelled", at_s, robot, task, why)
        self.is_changed = True

    def fail(self, task: int, now_s: float, why: str, robot: int = NOBODY) -> None:
        """An order will not be done."""
        self.orders.fail(task, now_s, why)
        self._say("failed", now_s, robot, task, why)

    def fail_if_nobody_can(self, task: int, now_s: float) -> None:
        """An order that is for none of the robots that are left will not be done; without any left the run has come to a stand."""
        left = [robot.number for robot in self.robots if not robot.is_gone]
        if left and self.some_cannot(task) and not any(self.can_do(r, task) for r in left):
            self.fail(task, now_s, "no robot that can do it is left")

    def lose(self, robot: RobotWork, now_s: float, change: Change) -> None:
        """A robot will never go on: what it has goes to others, or fails, by the rules of the orders."""
        why = f"{self.problem.fleet.robot_name[robot.number]} {WHY_LOST[change]}"
        self.give_up_next(robot)
        charged, next_of = robot.charges, dict(reversed(robot.tour))  # the next stop of each order
        if charged and robot.making is not None:
            robot.made.append(robot.making)
        robot.making, robot.legs = None, []
        robot.drop(change, now_s)
        for order, nth in next_of.items():
            if charged:
                self.orders.fail(order, now_s, why)
            elif nth == 0:
                self.orders.take_back(order)
            else:
                self._lose_load(robot, (order, nth), now_s, f"{why} with it on board")
        self.is_changed = True
        for waiting in list(self.orders.waiting):
            self.fail_if_nobody_can(waiting, now_s)

    def _lose_load(self, robot: RobotWork, at: TourStop, now_s: float, why: str) -> None:
        """What becomes of an order whose robot is lost after its first stop, before another."""
        task, nth = at
        orders, retry, stops = self.orders, self.settings.retry, self.tasks[task].stops
        if retry and retry.hand_over:
            fetch = self._place_to_hand_over(robot.number, stops[0])
            orders.hand_over(task, (fetch, *stops[nth:]), why)
            self._say("handed_over", now_s, robot.number, task, f"{why}; another is to fetch it", fetch.vertex)
        elif retry and orders.tries[task] < retry.times:
            orders.begin_anew(task, why)
            self._say("begun_anew", now_s, robot.number, task, f"{why}; it is begun anew")
        else:
            self.fail(task, now_s, why, robot.number)

    def _place_to_hand_over(self, robot: int, first: Stop) -> Stop:
        """A stop beside a robot that stands for good, which takes as long as the first."""
        visits = self.ledger.visits
        here = int(visits.reached[robot])
        ahead = int(visits.next[here])
        stands = visits.vertex[[here, ahead if ahead >= 0 else here]]
        near = self.places.beside(stands)[:PLACES_TO_HAND_OVER]
        station = Station(f"beside {self.problem.fleet.robot_name[robot]}", tuple(near))
        return Stop(station.places[0], first.service_s, "pickup", station)

    def _comes_to(self, robot: RobotWork, visit: int) -> bool:
        """True if a robot makes the next stop on its way at a visit."""
        leg, visits = robot.legs[0], self.ledger.visits
        if leg.vertex != visits.vertex[visit] or leg[:2] != robot.tour[0]:
            return False
        return bool(visit == visits.last[robot.number] or not self.stop_s(robot.number, leg.task, leg.nth))

    def _begin_stop(self, robot: RobotWork, visit: int, now_s: float) -> float:
        """A service begins, also one that takes no time. Returns when it is over."""
        leg, visits = robot.legs.pop(0), self.ledger.visits
        begin_s, takes_s = max(float(visits.arrived_s[visit]), robot.earliest_s), self._service_s(robot)
        if leg.nth == 0:
            begin_s = max(begin_s, self.orders.assigned_s(leg.task))
        begin_s = self._opens_s(robot, begin_s) if takes_s else begin_s
        robot.making = self._row(robot, visit, (begin_s, begin_s + takes_s), now_s)
        if begin_s <= now_s + 1e-9:
            self._pick(robot)
        robot.moved_s, robot.wait_at = begin_s, NONE
        self.made_s = max(self.made_s, begin_s)
        urgent = self.tasks[robot.task].priority
        for other in self.robots:  # those who drive or wait for it
            is_passed = other.is_on_the_road and other.since_s < robot.since_s and urgent <= self.tasks[other.task].priority
            if is_passed and self.next_stop(other).places == self.next_stop(robot).places:
                other.num_before += 1
        if takes_s:
            robot.on(Change.PLUGGED_IN if robot.charges else Change.SERVED, begin_s)
        return robot.making.end_s

    def _opens_s(self, robot: RobotWork, t_s: float) -> float:
        """Time from which the service at a robot's next stop may begin."""
        station = self.next_stop(robot).station
        return t_s if station is None else opens_s(station.spans_s, t_s)

    def _pick(self, robot: RobotWork) -> None:
        assert robot.making is not None
        if robot.stop == 0 and self.orders.status[robot.task] == ASSIGNED:
            self.orders.pick(robot.task, robot.making.begin_s)

    def put_off(self, robot: RobotWork, now_s: float, until_s: float) -> None:
        """A robot at a stop is broken until a time: its service lasts longer, or begins later."""
        row = robot.making
        assert row is not None
        if row.begin_s <= now_s:
            robot.making = row._replace(end_s=row.end_s + (until_s - now_s))
            return
        begin_s = self._opens_s(robot, max(row.begin_s, until_s))
        robot.making = row._replace(begin_s=begin_s, end_s=begin_s + (row.end_s - row.begin_s))

    def close(self, now_s: float) -> None:
        """The run is over: services that have not begun never will."""
        for robot in self.robots:
            if robot.making is not None and robot.making.begin_s > now_s:
                robot.making = None

    def _service_s(self, robot: RobotWork) -> float:
        if not robot.charges:
            return self.stop_s(robot.number, robot.task, robot.stop)
        charging = self.settings.charging
        assert charging is not None
        missing = max(charging.maximum - float(self.level[robot.number]), 0.0)
        return max(charging.minimum_charging_time_s, self.charge_s(robot, missing))

    def _row(self, robot: RobotWork, visit: int, span_s: tuple[float, float], now_s: float) -> StopRow:
        """A service of a robot at a visit. What was booked since it began, until now, is none of the way there."""
        task, stop, (begin_s, end_s), since_s = self.tasks[robot.task], self.next_stop(robot), span_s, robot.since_s
        vertex = int(self.ledger.visits.vertex[visit])
        stood_s, queued_s = (now - then for now, then in zip(self._idle_s(robot), robot.idle_s))
        queued_s = min(max(queued_s - (now_s - begin_s), 0.0), begin_s - since_s)
        stood_s = min(max(stood_s - self._stands_there_s(robot, visit, now_s - begin_s), 0.0), begin_s - since_s - queued_s)
        station = stop.station.name if stop.station else ""
        return StopRow(task.id, robot.number, station, vertex, since_s, begin_s, end_s, stood_s, queued_s, task.due_s)

    def _stands_there_s(self, robot: RobotWork, visit: int, within_s: float) -> float:
        """For how long one that came to a visit so long ago has stood there, about, if its way leads on: at half its speed at least."""
        visits, r = self.ledger.visits, robot.number
        if visit == visits.last[r]:  # where its way ends, it is booked as there
            return 0.0
        on_m = float(self.ledger.state.motion.s_m[r] - visits.at_m[visit])
        return max(within_s - 2 * max(on_m, 0.0) / float(self.problem.fleet.max_speed_mps[r]), 0.0)

    def _idle_s(self, robot: RobotWork) -> tuple[float, float]:
        """For how long a robot has stood on its way, and where it was sent."""
        booked_s = self.ledger.state.waits.booked_s[robot.number]
        return float(booked_s[STANDS].sum()), float(booked_s[AT_GOAL])

    def _say(self, kind: str, at_s: float, robot: int, task: int, text: str, vertex: int = NONE) -> None:
        self.events.append(Event(at_s, kind, robot, vertex, text=f"order '{self.tasks[task].name}': {text}"))
