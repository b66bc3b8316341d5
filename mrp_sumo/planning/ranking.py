"""Assignments in the order of their cost, each computed when it is asked for.

Source: Murty, "An algorithm for ranking all the assignments in order of increasing cost", Operations Research
1968: the assignments other than the best are partitioned by the first robot that differs, and each part's best is
the next candidate.
"""

from collections.abc import Callable, Iterator
from heapq import heappop, heappush

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray


def ranked_assignments(cost: FloatArray, check_clock: Callable[[], None] = lambda: None) -> Iterator[tuple[float, IntArray]]:
    """All assignments that serve min(R, G) goals, cheapest first.

    Parameters
    ----------
    cost
        [R, G], inf where a robot cannot reach a goal.
    check_clock
        Called now and then while looking for the next one; may raise to give up.

    Yields
    ------
    cost, goal_of
        The sum, and [R] the goal of each robot, -1 for none.
    """
    from scipy.optimize import linear_sum_assignment

    num_robots, num_goals = cost.shape
    spare = np.zeros((num_robots, max(0, num_robots - num_goals)))  # goals that stand for none
    square = np.hstack([np.asarray(cost, np.float64), spare])
    finite = np.isfinite(square)
    never = float(np.abs(square[finite]).max(initial=0) + 1) * (num_robots + 1)
    square = np.where(finite, square, never)
    robots = np.arange(num_robots)
    number = 0
    queue: list[tuple[float, int, IntArray, FloatArray, int]] = []

    def consider(matrix: FloatArray, fixed: int) -> None:
        nonlocal number
        choice = linear_sum_assignment(matrix)[1]
        chosen = matrix[robots, choice]
        if (chosen < never).all():
            number += 1
            heappush(queue, (float(chosen.sum()), number, choice, matrix, fixed))

    check_clock()
    consider(square, 0)
    seen: set[bytes] = set()
    while queue:
        total, _, choice, matrix, fixed = heappop(queue)
        goal_of = np.where(choice < num_goals, choice, -1).astype(np.int64)
        if goal_of.tobytes() not in seen:  # they differ in which spare goal a robot without a goal has
            seen.add(goal_of.tobytes())
            yield total, goal_of
        rest = matrix
        for robot in range(fixed, num_robots):
            check_clock()
            part = rest.copy()
            part[robot, choice[robot]] = never
            consider(part, robot)
            rest = rest.copy()  # from here on the robot keeps its goal
            before = rest[robot, choice[robot]]
            rest[robot] = never
            rest[:, choice[robot]] = never
            rest[robot, choice[robot]] = before
