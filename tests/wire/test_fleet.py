"""A virtual fleet drives what its master releases, and no farther."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from jsonschema import Draft202012Validator
from wire.worlds import TYPE, carts

from mrp_sumo.formats.vda.abilities import BREAKDOWN
from mrp_sumo.formats.vda.check import check
from mrp_sumo.formats.vda.messages import action, line_of
from mrp_sumo.wire.fleet import InjectedFault, Reporting
from mrp_sumo.wire.link import FROM_VEHICLES

SCHEMAS = Path(__file__).resolve().parents[3] / "shared" / "reference" / "data" / "vda5050"


def names_of(state):
    return [error["errorType"] for error in state["errors"]]


@pytest.mark.parametrize("engine", ["kinematic", "sumo"])
def test_vehicle_drives_its_base_and_stops_at_the_end_of_it(tmp_path, engine):
    with carts(tmp_path, execution={"engine": engine}) as master:
        master.order("robot_0", "abc", released=2)
        master.run(12)
        said = master.states["robot_0"]
        assert (master.at("robot_0"), said["lastNodeId"], said["driving"], said["newBaseRequest"]) == ((4, 0), "b", False, True)
        master.order("robot_0", "bde", update=1, begin=2, released=2)
        master.run(12)
        assert master.at("robot_0") == (4, 4) and master.states["robot_0"]["lastNodeSequenceId"] == 4


@pytest.mark.parametrize("engine", ["kinematic", "sumo"])
def test_vehicle_turns_to_the_heading_of_a_node_before_it_has_passed_it(tmp_path, engine):
    with carts(tmp_path, execution={"engine": engine}) as master:
        master.order("robot_0", "abc", theta={"b": -2.5, "c": 1.0})
        passed = {}
        for _ in range(200):
            master.run(0.1)
            said = master.states["robot_0"]
            passed.setdefault(said["lastNodeId"], (said["mobileRobotPosition"]["theta"], master.at("robot_0")))
        assert passed["b"] == (pytest.approx(-2.5, abs=0.02), (4, 0)), "it has turned there"
        assert passed["c"] == (pytest.approx(1.0, abs=0.02), (8, 0)) and said["mobileRobotPosition"]["theta"] == pytest.approx(1.0)
        assert not list(check([line_of(t_s, topic, payload) for t_s, topic, payload in master.all]))


def test_extended_base_is_driven_through_without_a_stop(tmp_path):
    with carts(tmp_path) as master:
        master.order("robot_0", "abc", released=2)
        master.run(2)
        master.order("robot_0", "bc", update=1, begin=2)
        slowest = 1.0
        for _ in range(40):
            master.run(0.1)
            slowest = min(slowest, master.states["robot_0"]["velocity"]["vx"])
        assert slowest > 0.9


def test_vehicles_that_are_released_into_each_other_stop_and_say_so(tmp_path):
    with carts(tmp_path) as master:
        master.order("robot_0", "abde", order="east")
        master.order("robot_1", "edba", order="west")
        nearest = math.inf
        for _ in range(300):
            master.run(0.1)
            nearest = min(nearest, float(np.hypot(*(master.fleet.bodies.positions()[0] - master.fleet.bodies.positions()[1]))))
        said = master.states["robot_0"]
        assert master.fleet.problem.fleet.separation_m - 1e-6 <= nearest < 2.5
        assert names_of(said) == ["blocked"] and "robot_1" in said["errors"][0]["errorDescription"]
        assert said["safetyState"]["fieldViolation"]


def test_cancelled_vehicle_stands_and_takes_an_order_from_there(tmp_path):
    with carts(tmp_path) as master:
        master.order("robot_0", "abc")
        master.run(1.5)
        master.instant("robot_0", "cancelOrder")
        master.run(6)
        said = master.states["robot_0"]
        assert said["instantActionStates"][0]["actionStatus"] == "FINISHED" and said["nodeStates"] == [] and not said["driving"]
        x, _ = master.at("robot_0")
        assert 0.5 < x < 4.0, "it stops between a and b"
        deviation = {"a": 9.0, "b": 9.0, "theta": 0.0}
        master.order("robot_0", "ab", order="o2", deviation=deviation)
        master.run(8)
        assert master.at("robot_0") == (4, 0) and names_of(master.states["robot_0"]) == []


def test_paused_vehicle_stands_between_nodes_until_it_may_go_on(tmp_path):
    with carts(tmp_path) as master:
        master.order("robot_0", "abc")
        master.run(2)
        master.instant("robot_0", "startPause")
        master.run(3)
        there = master.at("robot_0")
        assert not master.states["robot_0"]["driving"] and master.states["robot_0"]["paused"]
        master.run(3)
        assert master.at("robot_0") == there
        master.instant("robot_0", "stopPause")
        master.run(10)
        assert master.at("robot_0") == (8, 0)


def test_vehicle_stands_for_its_action_and_keeps_the_limit_of_its_edge(tmp_path):
    with carts(tmp_path) as master:
        master.order("robot_0", "abc", actions={"b": [action("pick", "p", "HARD", duration=5)]}, limit_mps=0.5)
        master.run(7)
        assert master.at("robot_0")[0] < 3.5 and master.states["robot_0"]["velocity"]["vx"] == pytest.approx(0.5)
        master.run(6)
        assert master.at("robot_0") == (4, 0) and master.states["robot_0"]["actionStates"][0]["actionStatus"] == "RUNNING"
        master.run(13)
        assert master.at("robot_0") == (8, 0) and master.states["robot_0"]["actionStates"][0]["actionStatus"] == "FINISHED"


def test_fault_stops_a_vehicle_for_as_long_as_it_was_asked_to(tmp_path):
    with carts(tmp_path, faults=[InjectedFault(0, BREAKDOWN, 2.0, 6.0)]) as master:
        master.order("robot_0", "ab")
        master.run(5)
        assert names_of(master.states["robot_0"]) == ["breakdown"] and not master.states["robot_0"]["driving"]
        master.run(8)
        assert names_of(master.states["robot_0"]) == [] and master.at("robot_0") == (4, 0)


def test_battery_drains_and_is_filled_while_charging(tmp_path):

    battery = {
        "voltage_v": 12.0,
        "capacity_ah": 0.01,
        "charging_a": 1.0,
        "mass_kg": 20.0,
        "inertia_kgm2": 1.0,
        "friction": 0.2,
        "device_w": 1.0,
    }
    robots = {"count": 2, "type": {**TYPE, "battery": battery}, "starts": ["a", "e"], "goals": ["e", "a"]}
    with carts(tmp_path, robots=robots) as master:
        master.order("robot_0", "ab", actions={"b": [action("startCharging", "c", "HARD")]})
        master.run(5)
        low = master.states["robot_0"]["powerSupply"]
        assert low["stateOfCharge"] < 95 and not low["charging"]
        master.run(10)
        assert master.states["robot_0"]["powerSupply"]["charging"]
        assert master.states["robot_0"]["powerSupply"]["stateOfCharge"] > low["stateOfCharge"] - 30


@pytest.mark.parametrize("version", ["2.1", "3.0"])
def test_what_vehicles_say_keeps_the_standard(tmp_path, version):
    with carts(tmp_path, version, reporting=Reporting(state_s=1.0, view_s=0.5)) as master:
        master.hear()
        sent = len(master.all)
        master.order("robot_0", "abc", released=2)
        master.run(3)
        master.order("robot_0", "bc", update=1, begin=2)
        master.run(8)
        assert sent and list(check(line_of(t_s, topic, payload) for t_s, topic, payload in master.all)) == []
    folder = SCHEMAS / version / "json_schemas"
    if folder.is_dir():
        schemas = {kind: Draft202012Validator(json.loads((folder / f"{kind}.schema").read_text())) for kind in FROM_VEHICLES}
        said = [(topic.rpartition("/")[2], payload) for _, topic, payload in master.all]
        assert {kind for kind, _ in said} == set(FROM_VEHICLES)
        assert [error.message for kind, payload in said for error in schemas[kind].iter_errors(payload)] == []
