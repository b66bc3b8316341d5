"""The VDMA's Layout Interchange Format."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from lif_worlds import TYPE, lif, lif_2, node

from mrp_sumo.cli.main import main
from mrp_sumo.core.robot_type import RobotType, Wheels
from mrp_sumo.errors import MapError
from mrp_sumo.io.map_files import write_map
from mrp_sumo.maps.catalogue import find_map
from mrp_sumo.maps.load import load_map

SHARED = Path(__file__).resolve().parents[4] / "shared" / "reference" / "data" / "lif"
FIGURES = {"length_m": 1.5, "width_m": 0.8, "max_speed_mps": 1.0, "accel_mps2": 0.5, "decel_mps2": 0.5}
STEERED = {"kind": "tricycle", "wheelbase_m": 1.0, "steering_max_rad": 1.0}
BACKS = RobotType("fork", **FIGURES, kinematics=Wheels(**STEERED, reverse=True, reverse_mps=0.4), vehicle_type="acme.backs")
TURNS = RobotType("turns", **FIGURES, turn_rate_rad_s=0.5)
FORWARD = RobotType("ahead", **FIGURES, kinematics=Wheels(**STEERED))
THERE = pytest.mark.skipif(not SHARED.is_dir(), reason="the VDMA's files are not beside this repository")


@pytest.fixture
def load(tmp_path):
    def loaded(document, **choice):
        path = tmp_path / "site.lif.json"
        path.write_text(document if isinstance(document, str) else json.dumps(document))
        return load_map(path, **choice)

    return loaded


def kinds(map_):
    return {finding.kind: finding for finding in map_.findings}


def test_nodes_edges_and_stations_become_vertices_lanes_and_options(load):
    nav = load(lif()).nav
    a, b, c = (nav.vertex_of_name[name] for name in "ABC")
    assert nav.vertex_of_name["dock"] == b
    assert nav.vertex_options[b] == {"station": "dock", "theta_rad": 1.5}
    assert nav.vertex_options[c] == {"is_charger": True, "actions": "startCharging"}
    assert nav.speed_mps[nav.lane_between(a, b)] == 1.2
    back = nav.lane_options[nav.lane_between(c, a)]
    assert back == {"edge_id": "C-A", "load": "unloaded", "orientation_constraint": "backward"}
    assert (nav.name, nav.level_names) == ("site", ("hall",))


def test_edges_that_no_type_of_vehicle_may_use_are_left_out_and_named(load):
    document = lif()
    document["layouts"][0]["edges"].append({"edgeId": "B-A", "startNodeId": "B", "endNodeId": "A", "vehicleTypeEdgeProperties": []})
    site = load(document)
    assert kinds(site)["edge_of_no_type"].details == ("'B-A'",) and site.nav.num_lanes == load(lif()).nav.num_lanes
    for edge in document["layouts"][0]["edges"]:
        edge["vehicleTypeEdgeProperties"] = []
    with pytest.raises(
        MapError, match=r"no lanes: nothing to drive on \(3 vertices\); edge of no type: 'A-B'; 'B-C'; 'C-A'; 'B-A': left out"
    ):
        load(document)


def test_a_trajectory_is_followed_within_a_centimetre(load):
    nav = load(lif()).nav
    bends = nav.xy[nav.having("is_bend")]
    t = np.linspace(0, 1, 2001)[:, None]
    weights = np.concatenate([(1 - t) ** 2, t * (1 - t), t**2], axis=1)  # 2 t (1 - t) times the weight 0.5
    curve = weights @ [(4, 0), (4, 4), (0, 4)] / weights.sum(1, keepdims=True)
    line = np.concatenate([[(4.0, 0.0)], bends, [(0.0, 4.0)]])
    for place in curve:
        start, route = line[:-1], np.diff(line, axis=0)
        share = np.clip(((place - start) * route).sum(1) / (route**2).sum(1), 0, 1)
        assert np.hypot(*(start + share[:, None] * route - place).T).min() <= 0.01


def test_draft_2_says_the_same(load):
    one, two = load(lif()).nav, load(lif_2()).nav
    assert (one.xy == two.xy).all()
    assert (one.vertex_options, one.lane_options) == (two.vertex_options, two.lane_options)
    assert (one.speed_mps == two.speed_mps).all()


def test_one_type_of_vehicle_is_chosen_by_name(load):
    document = lif()
    other = json.loads(json.dumps(document["layouts"][0]["edges"][0]).replace(TYPE, "slow").replace("1.2", "0.3").replace("A-B", "A-B2"))
    document["layouts"][0]["edges"].append(other)
    for what in document["layouts"][0]["nodes"][:2]:
        what["vehicleTypeNodeProperties"].append({"vehicleTypeId": "slow"})
    assert kinds(load(document))["several_vehicle_types"].details == (
        f"edges for {TYPE} 3, slow 1; all are read, --vehicle-type chooses one",
    )
    slow = load(document, vehicle_type="slow").nav
    assert (slow.num_lanes, slow.speed_mps.tolist()) == (1, [0.3])
    with pytest.raises(MapError, match=re.escape("no edge for vehicle type 'slw' (did you mean 'slow'?)")):
        load(document, vehicle_type="slw")


def test_what_is_odd_is_found(load):
    document = lif()
    layout = document["layouts"][0]
    layout["nodes"] += [node("D", 9000.0, 0.0), node("E", 9000.0, 5.0, theta=90.0)]
    layout["edges"] += [json.loads(json.dumps(layout["edges"][0]).replace('"A', '"D').replace('B"', 'E"').replace("-B", "-E"))]
    layout["stations"] += [{"stationId": "far", "interactionNodeIds": ["E", "F"]}]
    layout["edges"][1]["vehicleTypeEdgeProperties"][0]["trajectory"]["knotVector"] = [0, 1]
    result = kinds(load(document))
    assert result["extent_above_1_km"].details == ("9000 x 5 m: is the file in millimetres?",)
    assert result["theta_in_degrees"].details == ("theta of 'E' is 90",)
    assert result["dangling_reference"].details == ("layouts[0].stations[1].interactionNodeIds[1]: no node 'F' (known: A, B, C, D, E)",)
    assert result["station_out_of_reach"].details == ("'far' at 'E'",)
    assert "2 knots, expected 6" in result["trajectory_unusable"].details[0]
    assert "turns_restricted" in result and "load_dependent_lanes" not in result  # robots with orders keep to `load`


def test_nodes_at_one_place_between_which_vehicles_turn_are_one_vertex(load):
    document = lif()
    layout = document["layouts"][0]
    layout["nodes"].append(node("B2", 4.0, 0.0))
    layout["edges"].append(json.loads(json.dumps(layout["edges"][0]).replace('"A"', '"B"').replace('"B"', '"B"', 1).replace("A-B", "turn")))
    layout["edges"][-1] |= {"startNodeId": "B", "endNodeId": "B2"}
    layout["edges"][1]["startNodeId"] = "B2"
    layout["stations"].append({"stationId": "turntable", "interactionNodeIds": ["B", "B2"]})
    map_ = load(document)
    assert sum(str(vertex.get("station")).count("turntable") for vertex in map_.nav.vertex_options) == 1
    assert kinds(map_)["vertices_at_one_place"].details == ("'B2' is 'B'",)
    assert "several_components" not in kinds(map_)
    assert "not_strongly_connected" not in kinds(map_)


def test_an_edge_to_another_level_is_a_lift(load):
    document = lif()
    above = json.loads(
        json.dumps(document["layouts"][0])
        .replace('"A', '"U')
        .replace("B", "V")
        .replace("C", "W")
        .replace("ground", "up")
        .replace("hall", "roof")
    )
    above["stations"], above["nodes"][0]["mapId"] = [], "roof"
    for what in above["edges"]:
        what["vehicleTypeEdgeProperties"][0].pop("trajectory", None)
    above["edges"].append(
        json.loads(json.dumps(document["layouts"][0]["edges"][0]).replace('"A-B"', '"ride"').replace('"A"', '"U"').replace('"B"', '"A"'))
    )
    document["layouts"].append(above)
    nav = load(document).nav
    assert nav.level_names == ("hall", "roof")
    assert sorted(nav.label(int(v)) for k, v in enumerate(nav.head) if "lift" in nav.lane_options[k]) == ["A", "U"]
    assert load(document, level="roof").nav.num_vertices == 3


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"endNodeId": "B"', '"endNodeId": "b"', "layouts[0].edges[0].endNodeId: no node 'b' (did you mean 'B'?)"),
        ('"nodeId": "B"', '"nodeId": "A"', "layouts[0].nodes[1].nodeId: 'A' is taken by layouts[0].nodes[0]"),
        ('"x": 4.0', '"x": "4.0"', "layouts[0].nodes[1].nodePosition.x: found '4.0', expected a number"),
        ('"x": 4.0', '"X": 4.0', "layouts[0].nodes[1].nodePosition: no 'x' (there is 'X'?)"),
        ('"x": 4.0', '"x": 1e999', "not YAML"),
        ('"x": 4.0', '"x": 1' + 400 * "0", "layouts[0].nodes[1].nodePosition.x: found 1000"),
        (
            ' "maxSpeed":',
            ' "rotationAtEndNodeAllowed": ["BOTH"], "maxSpeed":',
            "rotationAtEndNodeAllowed: found an array of 1, expected text",
        ),
        ('"edges": [', '"edges": 3, "x": [', "layouts[0].edges: found 3, expected an array"),
        ('"layouts": [', '"layouts": [7, ', "layouts[0]: found 7, expected an object"),
        ('"A-B"', '"B-C"', "layouts[0].edges[1].edgeId: 'B-C' is taken by layouts[0].edges[0]"),
    ],
)
def test_broken_files_are_refused_with_the_path(load, old, new, message):
    text = json.dumps(lif())
    assert old in text
    with pytest.raises(MapError) as error:
        load(text.replace(old, new, 1))
    assert message in str(error.value).replace("inf", "") or message == "not YAML"
    assert "\n" not in str(error.value)


def test_a_check_lists_every_edge_to_nowhere_and_ends_with_2(tmp_path, capsys):
    path = tmp_path / "site.lif.json"
    path.write_text(json.dumps(lif()).replace('"endNodeId": "B"', '"endNodeId": "X"').replace('"endNodeId": "A"', '"endNodeId": "Y"'))
    assert main(["import", str(path), "--check"]) == 2
    assert "edge to nowhere: layouts[0].edges[0].endNodeId: no node 'X'" in capsys.readouterr().out


@THERE
@pytest.mark.parametrize(("file", "vertices", "edges"), [("example.lif.json", 2, 1)])
def test_published_examples_are_read(file, vertices, edges):
    nav = load_map(SHARED / file).nav
    assert (nav.num_vertices, nav.num_edges) == (vertices, edges)


@THERE
def test_the_examples_in_the_text_of_both_versions_are_read(load):
    read = 0
    for version in ("vdma-1.0", "vdma-2-draft"):
        for block in re.findall(r"```json\n(.*?)```", (SHARED / version / "LIF.md").read_text(), re.DOTALL):
            if '"lifVersion": "string"' in block or '"nodes"' not in block:
                continue  # the table of all fields
            try:
                json.loads(block)
            except ValueError:
                continue  # one has a comma too many
            assert load(block).nav.num_lanes > 0
            read += 1
    assert read >= 30


@pytest.mark.parametrize("make", ["site.lif.json", "plant.xml"])
def test_what_is_written_is_read_back(load, tmp_path, make):
    document = lif()
    document["layouts"][0]["nodes"][0]["vehicleTypeNodeProperties"][0]["theta"] = 1.5
    map_ = load(document)
    losses = write_map(map_, tmp_path / make)
    nav, back = map_.nav, load_map(tmp_path / make).nav
    assert [n for n in back.vertex_name if n] == ["A", "B", "C"]
    for name in "ABC":
        was, now = (g.vertex_options[g.vertex_of_name[name]] for g in (nav, back))
        if make.endswith(".xml") and name == "C":
            now = {key: value for key, value in now.items() if key != "station"}  # where vehicles charge is a location
        assert now == pytest.approx(was, abs=1e-5)
    assert back.vertex_of_name["dock"] == back.vertex_of_name["B"]
    assert back.length_m.sum() == pytest.approx(nav.length_m.sum(), abs=0.02)
    ca = back.lane_between(back.vertex_of_name["C"], back.vertex_of_name["A"])
    assert back.lane_options[ca]["orientation_constraint"] == "backward"
    assert ("load" in back.lane_options[ca]) == make.endswith(".json")
    assert any("load" in loss for loss in losses) == make.endswith(".xml")


def test_every_bundled_map_comes_back_as_lif_and_as_a_plant_model(tmp_path):
    map_ = load_map(find_map("hospital", tmp_path))
    for name in ("hospital.lif.json", "hospital.xml"):
        write_map(map_, tmp_path / name)
        back = load_map(tmp_path / name).nav
        assert back.xy == pytest.approx(map_.nav.xy, abs=6e-4)
        assert (back.tail.tolist(), back.head.tolist()) == (map_.nav.tail.tolist(), map_.nav.head.tolist())
        chargers = map_.nav.having("is_charger")
        assert (back.having("is_charger") == chargers).all()


@THERE
def test_what_is_written_is_valid_by_the_official_schema(load, tmp_path):
    jsonschema = pytest.importorskip("jsonschema")
    schema = json.loads((SHARED / "vdma-1.0" / "LIF.schema").read_text())
    for robots in ((), (BACKS, TURNS)):
        write_map(load(lif()), tmp_path / "again.lif.json", robots=robots)
        assert not list(jsonschema.Draft7Validator(schema).iter_errors(json.loads((tmp_path / "again.lif.json").read_text())))


def test_edges_are_written_for_the_types_that_can_drive_them(load, tmp_path):
    write_map(load(lif()), tmp_path / "again.lif.json", robots=(BACKS, TURNS, FORWARD))
    layout = json.loads((tmp_path / "again.lif.json").read_text())["layouts"][0]
    assert [each["vehicleTypeId"] for each in layout["nodes"][0]["vehicleTypeNodeProperties"]] == [
        "acme.backs",
        "mrp_sumo.turns",
        "mrp_sumo.ahead",
    ]
    edges = {edge["edgeId"]: {each["vehicleTypeId"]: each for each in edge["vehicleTypeEdgeProperties"]} for edge in layout["edges"]}
    assert set(edges["A-B"]) == {"acme.backs", "mrp_sumo.turns", "mrp_sumo.ahead"}
    assert set(edges["C-A"]) == {"acme.backs", "mrp_sumo.turns"}  # on which vehicles drive backward
    assert edges["A-B"]["acme.backs"]["rotationAtEndNodeAllowed"] == "NONE"
    assert "rotationAtEndNodeAllowed" not in edges["A-B"]["mrp_sumo.turns"]
    assert edges["A-B"]["mrp_sumo.turns"]["maxRotationSpeed"] == 0.5
    assert {each["maxSpeed"] for each in edges["A-B"].values()} == {1.2}


@pytest.mark.parametrize("allowed", [True, False])
def test_rotation_on_an_edge_comes_back_for_types_that_can_turn(load, tmp_path, allowed):
    document = lif()
    for edge in document["layouts"][0]["edges"]:
        for own in edge["vehicleTypeEdgeProperties"]:
            own["rotationAllowed"] = allowed
    write_map(load(document), tmp_path / "again.lif.json", robots=(BACKS, TURNS))
    edges = json.loads((tmp_path / "again.lif.json").read_text())["layouts"][0]["edges"]
    rotates = {(each["vehicleTypeId"], each["rotationAllowed"]) for edge in edges for each in edge["vehicleTypeEdgeProperties"]}
    assert rotates == {("acme.backs", False), ("mrp_sumo.turns", allowed)}


def test_types_of_a_layout_come_back(load, tmp_path):
    document = lif()
    for what in document["layouts"][0]["nodes"]:
        what["vehicleTypeNodeProperties"].append({"vehicleTypeId": "other"})
    document["layouts"][0]["edges"][0]["vehicleTypeEdgeProperties"].append({"vehicleTypeId": "other", "rotationAllowed": False})
    map_ = load(document)
    assert map_.vehicle_types == (TYPE, "other")
    assert [options.get("vehicle_types", "") for options in map_.nav.lane_options].count(TYPE) == map_.nav.num_lanes - 1
    losses = write_map(map_, tmp_path / "again.lif.json")
    assert losses == ["limits, directions and loads that differ by type of vehicle on one edge"]
    again = load_map(tmp_path / "again.lif.json")
    assert again.vehicle_types == map_.vehicle_types
    assert [o.get("vehicle_types") for o in again.nav.lane_options] == [o.get("vehicle_types") for o in map_.nav.lane_options]


def test_parallel_edges_for_types_of_their_own_are_one_lane_for_both(load):
    document = lif()
    layout = document["layouts"][0]
    for what in layout["nodes"]:
        what["vehicleTypeNodeProperties"] += [{"vehicleTypeId": "other"}, {"vehicleTypeId": "third"}]
    second = json.loads(json.dumps(layout["edges"][0]).replace(TYPE, "other").replace("1.2", "0.7").replace("A-B", "A-B2"))
    third = json.loads(json.dumps(layout["edges"][0]).replace(TYPE, "third"))
    layout["edges"] += [second, {**third, "edgeId": "B-A", "startNodeId": "B", "endNodeId": "A"}]
    nav = load(document).nav
    lane = nav.lane_between(*(nav.vertex_of_name[name] for name in "AB"))
    assert (nav.lane_options[lane]["vehicle_types"], nav.speed_mps[lane]) == (f"{TYPE}, other", 0.7)
