"""The paper's grid, cell by cell, and grids of any occupancy."""

import numpy as np
import pytest
from golden import INSTANCES, MRP_BENCH

from mrp_sumo.core.digraph import strong_components
from mrp_sumo.core.graph import nav_graph
from mrp_sumo.errors import MapError
from mrp_sumo.maps.facts import facts
from mrp_sumo.maps.grid import grid_facts, grid_graph, paper_grid
from mrp_sumo.maps.load import load_map

PAPER = {  # vertices, edges, total and free cells at 0.4 m, total and free at 0.35 m
    "office": (29, 32, 1025, 333, 1288, 391),
    "warehouse": (54, 40, 3009, 788, 3886, 914),
    "airport_terminal": (210, 211, 105700, 7645, 137600, 8772),
}


@pytest.mark.parametrize("name", PAPER)
def test_counts_are_those_of_the_paper(name):
    result = load_map(MRP_BENCH / f"{name}.building.yaml", graph="all")
    at_40, at_35 = facts(result, 0.4), grid_facts(result.nav, 0.35)
    assert (at_40["vertices"], at_40["edges"]) == PAPER[name][:2]
    assert (at_40["grid"]["total"], at_40["grid"]["free"], at_35["total"], at_35["free"]) == PAPER[name][2:]
    assert at_40["grid"]["blocked"] == at_40["grid"]["total"] - at_40["grid"]["free"]


@pytest.mark.parametrize("name", PAPER)
def test_cells_are_those_of_the_published_grids(name):
    rows = (INSTANCES / f"{name}_0.4.map").read_text().splitlines()[4:]
    expected = np.array([[cell in ".GS" for cell in row] for row in rows])
    grid = paper_grid(load_map(MRP_BENCH / f"{name}.building.yaml", graph="all").nav)
    column, row = np.floor((grid.xy - grid.xy.min(axis=0)) / 0.4 + 0.5).astype(int).T
    result = np.zeros_like(expected)
    result[row, column] = True
    assert (result == expected).all()


def test_airport_united_has_two_pieces_although_duplicates_have_no_lanes():
    result = load_map(MRP_BENCH / "airport_terminal.building.yaml", graph="all")
    assert facts(result)["components"] == 2
    assert result.chosen == (0, 1, 2, 4)


def test_a_grid_joins_the_four_neighbours():
    # . . x
    # . x .   row 0 is the lower one
    grid = grid_graph(np.array([[True, False, True], [True, True, False]]), 0.5, (10.0, 20.0))
    assert grid.xy.tolist() == [[10.25, 20.25], [11.25, 20.25], [10.25, 20.75], [10.75, 20.75]]
    assert sorted(zip(grid.tail.tolist(), grid.head.tolist())) == [(0, 2), (2, 0), (2, 3), (3, 2)]
    assert (grid.length_m == 0.5).all()
    assert grid.vertex_of_station.tolist() == [0, 1, 2, 3]
    assert paper_grid(grid) is grid
    assert grid_facts(grid) == {"cell_m": 0.5, "width": 3, "height": 2, "total": 6, "free": 4, "blocked": 2}


def test_a_straight_lane_is_two_cells_wide():
    nav = nav_graph(name="line", xy=[[0, 0], [0, 2]], lanes=[[0, 1], [1, 0]], vertex_name=["south", "north"])
    grid = paper_grid(nav, 0.4)
    # 1 column and 6 rows; there is no column to the left to widen into
    assert grid_facts(nav, 0.4) == {"cell_m": 0.4, "width": 1, "height": 6, "total": 6, "free": 6, "blocked": 0}
    assert [grid.vertex_name[v] for v in grid.vertex_of_station] == ["south", "north"]


def test_levels_have_a_grid_each_joined_by_lifts():
    xy, lanes = [[0, 0], [0, 2], [50, 2], [50, 0]], [[0, 1], [1, 0], [1, 2], [2, 1], [2, 3], [3, 2]]
    options = [{"lift": "goods"} if {a, b} == {1, 2} else {} for a, b in lanes]
    levels = {"level_names": ["L1", "L2"], "level": [0, 0, 1, 1]}
    tower = nav_graph(name="tower", xy=xy, lanes=lanes, length_m=[2, 2, 8, 8, 2, 2], lane_options=options, **levels)
    grid = paper_grid(tower, 0.4)
    assert np.bincount(grid.level).tolist() == [6, 6]  # as each level alone
    (up, down), stop = np.flatnonzero(grid.is_ride), grid.vertex_of_station
    assert [(grid.tail[k], grid.head[k]) for k in (up, down)] == [(stop[1], stop[2]), (stop[2], stop[1])]
    assert len(np.unique(strong_components(grid.num_vertices, grid.tail, grid.head))) == 1


def test_grids_of_too_small_cells_are_refused():
    with pytest.raises(MapError, match="cell length is 0 m"):
        paper_grid(nav_graph(name="line", xy=[[0, 0], [1, 0]], lanes=[[0, 1]]), 0.0)
