"""EPIBT: PIBT over operations, for robots that turn and whose tasks never end.

Enhanced PIBT (AAAI 2026) has robots choose sequences of a few actions rather than the next one: a robot that has to turn first, or
to wait for another that turns, can say so. Operations are inherited from step to step, and a robot may be pushed again while
another one chooses. Here they are improved too, a counted number of times: a robot that is drawn takes another operation, pushing
others, where the steps that are left fall for all together, in crowds those of who chose early counting most. Robots choose in the
order of the steps to the ends of their tasks, shuffled a little: in a fixed order those that stand off do so for good. In crowds
ways count as longer where robots wait, and against the stream, as in guidance graphs, and those who are last go to where there is
room, and who stands in a dead end that another has to go into comes before it; where a few jams block an empty floor, those who are
last are held back (`traffic`). Written from the description alone. No guarantee: robots may block each other; where none gets on
any more they are led out, if there is a way (`way_out`).
"""

from dataclasses import dataclass, replace

import numpy as np

from mrp_sumo.core.step_wise import StepWiseProblem
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.step_wise import run_step_wise
from planners.step_wise.ground import FreeCells
from planners.step_wise.stepper import OperationStepper, StepEffort
from planners.step_wise.tasks import Choice
from planners.step_wise.traffic import CROWDED

GUIDED = 0.02  # robots per free cell from which rows and columns have directions, for some twenty robots
FEW = 20
SPARSE, NUM_SPARSE = 0.3, 2000  # robots per free cell below which, and number up to which, operations are longer, and directions weaker
FADES = 3.0  # elsewhere those who are drawn undo each other's turns, unless the costs of the first in the order count more
DENSE = 0.9  # robots per free cell from which operations are shorter: longer ones collide with more than one other


@dataclass(frozen=True)
class Epibt:
    """PIBT over operations: fast, no guarantee."""

    depth: int = 0  # actions of an operation, 1 to 6; 0: 5, or by how many robots there are 4 or 3
    tries: int = -1  # how many times a step a robot that is drawn may change its operation where all gain by it; -1: 3 per robot
    limit: int = 0  # operations that are looked at when one robot chooses, with all that it pushes; 0: 3,000, or 30,000 in crowds and jams
    tasks: Choice = "nearest"  # or "in_turn": robot r of R has the tasks r, r + R, ...
    against: int = -1  # what a step against the direction of a row or column counts more at first; -1: by how many robots there are
    work: int = 50_000_000  # states of tables of distances that are filled in a step: about a quarter of a second
    memory_mb: int = 10_000  # for tables of distances

    def __post_init__(self) -> None:
        if not 0 <= self.depth <= 6:
            raise PlanError(f"depth is {self.depth}, expected 0 to 6")
        if self.tries < -1 or self.limit < 0 or self.work < 1 or self.memory_mb < 1 or not -1 <= self.against <= 100:
            raise PlanError("expected tries of -1 or more, limit of 0 or more, work and memory_mb of 1 or more and against of -1 to 100")

    def prepare(self) -> None:
        """Compile or load the kernels, by a few steps on a map of four cells."""
        free, cells = np.ones((2, 2), np.bool_), np.arange(4)
        problem = StepWiseProblem("four cells", free, cells[:2], np.arange(5), cells, 2)
        run_step_wise(problem, replace(self, depth=1, tries=1, limit=10, tasks="nearest", memory_mb=1), 2)

    def begin(self, problem: StepWiseProblem, seed: int) -> OperationStepper:
        """The planner at work."""
        share = problem.num_robots / problem.free.sum()
        is_sparse = share < SPARSE and problem.num_robots <= NUM_SPARSE
        depth = self.depth or (5 if is_sparse else 3 if share > DENSE else 4)
        limit = (self.limit, self.limit) if self.limit else (30_000, 30_000 if share >= CROWDED else 3000)  # in jams, elsewhere
        tries = self.tries if self.tries >= 0 else 3 * problem.num_robots
        against = 0 if share < GUIDED or problem.num_robots < FEW else 1 if is_sparse else 2
        ground = FreeCells(problem, self.memory_mb, against if self.against < 0 else self.against, self.work)
        effort = StepEffort(depth, limit, tries, 0.0 if is_sparse else FADES)
        return OperationStepper(problem, seed, effort, self.tasks, ground)
