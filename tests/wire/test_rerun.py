"""A run written for Rerun, read by Rerun's own program."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace

import pytest

from mrp_sumo.cli.main import main
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.wire.rerun import RerunView

pytestmark = pytest.mark.skipif(find_spec("rerun") is None, reason="no rerun-sdk")


@pytest.mark.slow
def test_recording_has_floor_robots_and_figures_and_the_files_are_those_of_an_unwatched_run(tmp_path):
    run = ["run", "office_doors", "--set", "record.bag=false"]
    assert main([*run, "--rerun", str(tmp_path / "run.rrd"), "--out", str(tmp_path / "watched")]) == 0
    assert main([*run, "--out", str(tmp_path / "unwatched")]) == 0
    files = sorted(path.name for path in (tmp_path / "unwatched").iterdir() if path.name != "result.json")  # it has clock times
    assert "trajectory.parquet" in files
    assert [name for name in files if (tmp_path / "unwatched" / name).read_bytes() != (tmp_path / "watched" / name).read_bytes()] == []
    program = [sys.executable, "-m", "rerun_cli", "rrd", "print", str(tmp_path / "run.rrd")]
    said = subprocess.run(program, capture_output=True, text=True, check=True).stdout
    for path in ("/floor/walls", "/floor/lanes", "/robots", "/plans", "/figures/moving", "/events"):
        assert f"{path} " in said or f"{path}\n" in said, path


def test_rerun_that_is_not_to_be_had_is_one_line(tmp_path, capsys, monkeypatch):
    (tmp_path / "file").touch()
    cases = {
        "run.txt": "--rerun run.txt: expected a file that ends with .rrd, or rerun+http://HOST:PORT/proxy",
        "rerun+http://127.0.0.1:1/proxy": "--rerun: no viewer listens at 127.0.0.1:1; start one with `rerun`",
        str(tmp_path / "file" / "x.rrd"): f"--rerun {tmp_path / 'file' / 'x.rrd'}: {tmp_path / 'file'} is no folder",
    }
    for to, line in cases.items():
        assert main(["run", "office_5", "--rerun", to, "--out", str(tmp_path / "run")]) == 2
        assert capsys.readouterr().err.startswith(f"mrp-sumo: {line}")
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(Exception, match=r"--rerun needs rerun-sdk: pip install 'mrp-sumo\[rerun\]'"):
        RerunView("x.rrd")
    assert not Path("x.rrd").exists() and not (tmp_path / "run").exists()


def test_recording_on_a_full_disk_is_refused_in_a_line_and_none_is_left_of_a_run_that_cannot_be_written(tmp_path, capsys, monkeypatch):
    run = ["run", "office_5", "--rerun", str(tmp_path / "x.rrd"), "--out", str(tmp_path / "out")]
    monkeypatch.setattr("mrp_sumo.wire.rerun.disk_usage", lambda folder: SimpleNamespace(free=0))
    assert main(run) == 2
    assert capsys.readouterr().err == f"mrp-sumo: --rerun {tmp_path / 'x.rrd'}: the disk is full\n"
    monkeypatch.undo()

    def fail(*_, **__):
        raise MrpSumoError("cannot be written")

    monkeypatch.setattr("mrp_sumo.experiments.result.write_run", fail)
    assert main(run) == 2 and not list(tmp_path.iterdir())
