"""`mrp-sumo convert`."""

import json
import re
from dataclasses import replace

import pytest

from mrp_sumo.cli.main import main
from mrp_sumo.errors import ScenarioError
from mrp_sumo.io.scenario.robots import robot_type
from mrp_sumo.maps.catalogue import bundled_folder
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
    output = capsys.readouterr().out
    assert "lost: 1 one-way lane" in output
    assert "lost: 4 names" in output
    assert load_map(tmp_path / "cross.map").free.shape == (5, 5)


def test_repairs_are_told_and_written(cross, tmp_path, capsys):
    out = tmp_path / "fixed.nav.yaml"
    assert main(["convert", str(cross), str(out), "--split-crossings"]) == 0
    assert "repair: vertex 4 at (0.00, 0.00) joins lanes that cross there" in capsys.readouterr().err
    result = load_map(out).nav
    assert result.num_edges == 4
    assert result.speed_mps[result.lane_between(4, 3)] == 0.4


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


def test_vehicle_of_a_plant_model_becomes_a_type(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["convert", "plant", "plant.xml", "--robot", "pallet_truck", "--robot", "forklift"]) == 0
    capsys.readouterr()
    assert main(["convert", "plant.xml", "same.yaml"]) == 0
    assert capsys.readouterr().out == "same.yaml: written\n"
    same = robot_type("./same.yaml", tmp_path, tmp_path)
    assert replace(same, name="pallet_truck") == robot_type("pallet_truck", bundled_folder("robots"), tmp_path)
    text = (tmp_path / "plant.xml").read_text()
    (tmp_path / "other.xml").write_text(text.replace('<boundingBox length="1900"', '<boundingBox length="1950"'))
    assert main(["convert", "other.xml", "other.yaml"]) == 0
    assert robot_type("./other.yaml", tmp_path, tmp_path).length_m == 1.95
    (tmp_path / "plant.xml").write_text(re.sub('<property name="mrp-sumo:type"[^>]*>', "", text))
    capsys.readouterr()
    assert main(["convert", "plant.xml", "fork.yaml", "--vehicle-type", "forklift"]) == 0
    assert capsys.readouterr().out.startswith("fork.yaml: written\nguessed: accelerations and rate of turning")
    fork, drawn = robot_type("./fork.yaml", tmp_path, tmp_path), robot_type("forklift", bundled_folder("robots"), tmp_path)
    assert (fork.length_m, fork.width_m, fork.max_speed_mps) == (drawn.length_m, drawn.width_m, drawn.max_speed_mps)
    assert fork.gap_m == pytest.approx(drawn.gap_m, abs=2e-3)  # envelopes are in whole millimetres
    assert main(["convert", "plant.xml", "longest.yaml"]) == 0
    assert robot_type("./longest.yaml", tmp_path, tmp_path).length_m == 1.9
    assert "maxReverseVelocity, 0.5 m/s" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["plant", "x.yaml"], "plant.lif.json: has no sizes of vehicles: convert the factsheet of plant.forklift"),
        (["plant.xml", "x.yaml", "--vehicle-type", "fork"], "--vehicle-type: no vehicle 'fork' in plant.xml (did you mean 'forklift'?)"),
        (["bare.xml", "x.yaml"], "bare.xml: vehicle 'forklift' has no length or no maxVelocity, expected both"),
        (["huge.xml", "x.yaml"], "huge.xml: vehicle 'forklift': length_m is 1800, expected"),
        (["text.xml", "x.yaml"], "maxVelocity of <vehicle> is 'fast', expected a number"),
        (["envelope.xml", "x.yaml"], "<vehicleEnvelope> has no 'key'"),
        (["key.xml", "x.yaml"], "key.xml: mrp-sumo:type of vehicle 'forklift':8: sourse: unknown key (did you mean 'source'?)"),
        (["vertex.xml", "x.yaml"], "x of <vertex> is '', expected a number"),
        (["office", "x.yaml"], "x.yaml: no map format ends in '.yaml'"),
        (
            ["office", "x.geojson", "--robot", "forklift"],
            "x.geojson: has no types of vehicles, expected a name that ends in .lif.json",
        ),
        (["office", "x.xml", "--robot", "forkift"], "'forkift' is neither a robot type nor a file (did you mean 'forklift'?)"),
        (["forklift", "x.json", "--robot", "forklift"], "--robot is for maps"),
    ],
)
def test_bad_vehicles_end_with_one_line_and_leave_nothing(tmp_path, capsys, monkeypatch, arguments, line):
    monkeypatch.chdir(tmp_path)
    assert main(["convert", "plant", "plant.xml", "--robot", "forklift"]) == 0
    text = (tmp_path / "plant.xml").read_text()
    for name, old, new in (
        ("bare", '"45" maxVelocity="1500"', '"45" maxVelocity="0"'),
        ("huge", '<boundingBox length="1800"', '<boundingBox length="1800000"'),
        ("text", '"45" maxVelocity="1500"', '"45" maxVelocity="fast"'),
        ("envelope", '<vehicleEnvelope key="forklift">', "<vehicleEnvelope>"),
        ("key", "source: ", "sourse: "),
        ("vertex", '<vertex x="', '<vertex x="" z="'),
    ):
        assert old in text
        (tmp_path / f"{name}.xml").write_text(text.replace(old, new))
    before = sorted(f.name for f in tmp_path.iterdir())
    capsys.readouterr()
    assert main(["convert", *arguments]) == 2
    output = capsys.readouterr()
    assert output.err.count("\n") == 1 and line in output.err
    assert sorted(f.name for f in tmp_path.iterdir()) == before


def test_type_to_factsheet_and_back(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["convert", "forklift", "fork.json", "--vda5050", "2.1"]) == 0
    assert capsys.readouterr().out == "fork.json: written\nlost: turn_rate_rad_s, gap_m, battery\n"
    assert main(["convert", "fork.json", "fork.yaml"]) == 0
    assert "guessed: turn_rate_rad_s 1" in capsys.readouterr().out
    assert "# guessed: turn_rate_rad_s 1, as the sheet does not say it" in (tmp_path / "fork.yaml").read_text()
    again = robot_type("./fork.yaml", tmp_path, tmp_path)
    assert (again.length_m, again.max_speed_mps, again.gap_m) == (1.8, 1.5, 0.1)
    assert main(["convert", "fork.yaml", "again.json", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"written": "again.json", "lost": []}
    assert json.loads((tmp_path / "again.json").read_text())["physicalParameters"]["maximumAngularSpeed"] == 1.0


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["forklift", "x.xml"], "x.xml: found '.xml', expected .json (a factsheet) or .yaml for a type of robots"),
        (["forklift", "x.json", "--vda5050", "4"], "VDA 5050 4: expected 2.0, 2.1 or 3.0"),
        (["forklift", "x.yaml", "--vda5050", "2.1"], "--vda5050 is for factsheets: a DST that ends in .json"),
        (["office", "x.lif.json", "--vda5050", "2.1"], "--vda5050 is for types of robots"),
        (["forklift", "x.json", "--graph", "1"], "--graph is for maps"),
        (["short.yaml", "x.json"], "short.yaml: max_speed_mps: missing"),
        (["forkift", "x.json"], "forkift"),
        (["empty.json", "x.yaml"], "empty.json"),
        (["bare.json", "x.yaml"], "bare.json: no 'physicalParameters'"),
        (["slow.yaml", "x.json"], "slow.yaml:3: max_speed_mps: found 0, expected"),
    ],
)
def test_bad_types_end_with_one_line_and_leave_nothing(tmp_path, capsys, monkeypatch, arguments, line):
    monkeypatch.chdir(tmp_path)
    figures = "length_m: 1\nwidth_m: 1\nmax_speed_mps: {}\naccel_mps2: 1\ndecel_mps2: 1\nturn_rate_rad_s: 1\n"
    (tmp_path / "slow.yaml").write_text(figures.format(0))
    (tmp_path / "short.yaml").write_text(figures.replace("max_speed_mps: {}\n", ""))
    (tmp_path / "empty.json").write_text("")
    (tmp_path / "bare.json").write_text('{"typeSpecification": {}}')
    before = sorted(f.name for f in tmp_path.iterdir())
    assert main(["convert", *arguments]) == 2
    output = capsys.readouterr()
    assert output.err.count("\n") == 1 and line in output.err
    assert sorted(f.name for f in tmp_path.iterdir()) == before


def test_factsheet_is_a_type_of_a_scenario_where_nothing_is_guessed(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["convert", "forklift", "new.json"]) == 0
    assert main(["convert", "forklift", "old.json", "--vda5050", "2.1"]) == 0
    drawn = robot_type("forklift", bundled_folder("robots"), tmp_path)
    assert robot_type("./new.json", tmp_path, tmp_path).turn_rate_rad_s == drawn.turn_rate_rad_s
    with pytest.raises(ScenarioError, match=r"guessed would be turn_rate_rad_s 1, .*`mrp-sumo convert .*old.json old.yaml`"):
        robot_type("./old.json", tmp_path, tmp_path)
    capsys.readouterr()
    assert main(["import", "old.json", "--check"]) == 2
    assert "a factsheet of VDA 5050: `mrp-sumo convert FILE type.yaml`" in capsys.readouterr().out
