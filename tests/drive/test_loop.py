"""Small worlds driven in SUMO whose outcome is known by hand."""

import dataclasses

import numpy as np
import pytest
from worlds import BURGER, cross, drive, graph_of, kinds, least_distance_m, line, problem_of, square_grid

from mrp_sumo.core.disturbances import Breakdown, Disturbances
from mrp_sumo.core.execution import Outcome
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

    def hear(self, moment):
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
    monkeypatch.setattr(engine, "excerpt", lambda *given, **more: loaded.append(network.excerpt(*given, **more)) or loaded[-1])
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
    told = []
    problem, plan = problem_of(line(3), [[0, 1, 2]], BURGER)
    network = build_network(line(3), tmp_path / "world.net.xml")
    progress = ProgressReport(lambda t_s, at_goal: told.append((t_s, at_goal)))
    simulate(problem, plan, ExecutionSettings(), network, listeners=[*others, progress])
    assert told == [(second, 0) for second in seconds]
