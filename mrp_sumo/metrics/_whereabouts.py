"""Kernels of the referee in seconds: how fast robots can be at their visits, where they are in between, and who comes too close to whom.

A lane is driven in five phases of constant acceleration. Its motion is an array [3, 6]: the moments before, between and after them, the
places along the lane then, and the accelerations of the phases that begin then. Speeds at visits are intervals: the motions between two
visits that keep the limits form a convex set, and so do their speeds at its ends.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel

FINE, TOO_EARLY, TOO_LATE = range(3)
HALVINGS = 60
LEAST_S = 0.005  # two bodies are looked at this often at least when they are near each other


class Rides(NamedTuple):
    """The lane to each of N visits of R robots, and when it is driven."""

    first: np.ndarray  # [R + 1] visits of each robot
    begins: np.ndarray  # [N] s
    ends: np.ndarray  # [N]
    stands: np.ndarray  # [N] whether the robot stands at the visit
    length: np.ndarray  # [N] m
    top: np.ndarray  # [N] m/s


class RideLimits(NamedTuple):
    """Limits of motion of R robots."""

    accel: np.ndarray  # [R] m/s2
    decel: np.ndarray  # [R]
    slack: np.ndarray  # [R] how far robots may be off, m
    stop: np.ndarray  # [R] speeds at which they may end when they come to stand, m/s


class Speeds(NamedTuple):
    """Speeds that robots can have at N visits, and whether there are some."""

    low: np.ndarray  # [N] m/s
    high: np.ndarray  # [N]
    verdict: np.ndarray  # [N] FINE, TOO_EARLY or TOO_LATE


@kernel
def least_m(u, w, t, accel, decel):
    """The shortest way in time t from speed u to speed w: brake, stand, accelerate."""
    if u / decel + w / accel <= t:
        return u * u / (2 * decel) + w * w / (2 * accel)
    low = (u / decel + w / accel - t) / (1 / decel + 1 / accel)
    return (u * u - low * low) / (2 * decel) + (w * w - low * low) / (2 * accel)


@kernel
def most_m(u, w, t, top, accel, decel):
    """The longest: accelerate, cruise at the top speed, brake."""
    high = (t + u / accel + w / decel) / (1 / accel + 1 / decel)
    if high <= top:
        return (high * high - u * u) / (2 * accel) + (high * high - w * w) / (2 * decel)
    cruise = t - (top - u) / accel - (top - w) / decel
    return (top * top - u * u) / (2 * accel) + (top * top - w * w) / (2 * decel) + top * cruise


@kernel
def speeds_after(between, length, slack, t, tops, accel, decel):
    """Speeds that a robot can have at the end of a lane.

    Parameters
    ----------
    between
        The lowest and the highest speed that it can have at its beginning.
    length, slack
        Of the lane, m, and by how much that may be wrong.
    t
        In which it drives it, s.
    tops
        Speeds that it may have on it, and at its end.

    Returns
    -------
    low, high, verdict
        Speeds, and whether it cannot be there so early, or so late.
    """
    (low, high), (top, most) = between, tops
    if t <= 0.0:
        return 0.0, most, TOO_EARLY
    floor, ceiling = max(0.0, low - decel * t), min(most, high + accel * t)
    if floor > ceiling or least_m(max(low, floor - accel * t), floor, t, accel, decel) > length + slack:
        return 0.0, most, TOO_LATE
    if most_m(min(high, ceiling + decel * t), ceiling, t, top, accel, decel) < length - slack:
        return 0.0, most, TOO_EARLY
    a, b = floor, ceiling  # the highest: of the ways to a, the shortest is short enough
    if least_m(max(low, b - accel * t), b, t, accel, decel) <= length + slack:
        a = b
    for _ in range(HALVINGS if a < b else 0):
        middle = (a + b) / 2
        if least_m(max(low, middle - accel * t), middle, t, accel, decel) <= length + slack:
            a = middle
        else:
            b = middle
    fastest = a
    a, b = floor, ceiling  # the lowest: of the ways to b, the longest is long enough
    if most_m(min(high, a + decel * t), a, t, top, accel, decel) >= length - slack:
        b = a
    for _ in range(HALVINGS if a < b else 0):
        middle = (a + b) / 2
        if most_m(min(high, middle + decel * t), middle, t, top, accel, decel) >= length - slack:
            b = middle
        else:
            a = middle
    if b > fastest + 1e-6:
        return 0.0, most, TOO_LATE
    return min(b, fastest), fastest, FINE


@kernel
def find_speeds(rides, limits, speeds):
    """Speeds of all robots at all visits, forward and back again; written to `speeds`."""
    first, begins, ends, stands, length, top = rides
    (accel, decel, slack, stop), (low, high, verdict) = limits, speeds
    for r in range(len(first) - 1):
        a, b = first[r], first[r + 1]
        low[a] = high[a] = 0.0
        for k in range(a + 1, b):
            between = (0.0, 0.0) if stands[k - 1] else (low[k - 1], high[k - 1])
            most = min(top[k], stop[r]) if stands[k] else min(top[k], top[k + 1])
            answer = speeds_after(between, length[k], slack[r], ends[k] - begins[k], (top[k], most), accel[r], decel[r])
            low[k], high[k], verdict[k] = answer
        for k in range(b - 1, a + 1, -1):
            if stands[k - 1] or verdict[k] != FINE:
                continue
            most = min(top[k], top[k - 1])
            back = speeds_after((low[k], high[k]), length[k], slack[r], ends[k] - begins[k], (top[k], most), decel[r], accel[r])
            if back[2] == FINE:
                low[k - 1] = min(max(low[k - 1], back[0]), high[k - 1])
                high[k - 1] = max(min(high[k - 1], back[1]), low[k - 1])


@kernel
def hurried(speeds, length, t, top, accel, decel, motion):
    """The motion that is farthest along a lane early on, and then waits: times and places from 0, ends at `length` at t.

    Accelerate from the first of the speeds, cruise, brake to a low speed or to a stand, wait, accelerate to the second.
    """
    (u, w), at_s, at_m = speeds, motion[0], motion[1]
    peak = max(u, np.sqrt(max(0.0, 2 * (length + (u * u - w * w) / (2 * accel)) / (1 / accel + 1 / decel))))
    cruise, low, stand = 0.0, 0.0, 0.0
    if peak > top:
        cruise = (length + (u * u - w * w) / (2 * accel) - top * top * (1 / accel + 1 / decel) / 2) / top
        peak = top
    stand = t - (peak - u) / accel - cruise - peak / decel - w / accel
    if stand < 0.0:
        stand = 0.0
        a = min(w, max(0.0, (u / decel + w / accel - t) / (1 / decel + 1 / accel)))
        b = w
        for _ in range(HALVINGS):
            low = (a + b) / 2
            peak = (t + u / accel + low / decel + (low - w) / accel) / (1 / accel + 1 / decel)
            cruise = 0.0
            if peak > top:
                cruise, peak = t - (top - u) / accel - (top - low) / decel - (w - low) / accel, top
            peak = max(peak, u)
            distance_m = (peak * peak - u * u) / (2 * accel) + cruise * peak + (peak * peak - low * low) / (2 * decel)
            if distance_m + (w * w - low * low) / (2 * accel) < length:
                a = low
            else:
                b = low
    at_s[0] = at_m[0] = 0.0
    at_s[1], at_m[1] = (peak - u) / accel, (peak * peak - u * u) / (2 * accel)
    at_s[2], at_m[2] = at_s[1] + cruise, at_m[1] + cruise * peak
    at_s[3], at_m[3] = at_s[2] + (peak - low) / decel, at_m[2] + (peak * peak - low * low) / (2 * decel)
    at_s[4], at_m[4] = at_s[3] + stand, at_m[3]
    at_s[5], at_m[5] = at_s[4] + (w - low) / accel, at_m[4] + (w * w - low * low) / (2 * accel)
    wrong_s, wrong_m = t / at_s[5] if at_s[5] > 0 else 1.0, length / at_m[5] if at_m[5] > 0 else 1.0
    for k in range(6):
        at_s[k] *= wrong_s
        at_m[k] *= wrong_m
    at_s[5], at_m[5] = t, length


@kernel(allocates=True)
def motions(rides, limits, speeds, early, late):
    """The farthest and the nearest that robots can be at every moment on the lane to each visit, [N, 3, 6] each."""
    first, begins, ends, stands, length, top = rides
    (accel, decel, _, _), (low, high, verdict) = limits, speeds
    for r in range(len(first) - 1):
        for k in range(first[r] + 1, first[r + 1]):
            t = ends[k] - begins[k]
            if verdict[k] != FINE:  # nobody can drive that; so that there is a place to look at, at one speed
                for p in range(6):
                    early[k, 0, p] = late[k, 0, p] = begins[k] + max(t, 0.0) * p / 5
                    early[k, 1, p] = late[k, 1, p] = length[k] * p / 5
                continue
            u, w = (0.0, 0.0) if stands[k - 1] else (low[k - 1], high[k - 1])
            hurried((min(w, low[k] + decel[r] * t), low[k]), length[k], t, top[k], accel[r], decel[r], early[k])
            early[k, 0] += begins[k]
            early[k, 2, 0] = early[k, 2, 4] = accel[r]
            early[k, 2, 2] = -decel[r]
            hurried((min(high[k], u + accel[r] * t), u), length[k], t, top[k], decel[r], accel[r], late[k])
            late[k, 0] = ends[k] - late[k, 0, ::-1].copy()
            late[k, 1] = length[k] - late[k, 1, ::-1].copy()
            late[k, 2, 0] = late[k, 2, 4] = -decel[r]
            late[k, 2, 2] = accel[r]


@kernel
def place_at(motion, t):
    """Place of a robot along its lane at a time."""
    if t <= motion[0, 0]:
        return motion[1, 0]
    if t >= motion[0, 5]:
        return motion[1, 5]
    p = 0
    while t > motion[0, p + 1]:
        p += 1
    takes, since, rate = motion[0, p + 1] - motion[0, p], t - motion[0, p], motion[2, p]
    speed = (motion[1, p + 1] - motion[1, p]) / takes - rate * takes / 2
    return motion[1, p] + since * (speed + rate * since / 2)


@kernel
def first_at(motion, place):
    """Time at which a robot comes to a place along its lane."""
    a, b = motion[0, 0], motion[0, 5]
    for _ in range(HALVINGS):
        middle = (a + b) / 2
        if place_at(motion, middle) < place:
            a = middle
        else:
            b = middle
    return b


@kernel
def where(piece, e, t, waits):
    """(x, y) of a robot at a moment of a piece of its way. `waits`: short of the vertex ahead as long as it can, where there is room."""
    k = piece.visit[e]
    if not piece.moves[e]:
        return piece.head[e, 0], piece.head[e, 1]
    s = place_at(piece.early[k], t)
    if waits:
        s = max(place_at(piece.late[k], t), min(s, piece.short_of[e]))
    share = s / piece.length[e]
    return (
        piece.tail[e, 0] + share * (piece.head[e, 0] - piece.tail[e, 0]),
        piece.tail[e, 1] + share * (piece.head[e, 1] - piece.tail[e, 1]),
    )


@kernel
def nearest(piece, e, f, apart, e_waits, f_waits):
    """First time at which two bodies come closer than `apart`, inf if never, and how close they come in all."""
    begin, end, pace = max(piece.begin[e], piece.begin[f]), min(piece.end[e], piece.end[f]), piece.top[e] + piece.top[f]
    t, first_s, least = begin, np.inf, np.inf
    while True:
        ex, ey = where(piece, e, t, e_waits)
        fx, fy = where(piece, f, t, f_waits)
        distance = np.hypot(ex - fx, ey - fy)
        least = min(least, distance)
        if distance < apart and first_s == np.inf:
            first_s = t
        if t >= end or pace == 0.0:
            return first_s, least
        t = min(end, t + max(abs(distance - apart) / pace, LEAST_S))


@kernel
def meetings(order, cell, piece, apart, kind, pairs, seen):
    """Pieces in one cell, at one time, whose bodies come too close. Returns how many; writes as many as there is room for.

    Parameters
    ----------
    order
        [E] entries: pieces by cell, then by when they begin.
    cell
        [E] column and row of each, [E, 2].
    apart
        [K, K] least distances by type.
    kind
        [R] types.
    pairs, seen
        [M, 2] pieces; when, and the least distance.
    """
    count = 0
    for i in range(len(order)):
        e = order[i]
        for j in range(i + 1, len(order)):
            f = order[j]
            if cell[i, 0] != cell[j, 0] or cell[i, 1] != cell[j, 1] or piece.begin[f] > piece.end[e]:
                break
            if piece.robot[e] == piece.robot[f] or piece.level[e] != piece.level[f]:
                continue
            if cell[i, 0] != max(piece.corner[e, 0], piece.corner[f, 0]) or cell[i, 1] != max(piece.corner[e, 1], piece.corner[f, 1]):
                continue  # they meet in other cells too, and are looked at in one
            least = apart[kind[piece.robot[e]], kind[piece.robot[f]]]
            t, m = nearest(piece, e, f, least, False, False)
            roomy_e, roomy_f = piece.short_of[e] < np.inf, piece.short_of[f] < np.inf
            if t < np.inf and roomy_e:
                t, m = nearest(piece, e, f, least, True, False)
            if t < np.inf and roomy_f:
                t, m = nearest(piece, e, f, least, False, True)
            if t < np.inf and roomy_e and roomy_f:
                t, m = nearest(piece, e, f, least, True, True)
            if t < np.inf:
                if count < len(pairs):
                    pairs[count, 0], pairs[count, 1], seen[count, 0], seen[count, 1] = e, f, t, m
                count += 1
    return count
