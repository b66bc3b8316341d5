import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import mrp_sumo as ms
from mrp_sumo.calibration.prediction import _note_standstills
from mrp_sumo.calibration.reading import read_fleet
from mrp_sumo.cli.main import main
from mrp_sumo.core.robot_states import IDLE
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.run import carry_out
from mrp_sumo.io.scenario.robots import robot_type

ROBOT = "{length_m: 0.5, width_m: 0.45, max_speed_mps: %s, accel_mps2: 0.6, decel_mps2: 0.8, turn_rate_rad_s: 1.0, gap_m: 0.05}"
SITE = """map: warehouse
discretisation: {kind: roadmap, cell_m: 1.5, clearance: ignore}
robots: {count: 3, type: %s}
planner: lacam
seed: %d
tasks:
  groups: {a: [pick_a1, pick_b1, pick_c1], b: [packing_1, dock_2]}
  streams: [{arrivals: {rate_per_h: 80}, stops: [a, b], service: [{constant_s: %d}]}]
execution: {engine: kinematic, time_limit_s: 1500}
record: {bag: false}
"""


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    (folder / "truth.yaml").write_text(SITE % (ROBOT % 1.3, 5, 12))
    (folder / "guess.yaml").write_text(SITE % (ROBOT % 0.7, 1, 60))
    assert main(["run", str(folder / "truth.yaml"), "--out", str(folder / "log")]) == 0
    return folder


def test_later_half_of_a_log_is_predicted_from_the_earlier_one(site, capsys):
    guess, out = str(site / "guess.yaml"), site / "prediction"
    assert main(["predict", guess, "--log", str(site / "log"), "--hold-out", "50%", "--runs", "3", "--out", str(out), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    figures = document["figures"]
    assert figures["lead_time_p50_s"]["predicted"] == pytest.approx(figures["lead_time_p50_s"]["logged"], rel=0.05)
    assert figures["throughput_per_h"]["predicted"] == pytest.approx(figures["throughput_per_h"]["logged"], rel=0.06)
    assert figures["robots_busy_share"]["error"] == pytest.approx(
        figures["robots_busy_share"]["predicted"] / figures["robots_busy_share"]["logged"] - 1, abs=1e-4
    )
    assert document["cut_s"] == 750
    assert robot_type("custom.yaml", out, out).max_speed_mps == pytest.approx(1.3, rel=0.02)
    assert "Side by side" in (out / "prediction.html").read_text()
    assert main(["replay", str(out / "log"), str(out / "simulation"), "--out", str(site / "both.html")]) == 0
    assert main(["predict", guess, "--log", str(site / "log"), "--out", str(site / "log")]) == 2
    assert "exists and is no earlier prediction" in capsys.readouterr().err


def test_robot_without_an_order_waits_for_one(site):
    execution, log = ms.load_run(site / "log").execution, read_fleet(site / "log")
    states = execution.robot_states
    waits = [np.array(rows)[:, [0, 4]] for rows in log.poses.values()]
    idle = [k for k in np.flatnonzero(states.state == IDLE) if states.end_s[k] - states.begin_s[k] > 1]
    works = [(stop_robot, t) for stop_robot, t in zip(execution.stops.robot, execution.stops.begin_s + 0.5) if t < execution.t_s[-1]]
    assert idle and all(np.interp((states.begin_s[k] + states.end_s[k]) / 2, *waits[states.robot[k]].T) == 1 for k in idle)
    assert works and all(np.interp(t, *waits[r].T) == 0 for r, t in works)


@pytest.mark.slow
def test_messages_of_the_fleet_with_orders_of_a_file(site, capsys):
    assert main(["export", str(site / "log"), "--vda5050", "--out", str(site / "vda")]) == 0
    tasks = ms.load_run(site / "log").execution
    rows = [f"{t:.3f},{name}" for t, name in zip(tasks.tasks.released_s.tolist(), tasks.tasks.name)]
    stops = {name: [] for name in tasks.tasks.name}
    for task, station in zip(tasks.stops.task.tolist(), tasks.stops.station):
        stops[tasks.tasks.name[task]].append(station)
    lines = [f"{row},{' '.join(stops[row.split(',')[1]])}" for row in rows if len(stops[row.split(",")[1]]) == 2]
    (site / "orders.csv").write_text("\n".join(["release_s,name,stops", *lines]))
    line = [
        "predict",
        str(site / "guess.yaml"),
        "--log",
        str(site / "vda" / "messages.jsonl"),
        "--runs",
        "3",
        "--out",
        str(site / "p2"),
        "--json",
    ]
    capsys.readouterr()
    assert main([*line, "--orders", str(site / "orders.csv")]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["kind"] == "VDA 5050"
    figure = document["figures"]["lead_time_p50_s"]
    assert figure["predicted"] == pytest.approx(figure["logged"], rel=0.06)
    (site / "wrong.csv").write_text("release_s,stops\n800,pick_a1 packng_1\n")
    assert main(["predict", str(site / "guess.yaml"), "--log", str(site / "log"), "--orders", str(site / "wrong.csv")]) == 2
    assert "wrong.csv:2: 'packng_1' is no station or vertex of the scenario (did you mean 'packing_1'?)" in capsys.readouterr().err


@pytest.mark.slow
def test_simulations_that_stand_still_are_not_counted_and_said(site, capsys, monkeypatch):
    runs = []

    def carried_out(file, maps):
        runs.append(runs[0] if runs else carry_out(file, maps))
        return replace(runs[0], **({"status": "stalled", "note": "all stand"} if len(runs) == 3 else {}))

    monkeypatch.setattr("mrp_sumo.calibration.prediction.carry_out", carried_out)
    line = ["predict", str(site / "guess.yaml"), "--log", str(site / "log"), "--runs", "3", "--out", str(site / "p3"), "--json"]
    assert main(line) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["runs"] == 2
    assert any(note.startswith("1 of 3 simulations came to a standstill (all stand)") for note in document["notes"])


def test_prediction_of_simulations_that_all_stand_still_is_refused():
    with pytest.raises(MrpSumoError, match=r"log: 3 of 3 simulations came to a standstill \(all stand\), expected some that do not"):
        _note_standstills(SimpleNamespace(log=SimpleNamespace(source="log"), notes=[]), ["all stand"] * 3, 3, False)


@pytest.mark.parametrize(
    "words, line",
    [
        (["--hold-out", "1"], "--hold-out: found '1', expected a share from 0.05 to 0.95, such as 0.5 or 50%"),
        (["--hold-out", "96%"], "--hold-out: found '96%', expected a share"),
        (["--hold-out", "0,5"], "--hold-out: found '0,5', expected a share"),
        (["--runs", "1"], "--runs: found 1, expected 3 to 1000"),
        (["--log", "nowhere.jsonl"], "nowhere.jsonl: no such log"),
    ],
)
def test_bad_line_is_refused(words, line, capsys, tmp_path):
    assert main(["predict", "warehouse_lifelong", "--log", str(tmp_path), "--out", str(tmp_path / "p"), *words]) == 2
    assert line in capsys.readouterr().err
    assert not Path(tmp_path / "p").exists()
