"""What is done to a run while it drives is a part of its scenario: made again from its folder, it is the same."""

import json
from dataclasses import dataclass, field

import pytest
import yaml
from wire.worlds import LANES, SCENARIO, TYPE

from mrp_sumo.cli.main import main
from mrp_sumo.drive.listeners import Listener
from mrp_sumo.experiments.interventions import Interventions
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import RunOptions, run_scenario
from mrp_sumo.experiments.staging.set_up import set_up
from mrp_sumo.io.scenario.read import read_scenario
from mrp_sumo.reports.live.watch import LiveView

TASKS = {"list": [{"stops": ["c"], "release_s": 5}], "streams": [{"name": "s", "stops": ["d", "a"], "arrivals": {"rate_per_h": 200}}]}
ROBOTS = {"count": 2, "type": TYPE, "starts": ["a", "e"]}


@dataclass
class Timed(Listener):
    """Asks for something at simulated times."""

    live: LiveView
    orders: dict
    answers: list = field(default_factory=list)

    def hear(self, time_s):
        for at_s in [at_s for at_s in self.orders if at_s <= time_s.now_s]:
            self.answers += [self.live.broadcast.control(order) for order in self.orders.pop(at_s)]


def steered(folder, orders, **changes):
    """A run to which orders were given at times; the answers and its scenario."""
    (folder / "lanes.csv").write_text(LANES)
    (folder / "case.yaml").write_text(yaml.safe_dump(SCENARIO | changes))
    live = LiveView()
    live.broadcast.control({"do": "speed", "speed": None})
    timed = Timed(live, orders)
    run_scenario(read_scenario(folder / "case.yaml"), folder / "run", RunOptions(watches=[live.watch, lambda *_: timed, live.steer]))
    live.close()
    return timed.answers, json.loads((folder / "run" / "result.json").read_text())["scenario"]


def test_robot_that_was_broken_and_lane_that_was_closed_are_so_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    orders = {1.0: [{"do": "break", "robot": 1, "duration_s": 7.5}], 2.3: [{"do": "close", "lane": 1, "duration_s": 40}]}
    answers, scenario = steered(tmp_path, orders)
    assert answers == ["", ""]
    what = scenario["execution"]["disturbances"]
    (breakdown,), (closure,) = what["breakdowns"], what["closures"]
    assert (breakdown["robot"], breakdown["duration_s"]) == (1, 7.5) and 1.0 < breakdown["begin_s"] < 1.2
    assert set(closure["between"]) == {"b", "c"} and 2.3 < closure["begin_s"] < 2.5
    kinds = [json.loads(line)["kind"] for line in (tmp_path / "run" / "events.jsonl").read_text().splitlines()]
    assert {"disturbed", "closed"} <= set(kinds)
    assert main(["reproduce", "run"]) == 0


def test_tasks_that_were_added_are_done_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    orders = {
        4.95: [{"do": "add", "stops": ["b", "e"]}],
        30.0: [{"do": "add", "stops": ["c"]}, {"do": "break", "robot": 0, "duration_s": 20}],
    }
    answers, scenario = steered(tmp_path, orders, tasks=TASKS, robots=ROBOTS, execution={"engine": "kinematic", "time_limit_s": 200})
    assert answers == ["", "", ""]
    assert [(task["name"], task["stops"]) for task in scenario["tasks"]["list"]] == [
        ("", ["c"]),
        ("asked_1", ["b", "e"]),
        ("asked_2", ["c"]),
    ]
    assert main(["reproduce", "run"]) == 0


@pytest.mark.parametrize(
    ("order", "why"),
    [
        ({"do": "break", "robot": 2}, "expected break with a robot"),
        ({"do": "break", "robot": True}, "expected break with a robot"),
        ({"do": "break", "robot": 0, "duration_s": -1}, "duration_s: expected seconds above 0"),
        ({"do": "close", "between": ["a", "x"]}, "'x' is not a vertex of 'lanes'"),
        ({"do": "add", "stops": ["x"]}, "'x' is no station, group or vertex"),
        ({"do": "add", "stops": []}, "expected break with a robot"),
        ({"do": "dance"}, "expected break with a robot"),
    ],
)
def test_what_cannot_be_done_is_said_to_who_asks(tmp_path, order, why):
    (tmp_path / "lanes.csv").write_text(LANES)
    (tmp_path / "case.yaml").write_text(yaml.safe_dump(SCENARIO | {"tasks": TASKS, "robots": ROBOTS}))
    with MapCache() as maps:
        wishes = Interventions(set_up(read_scenario(tmp_path / "case.yaml"), maps))
        assert why in wishes.ask(order)
        assert wishes.interventions(3.0) == []


def test_runs_with_goals_take_no_tasks(tmp_path):
    answers, _ = steered(tmp_path, {1.0: [{"do": "add", "stops": ["c"]}, {"do": "close", "lane": 99}]})
    assert answers == ["this run has goals instead of tasks", "expected the number of a lane"]
