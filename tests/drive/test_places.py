"""Robots go to places where they are no trouble; each case by hand, on a line."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from worlds import CELL_M, problem_on

from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.core.task import Station, Stop
from mrp_sumo.drive.places import RobotPlaces
from mrp_sumo.drive.robot_work import Leg
from mrp_sumo.drive.work_request import in_turn, older_first, passed_over
from mrp_sumo.search.distance import UNREACHABLE


def row(length, *doorsteps, ring=False, groups=None):
    """Vertices 0 to length - 1 in a row, on some of which nobody should stand; as a ring, the last one leads on to the first. Some are
    in mutex groups.
    """
    lanes = [lane for i in range(length - 1) for lane in ((i, i + 1), (i + 1, i))] + [(0, length - 1), (length - 1, 0)] * ring
    options = [{"is_passthrough_point": v in doorsteps} | (groups or {}).get(v, {}) for v in range(length)]
    nav = nav_graph(name="row", xy=[(i * CELL_M, 0) for i in range(length)], lanes=lanes, vertex_options=options)
    return plan_graph(nav, kind="roadmap", cell_m=CELL_M)


def chosen(graph, start, stops, parking=(), stays=(), aged=(), **other):
    """Where robots go that begin at `start`, and who of them makes a stop there; `stops` are vertices by robot."""
    where = RobotPlaces(problem_on(graph, start, start), parking)
    at = {r: Stop(v, 1.0, "", Station(f"at {v}", (v,))) for r, v in stops.items()}
    vertex, makes = where.choose(np.array(start), np.isin(np.arange(len(start)), stays), at, list(stops), aged, **other)
    return vertex.tolist(), makes.tolist()


@pytest.mark.parametrize(("doorsteps", "rests_at"), [((), 5), ((5,), 6), ((5, 6, 7), 8), ((5, 6, 7, 8), 3), ((3, 5, 6, 7, 8), 2)])
def test_a_robot_that_makes_room_does_not_stand_on_a_doorstep(doorsteps, rests_at):
    """robot_1 makes room at 4 for robot_0, which comes from 0: beyond it, and where there is no room, on the side it comes from."""
    assert chosen(row(9, *doorsteps), [0, 4], {0: 4}) == ([4, rests_at], [True, False])


def test_who_finds_its_place_full_is_passed_over_by_those_after_it():
    """A load was set down at 4, which robot_0 is to bring another to; robot_1 goes to 6 all the same."""
    assert chosen(row(9), [2, 7], {0: 4, 1: 6}, not_free={0: (4,)}) == ([2, 6], [False, True])


@pytest.mark.parametrize(("groups", "rests_at"), [({4: {"mutex": "a"}, 5: {"mutex": "b"}}, 5), ({4: {"mutex": "a"}, 5: {"mutex": "a"}}, 6)])
def test_a_robot_does_not_make_room_in_the_mutex_group_of_the_place(groups, rests_at):
    assert chosen(row(9, groups=groups), [0, 4], {0: 4}) == ([4, rests_at], [True, False])


@pytest.mark.parametrize(("group", "rests_at"), [("a", 10), ("b", 9)])
def test_a_robot_that_holds_the_mutex_group_of_anothers_only_way_is_sent_on(group, rests_at):
    """robot_0 comes from 0 to 8 over 4, robot_1 rests in a side road off 6."""
    pairs = [*((v, v + 1) for v in range(8)), (6, 9), (9, 10)]
    xy = [*((v * CELL_M, 0) for v in range(9)), (6 * CELL_M, CELL_M), (6 * CELL_M, 2 * CELL_M)]
    options = [{4: {"mutex": "a"}, 9: {"mutex": group}}.get(v, {}) for v in range(11)]
    nav = nav_graph(name="side", xy=xy, lanes=[lane for a, b in pairs for lane in ((a, b), (b, a))], vertex_options=options)
    assert chosen(plan_graph(nav, kind="roadmap", cell_m=CELL_M), [0, 9], {0: 8}) == ([8, rests_at], [True, False])


@pytest.mark.parametrize(("group", "rests_at"), [("a", [5, 9]), ("b", [5, 2])])
def test_a_way_round_is_none_that_the_mutex_group_of_who_rests_closes(group, rests_at):
    """robot_0 comes from 0 to 5, robot_1 rests at 2 on the shorter way; the longer one is over 7."""
    pairs = [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (1, 6), (6, 7), (7, 8), (8, 4), (3, 9)]
    xy = [(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (5, 0), (1, 2), (2, 3), (4, 2), (3, -2)]
    options = [{2: {"mutex": "a"}, 7: {"mutex": group}}.get(v, {}) for v in range(10)]
    lanes = [lane for a, b in pairs for lane in ((a, b), (b, a))]
    nav = nav_graph(name="two ways", xy=[(x * CELL_M, y * CELL_M) for x, y in xy], lanes=lanes, vertex_options=options)
    assert chosen(plan_graph(nav, kind="roadmap", cell_m=4 * CELL_M), [0, 2], {0: 5}) == (rests_at, [True, False])


def test_where_there_are_only_doorsteps_a_robot_makes_room_on_the_nearest():
    assert chosen(row(3, 0, 1, 2), [0, 1], {0: 1}) == ([1, 0], [True, False])


A, B, BOTH = {"mutex": "a"}, {"mutex": "b"}, {"mutex": "b", "cabin": "a"}


@pytest.mark.parametrize(("groups", "waits_at"), [({}, 3), ({4: A, 3: A}, 5), ({4: A, 3: B}, 3), ({4: BOTH, 3: B, 5: {"cabin": "a"}}, 2)])
def test_a_robot_does_not_wait_in_the_mutex_group_of_a_place_that_another_is_sent_to(groups, waits_at):
    assert chosen(row(9, ring=True, groups=groups), [0, 4], {0: 4}, stays=[1]) == ([waits_at, 4], [False, False])


def near_row(away_m, beyond_m=0.0, groups=None):
    """Ten vertices on a ring, of which 5 is so far from 4, where robots that need 0.383 m swing out by some."""
    graph = row(10, ring=True, groups=groups)
    xy = graph.xy.copy()
    xy[5, 0] = xy[4, 0] + away_m
    beyond = np.zeros(10)
    beyond[4] = beyond_m
    return replace(graph, xy=xy, beyond_m=beyond)


@pytest.mark.parametrize(
    ("graph", "both_go"),
    [
        (near_row(0.39), True),
        (near_row(0.37), False),
        (near_row(0.39, beyond_m=0.02), False),
        (near_row(0.39, groups={4: A, 5: B}), True),
        (near_row(0.39, groups={4: A, 5: A}), False),
    ],
)
def test_robots_are_not_sent_to_places_that_exclude_each_other(graph, both_go):
    """robot_0 is to be served at 4, robot_1 at 5: it waits beyond it, and who rests, or parks, there makes room."""
    assert chosen(graph, [0, 8], {0: 4, 1: 5}) == ([4, 5 if both_go else 6], [True, both_go])
    assert chosen(graph, [0, 5], {0: 4})[0] == [4, 5 if both_go else 6]
    assert chosen(graph, [0, 6], {0: 4}, parking=(5, 8))[0] == [4, 5 if both_go else 8]


@pytest.mark.parametrize(("away_m", "goes_to"), [(0.39, 5), (0.37, 7)])
def test_of_the_places_of_a_stop_a_robot_goes_to_one_that_is_not_too_near_to_where_another_is_sent(away_m, goes_to):
    where, start = RobotPlaces(problem_on(near_row(away_m), [3, 6], [3, 6])), np.array([3, 6])
    stops = {0: Stop(4, 1.0, "", Station("one", (4,))), 1: Stop(5, 1.0, "", Station("both", (5, 7)))}
    assert where.choose(start, np.zeros(2, bool), stops, [0, 1])[0].tolist() == [4, goes_to]


@pytest.mark.parametrize(
    ("start", "behind", "places", "goes_to"),
    [
        ((0, 7), (11, -1), (4, 3), [4, 2]),  # trailers at 3 come after it
        ((0, 7), (11, -1), (4, 2), [4, 2]),
        ((7, 0), (8, -1), (4, 3), [4, 3]),  # they are at 5
        ((4, 7), (3, -1), (4, 3), [4, 2]),  # it is there
        ((4, 7), (5, -1), (4, 3), [4, 3]),
        ((2, 0), (1, 11), (4, 5), [4, 6]),  # the other's would be at 4
        ((2, 7), (1, 8), (4, 5), [4, 5]),
        ((0, 7), (-1, -1), (4, 3), [4, 3]),  # nobody tows
    ],
)
def test_nobody_is_sent_to_where_trailers_stand_of_one_that_is_sent_beside_it(start, behind, places, goes_to):
    """A ring of twelve; robot_0 chooses first, robot_1 waits where it is out of the way if its place is taken."""
    where = RobotPlaces(problem := problem_on(row(12, ring=True), start, start))
    where.see(problem, np.array(behind))
    stops = {r: Stop(v, 1.0, "", Station(f"at {v}", (v,))) for r, v in enumerate(places)}
    assert where.choose(np.array(start), np.zeros(2, bool), stops, [0, 1])[0].tolist() == goes_to


def test_after_one_that_steps_aside_others_choose_too():
    """robot_1 leaves the place at 4 of a ring for robot_0, which was passed over often and waits at 5; robot_2 goes to 8."""
    vertex, makes = chosen(row(10, ring=True), [5, 4, 9], {0: 4, 1: 7, 2: 8}, aged=[0])
    assert (vertex[0], vertex[2], makes[2]) == (4, 8, True) and vertex[1] not in (4, 7)


def test_where_all_places_exclude_each_other_robots_are_sent_to_different_ones():
    graph = row(4, groups=dict.fromkeys(range(4), A))
    assert chosen(graph, [0, 2], {0: 2})[0] == [2, 1]


@pytest.mark.parametrize(("third", "rests_at"), [(2, 4), (4, 3)])
def test_a_robot_makes_room_where_best_nobody_stands(third, rests_at):
    """robot_1 makes room at the end of the row, so on the way to it; robot_2 stands there still, and is to go to 1."""
    assert chosen(row(6), [0, 5, third], {0: 5, 2: 1}) == ([5, rests_at, 1], [True, False, True])


def test_a_robot_that_is_in_nobodys_way_stays_even_on_a_doorstep():
    assert chosen(row(9, 6), [0, 6], {0: 4}) == ([4, 6], [True, False])


@pytest.mark.parametrize(("parking", "spots"), [((6,), [6, 1]), ((6, 0), [6, 0]), ((7, 6), [6, 7]), ((), [5, 1])])
def test_robots_without_work_park_as_far_as_there_is_room(parking, spots):
    assert chosen(row(9), [5, 1], {}, parking)[0] == spots


@pytest.mark.parametrize(("doorsteps", "waits_at"), [((), 3), ((3,), 5), ((3, 5), 2)])
def test_a_robot_waits_for_a_place_as_near_as_it_can_but_on_no_doorstep(doorsteps, waits_at):
    """robot_1 is served at 4, and can leave on the other side."""
    assert chosen(row(9, *doorsteps, ring=True), [0, 4], {0: 4}, stays=[1]) == ([waits_at, 4], [False, False])


@pytest.mark.parametrize(("doorsteps", "goes_to"), [((), [5, 4, 3]), ((5, 2, 1, 0, 8, 7, 6), [3, 4, 1])])
def test_a_robot_waits_where_another_is_to_be_served_only_if_there_is_no_other_vertex(doorsteps, goes_to):
    """robot_1 is served at 4, for which robot_0 waits; robot_2 is to be served at 3."""
    vertex, makes = chosen(row(9, *doorsteps, ring=True), [0, 4, 1], {0: 4, 2: 3}, stays=[1])
    assert (vertex, makes[2]) == (goes_to, goes_to[2] == 3)


@pytest.mark.parametrize(("groups", "waits_at"), [({}, 3), ({8: A, 3: A}, 5), ({8: A, 3: B}, 3)])
def test_a_robot_does_not_wait_in_the_mutex_group_of_a_place_where_another_is_to_be_served_next(groups, waits_at):
    """robot_1 is served at 4, for which robot_0 waits; robot_2 is to be served at 8, where it chooses its place later."""
    assert chosen(row(9, ring=True, groups=groups), [0, 4, 7], {0: 4, 2: 8}, stays=[1])[0] == [waits_at, 4, 8]


@pytest.mark.parametrize(("served_at", "waits_at"), [(10, 3), (8, 9)])
def test_a_robot_does_not_wait_in_a_dead_end_that_another_has_to_come_out_of(served_at, waits_at):
    """robot_1 is served at 5, for which robot_0 waits, which stands at 9 in the dead end from 4 to 10; robot_2 is to be served, too."""
    lanes = [lane for i in range(9) for lane in ((i, (i + 1) % 9), ((i + 1) % 9, i))] + [(4, 9), (9, 4), (9, 10), (10, 9)]
    xy = [(i * CELL_M, 0) for i in range(9)] + [(4 * CELL_M, CELL_M), (4 * CELL_M, 2 * CELL_M)]
    options = [{"is_passthrough_point": v in (4, 6)} for v in range(11)]
    graph = plan_graph(nav_graph(name="spur", xy=xy, lanes=lanes, vertex_options=options), kind="roadmap", cell_m=CELL_M)
    assert chosen(graph, [9, 5, 7], {0: 5, 2: served_at}, stays=[1])[0] == [waits_at, 5, served_at]


@pytest.mark.parametrize(("start", "waits_at"), [((0, 2), [2, 3]), ((2, 0), [3, 2])])
def test_robots_that_wait_in_line_need_not_pass_each_other(start, waits_at):
    """robot_0 is the next to be served at 4, but may stand behind robot_1."""
    assert chosen(row(9, ring=True), [*start, 4], {0: 4, 1: 4}, stays=[2])[0] == [*waits_at, 4]


@pytest.mark.parametrize(("one_way", "waits_at"), [(True, 1), (False, 3)])
def test_a_robot_waits_behind_one_that_stands_where_it_waits_and_cannot_be_passed(one_way, waits_at):
    """A ring of nine, two places off vertex 4 are taken: robot_0 comes from 1 and may wait at 3, robot_1 waits for the other one at 2."""
    ring = [(v, (v + 1) % 9) for v in range(9)]
    lanes = [*ring, *((b, a) for a, b in ring if not one_way), (4, 9), (9, 4), (4, 10), (10, 4)]
    angle = np.arange(9) * 2 * np.pi / 9
    xy = [*(9 * CELL_M * np.stack([np.cos(angle), np.sin(angle)], 1)).tolist()]
    xy += [(1.2 * xy[4][0], xy[4][1] * f) for f in (0.8, 1.8)]
    graph = plan_graph(nav_graph(name="spurs", xy=xy, lanes=lanes), kind="roadmap", cell_m=10 * CELL_M)
    assert chosen(graph, [1, 2, 9, 10], {0: 9, 1: 10}, stays=[2, 3])[0][0] == waits_at


def test_nobody_waits_where_the_robot_that_is_served_could_not_get_past():
    """In a row robot_1 cannot, wherever robot_0 waits."""
    assert chosen(row(9), [0, 4], {0: 4}, stays=[1]) == ([0, 4], [False, False])


def test_of_the_places_of_a_stop_a_robot_goes_to_one_that_nobody_who_stays_shuts_off():
    where, start = RobotPlaces(problem_on(row(9), [4, 3], [4, 3])), np.array([4, 3])
    stop = Stop(2, 1.0, "", Station("both", (2, 7)))
    vertex, makes = where.choose(start, np.array([False, True]), {0: stop}, [0])
    assert (vertex[0], makes[0]) == (7, True)


def test_of_two_robots_for_one_place_the_one_whose_turn_it_is_makes_its_stop():
    assert chosen(row(9), [0, 8], {0: 4, 1: 4})[1] == [True, False]
    assert chosen(row(9), [0, 8], {1: 4, 0: 4})[1] == [False, True]


@pytest.mark.parametrize(
    ("aside", "served", "back", "lets_pass"),
    [(2, 7, False, True), (1, 7, False, True), (0, 7, False, False), (2, 1, False, True), (1, 1, True, False)],
)
def test_who_stands_ahead_of_one_that_waits_lets_it_pass_where_it_can(aside, served, back, lets_pass):
    """One waits at 0 for a place at 4, the other stands at 3: there is room at 6, beside one of the vertices between, or beside who waits.

    Who is served, at 1 or beyond the place, may stand before that room; both drive back only where they may.
    """
    lanes = [lane for a, b in [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (5, 7), (aside, 6)] for lane in ((a, b), (b, a))]
    xy = [(v * CELL_M, 0.0) for v in range(6)] + [(aside * CELL_M, CELL_M), (6 * CELL_M, 0.0)]
    graph = plan_graph(nav_graph(name="aside", xy=xy, lanes=lanes), kind="roadmap", cell_m=CELL_M)
    assert RobotPlaces(problem_on(graph, [0, 3], [0, 3])).can_let_pass(1, 3, [0, 1, 2, 3, 4], {served}, back=back) == lets_pass


@pytest.mark.parametrize(("fork", "lets_pass"), [(3, False), (0, True)])
def test_nobody_drives_back_past_the_end_of_the_others_way_to_let_it_pass(fork, lets_pass):
    """On 2 of the way 0, 1, 2, 3 of another, with a crossing at 4 beyond one of its ends."""
    pairs = [(0, 1), (1, 2), (2, 3), (fork, 4), (4, 5), (4, 6)]
    nav = nav_graph(name="fork", xy=[(i * CELL_M, 0) for i in range(7)], lanes=[lane for a, b in pairs for lane in ((a, b), (b, a))])
    where = RobotPlaces(problem_on(plan_graph(nav, kind="roadmap", cell_m=CELL_M), [2], [2]))
    assert where.can_let_pass(0, 2, [0, 1, 2, 3], set(), back=True) == lets_pass


@pytest.mark.parametrize(("pairs", "lets_pass"), [([(0, 1)], False), ([(0, 1), (1, 5)], True)], ids=("line", "siding"))
def test_nobody_drives_back_to_let_another_pass_where_nobody_can(pairs, lets_pass):
    """One waits at 2 for a place at 4, the other stands at 3; behind the one are 1 and 0, and a siding 5 beside 1."""
    xy = [(v * CELL_M, 0.0) for v in range(5)] + [(CELL_M, CELL_M)]
    lanes = [lane for a, b in [*pairs, (1, 2), (2, 3), (3, 4)] for lane in ((a, b), (b, a))]
    graph = plan_graph(nav_graph(name="behind", xy=xy, lanes=lanes), kind="roadmap", cell_m=CELL_M)
    assert RobotPlaces(problem_on(graph, [2, 3], [2, 3])).can_let_pass(1, 3, [2, 3, 4], set(), back=True) == lets_pass


def test_nobody_waits_where_it_would_be_before_one_that_has_the_place():
    """One from 0 has the place at 4 of a ring: another, from beyond, stays at 5, though 3 is as near. One from behind waits at 3."""
    assert chosen(row(9, ring=True), [0, 5], {0: 4, 1: 4}) == ([4, 5], [True, False])
    assert chosen(row(9, ring=True), [0, 6], {0: 4, 1: 4}) == ([4, 5], [True, False])
    assert chosen(row(9, ring=True), [0, 3], {1: 4, 0: 4}) == ([3, 4], [False, True])


@pytest.mark.parametrize(
    ("ring", "leaves_for", "aged", "goes"),
    [(True, 7, [0], [4, 3]), (True, 7, [], [4, 7]), (True, 1, [0], [4, 1]), (False, 7, [0], [4, 3])],
    ids=("passed over often", "not yet", "not on its way", "line"),
)
def test_who_leaves_steps_aside_for_one_that_was_passed_over_often(ring, leaves_for, aged, goes):
    """robot_0 waits at 5 for the place at 4, which robot_1 leaves for 7, past it; at 3 it is out of the way."""
    assert chosen(row(9, ring=ring), [5, 4], {0: 4, 1: leaves_for}, aged=aged)[0] == goes


@pytest.mark.parametrize(
    ("aged", "way_round", "goes"),
    [((0,), False, ([4, 5], [True, False])), ((), False, ([4, 2], [True, True])), ((0,), True, ([4, 2], [True, True]))],
)
def test_nobody_is_served_where_one_that_was_passed_over_often_has_to_come_out(aged, way_round, goes):
    """robot_0 is to come from the dead end at 0 over 2 to 4, and robot_1 from 5, beside 3, to be served at 2; 6 and 7 lead round that."""
    pairs = [(0, 1), (1, 2), (2, 3), (3, 4), (3, 5)] + [(0, 6), (6, 7), (7, 3)] * way_round
    xy = [(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (3, 1), (1, -1), (2, -1)]
    lanes = [lane for a, b in pairs for lane in ((a, b), (b, a))]
    nav = nav_graph(name="pocket", xy=[(x * CELL_M, y * CELL_M) for x, y in xy[: 8 if way_round else 6]], lanes=lanes)
    assert chosen(plan_graph(nav, kind="roadmap", cell_m=CELL_M), [0, 5], {0: 4, 1: 2}, aged=aged) == goes


@pytest.mark.parametrize(("stays", "path"), [(1, [0, 5, 4, 3]), (4, [0, 1, 2, 3]), (2, [0, 5, 4, 3])])
def test_the_way_to_a_place_is_that_round_who_stays(stays, path):
    """A ring of six: from 0 to 3 there are two ways."""
    where = RobotPlaces(problem_on(row(6, ring=True), [0], [0]))
    assert where.route(0, 0, Stop(3, 1.0, "", Station("at 3", (3,))), {stays}) == path


@pytest.mark.parametrize(("at", "turn"), [(3, [1, 0]), (7, [0, 1])])
def test_one_that_waits_does_not_go_before_one_on_its_way_that_cannot_let_it_pass(at, turn):
    """robot_0 waits at 0 for 5, robot_1 sets out for it from 3, between them, or from 7, beyond it."""
    robots = [SimpleNamespace(num_before=0, since_s=9.0, in_line_since_s=s, task=0, making=None) for s in (1.0, np.inf)]
    start = np.array([0, at])
    crew = SimpleNamespace(places=RobotPlaces(problem_on(row(9), start, start)), robots=robots, tasks=[SimpleNamespace(priority=0)])
    assert in_turn(crew, start, dict.fromkeys((0, 1), Stop(5, 1.0)), {0: 0, 1: 0}, np.zeros(2, np.bool_), ()) == turn


@pytest.mark.parametrize(("num_before", "on_the_way", "turn"), [(1, True, [1, 0]), (2, True, [0, 1]), (2, False, [1, 0])])
def test_one_that_was_passed_over_twice_goes_first_though_it_is_in_no_line(num_before, on_the_way, turn):
    """robot_0 comes from 0 and is sent off again and again, while robot_1 sets out for 5, later and from nearer; it can make room at 6.

    How often it was passed over on the way to the stop where it still is counts no more.
    """
    lanes = [lane for a, b in [(0, 1), (1, 2), (2, 3), (3, 4), (4, 5), (1, 6)] for lane in ((a, b), (b, a))]
    xy = [(v * CELL_M, 0.0) for v in range(6)] + [(CELL_M, CELL_M)]
    graph = plan_graph(nav_graph(name="dead end", xy=xy, lanes=lanes), kind="roadmap", cell_m=CELL_M)
    came = SimpleNamespace(num_before=num_before, since_s=5.0, in_line_since_s=np.inf, task=0, making=None if on_the_way else object())
    robots = [came, SimpleNamespace(num_before=0, since_s=9.0, in_line_since_s=np.inf, task=0, making=None)]
    start = np.array([0, 3])
    crew = SimpleNamespace(
        places=RobotPlaces(problem_on(graph, start, start), ()), robots=robots, tasks=[SimpleNamespace(priority=0)], made_s=0.0
    )
    aged = passed_over(crew, (0, 1), 9.0)
    assert in_turn(crew, start, dict.fromkeys((0, 1), Stop(5, 1.0)), {0: 0, 1: 0}, np.zeros(2, np.bool_), aged) == turn


@pytest.mark.parametrize(("in_line_since_s", "turn"), [(4.0, [1, 0]), (np.inf, [0, 1])])
def test_one_that_came_to_its_place_is_not_sent_away_for_one_that_was_passed_over(in_line_since_s, turn):
    """robot_0 was passed over twice and waits at 0, robot_1 stands at the place: it came for it, or has a new order there."""
    robots = [
        SimpleNamespace(num_before=n, since_s=s, in_line_since_s=line_s, task=0, making=None)
        for n, s, line_s in ((2, 1.0, 1.0), (0, 3.0, in_line_since_s))
    ]
    start = np.array([0, 5])
    crew = SimpleNamespace(places=RobotPlaces(problem_on(row(9), start, start)), robots=robots, tasks=[SimpleNamespace(priority=0)])
    assert in_turn(crew, start, dict.fromkeys((0, 1), Stop(5, 1.0)), {0: 0, 1: 0}, np.zeros(2, np.bool_), {0}) == turn


def turns(graph, place, start, *, num_before, priorities=(0, 0)):
    """The order in which two robots choose, the first of which set out first and was passed over so often."""
    robots = [
        SimpleNamespace(num_before=n, since_s=since_s, in_line_since_s=np.inf, task=r, making=None)
        for r, (n, since_s) in enumerate([(num_before, 5.0), (0, 9.0)])
    ]
    places = RobotPlaces(problem_on(graph, start, start))
    crew = SimpleNamespace(places=places, robots=robots, tasks=[SimpleNamespace(priority=p) for p in priorities], made_s=0.0)
    aged = passed_over(crew, (0, 1), 9.0)
    return in_turn(crew, np.array(start), dict.fromkeys((0, 1), Stop(place, 1.0)), {0: 0, 1: 1}, np.zeros(2, np.bool_), aged)


@pytest.mark.parametrize(("num_before", "turn"), [(1, [1, 0]), (2, [0, 1])])
def test_on_a_one_way_ring_who_is_ahead_of_one_that_was_passed_over_twice_drives_round_once_more(num_before, turn):
    """A ring of six with a place beside 3: robot_0 comes from 0, robot_1 from 2, and can let it by at 4."""
    lanes = [*((v, (v + 1) % 6) for v in range(6)), (3, 6), (6, 3)]
    xy = [(0, 0), (1, 0), (2, 0), (3, 0), (3, 1), (0, 1), (4, 0)]
    graph = plan_graph(nav_graph(name="ring", xy=[(x * CELL_M, y * CELL_M) for x, y in xy], lanes=lanes), kind="roadmap", cell_m=3 * CELL_M)
    assert turns(graph, 6, [0, 2], num_before=num_before) == turn


@pytest.mark.parametrize(("num_before", "turn"), [(1, [1, 0]), (2, [0, 1])])
def test_one_that_was_passed_over_twice_goes_before_an_urgent_order(num_before, turn):
    """Both come to 4 of a row, from the two sides."""
    assert turns(row(9), 4, [0, 8], num_before=num_before, priorities=(0, 1)) == turn


@pytest.mark.parametrize(
    ("num_before", "priorities", "begun", "swapped"),
    [(2, (0, 0), 0, {1: 0, 0: 1}), (1, (0, 0), 0, {}), (2, (0, 1), 0, {}), (2, (1, 0), 0, {1: 0, 0: 1}), (2, (0, 0), 1, {})],
    ids=("twice", "once", "more urgent", "less urgent", "begun"),
)
def test_one_that_was_passed_over_twice_gives_the_older_order_to_the_one_that_goes_first(num_before, priorities, begun, swapped):
    """robot_1 goes before robot_0, which has order 0; order 1 is younger."""
    robots = [SimpleNamespace(num_before=n, making=None) for n in (num_before, 0)]
    orders = SimpleNamespace(released_s=(0.0, 5.0).__getitem__)
    tasks = [SimpleNamespace(priority=priority) for priority in priorities]
    crew = SimpleNamespace(
        robots=robots, orders=orders, tasks=tasks, made_s=0.0, may_pass_on=lambda robot: True, can_do=lambda robot, task: True
    )
    legs = {0: [Leg(0, 0, -1)], 1: [Leg(1, begun, -1)]}
    assert older_first(crew, [1, 0], dict.fromkeys((0, 1), Stop(5, 1.0)), legs, {}, passed_over(crew, (0, 1), 9.0)) == swapped
    assert older_first(crew, [0, 1], dict.fromkeys((0, 1), Stop(5, 1.0)), legs, {}, passed_over(crew, (0, 1), 9.0)) == {}


@pytest.mark.parametrize(("now_s", "robots"), [(59.9, {1}), (60.0, set())])
def test_nobody_is_let_by_where_no_stop_was_made_for_a_minute(now_s, robots):
    crew = SimpleNamespace(robots=[SimpleNamespace(num_before=n, making=None) for n in (1, 2)], made_s=0.0)
    assert passed_over(crew, (0, 1), now_s) == robots


def test_to_a_place_that_no_way_leads_to_a_robot_does_not_set_out():
    """0 leads to 1, and 1 nowhere."""
    nav = nav_graph(name="one way", xy=[(0, 0), (CELL_M, 0)], lanes=[(0, 1)])
    where = RobotPlaces(problem_on(plan_graph(nav, kind="roadmap", cell_m=CELL_M), [0], [0]))
    stops = [Stop(v, 1.0, "", Station(f"at {v}", (v,))) for v in (0, 1)]
    assert (where.route(0, 0, stops[1], set()), where.away(0, 0, stops[1])) == ([0, 1], 1)
    assert (where.route(0, 1, stops[0], set()), where.away(0, 1, stops[0])) == ([1], UNREACHABLE)


def test_a_robot_without_work_stays_where_no_way_leads_to_a_place_to_park():
    """0 leads to 1, and 1 nowhere."""
    nav = nav_graph(name="one way", xy=[(0, 0), (CELL_M, 0)], lanes=[(0, 1)])
    graph = plan_graph(nav, kind="roadmap", cell_m=CELL_M)
    assert chosen(graph, [1], {}, parking=(0,))[0] == [1]
    assert chosen(graph, [0], {}, parking=(1,))[0] == [1]


@pytest.mark.parametrize(("stands", "near"), [([2], [1, 3, 0, 4, 2]), ([1, 2], [0, 3, 4, 1, 2])])
def test_beside_robots_are_the_nearest_vertices_that_are_clear_of_all_of_them(stands, near):
    """On a row of five; where somebody stands comes last."""
    assert RobotPlaces(problem_on(row(5), [0], [0])).beside(np.array(stands)) == near


@pytest.mark.parametrize(
    ("stops", "has_room"), [((1, 3), True), ((2,), True), ((4,), False), ((1, 4), False), ((0,), True), ((0, 1), False)]
)
def test_a_robot_has_room_where_it_comes_and_goes_on_though_it_never_comes_back_to_its_start(stops, has_room):
    """A lane leads from its start 0 to the row 1, 2, 3, and none back; that from 3 to 4 is barred to it."""
    lanes = [(0, 1), (1, 2), (2, 1), (2, 3), (3, 2), (3, 4)]
    graph = plan_graph(nav_graph(name="row", xy=[(i * CELL_M, 0) for i in range(5)], lanes=lanes), kind="roadmap", cell_m=CELL_M)
    problem = replace(problem_on(graph, [0], [0]), barred=(graph.head == 4)[None])
    assert RobotPlaces(problem).has_room(0, [Stop(v) for v in stops]) == has_room
