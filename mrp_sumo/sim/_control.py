"""The controller's kernels: what every robot did in the last step, what it may enter next, how fast it shall go.

Robots move along their own paths; all distances are along the path from the start. A robot may drive up to
`allowed`, which grows as it wins the needs of its next visits and never shrinks, so that braking in time needs
no more than its deceleration.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

# why a robot does not go on
FREE, TURNING, PLANNED, OTHER, ONCOMING, FOLLOWING, DISTURBED, FINISHED = range(8)
# how a second of a robot is booked
MOVING, TURN, PLANNED_WAIT, DEPENDENCY_WAIT, YIELDING, BLOCKED, DISTURBANCE, AT_GOAL = range(8)
# what the log tells
WAITED, STOOD_BLOCKED, ARRIVED_AT_GOAL, SET_OUT = range(4)

MARGIN_M = 0.001  # a robot is stopped this far before the end of what it may drive
ARRIVED_M = 0.002
SLOWEST = 0.1  # a robot that is early keeps this share of its speed


class Drive(NamedTuple):
    """Limits of the robots, [R]."""

    speed: np.ndarray
    decel: np.ndarray
    turn_rate: np.ndarray
    reach: np.ndarray  # m before the end of its claim at which a robot wants more, first come first served


class Path(NamedTuple):
    """Visits in CSR form, [N] unless said."""

    first: np.ndarray  # [R + 1]
    vertex: np.ndarray
    at: np.ndarray  # m along the path
    lane: np.ndarray  # by which it is reached, -1 for first visits
    heading: np.ndarray  # of that lane, rad; for first visits that of the next
    turns: np.ndarray  # whether a robot turns in place here
    earliest: np.ndarray  # s, to leave
    due: np.ndarray  # s, to arrive, where robots keep a pace; 0 elsewhere
    short_of: np.ndarray  # m along the path where a robot may wait for the visit on its lane, inf: nowhere
    reverse: np.ndarray  # [L] opposite lane, -1: none


class Need(NamedTuple):
    """What visits need, [M] unless said."""

    first: np.ndarray  # [N + 1]
    resource: np.ndarray
    left_at: np.ndarray  # m along the path where it is left, inf: never
    passage: np.ndarray  # in the order of its resource
    closes: np.ndarray  # whether it ends its passage
    passing: np.ndarray  # [E] robot of each passage; without order empty


class State(NamedTuple):
    """Everything that changes."""

    s: np.ndarray  # [R] m driven
    speed: np.ndarray  # [R] m/s in the last step
    nx: np.ndarray  # [R] next visit to arrive at
    won: np.ndarray  # [R] last visit won
    back: np.ndarray  # [R] first visit that may still hold something
    allowed: np.ndarray  # [R] m
    on_lane: np.ndarray  # [R] whether it may enter the lane after `won` without having won its end
    yaw: np.ndarray  # [R] rad
    command: np.ndarray  # [R] m/s
    routed: np.ndarray  # [R] last visit whose edge is in SUMO's route, one beyond the path's end when that is complete
    cause: np.ndarray  # [R]
    other: np.ndarray  # [R] the robot it waits for, -1: none
    where: np.ndarray  # [R] the visit it waits for
    asked: np.ndarray  # [R] since when it asks for its next visit, inf: it does not
    wait_since: np.ndarray  # [R] s, inf: does not wait
    wait_cause: np.ndarray  # [R]
    wait_other: np.ndarray  # [R]
    wait_where: np.ndarray  # [R]
    mark_s: np.ndarray  # [R] m, at the last progress by a cell
    mark_t: np.ndarray  # [R] s
    stuck: np.ndarray  # [R] no progress by a cell within the window
    arrived: np.ndarray  # [N] s
    goal: np.ndarray  # [R] s
    booked: np.ndarray  # [R, 8] s
    freed: np.ndarray  # [M]
    holder: np.ndarray  # [Q] robot, -1: none
    held: np.ndarray  # [Q] by how many of its needs
    turn: np.ndarray  # [Q] the passage whose turn it is
    claims: np.ndarray  # [L] robots that may enter the lane and have not arrived at its end
    claimer: np.ndarray  # [L] the last of them


class Log(NamedTuple):
    """What happened in one step."""

    kind: np.ndarray
    robot: np.ndarray
    cause: np.ndarray
    visit: np.ndarray
    other: np.ndarray
    begin: np.ndarray
    end: np.ndarray


@njit(cache=True)
def stop_speed(free, decel, dt):
    """The highest speed for the next step that still allows a stop within `free` metres at `decel`.

    Exact for SUMO's Euler steps: speed v = n b + x (0 <= x < b = decel dt) needs (n+1) x dt + b dt n (n+1) / 2.
    """
    if free <= 0.0:
        return 0.0
    b = decel * dt
    n = np.floor((np.sqrt(1.0 + 8.0 * free / (b * dt)) - 1.0) / 2.0)
    return n * b + (free - b * dt * n * (n + 1.0) / 2.0) / ((n + 1.0) * dt)


@njit(cache=True)
def begin(path, need, state):
    """Robots hold what their first visits need."""
    for r in range(len(path.first) - 1):
        k = path.first[r]
        for e in range(need.first[k], need.first[k + 1]):
            state.holder[need.resource[e]] = r
            state.held[need.resource[e]] += 1
        state.arrived[k] = 0.0


class News(NamedTuple):
    """Robots SUMO has to be told of, [R] each, filled up to the counts that `advance` returns."""

    changed: np.ndarray  # whose speed is another
    due: np.ndarray  # whose route ends soon


@njit(cache=True)
def advance(now, dt, s, drive, path, need, state, log, news, factor, hold_until, cell, window, tolerance, wait_least, look_ahead, paced):
    """All between two steps of SUMO: look where robots are, let them claim, command speeds.

    One call, since handing the arrays over costs more than the work for few robots. Returns the number of
    entries in the log, of changed speeds and of routes to renew.
    """
    count = 0
    if now > 0.0:
        count = _observe(now, dt, s, drive, path, need, state, log, cell, window, tolerance, wait_least)
    _extend_all(now, drive, path, need, state, look_ahead)
    changed = _command(now, dt, drive, path, state, factor, hold_until, paced, news.changed)
    due = 0
    for r in range(len(s)):
        if state.won[r] + state.on_lane[r] >= state.routed[r] and state.routed[r] < path.first[r + 1]:
            news.due[due] = r
            due += 1
    return count, changed, due


@njit(cache=True)
def _observe(now, dt, s, drive, path, need, state, log, cell, window, goal_tolerance, wait_least):
    """Book the step that ended at `now`, turn, log arrivals, free what was left. Returns entries in the log."""
    count = 0
    for r in range(len(s)):
        moved = s[r] - state.s[r]
        state.speed[r] = moved / dt
        last = path.first[r + 1] - 1
        finished = state.nx[r] > last
        # turning
        target = path.heading[min(state.nx[r], last)]
        away = (target - state.yaw[r] + np.pi) % (2 * np.pi) - np.pi
        turned = abs(away) > 1e-12
        if turned:
            most = drive.turn_rate[r] * dt
            if abs(away) <= most + 1e-9:
                state.yaw[r] = target
            else:
                state.yaw[r] += most if away > 0 else -most
        # booking
        waits = False
        if finished:
            category = AT_GOAL
        elif moved > 1e-6:
            category = MOVING
        elif state.cause[r] == DISTURBED:
            category = DISTURBANCE
        elif turned:
            category = TURN
        elif state.cause[r] == PLANNED:
            category = PLANNED_WAIT
        elif state.cause[r] == FREE and state.command[r] <= 1e-6:
            category = MOVING  # it has just been allowed to go on
        else:
            waits = True
            category = BLOCKED if state.stuck[r] else DEPENDENCY_WAIT
        state.booked[r, category] += dt
        # blocking: no progress by a cell, not counting waits that the plan or a disturbance asks for
        if category in (TURN, PLANNED_WAIT, DISTURBANCE):
            state.mark_t[r] += dt
        if finished or s[r] - state.mark_s[r] >= cell:
            if state.stuck[r]:
                state.stuck[r] = False
                count = _note(
                    log, count, STOOD_BLOCKED, r, state.wait_cause[r], state.wait_where[r], state.wait_other[r], state.mark_t[r], now
                )
            state.mark_s[r] = s[r]
            state.mark_t[r] = now
        elif now - state.mark_t[r] >= window:
            state.stuck[r] = True
        # waits
        cause = FOLLOWING if state.cause[r] == FREE else state.cause[r]
        same = waits and cause == state.wait_cause[r] and state.other[r] == state.wait_other[r] and state.where[r] == state.wait_where[r]
        if state.wait_since[r] < np.inf and not same:
            if now - dt - state.wait_since[r] >= wait_least:
                count = _note(
                    log, count, WAITED, r, state.wait_cause[r], state.wait_where[r], state.wait_other[r], state.wait_since[r], now - dt
                )
            state.wait_since[r] = np.inf
        if waits and not same:
            state.wait_since[r] = now - dt
            state.wait_cause[r] = cause
            state.wait_other[r] = state.other[r]
            state.wait_where[r] = state.where[r]
        # arrivals
        if moved > 0.0 and state.s[r] == 0.0:
            count = _note(log, count, SET_OUT, r, FREE, path.first[r], -1, now - dt, now - dt)
        while state.nx[r] <= last and s[r] >= path.at[state.nx[r]] - ARRIVED_M:
            k = state.nx[r]
            late = (s[r] - path.at[k] + ARRIVED_M) / moved * dt if moved > 0.0 else 0.0
            state.arrived[k] = now - min(max(late, 0.0), dt)
            state.claims[path.lane[k]] -= 1
            state.nx[r] += 1
        if state.goal[r] != state.goal[r]:
            near = s[r] >= path.at[last] - goal_tolerance and moved <= 1e-6 and state.nx[r] >= last
            if state.nx[r] > last or near:
                state.goal[r] = state.arrived[last] if state.nx[r] > last else now
                count = _note(log, count, ARRIVED_AT_GOAL, r, FREE, last, -1, state.goal[r], state.goal[r])
        # what has been left
        k = state.back[r]
        oldest = True
        while k < state.nx[r] + 1 and k <= state.won[r]:
            all_freed = True
            for e in range(need.first[k], need.first[k + 1]):
                if state.freed[e]:
                    continue
                if s[r] >= need.left_at[e]:
                    _free(need, state, e)
                else:
                    all_freed = False
            if not all_freed:
                oldest = False
            k += 1
            if oldest:
                state.back[r] = k
        state.s[r] = s[r]
    return count


@njit(cache=True)
def _free(need, state, e):
    q = need.resource[e]
    state.freed[e] = True
    state.held[q] -= 1
    if state.held[q] == 0:
        state.holder[q] = -1
    if need.closes[e]:
        state.turn[q] += 1


@njit(cache=True)
def _note(log, count, kind, robot, cause, visit, other, begin, end):
    log.kind[count] = kind
    log.robot[count] = robot
    log.cause[count] = cause
    log.visit[count] = visit
    log.other[count] = other
    log.begin[count] = begin
    log.end[count] = end
    return count + 1


@njit(cache=True)
def _extend_all(now, drive, path, need, state, look_ahead):
    """Let robots claim their next visits: in the order of passages, or those first who have asked longest."""
    num_robots = len(state.s)
    if len(need.passing):
        for r in range(num_robots):
            _extend(r, now, drive, path, need, state, look_ahead)
        return
    asking = np.flatnonzero(state.asked < np.inf)
    for r in asking[np.argsort(state.asked[asking], kind="mergesort")]:
        _extend(r, now, drive, path, need, state, look_ahead)
    for r in range(num_robots):
        if state.asked[r] == np.inf:
            _extend(r, now, drive, path, need, state, look_ahead)


@njit(cache=True)
def _extend(r, now, drive, path, need, state, look_ahead):
    ordered = len(need.passing) > 0
    last = path.first[r + 1] - 1
    state.cause[r] = FREE
    state.other[r] = -1
    while True:
        m = state.won[r]
        k = m + 1
        state.where[r] = min(k, last)
        if m == last:
            if state.nx[r] > last:
                state.cause[r] = FINISHED
            return
        if k - state.nx[r] >= look_ahead:
            return
        driving = state.nx[r] <= m
        if path.turns[m]:
            if driving:
                return
            if state.yaw[r] != path.heading[k]:
                state.cause[r] = TURNING
                return
        lead = drive.speed[r] / drive.decel[r] if driving else 0.0
        if now < path.earliest[m] - lead - 1e-9:
            state.cause[r] = PLANNED
            return
        if not ordered and state.allowed[r] - state.s[r] > drive.reach[r]:
            return
        back = path.reverse[path.lane[k]]
        if not state.on_lane[r] and back >= 0 and state.claims[back] > 0:
            state.cause[r] = ONCOMING
            state.other[r] = state.claimer[back]
            _ask(state, r, now)
            return
        missing = -1
        for e in range(need.first[k], need.first[k + 1]):
            q = need.resource[e]
            if ordered and state.turn[q] != need.passage[e]:
                missing = need.passing[state.turn[q]]
            elif state.holder[q] >= 0 and state.holder[q] != r:
                missing = state.holder[q]
            if missing >= 0:
                break
        if missing >= 0:
            state.cause[r] = OTHER
            state.other[r] = missing
            if not state.on_lane[r] and path.short_of[k] < np.inf:
                state.on_lane[r] = True
                state.allowed[r] = path.short_of[k]
                _claim(path, state, r, k)
            _ask(state, r, now)
            return
        for e in range(need.first[k], need.first[k + 1]):
            q = need.resource[e]
            state.holder[q] = r
            state.held[q] += 1
        if not state.on_lane[r]:
            _claim(path, state, r, k)
        state.on_lane[r] = False
        state.asked[r] = np.inf
        state.won[r] = k
        state.allowed[r] = path.at[k]


@njit(cache=True)
def _ask(state, r, now):
    if state.asked[r] == np.inf:
        state.asked[r] = now


@njit(cache=True)
def _claim(path, state, r, k):
    state.claims[path.lane[k]] += 1
    state.claimer[path.lane[k]] = r


@njit(cache=True)
def _command(now, dt, drive, path, state, factor, hold_until, paced, changed):
    """The robots' speeds for the next step. Returns how many changed; `changed` tells which."""
    count = 0
    for r in range(len(state.s)):
        v = stop_speed(state.allowed[r] - state.s[r] - MARGIN_M, drive.decel[r], dt)
        v = min(v, drive.speed[r] * factor[r])
        if now < hold_until[r]:
            v = 0.0
            if state.cause[r] != FINISHED:
                state.cause[r] = DISTURBED
        k = state.nx[r]
        if paced and v > 0.0 and k < path.first[r + 1] and path.due[k] > now:
            v = min(v, max((path.at[k] - state.s[r]) / (path.due[k] - now), SLOWEST * drive.speed[r]))
        if v < 1e-9:
            v = 0.0
        if abs(v - state.command[r]) > 1e-4 or (v == 0.0 and state.command[r] != 0.0):
            state.command[r] = v
            changed[count] = r
            count += 1
    return count


@njit(cache=True)
def waiting_cycles(state):
    """[R] number of the wait-for cycle each robot is in, 0: none. One cause a robot, so a walk suffices."""
    num_robots = len(state.other)
    label = np.zeros(num_robots, np.int64)
    walk = np.zeros(num_robots, np.int64)
    cycles = 0
    for start in range(num_robots):
        r = start
        while r >= 0 and walk[r] == 0:
            walk[r] = start + 1
            r = state.other[r] if state.wait_since[r] < np.inf else -1
        if r >= 0 and walk[r] == start + 1:
            cycles += 1
            while label[r] == 0:
                label[r] = cycles
                r = state.other[r]
    return label
