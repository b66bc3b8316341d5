"""PIBT for robots that turn: the baseline of step-wise planning. Each robot chooses its next action only."""

from dataclasses import dataclass

from mrp_sumo.core.step_wise import StepWiseProblem
from mrp_sumo.errors import PlanError
from planners.step_wise._stepper import OperationStepper
from planners.step_wise._tasks import Choice
from planners.step_wise._warm import prepare


@dataclass(frozen=True)
class TurningPibt:
    """PIBT of single actions, with turns: the baseline."""

    limit: int = 3000  # actions that are looked at when one robot chooses, with all that it pushes
    tasks: Choice = "nearest"  # or "in_turn": robot r of R has the tasks r, r + R, ...
    memory_mb: int = 3000  # for tables of distances

    def __post_init__(self) -> None:
        if self.limit < 1 or self.memory_mb < 1:
            raise PlanError("expected limit and memory_mb of 1 or more")

    def prepare(self) -> None:
        """Compile or load the kernels."""
        prepare()

    def begin(self, problem: StepWiseProblem, seed: int) -> OperationStepper:
        """The planner at work."""
        return OperationStepper(problem, seed, 1, self.limit, 0, self.tasks, self.memory_mb)
