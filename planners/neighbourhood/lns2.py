"""MAPF-LNS2: plan one after another with collisions allowed, then repair by large neighbourhood search.

Li, Chen, Harabor, Stuckey, Koenig, "MAPF-LNS2: fast repairing for multi-agent path finding via large
neighborhood search", AAAI 2022; what improves a plan without collisions is Li et al., "Anytime multi-agent path
finding via large neighborhood search", IJCAI 2021. Incomplete, no bound; in practice solves crowded instances at low cost.
"""

from dataclasses import dataclass
from time import process_time
from typing import ClassVar

import numpy as np

from mrp_sumo.core.options import option
from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.planning.answers import deadline_of, order_clash, require_least, unplanned, used_up, without_effort
from planners.neighbourhood._traffic import path_of
from planners.neighbourhood.refinement import (
    AT_ONCE,
    FOREVER,
    Refinement,
    Repair,
    first_order,
    is_roomy,
    polishing_labels,
    prepare,
    room_bytes,
    task_on,
    threads_with_room,
)
from planners.world import SLICE_S, ByConfigurations, build_world, is_large, solved, sum_of_costs, without_search

CHANCE = 13  # purpose of the stream of chance


@dataclass(frozen=True)
class Lns2:
    """MAPF-LNS2: plans with collisions are repaired; `anytime` spends the rest of the time on lowering the cost."""

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "valid, not complete"
    supports: ClassVar[frozenset[str]] = frozenset({"effort", "window"})

    anytime: bool = option(False, "spend the rest of the time limit on lowering the cost")
    following: bool = option(False, "also forbid entering a vertex in the step in which another robot leaves it")
    rotations: bool = option(True, "allow rings of robots that all move at once, where the policy can drive them")
    neighbourhood: int = option(8, "robots replanned at a time, half as many once there are no collisions")
    horizon: int = option(0, "steps planned for; 0: twice the longest path, plus 128 and half a step a robot")
    polish: int = option(2500, "labels a robot spent on improving the first plan, and more while half of them gains 1 %, 0 for none")
    memory_mb: int = option(2000, "limit for tables; gives up at once where they would take more")
    threads: int = option(1, "refiners that improve a plan together; as many as fit into `memory_mb`")
    bandit: bool = option(False, "improve around late robots where that has helped (ADDRESS)")

    def __post_init__(self) -> None:
        require_least(self, neighbourhood=1, memory_mb=1, threads=1, horizon=0, polish=0)

    def prepare(self) -> None:
        """Compile or load the kernels."""
        prepare(self.threads)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """SOLVED, TIMED_OUT with the number of pairs left in collision, GAVE_UP at the horizon, INFEASIBLE where nobody could plan."""
        begin_s = process_time()
        deadline_s = deadline_of(time_limit_s)
        packed = is_large(problem)
        table_bytes = problem.num_robots * problem.graph.num_vertices * (1 if packed else 16) // 4
        if table_bytes > self.memory_mb * 1_000_000:
            return unplanned(Status.GAVE_UP, begin_s, f"tables of distances take more than {self.memory_mb} MB")
        rules = ByConfigurations(following=self.following, rotations=self.rotations)
        try:
            world, steps = build_world(problem, deadline_s, packed=packed, rules=rules)
        except TimeoutError:
            return unplanned(Status.TIMED_OUT, begin_s, "the time limit passed while distances were computed")
        known = without_search(problem, steps, begin_s) or order_clash(problem)
        if known:
            return known
        lower_bound = float(steps.sum())
        rng = np.random.default_rng([problem.seed, CHANCE])
        task = task_on(problem, world)
        horizon = self.horizon or 2 * int(steps.max()) + 128 + problem.num_robots // 2
        horizon = max(horizon, int(steps.max()) + 2, problem.window_steps + 2)
        if (need := table_bytes + room_bytes(task, horizon) + problem.num_robots**2) > self.memory_mb * 1_000_000:
            message = f"tables of {horizon} steps take {need / 1e6:.0f} MB, expected at most {self.memory_mb} MB"
            return unplanned(Status.GAVE_UP, begin_s, message, lower_bound)
        paths = Repair(task, horizon, self.neighbourhood)
        order, clear = first_order(task, rng), is_roomy(task)
        for k, robot in enumerate(order):
            if process_time() > deadline_s or not paths.plan(order[k : k + 1], clear=clear):
                name = problem.fleet.robot_name[robot]
                is_late, late = process_time() > deadline_s, f"no solution within {time_limit_s:g} s"
                message = late if is_late else f"{name} has no path within {horizon} steps, collisions allowed"
                return unplanned(Status.TIMED_OUT if is_late else Status.GAVE_UP, begin_s, message, lower_bound)
        first_pairs = paths.num_pairs()
        pairs = self._repaired(paths, first_pairs, rng, deadline_s, problem.effort)
        stats = {"initial_pairs": float(first_pairs)}
        if pairs and used_up(problem, paths.labels):
            return without_effort(problem, begin_s, lower_bound, pairs=float(pairs), **stats)
        if pairs:
            message = f"{pairs} pairs of robots are left in collision after {time_limit_s:g} s"
            return unplanned(Status.TIMED_OUT, begin_s, message, lower_bound, pairs=float(pairs), **stats)
        path, left = path_of(paths.traffic.at, paths.traffic.end), max(1, problem.effort - paths.labels) if problem.effort else 0
        del paths  # polishing takes as much memory
        cost = sum_of_costs(path, task.goal)
        stats |= {"first_solution_time_s": process_time() - begin_s, "first_solution_cost": float(cost)}
        if (self.polish or self.anytime) and cost > lower_bound:
            threads = threads_with_room(self.threads, task, path, self.memory_mb, table_bytes)
            refinement = Refinement(task, path, (self.neighbourhood + 1) // 2, rng, threads=threads, bandit=self.bandit)
            self._polish(refinement, problem, left, deadline_s)
            path, cost = refinement.path(), refinement.cost
        path = path[: problem.window_steps + 1] if problem.window_steps else path
        return solved(problem, path, begin_s, lower_bound, cost=float(cost), **stats)

    def _repaired(self, paths: Repair, pairs: int, rng: np.random.Generator, deadline_s: float, effort: int) -> int:
        """Replan neighbourhoods until nobody collides, or time or effort are up; how many pairs are left.

        Where the effort in labels is bounded (not 0), it is looked at as often on every machine.
        """
        at_once = AT_ONCE if effort else 1  # neighbourhoods between two looks at the clock
        while pairs and (slice_s := process_time()) <= deadline_s and not 0 < effort <= paths.labels:
            pairs = paths.repair(pairs, at_once, rng)
            if not effort:
                at_once = max(1, int(at_once * min(SLICE_S / max(process_time() - slice_s, 1e-6), 2.0)))
        return pairs

    def _polish(self, refinement: Refinement, problem: Problem, left: int, deadline_s: float) -> None:
        """Make paths shorter by some work, of which no more than `left` labels (0: any) may be done; anytime, to the end."""
        polish = polishing_labels(self.polish, problem.num_robots, problem.window_steps)
        if not self.anytime:
            refinement.polish(deadline_s, polish, left or FOREVER)
            return
        refinement.until(deadline_s, most_labels=left or polish)
        while not left and refinement.cost > refinement.least and process_time() < deadline_s:
            refinement.until(min(deadline_s - 0.02, process_time() + 0.5))
