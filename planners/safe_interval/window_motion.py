"""Ways through a window of unit steps, by the stops that robots have ahead, for priority-based search.

Source: Li, Tinka, Kiesel, Durham, Kumar, Koenig, "Lifelong multi-agent path finding in large-scale warehouses", AAAI 2021
(rolling-horizon collision resolution).
"""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.graph import BoolArray, IntArray
from mrp_sumo.core.plan import Plan, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.search.distance import distances
from mrp_sumo.traffic.clashes import clashes_of
from planners.safe_interval._window_way import NOBODY, WindowTask, branch, find_all, polish, room_for

CHANCE = 43  # purpose of the stream of chance
POLISH_LABELS = 2000  # a robot
MOST_STEPS = 1000
MOST_DEEP = 64 << 20  # bytes of nodes that are kept; beyond, the worse of two children is dropped


@dataclass(frozen=True, eq=False)
class StepWays:
    """The ways of R robots through a window of W steps."""

    at: np.ndarray  # [R, W + 1] int32 vertices
    cost: IntArray  # [R] steps, with those that they take beyond the window


class WindowSteps:
    """A problem with a window, for priority-based search; see `PriorityMotion`."""

    def __init__(self, problem: Problem) -> None:
        """Refuse longer windows than there is room for, with a PlanError."""
        if problem.window_steps > MOST_STEPS:
            raise PlanError(f"pbs plans in windows of at most {MOST_STEPS} steps, found {problem.window_steps}")
        robots = problem.num_robots
        self._problem, self._task = problem, task_of(problem)
        self.least_steps = float(self._task.least.sum())
        self.most_open = max(8, min(4 * robots, MOST_DEEP // max(robots * (robots + 4 * problem.window_steps + 12), 1)))
        self._room = room_for(self._task)
        self._holder = np.full((2, problem.graph.num_vertices), NOBODY, np.int32)

    def counters(self) -> dict[str, float]:
        return {"labels": float(self._room.count[1])}

    def alone(self) -> StepWays | None:
        shape = self._problem.num_robots, self._problem.window_steps + 1
        paths = StepWays(np.zeros(shape, np.int32), np.zeros(shape[0], np.int64))
        return paths if find_all(self._task, self._room, paths.at, paths.cost) else None

    def branched(self, paths: StepWays, above: BoolArray) -> list[tuple[BoolArray, StepWays]] | None:
        """By one kernel: to be called takes it longer than to work."""
        orders, at, cost = (np.array((each, each)) for each in (above, paths.at, paths.cost))
        meets, one, other = branch(self._task, self._room, self._holder, orders, at, cost)
        return [(orders[k], StepWays(at[k], cost[k])) for k, has_ways in enumerate((one, other)) if has_ways] if meets else None

    def cost(self, paths: StepWays) -> int:
        return int(paths.cost.sum())

    def plan(self, paths: StepWays) -> tuple[Plan, dict[str, float]]:
        """The plan of ways that have been made shorter."""
        problem, first_cost = self._problem, self.cost(paths)
        most = int(self._room.count[1]) + POLISH_LABELS * problem.num_robots
        rng = np.random.default_rng([problem.seed, CHANCE])
        most = min(most, problem.effort or most)
        polish(self._task, self._room, paths.at, paths.cost, most, rng)
        plan = plan_of_paths(list(paths.at.astype(np.int64)), problem.step_s)
        return plan, {"first_solution_cost": float(first_cost), "cost": float(self.cost(paths))}


def task_of(problem: Problem) -> WindowTask:
    """The problem as kernels see it."""
    graph, known = problem.graph, distances(problem.graph)
    ahead = [[*via, goal] for via, goal in zip(problem.via or [()] * problem.num_robots, problem.target.tolist())]
    stop = np.array([v for stops in ahead for v in stops], np.int64)
    first = np.cumsum([0, *map(len, ahead)]).astype(np.int64)
    steps = known.to_all(stop)
    after = np.zeros(len(stop), np.int64)
    for begin, end in zip(first[:-1].tolist(), first[1:].tolist()):
        for k in range(end - 2, begin - 1, -1):
            after[k] = after[k + 1] + steps[k + 1, stop[k]]
    least = steps[first[:-1], problem.start] + after[first[:-1]]
    return WindowTask(
        graph.first, graph.head, graph.tail, clashes_of(problem), problem.start, first, stop, steps, after, least, problem.window_steps
    )
