"""The referee on small worlds whose verdict is known by hand."""

import numpy as np
import pytest

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.core.plan import Plan, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.traffic.referee import describe, judge

STEP_S = 2.0
ROBOT = RobotType("small", 0.2, 0.2, 1.0, 1.0, 1.0, 1.0)


def world(starts, goals, width=4, height=3):
    """A 4-connected grid, vertex y * width + x, one robot a start."""
    xy = [(x, y) for y in range(height) for x in range(width)]
    lanes = [(i, j) for i, (x, y) in enumerate(xy) for j, (u, v) in enumerate(xy) if abs(x - u) + abs(y - v) == 1]
    nav = nav_graph(name="grid", xy=xy, lanes=lanes)
    graph = plan_graph(nav, kind="grid", cell_m=1.0)
    return Problem(graph, fleet_of(ROBOT, len(starts)), np.array(starts), np.array(goals), np.arange(len(starts)), STEP_S)


def verdict(paths, **size):
    problem = world([p[0] for p in paths], [p[-1] for p in paths], **size)
    return judge(problem, plan_of_paths(paths, STEP_S)), problem


def test_plan_without_meeting_is_valid():
    found, _ = verdict([[0, 1, 2], [4, 5, 6]])
    assert found.valid
    assert found.following == ()


def test_two_robots_at_one_vertex_is_a_vertex_conflict_with_place_and_time():
    found, problem = verdict([[0, 1, 2], [5, 1, 1, 0]])
    assert [(c.kind, c.vertex, c.t_s) for c in found.conflicts] == [("vertex", 1, 2.0)]
    assert describe(found.conflicts[0], problem) == "robot_0 and robot_1 meet at 'v1' at 2 s"


def test_summary_names_the_first_conflicts():
    """Four robots stay at one vertex: six pairs."""
    found, problem = verdict([[0, 1], [1], [2, 1], [5, 1]])
    first = "; ".join(describe(conflict, problem) for conflict in found.conflicts[:2])
    assert len(found.conflicts) == 6 and found.summary(problem, 2) == f"6 conflicts: {first}; ..."
    assert found.summary(problem, 6).endswith(describe(found.conflicts[5], problem))


def test_swap_is_an_edge_conflict():
    found, _ = verdict([[0, 1], [1, 0]])
    assert [(c.kind, c.robot, c.other, c.vertex, c.next_vertex, c.t_s) for c in found.conflicts] == [("edge", 0, 1, 0, 1, 0.0)]


def test_robot_that_stays_at_its_goal_is_an_obstacle_for_ever():
    found, _ = verdict([[1], [4, 0, 1, 2]])
    assert [(c.kind, c.vertex, c.t_s) for c in found.conflicts] == [("vertex", 1, 4.0)]


def test_train_follows_and_is_valid():
    found, _ = verdict([[1, 2, 3], [0, 1, 2]])
    assert found.valid
    assert [(c.vertex, c.t_s) for c in found.following] == [(1, 0.0), (2, 2.0)]


def test_rotation_is_valid_and_all_following():
    found, _ = verdict([[0, 1], [1, 5], [5, 4], [4, 0]])
    assert found.valid
    assert found.count("following") == 4


def test_waiting_robot_lets_the_other_pass():
    found, _ = verdict([[0, 0, 0, 1, 2], [5, 1, 2, 3]])
    assert found.valid


@pytest.mark.parametrize(
    ("paths", "words"),
    [
        ([[0, 2]], "robot_0 jumps from 'v0' to 'v2' at 0 s"),
        ([[0, 1, 6]], "robot_0 jumps from 'v1' to 'v6' at 2 s"),
    ],
)
def test_jump_is_a_fault(paths, words):
    found, _ = verdict(paths)
    assert not found.valid
    assert words in found.faults[0]


def test_the_first_vertex_that_the_graph_does_not_have_is_a_fault():
    found = judge(world([0], [2]), plan_of_paths([[0, 12, 99, 2]], STEP_S))
    assert found.faults == ("robot_0 visits vertex 12, which the graph does not have",)


def test_wrong_start_and_goal_are_faults():
    problem = world([0, 4], [1, 5])
    found = judge(problem, plan_of_paths([[1], [4, 5, 6]], STEP_S))
    assert found.faults == (
        "robot_0 begins at 'v1', not at its start 'v0'",
        "robot_1 ends at 'v6', not at its goal 'v5'",
    )


@pytest.mark.parametrize(("goal_of", "faults"), [([0], ("robot_0 ends at 'v8', not at its goal 'v0'",)), ([-1], ())])
def test_a_robot_may_end_anywhere_only_if_it_has_no_goal(goal_of, faults):
    assert judge(world([4], [0]).assigned(np.array(goal_of)), plan_of_paths([[4, 8]], STEP_S)).faults == faults


def test_lane_driven_too_fast_is_a_fault():
    problem = world([0], [1])
    plan = Plan(np.array([0, 2]), np.array([0, 1]), np.array([0.0, 1.0]), np.array([0.0, np.inf]))
    assert "needs 1 s" in judge(problem, plan).faults[0]
    problem = world([0], [2])  # its second lane, which takes two seconds
    plan = Plan(np.array([0, 3]), np.arange(3), np.array([0.0, 3.0, 5.5]), np.array([1.0, 4.0, np.inf]))
    assert judge(problem, plan).faults == ("robot_0 needs 1.5 s from 'v1' to 'v2' at 4 s, a lane takes 2 s",)


def test_overtaking_on_a_lane_is_an_edge_conflict_in_continuous_time():
    problem = world([0, 4], [2, 1])
    plan = Plan(
        np.array([0, 3, 6]),
        np.array([0, 1, 2, 4, 0, 1]),
        np.array([0.0, 9.0, 11.0, 0.0, 4.0, 6.5]),
        np.array([1.0, 9.0, np.inf, 2.0, 4.0, np.inf]),
    )
    kinds = {c.kind for c in judge(problem, plan).conflicts}
    assert kinds == {"edge", "vertex"}


def brute_force(paths):
    """Robots and kind of every conflict, by looking at every pair at every step."""
    horizon = max(map(len, paths))
    at = [list(p) + [p[-1]] * (horizon - len(p)) for p in paths]
    found = set()
    for t in range(horizon):
        for i in range(len(at)):
            for j in range(i):
                if at[i][t] == at[j][t]:
                    found.add((j, i, "vertex"))
                if t and at[i][t] == at[j][t - 1] and at[i][t - 1] == at[j][t] and at[i][t] != at[j][t]:
                    found.add((j, i, "edge"))
                for a, b in ((i, j), (j, i)):
                    if t and at[a][t] == at[b][t - 1] and at[a][t - 1] != at[a][t] != at[b][t]:
                        found.add((j, i, "following"))
    return found


@pytest.mark.parametrize("seed", range(60))
def test_referee_agrees_with_brute_force_on_random_walks(seed):
    rng = np.random.default_rng(seed)
    problem = world([0], [0])
    first, head = problem.graph.first, problem.graph.head
    paths = []
    for start in rng.permutation(12)[:5]:
        path = [int(start)]
        for _ in range(int(rng.integers(1, 8))):
            path.append(int(rng.choice([path[-1], *head[first[path[-1]] : first[path[-1] + 1]]])))
        while len(path) > 1 and path[-1] == path[-2]:
            path.pop()
        paths.append(path)
    goals = [p[-1] for p in paths]
    expected = brute_force(paths)
    if len(set(goals)) < len(goals):
        assert expected  # two robots stay at one vertex
        return
    problem = world([p[0] for p in paths], goals)
    found = judge(problem, plan_of_paths(paths, STEP_S))
    assert {(c.robot, c.other, c.kind) for c in (*found.conflicts, *found.following)} == expected
