"""Charging, and when: whose battery is low, who has nothing to do, and who is called off again for orders that wait."""

import numpy as np

from mrp_sumo.core.battery import Charging
from mrp_sumo.core.graph import BoolArray
from mrp_sumo.core.shifts import opens_s
from mrp_sumo.core.task import Station
from mrp_sumo.drive.crew import Crew
from mrp_sumo.drive.robot_work import NONE, RobotWork

LEAST_CHARGE_S = 60.0  # for less nobody goes to charge that need not


class Chargers:
    """Sends the robots of a crew to charge."""

    def __init__(self, crew: Crew, charging: Charging, station: Station) -> None:
        self._crew, self._charging, self._station = crew, charging, station
        first = (np.arange(len(crew.robots) + 1) * charging.start_charging / 100 + 0.5).astype(np.int64)
        self._go_first: BoolArray = np.diff(first) > 0  # [R] robots that go to charge whatever their level

    @property
    def watches(self) -> bool:
        """True if a look may change more than whose battery is low: robots that nobody needs may go to charge, others be called off."""
        return self._charging.opportunity and any(robot.is_charging or robot.is_free for robot in self._crew.robots)

    def look(self, now_s: float) -> None:
        """Send robots to chargers whose batteries are low, and with `opportunity` those that have nothing to do; call others off."""
        crew, charging = self._crew, self._charging
        go_first, self._go_first = self._go_first, np.zeros(len(crew.robots), np.bool_)
        for robot in crew.robots:
            if (crew.is_low(robot) or go_first[robot.number]) and not (robot.charges or robot.is_down):
                if crew.has_yet_to_begin(robot):
                    crew.take_back(robot, now_s)
                if robot.task == NONE:
                    crew.charge(robot, self._station, now_s)
        if charging.opportunity:
            free = [robot for robot in crew.robots if robot.task == NONE and not robot.is_down]
            self._use_chargers(free, now_s)
            self._call_off(max(0, len(crew.orders.waiting) - len(free)), now_s)

    def _use_chargers(self, free: list[RobotWork], now_s: float) -> None:
        """Send robots that nobody needs, as long as there are chargers; the emptiest first."""
        crew, charging = self._crew, self._charging
        if opens_s(self._station.spans_s, now_s) > now_s:
            return
        idle = max(0, len(free) - len(crew.orders.waiting))
        room = len(self._station.places) - sum(robot.charges for robot in crew.robots)
        for robot in sorted(free, key=lambda robot: (crew.level[robot.number], robot.number))[: max(0, min(idle, room))]:
            missing = charging.maximum - float(crew.level[robot.number])
            if crew.charge_s(robot, missing) >= max(charging.minimum_charging_time_s, LEAST_CHARGE_S):
                crew.charge(robot, self._station, now_s)

    def _call_off(self, wanted: int, now_s: float) -> None:
        """End the charging of as many as are wanted and full enough; the fullest first."""
        crew, charging = self._crew, self._charging
        ready = [
            robot
            for robot in crew.robots
            if crew.is_charging(robot)
            and crew.level[robot.number] >= charging.minimum
            and now_s - crew.orders.opened_s(robot.task) >= charging.minimum_charging_time_s
        ]
        for robot in sorted(ready, key=lambda robot: (-crew.level[robot.number], robot.number))[:wanted]:
            crew.end_stop(robot, now_s)
