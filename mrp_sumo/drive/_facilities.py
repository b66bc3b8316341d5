"""The kernels of lifts and doors: what they do in a step, and on which lanes robots have to wait for them.

A lift comes to who is next in the order of its cabin, or has asked longest, and opens its doors. People call it, too: it takes them where
they want to go while no robot is in it or may enter. A door opens when a robot that is to pass comes near, early enough that it need not
brake, and closes when nobody is near any more, nor comes before it could close and open again. A manual door opens for people only.
"""

import numpy as np

from mrp_sumo.drive._observe import get_on
from mrp_sumo.drive.state import RideRequests
from mrp_sumo.search._bodies import TIE_M
from mrp_sumo.search._kernel import kernel

CLOSED, COMING, OPEN, TAKEN, HELD = range(5)  # lifts; one that is coming closes its doors, travels, and opens them again
IN_SERVICE, OUT_OF_SERVICE, FIRE = range(3)  # of lifts and doors; a door that is out of service is locked
BOARDING, LEAVING = range(2)  # people who hold a lift
NOBODY, PEOPLE = -1, -2  # in the place of a robot
SHUT, OPENING, STANDS_OPEN, CLOSING = range(4)  # doors

IN_TIME_S = 1e-9


@kernel(allocates=False)
def note_requests(dt, kinematics, visits, needs, state, facilities):
    """Note calls of lifts and requests for doors: of robots that may pass already, and those that come near."""
    following, reached, granted, rank = visits.next, visits.reached, visits.granted, visits.rank
    from_m, vertex, lane = visits.from_m, visits.vertex, visits.lane
    lane_lift, lane_door, vertex_door = facilities.lane_lift, facilities.lane_door, facilities.vertex_door
    caller, calls, since_s, call_s = facilities.caller, facilities.calls, facilities.since_s, facilities.call_s
    asked, soon, door_s, door_service = facilities.asked, facilities.soon, facilities.door_s, facilities.door_service
    manual, door_robot = facilities.manual, facilities.door_robot
    s_m, top, reach, asked_s = state.motion.s_m, kinematics.speed_mps, kinematics.reach_m, state.grants.asked_s
    calls[:] = -1
    asked[:] = False
    soon[:] = False
    for r in range(len(s_m)):
        door = vertex_door[vertex[reached[r]]]
        if door >= 0:
            asked[door] = True
        k = following[reached[r]]
        while k >= 0:
            may_pass = rank[k] <= rank[granted[r]]
            ahead_s = (from_m[k] - s_m[r] - reach[r] - TIE_M) / top[r] - dt  # until it has to brake, or is let through
            if not may_pass and ahead_s > facilities.longest_s:
                break
            door, lift = lane_door[lane[k]], lane_lift[lane[k]]
            if door >= 0 and (may_pass or (not manual[door] and door_service[door] == IN_SERVICE)):
                if may_pass or ahead_s <= door_s[door]:
                    if not asked[door]:
                        door_robot[door] = r
                    asked[door] = True
                elif ahead_s <= 2 * door_s[door]:
                    soon[door] = True
            if lift >= 0 and (may_pass or ahead_s <= call_s[lift]) and is_next(r, k, lift, needs, state.grants, facilities):
                since = -1.0 if may_pass else asked_s[r]
                if calls[lift] < 0 or since < since_s[lift]:
                    caller[lift], calls[lift], since_s[lift] = r, k, since
            k = following[k]


@kernel(inline="always", allocates=False)
def is_next(robot, visit, lift, needs, grants, facilities):
    """True if a robot may be the next in a lift."""
    q = facilities.resource[lift]
    found = True
    for e in range(needs.first[visit], needs.first[visit + 1]):
        if needs.resource[e] == q:
            found = grants.turn[q] == needs.passage[e] if len(needs.passing) > 0 else grants.holder[q] < 0 or grants.holder[q] == robot
    return found


@kernel(allocates=False)
def run_lifts(now, visits, state, facilities):
    """Move cabins, and let robots enter them."""
    mode, car, target, until_s, session = facilities.mode, facilities.car, facilities.target, facilities.until_s, facilities.session
    ride_s, level, service, calls = facilities.ride_s, facilities.level, facilities.service, facilities.calls
    holder, reached, vertex = state.grants.holder, visits.reached, visits.vertex
    wish = facilities.wish
    for f in range(len(mode)):
        r = holder[facilities.resource[f]]
        if r >= 0 and facilities.vertex_lift[vertex[reached[r]]] == f:
            mode[f], car[f], session[f] = TAKEN, level[vertex[reached[r]]], r
            get_on(r, now, state.waits)
        elif mode[f] == TAKEN:
            mode[f], session[f] = OPEN, NOBODY
        if mode[f] == COMING and now >= until_s[f] - IN_TIME_S:
            mode[f], car[f] = OPEN, target[f]
            if session[f] == PEOPLE:
                mode[f], until_s[f] = HELD, now + wish.hold_s[f]
        if mode[f] == HELD and now >= until_s[f] - IN_TIME_S:
            if wish.stage[f] == BOARDING:
                mode[f], target[f], wish.stage[f] = COMING, wish.end[f], LEAVING
                until_s[f] = now + ride_s[f, car[f], target[f]]
            else:
                mode[f], session[f], wish.since_s[f] = OPEN, NOBODY, np.inf
        if mode[f] != OPEN and mode[f] != CLOSED:
            continue
        if service[f] == FIRE:
            if car[f] != facilities.recall[f]:
                session[f] = NOBODY
                come(now, f, facilities.recall[f], facilities)
        elif service[f] == IN_SERVICE:
            if r < 0 and wish.since_s[f] <= now and (calls[f] < 0 or wish.since_s[f] < facilities.since_s[f]):
                session[f], wish.stage[f] = PEOPLE, BOARDING
                come(now, f, wish.begin[f], facilities)
                if mode[f] == OPEN:
                    mode[f], until_s[f] = HELD, now + wish.hold_s[f]
            elif calls[f] >= 0:
                session[f] = facilities.caller[f]
                come(now, f, level[vertex[calls[f]]], facilities)
    for g in range(len(facilities.gate_lane)):
        f = facilities.gate_lift[g]
        facilities.shut[facilities.gate_lane[g]] = mode[f] != OPEN or car[f] != facilities.gate_level[g]


@kernel(inline="always", allocates=False)
def come(now, lift, wanted, facilities):
    """Send a lift that stands to a level, where it will stand with open doors."""
    mode, car, until_s = facilities.mode, facilities.car, facilities.until_s
    if wanted != car[lift]:
        shut_s = facilities.close_s[lift, car[lift]] if mode[lift] == CLOSED else 0.0
        until_s[lift] = now + facilities.ride_s[lift, car[lift], wanted] - shut_s
        mode[lift], facilities.target[lift] = COMING, wanted
    elif mode[lift] == CLOSED:
        mode[lift], facilities.target[lift], until_s[lift] = COMING, wanted, now + facilities.open_s[lift, wanted]


@kernel(allocates=False)
def run_doors(now, facilities):
    """Open and close doors, and let robots go through them."""
    mode, until_s, asked, soon, door_s = (
        facilities.door_mode,
        facilities.door_until_s,
        facilities.asked,
        facilities.soon,
        facilities.door_s,
    )
    for d in range(len(mode)):
        people = now < facilities.held_until_s[d]
        wanted = facilities.door_service[d] == IN_SERVICE and (people or (asked[d] and not facilities.manual[d]))
        if people and not asked[d]:
            facilities.door_robot[d] = PEOPLE
        if mode[d] == OPENING and now >= until_s[d] - IN_TIME_S:
            mode[d] = STANDS_OPEN
        elif mode[d] == CLOSING and now >= until_s[d] - IN_TIME_S:
            mode[d] = SHUT
        if mode[d] == SHUT and wanted:
            mode[d], until_s[d] = OPENING, now + door_s[d]
        elif mode[d] == CLOSING and wanted:  # it opens as far as it has closed
            mode[d], until_s[d] = OPENING, now + door_s[d] - (until_s[d] - now)
        elif mode[d] == STANDS_OPEN and not (wanted or asked[d] or soon[d]):
            mode[d], until_s[d] = CLOSING, now + door_s[d]
    for i in range(len(facilities.through)):
        facilities.shut[facilities.through[i]] = mode[facilities.through_door[i]] != STANDS_OPEN


def ask_for_ride(wish: RideRequests, lift: int, levels: tuple[int, int], since_s: float, hold_s: float) -> None:
    """People want to ride a lift from one level to another; the one before is over."""
    wish.begin[lift], wish.end[lift] = levels
    wish.hold_s[lift], wish.stage[lift], wish.since_s[lift] = hold_s, BOARDING, since_s
