"""The controller's kernels: what every robot may enter next, and how fast it shall go.

A robot may drive up to `allowed_m`, which grows as it is granted its next visits and never shrinks, so that braking in time
needs no more than its deceleration.
"""

import numpy as np

from mrp_sumo.drive._causes import DISTURBED, FACILITY, FINISHED, FREE, LETTING_PASS, MARGIN_M, ONCOMING, OTHER, PLANNED, TURNING
from mrp_sumo.drive._facilities import run_facilities
from mrp_sumo.drive._observe import observe
from mrp_sumo.drive._people import book_lost, heed
from mrp_sumo.search._bodies import TIE_M
from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._motion import stop_speed

SLOWEST = 0.1  # a robot that is early keeps this share of its speed


@kernel
def advance(look, now, dt, s_m, kinematics, rules, visits, needs, state, conditions, routed, log, news):
    """All between two steps of the engine: observe, run lifts and doors, grant, command.

    One call, since handing the arrays over costs more than the work for few robots.

    Parameters
    ----------
    look
        Whether a step has been made since the last call.
    now, dt
        Simulated time and the step length, s.
    s_m
        [R] what the engine says robots have driven.
    routed
        [R] rank of the last visit that the engine knows the way to.

    Returns
    -------
    num_logged, num_changed, num_due
        Entries in the log, robots with another speed, robots whose routes end soon.
    """
    num_logged = observe(now, dt, s_m, kinematics, rules, visits, needs, state, conditions.people.halted, log) if look else 0
    if look and conditions.people.any:
        book_lost(dt, conditions.people)
    if conditions.facilities.any:
        run_facilities(now, dt, kinematics, visits, needs, state, conditions.facilities)
    grant(now, kinematics, rules, visits, needs, state, conditions.closed, conditions.facilities.shut)
    num_changed = command(now, dt, kinematics, rules, visits, state, conditions, news.changed)
    num_due = 0
    for r in range(len(s_m)):
        if visits.rank[visits.granted[r]] + state.grants.on_lane[r] >= routed[r]:
            news.due[num_due] = r
            num_due += 1
    return num_logged, num_changed, num_due


@kernel
def grant(now, kinematics, rules, visits, needs, state, closed, shut):
    """Let robots claim their next visits, as many as they can and may."""
    # arrays are taken out of their tuples once: numba counts references each time
    grants, following, rank, reached, granted = state.grants, visits.next, visits.rank, visits.reached, visits.granted
    cause, other, wanted, asked, on_lane = grants.cause, grants.other, grants.wanted, grants.asked_s, grants.on_lane
    allowed, claims, claimer, holder, held, turn = grants.allowed_m, grants.claims, grants.claimer, grants.holder, grants.held, grants.turn
    turns, yaw, heading, earliest, due = visits.turns, state.motion.yaw_rad, visits.heading_rad, visits.earliest_s, visits.due_s
    lane, at, short_of = visits.lane, visits.at_m, visits.short_of_m
    first_need, resource, passage, passing, reverse = needs.first, needs.resource, needs.passage, needs.passing, visits.reverse
    pause, pause_for, home, s_m = state.yielding.pause, state.yielding.pause_for, state.home, state.motion.s_m
    top, decel, reach = kinematics.speed_mps, kinematics.decel_mps2, kinematics.reach_m
    ordered = len(passing) > 0
    for r in range(len(s_m)):
        k = following[granted[r]]
        if on_lane[r] and grants.ahead[r] >= 0 and k >= 0:
            allowed[r] = max(allowed[r], room_on_lane(r, k, kinematics, visits, grants.ahead, s_m))
    for r in order_of_asking(ordered, asked):
        cause[r] = FREE
        other[r] = -1
        while True:
            m = granted[r]
            k = following[m]
            wanted[r] = k if k >= 0 else m
            standing = reached[r] == m
            if k < 0:
                if standing:
                    cause[r] = FINISHED if home[r] else LETTING_PASS
                break
            if rank[m] >= pause[r]:
                if standing:
                    cause[r] = LETTING_PASS
                    other[r] = pause_for[r]
                break
            if rank[m] - rank[reached[r]] >= rules.look_ahead:
                break
            if turns[m] and not standing:
                break
            if turns[m] and yaw[r] != heading[k]:
                cause[r] = TURNING
                break
            stays = earliest[m] > due[m] + 1e-6  # it is planned to stop there
            lead = 0.0 if standing or stays else max(top[r] / decel[r], reach[r] / top[r])  # in time to drive through
            if now < earliest[m] - lead - 1e-9:
                cause[r] = PLANNED
                break
            if (rules.asks_late or not ordered) and allowed[r] - s_m[r] > reach[r] + TIE_M:
                break
            if closed[lane[k]] and not on_lane[r]:
                cause[r] = DISTURBED
                break
            back = reverse[lane[k]]
            if not on_lane[r] and back >= 0 and claims[back] > 0:
                cause[r] = ONCOMING
                other[r] = claimer[back]
                asked[r] = min(asked[r], now)
                break
            missing = who_is_before(r, first_need[k], first_need[k + 1], ordered, resource, turn, passage, passing, holder)
            if shut[lane[k]] and not on_lane[r]:
                waits_for = missing >= 0 and missing != r
                cause[r] = OTHER if waits_for else FACILITY
                other[r] = missing if waits_for else -1
                asked[r] = min(asked[r], now)
                break
            if missing >= 0:
                own = missing == r  # it is to pass again before its last passage is over: it has not heard how far it may go
                cause[r] = DISTURBED if own else OTHER
                other[r] = -1 if own else missing
                if not on_lane[r] and short_of[k] < np.inf:
                    on_lane[r] = True
                    grants.ahead[r] = claimer[lane[k]] if claims[lane[k]] > 0 else -1
                    allowed[r] = max(allowed[r], room_on_lane(r, k, kinematics, visits, grants.ahead, s_m))
                    claims[lane[k]] += 1
                    claimer[lane[k]] = r
                asked[r] = min(asked[r], now)
                break
            for e in range(first_need[k], first_need[k + 1]):
                q = resource[e]
                holder[q] = r
                held[q] += 1
            if not on_lane[r]:
                claims[lane[k]] += 1
                claimer[lane[k]] = r
            on_lane[r] = False
            asked[r] = np.inf
            granted[r] = k
            allowed[r] = at[k]


@kernel(inline="always")
def room_on_lane(robot, visit, kinematics, visits, ahead, s_m):
    """How far a robot may drive on the lane to a visit that it has not won: short of it, and behind who is ahead, wherever that one
    comes to a stop. Followers so need no engine that keeps them apart.
    """
    room = visits.short_of_m[visit]
    if ahead[robot] >= 0:
        before = visits.next[visits.reached[ahead[robot]]]
        if before >= 0 and visits.lane[before] == visits.lane[visit]:
            other = ahead[robot]
            radii, gap = kinematics.radius_m[robot] + kinematics.radius_m[other], max(kinematics.gap_m[robot], kinematics.gap_m[other])
            room = min(room, visits.at_m[visit] - (visits.at_m[before] - s_m[other]) - (radii + gap))
        else:
            ahead[robot] = -1
    return room


@kernel
def order_of_asking(ordered, asked_s):
    """Robots in the order in which they may claim: any, or those first who have asked longest."""
    if ordered:
        return np.arange(len(asked_s))
    asking = np.flatnonzero(asked_s < np.inf)
    others = np.flatnonzero(asked_s == np.inf)
    return np.concatenate((asking[np.argsort(asked_s[asking], kind="mergesort")], others))


@kernel(inline="always")
def who_is_before(robot, begin, end, ordered, resource, turn, passage, passing, holder):
    """The robot that holds one of the needs `begin` to `end`, or is to pass there first; -1: none."""
    missing = -1
    for e in range(begin, end):
        q = resource[e]
        if ordered and turn[q] != passage[e]:
            missing = passing[turn[q]]
        elif holder[q] >= 0 and holder[q] != robot:
            missing = holder[q]
        if missing >= 0:
            break
    return missing


@kernel
def command(now, dt, kinematics, rules, visits, state, conditions, changed):
    """The robots' speeds for the next step. Returns how many changed; `changed` tells which."""
    s_m, decel, top = state.motion.s_m, kinematics.decel_mps2, kinematics.speed_mps
    cause, commanded = state.grants.cause, state.grants.command_mps
    known = state.grants.allowed_m if conditions.prompt else conditions.told_m
    factor, hold_until, due, at = conditions.factor, conditions.hold_until_s, visits.due_s, visits.at_m
    following, reached, people = visits.next, visits.reached, conditions.people
    count = 0
    for r in range(len(s_m)):
        v = min(stop_speed(known[r] - s_m[r] - MARGIN_M, decel[r], dt), top[r] * factor[r])
        if v < 1e-9 or now < hold_until[r]:  # what rounding leaves of no way at all is no speed
            v = 0.0
        if now < hold_until[r] and cause[r] != FINISHED:
            cause[r] = DISTURBED
        k = following[reached[r]]
        if rules.paced and v > 0.0 and k >= 0 and due[k] > now:
            v = min(v, max((at[k] - s_m[r]) / (due[k] - now), SLOWEST * top[r]))
        if people.any:
            v = heed(r, v, now, dt, kinematics, visits, state.motion, people)
            if people.halted[r] and cause[r] != FINISHED:
                cause[r] = DISTURBED
        if abs(v - commanded[r]) > 1e-4 or (v == 0.0 and commanded[r] != 0.0):
            commanded[r] = v
            changed[count] = r
            count += 1
    return count


@kernel
def waiting_cycles(other, since_s):
    """[R] number of the wait-for cycle each robot is in, 0: none. One cause a robot, so a walk suffices."""
    num_robots = len(other)
    label = np.zeros(num_robots, np.int64)
    walk = np.zeros(num_robots, np.int64)
    cycles = 0
    for start in range(num_robots):
        r = start
        while r >= 0 and walk[r] == 0:
            walk[r] = start + 1
            r = other[r] if since_s[r] < np.inf else -1
        if r >= 0 and walk[r] == start + 1:
            cycles += 1
            while label[r] == 0:
                label[r] = cycles
                r = other[r]
    return label
