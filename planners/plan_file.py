"""No search at all: the plan is in a file, of this program or of another."""

from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import ClassVar

from mrp_sumo.core.options import option
from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError


@dataclass(frozen=True)
class PlanFile:
    """A plan that was made before, in any format that `mrp-sumo validate` reads."""

    assigns: ClassVar[bool] = True  # the goals at which it ends
    guarantee: ClassVar[str] = "none: as it is"
    supports: ClassVar[tuple[str, ...]] = ("seconds",)

    path: str = option("", "file of the plan, relative to the scenario")

    def prepare(self) -> None:
        """There is nothing to prepare."""

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """SOLVED with the plan in the file, which may have conflicts; raises PlanError where it is none for this problem."""
        from mrp_sumo.formats.peers import cells_of
        from mrp_sumo.formats.plan_files import plan_and_goals

        if not self.path:
            raise PlanError("plan_file: no path, expected the file of a plan")
        begin_s = process_time()
        plan, problem, note = plan_and_goals(Path(self.path), problem, cells_of(problem.graph))
        return PlanResult(Status.SOLVED, plan, problem.goal_of, process_time() - begin_s, message=note)
