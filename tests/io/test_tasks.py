"""The `tasks:` of a scenario become streams of tasks; what is wrong is one line with its place."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from pydantic import ValidationError

from mrp_sumo.cli.main import main
from mrp_sumo.core.task import TaskLog
from mrp_sumo.errors import ScenarioError
from mrp_sumo.io.tasks import TasksChoice, sources_of
from mrp_sumo.io.tasks_table import read_tasks, write_tasks

VERTICES = {"a": 0, "b": 1, "c": 2, "d": 3}
STREAM = {"arrivals": {"at_once": True}, "count": 20, "stops": ["pick", "pack"]}
GROUPS = {"groups": {"pick": ["a", "b"]}, "stations": {"pack": {"places": ["c", "d"]}}}


def at(*place):
    return "s.yaml: " + ".".join(map(str, place))


def tasks_of(choice, folder=None):
    (source,) = sources_of(TasksChoice.model_validate(choice), VERTICES.get, list(VERTICES), at, folder, 0, 3.0)
    return list(source.tasks())


def test_a_list_is_by_release():
    first, second = tasks_of([{"stops": ["a", "b"], "release_s": 9}, {"name": "x", "stops": ["c"], "service_s": 4, "due_s": 60}])
    assert (first.name, first.stops[0].places, first.stops[0].service_s, first.due_s) == ("x", (2,), 4, 60)
    assert [stop.places for stop in second.stops] == [(0,), (1,)] and second.release_s == 9


def test_a_file_has_a_task_in_each_row(tmp_path):
    (tmp_path / "orders.csv").write_text("release_s,stops,name,priority\n5,a c,one,2\n0,b,,\n")
    found = tasks_of("orders.csv", tmp_path)
    assert [(task.name, task.release_s, task.priority, len(task.stops)) for task in found] == [("task_1", 0, 0, 1), ("one", 5, 2, 2)]


def test_a_stream_takes_one_of_each_group():
    found = tasks_of({**GROUPS, "streams": [{**STREAM, "service": [2, {"triangular_s": [1, 2, 3]}]}]})
    assert len(found) == 20 and {task.stops[0].vertex for task in found} == {0, 1}
    assert {task.stops[1].places for task in found} == {(2, 3)} and all(task.stops[0].service_s == 2 for task in found)
    assert all(1 <= task.stops[1].service_s <= 3 for task in found)


def test_a_matrix_weighs_ways():
    found = tasks_of({"streams": [{"arrivals": {"open": 2}, "count": 50, "matrix": {"a": {"b": 1, "c": 0}, "b": {"b": 7, "a": 1}}}]})
    assert {tuple(stop.vertex for stop in task.stops) for task in found} == {(0, 1), (1, 0)}


@pytest.mark.parametrize(
    ("choice", "says"),
    [
        ([{"stops": ["a", "e"]}], "s.yaml: tasks.list.0.stops.1: 'e' is no station, group or vertex"),
        ({**GROUPS, "streams": [{**STREAM, "stops": ["pik"]}]}, r"tasks.streams.0.stops.0: 'pik' .*did you mean 'pick'"),
        ({"stations": {"x": {"places": ["q"]}}, "list": [{"stops": ["x"]}]}, "tasks.stations.x.places.0: 'q'"),
        ({"streams": [{**STREAM, "stops": ["a", "a"]}]}, "tasks.streams.0: no way leads"),
        ("none.csv", "none.csv: no such file"),
        ("bad.csv", r"bad.csv:3: release_s: .*found 'soon'"),
        ("lacks.csv", "lacks.csv:1: has no column 'stops'"),
        ("name.csv", "name.csv:2: 'zz' is no station"),
    ],
)
def test_what_is_wrong_is_one_line_with_its_place(tmp_path, choice, says):
    (tmp_path / "bad.csv").write_text("release_s,stops\n1,a\nsoon,b\n")
    (tmp_path / "lacks.csv").write_text("release_s\n1\n")
    (tmp_path / "name.csv").write_text("release_s,stops\n1,zz\n")
    with pytest.raises(ScenarioError, match=says) as raised:
        tasks_of(choice, tmp_path)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("choice", "says"),
    [
        ({}, "no tasks: give list, file or streams"),
        ({"streams": [{**STREAM, "arrivals": {"open": 2, "rate_per_h": 3}}]}, "found rate_per_h, open"),
        ({"streams": [{**STREAM, "count": None}]}, "at_once need a count"),
        ({"streams": [{**STREAM, "matrix": {"a": {"b": 1}}}]}, "give stops or matrix"),
        ({"streams": [{**STREAM, "service": [{"triangular_s": [3, 2, 1]}]}]}, "ascending order"),
        ({"streams": [{**STREAM, "arrivals": {"per_step": 1.5}}]}, "a whole number, or one below 1"),
    ],
)
def test_what_contradicts_itself_is_refused(choice, says):
    with pytest.raises(ValidationError, match=says):
        TasksChoice.model_validate(choice)


def test_the_table_keeps_what_became_of_tasks(tmp_path):
    nan = np.nan
    times = [np.array(column) for column in ([0.0, 1, 2, 3], [0.5, 2, 3, nan], [4.0, 5, nan, nan], [9.0, nan, nan, nan])]
    log = TaskLog(("a", "b", "c", "d"), np.array([1, 0, 0, -1]), *times)
    write_tasks(tmp_path, log, ("r0", "r1"))
    table = pq.read_table(tmp_path / "tasks.parquet")
    assert table.column_names == ["task", "robot", "released_s", "assigned_s", "opened_s", "done_s", "state"]
    assert table["robot"].to_pylist() == ["r1", "r0", "r0", None] and table["done_s"].to_pylist() == [9, None, None, None]
    assert table["state"].to_pylist() == ["done", "open", "assigned", "revealed"]
    again = read_tasks(tmp_path, ("r0", "r1"))
    assert again.state == log.state and again.robot.tolist() == log.robot.tolist()


def test_a_scenario_with_tasks_is_run_from_the_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "work.yaml").write_text(
        "map: warehouse\nrobots: {starts: [pick_a1, pick_b1]}\nplanner: lacam\nrecord: {bag: false}\n"
        "tasks: {streams: [{arrivals: {open: 2}, matrix: {pick_a1: {pick_a2: 1}, pick_b1: {pick_b2: 1}}, service: [2]}]}\n"
        "execution: {time_limit_s: 120}\n"
    )
    assert main(["run", "work.yaml", "--out", "out"]) == 0
    assert "tasks" in capsys.readouterr().out
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    metrics = result["metrics"]
    assert result["status"] == "completed" and metrics["tasks_done"] >= 1
    assert metrics["tasks_open"] == 2 and metrics["num_overlaps"] == 0
    assert metrics["goals_reached"] is None and metrics["makespan_s"] is None and result["robots"][0]["goal"] is None
    parts = [value for name, value in metrics.items() if name.startswith("cycle_")]
    assert sum(parts) == pytest.approx(metrics["service_time_mean_s"])
    assert metrics["throughput_per_h"] == pytest.approx(metrics["tasks_done"] * 3600 / 120)
    assert pq.read_table(tmp_path / "out" / "tasks.parquet").num_rows == metrics["tasks_done"] + 2


def test_an_unknown_station_is_answered_with_file_line_and_the_nearest(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "work.yaml").write_text("map: warehouse\nrobots: 2\ntasks:\n- stops: [pick_a1]\n- stops: [pikc_a2]\n")
    assert main(["run", "work.yaml", "--out", "out"]) == 2
    said = capsys.readouterr().err
    assert (
        said.startswith("mrp-sumo: work.yaml:3: tasks.list[1].stops[0]: ") and "did you mean 'pick_a2'?" in said and said.count("\n") == 1
    )
