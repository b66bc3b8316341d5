"""Ways through a window of unit steps, by the stops that robots have ahead, for priority-based search.

Sources: Li, Tinka, Kiesel, Durham, Kumar, Koenig, "Lifelong multi-agent path finding in large-scale warehouses", AAAI 2021
(rolling-horizon collision resolution); where no order has a plan, Li, Chen, Harabor, Stuckey, Koenig, "MAPF-LNS2", AAAI 2022.
"""

from dataclasses import dataclass
from time import process_time

import numpy as np

from mrp_sumo.core.graph import BoolArray, IntArray
from mrp_sumo.core.plan import Plan, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.search._distance import UNREACHABLE
from mrp_sumo.search.distance import distances
from mrp_sumo.traffic.clashes import clashes_of, with_beside
from planners.safe_interval._window_way import NOBODY, WindowTask, branch, find_all, mend, polish, room_for

CHANCE = 43  # purpose of the stream of chance
POLISH_LABELS = 2000  # a robot
MEND_LABELS = 100_000  # likewise
MEND_AT_ONCE = 1_000_000  # labels between looks at the clock
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
        self._holder = np.full((2, len(self._task.spot_first) - 1), NOBODY, np.int32)

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

    def mended(self, deadline_s: float) -> StepWays | None:
        """The ways of robots alone, planned again where they meet, whoever goes first, until nobody meets anybody; None without success."""
        paths, count, problem = self.alone(), self._room.count, self._problem
        most = int(count[1]) + MEND_LABELS * problem.num_robots
        most = min(most, problem.effort * 3 // 4 or most)  # the rest is for making ways shorter, these or those of robots that wait
        rng = np.random.default_rng([problem.seed, CHANCE])
        while paths is not None and count[1] < most and process_time() < deadline_s:
            if mend(self._task, self._room, self._holder, paths.at, paths.cost, min(most, int(count[1]) + MEND_AT_ONCE), rng):
                return paths
        return None

    def waited(self) -> StepWays | None:
        """The ways of robots that wait, but for those that can get on past all others; None where nobody can, or no effort is left."""
        at = np.repeat(self._problem.start.astype(np.int32)[:, None], self._problem.window_steps + 1, axis=1)
        paths = StepWays(at, np.where(self._task.least > 0, self._task.least + self._problem.window_steps, 0))
        self._shorten(paths)
        return paths if (at != at[:, :1]).any() else None

    def plan(self, paths: StepWays) -> tuple[Plan, dict[str, float]]:
        """The plan of ways that have been made shorter."""
        first_cost = self.cost(paths)
        self._shorten(paths)
        plan = plan_of_paths(list(paths.at.astype(np.int64)), self._problem.step_s)
        return plan, {"first_solution_cost": float(first_cost), "cost": float(self.cost(paths))}

    def _shorten(self, paths: StepWays) -> None:
        """Plan late robots again with those in their way, within the effort."""
        problem, count = self._problem, self._room.count
        most = int(count[1]) + POLISH_LABELS * problem.num_robots
        rng = np.random.default_rng([problem.seed, CHANCE])
        polish(self._task, self._room, paths.at, paths.cost, min(most, problem.effort or most), rng)


def task_of(problem: Problem) -> WindowTask:
    """The problem as kernels see it. Robots go as far as their stops can be reached one after the other, or stay at their starts."""
    graph, known, (clashes, spots) = problem.graph, distances(problem.graph), clashes_of(problem)
    ahead = []
    for start, via, goal in zip(problem.start.tolist(), problem.via or [()] * problem.num_robots, problem.target.tolist()):
        stops = [*via, goal]
        lost = (k for k, (at, v) in enumerate(zip([start, *via], stops)) if known.to(v)[at] >= UNREACHABLE)
        ahead.append(stops[: next(lost, len(stops))] or [start])
    stop = np.array([v for stops in ahead for v in stops], np.int64)
    first = np.cumsum([0, *map(len, ahead)]).astype(np.int64)
    steps = known.to_all(stop)
    after = np.zeros(len(stop), np.int64)
    for begin, end in zip(first[:-1].tolist(), first[1:].tolist()):
        for k in range(end - 2, begin - 1, -1):
            after[k] = after[k + 1] + steps[k + 1, stop[k]]
    least = steps[first[:-1], problem.start] + after[first[:-1]]
    places = graph.first, graph.head, spots.of, spots.first, spots.head, spots.tail, with_beside(clashes, spots)
    return WindowTask(*places, problem.start, first, stop, steps, after, least, problem.window_steps)
