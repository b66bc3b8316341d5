"""Any other program as a planner, by a command template; see `mrp_sumo.planning.external` for its places."""

from dataclasses import dataclass, replace
from typing import ClassVar

from mrp_sumo.core.options import option
from mrp_sumo.core.plan import PlanResult
from mrp_sumo.core.problem import Problem
from mrp_sumo.planning.external import assigns, check_command, plan_externally


@dataclass(frozen=True)
class External:
    """Another program, run by a command such as `lacam3 -m {map} -i {scen} -N {agents} -t {time_limit} -o {out}`."""

    assigns: ClassVar[bool] = False  # of one with {yaml_free} in its command: True
    guarantee: ClassVar[str] = "the program's own, not complete here"

    command: str = option("", "command line of the program, with places such as `{map}` and `{out}`")

    def __post_init__(self) -> None:
        if self.command:
            check_command(self.command)
            object.__setattr__(self, "assigns", assigns(self.command))

    def prepare(self) -> None:
        """There is nothing to prepare."""

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """SOLVED with the plan as read: judge it. TIMED_OUT when it had to be killed, else GAVE_UP or INFEASIBLE as it says."""
        result = plan_externally(self.command, problem, time_limit_s)
        return replace(result, planning_cpu_s=result.stats["cpu_s"])
