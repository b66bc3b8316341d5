"""How an execution is run. Refuses values that no run could use."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mrp_sumo.core.battery import Battery, Charging
from mrp_sumo.core.stream import TaskSource
from mrp_sumo.crowd.model import LaneSpeeds, People
from mrp_sumo.drive.disturbances import NONE, Disturbances
from mrp_sumo.drive.orders import KEPT, OrderRules
from mrp_sumo.errors import ExecutionError, nearest

ON_DEADLOCK = ("report", "stop", "resolve")
ENGINES = ("sumo", "kinematic")


@dataclass(frozen=True, kw_only=True)
class Planning:
    """How the planner is asked while robots drive, in simulated time."""

    budget_s: float = 0.0  # an answer takes effect so long after it was asked for
    period_s: float = 0.0  # the least time between two requests
    window_s: float | None = None  # for which robots keep clear of each other, for planners that support it; None: see `window_of`
    effort: int = 1_000_000  # labels that a planner may make for an answer

    def __post_init__(self) -> None:
        for key in ("budget_s", "period_s"):
            if not 0 <= getattr(self, key) < np.inf:
                raise ExecutionError(f"planning.{key} is {getattr(self, key)}, expected a number of seconds from 0 up")
        if self.window_s is not None and not 0 <= self.window_s < np.inf:
            raise ExecutionError(f"planning.window_s is {self.window_s}, expected a number of seconds from 0 up")
        if self.window_s and self.window_s <= 2 * max(self.budget_s, self.period_s):
            least = 2 * max(self.budget_s, self.period_s)
            raise ExecutionError(
                f"planning.window_s is {self.window_s:g}, expected more than {least:g}: twice the budget and the period, "
                "or robots come to the ends of their ways before there is a new plan"
            )
        if self.effort < 1:
            raise ExecutionError(f"planning.effort is {self.effort}, expected 1 or more")


@dataclass(frozen=True, kw_only=True)
class ExecutionSettings:
    """Policy, clock and recording of an execution."""

    engine: str = "sumo"  # what moves the bodies
    policy: str = "adg"
    policy_parameters: Mapping[str, Any] = field(default_factory=dict)
    dispatcher: str = "one_shot"  # who goes on when the first plan is there
    dispatcher_parameters: Mapping[str, Any] = field(default_factory=dict)
    planner: str = "lacam"  # that the dispatcher asks for more plans
    planner_parameters: Mapping[str, Any] = field(default_factory=dict)
    tasks: tuple[TaskSource, ...] = ()
    rules: OrderRules = KEPT  # of orders that nobody picks, or whose robot is lost
    parking: tuple[int, ...] = ()  # vertices where robots without a task go
    batteries: tuple[Battery, ...] = ()  # of each type of robots, if they have some; in runs with tasks
    charging: Charging | None = None
    start_level: tuple[float, float] = (1.0, 1.0)  # of batteries, drawn evenly between them
    planning: Planning = Planning()
    step_length_s: float = 0.1
    time_limit_s: float = 300.0  # simulated
    goal_tolerance_m: float = 0.0  # a robot that stands this near its goal when the run ends has reached it
    record_period_s: float = 0.1  # a whole number of steps
    seed: int = 0  # of what chance decides while driving
    blocking_window_s: float = 10.0  # without a cell of progress in it a robot is blocked
    on_deadlock: str = "report"  # 'stop': end the run; 'resolve': give way, drive around, replan from where robots are
    give_way: bool = True  # 'resolve' first asks a robot to step aside or back out, first come first served
    patience_s: float = 10.0  # of who is blocked for good, before 'resolve' drives around, or replans
    replanner: str = "lacam"  # the planner that resolves; '' for none
    disturbances: Disturbances = NONE
    people: People | LaneSpeeds | None = None  # who walks among the robots, or the speeds that they are drawn instead

    def __post_init__(self) -> None:
        for key in ("step_length_s", "time_limit_s", "record_period_s", "blocking_window_s", "patience_s"):
            value = getattr(self, key)
            if not (np.isfinite(value) and value > 0):
                raise ExecutionError(f"{key} is {value}, expected a number of seconds above 0")
        if not 0.001 <= self.step_length_s <= 1.0:
            raise ExecutionError(f"step_length_s is {self.step_length_s}, expected 0.001 to 1")
        for key, possible in (("on_deadlock", ON_DEADLOCK), ("engine", ENGINES)):
            if getattr(self, key) not in possible:
                raise ExecutionError(f"{key} is '{getattr(self, key)}'{nearest(getattr(self, key), possible)}")
        if not self.goal_tolerance_m >= 0:
            raise ExecutionError(f"goal_tolerance_m is {self.goal_tolerance_m}, expected 0 or more")
        steps = self.record_period_s / self.step_length_s
        if round(steps) < 1 or abs(steps - round(steps)) > 1e-6:
            raise ExecutionError(
                f"record_period_s is {self.record_period_s:g}, expected a whole number of steps of {self.step_length_s:g} s (step_length_s)"
            )

    @property
    def steps_per_sample(self) -> int:
        return round(self.record_period_s / self.step_length_s)
