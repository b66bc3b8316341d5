"""Kernels of the observer: what every robot did in the step that has ended, and what it has left.

Each stage is a pass over all robots and writes arrays of one owner.
"""

import numpy as np

from mrp_sumo.drive._causes import (
    ARRIVED_AT_GOAL,
    ARRIVED_M,
    AT_GOAL,
    BLOCKED,
    DEPENDENCY_WAIT,
    DISTURBANCE,
    DISTURBED,
    FACILITY,
    FOLLOWING,
    FREE,
    MOVING,
    PLANNED,
    PLANNED_WAIT,
    SET_OUT,
    STOOD_BLOCKED,
    TURN,
    TURNED_RAD,
    WAITED,
    YIELDING,
)
from mrp_sumo.search._arrays import write_over
from mrp_sumo.search._bodies import TIE_M
from mrp_sumo.search._kernel import kernel

AT_REST_M = 1e-6  # a robot that moved no more in a step stood still


@kernel
def observe(now, dt, s_m, kinematics, rules, visits, needs, state, halted, log):
    """Book the step that ended at `now`; robots have driven `s_m` [R] in all, and those `halted` did not turn. Returns the number of
    entries in the log.
    """
    move(dt, s_m, kinematics, visits, state.facing_rad, halted, state.motion)
    book(dt, visits, state)
    count = watch_progress(now, dt, s_m, rules, visits, state.grants, state.waits, log, 0)
    count = watch_waits(now, dt, rules, state.grants, state.waits, log, count)
    count = arrive(now, dt, s_m, visits, state, log, count)
    release(s_m, visits, needs, state.grants)
    write_over(state.motion.s_m, s_m)
    return count


@kernel
def move(dt, s_m, kinematics, visits, facing, halted, motion):
    """Speeds, and turns in place towards the lane that comes next, or at the end of its way as the robot is to stay."""
    was, moved, speed, yaw, turning = motion.s_m, motion.moved_m, motion.speed_mps, motion.yaw_rad, motion.turning
    reached, following, last, heading, turn_rate = visits.reached, visits.next, visits.last, visits.heading_rad, kinematics.turn_rate_rad_s
    for r in range(len(s_m)):
        moved[r] = s_m[r] - was[r]
        speed[r] = moved[r] / dt
        ahead = following[reached[r]]
        target = heading[ahead] if ahead >= 0 else heading[last[r]] if np.isnan(facing[r]) else facing[r]
        away = (target - yaw[r] + np.pi) % (2 * np.pi) - np.pi
        turning[r] = abs(away) > 1e-12
        if turning[r] and not halted[r]:
            most = turn_rate[r] * dt
            if abs(away) <= most + 1e-9:
                yaw[r] = target
            else:
                yaw[r] += most if away > 0 else -most


@kernel
def book(dt, visits, state):
    """What each robot's step was spent on."""
    moved, turning, cause, commanded = state.motion.moved_m, state.motion.turning, state.grants.cause, state.grants.command_mps
    stuck, category, booked, gives_way = state.waits.stuck, state.waits.category, state.waits.booked_s, state.yielding.gives_way
    home, reached, following, waiting, facing = state.home, visits.reached, visits.next, state.waits.waiting, state.facing_rad
    for r in range(len(moved)):
        waiting[r] = False
        if following[reached[r]] < 0 and turning[r] and not np.isnan(facing[r]):
            kind = TURN
        elif following[reached[r]] < 0:
            kind = AT_GOAL if home[r] else DISTURBANCE if cause[r] == DISTURBED else BLOCKED
        elif moved[r] > AT_REST_M:
            kind = MOVING
        elif cause[r] == DISTURBED:
            kind = DISTURBANCE
        elif turning[r]:
            kind = TURN
        elif cause[r] == PLANNED:
            kind = PLANNED_WAIT
        elif cause[r] == FREE and commanded[r] <= AT_REST_M:
            kind = MOVING  # it has just been allowed to go on
        else:
            waiting[r] = True
            kind = BLOCKED if stuck[r] else DEPENDENCY_WAIT
        if gives_way[r] and kind != DISTURBANCE and kind != AT_GOAL:
            kind = YIELDING
        booked[r, kind] += dt
        category[r] = kind


@kernel
def watch_progress(now, dt, s_m, rules, visits, grants, waits, log, count):
    """Blocked is who made no progress by a cell within the window, but for waits that the plan, a facility or a disturbance asks for."""
    why = grants.cause
    category, mark_m, mark_s, stuck = waits.category, waits.mark_m, waits.mark_s, waits.stuck
    reached, following, at_m, arrive_s, depart_s = visits.reached, visits.next, visits.at_m, visits.arrive_s, visits.depart_s
    for r in range(len(s_m)):
        kind, k, ahead = category[r], reached[r], following[reached[r]]
        on_lane = ahead >= 0 and s_m[r] > at_m[k] + AT_REST_M
        planned_until_s = arrive_s[ahead] if on_lane else depart_s[k] if depart_s[k] > arrive_s[k] else 0.0
        is_planned = why[r] == FACILITY or now <= planned_until_s
        if kind in (TURN, PLANNED_WAIT, DISTURBANCE, YIELDING) or (kind == DEPENDENCY_WAIT and is_planned):
            mark_s[r] += dt
        if ahead < 0 or s_m[r] - mark_m[r] >= rules.cell_m:
            if stuck[r]:
                stuck[r] = False
                count = note(log, count, STOOD_BLOCKED, r, waits.cause[r], waits.where[r], waits.other[r], mark_s[r], now)
            mark_m[r] = s_m[r]
            mark_s[r] = now
        elif now - mark_s[r] >= rules.window_s:
            stuck[r] = True
    return count


@kernel
def watch_waits(now, dt, rules, grants, waits, log, count):
    """Waits begin and end where their cause, the robot waited for or the place changes."""
    waiting, since, cause, other, where = waits.waiting, waits.since_s, waits.cause, waits.other, waits.where
    why_now, other_now, where_now = grants.cause, grants.other, grants.wanted
    for r in range(len(since)):
        why = FOLLOWING if why_now[r] == FREE else why_now[r]
        same = waiting[r] and since[r] < np.inf and why == cause[r] and other_now[r] == other[r] and where_now[r] == where[r]
        if since[r] < np.inf and not same:
            if now - dt - since[r] >= rules.wait_least_s:
                count = note(log, count, WAITED, r, cause[r], where[r], other[r], since[r], now - dt)
            since[r] = np.inf
        if waiting[r] and not same:
            since[r] = now - dt
            cause[r] = why
            other[r] = other_now[r]
            where[r] = where_now[r]
    return count


@kernel
def arrive(now, dt, s_m, visits, state, log, count):
    """Departures, arrivals, and who has come to stand where its tasks end, as it is to stay there."""
    was, moved, turned_back, claims = state.motion.s_m, state.motion.moved_m, state.grants.turned_back, state.grants.claims
    reached, following, last, at, lane, arrived = visits.reached, visits.next, visits.last, visits.at_m, visits.lane, visits.arrived_s
    goal, home, facing, yaw = state.waits.goal_s, state.home, state.facing_rad, state.motion.yaw_rad
    for r in range(len(s_m)):
        if moved[r] > 0.0 and was[r] == 0.0:
            count = note(log, count, SET_OUT, r, FREE, visits.first[r], -1, now - dt, now - dt)
        k = following[reached[r]]
        while k >= 0 and s_m[r] >= at[k] - ARRIVED_M - TIE_M:
            late = (s_m[r] - at[k] + ARRIVED_M) / moved[r] * dt if moved[r] > 0.0 else 0.0
            arrived[k] = now - min(max(late, 0.0), dt)
            claims[lane[k]] -= 1
            if turned_back[r]:
                claims[visits.reverse[lane[k]]] -= 1
                turned_back[r] = False
            reached[r] = k
            k = following[k]
        if goal[r] != goal[r] and home[r] and k < 0 and is_turned(yaw[r], facing[r]):
            goal[r] = now if state.motion.turning[r] and not np.isnan(facing[r]) else arrived[last[r]]
            count = note(log, count, ARRIVED_AT_GOAL, r, FREE, last[r], -1, goal[r], goal[r])
    return count


@kernel(inline="always")
def is_turned(yaw, facing):
    """Whether a robot faces as it is to stay; NaN: any will do."""
    return np.isnan(facing) or abs((facing - yaw + np.pi) % (2 * np.pi) - np.pi) <= TURNED_RAD


@kernel
def release(s_m, visits, needs, grants):
    """Free what robots have left; the turn at a resource passes on when a passage ends."""
    following, reached, granted, rank = visits.next, visits.reached, visits.granted, visits.rank
    oldest, holder, held, turn = grants.oldest, grants.holder, grants.held, grants.turn
    first_need, freed, left_at, resource, closes = needs.first, needs.freed, needs.left_at_m, needs.resource, needs.closes
    for r in range(len(s_m)):
        until = min(rank[reached[r]] + 1, rank[granted[r]])
        k = oldest[r]
        all_freed = True
        while k >= 0 and rank[k] <= until:
            for e in range(first_need[k], first_need[k + 1]):
                if freed[e]:
                    continue
                if s_m[r] < left_at[e] - TIE_M:
                    all_freed = False
                    continue
                q = resource[e]
                freed[e] = True
                held[q] -= 1
                if held[q] == 0:
                    holder[q] = -1
                if closes[e]:
                    turn[q] += 1
            k = following[k]
            if all_freed and k >= 0:
                oldest[r] = k


@kernel
def note(log, count, kind, robot, cause, visit, other, begin_s, end_s):
    """Add an entry to the log; returns how many there are."""
    log.kind[count] = kind
    log.robot[count] = robot
    log.cause[count] = cause
    log.visit[count] = visit
    log.other[count] = other
    log.begin_s[count] = begin_s
    log.end_s[count] = end_s
    return count + 1
