"""Small worlds in which plans cease to hold: who goes first, when, what is told and how seconds are booked, by hand.

Times: a Burger drives a cell of 0.4 m in 1.82 s at 0.22 m/s and turns back in 1.11 s at 2.84 rad/s; deadlocks are
looked for every half second.
"""

import dataclasses

import numpy as np
import pytest
from worlds import BURGER, cross, drive, graph_of, kinds, least_distance_m, line, square_grid

from mrp_sumo.core.disturbances import Breakdown, ClosedLane, Disturbances, Obstacle
from mrp_sumo.core.driving import RecoveryOptions
from mrp_sumo.core.execution import BOOKINGS, Outcome
from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.engines.sumo.session import Sumo
from mrp_sumo.errors import ExecutionError, PlanError
from mrp_sumo.metrics.audit import audit

pytestmark = pytest.mark.kernel

CELL_S = 0.4 / 0.22
U_TURN_S = np.pi / 2.84
YIELDING, DEPENDENCY, DISTURBED, AT_GOAL = (BOOKINGS.index(name) for name in ("yielding", "dependency_wait", "disturbed", "at_goal"))


def recovered(tmp_path, graph, paths, policy="open_loop", **settings):
    """Drive with recovery; nobody comes too near, and every second is booked once."""
    run = drive(tmp_path, graph, paths, policy, on_deadlock="resolve", **settings)
    assert least_distance_m(run) >= 0.325
    assert audit(run, fleet_of(BURGER, len(paths)))["passed"] and not run.findings
    assert run.booked_s.sum(1) == pytest.approx(run.sim_time_s)
    return run


def events(run, kind):
    return [event for event in run.events if event.kind == kind]


def corridor(cells, siding):
    """A row of vertices and a side vertex, the last, beside one of them."""
    xy = [(0.4 * k, 0.0) for k in range(cells)] + [(0.4 * siding, 0.4)]
    return graph_of(xy, [(k, k + 1) for k in range(cells - 1)] + [(siding, cells)])


def test_head_on_the_one_beside_the_siding_steps_aside(tmp_path):
    # robot_0 (to the right) and robot_1 meet at 2 and 3; the siding is at 2, where robot_0 stands: one cell away, two for robot_1
    run = recovered(tmp_path, corridor(6, 2), [[0, 1, 2, 3, 4, 5], [5, 4, 3, 2, 1, 0]])
    assert run.outcome is Outcome.COMPLETED and run.all_at_goal
    (gave_way,) = events(run, "gave_way")
    assert (gave_way.robot, gave_way.other, gave_way.vertex) == (0, 1, 6)
    # they meet after two cells; robot_1 goes on when robot_0 has turned aside and come clear of vertex 2
    assert gave_way.t_s == pytest.approx(2 * CELL_S, abs=1.0)
    assert run.goal_s[1] == pytest.approx(gave_way.t_s + U_TURN_S / 2 + 4 * CELL_S, abs=0.9)
    assert run.booked_s[0, YIELDING] == pytest.approx(gave_way.duration_s)
    assert run.booked_s[1, YIELDING] == 0
    assert len(events(run, "deadlock")) == 1


def test_the_robot_with_the_shorter_way_out_backs_out(tmp_path):
    # the siding is at 1, behind robot_0: it has to turn, drive one cell back, turn and step aside; robot_1 would need four cells
    run = recovered(tmp_path, corridor(7, 1), [[0, 1, 2, 3, 4, 5], [6, 5, 4, 3, 2, 1, 0]])
    assert run.all_at_goal
    (gave_way,) = events(run, "gave_way")
    assert (gave_way.robot, gave_way.vertex) == (0, 7)
    assert run.goal_s[0] > run.goal_s[1]


def test_on_a_tie_the_lower_number_has_right_of_way(tmp_path):
    # sidings at both places where they stand
    graph = graph_of([(0.4 * k, 0) for k in range(6)] + [(0.8, 0.4), (1.2, 0.4)], [(k, k + 1) for k in range(5)] + [(2, 6), (3, 7)])
    run = recovered(tmp_path, graph, [[0, 1, 2, 3, 4, 5], [5, 4, 3, 2, 1, 0]])
    (gave_way,) = events(run, "gave_way")
    assert (gave_way.robot, gave_way.vertex) == (1, 7)
    assert run.goal_s[0] < run.goal_s[1]


def test_head_on_without_a_place_is_told_and_stays(tmp_path):
    run = recovered(tmp_path, line(6), [[0, 1, 2, 3, 4, 5], [5, 4, 3, 2, 1, 0]], time_limit_s=40.0)
    assert run.outcome is Outcome.TIME_LIMIT and np.isnan(run.goal_s).all()
    assert len(events(run, "deadlock")) == 1 and events(run, "deadlock")[0].t_s <= 2 * CELL_S + 1.0
    assert len(events(run, "unresolved")) == 1 and "gave_way" not in kinds(run)


def test_a_robot_behind_backs_out_so_that_the_one_before_it_can(tmp_path):
    # robot_0 leads, robot_1 follows; sidings at 1 and 2 are behind them when they meet robot_2 at 4
    graph = graph_of([(0.4 * k, 0) for k in range(9)] + [(0.4, 0.4), (0.8, 0.4)], [(k, k + 1) for k in range(8)] + [(1, 9), (2, 10)])
    run = recovered(tmp_path, graph, [[1, 2, 3, 4, 5, 6, 7], [0, 1, 2, 3, 4, 5, 6], [8, 7, 6, 5, 4, 3, 2, 1, 0]])
    assert run.all_at_goal
    assert {event.robot for event in events(run, "gave_way")} == {0, 1}
    assert run.goal_s.argmin() == 2


def test_on_a_long_lane_a_robot_turns_back(tmp_path):
    # both wait at the ends of one long lane's inside: robot_0 short of vertex 2, where robot_1 wants to come in
    graph = graph_of([(0, 0), (0.4, 0), (3.0, 0), (3.4, 0), (0.4, 0.4)], [(0, 1), (1, 2), (2, 3), (1, 4)])
    run = recovered(tmp_path, graph, [[0, 1, 2, 3], [3, 2, 1, 0]], step_s=14.0)
    assert run.all_at_goal
    (gave_way,) = events(run, "gave_way")
    assert (gave_way.robot, gave_way.vertex) == (0, 4)
    assert run.goal_s[1] < run.goal_s[0]


def test_two_that_swap_pass_at_a_side_vertex(tmp_path):
    # neither may step aside over a vertex where the other ends, so a planner has to tell both
    graph = graph_of([(0, 0), (0.4, 0), (0.4, 0.4), (0.8, 0)], [(0, 1), (1, 2), (1, 3)])
    run = recovered(tmp_path, graph, [[0, 1], [1, 0]], recovery=RecoveryOptions(patience_s=5.0))
    assert run.all_at_goal and "gave_way" not in kinds(run)
    (deadlock,), (resolved,) = events(run, "deadlock"), events(run, "resolved")
    assert deadlock.t_s <= 1.0 and resolved.t_s == pytest.approx(deadlock.t_s + 5.0)


def test_in_a_roundabout_that_is_full_one_lets_the_others_turn(tmp_path):
    # four robots on a ring of four, each leaves it after two; vertex 8 lies beside 0 and is nobody's
    xy = [(0, 0), (0.4, 0), (0.4, 0.4), (0, 0.4), (-0.4, 0), (0.4, -0.4), (0.8, 0.4), (0, 0.8), (0, -0.4)]
    graph = graph_of(xy, [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (2, 6), (3, 7), (0, 8)])
    paths = [[0, 1, 2, 6], [1, 2, 3, 7], [2, 3, 0, 4], [3, 0, 1, 5]]
    run = recovered(tmp_path, graph, paths)
    assert run.all_at_goal
    (gave_way,) = events(run, "gave_way")
    assert (gave_way.robot, gave_way.vertex) == (0, 8)
    assert run.goal_s.argmax() == 0  # it goes on when robots 2 and 3 have passed vertex 0
    with pytest.raises(PlanError, match="cyclic"):
        drive(tmp_path, graph, paths, "adg")


def test_in_a_roundabout_with_a_gap_everybody_gets_on(tmp_path):
    graph = graph_of([(0, 0), (0.4, 0), (0.4, 0.4), (0, 0.4)], [(0, 1), (1, 2), (2, 3), (3, 0)])
    run = recovered(tmp_path, graph, [[0, 1, 2], [1, 2, 3], [2, 3, 0]])
    assert run.all_at_goal and not events(run, "deadlock")
    assert sorted(run.goal_s.tolist()) == run.goal_s[[2, 1, 0]].tolist()  # the one with the gap ahead is first


def test_at_a_merge_the_one_that_asks_first_goes_first(tmp_path):
    # robot_0 has two cells to the crossing, robot_1 one
    run = recovered(tmp_path, cross(), [[2, 1, 0, 7, 8], [4, 0, 7, 8, 9]])
    assert run.all_at_goal and run.goal_s[1] < run.goal_s[0]
    assert run.booked_s[1, DEPENDENCY] == 0
    assert [event.robot for event in events(run, "waited")] in ([], [0])


def test_who_blocks_a_goal_is_moved_aside_by_a_new_plan(tmp_path):
    # robot_0 is at home at 2, robot_1 has to pass; the siding at 2 lets it, if robot_0 steps aside and comes back
    run = recovered(tmp_path, corridor(5, 2), [[2], [0, 1, 2, 3]], recovery=RecoveryOptions(patience_s=10.0))
    assert run.all_at_goal
    (resolved,) = events(run, "resolved")
    assert 10.0 <= resolved.t_s <= CELL_S + 10.0 + 2.0
    assert (run.x_m[-1, 0], run.x_m[-1, 1]) == pytest.approx((0.8, 1.2), abs=0.002)


def test_who_had_come_to_stay_is_put_back_where_it_stood_when_it_is_sent_on(tmp_path, monkeypatch):
    out = []
    take_out = Sumo.take_out
    monkeypatch.setattr(Sumo, "take_out", lambda sumo, robot: out.append(robot) or take_out(sumo, robot))
    sumo, kinematic = (
        recovered(tmp_path, corridor(5, 2), [[2], [0, 1, 2, 3]], recovery=RecoveryOptions(patience_s=10.0), engine=engine)
        for engine in ("sumo", "kinematic")
    )
    assert out == [0, 1]  # robot_0 stands there from the beginning, and goes aside when it is in the way
    assert sumo.events == kinematic.events
    for name in ("x_m", "y_m", "yaw_rad", "goal_s"):
        np.testing.assert_allclose(getattr(sumo, name), getattr(kinematic, name), atol=1e-6)


@pytest.mark.parametrize("tolerance_m", [0.0, 0.01])
def test_a_robot_that_is_sent_aside_and_never_leaves_stands_on_its_goal(tmp_path, tolerance_m):
    # as above, but robot_0 breaks down before it leaves, and is not repaired before time is up
    broken = Disturbances(breakdowns=(Breakdown(0, 7.2, 1000.0),))
    settings = {"recovery": RecoveryOptions(patience_s=5.0), "time_limit_s": 40.0, "goal_tolerance_m": tolerance_m, "disturbances": broken}
    run = recovered(tmp_path, corridor(5, 2), [[2], [0, 1, 2, 3]], **settings)
    assert events(run, "resolved") and run.outcome is Outcome.TIME_LIMIT
    assert np.isfinite(run.goal_s).tolist() == [True, False]


def test_a_closed_lane_is_driven_around_after_the_patience(tmp_path):
    # 3 x 3: robot_0 goes along the lower edge and finds the second lane closed for good
    closed = (ClosedLane(1, 2, 0.0),)
    run = recovered(tmp_path, square_grid(3), [[0, 1, 2]], closed_lanes=closed, recovery=RecoveryOptions(patience_s=10.0))
    assert run.all_at_goal
    (detour,) = events(run, "detour")
    assert (detour.robot, detour.vertex, detour.text) == (0, 2, "drives around a closed lane")
    assert detour.duration_s == pytest.approx(10.0, abs=0.6)
    assert run.booked_s[0, DISTURBED] == pytest.approx(detour.duration_s, abs=0.6)
    # one cell, the patience, and up, right and down with a turn before each
    assert run.goal_s[0] == pytest.approx(4 * CELL_S + 10.0 + 3 * U_TURN_S / 2, abs=1.5)


@pytest.mark.parametrize("policy", ["open_loop", "adg", "adg_timed"])
def test_a_closed_lane_without_a_way_around_is_waited_for(tmp_path, policy):
    closed = (ClosedLane(1, 2, 0.0, 30.0),)
    run = recovered(tmp_path, line(4), [[0, 1, 2, 3]], policy, closed_lanes=closed)
    assert run.all_at_goal and "detour" not in kinds(run)
    assert run.goal_s[0] == pytest.approx(30.0 + 2 * CELL_S, abs=1.0)


@pytest.mark.parametrize("policy", ["adg", "adg_timed"])
def test_around_a_closed_lane_orders_are_made_anew(tmp_path, policy):
    # robot_1 follows robot_0 in the plan; both get a new way around the closed lane, and a new order
    closed = (ClosedLane(1, 2, 0.0),)
    run = recovered(tmp_path, square_grid(3), [[1, 2, 5], [0, 1, 2]], policy, closed_lanes=closed)
    assert run.all_at_goal
    assert events(run, "resolved") and not events(run, "deadlock")


def test_a_robot_that_breaks_down_on_its_way_is_driven_around(tmp_path):
    broken = Disturbances(breakdowns=(Breakdown(1, 1.0),))  # between 1 and 2, which it holds both
    run = recovered(tmp_path, square_grid(4), [[0, 1, 2, 6, 10, 14, 15], [1, 2, 3, 7]], "adg", disturbances=broken, time_limit_s=80.0)
    assert np.isfinite(run.goal_s[0]) and np.isnan(run.goal_s[1])
    assert run.outcome is Outcome.TIME_LIMIT
    assert run.booked_s[1, AT_GOAL] == 0
    assert run.booked_s[1, DISTURBED] == pytest.approx(80.0 - 1.0, abs=1.0)


@pytest.mark.parametrize("policy", ["open_loop", "adg"])
def test_a_human_on_a_lane_that_leaves_costs_the_time_that_it_stood_there(tmp_path, policy):
    human = Disturbances(obstacles=(Obstacle(0.8, 0.0, 0.0, 8.0, 0.1),))
    run = recovered(tmp_path, line(5), [[0, 1, 2, 3, 4]], policy, disturbances=human)
    # lanes within 0.1 + 0.1126 m of the human: both of vertex 2; robot_0 waits at 1 until 8 s
    assert run.goal_s[0] == pytest.approx(8.0 + 3 * CELL_S, abs=0.6)
    assert run.booked_s[0, DISTURBED] == pytest.approx(8.0 - CELL_S, abs=0.3)
    assert not {"detour", "resolved", "gave_way"} & set(kinds(run))


def test_a_recovered_run_gives_the_same_bytes(tmp_path):
    paths = [[0, 1, 2, 3, 4, 5], [5, 4, 3, 2, 1, 0]]
    one, two = (recovered(tmp_path, corridor(6, 2), paths) for _ in range(2))
    assert one.x_m.tobytes() == two.x_m.tobytes() and one.events == two.events


@pytest.mark.parametrize("dt", [0.2, 0.5, 1.0])
@pytest.mark.parametrize("policy", ["open_loop", "timed"])
def test_giving_way_works_at_every_step_length_and_with_late_messages(tmp_path, dt, policy):
    late = Disturbances(latency_s=1.0, message_loss=0.3)
    paths = [[0, 1, 2, 3, 4, 5], [5, 4, 3, 2, 1, 0]]
    run = recovered(tmp_path, corridor(6, 2), paths, policy, step_length_s=dt, record_period_s=dt, disturbances=late)
    assert run.all_at_goal and "gave_way" in kinds(run)


def with_mutex(graph, vertices=(), lanes=()):
    """The graph with some vertices and lanes in group 'dock'."""
    vertex_options = [{"mutex": "dock"} if v in vertices else {} for v in range(graph.num_vertices)]
    pairs = {pair for a, b in lanes for pair in ((a, b), (b, a))}
    lane_options = [{"mutex": "dock"} if pair in pairs else {} for pair in zip(graph.tail.tolist(), graph.head.tolist())]
    return dataclasses.replace(graph, vertex_options=tuple(vertex_options), lane_options=tuple(lane_options))


@pytest.mark.parametrize("policy", ["adg", "adg_timed", "open_loop", "timed"])
def test_one_robot_at_a_time_is_in_a_mutex_group(tmp_path, policy):
    # two rows that never meet; vertices 2 to 4 of both are one group
    xy = [(0.4 * k, y) for y in (0.0, 2.0) for k in range(7)]
    graph = graph_of(xy, [(7 * row + k, 7 * row + k + 1) for row in range(2) for k in range(6)])
    members = {2, 3, 4, 9, 10, 11}
    paths = [[0, 1, 2, 3, 4, 5, 6], [7, 8, 9, 10, 11, 12, 13]]
    free = drive(tmp_path, graph, paths, policy)
    run = drive(tmp_path, with_mutex(graph, members), paths, policy)
    assert run.all_at_goal
    inside = (run.x_m > 0.8 - 0.2) & (run.x_m < 1.6 + 0.2)  # of each robot, half a lane and more around its vertices
    assert not inside.all(1).any()
    if policy.endswith("timed"):
        return
    # robot_1 waits at vertex 8 until robot_0 is a separation past vertex 4
    assert free.goal_s[1] == pytest.approx(free.goal_s[0]) and run.goal_s[0] == pytest.approx(free.goal_s[0])
    assert run.goal_s[1] == pytest.approx((4 * 0.4 + 0.325) / 0.22 + 5 * CELL_S, abs=0.5)
    waited = events(run, "waited")
    assert [(event.robot, event.other, event.vertex) for event in waited] == [(1, 0, 9)]


def test_a_lane_in_a_group_is_left_at_its_end(tmp_path):
    xy = [(0.4 * k, y) for y in (0.0, 2.0) for k in range(5)]
    graph = graph_of(xy, [(5 * row + k, 5 * row + k + 1) for row in range(2) for k in range(4)])
    run = drive(tmp_path, with_mutex(graph, lanes=[(1, 2), (6, 7)]), [[0, 1, 2, 3, 4], [5, 6, 7, 8, 9]])
    assert run.goal_s[0] == pytest.approx(4 * CELL_S, abs=0.2)
    assert run.goal_s[1] == pytest.approx(2 * CELL_S + 3 * CELL_S, abs=0.3)  # sets out from 6 when robot_0 is at 2


def test_two_robots_in_one_group_at_the_start_are_refused(tmp_path):
    with pytest.raises(ExecutionError, match="robot_0 and robot_1 both start in mutex group 'dock'"):
        drive(tmp_path, with_mutex(line(5), {0, 4}), [[0, 1], [4, 3]])
