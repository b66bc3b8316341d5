"""What a scenario says about execution, checked against its map: recovery, closed stretches, mutex groups, lifts."""

import json
from itertools import pairwise

import numpy as np
import pytest

from mrp_sumo.core.disturbances import ClosedLane
from mrp_sumo.core.driving import RecoveryOptions
from mrp_sumo.core.facilities import door_names, lift_names
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import MrpSumoError, ScenarioError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.staging.set_up import set_up
from mrp_sumo.io.scenario.read import read_scenario
from mrp_sumo.maps.catalogue import bundled_folder
from mrp_sumo.maps.clearance import narrow
from mrp_sumo.planning.costs import costs_of

BUILDING = "map: office\ndiscretisation: {kind: roadmap, cell_m: 0.5}\nrobots: {count: 2}\n"


def problem_of(tmp_path, execution):
    path = tmp_path / "scenario.yaml"
    path.write_text(BUILDING + "execution:\n" + "".join(f"  {line}\n" for line in execution))
    with MapCache() as maps:
        return set_up(read_scenario(path), maps)


def test_recovery_is_what_the_scenario_says(tmp_path):
    keys = ["on_deadlock: resolve", "recovery: {give_way: false, patience_s: 7, replanner: pibt}"]
    settings = problem_of(tmp_path, keys).settings
    assert (settings.on_deadlock, settings.recovery) == ("resolve", RecoveryOptions(give_way=False, patience_s=7.0, replanner="pibt"))
    assert problem_of(tmp_path, ["recovery: {replanner: null}"]).settings.recovery.replanner is None
    with pytest.raises(MrpSumoError, match=r"execution.recovery.replanner: .*'lacamm'.*did you mean 'lacam'"):
        problem_of(tmp_path, ["recovery: {replanner: lacamm}"])


def test_a_closed_stretch_is_every_step_between_two_vertices(tmp_path):
    setup = problem_of(tmp_path, ["disturbances: {closures: [{between: [entrance, lobby], begin_s: 5, duration_s: 60}]}"])
    graph, closures = setup.problem.graph, setup.settings.closed_lanes
    ends = [int(graph.vertex_of_station[setup.map.nav.vertex_of_name[name]]) for name in ("entrance", "lobby")]
    assert [closures[0].tail, closures[-1].head] == ends
    assert all(a.head == b.tail for a, b in pairwise(closures))
    assert all(
        isinstance(c, ClosedLane) and (c.begin_s, c.duration_s) == (5.0, 60.0) and graph.lane_between(c.tail, c.head) >= 0 for c in closures
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


TYPES = sorted(path.stem for path in bundled_folder("robots").glob("*.yaml"))


def test_types_come_with_what_plants_drive():
    wanted = {"pallet_truck", "counterbalance_forklift", "tugger", "unit_load_agv", "amr_lift", "omni_mover"}
    assert wanted <= set(TYPES) and len(TYPES) == 9


@pytest.mark.parametrize("name", TYPES)
def test_robot_types_that_come_with_it_can_be_named_and_say_where_they_are_from(tmp_path, name):
    path = tmp_path / "scenario.yaml"
    path.write_text(f"map: office\ndiscretisation: {{kind: roadmap, cell_m: 5}}\nrobots: {{count: 2, type: {name}}}\n")
    from mrp_sumo.experiments.staging.choices import choices

    (model,) = choices(read_scenario(path))[0]
    assert model.name == name and model.source and model.battery
    if name not in ("turtlebot3", "amr_600", "forklift"):
        assert model.loaded and model.actions and model.with_load.battery.mass_kg > model.battery.mass_kg


SHORT = """building_name: hall
levels:
  L1:
    lanes: [[0, 1, {is_bidirectional: true}], [1, 2, {is_bidirectional: true}]]
    vertices: [[0, 0, {name: a}], [0.2, 0, {name: b}], [1.5, 0, {name: c}]]
"""


@pytest.mark.parametrize(
    ("second", "remedy"),
    [
        (
            "[0.2, 0, {name: b}]",
            "lane 'a' - 'b' of 'hall' is 0.200 m long; 'a' - 'b' cannot be joined, as both ends have a name or properties: "
            "lengthen it in the map, or choose smaller robots, or one alone, or let one at a time drive there "
            "(discretisation.short_lanes: drive)",
        ),
        (
            "[0.2, 0]",
            "lane 'a' - 'v1' of 'hall' is 0.200 m long; map.join_short_m: 0.326 would join its ends, with discretisation.cell_m: 0.34",
        ),
        ("[1.0, 0]", "the shortest step of 'hall' is 0.200 m (discretisation.cell_m: 0.34 would do)"),
    ],
)
def test_robot_too_large_for_a_step_learns_which_lane_it_is_and_what_would_help(tmp_path, second, remedy):
    (tmp_path / "hall.nav.yaml").write_text(SHORT.replace("[0.2, 0, {name: b}]", second))
    path = tmp_path / "scenario.yaml"
    path.write_text("map:\n  file: hall.nav.yaml\ndiscretisation:\n  kind: roadmap\n  cell_m: 0.2\nrobots: {count: 2, draw: mrp_bench}\n")
    with MapCache() as maps, pytest.raises(ScenarioError) as error:
        set_up(read_scenario(path), maps)
    assert remedy in str(error.value)
    if "cell_m: " not in remedy:
        return
    text = path.read_text().replace("cell_m: 0.2", f"cell_m: {remedy.split('cell_m: ')[1].split(' ')[0]}")  # take its advice
    if "join_short_m: " in remedy:
        text = text.replace("hall.nav.yaml", f"hall.nav.yaml\n  join_short_m: {remedy.split('join_short_m: ')[1].split(' ')[0]}")
    path.write_text(text)
    with MapCache() as maps:
        assert set_up(read_scenario(path), maps).problem.num_robots == 2


def test_robots_drive_lanes_that_are_too_short_for_two_of_them_one_at_a_time(tmp_path):
    """One from c to b and beyond: the other has left a by then."""
    (tmp_path / "hall.nav.yaml").write_text(SHORT)
    path = tmp_path / "scenario.yaml"
    path.write_text(
        "map:\n  file: hall.nav.yaml\ndiscretisation: {kind: roadmap, cell_m: 0.4, short_lanes: drive}\n"
        "robots: {starts: [a, c], goals: [c, a]}\nexecution: {engine: kinematic}\nplanner: lacam\n"
    )
    with MapCache() as maps:
        setup = set_up(read_scenario(path), maps)
        assert setup.problem.graph.length_m.min() == pytest.approx(0.2)
        path.write_text(path.read_text().replace("cell_m: 0.4", "cell_m: 0.2"))
        with pytest.raises(ScenarioError, match=r"discretisation.cell_m: 0.38 would do"):
            set_up(read_scenario(path), maps)


# a grid that reaches into walls
WIDE_CELLS = "map: office\nseed: 3000\nrobots: {count: 9}\ndiscretisation:\n  kind: grid\n  cell_m: 1.0\n  clearance: "


def test_a_map_without_room_is_refused_where_the_scenario_says_so(tmp_path):
    path = tmp_path / "scenario.yaml"
    path.write_text(WIDE_CELLS + "refuse\n")
    with MapCache() as maps, pytest.raises(ScenarioError) as refused:
        set_up(read_scenario(path), maps)
    (line,) = str(refused.value).splitlines()
    assert line.startswith(
        "scenario.yaml:7: discretisation.clearance: 'office': 20 lanes lead through a wall, such as v10 (2.10, -9.90) -> "
    )
    assert line.endswith("; clearance: prune leaves them out")
    with MapCache() as maps:
        fitting = read_scenario(path, {("discretisation", "cell_m"): ("--set", 0.4)})
        assert set_up(fitting, maps).problem.graph.num_vertices == 348


TWO_ROOMS = """name: rooms
coordinate_system: cartesian_meters
levels:
  L1:
    vertices: [[1, 2, 0, west], [9, 2, 0, east], [4.5, 0, 0, ""], [4.5, 1.65, 0, ""], [4.5, 2.35, 0, ""], [4.5, 4, 0, ""]]
    lanes: [[0, 1, {bidirectional: [4, true], graph_idx: [2, 0]}]]
    walls: [[2, 3, {}], [4, 5, {}]]
"""  # a gap of 0.7 m: amr_600, 0.6 m wide, drives through, and has no room to turn, for which it takes 0.85 m


@pytest.mark.parametrize(
    ("cell_m", "line"),
    [
        (2.0, ""),  # cuts at 3, 5 and 7 m: 0.5 m from the wall and more
        (8 / 7, r"s.yaml:2: discretisation.clearance: 'rooms': 1 vertex is closer than 0.42 m to a wall, too close for 'amr_600' to turn, "
         r"the closest v4 \(4.43, 2.00\): 0.36 m; a robot that needs no more than 0.35 m around its centre would fit; clearance: prune"),
    ],
)  # fmt: skip
def test_a_gap_is_passed_where_the_robot_need_not_turn_in_it(tmp_path, cell_m, line):
    path = rooms(tmp_path, cell_m, "refuse")
    with MapCache() as maps:
        if not line:
            assert set_up(read_scenario(path), maps).problem.graph.num_vertices == 5
            return
        with pytest.raises(ScenarioError, match=line):
            set_up(read_scenario(path), maps)


def test_a_goal_that_pruning_cuts_off_is_named(tmp_path):
    with MapCache() as maps, pytest.raises(ScenarioError, match=r"robots.starts\[0\]: robot_0 cannot reach any goal from 'west'"):
        set_up(read_scenario(rooms(tmp_path, 8 / 7, "prune")), maps)


def rooms(tmp_path, cell_m, clearance):
    (tmp_path / "rooms.building.yaml").write_text(TWO_ROOMS)
    path = tmp_path / "s.yaml"
    path.write_text(
        f"map: rooms.building.yaml\ndiscretisation: {{kind: roadmap, cell_m: {cell_m}, clearance: {clearance}}}\n"
        "robots: {type: amr_600, starts: [west], goals: [east]}\n"
    )
    return path


def test_pruned_graphs_have_room_and_are_made_once(tmp_path):
    path = tmp_path / "scenario.yaml"
    path.write_text(WIDE_CELLS + "prune\n")
    with MapCache() as maps:
        pruned = set_up(read_scenario(path), maps)
        assert set_up(read_scenario(path), maps).problem.graph is pruned.problem.graph
        whole = set_up(read_scenario(path, {("discretisation", "clearance"): ("--set", "ignore")}), maps)
    graph, robot = pruned.problem.graph, RobotType("turtlebot3", 0.138, 0.178, 0.22, 2.5, 2.5, 2.84)
    assert graph.num_vertices == whole.problem.graph.num_vertices and graph.num_lanes < whole.problem.graph.num_lanes
    assert narrow(whole.problem.graph, whole.map.building, robot).notes
    assert narrow(graph, pruned.map.building, robot).notes == ()


NARROWS = """coordinate_system: cartesian_meters
levels:
  L1:
    lanes:
    - [0, 1, {bidirectional: [4, true], graph_idx: [2, 0]}]
    - [1, 2, {bidirectional: [4, true], graph_idx: [2, 0]}]
    - [2, 3, {bidirectional: [4, true], graph_idx: [2, 0]}]
    - [1, 4, {bidirectional: [4, true], graph_idx: [2, 0]}]
    vertices: [[0, 0, 0, a], [10, 0, 0, b], [20, 0, 0, c], [30, 0, 0, d], [10, 10, 0, e], [12, -0.4, 0, ''], [18, -0.4, 0, '']]
    walls: [[5, 6, {}]]
name: narrows
"""
CART = "{length_m: 0.4, width_m: 0.4, max_speed_mps: 1, accel_mps2: 1, decel_mps2: 1, turn_rate_rad_s: 1}"
TRUCK = CART.replace("0.4", "1.2")


def mixed(tmp_path, groups):
    (tmp_path / "narrows.building.yaml").write_text(NARROWS)
    path = tmp_path / "scenario.yaml"
    head = "map: narrows.building.yaml\ndiscretisation: {kind: roadmap, cell_m: 2.0}\nassignment: {mode: fixed}\nplanner: cbs\n"
    path.write_text(f"{head}robots:\n" + "".join(f"  - {group}\n" for group in groups))
    with MapCache() as maps:
        return set_up(read_scenario(path), maps)


def test_lanes_without_room_for_a_type_are_none_of_its_lanes(tmp_path):
    setup = mixed(tmp_path, [f"{{type: {CART}, starts: [a], goals: [d]}}", f"{{type: {TRUCK}, starts: [b], goals: [e]}}"])
    problem = setup.problem
    lanes = np.flatnonzero(problem.barred[1])
    assert not problem.barred[0].any() and len(lanes) and (problem.graph.xy[problem.graph.tail[lanes], 0] >= 10).all()
    assert problem.fleet.kind.tolist() == [0, 1] and problem.goal_kind.tolist() == [0, 1]
    assert "'custom_1' has no room on" in setup.notes[0] and "'cbs' plans for all robots as for the slowest" in setup.notes[1]
    assert problem.for_any().graph.num_lanes == problem.graph.num_lanes - len(lanes)
    assert problem.for_reach().graph is problem.graph  # nobody has room at both ends of a lane and not on it


def test_a_goal_that_only_other_types_reach_is_refused(tmp_path):
    with pytest.raises(ScenarioError, match=r"robot_1 cannot reach its goal 'd' from 'b'"):
        mixed(tmp_path, [f"{{type: {CART}, starts: [a], goals: [e]}}", f"{{type: {TRUCK}, starts: [b], goals: [d]}}"])


@pytest.mark.parametrize(
    ("groups", "says"),
    [
        ([f"{{type: {CART}, count: 1}}", f"{{type: {CART.replace('0.4', '1.9')}, count: 1}}"], r"fleet\[1\].type: 'custom_1' does not fit"),
        ([f"{{type: {CART[:-1]}, loaded: {{length_m: 3}}}}, count: 2}}"], r"fleet\[0\].type: 'custom' with its load does not fit"),
        (["{type: turtlebot3}"], r"robots.fleet\[0\]: .*give count, or starts"),
        (["{type: turtelbot3, count: 1}"], r"robots.fleet\[0\].type: 'turtelbot3' is neither .*turtlebot3"),
        (["{type: turtlebot3, count: 2, starts: [a]}"], r"robots.fleet\[0\]: .*1 starts for 2 robots"),
        (["{type: turtlebot3, starts: [a]}", "{type: amr_600, starts: [a]}"], r"robots.fleet: 'a' is the start of two robots"),
    ],
)
def test_what_a_fleet_cannot_be_is_one_line(tmp_path, groups, says):
    with pytest.raises(ScenarioError, match=says) as error:
        mixed(tmp_path, groups)
    assert len(error.value.lines) == 1


def lifts_left(tmp_path, *out):
    """The lifts that planners know of in the hospital, and whether a robot of the ground floor can come to a ward on the third."""
    path = tmp_path / "scenario.yaml"
    outages = ", ".join(f"{{lift: {name}}}" for name in out)
    path.write_text(
        "map: hospital_levels\ndiscretisation: {kind: roadmap, cell_m: 1.2}\nrobots: {starts: [L1_kitchen], goals: [L3_ward_31]}\n"
        f"execution: {{disturbances: {{outages: [{outages}]}}}}\n"
    )
    with MapCache() as maps:
        setup = set_up(read_scenario(path), maps)
    return lift_names(setup.problem.graph), bool(np.isfinite(costs_of(setup.problem, "path")).all())


def test_a_lift_out_of_service_for_good_leaves_the_other_one_or_no_way(tmp_path):
    assert lifts_left(tmp_path) == (["lift_east", "lift_west"], True)
    assert lifts_left(tmp_path, "lift_west") == (["lift_east"], True)
    assert lifts_left(tmp_path, "lift_west", "lift_east") == ([], False)


def test_a_stop_in_a_lift_is_refused_in_a_line(tmp_path):
    path = tmp_path / "scenario.yaml"
    orders = "tasks: {list: [{stops: [L2_lift_west]}]}"
    path.write_text(f"map: hospital_levels\ndiscretisation: {{kind: roadmap, cell_m: 1.0}}\nrobots: {{count: 1}}\n{orders}\n")
    with MapCache() as maps, pytest.raises(ScenarioError, match="tasks: 'L2_lift_west' is in lift 'lift_west', where no robot can stay"):
        set_up(read_scenario(path), maps)


def test_doors_that_are_locked_for_good_or_that_nobody_opens_are_no_way(tmp_path):
    automatic, outage = "doors: automatic", "disturbances: {outages: [{door: boardroom_door}]}"
    known = door_names(problem_of(tmp_path, [automatic]).problem.graph)
    for keys in ([automatic, outage], [automatic, "manual_doors: [boardroom_door]"]):
        setup = problem_of(tmp_path, keys)
        assert door_names(setup.problem.graph) == [name for name in known if name != "boardroom_door"]
        assert any("boardroom_door" in note for note in setup.notes)
        assert "boardroom_door" not in [
            options.get("door") for options in setup.problem.graph.vertex_options
        ]  # who drives past needs no door
    people = "disturbances: {door_passages_per_h: 30}"
    assert door_names(problem_of(tmp_path, [automatic, "manual_doors: [boardroom_door]", people]).problem.graph) == known


@pytest.mark.parametrize(
    ("execution", "line"),
    [
        ("disturbances: {outages: [{door: boardroom_door}]}", r"outages\[0\].door: doors stand open, expected execution.doors: automatic"),
        ("manual_doors: [boardroom_door]", r"manual_doors\[0\]: doors stand open"),
        ("disturbances: {fires: [{begin_s: 3}]}", r"disturbances.fires: no lift joins levels of 'office'"),
        ("disturbances: {outages: [{begin_s: 3}]}", r"outages\[0\]: give lift or door"),
    ],
)
def test_what_a_building_lacks_is_refused_in_one_line(tmp_path, execution, line):
    with pytest.raises(MrpSumoError, match=line):
        problem_of(tmp_path, [execution])


def test_robots_that_stand_out_of_the_cabin_of_a_lift_are_refused(tmp_path):  # of 2.4 m x 2.4 m
    def set_up_with(width_m):
        size = f"length_m: 0.5, width_m: {width_m}, max_speed_mps: 1.0, accel_mps2: 0.5, decel_mps2: 0.5, turn_rate_rad_s: 1.0"
        path = tmp_path / "scenario.yaml"
        path.write_text(
            f"map: hospital_levels\ndiscretisation: {{kind: roadmap, cell_m: 1.2, clearance: ignore}}\n"
            f"robots: {{starts: [L1_kitchen], goals: [L3_ward_31], type: {{{size}}}}}\n"
        )
        with MapCache() as maps:
            return set_up(read_scenario(path), maps)

    assert set_up_with(2.0).problem.num_robots == 1
    with pytest.raises(
        ScenarioError, match=r"robots.type: '.*', 0.5 x 2.8 m, stands 0.\d+ m out of the cabin of lift 'lift_\w+', 2.4 x 2.4 m"
    ):
        set_up_with(2.8)


@pytest.mark.parametrize("side_m", [10.0, 10_000.0])
def test_a_map_that_may_be_in_millimetres_says_so_where_it_is_driven(tmp_path, side_m):
    ends = [{"type": "Feature", "properties": {"id": k}, "geometry": {"type": "Point", "coordinates": [k * side_m, 0]}} for k in range(2)]
    line = {"type": "MultiLineString", "coordinates": [[[0, 0], [side_m, 0]]]}
    edges = [{"type": "Feature", "properties": {"id": 2 + k, "startid": k, "endid": 1 - k}, "geometry": line} for k in range(2)]
    (tmp_path / "line.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": ends + edges}))
    path = tmp_path / "scenario.yaml"
    path.write_text("map: line.geojson\nrobots: {count: 1}\ndiscretisation: roadmap\n")
    with MapCache() as maps:
        notes = set_up(read_scenario(path), maps).notes
    assert notes == (("extent above 1 km: 10000 x 0 m: is the file in millimetres?",) if side_m > 1_000 else ())
