"""The kernels of lifts and doors: what they do in a step, and on which lanes robots have to wait for them.

A lift comes to who is next in the order of its cabin, or has asked longest, and opens its doors. People call it, too: it takes them where
they want to go while no robot is in it or may enter. A door opens when a robot that is to pass comes near, early enough that it need not
brake, and closes when nobody is near any more, nor comes before it could close and open again. A manual door opens for people only.
"""

import numpy as np

from mrp_sumo.drive._observe import get_on
from mrp_sumo.drive.state import Lifts
from mrp_sumo.search._bodies import TIE_M
from mrp_sumo.search._kernel import kernel

CLOSED, COMING, OPEN, TAKEN, HELD = range(5)  # lifts; one that is coming closes its doors, travels, and opens them again
IN_SERVICE, OUT_OF_SERVICE, FIRE = range(3)  # of lifts and doors; a door that is out of service is locked
BOARDING, LEAVING = range(2)  # people who hold a lift
NOBODY, PEOPLE = -1, -2  # in the place of a robot
SHUT, OPENING, STANDS_OPEN, CLOSING = range(4)  # doors

IN_TIME_S = 1e-9


@kernel
def note_requests(dt, kinematics, visits, needs, state, facilities):
    """Note calls of lifts and requests for doors: of robots that may pass already, and those that come near."""
    following, reached, granted, rank = visits.next, visits.reached, visits.granted, visits.rank
    from_m, vertex, lane = visits.from_m, visits.vertex, visits.lane
    lane_lift, lane_door, vertex_door = facilities.lane_lift, facilities.lane_door, facilities.vertex_door
    lifts, doors = facilities.lifts, facilities.doors
    called, soon, door_s = doors.called, doors.soon, doors.move_s
    s_m, top, reach, asked_s = state.motion.s_m, kinematics.speed_mps, kinematics.reach_m, state.grants.asked_s
    lifts.visit[:] = -1
    called[:] = False
    soon[:] = False
    for r in range(len(s_m)):
        door = vertex_door[vertex[reached[r]]]
        if door >= 0:
            called[door] = True
        k = following[reached[r]]
        while k >= 0:
            may_pass = rank[k] <= rank[granted[r]]
            ahead_s = (from_m[k] - s_m[r] - reach[r] - TIE_M) / top[r] - dt  # until it has to brake, or is let through
            if not may_pass and ahead_s > facilities.longest_s:
                break
            door, lift = lane_door[lane[k]], lane_lift[lane[k]]
            if door >= 0 and (may_pass or (not doors.manual[door] and doors.service[door] == IN_SERVICE)):
                if may_pass or ahead_s <= door_s[door]:
                    if not called[door]:
                        doors.robot[door] = r
                    called[door] = True
                elif ahead_s <= 2 * door_s[door]:
                    soon[door] = True
            if lift >= 0 and (may_pass or ahead_s <= lifts.call_s[lift]) and is_next(r, k, lifts.resource[lift], needs, state.holds):
                since = -1.0 if may_pass else asked_s[r]
                if lifts.visit[lift] < 0 or since < lifts.since_s[lift]:
                    lifts.caller[lift], lifts.visit[lift], lifts.since_s[lift] = r, k, since
            k = following[k]


@kernel(inline="always")
def is_next(robot, visit, q, needs, holds):
    """True if a robot may be the next in a lift whose cabin is the resource `q`."""
    free = True
    for e in range(needs.first[visit], needs.first[visit + 1]):
        if needs.resource[e] == q:
            free = holds.turn[q] == needs.passage[e] if len(needs.passing) > 0 else holds.holder[q] < 0 or holds.holder[q] == robot
    return free


@kernel
def run_lifts(now, visits, state, facilities):
    """Move cabins, and let robots enter them."""
    lifts, ride_s, level = facilities.lifts, facilities.ride_s, facilities.level
    mode, car, target, until_s, session = lifts.mode, lifts.car, lifts.target, lifts.until_s, lifts.session
    service, visit, holder, reached, vertex = lifts.service, lifts.visit, state.holds.holder, visits.reached, visits.vertex
    for f in range(len(mode)):
        r = holder[lifts.resource[f]]
        if r >= 0 and facilities.vertex_lift[vertex[reached[r]]] == f:
            mode[f], car[f], session[f] = TAKEN, level[vertex[reached[r]]], r
            get_on(r, now, state.waits)
        elif mode[f] == TAKEN:
            mode[f], session[f] = OPEN, NOBODY
        if mode[f] == COMING and now >= until_s[f] - IN_TIME_S:
            mode[f], car[f] = OPEN, target[f]
            if session[f] == PEOPLE:
                mode[f], until_s[f] = HELD, now + lifts.ride_hold_s[f]
        if mode[f] == HELD and now >= until_s[f] - IN_TIME_S:
            if lifts.ride_stage[f] == BOARDING:
                mode[f], target[f], lifts.ride_stage[f] = COMING, lifts.ride_end[f], LEAVING
                until_s[f] = now + ride_s[f, car[f], target[f]]
            else:
                mode[f], session[f], lifts.ride_since_s[f] = OPEN, NOBODY, np.inf
        if mode[f] != OPEN and mode[f] != CLOSED:
            continue
        if service[f] == FIRE:
            if car[f] != lifts.recall[f]:
                session[f] = NOBODY
                come(now, f, lifts.recall[f], facilities)
        elif service[f] == IN_SERVICE:
            if r < 0 and lifts.ride_since_s[f] <= now and (visit[f] < 0 or lifts.ride_since_s[f] < lifts.since_s[f]):
                session[f], lifts.ride_stage[f] = PEOPLE, BOARDING
                come(now, f, lifts.ride_begin[f], facilities)
                if mode[f] == OPEN:
                    mode[f], until_s[f] = HELD, now + lifts.ride_hold_s[f]
            elif visit[f] >= 0:
                session[f] = lifts.caller[f]
                come(now, f, level[vertex[visit[f]]], facilities)
    for g in range(len(facilities.gate_lane)):
        f = facilities.gate_lift[g]
        facilities.shut[facilities.gate_lane[g]] = mode[f] != OPEN or car[f] != facilities.gate_level[g]


@kernel(inline="always")
def come(now, lift, wanted, facilities):
    """Send a lift that stands to a level, where it will stand with open doors."""
    lifts, mode, car, until_s = facilities.lifts, facilities.lifts.mode, facilities.lifts.car, facilities.lifts.until_s
    if wanted != car[lift]:
        shut_s = facilities.close_s[lift, car[lift]] if mode[lift] == CLOSED else 0.0
        until_s[lift] = now + facilities.ride_s[lift, car[lift], wanted] - shut_s
        mode[lift], lifts.target[lift] = COMING, wanted
    elif mode[lift] == CLOSED:
        mode[lift], lifts.target[lift], until_s[lift] = COMING, wanted, now + facilities.open_s[lift, wanted]


@kernel
def run_doors(now, facilities):
    """Open and close doors, and let robots go through them."""
    doors = facilities.doors
    mode, until_s, called, soon, door_s = doors.mode, doors.until_s, doors.called, doors.soon, doors.move_s
    for d in range(len(mode)):
        people = now < doors.held_until_s[d]
        wanted = doors.service[d] == IN_SERVICE and (people or (called[d] and not doors.manual[d]))
        if people and not called[d]:
            doors.robot[d] = PEOPLE
        if mode[d] == OPENING and now >= until_s[d] - IN_TIME_S:
            mode[d] = STANDS_OPEN
        elif mode[d] == CLOSING and now >= until_s[d] - IN_TIME_S:
            mode[d] = SHUT
        if mode[d] == SHUT and wanted:
            mode[d], until_s[d] = OPENING, now + door_s[d]
        elif mode[d] == CLOSING and wanted:  # it opens as far as it has closed
            mode[d], until_s[d] = OPENING, now + door_s[d] - (until_s[d] - now)
        elif mode[d] == STANDS_OPEN and not (wanted or called[d] or soon[d]):
            mode[d], until_s[d] = CLOSING, now + door_s[d]
    for i in range(len(facilities.through)):
        facilities.shut[facilities.through[i]] = mode[facilities.through_door[i]] != STANDS_OPEN


def ask_for_ride(lifts: Lifts, lift: int, levels: tuple[int, int], since_s: float, hold_s: float) -> None:
    """People want to ride a lift from one level to another; the one before is over."""
    lifts.ride_begin[lift], lifts.ride_end[lift] = levels
    lifts.ride_hold_s[lift], lifts.ride_stage[lift], lifts.ride_since_s[lift] = hold_s, BOARDING, since_s
