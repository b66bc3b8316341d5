"""Writers, and round trips between formats."""

import json

import numpy as np
import pytest
import yaml
from golden import MAPS

from mrp_sumo.errors import MapError
from mrp_sumo.io.map_files import write_map
from mrp_sumo.maps.grid import paper_grid
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.repair import repair

BUILDINGS = [
    "boschresearch+mrp_bench/warehouse",
    "cardboardcode+rmf_gym_lite/delivery_queue",
    "open-rmf+rmf_demos/office",
    "open-rmf+rmf_demos/campus",
    "open-rmf+rmf_demos/hotel",
]


def assert_same_graph(a, b, within_m=0.0):
    assert a.vertex_name == b.vertex_name
    assert a.vertex_options == b.vertex_options
    assert (a.tail.tolist(), a.head.tolist()) == (b.tail.tolist(), b.head.tolist())
    assert a.lane_options == b.lane_options
    assert a.speed_mps.tolist() == b.speed_mps.tolist()
    assert np.abs(a.xy - b.xy).max() <= within_m
    assert a.level.tolist() == b.level.tolist()


@pytest.mark.parametrize("name", BUILDINGS)
def test_building_and_its_nav_graph_give_the_same_graph(name, tmp_path):
    result = load_map(MAPS / f"{name}.building.yaml", level="L1")
    write_map(result, tmp_path / "0.nav.yaml")
    again = load_map(tmp_path / "0.nav.yaml")
    assert_same_graph(result.nav, again.nav)
    assert again.name == "0"


def test_reference_nav_graphs_give_the_graph_of_their_building():
    for reference in sorted(MAPS.glob("open-rmf+rmf_demos/airport_terminal.nav/*.yaml")):
        building = reference.parent.with_name("airport_terminal.building.yaml")
        assert_same_graph(load_map(building, graph=int(reference.stem)).nav, load_map(reference).nav)


def test_levels_of_a_nav_graph_are_laid_side_by_side_too(tmp_path):
    result = load_map(MAPS / "open-rmf+rmf_demos/hotel.building.yaml")
    write_map(result, tmp_path / "hotel.nav.yaml")
    again = load_map(tmp_path / "hotel.nav.yaml")
    assert again.nav.num_vertices == result.nav.num_vertices
    assert again.nav.num_components == 1
    assert set(again.level_shift_m) == {"L1", "L2", "L3"}


def test_written_nav_graphs_have_the_content_of_open_rmfs(tmp_path):
    building = MAPS / "open-rmf+rmf_demos/office.building.yaml"
    write_map(load_map(building), tmp_path / "office.nav.yaml")
    written, reference = (
        yaml.safe_load(f.read_text()) for f in (tmp_path / "office.nav.yaml", building.with_name("office.nav") / "0.yaml")
    )
    assert written == reference


def test_repaired_maps_keep_everything_but_what_was_repaired(tmp_path):
    building = MAPS / "boschresearch+mrp_bench/warehouse.building.yaml"
    result, _ = repair(load_map(building), snap_m=0.15)
    write_map(result, tmp_path / "warehouse.nav.yaml")
    assert_same_graph(result.nav, load_map(tmp_path / "warehouse.nav.yaml").nav, 1e-9)


def test_a_nav_graph_becomes_the_papers_grid(tmp_path):
    result = load_map(MAPS / "boschresearch+mrp_bench/office.building.yaml")
    losses = write_map(result, tmp_path / "office.map")
    again, grid = load_map(tmp_path / "office.map").nav, paper_grid(result.nav)
    assert (again.tail.tolist(), again.head.tolist()) == (grid.tail.tolist(), grid.head.tolist())
    assert np.ptp(again.xy - grid.xy, axis=0).max() < 1e-9
    assert any("name" in loss for loss in losses)


def test_geojson_holds_vertices_lanes_and_walls(tmp_path):
    result = load_map(MAPS / "open-rmf+rmf_demos/office.building.yaml")
    assert write_map(result, tmp_path / "office.geojson") == ["4 floors", "3 doors"]
    document = json.loads((tmp_path / "office.geojson").read_text())
    kinds = [feature["properties"]["kind"] for feature in document["features"]]
    assert (kinds.count("vertex"), kinds.count("lane")) == (29, 30)
    assert kinds.count("wall") > 30
    assert document["coordinates_m"]


def test_geojson_of_a_building_on_earth_is_in_degrees(tmp_path):
    result = load_map(MAPS / "open-rmf+rmf_demos/campus.building.yaml")
    write_map(result, tmp_path / "campus.geojson")
    document = json.loads((tmp_path / "campus.geojson").read_text())
    longitude, latitude = document["features"][0]["geometry"]["coordinates"]
    assert 103 < longitude < 105  # Singapore
    assert 1 < latitude < 2
    assert "coordinates_m" not in document


def test_unknown_suffixes_and_several_levels_on_a_grid_are_refused_with_nothing_written(tmp_path):
    result = load_map(MAPS / "open-rmf+rmf_demos/hotel.building.yaml")
    with pytest.raises(MapError, match=r"no map format ends in '\.maps' \(did you mean '\.map'\?\)"):
        write_map(result, tmp_path / "hotel.maps")
    with pytest.raises(MapError, match="a grid holds one level"):
        write_map(result, tmp_path / "hotel.map")
    assert not list(tmp_path.iterdir())


def test_graphs_that_were_not_chosen_and_levels_are_told_as_lost(tmp_path):
    result = load_map(MAPS / "open-rmf+rmf_demos/hotel.building.yaml")
    losses = write_map(result, tmp_path / "hotel.net.xml")
    assert losses[0] == "graphs 1, 2; --graph chooses"
    assert losses[-2:] == ["2 lifts", "which of the 3 levels an edge is on; they are laid out on one plane"]
