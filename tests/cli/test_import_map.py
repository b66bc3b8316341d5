"""`mrp-sumo import`."""

import json

import pytest
import yaml

from mrp_sumo.cli.main import main

SQUARE = """
name: square
coordinate_system: cartesian_meters
levels:
  L1:
    vertices: [[0, 0, 0, a], [4, 0, 0, b], [4, 4, 0, c], [0, 4, 0, d, {is_charger: [4, true]}]]
    walls: [[0, 1, {}]]
    lanes:
      - [0, 1, {graph_idx: [2, 0], bidirectional: [4, true]}]
      - [1, 2, {graph_idx: [2, 0], bidirectional: [4, true]}]
      - [2, 3, {graph_idx: [2, 2], bidirectional: [4, true]}]
"""


@pytest.fixture
def square(tmp_path):
    path = tmp_path / "square.building.yaml"
    path.write_text(SQUARE)
    return path


def test_writes_network_nav_graph_picture_and_facts(square, tmp_path, capsys):
    out = tmp_path / "new" / "square"
    for _ in range(2):  # the second time over the first
        assert main(["import", str(square), "--out", str(out)]) == 0
    assert sorted(f.name for f in out.iterdir()) == [
        "0.nav.yaml",
        "facts.json",
        "square.net.xml",
        "square.png",
        "square.poly.xml",
        "square.svg",
    ]
    assert list(out.parent.iterdir()) == [out]
    text = capsys.readouterr().out
    assert "several graphs" in text
    assert "4.00 x 4.00 m" in text


def test_json_prints_exactly_the_key_facts_and_writes_nothing(square, tmp_path, capsys):
    assert main(["import", str(square), "--json", "--graph", "all"]) == 0
    output = json.loads(capsys.readouterr().out)
    assert set(output) == {"levels", "graphs", "vertices", "edges", "components", "extent_m", "lane_extent_m", "warnings", "grid"}
    assert (output["graphs"], output["vertices"], output["edges"], output["components"]) == ([0, 2], 5, 3, 1)
    assert output["grid"]["width"] == 11
    assert [f.name for f in tmp_path.iterdir()] == [square.name]


def test_check_reports_and_tells_refusals_by_its_exit_code(square, tmp_path, capsys):
    assert main(["import", "--check", str(square)]) == 0
    assert "warn: several graphs: graph 0: 2 lanes; graph 2: 1 lanes" in capsys.readouterr().out
    broken = tmp_path / "broken.building.yaml"
    broken.write_text("<<<<<<< HEAD\nname: x\n=======\n")
    assert main(["import", "--check", "--json", str(broken)]) == 2
    output = json.loads(capsys.readouterr().out)
    assert output["refused"]
    assert output["warnings"][0]["kind"] == "not_yaml"


def test_notes_are_told_apart_from_the_findings(square, capsys):
    square.write_text(SQUARE.replace("walls: [[0, 1, {}]]", "walls: [[0, 2, {}]]") + "      - [1, 3, {graph_idx: [2, 0]}]\n")
    assert main(["import", "--check", "--json", str(square)]) == 0
    output = json.loads(capsys.readouterr().out)
    assert "lanes_cross_without_vertex" not in [finding["kind"] for finding in output["warnings"]]
    assert output["notes"] == ["level L1: lane 3 goes through wall 0"]
    assert main(["import", "--check", str(square)]) == 0
    assert "square.building.yaml: note: level L1: lane 3 goes through wall 0" in capsys.readouterr().out


def test_frame_and_repairs_are_recorded(square, tmp_path):
    square.write_text(SQUARE + "      - [1, 3, {graph_idx: [2, 0]}]\n      - [0, 2, {graph_idx: [2, 0]}]\n")
    assert main(["import", str(square), "--split-crossings", "--out", str(tmp_path / "out")]) == 0
    facts = json.loads((tmp_path / "out" / "facts.json").read_text())
    assert (facts["origin_m"], facts["level_shift_m"]) == ([0.0, 0.0], {})
    assert facts["repairs"] == ["vertex 4 at (2.00, 2.00) joins lanes that cross there"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--json", "--graph", "1"], "square.building.yaml has no lane in graph 1; graphs with lanes: 0 (2 lanes), 2 (1 lanes)"),
        (["--json", "--level", "L7"], "square.building.yaml has no level 'L7' (known: L1)"),
        (["--json", "--graph", "x"], "'x' is neither a number nor 'all'"),
        (["--json", "--cell", "0"], "--cell: found 0, expected more than 0"),
        ([], "say where to write with --out DIR"),
        (["--out", "occupied"], "occupied exists and is no folder of an earlier import"),
    ],
)
def test_bad_requests_end_with_one_line_and_nothing_written(square, tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "occupied").mkdir()
    (tmp_path / "occupied" / "letter.txt").write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    assert main(["import", str(square), *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert sorted(tmp_path.rglob("*")) == before


def test_missing_files_name_the_nearest_bundled_map(capsys):
    assert main(["import", "ofice", "--json"]) == 2
    assert "did you mean 'office'" in capsys.readouterr().err


def test_that_there_is_no_such_map_comes_first(capsys):
    assert main(["import", "ofice"]) == 2
    assert "no map 'ofice': neither a file nor a bundled map (did you mean 'office'?)" in capsys.readouterr().err


def test_lanes_without_room_for_a_robot_are_reported(capsys):
    assert main(["import", "office", "--check"]) == 0
    assert "too close" not in capsys.readouterr().out
    assert main(["import", "office", "--check", "--robot", "forklift"]) == 0
    assert "office.building.yaml: note: 10 vertices are closer than 0.98 m to a wall, too close for 'forkl" in capsys.readouterr().out
    assert main(["import", "office", "--json", "--robot", "forklift"]) == 0
    room = json.loads(capsys.readouterr().out)["clearance"]
    assert (room["robot"], room["lanes"], room["vertices"], len(room["notes"])) == ("forklift", 0, 10, 1)
    assert main(["import", "office", "--check", "--robot", "forklif"]) == 2
    assert "'forklif' is neither a robot type nor a file (did you mean 'forklift'?)" in capsys.readouterr().err


def test_turns_without_room_for_a_vehicle_are_reported(capsys):
    assert main(["import", "office", "--check", "--robot", "pallet_truck"]) == 0
    lines = capsys.readouterr().out.splitlines()
    turn = "pallet_truck needs 1.91 m beside 'v2' to turn from 'v4' over 'v2' to 'pantry' and has 1.56 m to a wall"
    turn += " (nor has it room for 1 more turn there)"
    assert lines.count(f"office.building.yaml: note: {turn}") == 1 and len(set(lines)) == len(lines)
    assert main(["import", "office", "--check", "--robot", "forklift", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["narrow_turns"] == []


def test_keys_of_a_nav_graph_that_are_no_text_are_written_as_they_were(tmp_path):
    (tmp_path / "odd.nav.yaml").write_text(
        "1: one\nbuilding_name: odd\nlevels:\n  L1:\n    lanes:\n    - [0, 1, {1.5: true, speed_limit: 1}]\n    - [1, 0, {}]\n"
        "    vertices:\n    - [0, 0, {name: a}]\n    - [4, 0, {name: b}]\n"
    )
    assert main(["import", str(tmp_path / "odd.nav.yaml"), "--out", str(tmp_path / "out")]) == 0
    written = yaml.safe_load((tmp_path / "out" / "0.nav.yaml").read_text())
    assert written[1] == "one" and written["levels"]["L1"]["lanes"][0][2] == {1.5: True, "speed_limit": 1}
