"""Run folders are whole or absent, strict JSON, and never replace what is not a run."""

import hashlib
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from worlds import record_of_four, run_of_four

from mrp_sumo.bags.writer import write_bag
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.formats.plan_json import read_plan
from mrp_sumo.io import logs, run_folder
from mrp_sumo.io.floor_plan import read_floor, read_walls, write_floor
from mrp_sumo.io.run_folder import check_replaceable, laid_out, plain
from mrp_sumo.io.run_reader import load_run
from mrp_sumo.io.scenario.model import ScenarioModel


def strict(path):
    def refuse(word):
        raise AssertionError(f"{word} is no JSON")

    return json.loads(path.read_text(), parse_constant=refuse)


def test_everything_is_there_and_listed(tmp_path):
    run_of_four(tmp_path / "run", tmp_path / "x.net.xml")
    out = tmp_path / "run"
    result = strict(out / "result.json")
    assert {"status", "scenario", "seed", "versions", "metrics", "audit", "files"} <= set(result)
    names = {p.relative_to(out).as_posix() for p in out.rglob("*") if p.is_file()}
    assert names == set(result["files"]) | {"result.json"}
    assert {
        "plan.json",
        "visits.parquet",
        "trajectory.parquet",
        "events.jsonl",
        "network.net.xml",
        "bag/bag.mcap",
        "bag/metadata.yaml",
    } <= names
    for name, about in result["files"].items():
        assert hashlib.sha256((out / name).read_bytes()).hexdigest() == about["sha256"]
    assert result["metrics"] == {"min_distance_m": 1.5, "real_time_factor": None, "time_blocked_s": [0.0, 1.0], "flag": True}
    assert {"python", "mrp_sumo", "libsumo", "numpy", "ortools", "rosbags", "numba"} <= set(result["versions"])
    assert list(tmp_path.iterdir()) == [tmp_path / "x.net.xml", out] or {p.name for p in tmp_path.iterdir()} == {"x.net.xml", "run"}


def test_bag_is_as_the_scenario_says(tmp_path):
    choice = {"storage": "sqlite3", "rmf_messages": "galactic", "robots": ["robot_2"]}
    scenario = ScenarioModel.model_validate({"name": "four", "map": "four", "robots": {"count": 4}, "record": choice})
    run_of_four(tmp_path / "run #1", tmp_path / "x.net.xml", scenario=scenario)
    assert (tmp_path / "run #1" / "bag" / "bag.db3").is_file()
    (tmp_path / "run #1").rename(tmp_path / "run")  # the library reads no sqlite3 bag below a '#'
    with AnyReader([tmp_path / "run" / "bag"]) as reader:
        assert "/robot_2/odom" in reader.topics


def test_the_bag_tells_what_robots_believe_and_the_trajectory_what_is_true(tmp_path):
    execution = record_of_four(seconds=3.0).execution
    believed = np.stack((execution.x_m + 0.25, execution.y_m - 0.5, execution.yaw_rad))
    output = {"sim_time_s": 3.0, "wall_time_s": 0.1, "cpu_time_s": 0.1}
    run_of_four(tmp_path / "run", tmp_path / "x.net.xml", execution=replace(execution, believed=believed), metrics=output)
    run = load_run(tmp_path / "run")
    assert (run.samples.x_m == execution.x_m).all() and (run.execution.y_m == execution.y_m).all()
    assert (run.believed.x_m == believed[0]).all() and (run.execution.believed == believed).all()
    with AnyReader([tmp_path / "run" / "bag"]) as reader:
        connections = [c for c in reader.connections if c.topic == "/fleet_states"]
        states = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages(connections)]
    place = states[2].robots[0].location  # at 1 s
    assert (place.x, place.y) == pytest.approx((1.25, -0.5))
    write_bag(tmp_path / "again" / "bag", run.record)
    assert (tmp_path / "again/bag/bag.mcap").read_bytes() == (tmp_path / "run/bag/bag.mcap").read_bytes()
    run_of_four(tmp_path / "sure", tmp_path / "x.net.xml")
    assert load_run(tmp_path / "sure").believed is None and not (tmp_path / "sure/believed.parquet").exists()


def test_plan_floor_and_walls_come_back(tmp_path):
    run_of_four(tmp_path / "run", tmp_path / "x.net.xml")
    record = record_of_four()
    plan = read_plan(tmp_path / "run" / "plan.json", record.fleet.robot_name)
    for name in ("first", "vertex", "arrive_s", "depart_s"):
        assert np.array_equal(getattr(plan, name), getattr(record.plan, name))
    visit = strict(tmp_path / "run" / "plan.json")["robots"][1]["visits"][2]
    assert visit == {"vertex": 10, "name": "v10", "x": 2.0, "y": 1.0, "arrive_s": 2.0, "depart_s": 2.0}
    graph, fleet, nav = read_floor(tmp_path / "run" / "floor.json")
    for name in ("xy", "tail", "head", "length_m", "reverse", "vertex_of_station"):
        assert np.array_equal(getattr(graph, name), getattr(record.graph, name)), name
    assert graph.vertex_name == record.graph.vertex_name and (graph.kind, graph.cell_m) == ("grid", 1.0)
    assert fleet.robot_name == record.fleet.robot_name and np.array_equal(fleet.gap_m, record.fleet.gap_m)
    assert nav is not None and np.array_equal(nav.xy, record.nav.xy)
    walls = read_walls(tmp_path / "run")
    assert walls is not None and np.array_equal(walls.occupied, record.costmap.occupied)
    assert walls.origin_m == record.costmap.origin_m and walls.resolution_m == record.costmap.resolution_m


def test_curves_of_lanes_come_back(tmp_path):
    record, arc = record_of_four(), np.array([[0.0, 0.0, 0.0, 0.0], [0.7, 0.6, 0.2, 0.6], [1.4, 1.0, 1.0, 1.5]])
    lane = int(record.graph.tail[0]), int(record.graph.head[0])
    write_floor(tmp_path / "floor.json", replace(record.graph, curves={lane: arc}), record.fleet, None)
    (back,) = read_floor(tmp_path / "floor.json")[0].curves.items()
    assert back[0] == lane and np.array_equal(back[1], arc)
    write_floor(tmp_path / "floor.json", replace(record.graph, curves={(0, 0): arc}), record.fleet, None)
    with pytest.raises(ValueError, match="a curve is along no lane"):
        read_floor(tmp_path / "floor.json")
    for damaged in (arc[:1], arc[:0], arc[::-1]):
        write_floor(tmp_path / "floor.json", replace(record.graph, curves={lane: damaged}), record.fleet, None)
        with pytest.raises(ValueError, match="growing distances"):
            read_floor(tmp_path / "floor.json")


def test_a_run_without_a_plan_is_a_result_too(tmp_path):
    output = run_of_four(tmp_path / "run", tmp_path / "x.net.xml", executed=False, status="planning_timed_out")
    assert set(output["files"]) == {"floor.json", "map.png", "map.yaml", "network.net.xml"}
    assert output["plan"]["message"] == "no time" and output["audit"] is None


def test_equal_runs_give_equal_files(tmp_path):
    first = run_of_four(tmp_path / "a", tmp_path / "x.net.xml")
    second = run_of_four(tmp_path / "b", tmp_path / "x.net.xml")
    assert first == second


def test_a_run_is_replaced_and_leftovers_of_it_go(tmp_path):
    out = tmp_path / "run"
    run_of_four(out, tmp_path / "x.net.xml")
    (out / "mine.txt").write_text("made from the old run")
    run_of_four(out, tmp_path / "x.net.xml", executed=False)
    assert not (out / "mine.txt").exists() and not (out / "bag").exists()
    assert {p.name for p in tmp_path.iterdir()} == {"x.net.xml", "run"}


def test_other_folders_and_files_are_not_replaced(tmp_path):
    thesis = tmp_path / "thesis"
    thesis.mkdir()
    check_replaceable(thesis)  # empty
    check_replaceable(tmp_path / "new" / "deep")
    (thesis / "chapter_1.tex").write_text("...")
    with pytest.raises(MrpSumoError, match="thesis: is not empty and not a run folder"):
        check_replaceable(thesis)
    (thesis / "result.json").write_text("[1]")
    with pytest.raises(MrpSumoError, match="not a run folder"):
        check_replaceable(thesis)
    with pytest.raises(MrpSumoError, match="is a file"):
        check_replaceable(thesis / "chapter_1.tex")
    with pytest.raises(MrpSumoError, match=r"chapter_1\.tex is not a folder"):
        check_replaceable(thesis / "chapter_1.tex" / "run")


def test_nothing_stays_when_the_disk_is_full(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    out = tmp_path / "run"
    run_of_four(out, tmp_path / "x.net.xml")
    before = (out / "result.json").read_bytes()
    monkeypatch.setattr(logs, "write_events", full)
    with pytest.raises(MrpSumoError, match="run: cannot be written: the disk is full"):
        run_of_four(out, tmp_path / "x.net.xml")
    assert (out / "result.json").read_bytes() == before
    assert {p.name for p in tmp_path.iterdir()} == {"x.net.xml", "run"}


def test_numbers_become_plain_and_arrays_stay_in_a_line():
    value = plain({"a": np.arange(3), "b": {"c": np.nan, "d": Path("x")}, "e": [{"f": (1, 2)}, {"g": None}]})
    assert value == {"a": [0, 1, 2], "b": {"c": None, "d": "x"}, "e": [{"f": [1, 2]}, {"g": None}]}
    text = laid_out(value)
    assert json.loads(text) == value
    assert '"a": [0, 1, 2],' in text.splitlines()[1]


@pytest.mark.slow
def test_a_writer_that_is_killed_leaves_no_run_and_the_next_one_tidies_up(tmp_path):
    code = (
        "import os, sys\nsys.path.insert(0, sys.argv[2])\n"
        "from pathlib import Path\nimport worlds\nfrom mrp_sumo.io import run_folder\n"
        "run_folder.files_in = lambda folder: os._exit(9)\n"
        "folder = Path(sys.argv[1])\nworlds.run_of_four(folder / 'run', folder / 'x.net.xml')\n"
    )
    output = subprocess.run([sys.executable, "-c", code, str(tmp_path), str(Path(__file__).parents[1])], check=False)
    (left,) = tmp_path.glob(".run.new-*")
    assert output.returncode == 9 and not (tmp_path / "run").exists()
    with AnyReader([left / "bag"]) as reader:  # what was complete stays readable
        assert reader.message_count > 0
    run_of_four(tmp_path / "run", tmp_path / "x.net.xml")
    assert {p.name for p in tmp_path.iterdir()} == {"x.net.xml", "run"}


def test_a_run_whose_replacement_was_killed_half_way_is_kept(tmp_path, monkeypatch):
    run_of_four(tmp_path / "run", tmp_path / "x.net.xml")
    before = (tmp_path / "run" / "result.json").read_bytes()
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    (tmp_path / "run").rename(tmp_path / f".run.old-{process.pid}")

    def fail(*_):
        raise ZeroDivisionError

    monkeypatch.setattr(run_folder, "files_in", fail)
    with pytest.raises(ZeroDivisionError):
        run_of_four(tmp_path / "run", tmp_path / "x.net.xml")
    assert (tmp_path / "run" / "result.json").read_bytes() == before
