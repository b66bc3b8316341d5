"""The operations audit judges a folder as it judged the run, and finds each table that was changed by hand."""

import json

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from floors import BATTERY, ring, scenario, written

from mrp_sumo.cli.main import main
from mrp_sumo.experiments.audit_work import logs_in
from mrp_sumo.io.run_reader import load_run
from mrp_sumo.metrics.operations.audit import operations_audit


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run with orders, charging, and a robot that breaks down for good with a load on board."""
    tasks = {
        "streams": [{"name": "o", "stops": ["A", "B"], "service": [5, 3], "arrivals": {"rate_per_h": 60}}],
        "charging": {"stations": ["c3"], "critical_low_charging_level": 85, "minimum_desired_charging_level": 90},
    }
    place = tmp_path_factory.mktemp("ring")
    what = {"time_limit_s": 300.0, "disturbances": {"breakdowns": [{"robot": 0, "begin_s": 40.0, "duration_s": 20.0}]}}
    file = scenario(ring(place), tasks, starts=["c4", "c2"], shape={"battery": BATTERY}, execution=what)
    return written(file, place / "run")


def copied(folder, out):
    out.mkdir()
    for path in folder.iterdir():
        (out / path.name).write_bytes(path.read_bytes())
    return out


def change(path, column, row, by):
    """One cell of a table changed: a number by another, a text by another."""
    table = pq.read_table(path)
    rest = table.schema.metadata
    cells = table[column].to_pylist()
    cells[row] = by(cells[row])
    kind = table[column].type
    new = pa.array(cells, kind.value_type if pa.types.is_dictionary(kind) else kind)
    table = table.set_column(table.column_names.index(column), column, new.dictionary_encode() if pa.types.is_dictionary(kind) else new)
    pq.write_table(table.replace_schema_metadata(rest), path)


def test_the_folder_is_judged_as_the_run_was(folder, capsys):
    result = json.loads((folder / "result.json").read_text())
    assert result["status"] == "completed" and result["operations_audit"] == {"passed": True, "findings": []}
    assert operations_audit(logs_in(load_run(folder))) == result["operations_audit"]
    assert main(["analyze", str(folder), "--audit"]) == 0
    assert "operations audit passed" in capsys.readouterr().out


def first(folder, table, column, wanted):
    """The first row of a table whose cell is wanted."""
    return next(k for k, value in enumerate(pq.read_table(folder / table)[column].to_pylist()) if wanted(value))


@pytest.mark.parametrize(
    ("table", "column", "wanted", "by", "rule"),
    [
        ("tasks.parquet", "done_s", lambda t: t is not None, lambda t: t - 2.0, "loads"),
        ("tasks.parquet", "status", lambda s: s == "done", lambda s: "picked", "one state"),
        ("tasks.parquet", "released_s", lambda t: t > 0, lambda t: t + 0.5, "released once"),
        ("charges.parquet", "opened_s", lambda t: t is not None, lambda t: t - 2.0, "loads"),
        ("stops.parquet", "begin_s", lambda t: t > 0, lambda t: t - 1.5, "service"),
        ("stops.parquet", "station", lambda s: s == "A", lambda s: "B", "stops in order"),
        ("trajectory.parquet", "x_m", lambda x: True, lambda x: x + 3.0, "visits"),
        ("trajectory.parquet", "speed_mps", lambda v: True, lambda v: v + 9.0, "bodies"),
        ("visits.parquet", "arrived_s", lambda t: t is not None, lambda t: t + 150.0, "visits"),
        ("replans.parquet", "arrived_s", lambda t: t is not None, lambda t: t + 30.0, "visits"),
        ("battery.parquet", "battery_percent", lambda p: p < 95, lambda p: p + 1.0, "batteries"),
        ("robot_states.parquet", "end_s", lambda t: t > 20, lambda t: t - 5.0, "states"),
        ("robot_states.parquet", "state", lambda s: s == "working", lambda s: "idle", "states"),
    ],
)
def test_a_cell_that_was_changed_by_hand(folder, tmp_path, capsys, table, column, wanted, by, rule):
    other = copied(folder, tmp_path / "run")
    change(other / table, column, first(folder, table, column, wanted), by)
    assert main(["analyze", str(other), "--audit", "--json"]) == 1
    outcome = json.loads(capsys.readouterr().out)
    assert not outcome["passed"] and rule in {finding["rule"] for finding in outcome["findings"]}
    assert all(set(finding) == {"rule", "t_s", "text", "robot", "place", "order"} for finding in outcome["findings"])


def test_bad_input_is_one_line(folder, tmp_path, capsys):
    other = copied(folder, tmp_path / "run")
    (other / "stops.parquet").unlink()
    for arguments, line in (
        ([str(other), "--audit"], "stops.parquet: lost, the run wrote it"),
        ([str(tmp_path / "nowhere"), "--audit"], "no such folder"),
        ([str(folder), "--audit", "--metric", "tasks_done"], "--audit and --metric: expected one of them"),
    ):
        assert main(["analyze", *arguments]) == 2
        text = capsys.readouterr().err
        assert line in text and text.count("\n") == 1
    (other / "stops.parquet").write_bytes((folder / "stops.parquet").read_bytes())
    change(other / "stops.parquet", "robot", 0, lambda name: "robot_7")
    assert main(["analyze", str(other), "--audit"]) == 2
    assert "robot_7" in capsys.readouterr().err
    assert np.isfinite(load_run(folder).metrics["tasks_done"])


def test_run_without_tasks_has_its_bodies_judged(tmp_path, capsys):
    file = scenario(ring(tmp_path), None, robots=2, execution={"time_limit_s": 60.0})
    place = written(file, tmp_path / "run")
    assert main(["analyze", str(place), "--audit"]) == 0
    assert "audit of bodies passed, a run without orders" in capsys.readouterr().out
    change(place / "trajectory.parquet", "x_m", 0, lambda x: x + 9.0)
    assert main(["analyze", str(place), "--audit"]) == 1
    assert "bodies: robot_0" in capsys.readouterr().out
