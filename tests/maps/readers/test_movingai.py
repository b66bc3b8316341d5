"""MovingAI grids and problem sets."""

import pytest

from mrp_sumo.errors import MapError
from mrp_sumo.formats.instances import read_instance
from mrp_sumo.io.map_files import write_map
from mrp_sumo.maps.facts import facts
from mrp_sumo.maps.load import load_map

GRID = "type octile\nheight 3\nwidth 4\nmap\n@@@@\n..G@\n.T.@\n"
PROBLEMS = "version 1\n0\tmaps/small.map\t4\t3\t0\t1\t2\t2\t3.0\n0\tmaps/small.map\t4\t3\t2\t1\t0\t2\t3.0\n"


@pytest.fixture
def grid(tmp_path):
    path = tmp_path / "small.map"
    path.write_text(GRID)
    return path


def test_the_last_row_is_the_lowest(grid):
    result = load_map(grid, cell_m=1.0)
    assert result.nav.xy.tolist() == [[0.5, 0.5], [2.5, 0.5], [0.5, 1.5], [1.5, 1.5], [2.5, 1.5]]
    assert result.nav.num_edges == 4
    assert result.nav.kind == "grid"
    assert facts(result)["grid"] == {"cell_m": 1.0, "width": 4, "height": 3, "total": 12, "free": 5, "blocked": 7}


def test_problem_sets_name_cells_from_the_top(grid):
    path = grid.with_suffix(".scen")
    path.write_text(PROBLEMS)
    assert load_map(path, cell_m=1.0).name == "small"  # of the map beside it
    problem = read_instance(grid, path).problem
    assert problem.graph.xy[problem.start].tolist() == [[0.5, 1.5], [2.5, 1.5]]
    assert problem.graph.xy[problem.target].tolist() == [[2.5, 0.5], [0.5, 0.5]]


def test_what_is_written_reads_the_same(grid, tmp_path):
    write_map(load_map(grid), tmp_path / "again.map")
    assert (tmp_path / "again.map").read_text() == GRID.replace("T", "@").replace("G", ".")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (".T.@", ".X.@", "small.map:7: column 2 is 'X', expected one of"),
        (".T.@", ".T.", "small.map:7: a row of 3 characters, but the header says 4"),
        (".T.@\n", "", "2 rows, but the header says 3"),
        (".T.@\n", ".T.@\n....\n", "small.map:8: more rows than the header's 3"),
        ("height 3", "height -3", "small.map:2: height is '-3', expected a whole number above 0"),
        ("height 3", "depth 3", "small.map:2: 'depth 3' in the header"),
        ("width 4\n", "", "the header has no 'width' line"),
        ("..G@\n.T.@", "@@@@\n@@@@", "no free cell"),
        ("height 3\nwidth 4", "height 99999\nwidth 99999", "99999 x 99999 cells; more than"),
    ],
)
def test_broken_grids_are_refused(grid, old, new, message):
    grid.write_text(GRID.replace(old, new))
    with pytest.raises(MapError) as error:
        load_map(grid)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("small.map", "other.map", "map 'maps/other.map' of 4 x 3, but"),
        ("\t0\t1\t2", "\t9\t1\t2", "small.scen:2: cell outside the 4 x 3 map"),
        ("\t0\t1\t2", "\tx\t1\t2", "small.scen:2: expected bucket, map"),
        (PROBLEMS[10:], "", "no rows"),
    ],
)
def test_broken_problem_sets_are_refused(grid, old, new, message):
    path = grid.with_suffix(".scen")
    path.write_text(
        PROBLEMS.replace(old, new) if old != "small.map" else PROBLEMS[:10] + PROBLEMS[10:].replace(old, new, 1).replace("X", "")
    )
    with pytest.raises(MapError) as error:
        load_map(path)
    assert message.replace("map 'maps/other.map' of", "") in str(error.value) or message in str(error.value)
