"""The referee in seconds on small worlds whose verdict is known by hand."""

from dataclasses import replace

import numpy as np
import pytest
from campaigns.referee_in_seconds import RefereeInSeconds
from test_architecture import tool
from worlds import CART, cross, graph_of, line, random_grid

from mrp_sumo.core.fleet import fleet_of, fleet_of_types
from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.errors import PlanError
from mrp_sumo.metrics.referee_in_seconds import Drivability, describe_meeting, judge_in_seconds
from mrp_sumo.planning.registry import planner

CLOSED = tool("speed_profile")  # runs as closed forms

SEPARATION_M = 2 * CART.radius_m + CART.gap_m  # 0.82 m; 1 m/s, 1 m/s2 both ways, turns at 1 rad/s


def plan_of(*ways):
    """Each a list of (vertex, arrival, departure)."""
    vertex, arrive, depart = (np.array(column) for column in zip(*(visit for route in ways for visit in route)))
    return Plan(np.cumsum([0, *map(len, ways)]), vertex.astype(np.int64), arrive.astype(float), depart.astype(float))


def judged(graph, *ways, fleet=None, step_s=0.01):
    plan = plan_of(*ways)
    starts, goals = plan.vertex[plan.first[:-1]], plan.last_vertex
    problem = Problem(graph, fleet or fleet_of(CART, len(ways)), starts, goals, np.arange(len(ways)), 1.0)
    return judge_in_seconds(problem, plan, step_s), problem


def run(vertices, lengths, begin=0.0, robot=CART):
    """Visits of a run at full speed that sets out at `begin`."""
    profile = CLOSED.run_profile(np.array(lengths), np.full(len(lengths), np.inf), robot.max_speed_mps, robot.accel_mps2, robot.decel_mps2)
    at = [0.0, *CLOSED.time_s(profile, np.cumsum(lengths)).tolist()]
    times = [begin + t for t in at]
    return [(vertices[0], 0.0, begin), *((v, t, t) for v, t in zip(vertices[1:-1], times[1:-1])), (vertices[-1], times[-1], np.inf)]


def test_run_at_full_speed_is_drivable():
    result, _ = judged(line(4, 1.0), run([0, 1, 2, 3], [1.0] * 3))
    assert result.drivable


@pytest.mark.parametrize("visit", [1, 2, 3])
def test_nobody_is_faster_than_full_speed(visit):
    route = run([0, 1, 2, 3], [1.0] * 3)
    v, arrive, depart = route[visit]
    route[visit] = (v, arrive - 0.15, depart - 0.15)
    result, _ = judged(line(4, 1.0), route)
    assert result.faults == (
        f"robot_0 leaves 'v{visit - 1}' at {route[visit - 1][2]:.2f} s and cannot be at 'v{visit}' as early as {route[visit][1]:.2f} s",
    )


def test_robot_that_brakes_on_the_way_and_drives_on_is_drivable():
    route = run([0, 1, 2, 3], [1.0] * 3)
    route[1:] = [route[1], *((v, a + 0.7, d + 0.7) for v, a, d in route[2:])]
    result, _ = judged(line(4, 1.0), route)
    assert result.drivable


def test_robot_that_passes_too_fast_cannot_come_late():
    fast = replace(CART, max_speed_mps=2.0, decel_mps2=0.5, length_m=0.2, width_m=0.2)
    route = run([0, 1, 2, 3, 4, 5, 6, 7, 8], [1.0] * 8, robot=fast)
    assert judged(line(9, 1.0), route, fleet=fleet_of(fast, 1))[0].drivable
    route[4:] = [(v, a + 20.0, d + 20.0) for v, a, d in route[4:]]  # at 2 m/s or so it needs 3 m to stop
    result, _ = judged(line(9, 1.0), route, fleet=fleet_of(fast, 1))
    assert result.faults == ("robot_0 passes 'v3' at 2.50 s too fast to come to 'v4' as late as 23.00 s",)


def test_turning_takes_its_time():
    corner = graph_of([(0, 0), (1, 0), (1, 1)], [(0, 1), (1, 2)], 1.0)
    lane_s = 2.0  # of 1 m from rest to rest
    turned = lane_s + np.pi / 2

    def route(leaves):
        return [(0, 0.0, 0.0), (1, lane_s, leaves), (2, leaves + lane_s, np.inf)]

    assert judged(corner, route(turned))[0].drivable
    assert not judged(corner, route(turned - 0.2))[0].drivable
    # where it is said to leave at once, it turns first
    assert judged(corner, [(0, 0.0, 0.0), (1, lane_s, lane_s), (2, turned + lane_s, np.inf)])[0].drivable


@pytest.mark.parametrize("turns", ["at the start", "at the goal"])
def test_turns_from_and_to_headings_take_their_time(turns):
    route = run([0, 1, 2], [1.0, 1.0], begin=np.pi)
    problem = Problem(line(3, 1.0), fleet_of(CART, 1), np.array([0]), np.array([2]), np.arange(1), 1.0)
    problem = replace(problem, start_heading_rad=np.array([np.pi]), goal_heading_rad=np.array([np.pi / 2]))
    arrive_s = route[-1][1]
    plan = replace(plan_of(route), turned_s=np.array([arrive_s + np.pi / 2]))
    assert judge_in_seconds(problem, plan, 0.01).drivable
    if turns == "at the start":
        plan = replace(plan_of([(v, max(0.0, a - 0.2), d - 0.2) for v, a, d in route]), turned_s=plan.turned_s)
        assert judge_in_seconds(problem, plan, 0.01).faults[0].startswith("robot_0 leaves 'v0' at 2.94 s and cannot be at 'v1' as early")
        return
    for turned_s in (None, np.array([arrive_s + 1.4])):
        (fault,) = judge_in_seconds(problem, replace(plan, turned_s=turned_s), 0.01).faults
        assert fault.startswith(f"robot_0 arrives at 'v2' at {arrive_s:.2f} s and cannot have turned there by")


def test_lane_with_a_limit_takes_longer():
    nav = nav_graph(name="slow", xy=[(0, 0), (4, 0)], lanes=[(0, 1), (1, 0)], speed_mps=[0.5, 0.5])
    graph = plan_graph(nav, kind="roadmap", cell_m=4.0)
    assert not judged(graph, run([0, 1], [4.0]))[0].drivable
    assert judged(graph, [(0, 0.0, 0.0), (1, 8.5, np.inf)])[0].drivable


def test_robots_that_cross_one_after_the_other_are_apart_and_both_at_once_are_not():
    graph = cross(arm=2, cell_m=1.0)
    east_west, north_south = [2, 1, 0, 5, 6], [4, 3, 0, 7, 8]
    through = run(east_west, [1.0] * 4)
    result, problem = judged(graph, through, run(north_south, [1.0] * 4))
    assert not result.drivable
    assert describe_meeting(result.meetings[0], problem).startswith(
        "robot_0 and robot_1 come 0.000 m close, at or on the way to 'v0' and 'v0', at "
    )
    assert judged(graph, through, run(north_south, [1.0] * 4, begin=2.0))[0].drivable


def test_follower_keeps_a_separation():
    graph = line(8, 1.0)
    ahead = run([1, 2, 3, 4, 5, 6, 7], [1.0] * 6)
    assert judged(graph, ahead, run([0, 1, 2, 3, 4, 5, 6], [1.0] * 6, begin=-0.3))[0].meetings
    assert judged(graph, ahead, run([0, 1, 2, 3, 4, 5, 6], [1.0] * 6))[0].drivable


def test_least_distance_is_that_of_the_two_types():
    side_by_side = graph_of([(0, 0), (2, 0), (0, 0.5), (2, 0.5)], [(0, 1), (2, 3)], 2.0)
    ways = run([0, 1], [2.0]), run([2, 3], [2.0])
    small = replace(CART, length_m=0.2, width_m=0.2)
    mixed = fleet_of_types([CART, small], np.array([0, 1]))
    assert judged(side_by_side, *ways, fleet=fleet_of(small, 2))[0].drivable  # 0.383 m
    assert not judged(side_by_side, *ways, fleet=mixed)[0].drivable  # 0.602 m
    apart = graph_of([(0, 0), (2, 0), (0, 0.7), (2, 0.7)], [(0, 1), (2, 3)], 2.0)
    assert judged(apart, *ways, fleet=mixed)[0].drivable
    assert not judged(apart, *ways)[0].drivable  # 0.821 m


def test_two_robots_cannot_meet_on_a_long_lane():
    graph = line(2, 10.0)
    there, back = run([0, 1], [10.0]), run([1, 0], [10.0])
    result, _ = judged(graph, there, back)
    assert not result.drivable
    assert result.meetings[0].t_s == pytest.approx(5.5 - SEPARATION_M / 2, abs=0.05)


def test_nobody_overtakes_on_a_lane():
    graph = graph_of([(0, 0), (10, 0), (0, -1), (10, 1)], [(0, 1), (0, 2), (1, 3)], 1.0)
    slow = [(0, 0.0, 0.0), (1, 40.0, 40.0 + np.pi / 2), (3, 42.0 + np.pi / 2, np.inf)]
    fast = [(2, 0.0, 3.0), (0, 5.0, 5.0 + np.pi / 2), (1, 20.0, np.inf)]
    assert not judged(graph, slow, fast)[0].drivable


def test_robot_may_wait_on_a_long_lane_short_of_its_vertex():
    # robot_0 sets out at once and arrives late; robot_1 crosses the vertex in between, a separation before which there is room
    graph = graph_of([(0, 0), (5, 0), (5, 3), (5, -3)], [(0, 1), (1, 2), (1, 3)], 1.0)
    across = run([2, 1, 3], [3.0, 3.0])
    assert judged(graph, [(0, 0.0, 0.0), (1, 12.0, np.inf)], across)[0].drivable
    assert not judged(graph, [(0, 0.0, 0.0), (1, 6.0, np.inf)], run([2, 1, 3], [3.0, 3.0], begin=3.0))[0].drivable


def test_it_waits_farther_back_where_the_other_leaves_at_an_acute_angle():
    # the lanes to 0 and 2 leave vertex 1 at 30 degrees: they are a separation apart only 1.64 m from it
    graph = graph_of([(0, 0), (5, 0), (5 - 5 * np.cos(np.pi / 6), 2.5)], [(0, 1), (1, 2)], 1.0)
    leaves = run([1, 2], [5.0], begin=3.0)
    assert judged(graph, [(0, 0.0, 0.0), (1, 8.0, np.inf)], leaves)[0].drivable
    assert not judged(graph, [(0, 0.0, 0.0), (1, 6.0, np.inf)], leaves)[0].drivable


def test_one_robot_at_a_time_is_in_a_group():
    nav = nav_graph(
        name="two rooms",
        xy=[(0, 0), (3, 0), (0, 9), (3, 9)],
        lanes=[(0, 1), (1, 0), (2, 3), (3, 2)],
        vertex_options=[{}, {"mutex": "crane"}, {}, {"mutex": "crane"}],
    )
    graph = plan_graph(nav, kind="roadmap", cell_m=1.0)
    there_and_back = [(0, 0.0, 0.0), (1, 4.0, 4.0 + np.pi), (0, 8.0 + np.pi, np.inf)]

    def later(begin):
        return [(2, 0.0, begin), (3, begin + 4.0, np.inf)]

    result, problem = judged(graph, there_and_back, later(3.0))
    assert describe_meeting(result.meetings[0], problem).startswith("robot_0 and robot_1 are both in mutex group 'crane'")
    assert judged(graph, there_and_back, later(8.0))[0].drivable
    # robot_1 comes within a separation of its vertex about 3 s after it sets out, when the other one has left
    assert judged(graph, there_and_back, later(6.0))[0].drivable


def test_plan_of_nobody_is_drivable():
    graph = line(3, 1.0)
    empty = Plan(np.zeros(1, np.int64), np.zeros(0, np.int64), np.zeros(0), np.zeros(0))
    none = np.zeros(0, np.int64)
    assert judge_in_seconds(Problem(graph, fleet_of(CART, 0), none, none, none, 1.0), empty).drivable


@pytest.mark.parametrize("name", ["cbs", "ecbs", "eecbs", "lacam", "lns2", "pibt", "prioritised"])
def test_retimed_plans_of_all_planners_are_drivable(name):
    judged_plans = 0
    for seed in range(4):
        problem = replace(random_grid(6, 6, seed), fleet=fleet_of(CART, 6))  # for whom there is no room to wait on a lane
        plan = planner(name, {}).plan(problem, 5.0).plan
        if plan is None:
            continue
        try:
            plan = retime(problem, plan, ExecutionSettings())
        except PlanError:  # robots that rotate in a ring
            continue
        assert judge_in_seconds(problem, plan) == Drivability((), ())
        judged_plans += 1
    assert judged_plans >= 2


@pytest.mark.parametrize("number", range(24))
def test_mutated_plans_are_judged_as_linear_programs_and_sampled_footprints_do(number, tmp_path):
    assert RefereeInSeconds(1).trial(number, tmp_path).faults == ()


@pytest.mark.campaign
def test_ten_thousand_mutated_plans_are_judged_as_linear_programs_and_sampled_footprints_do(tmp_path):
    campaign = RefereeInSeconds(2)
    assert [trial for trial in (campaign.trial(number, tmp_path) for number in range(10_000)) if trial.faults] == []
