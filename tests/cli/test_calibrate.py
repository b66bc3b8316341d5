import errno
import json
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest
from shuttles import shuttle_rows, write_csv

from mrp_sumo.cli.main import main
from mrp_sumo.io.scenario.read import read_scenario
from mrp_sumo.io.scenario.robots import robot_type


@pytest.fixture(scope="module")
def poses(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "poses.csv"
    rng = np.random.default_rng(7)
    write_csv(path, {f"s{k}": shuttle_rows(rng, trips=25) for k in range(3)})
    return path


def test_scenario_takes_what_is_written(poses, tmp_path, capsys, monkeypatch):
    assert main(["calibrate", str(poses), "--out", str(tmp_path / "mine.yaml"), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert [Path(name).name for name in document["files"]] == ["mine.yaml", "mine.disturbances.yaml", "mine.png"]
    made = robot_type("mine.yaml", tmp_path, tmp_path)
    assert made.accel_mps2 == pytest.approx(document["quantities"]["accel_mps2"]["value"], rel=1e-3)
    assert made.intervals["accel_mps2"][0] < made.accel_mps2 < made.intervals["accel_mps2"][1]
    (tmp_path / "s.yaml").write_text(
        "map: office\nrobots: {count: 2, type: ./mine.yaml}\nexecution: {disturbances: {name: ./mine.disturbances.yaml, latency_s: 0.2}}\n"
    )
    what = read_scenario(tmp_path / "s.yaml").scenario.execution.disturbances
    assert what.speed_noise == pytest.approx(document["quantities"]["speed_noise"]["value"], rel=1e-3)
    assert what.latency_s == 0.2
    assert main(["calibrate", str(poses), "--out", str(tmp_path / "mine.yaml")]) == 2
    assert "is there already" in capsys.readouterr().err
    full = OSError(errno.ENOSPC, "No space left on device")  # while the last of the three is written
    monkeypatch.setattr("mrp_sumo.reports.pictures.picture.Picture.write", MagicMock(side_effect=full))
    assert main(["calibrate", str(poses), "--out", str(tmp_path / "more.yaml")]) == 2
    assert capsys.readouterr().err.endswith("more.yaml: cannot be written: the disk is full\n") and not [*tmp_path.glob("more*")]
    assert main(["calibrate", "no.csv", "--out", str(tmp_path / "none" / "mine.yaml")]) == 2
    assert "none: no such folder" in capsys.readouterr().err  # before anything is read


@pytest.mark.slow
def test_log_drifts_from_what_another_fleet_was_like(poses, tmp_path, capsys):
    assert main(["calibrate", str(poses), "--out", str(tmp_path / "mine.yaml")]) == 0
    assert main(["calibrate", str(poses), "--against", str(tmp_path / "mine.yaml")]) == 0
    assert "no drift: every figure fits" in capsys.readouterr().out
    rng = np.random.default_rng(8)
    write_csv(tmp_path / "worn.csv", {f"s{k}": shuttle_rows(rng, accel=0.45, trips=25) for k in range(3)})
    assert main(["calibrate", str(tmp_path / "worn.csv"), "--against", str(tmp_path / "mine.yaml"), "--json"]) == 1
    assert list(json.loads(capsys.readouterr().out)["drift"]) == ["accel_mps2"]
    assert main(["calibrate", str(poses), "--against", str(tmp_path / "mine.disturbances.yaml")]) == 2
    error = capsys.readouterr().err
    assert "found a set of disturbances, expected the robot type beside it" in error and error.count("\n") == 1


def test_log_of_another_site_is_refused(poses, capsys):
    assert main(["calibrate", str(poses), "--map", "airport"]) == 2
    assert "71% of the poses are more than 10 m from any lane of 'airport'" in capsys.readouterr().err
    far = poses.with_name("far.csv")
    far.write_text("t_s,x_m,y_m\n" + "\n".join(f"{k},{5000 + k % 50},5000" for k in range(200)))
    assert main(["calibrate", str(far), "--map", "office"]) == 2
    error = capsys.readouterr().err
    assert "100% of the poses are more than 10 m from any lane of 'office'" in error
    assert error.count("\n") == 1


def test_flaw_in_a_file_of_disturbances_has_its_line(tmp_path, capsys):
    (tmp_path / "d.yaml").write_text("speed_noise: 0.1\nspeed_nose: 0.1\n")
    (tmp_path / "s.yaml").write_text("map: office\nrobots: 2\nexecution: {disturbances: ./d.yaml}\n")
    assert main(["run", str(tmp_path / "s.yaml")]) == 2
    assert "d.yaml:2: speed_nose" in capsys.readouterr().err
