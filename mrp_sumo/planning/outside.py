"""Planners and assigners from outside: they look like ours, and run in a process of their own that can be killed.

Nothing is loaded before `prepare`, `plan` or `assign` is called.
"""

from collections.abc import Mapping
from time import perf_counter
from typing import Any

from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlugInError
from mrp_sumo.planning.processes import Overtime, PlugInProcess
from mrp_sumo.plugins.description import Described, describe
from mrp_sumo.plugins.kinds import KINDS
from mrp_sumo.plugins.limit import LIMIT_S
from mrp_sumo.plugins.registry import find
from mrp_sumo.plugins.source import Source, definition


class Outside:
    """A plug-in that is loaded into its process when it is first needed."""

    kind: str

    def __init__(self, source: Source, parameters: Mapping[str, Any]) -> None:
        self._source, self._parameters = source, parameters
        self._process: PlugInProcess | None = None

    @property
    def process(self) -> PlugInProcess:
        """Its process, with the plug-in loaded.

        Raises ScenarioError for parameters that it does not have, and PlugInError when it cannot be loaded or made, or lacks what its kind
        needs.
        """
        if self._process is None or not self._process.alive:
            try:
                self._process = PlugInProcess(self.kind, self._source, self._parameters)
            except Overtime:
                raise PlugInError(f"{definition(self._source)}: not loaded after {LIMIT_S:g} s") from None
        return self._process

    def prepare(self) -> None:
        """Load it; raises as `process` does."""
        _ = self.process

    def close(self) -> None:
        """End its process; another begins when it is needed again."""
        if self._process is not None:
            self._process.close()


class OutsidePlanner(Outside):
    """A planner; see `Planner`."""

    kind = "planners"

    @property
    def assigns(self) -> bool:
        """See `Planner`."""
        return bool(self.process.facts["assigns"])

    @property
    def guarantee(self) -> str:
        """See `Planner`."""
        return str(self.process.facts["guarantee"])

    def prepare(self) -> None:
        """Load it, and let it compile; raises as `process` does."""
        try:
            self.process.ask("prepare", (), LIMIT_S)
        except Overtime:
            raise PlugInError(f"{definition(self._source)}: prepare() has not ended after {LIMIT_S:g} s") from None

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """As `Planner.plan`; PLANNER_FAILED with the line to show for whatever the plug-in does wrong."""
        began = perf_counter()
        try:
            process = self.process
            began = perf_counter()
            result: PlanResult = process.ask("plan", (problem, time_limit_s), time_limit_s)[0]
        except Overtime:
            return PlanResult(Status.TIMED_OUT, planning_time_s=perf_counter() - began, message=f"killed after {time_limit_s:g} s")
        except PlugInError as error:
            return failed(error, perf_counter() - began)
        return result


class OutsideAssigner(Outside):
    """An assigner; see `Assigner`."""

    kind = "assigners"

    def assign(self, cost: FloatArray, time_limit_s: float) -> IntArray:
        """As `Assigner.assign`; raises PlugInError for whatever the plug-in does wrong."""
        try:
            goal_of: IntArray = self.process.ask("assign", (cost, time_limit_s), time_limit_s)[0]
        except Overtime:
            raise PlugInError(f"{definition(self._source)}: no assignment after {time_limit_s:g} s, killed") from None
        return goal_of


def described(kind: str, name: str) -> Described:
    """A registered plug-in of any kind in words; one from outside is loaded in a process of its own.

    Raises PlugInError when it cannot be loaded, or lacks what its kind needs.
    """
    source = find(kind, name)
    if source.ours:
        return describe(KINDS[kind], source)
    try:
        process = PlugInProcess(kind, source, {}, first="describe")
    except Overtime:
        raise PlugInError(f"{definition(source)}: not loaded after {LIMIT_S:g} s") from None
    process.close()
    facts: Described = process.facts["described"]
    return facts


def failed(error: PlugInError, time_s: float = 0.0) -> PlanResult:
    """The result of a plug-in that failed."""
    return PlanResult(Status.PLANNER_FAILED, planning_time_s=time_s, message=str(error), details=error.details)
