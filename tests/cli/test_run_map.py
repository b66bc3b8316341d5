"""`mrp-sumo run MAP`: from a map alone to a run on its lanes."""

import json

import pytest

from mrp_sumo.cli.main import main
from mrp_sumo.cli.scenario_choice import is_map
from mrp_sumo.maps.catalogue import bundled_maps

TURN = """name: turn
coordinate_system: cartesian_meters
levels:
  L1:
    vertices: [[0, 0, 0, a], [4, 0, 0, b], [4, 4, 0, c], [0, 4, 0, d]]
    lanes: [[0, 1, {graph_idx: [2, 0]}], [1, 2, {graph_idx: [2, 0]}], [2, 3, {graph_idx: [2, 0]}], [3, 0, {graph_idx: [2, 0]}]]
"""  # one-ways round a block
KINEMATIC = ("--set", "execution.engine=kinematic", "--set", "record.bag=false")


def run(folder, *arguments):
    """The exit code, and what `result.json` says."""
    code = main(["run", *map(str, arguments), *KINEMATIC, "--out", str(folder / "out")])
    path = folder / "out" / "result.json"
    return code, json.loads(path.read_text()) if path.is_file() else {}


@pytest.mark.parametrize(("map_", "type_"), [("office", "turtlebot3"), ("plant", "forklift"), ("hospital_levels", "turtlebot3")])
def test_a_map_alone_runs_on_its_lanes(tmp_path, map_, type_):
    code, result = run(tmp_path, bundled_maps()[map_], "--type", type_)
    assert (code, result["status"], result["audit"]["passed"]) == (0, "completed", True)
    assert result["discretisation"]["kind"] == "roadmap" and result["lanes"]["driven_m"] > 10
    assert (result["lanes"]["off_m"], result["lanes"]["against_one_way_m"]) == (0, 0)
    assert 1 < result["metrics"]["num_robots"] <= 10 and result["scenario"]["robots"]["type"] == type_


@pytest.mark.parametrize("robots", [1, 3])
def test_robots_are_as_many_as_said_and_keep_one_ways(tmp_path, robots):
    path = tmp_path / "turn.building.yaml"
    path.write_text(TURN)
    code, result = run(tmp_path, path, "--robots", robots)
    assert (code, result["metrics"]["num_robots"], result["lanes"]["against_one_way_m"]) == (0, robots, 0)


def test_a_fleet_of_one_says_which_lane_is_too_short_for_two(tmp_path, capsys):
    path = tmp_path / "short.building.yaml"
    longer = TURN.replace("[0, 4, 0, d]]", "[0, 4, 0, d], [-4, 4, 0, e], [-4, 0, 0, f]]").replace(
        "[3, 0, {", "[3, 4, {}], [4, 5, {}], [5, 0, {"
    )
    path.write_text(longer.replace("{}", "{graph_idx: [2, 0]}").replace("[4, 0, 0, b]", "[0.2, 0, 0, b]"))
    code, result = run(tmp_path, path)
    said = capsys.readouterr().err
    assert (code, result["metrics"]["num_robots"], said.count("\n")) == (0, 1, 1)
    assert said.startswith("mrp-sumo: 1 robot, as more are refused: 'turtlebot3' does not fit: ") and "lane 'a' - 'b'" in said


WALLED = TURN.replace("[0, 4, 0, d]]", "[0, 4, 0, d], [-2, 0.6, 0, ''], [6, 0.6, 0, '']]") + "    walls: [[4, 5, {}]]\n"


@pytest.mark.parametrize(("has_way_back", "code"), [(False, 2), (True, 0)])  # from c to d, and from d to c
def test_robots_that_could_only_stay_where_they_are_are_refused(tmp_path, capsys, has_way_back, code):
    path = tmp_path / "walled.building.yaml"
    path.write_text(WALLED.replace("[2, 3, {", "[2, 3, {bidirectional: [4, true], ") if has_way_back else WALLED)
    done, result = run(tmp_path, path, "--type", "forklift")
    said = capsys.readouterr().err
    assert (done, said.count("\n"), bool(result)) == (code, has_way_back ^ 1, has_way_back), said
    if has_way_back:
        assert result["lanes"]["driven_m"] > 3
    else:
        assert "no two stations of 'walled' reach each other: 3 of 4 pieces of lanes left out: 2 lanes lead through a wall" in said


def test_a_map_on_which_a_type_cannot_turn_names_the_first_turn(tmp_path, capsys):
    path = tmp_path / "block.building.yaml"
    path.write_text(TURN.replace("4, 0, c], [0, 4, 0, d]", "1, 0, c], [0, 1, 0, d]"))
    code, _ = run(tmp_path, path, "--type", "pallet_truck")
    said = capsys.readouterr().err
    assert (code, said.count("\n")) == (2, 1), said
    assert "by turns that 'pallet_truck' can make: pallet_truck needs 0.54 m to turn from 'a' over 'b' to 'c' and has 0.50 m" in said


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["FILE", "--robots", "9"], "--robots: 9 robots, but 'turn' has 4 stations that reach each other"),
        (["FILE", "--type", "tugger"], "that reach each other by turns that 'tugger' can make and on which robots may stand at once"),
        (["FILE", "--type", "tugger"], "5.05 m of a lane behind starts for trailers"),
        (["FILE", "--type", "amr_6000"], "--type: 'amr_6000' is neither a robot type nor a file (did you mean 'amr_600'?)"),
        (["FILE", "--set", "robots.cuont=3"], "--set robots.cuont: unknown key"),
        (["office_5", "--meters-per-pixel", "0.1"], "--scale is for a map"),
        (["PIXELS"], "pixels.building.yaml: no measurement, coordinates would be pixels"),
        (["PIXELS", "--scale", "-1"], "--scale/--meters-per-pixel/--metres-per-pixel: found -1, expected more than 0"),
        (["FOLDER"], "is a folder"),
        (["NONE"], "no such file"),
    ],
)
def test_what_cannot_run_is_one_line(tmp_path, capsys, arguments, line):
    paths = {"FILE": "turn.building.yaml", "PIXELS": "pixels.building.yaml", "FOLDER": ".", "NONE": "none.building.yaml"}
    (tmp_path / paths["FILE"]).write_text(TURN)
    (tmp_path / paths["PIXELS"]).write_text(TURN.replace("coordinate_system: cartesian_meters\n", ""))
    code, result = run(tmp_path, *(str(tmp_path / paths[a]) if a in paths else a for a in arguments))
    said = capsys.readouterr().err
    assert (code, said.count("\n"), result) == (2, 1, {}), said
    assert line in said


@pytest.mark.parametrize(
    ("name", "text", "is_one"),
    [
        ("a.building.yaml", TURN, True),
        ("a.yaml", "map: office\nrobots: 3\n", False),
        ("a.yaml", "{map: office, robots: 3}\n", False),
        ("a.yaml", "# a comment\nrobots: 3\nmap:\n  file: x.building.yaml\nlevels: 3\n", False),  # with a wrong key
        ("a.yaml", "robot: 3\n", False),  # a scenario without a map: its messages say so
        ("a.yaml", "image: a.pgm\nresolution: 0.05\n", True),
        ("a.lif.json", '{"metaInformation": {}, "layouts": []}', True),
        ("a.json", '{"map": "office"}', False),
        ("a.xml", "<model/>", True),
        ("a.map", "type octile\nheight 1\nwidth 1\nmap\n.\n", True),
    ],
)
def test_maps_are_told_from_scenarios_by_what_they_hold(tmp_path, name, text, is_one):
    (tmp_path / name).write_text(text)
    assert is_map(str(tmp_path / name)) is is_one


def test_names_are_those_of_bundled_scenarios_before_maps():
    assert is_map("office") and not is_map("office_5") and not is_map("nothing")
