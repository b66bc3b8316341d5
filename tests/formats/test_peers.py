"""Peers' formats: instances are written as they read them, plans are read as they write them."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import nav_graph
from mrp_sumo.core.plan import paths_of_plan, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.formats.instances import POINT
from mrp_sumo.formats.peers import (
    FORMATS,
    cells_of,
    format_of,
    goals_reached,
    movingai_map,
    movingai_scen,
    print_paths,
    read_paths,
    read_places,
    yaml_instance,
)
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.maps.roadmap import cut_lanes
from mrp_sumo.traffic.referee import judge

# row 0 of a picture is the highest: cells (column, row)
#   0 1 2
#   3 @ 4
FREE = np.array([[True, False, True], [True, True, True]])  # lowest row first


@pytest.fixture
def problem():
    graph = grid_graph(FREE, 1.0, (0.0, 0.0), name="u")
    cells = cells_of(graph)
    start = np.array([cells.vertex[0, 1], cells.vertex[2, 0]])
    goal = np.array([cells.vertex[2, 1], cells.vertex[0, 0]])
    return Problem(graph, fleet_of(POINT, 2), start, goal, np.array([0, 1]), 1.0)


@pytest.fixture
def cells(problem):
    return cells_of(problem.graph)


def path(cells, *places):
    return [cells.vertex[place] for place in places]


@pytest.fixture
def plan(cells):
    one = path(cells, (0, 1), (0, 1), (0, 1), (0, 0), (1, 0), (2, 0), (2, 1))
    return plan_of_paths([one, path(cells, (2, 0), (1, 0), (0, 0))], 1.0)


def test_instance_as_movingai(problem, cells):
    assert movingai_map(cells) == "type octile\nheight 2\nwidth 3\nmap\n...\n.@.\n"
    rows = movingai_scen(problem, cells, "u.map").splitlines()
    assert rows == ["version 1", "0\tu.map\t3\t2\t0\t1\t2\t1\t0", "0\tu.map\t3\t2\t2\t0\t0\t0\t0"]


def test_instance_as_yaml(problem, cells):
    document = yaml.safe_load(yaml_instance(problem, cells))
    assert document["map"] == {"dimensions": [3, 2], "obstacles": [[1, 1]]}
    assert document["agents"][1] == {"name": "agent1", "start": [2, 0], "goal": [0, 0]}


def test_roadmap_as_yaml_and_back():
    nav = nav_graph(name="r", xy=[[0, 0], [1, 0], [2, 0]], lanes=[(0, 1), (1, 2), (2, 1)], vertex_name=("a", "", "a"))
    problem = Problem(cut_lanes(nav, 1.0), fleet_of(POINT, 1), np.array([0]), np.array([2]), np.array([0]), 1.0)
    document = yaml.safe_load(yaml_instance(problem, None))
    assert document["roadmap"]["undirected"] is False
    assert document["roadmap"]["edges"] == [["a", "v1"], ["v1", "v2"], ["v2", "v1"]]
    assert document["agents"] == [{"name": "agent0", "start": "a", "goal": "v2"}]
    plan = plan_of_paths([[0, 0, 1, 2]], 1.0)
    text = print_paths(problem, plan, None, "yaml")
    assert (read_paths(text, problem, None).vertex == plan.vertex).all()
    with pytest.raises(PlanError, match="not on a grid"):
        print_paths(problem, plan, None, "lacam")


@pytest.mark.parametrize("kind", FORMATS)
def test_plans_come_back_from_every_format(problem, cells, plan, kind):
    text = print_paths(problem, plan, cells, kind)
    assert format_of(text) == kind
    back = read_paths(text, problem, cells)
    assert all((a == b).all() for a, b in zip(paths_of_plan(plan, 1.0), paths_of_plan(back, 1.0), strict=True))


def test_eecbs_writes_row_before_column(problem, cells):
    text = "Agent 0: (1,0)->(0,0)->(0,1)->\nAgent 1: (0,2)->\n"
    assert paths_of_plan(read_paths(text, problem, cells), 1.0)[0].tolist() == path(cells, (0, 1), (0, 0), (1, 0))


def test_yaml_is_read_by_position_since_times_may_repeat(problem, cells):
    text = """
schedule:
  agent0: [{x: 0, y: 1, t: 0}, {x: 0, y: 0, t: 1}, {x: 1, y: 0, t: 1}]
  agent1: [{x: 2, y: 0, t: 0}]
"""
    assert len(paths_of_plan(read_paths(text, problem, cells), 1.0)[0]) == 3


def test_smart_may_leave_out_waits(problem, cells):
    text = "Agent 0:(0,1,0)->(0,1,2)->(0,0,3)->\nAgent 1:(2,0,0)->\n"
    assert paths_of_plan(read_paths(text, problem, cells), 1.0)[0].tolist() == path(cells, (0, 1), (0, 1), (0, 1), (0, 0))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "not a plan in a known format"),
        ("Agent 0: (1,0)->(1,1)->\nAgent 1: (0,2)->", r"robot_0 is at cell \(1, 1\) at step 1, which is blocked"),
        ("Agent 0: (1,0)->(2,0)->\nAgent 1: (0,2)->", r"robot_0 is at cell \(0, 2\) at step 1, which is off the map"),
        ("Agent 0: (1,0)->", "paths of 1 agents, the problem has 2 robots"),
        ("Agent 0: (1,0)->\nAgent 0: (1,0)->", "agent 0 comes twice"),
        ("Agent 0: (1,0)->oops\nAgent 1: (0,2)->", "agent 0 has 'oops' in its path"),
        ("Agent 0:(0,1,0)->(0,0,2)->\nAgent 1:(2,0,0)->", "agent 0 has nothing between times 0 and 2"),
        ("Agent 0:(0,1,1)->\nAgent 1:(2,0,0)->", "agent 0 has time 1 at position 0"),
        ("Agent 0:\nAgent 1: (0,2)->", "robot_0 has no path"),
        ("solution=\n0:(0,1),(2,0),\n2:(0,1),(2,0),", "step 2 follows step 0"),
        ("solution=\n0:(0,1),", "1 agents at step 0, the problem has 2"),
        ("solution=\n", "not solved"),
        ("schedule: 3", "schedule is not a mapping"),
        ("schedule:\n  agent0:\n  - {x: 0, y: 1, t: 0}", "schedule has no agent1"),
        ("schedule:\n  agent0:\n  - {x: 0, y: left}\n  agent1: []", r"schedule.agent0\[0\]"),
        ("schedule:\n  agent0:\n  - {x: 0, y: 1, t: 0}\n  - {x: 0, y: 0, t: 2}\n  agent1: []", r"schedule.agent0\[1\] has t 2, expected 1"),
        ("schedule:\n  agent0:\n  - {x: 0, y: 1, t: -1}\n  agent1: []", r"schedule.agent0\[0\] has t -1, expected 0"),
        ("schedule: [", "not YAML"),
    ],
)
def test_flawed_plans_are_refused_in_one_line(problem, cells, text, says):
    with pytest.raises(PlanError, match=says) as error:
        read_paths(text, problem, cells)
    assert "\n" not in str(error.value)


def test_unsolved_lacam_result_is_no_plan(problem, cells):
    text = "agents=2\nsolved=0\ncomp_time_initial_solution=-1\nsolution=\n"
    for num_robots in (2, None):
        with pytest.raises(PlanError, match="not solved"):
            read_places(text, num_robots)


def test_goals_reached_are_the_assignment_of_a_plan(problem, cells):
    ends = plan_of_paths([path(cells, (0, 1), (0, 0)), path(cells, (2, 0), (2, 1))], 1.0)
    assert goals_reached(problem, ends).tolist() == [1, 0]
    astray = plan_of_paths([path(cells, (0, 1)), path(cells, (2, 0), (2, 1))], 1.0)
    assert goals_reached(problem, astray).tolist() == [1, 0]  # and the referee says that robot 0 is not there
    assert "not at its goal" in judge(problem, astray, goals_reached(problem, astray)).faults[0]
    one_goal = replace(problem, goal=problem.goal[:1], goal_of=np.full(2, -1))
    assert goals_reached(one_goal, astray).tolist() == [-1, 0]


@pytest.mark.parametrize(
    "text",
    [
        "Agent 0: (0,0)->(" + "9" * 5000 + ",0)->\nAgent 1: (1,1)->\n",
        "Agent " + "9" * 5000 + ": (0,0)->\n",
        "Agent 0:(0,0,0)->(0,0,99999999999)->\n",
        "Agent 0:(0,0,0)->(0,0,1.2.3)->\n",
        "agents=99999999999\nsolved=1\nsolution=\n0:(0,0),\n",
        "agents=" + "9" * 5000 + "\nsolved=1\nsolution=\n",
        "agents=1\nsolution=\n" + "9" * 5000 + ":(0,0),\n",
    ],
    ids=lambda text: text[:30],
)
def test_numbers_beyond_range_are_refused_before_they_are_used(text):
    with pytest.raises(PlanError) as caught:
        read_places(text, None, "plan.txt")
    assert len(str(caught.value).splitlines()) == 1
