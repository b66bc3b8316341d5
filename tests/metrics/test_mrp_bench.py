"""MRP-Bench's numbers: its own analyser's on golden logs, and small logs known by hand."""

import csv
import json
import math

import numpy as np
import pytest
from golden import METRICS
from hypothesis import given, settings
from hypothesis import strategies as st

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.metrics.mrp_bench import AnalyserConstants, execution_metrics, smoothed_counts

CASES = sorted(folder.name for folder in METRICS.iterdir() if folder.is_dir())


def read_case(folder):
    case = json.loads((folder / "case.json").read_text())
    names = list(case["robots"])
    rows = list(csv.DictReader((folder / "fleet_states.csv").read_text().splitlines()))
    t_ns = np.array(sorted({int(row["t_ns"]) for row in rows}))
    x, y = np.full((2, len(t_ns), len(names)), np.nan)
    for row in rows:
        at = np.searchsorted(t_ns, int(row["t_ns"])), names.index(row["robot"])
        x[at], y[at] = float(row["x"]), float(row["y"])
    start = np.array([case["robots"][n]["start"] for n in names], float)
    goal = np.array([case["robots"][n]["goal"] for n in names], float)
    return case["config"], names, t_ns, x, y, start, goal


@pytest.mark.parametrize("name", CASES)
def test_golden_logs_give_the_numbers_of_mrp_bench(name):
    config, names, t_ns, x, y, start, goal = read_case(METRICS / name)
    expected = json.loads((METRICS / name / "expected.json").read_text())
    constants = AnalyserConstants(*(config[key] for key in ("cellSize", "locationTolerance", "windowSize", "recordingTimeout")))
    result = execution_metrics(t_ns, x, y, start, goal, constants)
    result["agentsAtGoal"] = sorted(names[i] for i in result["agentsAtGoal"])
    blocked = {names[i]: value for i, value in result.pop("timeBlockedPerAgent").items()}
    wanted = expected.pop("timeBlockedPerAgent")
    assert set(blocked) == set(wanted)
    assert blocked == pytest.approx(wanted, rel=1e-9, abs=1e-12)
    assert set(result) == set(expected)
    for key, value in expected.items():
        assert result[key] == (pytest.approx(value, rel=1e-9, abs=1e-12) if isinstance(value, float) else value), key


def drive(x_of_robot, start, goal):
    x = np.array(x_of_robot, float).T
    t_ns = np.arange(len(x)) * 500_000_000
    return execution_metrics(t_ns, x, np.zeros_like(x), np.array(start, float), np.array(goal, float))


def test_one_robot_alone_has_no_distance_to_another():
    result = drive([[0, 1, 2]], [[0, 0]], [[2, 0]])
    assert result["minDistanceBetweenTwoAgents"] == 99999.9
    assert result["minDistanceBetweenTwoAgentsAtStart"] == 0.0
    assert result["totalTimeForScheduleExecution"] == 0.5  # from the sample at 1 m to the one at 2 m


def test_a_fleet_that_need_not_move_has_no_execution_time():
    result = drive([[0, 0, 0]], [[0, 0]], [[0.1, 0]])
    assert result["allGoalReached"] and result["totalTimeForScheduleExecution"] is None


def test_distances_of_a_crowd_equal_those_of_all_pairs():
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, 50, (2, 3, 100))
    x[1, 7] = y[1, 7] = np.nan
    result = execution_metrics(np.arange(3), x, y, np.zeros((100, 2)), np.zeros((100, 2)))
    pairs = np.hypot(x[:, :, None] - x[:, None], y[:, :, None] - y[:, None])
    pairs[:, np.arange(100), np.arange(100)] = np.inf
    assert result["minDistanceBetweenTwoAgents"] == pytest.approx(np.nanmin(pairs), rel=1e-12)
    assert result["minDistanceBetweenTwoAgentsAtStart"] == pytest.approx(np.nanmin(pairs[0]), rel=1e-12)


def test_a_log_without_messages_is_refused():
    with pytest.raises(MrpSumoError, match="no fleet state"):
        execution_metrics(np.zeros(0, np.int64), np.zeros((0, 1)), np.zeros((0, 1)), np.zeros((1, 2)), np.zeros((1, 2)))


def test_smoothing_drops_corners_and_waits():
    cell = np.array([[0, 0], [1, 0], [1, 1], [2, 1]])  # a staircase
    # 0 -> 2 is diagonal: 1 dropped; 2 -> beyond the end; 3 kept
    assert smoothed_counts([[0, 1, 2, 3], [3]], cell) == (3, 4)
    # waiting twice at 0: 0, 0, 0 -> the middle one goes
    assert smoothed_counts([[0, 0, 0, 1]], cell) == (3, 3)


def slow_truth(t_ns, x, y, start, goal, cell_m, tolerance_m, window, timeout_s):
    """The order of operations, message by message and robot by robot, as MRP-Bench's documents state it."""
    robots = range(len(start))
    most_seen, started, ended, arrived = 0, None, None, set()
    lists, blocked, least, at_start = {}, {}, 99999.9, 0.0
    for k, tau in enumerate(t_ns):
        there = [r for r in robots if np.isfinite(x[k, r])]
        most_seen = max(most_seen, len(there))
        for r in there:
            ds, dg = math.dist((x[k, r], y[k, r]), start[r]), math.dist((x[k, r], y[k, r]), goal[r])
            if started is None and ds > tolerance_m:
                started = tau
            if r in arrived:
                continue
            if dg < tolerance_m:
                arrived.add(r)
            if len(arrived) == len(start):
                ended = tau
            if ds > cell_m or dg < cell_m:
                lists.setdefault(r, []).append(dg)
                blocked.setdefault(r, 0)
                lists[r] = lists[r][-window:]
                if len(lists[r]) == window and abs(lists[r][0] - lists[r][-1]) <= cell_m:
                    blocked[r] += 1
        pairs = [math.dist((x[k, a], y[k, a]), (x[k, b], y[k, b])) for a in there for b in there if a < b]
        least = min([least, *pairs])
        if at_start == 0.0 and most_seen == len(start) and least < 99999.9:
            at_start = least
    period = (t_ns[-1] - t_ns[0]) / 1e9 / len(t_ns)
    time = timeout_s if ended is None else None if started is None else (ended - started) / 1e9
    return {
        "goalsReached": len(arrived),
        "totalTimeForScheduleExecution": time,
        "timeBlockedPerAgent": {r: blocked[r] * period for r in sorted(blocked)},
        "minDistanceBetweenTwoAgents": least,
        "minDistanceBetweenTwoAgentsAtStart": at_start,
        "invalidRun": most_seen != len(blocked),
        "maxRobotsSeen": most_seen,
    }


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32), robots=st.integers(1, 5), samples=st.integers(1, 60), window=st.integers(2, 12))
def test_any_log_gives_what_the_order_of_operations_gives(seed, robots, samples, window):
    rng = np.random.default_rng(seed)
    start, goal = rng.integers(0, 12, (2, robots, 2)) / 4
    steps = rng.integers(-1, 2, (2, samples, robots)) / rng.choice([4, 8, 64])
    x, y = start[:, 0] + np.cumsum(steps[0], 0), start[:, 1] + np.cumsum(steps[1], 0)
    late = rng.integers(0, samples, robots) * (rng.random(robots) < 0.3)
    x[np.arange(samples)[:, None] < late] = np.nan
    y[np.isnan(x)] = np.nan
    t_ns = 10**18 + np.cumsum(rng.integers(3, 7, samples)) * 10**8
    result = execution_metrics(t_ns, x, y, start, goal, AnalyserConstants(0.25, 0.5, window, 60.0))
    wanted = slow_truth(t_ns.tolist(), x, y, start, goal, 0.25, 0.5, window, 60.0)
    for key, value in wanted.items():
        assert result[key] == (pytest.approx(value, rel=1e-9, abs=1e-12) if isinstance(value, float | dict) else value), key
