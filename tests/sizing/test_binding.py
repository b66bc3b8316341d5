"""What binds, on floors that are made to be bound by one thing, driven; and beside each the same floor without that."""

import json
from itertools import pairwise

import numpy as np
import pytest

from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import carry_out
from mrp_sumo.io.scenario.read import scenario_of
from mrp_sumo.sizing.observe import observation
from mrp_sumo.sizing.points import Point, record_of
from mrp_sumo.sizing.reasons import reasons

pytestmark = pytest.mark.slow

CART = {"length_m": 0.4, "width_m": 0.4, "max_speed_mps": 1.0, "accel_mps2": 1.0, "decel_mps2": 1.0, "turn_rate_rad_s": 1.5, "gap_m": 0.1}
BATTERY = {
    "voltage_v": 10.0,
    "capacity_ah": 0.1,
    "charging_a": 1.0,
    "mass_kg": 10.0,
    "inertia_kgm2": 0.5,
    "friction": 0.05,
    "device_w": 10.0,
}
HORIZON_S = 1200.0
# one way round, 40 m, with spurs to charge at
RING = "A c1 w c2 B c3 c4 A"
AT = {
    "A": (5, 0),
    "c1": (10, 0),
    "c2": (10, 10),
    "B": (5, 10),
    "c3": (0, 10),
    "c4": (0, 0),
    "p1": (13, 0),
    "p2": (13, 10),
    "p3": (-3, 10),
    "P": (10, 24),
    "q": (0, 24),
    "w": (10, 8),
}


def lanes(*ways, at=AT, both=False):
    """A table of lanes along ways, each the names of vertices."""
    rows = ["from,to,from_x_m,from_y_m,to_x_m,to_y_m,both_ways,speed_mps"]
    for route in ways:
        for a, b in pairwise(route.split()):
            rows.append(f"{a},{b},{at[a][0]},{at[a][1]},{at[b][0]},{at[b][1]},{'yes' if both else 'no'},")
    return "\n".join(rows) + "\n"


WITH_SPURS = lanes(RING) + "".join(lanes(route, both=True).split("\n", 1)[1] for route in ("c1 p1", "c2 p2", "c3 p3"))


def bound(folder, text, robots, tasks, **options):
    """What binds robots that drive there."""
    result = driven(folder, text, robots, tasks, **options)
    record = {"status": result.result["status"], "success": True, "reason": "", "metrics": result.result["metrics"]}
    return reasons(Point(robots, HORIZON_S, (record_of({**record, "observed": observation(result)}),)))


def driven(folder, text, robots, tasks, *, robot=CART, planner="prioritised", horizon_s=HORIZON_S, name="floor.csv", **execution):
    (folder / name).write_text(text)
    values = {
        "map": name,
        "discretisation": {"kind": "roadmap", "cell_m": 1.0},
        "robots": {"count": robots, "type": robot, "draw": "anywhere"},
        "planner": planner,
        "tasks": tasks,
        "execution": {"engine": "kinematic", "time_limit_s": horizon_s, **execution},
        "record": {"bag": False},
    }
    with MapCache() as maps:
        return carry_out(scenario_of(values, folder, "floor"), maps)


def round_trips(service, count=2, **more):
    return {"streams": [{"name": "o", "stops": ["A", "B"], "service": service, "arrivals": {"open": 2 * count}}], **more}


@pytest.mark.parametrize(("robots", "kind", "name"), [(4, "station", "A"), (1, "fleet", "")])
def test_a_station_binds_the_robots_that_queue_for_it(tmp_path, robots, kind, name):
    limit = bound(tmp_path, lanes(RING), robots, round_trips([30, 5], robots)).limit
    assert (limit.kind, limit.name) == (kind, name)


@pytest.mark.parametrize(("at_once", "kind"), [(1, "orders"), (8, "station")])
def test_a_lack_of_orders_binds_robots_that_stand_idle(tmp_path, at_once, kind):
    tasks = {"streams": [{"name": "o", "stops": ["A", "B"], "service": [30, 5], "arrivals": {"open": at_once}}]}
    assert bound(tmp_path, lanes(RING), 4, tasks).limit.kind == kind


@pytest.mark.parametrize(("budget_s", "kind"), [(20.0, "planner"), (0.0, "fleet")])
def test_the_planner_binds_robots_that_stand_after_each_stop_until_it_answers(tmp_path, budget_s, kind):
    assert bound(tmp_path, lanes(RING), 2, round_trips([5, 5]), planning={"budget_s": budget_s}).limit.kind == kind


DEAD_END = lanes(RING) + lanes("c2 P", both=True).split("\n", 1)[1]
THROUGH = lanes("A c1 w c2 P q c3 c4 A")


@pytest.mark.parametrize(("text", "kind", "name"), [(DEAD_END, "aisle", "c2 \N{EN DASH} P"), (THROUGH, "fleet", "")])
def test_an_aisle_binds_robots_that_wait_for_who_comes_out_of_it(tmp_path, text, kind, name):
    """Goods lie at the end of an aisle, which holds one robot at a time, or which goes on."""
    stations = {"end": {"places": ["P"], "queue": ["w"]}}
    tasks = {"stations": stations, "streams": [{"name": "o", "stops": ["A", "end"], "service": [2, 2], "arrivals": {"open": 8}}]}
    limit = bound(tmp_path, text, 4, tasks).limit
    assert (limit.kind, limit.name) == (kind, name)


@pytest.mark.parametrize(("robots", "kind"), [(8, "crossing"), (1, "fleet")])
def test_a_crossing_binds_robots_that_wait_to_cross(tmp_path, robots, kind):
    """Two one-way loops that share one vertex in the middle, at which all robots turn."""
    eight = {"A": (4, 3), "a": (4, 0), "m": (0, 0), "b": (-4, 0), "B": (-4, 3), "n": (0, 3)}
    eight |= {"c": (0, -4), "C": (4, -4)}
    text = lanes("m A a m", "m B b m", "m C c m", at=eight)
    tasks = {
        "groups": {"ends": ["A", "B", "C"]},
        "streams": [{"stops": ["ends", "ends"], "service": [0, 0], "arrivals": {"open": 2 * robots}}],
    }
    slow = {**CART, "turn_rate_rad_s": 0.5}
    assert bound(tmp_path, text, robots, tasks, robot=slow, planner="lacam").limit.kind == kind


@pytest.mark.parametrize(("robots", "stops", "kind"), [(6, ["A", "B"], "lift"), (6, ["A", "C"], "fleet"), (1, ["A", "B"], "fleet")])
def test_a_lift_binds_robots_whose_orders_are_on_two_levels(tmp_path, robots, stops, kind):
    """A one-way loop on each level, past a lift with a way in and a way out; B is on the upper one, A and C on the lower one."""
    levels = {}
    for level, names in (("L1", "in C out a A b"), ("L2", "in2 c2 out2 a2 B b2")):
        at = zip(names.split(), ((0, 0), (6, 0), (12, 0), (12, 12), (6, 12), (0, 12)))
        vertices = [[x, y, {"name": name}] for name, (x, y) in at] + [[6, -3, {"name": f"lift_{level}", "lift": "goods"}]]
        lanes = [[k, (k + 1) % 6, {}] for k in range(6)] + [[0, 6, {}], [6, 2, {}]]
        levels[level] = {"vertices": vertices, "lanes": lanes}
    text = json.dumps({"building_name": "two levels", "levels": levels})
    tasks = {"streams": [{"name": "o", "stops": stops, "service": [2, 2], "arrivals": {"open": 2 * robots}}]}
    assert bound(tmp_path, text, robots, tasks, name="0.yaml").limit.kind == kind


@pytest.mark.parametrize(("places", "kind"), [(["p1"], "charger"), (["p1", "p2"], "fleet")])
def test_chargers_bind_where_there_are_too_few(tmp_path, places, kind):
    """A charge takes as long as it lasts, so that two robots want more than one place."""
    charging = {"stations": places, "critical_low_charging_level": 40, "start_level": [40, 100]}
    assert bound(tmp_path, WITH_SPURS, 2, round_trips([5, 5], charging=charging), robot={**CART, "battery": BATTERY}).limit.kind == kind


@pytest.mark.parametrize(("places", "is_pressed"), [(["p1"], True), (["p1", "p2"], False)])
def test_place_to_charge_that_nobody_drives_to_is_one_of_them(tmp_path, places, is_pressed):
    """A single robot charges at the nearest, and the other is free all the time."""
    charging = {"stations": places, "critical_low_charging_level": 40, "start_level": [40, 100]}
    result = driven(tmp_path, WITH_SPURS, 1, round_trips([5, 5], charging=charging), robot={**CART, "battery": BATTERY})
    assert any(kind == "charger" for kind, *_ in observation(result)["causes"]) == is_pressed


@pytest.mark.parametrize(("places", "is_pressed"), [(["A"], True), (["A", "p1"], False)])
def test_place_of_a_station_that_nobody_drives_to_is_one_of_them(tmp_path, places, is_pressed):
    """A single robot is served at the nearest for nearly all the time, and the other is free."""
    tasks = {"streams": [{"name": "o", "stops": ["S"], "service": [200], "arrivals": {"open": 2}}], "stations": {"S": {"places": places}}}
    result = driven(tmp_path, WITH_SPURS, 1, tasks)
    assert observation(result)["stations"]["S"]["places"] == len(places)
    assert any(kind == "station" and share > 0.8 for kind, _, _, share in observation(result)["causes"]) == is_pressed


def test_a_station_may_be_called_charger(tmp_path):
    charging = {"stations": ["p1", "p2"], "critical_low_charging_level": 40, "start_level": [40, 100]}
    streams = [{"name": "o", "stops": ["charger"], "service": [5], "arrivals": {"open": 2}}]
    tasks = {"streams": streams, "stations": {"charger": {"places": ["A"]}}, "charging": charging}
    result = driven(tmp_path, WITH_SPURS, 1, tasks, robot={**CART, "battery": BATTERY})
    assert observation(result)["stations"]["charger"]["places"] == 1


@pytest.mark.parametrize(("share", "first"), [(0, 0), (50, 2), (62, 2), (63, 3)])
def test_a_share_of_the_robots_begins_with_a_charge(tmp_path, share, first):
    charging = {"stations": ["p1", "p2", "p3"], "start_charging": share}
    result = driven(tmp_path, WITH_SPURS, 4, round_trips([5, 5], 4, charging=charging), robot={**CART, "battery": BATTERY}, horizon_s=10.0)
    tasks = result.execution.tasks
    assert len(np.unique(tasks.robot[~tasks.is_order & (tasks.assigned_s < 1.0)])) == first
