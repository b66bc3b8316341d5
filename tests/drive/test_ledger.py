"""Visits keep their ids; what is cut off is never driven, and a plan that nobody can keep leaves no trace."""

from contextlib import nullcontext
from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from vehicles import TRICYCLE, TUGGER, corner, roads, vehicles_on
from worlds import BURGER, cross, graph_of, line, problem_of, square_grid

from mrp_sumo.core.execution import plans_in_force
from mrp_sumo.core.plan import Plan
from mrp_sumo.drive._causes import DISTURBED
from mrp_sumo.drive.crew import Crew
from mrp_sumo.drive.facilities import facilities_of
from mrp_sumo.drive.fit import resources_for
from mrp_sumo.drive.ledger import Ledger, _squeezed, planned_arrivals, replies_of
from mrp_sumo.drive.policy import policy_of
from mrp_sumo.drive.replanning import situation
from mrp_sumo.drive.reroute import Replan, Reroute, first_of
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.drive.state import NEVER, Kinematics
from mrp_sumo.drive.surroundings import Surroundings
from mrp_sumo.drive.work import Work
from mrp_sumo.drive.world import World
from mrp_sumo.errors import PlanError
from mrp_sumo.traffic.moves import BOUND, STANDING, UNDER_WAY
from mrp_sumo.traffic.passages import permuted


def ledger_of(graph, paths, policy="adg"):
    problem, plan = problem_of(graph, paths, BURGER)
    ledger = Ledger(problem, resources_for(problem, plan))
    ledger.append(first_of(plan), policy_of(policy), 0.0)
    return ledger, plan


def route(*vertices, leave_s=0.0, **other):
    times = np.arange(1.0, len(vertices) + 1)
    return Reroute(np.array(vertices, np.int64), times, np.append(times[1:], np.inf)[: len(vertices)], leave_s, **other)


def column(ledger, name):
    """[N] a field of all visits."""
    return getattr(ledger.visits, name)[: ledger.num_visits]


def content(ledger):
    """All that the ledger holds; its arrays may be longer."""
    names = ("vertex", "lane", "at_m", "next", "rank", "arrive_s", "depart_s", "turns")
    state = [array.tobytes() for part in ledger.state[:-1] for array in part]
    first, *needs, passing = ledger.needs
    needs = [first[: ledger.num_visits + 1], *(array[: ledger.num_needs] for array in needs), passing]
    return [column(ledger, name).tobytes() for name in names], state, [array.tobytes() for array in needs], len(ledger.entries)


def test_a_ledger_begins_with_robots_that_hold_their_starts_and_have_nothing_to_do():
    problem, plan = problem_of(line(4), [[0, 1], [3, 2]], BURGER)
    ledger = Ledger(problem, resources_for(problem, plan))
    assert column(ledger, "vertex").tolist() == [0, 3] and column(ledger, "next").tolist() == [-1, -1]
    assert ledger.state.holds.holder.tolist()[:4] == [0, -1, -1, 1]
    assert ledger.entries == [] and not ledger.state.home.any()


def test_the_first_plan_is_the_first_entry_and_begins_at_the_starts():
    ledger, plan = ledger_of(line(4), [[0, 1], [3, 2]])
    assert ledger.all_ids(0).tolist() == [0, 2] and ledger.all_ids(1).tolist() == [1, 3]
    assert column(ledger, "next").tolist() == [2, 3, -1, -1]
    assert ledger.state.motion.yaw_rad == pytest.approx([0.0, np.pi])  # robots face the way that they go
    assert planned_arrivals(ledger)[plan.first[:-1]].tolist() == [0.0, 0.0] and len(planned_arrivals(ledger)) == plan.num_visits
    assert replies_of(ledger) == ()


def test_a_first_plan_that_nobody_can_keep_leaves_the_ledger_empty():
    problem, plan = problem_of(square_grid(2), [[0, 1], [1, 0]], BURGER)  # a swap
    ledger = Ledger(problem, resources_for(problem, plan))
    with pytest.raises(PlanError):
        ledger.append(first_of(plan), policy_of("adg"), 0.0)
    assert ledger.entries == [] and ledger.all_ids(0).tolist() == [0]
    ledger.append(first_of(plan), policy_of("open_loop"), 0.0)
    assert ledger.all_ids(0).tolist() == [0, 2]


def test_new_visits_are_linked_in_the_place_of_those_that_are_cut_off():
    # vertex y * 3 + x: straight on along the bottom, then up and over the top instead
    ledger, plan = ledger_of(square_grid(3), [[0, 1, 2, 5]])
    before = column(ledger, "at_m").copy()
    ledger.append(Replan({0: route(3, 4, 5)}, "detour"), policy_of("adg"), 1.0)
    assert ledger.num_visits == 7  # those that are cut off stay in the ledger
    assert ledger.all_ids(0).tolist() == [0, 4, 5, 6]
    assert column(ledger, "vertex").tolist() == [0, 1, 2, 5, 3, 4, 5]
    assert column(ledger, "at_m")[:4].tolist() == before.tolist()
    assert column(ledger, "at_m")[4:] == pytest.approx([0.4, 0.8, 1.2])
    assert column(ledger, "turns")[0] and ledger.state.home.all()
    (reply,) = replies_of(ledger)
    (after,) = plans_in_force(plan, [reply])
    assert after.vertex.tolist() == [0, 3, 4, 5]


def test_a_robot_that_is_given_nothing_more_stays_and_is_not_at_its_goal():
    ledger, plan = ledger_of(line(3), [[0, 1, 2]])
    ledger.append(Replan({0: route(leave_s=np.inf)}, "replan"), policy_of("adg"), 1.0)
    assert ledger.all_ids(0).tolist() == [0] and not ledger.state.home.any()
    assert column(ledger, "next")[0] == -1
    assert next(plans_in_force(plan, replies_of(ledger))).vertex.tolist() == [0]


def test_an_order_that_nobody_can_keep_leaves_the_ledger_as_it_was():
    ledger, _ = ledger_of(square_grid(2), [[0, 1], [3, 2]])
    before = content(ledger)
    with pytest.raises(PlanError, match="robot_0 stays at 'v1'"):
        ledger.append(Replan({0: route(1), 1: route(1)}, "replan"), policy_of("adg"), 1.0)
    assert content(ledger) == before
    for seen, name in ((ledger.visits.arrived_s, "arrived_s"), (ledger.visits.next, "next")):  # kernels write where the ledger reads
        assert np.shares_memory(seen, column(ledger, name))
    ledger.append(Replan({0: route(1, 3), 1: route(2, 0)}, "replan"), policy_of("adg"), 1.0)
    assert len(ledger.entries) == 2


def test_arrays_grow_and_ids_stay():
    ledger, _ = ledger_of(line(3), [[0, 1, 2]])
    for turn in range(40):
        ledger.append(Replan({0: route(1, 0, 1, 2)}, "detour"), policy_of("adg"), float(turn))
    assert ledger.num_visits == 3 + 40 * 4
    assert ledger.all_ids(0).tolist() == [0, *range(159, 163)]
    needs = [ledger.resources_from(0, int(k)).tolist() for k in ledger.all_ids(0)[-1:]]
    assert needs == [[2]]


@pytest.mark.parametrize(("off_rad", "turned"), [(0.0, True), (2 * np.pi, True), (1e-6, False), (-np.pi / 2, False), (np.nan, True)])
def test_a_robot_has_turned_when_it_faces_as_it_is_to_stay_whatever_turns_it_made_before(off_rad, turned):
    ledger, _ = ledger_of(line(2), [[0, 1]])
    ledger.state.motion.yaw_rad[0], ledger.state.facing_rad[0] = 3.0, 3.0 + off_rad
    assert ledger.turned.tolist() == [turned]


def test_a_robot_drives_back_until_it_is_granted_the_vertex_behind_it_though_it_goes_no_farther():
    ledger, _ = ledger_of(line(2, 2.0), [[0, 1]], "open_loop")
    ledger.state.motion.s_m[0], ledger.state.grants.on_lane[0] = 0.5, True
    ledger.state.claims.number[ledger.graph.lane_between(0, 1)] = 1
    ledger.append(Replan({0: route(0, back=True)}, "give_way"), policy_of("open_loop"), 3.0)
    assert ledger.is_driving_back.tolist() == [True]
    ledger.visits.granted[0] = ledger.visits.last[0]
    assert ledger.is_driving_back.tolist() == [False]


def test_what_is_over_is_forgotten_and_the_rest_has_new_ids():
    """The robot has come to vertex 3; the visit before it is kept, since it stops a little short."""
    ledger, _ = ledger_of(line(6), [[0, 1, 2, 3, 4, 5]])
    ledger.visits.reached[0] = ledger.visits.granted[0] = ledger.state.grants.oldest[0] = 3
    needed = np.array([4])
    ledger.forget(needed)
    assert column(ledger, "vertex").tolist() == [2, 3, 4, 5] and column(ledger, "next").tolist() == [1, 2, 3, -1]
    of_robot = (ledger.visits.first, ledger.visits.reached, ledger.visits.granted, ledger.visits.last, ledger.state.grants.oldest, needed)
    assert [int(ids[0]) for ids in of_robot] == [0, 1, 1, 3, 1, 2]
    assert ledger.logged(ledger.entries[0])["vertex"].tolist() == [1, 2, 3, 4, 5]  # the log knows all


def test_what_was_cut_off_is_forgotten_too_and_logs_and_cuts_know_the_rest_by_new_ids():
    """robot_0 has been sent back from vertex 2, so that its way is 0, 1, 2, 1, 0; robot_1 has not set out. Twice is as good as once."""
    ledger, _ = ledger_of(square_grid(3), [[0, 1, 2, 5], [6, 7, 8]])
    ledger.visits.reached[0] = ledger.visits.granted[0] = ledger.state.grants.oldest[0] = 3
    ledger.visits.arrived_s[[2, 3]] = 1.0, 2.0
    ledger.append(Replan({0: route(1, 0)}, "replan"), policy_of("adg"), 3.0)
    assert ledger.all_ids(0).tolist() == [0, 2, 3, 7, 8]
    ledger._cut, needed = np.array([7, 5]), np.array([3, 1])
    for _ in range(2):
        ledger.forget(needed)
        assert column(ledger, "vertex").tolist() == [6, 1, 2, 7, 8, 1, 0]
        assert ledger.all_ids(0).tolist() == [1, 2, 5, 6] and ledger.all_ids(1).tolist() == [0, 3, 4]
        assert column(ledger, "next").tolist() == [3, 2, 5, 4, -1, 6, -1]
        assert ledger.joint.tolist() == [5, 3] and needed.tolist() == [2, 0]
        assert [ledger.resources_from(0, 5).tolist(), ledger.resources_from(1, 4).tolist()] == [[1, 0], [8]]
    assert not ledger.is_full
    ledger.visits.arrived_s[[3, 5]] = 4.0, 9.0
    first, second = (ledger.logged(entry) for entry in ledger.entries)
    assert first["vertex"].tolist() == [1, 2, 5, 7, 8] and second["vertex"].tolist() == [1, 0]
    assert first["arrived_s"].tolist() == pytest.approx([1.0, 2.0, np.nan, 4.0, np.nan], nan_ok=True)
    assert second["arrived_s"].tolist() == pytest.approx([9.0, np.nan], nan_ok=True)
    assert planned_arrivals(ledger).tolist() == pytest.approx([0.0, 1.0, 2.0, np.nan, 0.0, 4.0, np.nan], nan_ok=True)


def test_a_policy_sees_how_far_robots_have_come_how_late_they_are_and_who_is_held():
    """robot_0 was to be at 0 at 0 s and came at 1 s, and was to be at 1 at 3 s; it is 7.5 s now. robot_1 has come early, to its end."""
    seen = []
    ledger, _ = ledger_of(line(7), [[0, 1, 2], [6, 5]])
    last = ledger.visits.reached[1] = ledger.visits.granted[1] = ledger.all_ids(1)[1]
    ledger.visits.arrived_s[[0, 1, last]] = 1.0, 0.0, 2.5
    ledger.state.motion.s_m[:], ledger.state.grants.cause[1] = [0.25, ledger.visits.at_m[last]], DISTURBED
    ledger.decide(SimpleNamespace(decide=lambda problem, plan, needs, now_s: seen.append(plan)), 7.5)
    (plan,) = seen
    assert plan.driven_m.tolist() == [0.25, 0.0] and plan.late_s.tolist() == [4.5, -0.5] and plan.held.tolist() == [False, True]
    ledger.decide(SimpleNamespace(decide=lambda problem, plan, needs, now_s: seen.append(plan)), 3.5)
    assert seen[1].late_s.tolist() == [1.0, -0.5]


@pytest.mark.parametrize("begin", [0, 1])
def test_a_robot_that_turns_back_comes_to_the_vertex_behind_it_again(begin):
    end, side = 1 - begin, 1 - 2 * begin
    graph = graph_of([(0, 0), (2, 0), (2 * begin, 1)], [(0, 1), (begin, 2)])
    ledger, _ = ledger_of(graph, [[begin, end]], "open_loop")
    ledger.state.motion.s_m[0] = 0.5  # half a metre into the lane, which it has not won the end of
    ledger.state.grants.on_lane[0] = True
    lane = int(graph.lane_between(begin, end))
    ledger.state.claims.number[lane], ledger.state.holds.holder[begin] = 1, -1  # and has left the vertex behind it
    left_at_m = ledger.needs.left_at_m[0]
    assert not ledger.is_driving_back[0]
    ledger.append(Replan({0: route(begin, 2, back=True)}, "give_way"), policy_of("open_loop"), 3.0)
    assert ledger.is_driving_back[0] and ledger.needs.left_at_m[0] == left_at_m
    behind = int(ledger.all_ids(0)[1])
    assert column(ledger, "lane")[behind] == graph.reverse[lane]
    assert column(ledger, "at_m")[behind] == pytest.approx(1.0)  # half a metre there, half a metre back
    assert column(ledger, "from_m")[behind] == pytest.approx(-1.0)  # as if it had come from the lane's other end
    assert ledger.state.claims.number[[lane, graph.reverse[lane]]].tolist() == [1, 1]
    assert ledger.state.holds.holder[begin] == 0  # nobody else is to come there
    assert ledger.turn_backs[0].xy == pytest.approx([2 * begin + 0.5 * side, 0.0]) and ledger.turn_backs[0].at_m == 0.5
    ledger.append(
        Replan({0: route(begin, end)}, "replan"), policy_of("open_loop"), 4.0
    )  # another way before it has set out: it is still to come back
    again = ledger.all_ids(0).tolist()
    assert column(ledger, "vertex")[again].tolist() == [begin, begin, end]
    assert column(ledger, "lane")[again].tolist() == [-1, graph.reverse[lane], lane]
    assert column(ledger, "at_m")[again] == pytest.approx([0.0, 1.0, 3.0])
    assert ledger.state.claims.number[[lane, graph.reverse[lane]]].tolist() == [1, 1] and len(ledger.turn_backs) == 1


def test_a_robot_that_is_sent_another_way_leaves_when_planned_though_one_before_it_turns_back():
    ledger, _ = ledger_of(square_grid(3), [[0, 1, 2], [6, 7, 8]], "open_loop")
    ledger.state.motion.s_m[0], ledger.state.grants.on_lane[0] = 0.1, True
    ledger.state.claims.number[ledger.graph.lane_between(0, 1)] = 1
    ledger.append(Replan({0: route(0, back=True), 1: route(3, leave_s=9.0)}, "give_way"), policy_of("open_loop"), 3.0)
    joint = ledger.joint[1]
    assert (column(ledger, "depart_s")[joint], column(ledger, "turns")[joint]) == (9.0, True)


def passing(ledger, vertex):
    """Robots in the order in which they are to pass a vertex."""
    visits = [(r, k) for r in range(ledger.num_robots) for k in ledger.all_ids(r) if column(ledger, "vertex")[k] == vertex]
    return [r for r, _ in sorted(visits, key=lambda visit: ledger.needs.passage[ledger.needs.first[visit[1]]])]


def frozen_ahead(ledger, *stays):
    """Freeze what robots will have been granted in a minute; those that stay are granted nothing more."""
    num_robots, graph = ledger.num_robots, ledger.graph
    limits = Kinematics(*(np.full(num_robots, value) for value in (0.22, 2.5, 2.84, 0.1, 0.1, 0.1, 0.0)))
    ledger.cut(60.0, limits, np.zeros(graph.num_lanes, np.bool_), np.isin(np.arange(num_robots), stays))


@pytest.mark.parametrize(("decel_mps2", "frozen"), [(1.0, 1), (0.25, 2), (0.15, 3)])
def test_as_much_is_frozen_as_a_robot_needs_to_brake(decel_mps2, frozen):
    """Vertices are 0.4 m apart; from 0.5 m/s a robot brakes in 0.125 m, 0.5 m or 0.83 m, and reaches 0.05 m."""
    ledger, _ = ledger_of(line(6), [[0, 1, 2, 3, 4, 5]])
    speed, decel, reach = np.array([0.5]), np.array([decel_mps2]), np.array([0.05])
    closed, nobody = np.zeros(ledger.graph.num_lanes, np.bool_), np.zeros(1, np.bool_)
    ledger.cut(0.0, Kinematics(speed, decel, speed, reach, reach, reach, 0 * reach), closed, nobody)
    assert ledger.joint.tolist() == [frozen]


@pytest.mark.parametrize(("policy", "ends"), [("adg", [2]), ("open_loop", [0])])
def test_without_an_order_no_more_is_frozen_than_was_granted(policy, ends):
    ledger, _ = ledger_of(line(3), [[0, 1, 2]], policy)
    frozen_ahead(ledger)
    assert ledger.visits.vertex[ledger.joint].tolist() == ends


def truck_on(vertices, s_m, *, speed_mps=0.5, graph=None, truck=TRICYCLE):
    """A truck on its way over these vertices of a corner with lanes of 8 m, on the first of which it is, granted to its end."""
    graph = graph or corner(8.0)
    problem = vehicles_on(graph, vertices[:1], vertices[-1:], truck)
    count = len(vertices)
    plan = Plan(np.array([0, count]), np.array(vertices), 20.0 * np.arange(count), np.append(20.0 * np.arange(1, count), np.inf))
    ledger = Ledger(problem, resources_for(problem, plan))
    ledger.append(first_of(plan), policy_of("adg"), 0.0)
    ledger.visits.granted[0] = ledger.all_ids(0)[1]
    ledger.state.motion.s_m[0], ledger.state.motion.speed_mps[0] = s_m, speed_mps
    return ledger


@pytest.mark.parametrize(("lead_s", "does"), [(1.0, STANDING), (0.9, UNDER_WAY)])
def test_a_vehicle_counts_as_past_its_turn_where_it_may_be_when_a_new_way_begins(lead_s, does):
    """From 0.5 m/s it drives 0.75 m in 1 s, speeding up by 0.5 m/s², and 0.6525 m in 0.9 s; its turn begins in 0.7 m."""
    turn_m = 8.0 - 4.0 - TRICYCLE.kinematics.ahead_m
    ledger = truck_on([0, 1], turn_m - 0.7)
    assert ledger.standing.does.tolist() == [UNDER_WAY]
    limits = Kinematics(*(np.array([value]) for value in (1.0, 0.5, 1.0, 0.1, 0.1, 0.1, 0.0)))
    ledger.cut(lead_s, limits, np.zeros(ledger.graph.num_lanes, np.bool_), np.zeros(1, np.bool_))
    assert ledger.standing.does.tolist() == [does]
    ledger.lift()
    assert ledger.standing.does.tolist() == [UNDER_WAY]


@pytest.mark.parametrize(("to", "s_m", "does", "bends"), [(3, 1.0, UNDER_WAY, False), (2, 1.0, UNDER_WAY, True), (2, 7.0, BOUND, True)])
def test_a_vehicle_that_is_sent_straight_on_does_not_bend_where_it_was_to_turn(to, s_m, does, bends):
    """It was to turn at 1, to 2 in the north; 3 is straight on, in the east."""
    graph = roads([(0.0, 0.0), (8.0, 0.0), (8.0, 8.0), (16.0, 0.0)], [(0, 1), (1, 2), (1, 3)], cell_m=8.0)
    ledger = truck_on([0, 1, 2], s_m, graph=graph)
    joint = int(ledger.joint[0])
    assert column(ledger, "tangent_m")[joint] > 0 and ledger.standing.does.tolist() == [does]
    ledger.append(Replan({0: route(to)}, "replan"), policy_of("adg"), 16.0)
    assert [column(ledger, name)[joint] > 0 for name in ("tangent_m", "bend_m")] == [bends] * 2
    assert np.isfinite(column(ledger, "bend_mps")[joint]) == bends


SHORT = replace(TUGGER, trailers=(replace(TUGGER.trailers[0], length_m=0.3, hitch_m=0.2),))  # the trailer ends 1 m behind its middle


@pytest.mark.parametrize(("truck", "first", "then"), [(TRICYCLE, -1, -1), (SHORT, 1, 0)])
def test_trailers_stand_where_a_robot_came_from_and_at_first_where_its_start_has_them(truck, first, then):
    """It stands at 0 as if it had come from 1, and is to come there."""
    ledger = truck_on([0, 1, 2], 0.0, truck=truck)
    assert ledger.behind.tolist() == [then]
    ledger.visits.granted[0] = ledger.all_ids(0)[0]
    assert ledger.behind.tolist() == [first]


@pytest.mark.parametrize("truck", [TRICYCLE, TUGGER])
def test_a_vertex_is_left_when_the_last_trailer_is_clear_of_who_stands_there(truck):
    """Straight on: the middle is as far away as what it tows reaches back, or its own circle, and the circle of another and the gap."""
    ledger = truck_on([0, 1, 2], 0.0, truck=truck, graph=roads([(0.0, 0.0), (20.0, 0.0), (40.0, 0.0)], [(0, 1), (1, 2)], cell_m=20.0))
    k = int(ledger.all_ids(0)[1])
    mine = slice(ledger.needs.first[k], ledger.needs.first[k + 1])
    (left_m,) = ledger.needs.left_at_m[mine][ledger.needs.resource[mine] == 1] - ledger.visits.at_m[k]
    assert left_m == pytest.approx(max(truck.behind_m, truck.radius_m) + truck.radius_m + truck.gap_m)


def test_a_vehicle_that_swings_out_to_change_gear_keeps_the_gear_in_which_it_leaves():
    """Backward out of the station in the west, past the corner, and forward to the north."""
    graph = roads([(0.0, 0.0), (8.0, 0.0), (8.0, 8.0), (8.0, 16.0)], [(1, 2), (2, 3)], [(0, 1), (1, 0)], cell_m=8.0)
    graph = replace(graph, lane_options=tuple({"orientation_constraint": "backward"} if k == 0 else {} for k in range(graph.num_lanes)))
    ledger = truck_on([0, 1, 2], 7.0, graph=graph)
    before = ledger.all_ids(0)
    assert column(ledger, "gear")[before].tolist() == [0, 1, 0] and ledger.standing.does.tolist() == [BOUND]
    ledger.append(Replan({0: route(2, 3)}, "replan"), policy_of("adg"), 16.0)
    after = ledger.all_ids(0)
    assert column(ledger, "vertex")[after].tolist() == [0, 1, 2, 3] and column(ledger, "gear")[after].tolist() == [0, 1, 0, 0]
    assert column(ledger, "tangent_m")[after[1]] > 0 and column(ledger, "turns")[after[1]]


EAST_TO_NORTH, WEST_TO_SOUTH = [2, 1, 0, 4, 5], [8, 7, 7, 7, 0, 10, 11]  # the second one comes to the middle, 0, after the first


@pytest.mark.parametrize("first", [0, 1])
def test_what_is_frozen_keeps_its_order_whatever_comes_after_it(first):
    """Two robots are to pass the middle of a cross one after the other, and are sent on beyond that, both from the same time on."""
    ledger, _ = ledger_of(cross(3), [EAST_TO_NORTH, WEST_TO_SOUTH] if first == 0 else [WEST_TO_SOUTH, EAST_TO_NORTH])
    before = passing(ledger, 0)
    frozen_ahead(ledger)
    assert [route[-1] for route in ledger.committed] == ([5, 11] if first == 0 else [11, 5])
    ledger.append(Replan(dict(enumerate([route(6), route(12)] if first == 0 else [route(12), route(6)])), "replan"), policy_of("adg"), 1.0)
    assert passing(ledger, 0) == before == [first, 1 - first]


@pytest.mark.parametrize(("stays", "ends"), [((), [5, 11]), ((0,), [2, 7]), ((1,), [5, 8])])
def test_nothing_is_frozen_beyond_what_another_is_to_pass_first_who_stays(stays, ends):
    """robot_1 comes to the middle after robot_0, from 8 by way of 7."""
    ledger, _ = ledger_of(cross(3), [EAST_TO_NORTH, WEST_TO_SOUTH])
    frozen_ahead(ledger, *stays)
    assert [route[-1] for route in ledger.committed] == ends


def test_what_is_not_frozen_goes_by_the_new_times():
    ledger, _ = ledger_of(cross(3), [EAST_TO_NORTH, WEST_TO_SOUTH])
    slow = Reroute(np.array([1, 0, 4]), np.array([20.0, 23.0, 26.0]), np.array([20.0, 23.0, np.inf]), 17.0)
    ledger.append(Replan({0: slow, 1: route(7, 0, 10)}, "replan"), policy_of("adg"), 1.0)
    assert passing(ledger, 0) == [1, 0]


class Decides:
    """A policy whose order is what is made of that in force."""

    def __init__(self, order):
        self.order = order

    def decide(self, problem, plan, needs, now_s):
        return self.order(plan.order)


def swapped_at(v):
    """The order in which the two that pass a vertex change places."""

    def order(schedule):
        places, first = np.arange(schedule.num_passages), int(schedule.first[v])
        places[[first, first + 1]] = first + 1, first
        return permuted(schedule, places)

    return order


def test_a_policy_that_decides_nothing_changes_nothing():
    ledger, _ = ledger_of(cross(3), [EAST_TO_NORTH, WEST_TO_SOUTH])
    before = content(ledger)
    assert not ledger.decide(Decides(lambda order: None), 1.0)
    assert content(ledger) == before


def test_robots_pass_in_the_order_that_a_policy_decides():
    ledger, _ = ledger_of(cross(3), [EAST_TO_NORTH, WEST_TO_SOUTH])
    assert passing(ledger, 0) == [0, 1]
    assert ledger.decide(Decides(swapped_at(0)), 1.0)
    assert passing(ledger, 0) == [1, 0]


@pytest.mark.parametrize("first", [0, 1])
@pytest.mark.parametrize(("granted", "refused"), [(1, False), (2, True)])
def test_nobody_passes_before_one_that_has_been_granted_the_passage(first, granted, refused):
    """One robot passes the middle of a grid, 4, before the other; it has been granted the vertex before it, or the middle."""
    order, paths = [first, 1 - first], [[0, 1, 4, 7], [5, 5, 5, 5, 4, 3]]
    ledger, _ = ledger_of(square_grid(3), [paths[r] for r in order])
    ledger.visits.granted[first] = ledger.all_ids(first)[granted]
    with pytest.raises(PlanError, match=f"robot_{1 - first} pass before robot_{first}, which") if refused else nullcontext():
        assert ledger.decide(Decides(swapped_at(4)), 1.0)
    assert passing(ledger, 4) == (order if refused else order[::-1])


def test_a_policy_sees_each_visit_that_is_ahead_once():
    """And what they hold: robot_0 has been granted the vertex after its start, robot_1 nothing."""
    seen = []

    class Sees(Decides):
        def decide(self, problem, plan, needs, now_s):
            seen.extend(plan.vertex[a:b].tolist() for a, b in pairwise(plan.first.tolist()))

    ledger, _ = ledger_of(line(7), [[0, 1, 2, 3], [6, 5, 4]])
    ledger.visits.granted[0] = ledger.all_ids(0)[1]
    assert not ledger.decide(Sees(None), 1.0)
    assert seen == [[0, 1, 2, 3], [6, 5, 4]]


@pytest.mark.parametrize(("other", "goes_on"), [(-1, True), (0, False)])
def test_a_robot_that_gives_way_goes_on_when_it_lets_nobody_pass(other, goes_on):
    ledger, _ = ledger_of(square_grid(3), [[0, 1], [8, 7]])
    ledger.append(Replan({1: route(5, 4, pause=1)}, "give_way"), policy_of("adg"), 1.0)
    ledger.let_pass(1, other)
    yielding = ledger.state.yielding
    assert (yielding.pause[1] == NEVER, not yielding.gives_way[1]) == (goes_on, goes_on) and yielding.pause_for[1] == other


def test_a_robot_that_is_left_alone_in_a_replan_stays_where_it_was_granted():
    ledger, _ = ledger_of(square_grid(3), [[0, 1], [8, 7]])
    ledger.append(Replan({0: route(3), 1: route(5)}, "replan", left_alone=frozenset({1})), policy_of("adg"), 1.0)
    rank = int(ledger.visits.rank[ledger.visits.granted[1]])
    assert ledger.state.yielding.pause.tolist() == [NEVER, rank]


def test_times_are_squeezed_into_a_second_in_their_order_entry_by_entry():
    """What an earlier entry planned comes first, however late it was planned for; equal times stay equal."""
    squeezed = _squeezed(np.array([1, 0, 0, 1, 0]), np.array([3.0, 9.0, 7.0, 4.0, 7.0]), 100.0)
    assert squeezed == pytest.approx([100.05 + 0.9 * k / 4 for k in (2, 1, 0, 3, 0)])


@pytest.mark.parametrize("leave_s", [4.0, 7.0])
def test_a_robot_that_is_sent_another_way_leaves_when_the_new_plan_says(leave_s):
    """It was to leave 0 at 3 s."""
    ledger, _ = ledger_of(square_grid(3), [[0, 0, 1, 2]], "timed")
    assert (column(ledger, "depart_s")[0], column(ledger, "earliest_s")[0]) == (3.0, 3.0)
    ledger.append(Replan({0: route(3, 6, leave_s=leave_s)}, "detour"), policy_of("timed"), 1.0)
    assert (column(ledger, "depart_s")[0], column(ledger, "earliest_s")[0]) == (leave_s, leave_s)
    assert column(ledger, "earliest_s")[ledger.all_ids(0)[1]] == 2.0  # as planned


def test_robots_that_are_not_sent_elsewhere_keep_when_they_leave():
    ledger, _ = ledger_of(square_grid(3), [[0, 0, 1], [8, 8, 8, 7]], "timed")
    ledger.append(Replan({0: route(3, leave_s=7.0)}, "detour"), policy_of("timed"), 1.0)
    assert [float(column(ledger, "earliest_s")[ledger.all_ids(r)[0]]) for r in (0, 1)] == [7.0, 6.0]


def test_who_waits_behind_another_on_a_lane_is_not_sent_past_it():
    """Two wait on the lane to vertex 2, robot 0 behind robot 1; in either order of names, who is in front is sent on."""
    for behind, front in ((0, 1), (1, 0)):
        starts = {behind: [0, 1, 2, 3], front: [1, 2, 3]}
        graph = line(5, 2.0)
        ledger, _ = ledger_of(graph, [starts[0], starts[1]], "open_loop")
        lane, settings, visits = int(graph.lane_between(1, 2)), ExecutionSettings(), ledger.visits
        first = int(visits.next[visits.first[behind]])  # of the one behind, at vertex 1
        visits.granted[behind] = visits.reached[behind] = first
        ledger.state.motion.s_m[behind] = visits.at_m[first] + 0.5
        ledger.state.motion.s_m[front] = 1.2
        ledger.state.grants.on_lane[:], ledger.state.holds.holder[:], ledger.state.claims.number[lane] = True, -1, 2
        world = World(ledger.problem, settings, facilities_of(graph, ledger.resources))
        context = Surroundings(ledger, world, Work(Crew(ledger, settings, 3)), lambda _: pytest.fail("asked"))
        answer = situation(9.0, context, np.zeros(2, np.bool_), ledger.end_of_tasks)
        assert answer.request.robot.tolist() == [front] and answer.request.start.tolist() == [2] and answer.left_alone == {behind}


@pytest.mark.parametrize("stays", [True, False])
def test_nobody_is_planned_past_where_another_is_committed_to_come_to_stay(stays):
    """Robot 0 is at 0 and committed as far as 2, which is nobody's yet."""
    graph = line(5, 2.0)
    ledger, _ = ledger_of(graph, [[0, 1, 2], [4, 3]], "open_loop")
    ledger._cut = np.array([ledger.all_ids(0)[2], ledger.joint[1]])
    settings = ExecutionSettings()
    world = World(ledger.problem, settings, facilities_of(graph, ledger.resources))
    context = Surroundings(ledger, world, Work(Crew(ledger, settings, 3)), lambda _: pytest.fail("asked"))
    request = situation(9.0, context, np.array([stays, False]), ledger.end_of_tasks).request
    assert request.robot.tolist() == ([1] if stays else [0, 1]) and request.closed[graph.head == 2].tolist() == [stays] * 2


@pytest.mark.parametrize(("makes_way", "stops"), [(False, [1, 3]), (True, [2, 3])])
def test_who_stands_where_another_waits_to_come_makes_way_though_its_own_goal_is_taken(makes_way, stops):
    """On a one-way ring robot_0 waits on the lane to 1, which bars it: robot_2 cannot get from 3 to 2, nor robot_1 from 1 to 3."""
    ring = [(np.cos(k), np.sin(k)) for k in range(6)]
    graph = graph_of(ring, (), 2.0, one_way=[(k, (k + 1) % 6) for k in range(6)])
    ledger, _ = ledger_of(graph, [[0, 1, 2], [1, 2, 3], [3, 4, 5, 0, 1, 2]], "open_loop")
    ledger.state.motion.s_m[0], ledger.state.grants.on_lane[0] = 0.3, True
    ledger.state.claims.number[graph.lane_between(0, 1)] = 1
    settings = ExecutionSettings()
    world = World(ledger.problem, settings, facilities_of(graph, ledger.resources))
    context = Surroundings(ledger, world, Work(Crew(ledger, settings, 3)), lambda _: pytest.fail("asked"))
    answer = situation(9.0, context, np.zeros(3, np.bool_), np.array([5, 3, 2]), makes_way=makes_way)
    assert answer.left_alone == {0} and answer.request.stop.tolist() == stops


@pytest.mark.parametrize(("policy", "due_s", "earliest_s"), [("adg", [0, 0, 0], [0, 0, 0]), ("adg_timed", [0, 3, 6], [0, 3, np.inf])])
def test_robots_are_due_when_planned_only_where_their_policy_has_a_pace(policy, due_s, earliest_s):
    ledger, _ = ledger_of(line(3), [[0, 1, 2]], policy)
    assert column(ledger, "due_s").tolist()[1:] == due_s[1:] and column(ledger, "earliest_s").tolist() == earliest_s


@pytest.mark.parametrize(
    ("s_m", "granted", "enters", "keeps"),
    [
        (0.0, 3, False, 0),
        (0.0, 0, False, 0),
        (0.1, 3, False, 1),  # it is on its way to the first
        (0.1, 1, False, 1),
        (0.1, 2, True, 1),  # it has begun to claim a lane, too
    ],
)
def test_a_robot_that_stands_for_good_gives_back_what_it_is_not_on_its_way_to(s_m, granted, enters, keeps):
    """It has been granted some of the vertices 1 to 5, 0.4 m apart."""
    ledger, _ = ledger_of(line(6), [[0, 1, 2, 3, 4, 5]])
    grants, holds, claims = ledger.state.grants, ledger.state.holds, ledger.state.claims
    visits, lanes = ledger.visits, ledger.graph.lane_between
    holds.held[: granted + 1], holds.holder[: granted + 1] = 1, 0
    for k in range(granted + enters):
        claims.number[lanes(k, k + 1)] = 1
    visits.granted[0], grants.allowed_m[0], grants.on_lane[0], ledger.state.motion.s_m[0] = granted, 0.4 * granted, enters, s_m
    ledger.give_back(np.array([0]))
    assert visits.granted[0] == keeps and grants.allowed_m[0] == pytest.approx(0.4 * keeps)
    assert holds.holder.tolist() == [0] * (keeps + 1) + [-1] * (5 - keeps) and holds.held.tolist() == [1] * (keeps + 1) + [0] * (5 - keeps)
    assert [claims.number[lanes(k, k + 1)] for k in range(5)] == [1] * keeps + [0] * (5 - keeps)
    assert ledger.state.yielding.pause[0] == (keeps if granted != keeps else NEVER) and not grants.on_lane[0]


def test_of_robots_that_stand_for_good_each_gives_back_what_it_has_been_granted():
    """The first has nothing to give back, the second two vertices and the lanes there."""
    ledger, _ = ledger_of(square_grid(3), [[0, 1], [6, 7, 8]])
    holds, claims, ids = ledger.state.holds, ledger.state.claims, ledger.all_ids(1)
    lanes = [int(ledger.graph.lane_between(a, b)) for a, b in ((6, 7), (7, 8))]
    ledger.visits.granted[1], holds.holder[[7, 8]], holds.held[[7, 8]], claims.number[lanes] = ids[2], 1, 1, 1
    ledger.give_back(np.array([0, 1]))
    assert ledger.visits.granted.tolist() == ledger.visits.reached.tolist() == [0, 1]
    assert holds.holder[[6, 7, 8]].tolist() == [1, -1, -1] and claims.number[lanes].tolist() == [0, 0]


def test_a_robot_is_at_its_goal_from_the_start_or_since_it_was_told_to_stay():
    """robot_0 drives to 1, robot_1 stays at 3; at 7 s robot_2 is told to stay at 5, its goal no more being 4."""
    ledger, _ = ledger_of(line(6), [[0, 1], [3], [5, 4]])
    assert ledger.state.waits.goal_s.tolist() == pytest.approx([np.nan, 0.0, np.nan], nan_ok=True)
    ledger.append(Replan({1: route(), 2: route()}, "replan", ends={2: 5}), policy_of("adg"), 7.0)
    assert ledger.state.waits.goal_s.tolist() == pytest.approx([np.nan, 0.0, 7.0], nan_ok=True)
    assert ledger.state.home.tolist() == [True, True, True]
