"""How far ahead plans reach by default: into the longest aisle and back, or robots meet in it again and again."""

from types import SimpleNamespace

import numpy as np
import pytest
from floors import driven, lanes, scenario
from worlds import graph_of

from mrp_sumo.drive import rolling
from mrp_sumo.drive.rolling import longest_aisle
from mrp_sumo.errors import PlanError

ROW = [(float(k), 0.0) for k in range(8)]
LINE = [(k, k + 1) for k in range(7)]
BRANCH = [*ROW, (4.0, 1.0)]
SQUARE = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]
ROUND = [(0, 1), (1, 2), (2, 3), (3, 0)]


@pytest.mark.parametrize(
    ("xy", "pairs", "one_way", "length"),
    [
        (ROW, LINE, (), 7),
        (ROW, LINE[3:], LINE[:3], 4),
        (BRANCH, [*LINE, (4, 8)], (), 4),
        (SQUARE, ROUND, (), 0),
    ],
    ids=("line", "partly one-way", "branch", "ring"),
)
def test_longest_aisle(xy, pairs, one_way, length):
    assert longest_aisle(graph_of(xy, pairs, one_way=one_way)) == length


@pytest.mark.parametrize("planner", ["lacam", "prioritised"])
def test_robots_take_turns_in_a_long_dead_end(tmp_path, planner):
    """An aisle of 30 m off a one-way ring: an order keeps it for 64 s and two turns, and 84 s are allowed."""
    xy = {"a": (0.0, 0.0), "b": (10.0, 0.0), "c": (10.0, 10.0), "d": (0.0, 10.0), "end": (10.0, 40.0)}
    floor = lanes(tmp_path / "ring.csv", xy, [("a", "b"), ("b", "c"), ("c", "d"), ("d", "a")], False)
    spur = lanes(tmp_path / "spur.csv", xy, [("c", "end")], True).read_text().partition("\n")[2]
    floor.write_text(floor.read_text() + spur)
    tasks = {"streams": [{"name": "o", "stops": ["a", "end"], "service": [2, 4], "arrivals": {"open": 6}}]}
    result = driven(scenario(floor, tasks, robots=3, planner=planner, execution={"time_limit_s": 1500.0}))
    begin_s = np.sort(result.execution.stops.begin_s[np.array(result.execution.stops.station) == "end"])
    assert result.operations_audit["passed"] and np.diff(begin_s).mean() < 84


@pytest.mark.parametrize("planner", ["auto", "prioritised"])
def test_robots_that_bar_each_others_places_are_led_out(tmp_path, planner):
    """robot_0 waits in the dead end where robot_1 is to be served next, which waits on the only street, where robot_2 has to pass first."""
    xy = {"dock": (0.0, 0.0), "a": (3.0, 0.0), "b": (6.0, 0.0), "c": (9.0, 0.0), "d": (12.0, 0.0), "off": (6.0, 3.0)}
    xy |= {"one": (9.0, 3.0), "two": (15.0, 0.0)}
    street = [("dock", "a"), ("a", "b"), ("b", "c"), ("c", "d"), ("d", "two"), ("b", "off"), ("c", "one")]
    stream = {"name": "o", "stops": ["place", "place"], "service": [20, 20], "arrivals": {"open": 3}}
    tasks = {"groups": {"place": ["one", "two"]}, "streams": [stream]}
    floor, execution = lanes(tmp_path / "comb.csv", xy, street, True), {"time_limit_s": 1800.0}
    result = driven(scenario(floor, tasks, starts=["dock", "one", "two"], planner=planner, execution=execution))
    assert result.status == "completed" and result.metrics["tasks_done"] > 15, result.note


def test_a_way_out_is_asked_for_ever_more_seldom_where_there_is_none(monkeypatch):
    """Requests each second for ten minutes: after 60, 120, 240 s; at once after a stop, and when a broken robot is repaired. At first with
    an eighth of the effort, then with twice as much each time.
    """
    crew, broken, requests = SimpleNamespace(made_s=0.0), np.array([True, False]), list[tuple[float, int]]()

    def planned(request, begin_s, context, planner, parameters, limits):
        if planner == rolling.COMPLETE:
            requests.append((request.now_s, limits.effort))
            raise PlanError("no way out")
        return "ways"

    monkeypatch.setattr(rolling, "planned", planned)
    monkeypatch.setattr(rolling.Rolling, "_staying", lambda *_: 1)
    settings = SimpleNamespace(planning=SimpleNamespace(effort=400, budget_s=0.0), tasks=True, planner="prioritised", planner_parameters={})
    ledger = SimpleNamespace(problem=SimpleNamespace(num_robots=2))
    monkeypatch.setattr(rolling, "window_of", lambda *_: 20)
    surroundings = SimpleNamespace(crew=crew, world=SimpleNamespace(broken=broken), ledger=ledger)
    asks = rolling.Rolling(settings, surroundings, None, None)
    for now_s in range(1, 601):
        crew.made_s = 500.0 if now_s >= 500 else 0.0
        broken[0] = now_s < 550
        assert asks.plan(SimpleNamespace(now_s=float(now_s)), float(now_s)) == "ways"
    assert requests == [(1.0, 50), (61.0, 100), (181.0, 200), (421.0, 400), (500.0, 50), (550.0, 50)]
