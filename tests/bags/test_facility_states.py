"""States of lifts and doors in bags, as Open-RMF's adapters publish them."""

from dataclasses import replace

from rosbags.highlevel import AnyReader
from worlds import BURGER, line, problem_of, two_levels

from mrp_sumo.bags.writer import BagOptions, write_bag
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.io.record import RunRecord


def test_a_ride_in_the_bag(tmp_path):
    graph = two_levels(ride_s=10.0, step_s=3.0)
    problem, plan = problem_of(graph, [[1, 2, 3, 10, 11, 12, 4, 5, 6, 7]], BURGER)
    run = simulate(problem, plan, ExecutionSettings(engine="kinematic"), tmp_path)
    levels = dict(zip(graph.level_names, ([0.0, 0.0], [50.0, 0.0])))
    write_bag(tmp_path / "bag", RunRecord("ride", 0, problem.fleet, graph, problem.goal, plan, run, levels=levels), BagOptions())
    states, places, requests = [], [], []
    with AnyReader([tmp_path / "bag"]) as reader:
        for connection, _, raw in reader.messages():
            if connection.topic == "/lift_states":
                m = reader.deserialize(raw, connection.msgtype)
                states.append((m.current_floor, m.destination_floor, m.door_state, m.motion_state, m.session_id))
                assert (m.lift_name, m.available_floors) == ("goods", ["L1", "L2"])
            if connection.topic == "/lift_requests":
                m = reader.deserialize(raw, connection.msgtype)
                requests.append((m.lift_name, m.session_id, m.request_type, m.destination_floor))
            if connection.topic == "/fleet_states":
                places.append(reader.deserialize(raw, connection.msgtype).robots[0].location)
    rest = [(floor, to, door, motion) for floor, to, door, motion, session in dict.fromkeys(states) if session.endswith("/robot_0")]
    closing, up, above, opening = ("L1", "L2", 1, 0), ("L1", "L2", 0, 1), ("L2", "L2", 0, 1), ("L2", "L2", 1, 0)
    assert [rest.index(state) for state in (closing, up, above, opening)] == sorted(rest.index(s) for s in (closing, up, above, opening))
    robot, agv, end = "mrp_sumo/robot_0", 1, 0
    assert requests == [("goods", robot, agv, "L1"), ("goods", robot, agv, "L2"), ("goods", robot, end, "L2")]
    assert (places[0].level_name, places[-1].level_name) == ("L1", "L2")
    assert places[-1].x < 2.0  # in the frame of its level


def test_requests_for_a_door_in_the_bag(tmp_path):
    graph = line(6)
    through = [{"door": "gate", "door_s": 2.0} if {a, b} == {3, 4} else {} for a, b in zip(graph.tail, graph.head)]
    graph = replace(graph, lane_options=tuple(through))
    problem, plan = problem_of(graph, [[0, 1, 2, 3, 4, 5]], BURGER)
    run = simulate(problem, plan, ExecutionSettings(engine="kinematic"), tmp_path)
    write_bag(tmp_path / "bag", RunRecord("door", 0, problem.fleet, graph, problem.goal, plan, run), BagOptions())
    requests, times = [], []
    with AnyReader([tmp_path / "bag"]) as reader:
        for connection, ns, raw in reader.messages():
            if connection.topic == "/door_requests":
                m = reader.deserialize(raw, connection.msgtype)
                requests.append((m.door_name, m.requester_id, m.requested_mode.value))
                times.append(ns)
    assert requests == [("gate", "mrp_sumo/robot_0", mode) for mode in (2, 0)]
    assert times[0] < times[1]
