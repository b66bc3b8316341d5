"""Our planners and dispatchers drive vehicles that they know by their messages alone."""

import json
import math

import numpy as np
import pytest
from wire.worlds import SCENARIO, TYPE, Coupled, carts, scenario

from mrp_sumo.errors import ExecutionError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import RunOptions, finish
from mrp_sumo.experiments.solve import solve
from mrp_sumo.experiments.staging.set_up import set_up
from mrp_sumo.formats.vda.check import check
from mrp_sumo.formats.vda.messages import line_of
from mrp_sumo.wire.link import Received
from mrp_sumo.wire.master import DrivenVehicles, driven_vehicles

ROBOTS = {"count": 2, "type": TYPE, "starts": ["a", "e"]}
TASKS = [{"name": f"t{k}", "stops": ["c", "a"] if k % 2 else ["d", "c"], "release_s": 8.0 * k, "service_s": 2.0} for k in range(3)]


def driven(folder, master, **changes):
    """The run of a scenario by the vehicles of a fleet, and all messages as lines of a log."""
    link = Coupled(master.fleet, master.link)
    with MapCache() as maps:
        setup = set_up(scenario(folder, **changes), maps)
        engine = driven_vehicles(setup.problem, master.fleet.site, link, master.dialect, setup.settings.step_length_s, speed=1e9)
        result = finish(setup, solve(setup), maps, RunOptions(engine=engine))
    lines = [line_of(t_s, master.dialect.topic(serial, kind), payload) for t_s, serial, kind, payload in link.said]
    return result, lines


@pytest.mark.parametrize("version", ["2.1", "3.0"])
def test_vehicles_that_swap_places_come_to_their_goals_by_orders_that_keep_the_standard(tmp_path, version):
    with carts(tmp_path, version) as master:
        result, lines = driven(tmp_path, master)
        assert result.status == "completed" and result.audit["passed"], result.note
        bodies = master.fleet.bodies.positions()
    assert np.abs(bodies - [[8, 4], [0, 0]]).max() < 0.01, "where the fleet has its vehicles"
    assert list(check(lines)) == []
    updates = [json.loads(line)["payload"] for line in lines if "/robot_0/order" in line]
    assert len(updates) > 2 and not updates[0]["nodes"][-1]["released"], "released bit by bit"
    assert [one["orderUpdateId"] for one in updates] == list(range(len(updates))), "an order and its updates"


def test_vehicles_stay_at_their_goals_in_the_headings_that_were_asked_for(tmp_path):
    with carts(tmp_path) as master:
        result, lines = driven(tmp_path, master, robots={**SCENARIO["robots"], "goal_heading_deg": [90, 0]})
        assert result.status == "completed" and result.audit["passed"], result.note
        assert [vehicle.body.yaw_rad for vehicle in master.fleet.vehicles] == pytest.approx([math.pi / 2, 0.0])
    assert list(check(lines)) == []
    nodes = [node for line in lines if "/order" in line for node in json.loads(line)["payload"]["nodes"]]
    assert {(node["nodeId"], node["nodePosition"]["theta"]) for node in nodes if "theta" in node["nodePosition"]} == {
        ("e", 1.570796),
        ("a", 0),
    }


def test_vehicles_do_tasks_as_they_come(tmp_path):
    with carts(tmp_path) as master:
        result, lines = driven(tmp_path, master, tasks=TASKS, planner="lacam", robots=ROBOTS)
    assert result.status == "completed" and result.metrics["tasks_done"] == 3 and result.audit["passed"], result.note
    assert list(check(lines)) == []


def test_vehicle_that_breaks_down_holds_the_others_where_they_are_safe(tmp_path):
    from mrp_sumo.formats.vda.abilities import BREAKDOWN
    from mrp_sumo.wire.fleet import InjectedFault

    with carts(tmp_path, faults=[InjectedFault(0, BREAKDOWN, 3.0, 33.0)]) as master:
        result, _ = driven(tmp_path, master)
    assert result.status == "completed" and result.execution.sim_time_s > 33.0 and result.audit["passed"]


def test_vehicle_elsewhere_than_its_way_begins_is_refused(tmp_path):
    with carts(tmp_path) as master, pytest.raises(ExecutionError, match=r"'robot_0' is 4.00 m from 'b', where its way begins"):
        driven(tmp_path, master, robots={**ROBOTS, "starts": ["b", "e"], "goals": ["e", "a"]})


def test_states_that_are_damaged_break_no_master(tmp_path):
    """Sound states follow such with another value in each member in turn, and halves of messages."""
    with carts(tmp_path) as master:
        link = Coupled(master.fleet, master.link)
        with MapCache() as maps:
            problem = set_up(scenario(tmp_path), maps).problem
        vehicles = DrivenVehicles(problem, master.fleet.site, link, master.dialect, 0.1, 1e9, "mrp_sumo")
        vehicles.greet()
        sound = vehicles.vehicles["robot_0"].state
        named = {"errorType": "VALIDATION_FAILURE", "errorReferences": [{"referenceKey": ["x"], "referenceValue": {}}, 3]}
        for key in sound:
            for junk in (None, 5, 1.5, "x", [], [[]], [{}], {}, {"x": "y"}, [named], [{"errorType": ["x"]}]):
                payload = json.dumps({**sound, key: junk}).encode()
                vehicles._take([Received("robot_0", kind, payload) for kind in ("state", "connection", "factsheet")])
                vehicles._take([Received("robot_0", "state", payload[: len(payload) // 2])])
        vehicles._take([Received("robot_0", "state", json.dumps(sound).encode())])
        assert vehicles.vehicles["robot_0"].state == sound and vehicles.vehicles["robot_0"].reached == 0
