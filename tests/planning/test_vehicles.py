"""Problems of vehicles that cannot turn in place: every planner's plan is one that they can drive."""

from dataclasses import replace

import numpy as np
import pytest

from mrp_sumo.core.plan import Status, plan_of_paths
from mrp_sumo.core.problem import Standing
from mrp_sumo.planning.answers import planned_by
from mrp_sumo.planning.registry import planner
from mrp_sumo.planning.vehicles import on_moves, within_reach
from mrp_sumo.traffic.clashes import clashes_of
from mrp_sumo.traffic.moves import BOUND, UNDER_WAY
from mrp_sumo.traffic.referee import judge
from mrp_sumo.traffic.turns import obstacle_to, with_swings
from planners.conflict_based.tree import NO_CONFLICTS, ConflictNode, SearchLimits, Tree
from tests.vehicles import CAR, CART, TRICYCLE, TUGGER, corner, roads, squares, vehicles_on

PLANNERS = ("astar", "cbs", "ecbs", "eecbs", "pbs", "prioritised", "pibt", "lacam", "lns2", "continuous", "auto")


def plan(problem, name="lacam"):
    chosen = planner(name, {})
    chosen.prepare()
    return planned_by(chosen, problem, 20.0)


@pytest.mark.parametrize("name", PLANNERS)
def test_planners_make_turns_that_each_type_can_make(name):
    graph = squares(4, 4.0)
    problem = vehicles_on(graph, [0, 15, 3], [10, 5, 12], [TRICYCLE, CAR, CART])
    result = plan(problem, name)
    assert result.status is Status.SOLVED, result.message
    verdict = judge(problem, result.plan, in_seconds="seconds" in getattr(planner(name, {}), "supports", ()))
    assert name == "astar" or verdict.valid, verdict
    assert not verdict.faults
    for robot, vehicle in enumerate((TRICYCLE, CAR)):
        assert obstacle_to(graph, vehicle, result.plan.vertex[slice(*result.plan.first[robot : robot + 2])].tolist()) == ""


def test_who_cannot_reverse_goes_round_the_block_and_who_can_goes_back():
    """From 1, a dead end, with a block 2 - 3 - 4 - 5 before it: to get back to 0 facing there, a car has to drive round."""
    xy = [(0.0, 0.0), (4.0, 0.0), (8.0, 0.0), (12.0, 0.0), (12.0, 4.0), (8.0, 4.0)]
    graph = roads(xy, [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 2)])
    east = np.zeros(1)
    there = plan(vehicles_on(graph, [1], [0], CAR, start_heading_rad=east)).plan.vertex.tolist()
    assert there == [1, 2, 3, 4, 5, 2, 1, 0] or there == [1, 2, 5, 4, 3, 2, 1, 0]
    assert plan(vehicles_on(graph, [1], [0], TRICYCLE, start_heading_rad=east)).plan.vertex.tolist() == [1, 0]


def test_a_car_that_faces_along_a_lane_drives_along_it_though_it_could_not_go_on_from_the_lane_before():
    """The lanes to and from 1 are 6 degrees off each other: who had stopped at the end of the first would have missed the arc."""
    graph = roads([(0.0, 0.0), (4.0, 0.0), (8.0, 0.4), (12.0, 0.8)], [(0, 1), (1, 2), (2, 3)])
    facing = np.array([np.arctan2(0.4, 4.0)])
    assert plan(vehicles_on(graph, [1], [3], CAR, start_heading_rad=facing)).plan.vertex.tolist() == [1, 2, 3]
    assert "cannot reach" in plan(vehicles_on(graph, [1], [3], CAR, start_heading_rad=facing + np.pi)).message


def test_a_car_comes_to_its_goal_by_the_side_on_which_nobody_else_has_one():
    """On a ring of twelve, from 0 to 4: the shorter way is over 2, where a cart stays, and 4 from there is another state than from 5."""
    side = range(3)
    xy = [*((k, 0) for k in side), *((3, k) for k in side), *((3 - k, 3) for k in side), *((0, 3 - k) for k in side)]
    graph = roads([(4.0 * x, 4.0 * y) for x, y in xy], [(k, (k + 1) % 12) for k in range(12)])
    round_it = plan(vehicles_on(graph, [0, 2], [4, 2], [CAR, CART]))
    assert round_it.plan.vertex[: round_it.plan.first[1]].tolist() == [0, 11, 10, 9, 8, 7, 6, 5, 4]
    assert plan(vehicles_on(graph, [0, 2], [4, 6], [CAR, CART])).plan.vertex[:5].tolist() == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("vehicle", [CAR, TUGGER])
def test_who_stands_at_its_goal_drives_round_where_another_has_to_pass(vehicle):
    """On a one-way ring of twelve, from 3 to 9, where one stands at 6 to which it can come back; trailers stand straight behind it."""
    side = range(3)
    xy = [*((k, 0) for k in side), *((3, k) for k in side), *((3 - k, 3) for k in side), *((0, 3 - k) for k in side)]
    graph = roads([(4.0 * x, 4.0 * y) for x, y in xy], one_way=[(k, (k + 1) % 12) for k in range(12)])
    begins = {CAR: (6, 3), TUGGER: (5, 2)}[vehicle]
    passed = vehicles_on(graph, begins, [begins[0], 9], vehicle)
    result = plan(passed)
    assert result.status is Status.SOLVED and judge(passed, result.plan).valid, result.message
    assert result.plan.vertex[result.plan.first[1] - 1] == begins[0]
    assert set(result.plan.vertex[: result.plan.first[1]].tolist()) == set(range(12))
    beyond = plan(vehicles_on(graph, [begins[0], 8], [begins[0], 9], vehicle))
    assert set(beyond.plan.vertex[: beyond.plan.first[1]].tolist()) == {begins[0]}


def test_what_is_out_of_reach_is_named():
    tight = plan(vehicles_on(corner(0.7), [0], [2], CAR))
    assert tight.status is Status.INFEASIBLE
    assert "car needs 1.07 m to turn from 'v0' over 'v1' to 'v2' and has 0.35 m" in tight.message
    dead_end = plan(vehicles_on(roads([(0.0, 0.0), (4.0, 0.0)], [(0, 1)]), [1], [0], CAR, start_heading_rad=np.zeros(1)))
    assert "robot_0 cannot reach its goal 'v0' from 'v1'" in dead_end.message
    aside = plan(vehicles_on(corner(), [0], [2], CAR, start_heading_rad=np.full(1, np.pi / 2)))
    assert "robot_0 faces 90 degrees at 'v0', where no lane leads that way or back" in aside.message


def test_nobody_stands_where_trailers_are():
    line = [(4.0 * k, 0.0) for k in range(5)]
    graph = roads(line, one_way=[(k, k + 1) for k in range(4)])
    near = plan(vehicles_on(graph, [1, 3], [4, 3], [TUGGER, CART]))
    assert near.status is not Status.SOLVED  # the cart stays at 3, and the trailers would stand there
    assert plan(vehicles_on(graph, [1, 2], [3, 4], [TUGGER, CART])).status is Status.SOLVED
    assert plan(vehicles_on(graph, [1, 3], [3, 4], [TUGGER, CART])).status is Status.SOLVED
    alone = plan(vehicles_on(graph, [0], [3], TUGGER))
    assert "robot_0 starts at 'v0', where no free lane behind it has 2.90 m for its trailers" in alone.message


def test_goals_that_take_one_place_for_the_trailers_of_both_are_named():
    """A road that forks: whoever ends beyond the fork has its trailers there."""
    graph = roads([*((4.0 * k, 0.0) for k in range(6)), (20.0, 4.0)], one_way=[*((k, k + 1) for k in range(5)), (4, 6)])
    message = plan(vehicles_on(graph, [3, 1], [5, 6], TUGGER)).message
    assert message == "robot_0 and robot_1 have to end at 'v5' and 'v6', and 'v4' would be taken twice, by trailers"
    assert plan(vehicles_on(graph, [3, 1], [5, 3], TUGGER)).status is Status.SOLVED


@pytest.mark.parametrize(("closed", "goal"), [([(1, 2)], 3), ([(1, 3)], 2)])
def test_trailers_stand_where_the_tugger_can_go_on(closed, goal):
    """At a crossing of two roads, of which one is closed to it beyond."""
    graph = roads([(0, 0), (4, 0), (8, 0), (4, 4), (4, -4)], one_way=[(0, 1), (1, 2), (1, 3), (4, 1)])
    graph = replace(graph, closed_to={TUGGER.name: frozenset(closed)})
    assert plan(vehicles_on(graph, [1], [goal], TUGGER)).status is Status.SOLVED


@pytest.mark.parametrize(
    ("xy", "why"),
    [
        ([(0, 0), (4, 0), (8, 0), (8, 4)], ""),
        ([(0, 0), (4, 0), (4, 4), (8, 4)], "tugger stands at 'v1' with its back to 'v0', and from a stand it can go straight on only"),
        ([(0, 0), (4, 0), (8, 0), (4, 0.1)], "tugger cannot reverse, from 'v1' to 'v2' and back"),
    ],
)
def test_why_a_tugger_cannot_come_to_its_goal_is_said(xy, why):
    result = plan(vehicles_on(roads(xy, one_way=[(0, 1), (1, 2), (2, 3)]), [1], [3], TUGGER))
    assert (result.status is Status.SOLVED) == (not why) and why in result.message


def test_how_many_places_a_vehicle_comes_to_is_said_where_another_way_hides_the_turn_that_it_cannot_make():
    """It stands at v1 and may go on to v4; the way of a robot that turns in place is over v2."""
    graph = roads([(0, 0), (4, 0), (4, 4), (8, 4), (8, 0)], one_way=[(0, 1), (1, 2), (2, 3), (1, 4)])
    assert plan(vehicles_on(graph, [1], [3], TUGGER)).message.endswith(": by moves that it can make it comes to 2 of 5 places only")


@pytest.mark.parametrize(("types", "passes"), [([TUGGER, TUGGER], 7), ([CART, TUGGER], 4)])
def test_a_tugger_comes_to_its_goal_by_the_side_on_which_no_trailers_stand(types, passes):
    """One from 1 goes straight on over 4 to 5, the other from 2 over 4 to 8, or round by 6 and 7 if trailers stand at 4."""
    xy = [(-16, 0), (-8, 0), (0, -16), (0, -8), (0, 0), (8, 0), (16, -8), (16, 8), (0, 8), (0, -24), (0, 16)]
    lanes = [(0, 1), (1, 4), (4, 5), (9, 2), (2, 3), (3, 4), (4, 8), (3, 6), (6, 7), (7, 8), (8, 10)]
    problem = vehicles_on(roads(xy, one_way=lanes, cell_m=16.0), [1, 2], [5, 8], types)
    result = planned_by(planner("cbs", {}), problem, 5.0)
    assert result.plan is not None, result.message
    path = result.plan.vertex[result.plan.first[1] : result.plan.first[2]].tolist()
    assert (passes in path, 4 in path and 7 in path) == (True, False)


def test_the_referee_knows_turns_that_a_vehicle_cannot_make():
    """A plan that turns round at a dead end is one for those who may reverse."""
    graph = roads([(0.0, 0.0), (4.0, 0.0)], [(0, 1)])
    problem = vehicles_on(graph, [0], [0], CAR)
    there_and_back = plan_of_paths([[0, 1, 0]], problem.step_s)
    (fault,) = judge(problem, there_and_back).faults
    assert fault == "robot_0 cannot drive its path: car cannot reverse, from 'v0' to 'v1' and back (kinematics.reverse: true would do)"
    assert judge(vehicles_on(graph, [0], [0], TRICYCLE), there_and_back).valid


@pytest.mark.parametrize(("heading_rad", "last"), [(0.0, [0, 1]), (np.pi, [2, 1])])
def test_a_heading_at_the_goal_decides_from_where_a_vehicle_comes(heading_rad, last):
    """1 is on the line 0 - 1 - 2, which is one side of a ring, so that one can come to it from both ends."""
    graph = roads([(0.0, 0.0), (4.0, 0.0), (8.0, 0.0), (8.0, 4.0), (4.0, 4.0), (0.0, 4.0)], [(k, (k + 1) % 6) for k in range(6)])
    result = plan(vehicles_on(graph, [4], [1], CAR, goal_heading_rad=np.array([heading_rad])))
    assert result.plan.vertex[-2:].tolist() == last


@pytest.mark.parametrize("vehicle", [TRICYCLE, CAR, TUGGER], ids=lambda each: each.name)
def test_a_vehicle_on_an_arc_goes_on_along_it(vehicle):
    """At 1, bound for 2, of a ring: it goes there first, though a tricycle could back out."""
    ring = [(0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0)]
    graph = roads(ring, one_way=[(k, (k + 1) % 4) for k in range(4)])
    came, bound = graph.lane_between(0, 1), graph.lane_between(1, 2)
    standing = Standing(np.array([BOUND]), np.array([bound]), np.array([0]), np.array([came]))
    assert plan(vehicles_on(graph, [1], [3], vehicle, standing=standing)).plan.vertex.tolist() == [1, 2, 3]


def test_goals_too_near_to_a_corner_where_trucks_swing_are_named_with_what_they_need():
    """1 is the corner before the dead end 0, 4 is across it."""
    forks = replace(TRICYCLE, kinematics=replace(TRICYCLE.kinematics, docking="forks_first"))
    long_m = 2 * forks.radius_m + forks.gap_m + 0.01
    xy = [(0.0, 8.0), (0.0, 0.0), (-8.0, 0.0), (8.0, 0.0), (0.0, -long_m), (0.0, -8.0)]
    graph = with_swings(roads(xy, [(0, 1), (1, 2), (1, 3), (1, 4), (4, 5)], cell_m=8.0), [forks])
    result = plan(vehicles_on(graph, [2, 5], [1, 4], forks))
    needs_m = long_m - 0.01 + graph.swing_m[[1, 4]].sum()
    assert result.status is Status.INFEASIBLE and f"{long_m:.3f} m apart, where they need {needs_m:.3f} m" in result.message


@pytest.mark.parametrize("name", ["cbs", "eecbs", "lacam", "pibt", "prioritised"])
def test_a_vehicle_comes_to_a_place_as_another_leaves_it_unless_following_is_forbidden(name):
    """Over the crossing 0 from 1 to 2, and from 5, a lane farther off, over 3 to 4: nobody has to wait."""
    graph = roads([(0.0, 0.0), (-4.0, 0.0), (4.0, 0.0), (0.0, -4.0), (0.0, 4.0), (0.0, -8.0)], [(0, 1), (0, 2), (0, 3), (0, 4), (3, 5)])
    problem = vehicles_on(graph, [1, 5], [2, 4], TRICYCLE)
    for following in (False, True):
        result = planned_by(planner(name, {"following": following}), problem, 20.0)
        assert judge(problem, result.plan).valid
        assert (result.plan.end_s.sum() == pytest.approx(5 * problem.step_s)) != following


def test_in_windows_of_priority_based_search_too():
    graph = roads([(0.0, 0.0), (-4.0, 0.0), (4.0, 0.0), (0.0, -4.0), (0.0, 4.0), (0.0, -8.0)], [(0, 1), (0, 2), (0, 3), (0, 4), (3, 5)])
    result = planned_by(planner("pbs", {}), replace(vehicles_on(graph, [1, 5], [2, 4], TRICYCLE), window_steps=6), 20.0)
    assert result.stats["cost"] == 5


@pytest.mark.parametrize("num_robots", [4, 3])
def test_vehicles_on_a_block_that_all_go_on_at_once_rotate_though_none_enters_a_state_that_another_leaves(num_robots, monkeypatch):
    """Each goes to where the next one is; of three the last one to where nobody is."""
    ring = [0, 1, 3, 2][:num_robots]
    problem = on_moves(vehicles_on(squares(2, 4.0), ring, [1, 3, 2, 0][:num_robots], TRICYCLE))
    graph, tree = problem.graph, Tree(problem, SearchLimits(20.0, 100))
    lanes = [graph.base.lane_between(*lane) for lane in zip(ring, [1, 3, 2, 0])]
    paths = [np.array([start, graph.states[0].at[UNDER_WAY, lane, 0]]) for start, lane in zip(problem.start, lanes)]
    monkeypatch.setattr(tree, "paths", lambda node: paths)
    moves = [(robot, *tree.instance.spots.of[paths[robot]].tolist(), 1) for robot in range(num_robots)]
    assert sorted(tree.ring(ConflictNode(tree, np.zeros(num_robots, np.int64), NO_CONFLICTS, 0, 0))) == (moves if num_robots == 4 else [])


def test_states_of_one_place_are_one_spot_and_where_nobody_tows_spots_clash_as_the_map_says():
    problem = on_moves(vehicles_on(squares(2, 4.0), [0, 3], [1, 2], [TRICYCLE, CART]))
    graph, (clashes, spots) = problem.graph, clashes_of(problem)
    assert (spots.place[spots.of] == graph.place).all() and sorted(spots.place.tolist()) == [0, 1, 2, 3]
    assert not clashes.any and not len(spots.beside)
    assert (spots.tail[spots.move] == spots.of[graph.tail]).all() and (spots.head[spots.move] == spots.of[graph.head]).all()
    assert len(spots.head) == graph.base.num_lanes


def test_a_spot_of_a_tugger_is_its_place_and_that_behind_it():
    """A waiting tugger keeps others off both; heads at its own place are beside it."""
    problem = on_moves(vehicles_on(squares(3, 4.0), [1, 7], [3, 5], TUGGER))
    graph, (clashes, spots) = problem.graph, clashes_of(problem)
    held = {spot: (place, behind) for spot, place, behind in zip(spots.of.tolist(), graph.place.tolist(), graph.behind.tolist())}
    assert len(set(held.values())) == len(held) == len(spots.place)
    for spot, (place, behind) in held.items():
        beside = spots.beside[slice(*spots.beside_first[spot : spot + 2])].tolist()
        assert beside == [other for other, (at, _) in sorted(held.items()) if at == place and other != spot]
        wait = len(spots.head) + spot
        near = clashes.vertex[slice(*clashes.vertex_first[wait : wait + 2])].tolist()
        assert near == [other for other, (at, tow) in sorted(held.items()) if tow == place or (behind >= 0 and behind in (at, tow))]


@pytest.mark.parametrize(("to", "stays", "goals"), [(0, True, [1, 3, 2]), (3, False, [3, 1, 4])])
def test_a_vehicle_that_comes_to_its_goal_by_no_moves_stays_and_so_does_who_is_to_come_there(to, stays, goals):
    """robot_0, which cannot back, faces east at 1 of a row; robot_1 is to come there, and robot_2 to where that one stands."""
    graph = roads([(4.0 * v, 0.0) for v in range(5)], [(v, v + 1) for v in range(4)])
    wanted = [to, 1, 3] if stays else [to, 1, 4]
    problem = vehicles_on(graph, [1, 3, 2], wanted, [CAR, CART, CART], start_heading_rad=np.zeros(3))
    within = within_reach(problem)
    assert within.target.tolist() == goals
    assert (within is problem) == (not stays)
