"""`mrp-sumo convert`."""

import json

import pytest

from mrp_sumo.cli.main import main
from mrp_sumo.maps.load import load_map

CROSS = """
building_name: cross
levels:
  L1:
    vertices: [[-1, 0, {name: w}], [1, 0, {name: e}], [0, -1, {name: s}], [0, 1, {name: n}]]
    lanes: [[0, 1, {}], [1, 0, {}], [2, 3, {is_bidirectional: false, speed_limit: 0.4}]]
"""


@pytest.fixture
def cross(tmp_path):
    path = tmp_path / "cross.nav.yaml"
    path.write_text(CROSS)
    return path


def test_grid_of_a_nav_graph_with_what_is_lost(cross, tmp_path, capsys):
    assert main(["convert", str(cross), str(tmp_path / "cross.map"), "--cell", "0.5"]) == 0
    told = capsys.readouterr().out
    assert "lost: 1 one-way lane" in told
    assert "lost: 4 names" in told
    assert load_map(tmp_path / "cross.map").free.shape == (5, 5)


def test_repairs_are_told_and_written(cross, tmp_path, capsys):
    out = tmp_path / "fixed.nav.yaml"
    assert main(["convert", str(cross), str(out), "--split-crossings"]) == 0
    assert "repair: vertex 4 at (0.00, 0.00) joins lanes that cross there" in capsys.readouterr().err
    found = load_map(out).nav
    assert found.num_edges == 4
    assert found.speed_mps[found.lane_between(4, 3)] == 0.4


def test_bad_destinations_end_with_one_line(cross, tmp_path, capsys):
    assert main(["convert", str(cross), str(tmp_path / "cross.xyz")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
    assert [f.name for f in tmp_path.iterdir()] == ["cross.nav.yaml"]


def test_small_commands_say_as_json_what_they_did(tmp_path, capsys):
    for arguments, keys in (
        (["convert", "office", str(tmp_path / "office.map")], {"written", "lost"}),
        (["generate", "ring", "--vertices", "12", "--out", str(tmp_path / "ring.building.yaml")], {"written", "vertices", "edges"}),
        (["trust", "--list"], {"trusted"}),
        (["warmup", "astar"], {"astar"}),
    ):
        assert main([*arguments, "--json"]) == 0
        assert keys <= set(json.loads(capsys.readouterr().out))
