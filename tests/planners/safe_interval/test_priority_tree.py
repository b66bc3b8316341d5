"""The tree of priorities, over a motion that is made up: robots meet as a table says, and costs follow from who goes first."""

import numpy as np
import pytest
from worlds import line, problem_on

from mrp_sumo.core.plan import Status, plan_of_paths
from planners.safe_interval.priority_tree import branched_on, search


class Talk:
    """Robots of a list of pairs meet until one of both goes before the other; a way that is below others costs what `price` says."""

    least_steps = 3.0

    def __init__(self, pairs, price=lambda above: 0, most_open=99):
        self.pairs, self.price, self.most_open, self.seen = pairs, price, most_open, []

    def counters(self):
        return {"labels": float(len(self.seen))}

    def alone(self):
        return 0

    def branched(self, ways, above):
        self.seen.append(above.tolist())
        pair = next(((a, b) for a, b in self.pairs if not above[a, b] and not above[b, a]), None)
        return None if pair is None else branched_on(pair, ways, above, lambda ways, above, robots: self.price(above))

    def cost(self, ways):
        return ways

    def plan(self, ways):
        return plan_of_paths([[0], [1], [2]], 1.0), {"cost": float(ways)}


PROBLEM = problem_on(line(3), [0, 1, 2], [0, 1, 2])


def above_after(motion, max_nodes=99):
    result = search(motion, PROBLEM, 0.0, np.inf, max_nodes)
    return result, np.argwhere(motion.seen[-1]).tolist()


def test_of_orders_that_cost_the_same_the_one_that_was_proposed_is_looked_at_first():
    result, above = above_after(Talk([(1, 0)]))
    assert (result.status, result.stats["nodes"], above) == (Status.SOLVED, 2.0, [[1, 0]])


def test_the_cheaper_order_is_looked_at_first():
    result, above = above_after(Talk([(1, 0)], price=lambda above: int(above[1, 0])))
    assert (result.stats["cost"], above) == (0.0, [[0, 1]])


def test_who_goes_before_a_robot_goes_before_those_after_it():
    _, above = above_after(Talk([(0, 1), (1, 2)]))
    assert above == [[0, 1], [0, 2], [1, 2]]


def test_an_order_that_is_decided_is_not_turned_round():
    above = np.array([[False, True], [False, False]])
    (order,) = branched_on((1, 0), "ways", above, lambda ways, above, robots: robots.tolist())
    assert order[0].tolist() == above.tolist() and order[1] == [1]


@pytest.mark.parametrize(("most_open", "status", "nodes"), [(2, Status.SOLVED, 4), (1, Status.GAVE_UP, 2)])
def test_without_room_for_both_the_order_that_comes_second_is_dropped(most_open, status, nodes):
    """Nobody finds a way where 0 goes before 1 and 2 has met them: then 1 has to go first."""
    motion = Talk([(0, 1), (1, 2)], most_open=most_open)
    motion.price = lambda above: None if above[0, 1] and (above[1, 2] or above[2, 1]) else 0
    result, _ = above_after(motion)
    assert (result.status, result.stats["nodes"]) == (status, nodes)


def test_a_search_that_ends_without_a_plan_says_its_bound():
    result, _ = above_after(Talk([(0, 1)]), max_nodes=1)
    assert (result.status, result.lower_bound_steps, result.message) == (Status.GAVE_UP, 3.0, "no plan among 1 orders of priorities")
