"""Continuous-time CBS: as cheap as slow truth, within w of it, and never too close whenever one looks."""

from dataclasses import replace
from itertools import combinations, product

import numpy as np
import pytest
from scipy.optimize import LinearConstraint, milp
from scipy.spatial.distance import pdist
from worlds import BURGER, graph_of, line, square_grid

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.plan import Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import ScenarioError
from mrp_sumo.metrics.referee_in_seconds import judge_in_seconds
from mrp_sumo.planning.registry import planner
from planners.safe_interval.unit_motion import UnitMotion, lanes_of

pytestmark = pytest.mark.kernel

RADIUS_M = 0.3
LATE = 1000.0


def problem_of(graph, start, goal):
    return Problem(graph, fleet_of(BURGER, len(start)), np.array(start), np.array(goal), np.arange(len(start)), 3.0)


def made(name="ccbs", **parameters):
    chosen = planner(name, parameters)
    chosen.prepare()
    return chosen


def solved(problem, **parameters):
    result = made(**parameters).plan(problem, 60.0)
    assert result.status is Status.SOLVED, result.message
    return result


def random_problem(seed, robots):
    """Seven vertices anywhere in 4 x 4 m that are not too close, joined at random."""
    rng = np.random.default_rng(seed)
    xy = rng.uniform(0, 4, (1, 2))
    while len(xy) < 7:
        point = rng.uniform(0, 4, 2)
        if np.hypot(*(xy - point).T).min() > 2.2 * RADIUS_M:
            xy = np.vstack([xy, point])
    tree = [(int(rng.integers(k)), k) for k in range(1, 7)]
    pairs = dict.fromkeys([*tree, *(tuple(sorted(rng.choice(7, 2, replace=False).tolist())) for _ in range(3))])
    return problem_of(graph_of(xy, list(pairs)), rng.permutation(7)[:robots], rng.permutation(7)[:robots])


def walks(graph, start, goal, most_m):
    """All ways from start to goal up to a length, as lists of vertices."""
    outcome, open_ = [], [([start], 0.0)]
    while open_:
        route, long = open_.pop()
        if route[-1] == goal:
            outcome.append((long, route))
        for lane in range(graph.first[route[-1]], graph.first[route[-1] + 1]):
            longer = long + float(graph.length_m[lane])
            open_ += [([*route, int(graph.head[lane])], longer)] * (longer <= most_m and len(route) < 7)
    return outcome


def too_close_after(p, q, velocity, other_velocity, long, other_long):
    """(low, high) of how much later the second sets out when they collide, by looking closely; None where never."""
    delay = np.linspace(-other_long, long, 4001)
    begin, end = np.maximum(0, delay), np.minimum(long, delay + other_long)
    gap = np.asarray(p) - q + delay[:, None] * other_velocity
    slope = velocity - other_velocity
    at = np.clip(-(gap @ slope) / max(slope @ slope, 1e-12), begin, end)
    close = delay[np.hypot(*(gap + at[:, None] * slope).T) < 2 * RADIUS_M]
    return (close[0], close[-1]) if len(close) else None


def least_cost(graph, ways):
    """The least sum of arrivals of robots on given ways: departures and arrivals as a mixed integer linear program."""
    first = np.cumsum([0, *(len(route) - 1 for route in ways)])
    num = int(first[-1])
    rows, low, cost = [], [], np.zeros(num)

    def at_least(plus, minus, by, switch=None):
        """Departure `plus` less departure `minus` is at least `by`, if the switch (number, value) is set; None stands for 0."""
        rows.append(({k: sign for k, sign in ((plus, 1.0), (minus, -1.0)) if k is not None}, switch))
        low.append(by)

    pieces, constant = [], 0.0
    for r, route in enumerate(ways):
        xy = graph.xy[route]
        long = np.hypot(*np.diff(xy, axis=0).T)
        for k in range(len(route) - 1):
            at_least(first[r] + k, first[r] + k - 1 if k else None, long[k - 1] if k else 0.0)
            pieces.append((r, "move", first[r] + k, xy[k], (xy[k + 1] - xy[k]) / long[k], long[k]))
        for k in range(len(route)):
            before, after = (first[r] + k - 1 if k else None), (first[r] + k if k < len(route) - 1 else None)
            pieces.append((r, "stay", before, after, xy[k], long[k - 1] if k else 0.0))
        if len(route) > 1:
            cost[first[r + 1] - 1] = 1.0
            constant += long[-1]
    switches = 0
    for one, two in combinations(pieces, 2):
        if one[0] == two[0] or one[1] == two[1] == "stay":
            continue
        if one[1] == two[1] == "move":
            outcome = too_close_after(one[3], two[3], one[4], two[4], one[5], two[5])
            if outcome:
                at_least(two[2], one[2], outcome[1], (switches, 0))
                at_least(one[2], two[2], -outcome[0], (switches, 1))
                switches += 1
            continue
        move, stay = (one, two) if one[1] == "move" else (two, one)
        t = np.linspace(0, move[5], 2001)
        close = t[np.hypot(*(move[3] + t[:, None] * move[4] - stay[4]).T) < 2 * RADIUS_M]
        if len(close):  # the stay begins after the mover has passed, or ends before
            begins, ends = stay[2] is not None, stay[3] is not None
            at_least(*((stay[2], move[2], close[-1] - stay[5]) if begins else (None, None, LATE / 2)), (switches, 0))
            at_least(*((move[2], stay[3], -close[0]) if ends else (None, None, LATE / 2)), (switches, 1))
            switches += 1
    matrix, bound = np.zeros((len(rows), num + switches)), np.array(low)
    for i, (row, switch) in enumerate(rows):
        for k, value in row.items():
            matrix[i, k] = value
        if switch is not None:  # off by LATE where the switch says so
            matrix[i, num + switch[0]] = LATE if switch[1] == 0 else -LATE
            bound[i] -= 0.0 if switch[1] == 0 else LATE
    outcome = milp(
        np.append(cost, np.zeros(switches)),
        constraints=LinearConstraint(matrix, bound, np.inf),
        integrality=np.append(np.zeros(num), np.ones(switches)),
        bounds=(0, np.append(np.full(num, LATE / 4), np.ones(switches))),
    )
    return outcome.fun + constant if outcome.success else np.inf


@pytest.mark.parametrize(("seed", "robots"), [(3, 2), (7, 2), (10, 2), (12, 2), (15, 2), (104, 3)])
def test_discs_cost_what_the_best_of_all_ways_costs(seed, robots):
    problem = random_problem(seed, robots)
    cost = solved(problem, motion="unit", radius_m=RADIUS_M).stats["cost_s"]
    truth = np.inf
    both = [walks(problem.graph, int(s), int(g), cost + 0.01) for s, g in zip(problem.start, problem.target)]
    for ways in sorted(product(*both), key=lambda ways: sum(long for long, _ in ways)):
        if sum(long for long, _ in ways) < min(truth, cost + 0.01):
            truth = min(truth, least_cost(problem.graph, [route for _, route in ways]))
    assert truth == pytest.approx(cost, abs=0.02)
    bounded = solved(problem, motion="unit", radius_m=RADIUS_M, w=1.3)
    assert cost - 1e-6 <= bounded.stats["cost_s"] <= 1.3 * cost


@pytest.mark.compiled
@pytest.mark.parametrize("w", [1.0, 1.2])
def test_discs_are_never_too_close(w):
    solutions = 0
    for seed in range(100, 104):
        problem = random_problem(seed, 3)
        outcome = made(motion="unit", radius_m=RADIUS_M, w=w, max_nodes=500).plan(problem, 60.0)
        if outcome.plan is None:
            continue
        solutions += 1
        plan, t = outcome.plan, np.arange(0, outcome.plan.end_s.max() + 0.1, 0.01)
        places = []
        for r in range(3):
            visits = slice(plan.first[r], plan.first[r + 1])
            times = np.stack([plan.arrive_s[visits], np.minimum(plan.depart_s[visits], 1e6)], 1).ravel()
            xy = np.repeat(problem.graph.xy[plan.vertex[visits]], 2, axis=0)
            places.append(np.stack([np.interp(t, times, xy[:, 0]), np.interp(t, times, xy[:, 1])], 1))
        assert min(pdist(at).min() for at in np.stack(places, 1)) > 2 * RADIUS_M - 1e-6
    assert solutions >= 2


@pytest.mark.compiled
def test_real_motion_is_drivable_and_costs_no_more_than_pbs_and_continuous():
    for seed in range(5):
        rng = np.random.default_rng(seed)
        graph = square_grid(4)
        problem = problem_of(graph, rng.permutation(16)[:4], rng.permutation(16)[:4])
        best = solved(problem)
        others = [made(name).plan(problem, 60.0).stats["cost_s"] for name in ("pbs", "continuous")]
        verdict = judge_in_seconds(problem, best.plan)
        assert not verdict.faults
        assert not verdict.meetings
        assert best.stats["cost_s"] <= min(others) + 1e-6
        assert best.stats["lower_bound_s"] == pytest.approx(best.stats["cost_s"])


@pytest.mark.parametrize("parameters", [{"w": 0.9}, {"motion": "brownian"}, {"radius_m": -1.0}, {"speed_mps": 0.0}, {"max_nodes": 0}])
def test_parameters_that_mean_nothing_are_refused(parameters):
    with pytest.raises(ScenarioError, match=next(iter(parameters))):
        planner("ccbs", parameters)


def test_a_bounded_effort_and_no_clock_ends_the_search():
    problem = problem_of(square_grid(4, 1.0), [0, 3, 12], [15, 12, 3])
    chosen, free = made(), solved(problem)
    counted = chosen.plan(replace(problem, effort=10_000_000), 1e-9)
    assert counted.plan.arrive_s.tolist() == free.plan.arrive_s.tolist()
    ended = [chosen.plan(replace(problem, effort=effort), 60.0) for effort in (1, 40, 40)]
    assert all(result.status is Status.TIMED_OUT and "no plan within an effort of" in result.message for result in ended)
    assert ended[1].stats == ended[2].stats


@pytest.mark.compiled
def test_two_discs_that_change_places_cost_the_corridor_and_the_way_round():
    """10 m through, 18 m round: a bound on both knows that neither can wait for the other in the corridor."""
    xy = [(k, 0) for k in range(11)] + [(0, 4), (10, 4)]
    graph = graph_of(xy, [*((k, k + 1) for k in range(10)), (0, 11), (11, 12), (12, 10)])
    problem = problem_of(graph, [0, 10], [10, 0])
    motion = UnitMotion(problem, RADIUS_M, 1.0)
    assert motion.least_cost_s(0, 1, motion.nothing, motion.nothing) == pytest.approx(28.0)
    assert solved(problem, motion="unit", radius_m=RADIUS_M).stats["cost_s"] == pytest.approx(28.0)


@pytest.mark.compiled
@pytest.mark.parametrize("degrees", [20, 90])
def test_who_enters_a_corridor_second_lets_the_first_pass_by(degrees):
    """10 m of corridor, 4 m to either goal beyond: on lanes at a sharp angle, the second sets out later."""
    xy = [(0, 0), (10, 0), (10, 4), (10 + 4 * np.sin(np.radians(degrees)), 4 * np.cos(np.radians(degrees)))]
    motion = UnitMotion(problem_of(graph_of(xy, [(0, 1), (1, 2), (1, 3)]), [0, 2], [3, 0]), RADIUS_M, 1.0)
    cost_s = motion.least_cost_s(0, 1, motion.nothing, motion.nothing)
    assert cost_s == pytest.approx(14 + 20 + 2 * RADIUS_M / np.sin(np.radians(degrees / 2)), abs=1e-5)


@pytest.mark.parametrize(
    ("pairs", "one_way", "within"),
    [
        ([(0, 1), (1, 2)], (), [1]),
        ([(0, 1)], [(1, 2)], [1]),  # lanes of one direction join it to its second neighbour
        ([(0, 1), (1, 2), (2, 0)], (), [0, 1, 2]),
        ([(0, 1), (1, 2), (1, 3)], (), []),  # three neighbours
        ([(0, 1)], [(2, 1), (1, 3)], []),
    ],
)
def test_corridors_are_of_vertices_with_two_neighbours(pairs, one_way, within):
    graph = graph_of([(0, 0), (1, 0), (2, 1), (2, -1)], pairs, one_way=one_way)
    assert np.flatnonzero(lanes_of(graph, graph.length_m, 2 * RADIUS_M).inner).tolist() == within


ROUND = [(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (0, 2), (4, 2)], [(0, 1), (1, 2), (2, 3), (3, 4), (0, 5), (5, 6), (6, 4)]
ASIDE = [(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (2, 2), (4, 0.7)], [(0, 1), (1, 2), (2, 3), (3, 4), (2, 5), (4, 6)]


@pytest.mark.compiled
@pytest.mark.parametrize(
    ("world", "start", "goal", "cost_s"),
    [
        (ROUND, [3, 2], [1, 3], 11.0),  # 2 m and 1 m in the wrong order: the first goes round, which is 10 m
        (ROUND, [3, 2], [1, 0], 4.0),  # in the right order they do not have to
        (ASIDE, [1, 0], [3, 4], 10.0),  # the second has to pass the first, which steps aside; beyond its goal that is of no use
        (ASIDE, [1, 0], [4, 3], 6.0),
    ],
)
def test_discs_in_the_wrong_order_on_a_line_leave_it(world, start, goal, cost_s):
    result = solved(problem_of(graph_of(*world), start, goal), motion="unit", radius_m=RADIUS_M)
    assert result.stats["cost_s"] == pytest.approx(cost_s)


def test_discs_in_the_wrong_order_on_a_line_that_nobody_can_leave_have_no_plan():
    chosen = made(motion="unit", radius_m=RADIUS_M, max_nodes=10)
    assert chosen.plan(problem_of(line(4), [0, 2], [3, 1]), 60.0).status is Status.INFEASIBLE
    assert chosen.plan(problem_of(line(4), [0, 2], [1, 3]), 60.0).status is Status.SOLVED


def test_goals_too_close_for_discs_are_named():
    problem = problem_of(line(4), [0, 3], [1, 2])
    outcome = made(motion="unit", radius_m=RADIUS_M).plan(problem, 10.0)
    assert outcome.status is Status.INFEASIBLE
    assert "robot_0 and robot_1 have to end at 'v1' and 'v2', which are too close" in outcome.message
