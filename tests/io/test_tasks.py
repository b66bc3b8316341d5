"""The `tasks:` of a scenario become streams of tasks; what is wrong is one line with its place."""

import json
from contextlib import nullcontext

import numpy as np
import pyarrow.parquet as pq
import pytest
from pydantic import ValidationError

from mrp_sumo.cli.main import main
from mrp_sumo.core.battery import Charging
from mrp_sumo.core.task import NOBODY, log_of_times
from mrp_sumo.errors import OptionError, ScenarioError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.staging.set_up import set_up
from mrp_sumo.io.scenario.read import read_scenario
from mrp_sumo.io.scenario.tasks import TasksChoice
from mrp_sumo.io.tasks import TaskNames, sources_of
from mrp_sumo.io.tasks_table import read_tasks, write_tasks

VERTICES = {"a": 0, "b": 1, "c": 2, "d": 3}
STREAM = {"arrivals": {"at_once": True}, "count": 20, "stops": ["pick", "pack"]}
GROUPS = {"groups": {"pick": ["a", "b"]}, "stations": {"pack": {"places": ["c", "d"]}}}


def at(*place):
    return "s.yaml: " + ".".join(map(str, place))


def tasks_of(choice, folder=None):
    return list(source_of(choice, folder).tasks())


def source_of(choice, folder=None, names=VERTICES):
    cells = np.array([[1, 0, 1], [1, 1, 1]], np.bool_)  # v0 to v2 below, v3 and v4 above
    site = TaskNames(names.get, list(names), at, folder, lambda: cells, ("cart", "cart", "lift"), ("robot_0", "robot_1", "robot_2"))
    (source,) = sources_of(TasksChoice.model_validate(choice), site, 0, 3.0, 3)
    return source


def test_a_list_is_by_release():
    first, second = tasks_of([{"stops": ["a", "b"], "release_s": 9}, {"name": "x", "stops": ["c"], "service_s": 4, "due_s": 60}])
    assert (first.name, first.stops[0].places, first.stops[0].service_s, first.due_s) == ("x", (2,), 4, 60)
    assert [stop.places for stop in second.stops] == [(0,), (1,)] and second.release_s == 9


def test_a_type_of_robot_that_nobody_is_of_is_refused(tmp_path):
    with pytest.raises(
        ScenarioError,
        match=r"s.yaml: tasks.list.0.robot_type: no robot is of type 'lft', the fleet's are 'cart', 'lift' \(did you mean 'lift'\?\)",
    ):
        tasks_of([{"stops": ["a"], "robot_type": "lft"}])
    (tmp_path / "orders.csv").write_text("release_s,stops,robot_type\n5,a c,lift\n0,b,\n")
    assert [task.robot_type for task in tasks_of("orders.csv", tmp_path)] == ["", "lift"]
    assert {task.robot_type for task in tasks_of({**GROUPS, "streams": [{**STREAM, "robot_type": "cart"}]})} == {"cart"}


def test_a_task_may_be_for_one_robot_which_has_to_be_there(tmp_path):
    assert [task.robot for task in tasks_of([{"stops": ["a"], "robot": "robot_1"}, {"stops": ["b"]}])] == [1, NOBODY]
    assert {task.robot for task in tasks_of({**GROUPS, "streams": [{**STREAM, "robot": "robot_2", "robot_type": "lift"}]})} == {2}
    (tmp_path / "orders.csv").write_text("release_s,stops,robot\n5,a c,robot_0\n0,b,\n")
    assert [task.robot for task in tasks_of("orders.csv", tmp_path)] == [NOBODY, 0]
    with pytest.raises(ScenarioError, match=r"s.yaml: tasks.list.0.robot: no robot is called 'robt_1' \(did you mean 'robot_1'\?\)"):
        tasks_of([{"stops": ["a"], "robot": "robt_1"}])
    with pytest.raises(ScenarioError, match=r"s.yaml: tasks.streams.0.robot: robot_0 is of type 'cart', the order needs 'lift'"):
        tasks_of({**GROUPS, "streams": [{**STREAM, "robot": "robot_0", "robot_type": "lift"}]})


def test_a_file_has_a_task_in_each_row(tmp_path):
    (tmp_path / "orders.csv").write_text("release_s,stops,name,priority\n5,a c,one,2\n0,b,,\n")
    outcome = tasks_of("orders.csv", tmp_path)
    assert [(task.name, task.release_s, task.priority, len(task.stops)) for task in outcome] == [("task_1", 0, 0, 1), ("one", 5, 2, 2)]


def test_a_row_has_a_service_time_for_every_stop_or_one_for_each(tmp_path):
    (tmp_path / "orders.csv").write_text("release_s,stops,service_s\n0,a c,2 3.5\n1,a c,4\n2,a c,\n")
    assert [[stop.service_s for stop in task.stops] for task in tasks_of("orders.csv", tmp_path)] == [[2, 3.5], [4, 4], [0, 0]]


def test_a_stream_takes_one_of_each_group():
    outcome = tasks_of({**GROUPS, "streams": [{**STREAM, "service": [2, {"triangular_s": [1, 2, 3]}]}]})
    assert len(outcome) == 20 and {task.stops[0].vertex for task in outcome} == {0, 1}
    assert {task.stops[1].places for task in outcome} == {(2, 3)} and all(task.stops[0].service_s == 2 for task in outcome)
    assert all(1 <= task.stops[1].service_s <= 3 for task in outcome)


def test_a_matrix_weighs_ways():
    outcome = tasks_of({"streams": [{"arrivals": {"open": 2}, "count": 50, "matrix": {"a": {"b": 1, "c": 0}, "b": {"b": 7, "a": 1}}}]})
    assert {tuple(stop.vertex for stop in task.stops) for task in outcome} == {(0, 1), (1, 0)}


def test_a_matrix_may_be_between_groups():
    streams = [{"arrivals": {"open": 2}, "count": 400, "matrix": {"pick": {"pack": 3, "d": 1}}}]
    ways = [task.stops[1].places for task in tasks_of({**GROUPS, "streams": streams})]
    assert 70 < ways.count((3,)) < 130 and ways.count((2, 3)) == 400 - ways.count((3,))


def test_factors_of_a_station_and_of_its_groups_multiply_and_change_no_draw():
    plain = {**GROUPS, "streams": [{**STREAM, "service": [{"lognormal": [5, 0.4]}, {"constant_s": 8}]}]}
    changed = tasks_of({**plain, "service_factor": {"pick": 2.0, "b": 0.5, "pack": 1.25}})
    for before, after in zip(tasks_of(plain), changed, strict=True):
        assert after.stops[0].places == before.stops[0].places
        assert after.stops[0].service_s == before.stops[0].service_s * {0: 2.0, 1: 1.0}[after.stops[0].places[0]]
        assert (before.stops[1].service_s, after.stops[1].service_s) == (8.0, 10.0)
    (listed,) = tasks_of({"list": [{"stops": ["a", "c"], "service_s": 4}], "service_factor": {"a": 3}})
    assert [stop.service_s for stop in listed.stops] == [12, 4]


def test_task_requests_of_open_rmf_are_read(tmp_path):
    patrol = {"category": "patrol", "description": {"places": ["a", "b"], "rounds": 2}, "unix_millis_earliest_start_time": 7000}
    deliver = {"category": "delivery", "description": {"pickup": {"place": "c"}, "dropoff": {"place": "d"}}}
    steps = [
        {"category": "go_to_place", "description": {"waypoint": "b"}},
        {"category": "wait_for", "description": {"duration": 4000}},
        {"category": "dropoff", "description": {"place": "a", "handler": "h", "payload": []}},
    ]
    phases = [{"activity": {"category": "sequence", "description": {"activities": steps}}}]
    compose = {"category": "compose", "description": {"category": "x", "phases": phases}, "priority": {"type": "binary", "value": 1}}
    posts = [
        {"type": "dispatch_task_request", "request": {**compose, "unix_millis_earliest_start_time": 9500}},
        patrol,
        {"type": "robot_task_request", "robot": "r", "request": deliver},
    ]
    (tmp_path / "orders.json").write_text(json.dumps(posts))
    first, second, third = tasks_of("orders.json", tmp_path)
    assert [stop.vertex for stop in first.stops] == [0, 1, 0, 1] and first.release_s == 0
    assert [stop.vertex for stop in second.stops] == [2, 3] and second.release_s == 0
    assert [(stop.vertex, stop.service_s) for stop in third.stops] == [(1, 4), (0, 0)] and (third.release_s, third.priority) == (2.5, 1)
    (tmp_path / "orders.json").write_text(json.dumps({**patrol, "category": "dance"}))
    with pytest.raises(ScenarioError, match=r"orders.json: \[0\].category: found 'dance', expected patrol, delivery, clean or compose"):
        tasks_of("orders.json", tmp_path)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (
            {"description": {"places": ["a"], "rounds": 1e308}},
            r"\[0\].description.rounds: found 1e\+308, expected a number of at most 1e\+15",
        ),
        ({"description": {"places": ["a"], "rounds": 1e6}}, r"\[0\].description.rounds: found 1000000.0, expected 1 to 10000"),
        ({"labels": 5}, r"\[0\].labels: found 5, expected a list"),
        ({"priority": {"value": float("inf")}}, r"\[0\].priority.value: found inf, expected a number"),
    ],
)
def test_damaged_task_requests_are_refused(tmp_path, damage, said):
    patrol = {"category": "patrol", "description": {"places": ["a", "b"]}}
    (tmp_path / "orders.json").write_text(json.dumps({**patrol, **damage}))
    with pytest.raises(ScenarioError, match=f"orders.json: {said}"):
        tasks_of("orders.json", tmp_path)


def test_service_of_years_is_driven_to_the_time_limit(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "two.map").write_text("type octile\nheight 1\nwidth 3\nmap\n...\n")
    (tmp_path / "long.yaml").write_text(
        "map: two.map\ndiscretisation: {cell_m: 1}\nrobots: {starts: [v0]}\nexecution: {engine: kinematic, time_limit_s: 30}\n"
        "tasks:\n  streams:\n  - {arrivals: {open: 1}, stops: [v2], service: [{constant_s: 1.0e+9}]}\n"
    )
    assert main(["run", "long.yaml", "--out", "out"]) == 0
    assert json.loads((tmp_path / "out" / "result.json").read_text())["metrics"]["tasks_done"] == 0


def test_streams_without_measure_are_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "two.map").write_text("type octile\nheight 1\nwidth 3\nmap\n...\n")
    (tmp_path / "much.yaml").write_text(
        "map: two.map\nrobots: {starts: [v0]}\ntasks:\n  streams:\n  - {arrivals: {open: 100000000000}, stops: [v1]}\n"
    )
    assert main(["run", "much.yaml", "--out", "out"]) == 2
    assert "much.yaml:5: tasks.streams[0].arrivals.open: found 100000000000, expected 100000 or less" in capsys.readouterr().err


def test_tasks_of_the_league_are_a_pool_in_their_order(tmp_path):
    (tmp_path / "league.tasks").write_text("# cells\n3\n0,3\n5\n2,4\n")
    names = {f"v{k}": k for k in range(5)}
    source = source_of("league.tasks", tmp_path, names)
    assert source.num_open == 4 and [[stop.vertex for stop in task.stops] for task in source.tasks()] == [[3, 0], [2], [4, 1]]
    (tmp_path / "league.tasks").write_text("1\n0,1\n")
    with pytest.raises(ScenarioError, match=r"league.tasks:2: '1' is no free cell of the map"):
        source_of("league.tasks", tmp_path, names)


def test_a_yaml_file_has_a_list_of_tasks(tmp_path):
    (tmp_path / "orders.yaml").write_text("tasks:\n  - {stops: [a, b], service_s: [3, 1]}\n")
    (task,) = tasks_of("orders.yaml", tmp_path)
    assert [stop.service_s for stop in task.stops] == [3, 1]
    (tmp_path / "orders.yaml").write_text("tasks:\n  - {stops: [a, b], service_s: [3]}\n")
    with pytest.raises(ScenarioError, match=r"orders.yaml: \[0\]: service_s has 1 times, but there are 2 stops"):
        tasks_of("orders.yaml", tmp_path)


def test_a_task_that_no_robot_can_do_is_refused(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "two.map").write_text("type octile\nheight 1\nwidth 5\nmap\n..@..\n")
    (tmp_path / "cut.yaml").write_text(
        "map: two.map\nrobots: {starts: [v0, v2]}\nplanner: lacam\ntasks: {list: [{stops: [v1]}, {stops: [v0, v3], name: across}]}\n"
    )
    assert main(["run", "cut.yaml", "--out", "out"]) == 2
    assert "cut.yaml:4: tasks: no robot can reach 'v3' after 'v0', a stop of 'across'" in capsys.readouterr().err
    other = (tmp_path / "cut.yaml").read_text().replace("stops: [v0, v3]", "stops: [v0], robot: robot_1")
    (tmp_path / "cut.yaml").write_text(other)
    assert main(["run", "cut.yaml", "--out", "out"]) == 2
    assert "cut.yaml:4: tasks: robot_1 cannot reach 'v0', a stop of 'across'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("choice", "says"),
    [
        ([{"stops": ["a", "e"]}], "s.yaml: tasks.list.0.stops.1: 'e' is no station, group or vertex"),
        ({**GROUPS, "streams": [{**STREAM, "stops": ["pik"]}]}, r"tasks.streams.0.stops.0: 'pik' .*did you mean 'pick'"),
        ({"stations": {"x": {"places": ["q"]}}, "list": [{"stops": ["x"]}]}, "tasks.stations.x.places.0: 'q'"),
        ({"streams": [{**STREAM, "stops": ["a", "a"]}]}, "tasks.streams.0: no way leads"),
        ({"list": [{"stops": ["a"]}], "service_factor": {"pik": 2}}, "s.yaml: tasks.service_factor.pik: 'pik' is no station, group"),
        ("none.csv", "none.csv: no such file"),
        ("bad.csv", r"bad.csv:3: release_s: .*found 'soon'"),
        ("far.csv", r"far.csv:2: release_s: expected 1000000000 or less, found '1e306'"),
        ("lacks.csv", "lacks.csv:1: has no column 'stops'"),
        ("times.csv", r"times.csv:3: service_s: expected a number, found '2 x'"),
        ("many.csv", r"many.csv:2: service_s has 3 times, but there are 2 stops"),
        ("times.yaml", r"times.yaml: \[0\].service_s: expected a number, found 'x'"),
        ("name.csv", "name.csv:2: 'zz' is no station"),
    ],
)
def test_what_is_wrong_is_one_line_with_its_place(tmp_path, choice, says):
    (tmp_path / "bad.csv").write_text("release_s,stops\n1,a\nsoon,b\n")
    (tmp_path / "far.csv").write_text("release_s,stops\n1e306,a\n")
    (tmp_path / "lacks.csv").write_text("release_s\n1\n")
    (tmp_path / "name.csv").write_text("release_s,stops\n1,zz\n")
    (tmp_path / "times.csv").write_text("release_s,stops,service_s\n1,a b,2 3\n1,a b,2 x\n")
    (tmp_path / "many.csv").write_text("release_s,stops,service_s\n1,a b,2 3 4\n")
    (tmp_path / "times.yaml").write_text("tasks:\n- {stops: [a], service_s: x}\n")
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


@pytest.mark.parametrize(("policy", "minimum", "fits"), [("opportunity", 50, False), ("opportunity", 51, True), ("threshold", 50, True)])
def test_who_is_called_off_a_charger_need_not_go_back_at_once(policy, minimum, fits):
    levels = {"critical_low_charging_level": 50, "minimum_desired_charging_level": minimum}
    with nullcontext() if fits else pytest.raises(OptionError, match="with policy opportunity a minimum_desired above critical_low"):
        Charging(stations=("c",), policy=policy, **levels)


def test_the_table_keeps_what_became_of_tasks(tmp_path):
    nan = np.nan
    times = [np.array(column) for column in ([0.0, 1, 2, 3], [0.5, 2, 3, nan], [4.0, 5, nan, nan], [9.0, nan, nan, nan])]
    log = log_of_times(("a", "b", "c", "d"), np.array([1, 0, 0, -1]), *times)
    write_tasks(tmp_path, log, ("r0", "r1"))
    table = pq.read_table(tmp_path / "tasks.parquet")
    assert table.column_names == ["task", "robot", "released_s", "assigned_s", "opened_s", "done_s", "ended_s", "status", "reason"]
    assert table["robot"].to_pylist() == ["r1", "r0", "r0", None] and table["done_s"].to_pylist() == [9, None, None, None]
    assert table["status"].to_pylist() == ["done", "picked", "assigned", "released"]
    again = read_tasks(tmp_path, ("r0", "r1"))
    assert again.status == log.status and again.robot.tolist() == log.robot.tolist()


def test_a_scenario_with_tasks_is_run_from_the_command_line(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "work.yaml").write_text(
        "map: warehouse\nrobots: {starts: [pick_a1, pick_b1]}\nplanner: lacam\nrecord: {bag: false}\n"
        "tasks: {streams: [{arrivals: {open: 2}, matrix: {pick_a1: {pick_a2: 1}, pick_b1: {pick_b2: 1}}, service: [2]}]}\n"
        "execution: {time_limit_s: 120}\n"
    )
    assert main(["run", "work.yaml", "--out", "out"]) == 0
    assert "orders" in capsys.readouterr().out
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    metrics = result["metrics"]
    assert result["status"] == "completed" and metrics["tasks_done"] >= 1
    assert metrics["tasks_open"] == 2 and metrics["num_overlaps"] == 0
    assert metrics["goals_reached"] is None and metrics["makespan_s"] is None and result["robots"][0]["goal"] is None
    parts = [value for name, value in metrics.items() if name.startswith("cycle_")]
    assert sum(parts) == pytest.approx(metrics["lead_time_mean_s"])
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


@pytest.mark.parametrize(
    "rule, says",
    [
        ({"cancel": {}}, "cancels nothing: give overdue: true, after_s, or both"),
        ({"cancel": {"after_s": 0}}, "greater than 0"),
        ({"retry": {}}, "retries nothing: give times, or hand_over: true"),
        ({"retry": {"times": 1, "hand_over": True}}, "gives times and hand_over, expected one"),
    ],
)
def test_rules_that_say_nothing_are_refused(rule, says):
    with pytest.raises(ValidationError, match=says):
        TasksChoice.model_validate({"list": [{"stops": ["a"]}], **rule})


def test_rules_of_a_scenario_are_those_that_are_driven(tmp_path):
    (tmp_path / "lanes.csv").write_text("from,to,from_x_m,from_y_m,to_x_m,to_y_m,both_ways\na,b,0,0,4,0,yes\n")
    tasks = {"list": [{"name": n, "stops": ["b"], "service_s": 30} for n in "xy"], "cancel": {"after_s": 20}}
    document = {"map": "lanes.csv", "robots": {"count": 1, "starts": ["a"]}, "planner": "lacam", "tasks": tasks, "record": {"bag": False}}
    document |= {"discretisation": {"kind": "roadmap", "cell_m": 1.0}, "execution": {"engine": "kinematic", "time_limit_s": 100}}
    (tmp_path / "s.yaml").write_text(json.dumps(document))
    assert main(["run", str(tmp_path / "s.yaml"), "--out", str(tmp_path / "run")]) == 0
    table = pq.read_table(tmp_path / "run" / "tasks.parquet").to_pylist()
    assert [(row["task"], row["status"]) for row in table] == [("x", "done"), ("y", "cancelled")] and table[1]["ended_s"] == 20.0


def test_orders_are_due_after_their_release(tmp_path):
    with pytest.raises(ValidationError, match="due_s is 5, before release_s, 9"):
        TasksChoice.model_validate([{"stops": ["a"], "release_s": 9, "due_s": 5}])
    (tmp_path / "orders.csv").write_text("release_s,stops,due_s\n5,a,5\n9,b,5\n")
    with pytest.raises(ScenarioError, match=r"orders.csv:3: due_s is 5, before release_s, 9$"):
        tasks_of("orders.csv", tmp_path)


def test_two_orders_of_one_name_are_refused(tmp_path):
    with pytest.raises(ScenarioError, match=r"^s.yaml: tasks.list.1: the order at s.yaml: tasks.list.0 is called 'x', too$"):
        tasks_of([{"name": "x", "stops": ["a"]}, {"name": "x", "stops": ["b"]}])
    (tmp_path / "orders.csv").write_text("release_s,stops,name\n5,a,x\n9,b,\n9,b,x\n")
    with pytest.raises(ScenarioError, match=r"orders.csv:4: the order at .*orders.csv:2 is called 'x', too$"):
        tasks_of("orders.csv", tmp_path)
    with pytest.raises(ValidationError, match="two streams are called 'x', expected names of their own"):
        TasksChoice.model_validate({"streams": [{"name": "x", "arrivals": {"open": 1}, "stops": ["a"]}] * 2})


def test_orders_without_names_have_names_of_their_own(tmp_path):
    (tmp_path / "orders.csv").write_text("release_s,stops\n5,a\n9,b\n")
    site = TaskNames(VERTICES.get, list(VERTICES), at, tmp_path, lambda: None, ("cart",))
    stream = {"arrivals": {"at_once": True}, "count": 2, "stops": ["a"]}
    choice = {"list": [{"stops": ["a"]}], "file": "orders.csv", "streams": [stream, stream]}
    names = [task.name for source in sources_of(TasksChoice.model_validate(choice), site, 0, 3.0, 1) for task in source.tasks()]
    assert names == ["task_0", "task_1", "task_2", "task_1_0", "task_1_1", "task_2_0", "task_2_1"]


@pytest.mark.parametrize("last, both_ways, says", [("c", "no", True), ("b", "no", False), ("c", "yes", False)])
def test_a_last_stop_without_a_way_back_and_late_orders_are_said(tmp_path, last, both_ways, says):
    rows = "from,to,from_x_m,from_y_m,to_x_m,to_y_m,both_ways\na,b,0,0,4,0,yes\n" + f"b,c,4,0,8,0,{both_ways}\n"
    (tmp_path / "lanes.csv").write_text(rows)
    tasks = [{"name": "o", "stops": ["a", last]}, {"name": "late", "stops": ["a"], "release_s": 0 if says else 100}]
    document = {"map": "lanes.csv", "robots": {"count": 1, "starts": ["a"]}, "planner": "lacam", "tasks": tasks, "record": {"bag": False}}
    document |= {"discretisation": {"kind": "roadmap", "cell_m": 1.0}, "execution": {"engine": "kinematic", "time_limit_s": 100}}
    (tmp_path / "s.yaml").write_text(json.dumps(document))
    with MapCache() as maps:
        notes = set_up(read_scenario(tmp_path / "s.yaml"), maps).notes
    stays = "no way leads from 'c', the last stop of 'o', to where an order begins: a robot stays there for good"
    late = "1 of 2 orders are released after the run's end at 100 s, the first is 'late' at 100 s"
    assert notes == ((stays,) if says else (late,))
