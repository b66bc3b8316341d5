"""The reader of RMF buildings: equal to Open-RMF's generator on real buildings, and strict on broken ones."""

import json

import pytest
import yaml
from golden import MAPS

from mrp_sumo.errors import MapError
from mrp_sumo.maps.check import findings_of
from mrp_sumo.maps.lifts import travel_s
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.readers.nav_graph import graph_of_documents
from mrp_sumo.maps.readers.rmf.building_yaml import building_of
from mrp_sumo.maps.readers.rmf.generated_graph import nav_graph_documents
from mrp_sumo.maps.yaml_text import parse, read_text

NAMES = [file.relative_to(MAPS).as_posix() for file in sorted(MAPS.rglob("*.building.yaml"))]

TINY = """
name: tiny
coordinate_system: reference_image
levels:
  L1:
    drawing: {filename: tiny.png}
    elevation: 0
    vertices:
      - [100, 200, 0, dock_a, {is_charger: [4, true], dock_name: [1, dock_a]}]
      - [300, 200, 0, ""]
      - [300, 400, 0, station_b, {is_parking_spot: [4, true]}]
      - [280, 300, 0, ""]
      - [320, 300, 0, ""]
      - [500, 200, 0, unused, {is_charger: [4, true]}]
    measurements:
      - [0, 1, {distance: [3, 10]}]
    doors:
      - [3, 4, {name: [1, gate], type: [1, hinged], motion_axis: [1, start], motion_degrees: [3, 90], motion_direction: [2, 1]}]
    lanes:
      - [1, 0, {graph_idx: [2, 0], bidirectional: [4, true], orientation: [1, forward]}]
      - [1, 2, {graph_idx: [2, 0], bidirectional: [4, false], speed_limit: [3, 0.5]}]
lifts: {}
"""
TINY_GRAPH = """
building_name: tiny
doors: {gate: {endpoints: [[14.0, -15.0], [16.0, -15.0]], map: L1}}
lifts: {}
levels:
  L1:
    vertices:
    - [15.0, -10.0, {name: ''}]
    - [5.0, -10.0, {name: dock_a, is_charger: true, dock_name: dock_a}]
    - [15.0, -20.0, {name: station_b, is_parking_spot: true}]
    lanes:
    - [0, 1, {orientation_constraint: forward, dock_name: dock_a}]
    - [1, 0, {orientation_constraint: backward, undock_name: dock_a}]
    - [0, 2, {door_name: gate, speed_limit: 0.5, is_bidirectional: false}]
"""
TWO_LEVELS = """
name: tower
reference_level_name: ground
levels:
  ground:
    vertices: [[0, 0, 0, a], [100, 0, 0, b]]
    measurements: [[0, 1, {distance: [3, 10]}]]
    lanes: [[0, 1, {graph_idx: [2, 0], bidirectional: [4, true]}]]
    fiducials: [[0, 0, f], [100, 0, g]]
  upper:
    elevation: 4
    vertices: [[0, 0, 0, c], [0, 200, 0, d]]
    lanes: [[0, 1, {graph_idx: [2, 0], bidirectional: [4, true]}]]
    fiducials: [[0, 0, f], [0, 200, g]]
lifts:
  cabin:
    {x: 100, y: 0, yaw: 0, width: 2, depth: 2, level_doors: {ground: [door], upper: [door]}}
"""


def built(path, meters_per_pixel=None):
    text = read_text(path)
    return building_of(parse(text), text, meters_per_pixel)


def building(tmp_path, text=TINY, **keys):
    path = tmp_path / "tiny.building.yaml"
    path.write_text(text)
    return built(path, **keys)


def refusal(tmp_path, old, new, text=TINY):
    assert text.count(old) >= 1
    path = tmp_path / "tiny.building.yaml"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(MapError) as error:
        load_map(path)
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("name", NAMES)
def test_nav_graphs_equal_the_reference(name):
    file = MAPS / name
    references = {
        int(p.stem): yaml.load(p.read_text(), yaml.CSafeLoader)
        for p in file.with_name(file.name.replace(".building.yaml", ".nav")).glob("*")
    }
    if not references:
        with pytest.raises(MapError):
            load_map(file)
        return
    result = nav_graph_documents(built(file))
    assert set(result) == set(references)
    for graph, reference in references.items():
        document = result[graph]
        assert {k: v for k, v in document.items() if k not in PLACED} == {k: v for k, v in reference.items() if k not in PLACED}
        assert flat(document["doors"], "endpoints") == pytest.approx(flat(reference["doors"], "endpoints"), abs=1e-6)
        assert flat(document["lifts"], "position", "dims") == pytest.approx(flat(reference["lifts"], "position", "dims"), abs=1e-6)
        assert set(document["levels"]) == set(reference["levels"])
        for level, expected in reference["levels"].items():
            vertices, lanes = document["levels"][level]["vertices"], document["levels"][level]["lanes"]
            assert lanes == expected["lanes"]
            assert [v[2] for v in vertices] == [v[2] for v in expected["vertices"]]
            assert [c for v in vertices for c in v[:2]] == pytest.approx([c for v in expected["vertices"] for c in v[:2]], abs=1e-6)


PLACED = ("doors", "lifts", "levels")


def flat(things, *keys):
    return {(name, key, i): x for name, thing in things.items() for key in keys for i, x in enumerate(_numbers(thing[key]))}


def _numbers(value):
    return [y for x in value for y in _numbers(x)] if isinstance(value, list) else [value]


@pytest.mark.parametrize("name", NAMES)
def test_findings_are_the_expected_ones(name):
    expected = json.loads((MAPS / "expected_findings.json").read_text())
    try:
        result = load_map(MAPS / name).findings
    except MapError as error:
        result = findings_of(error)
    wanted = {f["kind"]: f["count"] for f in expected["files"][name]}
    assert {finding.kind: finding.count for finding in result} == wanted
    assert all(finding.severity == expected["kinds"][finding.kind]["severity"] for finding in result)


def test_the_example_of_the_manual(tmp_path):
    assert nav_graph_documents(building(tmp_path)) == {0: yaml.safe_load(TINY_GRAPH)}


def test_nav_graph_keeps_speed_limits_and_directions(tmp_path):
    read = building(tmp_path)
    graph = graph_of_documents([nav_graph_documents(read)[0]], "tiny", levels=read.levels)
    assert graph.vertex_name == ("", "dock_a", "station_b")
    assert graph.having("is_charger").tolist() == [False, True, False]
    assert graph.speed_mps[graph.lane_between(0, 2)] == 0.5
    assert graph.speed_mps[graph.lane_between(0, 1)] == float("inf")
    assert graph.lane_between(2, 0) == -1
    assert graph.num_edges == 2


def test_lanes_have_widths_and_floors_without_robots_are_zones(tmp_path):
    drawn = TINY.replace("speed_limit: [3, 0.5]", "width: [3, 1.2]")
    assert drawn != TINY
    floor = "      - {parameters: {PARAMETER: [4, true]}, vertices: [0, 1, 2]}\n"
    floors = f"    floors:\n{floor.replace('PARAMETER', 'no_robots')}{floor.replace('PARAMETER', 'indoor')}"
    read = building(tmp_path, drawn.replace("    lanes:", f"{floors}    lanes:"))
    graph = graph_of_documents([nav_graph_documents(read)[0]], "tiny", levels=read.levels)
    assert [options.get("width") for options in graph.lane_options] == [None, 1.2, None]
    assert (read.levels["L1"].zones, read.levels["L1"].floors) == (((0, 1, 2),), ((0, 1, 2),))
    with pytest.raises(MapError, match="lane 1: width is 'wide', expected a number"):
        building(tmp_path, TINY.replace("speed_limit: [3, 0.5]", "width: [1, wide]"))


def test_levels_are_aligned_by_fiducials(tmp_path):
    # ground: 0.1 m a pixel. upper: drawn twice as large and turned by a quarter, so c lies on a and d on b.
    levels = building(tmp_path, TWO_LEVELS).levels
    assert levels["upper"].world_xy.tolist() == [pytest.approx([0, 0], abs=1e-9), pytest.approx([10, 0], abs=1e-9)]


def test_levels_are_laid_out_and_joined_by_lifts(tmp_path):
    path = tmp_path / "tower.building.yaml"
    path.write_text(TWO_LEVELS)
    result = load_map(path)
    assert result.level_shift_m == {"ground": (0.0, 0.0), "upper": (0.0, -6.0)}
    assert result.nav.xy.round(9).tolist() == [[0, 0], [10, 0], [0, -6], [10, -6]]
    lift = result.nav.lane_between(1, 3)
    options = result.nav.lane_options[lift]
    assert options["lift"] == "cabin"
    assert options["ride_s"] == pytest.approx(options["close_s"] + travel_s(result.nav.length_m[lift]) + options["open_s"])
    assert result.nav.length_m[lift] == 4
    assert result.nav.num_components == 1
    assert result.building.levels["upper"].xy[0].tolist() == pytest.approx([0, -6])


def test_one_level_alone_stays_where_it_is(tmp_path):
    path = tmp_path / "tower.building.yaml"
    path.write_text(TWO_LEVELS)
    result = load_map(path, level="upper")
    assert result.nav.xy.round(9).tolist() == [[0, 0], [10, 0]]
    assert result.nav.level_names == ("upper",)


def test_scale_can_be_stated(tmp_path):
    text = TINY.replace("      - [0, 1, {distance: [3, 10]}]", "")
    assert [f.kind for f in building(tmp_path, text).findings] == ["reference_level_without_measurement"]
    assert building(tmp_path, text, meters_per_pixel=0.05).levels["L1"].xy[0].tolist() == [5.0, -10.0]


def test_values_are_coerced_by_tag(tmp_path):
    text = TINY.replace("dock_name: [1, dock_a]", "mutex: [1, 5]").replace("[500, 200, 0, unused", "[500, 200, 0, 12")
    read = building(tmp_path, text)
    assert [(f.kind, f.count) for f in read.findings] == [("type_tag_mismatch", 1)]
    assert graph_of_documents([nav_graph_documents(read)[0]], "tiny", levels=read.levels).vertex_options[1]["mutex"] == "5"


def test_names_that_occur_again_in_a_graph_get_a_number(tmp_path):
    path = tmp_path / "tiny.building.yaml"
    path.write_text(TINY.replace("station_b", "dock_a"))
    result = load_map(path)
    assert result.nav.vertex_name == ("", "dock_a", "dock_a_2")
    assert "name_twice_in_graph" in [f.kind for f in result.findings]


def test_old_key_names_are_read(tmp_path):
    assert (
        building(tmp_path, TINY.replace("name: tiny", "building_name: tiny", 1).replace("coordinate_system: reference_image\n", "")).name
        == "tiny"
    )


def test_lane_without_length_and_repeated_lanes_are_left_out(tmp_path):
    lane = "      - [1, 2, {graph_idx: [2, 0], bidirectional: [4, true]}]\n      - [1, 1, {graph_idx: [2, 0], bidirectional: [4, true]}]\n"
    path = tmp_path / "tiny.building.yaml"
    path.write_text(TINY.replace("lifts: {}", lane.removeprefix("") + "lifts: {}"))
    result = load_map(path)
    assert {f.kind: f.count for f in result.findings} == {"duplicate_lanes": 1, "lane_without_length": 1, "robot_vertex_off_lanes": 1}
    assert result.nav.num_edges == 2
    assert result.nav.speed_mps[result.nav.lane_between(0, 2)] == 0.5  # the first stays


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("- [1, 2, {graph", "- [1, 6, {graph", "tiny.building.yaml:21: level L1 lane 1 names vertex 6, but the level has 6 (0 to 5)"),
        ("- [1, 2, {graph", "- [-1, 2, {graph", "tiny.building.yaml:21: level L1 lane 1 names vertex -1, but the level has 6 (0 to 5)"),
        ("- [1, 2, {graph_idx: [2, 0], ", "- [1, 2, {", "tiny.building.yaml:21: level L1 lane 1 has no graph_idx"),
        (
            '[300, 200, 0, ""]',
            '[.nan, 200, 0, ""]',
            "tiny.building.yaml:10: level L1 vertex 1: x is nan, expected a number of sensible size",
        ),
        ('[300, 200, 0, ""]', "[300, 200]", "vertex 1 is [300, 200], a list, expected [x, y, z, name, {parameters}]"),
        ("distance: [3, 10]", "distance: [3, 0]", "tiny.building.yaml:16: level L1 measurement 0 says that 200 pixels are 0 m"),
        ("- [0, 1, {distance", "- [1, 1, {distance", "says that 0 pixels are 10 m: no scale can be computed"),
        (
            "      - [0, 1, {distance: [3, 10]}]\n",
            "",
            "no measurement, coordinates would be pixels (level L1: lanes span 200 x 200 pixels)",
        ),
        ("orientation: [1, forward]", "orientation: [1, sideways]", "orientation is 'sideways', expected forward, backward or nothing"),
        ("reference_image", "reference_imge", "'reference_imge' is unknown (did you mean 'reference_image'?)"),
        ("reference_image", "web_mercator", "web_mercator is not read"),
        ("reference_image", "wgs84", "needs the parameter generate_crs"),
        ("    lanes:", "    human_lanes:", "nothing to drive on (6 vertices, 0 walls): draw lanes with `mrp-sumo studio`, or"),
        ("levels:", "storeys:", "its name says RMF building, but it is none: expected 'levels' with"),
        ("bidirectional: [4, true]", "bidirectional: [1, perhaps]", "bidirectional is 'perhaps', expected true or false"),
        ("{graph_idx: [2, 0], ", "{graph_idx: 0, ", "'graph_idx' is '0', expected [type, value]"),
        ("lifts: {}", "lifts: {cabin: {x: 1, y: 1, yaw: 0, width: 2}}", "lift 'cabin' has no depth"),
        ("name: tiny", "title: tiny", "the building has no 'name'"),
    ],
)
def test_broken_buildings_are_refused_with_place_and_reason(tmp_path, old, new, message):
    assert message in refusal(tmp_path, old, new)


def test_level_that_cannot_be_placed_is_refused_unless_taken_alone(tmp_path):
    path = tmp_path / "tower.building.yaml"
    path.write_text(TWO_LEVELS.replace("[0, 200, g]", "[0, 200, h]"))
    with pytest.raises(MapError, match="level upper shares 1 fiducial with ground; 2 needed"):
        load_map(path)
    assert load_map(path, level="ground").nav.num_edges == 1


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"graph": 3}, "has no lane in graph 3; graphs with lanes: 0 (2 lanes)"),
        ({"level": "L2"}, "has no level 'L2' (known: L1)"),
        ({"meters_per_pixel": -1.0}, "meters per pixel is -1.0, expected a number above 0"),
    ],
)
def test_choices_that_do_not_exist_are_refused(tmp_path, keys, message):
    path = tmp_path / "tiny.building.yaml"
    path.write_text(TINY)
    with pytest.raises(MapError) as error:
        load_map(path, **keys)
    assert message in str(error.value)


def test_georeferenced_buildings_lose_their_offset():
    result = load_map(MAPS / "open-rmf+rmf_demos/campus.building.yaml")
    assert result.origin_m == (22000.0, 31500.0)
    assert abs(result.nav.xy).max() < 1000


@pytest.mark.parametrize(
    ("second", "lane", "kinds"),
    [
        ("dock", [0, 1], {"name_twice_in_graph": 1}),
        ("hall", [0, 2], {"lane_without_length": 1}),
        ("hall", [0, 1], {}),
    ],
)
def test_nav_graph_tells_what_it_changes(tmp_path, second, lane, kinds):
    """A later vertex of a name gets a number; a lane between equal places is left out."""
    vertices = [[0, 0, {"name": "dock"}], [4, 0, {"name": second}], [0, 0, {"name": ""}]]
    level = {"vertices": vertices, "lanes": [[0, 1, {}], [1, 0, {}], [*lane, {}]]}
    (tmp_path / "two.yaml").write_text(yaml.safe_dump({"building_name": "two", "levels": {"L1": level}}))
    findings = load_map(tmp_path / "two.yaml").findings
    assert {f.kind: f.count for f in findings if f.kind in ("name_twice_in_graph", "lane_without_length")} == kinds
