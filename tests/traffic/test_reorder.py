"""Another order in zones: whoever stands in one goes first, whoever stays goes last, and in between whoever others wait for."""

from itertools import permutations, product

import numpy as np
import pytest

from mrp_sumo.core.digraph import has_cycle
from mrp_sumo.core.plan import plan_of_paths
from mrp_sumo.traffic.passages import Needs, order_of, permuted, waiting_arcs, waits
from mrp_sumo.traffic.reorder import reordered

NUM_VERTICES = 6


def planned(paths, *zones):
    """A plan with a second a step, and its order at vertices and at zones of some of them."""
    plan = plan_of_paths(paths, 1.0)
    needs = [[v, *(NUM_VERTICES + q for q, zone in enumerate(zones) if v in zone)] for v in plan.vertex.tolist()]
    flat = np.concatenate(needs)
    columns = np.cumsum([0, *map(len, needs)]), flat, np.zeros(len(flat), np.bool_)
    return plan, order_of(plan, Needs(*columns, NUM_VERTICES + len(zones)))


def schedules(paths, *zones):
    """Robots in the one zone of vertices of each, in the plan's order and in the other one."""
    plan, before = planned(paths, *zones)
    return before, reordered(plan, before, NUM_VERTICES)


def passing(schedule, resource=NUM_VERTICES):
    return schedule.robot[schedule.first[resource] : schedule.first[resource + 1]].tolist()


@pytest.mark.parametrize(("route", "after"), [([0, 2], [0, 1]), ([4, 0, 2], [1, 0])])
def test_nobody_overtakes_a_robot_that_begins_in_a_zone(route, after):
    """robot_0 leaves the zone of 0 and 1 when it is at 2, which robot_1 leaves when it is at 1: only robot_1 can go first.

    It does where robot_0 is still outside; where robot_0 begins in the zone, nothing helps, and the order stays as it is.
    """
    before, schedule = schedules([route, [2] * len(route) + [1, 3]], {0, 1})
    assert passing(before) == [0, 1] and passing(schedule) == after
    assert passing(schedule, 2) == [1, 0]  # vertices keep the plan's order


def test_vertices_keep_the_plans_order_even_where_another_would_undo_a_circle():
    """robot_0 begins in the zone and leaves it for 2, from where robot_1 has to come into it."""
    before, schedule = schedules([[0, 0, 0, 2, 4], [5, 2, 1, 3]], {0, 1})
    for each in (before, schedule):
        assert (passing(each), passing(each, 2)) == ([0, 1], [1, 0])


@pytest.mark.parametrize(("route", "after"), [([0], [0, 1]), ([4, 0], [1, 0])])
def test_a_robot_that_stays_in_a_zone_comes_last_there_unless_it_begins_there(route, after):
    before, schedule = schedules([route, [2, 2, 1, 3]], {0, 1})
    assert passing(before) == [0, 1] and passing(schedule) == after


def test_a_robot_that_stays_in_a_zone_comes_last_there_even_where_it_has_to_go_first():
    """robot_1 is through the zone when it is at 4, which robot_0 leaves when it is in it: no order helps."""
    before, schedule = schedules([[4, 0], [2, 2, 1, 4, 5]], {0, 1})
    assert passing(before) == [0, 1] and passing(schedule) == [1, 0]


def test_without_a_circle_the_order_stays_as_it_is():
    before, schedule = schedules([[4, 0, 2], [5, 5, 5, 1, 3]], {0, 1})
    assert passing(before) == passing(schedule) == [0, 1]


def test_a_circle_through_two_zones_is_undone_in_both():
    """Both zones hold 0 and 1, so the order of one decides that of the other."""
    before, schedule = schedules([[4, 0, 2, 5], [2, 2, 2, 2, 1, 3]], {0, 1}, {0, 1})
    assert passing(before, 6) == passing(before, 7) == [0, 1]
    assert passing(schedule, 6) == passing(schedule, 7) == [1, 0]


def test_a_pair_that_may_go_either_way_does_not_keep_those_after_it_from_being_decided():
    """robot_0 and robot_1 wait for each other; robot_2 passes the zone before and after them."""
    before, schedule = schedules([[2, 3, 1, 4], [4, 4, 0, 2, 5], [5, 1, 5, 3, 1]], {0, 1})
    assert passing(before) == [2, 0, 1, 2] and passing(schedule) == [2, 1, 0, 2]


def can_be_kept(plan, schedule):
    _, left_at = waits(schedule)
    return not (left_at == plan.num_visits).any() and not has_cycle(plan.num_visits, *waiting_arcs(plan, schedule))


def drawn(chance):
    """Plans that their vertices allow, and zones in the order of which they cannot be kept: few robots begin or end in them."""
    while True:
        paths = [
            [v for v in chance.permutation(6)[: chance.integers(2, 6)].tolist() for _ in range(chance.integers(1, 3))] for _ in range(3)
        ]
        ends = [{path[end] for path in paths} for end in (0, -1)]
        inner = [v for v in range(6) if not any(v in each for each in ends) or chance.random() < 0.2]
        if len(inner) < 2 or min(map(len, ends)) < 3:
            continue
        zones = [set(chance.choice(inner, 2, replace=False).tolist()) for _ in range(chance.integers(1, 4))]
        plan, before = planned(paths, *zones)
        if can_be_kept(*planned(paths)) and not can_be_kept(plan, before) and all(len(each & zone) < 2 for each in ends for zone in zones):
            return plan, before, len(zones)


def orders(plan, schedule, passages):
    """The orders of a zone's passages in which robots make theirs one after the other, and nobody overtakes who begins there."""

    def before(one, other):
        same = schedule.robot[one] == schedule.robot[other]
        return (same and one < other) or (not same and plan.arrive_s[schedule.visit[one]] == 0 < plan.arrive_s[schedule.visit[other]])

    return [order for order in permutations(passages) if not any(before(b, a) for k, a in enumerate(order) for b in order[k + 1 :])]


def test_an_order_is_found_wherever_one_of_all_there_are_can_be_kept():
    chance, outcomes = np.random.default_rng(3), []
    for _ in range(80):
        plan, before, num_zones = drawn(chance)
        after = reordered(plan, before, NUM_VERTICES)
        blocks = [tuple(range(*before.first[q : q + 2])) for q in range(NUM_VERTICES + num_zones)]
        of_zones = [orders(plan, before, block) for block in blocks[NUM_VERTICES:]]
        at_vertices = sum(blocks[:NUM_VERTICES], ())
        possible = any(can_be_kept(plan, permuted(before, np.array([*at_vertices, *sum(each, ())]))) for each in product(*of_zones))
        assert can_be_kept(plan, after) == possible
        for q in range(NUM_VERTICES):
            assert passing(after, q) == passing(before, q)
        outcomes.append(possible)
    assert 5 <= sum(outcomes) <= 75
