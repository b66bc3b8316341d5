"""The referee on small worlds whose verdict is known by hand."""

from dataclasses import replace

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


def verdict_of(paths, **size):
    problem = world([p[0] for p in paths], [p[-1] for p in paths], **size)
    return judge(problem, plan_of_paths(paths, STEP_S)), problem


def test_plan_without_meeting_is_valid():
    result, _ = verdict_of([[0, 1, 2], [4, 5, 6]])
    assert result.valid
    assert result.following == ()


def test_two_robots_at_one_vertex_is_a_vertex_conflict_with_place_and_time():
    result, problem = verdict_of([[0, 1, 2], [5, 1, 1, 0]])
    assert [(c.kind, c.vertex, c.t_s) for c in result.conflicts] == [("vertex", 1, 2.0)]
    assert describe(result.conflicts[0], problem) == "robot_0 and robot_1 meet at 'v1' at 2 s"


def test_summary_names_the_first_conflicts():
    """Four robots stay at one vertex: six pairs."""
    result, problem = verdict_of([[0, 1], [1], [2, 1], [5, 1]])
    first = "; ".join(describe(conflict, problem) for conflict in result.conflicts[:2])
    assert len(result.conflicts) == 6 and result.summary(problem, 2) == f"6 conflicts: {first}; ..."
    assert result.summary(problem, 6).endswith(describe(result.conflicts[5], problem))


def test_swap_is_an_edge_conflict():
    result, _ = verdict_of([[0, 1], [1, 0]])
    assert [(c.kind, c.robot, c.other, c.vertex, c.next_vertex, c.t_s) for c in result.conflicts] == [("edge", 0, 1, 0, 1, 0.0)]


def test_robot_that_stays_at_its_goal_is_an_obstacle_for_ever():
    result, _ = verdict_of([[1], [4, 0, 1, 2]])
    assert [(c.kind, c.vertex, c.t_s) for c in result.conflicts] == [("vertex", 1, 4.0)]


def test_train_follows_and_is_valid():
    result, _ = verdict_of([[1, 2, 3], [0, 1, 2]])
    assert result.valid
    assert [(c.vertex, c.t_s) for c in result.following] == [(1, 0.0), (2, 2.0)]


def test_rotation_is_valid_and_all_following():
    result, _ = verdict_of([[0, 1], [1, 5], [5, 4], [4, 0]])
    assert result.valid
    assert result.count("following") == 4


def test_waiting_robot_lets_the_other_pass():
    result, _ = verdict_of([[0, 0, 0, 1, 2], [5, 1, 2, 3]])
    assert result.valid


@pytest.mark.parametrize(
    ("paths", "words"),
    [
        ([[0, 2]], "robot_0 jumps from 'v0' to 'v2' at 0 s"),
        ([[0, 1, 6]], "robot_0 jumps from 'v1' to 'v6' at 2 s"),
    ],
)
def test_jump_is_a_fault(paths, words):
    result, _ = verdict_of(paths)
    assert not result.valid
    assert words in result.faults[0]


def test_the_first_vertex_that_the_graph_does_not_have_is_a_fault():
    result = judge(world([0], [2]), plan_of_paths([[0, 12, 99, 2]], STEP_S))
    assert result.faults == ("robot_0 visits vertex 12, which the graph does not have",)


def test_wrong_start_and_goal_are_faults():
    problem = world([0, 4], [1, 5])
    result = judge(problem, plan_of_paths([[1], [4, 5, 6]], STEP_S))
    assert result.faults == (
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


def timed(first, vertex, arrive_s, depart_s):
    return Plan(*map(np.array, (first, vertex)), *(np.array(times_s, np.float64) for times_s in (arrive_s, depart_s)))


INF = np.inf


@pytest.mark.parametrize(
    ("plan", "faults"),
    [
        (timed([0, 2], [0, 1], [0, 2], [0, INF]), []),
        (timed([0, 2], [0, 1], [5e-7, 2], [5e-7, INF]), []),
        (timed([0, 2], [0, 1], [0, 2], [9e-7, INF]), []),
        (timed([0, 2], [0, 1], [0, 2], [2e-6, INF]), ["robot_0 needs 2 s from 'v0' to 'v1' at 2e-06 s, a lane takes 2 s"]),
        (timed([0, 2], [0, 1], [1, 4], [1, INF]), ["robot_0 begins at 1 s, not at 0 s"]),
        (timed([0, 2], [0, 1], [-1, 4], [1, INF]), ["robot_0 begins at -1 s, not at 0 s"]),
        (timed([0, 2], [0, 1], [0, 2], [0, 9]), ["robot_0 leaves its last vertex at 9 s"]),
        (timed([0, 2], [0, 1], [0, INF], [0, INF]), ["robot_0 has a visit without a time"]),
        (timed([0, 2], [0, 1], [0, 4], [np.nan, INF]), ["robot_0 has a visit without a time"]),
        (timed([0, 3], [0, 1, 2], [0, 4, 9], [0, 3, INF]), ["robot_0 leaves 'v1' at 3 s, before it arrives at 4 s"]),
        (timed([0, 1, 2], [0, 1], [0, 0], [INF, INF]), ["the plan is for 2 robots, the problem has 1"]),
        (timed([0, 0], [], [], []), ["robot_0 has no visit"]),
        (timed([0, 2], [0, 12], [0, 2], [0, INF]), ["robot_0 visits vertex 12, which the graph does not have"]),
        (timed([0, 2], [0, -1], [0, 2], [0, INF]), ["robot_0 visits vertex -1, which the graph does not have"]),
    ],
)
def test_times_and_places_that_no_robot_can_keep_are_faults(plan, faults):
    assert list(judge(world([0], [2 if len(plan.vertex) == 3 else 1]), plan).faults) == faults


def test_real_times_may_be_shorter_than_a_step_and_those_that_were_planned_are_judged():
    problem = world([0], [1])
    fast = timed([0, 2], [0, 1], [0, 0.5], [0, INF])
    assert judge(problem, fast, in_seconds=True).valid and not judge(problem, fast).valid
    assert judge(problem, replace(fast, in_steps=plan_of_paths([[0, 1]], STEP_S))).valid
    assert judge(problem, timed([0, 2], [0, 1], [0, -1e-5], [0, INF]), in_seconds=True).faults != ()


def test_one_goal_is_of_one_robot():
    problem = world([0, 4], [1, 5])
    plan = plan_of_paths([[0, 1], [4, 5]], STEP_S)
    assert judge(problem, plan).valid and judge(problem, plan, np.array([0, -1])).valid
    assert "two robots are assigned the same goal" in judge(problem, plan, np.array([0, 0])).faults
    assert judge(problem, plan, np.array([1, 0])).faults[0] == "robot_0 ends at 'v1', not at its goal 'v5'"


def test_a_lane_on_which_a_type_has_no_room_is_a_fault_for_that_type():
    problem = world([0, 4], [1, 5])
    lane = problem.graph.lane_between(0, 1)
    barred = np.zeros((1, problem.graph.num_lanes), np.bool_)
    barred[0, lane] = True
    for paths, faults in (
        ([[0, 1], [4, 5]], ("robot_0 drives from 'v0' to 'v1' at 0 s, where a small has no room",)),
        ([[0, 4, 5, 1], [4, 5, 6, 5]], ()),
        ([[0, 0, 4, 5, 1], [4, 5]], ()),
    ):
        assert judge(replace(problem, barred=barred), plan_of_paths(paths, STEP_S)).faults == faults
    assert judge(replace(world([0, 1], [0, 5]), barred=barred), plan_of_paths([[0], [1, 5]], STEP_S)).valid  # robots after each other


def test_no_more_than_ten_faults_of_a_kind_are_listed():
    zigzag = [0, 2] * 9
    (*jumps,) = judge(world([0], [2]), plan_of_paths([zigzag], STEP_S)).faults
    assert len(jumps) == 10 and jumps[-1] == "robot_0 jumps from 'v2' to 'v0' at 18 s: there is no lane"


@pytest.mark.parametrize(("gap_s", "kinds"), [(0.0, ["vertex"]), (5e-7, ["vertex"]), (2e-6, ["following"]), (4.0, [])])
def test_a_robot_comes_after_the_other_has_left(gap_s, kinds):
    """One leaves vertex 1 at 10 s and is at 2 at 12 s; the other sets out for 1 at 8 s, or later."""
    problem = world([1, 0], [2, 1])
    plan = timed([0, 2, 4], [1, 2, 0, 1], [0, 12, 0, 10 + gap_s], [10, INF, 8 + gap_s, INF])
    verdict = judge(problem, plan)
    assert [c.kind for c in (*verdict.conflicts, *verdict.following)] == kinds


@pytest.mark.parametrize(
    ("times_s", "conflict"),
    [
        ((0.0, 4.0, 1.0, 3.0), ("edge", 0, 1, 0, 1, 1.0)),  # overtakes on it
        ((0.0, 4.0, 1.0, 5.0), None),
        ((0.0, 4.0, 4.0, 6.0), None),
        ((1.0, 3.0, 0.0, 4.0), ("edge", 0, 1, 0, 1, 1.0)),
    ],
)
def test_who_overtakes_on_a_lane_is_in_conflict(times_s, conflict):
    """Both drive from 0 to 1 and away from it, the first from 4, the second from 0 itself."""
    a, b, c, d = times_s
    problem = world([0, 4], [2, 5])
    first = [0, 1, 2], [0, b, b + 2], [a, b, INF]
    second = [4, 0, 1, 5], [-0.0, c, d, d + 2], [0, c, d, INF]
    plan = timed([0, 3, 7], *([*one, *other] for one, other in zip(first, second)))
    conflicts = judge(problem, plan, in_seconds=True).conflicts
    edges = [(e.kind, e.robot, e.other, e.vertex, e.next_vertex, e.t_s) for e in conflicts if e.kind == "edge"]
    assert edges == ([conflict] if conflict else [])


@pytest.mark.parametrize(("late_s", "meets"), [(0.0, True), (1.9, True), (2.0, False)])
def test_two_swap_only_while_both_are_on_the_lane(late_s, meets):
    """Robot 1 sets out from 1 to 0 that much later than robot 0 from 0 to 1, where it gives way to nobody in between."""
    problem = world([0, 1], [1, 0])
    plan = timed([0, 2, 4], [0, 1, 1, 0], [0, 2, 0, late_s + 2], [0, INF, late_s, INF])
    verdict = judge(problem, plan)
    assert verdict.count("edge") == meets
    if meets:
        edge = next(c for c in verdict.conflicts if c.kind == "edge")
        assert (edge.vertex, edge.next_vertex, edge.t_s) == (0, 1, late_s)
        assert describe(edge, problem) == f"robot_0 and robot_1 swap between 'v0' and 'v1' at {late_s:g} s"


def test_conflicts_are_listed_by_time_then_robots():
    verdict, problem = verdict_of([[0, 1], [1, 0], [8, 9], [9, 8], [4, 5, 6], [7, 6, 6]])
    assert [(c.kind, c.robot, c.other, c.t_s) for c in verdict.conflicts] == [
        ("edge", 0, 1, 0.0),
        ("edge", 2, 3, 0.0),
        ("vertex", 4, 5, 4.0),
    ]
    assert verdict.summary(problem, 3).startswith("3 conflicts: ") and not verdict.summary(problem, 3).endswith("...")
    followed, problem = verdict_of([[0, 1], [1, 2]])
    assert describe(followed.following[0], problem) == "robot_0 and robot_1 follow each other into 'v1' at 0 s"
    assert followed.summary(problem) == "valid"
    assert (
        judge(world([0, 4], [1, 5]), plan_of_paths([[1], [5]], STEP_S)).summary(problem, 1)
        == "robot_0 begins at 'v1', not at its start 'v0'"
    )


def brute_force(paths):
    """Robots and kind of every conflict, by looking at every pair at every step."""
    horizon = max(map(len, paths))
    at = [list(p) + [p[-1]] * (horizon - len(p)) for p in paths]
    result = set()
    for t in range(horizon):
        for i in range(len(at)):
            for j in range(i):
                if at[i][t] == at[j][t]:
                    result.add((j, i, "vertex"))
                if t and at[i][t] == at[j][t - 1] and at[i][t - 1] == at[j][t] and at[i][t] != at[j][t]:
                    result.add((j, i, "edge"))
                for a, b in ((i, j), (j, i)):
                    if t and at[a][t] == at[b][t - 1] and at[a][t - 1] != at[a][t] != at[b][t]:
                        result.add((j, i, "following"))
    return result


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
    result = judge(problem, plan_of_paths(paths, STEP_S))
    assert {(c.robot, c.other, c.kind) for c in (*result.conflicts, *result.following)} == expected
