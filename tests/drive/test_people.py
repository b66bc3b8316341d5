"""Robots among people: they stop at the distance of their fields, go on two seconds after these are free, and turn only where nobody is."""

from itertools import pairwise

import numpy as np
import pytest
from floors import driven, lanes, scenario
from worlds import CART, drive, graph_of, line, problem_of

from mrp_sumo.core.bodies import bodies_of
from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.plan import plan_of_paths
from mrp_sumo.crowd import _walk
from mrp_sumo.crowd.floor import floor_of
from mrp_sumo.crowd.model import People
from mrp_sumo.drive import people as drive_people
from mrp_sumo.drive.listeners import Listener
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.engines.sumo import session
from mrp_sumo.engines.sumo.network import build_network
from mrp_sumo.maps.map import Map
from mrp_sumo.metrics.audit import audit
from tests.vehicles import CAR, TRICYCLE, TUGGER, corner, roads, vehicles_on

BOTH = pytest.mark.parametrize("engine", ["sumo", "kinematic"])


def corridor_of(graph, **more):
    """People on the corridors of a graph, between its first and last vertices."""
    floor = floor_of(Map(name="world", path=None, nav=graph), graph, 3.0)
    places = [floor.place_at(graph.xy[v]) for v in (0, -1)]
    return People(floor, np.array(places), **{"count": 1, **more})


@pytest.fixture
def script(monkeypatch):
    """Have one person be where a function of time says, nowhere where it says None."""

    def be(where):
        def place(crowd, now_s):
            xy = where(now_s)
            crowd.count = 0 if xy is None else 1
            if xy is not None:
                crowd.walkers.x_m[0], crowd.walkers.y_m[0] = xy
            crowd.waited_s = [0.0]
            _walk.put_in_bins(crowd.walkers.x_m, crowd.walkers.y_m, crowd.count, crowd.ground, crowd.walkers.first, crowd.walkers.member)

        monkeypatch.setattr(drive_people.Crowd, "begin", lambda crowd: place(crowd, 0.0))
        monkeypatch.setattr(drive_people.Crowd, "step", lambda crowd, now_s, dt: place(crowd, now_s + dt))

    return be


@BOTH
def test_person_in_the_aisle_stops_the_robot_at_the_distance_of_its_field_until_two_seconds_after_it_has_gone(tmp_path, script, engine):
    script(lambda now_s: (6.5, 0.0) if now_s < 30.0 - 1e-9 else None)
    graph = line(12, 1.0)
    run = drive(tmp_path, graph, [range(12)], robot=CART, engine=engine, people=corridor_of(graph))
    x, speed = run.x_m[:, 0], run.speed_mps[:, 0]
    ahead = 6.5 - 0.25 - 0.3 - x  # of the front, to the body
    stands = ahead[290]
    reach = 0.1**2 / 2 + 0.1 * 0.2 + 0.45
    assert reach == pytest.approx(0.475)
    assert reach - 0.1 * 0.1 - 1e-6 <= stands <= reach  # it drove the last step at 0.1 m/s
    moves = (speed > 1e-9) & (run.t_s < 30.0)
    assert (speed[moves] ** 2 / 2 + 0.2 * speed[moves] + 0.45 <= ahead[moves] + 0.01 + 1e-6).all()
    again = run.t_s[(run.t_s > 30.0) & (speed > 1e-9)][0]
    assert again == pytest.approx(32.1)  # the field is free at 30.0 s, it may go on at 32.0 s, and has moved a step later
    (stop,) = [event for event in run.events if event.kind == "person"]
    assert stop.t_s + stop.duration_s == pytest.approx(32.0)
    outcome = audit(run, fleet_of(CART, 1))
    assert outcome["passed"] and outcome["min_person_distance_m"] == pytest.approx(stands, abs=1e-4)
    assert run.people.lost_s[0] > 24.0


@BOTH
def test_person_who_crosses_makes_the_robot_brake_from_the_step_in_which_it_comes_into_the_field(tmp_path, script, engine):
    script(lambda now_s: (5.0, -3.65 + 0.7 * now_s))
    graph = line(12, 1.0)
    run = drive(tmp_path, graph, [range(12)], robot=CART, engine=engine, people=corridor_of(graph))
    x, speed = run.x_m[:, 0], run.speed_mps[:, 0]
    aside = np.abs(-3.65 + 0.7 * run.t_s)
    over = np.maximum(aside - 0.2 - 0.1, 0.0)
    ahead = 5.0 - 0.3 - x - np.sqrt(np.maximum(0.25**2 - over**2, 0.0))
    inside = (over < 0.25) & (x + 0.3 < 5.0)
    k = int(np.flatnonzero(inside & (ahead + 1e-9 < speed**2 / 2 + 0.2 * speed + 0.45))[0])
    assert speed[k] == pytest.approx(1.0)
    braked = speed[k] - 0.1 * np.arange(1, 10)
    assert speed[k + 1 : k + 10] == pytest.approx(np.maximum(braked, 0.0), abs=1e-6)
    free = int(np.flatnonzero(~(inside & (ahead < 0.475)) & (np.arange(len(x)) > k))[0])
    stood = int(np.flatnonzero(speed[k:] < 1e-9)[0]) + k
    again = int(np.flatnonzero(speed[stood:] > 1e-9)[0]) + stood
    assert again == free + 21  # two seconds, and the step in which it moves
    assert audit(run, fleet_of(CART, 1))["passed"]


@BOTH
def test_robot_does_not_turn_where_somebody_stands_beside_it(tmp_path, script, engine):
    script(lambda now_s: (2.0, -0.65) if now_s < 20.0 - 1e-9 else None)
    graph = graph_of([(0, 0), (1, 0), (2, 0), (2, 1), (2, 2)], [(0, 1), (1, 2), (2, 3), (3, 4)], 1.0)
    run = drive(tmp_path, graph, [[0, 1, 2, 3, 4]], robot=CART, engine=engine, people=corridor_of(graph))
    at_corner = (np.abs(run.x_m[:, 0] - 2.0) < 0.01) & (run.t_s < 22.0) & (run.t_s > 5.0)
    assert at_corner.sum() > 100
    assert np.abs(run.yaw_rad[at_corner, 0]).max() == 0.0
    assert run.goal_s[0] > 22.0


@pytest.mark.parametrize("vehicle", [CAR, TRICYCLE], ids=lambda each: each.name)
@pytest.mark.parametrize("where", [(4.0, 1.6), (4.6, 0.9), (3.4, 1.2), (5.0, 0.4)], ids=str)
def test_vehicle_on_an_arc_keeps_to_the_field_ahead_of_its_body(tmp_path, script, vehicle, where):
    script(lambda now_s: where if now_s < 20.0 - 1e-9 else None)
    graph = corner()
    people = corridor_of(graph)
    problem = vehicles_on(graph, [0], [2], vehicle)
    settings = ExecutionSettings(engine="kinematic", people=people, time_limit_s=60.0)
    run = simulate(problem, plan_of_paths([[0, 1, 2]], problem.step_s), settings, tmp_path)
    outcome = audit(run, problem.fleet)
    assert outcome["num_field_violations"] == 0 and outcome["num_person_contacts"] == 0
    assert run.goal_s[0] > 0


def test_people_see_trailers_where_they_are(tmp_path, script, monkeypatch):
    """On the way round a corner, as the samples of the run have them."""
    seen = {}

    def step(crowd, now_s, dt):
        seen[round(now_s + dt, 6)] = np.stack([crowd.robots.x_m, crowd.robots.y_m, crowd.robots.yaw_rad])

    script(lambda now_s: None)
    monkeypatch.setattr(drive_people.Crowd, "step", step)
    graph = roads([(-4.0, 0.0), (0.0, 0.0), (4.0, 0.0), (8.0, 0.0), (8.0, 4.0), (8.0, 8.0)], one_way=[(k, k + 1) for k in range(5)])
    problem = vehicles_on(graph, [1], [5], TUGGER)
    settings = ExecutionSettings(engine="kinematic", people=corridor_of(graph), time_limit_s=60.0)
    run = simulate(problem, plan_of_paths([[1, 2, 3, 4, 5]], problem.step_s), settings, tmp_path)
    bodies = bodies_of(run, problem.fleet)
    compared = [(k, seen[t]) for k, t in enumerate(np.round(run.t_s, 6).tolist()) if t in seen]
    assert len(compared) > 100 and bodies.x_m.shape[1] == 3
    for k, (x, y, yaw) in compared:
        assert np.hypot(x - bodies.x_m[k], y - bodies.y_m[k]).max() < 0.01
        assert np.abs(yaw - bodies.yaw_rad[k]).max() < 0.02


def test_people_walk_past_a_train_and_not_through_its_trailers(tmp_path):
    graph = roads([(4.0 * k, 0.0) for k in range(8)], one_way=[(k, k + 1) for k in range(7)])
    problem = vehicles_on(graph, [1], [7], TUGGER)
    settings = ExecutionSettings(engine="kinematic", people=corridor_of(graph, count=6, seed=3), time_limit_s=100.0)
    run = simulate(problem, plan_of_paths([range(1, 8)], problem.step_s), settings, tmp_path)
    outcome = audit(run, problem.fleet)
    assert len(run.people.person) > 1000 and outcome["num_person_touches"] == 0


def test_robots_behind_wait_and_the_rest_of_the_fleet_triggers_no_field(tmp_path, script):
    script(lambda now_s: (6.5, 0.0) if now_s < 20.0 - 1e-9 else None)
    graph = line(12, 1.0)
    run = drive(tmp_path, graph, [range(2, 12), range(10)], robot=CART, engine="kinematic", people=corridor_of(graph))
    assert {event.robot for event in run.events if event.kind == "person"} == {0}
    assert np.isfinite(run.goal_s).all() and (run.x_m[:, 0] - run.x_m[:, 1]).min() >= 1.0 - 1e-2


@BOTH
def test_same_seed_same_people_and_same_robots(tmp_path, engine):
    graph = line(12, 1.0)
    people = corridor_of(graph, count=6, seed=3)
    one, other = (drive(tmp_path, graph, [range(12)], robot=CART, engine=engine, people=people, time_limit_s=40.0) for _ in range(2))
    assert len(one.people.person) > 1000
    for name in ("x_m", "y_m", "person"):
        assert np.array_equal(getattr(one.people, name), getattr(other.people, name))
    assert np.array_equal(one.x_m, other.x_m)
    assert audit(one, fleet_of(CART, 1))["passed"]


@BOTH
def test_speeds_drawn_for_lanes_are_kept_and_the_same_with_both_engines(tmp_path, engine):
    graph = line(12, 1.0)
    run = drive(tmp_path, graph, [range(12)], robot=CART, engine=engine, lane_speeds_mps=(0.274, 0.508, 0.63))
    speed = run.speed_mps[:, 0]
    assert speed.max() <= 0.63 + 1e-9 and run.people is None
    draws = np.random.default_rng([0, 56, 0])
    drawn = [draws.triangular(0.274, 0.508, 0.63) for _ in range(11)]
    assert {round(v, 6) for v in drawn[1:-1]} <= {round(v, 6) for v in speed.tolist()}


def test_people_are_discs_in_the_gui_that_come_and_go(tmp_path, script, monkeypatch):
    script(lambda now_s: (6.5, 1.0) if 1.0 <= now_s < 3.0 - 1e-9 else None)
    monkeypatch.setattr(session, "_api", lambda gui, outcome=session._api: outcome(False))  # everything but the window
    monkeypatch.setattr(session, "VIEW", ())
    graph, seen = line(12, 1.0), {}
    problem, plan = problem_of(graph, [range(12)], CART)

    class Look(Listener):
        def hear(self, time_s):
            api = time_s.bodies._sumo._api
            seen[round(time_s.now_s, 1)] = [api.polygon.getShape(name) for name in api.polygon.getIDList() if name.startswith("person")]

    settings = ExecutionSettings(people=corridor_of(graph), time_limit_s=4.0)
    simulate(problem, plan, settings, build_network(graph, tmp_path / "world.net.xml"), gui=True, listeners=[Look()])
    assert not seen[0.9] and not seen[3.5]
    (disc,) = seen[2.0]
    assert np.mean(disc[:12], axis=0) == pytest.approx((6.5, 1.0), abs=1e-2)
    assert np.ptp(np.array(disc)[:, 0]) == pytest.approx(0.5, abs=1e-2)


def test_people_walk_alike_among_robots_of_either_engine(tmp_path):
    """What engines round would show within seconds: who walks among others sees everything again in their steps."""
    graph = line(12, 1.0)
    people = corridor_of(graph, count=6, seed=3)
    one, other = (drive(tmp_path, graph, [range(12)], robot=CART, engine=name, people=people, time_limit_s=40.0) for name in BOTH.args[1])
    assert len(one.people.person) > 1000
    assert np.array_equal(one.people.x_m, other.people.x_m) and np.array_equal(one.people.y_m, other.people.y_m)


@pytest.mark.parametrize("seed", [0, 1])
def test_six_people_in_a_corridor_of_two_metres_let_a_robot_pass(tmp_path, seed):
    """There is room for a robot of 0.4 m, its field and a person beside it: who meets it steps aside instead of going back before it."""
    xy = {f"p{k}": (5.0 * k, 0.0) for k in range(5)}
    street = lanes(tmp_path / "street.csv", xy, pairwise(xy), True)
    to_and_fro = {"streams": [{"name": "o", "stops": ["p0", "p4"], "service": [5.0], "arrivals": {"open": 2}}]}
    result = driven(scenario(street, to_and_fro, starts=["p0"], seed=seed, people={"count": 6, "corridor_m": 2.0}))
    assert result.audit["passed"] and result.execution.people.lost_s[0] < 150.0  # of 300; 275 where people go back
    assert np.isfinite(result.execution.tasks.done_s).sum() >= 3
