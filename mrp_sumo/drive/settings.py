"""Settings of an execution. Refuses values that no run could use."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mrp_sumo.core.battery import Charging
from mrp_sumo.core.disturbances import ClosedLane
from mrp_sumo.core.driving import DrivingOptions, Planning
from mrp_sumo.core.order_rules import Cancel, Retry
from mrp_sumo.core.stream import TaskSource
from mrp_sumo.crowd.model import People
from mrp_sumo.errors import ExecutionError, nearest

ON_DEADLOCK = ("report", "stop", "resolve")
ENGINES = ("sumo", "kinematic")
AT_ONCE = Planning(budget_s=0.0)


def check_period(period_s: float, step_s: float) -> None:
    """A period of samples that is not a whole number of steps is refused."""
    steps = period_s / step_s
    if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
        raise ExecutionError(f"a sample every {period_s:g} s, expected a whole number of steps of {step_s:g} s")


@dataclass(frozen=True, kw_only=True)
class ExecutionSettings(DrivingOptions):
    """Policy, clock and recording of an execution."""

    policy: str = "adg"
    policy_parameters: Mapping[str, Any] = field(default_factory=dict)
    dispatcher: str = "one_shot"  # who goes on when the first plan is there
    dispatcher_parameters: Mapping[str, Any] = field(default_factory=dict)
    planner: str = "lacam"  # that the dispatcher asks for more plans
    planner_parameters: Mapping[str, Any] = field(default_factory=dict)
    tasks: tuple[TaskSource, ...] = ()
    cancel: Cancel | None = None  # orders that nobody picks; None: they wait
    retry: Retry | None = None  # orders whose robot is lost with them on board; None: they have failed
    parking: tuple[int, ...] = ()  # vertices where robots without a task go
    charging: Charging | None = None
    chargers: tuple[int, ...] = ()  # vertices where, if they do
    start_level: tuple[float, float] = (1.0, 1.0)  # of batteries, drawn evenly between them
    planning: Planning = AT_ONCE
    time_limit_s: float = 300.0  # simulated
    goal_tolerance_m: float = 0.0  # a robot that stands this near its goal when the run ends has reached it
    record_period_s: float = 0.1  # a whole number of steps
    seed: int = 0  # of what chance decides while driving
    closed_lanes: tuple[ClosedLane, ...] = ()  # of the disturbances' closures
    people: People | None = None  # who walks among the robots
    lane_speeds_mps: tuple[float, float, float] | None = None  # instead, least, usual and most of those that robots draw for each lane

    def __post_init__(self) -> None:
        super().__post_init__()
        for key in ("time_limit_s", "record_period_s"):
            value = getattr(self, key)
            if not (np.isfinite(value) and value > 0):
                raise ExecutionError(f"{key} is {value}, expected a number of seconds above 0")
        if self.step_length_s < 0.001:
            raise ExecutionError(f"step_length_s is {self.step_length_s}, expected 0.001 to 1")
        for key, possible in (("on_deadlock", ON_DEADLOCK), ("engine", ENGINES)):
            if getattr(self, key) not in possible:
                raise ExecutionError(f"{key} is '{getattr(self, key)}'{nearest(getattr(self, key), possible)}")
        if not self.goal_tolerance_m >= 0:
            raise ExecutionError(f"goal_tolerance_m is {self.goal_tolerance_m}, expected 0 or more")
        planning, least_s = self.planning, 2 * max(self.planning.budget_s, self.planning.period_s or 0.0)
        if planning.window_s and planning.window_s <= least_s:
            raise ExecutionError(
                f"planning.window_s is {planning.window_s:g}, expected more than {least_s:g}: twice the budget and the period, "
                "or robots come to the ends of their ways before there is a new plan"
            )
        check_period(self.record_period_s, self.step_length_s)

    @property
    def steps_per_sample(self) -> int:
        return round(self.record_period_s / self.step_length_s)
