"""Charts of tasks, from logs whose figures are known by hand."""

from types import SimpleNamespace

import numpy as np

from mrp_sumo.core.task import CHARGE, ORDER, log_of_times
from mrp_sumo.reports.charts.task_charts import _known, task_charts
from mrp_sumo.reports.report import _task_tables


def log(released_s, done_s, kind=()):
    nan = np.full(len(released_s), np.nan)
    times = np.array(released_s, float), np.array(released_s, float) + 1, nan, np.array(done_s, float)
    return log_of_times(tuple(map(str, range(len(nan)))), np.zeros(len(nan), np.int64), *times, kind=kind)


def test_open_tasks_are_counted_from_release_to_done():
    at_s, number = _known(np.array([0.0, 10.0, 20.0]), np.array([15.0, np.nan, 99.0]), 60.0)
    assert dict(zip(at_s.tolist(), number.tolist())) == {0.0: 1, 10.0: 2, 15.0: 1, 20.0: 2, 60.0: 2}


def test_charts_say_what_they_count():
    charts = {chart.name: chart for chart in task_charts(log(range(0, 120, 10), range(60, 180, 10)), 360.0, None, "run")}
    assert set(charts) == {"run_throughput", "run_open_tasks", "run_lead_time"}
    assert charts["run_throughput"].caption == "By the hour, in 2 parts of 180 s each. Dashed: the mean, 120."
    assert "; 0 at the end" in charts["run_open_tasks"].caption and "12 orders" in charts["run_lead_time"].caption


def test_charging_is_no_task_of_anybodys_and_few_tasks_make_no_distribution():
    assert task_charts(log([0, 1], [5, 6], (CHARGE, CHARGE)), 60.0, None, "run") == []
    assert [chart.name for chart in task_charts(log([0, 1], [5, np.nan], (ORDER, CHARGE)), 60.0, None, "run")] == ["run_open_tasks"]


def test_charges_stand_in_a_table_of_their_own():
    tasks = log([0, 1, 2], [5, 6, 7], (ORDER, CHARGE, ORDER))
    run = SimpleNamespace(metrics={"tasks_done": 2}, fleet=SimpleNamespace(robot_name=("robot_0",)))
    run.record = SimpleNamespace(execution=SimpleNamespace(tasks=tasks))
    assert [(table.title, [row[0] for row in table.rows]) for table in _task_tables(run)] == [("Orders", ["0", "2"]), ("Charging", ["1"])]
    run.record.execution.tasks = log([0], [5], (ORDER,))
    assert [table.title for table in _task_tables(run)] == ["Orders"]
