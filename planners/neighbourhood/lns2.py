"""MAPF-LNS2: plan one after another with collisions allowed, then repair by large neighbourhood search.

Li, Chen, Harabor, Stuckey, Koenig, "MAPF-LNS2: fast repairing for multi-agent path finding via large
neighborhood search", AAAI 2022; what improves a plan without collisions is Li et al., "Anytime multi-agent path
finding via large neighborhood search", IJCAI 2021. Incomplete, no bound; in practice solves crowded instances at low cost.
"""

from dataclasses import dataclass
from time import process_time
from typing import ClassVar

import numpy as np

from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.answers import deadline_of, order_clash, unplanned, used_up, without_effort

CHANCE = 13  # purpose of the stream of chance


@dataclass(frozen=True)
class Lns2:
    """MAPF-LNS2: plans with collisions are repaired; `anytime` spends the rest of the time on lowering the cost."""

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "valid, not complete"
    supports: ClassVar[frozenset[str]] = frozenset({"effort", "window"})

    anytime: bool = False
    following: bool = False  # avoid following conflicts too: nobody enters a vertex in the step its holder leaves
    rotations: bool = True  # rings of robots may move at once
    neighbourhood: int = 8  # robots replanned at a time while there are collisions; half as many afterwards
    horizon: int = 0  # steps to plan for; 0: twice the longest path, plus 128 and half a step per robot
    polish: int = 2500  # labels per robot to spend on improving the first solution, see `polishing_labels`; 0 for none
    memory_mb: int = 2000  # for tables; gives up at once where they would take more
    threads: int = 1  # that improve the plan, as many as have room for tables of their own
    bandit: bool = False  # improve around late robots for whom it has paid, instead of by three kinds of neighbourhoods

    def __post_init__(self) -> None:
        if self.neighbourhood < 1 or self.memory_mb < 1 or self.threads < 1 or self.horizon < 0 or self.polish < 0:
            raise PlanError("lns2: expected neighbourhood, memory_mb and threads of 1 or more, horizon and polish of 0 or more")

    def prepare(self) -> None:
        """Compile or load the kernels."""
        from planners.neighbourhood.refinement import prepare

        prepare(self.threads)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """SOLVED, TIMED_OUT with the number of pairs left in collision, GAVE_UP at the horizon, INFEASIBLE where nobody could plan."""
        from mrp_sumo.search.distance import UNREACHABLE
        from planners.neighbourhood._traffic import path_of
        from planners.neighbourhood.refinement import (
            Refinement,
            first_order,
            plan_in_order,
            polishing_labels,
            repair,
            room_bytes,
            room_to_repair,
            task_of,
            threads_with_room,
        )
        from planners.world import (
            solved,
            steps_table,
            sum_of_costs,
            without_search,
        )

        begin_s = process_time()
        deadline_s = deadline_of(time_limit_s)
        if 4 * problem.num_robots * problem.graph.num_vertices > self.memory_mb * 1_000_000:
            return unplanned(Status.GAVE_UP, begin_s, f"tables of distances take more than {self.memory_mb} MB")
        table = steps_table(problem, deadline_s)
        if table is None:
            return unplanned(Status.TIMED_OUT, begin_s, "the time limit passed while distances were computed")
        steps = table[np.arange(problem.num_robots), problem.start].astype(np.int64)
        steps[steps >= UNREACHABLE] = -1
        known = without_search(problem, steps, begin_s) or order_clash(problem)
        if known:
            return known
        lower_bound = float(steps.sum())
        rng = np.random.default_rng([problem.seed, CHANCE])
        task = task_of(problem, table)
        horizon = self.horizon or 2 * int(steps.max()) + 128 + problem.num_robots // 2
        horizon = max(horizon, int(steps.max()) + 2, problem.window_steps + 2)
        if (need := table.nbytes + room_bytes(task, horizon) + problem.num_robots**2) > self.memory_mb * 1_000_000:
            message = f"tables of {horizon} steps take {need / 1e6:.0f} MB, expected at most {self.memory_mb} MB"
            return unplanned(Status.GAVE_UP, begin_s, message, lower_bound)
        window = problem.window_steps
        kind = {"following": self.following, "rotations": self.rotations}
        room = room_to_repair(task, horizon, self.neighbourhood, window=window, **kind)
        order = first_order(task, rng)
        planned = plan_in_order(task, room, order, deadline_s)
        if planned < len(order):
            if process_time() > deadline_s:
                return unplanned(Status.TIMED_OUT, begin_s, f"no solution within {time_limit_s:g} s", lower_bound)
            name = problem.fleet.robot_name[order[planned]]
            return unplanned(Status.GAVE_UP, begin_s, f"{name} has no path within {horizon} steps, collisions allowed", lower_bound)
        first_pairs, pairs = repair(task, room, self.neighbourhood, rng, deadline_s, problem.effort)
        stats = {"initial_pairs": float(first_pairs)}
        labels = int(room[1].stamp[1])
        if pairs and used_up(problem, labels):
            return without_effort(problem, begin_s, lower_bound, pairs=float(pairs), **stats)
        if pairs:
            message = f"{pairs} pairs of robots are left in collision after {time_limit_s:g} s"
            return unplanned(Status.TIMED_OUT, begin_s, message, lower_bound, pairs=float(pairs), **stats)
        path = path_of(room[0])
        left = max(1, problem.effort - labels) if problem.effort else 0
        cost = sum_of_costs(path, task.goal)
        stats |= {"first_solution_time_s": process_time() - begin_s, "first_solution_cost": float(cost)}
        del room
        if (self.polish or self.anytime) and cost > lower_bound:
            threads = threads_with_room(self.threads, task, path, self.memory_mb, table.nbytes)
            size = (self.neighbourhood + 1) // 2
            refinement = Refinement(task, path, size, rng, window=window, threads=threads, bandit=self.bandit, **kind)
            polish = polishing_labels(self.polish, problem.num_robots, window)
            refinement.until(deadline_s, most_labels=left if left and (self.anytime or left < polish) else polish)
            while self.anytime and not left and refinement.cost > lower_bound and process_time() < deadline_s:
                refinement.until(min(deadline_s - 0.02, process_time() + 0.5))
            path, cost = refinement.path(), refinement.cost
        path = path[: window + 1] if window else path
        return solved(problem, path, begin_s, lower_bound, cost=float(cost), **stats)
