"""Small worlds driven in SUMO whose outcome is known by hand."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from worlds import BURGER, cross, drive, graph_of, kinds, least_distance_m, line, problem_of, square_grid

from mrp_sumo.core.disturbances import Breakdown, Disturbances
from mrp_sumo.core.execution import BOOKINGS, Outcome
from mrp_sumo.core.robot_type import Loaded
from mrp_sumo.drive._causes import FACILITY, FOLLOWING
from mrp_sumo.drive.controller import Controller
from mrp_sumo.drive.fit import resources_for
from mrp_sumo.drive.ledger import Ledger
from mrp_sumo.drive.listeners import Listener, ProgressReport
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.policy import policy_of
from mrp_sumo.drive.reroute import first_of
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.engines.sumo import engine, network
from mrp_sumo.engines.sumo.network import build_network
from mrp_sumo.errors import ExecutionError, MrpSumoError, PlanError

pytestmark = pytest.mark.kernel

SEPARATION_M = 0.325  # of two Burgers: hypot(0.138, 0.178) + 0.1, rounded down


def test_a_robot_alone_drives_its_path_at_its_speed(tmp_path):
    run = drive(tmp_path, line(5), [[0, 1, 2, 3, 4]])
    assert run.outcome is Outcome.COMPLETED
    assert run.goal_s[0] == pytest.approx(1.6 / 0.22, abs=0.1)
    assert run.x_m[-1, 0] == pytest.approx(1.6, abs=0.0011)
    assert (run.y_m == 0).all() and (run.yaw_rad == 0).all()
    assert run.speed_mps.max() == pytest.approx(0.22)
    assert run.t_s[1] == 0.1 and run.t_s[-1] == run.sim_time_s
    assert kinds(run) == {"started": [0], "goal": [0]}


def test_a_robot_that_stays_has_heading_zero_and_is_at_its_goal(tmp_path):
    run = drive(tmp_path, line(3), [[2], [0, 1]])
    assert run.goal_s[0] == 0
    assert (run.yaw_rad[:, 0] == 0).all() and (run.x_m[:, 0] == 0.8).all()


def test_a_corner_takes_the_time_of_the_turn_and_the_heading_is_never_faster(tmp_path):
    straight = drive(tmp_path, line(3), [[0, 1, 2]])
    corner = drive(tmp_path, square_grid(2), [[0, 1, 3]])
    turn_s = np.pi / 2 / 2.84
    # the turn, braking and starting again, each up to a step late
    assert turn_s < corner.goal_s[0] - straight.goal_s[0] < turn_s + 0.3
    assert np.abs(np.diff(corner.yaw_rad[:, 0])).max() <= 2.84 * 0.1 + 1e-9
    assert corner.yaw_rad[-1, 0] == pytest.approx(np.pi / 2)


def test_the_one_planned_first_crosses_first(tmp_path):
    east_to_west, north_to_south = [1, 0, 7], [4, 0, 10]
    run = drive(tmp_path, cross(), [east_to_west, [4, *north_to_south]])
    assert run.goal_s[0] < run.goal_s[1]
    run = drive(tmp_path, cross(), [[1, *east_to_west], north_to_south])
    assert run.goal_s[0] > run.goal_s[1]
    assert least_distance_m(run) >= SEPARATION_M
    assert kinds(run)["waited"] == [0]


def test_rounding_in_an_engine_does_not_decide_when_a_robot_has_arrived(tmp_path):
    """At full speed this robot is 3.498 m on its way after 159 steps: 2 mm before a vertex, where it has arrived, but for rounding."""
    granted = [drive(tmp_path, line(12, 0.5), [range(12)], engine=name).grants for name in ("sumo", "kinematic")]
    assert np.array_equal(granted[0].t_s, granted[1].t_s)
    assert 15.9 in granted[0].t_s


class Count(Listener):
    def __init__(self, *, is_patient=False):
        self.steps, self.is_patient = 0, is_patient

    def hear(self, time_s):
        self.steps += 1


@pytest.mark.parametrize(("policy", "period_s"), [("adg", 0.1), ("adg_timed", 0.4), ("adg_switch", 0.3), ("open_loop", 1.0)])
def test_steps_are_the_same_whether_somebody_is_shown_them_or_not(tmp_path, policy, period_s):
    problem, plan = problem_of(cross(), [[1, 0, 7, 8], [4, 4, 0, 10, 11], [2, 2, 2, 2, 1, 0, 4, 5]], BURGER, 3.0)
    settings = ExecutionSettings(policy=policy, engine="kinematic", record_period_s=period_s, time_limit_s=25.15)
    heard, patient = Count(), Count(is_patient=True)
    alone, shown = (simulate(problem, plan, settings, tmp_path / "none.net.xml", listeners=[who]) for who in (patient, heard))
    assert heard.steps > 100 and shown.events and patient.steps < heard.steps
    for name in ("t_s", "x_m", "y_m", "yaw_rad", "speed_mps", "arrived_s", "booked_s", "sumo_xy_m"):
        assert getattr(alone, name).tobytes() == getattr(shown, name).tobytes(), name
    assert alone.events == shown.events and (alone.outcome, alone.sim_time_s) == (shown.outcome, shown.sim_time_s)
    assert all(one.tobytes() == other.tobytes() for one, other in zip(vars(alone.grants).values(), vars(shown.grants).values()))


def test_a_platoon_drives_as_one(tmp_path):
    run = drive(tmp_path, line(8), [[3, 4, 5, 6, 7], [2, 3, 4, 5, 6], [1, 2, 3, 4, 5]])
    assert run.all_at_goal
    assert np.diff(run.goal_s).min() > 0
    assert least_distance_m(run) >= SEPARATION_M


def test_head_on_in_a_corridor_is_a_deadlock_in_open_loop(tmp_path):
    run = drive(tmp_path, line(6), [[0, 1, 2, 3, 4, 5], [5, 4, 3, 2, 1, 0]], "open_loop", time_limit_s=30.0)
    assert run.outcome is Outcome.TIME_LIMIT
    assert run.sim_time_s == 30.0
    assert np.isnan(run.goal_s).all()
    deadlock = next(event for event in run.events if event.kind == "deadlock")
    assert {deadlock.robot, deadlock.other} == {0, 1}
    assert deadlock.t_s < 7
    assert sorted(kinds(run)["blocked"]) == [0, 1]
    assert least_distance_m(run) >= SEPARATION_M


def test_head_on_on_one_long_lane_stops_before_a_collision(tmp_path):
    graph = graph_of([(0, 0), (0.4, 0), (6, 0), (6.4, 0)], [(0, 1), (1, 2), (2, 3)])
    run = drive(tmp_path, graph, [[0, 1, 2, 3], [3, 2, 1, 0]], "open_loop", time_limit_s=40.0)
    assert not run.all_at_goal
    assert "deadlock" in kinds(run)
    assert least_distance_m(run) >= SEPARATION_M


def test_followers_share_a_long_lane(tmp_path):
    graph = graph_of([(0, 0), (0.4, 0), (0.8, 0), (10, 0), (10.4, 0), (10.8, 0)], [(k, k + 1) for k in range(5)])
    run = drive(tmp_path, graph, [[1, 2, 3, 4, 5], [0, 1, 2, 3, 4]], step_s=45.0)
    assert run.all_at_goal
    assert run.goal_s[1] - run.goal_s[0] < 5  # a lane for one robot at a time would take 40 s more
    assert least_distance_m(run) >= SEPARATION_M


def test_a_dead_end_is_left_before_the_next_comes(tmp_path):
    # robot_0 backs out of the arm into the side while robot_1 waits to go in
    run = drive(tmp_path, cross(), [[2, 1, 0, 4], [7, 7, 7, 7, 0, 1]])
    assert run.all_at_goal
    assert least_distance_m(run) >= SEPARATION_M


def test_who_stands_at_its_goal_blocks_the_others_for_good(tmp_path):
    run = drive(tmp_path, line(5), [[2], [0, 1, 2, 3]], "open_loop", time_limit_s=30.0)
    assert run.goal_s[0] == 0 and np.isnan(run.goal_s[1])
    blocked = next(event for event in run.events if event.kind == "blocked")
    assert (blocked.robot, blocked.other, blocked.vertex) == (1, 0, 2)
    assert run.x_m[-1, 1] == pytest.approx(0.4, abs=0.002)
    final = next(event for event in run.events if event.kind == "blocked_for_good")
    assert (final.robot, final.other, final.text) == (1, 0, "behind robot_0, which stays at its goal")
    assert 10.0 < final.t_s < 13.0  # no progress within the window of 10 s


def test_a_wait_goes_on_after_a_disturbance_of_the_one_that_waits(tmp_path):
    # robot_1 waits behind robot_0, breaks down there for 4 s, and waits on, for the same reason
    broken = Disturbances(breakdowns=(Breakdown(1, 5.0, 4.0),))
    run = drive(tmp_path, line(5), [[2], [0, 1, 2, 3]], "open_loop", time_limit_s=40.0, disturbances=broken)
    waits = [(event.t_s, event.t_s + event.duration_s) for event in run.events if event.kind == "waited"]
    assert waits[-1] == pytest.approx((9.0, 40.0), abs=0.3)
    assert "blocked_for_good" in kinds(run)


def test_a_robot_that_breaks_down_on_its_way_comes_as_much_later(tmp_path):
    broken = Disturbances(breakdowns=(Breakdown(0, 2.0, 4.0),))
    run = drive(tmp_path, line(5), [[0, 1, 2, 3, 4]], disturbances=broken)
    assert run.goal_s[0] == pytest.approx(1.6 / 0.22 + 4.0, abs=0.2)


def test_the_waits_of_those_who_are_sent_another_way_end_and_those_of_others_go_on():
    problem, plan = problem_of(line(5), [[0, 1], [4, 3]], BURGER)
    ledger = Ledger(problem, resources_for(problem, plan))
    ledger.append(first_of(plan), policy_of("adg"), 0.0)
    ledger.state.waits.since_s[:] = 2.0
    controller = Controller(ledger, policy_of("adg"), ExecutionSettings())
    waits = [[event.robot for event in controller.unfinished_waits(5.0, robots)] for robots in ([1], [], None)]
    assert waits == [[1], [], [0, 1]]


def controller_of(paths, robot=BURGER, graph=None, policy="open_loop"):
    problem, plan = problem_of(graph or line(5), paths, robot)
    ledger = Ledger(problem, resources_for(problem, plan))
    ledger.append(first_of(plan), policy_of(policy), 0.0)
    return Controller(ledger, policy_of(policy), ExecutionSettings())


def test_robots_have_been_at_their_starts_from_the_beginning():
    visits = controller_of([[0, 1], [4, 3]]).ledger.visits
    assert visits.arrived_s[:4].tolist() == pytest.approx([0.0, 0.0, np.nan, np.nan], nan_ok=True)


def test_waits_of_half_a_second_and_blockings_are_told_with_their_reasons():
    controller = controller_of([[0, 1], [2, 1], [4, 3]])
    state = controller.ledger.state
    state.waits.since_s[:] = [4.5, 4.6, 2.0]
    state.waits.stuck[:] = [False, True, False]
    state.waits.mark_s[:], state.waits.cause[:], state.waits.other[:], state.waits.where[:] = 1.0, FOLLOWING, [-1, 0, 1], [-1, 3, 5]
    events = [(e.kind, e.robot, e.vertex, e.other, e.t_s, e.duration_s, e.text) for e in controller.unfinished_waits(5.0)]
    assert events == [
        ("waited", 0, -1, -1, 4.5, 0.5, "behind another robot"),
        ("waited", 2, 3, 1, 2.0, 3.0, "behind robot_1"),
        ("blocked", 1, 1, 0, 1.0, 4.0, "behind robot_0"),
    ]
    assert [e.robot for e in controller.unfinished_waits(5.0, [0, 1])] == [0, 1]


@pytest.mark.parametrize(
    ("options", "text"), [({"door": "glass"}, "waits for door 'glass'"), ({"cabin": "goods"}, "waits for lift 'goods'")]
)
def test_what_a_robot_waits_for_is_named(options, text):
    controller = controller_of([[0, 1]])
    graph, waits = controller.ledger.graph, controller.ledger.state.waits
    lane = int(controller.ledger.visits.lane[1])
    vars(graph)["lane_options"] = tuple(options if at == lane else {} for at in range(graph.num_lanes))
    waits.since_s[:], waits.cause[:], waits.where[:] = 1.0, FACILITY, 1
    (event,) = controller.unfinished_waits(5.0)
    assert (event.vertex, event.text) == (1, text)


def test_a_deadlock_names_where_each_wants_to_go():
    controller = controller_of([[0, 1], [2, 1], [4, 3]])
    controller.ledger.state.grants.wanted[:] = [3, 4, 5]
    event = controller.deadlock(7.0, (2, 0, 1))
    assert event.text == "robot_2 (to 'v3') waits for robot_0 (to 'v1') waits for robot_1 (to 'v1') waits for robot_2"
    assert (event.t_s, event.kind, event.robot, event.vertex, event.other, event.duration_s) == (7.0, "deadlock", 2, 3, 0, 0.0)
    alone = controller.deadlock(7.0, (1,))
    assert (alone.robot, alone.other, alone.text) == (1, 1, "robot_1 (to 'v1') waits for robot_1")


@pytest.mark.parametrize(
    ("speed_mps", "decel_mps2", "reach_m"), [(1.0, 1.0, 0.5 + 0.3 + 0.02), (2.0, 1.0, 2.0 + 0.6 + 0.02), (0.2, 0.5, 0.12)]
)
def test_robots_look_as_many_visits_ahead_as_their_policy_says_and_as_they_need_to_brake(speed_mps, decel_mps2, reach_m):
    """To brake takes v^2 / 2a; three steps and 2 cm are added. Lanes are 0.4 m long."""
    robot = dataclasses.replace(BURGER, max_speed_mps=speed_mps, decel_mps2=decel_mps2)
    controller = controller_of([[0, 1]], robot)
    assert controller.kinematics.reach_m.tolist() == pytest.approx([reach_m])
    assert controller.rules.look_ahead == 2 + int(reach_m / 0.4)
    loaded = dataclasses.replace(robot, loaded=Loaded(decel_mps2=decel_mps2 / 2))
    far_m = speed_mps**2 / decel_mps2 + 0.3 * speed_mps + 0.02
    assert controller_of([[0, 1]], loaded).rules.look_ahead == 2 + int(far_m / 0.4)
    assert controller.rules.cell_m == pytest.approx(0.39, abs=1e-6)


def test_a_final_blocking_ends_the_run_where_that_is_asked_for(tmp_path):
    # robot_2 is behind robot_1, which is behind robot_0
    run = drive(tmp_path, line(6), [[3], [1, 2, 3, 4], [0, 1, 2]], "open_loop", time_limit_s=100.0, on_deadlock="stop")
    assert run.outcome is Outcome.DEADLOCK and run.sim_time_s < 15.0
    texts = [event.text for event in run.events if event.kind == "blocked_for_good"]
    assert "behind robot_0, which stays at its goal" in texts


def test_who_waits_behind_a_broken_robot_in_a_ring_is_blocked_for_good(tmp_path):
    # robot_0 and robot_1 meet on a line, robot_2 comes behind robot_1, which breaks down there
    broken = Disturbances(breakdowns=(Breakdown(1, 25.0),))
    run = drive(tmp_path, line(8), [[2, 3, 4, 5], [5, 4, 3, 2], [7, 6, 5, 4]], "open_loop", time_limit_s=40.0, disturbances=broken)
    texts = {event.robot: event.text for event in run.events if event.kind == "blocked_for_good"}
    assert texts[2] == texts[0] == "behind robot_1, which is broken"


@pytest.mark.parametrize("policy", ["adg", "adg_timed"])
def test_orders_that_nobody_can_keep_are_refused(tmp_path, policy):
    with pytest.raises(PlanError, match="cyclic"):
        drive(tmp_path, line(2), [[0, 1], [1, 0]], policy)
    with pytest.raises(PlanError, match="cyclic"):
        drive(tmp_path, square_grid(2), [[0, 1], [1, 3], [3, 2], [2, 0]], policy)
    with pytest.raises(PlanError, match="robot_0 stays at 'v1'"):
        drive(tmp_path, line(3), [[1], [0, 1, 2]], policy)


@pytest.mark.parametrize("policy", ["timed", "adg_timed"])
def test_no_vertex_is_left_before_the_plan_does(tmp_path, policy):
    run = drive(tmp_path, line(4), [[0, 1, 1, 1, 2, 3]], policy)
    assert run.goal_s[0] == pytest.approx(5 * 3.0, abs=0.5)
    early = drive(tmp_path, line(4), [[0, 1, 1, 1, 2, 3]], "adg")
    assert early.goal_s[0] < 6


def test_one_way_streets_and_dead_ends_without_exit_are_driven(tmp_path):
    graph = graph_of([(0, 0), (0.4, 0), (0.8, 0)], [], one_way=[(0, 1), (1, 2)])
    run = drive(tmp_path, graph, [[0, 1, 2]])
    assert run.all_at_goal
    assert run.x_m[-1, 0] == pytest.approx(0.8, abs=0.002)


def test_every_second_is_booked_once(tmp_path):
    run = drive(tmp_path, cross(), [[1, 1, 0, 7], [4, 0, 10], [12]])
    assert run.booked_s.shape == (3, 8)
    assert run.booked_s.sum(1) == pytest.approx(run.sim_time_s)


LONG = graph_of([(0, 0), (0.4, 0), (6, 0), (6.4, 0)], [(0, 1), (1, 2), (2, 3)])
BEHIND_0 = "needs what robot_0 holds or is to pass first"


def drive_in_the_plane(graph, paths, policy="adg", step_s=3.0, limit_s=20.0, broken=(), goal_heading_rad=None):
    """Drive paths without SUMO."""
    problem, plan = problem_of(graph, paths, BURGER, step_s)
    broken = Disturbances(breakdowns=tuple(Breakdown(*each) for each in broken))
    settings = ExecutionSettings(policy=policy, engine="kinematic", time_limit_s=limit_s, disturbances=broken)
    return simulate(dataclasses.replace(problem, goal_heading_rad=goal_heading_rad), plan, settings, Path("no.net.xml"))


@pytest.mark.parametrize(
    ("graph", "paths", "how", "booked", "events"),
    [
        pytest.param(  # 0.398 m at 0.22 m/s are 1.8 s, and braking takes some more; it leaves vertex 1 with the plan
            line(3),
            [[0, 1, 1, 1, 1, 1, 2]],
            {"policy": "timed"},
            [{"moving": 6.0, "planned_wait": 12.0}],
            [],
            id="waits as planned",
        ),
        pytest.param(  # a tenth of its speed is the least: 18.1 s for a lane of 30 s, and that is no blocking
            line(3),
            [[0, 1, 2]],
            {"policy": "adg_timed", "step_s": 30.0, "limit_s": 60.0},
            [{"moving": 36.4, "planned_wait": 11.8}],
            [],
            id="creeps as planned",
        ),
        pytest.param(square_grid(2), [[0, 1, 3]], {}, [{"moving": 3.8, "turning": 0.6}], [], id="turns"),
        pytest.param(
            line(3),
            [[0, 1, 2]],
            {"goal_heading_rad": np.array([np.pi])},
            [{"moving": 3.7, "turning": 1.2}],
            [],
            id="turns at its goal",
        ),
        pytest.param(  # the second may set out when the first has left the crossing by its size and the gap
            cross(),
            [[4, 0, 10], [1, 1, 0, 7]],
            {},
            [{"moving": 3.7, "at_goal": 3.3}, {"moving": 3.7, "dependency_wait": 3.3}],
            [("waited", 1, 0, 0.0, 3.3, BEHIND_0)],
            id="lets another pass",
        ),
        pytest.param(  # no cell in the 10 s since it was at vertex 1, but for 2 mm
            line(5),
            [[2], [0, 1, 2, 3]],
            {"policy": "open_loop"},
            [{"at_goal": 20.0}, {"moving": 1.9, "dependency_wait": 9.9, "blocked": 8.2}],
            [("blocked", 1, 2, 1.8, 18.2, BEHIND_0), ("waited", 1, 2, 1.9, 18.1, BEHIND_0)],
            id="is blocked for good",
        ),
        pytest.param(  # what it stood broken is none of it
            line(5),
            [[2], [0, 1, 2, 3]],
            {"policy": "open_loop", "broken": [(1, 5.0, 4.0)], "limit_s": 18.0},
            [{"at_goal": 18.0}, {"moving": 1.9, "dependency_wait": 9.9, "disturbed": 4.0, "blocked": 2.2}],
            [("waited", 1, 2, 1.9, 3.1, BEHIND_0), ("blocked", 1, 2, 5.8, 12.2, BEHIND_0), ("waited", 1, 2, 9.0, 9.0, BEHIND_0)],
            id="is blocked beside a breakdown",
        ),
        pytest.param(  # the first breaks down when it has driven 2.2 m of the lane; who stands at its goal may break down for nothing
            LONG,
            [[1, 2, 3], [0, 1, 2]],
            {"step_s": 45.0, "limit_s": 15.0, "broken": [(0, 10.0)]},
            [{"moving": 10.0, "disturbed": 5.0}, {"moving": 10.4, "dependency_wait": 4.6}],
            [("waited", 1, 1, 0.0, 1.5, BEHIND_0), ("waited", 1, 2, 11.9, 3.1, BEHIND_0)],
            id="stands behind another on its lane",
        ),
        pytest.param(
            line(4),
            [[0, 1, 2], [3]],
            {"broken": [(1, 0.5, 1.0)]},
            [{"moving": 3.7}, {"at_goal": 3.7}],
            [],
            id="breaks down at its goal",
        ),
        pytest.param(
            LONG,
            [[0, 1, 2, 3], [3, 2, 1, 0]],
            {"policy": "open_loop", "limit_s": 5.0},
            [{"moving": 5.0}, {"moving": 1.9, "dependency_wait": 3.1}],
            [("waited", 1, 1, 1.9, 3.1, "robot_0 comes towards it on the lane")],
            id="meets another on a long lane",
        ),
    ],
)
def test_every_second_is_booked_to_what_it_was_spent_on(graph, paths, how, booked, events):
    run = drive_in_the_plane(graph, paths, **how)
    spent = [{name: round(s, 6) for name, s in zip(BOOKINGS, row) if s > 0} for row in run.booked_s.tolist()]
    assert spent == booked
    waits = [(e.kind, e.robot, e.vertex, e.t_s, e.duration_s, e.text) for e in run.events if e.kind in ("waited", "blocked")]
    assert waits == events


def test_followers_on_a_lane_keep_their_gap_and_the_millimetre_in_which_they_stop():
    run = drive_in_the_plane(LONG, [[1, 2, 3], [0, 1, 2]], step_s=45.0, limit_s=20.0, broken=[(0, 10.0)])
    assert run.x_m[-1, 0] == pytest.approx(0.4 + 2.2)
    assert run.x_m[-1, 0] - run.x_m[-1, 1] == pytest.approx(np.hypot(0.138, 0.178) + 0.1 + 0.001)


@pytest.mark.parametrize(
    ("heading_rad", "goal_s"), [(np.nan, 3.6857), (0.0, 3.6857), (np.pi / 2, 3.7 + 0.6), (-np.pi / 2, 3.7 + 0.6), (np.pi, 3.7 + 1.2)]
)
def test_who_is_to_face_a_side_at_its_goal_is_there_when_it_does(heading_rad, goal_s):
    """Two lanes of 0.4 m, whose last 2 mm are not driven, and 2.84 rad/s: 6 steps of 0.1 s for a quarter, 12 for a half."""
    run = drive_in_the_plane(line(3), [[0, 1, 2]], goal_heading_rad=np.array([heading_rad]))
    assert run.goal_s[0] == pytest.approx(goal_s, abs=1e-3) and run.arrived_s[2] == pytest.approx(3.6857, abs=1e-3)
    assert run.arrived_s[1] == pytest.approx(0.398 / 0.22)
    assert np.cos(run.yaw_rad[-1, 0] - np.nan_to_num(heading_rad)) == pytest.approx(1.0)


@pytest.mark.parametrize(("from_north", "first"), [([5, 4, 0, 1, 2], 2), ([4, 0, 1, 2], 1)])
def test_without_an_order_who_has_asked_longest_goes_first_and_of_two_the_lower_number(from_north, first):
    """robot_0 is the first on the crossing. robot_2 asks for it at once, robot_1 when it has come near, or at once too."""
    run = drive_in_the_plane(cross(), [[1, 0, 10, 11, 12], from_north, [7, 0, 10]], "open_loop")
    begins = {event.robot: event.t_s for event in run.events if event.kind == "waited" and event.other == 0}
    assert begins[2] == 0.0 and (begins[1] == 0.0) == (first == 1)
    _, of_1, of_2 = np.split(run.arrived_s, [5, 5 + len(from_north)])
    assert (of_1[-3] < of_2[1]) == (first == 1)


def test_the_same_input_gives_the_same_bytes(tmp_path):
    paths = [[1, 0, 7], [4, 4, 0, 10]]
    one, two = (drive(tmp_path, cross(), paths) for _ in range(2))
    assert one.x_m.tobytes() == two.x_m.tobytes()
    assert one.arrived_s.tobytes() == two.arrived_s.tobytes()
    assert one.events == two.events


@pytest.mark.parametrize("robot", [BURGER, dataclasses.replace(BURGER, max_speed_mps=3.0)])
def test_what_no_robot_drives_on_changes_nothing_and_is_not_loaded(tmp_path, monkeypatch, robot):
    graph = square_grid(7)
    paths = [[0, 1, 2, 9], [9, 8, 7, 0], [16, 15, 14]]
    loaded = []
    monkeypatch.setattr(engine, "excerpt", lambda *params, **more: loaded.append(network.excerpt(*params, **more)) or loaded[-1])
    one = drive(tmp_path, graph, paths, robot=robot)
    monkeypatch.setattr(engine, "excerpt", lambda text, **_: text)
    two = drive(tmp_path, graph, paths, robot=robot)
    (text,) = loaded
    assert text.count("<edge") == 8 + 8 + 3  # what is driven on, leads to where robots stand at first, and on from where they end
    assert one.all_at_goal
    assert one.events == two.events
    for name in ("x_m", "y_m", "speed_mps", "arrived_s", "sumo_xy_m"):
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes()


@pytest.mark.parametrize("dt", [0.05, 0.2, 0.5, 1.0])
def test_step_lengths_change_the_outcome_little(tmp_path, dt):
    run = drive(tmp_path, cross(), [[3, 2, 1, 0, 7, 8], [12, 12, 11, 10, 0, 4]], step_length_s=dt, record_period_s=dt)
    assert run.all_at_goal
    assert least_distance_m(run) >= SEPARATION_M
    assert run.goal_s[0] == pytest.approx(2.0 / 0.22, abs=2 * dt + 0.2)


@pytest.mark.parametrize("engine", ["sumo", "kinematic"])
def test_a_robot_alone_drives_steps_shorter_than_two_robots_need(tmp_path, engine):
    run = drive(tmp_path, line(9, 0.1), [range(9)], engine=engine)
    assert run.outcome is Outcome.COMPLETED and run.x_m[-1, 0] == pytest.approx(0.8, abs=0.02)


def test_what_cannot_be_driven_is_refused_in_one_line(tmp_path):
    def refused(message, graph, paths, **settings):
        with pytest.raises(MrpSumoError, match=message) as caught:
            drive(tmp_path, graph, paths, **settings)
        assert "\n" not in str(caught.value)

    refused(r"do not fit: with their gap they need 0\.325 m", line(3, 0.3), [[0, 1], [2]])
    refused("where there is no lane", line(4), [[0, 2]])
    refused("'v2', which has no lane", graph_of([(0, 0), (1, 0), (2, 0)], [(0, 1)]), [[2]])
    refused("start 0.300 m apart", graph_of([(0, 0), (1, 0), (0.3, 0), (0.3, 1)], [(0, 1), (2, 3)]), [[0, 1], [2, 3]])
    refused(r"unknown execution policy 'agd' \(did you mean 'adg'\?\)", line(3), [[0, 1]], policy="agd")
    refused("a sample every 0.25 s, expected a whole number of steps", line(3), [[0, 1]], record_period_s=0.25)
    refused("time_limit_s is 0.0", line(3), [[0, 1]], time_limit_s=0.0)


def test_a_network_of_another_graph_is_refused(tmp_path):
    problem, plan = problem_of(line(4), [[0, 1, 2, 3]])
    settings = ExecutionSettings()
    with pytest.raises(ExecutionError, match="no such network"):
        simulate(problem, plan, settings, tmp_path / "missing.net.xml")
    with pytest.raises(ExecutionError, match="no edge 'e2_3'"):
        simulate(problem, plan, settings, build_network(line(3), tmp_path / "short.net.xml"))
    with pytest.raises(ExecutionError, match=r"0\.5 m long, expected 0\.4 m"):
        simulate(problem, plan, settings, build_network(line(4, 0.5), tmp_path / "other.net.xml"))
    (tmp_path / "bad.net.xml").write_text("<net>")
    with pytest.raises(ExecutionError, match="not a whole SUMO network"):
        simulate(problem, plan, settings, tmp_path / "bad.net.xml")
    good = simulate(problem, plan, settings, build_network(line(4), tmp_path / "good.net.xml"))  # SUMO starts again after all that
    assert good.all_at_goal


@pytest.mark.parametrize(
    ("others", "seconds"), [([Listener()], [1.0, 2.0, 3.0]), ([], [])], ids=("every moment is heard", "nothing happens")
)
def test_progress_is_told_once_a_second_while_something_happens(tmp_path, others, seconds):
    output = []
    problem, plan = problem_of(line(3), [[0, 1, 2]], BURGER)
    network = build_network(line(3), tmp_path / "world.net.xml")
    progress = ProgressReport(lambda t_s, at_goal: output.append((t_s, at_goal)))
    simulate(problem, plan, ExecutionSettings(), network, listeners=[*others, progress])
    assert output == [(second, 0) for second in seconds]
