"""Stills: a run at one moment, the same bytes each time; what cannot be drawn is refused in one line."""

import shutil

import numpy as np
import pytest

from mrp_sumo.cli.main import main


def test_still_is_drawn_and_the_same_again(folder, tmp_path, capsys):
    from PIL import Image

    for name in ("a.png", "b.png"):
        assert main(["render", str(folder), "--at", "12.5", "--out", str(tmp_path / name), "--dpi", "60"]) == 0
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with Image.open(tmp_path / "a.png") as image:
        assert image.width == 720
        assert len(image.convert("RGB").getcolors(1 << 20)) > 50


def test_a_name_is_no_formula(folder, tmp_path):
    from mrp_sumo.io.logs import read_grants, write_grants
    from mrp_sumo.io.trajectory import read_trajectory, write_trajectory

    shutil.copytree(folder, tmp_path / "run")
    for path in (tmp_path / "run").glob("*.json*"):
        path.write_text(path.read_text().replace("robot_0", "$x^$"))
    path = tmp_path / "run" / "trajectory.parquet"
    samples = read_trajectory(path)
    names = ("$x^$", *samples.robot_name[1:])
    write_trajectory(path, samples, names, {})
    grants = tmp_path / "run" / "grants.parquet"
    write_grants(grants, read_grants(grants, samples.robot_name, np.full(len(samples.robot_name), 10**6)), names)
    assert main(["render", str(tmp_path / "run"), "--at", "0", "--out", str(tmp_path / "x.svg")]) == 0


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--at", "-1", "--out", "x.png"], "outside the run"),
        (["--at", "1e9", "--out", "x.png"], "outside the run"),
        (["--at", "nan", "--out", "x.png"], "outside the run"),
        (["--at", "1", "--out", "x.jpg"], "ends in .png or .svg"),
        (["--at", "1", "--out", "none/x.png"], "cannot be written"),
        (["--at", "1", "--out", "x.png", "--dpi", "0"], "expected 10 to 1200"),
        (["--at", "soon", "--out", "x.png"], "--at: found 'soon', expected a number"),
    ],
)
def test_still_that_cannot_be_drawn_is_told_in_one_line(folder, tmp_path, monkeypatch, capsys, options, told):
    monkeypatch.chdir(tmp_path)
    assert main(["render", str(folder), *options]) == 2
    said = capsys.readouterr().err
    assert told in said
    assert len(said.splitlines()) == 1
    assert not list(tmp_path.iterdir())
