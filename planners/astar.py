"""Independent A*: every robot takes a shortest path of its own, as if it were alone. Guarantee: none, plans may collide.

Source: Hart, Nilsson, Raphael, "A formal basis for the heuristic determination of minimum cost paths", IEEE TSSC
1968. With the exact distance table as heuristic, A* expands the vertices of one shortest path only.
"""

from dataclasses import dataclass
from time import process_time
from typing import ClassVar

from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.planning.answers import deadline_of, impossible
from mrp_sumo.search.distance import distances


@dataclass(frozen=True)
class AStar:
    """Independent shortest paths, which may collide: the baseline. Their sum of costs is a lower bound for every other planner."""

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "no coordination"

    def prepare(self) -> None:
        """See `Planner`."""
        from planners.world import small_problem

        self.plan(small_problem(), 1.0)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """See `Planner`. SOLVED whether or not the paths collide, which the referee judges."""
        from mrp_sumo.search._distance import shortest_path

        began = process_time()
        deadline_of(time_limit_s)  # refuses what is none; there is no need for it
        if refusal := impossible(problem):
            return refusal
        tables = distances(problem.graph)
        table = tables.to_all(problem.target)
        paths = [shortest_path(tables.first, tables.head, table[r], problem.start[r]) for r in range(problem.num_robots)]
        return PlanResult(
            Status.SOLVED,
            plan=plan_of_paths(paths, problem.step_s),
            planning_time_s=process_time() - began,
            lower_bound_steps=float(sum(len(path) - 1 for path in paths)),
        )
