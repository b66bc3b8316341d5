"""Kernels of the observer: what every robot did in the step that has ended.

Each stage is a pass over all robots. At the end are the changes of what is known of robots that new ways bring.
"""

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.visits import Visits
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
from mrp_sumo.drive._grants import leave_lane
from mrp_sumo.drive._people import STRAIGHT_RAD, heading_ahead, off_heading
from mrp_sumo.drive.state import Motion, Waits
from mrp_sumo.search._bodies import TIE_M
from mrp_sumo.search._kernel import kernel

AT_REST_M = 1e-6  # a robot that moved no more in a step stood still


@kernel(inline="always")
def observe(now, s_m, scene):
    """Book the step that ended at `now`; robots have driven `s_m` [R] in all."""
    kinematics, rules, visits, _, state, conditions, log, _ = scene
    log.num_entries[0] = 0
    move(s_m, rules.step_s, kinematics.turn_rate_rad_s, visits, state.motion, state.facing_rad, conditions.people.halted)
    if rules.books:
        book(rules, visits, state)
        watch_progress(now, s_m, rules, visits, state, log)
        watch_waits(now, rules, state, log)
    arrive(now, s_m, rules.step_s, visits, state, log)
    for r in range(len(s_m)):
        state.motion.s_m[r] = s_m[r]


@kernel(inline="always")
def move(s_m, dt, turn_rate_rad_s, visits, motion, facing_rad, halted):
    """Speeds, and turns in place towards the lane that comes next, or at the end of its way as the robot is to stay."""
    yaw, turning = motion.yaw_rad, motion.turning
    for r in range(len(s_m)):
        motion.moved_m[r] = s_m[r] - motion.s_m[r]
        motion.speed_mps[r] = motion.moved_m[r] / dt
        target = heading_ahead(r, visits, facing_rad)
        away = off_heading(target, yaw[r])
        turning[r] = abs(away) > STRAIGHT_RAD
        if turning[r] and not halted[r]:
            most = turn_rate_rad_s[r] * dt
            if abs(away) <= most + 1e-9:
                yaw[r] = target
            else:
                yaw[r] += most if away > 0 else -most


@kernel
def book(rules, visits, state):
    """Book the step to what each robot spent it on."""
    motion, waits, cause = state.motion, state.waits, state.grants.cause
    for r in range(len(cause)):
        waits.waiting[r] = False
        at_end = visits.next[visits.reached[r]] < 0
        if at_end and motion.turning[r] and not np.isnan(state.facing_rad[r]):
            kind = TURN
        elif at_end:
            kind = AT_GOAL if state.home[r] else DISTURBANCE if cause[r] == DISTURBED else BLOCKED
        elif motion.moved_m[r] > AT_REST_M:
            kind = MOVING
        elif cause[r] == DISTURBED:
            kind = DISTURBANCE
        elif motion.turning[r]:
            kind = TURN
        elif cause[r] == PLANNED:
            kind = PLANNED_WAIT
        elif cause[r] == FREE and state.grants.command_mps[r] <= AT_REST_M:
            kind = MOVING  # it has just been allowed to go on
        else:
            waits.waiting[r] = True
            kind = BLOCKED if waits.stuck[r] else DEPENDENCY_WAIT
        if state.yielding.gives_way[r] and kind != DISTURBANCE and kind != AT_GOAL:
            kind = YIELDING
        waits.booked_s[r, kind] += rules.step_s
        waits.category[r] = kind


@kernel
def watch_progress(now, s_m, rules, visits, state, log):
    """Blocked is who made no progress by a cell within the window, but for waits that the plan, a facility or a disturbance asks for."""
    waits, mark_m, mark_s, stuck = state.waits, state.waits.mark_m, state.waits.mark_s, state.waits.stuck
    for r in range(len(s_m)):
        kind, k = waits.category[r], visits.reached[r]
        ahead = visits.next[k]
        on_lane = ahead >= 0 and s_m[r] > visits.at_m[k] + AT_REST_M
        stands_until_s = visits.depart_s[k] if visits.depart_s[k] > visits.arrive_s[k] else 0.0
        planned_until_s = visits.arrive_s[ahead] if on_lane else stands_until_s
        is_planned = state.grants.cause[r] == FACILITY or now <= planned_until_s
        as_planned = is_planned and (kind == DEPENDENCY_WAIT or (kind == MOVING and rules.paced))  # who is early may creep
        if kind in (TURN, PLANNED_WAIT, DISTURBANCE, YIELDING) or as_planned:
            mark_s[r] += rules.step_s
        if ahead < 0 or s_m[r] - mark_m[r] >= rules.cell_m:
            if stuck[r]:
                stuck[r] = False
                note(log, STOOD_BLOCKED, r, (waits.cause[r], waits.where[r], waits.other[r]), (mark_s[r], now))
            mark_m[r] = s_m[r]
            mark_s[r] = now
        elif now - mark_s[r] >= rules.window_s:
            stuck[r] = True


@kernel
def watch_waits(now, rules, state, log):
    """Waits begin and end where their cause, the robot waited for or the place changes."""
    waits, grants, since, before = state.waits, state.grants, state.waits.since_s, now - rules.step_s
    for r in range(len(since)):
        why = FOLLOWING if grants.cause[r] == FREE else grants.cause[r]
        same = waits.waiting[r] and since[r] < np.inf and why == waits.cause[r] and grants.other[r] == waits.other[r]
        same = same and grants.wanted[r] == waits.where[r]
        if since[r] < np.inf and not same:
            if before - since[r] >= rules.wait_least_s:
                note(log, WAITED, r, (waits.cause[r], waits.where[r], waits.other[r]), (since[r], before))
            since[r] = np.inf
        if waits.waiting[r] and not same:
            since[r] = before
            waits.cause[r] = why
            waits.other[r] = grants.other[r]
            waits.where[r] = grants.wanted[r]


@kernel(inline="always")
def arrive(now, s_m, dt, visits, state, log):
    """Departures, arrivals, and who has come to stand where its tasks end, as it is to stay there."""
    motion, grants, goal, facing, home = state.motion, state.grants, state.waits.goal_s, state.facing_rad, state.home
    for r in range(len(s_m)):
        moved = motion.moved_m[r]
        if moved > 0.0 and motion.s_m[r] == 0.0:
            note(log, SET_OUT, r, (FREE, visits.first[r], -1), (now - dt, now - dt))
        k = visits.next[visits.reached[r]]
        while k >= 0 and s_m[r] >= visits.at_m[k] - ARRIVED_M - TIE_M:
            late = (s_m[r] - visits.at_m[k] + ARRIVED_M) / moved * dt if moved > 0.0 else 0.0
            visits.arrived_s[k] = now - min(max(late, 0.0), dt)
            leave_lane(r, k, visits, grants, state.claims)
            visits.reached[r] = k
            k = visits.next[k]
        if goal[r] != goal[r] and home[r] and k < 0 and is_turned(motion.yaw_rad[r], facing[r]):
            goal[r] = now if motion.turning[r] and not np.isnan(facing[r]) else visits.arrived_s[visits.last[r]]
            note(log, ARRIVED_AT_GOAL, r, (FREE, visits.last[r], -1), (goal[r], goal[r]))


@kernel(inline="always")
def is_turned(yaw, facing):
    """True if a robot faces as it is to stay; NaN: any will do."""
    return np.isnan(facing) or abs((facing - yaw + np.pi) % (2 * np.pi) - np.pi) <= TURNED_RAD


@kernel
def note(log, kind, robot, why, span_s):
    """Add an entry to the log: why is cause, visit and other robot, and the span when it began and ended."""
    k, entries = log.num_entries[0], log.entries
    entries.kind[k], entries.robot[k] = kind, robot
    entries.cause[k], entries.visit[k], entries.other[k] = why
    entries.begin_s[k], entries.end_s[k] = span_s
    log.num_entries[0] = k + 1


@kernel(inline="always")
def get_on(robot, now, waits):
    """Note that what a robot is doing is progress: a ride."""
    waits.mark_s[robot] = now


@kernel(allocates=True)
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


def begin(visits: Visits, motion: Motion, yaw_rad: NDArray[np.float64]) -> None:
    """Robots have been at their first visits from 0 s on, and face so [R], NaN: the way that they are sent first."""
    visits.arrived_s[visits.first] = 0.0
    motion.yaw_rad[:] = yaw_rad


def face(motion: Motion, robots: NDArray[np.int64], yaw_rad: NDArray[np.float64] | float) -> None:
    """Robots that have not driven yet face so [K]."""
    motion.yaw_rad[robots] = yaw_rad


def go_elsewhere(waits: Waits, robot: int, s_m: float, now_s: float) -> None:
    """Let a robot that goes another way, from where it has driven to, wait for nothing."""
    waits.since_s[robot], waits.cause[robot], waits.other[robot], waits.where[robot] = np.inf, FREE, -1, -1
    waits.mark_m[robot], waits.mark_s[robot], waits.stuck[robot] = s_m, now_s, False


def stand_at_goal(waits: Waits, robots: NDArray[np.int64], goal_s: NDArray[np.float64]) -> None:
    """Times at which robots came to stand where their tasks end [K], NaN: they do not."""
    waits.goal_s[robots] = goal_s


def renumber(waits: Waits, new: NDArray[np.int64]) -> None:
    """Visits have other ids, those that are forgotten -1; `new` [N] by the old ones, the last place for -1."""
    waits.where[:] = new[waits.where]
