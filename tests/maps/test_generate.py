"""Generated maps import without findings, hold what was asked for, and can be driven from everywhere to everywhere."""

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from mrp_sumo.cli.main import main
from mrp_sumo.core.graph import NavGraph
from mrp_sumo.errors import MapError
from mrp_sumo.maps.drawing import Drawing
from mrp_sumo.maps.generate import GENERATORS, rack_warehouse, random_roads, ring, street_grid
from mrp_sumo.maps.grid import paper_grid
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.map import Map


def written(drawing: Drawing, tmp_path: Path) -> Map:
    drawing.write(tmp_path / "made.building.yaml")
    return load_map(tmp_path / "made.building.yaml")


def num_strong_parts(nav: NavGraph) -> int:
    links = coo_array((np.ones(nav.num_lanes), (nav.tail, nav.head)), shape=(nav.num_vertices, nav.num_vertices))
    return int(connected_components(links, connection="strong")[0])


CASES: list[tuple[str, int, dict[str, Any]]] = [
    ("warehouse", 12, {}),
    ("warehouse", 300, {}),
    ("warehouse", 300, {"one_way": True}),
    ("warehouse", 250, {"cross_aisles": 5, "bays": 3}),
    ("warehouse", 250, {"cross_aisles": 2, "bays": 1, "one_way": True}),
    ("grid", 4, {}),
    ("grid", 100, {}),
    ("grid", 100, {"one_way": True, "spacing_m": 0.8}),
    ("ring", 12, {}),
    ("ring", 61, {"one_way": True, "spacing_m": 0.8}),
    ("random", 8, {}),
    ("random", 200, {"seed": 1}),
    ("random", 200, {"seed": 2, "spacing_m": 1.5}),
]


@pytest.mark.parametrize(("kind", "num_vertices", "options"), CASES)
def test_map_imports_without_findings_and_is_strongly_connected(
    kind: str, num_vertices: int, options: dict[str, Any], tmp_path: Path
) -> None:
    drawing = GENERATORS[kind](num_vertices, **options)
    map_ = written(drawing, tmp_path)
    assert map_.findings == ()
    assert map_.nav.num_vertices == len(drawing.stations) >= num_vertices
    assert map_.nav.num_edges == len(drawing.lanes)
    assert num_strong_parts(map_.nav) == 1
    assert len(map_.nav.vertex_of_name) >= map_.nav.num_vertices
    assert map_.building is not None
    walls = map_.building.levels["L1"].wall_xy.reshape(-1, 2)
    assert np.ptp(walls, axis=0) == pytest.approx((drawing.width_m, drawing.height_m), abs=1e-4)


def test_warehouse_counts_are_those_of_its_shape() -> None:
    # 5 cross aisles, 3 bays: an aisle has 5 junctions, 4 times 3 bays, a dock and a charger or parking place: 19 vertices
    drawing = rack_warehouse(95, cross_aisles=5, bays=3)
    assert len(drawing.stations) == 5 * 19
    # an aisle has 4 times 4 lanes and 2 to its ends; 5 cross aisles have 4 lanes each
    assert len(drawing.lanes) == 5 * 18 + 5 * 4
    assert len(rack_warehouse(96, cross_aisles=5, bays=3).stations) == 6 * 19


def test_grid_and_ring_counts_are_those_of_their_shape() -> None:
    assert (len(street_grid(4).stations), len(street_grid(4).lanes)) == (6, 7)  # 3 columns, 2 rows
    assert (len(ring(20).stations), len(ring(20).lanes)) == (20, 20)  # ten on the loop, ten beside it
    assert len(random_roads(50).stations) == 50


@pytest.mark.parametrize("draw", [rack_warehouse, street_grid])
def test_one_way_lanes_alternate(draw: Any, tmp_path: Path) -> None:
    nav = written(draw(200, one_way=True), tmp_path).nav
    step = nav.xy[nav.head] - nav.xy[nav.tail]
    alone = nav.reverse < 0
    northward = alone & (np.abs(step[:, 0]) < 1e-6)
    columns = sorted({(round(float(x), 2), bool(dy > 0)) for (x, _), dy in zip(nav.xy[nav.tail[northward]], step[northward, 1])})
    assert len(columns) == len({x for x, _ in columns})  # one direction a column
    assert all(up != next_up for (_, up), (_, next_up) in pairwise(columns))


def test_vertices_stand_apart(tmp_path: Path) -> None:
    for kind, num_vertices, options in CASES:
        nav = written(GENERATORS[kind](num_vertices, **options), tmp_path).nav
        apart = np.hypot(*(nav.xy[:, None] - nav.xy).transpose(2, 0, 1)) + 9 * np.eye(nav.num_vertices)
        assert apart.min() > 0.74  # half the spacing of random maps; two cells elsewhere


def test_seed_decides_a_random_map() -> None:
    assert random_roads(60, seed=5).text() == random_roads(60, seed=5).text()
    assert random_roads(60, seed=5).text() != random_roads(60, seed=6).text()


def test_generated_map_has_cells_around_its_lanes(tmp_path: Path) -> None:
    nav = written(rack_warehouse(120), tmp_path).nav
    grid = paper_grid(nav, 0.4)
    assert grid.num_components == 1
    off = np.abs(grid.xy[grid.vertex_of_station] - nav.xy).max(axis=1)
    assert (off < 0.01).sum() > 0.6 * nav.num_vertices  # all but the outermost lanes lie in the middle of cells


def test_command_writes_a_map_for_robots(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "big.building.yaml"
    assert main(["generate", "warehouse", "--robots-for", "20", "--one-way", "--out", str(out)]) == 0
    map_ = load_map(out)
    assert map_.name == "big"
    assert 200 <= map_.nav.num_vertices < 240
    assert f"{map_.nav.num_vertices} vertices, {map_.nav.num_edges} edges" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["warehouse", "--vertices", "50"], "--out"),
        (["wherehouse", "--vertices", "50", "--out", "a.building.yaml"], "warehouse"),
        (["grid", "--out", "a.building.yaml"], "--robots-for --vertices"),
        (["grid", "--vertices", "1", "--out", "a.building.yaml"], "4 to 250000 vertices, not 1"),
        (["grid", "--vertices", "999999", "--out", "a.building.yaml"], "4 to 250000 vertices, not 999999"),
        (["grid", "--robots-for", "0", "--out", "a.building.yaml"], "--robots-for 0"),
        (["grid", "--vertices", "50", "--spacing", "nan", "--out", "a.building.yaml"], "0.8 m or more"),
        (["grid", "--vertices", "50", "--spacing", "inf", "--out", "a.building.yaml"], "0.8 m or more"),
        (
            ["ring", "--vertices", "50", "--bays", "3", "--out", "a.building.yaml"],
            "--bays is not for a map of kind 'ring', only for warehouse",
        ),
        (["random", "--vertices", "50", "--seed", "-1", "--out", "a.building.yaml"], "--seed -1"),
        (["warehouse", "--vertices", "50", "--bays", "0", "--out", "a.building.yaml"], "1 bay or more"),
        (["warehouse", "--vertices", "50", "--cross-aisles", "1", "--out", "a.building.yaml"], "2 or more cross aisles, not 1"),
        (["warehouse", "--vertices", "50", "--cross-aisles", "3", "--one-way", "--out", "a.building.yaml"], "2, 4, 6, ..."),
        (["grid", "--vertices", "50", "--out", "a.yaml"], "ends in .building.yaml"),
        (["grid", "--vertices", "50", "--out", "none/a.building.yaml"], "no such file or directory"),
    ],
)
def test_bad_input_is_one_line(
    arguments: list[str], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["generate", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_names_that_yaml_would_misread_survive(tmp_path: Path) -> None:
    drawing = Drawing("007", 10.0, 10.0)
    drawing.lane(drawing.station(1, 1, "no"), drawing.station(5, 5, "12"), drawing.station(9, 1, "dock: 'north'"))
    map_ = written(drawing, tmp_path)
    assert map_.findings == ()
    assert map_.building is not None
    assert map_.building.name == "007"
    assert map_.nav.vertex_name == ("no", "12", "dock: 'north'")


def test_drawing_refuses_what_no_map_can_hold() -> None:
    drawing = Drawing("small", 10.0, 10.0)
    a = drawing.station(1, 1, "here")
    with pytest.raises(MapError, match="already a station 'here'"):
        drawing.station(2, 2, "here")
    with pytest.raises(MapError, match="already a station"):
        drawing.station(1, 1)
    with pytest.raises(MapError, match="cannot join stations 0 and 7"):
        drawing.lane(a, 7)
    with pytest.raises(MapError, match="cannot join stations 0 and 0"):
        drawing.lane(a, a)
