"""MRP-Bench's numbers: its own analyser's on golden logs, and small logs known by hand."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.metrics.mrp_bench import execution_metrics, planning_counts, smoothed_counts

GOLDEN = Path(__file__).resolve().parents[2] / "../shared/rosbag/mrp_metrics_golden"
CASES = sorted(p.name for p in GOLDEN.iterdir() if p.is_dir()) if GOLDEN.is_dir() else []


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


@pytest.mark.skipif(not CASES, reason="MRP-Bench's golden numbers are not beside the project")
@pytest.mark.parametrize("name", CASES)
def test_golden_logs_give_the_numbers_of_mrp_bench(name):
    config, names, t_ns, x, y, start, goal = read_case(GOLDEN / name)
    expected = json.loads((GOLDEN / name / "expected.json").read_text())
    found = execution_metrics(
        t_ns,
        x,
        y,
        start,
        goal,
        cell_m=config["cellSize"],
        tolerance_m=config["locationTolerance"],
        window=config["windowSize"],
        recording_timeout_s=config["recordingTimeout"],
    )
    found["agentsAtGoal"] = sorted(names[i] for i in found["agentsAtGoal"])
    blocked = {names[i]: value for i, value in found.pop("timeBlockedPerAgent").items()}
    wanted = expected.pop("timeBlockedPerAgent")
    assert set(blocked) == set(wanted)
    assert blocked == pytest.approx(wanted, rel=1e-9, abs=1e-12)
    assert set(found) == set(expected)
    for key, value in expected.items():
        assert found[key] == (pytest.approx(value, rel=1e-9, abs=1e-12) if isinstance(value, float) else value), key


def drive(x_of_robot, start, goal, **options):
    x = np.array(x_of_robot, float).T
    t_ns = np.arange(len(x)) * 500_000_000
    return execution_metrics(t_ns, x, np.zeros_like(x), np.array(start, float), np.array(goal, float), **options)


def test_one_robot_alone_has_no_distance_to_another():
    found = drive([[0, 1, 2]], [[0, 0]], [[2, 0]])
    assert found["minDistanceBetweenTwoAgents"] == 99999.9
    assert found["minDistanceBetweenTwoAgentsAtStart"] == 0.0
    assert found["totalTimeForScheduleExecution"] == 0.5  # from the sample at 1 m to the one at 2 m


def test_a_fleet_that_need_not_move_has_no_execution_time():
    found = drive([[0, 0, 0]], [[0, 0]], [[0.1, 0]])
    assert found["allGoalReached"] and found["totalTimeForScheduleExecution"] is None


def test_distances_of_a_crowd_equal_those_of_all_pairs():
    rng = np.random.default_rng(1)
    x, y = rng.uniform(0, 50, (2, 3, 100))
    x[1, 7] = y[1, 7] = np.nan
    found = execution_metrics(np.arange(3), x, y, np.zeros((100, 2)), np.zeros((100, 2)))
    pairs = np.hypot(x[:, :, None] - x[:, None], y[:, :, None] - y[:, None])
    pairs[:, np.arange(100), np.arange(100)] = np.inf
    assert found["minDistanceBetweenTwoAgents"] == pytest.approx(np.nanmin(pairs), rel=1e-12)
    assert found["minDistanceBetweenTwoAgentsAtStart"] == pytest.approx(np.nanmin(pairs[0]), rel=1e-12)


def test_a_log_without_messages_is_refused():
    with pytest.raises(MrpSumoError, match="no fleet state"):
        execution_metrics(np.zeros(0, np.int64), np.zeros((0, 1)), np.zeros((0, 1)), np.zeros((1, 2)), np.zeros((1, 2)))


def test_counts_are_list_lengths_and_smoothing_drops_corners_and_waits():
    cell = np.array([[0, 0], [1, 0], [1, 1], [2, 1]])  # a staircase
    assert planning_counts([[0, 1, 2, 3], [3]]) == (4, 5)
    # 0 -> 2 is diagonal: 1 dropped; 2 -> beyond the end; 3 kept
    assert smoothed_counts([[0, 1, 2, 3], [3]], cell) == (3, 4)
    # waiting twice at 0: 0, 0, 0 -> the middle one goes
    assert smoothed_counts([[0, 0, 0, 1]], cell) == (3, 3)
