"""LaCAM*: lazy constraints addition search, anytime.

Okumura, AAAI 2023, IJCAI 2023 and AAMAS 2024 (titles in `_lacam.py`). Searches configurations depth first; PIBT
proposes the next one, and constraints are added only where the search comes by again. Complete: finds a
solution or proves that there is none, given time and memory. Anytime, it goes on after the first solution and
converges to the least sum of loss.
"""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

from mrp_sumo.core.plan import PlanResult
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from planners.parameters import check_local


@dataclass(frozen=True)
class Lacam:
    """LaCAM; with `anytime` LaCAM*, which uses all its time unless it proves optimality.

    Where robots use the map thinly, the first solution is one of prioritised planning, see `first_paths`. Elsewhere robots are guided by
    ways of their own where lanes are little used, see `_ways`, and else, where tables allow, by the traffic flow at first, see `_flow`;
    before each step, they are led round each other by local guidance, see `_local_guidance`.
    Where tables allow, the first solution is polished by
    large neighbourhood search for a fixed amount of work; anytime, the rest of the time goes to both the search and
    the neighbourhoods.
    """

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "complete; eventually optimal in sum of loss when anytime"
    supports: ClassVar[frozenset[str]] = frozenset({"effort", "window"})

    anytime: bool = False
    following: bool = False  # avoid following conflicts too: nobody enters a vertex in the step its holder leaves
    rotations: bool = True  # rings of robots may move at once
    num_tries: int = 1  # configurations generated each time, of which the best is kept
    hindrance: bool = True  # prefer, among equally near vertices, those that fewer neighbours want
    ways: int = 2  # rounds of giving robots shortest ways that meet few others, where lanes are little used; 0 for none
    flow: int = 1  # rounds of giving robots guide paths that avoid oncoming traffic, elsewhere; 0 for none
    local: int = 14  # steps of short paths that robots are given before each step, around each other's; 0 for none
    traffic: int = 0  # further solutions, guided by the traffic in those before, see `_traffic_map`; 0 for none
    polish: int = 1800  # labels per robot to spend on improving the first solution, see `polishing_labels`; 0 for none
    neighbourhood: int = 4  # robots replanned at a time
    memory_mb: int = 2000  # for the search, and for neighbourhoods; beyond it gives up, or keeps what it has
    threads: int = 1  # that improve the first solution, as many as have room for tables of their own
    bandit: bool = False  # improve around late robots for whom it has paid, instead of by three kinds of neighbourhoods

    def __post_init__(self) -> None:
        for key in ("num_tries", "neighbourhood", "memory_mb", "threads"):
            if getattr(self, key) < 1:
                raise PlanError(f"lacam: {key} is {getattr(self, key)}, expected 1 or more")
        for key in ("ways", "flow", "traffic", "polish"):
            if getattr(self, key) < 0:
                raise PlanError(f"lacam: {key} is {getattr(self, key)}, expected 0 or more")
        check_local("lacam", self.local)

    def prepare(self) -> None:
        """Compile or load the kernels."""
        from planners.configuration.lacam_search import prepare_to_grow
        from planners.neighbourhood.refinement import prepare
        from planners.world import small_problem

        replace(self, ways=0, flow=1, polish=10, anytime=True)._plan(small_problem(), math.inf, False)
        replace(self, ways=1, flow=0, polish=0)._plan(small_problem(), math.inf, False)
        replace(self, ways=0, flow=0, traffic=1, polish=0)._plan(small_problem(), math.inf, False)
        self._plan(small_problem(), math.inf, True)
        prepare(self.threads)
        prepare_to_grow()

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """SOLVED, with the best plan found if anytime; INFEASIBLE with proof; TIMED_OUT."""
        return self._plan(problem, time_limit_s, None)

    def _plan(self, problem: Problem, time_limit_s: float, packed: bool | None) -> PlanResult:
        from planners.configuration.lacam_search import plan_by_lacam

        return plan_by_lacam(self, problem, time_limit_s, packed)
