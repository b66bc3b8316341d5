"""Sites of Open-RMF, route graphs of Nav2, our own GeoJSON and SUMO networks read back, CSV and node-link graphs."""

import json
from pathlib import Path

import networkx
import pytest
from map_worlds import CSV, LINK, ROUTE, SITE

from mrp_sumo.errors import MapError
from mrp_sumo.io.map_files import write_map
from mrp_sumo.maps.catalogue import find_map
from mrp_sumo.maps.load import load_map

DATA = Path(__file__).resolve().parents[2] / "data" / "formats"


@pytest.fixture
def load(tmp_path):
    def loaded(content, name, **choice):
        path = tmp_path / name
        path.write_text(content if isinstance(content, str) else json.dumps(content))
        return load_map(path, **choice)

    return loaded


def lanes(nav):
    return sorted((nav.label(int(a)), nav.label(int(b))) for a, b in zip(nav.tail, nav.head))


def test_a_site_has_the_lanes_of_its_first_graph_and_names_locations(load):
    map_ = load(SITE, "clinic.site.json")
    nav = map_.nav
    ward = nav.vertex_of_name["ward"]
    assert (nav.xy[ward].tolist(), nav.vertex_options[ward]) == ([2, 0], {"is_charger": True, "is_parking_spot": True})
    on_floor = [(a, b) for a, b in lanes(nav) if "ward" in (a, b)]
    assert on_floor == [("v0", "ward"), ("ward", "v0"), ("ward", "v2")]
    assert nav.speed_mps[nav.lane_between(0, ward)] == 0.5
    assert any(finding.kind == "several_graphs" for finding in map_.findings)
    assert load(SITE, "clinic.site.json", graph=1, level="L1").nav.num_lanes == 6
    level = map_.building.levels["L1"]
    assert (len(level.walls), level.doors[0].name, level.doors[0].kind) == (1, "gate", "double_sliding")


def test_a_cabin_of_a_site_joins_its_levels(load):
    nav = load(SITE, "clinic.site.json").nav
    cabins = [v for v, options in enumerate(nav.vertex_options) if options.get("lift") == "main"]
    assert [nav.level_names[nav.level[v]] for v in cabins] == ["L1", "L2"]
    assert nav.xy[cabins[0]] == pytest.approx([9, 0], abs=1e-9)  # behind the doors, seen from the lower reference anchor to the left
    assert nav.num_components == 1


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"anchors": [1, 2]', '"anchors": [1, 99]', "navigation.guided.lanes.61.anchors[1]: anchor 99 is not there"),
        ("[2.0, 0.0]", '["2", 0.0]', "levels.1.anchors.1.Translate2D[0]: found '2', expected a number"),
        ('"Disable"', '"Never"', "navigation.guided.lanes.61.reverse: found Never, expected Same, Disable or Different"),
        ('{"Only": [71]}', '"None"', "navigation.guided.lanes.61.graphs: found None, expected All, Only or AllExcept"),
        ('"levels": {', '"levels": {}, "other": {', "anchors[0]: anchor 0 is not there"),
        ('"L2"', '"L1"', "levels.2.properties.name: 'L1' is the name of another level, too"),
    ],
)
def test_broken_sites_are_refused_with_the_path(load, old, new, message):
    text = json.dumps(SITE)
    assert old in text
    with pytest.raises(MapError) as error:
        load(text.replace(old, new, 1), "clinic.site.json")
    assert message in str(error.value)


def test_edges_of_nav2_are_directed_and_follow_their_lines(load):
    nav = load(ROUTE, "route.geojson").nav
    start, dock = nav.vertex_of_name["node_0"], nav.vertex_of_name["dock"]
    assert nav.lane_between(dock, start) >= 0
    assert nav.lane_between(start, dock) < 0
    bend = nav.having("is_bend").nonzero()[0].tolist()
    assert nav.xy[bend].tolist() == [[0, 2]]
    assert nav.speed_mps[nav.lane_between(start, bend[0])] == 0.4


@pytest.mark.parametrize(
    ("line", "noted"),
    [
        ({"type": "LineString", "coordinates": [[[0.0, 0.0], [0.0, 2.0], [3.0, 0.0]]]}, False),  # nested as in a line of several parts
        ({"type": "LineString", "coordinates": [[0.0, 0.0], [0.0, 2.0], [3.0, 0.0]]}, False),
        ({"type": "MultiLineString"}, False),
        (None, False),
        ({"type": "LineString", "coordinates": [[0.0], 7]}, True),
    ],
)
def test_an_edge_of_nav2_is_read_whatever_its_geometry_since_nav2_reads_none(load, line, noted):
    document = json.loads(json.dumps(ROUTE))
    document["features"][2]["geometry"] = line
    loaded = load(document, "route.geojson")
    assert loaded.nav.num_lanes == (3 if line and len(line.get("coordinates", ())) in (1, 3) else 2)
    assert ("trajectory_unusable" in {finding.kind for finding in loaded.findings}) == noted


def test_nav2s_own_graph_of_a_warehouse_is_read():
    nav = load_map(DATA / "nav2" / "aws_graph.geojson").nav
    assert (nav.num_vertices, nav.num_lanes) == (40, 83)


def test_an_edge_of_nav2_to_no_node_is_refused(load):
    with pytest.raises(MapError, match=r"features\[2\]\.properties\.endid: no node 9"):
        load(json.dumps(ROUTE).replace('"endid": 1', '"endid": 9'), "route.geojson")


@pytest.mark.parametrize("suffix", [".geojson", ".net.xml"])
def test_what_is_written_is_read_back(tmp_path, suffix):
    map_ = load_map(find_map("office", tmp_path))
    path = tmp_path / f"office{suffix}"
    write_map(map_, path)
    back = load_map(path).nav
    assert back.xy == pytest.approx(map_.nav.xy, abs=1e-6)
    assert (back.tail.tolist(), back.head.tolist()) == (map_.nav.tail.tolist(), map_.nav.head.tolist())
    if suffix == ".geojson":
        assert (back.vertex_name, back.vertex_options) == (map_.nav.vertex_name, map_.nav.vertex_options)
        assert len(load_map(path).building.levels["L1"].walls) == len(map_.building.levels["L1"].walls)


def test_a_wall_of_several_strokes_is_read_and_one_of_a_single_place_has_none(load):
    ends = [
        {"type": "Feature", "properties": {"kind": "vertex", "id": k}, "geometry": {"type": "Point", "coordinates": [k, 0]}} for k in (0, 1)
    ]
    lane = {"type": "Feature", "properties": {"kind": "lane", "tail": 0, "head": 1}, "geometry": {"type": "LineString", "coordinates": []}}
    lines = ("LineString", [[0, 1], [1, 1], [1, 2]]), ("MultiLineString", [[[0, 3], [1, 3]], [[4, 4]]]), ("LineString", [[5, 5]])
    walls = [
        {"type": "Feature", "properties": {"kind": "wall"}, "geometry": {"type": kind, "coordinates": places}} for kind, places in lines
    ]
    building = load({"type": "FeatureCollection", "coordinates_m": True, "features": [*ends, lane, *walls]}, "a.geojson").building
    (level,) = building.levels.values()
    assert level.wall_xy.tolist() == [[[0, 1], [1, 1]], [[1, 1], [1, 2]], [[0, 3], [1, 3]]]


def test_degrees_are_refused(load):
    feature = {"type": "Feature", "properties": {"kind": "vertex"}, "geometry": {}}
    with pytest.raises(MapError, match="coordinates_m: missing, so these are degrees"):
        load({"type": "FeatureCollection", "features": [feature]}, "a.geojson")


def test_a_table_of_lanes_is_a_map(load):
    nav = load(CSV, "lanes.csv").nav
    assert lanes(nav) == [("a", "b"), ("b", "a"), ("b", "c")]
    assert nav.speed_mps[0] == 0.5


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("2,0,2,3", "2,0,2,3 m", "lanes.csv:3: to_y_m is '3 m', expected a number"),
        ("b,c,2,0", "b,c,2,1", "lanes.csv:3: 'b' is at (2, 1), but at (2, 0) before"),
        ("yes", "maybe", "lanes.csv:2: both_ways is 'maybe', expected yes or no"),
        ("to_y_m", "to_z_m", "lanes.csv:1: no column 'to_y_m'"),
        ("speed_mps", "speed", "lanes.csv:1: column 'speed' (did you mean 'speed_mps'?)"),
    ],
)
def test_broken_tables_are_refused_with_the_line(load, old, new, message):
    with pytest.raises(MapError) as error:
        load(CSV.replace(old, new, 1), "lanes.csv")
    assert message in str(error.value)


def test_graphs_of_networkx_are_maps(load):
    assert lanes(load(LINK, "graph.json").nav) == [("a", "v1")]
    graph = networkx.Graph()
    graph.add_node("x", x_m=0.0, y_m=0.0)
    graph.add_node("y", x_m=1.0, y_m=0.0, is_charger=True)
    graph.add_edge("x", "y")
    nav = load(networkx.node_link_data(graph, edges="links"), "graph.json").nav
    assert lanes(nav) == [("x", "y"), ("y", "x")]
    assert nav.vertex_options[1] == {"is_charger": True}
    with pytest.raises(MapError, match=r"links\[0\]\.target: no node '8'"):
        load(json.dumps(LINK).replace('"target": 7', '"target": 8'), "graph.json")
