"""Traces: what metrics are computed from later, exact to the bit, in few bytes."""

import base64
import json
from pathlib import Path

import pytest

from mrp_sumo.errors import BatchError
from mrp_sumo.experiments.identity import plug_in_hash
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.measure_later import measure_run
from mrp_sumo.experiments.worker import measure_and_trace
from mrp_sumo.io.run_folder import plain
from mrp_sumo.io.run_reader import load_run
from mrp_sumo.io.scenario.model import ScenarioModel
from mrp_sumo.io.trace import Trace, read_trace, trace_path, write_trace
from mrp_sumo.metrics.registry import METRICS

KEY = "abcd"
PLAIN = {"map": "office", "planner": "pibt", "robots": {"count": 3}, "seed": 2}
DISTURBED = {**PLAIN, "execution": {"disturbances": "nav2_like"}}
TASKS = {
    **PLAIN,
    "planner": "lacam",
    "execution": {"time_limit_s": 120},
    "robots": {"count": 3, "type": "amr_600"},
    "discretisation": {"kind": "grid", "cell_m": 1.2},
    "people": 4,
    "tasks": {
        "streams": [{"name": "order", "arrivals": {"rate_per_h": 200}, "stops": ["pantry", "lobby"], "service": [{"constant_s": 3}] * 2}]
    },
}
NO_PLAN = {**PLAIN, "planner": {"name": "cbs", "time_limit_s": 1e-6}}


def made(document):
    """The answer of a worker, and its trace."""
    scenario = ScenarioModel.model_validate({"name": "trace", **document})
    job = {
        "key": KEY,
        "scenario": scenario.model_dump_json(),
        "until": "execution",
        "folder": ".",
        "plug_ins": plug_in_hash(scenario, Path()),
    }
    with MapCache() as maps:
        answer = measure_and_trace(job, maps)
    assert answer["status"] != "bad_input", answer["reason"]
    return answer, Trace(*(base64.b64decode(part) for part in answer["trace"]))


@pytest.mark.parametrize("document", [PLAIN, DISTURBED, TASKS, NO_PLAN], ids=["plain", "disturbed", "tasks", "no plan"])
def test_metrics_computed_from_a_trace_are_those_of_the_run_to_the_bit(tmp_path, document):
    answer, trace = made(document)
    write_trace(tmp_path / "batch", KEY, trace)
    (tmp_path / "run").mkdir()
    read_trace(tmp_path / "batch", KEY, tmp_path / "run")
    later = plain(measure_run(load_run(tmp_path / "run"), METRICS))
    assert later == {metric.name: answer["metrics"][metric.name] for metric in METRICS}
    assert (document is NO_PLAN) == (later["sim_time_s"] is None)


def test_a_trace_is_small_and_equal_runs_have_equal_ones(tmp_path):
    (_, first), (_, second) = made(PLAIN), made(PLAIN)
    assert len(first.archive) < 30_000
    assert first.floor == second.floor
    folders = []
    for name, trace in (("a", first), ("b", second)):
        write_trace(tmp_path, name, trace)
        folder = tmp_path / f"run_{name}"
        folder.mkdir()
        read_trace(tmp_path, name, folder)
        folders.append(folder)
    assert len(list((tmp_path / "floors").iterdir())) == 1
    for path in folders[0].iterdir():
        if path.name != "result.json":  # clocks
            assert path.read_bytes() == (folders[1] / path.name).read_bytes(), path.name
    assert json.loads((folders[0] / "result.json").read_text())["status"] == "completed"


@pytest.mark.parametrize("change", ["cut", "flip", "floor lost", "floor changed", "lost"])
def test_a_damaged_trace_is_one_line(tmp_path, change):
    _, trace = made(PLAIN)
    write_trace(tmp_path, KEY, trace)
    path, (floor,) = trace_path(tmp_path, KEY), (tmp_path / "floors").iterdir()
    data = bytearray(path.read_bytes())
    if change == "cut":
        path.write_bytes(data[: len(data) // 2])
    elif change == "flip":
        data[len(data) // 2] ^= 1
        path.write_bytes(data)
    elif change == "lost":
        path.unlink()
    elif change == "floor lost":
        floor.unlink()
    else:
        floor.write_bytes(floor.read_bytes()[:-9])
    (tmp_path / "run").mkdir()
    with pytest.raises(BatchError) as error:
        read_trace(tmp_path, KEY, tmp_path / "run")
    assert "\n" not in str(error.value)
