"""Orders that can be kept are kept in the plan's sequence; those that cannot are refused by name."""

import numpy as np
import pytest
from worlds import graph_of, problem_of

from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import PlanError
from mrp_sumo.traffic.passages import Needs, order_of
from mrp_sumo.traffic.schedule import schedule_of, waiting_cycle

ROBOT = RobotType("cube", 0.2, 0.2, 0.5, 1.0, 1.0, 2.0)


def world(xy, pairs, paths):
    """A problem on two-way lanes and the plan of these paths, a second a step."""
    return problem_of(graph_of(xy, pairs, cell_m=1.0), paths, ROBOT, step_s=1.0)


def line(n):
    return [(i, 0) for i in range(n)], [(i, i + 1) for i in range(n - 1)]


def passing(plan, schedule, resource):
    return schedule.robot[schedule.first[resource] : schedule.first[resource + 1]].tolist()


def test_a_vertex_is_passed_in_the_order_of_planned_arrival():
    problem, plan = world(*line(5), [[2, 3, 4], [0, 1, 2, 3]])
    schedule = schedule_of(problem, plan)
    assert passing(plan, schedule, 2) == [0, 1]
    assert passing(plan, schedule, 3) == [0, 1]
    assert passing(plan, schedule, 4) == [0]
    assert passing(plan, schedule, 0) == [1]


def test_a_robot_that_returns_passes_twice():
    problem, plan = world(*line(3), [[0, 1, 0]])
    assert passing(plan, schedule_of(problem, plan), 0) == [0, 0]


def test_a_swap_is_refused_with_both_robots():
    problem, plan = world(*line(2), [[0, 1], [1, 0]])
    with pytest.raises(PlanError, match=r"(robot_0 at 'v\d' waits for robot_1|robot_1 at 'v\d' waits for robot_0)"):
        schedule_of(problem, plan)


def test_a_rotation_without_a_gap_is_refused():
    square = [(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1), (1, 2), (2, 3), (3, 0)]
    problem, plan = world(*square, [[0, 1], [1, 2], [2, 3], [3, 0]])
    with pytest.raises(PlanError, match="cyclic"):
        schedule_of(problem, plan)
    problem, plan = world(*square, [[0, 1, 2], [1, 2, 3], [2, 3, 0], [3, 0, 1]])
    with pytest.raises(PlanError, match=r"cyclic: .*; they rotate, which the planner's parameters rotations: false"):
        schedule_of(problem, plan)


def test_a_rotation_with_a_gap_is_a_train():
    square = [(0, 0), (1, 0), (1, 1), (0, 1)], [(0, 1), (1, 2), (2, 3), (3, 0)]
    problem, plan = world(*square, [[0, 1], [1, 2], [2, 3]])
    assert passing(plan, schedule_of(problem, plan), 1) == [1, 0]


def test_driving_through_a_robot_that_stays_is_refused():
    problem, plan = world(*line(3), [[1], [0, 1, 2]])
    with pytest.raises(PlanError, match="robot_0 stays at 'v1' from 0 s on, and robot_1 has to pass there at 1 s"):
        schedule_of(problem, plan)


def test_overtaking_on_a_lane_is_refused():
    # both drive 0 -> 1, robot_1 sets out later and arrives earlier
    problem, plan = world([(0, 0), (1, 0), (2, 0), (0, 1), (1, 1)], [(0, 1), (1, 2), (0, 3), (1, 4)], [[0, 1, 2], [3, 0, 1, 4]])
    arrive = plan.arrive_s.copy()
    arrive[plan.first[0] + 1 : plan.first[1]] += 5
    late = type(plan)(plan.first, plan.vertex, arrive, plan.depart_s)
    with pytest.raises(PlanError, match="cyclic"):
        schedule_of(problem, late)


def needs_of(*resources, num_resources, on_lane=()):
    first = np.cumsum([0, *map(len, resources)])
    flat = np.concatenate(resources)
    return Needs(first, flat, np.isin(np.arange(len(flat)), on_lane), num_resources)


@pytest.mark.parametrize("path", [[0, 1, 2, 3], [0, 1, 1, 1, 2, 2, 3]], ids=("drives through", "waits in it"))
def test_consecutive_visits_of_one_zone_are_one_passage(path):
    _, plan = world(*line(4), [path])
    schedule = order_of(plan, needs_of([0], [1, 4], [2, 4], [3], num_resources=5))
    assert passing(plan, schedule, 4) == [0]
    passage = schedule.first[4]
    assert (schedule.visit[passage], schedule.last_visit[passage], schedule.left_at[passage]) == (1, 2, 3)
    assert schedule.passage_of_need[2] == schedule.passage_of_need[4] == passage


@pytest.mark.parametrize("path, passes", [([4, 3], [0]), ([3, 4, 4, 4, 4], [0, 1, 0]), ([3, 3, 3, 3, 3, 4], [0, 1])])
def test_who_waits_beside_a_zone_passes_it_once_unless_another_does_between(path, passes):
    """robot_0 leaves zone 5 where its lane to vertex 1 ends, waits there, and needs the zone again on the next lane."""
    problem, plan = world([(k, k > 2) for k in range(5)], [(0, 1), (1, 2), (3, 4)], [[0, 1, 1, 1, 2], path])
    zone = [[path[0]], [4, 5]] if path[0] == 3 else [[4], [3]]
    needs = needs_of([0], [1, 5], [2, 5], *zone, num_resources=6, on_lane=[2, 4, 7])
    schedule = schedule_of(problem, plan, needs)
    assert passing(plan, schedule, 5) == passes
    assert schedule.passage_of_need.max() == schedule.num_passages - 1
    first, last = schedule.passage_of_need[[2, 4]].tolist()
    assert (schedule.visit[first], schedule.left_at[last]) == (1, 2) and (first == last) == (passes != [0, 1, 0])


CROSS = [(-1, 0), (1, 0), (0, -1), (0, 1)], [(0, 1), (2, 3)]


def test_a_zone_orders_robots_that_share_no_vertex():
    problem, plan = world(*CROSS, [[0, 1], [2, 2, 3]])
    needs = needs_of([0], [1, 4], [2], [3, 4], num_resources=5, on_lane=[2, 5])
    schedule = schedule_of(problem, plan, needs)
    assert passing(plan, schedule, 4) == [0, 1]
    assert schedule.left_at[schedule.first[4]] == 1  # where the lane ends


def test_a_robot_that_stays_in_a_zone_comes_last_there():
    problem, plan = world(*CROSS, [[0, 1], [2, 2, 3]])
    schedule = schedule_of(problem, plan, needs_of([0], [1, 4], [2], [3, 4], num_resources=5, on_lane=[5]))
    assert passing(plan, schedule, 4) == [1, 0]


def test_a_robot_that_stays_in_a_zone_from_the_beginning_blocks_it():
    problem, plan = world(*CROSS, [[1], [2, 2, 3]])
    with pytest.raises(PlanError, match="robot_0 stays at 'v1' from 0 s on, and robot_1 has to pass within reach of it, to 'v3' at 2 s"):
        schedule_of(problem, plan, needs_of([0, 4], [2], [3, 4], num_resources=5, on_lane=[4]))


def test_zones_in_a_circle_get_an_order_that_can_be_kept():
    # robot_0 is planned into zone 5 first, but can only leave it at vertex 2, where robot_1 is planned to pass before
    problem, plan = world([(k, 0) for k in range(5)], [(k, k + 1) for k in range(4)], [[0, 1, 1, 1, 1, 2], [4, 3, 3, 2, 3]])
    rest = schedule_of(problem, plan)
    needs = needs_of([0], [1, 5], [2], [4], [3], [2, 5], [3], num_resources=6)
    assert len(waiting_cycle(plan, order_of(plan, needs)))
    schedule = schedule_of(problem, plan, needs)
    assert passing(plan, schedule, 5) == [1, 0]
    assert [passing(plan, schedule, v) for v in range(5)] == [passing(plan, rest, v) for v in range(5)]


def test_robots_that_wait_for_each_other_at_two_zones_are_not_told_that_they_rotate():
    problem, plan = world(*line(6), [[0, 1, 2], [5, 4, 3]])
    needs = needs_of([0], [1, 6], [2, 7], [5], [4, 7], [3, 6], num_resources=8)
    with pytest.raises(PlanError, match=r"cyclic: [^;]*$"):
        schedule_of(problem, plan, needs)
