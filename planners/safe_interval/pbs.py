"""Priority-based search with the robots' real motion: which of two robots in conflict goes first is branched on, depth first.

In a window it plans in unit steps, by all stops that robots have ahead.

Each robot takes the earliest way around those above it (see `continuous` for ways, times and resources); two robots in conflict without
a priority between them are a branching. Guarantee: drivable, not complete, though it finds plans that no fixed order of robots has.

Source: Ma, Harabor, Stuckey, Li, Koenig, "Searching with consistent prioritization for multi-agent path finding", AAAI 2019.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from time import process_time
from typing import TYPE_CHECKING, ClassVar

import numpy as np

from mrp_sumo.core.graph import BoolArray, IntArray
from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.answers import impossible, require_limit, used_up, without_effort

if TYPE_CHECKING:
    from planners.safe_interval.timetable import TimedPath, Timetable

MOST = 200_000  # entries a search looks at


@dataclass(frozen=True)
class Pbs:
    """Priority-based search with the robots' real motion."""

    max_nodes: int = 20_000  # of the tree
    step_length_s: float = 0.1  # of the simulation that is to drive the plan

    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "drivable, not complete"
    supports: ClassVar[frozenset[str]] = frozenset({"seconds", "effort", "types", "window", "stops"})

    def __post_init__(self) -> None:
        if self.max_nodes < 1:
            raise PlanError(f"max_nodes is {self.max_nodes}, expected 1 or more")
        if not 0.001 <= self.step_length_s <= 1.0:
            raise PlanError(f"step_length_s is {self.step_length_s}, expected 0.001 to 1")

    def prepare(self) -> None:
        """Compile or load the kernels."""
        from planners.world import small_problem

        self.plan(small_problem(), 60.0)
        self.plan(replace(small_problem(), window_steps=4), 60.0)

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """See `Planner`. GAVE_UP when the tree is searched, or has `max_nodes`."""
        from planners.safe_interval.timetable import Timetable

        require_limit(time_limit_s)
        began = process_time()
        if refusal := impossible(problem):
            return refusal
        if problem.window_steps and problem.num_robots:
            from planners.safe_interval.window_search import plan_window

            return plan_window(problem.for_any(), time_limit_s, self.max_nodes)
        if not problem.num_robots:
            return PlanResult(Status.SOLVED, plan_of_paths([], problem.step_s), planning_time_s=process_time() - began)
        timetable = Timetable(problem, self.step_length_s)
        for robot in range(problem.num_robots):
            timetable.look_back(robot)
        root = PriorityNode(
            np.zeros((problem.num_robots, problem.num_robots), np.bool_), [timetable.ideal(r) for r in range(problem.num_robots)]
        )
        stack, nodes, status = [root], 0, Status.GAVE_UP
        while stack and nodes < self.max_nodes:
            if process_time() - began > time_limit_s:
                status = Status.TIMED_OUT
                break
            if used_up(problem, timetable.work):
                return without_effort(problem, began, nodes=float(nodes))
            node = stack.pop()
            nodes += 1
            pair = first_conflict(node.ways)
            if pair is None:
                timetable.clear()
                for robot, way in enumerate(node.ways):
                    timetable.add(robot, way)
                least_s = np.maximum(timetable.alone - 1, 0).sum() * self.step_length_s  # arrivals are within a step
                cost, bound = timetable.steps.sum(), timetable.alone.sum()
                return PlanResult(
                    Status.SOLVED,
                    plan=timetable.plan(),
                    planning_time_s=process_time() - began,
                    lower_bound_steps=float(least_s / problem.step_s),
                    stats={
                        "nodes": float(nodes),
                        "cost_s": float(cost * self.step_length_s),
                        "lower_bound_s": float(bound * self.step_length_s),
                        "entries": float(timetable.work),
                    },
                )
            children = [child for above, below in (pair, pair[::-1]) if (child := below_each_other(timetable, node, above, below))]
            stack += sorted(children, key=lambda child: -sum(way.steps for way in child.ways))
        return PlanResult(
            status,
            planning_time_s=process_time() - began,
            stats={"nodes": float(nodes), "entries": float(timetable.work)},
            message=f"no plan among {nodes} orders of priorities",
        )


@dataclass(frozen=True, eq=False)
class PriorityNode:
    """Priorities, and the ways of R robots that keep them."""

    above: BoolArray  # [R, R] whether one robot goes before another, as far as that is decided
    ways: "list[TimedPath]"


def first_conflict(ways: "list[TimedPath]") -> tuple[int, int] | None:
    """The two robots that hold one resource at once the earliest."""
    from planners.safe_interval._overlaps import first_overlap
    from planners.safe_interval._table import FOREVER

    earliest, pair = FOREVER, None
    for i, one in enumerate(ways):
        for j in range(i + 1, len(ways)):
            other = ways[j]
            overlap = first_overlap(one.resource, one.begin, one.end, other.resource, other.begin, other.end)
            if overlap < earliest:
                earliest, pair = overlap, (i, j)
    return pair


def below_each_other(timetable: "Timetable", node: PriorityNode, first: int, second: int) -> PriorityNode | None:
    """The node in which one robot goes before another; None where somebody finds no way.

    Whoever is in conflict with those above looks for another way. Those above may be in conflict with each other still.
    """
    from planners.safe_interval._table import settle

    above = node.above.copy()
    over, under = above[:, first].copy(), above[second].copy()
    over[first] = under[second] = True
    above |= over[:, None] & under[None, :]
    ways = list(node.ways)
    for robot in in_order(above, under):
        timetable.clear()
        for other in np.flatnonzero(above[:, robot]).tolist():
            timetable.add(other, ways[other])
        settle(timetable.table)
        if len(timetable.hinders(robot, ways[robot])):
            way = timetable.search(robot, MOST)
            if way is None:
                return None
            ways[robot] = way
    return PriorityNode(above, ways)


def in_order(above: BoolArray, robots: BoolArray) -> Iterator[int]:
    """Some robots, each after those above it."""
    rank: IntArray = above.sum(0)  # the relation is transitive
    yield from np.flatnonzero(robots)[np.argsort(rank[robots], kind="stable")].tolist()
