"""What is published while a run drives is what its bag says afterwards."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from worlds import BURGER, problem_of, two_levels

from mrp_sumo.bags.live import LiveMessages
from mrp_sumo.bags.live_bag import LiveBag
from mrp_sumo.bags.writer import write_bag
from mrp_sumo.core.execution import Execution, Outcome
from mrp_sumo.drive.listeners import Listener
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.io.record import RunRecord


@dataclass
class Heard(Listener):
    """A listener that keeps messages by topic."""

    live: LiveMessages | LiveBag
    by_topic: dict = field(default_factory=dict)

    def hear(self, time_s):
        for topic, _, message in self.live.of(time_s):
            self.by_topic.setdefault(topic, []).append(message)


@pytest.mark.parametrize("period_s", [0.1, 0.3])
def test_live_messages_of_a_ride_in_a_lift_are_those_of_the_bag(tmp_path, period_s):
    graph = two_levels(ride_s=10.0, step_s=3.0)
    problem, plan = problem_of(graph, [[1, 2, 3, 10, 11, 12, 4, 5]], BURGER)
    levels = dict(zip(graph.level_names, ([0.0, 0.0], [50.0, 0.0])))
    here = graph.xy[problem.start][None]
    nothing = Execution(
        *(np.zeros(1), here[..., 0], here[..., 1], np.zeros((1, 1)), np.zeros((1, 1)), np.zeros(0), np.full(1, np.nan)),
        *(Outcome.INTERRUPTED, "", 0.0, 0.0, 0.0),
        level=graph.level[problem.start][None],
    )
    record = RunRecord("ride", 0, problem.fleet, graph, problem.goal, plan, nothing, levels=levels)
    heard, viewed = Heard(LiveMessages(record)), Heard(live_bag := LiveBag(record))
    for topic, _, message in live_bag.at_outset():
        viewed.by_topic.setdefault(topic, []).append(message)
    run = simulate(problem, plan, ExecutionSettings(engine="kinematic", record_period_s=period_s), tmp_path, listeners=[heard, viewed])
    write_bag(tmp_path / "bag", replace(record, execution=run))
    with AnyReader([tmp_path / "bag"]) as reader:
        bag = {}
        for connection, _, raw in reader.messages():
            bag.setdefault(connection.topic, []).append(bytes(raw))
    assert len(bag["/lift_states"]) > 15
    for topic in ("/lift_states", "/lift_requests"):
        assert heard.by_topic[topic] == bag[topic]
    if period_s == 0.1:  # else the bag has states between samples
        assert heard.by_topic["/fleet_states"] == bag["/fleet_states"]
        assert viewed.by_topic.keys() - {"/clock"} == {topic for topic in bag if bag[topic]}
        assert {topic for topic in bag if bag[topic] != viewed.by_topic[topic]} <= {
            "/rosout"
        }  # where what has lasted is said when it is over
    assert len(heard.by_topic["/clock"]) == len(run.t_s)
