"""States of lifts and doors in bags, as Open-RMF's adapters publish them."""

import numpy as np
from rosbags.highlevel import AnyReader
from worlds import BURGER, problem_of, two_levels

from mrp_sumo.bags.writer import BagOptions, write_bag
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.io.record import RunRecord
from mrp_sumo.io.trajectory import Levels


def test_a_ride_in_the_bag(tmp_path):
    graph = two_levels(ride_s=10.0, step_s=3.0)
    problem, plan = problem_of(graph, [[1, 2, 3, 10, 11, 12, 4, 5]], BURGER)
    run = simulate(problem, plan, ExecutionSettings(engine="kinematic"), tmp_path)
    levels = Levels(graph.level_names, np.array([[0.0, 0.0], [50.0, 0.0]]))
    write_bag(tmp_path / "bag", RunRecord("ride", 0, problem.fleet, graph, problem.goal, plan, run, levels=levels), BagOptions())
    states, places = [], []
    with AnyReader([tmp_path / "bag"]) as reader:
        for connection, _, raw in reader.messages():
            if connection.topic == "/lift_states":
                m = reader.deserialize(raw, connection.msgtype)
                states.append((m.current_floor, m.destination_floor, m.door_state, m.motion_state, m.session_id))
                assert (m.lift_name, m.available_floors) == ("goods", ["L1", "L2"])
            if connection.topic == "/fleet_states":
                places.append(reader.deserialize(raw, connection.msgtype).robots[0].location)
    kept = [(floor, to, door, motion) for floor, to, door, motion, session in dict.fromkeys(states) if session.endswith("/robot_0")]
    closing, up, above, opening = ("L1", "L2", 1, 0), ("L1", "L2", 0, 1), ("L2", "L2", 0, 1), ("L2", "L2", 1, 0)
    assert [kept.index(state) for state in (closing, up, above, opening)] == sorted(kept.index(s) for s in (closing, up, above, opening))
    assert (places[0].level_name, places[-1].level_name) == ("L1", "L2")
    assert places[-1].x < 1.0  # in the frame of its level
