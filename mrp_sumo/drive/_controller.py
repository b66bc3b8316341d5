"""The controller's kernels: what every robot did in the last step, what it may enter next, how fast it shall go.

Robots move along their own paths; all distances are along the path from the start. A robot may drive up to
`allowed`, which grows as it wins the needs of its next visits and never shrinks, so that braking in time needs
no more than its deceleration.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

# why a robot does not go on
FREE, TURNING, PLANNED, OTHER, ONCOMING, FOLLOWING, DISTURBED, FINISHED, LETTING_PASS = range(9)
# how a second of a robot is booked
MOVING, TURN, PLANNED_WAIT, DEPENDENCY_WAIT, YIELDING, BLOCKED, DISTURBANCE, AT_GOAL = range(8)
# what the log tells
WAITED, STOOD_BLOCKED, ARRIVED_AT_GOAL, SET_OUT = range(4)

MARGIN_M = 0.001  # a robot is stopped this far before the end of what it may drive
ARRIVED_M = 0.002
NEVER = 2**62
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
    turned: np.ndarray  # [R] whether it has turned back on the lane it is on: nobody follows it there, SUMO would not see it
    pause: np.ndarray  # [R] the visit beyond which a robot that gives way claims nothing; NEVER where it does not
    pause_for: np.ndarray  # [R] the robot it lets pass, -1: none
    gives_way: np.ndarray  # [R] since it set out to give way until it may go on
    home: np.ndarray  # [R] whether its path ends at its goal


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
def take_up(path, need, state):
    """Robots hold what the visits they have arrived at or won need, and claim the lanes to those they have won."""
    for r in range(len(path.first) - 1):
        for k in range(path.first[r], state.won[r] + 1):
            for e in range(need.first[k], need.first[k + 1]):
                state.holder[need.resource[e]] = r
                state.held[need.resource[e]] += 1
        for k in range(state.nx[r], state.won[r] + state.on_lane[r] + 1):
            state.claims[path.lane[k]] += 1
            state.claimer[path.lane[k]] = r
        if state.turned[r]:
            state.claims[path.reverse[path.lane[state.nx[r]]]] += 1
            state.claimer[path.reverse[path.lane[state.nx[r]]]] = r


class Around(NamedTuple):
    """What disturbs the robots."""

    factor: np.ndarray  # [R] on their speed
    hold_until: np.ndarray  # [R] s, before which they stand still
    told: np.ndarray  # [R] m, how far they know they may drive
    closed: np.ndarray  # [L] whether nobody may set out on a lane
    prompt: bool  # whether they know everything at once


class News(NamedTuple):
    """Robots SUMO has to be told of, [R] each, filled up to the counts that `advance` returns."""

    changed: np.ndarray  # whose speed is another
    due: np.ndarray  # whose route ends soon


@njit(cache=True)
def advance(look, now, dt, s, drive, path, need, state, log, news, around, cell, window, tolerance, wait_least, look_ahead, paced):
    """All between two steps of SUMO: look where robots are, let them claim, command speeds.

    One call, since handing the arrays over costs more than the work for few robots. `look` is off where no step
    has been made since the last call. Returns the number of entries in the log, of changed speeds and of routes
    to renew.
    """
    count = 0
    if look:
        count = _observe(now, dt, s, drive, path, need, state, log, cell, window, tolerance, wait_least)
    _extend(now, drive, path, need, state, around.closed, look_ahead)
    changed = _command(now, dt, drive, path, state, around, paced, news.changed)
    due = 0
    for r in range(len(s)):
        if state.won[r] + state.on_lane[r] >= state.routed[r] and state.routed[r] < path.first[r + 1]:
            news.due[due] = r
            due += 1
    return count, changed, due


@njit(cache=True)
def _observe(now, dt, s, drive, path, need, state, log, cell, window, goal_tolerance, wait_least):
    """Book the step that ended at `now`, turn, log arrivals, free what was left. Returns entries in the log."""
    # arrays are taken out of their tuples once: numba counts references each time
    was, speed, first, nx, heading = state.s, state.speed, path.first, state.nx, path.heading
    yaw, turn_rate, cause, commanded, stuck = state.yaw, drive.turn_rate, state.cause, state.command, state.stuck
    booked, mark_t, mark_s, wait_cause, wait_where = state.booked, state.mark_t, state.mark_s, state.wait_cause, state.wait_where
    wait_other, other, where, wait_since, at = state.wait_other, state.other, state.where, state.wait_since, path.at
    arrived, claims, lane, goal, back = state.arrived, state.claims, path.lane, state.goal, state.back
    won, first_need, freed, left_at = state.won, need.first, state.freed, need.left_at
    resource, held, holder, closes, turn = need.resource, state.held, state.holder, need.closes, state.turn
    gives_way, home, turned_back, reverse = state.gives_way, state.home, state.turned, path.reverse
    count = 0
    for r in range(len(s)):
        moved = s[r] - was[r]
        speed[r] = moved / dt
        last = first[r + 1] - 1
        finished = nx[r] > last
        # turning
        target = heading[min(nx[r], last)]
        away = (target - yaw[r] + np.pi) % (2 * np.pi) - np.pi
        turned = abs(away) > 1e-12
        if turned:
            most = turn_rate[r] * dt
            if abs(away) <= most + 1e-9:
                yaw[r] = target
            else:
                yaw[r] += most if away > 0 else -most
        # booking
        waits = False
        if finished:
            category = AT_GOAL if home[r] else DISTURBANCE if cause[r] == DISTURBED else BLOCKED
        elif moved > 1e-6:
            category = MOVING
        elif cause[r] == DISTURBED:
            category = DISTURBANCE
        elif turned:
            category = TURN
        elif cause[r] == PLANNED:
            category = PLANNED_WAIT
        elif cause[r] == FREE and commanded[r] <= 1e-6:
            category = MOVING  # it has just been allowed to go on
        else:
            waits = True
            category = BLOCKED if stuck[r] else DEPENDENCY_WAIT
        if gives_way[r] and category != DISTURBANCE and category != AT_GOAL:
            category = YIELDING
        booked[r, category] += dt
        # blocking: no progress by a cell, not counting waits that the plan or a disturbance asks for
        if category in (TURN, PLANNED_WAIT, DISTURBANCE, YIELDING):
            mark_t[r] += dt
        if finished or s[r] - mark_s[r] >= cell:
            if stuck[r]:
                stuck[r] = False
                count = _note(log, count, STOOD_BLOCKED, r, wait_cause[r], wait_where[r], wait_other[r], mark_t[r], now)
            mark_s[r] = s[r]
            mark_t[r] = now
        elif now - mark_t[r] >= window:
            stuck[r] = True
        # waits
        why = FOLLOWING if cause[r] == FREE else cause[r]
        same = waits and why == wait_cause[r] and other[r] == wait_other[r] and where[r] == wait_where[r]
        if wait_since[r] < np.inf and not same:
            if now - dt - wait_since[r] >= wait_least:
                count = _note(log, count, WAITED, r, wait_cause[r], wait_where[r], wait_other[r], wait_since[r], now - dt)
            wait_since[r] = np.inf
        if waits and not same:
            wait_since[r] = now - dt
            wait_cause[r] = why
            wait_other[r] = other[r]
            wait_where[r] = where[r]
        # arrivals
        if moved > 0.0 and was[r] == 0.0:
            count = _note(log, count, SET_OUT, r, FREE, first[r], -1, now - dt, now - dt)
        while nx[r] <= last and s[r] >= at[nx[r]] - ARRIVED_M:
            k = nx[r]
            late = (s[r] - at[k] + ARRIVED_M) / moved * dt if moved > 0.0 else 0.0
            arrived[k] = now - min(max(late, 0.0), dt)
            claims[lane[k]] -= 1
            if turned_back[r]:
                claims[reverse[lane[k]]] -= 1
                turned_back[r] = False
            nx[r] += 1
        if goal[r] != goal[r] and home[r]:
            near = s[r] >= at[last] - goal_tolerance and moved <= 1e-6 and nx[r] >= last
            if nx[r] > last or near:
                goal[r] = arrived[last] if nx[r] > last else now
                count = _note(log, count, ARRIVED_AT_GOAL, r, FREE, last, -1, goal[r], goal[r])
        # what has been left
        k = back[r]
        oldest = True
        while k < nx[r] + 1 and k <= won[r]:
            all_freed = True
            for e in range(first_need[k], first_need[k + 1]):
                if freed[e]:
                    continue
                if s[r] >= left_at[e]:
                    _free(e, resource, freed, held, holder, closes, turn)
                else:
                    all_freed = False
            if not all_freed:
                oldest = False
            k += 1
            if oldest:
                back[r] = k
        was[r] = s[r]
    return count


@njit(cache=True)
def _free(e, resource, freed, held, holder, closes, turn):
    q = resource[e]
    freed[e] = True
    held[q] -= 1
    if held[q] == 0:
        holder[q] = -1
    if closes[e]:
        turn[q] += 1


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
def _turns_to_ask(ordered, asked):
    """Robots in the order in which they may claim: any, or those first who have asked longest."""
    if ordered:
        return np.arange(len(asked))
    asking = np.flatnonzero(asked < np.inf)
    others = np.flatnonzero(asked == np.inf)
    return np.concatenate((asking[np.argsort(asked[asking], kind="mergesort")], others))


@njit(cache=True)
def _extend(now, drive, path, need, state, closed, look_ahead):
    """Let robots claim their next visits."""
    first, cause, other, won, where = path.first, state.cause, state.other, state.won, state.where
    nx, turns, yaw, heading, top = state.nx, path.turns, state.yaw, path.heading, drive.speed
    decel, earliest, allowed, was, reach = drive.decel, path.earliest, state.allowed, state.s, drive.reach
    reverse, lane, on_lane, claims, claimer = path.reverse, path.lane, state.on_lane, state.claims, state.claimer
    first_need, resource, turn, passage, passing = need.first, need.resource, state.turn, need.passage, need.passing
    holder, short_of, held, asked, at = state.holder, path.short_of, state.held, state.asked, path.at
    ordered, pause, pause_for, home = len(passing) > 0, state.pause, state.pause_for, state.home
    for r in _turns_to_ask(ordered, asked):
        last = first[r + 1] - 1
        cause[r] = FREE
        other[r] = -1
        while True:
            m = won[r]
            k = m + 1
            where[r] = min(k, last)
            if m == last:
                if nx[r] > last:
                    cause[r] = FINISHED if home[r] else LETTING_PASS
                break
            if m >= pause[r]:
                if nx[r] > m:
                    cause[r] = LETTING_PASS
                    other[r] = pause_for[r]
                break
            if k - nx[r] >= look_ahead:
                break
            driving = nx[r] <= m
            if turns[m]:
                if driving:
                    break
                if yaw[r] != heading[k]:
                    cause[r] = TURNING
                    break
            lead = top[r] / decel[r] if driving else 0.0
            if now < earliest[m] - lead - 1e-9:
                cause[r] = PLANNED
                break
            if not ordered and allowed[r] - was[r] > reach[r]:
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
            missing = -1
            for e in range(first_need[k], first_need[k + 1]):
                q = resource[e]
                if ordered and turn[q] != passage[e]:
                    missing = passing[turn[q]]
                elif holder[q] >= 0 and holder[q] != r:
                    missing = holder[q]
                if missing >= 0:
                    break
            if missing >= 0:
                own = missing == r  # it is to pass again before its last passage is over: it has not heard how far it may go
                cause[r] = DISTURBED if own else OTHER
                other[r] = -1 if own else missing
                if not on_lane[r] and short_of[k] < np.inf:
                    on_lane[r] = True
                    allowed[r] = short_of[k]
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
            won[r] = k
            allowed[r] = at[k]


@njit(cache=True)
def _command(now, dt, drive, path, state, around, paced, changed):
    """The robots' speeds for the next step. Returns how many changed; `changed` tells which."""
    was, decel, top, cause = state.s, drive.decel, drive.speed, state.cause
    told = state.allowed if around.prompt else around.told
    factor, hold_until = around.factor, around.hold_until
    nx, first, due, at, commanded = state.nx, path.first, path.due, path.at, state.command
    count = 0
    for r in range(len(was)):
        v = stop_speed(told[r] - was[r] - MARGIN_M, decel[r], dt)
        v = min(v, top[r] * factor[r])
        if now < hold_until[r]:
            v = 0.0
            if cause[r] != FINISHED:
                cause[r] = DISTURBED
        k = nx[r]
        if paced and v > 0.0 and k < first[r + 1] and due[k] > now:
            v = min(v, max((at[k] - was[r]) / (due[k] - now), SLOWEST * top[r]))
        if v < 1e-9:
            v = 0.0
        if abs(v - commanded[r]) > 1e-4 or (v == 0.0 and commanded[r] != 0.0):
            commanded[r] = v
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
