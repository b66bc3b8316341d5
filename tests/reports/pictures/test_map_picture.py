"""The picture shows what is on the map, where it is, and the same bytes each time."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from golden import MAPS
from PIL import Image

from mrp_sumo.errors import MapError
from mrp_sumo.maps.drawing import Drawing
from mrp_sumo.maps.finding import MapFinding
from mrp_sumo.maps.generate import rack_warehouse
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.map import Map
from mrp_sumo.reports.pictures.labels import place_labels
from mrp_sumo.reports.pictures.map_picture import draw_map, map_picture


def small_map(tmp_path: Path, *, one_way: bool = False, second_piece: bool = False) -> Map:
    drawing = Drawing("small", 10.0, 6.0)
    a, b, c = drawing.station(2, 3, "depot", is_charger=True), drawing.station(5, 3), drawing.station(8, 3, "shelf")
    drawing.lane(a, b)
    drawing.lane(b, c, one_way=one_way)
    if second_piece:
        drawing.lane(drawing.station(2, 5), drawing.station(8, 5))
    drawing.box(0, 0, 10, 6)
    drawing.box(4, 1, 6, 2)
    drawing.door((0, 2), (0, 3), "gate")
    drawing.write(tmp_path / "small.building.yaml")
    return load_map(tmp_path / "small.building.yaml")


def words(map_: Map, tmp_path: Path, findings: bool = True) -> Sequence[str]:
    """The texts of the picture as SVG."""
    svg = map_picture(map_, findings=findings).write(tmp_path / "map.svg").read_text()
    return [piece.split("</text>")[0].split(">")[-1] for piece in svg.split("<text")[1:]]


def test_picture_tells_key_facts_names_and_kinds(tmp_path: Path) -> None:
    text = words(small_map(tmp_path), tmp_path)
    assert "small" in text
    assert "3 vertices   ·   2 edges   ·   1 component   ·   10.0 x 6.0 m" in text
    assert {"depot", "shelf", "charger", "station", "junction", "door", "lane, both ways"} <= set(text)
    assert "lane, one way" not in text
    assert "warning" not in text


def test_one_way_lanes_get_arrows(tmp_path: Path) -> None:
    assert {"lane, one way", "lane, both ways"} <= set(words(small_map(tmp_path, one_way=True), tmp_path))


def test_components_get_colours(tmp_path: Path) -> None:
    text = words(small_map(tmp_path, second_piece=True), tmp_path)
    assert {"component of 3 vertices (1)", "component of 2 vertices (2)"} <= set(text)


def test_warnings_are_ringed_unless_unwanted_and_notes_are_not(tmp_path: Path) -> None:
    near = MapFinding("t_junction_near_miss", "warn", 1, ("graph 0 level L1 vertex 1 near lane 1: 0.088 m",))
    crossing = MapFinding("lanes_cross_without_vertex", "warn", 1, ("graph 0 level L1 lanes 1 and 3 at (5.50, -4.00)",))
    elsewhere = MapFinding("t_junction_near_miss", "warn", 1, ("graph 0 level L2 vertex 1 near lane 1: 0.088 m",))
    map_ = replace(small_map(tmp_path), findings=(near, crossing))
    assert "warning" in words(map_, tmp_path)
    assert "warning" not in words(map_, tmp_path, findings=False)
    assert "warning" not in words(replace(map_, findings=(elsewhere,)), tmp_path)
    assert "warning" not in words(replace(map_, findings=(replace(near, severity="info"),)), tmp_path)


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_same_map_same_bytes(tmp_path: Path, suffix: str) -> None:
    map_ = small_map(tmp_path)
    first = draw_map(map_, tmp_path / f"a.{suffix}").read_bytes()
    assert draw_map(map_, tmp_path / f"b.{suffix}").read_bytes() == first


def test_dense_map_names_only_stations_of_a_kind(tmp_path: Path) -> None:
    rack_warehouse(1500).write(tmp_path / "dense.building.yaml")
    text = words(load_map(tmp_path / "dense.building.yaml"), tmp_path)
    assert {"dock_1", "charger_1", "parking_2"} <= set(text)
    assert not any(word.startswith("pick_") for word in text)


def test_long_map_gives_a_long_picture(tmp_path: Path) -> None:
    drawing = Drawing("long", 280.0, 60.0)
    drawing.box(0, 0, 280, 60)
    drawing.lane(drawing.station(10, 30), drawing.station(270, 30))
    drawing.write(tmp_path / "long.building.yaml")
    with Image.open(map_picture(load_map(tmp_path / "long.building.yaml")).write(tmp_path / "long.png", 50)) as picture:
        assert 800 < picture.width <= 1100
        assert 2 < picture.width / picture.height < 4


def test_levels_are_panels(tmp_path: Path) -> None:
    text = words(load_map(MAPS / "open-rmf+rmf_demos/hotel.building.yaml"), tmp_path)
    assert {"L1", "L2", "L3", "lift", "lift cabin"} <= set(text)


def test_map_without_building_is_drawn(tmp_path: Path) -> None:
    assert "depot" in words(replace(small_map(tmp_path), building=None), tmp_path)


def test_warnings_of_a_repaired_map_are_ringed_by_label(tmp_path: Path) -> None:
    near = MapFinding("t_junction_near_miss", "warn", 1, ("level L1 vertex depot near lane v1 - shelf: 0.088 m",))
    map_ = replace(small_map(tmp_path), findings=(near,))
    assert "warning" not in words(map_, tmp_path)
    assert "warning" in words(replace(map_, changes=("something",)), tmp_path)
    assert "warning" in words(replace(map_, building=None), tmp_path)


def test_blocked_cells_of_a_grid_are_drawn(tmp_path: Path) -> None:
    (tmp_path / "room.map").write_text("type octile\nheight 2\nwidth 3\nmap\n..@\n...\n")
    text = words(load_map(tmp_path / "room.map", cell_m=1.0), tmp_path)
    assert "blocked" in text
    assert "5 vertices   ·   5 edges   ·   1 component   ·   3.0 x 2.0 m" in text


def test_lifts_are_named_and_their_lanes_not_counted(tmp_path: Path) -> None:
    map_ = small_map(tmp_path)
    options = ({"lift": "goods_lift"}, *map_.nav.vertex_options[1:])
    lanes = tuple({"lift": "goods_lift"} if 0 in (a, b) else {} for a, b in zip(map_.nav.tail, map_.nav.head))
    nav = replace(map_.nav, vertex_name=("", *map_.nav.vertex_name[1:]), vertex_options=options, lane_options=lanes)
    text = words(replace(map_, nav=nav), tmp_path)
    assert "goods_lift" in text
    assert any("1 edge " in word for word in text)


def test_several_files_hold_the_same_picture(tmp_path: Path) -> None:
    map_ = small_map(tmp_path)
    assert draw_map(map_, tmp_path / "a.png", tmp_path / "a.svg") == tmp_path / "a.png"
    draw_map(map_, tmp_path / "b.svg")
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()


def test_other_suffixes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(MapError, match=r"ends in \.png or \.svg, not '\.bmp'"):
        draw_map(small_map(tmp_path), tmp_path / "map.bmp")
    assert not list(tmp_path.glob("map*"))


def test_labels_do_not_meet_and_stay_on_the_page() -> None:
    rng = np.random.default_rng(3)
    anchor, size = rng.uniform(0, 300, (60, 2)), np.tile([40.0, 8.0], (60, 1))
    none = np.zeros((0, 2, 2))
    low = place_labels(anchor, size, none, none, np.array([(0.0, 0.0), (300.0, 300.0)]), 4.0)
    placed = np.isfinite(low[:, 0])
    assert placed.sum() > 40
    low, high = low[placed], (low + size)[placed]
    assert (low >= 0).all()
    assert (high <= 300).all()
    meets = ((low[:, None] < high) & (high[:, None] > low)).all(2)
    assert (meets == np.eye(len(low), dtype=bool)).all()


def test_label_keeps_off_a_lane() -> None:
    lane = np.array([[(0.0, 50.0), (100.0, 50.0)]] * 2)
    corner = place_labels(np.array([(50.0, 50.0)]), np.array([(30.0, 8.0)]), lane, lane[:0], np.array([(0.0, 0.0), (100.0, 100.0)]), 4.0)
    assert corner[0, 1] >= 50 or corner[0, 1] + 8 <= 50
