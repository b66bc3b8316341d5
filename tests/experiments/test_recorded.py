"""A recorded stream of VDA 5050 is a run like any other: our own export read back is what was driven."""

import json

import numpy as np
import pytest
from wire.worlds import driven

from mrp_sumo.cli.main import main
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.experiments.recorded import recorded_run
from mrp_sumo.io.run_reader import load_run

SMALL = RobotType("small", 0.2, 0.2, 1.0, 1.0, 1.0, 1.0, gap_m=0.1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run of two carts in `run`, its messages of both versions, and what was made of these again, `back_2.1` and `back_3.0`."""
    work = tmp_path_factory.mktemp("recorded")
    driven(work)
    for version in ("2.1", "3.0"):
        assert main(["export", str(work / "run"), "--vda5050", version, "--out", str(work / version)]) == 0
        assert main(["import", str(work / version / "messages.jsonl"), "--out", str(work / f"back_{version}")]) == 0
    return work


@pytest.mark.parametrize("version", ["2.1", "3.0"])
def test_what_was_exported_is_read_back(folder, version):
    run, back = load_run(folder / "run"), load_run(folder / f"back_{version}")
    assert back.fleet.robot_name == run.fleet.robot_name and (back.fleet.length_m == run.fleet.length_m).all()
    count = len(back.samples.t_s)
    assert 0 <= len(run.samples.t_s) - count <= 1
    for column in ("x_m", "y_m", "speed_mps"):
        assert np.abs(getattr(back.samples, column) - getattr(run.samples, column)[:count]).max() < 2e-6, column
    turned = np.exp(1j * back.samples.yaw_rad) - np.exp(1j * run.samples.yaw_rad[:count])
    assert np.abs(turned).max() < 2e-6
    assert back.audit["passed"] and back.result["status"] == "completed"
    assert back.metrics["min_distance_m"] == pytest.approx(run.metrics["min_distance_m"], abs=1e-5)
    names = {robot: [run.graph.label(v) for v in run.plan.vertex[run.plan.robot == robot]] for robot in (0, 1)}
    for robot, vertices in names.items():
        assert [back.graph.label(v) for v in back.plan.vertex[back.plan.robot == robot]] == vertices
    arrived = back.execution.arrived_s - run.execution.arrived_s
    assert np.abs(arrived).max() < 2e-3, "to a millisecond, as timestamps are"


def test_pages_are_made_of_it(folder):
    assert main(["replay", str(folder / "back_3.0"), "--out", str(folder / "replay.html")]) == 0
    assert main(["export", str(folder / "back_3.0"), "--csv", "--out", str(folder / "back.csv")]) == 0


def test_overlap_in_a_stream_is_found(folder):
    lines = (folder / "3.0" / "messages.jsonl").read_text().splitlines()
    shifted = []
    for line in lines:
        message = json.loads(line)
        place = message["payload"].get("mobileRobotPosition")
        if place and "robot_1" in message["topic"]:
            place["x"], place["y"] = 0.3, 0.1
        shifted.append(json.dumps(message))
    path = folder / "close.jsonl"
    path.write_text("\n".join(shifted))
    assert main(["import", str(path), "--out", str(folder / "close")]) == 1
    outcome = load_run(folder / "close")
    assert outcome.result["status"] == "audit_failed" and outcome.audit["num_overlaps"] >= 1


def damaged(folder, change):
    lines = (folder / "3.0" / "messages.jsonl").read_text().splitlines()
    k = next(k for k, line in enumerate(lines) if "/state" in line)
    message = json.loads(lines[k])
    change(message)
    (folder / "damaged.jsonl").write_text("\n".join([*lines[:k], json.dumps(message), *lines[k + 1 :]]))
    return folder / "damaged.jsonl", k + 1


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda m: m["payload"].update(timestamp="yesterday"), "payload.timestamp: expected YYYY-MM-DDTHH:mm:ss.fffZ"),
        (lambda m: m["payload"]["mobileRobotPosition"].update(x="left"), "payload.mobileRobotPosition.x is left, expected a number"),
        (lambda m: m["payload"].pop("lastNodeId"), "payload.lastNodeId is missing"),
        (lambda m: m.pop("payload"), "payload is missing"),
    ],
)
def test_what_is_no_message_is_a_line(folder, change, said, capsys):
    path, number = damaged(folder, change)
    assert main(["import", str(path), "--out", str(folder / "none")]) == 2
    assert capsys.readouterr().err == f"mrp-sumo: {path}:{number}: {said}\n" and not (folder / "none").exists()


@pytest.mark.parametrize("junk", [5, [3], [{"errorType": ["x"]}], {}])
def test_errors_that_are_none_are_left_out(folder, junk):
    path, _ = damaged(folder, lambda message: message["payload"].update(errors=junk))
    assert main(["import", str(path), "--out", str(folder / "odd")]) == 0


def test_streams_without_poses_and_options_of_maps_are_lines(folder, capsys):
    (folder / "empty.jsonl").write_text("\n")
    assert main(["import", str(folder / "empty.jsonl"), "--out", str(folder / "none")]) == 2
    assert "no state or visualization says where a vehicle is" in capsys.readouterr().err
    assert main(["import", str(folder / "empty.jsonl"), "--check"]) == 2
    assert "validate --vda5050" in capsys.readouterr().err
    assert main(["import", "office", "--map", "office", "--check"]) == 2
    assert "--map is for a recorded stream" in capsys.readouterr().err


def test_vehicles_keep_as_far_apart_as_their_factsheets_ask_for(folder):
    fleet = recorded_run(folder / "3.0" / "messages.jsonl", SMALL).setup.problem.fleet
    assert fleet.num_kinds == 1 and fleet.separation_m == pytest.approx(np.hypot(0.6, 0.4) + 0.1)


def say(serial, t_s, x_m, level, last, sequence):
    """A line with a state of a vehicle of version 2.1."""
    place = {"x": x_m, "y": 0.0, "theta": 0.0, "mapId": level, "positionInitialized": True}
    stamp = f"2026-01-01T00:00:{t_s:06.3f}Z"
    payload = {"timestamp": stamp, "lastNodeId": last, "lastNodeSequenceId": sequence, "orderId": "o", "agvPosition": place}
    return json.dumps({"t_s": t_s, "topic": f"uagv/v2/acme/{serial}/state", "payload": payload})


def test_levels_of_a_recording_lie_side_by_side(tmp_path):
    """Two vehicles pass each other at the same place of different levels; one of them takes a lift from the ground to the first."""
    low = [(0, 0.0, "ground", "a", 0), (4, 4.0, "ground", "lift_0", 2), (10, 4.0, "first", "lift_1", 4), (14, 8.0, "first", "b", 6)]
    high = [(0, 2.0, "first", "c", 0), (2, 1.0, "first", "d", 2), (14, 1.0, "first", "d", 2)]
    lines = [say(serial, *row) for serial, rows in (("low", low), ("high", high)) for row in rows]
    (tmp_path / "log.jsonl").write_text("\n".join(lines))
    assert main(["import", str(tmp_path / "log.jsonl"), "--robot", "amr_600", "--out", str(tmp_path / "run")]) == 0
    run = load_run(tmp_path / "run")
    names, xy = [run.graph.label(v) for v in range(run.graph.num_vertices)], run.graph.xy
    assert run.graph.level_names == ("first", "ground")
    spans = [xy[run.graph.level == k, 1] for k in (0, 1)]
    assert spans[0].min() > spans[1].max(), "no place of one level is a place of the other"
    graph = recorded_run(tmp_path / "log.jsonl", SMALL).graph
    ride = graph.lane_between(graph.vertex_name.index("lift_0"), graph.vertex_name.index("lift_1"))
    assert graph.is_ride.tolist() == [lane == ride for lane in range(graph.num_lanes)]
    low = run.fleet.robot_name.index("low")
    x = run.samples.x_m[:, low]
    on_ground = xy[names.index("lift_0"), 0] - 4.0
    assert x[20] == pytest.approx(on_ground + 2.0) and x[69] == pytest.approx(on_ground + 4.0), "below until half of the ride"
    assert x[71] == pytest.approx(xy[names.index("lift_1"), 0]) and x[120] == pytest.approx(x[71] + 2.0)
    assert run.audit["num_jumps"] == 0 and run.audit["num_overlaps"] == 0
    frame = run.trajectory
    last = frame[(frame.robot == "low") & (frame.t_s == 14.0)].iloc[0]
    assert (last.x_m, last.level) == (pytest.approx(8.0), "first"), "files have positions in the frame of their level"
