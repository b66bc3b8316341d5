"""MRP-Bench's metrics out of bags: its own golden numbers, every generation and storage, and bags of ours."""

import csv
import json
import sqlite3

import numpy as np
import pytest
import yaml
from golden import METRICS
from rosbags.rosbag2 import StoragePlugin, Writer

from mrp_sumo.bags.messages import GENERATIONS, typestore
from mrp_sumo.cli.main import main

CASES = sorted(folder.name for folder in METRICS.iterdir() if folder.is_dir())


def fleet_bag(folder, rows, generation="galactic", storage=StoragePlugin.SQLITE3, topic="/fleet_states"):
    """A bag of these (t_ns, robot, x, y), as MRP-Bench would record it."""
    store = typestore(generation)
    kinds = {name.rsplit("/", 1)[1]: kind for name, kind in store.types.items() if name.startswith(("rmf_fleet", "builtin_interfaces"))}
    limit, more = ((), ()) if generation == "galactic" else ((False, 0.0), ())
    more = ("",) if generation == "kilted" else more
    with Writer(folder, version=8, storage_plugin=storage) as writer:
        connection = writer.add_connection(topic, "rmf_fleet_msgs/msg/FleetState", typestore=store)
        for ns in sorted({row[0] for row in rows}):
            robots = [
                kinds["RobotState"](
                    name, "m", "t", 1, kinds["RobotMode"](2, 0, *more), 90.0,
                    kinds["Location"](kinds["Time"](*divmod(ns, 10**9)), x, y, 0.0, *limit, "L1", 0), [],
                )
                for at, name, x, y in rows
                if at == ns
            ]  # fmt: skip
            writer.write(connection, ns, store.serialize_cdr(kinds["FleetState"]("fleet", robots), connection.msgtype))


def golden_rows(case):
    with (METRICS / case / "fleet_states.csv").open() as stream:
        return [(int(r["t_ns"]), r["robot"], float(r["x"]), float(r["y"])) for r in csv.DictReader(stream)]


def without_definitions(bag):
    """Bags of Galactic carry no message definitions and no type hashes."""
    database = sqlite3.connect(next(bag.glob("*.db3")))
    database.execute("delete from message_definitions")
    database.commit()
    database.close()
    metadata = bag / "metadata.yaml"
    document = yaml.safe_load(metadata.read_text())
    for topic in document["rosbag2_bagfile_information"]["topics_with_message_count"]:
        topic["topic_metadata"]["type_description_hash"] = ""
    metadata.write_text(yaml.safe_dump(document))


def analyzed(capsys, *arguments):
    assert main(["analyze", *map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def same(result, case):
    expected = json.loads((METRICS / case / "expected.json").read_text())
    assert set(result) == set(expected)
    for key, value in expected.items():
        close = isinstance(value, float | dict)
        assert result[key] == (pytest.approx(value, rel=1e-9, abs=1e-12) if close else value), key


@pytest.mark.parametrize("case", CASES)
def test_bags_give_the_golden_numbers(tmp_path, capsys, case):
    fleet_bag(tmp_path / case, golden_rows(case))
    same(
        analyzed(capsys, tmp_path / case, "--config", METRICS / case / "case.json"),
        case,
    )


@pytest.mark.parametrize("generation", GENERATIONS)
@pytest.mark.parametrize("form", ["mcap", "sqlite3", "sqlite3 without definitions", "database alone"])
def test_every_generation_is_recognised(tmp_path, capsys, generation, form):
    case = CASES[2]
    fleet_bag(tmp_path / "bag", golden_rows(case), generation, StoragePlugin.MCAP if form == "mcap" else StoragePlugin.SQLITE3)
    if form == "sqlite3 without definitions":
        without_definitions(tmp_path / "bag")
    if form == "database alone":
        (tmp_path / "bag" / "metadata.yaml").unlink()
    same(
        analyzed(capsys, tmp_path / "bag", "--config", METRICS / case / "case.json"),
        case,
    )


def test_starts_and_goals_beside_the_bag_are_found(tmp_path, capsys):
    """MRP-Bench leaves a YAML file named like the bag's folder, starts and goals somewhere inside."""
    case = CASES[0]
    output = json.loads((METRICS / case / "case.json").read_text())
    places = [{"assignedAgent": name, "start_wcos": at["start"], "goal_wcos": at["goal"]} for name, at in output["robots"].items()]
    fleet_bag(tmp_path / "run_1", golden_rows(case))
    (tmp_path / "run_1.yaml").write_text(yaml.safe_dump({"config": {"cellSize": 0.35}, "metrics": {"startsAndGoals": places}}))
    same(analyzed(capsys, tmp_path / "run_1"), case)


def rows_of_two():
    return [(10**18 + k * 5 * 10**8, f"r{i}", float(k), float(i)) for k in range(4) for i in range(2)]


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["nowhere"], "nowhere: no such bag"),
        (["study"], "study: a batch, expected a bag or a run; add --metric NAME, or see `mrp-sumo report study`"),
        (["empty"], "empty: no metadata.yaml: not a bag, or its writer was interrupted"),
        (["other"], "other: no topic /fleet_states (did you mean '/fleet_state'?)"),
        (["good"], "good: no starts and goals beside it and no /robot_path_requests in it; give them with --config"),
        (["good", "--rmf", "humbel"], "unknown generation 'humbel' of rmf_fleet_msgs"),
        (["good", "--config", "nowhere.yaml"], "nowhere.yaml: no such file or directory"),
        (["good", "--config", "half.yaml"], "good: robot 'r1' has no start and goal"),
        (["good", "--config", "half.yaml", "--cell", "-1"], "--cell: found -1, expected a number above 0"),
        (["good", "--config", "endless.yaml"], "windowSize is inf, expected a number above 0"),
        (["good", "--config", "odd.yaml"], "odd.yaml: robots: found "),
        (
            ["good", "--config", "nowhere_near.yaml"],
            "nowhere_near.yaml: robots: found \"{'r0': {'start': [nan, 0], 'goal': [3, 0]}}\", expected a start",
        ),
        (["broken"], "broken: cannot be read as a bag: "),
    ],
)
def test_bad_input_is_told_in_one_line(tmp_path, capsys, monkeypatch, arguments, line):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "empty").mkdir()
    (tmp_path / "study" / "runs").mkdir(parents=True)
    (tmp_path / "study" / "plan.json").write_text("{}")
    fleet_bag(tmp_path / "good", rows_of_two())
    fleet_bag(tmp_path / "other", rows_of_two(), topic="/fleet_state")
    fleet_bag(tmp_path / "broken", rows_of_two(), storage=StoragePlugin.MCAP)
    mcap = tmp_path / "broken" / "broken.mcap"
    mcap.write_bytes(mcap.read_bytes()[:300])
    (tmp_path / "nowhere_near.yaml").write_text("robots: {r0: {start: [.nan, 0], goal: [3, 0]}}")
    (tmp_path / "endless.yaml").write_text("robots: {r0: {start: [0, 0], goal: [3, 0]}}\nwindowSize: .inf")
    (tmp_path / "half.yaml").write_text("robots: {r0: {start: [0, 0], goal: [3, 0]}}")
    (tmp_path / "odd.yaml").write_text("robots: {r0: {start: [0, 0]}}")
    assert main(["analyze", *arguments]) == 2
    output = capsys.readouterr()
    assert output.out == "" and output.err.startswith(f"mrp-sumo: {line}") and output.err.count("\n") == 1


@pytest.mark.parametrize("name", ["bag", "folder.bag"])
def test_a_table_for_people(tmp_path, capsys, name):
    fleet_bag(tmp_path / "bag", rows_of_two())
    (tmp_path / "bag").rename(tmp_path / name)
    (tmp_path / "config.yaml").write_text("robots: {r0: {start: [0, 0], goal: [3, 0]}, r1: {start: [0, 1], goal: [3, 1]}}")
    assert main(["analyze", str(tmp_path / name), "--config", str(tmp_path / "config.yaml")]) == 0
    output = capsys.readouterr().out
    assert "goalsReached                        2\n" in output and "minDistanceBetweenTwoAgents         1.000 m\n" in output
    assert np.isfinite(float(output.split("totalTimeForScheduleExecution")[1].split()[0]))


def test_the_bag_of_a_run_gives_the_metrics_of_its_result(tmp_path, capsys):
    """From scenario to bag and back: what evaluate says from the trajectory, analyze says from the messages."""
    assert main(["run", "office_5", "--planner", "prioritised", "--out", str(tmp_path / "run")]) == 0
    capsys.readouterr()
    output, metrics = analyzed(capsys, tmp_path / "run"), json.loads((tmp_path / "run" / "result.json").read_text())["metrics"]
    ours = {
        "goalsReached": "goals_reached",
        "allGoalReached": "all_goals_reached",
        "totalTimeForScheduleExecution": "execution_time_s",
        "executionTimeoutReached": "execution_timed_out",
        "timeBlockedTotal": "time_blocked_total_s",
        "minDistanceBetweenTwoAgents": "min_distance_m",
        "minDistanceBetweenTwoAgentsAtStart": "min_distance_at_start_m",
        "minDistanceBetweenTwoAgentsDelta": "min_distance_delta_m",
        "invalidRun": "run_invalid",
    }
    assert {key: output[key] for key in ours} == {key: pytest.approx(metrics[name], rel=1e-9) for key, name in ours.items()}


@pytest.mark.parametrize("has_orders", [True, False])
def test_of_a_run_with_orders_it_is_said_that_these_metrics_know_none(tmp_path, capsys, has_orders):
    fleet_bag(tmp_path / "run" / "bag", rows_of_two())
    (tmp_path / "run" / "bag.yaml").write_text("robots: {r0: {start: [0, 0], goal: [3, 0]}, r1: {start: [0, 1], goal: [3, 1]}}")
    if has_orders:
        (tmp_path / "run" / "tasks.parquet").touch()
    assert main(["analyze", str(tmp_path / "run")]) == 0
    assert ("a run with orders, which MRP-Bench's metrics do not count" in capsys.readouterr().err) == has_orders
