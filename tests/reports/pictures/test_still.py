"""Stills: a run at one moment, the same bytes each time; what cannot be drawn is refused in one line."""

import shutil

import numpy as np
import pytest
from matplotlib.collections import LineCollection, PolyCollection

from mrp_sumo.cli.main import main
from mrp_sumo.core.bodies import bodies_of
from mrp_sumo.io.run_reader import load_run
from mrp_sumo.reports.pictures.still import still


def test_still_is_drawn_and_the_same_again(folder, tmp_path, capsys):
    from PIL import Image

    for name in ("a.png", "b.png"):
        assert main(["render", str(folder), "--at", "12.5", "--out", str(tmp_path / name), "--dpi", "60"]) == 0
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    with Image.open(tmp_path / "a.png") as image:
        assert image.width == 720
        assert len(image.convert("RGB").getcolors(1 << 20)) > 50


def outlines(run, at_s, corners):
    """Middles of the filled shapes with so many corners of a still, layer by layer from below."""
    layers = sorted(still(run, at_s).axes[0].collections, key=lambda layer: layer.get_zorder())
    paths = [[path.vertices[:-1] for path in layer.get_paths()] for layer in layers if isinstance(layer, PolyCollection)]
    return [np.array([shape.mean(axis=0) for shape in shapes]) for shapes in paths if shapes and len(shapes[0]) == corners]


def test_trailers_are_where_they_hang(trains):
    run = load_run(trains)
    bodies, at = bodies_of(run.record.execution, run.fleet), 145
    middle = np.column_stack((bodies.x_m[at], bodies.y_m[at]))
    assert any(len(result) == 4 and np.allclose(result, middle[2:], atol=1e-3) for result in outlines(run, 14.5, 4))
    assert any(len(result) == 2 and np.allclose(result, middle[:2], atol=1e-3) for result in outlines(run, 14.5, 4))


@pytest.mark.parametrize(("axle", "num_forks"), [("rear", 0), ("front", 4)])
def test_forklifts_have_forks_in_front(trains, tmp_path, axle, num_forks):
    folder = shutil.copytree(trains, tmp_path / "run")
    floor = folder / "floor.json"
    floor.write_text(floor.read_text().replace('"fixed_axle":"rear"', f'"fixed_axle":"{axle}"'))
    run = load_run(folder)
    picture, execution = still(run, 8.0), run.record.execution
    x, y, yaw = execution.x_m[80, 0], execution.y_m[80, 0], execution.yaw_rad[80, 0]
    tips = [line[1] for layer in picture.axes[0].collections if layer.get_zorder() == 5.1 for line in lines_of(layer)]
    assert len(tips) == num_forks
    for tip in tips[:2]:
        assert (tip - (x, y)) @ (np.cos(yaw), np.sin(yaw)) == pytest.approx(0.5)  # at the front of a body of 1 m


def lines_of(layer):
    return layer.get_segments() if isinstance(layer, LineCollection) else []


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
    ("options", "output"),
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
def test_still_that_cannot_be_drawn_is_told_in_one_line(folder, tmp_path, monkeypatch, capsys, options, output):
    monkeypatch.chdir(tmp_path)
    assert main(["render", str(folder), *options]) == 2
    said = capsys.readouterr().err
    assert output in said
    assert len(said.splitlines()) == 1
    assert not list(tmp_path.iterdir())
