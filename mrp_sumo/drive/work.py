"""The work of a run: tasks as they become known, robots at them, and when that has to be looked at.

What a robot is at is in `drive.robot_work`, what becomes of a task in `drive.orders`, and both together in `drive.crew`.
"""

from collections.abc import Sequence

import numpy as np

from mrp_sumo.core.graph import BoolArray, FloatArray
from mrp_sumo.core.task import Station, Task
from mrp_sumo.drive.charging import Chargers
from mrp_sumo.drive.crew import Crew
from mrp_sumo.drive.robot_work import NONE, Change, Condition, Duty, RobotWork
from mrp_sumo.drive.stalling import Progress
from mrp_sumo.drive.work_request import WorkRequest, take_over

SLACK_S = 0.5  # so much earlier than a robot would have to brake for a stop without service, its way on is asked for
STEP_S = 1.0  # more than between two looks: so much before a battery may be empty or low, every look counts
TRY_AGAIN_S = 2.0  # after a request that had no answer


class Work:
    """Looks at a crew and its tasks: again and again as robots drive."""

    def __init__(self, crew: Crew) -> None:
        self.crew, self.progress = crew, Progress(crew)
        charging, places = crew.settings.charging, crew.settings.chargers
        self._chargers = None
        if charging is not None and places:
            self._chargers = Chargers(crew, charging, Station("charger", places, spans_s=charging.spans_s))
        self._lead_s = crew.settings.planning.budget_s  # what is asked for takes effect so much later
        self.wake_s = 0.0  # when something will have changed that is known already
        self._again_s = 0.0

    def update(
        self,
        now_s: float,
        level: FloatArray | None = None,
        down_until_s: FloatArray | None = None,
        stands_until_s: FloatArray | None = None,
    ) -> None:
        """Note what robots have done by now; reveal tasks; see who has to charge.

        `level` [R] are states of charge, where robots have batteries; robots are broken until `down_until_s` [R], inf: for good, and stand
        where they are until `stands_until_s` [R], by default as long as they are broken.
        """
        crew = self.crew
        for robot in crew.robots:
            if robot.task != NONE:
                crew.follow(robot, now_s)
        if down_until_s is not None:  # what was over by then is
            self._see_who_is_broken(now_s, down_until_s.tolist())
            if stands_until_s is not None:
                self._see_who_is_pushed(now_s, stands_until_s.tolist())
        crew.seen[:] = crew.ledger.visits.reached
        self._see_who_waits(now_s)
        for task in [k for k in crew.orders.not_picked if crew.orders.last_chance_s(k) <= now_s]:
            crew.cancel(task, f"not picked up by {crew.orders.last_chance_s(task):g} s")
        for task in crew.orders.reveal(now_s):
            crew.fail_if_nobody_can(task, now_s)
            could = (crew.free or crew.may_pass_on(robot) or crew.has_room_for_more(robot) for robot in crew.robots)
            crew.is_changed |= any(could)  # else nobody could take it now
        if level is not None:
            crew.level = level
            if self._chargers is not None:
                self._chargers.look(now_s)
        self._see_who_leaves(now_s)
        self.progress.look(now_s)
        if now_s >= self._again_s:
            crew.is_changed, self._again_s = True, np.inf
        crew.looks_s = crew.looks_s[-1], now_s
        self.wake_s = self._next_change_s(now_s)

    def is_quiet(self, now_s: float, down_until_s: FloatArray, stands_until_s: FloatArray) -> bool:
        """True if `update` changes nothing before `wake_s` but the time since which robots have got on (see `pass_over`), as long as no
        robot stands but those in `rests` and `held`, nor goes on that is `watched` or `held`, nor breaks, may be pushed or is mended.
        """
        is_down, stands = (until_s > now_s for until_s in (down_until_s, stands_until_s))
        if any(not self._has_seen(robot, *has) for robot, *has in zip(self.crew.robots, is_down.tolist(), stands.tolist())):
            return False
        if self.crew.is_changed or not self.progress.is_steady(now_s) or (self._chargers is not None and self._chargers.watches):
            return False
        if any(map(self._lines_up, self.crew.robots)):  # a look notes since when, before they go on
            return False
        speed_mps = self.crew.ledger.state.motion.speed_mps
        return all(speed_mps[robot.number] > 0 for robot in self._passing())  # else nobody knows when they are near

    def _has_seen(self, robot: RobotWork, is_down: bool, stands: bool) -> bool:
        """True if it is known here whether a robot is broken, and whether it is pushed."""
        if robot.condition is Condition.EMPTY:
            return True
        if robot.condition is Condition.BROKEN:
            return is_down and (stands or robot.making is not None)
        return robot.is_down == is_down

    @property
    def watched(self) -> BoolArray:
        """[R] robots that make a stop in passing, come to wait in line, or come to a charger, on their way."""
        lines_up = (robot.duty is Duty.DRIVING and (robot.wait_at != NONE or robot.charges) for robot in self.crew.robots)
        passes = (any(not self.crew.stop_s(robot.number, leg.task, leg.nth) for leg in robot.legs) for robot in self.crew.robots)
        return np.array([a or b for a, b in zip(lines_up, passes)], np.bool_)

    def level_wake_s(self, now_s: float, most_per_s: FloatArray) -> float:
        """Until when no battery runs empty, nor so low that its robot is to charge, as robots draw at most so much a second [R]."""
        level, charging = self.crew.level, self.crew.settings.charging
        left = np.where(level > 0, level, np.inf)
        if charging is not None:
            left = np.where(level > charging.critical, level - charging.critical, left)
        left[[robot.is_out for robot in self.crew.robots]] = np.inf
        return now_s + float((left / most_per_s).min(initial=np.inf)) - STEP_S

    def pass_over(self, looks_s: Sequence[float], level: FloatArray | None, held: BoolArray) -> None:
        """`update` was not called at some times, of which these are the last two, since it `is_quiet`; with states of charge [R] then, and
        robots that were `held` [R].
        """
        if level is not None and len(looks_s):
            self.crew.level = level
        for now_s in looks_s:
            self.progress.pass_over(now_s, held)
            self.crew.looks_s = self.crew.looks_s[-1], now_s

    def accepted(self, request: WorkRequest, now_s: float) -> None:
        """Robots are on the ways that were asked for."""
        take_over(self.crew, request, now_s)
        self._see_who_leaves(now_s)
        self.wake_s = self._next_change_s(now_s)

    def failed(self, now_s: float) -> None:
        """There was no answer to a request: it is made again in a while."""
        self._again_s = now_s + TRY_AGAIN_S
        self.wake_s = min(self.wake_s, self._again_s)

    def add(self, task: Task) -> None:
        """Have a task that nobody knew of, among those that are listed with times of their own."""
        self.crew.orders.add(task)
        self.wake_s = min(self.wake_s, task.release_s)

    def _see_who_is_broken(self, now_s: float, down_until_s: Sequence[float]) -> None:
        """Robots break down, for a while or for good, and go on."""
        crew = self.crew
        for robot, until_s in zip(self.crew.robots, down_until_s):
            if until_s == np.inf and not robot.is_gone:
                crew.lose(robot, now_s, Change.LOST)
            if until_s <= now_s or robot.is_down:
                continue
            if crew.has_yet_to_begin(robot):
                crew.take_back(robot, now_s)
            crew.give_up_next(robot)
            if robot.making is not None:
                crew.put_off(robot, now_s, until_s)
            robot.on(Change.BREAKS, now_s)
            crew.is_changed = True
        for robot, until_s in zip(self.crew.robots, down_until_s):
            if robot.is_broken and until_s <= now_s:
                robot.on(Change.MENDED, until_s)
                robot.earliest_s = max(robot.earliest_s, until_s)  # of a stop that it rolled to
                robot.moved_s, crew.is_changed = now_s, True

    def _see_who_is_pushed(self, now_s: float, stands_until_s: Sequence[float]) -> None:
        """Broken robots are out of the way as soon as somebody needs it; those that are being served stay."""
        for robot, until_s in zip(self.crew.robots, stands_until_s):
            if robot.condition is Condition.BROKEN and until_s <= now_s and robot.making is None:
                robot.on(Change.TOWED, now_s)
                self.crew.is_changed = True

    def _see_who_waits(self, now_s: float) -> None:
        """Note since when robots have been as near to a place as where they were sent to wait, though they make room for others there."""
        visits = self.crew.ledger.visits
        for robot in filter(self._lines_up, self.crew.robots):
            robot.came_s = max(float(visits.arrived_s[visits.reached[robot.number]]), robot.since_s)
            robot.on(Change.LINED_UP, now_s)

    def _lines_up(self, robot: RobotWork) -> bool:
        """True if a robot is as near to a place as where it was sent to wait, which has not been noted."""
        if robot.duty is not Duty.DRIVING or robot.wait_at == NONE:
            return False
        visits, stop = self.crew.ledger.visits, self.crew.next_stop(robot)
        here = int(visits.vertex[visits.reached[robot.number]])
        away, at_most = (self.crew.places.away(robot.number, v, stop) for v in (here, robot.wait_at))
        return away <= at_most

    def _see_who_leaves(self, now_s: float) -> None:
        """Robots whose ways on can be asked for: they will be done with what they are at when what is asked for now takes effect."""
        visits, s_m = self.crew.ledger.visits, self.crew.ledger.state.motion.s_m
        crew = self.crew
        done = [r for r in crew.robots if r.is_busy and not r.is_out and r.making and r.making.end_s <= now_s + self._lead_s + 1e-9]
        over = [r for r in done if not crew.goes_on_here(r)]
        passing = [r for r in self._passing() if visits.granted[r.number] == visits.last[r.number]]
        near = [r for r in passing if visits.at_m[visits.last[r.number]] - s_m[r.number] <= self._near_m(r.number) + 1e-9]
        for robot in (*over, *near):
            robot.leaves = True
            self.crew.is_changed = True

    def _passing(self) -> list[RobotWork]:
        """Robots on the way to stops without service, at the last of which their ways end."""
        visits = self.crew.ledger.visits
        last = visits.vertex[visits.last].tolist()
        ends = (r for r in self.crew.robots if r.legs and r.then == NONE and r.is_on_the_road and r.condition is Condition.SOUND)
        return [r for r in ends if r.legs[-1].vertex == last[r.number] and not self.crew.stop_s(r.number, r.legs[-1].task, r.legs[-1].nth)]

    def _near_m(self, r: int) -> float:
        """How far before a stop a robot would have to brake soon after what is asked for now takes effect."""
        top, decel = float(self.crew.problem.fleet.max_speed_mps[r]), float(self.crew.problem.fleet.decel_mps2[r])
        return top * (self._lead_s + SLACK_S) + top**2 / (2 * decel)

    def _next_change_s(self, now_s: float) -> float:
        """When something will have changed that is known by now."""
        visits, motion = self.crew.ledger.visits, self.crew.ledger.state.motion
        times = [self._again_s, self.crew.orders.next_release_s]
        at_stops = [r for r in self.crew.robots if r.making and not r.is_out]
        times += [r.making.end_s - self._lead_s * (r.is_busy and not self.crew.goes_on_here(r)) for r in at_stops if r.making]
        times += [r.making.begin_s for r in self.crew.robots if r.making]
        times += [self.crew.orders.last_chance_s(k) for k in self.crew.orders.not_picked]
        for r in (robot.number for robot in self._passing()):
            if motion.speed_mps[r] > 0:
                left_m = float(visits.at_m[visits.last[r]] - motion.s_m[r]) - self._near_m(r)
                times.append(now_s + max(left_m / float(self.crew.problem.fleet.max_speed_mps[r]), 1e-6))
        return min((t for t in times if t > now_s), default=np.inf)
