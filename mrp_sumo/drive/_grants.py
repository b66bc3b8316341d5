"""The controller's kernels: what every robot may enter next, how fast it shall go, and what it has left.

A robot may drive up to `allowed_m`, which grows as it is granted its next visits and never shrinks, so that braking in time
needs no more than its deceleration. At the end are the changes of grants that new ways bring.
"""

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.visits import Visits
from mrp_sumo.drive._causes import DISTURBED, FACILITY, FINISHED, FREE, LETTING_PASS, MARGIN_M, ONCOMING, OTHER, PLANNED, TURNING
from mrp_sumo.drive._people import heed
from mrp_sumo.drive.state import Grants, Holds, State
from mrp_sumo.search._bodies import TIE_M
from mrp_sumo.search._kernel import kernel
from mrp_sumo.search._motion import stop_speed

SLOWEST = 0.1  # a robot that is early keeps this share of its speed


@kernel(inline="always")
def grant(now, scene):
    """Let robots claim their next visits, as many as they can and may."""
    kinematics, rules, visits, needs, state, conditions, _, _ = scene
    grants, s_m, ordered = state.grants, state.motion.s_m, len(needs.passing) > 0
    closed, shut = conditions.closed, conditions.facilities.shut
    for r in range(len(s_m)):
        k = visits.next[visits.granted[r]]
        if grants.on_lane[r] and grants.ahead[r] >= 0 and k >= 0:
            grants.allowed_m[r] = max(grants.allowed_m[r], room_on_lane(r, k, kinematics, visits, grants, s_m))
    if not ordered:
        queue_up(grants)
    for i in range(len(s_m)):
        r = i if ordered else grants.queue[i]
        grant_visits(r, now, ordered, kinematics, rules, visits, needs, state, closed, shut)


@kernel(inline="always")
def grant_visits(r, now, ordered, kinematics, rules, visits, needs, state, closed, shut):
    """Let a robot claim its next visits."""
    grants, motion, yielding = state.grants, state.motion, state.yielding
    top, decel, reach = kinematics.speed_mps[r], kinematics.decel_mps2[r], kinematics.reach_m[r]
    rank, lanes, s_m = visits.rank, visits.lane, motion.s_m
    cause, other, since_s, on_lane = grants.cause, grants.other, grants.asked_s, grants.on_lane
    holds, count, claimer = state.holds, state.claims.number, state.claims.claimer
    cause[r] = FREE
    other[r] = -1
    while True:
        m = visits.granted[r]
        k = visits.next[m]
        grants.wanted[r] = k if k >= 0 else m
        standing = visits.reached[r] == m
        if k < 0:
            if standing:
                cause[r] = FINISHED if state.home[r] else LETTING_PASS
            break
        if rank[m] >= yielding.pause[r]:
            if standing:
                cause[r] = LETTING_PASS
                other[r] = yielding.pause_for[r]
            break
        if rank[m] - rank[visits.reached[r]] >= rules.look_ahead:
            break
        if visits.turns[m] and not standing:
            break
        if visits.turns[m] and motion.yaw_rad[r] != visits.heading_rad[k]:
            cause[r] = TURNING
            break
        stays = visits.earliest_s[m] > visits.due_s[m] + 1e-6  # it is planned to stop there
        lead = 0.0 if standing or stays else max(top / decel, reach / top)  # in time to drive through
        if now < visits.earliest_s[m] - lead - 1e-9:
            cause[r] = PLANNED
            break
        if (rules.asks_late or not ordered) and grants.allowed_m[r] - s_m[r] > reach + TIE_M:
            break
        lane = lanes[k]
        if closed[lane] and not on_lane[r]:
            cause[r] = DISTURBED
            break
        back = visits.reverse[lane]
        if not on_lane[r] and back >= 0 and count[back] > 0:
            cause[r] = ONCOMING
            other[r] = claimer[back]
            since_s[r] = min(since_s[r], now)
            break
        missing = who_is_before(r, k, ordered, needs, holds)
        if shut[lane] and not on_lane[r]:
            waits_for = missing >= 0 and missing != r
            cause[r] = OTHER if waits_for else FACILITY
            other[r] = missing if waits_for else -1
            since_s[r] = min(since_s[r], now)
            break
        if missing >= 0:
            own = missing == r  # it is to pass again before its last passage is over: it has not heard how far it may go
            cause[r] = DISTURBED if own else OTHER
            other[r] = -1 if own else missing
            if not on_lane[r] and visits.short_of_m[k] < np.inf:
                on_lane[r] = True
                grants.ahead[r] = claimer[lane] if count[lane] > 0 else -1
                grants.allowed_m[r] = max(grants.allowed_m[r], room_on_lane(r, k, kinematics, visits, grants, s_m))
                count[lane] += 1
                claimer[lane] = r
            since_s[r] = min(since_s[r], now)
            break
        for e in range(needs.first[k], needs.first[k + 1]):
            q = needs.resource[e]
            holds.holder[q] = r
            holds.held[q] += 1
        if not on_lane[r]:
            count[lane] += 1
            claimer[lane] = r
        on_lane[r] = False
        since_s[r] = np.inf
        visits.granted[r] = k
        grants.allowed_m[r] = visits.at_m[k]


@kernel(inline="always")
def room_on_lane(robot, visit, kinematics, visits, grants, s_m):
    """Distance that a robot may drive on the lane to a visit that it has not won: short of it, and behind who is ahead, wherever that one
    comes to a stop. Followers so need no engine that keeps them apart.
    """
    room = visits.short_of_m[visit]
    other = grants.ahead[robot]
    if other >= 0:
        before = visits.next[visits.reached[other]]
        if before >= 0 and visits.lane[before] == visits.lane[visit]:
            radii, gap = kinematics.radius_m[robot] + kinematics.radius_m[other], max(kinematics.gap_m[robot], kinematics.gap_m[other])
            room = min(room, visits.at_m[visit] - (visits.at_m[before] - s_m[other]) - (radii + gap + kinematics.behind_m[other]))
        else:
            grants.ahead[robot] = -1
    return room


@kernel
def queue_up(grants):
    """Robots in the order in which they may claim: those first who have asked longest, then by number."""
    queue, since_s = grants.queue, grants.asked_s
    for i in range(1, len(queue)):  # few have moved since the last step
        r, j = queue[i], i - 1
        while j >= 0 and (since_s[queue[j]] > since_s[r] or (since_s[queue[j]] == since_s[r] and queue[j] > r)):
            queue[j + 1] = queue[j]
            j -= 1
        queue[j + 1] = r


@kernel(inline="always")
def who_is_before(robot, visit, ordered, needs, holds):
    """The robot that holds what a visit needs, or is to pass there first; -1: none."""
    missing = -1
    for e in range(needs.first[visit], needs.first[visit + 1]):
        q = needs.resource[e]
        if ordered and holds.turn[q] != needs.passage[e]:
            missing = needs.passing[holds.turn[q]]
        elif holds.holder[q] >= 0 and holds.holder[q] != robot:
            missing = holds.holder[q]
        if missing >= 0:
            break
    return missing


@kernel(inline="always")
def command(now, scene):
    """The robots' speeds for the next step. Returns how many changed; `news.changed` tells which."""
    kinematics, rules, visits, _, state, conditions, _, _ = scene
    people, changed = conditions.people, scene.notices.changed
    motion, facing, cause, commanded = state.motion, state.facing_rad, state.grants.cause, state.grants.command_mps
    s_m, hold_until_s, factor = motion.s_m, conditions.hold_until_s, conditions.factor
    known = state.grants.allowed_m if conditions.prompt else conditions.told_m
    count = 0
    for r in range(len(s_m)):
        top, held = kinematics.speed_mps[r], now < hold_until_s[r]
        v = min(stop_speed(known[r] - s_m[r] - MARGIN_M, kinematics.decel_mps2[r], rules.step_s), top * factor[r])
        if v < 1e-9 or held:  # what rounding leaves of no way at all is no speed
            v = 0.0
        if held and cause[r] != FINISHED:
            cause[r] = DISTURBED
        k = visits.next[visits.reached[r]]
        if rules.paced and v > 0.0 and k >= 0 and visits.due_s[k] > now:
            v = min(v, max((visits.at_m[k] - s_m[r]) / (visits.due_s[k] - now), SLOWEST * top))
        if people.any:
            v = heed(r, v, now, rules.step_s, kinematics, visits, motion, facing, people)
            if people.halted[r] and cause[r] != FINISHED:
                cause[r] = DISTURBED
        if abs(v - commanded[r]) > 1e-4 or (v == 0.0 and commanded[r] != 0.0):
            commanded[r] = v
            changed[count] = r
            count += 1
    return count


@kernel(inline="always")
def leave_lane(robot, visit, visits, grants, claims):
    """A robot has come to a visit: it is on the lane to there no more."""
    claims.number[visits.lane[visit]] -= 1
    if grants.turned_back[robot]:
        claims.number[visits.reverse[visits.lane[visit]]] -= 1
        grants.turned_back[robot] = False


@kernel
def release(s_m, visits, needs, grants, holds):
    """Free what robots have left; the turn at a resource passes on when a passage ends."""
    rank, oldest = visits.rank, grants.oldest
    for r in range(len(s_m)):
        until = min(rank[visits.reached[r]] + 1, rank[visits.granted[r]])
        k = oldest[r]
        all_freed = True
        while k >= 0 and rank[k] <= until:
            for e in range(needs.first[k], needs.first[k + 1]):
                if needs.freed[e]:
                    continue
                if s_m[r] < needs.left_at_m[e] - TIE_M:
                    all_freed = False
                    continue
                q = needs.resource[e]
                needs.freed[e] = True
                holds.held[q] -= 1
                if holds.held[q] == 0:
                    holds.holder[q] = -1
                if needs.closes[e]:
                    holds.turn[q] += 1
            k = visits.next[k]
            if all_freed and k >= 0:
                oldest[r] = k


def hold(holds: Holds, robot: int, resource: NDArray[np.int64]) -> None:
    """A robot holds these resources, once more."""
    holds.holder[resource] = robot
    holds.held[resource] += 1


def give_back(state: State, visits: Visits, robot: int, last: int, resource: NDArray[np.int64], lane: NDArray[np.int64]) -> None:
    """A robot drives no farther than to a visit: it holds these resources, and claims these lanes, once less."""
    grants, holds = state.grants, state.holds
    np.subtract.at(holds.held, resource, 1)
    np.subtract.at(state.claims.number, lane, 1)
    holds.holder[resource[holds.held[resource] == 0]] = -1
    visits.granted[robot], grants.on_lane[robot], grants.allowed_m[robot] = last, False, visits.at_m[last]


def turn_back(state: State, robot: int, at_m: float, lane: int, behind: NDArray[np.int64]) -> None:
    """A robot turns round on its lane: nobody is to come to the vertex behind it, which needs the resources `behind`, nor on either side
    of the lane.
    """
    state.grants.turned_back[robot] = True
    state.grants.allowed_m[robot] = at_m
    state.claims.number[lane] += 1
    state.claims.claimer[lane] = robot
    state.holds.holder[behind] = robot


def ask_anew(grants: Grants, robot: int, visit: int) -> None:
    """Let a robot that goes another way from a visit on wait for nothing."""
    grants.cause[robot], grants.other[robot], grants.asked_s[robot], grants.wanted[robot] = FREE, -1, np.inf, visit


def may_hold_from(grants: Grants, robot: int, visit: int) -> None:
    """The oldest visit for which a robot may still hold something has been cut off; it is this one now."""
    grants.oldest[robot] = visit


def take_turns(holds: Holds, turn: NDArray[np.int64] | int) -> None:
    """[Q] The passages whose turn it is are others."""
    holds.turn[:] = turn


def send_again(grants: Grants) -> None:
    """Speeds that were set in this step may be set again: all robots are to be sent theirs."""
    grants.command_mps[:] = -1.0


def renumber(grants: Grants, new: NDArray[np.int64]) -> None:
    """Visits have other ids, those that are forgotten -1; `new` [N] by the old ones, the last place for -1."""
    grants.oldest[:], grants.wanted[:] = new[grants.oldest], new[grants.wanted]
