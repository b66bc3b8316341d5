"""What was written comes back, as arrays and as DataFrames."""

import json
import shutil
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from worlds import record_of_four, run_of_four

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.io.run_reader import RunFolder, load_run, num_visits
from mrp_sumo.io.trajectory import write_trajectory


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    metrics = {"sim_time_s": 3.0, "wall_time_s": 0.1, "cpu_time_s": 0.1, "num_robots": 4}
    run_of_four(folder / "run", folder / "x.net.xml", metrics=metrics)
    return load_run(folder / "run")


def test_record_is_the_one_that_was_written(run):
    wanted, answer = record_of_four(seconds=3.0), run.record
    for name in ("x_m", "y_m", "yaw_rad", "speed_mps", "arrived_s", "goal_s"):
        assert np.array_equal(getattr(answer.execution, name), getattr(wanted.execution, name), equal_nan=True), name
    assert answer.execution.t_s == pytest.approx(wanted.execution.t_s, abs=1e-12)
    assert answer.execution.events == wanted.execution.events
    assert np.array_equal(answer.target, wanted.target) and np.array_equal(answer.plan.depart_s, wanted.plan.depart_s)
    assert (answer.name, answer.seed, answer.execution.outcome) == ("four", 7, wanted.execution.outcome)


def test_vertices_of_one_name_are_told_apart(run, tmp_path):
    """The goals of robot_0 and robot_1 have one name, and an event happens at the second."""
    shutil.copytree(run.folder, tmp_path / "run")
    wanted = record_of_four(seconds=3.0)
    result, floor, plan = (json.loads((tmp_path / "run" / name).read_text()) for name in ("result.json", "floor.json", "plan.json"))
    second = int(wanted.target[1])
    for r in (0, 1):
        floor["plan_graph"]["vertex_name"][str(wanted.target[r])] = "goal"
        result["robots"][r]["goal"] = plan["robots"][r]["goal"] = "goal"
    for name, document in (("result.json", result), ("floor.json", floor), ("plan.json", plan)):
        (tmp_path / "run" / name).write_text(json.dumps(document))
    x, y = wanted.graph.xy[second].tolist()
    event = {"t_s": 3.0, "kind": "goal", "robot": "robot_1", "vertex": "goal", "x_m": x, "y_m": y}
    (tmp_path / "run" / "events.jsonl").write_text(json.dumps(event) + "\n")
    answer = load_run(tmp_path / "run").record
    assert answer.target.tolist() == wanted.target.tolist()
    assert [e.vertex for e in answer.execution.events] == [second]


def test_levels_have_the_order_of_the_graph_not_of_the_alphabet(run, tmp_path):
    shutil.copytree(run.folder, tmp_path / "run")
    floor, levels = json.loads((tmp_path / "run" / "floor.json").read_text()), {"upper": (0.0, 0.0), "ground": (0.0, -12.0)}
    floor["plan_graph"]["level_names"] = list(levels)
    (tmp_path / "run" / "floor.json").write_text(json.dumps(floor))
    below = replace(run.record.execution, level=np.ones(run.samples.x_m.shape, np.int64))
    write_trajectory(tmp_path / "run" / "trajectory.parquet", below, run.fleet.robot_name, {}, levels)
    samples = load_run(tmp_path / "run").samples
    assert (list(samples.levels), set(samples.level.ravel().tolist())) == (["upper", "ground"], {1})
    assert np.allclose(samples.y_m, below.y_m, equal_nan=True)


def test_frames_have_a_row_a_sample_an_event_a_visit(run):
    assert list(run.trajectory.columns) == ["t_s", "robot", "x_m", "y_m", "yaw_rad", "speed_mps"]
    assert len(run.trajectory) == 4 * 31
    assert run.trajectory.groupby("robot", observed=True).x_m.max()["robot_0"] == 3.0
    assert run.events.kind.tolist() == ["started", "blocked", "goal"] and run.events.other[1] == "robot_2"
    assert run.visits.groupby("robot", observed=True).visit.max().tolist() == [7, 7, 7, 0]
    assert run.visits.depart_s.isna().sum() == 4
    assert run.metrics["num_robots"] == 4 and run.audit == {"passed": True}


def test_a_bag_made_later_is_the_bag_of_the_run(run, tmp_path):
    from mrp_sumo.bags.writer import write_bag

    write_bag(tmp_path / "bag", run.record)
    assert (tmp_path / "bag" / "bag.mcap").read_bytes() == (run.folder / "bag" / "bag.mcap").read_bytes()


def test_folders_without_a_run_are_refused(tmp_path):
    with pytest.raises(MrpSumoError, match="holds no complete run"):
        load_run(tmp_path)
    with pytest.raises(MrpSumoError, match="no such folder"):
        load_run(tmp_path / "x")
    (tmp_path / "result.json").write_text("{")
    with pytest.raises(MrpSumoError, match="not JSON"):
        load_run(tmp_path)


def test_a_run_that_was_not_executed_says_so(tmp_path):
    run_of_four(tmp_path / "run", tmp_path / "x.net.xml", executed=False, status="planning_timed_out")
    run = load_run(tmp_path / "run")
    assert run.plan is None and len(run.events) == 0
    with pytest.raises(MrpSumoError, match=r"was not executed \(planning_timed_out\)"):
        _ = run.trajectory


@pytest.mark.parametrize(
    ("name", "content", "reading", "line"),
    [
        ("floor.json", None, "graph", r"floor\.json: no such file"),
        ("floor.json", "{", "graph", r"floor\.json: not JSON"),
        ("floor.json", "{}", "graph", r"floor\.json: schema version None, expected 1"),
        (
            "floor.json",
            '{"schema_version": 1, "fleet": {}, "nav_graph": {}, "plan_graph": {"kind": "grid", "cell_m": 1, "vertex_of_station": [], '
            '"name": "a", "level_names": ["L1"], "xy": [[0, 0]], "level": null, "vertex_name": {"0": [1]}, "lanes": [], "length_m": null}}',
            "graph",
            r"damaged, or of another version: TypeError: a name is \[1\], expected text",
        ),
        (
            "floor.json",
            '{"schema_version": 1, "fleet": {}, "nav_graph": {}, "plan_graph": {"kind": "grid", "cell_m": 1, "vertex_of_station": [], '
            '"name": "a", "level_names": ["L1"], "xy": [[0, 0]], "level": [1], "vertex_name": {}, "lanes": [], "length_m": null}}',
            "graph",
            r"damaged, or of another version: ValueError: a vertex is on no level",
        ),
        (
            "floor.json",
            '{"schema_version": 1, "fleet": {}, "nav_graph": {}, "plan_graph": {"kind": "grid", "cell_m": 1, "vertex_of_station": [], '
            '"name": "a", "level_names": ["L1"], "xy": [[0, 0], [1, 0]], "level": [0], "vertex_name": {}, "lanes": [], "length_m": null}}',
            "graph",
            r"damaged, or of another version: ValueError: levels of 1 vertices, expected 2",
        ),
        (
            "floor.json",
            '{"schema_version": 1, "fleet": {}, "nav_graph": {}, "plan_graph": {"kind": "grid", "cell_m": 1, "vertex_of_station": [], '
            '"name": "a", "level_names": ["L1"], "xy": [[0, 0]], "level": null, "vertex_name": {}, "vertex_options": {"0": []}, '
            '"lanes": [], "length_m": null}}',
            "graph",
            r"damaged, or of another version: TypeError: options of a vertex are \[\], expected keys and values",
        ),
        ("plan.json", "[1", "plan", r"plan\.json: not JSON"),
        ("plan.json", '{"schema_version": 9}', "plan", r"plan\.json: schema version 9, expected 1"),
        (
            "plan.json",
            '{"schema_version": 1, "step_s": 1, "robots": [{"name": "x", "visits": []}]}',
            "plan",
            "robot 'robot_0' is not in both",
        ),
        (
            "plan.json",
            '{"schema_version": 1, "step_s": 1, "robots": [{"name": "x", "visits": '
            '[{"vertex": 0, "arrive_s": 0, "depart_s": 1, "arrive_step": 0, "depart_step": 1' + "0" * 400 + "}]}]}",
            "plan",
            r"visits\[0\] has the arrive_step and depart_step .*, expected numbers of steps",
        ),
        ("events.jsonl", '{"t_s": 1}\nnonsense\n', "events", r"events\.jsonl:2: not JSON"),
        ("events.jsonl", '{"t_s": 99999999999999999999}\n', "events", r"events\.jsonl:1: t_s is 99999999999999999999, expected a time"),
        ("events.jsonl", '{"t_s": 1, "duration_s": -1}\n', "events", r"events\.jsonl:1: duration_s is -1, expected 0 s or more"),
        ("events.jsonl", "[1]\n", "execution", r"events\.jsonl:1: found '\[1\]', expected an object"),
        ("trajectory.parquet", "nonsense", "samples", r"trajectory\.parquet: not a readable Parquet file"),
        ("trajectory.parquet", None, "record", r"trajectory\.parquet: lost, the run wrote it"),
        ("plan.json", None, "plan", r"plan\.json: lost, the run wrote it"),
        ("visits.parquet", None, "record", r"visits\.parquet: no such file or directory"),
        ("map.yaml", "]", "record", r"map\.yaml: no map of walls"),
        ("map.yaml", "{image: map.png, origin: [0, L1], resolution: 1}", "record", r"map\.yaml: no map of walls: could not convert"),
        ("map.yaml", "{image: map.png, origin: [0, 0], resolution: .nan}", "record", r"map\.yaml: no map of walls: origin 0, 0 m and"),
    ],
)
def test_damaged_files_are_named(run, tmp_path, name, content, reading, line):
    shutil.copytree(run.folder, tmp_path / "run", ignore=shutil.ignore_patterns("bag"))
    if content is None:
        (tmp_path / "run" / name).unlink()
    else:
        (tmp_path / "run" / name).write_text(content)
    with pytest.raises(MrpSumoError, match=line):
        getattr(load_run(tmp_path / "run"), reading)


def test_lane_that_no_building_has_is_damage(run, tmp_path):
    shutil.copytree(run.folder, tmp_path / "run", ignore=shutil.ignore_patterns("bag"))
    floor = json.loads((run.folder / "floor.json").read_text())
    floor["plan_graph"]["xy"][0][0] = 2.0**31
    (tmp_path / "run" / "floor.json").write_text(json.dumps(floor))
    with pytest.raises(MrpSumoError, match=r"damaged, .*: a lane of 2\.147\d*e\+09 m, expected less than 1e\+06 m"):
        _ = load_run(tmp_path / "run").graph


def test_time_that_is_no_number_is_damage(run):
    with pytest.raises(MrpSumoError, match=r"damaged, or of another version: TypeError"):
        _ = RunFolder(run.folder, run.result | {"metrics": run.metrics | {"sim_time_s": None}}).execution


def test_result_of_another_schema_is_refused_with_who_wrote_it(tmp_path):
    document = {"schema_version": 9, "status": "completed", "scenario": {}, "metrics": {}, "versions": {"mrp_sumo": "7.1"}}
    (tmp_path / "result.json").write_text(json.dumps(document))
    with pytest.raises(MrpSumoError, match=r"result.json: schema version 9, written by mrp_sumo 7.1, expected 1"):
        load_run(tmp_path)


@pytest.mark.parametrize(("key", "value"), [("scenario.name", float("inf")), ("seed", "1"), ("metrics", [])])
def test_result_with_another_type_is_refused_by_its_key(tmp_path, key, value):
    document = {"status": "completed", "seed": 1, "scenario": {"name": "a"}, "metrics": {}}
    first, _, last = key.rpartition(".")
    (document[first] if first else document)[last] = value
    (tmp_path / "result.json").write_text(json.dumps(document))
    with pytest.raises(MrpSumoError, match=rf"result.json: {key}: found {type(value).__name__}, expected"):
        load_run(tmp_path)


def test_replan_from_a_visit_that_a_robot_does_not_have_is_refused(run):
    again = RunFolder(run.folder, run.result)
    ends = np.diff(again.plan.first)[:1]
    for since, count, fits in ((ends - 1, 2, True), (ends, 2, False)):
        reply = SimpleNamespace(t_s=3.0, robot=np.array([0]), since=since, first=np.array([0, count]))
        if fits:
            assert num_visits(again, (reply,))[0] == ends[0] + 2
        else:
            with pytest.raises(MrpSumoError, match=r"replans\.parquet: at 3 s a robot goes on from a visit that it does not have"):
                num_visits(again, (reply,))
