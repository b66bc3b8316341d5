"""The rules of controller and observer, each by hand: the kernels as plain Python, on robots that drive along lines of 1 m lanes."""

from inspect import unwrap
from types import SimpleNamespace as Group

import numpy as np
import pytest
from plain_kernels import as_plain_python

from mrp_sumo.drive import _causes, _grants, _observe
from mrp_sumo.drive._causes import (
    ARRIVED_AT_GOAL,
    AT_GOAL,
    BLOCKED,
    DEPENDENCY_WAIT,
    DISTURBANCE,
    DISTURBED,
    FACILITY,
    FINISHED,
    FOLLOWING,
    FREE,
    LETTING_PASS,
    MARGIN_M,
    MOVING,
    ONCOMING,
    OTHER,
    PLANNED,
    PLANNED_WAIT,
    SET_OUT,
    STOOD_BLOCKED,
    TURN,
    TURNING,
    WAITED,
    YIELDING,
)
from mrp_sumo.drive.state import NEVER, StepArrays

PER_ROBOT = 4  # visits at 0, 1, 2 and 3 m


@pytest.fixture(autouse=True)
def plain(monkeypatch):
    as_plain_python(monkeypatch, _grants, _observe)


def scene(num_robots=1, ordered=False):
    """Robots at rest at the first of their visits, each of which needs a resource of its own and has a lane of its own to it."""
    num_visits, robot, visit = num_robots * PER_ROBOT, np.arange(num_robots), np.arange(num_robots * PER_ROBOT)
    rank, first = visit % PER_ROBOT, robot * PER_ROBOT

    def each(value, count=num_robots, dtype=None):
        return np.full(count, value, dtype)

    return StepArrays(
        visits=Group(
            next=np.where(rank < PER_ROBOT - 1, visit + 1, -1),
            rank=rank,
            lane=np.where(rank > 0, visit, -1),
            at_m=rank * 1.0,
            turns=each(False, num_visits),
            heading_rad=each(0.0, num_visits),
            arrive_s=rank * 2.0,
            depart_s=rank * 2.0,
            earliest_s=each(0.0, num_visits),
            due_s=each(0.0, num_visits),
            arrived_s=each(np.nan, num_visits),
            short_of_m=each(np.inf, num_visits),
            reverse=each(-1, num_visits),
            first=first,
            last=first + PER_ROBOT - 1,
            reached=first.copy(),
            granted=first.copy(),
        ),
        needs=Group(
            first=np.arange(num_visits + 1),
            resource=visit.copy(),
            left_at_m=rank + 0.5,
            freed=each(False, num_visits),
            passage=each(0, num_visits),
            closes=each(True, num_visits),
            passing=robot if ordered else robot[:0],
        ),
        state=Group(
            grants=Group(
                cause=each(FREE),
                other=each(-1),
                asked_s=each(np.inf),
                wanted=each(-1),
                on_lane=each(False),
                ahead=each(-1),
                turned_back=each(False),
                allowed_m=each(0.0),
                command_mps=each(0.0),
                oldest=first.copy(),
                queue=robot.copy(),
            ),
            holds=Group(holder=each(-1, num_visits), held=each(0, num_visits), turn=each(0, num_visits)),
            claims=Group(number=each(0, num_visits), claimer=each(-1, num_visits)),
            motion=Group(**{name: each(0.0) for name in ("s_m", "moved_m", "speed_mps", "yaw_rad")}, turning=each(False)),
            waits=Group(
                waiting=each(False),
                stuck=each(False),
                category=each(-1),
                booked_s=np.zeros((num_robots, 8)),
                mark_m=each(0.0),
                mark_s=each(0.0),
                since_s=each(np.inf),
                cause=each(FREE),
                other=each(-1),
                where=each(-1),
                goal_s=each(np.nan),
            ),
            yielding=Group(pause=each(NEVER), pause_for=each(-1), gives_way=each(False)),
            home=each(True),
            facing_rad=each(np.nan),
        ),
        kinematics=Group(
            speed_mps=each(1.0), decel_mps2=each(0.5), reach_m=each(0.5), radius_m=each(0.25), gap_m=each(0.1), behind_m=each(0.0),
            turn_rate_rad_s=each(1.0),
        ),
        rules=Group(step_s=0.1, look_ahead=10, asks_late=False, paced=False, books=True, cell_m=1.0, window_s=10.0, wait_least_s=1.0),
        conditions=Group(
            prompt=True,
            told_m=each(0.0),
            hold_until_s=each(0.0),
            factor=each(1.0),
            closed=each(False, num_visits),
            facilities=Group(shut=each(False, num_visits)),
            people=Group(any=False, halted=each(False)),
        ),
        notices=Group(changed=each(-1)),
        log=Group(
            num_entries=np.zeros(1, np.int64),
            entries=Group(
                **{name: each(-9, 9) for name in ("kind", "robot", "cause", "visit", "other")},
                **{name: each(np.nan, 9) for name in ("begin_s", "end_s")},
            ),
        ),
    )  # fmt: skip


def put(world, places):
    """Set elements of arrays by dotted names, such as {"visits.turns": {0: True}}, or all of them, or a number of its own."""
    for name, value in places.items():
        *above, last = name.split(".")
        record = world
        for part in above:
            record = getattr(record, part)
        if isinstance(value, dict):
            for place, one in value.items():
                getattr(record, last)[place] = one
        elif isinstance(getattr(record, last), np.ndarray):
            getattr(record, last)[:] = value
        else:
            setattr(record, last, value)
    return world


def entries(world):
    """The log, an entry a row."""
    columns = vars(world.log.entries).values()
    return [tuple(column[k] for column in columns) for k in range(world.log.num_entries[0])]


AT_SECOND = {"visits.reached": {0: 1}, "visits.granted": {0: 1}, "state.motion.s_m": {0: 1.0}, "state.grants.allowed_m": {0: 1.0}}
AT_END = {"visits.reached": {0: 3}, "visits.granted": {0: 3}, "state.motion.s_m": {0: 3.0}}
STOPS = {  # what holds a robot at its first visit -> why it waits, for whom, how many visits it is granted
    "nothing": ({}, FREE, -1, 1),
    "the end of its way": (AT_END, FINISHED, -1, 3),
    "the end of its way, not its place": (AT_END | {"state.home": False}, LETTING_PASS, -1, 3),
    "the end of its way, driving": (AT_END | {"visits.reached": {0: 2}}, FREE, -1, 3),
    "a pause": ({"state.yielding.pause": 0, "state.yielding.pause_for": 7}, LETTING_PASS, 7, 0),
    "a pause farther on": ({"state.yielding.pause": 1, "state.yielding.pause_for": 7}, FREE, -1, 1),
    "a turn": ({"visits.turns": {0: True}, "visits.heading_rad": {1: 1.0}}, TURNING, -1, 0),
    "a turn that is made": ({"visits.turns": {0: True}}, FREE, -1, 1),
    "a plan": ({"visits.earliest_s": {0: 20.0}}, PLANNED, -1, 0),
    "a plan from now on": ({"visits.earliest_s": {0: 10.0}}, FREE, -1, 1),
    "a closed lane": ({"conditions.closed": {1: True}}, DISTURBED, -1, 0),
    "a closed lane that it is on": ({"conditions.closed": {1: True}, "state.grants.on_lane": True}, FREE, -1, 1),
    "a robot that comes": ({"visits.reverse": {1: 2}, "state.claims.number": {2: 1}, "state.claims.claimer": {2: 5}}, ONCOMING, 5, 0),
    "nobody on the other side": ({"visits.reverse": {1: 2}}, FREE, -1, 1),
    "a lane without another side": ({"state.claims.number": {3: 1}}, FREE, -1, 1),
    "a door": ({"conditions.facilities.shut": {1: True}}, FACILITY, -1, 0),
    "a door that it is in": ({"conditions.facilities.shut": {1: True}, "state.grants.on_lane": True}, FREE, -1, 1),
    "a door and a robot": ({"conditions.facilities.shut": {1: True}, "state.holds.holder": {1: 6}}, OTHER, 6, 0),
    "a robot": ({"state.holds.holder": {1: 6}}, OTHER, 6, 0),
    "itself, as it holds that already": ({"state.holds.holder": {1: 0}, "state.holds.held": {1: 1}}, FREE, -1, 1),
}


@pytest.mark.parametrize("what", STOPS)
def test_what_holds_a_robot(what):
    places, cause, other, granted = STOPS[what]
    world = put(scene(), places)
    _grants.grant(10.0, world)
    grants = world.state.grants
    assert (grants.cause[0], grants.other[0], world.visits.granted[0]) == (cause, other, granted)
    assert grants.wanted[0] == (3 if granted == 3 else granted + 1)
    assert np.isfinite(grants.asked_s[0]) == (what in ("a robot that comes", "a door", "a door and a robot", "a robot"))


def test_a_visit_that_is_granted_is_held_and_its_lane_claimed():
    world = scene()
    _grants.grant(10.0, world)
    grants, holds, claims = world.state.grants, world.state.holds, world.state.claims
    assert holds.holder.tolist() == [-1, 0, -1, -1] and holds.held.tolist() == [0, 1, 0, 0]
    assert claims.number.tolist() == [0, 1, 0, 0] and claims.claimer.tolist() == [-1, 0, -1, -1]
    assert grants.allowed_m[0] == 1.0 and not grants.on_lane[0]


@pytest.mark.parametrize(("ordered", "asks_late", "granted"), [(False, False, 1), (True, False, 3), (True, True, 1)])
def test_visits_are_granted_within_braking_distance_or_to_the_end_where_an_order_is_kept(ordered, asks_late, granted):
    world = put(scene(ordered=ordered), {"rules.asks_late": asks_late})
    _grants.grant(10.0, world)
    assert world.visits.granted[0] == granted


@pytest.mark.parametrize(("look_ahead", "granted"), [(1, 1), (2, 2), (9, 3)])
def test_robots_look_so_many_visits_ahead(look_ahead, granted):
    world = put(scene(ordered=True), {"rules.look_ahead": look_ahead})
    _grants.grant(10.0, world)
    assert world.visits.granted[0] == granted


def test_a_robot_that_drives_does_not_ask_for_what_comes_after_a_turn():
    world = put(scene(ordered=True), {"visits.turns": {1: True}})
    _grants.grant(10.0, world)
    assert (world.visits.granted[0], world.state.grants.cause[0]) == (1, FREE)


@pytest.mark.parametrize(("earliest_s", "due_s", "granted"), [(12.0, 12.0, 3), (12.1, 12.1, 1), (10.1, 10.0, 1), (12.0, 10.0, 1)])
def test_who_is_to_drive_through_asks_as_early_as_it_takes_to_brake_and_who_is_to_stop_in_time(earliest_s, due_s, granted):
    """From 1 m/s at 0.5 m/s2 it takes 2 s to brake."""
    world = put(scene(ordered=True), {"visits.earliest_s": {1: earliest_s}, "visits.due_s": {1: due_s}})
    _grants.grant(10.0, world)
    assert world.visits.granted[0] == granted


@pytest.mark.parametrize(("earliest_s", "granted"), [(10.5, 3), (10.6, 1)])
def test_who_brakes_at_once_asks_as_early_as_it_is_to_know_how_far_it_may_go(earliest_s, granted):
    """It is to know that for 1 m at 2 m/s."""
    world = put(scene(ordered=True), {"visits.earliest_s": {1: earliest_s}, "visits.due_s": {1: earliest_s}})
    put(world, {"kinematics.speed_mps": 2.0, "kinematics.decel_mps2": 20.0, "kinematics.reach_m": 1.0})
    _grants.grant(10.0, world)
    assert world.visits.granted[0] == granted


def test_robots_pass_in_the_order_that_is_kept():
    world = put(scene(2, ordered=True), {"needs.resource": {1: 1, 5: 1}, "needs.passage": {1: 1, 5: 0}})
    world.needs.passing = np.array([1, 0])
    _grants.grant(10.0, world)
    grants = world.state.grants
    assert (grants.cause[0], grants.other[0], world.visits.granted.tolist()) == (OTHER, 1, [0, 7])
    world.needs.passage[6:] = 1  # robot 1 is to pass there again before its first passage is over
    again = put(scene(ordered=True), {"needs.passage": {1: 1}})
    again.needs.passing = np.array([0, 0])
    _grants.grant(10.0, again)
    assert (again.state.grants.cause[0], again.state.grants.other[0]) == (DISTURBED, -1)


def test_without_an_order_who_has_asked_longest_is_first_then_the_lower_number():
    world = put(scene(4), {"state.grants.asked_s": {0: np.inf, 1: 5.0, 2: 3.0, 3: 5.0}, "needs.resource": {1: 1, 5: 1, 9: 1, 13: 1}})
    _grants.grant(10.0, world)
    assert world.state.grants.queue.tolist() == [2, 1, 3, 0]
    assert world.visits.granted.tolist() == [0, 4, 9, 12]
    assert world.state.grants.other.tolist() == [2, 2, -1, 2]
    assert world.state.grants.asked_s.tolist() == [10.0, 5.0, np.inf, 5.0]  # who waits keeps its turn


def test_who_waits_for_a_place_drives_up_to_it_behind_who_is_ahead():
    """Robot 1 is on the lane already, at 0.8 m of it; between the middles are to be two radii, a gap, and what robot 1 pulls."""
    world = put(scene(2), {"visits.lane": {5: 1}, "visits.short_of_m": 0.9, "state.motion.s_m": {1: 0.8}, "kinematics.behind_m": {1: 0.05}})
    put(world, {"state.claims.number": {1: 1}, "state.claims.claimer": {1: 1}, "state.holds.holder": {1: 1}, "visits.granted": {1: 7}})
    _grants.grant(10.0, world)
    grants, claims = world.state.grants, world.state.claims
    assert (grants.cause[0], grants.on_lane[0], grants.ahead[0], claims.number[1]) == (OTHER, True, 1, 2)
    assert grants.allowed_m[0] == pytest.approx(0.8 - 0.5 - 0.1 - 0.05)
    world.state.motion.s_m[1] = 0.9
    _grants.grant(10.1, world)
    assert grants.allowed_m[0] == pytest.approx(0.9 - 0.5 - 0.1 - 0.05)
    world.visits.reached[1] = 5  # it has left the lane
    _grants.grant(10.2, world)
    assert grants.allowed_m[0] == 0.9 and grants.ahead[0] == -1 and claims.number[1] == 2
    world.state.holds.holder[1], world.state.motion.s_m[0] = -1, 0.45
    _grants.grant(10.3, world)
    assert (grants.cause[0], grants.on_lane[0], grants.allowed_m[0], claims.number[1]) == (FREE, False, 1.0, 2)


def test_who_is_first_on_a_lane_drives_up_to_the_place_that_it_waits_for():
    world = put(scene(2), {"visits.short_of_m": 0.9, "state.holds.holder": {1: 1}, "state.claims.claimer": {1: 1}})
    _grants.grant(10.0, world)
    grants, claims = world.state.grants, world.state.claims
    assert (grants.ahead[0], grants.allowed_m[0], claims.number[1], claims.claimer[1]) == (-1, 0.9, 1, 0)


SPEEDS = {  # at 0.2 m before the end of what it may drive, 0.5 m/s2, steps of 0.1 s; what it is told, and why it waits then
    "to stop there": ({}, unwrap(_grants.stop_speed)(0.199, 0.5, 0.1), FREE),
    "its top speed": ({"state.grants.allowed_m": 9.0}, 1.0, FREE),
    "slowed down": ({"state.grants.allowed_m": 9.0, "conditions.factor": 0.6}, 0.6, FREE),
    "what rounding leaves": ({"state.grants.allowed_m": MARGIN_M + 5e-11}, 0.0, FREE),
    "held": ({"conditions.hold_until_s": 10.1}, 0.0, DISTURBED),
    "no longer held": ({"conditions.hold_until_s": 10.0, "state.grants.allowed_m": 9.0}, 1.0, FREE),
    "held at the end": ({"conditions.hold_until_s": 10.1, "state.grants.cause": FINISHED}, 0.0, FINISHED),
    "halted by people": ({"conditions.people.any": True, "conditions.people.halted": True}, 0.0, DISTURBED),
    "halted at the end": ({"conditions.people.any": True, "conditions.people.halted": True, "state.grants.cause": FINISHED}, 0.0, FINISHED),
    "near people": ({"conditions.people.any": True, "state.grants.allowed_m": 9.0}, 0.25, FREE),
    "early": ({"rules.paced": True, "visits.due_s": {1: 12.0}, "state.grants.allowed_m": 9.0}, 0.5, FREE),
    "early at its last visit": (AT_END | {"rules.paced": True, "visits.due_s": 90.0, "state.grants.allowed_m": 9.0}, 1.0, FREE),
    "very early": ({"rules.paced": True, "visits.due_s": {1: 90.0}, "state.grants.allowed_m": 9.0}, 0.1, FREE),
    "late": ({"rules.paced": True, "visits.due_s": {1: 10.0}, "state.grants.allowed_m": 9.0}, 1.0, FREE),
    "it has not heard": ({"conditions.prompt": False, "state.grants.allowed_m": 9.0, "conditions.told_m": 0.0}, 0.0, FREE),
    "it has heard": ({"conditions.prompt": False, "conditions.told_m": 9.0}, 1.0, FREE),
}


@pytest.mark.parametrize("what", SPEEDS)
def test_speed_that_a_robot_is_told(monkeypatch, what):
    places, speed, cause = SPEEDS[what]
    monkeypatch.setattr(_grants, "heed", lambda r, v, *others: 0.0 if others[-1].halted[r] else v / 4)
    world = put(scene(), {"state.grants.allowed_m": 0.2, "state.grants.command_mps": -1.0} | places)
    assert _grants.command(10.0, world) == 1
    assert (world.state.grants.command_mps[0], world.state.grants.cause[0]) == (pytest.approx(speed), cause)


def test_speeds_are_told_when_they_change_when_robots_are_to_stop_and_all_when_they_are_sent_again():
    world = put(scene(3), {"state.grants.allowed_m": {0: 9.0, 1: 9.0}, "state.grants.command_mps": {0: 1.0, 1: 0.9998, 2: 5e-5}})
    assert _grants.command(10.0, world) == 2
    assert world.notices.changed[:2].tolist() == [1, 2] and world.state.grants.command_mps.tolist() == [1.0, 1.0, 0.0]
    assert _grants.command(10.1, world) == 0
    _grants.send_again(world.state.grants)
    assert _grants.command(10.2, world) == 3 and world.notices.changed.tolist() == [0, 1, 2]


def test_what_a_robot_has_left_is_free_and_the_turn_passes_on():
    world = put(scene(), AT_SECOND | {"state.holds.holder": {0: 0, 1: 0}, "state.holds.held": {0: 2, 1: 1}, "needs.closes": {1: False}})
    grants, holds = world.state.grants, world.state.holds
    _grants.release(np.array([0.49]), world.visits, world.needs, grants, holds)
    assert holds.held.tolist() == [2, 1, 0, 0] and grants.oldest[0] == 0
    _grants.release(np.array([0.5]), world.visits, world.needs, grants, holds)
    assert holds.held.tolist() == [1, 1, 0, 0] and holds.holder[0] == 0  # it holds that for another visit, too
    assert holds.turn.tolist() == [1, 0, 0, 0] and grants.oldest[0] == 1 and world.needs.freed[0]
    _grants.release(np.array([1.5]), world.visits, world.needs, grants, holds)
    assert holds.held.tolist() == [1, 0, 0, 0] and holds.holder[1] == -1 and holds.turn[1] == 0  # it is to come back
    assert grants.oldest[0] == 2


def test_a_robot_holds_what_it_has_been_granted_and_not_come_to():
    world = put(scene(), {"visits.granted": {0: 2}, "needs.left_at_m": 0.0})
    _grants.release(np.zeros(1), world.visits, world.needs, world.state.grants, world.state.holds)
    assert world.needs.freed.tolist() == [True, True, False, False]  # that it is on its way to may be behind it already


def test_grants_that_are_given_back_are_held_once_less():
    world = put(scene(), {"visits.granted": {0: 3}, "state.grants.on_lane": True, "state.grants.allowed_m": 3.0})
    put(world, {"state.holds.held": {1: 1, 2: 2, 3: 3}, "state.holds.holder": 0, "state.claims.number": {2: 1, 3: 2}})
    grants, holds, claims = world.state.grants, world.state.holds, world.state.claims
    _grants.give_back(world.state, world.visits, 0, 1, np.array([2, 3, 3]), np.array([2, 3]))
    assert holds.held.tolist() == [0, 1, 1, 1] and holds.holder.tolist() == [0, 0, 0, 0] and claims.number.tolist() == [0, 0, 0, 1]
    assert (world.visits.granted[0], grants.on_lane[0], grants.allowed_m[0]) == (1, False, 1.0)
    _grants.give_back(world.state, world.visits, 0, 1, np.array([2]), np.array([3]))
    assert holds.holder.tolist() == [0, 0, -1, 0]


def test_who_turns_back_claims_the_other_side_of_its_lane_until_it_comes_to_the_vertex_behind():
    world = put(scene(), {"visits.reverse": {1: 2, 2: 1}, "state.claims.number": {1: 1, 2: 1}})
    grants, holds, claims = world.state.grants, world.state.holds, world.state.claims
    _grants.turn_back(world.state, 0, 0.4, 2, np.array([0, 3]))
    assert grants.turned_back[0] and grants.allowed_m[0] == 0.4 and claims.number.tolist() == [0, 1, 2, 0]
    assert claims.claimer[2] == 0 and holds.holder.tolist() == [0, -1, -1, 0]
    _grants.leave_lane(0, 2, world.visits, grants, claims)
    assert claims.number.tolist() == [0, 0, 1, 0] and not grants.turned_back[0]
    _grants.leave_lane(0, 2, world.visits, grants, claims)
    assert claims.number.tolist() == [0, 0, 0, 0]


def test_changes_that_new_ways_bring():
    world = put(scene(2), {"state.grants.cause": OTHER, "state.grants.other": 1, "state.grants.asked_s": 4.0})
    grants, holds = world.state.grants, world.state.holds
    _grants.ask_anew(grants, 1, 6)
    assert (grants.cause[1], grants.other[1], grants.asked_s[1], grants.wanted[1]) == (FREE, -1, np.inf, 6)
    assert (grants.cause[0], grants.other[0], grants.asked_s[0]) == (OTHER, 1, 4.0)
    _grants.hold(holds, 1, np.array([2, 5]))
    assert holds.holder.tolist() == [-1, -1, 1, -1, -1, 1, -1, -1] and holds.held.sum() == 2
    _grants.renumber(grants, np.array([-1, 0, 1, 2, 3, 4, 5, 6, -1]))
    assert grants.oldest.tolist() == [-1, 3] and grants.wanted.tolist() == [-1, 5]
    waits = put(world, {"state.waits.where": {0: 6, 1: -1}}).state.waits
    _observe.renumber(waits, np.array([-1, 0, 1, 2, 3, 4, 5, 6, -1]))
    assert waits.where.tolist() == [5, -1]


@pytest.mark.parametrize(("yaw_rad", "halted", "after_rad", "turning"), [
    (0.0, False, 0.1, True), (0.95, False, 1.0, True), (2.0, False, 1.9, True), (0.0, True, 0.0, True), (1.0, False, 1.0, False),
    (1.0 - np.pi + 0.5, False, 1.0 - np.pi + 0.6, True), (1.0 - np.pi - 0.5, False, 1.0 - np.pi - 0.6, True),
])  # fmt: skip
def test_robots_turn_the_shorter_way_unless_people_halt_them(yaw_rad, halted, after_rad, turning):
    world = put(scene(), {"visits.heading_rad": {1: 1.0}, "state.motion.yaw_rad": yaw_rad, "conditions.people.halted": halted})
    motion = world.state.motion
    _observe.move(np.array([0.03]), 0.1, np.ones(1), world.visits, motion, world.state.facing_rad, world.conditions.people.halted)
    assert motion.yaw_rad[0] == pytest.approx(after_rad) and motion.turning[0] == turning
    assert (motion.moved_m[0], motion.speed_mps[0]) == (pytest.approx(0.03), pytest.approx(0.3))


STOOD = {"state.motion.moved_m": 0.0, "state.grants.command_mps": 0.5}
BOOKED = {
    "it drives": ({"state.motion.moved_m": 0.01}, MOVING),
    "it drives to let somebody pass": ({"state.motion.moved_m": 0.01, "state.yielding.gives_way": True}, YIELDING),
    "it lets somebody pass": (STOOD | {"state.grants.cause": LETTING_PASS, "state.yielding.gives_way": True}, YIELDING),
    "it is held": (STOOD | {"state.grants.cause": DISTURBED}, DISTURBANCE),
    "it is held while it gives way": (STOOD | {"state.grants.cause": DISTURBED, "state.yielding.gives_way": True}, DISTURBANCE),
    "it turns": (STOOD | {"state.motion.turning": True}, TURN),
    "it is planned to wait": (STOOD | {"state.grants.cause": PLANNED}, PLANNED_WAIT),
    "it waits for another": (STOOD | {"state.grants.cause": OTHER}, DEPENDENCY_WAIT),
    "it waits for another for long": (STOOD | {"state.grants.cause": OTHER, "state.waits.stuck": True}, BLOCKED),
    "it is free, and told to go": (STOOD, DEPENDENCY_WAIT),
    "it has just been allowed to go": (STOOD | {"state.grants.command_mps": 0.0}, MOVING),
    "it is at its goal": (AT_END, AT_GOAL),
    "it is at its goal, and gave way": (AT_END | {"state.yielding.gives_way": True}, AT_GOAL),
    "it turns at its goal": (AT_END | {"state.motion.turning": True, "state.facing_rad": 1.0}, TURN),
    "it turns at its goal as it likes": (AT_END | {"state.motion.turning": True}, AT_GOAL),
    "it is where it has no work": (AT_END | {"state.home": False}, BLOCKED),
    "it is held where it has no work": (AT_END | {"state.home": False, "state.grants.cause": DISTURBED}, DISTURBANCE),
}


WAITS = ("it lets somebody pass", "it waits for another", "it waits for another for long", "it is free, and told to go")


@pytest.mark.parametrize("what", BOOKED)
def test_what_a_step_is_booked_to(what):
    places, kind = BOOKED[what]
    world = put(scene(), places)
    _observe.book(world.rules, world.visits, world.state)
    waits = world.state.waits
    assert waits.category[0] == kind
    assert waits.booked_s[0, kind] == pytest.approx(0.1) and waits.booked_s.sum() == pytest.approx(0.1)
    assert waits.waiting[0] == (what in WAITS)


def stuck_after(places, at_m=0.0):
    """How long a robot that stays where it is has to stand until it is blocked, and what the plan asks of it."""
    world = put(scene(), places)
    world.state.motion.s_m[0] = at_m
    for step in range(1, 400):
        _observe.watch_progress(step * 0.1, np.array([at_m]), world.rules, world.visits, world.state, world.log)
        if world.state.waits.stuck[0]:
            return step * 0.1
    return np.inf


@pytest.mark.parametrize(("places", "at_m", "after_s"), [
    ({"state.waits.category": DEPENDENCY_WAIT}, 0.0, 10.0),
    ({"state.waits.category": BLOCKED}, 0.0, 10.0),
    ({"state.waits.category": MOVING}, 0.0, 10.0),
    ({"state.waits.category": TURN}, 0.0, np.inf),
    ({"state.waits.category": PLANNED_WAIT}, 0.0, np.inf),
    ({"state.waits.category": DISTURBANCE}, 0.0, np.inf),
    ({"state.waits.category": YIELDING}, 0.0, np.inf),
    ({"state.waits.category": DEPENDENCY_WAIT, "visits.depart_s": {0: 5.0}}, 0.0, 15.0),  # it is planned to stand there for so long
    ({"state.waits.category": BLOCKED, "visits.depart_s": {0: 5.0}}, 0.0, 10.0),
    ({"state.waits.category": DEPENDENCY_WAIT, "visits.arrive_s": {0: 5.0}, "visits.depart_s": {0: 5.0}}, 0.0, 10.0),
    ({"state.waits.category": DEPENDENCY_WAIT, "visits.arrive_s": {1: 7.0}}, 0.3, 17.0),  # on the lane, of which it is to be at the end
    ({"state.waits.category": DEPENDENCY_WAIT, "state.grants.cause": FACILITY}, 0.0, np.inf),
    ({"state.waits.category": MOVING, "visits.depart_s": {0: 5.0}}, 0.0, 10.0),
    ({"state.waits.category": MOVING, "visits.depart_s": {0: 5.0}, "rules.paced": True}, 0.0, 15.0),  # who is early may creep
    ({"state.waits.category": DEPENDENCY_WAIT, "visits.reached": {0: 3}}, 0.0, np.inf),
])  # fmt: skip
def test_who_makes_no_progress_within_the_window_is_blocked_but_for_waits_that_are_asked_for(places, at_m, after_s):
    assert stuck_after(places, at_m) == pytest.approx(after_s, abs=0.11)


def test_who_is_blocked_is_so_until_it_has_come_on_by_a_cell():
    world = put(scene(), {"state.waits.stuck": True, "state.waits.mark_s": 3.0, "state.waits.cause": OTHER, "state.waits.other": 4})
    put(world, {"state.waits.where": 1, "state.waits.category": MOVING})
    _observe.watch_progress(20.0, np.array([0.99]), world.rules, world.visits, world.state, world.log)
    assert world.state.waits.stuck[0] and entries(world) == []
    _observe.watch_progress(20.1, np.array([1.0]), world.rules, world.visits, world.state, world.log)
    waits = world.state.waits
    assert not waits.stuck[0] and (waits.mark_m[0], waits.mark_s[0]) == (1.0, 20.1)
    assert entries(world) == [(STOOD_BLOCKED, 0, OTHER, 1, 4, 3.0, 20.1)]


def test_waits_are_logged_from_when_they_begin_to_when_they_end_if_they_are_long_enough():
    world = put(scene(), {"state.grants.cause": OTHER, "state.grants.other": 3, "state.grants.wanted": 1, "state.waits.waiting": True})
    waits, grants = world.state.waits, world.state.grants

    def watch(now_s):
        _observe.watch_waits(now_s, world.rules, world.state, world.log)

    watch(5.0)
    assert waits.since_s[0] == pytest.approx(4.9) and (waits.cause[0], waits.other[0], waits.where[0]) == (OTHER, 3, 1)
    grants.other[0] = 2  # after 0.9 s, which is too short for the log
    watch(5.9)
    assert entries(world) == [] and waits.since_s[0] == pytest.approx(5.8) and waits.other[0] == 2
    watch(6.8)
    grants.cause[0] = FREE  # it is free, and follows another that is in its way
    watch(7.0)
    assert entries(world) == [(WAITED, 0, OTHER, 1, 2, pytest.approx(5.8), pytest.approx(6.9))] and waits.cause[0] == FOLLOWING
    grants.wanted[0] = 2
    watch(8.1)
    assert entries(world)[1] == (WAITED, 0, FOLLOWING, 1, 2, pytest.approx(6.9), pytest.approx(8.0)) and waits.where[0] == 2
    grants.cause[0] = OTHER
    watch(9.3)
    assert entries(world)[2] == (WAITED, 0, FOLLOWING, 2, 2, pytest.approx(8.0), pytest.approx(9.2)) and waits.cause[0] == OTHER
    waits.waiting[0] = False
    watch(10.9)
    assert entries(world)[3] == (WAITED, 0, OTHER, 2, 2, pytest.approx(9.2), pytest.approx(10.8)) and np.isinf(waits.since_s[0])


def arrive(now_s, s_m, world):
    _observe.arrive(now_s, s_m, 0.1, world.visits, world.state, world.log)


def test_arrivals_are_within_the_step_and_a_robot_that_is_home_has_come_to_its_goal():
    """In a step of 0.1 s it drives 0.1 m, and comes to within 2 mm of the vertex at 1 m after 0.048 of them."""
    world = put(scene(), {"state.motion.s_m": 0.95, "state.motion.moved_m": 0.1, "visits.granted": {0: 3}, "state.claims.number": 1})
    visits = world.visits
    arrive(10.0, np.array([1.05]), world)
    assert visits.arrived_s[1] == pytest.approx(9.948) and visits.reached[0] == 1 and np.isnan(visits.arrived_s[2])
    assert world.state.claims.number.tolist() == [1, 0, 1, 1] and np.isnan(world.state.waits.goal_s[0]) and entries(world) == []
    world.state.motion.s_m[0] = 1.05
    arrive(10.1, np.array([3.0 - 0.002]), world)
    assert visits.reached[0] == 3 and visits.arrived_s[3] == pytest.approx(10.1)
    assert entries(world) == [(ARRIVED_AT_GOAL, 0, FREE, 3, -1, pytest.approx(10.1), pytest.approx(10.1))]
    arrive(10.2, np.array([3.0]), world)
    assert len(entries(world)) == 1 and world.state.waits.goal_s[0] == pytest.approx(10.1)


@pytest.mark.parametrize(("s_m", "reached"), [(0.9979, 0), (0.998, 1)])
def test_a_vertex_is_reached_two_millimetres_before(s_m, reached):
    world = put(scene(), {"state.motion.s_m": 0.9, "state.motion.moved_m": s_m - 0.9})
    arrive(10.0, np.array([s_m]), world)
    assert world.visits.reached[0] == reached


def test_who_goes_elsewhere_waits_for_nothing_and_begins_to_make_progress_anew():
    world = put(scene(2), {"state.waits.since_s": 3.0, "state.waits.cause": OTHER, "state.waits.other": 7, "state.waits.where": 6})
    waits = put(world, {"state.waits.stuck": True}).state.waits
    _observe.go_elsewhere(waits, 1, 2.5, 8.0)
    assert (waits.since_s[1], waits.cause[1], waits.other[1], waits.where[1]) == (np.inf, FREE, -1, -1)
    assert (waits.mark_m[1], waits.mark_s[1], waits.stuck[1]) == (2.5, 8.0, False)
    assert (waits.since_s[0], waits.mark_s[0], waits.stuck[0]) == (3.0, 0.0, True)


@pytest.mark.parametrize(("home", "facing_rad", "turning", "goal_s"), [
    (True, np.nan, False, 7.0), (True, np.nan, True, 7.0), (False, np.nan, False, np.nan), (True, 1.0, True, np.nan),
    (True, 0.0, False, 7.0), (True, 0.0, True, 10.0), (True, 2 * np.pi, False, 7.0),
])  # fmt: skip
def test_a_goal_is_reached_when_the_robot_faces_as_it_is_to_stay(home, facing_rad, turning, goal_s):
    world = put(scene(), AT_END | {"visits.arrived_s": {3: 7.0}, "state.home": home, "state.facing_rad": facing_rad})
    arrive(10.0, np.array([3.0]), put(world, {"state.motion.turning": turning}))
    assert world.state.waits.goal_s[0] == pytest.approx(goal_s, nan_ok=True)


def test_a_robot_sets_out_in_its_first_step():
    world = put(scene(2), {"state.motion.moved_m": {0: 0.02}})
    arrive(10.0, np.array([0.02, 0.0]), world)
    assert entries(world) == [(SET_OUT, 0, FREE, 0, -1, pytest.approx(9.9), pytest.approx(9.9))]
    world.state.motion.s_m[0] = 0.02
    arrive(10.1, np.array([0.04, 0.0]), world)
    assert len(entries(world)) == 1


def test_a_step_is_observed_as_a_whole_but_not_booked_where_nothing_is():
    for books in (True, False):
        world = put(scene(), {"visits.granted": {0: 1}, "rules.books": books, "state.claims.number": 1})
        _observe.observe(0.1, np.array([0.05]), world)
        assert world.state.motion.s_m[0] == 0.05 and world.state.motion.speed_mps[0] == pytest.approx(0.5)
        assert world.state.waits.booked_s[0, MOVING] == (pytest.approx(0.1) if books else 0.0)
        assert [row[0] for row in entries(world)] == [SET_OUT]
        _observe.observe(0.2, np.array([0.07]), world)
        assert entries(world) == []  # each step has its own


@pytest.mark.parametrize(("other", "label"), [
    ([1, 2, 0, 0], [1, 1, 1, 0]), ([1, 0, 3, 2], [1, 1, 2, 2]), ([1, 2, -1, 0], [0, 0, 0, 0]), ([1, 0, 0, 2], [1, 1, 0, 0]),
])  # fmt: skip
def test_robots_that_wait_for_each_other_are_a_cycle(other, label):
    since_s = np.where(np.array(other) >= 0, 1.0, np.inf)
    assert _observe.waiting_cycles(np.array(other), since_s).tolist() == label
    assert _observe.waiting_cycles(np.array(other), np.full(4, np.inf)).tolist() == [0, 0, 0, 0]


def test_the_margin_before_a_stop_is_half_of_what_counts_as_arrived():
    assert pytest.approx(_causes.ARRIVED_M / 2) == MARGIN_M
