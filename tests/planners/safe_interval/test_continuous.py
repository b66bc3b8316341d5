"""Plans in continuous time: as short as slow truth, kept by robots in SUMO, and never too close whenever one looks."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from campaigns.noise import Worlds
from scipy.spatial.distance import pdist
from stepped_motion import stepped_run
from worlds import BURGER, CART, cross, graph_of, line, random_grid, square_grid

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import nav_graph
from mrp_sumo.core.plan import Status, as_planned_in_steps
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.engines.sumo.network import build_network
from mrp_sumo.errors import ScenarioError
from mrp_sumo.maps.roadmap import cut_lanes
from mrp_sumo.metrics.audit import audit
from mrp_sumo.metrics.referee_in_seconds import judge_in_seconds
from mrp_sumo.planning.answers import planned_by
from mrp_sumo.planning.registry import planner
from mrp_sumo.planning.vehicles import on_moves
from mrp_sumo.search._motion import turn_steps
from mrp_sumo.search._records import FOREVER
from mrp_sumo.traffic.draw import uniform_draw
from mrp_sumo.traffic.referee import judge
from mrp_sumo.traffic.resources import resources_of
from planners.safe_interval._search import FAR, RunGround, is_cut_off, is_shut_in, step_of_run, steps_left
from planners.safe_interval.first_ways import first_ways
from planners.safe_interval.moves import moves_of
from planners.safe_interval.timetable import Timetable
from tests.vehicles import TRICYCLE, vehicles_on

pytestmark = pytest.mark.kernel

LIMITS = {"burger": (0.22, 2.5, 2.5, 2.84), "slow to brake": (2.0, 0.5, 0.5, 1.5), "slow to start": (1.0, 0.3, 0.7, 0.8)}


def problem_of(graph, start, goal, robot=BURGER):
    return Problem(graph, fleet_of(robot, len(start)), np.array(start), np.array(goal), np.arange(len(start)), 3.0)


def test_in_a_window_robots_that_cannot_pass_each_other_keep_ways_through_it():
    """Two on a line want to change places: to the end there is no plan, for three steps there is."""
    chosen, swap = planner("continuous", {}), problem_of(line(6), [0, 5], [5, 0])
    chosen.prepare()
    assert planned_by(chosen, swap, 20.0).plan is None
    in_window = replace(swap, window_steps=3, drivable=True, effort=10_000)
    assert "window" in chosen.supports and planned_by(chosen, in_window, 20.0).plan is not None


def wrapped(angle):
    return abs((angle + np.pi) % (2 * np.pi) - np.pi)


def planned(problem, name="continuous", **parameters):
    chosen = planner(name, parameters)
    chosen.prepare()
    result = chosen.plan(problem, 60.0)
    assert result.status is Status.SOLVED, result.message
    return result.plan


@pytest.mark.parametrize("limits", LIMITS.values(), ids=LIMITS)
@pytest.mark.parametrize("cell_m", [0.4, 1.0, 3.3])
def test_runs_take_the_steps_that_robots_take(limits, cell_m):
    graph = line(7, cell_m)
    moves = moves_of(graph, resources_of(graph, 0.3), limits, 0.1)
    s = np.empty(4000)
    for lanes in range(1, 7):
        num = stepped_run(lanes * cell_m, limits[0], limits[1], limits[2], 0.1, s)
        arrived = int(np.searchsorted(s[:num], lanes * cell_m - 0.001 - 1e-9)) + 1  # robots stop 1 mm short and have arrived 2 mm short
        lane = graph.lane_between(0, 1)
        assert moves.time[moves.run_first[moves.course[lane]] + lanes - 1] == arrived
        for at_m in np.linspace(0.0513, lanes * cell_m - 0.00371, 9):
            assert step_of_run(moves, lane, lanes, at_m) == np.searchsorted(s[:num], at_m + 0.001 - 1e-9) + 1


@pytest.mark.parametrize("goal_heading", [np.nan, 2.0])
@pytest.mark.parametrize("limits", LIMITS.values(), ids=LIMITS)
def test_steps_left_are_the_least_over_all_sequences_of_runs_and_turns(limits, goal_heading):
    graph = square_grid(4, 1.0)
    moves = moves_of(graph, resources_of(graph, 0.5), limits, 0.1)
    at_rest, facing, lanes_best = (np.zeros(graph.num_lanes, np.int64) for _ in range(3))
    stack = np.zeros(graph.num_lanes + 1, np.int64)
    assert steps_left(moves, (5, goal_heading), at_rest, facing, lanes_best, stack, np.zeros(4000, np.int64))
    left = [0 if np.isnan(goal_heading) else turn_steps(wrapped(goal_heading - a), limits[3], 0.1) for a in moves.heading_rad]
    expected = np.where(graph.head == 5, left, FAR)
    for _ in range(40):  # Bellman's equations, over and over
        for lane in range(graph.num_lanes):
            for ray in range(graph.first[graph.head[lane]], graph.first[graph.head[lane] + 1]):
                bend = wrapped(moves.heading_rad[ray] - moves.heading_rad[lane])
                turn, at = turn_steps(bend, limits[3], 0.1) if bend > 0.2 else 0, ray
                for lanes in range(moves.length[ray]):
                    steps = turn + moves.time[moves.run_first[moves.course[ray]] + lanes] + expected[at]
                    expected[lane] = min(expected[lane], steps)
                    at = moves.onward[at]
    assert at_rest.tolist() == expected.tolist()


def test_robot_waits_until_the_crossing_is_free_and_then_drives_through():
    plan = planned(problem_of(cross(arm=4, cell_m=1.0), [4, 8], [12, 16], CART))
    waits = plan.depart_s - plan.arrive_s
    moved_on = np.isfinite(waits) & (np.arange(plan.num_visits) != plan.first[plan.robot])
    assert (waits[moved_on] == 0).all()  # nobody stops on the way: the second one sets out later
    assert plan.depart_s[plan.first[:-1]].min() == 0
    assert plan.depart_s[plan.first[:-1]].max() > 0


@pytest.mark.parametrize(
    ("third_xy", "ahead", "back", "most"), [((8.0, 0.0), [(0, 1), (1, 2)], [(2, 1), (1, 0)], 2), ((0.0, 0.4), [(0, 1)], [(1, 2)], 1)]
)
@pytest.mark.parametrize("robot", [CART, TRICYCLE], ids=lambda robot: robot.name)
def test_runs_end_where_robots_begin_to_drive_backward(third_xy, ahead, back, most, robot):
    """They face east on all lanes: into a dock and out of it, and back beside the lane by which they came."""
    options = [{}] * len(ahead) + [{"orientation_constraint": "backward"}] * len(back)
    nav = nav_graph(name="dock", xy=[(0.0, 0.0), (4.0, 0.0), third_xy], lanes=ahead + back, lane_options=options)
    problem = vehicles_on(cut_lanes(nav, 4.0), [0], [2], robot)
    moves = Timetable(on_moves(problem) if robot is TRICYCLE else problem, 0.1).moves[0]
    assert moves.length.max() == most


@pytest.mark.parametrize("name", ["continuous", "pbs", "ccbs"])
def test_plans_keep_the_headings_of_starts_and_goals(name):
    rng = np.random.default_rng(5)
    for seed in range(4):
        problem = problem_of(square_grid(4, 1.0), rng.permutation(16)[:3], rng.permutation(16)[:3], CART)
        start, goal = rng.choice([np.nan, 0.0, np.pi / 2, np.pi, -np.pi / 2], (2, 3))
        problem = replace(problem, start_heading_rad=start, goal_heading_rad=goal, seed=seed)
        plan = planned(problem, name)
        timed = ExecutionSettings(policy="adg_timed", engine="kinematic")
        run = simulate(problem, replace(plan, in_steps=None), timed, None)
        assert np.abs(run.arrived_s - plan.arrive_s).max() <= 0.1 + 1e-9
        assert run.goal_s == pytest.approx(plan.end_s, abs=0.001)
        assert wrapped(run.yaw_rad[-1] - goal)[~np.isnan(goal)] == pytest.approx(0.0)
        assert judge_in_seconds(problem, plan).drivable


def test_a_slow_turner_rather_drives_round_a_loop_than_turn_at_its_goal_unless_somebody_stands_there():
    bends = 0.15 - np.arange(1, 19) / 18 * (np.pi + 0.3)  # gentle enough to be driven through, out along 20 m and back
    arc = np.cumsum(np.column_stack([np.cos(bends), np.sin(bends)]), axis=0)
    arc = np.vstack([[0, 0], arc[:-1]]) * 2 * 20 * np.sin(0.15) / np.hypot(*arc[-1]) + 20 * np.array([np.cos(0.15), np.sin(0.15)])
    loop = [1, *range(2, 2 + len(arc)), 1]
    graph = graph_of([(-4, 0), (0, 0), *arc.tolist()], [], 0.4, [(0, 1), *pairwise(loop)])
    robot = replace(BURGER, max_speed_mps=2.0, turn_rate_rad_s=0.02)
    there_s = planned(problem_of(graph, [0], [1], robot)).end_s[0]
    heading = np.array([np.pi - 0.15, np.nan])
    alone, beside = (replace(problem_of(graph, at, [1, 9][: len(at)], robot), goal_heading_rad=heading[: len(at)]) for at in ([0], [0, 9]))
    assert there_s + 20.0 < planned(alone).end_s[0] < there_s + 40.0
    assert planned(beside).end_s[0] == pytest.approx(there_s + (np.pi - 0.15) / 0.02, abs=0.2)


def test_robot_steps_aside_into_the_bay():
    bay = graph_of([(0, 0), (1, 0), (2, 0), (3, 0), (2, 1)], [(0, 1), (1, 2), (2, 3), (2, 4)], 1.0)
    plan = planned(problem_of(bay, [0, 3], [3, 0], CART))
    assert 4 in plan.vertex


def bodies_xy(problem, plan, dt=0.1):
    """[T, R, 2] where robots are after each step that leave their stops as planned and drive to the next as the executor does."""
    graph, steps = problem.graph, int(plan.end_s.max() / dt) + 3
    at = np.empty((steps, plan.num_robots, 2))
    for r in range(plan.num_robots):
        a, b = plan.first[r], plan.first[r + 1]
        limits = (problem.fleet.max_speed_mps[r], problem.fleet.accel_mps2[r], problem.fleet.decel_mps2[r])
        stops = [k for k in range(a, b) if k in (a, b - 1) or plan.depart_s[k] > plan.arrive_s[k]]
        xy = graph.xy[plan.vertex]
        at[:, r] = xy[a]
        for stop, following in pairwise(stops):
            end_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy[stop : following + 1], axis=0).T))])
            s = np.empty(4000)
            num = stepped_run(end_m[-1], *limits, dt, s)
            begin = round(plan.depart_s[stop] / dt)
            along = np.interp(np.clip(s[:num], 0, end_m[-1]), end_m, np.arange(len(end_m)))
            k = np.minimum(along.astype(int), len(end_m) - 2)
            route = xy[stop + k] + (along - k)[:, None] * (xy[stop + k + 1] - xy[stop + k])
            until = min(begin + 1 + num, steps)
            at[begin + 1 : until, r] = route[: until - begin - 1]
            at[until:, r] = xy[following]
    return at


def crowds():
    """Small problems with traffic."""
    for seed in range(12):
        problem = random_grid(5, 5, seed, blocked=0.15)
        yield pytest.param(replace(problem, fleet=fleet_of(CART, 5)), id=f"grid {seed}")
    yield pytest.param(problem_of(cross(arm=3), [3, 6, 9], [6, 9, 3]), id="cross")
    star = graph_of([(0, 0), (2, 0), (2, 0.5), (2, 1.1), (0, 2)], [(0, 1), (0, 2), (0, 3), (0, 4)], 1.0)  # lanes at acute angles
    yield pytest.param(problem_of(star, [1, 3], [3, 4]), id="star")
    beside = graph_of([(0, 0), (1, 0), (2, 0), (0, 0.25), (1, 0.25), (2, 0.25)], [(0, 1), (1, 2), (3, 4), (4, 5)], 1.0)
    yield pytest.param(problem_of(beside, [0, 5], [1, 5]), id="beside each other")


@pytest.mark.compiled
@pytest.mark.parametrize("problem", list(crowds()))
@pytest.mark.parametrize("name", ["continuous", "pbs"])
def test_bodies_never_come_too_close(name, problem):
    chosen = planner(name, {})
    chosen.prepare()
    result = chosen.plan(problem, 60.0)
    if result.plan is None:
        assert result.status in (Status.GAVE_UP, Status.INFEASIBLE)
        return
    plan = result.plan
    if as_planned_in_steps(plan, problem.step_s) is not None:  # who finds no ways one by one gets a plan of lacam
        plan = retime(problem, plan, ExecutionSettings())
    at = bodies_xy(problem, plan)
    assert min(pdist(frame).min() for frame in at) > problem.fleet.separation_m - 0.01


@pytest.mark.compiled
def test_robots_that_cannot_go_one_by_one_get_a_plan_in_steps_that_can_be_driven():
    problem = problem_of(cross(arm=3), [3, 6, 9], [6, 9, 3])
    chosen = planner("continuous", {})
    chosen.prepare()
    result = chosen.plan(problem, 60.0)
    assert result.status is Status.SOLVED and result.stats["from_lacam"] == 1.0
    assert retime(problem, result.plan, ExecutionSettings()).vertex.tolist() == result.plan.vertex.tolist()


@pytest.mark.compiled
def test_most_crowds_have_plans():
    solved = [planner("continuous", {}).plan(case.values[0], 60.0).status is Status.SOLVED for case in crowds()]
    assert sum(solved) >= 13


@pytest.mark.parametrize("seed", range(4))
def test_robots_in_sumo_are_where_they_are_planned_to_be(tmp_path, seed):
    problem = random_grid(6, 6, seed, blocked=0.1)
    problem = replace(problem, fleet=fleet_of(CART, 6))
    plan = planned(problem)
    network = build_network(problem.graph, tmp_path / "world.net.xml")
    settings = ExecutionSettings(policy="adg_timed", time_limit_s=300.0)
    driven = simulate(problem, plan, settings, network)
    assert np.abs(driven.arrived_s - plan.arrive_s).max() <= 0.1 + 1e-6
    assert audit(driven, problem.fleet)["num_overlaps"] == 0


def test_bad_parameters_are_refused():
    with pytest.raises(ScenarioError, match="step_length_s is 2"):
        planner("continuous", {"step_length_s": 2.0})


@pytest.mark.compiled
def test_who_is_kept_from_its_way_by_a_start_that_is_protected_again_looks_for_another(tmp_path):
    """Others make room for a robot in vain and go back to their ways; one of them crosses the start of another that is still away."""
    graph = Worlds(None, tmp_path).graph(("tangle", "543"))
    fleet = fleet_of(BURGER, 20)
    start, goal = uniform_draw(graph, 20, 543, fleet.separation_m)
    step_s = float(np.ceil((graph.length_m.max() / BURGER.max_speed_mps + 1.0) / 0.1)) * 0.1
    problem = Problem(graph, fleet, start, goal, np.arange(20), step_s, 543)
    result = planner("continuous", {}).plan(problem, 60.0)
    assert result.status is Status.SOLVED
    assert judge(problem, result.plan).valid


@pytest.mark.parametrize(
    ("pairs", "held", "shut_in"),
    [
        ([(k, k + 1) for k in range(5)], (3, 9, FOREVER), True),
        ([(k, k + 1) for k in range(5)], (3, 20, FOREVER), False),  # it may have passed by then
        ([(k, k + 1) for k in range(5)], (3, 0, 90), False),
        ([(k, (k + 1) % 6) for k in range(6)], (3, 0, FOREVER), False),
        ([(k, (k + 1) % 6) for k in range(6)], (4, 0, FOREVER), False),
    ],
    ids=("before it", "after it", "for a while", "other way", "neighbour"),
)
def test_a_robot_is_shut_in_where_others_stay_on_every_way_before_it_can_have_passed(pairs, held, shut_in):
    """From 0 to 4 or 5 in a row, or on a ring, at 1 m/s in steps of 0.1 s: it is at 3 after 12 steps at the earliest."""
    xy = [(0.4 * k, 0.0) for k in range(6)] if len(pairs) < 6 else [(0.4 * np.cos(k), 0.4 * np.sin(k)) for k in np.arange(6) * np.pi / 3]
    graph = graph_of(xy, pairs)
    goal = 4 if held[0] != 4 else 5
    timetable = Timetable(Problem(graph, fleet_of(CART, 1), np.array([0]), np.array([goal]), np.arange(1), 1.0), 0.1)
    timetable.look_back(0)
    timetable._reserve(-1, tuple(np.array([each]) for each in held))
    ground = RunGround(timetable.moves[0], timetable.table, timetable.at_rest[0], timetable.facing[0], 1.0)
    assert is_shut_in(ground, timetable.scratch, 0, goal) == shut_in


@pytest.mark.parametrize(
    ("held", "cut_off"),
    [
        ([(3, 0, 90), (2, 50, FOREVER)], True),
        ([(3, 0, 40), (2, 50, FOREVER)], False),  # it goes on in time
        ([(3, 0, 90), (2, 50, 60)], False),
    ],
    ids=("too late", "in time", "for a while"),
)
def test_a_robot_is_cut_off_where_no_way_is_free_long_enough_for_it(held, cut_off):
    """From 0 to 5 in a row: it cannot wait before 3 until that is free, since somebody stays at 2 by then."""
    graph = graph_of([(0.4 * k, 0.0) for k in range(6)], [(k, k + 1) for k in range(5)])
    timetable = Timetable(Problem(graph, fleet_of(CART, 1), np.array([0]), np.array([5]), np.arange(1), 1.0), 0.1)
    timetable.look_back(0)
    for each in held:
        timetable._reserve(-1, tuple(np.array([value]) for value in each))
    ground = RunGround(timetable.moves[0], timetable.table, timetable.at_rest[0], timetable.facing[0], 1.0)
    assert is_cut_off(ground, 0, 5) == cut_off == (timetable.search(0) is None)
    assert not is_shut_in(ground, timetable.scratch, 0, 5) or cut_off


def test_robots_that_raise_each_other_in_turns_look_for_no_way_twice(monkeypatch):
    """Two that would have to change places in a row: each raises itself above the other until that has been enough."""
    graph = graph_of([(0.4 * k, 0.0) for k in range(6)], [(k, k + 1) for k in range(5)])
    timetable = Timetable(Problem(graph, fleet_of(CART, 2), np.array([0, 5]), np.array([4, 1]), np.arange(2), 1.0), 0.1)
    for robot in range(2):
        timetable.look_back(robot)
    searches, search, looked = [], timetable.search, 0

    def noted(robot, most, weight):
        nonlocal looked
        searches.append((robot, most, *timetable.path))
        before = timetable.work
        path = search(robot, most, weight=weight)
        looked += timetable.work - before
        return path

    monkeypatch.setattr(timetable, "search", noted)
    assert not first_ways(timetable, np.arange(2), 20, np.inf, 10_000)
    assert len(set(searches)) == len(searches) < 10
    assert timetable.work > 2 * looked  # those known count, too
