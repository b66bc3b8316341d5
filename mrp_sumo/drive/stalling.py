"""Progress: robots that do not get on with their work, for nothing that the work itself asks for, and runs in which no work gets done."""

import numpy as np

from mrp_sumo.core.execution import Event
from mrp_sumo.core.graph import BoolArray
from mrp_sumo.core.task import NOBODY
from mrp_sumo.drive._causes import FACILITY, PLANNED
from mrp_sumo.drive.crew import Crew
from mrp_sumo.drive.robot_work import NONE, Change, Condition, Duty, RobotWork

STALLED_S = 60.0  # for which a robot with work has not got on, nor stood for the work's sake
STANDS_S = 360.0  # for which a robot has not got on, or no stop was made, in a run that counts as stalled
LATE = 3.0  # so many times the longest way to a stop is more than robots need for it


class Progress:
    """The progress of a crew."""

    def __init__(self, crew: Crew) -> None:
        self._crew = crew
        self._gets_done_s = 0.0  # when there was last no stop to be made, or somebody was at one
        self._stands = False  # whether that is too long ago

    @property
    def made_s(self) -> float:
        """Time at which a stop was last made, or none was to be."""
        return max(self._crew.made_s, self._gets_done_s)

    @property
    def gets_done(self) -> bool:
        """True if robots are being served, will be mended, or have no orders."""
        robots = self._crew.robots
        if not self._crew.orders.num_open or not any(_is_at_work(robot) for robot in robots):
            return True
        return any(robot.making is not None or robot.is_broken for robot in robots)

    def is_steady(self, now_s: float) -> bool:
        """True if a look would see nothing but that others get on: nobody is stalled, and stops are being made."""
        if self._stands or any(robot.condition is Condition.STALLED for robot in self._crew.robots):
            return False
        return now_s - self.made_s < STANDS_S / 2 or self.gets_done

    def pass_over(self, now_s: float, held: BoolArray) -> None:
        """Nobody looked at a time at which all was steady, and robots got on but those that were `held` [R]."""
        for robot, is_held in zip(self._crew.robots, held.tolist()):
            robot.moved_s = robot.moved_s if is_held else now_s
        if self.gets_done:
            self._gets_done_s = now_s

    def look(self, now_s: float) -> None:
        """See who does not get on. An order fails whose robot stands where another that is gone stands at its only place."""
        crew, visits, motion = self._crew, self._crew.ledger.visits, self._crew.ledger.state.motion
        gets_on = ((motion.speed_mps > 0) | motion.turning).tolist()
        for robot in crew.robots:
            if gets_on[robot.number] or robot.making is not None or robot.task == NONE:
                robot.moved_s = now_s
        self._look_at_all(now_s)
        at = visits.vertex[visits.reached].tolist()
        out_at, gone_at = (
            {at[each.number] for each in crew.robots if each.is_out},
            {at[each.number] for each in crew.robots if each.is_gone},
        )
        for robot in crew.robots:
            if not robot.is_on_the_road or robot.is_down:
                continue
            if robot.condition is Condition.STALLED:
                if robot.moved_s == now_s:
                    robot.on(Change.GETS_ON, now_s)
            elif now_s - robot.moved_s >= STALLED_S:
                if self._waits_for_work(robot, out_at):
                    robot.moved_s = now_s
                else:
                    self._stall(robot, now_s, gone_at)

    def has_stalled(self, now_s: float) -> bool:
        """True if orders are open, and no stop was made or a robot stalled for long, or nobody has been at work for a while.

        Who charges for it, or is broken for a while only, counts as at work.
        """
        robots, open_since_s = self._crew.robots, self._crew.orders.open_since_s
        stalled = [robot for robot in robots if robot.condition is Condition.STALLED]
        if self._stands or any(now_s - robot.moved_s >= STANDS_S for robot in stalled):
            return True
        if np.isinf(open_since_s) or any(robot.is_broken for robot in robots):
            return False
        if any(robot.condition is Condition.SOUND and robot.duty is not Duty.IDLE for robot in robots):
            return False
        return bool(stalled) or now_s - max(open_since_s, *(robot.changed_s for robot in robots)) >= STALLED_S

    def _stall(self, robot: RobotWork, now_s: float, gone_at: set[int]) -> None:
        crew = self._crew
        robot.on(Change.STALLS, now_s)
        if not robot.charges and gone_at.issuperset(crew.next_stop(robot).places):
            task = robot.task
            crew.drop_order(robot, task, now_s)
            crew.fail(task, now_s, "a robot that is lost stands where its next stop is", robot.number)
            crew.is_changed = True
            return
        doing = "its way to a charger" if robot.charges else f"order '{crew.tasks[robot.task].name}'"
        crew.events.append(Event(now_s, "stalled", robot.number, text=f"has not got on with {doing} for {STALLED_S:g} s"))

    def _look_at_all(self, now_s: float) -> None:
        """Say once that no stop has been made for long, though robots have orders and none is served or about to be mended."""
        crew = self._crew
        if self.gets_done:
            self._gets_done_s = now_s
        stood_s = now_s - self.made_s
        if stood_s < STANDS_S or self._stands:
            self._stands &= stood_s >= STANDS_S
            return
        at_work = [robot for robot in crew.robots if _is_at_work(robot)]
        drives_s = crew.problem.step_s * max(crew.places.farthest(robot.number, crew.next_stop(robot)) for robot in at_work)
        if stood_s >= STANDS_S + LATE * drives_s:
            self._stands = True
            text = f"no stop has been made since {self.made_s:.0f} s, and {crew.orders.num_open} orders are open"
            crew.events.append(Event(now_s, "stalled", NOBODY, text=text))

    def _waits_for_work(self, robot: RobotWork, out_at: set[int]) -> bool:
        """True if a robot that stands will get on by itself: the last of those that it waits for gets on, or is being served."""
        crew, grants, looked_s = self._crew, self._crew.ledger.state.grants, self._crew.looks_s[-1]
        at, seen = robot, list[RobotWork]()
        while at not in seen:
            seen.append(at)
            if at.is_out or (at is not robot and at.task == NONE):
                return False
            if at is not robot and at.moved_s > looked_s - STALLED_S / 2:
                return True
            if at.duty is Duty.WAITING:  # for one of those who are at the places
                return crew.places.can_come(at.number, at.wait_at, crew.next_stop(at), out_at)
            if grants.cause[at.number] in (PLANNED, FACILITY):
                return True
            if grants.other[at.number] < 0:
                return False
            at = crew.robots[int(grants.other[at.number])]
        return False


def _is_at_work(robot: RobotWork) -> bool:
    return robot.task != NONE and not robot.is_down
