"""Continuous-time conflict-based search: optimal in continuous time, with the robots' real motion or with that of the literature.

Each node of a tree forbids robots some actions, and each robot takes its earliest way by safe interval planning; a conflict of two
robots is split into two children. In the literature's motion splits are disjoint: one child forbids a robot to depart to a lane within an
interval, the other demands it, and forbids the second robot what collides with every departure within it: departures, and stays that
begin too early and last too long (the interval of a vertex that plain CCBS forbids who waits loses solutions). In real motion either robot
is forbidden something, and both at once would conflict. So no solution is lost. Cardinal conflicts come first, and bounds count what pairs
of robots cost together.

With w above 1, the node with the fewest conflicts among those within w times the bound is next.

Sources: Andreychuk, Yakovlev, Surynek, Atzmon, Stern, "Multi-agent pathfinding with continuous time", AIJ 2022; Andreychuk, Yakovlev,
Boyarski, Stern, "Improving continuous-time conflict based search", AAAI 2021, for prioritised conflicts and disjoint splits; Li, Felner,
Boyarski, Ma, Koenig, "Improved heuristics for multi-agent path finding with conflict-based search", IJCAI 2019; Barer, Sharon, Stern,
Felner, "Suboptimal variants of the conflict-based search algorithm", SoCS 2014, for w.
"""

from dataclasses import dataclass, replace
from time import process_time
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.core.options import option
from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.answers import deadline_of, impossible, without_effort

if TYPE_CHECKING:
    from planners.safe_interval.conflict_tree import LowLevel

CHANCE = 15  # purpose of the stream of chance
MOTIONS = ("real", "unit")


@dataclass(frozen=True)
class Ccbs:
    """Conflict-based search in continuous time, for small fleets."""

    w: float = option(1.0, "allowed cost as a multiple of the optimum, 1 or more")
    motion: str = option("real", "`real`: the robots' own; `unit`: discs at one speed that turn at once, as in the literature")
    radius_m: float = option(0.0, "radius of discs (`motion: unit`); 0: half the distance that robots must keep")
    speed_mps: float = option(1.0, "speed of discs (`motion: unit`)")
    max_nodes: int = option(200_000, "nodes of the search tree at most")
    step_length_s: float = option(0.1, "step of the simulation that drives the plan")

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "w-bounded sum of costs in seconds (w = 1: optimal)"
    supports: ClassVar[frozenset[str]] = frozenset({"seconds", "effort"})

    def __post_init__(self) -> None:
        if not self.w >= 1:
            raise PlanError(f"w is {self.w}, expected 1 or more")
        if self.motion not in MOTIONS:
            raise PlanError(f"motion is {self.motion!r}, expected 'real' or 'unit'")
        if not (self.radius_m >= 0 and self.speed_mps > 0):
            raise PlanError(f"radius_m is {self.radius_m} and speed_mps {self.speed_mps}, expected 0 or more, and above 0")
        if self.max_nodes < 1:
            raise PlanError(f"max_nodes is {self.max_nodes}, expected 1 or more")
        if not 0.001 <= self.step_length_s <= 1.0:
            raise PlanError(f"step_length_s is {self.step_length_s}, expected 0.001 to 1")

    def prepare(self) -> None:
        """Compile or load the kernels."""
        from planners.safe_interval.conflict_tree import TimedTree

        problem = crossing()
        for w in {1.0, self.w}:
            replace(self, w=w, radius_m=min(self.radius_m, 0.4)).plan(problem, 600.0)
        motion = self._motion(problem, np.inf)
        motion.clash()
        motion.some_paths(np.random.default_rng(0), 0.0, np.inf)
        TimedTree(motion, range(2), np.inf).focal([motion.nothing] * 2, 1.0, 4, np.random.default_rng(0))

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """See `Planner`. GAVE_UP when the tree has `max_nodes`."""
        from planners.safe_interval.conflict_tree import OutOfTime, TimedTree

        began, deadline_s = process_time(), deadline_of(time_limit_s)
        counted = problem.effort > 0 and self.motion == "real"
        deadline_s = np.inf if counted else deadline_s
        if refusal := impossible(problem):
            return refusal
        if not problem.num_robots:
            return PlanResult(Status.SOLVED, plan_of_paths([], problem.step_s), planning_time_s=process_time() - began)
        motion = self._motion(problem, deadline_s)
        tree = TimedTree(motion, range(problem.num_robots), deadline_s)
        forbidden = [motion.nothing] * problem.num_robots
        paths, message = None, ""
        try:
            if clash := motion.clash():
                return PlanResult(Status.INFEASIBLE, planning_time_s=process_time() - began, message=clash)
            if self.w > 1:
                paths = tree.focal(forbidden, self.w, self.max_nodes, np.random.default_rng([problem.seed, CHANCE]))
            else:
                paths = tree.best_first(forbidden, self.max_nodes)
            status = Status.SOLVED if paths else Status.INFEASIBLE if tree.bound_s == float("inf") else Status.GAVE_UP
            message = {Status.INFEASIBLE: "no plan exists", Status.GAVE_UP: f"no plan among {tree.nodes} nodes"}.get(status, "")
        except OutOfTime:
            if counted:
                return without_effort(problem, began, nodes=float(tree.nodes), lower_bound_s=tree.bound_s)
            status, message = Status.TIMED_OUT, f"no plan within {time_limit_s:g} s"
        stats = {"nodes": float(tree.nodes), "lower_bound_s": tree.bound_s if status is not Status.INFEASIBLE else 0.0}
        # robots are there up to a step before they stand; no bound of discs holds for robots
        arrivals_s = stats["lower_bound_s"] - problem.num_robots * self.step_length_s if self.motion == "real" else 0.0
        return PlanResult(
            status,
            plan=motion.plan(paths) if paths else None,
            planning_time_s=process_time() - began,
            lower_bound_steps=max(0.0, arrivals_s) / problem.step_s,
            stats=stats | ({"cost_s": sum(map(motion.cost_s, paths))} if paths else {}),
            message=message,
        )

    def _motion(self, problem: Problem, deadline_s: float) -> "LowLevel":
        from planners.safe_interval.real_motion import RealMotion
        from planners.safe_interval.unit_motion import UnitMotion

        if self.motion == "unit":
            return UnitMotion(problem, self.radius_m or problem.fleet.separation_m / 2, self.speed_mps)
        return RealMotion(problem, self.step_length_s, deadline_s)


def crossing() -> Problem:
    """Two robots that have to wait for each other where they cross."""
    xy, pairs = [(0, 0), (2, 0), (-2, 0), (0, 2), (0, -2)], [(0, 1), (0, 2), (0, 3), (0, 4)]
    graph = nav_graph(name="crossing", xy=xy, lanes=[lane for a, b in pairs for lane in ((a, b), (b, a))])
    fleet = fleet_of(RobotType("cart", 0.5, 0.5, 1.0, 1.0, 1.0, 1.0), 2)
    start, goal = np.array([1, 3]), np.array([2, 4])
    return Problem(plan_graph(graph, kind="roadmap", cell_m=2.0), fleet, start, goal, np.arange(2), 3.0)
