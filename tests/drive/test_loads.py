"""Robots that are others with a load: slower, larger, heavier between the first stop of an order and the last, in plans and driven."""

import json
from dataclasses import replace

import numpy as np
import pytest
from floors import BATTERY, SMALL, driven, lanes, ring, scenario
from lif_worlds import edge, lif, node

from mrp_sumo.core.execution import Execution, Outcome
from mrp_sumo.core.fleet import fleet_of, with_loads
from mrp_sumo.core.robot_type import Loaded, RobotType
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.audit_work import logs_of
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.io.run_reader import load_run
from mrp_sumo.io.scenario.read import scenario_of
from mrp_sumo.metrics.audit import audit
from mrp_sumo.metrics.operations.audit import operations_audit

SLOW = {"speed_mps": 0.5, "accel_mps2": 0.25, "decel_mps2": 0.5}
CART = RobotType("cart", 0.4, 0.4, max_speed_mps=1.0, accel_mps2=1.0, decel_mps2=1.0, turn_rate_rad_s=3.0, loaded=Loaded(speed_mps=0.5))
TWO_ORDERS = [{"stops": ["A", "B"], "service_s": [5, 0]}, {"stops": ["B", "A"], "service_s": [0, 3]}]


def run_of(tmp_path, tasks=TWO_ORDERS, shape=None, **other):
    """One robot on the ring that brings one order from A to B and another back."""
    planning = {"planning": {"budget_s": 0.0}, **other.pop("execution", {})}
    file = scenario(
        ring(tmp_path), tasks, starts=["c1"], shape={"loaded": SLOW, **(shape or {})}, execution=planning, planner="continuous", **other
    )
    result = driven(file)
    assert result.status == "completed" and result.audit["passed"] and result.operations_audit["passed"], result.note
    return result


def rectangle(folder, only, between=("A", "B")):
    """A in the lower left corner of 10 x 8 m, B in the lower right one; lanes between two corners are for robots in one state of load."""
    corners = {"A": (0.0, 0.0), "B": (10.0, 0.0), "C": (10.0, 8.0), "D": (0.0, 8.0)}
    document = lif()
    layout, rule = document["layouts"][0], {"loadRestriction": {"loaded": only == "loaded", "unloaded": only == "unloaded"}}
    layout["nodes"] = [node(name, *xy) for name, xy in corners.items()]
    pairs = [*zip("ABCD", "BCDA"), *zip("BCDA", "ABCD")]
    layout["edges"] = [edge(a, b, **(rule if {a, b} == set(between) else {})) for a, b in pairs]
    layout["stations"] = []
    path = folder / "rectangle.lif.json"
    path.write_text(json.dumps(document))
    return path


def standing(apart_m, loads):
    """Two robots that stand so far apart, along which they face, the first with so many loads."""
    still = np.zeros((3, 2))
    x_m, on_board = np.array([[0.0, apart_m]] * 3), np.array([[loads, 0]] * 3)
    return Execution(
        np.arange(3.0), x_m, still, still, still, np.zeros(0), np.zeros(2), Outcome.COMPLETED, "adg", 1.0, 1.0, 1.0, loads=on_board
    )


def top_mps(run, loads):
    """The highest speed with so many loads on board."""
    return float(run.speed_mps[run.loads == loads].max())


@pytest.mark.parametrize("engine", ["kinematic", "sumo"])
def test_a_robot_is_slower_from_the_first_stop_of_an_order_to_its_last(tmp_path, engine):
    run = run_of(tmp_path, execution={"engine": engine}).execution
    assert top_mps(run, 0) == pytest.approx(1.0) and top_mps(run, 1) == pytest.approx(0.5)
    (begin, back), (end, home) = (np.flatnonzero(np.diff(run.loads[:, 0]) == by) + 1 for by in (1, -1))
    first, second, third, last = run.stops.end_s.tolist()
    assert run.t_s[[begin, end, back, home]] == pytest.approx([first, second, third, last], abs=0.5)
    assert run.stops.end_s[1] - run.stops.begin_s[1] == 1.0  # though no service was asked for: it stands there


def test_both_engines_drive_it_alike(tmp_path):
    one, other = (run_of(tmp_path, execution={"engine": engine}).execution for engine in ("kinematic", "sumo"))
    assert np.array_equal(one.loads, other.loads) and np.abs(one.x_m - other.x_m).max() < 1e-9


def test_a_loaded_way_is_driven_as_planned(tmp_path):
    """From one stop to the next the robot keeps the plan's times to a step, but for the turn before it sets out."""
    run = run_of(tmp_path, [{"stops": ["A", "B"], "service_s": 5}]).execution
    loaded = next(reply for reply in run.replies if reply.t_s > run.stops.end_s[0] - 0.2)
    late_s = (loaded.arrived_s - loaded.arrive_s)[np.isfinite(loaded.arrived_s)]
    assert len(late_s) == 20 and np.abs(late_s).max() <= 0.1  # 20 m in steps of 1 m


def test_an_order_of_one_stop_is_no_load(tmp_path):
    run = run_of(tmp_path, [{"stops": ["B"], "service_s": 2}]).execution
    assert not run.loads.any() and top_mps(run, 0) == pytest.approx(1.0)


def test_without_loaded_there_is_no_column(tmp_path):
    file = scenario(ring(tmp_path), TWO_ORDERS, starts=["c1"])
    assert driven(file).execution.loads is None


def test_a_load_costs_energy_by_its_mass(tmp_path):
    """Friction and acceleration cost twice as much with twice the mass; 20 m of each way are driven with a load, 10 m of three without."""
    heavy, light = (
        run_of(tmp_path, [{"stops": ["A", "B"], "service_s": 5}], {"loaded": {"mass_kg": mass}, "battery": {**BATTERY, "device_w": 0.0}})
        for mass in (40.0, 20.0)
    )
    begin = float(light.execution.stops.end_s[0])
    assert heavy.execution.stops.end_s[0] == begin
    used = [float(run.execution.batteries.used_j[0]) for run in (heavy, light)]
    friction_j = 20.0 * 9.81 * 0.2 * 20.0  # of 20 kg over the 20 m from A to B
    assert used[0] - used[1] == pytest.approx(friction_j, rel=0.15)


def test_lifting_a_load_takes_energy_once_an_order(tmp_path):
    one_stop = [{"stops": ["c2"], "service_s": 2}]
    plain, lifting = (run_of(tmp_path, TWO_ORDERS + one_stop, {"battery": {**BATTERY, "lift_j": lift_j}}) for lift_j in (0.0, 1500.0))
    assert lifting.execution.batteries.used_j[0] - plain.execution.batteries.used_j[0] == pytest.approx(2 * 1500.0)


def test_lift_that_no_battery_has_drawn_is_found(tmp_path):
    result = run_of(tmp_path, shape={"battery": {**BATTERY, "lift_j": 1500.0}})
    logs = logs_of(result)
    assert operations_audit(logs)["passed"]
    types = tuple(replace(each, battery=replace(each.battery, lift_j=0.0)) for each in logs.terms.fleet.types)
    free = replace(logs.terms, fleet=replace(logs.terms.fleet, types=types))
    again = operations_audit(replace(logs, terms=free))
    assert not again["passed"] and "batteries" in str(again)


def test_the_folder_of_a_run_is_judged_as_the_run(tmp_path):
    result = run_of(tmp_path)
    with MapCache() as maps:
        result.write(tmp_path / "out", maps)
    folder = load_run(tmp_path / "out")
    assert np.array_equal(folder.execution.loads, result.execution.loads)
    assert folder.fleet.loaded.max_speed_mps.tolist() == [0.5] and audit(folder.execution, folder.fleet)["passed"]


def test_the_audit_holds_a_loaded_robot_to_its_limits(tmp_path):
    result = run_of(tmp_path)
    run, loaded = result.execution, np.flatnonzero(result.execution.loads[:, 0])
    speed = run.speed_mps.copy()
    fast = loaded[len(loaded) // 4]
    speed[fast, 0] = 0.9  # which it may drive without a load
    outcome = audit(replace(run, speed_mps=speed), result.fleet)
    assert outcome["num_speed_violations"] == 1 and outcome["violations"][0]["limit"] == 0.5
    assert audit(replace(run, speed_mps=speed, loads=run.loads * 0), result.fleet)["num_speed_violations"] == 0


def test_the_audit_sees_the_body_with_its_load():
    """Two robots 0.5 m apart, 0.4 m long: 0.1 m of air, but none with a load of 0.8 m on one."""
    fleet = fleet_of(replace(CART, loaded=Loaded(length_m=0.8)), 2)
    assert audit(standing(0.5, loads=0), fleet)["min_clearance_m"] == pytest.approx(0.1)
    assert audit(standing(0.61, loads=1), fleet)["passed"] and audit(standing(0.59, loads=1), fleet)["num_overlaps"] == 1


def test_the_operations_audit_compares_the_loads_with_the_stops(tmp_path):
    result = run_of(tmp_path)
    logs = logs_of(result)
    begin = int(np.flatnonzero(result.execution.loads[:, 0])[0])
    for by_s, passed in ((1.0, True), (4.0, False)):
        loads = result.execution.loads.copy()
        loads[begin : begin + int(by_s / 0.1), 0] = 0
        assert operations_audit(replace(logs, execution=replace(result.execution, loads=loads)))["passed"] is passed


@pytest.mark.parametrize(("only", "detours"), [("unloaded", 1), ("loaded", 0)])
def test_lanes_for_one_state_of_load_are_kept(tmp_path, only, detours):
    """From A to B with a load and back without: over the direct lanes in the state that they are for, round the others in the other."""
    tasks = [{"stops": ["A", "B"], "service_s": 5}, {"stops": ["A", "D"], "service_s": 2}]
    file = scenario(rectangle(tmp_path, only), tasks, starts=["A"], execution={"time_limit_s": 400.0})
    run = driven(file)
    assert run.status == "completed" and run.operations_audit["passed"], run.note
    on_direct = (np.abs(run.execution.y_m) < 0.01) & (run.execution.x_m > 2) & (run.execution.x_m < 8)
    assert on_direct.any() and set(run.execution.loads[on_direct].tolist()) == {1 - detours}
    assert (run.execution.loads[run.execution.y_m > 7.9] == detours).any()


def test_orders_that_no_state_of_load_can_bring_are_refused(tmp_path):
    path = rectangle(tmp_path, "loaded")
    document = json.loads(path.read_text())
    edges = document["layouts"][0]["edges"]
    document["layouts"][0]["edges"] = [each for each in edges if each["edgeId"] in ("A-B", "B-A")]
    path.write_text(json.dumps(document))
    with pytest.raises(MrpSumoError, match="no robot can reach 'B', a stop of 'task_0'"):
        driven(scenario(path, [{"stops": ["B", "A"]}], starts=["A"]))


def test_actions_take_a_type_longer(tmp_path):
    actions = {"pick": {"constant_s": 20.0}, "drop": {"triangular_s": [5.0, 6.0, 8.0]}, "dock": {"lognormal": [10.0, 0.5]}}
    tasks = {"list": TWO_ORDERS, "stations": {"A": {"places": ["A"], "actions": ["dock"]}}}
    run = run_of(tmp_path, tasks, {"actions": actions}).execution
    at_a, at_b, again_b, again_a = (run.stops.end_s - run.stops.begin_s).tolist()
    assert at_a > 5 + 20 and 5 <= at_b <= 8 and again_b == 20.0 and again_a > 3 + 5
    slower = run_of(tmp_path, tasks, {"actions": actions, "max_speed_mps": 0.6}).execution
    assert (slower.stops.end_s - slower.stops.begin_s).tolist() == pytest.approx([at_a, at_b, again_b, again_a])


def test_fleets_of_loaded_robots_are_those_of_the_types():
    both = fleet_of(replace(CART, loaded=Loaded(speed_mps=0.5, length_m=0.8)), 2)
    now = with_loads(both, np.array([False, True]))
    assert now.max_speed_mps.tolist() == [1.0, 0.5] and now.length_m.tolist() == [0.4, 0.8]
    assert now.radius_m.tolist() == both.radius_m.tolist() == [np.hypot(0.8, 0.4) / 2] * 2  # kept free at all times
    assert fleet_of(replace(CART, loaded=None), 2).loaded is None


@pytest.mark.parametrize(
    ("shape", "says"),
    [
        ({"loaded": {"speed_mps": 1.5}}, "loaded.speed_mps is 1.5, expected at most max_speed_mps, 1"),
        ({"loaded": {"length_m": 0.2}}, "loaded.length_m is 0.2, expected at least length_m, 0.4"),
        ({"loaded": {"mass_kg": 30.0}}, "loaded.mass_kg has no effect without a battery"),
        ({"loaded": {"speed": 0.5}}, "speed"),
        ({"loaded": {"decel_mps2": 0.0}}, "decel_mps2"),
        ({"capacity": 0}, "capacity"),
        ({"actions": {"pick": {}}}, "give one of constant_s, triangular_s, lognormal"),
        ({"actions": {"grab": {"constant_s": 1}}}, "grab"),
        ({"loaded": {"decel_mps2": 0.01}}, "with a load cannot stop"),
    ],
)
def test_bad_shapes_are_refused_in_one_line(tmp_path, shape, says):
    with pytest.raises(MrpSumoError) as refused:
        driven(scenario(ring(tmp_path), TWO_ORDERS, starts=["c1"], shape=shape))
    assert says in str(refused.value) and "\n" not in str(refused.value)


def two_types(tmp_path, tasks):
    """A robot that carries 50 kg right before A, and one that carries 60 kg on the other side of the ring."""
    shapes = [{**SMALL, "max_load_kg": kg} for kg in (50, 60)]
    values = {
        "map": str(ring(tmp_path)),
        "discretisation": {"kind": "roadmap", "cell_m": 1.0},
        "robots": [{"type": shape, "starts": [at]} for shape, at in zip(shapes, ("c1", "c3"))],
        "planner": "lacam",
        "tasks": tasks,
        "execution": {"engine": "kinematic", "dispatcher": "nearest"},
    }
    return scenario_of(values, tmp_path, "two")


@pytest.mark.parametrize(
    ("order", "says"),
    [
        ({"load_kg": 60.5}, r"load_kg: found 60.5, but the robots that the order is for carry 60 kg at most"),
        ({"load_kg": 60, "robot_type": "custom_0"}, r"load_kg: found 60, but the robots that the order is for carry 50 kg at most"),
        ({"load_kg": 60, "robot": "robot_0"}, r"load_kg: found 60, but the robots that the order is for carry 50 kg at most"),
        ({"load_kg": -1}, r"load_kg: found -1, expected 0 or more"),
    ],
)
def test_loads_that_are_too_heavy_are_refused(tmp_path, order, says):
    with pytest.raises(MrpSumoError, match=says):
        driven(two_types(tmp_path, [{"stops": ["A", "B"], **order}]))


@pytest.mark.parametrize(("load_kg", "robot"), [(50.0, 0), (50.5, 1)])
def test_a_heavy_load_goes_to_who_can_carry_it(tmp_path, load_kg, robot):
    result = driven(two_types(tmp_path, [{"stops": ["A", "B"], "load_kg": load_kg, "service_s": 2}]))
    assert result.execution.tasks.robot.tolist() == [robot] and result.operations_audit["passed"], result.note
    logs = logs_of(result)
    weak = replace(logs.terms.fleet, types=tuple(replace(each, max_load_kg=49.0) for each in logs.terms.fleet.types))
    weaker = operations_audit(replace(logs, terms=replace(logs.terms, fleet=weak)))
    assert f"the order is for robots that carry {load_kg:g} kg" in weaker["findings"][0]["text"]


def buffered(tmp_path, places, picks, *, queue=("c2",), loads=3, **other):
    """Loads to a buffer off the ring with so many places, and as many away from there from a time on."""
    xy = {"c1": (0.0, 0.0), "A": (5.0, 0.0), "c2": (10.0, 0.0), "B": (10.0, 10.0), "c4": (0.0, 10.0), "p1": (10.0, 4.0), "p2": (10.0, 7.0)}
    names = ["c1", "A", "c2", "p1", "p2", "B", "c4"]
    path = lanes(tmp_path / "buffer.csv", xy, zip(names, names[1:] + names[:1]), False)
    tasks = {
        "stations": {"buffer": {"places": places, "queue": list(queue), "holds": 1}},
        "list": [{"stops": ["A", "buffer"], "service_s": 3, "release_s": 1.0 * k} for k in range(loads)]
        + [{"stops": ["buffer", "c4"], "service_s": 3, "release_s": 200.0 + k} for k in range(picks)],
    }
    return driven(scenario(path, tasks, starts=["c1", "c4"], execution={"time_limit_s": 600.0}, **other))


def test_a_load_that_is_set_down_takes_its_place_until_it_is_picked_up(tmp_path):
    result = buffered(tmp_path, ["p1", "p2"], 3)
    tasks = result.execution.tasks
    assert result.status == "completed" and result.operations_audit["passed"] and set(tasks.status) == {"done"}, result.note
    assert np.sort(tasks.done_s[:3])[1] < 200.0 < tasks.done_s[:3].max()  # the third waits for a place
    logs, vertex = logs_of(result), result.execution.stops.vertex.copy()
    last_of = {task: row for row, task in enumerate(logs.stops.task.tolist())}  # where two loads were set down
    one, other = np.argsort(tasks.done_s[:3])[:2].tolist()
    vertex[last_of[other]] = vertex[last_of[one]]
    changed = replace(logs, execution=replace(logs.execution, stops=replace(logs.stops, vertex=vertex)))
    assert "one load a place" in {finding["rule"] for finding in operations_audit(changed)["findings"]}


def test_who_waits_to_set_down_lets_by_who_is_to_pick_up(tmp_path):
    """One robot has set down its load in the only place, the other waits on the one-way ring that leads there."""
    result = buffered(tmp_path, ["p1"], 2, queue=(), loads=2)
    assert result.status == "completed" and set(result.execution.tasks.status) == {"done"}, result.note
    assert result.operations_audit["passed"], result.operations_audit["findings"]


def test_with_nobody_to_pick_up_the_last_load_stays_on_its_robot(tmp_path):
    result = buffered(tmp_path, ["p1", "p2"], 0)
    assert result.execution.tasks.status.count("done") == 2 and result.execution.loads is None
