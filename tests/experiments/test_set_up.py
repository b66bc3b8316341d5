"""What a scenario says about execution, checked against its map: recovery, closed stretches, mutex groups, lifts."""

from itertools import pairwise

import numpy as np
import pytest

from mrp_sumo.drive.disturbances import Closure
from mrp_sumo.errors import MrpSumoError, ScenarioError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.set_up import set_up
from mrp_sumo.io.scenario import read_scenario

BUILDING = "map: office\ndiscretisation: {kind: roadmap, cell_m: 0.5}\nrobots: {count: 2}\n"


def problem_of(tmp_path, execution):
    path = tmp_path / "scenario.yaml"
    path.write_text(BUILDING + "execution:\n" + "".join(f"  {line}\n" for line in execution))
    with MapCache() as maps:
        return set_up(read_scenario(path), maps)


def test_recovery_is_what_the_scenario_says(tmp_path):
    keys = ["on_deadlock: resolve", "recovery: {give_way: false, patience_s: 7, replanner: pibt}"]
    settings = problem_of(tmp_path, keys).settings
    assert (settings.on_deadlock, settings.give_way, settings.patience_s, settings.replanner) == ("resolve", False, 7.0, "pibt")
    assert problem_of(tmp_path, ["recovery: {replanner: null}"]).settings.replanner == ""
    with pytest.raises(MrpSumoError, match=r"execution.recovery.replanner: .*'lacamm'.*did you mean 'lacam'"):
        problem_of(tmp_path, ["recovery: {replanner: lacamm}"])


def test_a_closed_stretch_is_every_step_between_two_vertices(tmp_path):
    setup = problem_of(tmp_path, ["disturbances: {closures: [{between: [entrance, lobby], begin_s: 5, duration_s: 60}]}"])
    graph, closures = setup.problem.graph, setup.settings.disturbances.closures
    ends = [int(graph.vertex_of_station[setup.map.nav.vertex_of_name[name]]) for name in ("entrance", "lobby")]
    assert [closures[0].tail, closures[-1].head] == ends
    assert all(a.head == b.tail for a, b in pairwise(closures))
    assert all(
        isinstance(c, Closure) and (c.begin_s, c.duration_s) == (5.0, 60.0) and graph.lane_between(c.tail, c.head) >= 0 for c in closures
    )
    with pytest.raises(MrpSumoError, match=r"closures\[0\].between\[1\]: 'loby' is not a vertex of 'office' \(did you mean 'lobby'\?\)"):
        problem_of(tmp_path, ["disturbances: {closures: [{between: [entrance, loby]}]}"])


def test_a_mutex_group_has_its_vertices_and_the_steps_between_them(tmp_path):
    setup = problem_of(tmp_path, ["mutex_groups: {hall: [entrance, lobby]}"])
    graph = setup.problem.graph
    inside = {v for v, options in enumerate(graph.vertex_options) if options.get("mutex") == "hall"}
    assert {graph.label(v) for v in inside} == {"entrance", "lobby"}
    lanes = [lane for lane, options in enumerate(graph.lane_options) if options.get("mutex") == "hall"]
    distance = float(np.hypot(*np.diff(graph.xy[sorted(inside)], axis=0)[0]))
    assert graph.length_m[lanes].sum() == pytest.approx(2 * distance)  # both directions
    with pytest.raises(MrpSumoError, match=r"mutex_groups.hall\[0\]: 'nowhere' is not a vertex of 'office'"):
        problem_of(tmp_path, ["mutex_groups: {hall: [nowhere]}"])


@pytest.mark.parametrize("name", ["turtlebot3", "amr_600", "forklift", "tugger"])
def test_robot_types_of_the_documentation_are_there(tmp_path, name):
    path = tmp_path / "scenario.yaml"
    path.write_text(f"map: office\ndiscretisation: {{kind: roadmap, cell_m: 5}}\nrobots: {{count: 2, type: {name}}}\n")
    from mrp_sumo.experiments.set_up import choices

    assert choices(read_scenario(path))[0].name == name


SHORT = """building_name: hall
levels:
  L1:
    lanes: [[0, 1, {is_bidirectional: true}], [1, 2, {is_bidirectional: true}]]
    vertices: [[0, 0, {name: a}], [0.2, 0, {name: b}], [1.5, 0, {name: c}]]
"""


@pytest.mark.parametrize(
    ("first_m", "cell_m", "told"),
    [
        (0.2, 0.5, "lane 'a' - 'b' of 'hall' is 0.200 m long; no cell length makes a step longer than its lane: join the lane's ends"),
        (1.0, 0.2, "the shortest step of 'hall' is 0.200 m (discretisation.cell_m: 0.34 would do)"),
    ],
)
def test_robot_too_large_for_a_step_names_the_lane_or_the_cell_length_that_would_do(tmp_path, first_m, cell_m, told):
    (tmp_path / "hall.nav.yaml").write_text(SHORT.replace("[0.2, 0,", f"[{first_m}, 0,"))
    path = tmp_path / "scenario.yaml"
    path.write_text(f"map: hall.nav.yaml\ndiscretisation: {{kind: roadmap, cell_m: {cell_m}}}\nrobots: {{count: 1}}\n")
    with MapCache() as maps, pytest.raises(ScenarioError) as error:
        set_up(read_scenario(path), maps)
    assert told in str(error.value)
    if "would do" in told:
        path.write_text(path.read_text().replace(f"cell_m: {cell_m}", f"cell_m: {told.split('cell_m: ')[1].split(' ')[0]}"))
        with MapCache() as maps:
            assert set_up(read_scenario(path), maps).problem.num_robots == 1
