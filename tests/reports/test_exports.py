"""Exports say what the record says, in other people's words."""

import csv
import json
import math
import os
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader
from worlds import record_of_four, run_of_four

from mrp_sumo.bags.writer import BagOptions, write_bag
from mrp_sumo.cli.main import main
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.reports.exports import write_csv, write_fcd, write_geojson, write_ros1, write_viewers


def test_csv_has_every_number_in_full(tmp_path):
    record = record_of_four(seconds=2.0, absent=True)
    write_csv(tmp_path / "t.csv", record)
    with (tmp_path / "t.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 21 * 4 - 20  # robot_2 comes after 20 samples
    row = next(r for r in rows if r["t_s"] == "0.3" and r["robot"] == "robot_0")
    assert float(row["x_m"]) == record.execution.x_m[3, 0] and row["state"] == "moving"


def test_csv_of_several_levels_has_positions_in_the_frames_of_their_levels(tmp_path):
    record = record_of_four(seconds=2.0)
    on = np.zeros(record.execution.x_m.shape, np.int64)
    on[10:, 1] = 1  # robot_1 has been on L2 since 1 s, which lies beside L1 by 20 m and -5 m
    graph = replace(record.graph, level_names=("L1", "L2"))
    record = replace(record, graph=graph, execution=replace(record.execution, level=on), levels={"L1": (0.0, 0.0), "L2": (20.0, -5.0)})
    write_csv(tmp_path / "t.csv", record)
    with (tmp_path / "t.csv").open() as stream:
        place = {(row["t_s"], row["robot"]): (float(row["x_m"]), float(row["y_m"]), row["level"]) for row in csv.DictReader(stream)}
    assert place["0.9", "robot_1"] == pytest.approx((0.9, 1.0, "L1")) and place["1", "robot_1"] == pytest.approx((-19.0, 6.0, "L2"))
    assert place["1", "robot_0"] == pytest.approx((1.0, 0.0, "L1"))


def test_fcd_points_north_clockwise(tmp_path):
    record = record_of_four(seconds=2.0)
    write_fcd(tmp_path / "fcd.xml", record)
    steps = ElementTree.parse(tmp_path / "fcd.xml").getroot().findall("timestep")
    assert [s.get("time") for s in steps[:2]] == ["0.00", "0.10"] and len(steps) == 21
    angles = [float(v.get("angle")) for v in steps[5].findall("vehicle")]
    assert angles == pytest.approx([90, 90 - math.degrees(0.1), 90, 0], abs=0.01)


def test_geojson_has_map_paths_and_events(tmp_path):
    write_geojson(tmp_path / "run.geojson", record_of_four())
    document = json.loads((tmp_path / "run.geojson").read_text())
    layers = [f["properties"]["layer"] for f in document["features"]]
    assert {layer: layers.count(layer) for layer in set(layers)} == {"vertex": 32, "lane": 28, "trajectory": 4, "event": 3}
    line = next(f for f in document["features"] if f["properties"].get("robot") == "robot_1" and f["properties"]["layer"] == "trajectory")
    assert len(line["geometry"]["coordinates"]) == len(line["properties"]["times_s"])
    assert 4.0 not in line["properties"]["times_s"] and {3.0, 6.0} <= set(line["properties"]["times_s"])  # it stands in between
    blocked = next(f for f in document["features"] if f["properties"].get("kind") == "blocked")
    assert blocked["geometry"]["coordinates"] == [3.0, 1.0] and blocked["properties"]["other"] == "robot_2"


def test_ros1_bag_has_the_same_messages(tmp_path, capsys):
    record = record_of_four(seconds=2.0)
    write_ros1(tmp_path / "run.bag", record, lambda folder: write_bag(folder, record, BagOptions(robots=("robot_0",))))
    with AnyReader([tmp_path / "run.bag"]) as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
        latched = {c.topic for c in reader.connections if c.ext.latching}
        poses = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages([c for c in reader.connections if c.topic == "/tf"])]
    assert counts["/tf"] == counts["/robot_cloud"] == counts["/robot_0/odom"] == 21 and counts["/fleet_states"] == 5
    assert "/rosout" not in counts and {"/map", "/tf_static", "/map_markers"} <= latched
    assert poses[10].transforms[0].transform.translation.x == record.execution.x_m[10, 0]
    assert capsys.readouterr().out == ""


def test_ros1_bag_needs_its_ending(tmp_path):
    with pytest.raises(MrpSumoError, match=r"ends in \.bag"):
        write_ros1(tmp_path / "run", record_of_four(seconds=1.0), lambda folder: None)


def test_a_place_that_is_taken_is_refused_and_a_full_disk_leaves_nothing(tmp_path, monkeypatch):
    (tmp_path / "t.csv").write_text("mine")
    with pytest.raises(MrpSumoError, match=r"t\.csv: exists already"):
        write_csv(tmp_path / "t.csv", record_of_four(seconds=1.0))

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("pathlib.Path.write_text", full)
    with pytest.raises(MrpSumoError, match="cannot be written: the disk is full"):
        write_geojson(tmp_path / "run.geojson", record_of_four(seconds=1.0))
    assert [p.name for p in tmp_path.iterdir()] == ["t.csv"]


def test_a_place_below_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("mine")
    for place in (tmp_path / "file" / "t.csv", tmp_path / "file" / "more" / "t.csv"):
        with pytest.raises(MrpSumoError, match=r"t\.csv: cannot be written"):
            write_csv(place, record_of_four(seconds=1.0))


@pytest.mark.slow
@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_bag_that_the_disk_refuses_leaves_nothing(folder, tmp_path, storage):
    """In a process of its own, which may write 5 kB a file."""
    code = (
        "import resource, sys\nfrom mrp_sumo.cli.main import main\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (5_000, 5_000))\nsys.exit(main(sys.argv[1:]))\n"
    )
    command = [sys.executable, "-c", code, "export", str(folder), "--bag", "--storage", storage, "--repeat-latched", "0.1"]
    quiet = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}  # Python would leave its own caches cut off
    output = subprocess.run([*command, "--out", str(tmp_path / "bag")], capture_output=True, text=True, check=False, env=quiet)
    assert output.returncode == 2 and f"{tmp_path / 'bag'}: cannot be written: " in output.stderr and output.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    metrics = {"sim_time_s": 3.0, "wall_time_s": 0.1, "cpu_time_s": 0.1}
    run_of_four(folder / "run", folder / "x.net.xml", metrics=metrics)
    return folder / "run"


@pytest.mark.parametrize(
    ("arguments", "made"),
    [
        (["--csv"], "trajectory.csv"),
        (["--geojson"], "run.geojson"),
        (["--fcd", "--json"], "fcd.xml"),
        (["--ros1"], "run.bag"),
        (["--viewers"], "viewers"),
        (["--bag", "--out", "OUT", "--storage", "sqlite3", "--rmf", "galactic", "--robots", "robot_0,robot_1"], "OUT"),
    ],
)
def test_command_makes_each_format_once(folder, tmp_path, capsys, arguments, made):
    arguments = [str(tmp_path / "bag") if a == "OUT" else a for a in arguments]
    path = tmp_path / "bag" if made == "OUT" else folder / made
    assert main(["export", str(folder), *arguments]) == 0
    said = json.dumps({"file": str(path)}) if "--json" in arguments else path
    assert path.exists() and capsys.readouterr().out == f"{said}\n"
    assert not [p for p in path.parent.iterdir() if p.name.startswith(".")]
    if made == "OUT":
        with AnyReader([path]) as reader:
            assert {"/robot_0/odom", "/robot_1/plan"} <= set(reader.topics)
            assert not hasattr(reader.typestore.types["rmf_fleet_msgs/msg/Location"], "approach_speed_limit")
    assert main(["export", str(folder), *arguments]) == 2
    assert "exists already" in capsys.readouterr().err


def test_metrics_of_a_bag_are_those_of_the_run(folder, capsys):
    assert main(["analyze", str(folder), "--json"]) == 0
    output = json.loads(capsys.readouterr().out)
    assert output["numGoals"] == 4 and output["messages"] == 7
    distance = np.hypot(np.diff(record_of_four(seconds=3.0).execution.x_m[::5, :2], axis=1)[:, 0], 1.0).min()
    assert output["allGoalReached"] is False and output["totalTimeForScheduleExecution"] == 300  # the scenario's time limit, from the bag
    assert output["minDistanceBetweenTwoAgents"] == pytest.approx(distance, abs=1e-6)


def test_viewer_set_ups_name_topics_of_the_bag_and_look_at_the_map(tmp_path):
    record = record_of_four(seconds=2.0)
    write_viewers(tmp_path / "viewers", record)
    write_bag(tmp_path / "bag", record)
    with AnyReader([tmp_path / "bag"]) as reader:
        topics = set(reader.topics)
    layout = json.loads((tmp_path / "viewers" / "foxglove.json").read_text())
    floor = layout["configById"]["3D!floor"]
    assert set(floor["topics"]) <= topics and floor["cameraState"]["targetOffset"] == [3.5, 1.5, 0]
    plots = [p["value"] for panel in layout["configById"].values() for p in panel.get("paths", [])]
    assert plots and {p.removesuffix(".data") for p in plots} <= topics
    rviz = yaml.safe_load((tmp_path / "viewers" / "mrp_sumo.rviz").read_text())
    shown = {d["Topic"]["Value"] for d in rviz["Visualization Manager"]["Displays"] if "Topic" in d}
    assert shown <= topics and rviz["Visualization Manager"]["Views"]["Current"]["X"] == 3.5
    docks = bytes.fromhex(rviz["Window Geometry"]["QMainWindow State"])  # names of panels, as Qt stores them
    assert all(panel["Name"].encode("utf-16-be") in docks for panel in rviz["Panels"])
    juggler = ElementTree.parse(tmp_path / "viewers" / "plotjuggler.xml")
    curves = {c.get("name").removesuffix("/data") for c in juggler.iter("curve")}
    assert curves <= topics and juggler.find("previouslyLoaded_Datafiles/fileInfo").get("filename") == "../bag/bag.mcap"
    assert [set(p.get("selected_topics").split(";")) for p in juggler.iter("parameters")] == [curves, curves]
    compile((tmp_path / "viewers" / "open_in_rerun.py").read_text(), "open_in_rerun.py", "exec")
