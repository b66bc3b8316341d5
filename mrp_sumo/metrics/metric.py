"""Metrics: one function of what a run came to, with its name, unit, sense and formula."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.plan import Plan, PlanResult
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.zone_log import ZoneLog
from mrp_sumo.traffic.referee import Verdict

YES_NO = "yes/no"  # the unit of what is true or false
UNITS = {"_s": "s", "_m": "m", "_mps": "m/s", "_steps": "steps", "_j": "J"}  # by the end of a name

TOLERANCE_M = 0.7  # MRP-Bench's locationTolerance
RECORDING_TIMEOUT_S = 600.0  # its recordingTimeout
TOGETHER = 4096  # samples of a run to look at together, so that long runs take little memory

T = TypeVar("T")


class Sense(StrEnum):
    """The better values of a metric."""

    MORE = "more"
    LESS = "less"
    NONE = "none"  # neither: a fact about the run


MORE, LESS, NONE = Sense  # for tables


@dataclass(frozen=True, eq=False)
class Evidence:
    """All that a metric may read of a run."""

    problem: Problem  # as it was executed, with the assignment
    result: PlanResult  # of the planner
    verdict: Verdict | None  # of the referee on the plan; None without a plan
    execution: Execution | None  # None when nothing was driven
    audit: dict[str, Any] | None = None  # of the execution, as `metrics.audit.audit` gives it
    assignment_time_s: float | None = None  # wall time; None when there was nothing to assign
    tolerance_m: float = TOLERANCE_M  # execution.goal_tolerance_m
    time_limit_s: float = RECORDING_TIMEOUT_S  # of the execution, simulated
    zones: ZoneLog | None = None  # how occupied they were, of runs with tasks
    _found: dict[Callable[..., Any], Any] = field(default_factory=dict, init=False, repr=False)

    @property
    def plan(self) -> Plan | None:
        return self.result.plan

    @property
    def has_tasks(self) -> bool:
        """True where work came while robots drove, so that there was no plan of all that they did, and no goal of each."""
        return self.execution is not None and self.execution.tasks is not None

    def once(self, work: Callable[["Evidence"], T]) -> T:
        """The result of `work` on this evidence, worked out the first time: several metrics may share it."""
        if work not in self._found:
            self._found[work] = work(self)
        value: T = self._found[work]
        return value


Function = Callable[[Evidence], Any]
Sample = Callable[[Evidence], FloatArray]  # of a run, such as all lead times; worked out once


@dataclass(frozen=True)
class Metric:
    """A number, a yes or no, or a number for each robot."""

    name: str
    unit: str  # SI, 'yes/no', or '' for a count
    sense: Sense
    formula: str  # in words, for the documentation
    function: Function
    of_machine: bool = False  # differs from run to run; all others are the same for the same scenario, seed and versions
    per_robot: bool = False  # a list with a number for each robot
    one_goal: bool = False  # about a plan to one goal for each robot: none in runs with tasks

    def __call__(self, evidence: Evidence) -> Any:
        """The value; None where it does not exist."""
        return None if self.one_goal and evidence.has_tasks else self.function(evidence)

    @property
    def label(self) -> str:
        """The name in words, without its unit."""
        suffix = next((end for end in UNITS if self.name.endswith(end)), "")
        return self.name.removesuffix(suffix).removeprefix("num_").replace("_", " ")


def metric(
    unit: str = "", sense: str = Sense.NONE, formula: str = "", *, of_machine: bool = False, per_robot: bool = False, one_goal: bool = False
) -> Callable[[Function], Metric]:
    """Make a function of the evidence the metric of its name, with these fields of `Metric`.

    The sense is 'more', 'less' or 'none'; the formula is by default the first line of the function's docstring.
    """

    def made(function: Function) -> Metric:
        words = formula or (function.__doc__ or "").strip().split("\n")[0].rstrip(".")
        return Metric(function.__name__, unit, Sense(sense), words, function, of_machine, per_robot, one_goal)

    return made


def statistic(sample: Sample, of: Callable[[FloatArray], Any]) -> Function:
    """A statistic of a sample, such as its mean; None of an empty one."""

    def value(run: Evidence) -> float | None:
        values = run.once(sample)
        return float(of(values)) if len(values) else None

    return value


def quantile(sample: Sample, share: float) -> Function:
    """A quantile of a sample; None of an empty one."""
    return statistic(sample, lambda values: np.quantile(values, share))


def of(log: Callable[[Evidence], T | None], read: Callable[[T], Any]) -> Function:
    """Something that a log of the run tells, or what is worked out of it; None where there is none."""

    def value(run: Evidence) -> Any:
        there = run.once(log)
        return None if there is None else read(there)

    return value


def part(parts: Callable[[Evidence], Mapping[str, Any]], name: str) -> Function:
    """One of several values that are worked out together; None where it is not among them."""
    return of(parts, lambda values: values.get(name))


def of_execution(read: Callable[[Execution], Any]) -> Function:
    """All that can be read of an execution; None where nothing was driven."""
    return of(lambda run: run.execution, read)


def logged(name: str, read: Callable[[Any], Any]) -> Function:
    """Something that one of the logs of an execution tells, such as `batteries`; None where there is none."""
    return of(lambda run: getattr(run.execution, name, None), read)


def of_audit(name: str) -> Function:
    """A value of the audit; None where there was none."""
    return lambda run: run.audit[name] if run.audit else None


def metric_of(function: Function) -> Metric:
    """The metric that a plain function is: its unit by its name's end, no sense, its docstring's first line as formula."""
    return metric(next((unit for end, unit in UNITS.items() if function.__name__.endswith(end)), ""))(function)


def most_at_once(begin_s: ArrayLike, end_s: ArrayLike) -> int:
    """The most spans that are under way at one time; one that ends makes room for one that begins then."""
    at_s, change = np.append(begin_s, end_s), np.repeat((1, -1), (np.size(begin_s), np.size(end_s)))
    return int(change[np.lexsort((change, at_s))].cumsum().max(initial=0))


def count_of(steps: float) -> float | int | None:
    """A number of steps; an int where it is whole, None where there is none."""
    if not math.isfinite(steps):
        return None
    whole = round(float(steps))
    return whole if abs(steps - whole) < 1e-6 * max(1.0, abs(steps)) else float(steps)


def is_value(value: Any) -> bool:
    """True for a value that a metric may have: a finite number, a yes or no, a list of numbers, or None."""
    if isinstance(value, list | tuple):
        return all(is_value(each) and each is not None for each in value)
    if value is None or isinstance(value, bool | np.bool_):
        return True
    return isinstance(value, int | float | np.integer | np.floating) and math.isfinite(value)
