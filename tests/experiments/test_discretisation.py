"""`discretisation: auto`: lanes where the map has them, grids elsewhere; walls, one-ways, and maps with room for fewer robots."""

import numpy as np
import pytest

from mrp_sumo.core.graph import PlanGraph, nav_graph
from mrp_sumo.errors import ScenarioError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import carry_out
from mrp_sumo.experiments.staging.discretisation import with_drawn_one_ways
from mrp_sumo.experiments.staging.set_up import set_up
from mrp_sumo.io.scenario.read import scenario_of
from mrp_sumo.maps.grid import paper_grid

SQUARE = """building_name: square
levels:
  L1:
    lanes: [[0, 1, {}], [1, 2, {}], [2, 3, {}], [3, 0, {}]]
    vertices: [[0, 0, {name: a}], [4, 0, {name: b}], [4, 4, {name: c}], [0, 4, {name: d}]]
"""  # a ring of one-ways
GAP = """name: gap
coordinate_system: cartesian_meters
levels:
  L1:
    vertices: [[0, 0, 0, west], [4, 0, 0, mid], [8, 0, 0, east], [6, -3, 0, ""], [6, -0.2, 0, ""], [6, 0.2, 0, ""], [6, 3, 0, ""]]
    lanes: [[0, 1, {bidirectional: [4, true], graph_idx: [2, 0]}], [1, 2, {bidirectional: [4, true], graph_idx: [2, 0]}]]
    walls: [[3, 4, {}], [5, 6, {}]]
"""  # 0.4 m wide: a TurtleBot3 drives and turns in it, an AMR does not get through


def chosen(folder, name, text, **values):
    """The set-up of a scenario on a map."""
    (folder / name).write_text(text)
    with MapCache() as maps:
        return set_up(scenario_of({"map": str(folder / name), "robots": 2, **values}, folder, "s"), maps)


@pytest.mark.parametrize(
    ("map_", "type_", "kind", "cell_m"),
    [
        ("office", "turtlebot3", "roadmap", 0.4),
        ("warehouse", "turtlebot3", "roadmap", 0.4),
        ("plant", "forklift", "roadmap", 2.67),  # the least with which no lane is cut too short
        ("free.map", "turtlebot3", "grid", 0.4),
        ("free.map", "amr_600", "grid", 0.95),
    ],
)
def test_lanes_are_driven_where_there_are_some(tmp_path, map_, type_, kind, cell_m):
    (tmp_path / "free.map").write_text("type octile\nheight 4\nwidth 4\nmap\n" + "....\n" * 4)
    with MapCache() as maps:
        setup = set_up(scenario_of({"map": map_, "robots": {"count": 2, "type": type_}}, tmp_path, "s"), maps)
    graph, choice = setup.problem.graph, setup.scenario.discretisation
    assert (graph.kind, choice.kind) == (kind, kind) and choice.cell_m == pytest.approx(cell_m)
    assert graph.length_m.min() >= setup.problem.fleet.separation_m - 1e-9


def test_a_run_says_what_was_chosen_and_keeps_to_lanes_and_one_ways(tmp_path):
    (tmp_path / "square.nav.yaml").write_text(SQUARE)
    values = {
        "map": str(tmp_path / "square.nav.yaml"),
        "robots": {"starts": ["a"], "goals": ["d"]},
        "execution": {"engine": "kinematic"},
        "record": {"bag": False},
    }
    with MapCache() as maps:
        by_lane = carry_out(scenario_of(values, tmp_path, "s"), maps).result
    assert by_lane["status"] == "completed" and by_lane["discretisation"] == {"kind": "roadmap", "cell_m": 0.4}
    assert by_lane["lanes"] == {"driven_m": pytest.approx(12, abs=0.01), "off_m": 0, "against_one_way_m": 0}  # round the ring


def test_a_grid_of_one_ways_keeps_them_and_says_so(tmp_path):
    setup = chosen(tmp_path, "square.nav.yaml", SQUARE, discretisation="grid")
    graph, nav = setup.problem.graph, setup.map.nav
    assert len(setup.notes) == 1 and setup.notes[0].startswith("a grid leaves the lanes of 'square', of which 4 of 4 (100%) are one-way: ")
    middle, step = (graph.xy[graph.tail] + graph.xy[graph.head]) / 2, graph.xy[graph.head] - graph.xy[graph.tail]
    south = (middle[:, 1] < 1) & (middle[:, 0] > 1) & (middle[:, 0] < 3)
    assert (step[south][:, 0] >= -1e-9).all() and (step[south][:, 0] > 0).any()  # eastwards only
    assert nav.num_lanes == 4


def test_cells_larger_than_the_map_are_refused_by_their_key(tmp_path):
    assert chosen(tmp_path, "square.nav.yaml", SQUARE, discretisation={"kind": "grid", "cell_m": 2}).problem.graph.num_lanes
    with pytest.raises(ScenarioError, match=r"cell_m: found 40 m, but the stations of 'square' lie within 4 x 4 m: no robot could go"):
        chosen(tmp_path, "square.nav.yaml", SQUARE, discretisation={"kind": "grid", "cell_m": 40})


def test_a_two_way_lane_beside_a_one_way_stays_open():
    nav = nav_graph(name="two", xy=[(0, 0), (8, 0), (0, 2), (8, 2)], lanes=[(0, 1), (2, 3), (3, 2), (0, 2), (2, 0)])
    graph, notes = with_drawn_one_ways(nav, paper_grid(nav, 0.4))
    west = graph.xy[graph.head][:, 0] < graph.xy[graph.tail][:, 0] - 1e-9
    inner = (graph.xy[graph.tail][:, 0] > 1) & (graph.xy[graph.tail][:, 0] < 7)
    assert notes and (graph.xy[graph.tail][west & inner][:, 1] > 1).all() and (west & inner).any()


def test_maps_without_one_ways_are_left_alone():
    nav = nav_graph(name="two", xy=[(0, 0), (8, 0)], lanes=[(0, 1), (1, 0)])
    grid = paper_grid(nav, 0.4)
    assert with_drawn_one_ways(nav, grid) == (grid, ())


@pytest.mark.parametrize(("type_", "cut"), [("turtlebot3", None), ("amr_600", "; cut off by that: east")])
def test_lanes_without_room_are_left_out_and_what_that_cuts_off_is_named(tmp_path, type_, cut):
    setup = chosen(tmp_path, "gap.building.yaml", GAP, robots={"count": 1, "type": type_})
    assert [note.endswith(cut) for note in setup.notes] == ([] if cut is None else [True])
    assert np.ptp(setup.problem.graph.xy[np.unique(setup.problem.graph.tail), 0]) > 7  # beyond the gap, too


def test_of_what_is_cut_off_places_with_names_come_first(tmp_path):
    both = "{bidirectional: [4, true], graph_idx: [2, 0]}"
    far = (
        GAP.replace("0, east]", '0, ""]')
        .replace('3, 0, ""]]', '3, 0, ""], [9, 0, 0, east]]')
        .replace("lanes: [", f"lanes: [[2, 7, {both}], ")
    )
    setup = chosen(tmp_path, "gap.building.yaml", far, robots={"count": 1, "type": "amr_600"})
    assert setup.notes[0].endswith("; cut off by that: east, v0")


def test_a_map_that_holds_fewer_robots_says_how_many_and_what_else_would_do(tmp_path):
    line = (
        r"robots.count: 9 robots, but 'square' has 4 stations that reach each other and on which robots may stand at once, "
        r"0.33 m between centres: robots.count: 4 fits; robots.draw: anywhere lets 40 stand between stations, too"
    )
    with pytest.raises(ScenarioError, match=line):
        chosen(tmp_path, "square.nav.yaml", SQUARE, robots=9)
    assert chosen(tmp_path, "square.nav.yaml", SQUARE, robots={"count": 40, "draw": "anywhere"}).problem.num_robots == 40
    assert isinstance(chosen(tmp_path, "square.nav.yaml", SQUARE, robots=4).problem.graph, PlanGraph)


def test_walls_of_a_level_without_lanes_are_not_those_of_the_level_below(tmp_path):
    upstairs = (
        '  L2:\n    vertices: [[2, -1, 0, ""], [2, 1, 0, ""]]\n    walls: [[0, 1, {}]]\n'  # across the lane from west to mid, one level up
    )
    (tmp_path / "gap.building.yaml").write_text(GAP + upstairs)
    values = {"map": str(tmp_path / "gap.building.yaml"), "robots": {"starts": ["west"], "goals": ["east"]}}
    quick = {"execution": {"engine": "kinematic"}, "record": {"bag": False}}
    with MapCache() as maps:
        result = carry_out(scenario_of(values | quick, tmp_path, "s"), maps).result
    assert (result["status"], result["note"]) == ("completed", "")


def test_one_robot_alone_needs_no_room_for_two(tmp_path):
    short = SQUARE.replace("[4, 0, {name: b}]", "[0.2, 0, {name: b}]")
    assert chosen(tmp_path, "short.nav.yaml", short, robots=1).problem.num_robots == 1
    with pytest.raises(ScenarioError, match=r"lane 'a' - 'b' of 'short' is 0.200 m long; .* or one alone"):
        chosen(tmp_path, "short.nav.yaml", short, robots=2)
