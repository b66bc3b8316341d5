"""The tree of priority-based search over any motion: nodes say which robots go before which, and each robot's way keeps to that."""

from collections.abc import Callable
from time import process_time
from typing import Protocol, TypeVar

import numpy as np

from mrp_sumo.core.graph import BoolArray, IntArray
from mrp_sumo.core.plan import Plan, PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.planning.answers import unplanned, used_up, without_effort
from planners.safe_interval._priorities import put_before

Ways = TypeVar("Ways")


class PriorityMotion(Protocol[Ways]):
    """Motion of robots, with paths of all in a form of its own."""

    most_open: int  # nodes still to be looked at; beyond, the worse of two children is dropped
    least_steps: float  # a lower bound on the sum of costs

    def counters(self) -> dict[str, float]:
        """The labels or entries of searches so far, and nothing else."""

    def alone(self) -> Ways | None:
        """The ways of robots of which none goes before another; None where somebody has none."""

    def branched(self, paths: Ways, above: BoolArray) -> list[tuple[BoolArray, Ways]] | None:
        """The orders, with ways in them, in which one of the two robots that meet first goes before the other; None where nobody meets.

        `above` [R, R] is whether one robot goes before another, as far as that is decided. The order in which the second of both goes first
        comes first; one in which somebody finds no way is left out. See `branched_on`.
        """

    def cost(self, paths: Ways) -> int:
        """Of all robots."""

    def plan(self, paths: Ways) -> tuple[Plan, dict[str, float]]:
        """The plan of ways without conflicts, made shorter or as they are, and what it costs."""


def branched_on(
    pair: tuple[int, int], paths: Ways, above: BoolArray, replanned: Callable[[Ways, BoolArray, IntArray], Ways | None]
) -> list[tuple[BoolArray, Ways]]:
    """See `PriorityMotion.branched`; `pair` are two robots that meet.

    `replanned` gives the ways in an order where some robots, of which each comes after those above it, look for others if those above them
    are in their way; None where somebody finds none. Those above may be in conflict with each other still.
    """
    orders = []
    for first, second in (pair[::-1], pair):
        if not above[second, first]:
            order = above.copy()
            new = replanned(paths, order, put_before(order, first, second))
            if new is not None:
                orders.append((order, new))
    return orders


def search(motion: PriorityMotion[Ways], problem: Problem, began: float, deadline_s: float, max_nodes: int) -> PlanResult:
    """Look at nodes, priorities and ways that keep them, depth first, the cheaper child first, until one of `max_nodes` has no conflict.

    `began` and `deadline_s` are on the clock of `process_time`.
    """
    alone = motion.alone()
    stack = [] if alone is None else [(np.zeros((problem.num_robots, problem.num_robots), np.bool_), alone)]
    nodes = 0
    status = Status.GAVE_UP
    while stack and nodes < max_nodes:
        if process_time() > deadline_s:
            status = Status.TIMED_OUT
            break
        if used_up(problem, sum(motion.counters().values())):
            return without_effort(problem, began, motion.least_steps, nodes=float(nodes))
        above, paths = stack.pop()
        nodes += 1
        children = motion.branched(paths, above)
        if children is None:
            stats = {"nodes": float(nodes), **motion.counters()}
            plan, costs = motion.plan(paths)
            took_s = process_time() - began
            return PlanResult(Status.SOLVED, plan, None, took_s, lower_bound_steps=motion.least_steps, stats=stats | costs)
        children.sort(key=lambda child: -motion.cost(child[1]))
        stack += children if len(stack) + len(children) <= motion.most_open else children[-1:]
    message = f"no plan among {nodes} orders of priorities"
    return unplanned(status, began, message, motion.least_steps, nodes=float(nodes), **motion.counters())
