"""Compiles or loads the kernels of step-wise planners, by a few steps on a map of four cells."""

import numpy as np

from mrp_sumo.core.step_wise import StepWiseProblem
from mrp_sumo.planning.step_wise import run_step_wise
from planners.step_wise._stepper import OperationStepper


class _Small:
    """Operations of one action."""

    def prepare(self) -> None:
        """Nothing."""

    def begin(self, problem: StepWiseProblem, seed: int) -> OperationStepper:
        """At work."""
        return OperationStepper(problem, seed, 1, 10, 1, "nearest", 1)


def prepare() -> None:
    """Have all kernels ready."""
    free, cells = np.ones((2, 2), np.bool_), np.arange(4)
    run_step_wise(StepWiseProblem("four cells", free, cells[:2], np.arange(5), cells, 2), _Small(), 2)
