"""The audit's kernels: how near footprints come, also between samples, and who exceeds its limits.

Between two samples a robot is taken to move on a straight line and to turn the short way, both evenly. The distance
of two footprints then changes by no more than their points move against each other, so that an interval is left
aside, or halved, until nothing in it can matter.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._arrays import write_over
from mrp_sumo.search._kernel import kernel

TOUCH_M = 1e-6  # rectangles that share less than this are not called overlapping
CLOSE_ENOUGH_M = 1e-4  # the least clearance between samples is found to this

SPEED, ACCEL, DECEL, TURN_RATE, JUMP, HEADING_JUMP = range(6)
NONE, ANY, FIRST = range(3)  # overlaps that are sought
SPEED_SLACK = 1e-3  # relative: rounding in SUMO's files and steps
ACCEL_SLACK = 1e-2
JUMP_SLACK_M = 1e-3
TURN_SLACK_RAD = 1e-6


class Poses(NamedTuple):
    """Centres and headings of R robots in T samples; x is NaN where a robot is not on the floor."""

    x: np.ndarray  # [T, R] m
    y: np.ndarray  # [T, R]
    yaw: np.ndarray  # [T, R] rad


class Footprints(NamedTuple):
    """Footprints of R robots, and the circles around them."""

    radius: np.ndarray  # [R] m
    half_length: np.ndarray  # [R]
    half_width: np.ndarray  # [R]
    owner: np.ndarray  # [R] robot whose body it is: parts of one do not meet


class MotionLimits(NamedTuple):
    """The most that R robots can do."""

    speed: np.ndarray  # [R] m/s
    accel: np.ndarray  # [R] m/s2
    decel: np.ndarray  # [R]
    turn_rate: np.ndarray  # [R] rad/s


@kernel
def rectangle_distance(dx, dy, yaw_a, yaw_b, size_a, size_b):
    """Distance of two rectangles, b's centre at (dx, dy) of a's; where they overlap, minus the depth they share.

    Sizes are half lengths and half widths, m.
    """
    (long_a, wide_a), (long_b, wide_b) = size_a, size_b
    cos_a, sin_a, cos_b, sin_b = np.cos(yaw_a), np.sin(yaw_a), np.cos(yaw_b), np.sin(yaw_b)
    bx, by = cos_a * dx + sin_a * dy, cos_a * dy - sin_a * dx  # b seen from a
    ax, ay = -cos_b * dx - sin_b * dy, sin_b * dx - cos_b * dy  # a seen from b
    cos, sin = cos_a * cos_b + sin_a * sin_b, cos_a * sin_b - sin_a * cos_b
    along, across = abs(cos), abs(sin)
    # separating axes of two rectangles are their own: apart unless they overlap on all four
    gap = max(abs(bx) - long_a - along * long_b - across * wide_b, abs(by) - wide_a - across * long_b - along * wide_b)
    gap = max(gap, abs(ax) - long_b - along * long_a - across * wide_a, abs(ay) - wide_b - across * long_a - along * wide_a)
    if gap <= 0.0:
        return gap
    # two rectangles that are apart are nearest at a corner of one of them
    least = np.inf
    for f in (-1.0, 1.0):
        for g in (-1.0, 1.0):
            x, y = bx + f * cos * long_b - g * sin * wide_b, by + f * sin * long_b + g * cos * wide_b
            least = min(least, max(abs(x) - long_a, 0.0) ** 2 + max(abs(y) - wide_a, 0.0) ** 2)
            x, y = ax + f * cos * long_a + g * sin * wide_a, ay - f * sin * long_a + g * cos * wide_a
            least = min(least, max(abs(x) - long_b, 0.0) ** 2 + max(abs(y) - wide_b, 0.0) ** 2)
    return np.sqrt(least)


@kernel
def short_way(turn):
    """The angle between -pi and pi."""
    return (turn + np.pi) % (2.0 * np.pi) - np.pi


@kernel(allocates=True)
def closeness(poses, level, bodies):
    """Least distances between footprints in T samples of R robots.

    Parameters
    ----------
    level
        [R] robots on different levels never meet.

    Returns
    -------
    best, where
        The least distance (0 when any overlap, inf without two robots on one floor), and [4] the interval (the
        sample before), the share of it that has passed, and the robots.
    hits
        [H, 4] the same for every pair that overlaps, once.
    """
    x, y, radius, (num_samples, num_robots) = poses.x, poses.y, bodies.radius, poses.x.shape
    where, hits, num_hits = np.zeros(4), np.empty((64, 4)), 0
    known = {np.int64(-1)}
    best = _bound(poses, level, bodies, where)
    if best == np.inf:
        return best, where, hits[:0]
    size = 1
    while size < 2 * num_robots:
        size *= 2
    begin, free, order = np.zeros(size + 1, np.int64), np.zeros(size, np.int64), np.empty(num_robots, np.int64)
    bucket, column, row = np.empty(num_robots, np.int64), np.empty(num_robots, np.int64), np.empty(num_robots, np.int64)
    mid_x, mid_y, reach = np.empty(num_robots), np.empty(num_robots), np.empty(num_robots)
    scratch = np.empty((128, 4)), np.empty(3)
    result = scratch[1]
    for k in range(max(1, num_samples - 1)):
        after = min(k + 1, num_samples - 1)
        # where each robot is in this interval: a circle; -1: nowhere
        widest = 0.0
        for r in range(num_robots):
            x0, y0, x1, y1 = x[k, r], y[k, r], x[after, r], y[after, r]
            if x0 != x0 or y0 != y0:
                x0, y0 = x1, y1
            if x1 != x1 or y1 != y1:
                x1, y1 = x0, y0
            mid_x[r], mid_y[r] = (x0 + x1) / 2.0, (y0 + y1) / 2.0
            reach[r] = radius[r] + np.hypot(x1 - x0, y1 - y0) / 2.0 if x0 == x0 and y0 == y0 else -1.0
            widest = max(widest, reach[r])
        # robots by squares of the floor, so wide that pairs that matter are in one or in neighbouring squares
        wide = 2.0 * widest + best + TOUCH_M
        begin[:] = 0
        for r in range(num_robots):
            if reach[r] >= 0.0:
                column[r], row[r] = int(np.floor(mid_x[r] / wide)), int(np.floor(mid_y[r] / wide))
                bucket[r] = (column[r] * 73856093 ^ row[r] * 19349663) & (size - 1)
                begin[bucket[r] + 1] += 1
        for b in range(size):
            begin[b + 1] += begin[b]
        write_over(free, begin)
        for r in range(num_robots):
            if reach[r] >= 0.0:
                order[free[bucket[r]]] = r
                free[bucket[r]] += 1
        for i in range(num_robots):
            if reach[i] < 0.0:
                continue
            for c in range(2):
                for d in range(-1 if c else 0, 2):
                    b = ((column[i] + c) * 73856093 ^ (row[i] + d) * 19349663) & (size - 1)
                    for at in range(begin[b], begin[b + 1]):
                        j = order[at]
                        if column[j] != column[i] + c or row[j] != row[i] + d or (c == 0 and d == 0 and j <= i) or level[i] != level[j]:
                            continue
                        if bodies.owner[i] == bodies.owner[j]:
                            continue
                        if np.hypot(mid_x[j] - mid_x[i], mid_y[j] - mid_y[i]) - reach[i] - reach[j] > best:
                            continue
                        one, two = min(i, j), max(i, j)
                        pair = one * num_robots + two
                        _meet(poses, bodies, k, (one, two), best, pair in known, scratch)
                        if result[0] < best:
                            best = result[0]
                            where[0], where[1], where[2], where[3] = k, result[1], one, two
                        if result[2] >= 0.0:
                            known.add(pair)
                            if num_hits == len(hits):
                                hits = np.concatenate((hits, np.empty_like(hits)))
                            hits[num_hits, 0], hits[num_hits, 1], hits[num_hits, 2], hits[num_hits, 3] = k, result[2], one, two
                            num_hits += 1
    return best, where, hits[:num_hits]


@kernel
def _bound(poses, level, bodies, where):
    """The least distance at the first sample with two robots on a floor, which bounds that of the whole run. Sets `where`."""
    (x, y, yaw), radius, (num_samples, num_robots) = poses, bodies.radius, poses.x.shape
    best = np.inf
    for k in range(num_samples):
        for i in range(num_robots):
            if x[k, i] != x[k, i]:
                continue
            for j in range(i + 1, num_robots):
                dx, dy = x[k, j] - x[k, i], y[k, j] - y[k, i]
                if bodies.owner[i] == bodies.owner[j] or level[i] != level[j] or not np.hypot(dx, dy) - radius[i] - radius[j] < best:
                    continue
                d = rectangle_distance(dx, dy, yaw[k, i], yaw[k, j], _size(bodies, i), _size(bodies, j))
                if max(d, 0.0) < best:
                    best = max(d, 0.0)
                    where[0], where[1], where[2], where[3] = k, 0.0, i, j
        if best < np.inf:
            break
    return best


@kernel
def _size(bodies, r):
    return bodies.half_length[r], bodies.half_width[r]


@kernel
def _meet(poses, bodies, k, pair, best, known, scratch):
    """Two robots in one interval: the second of `scratch` becomes the least distance (as far as it is below `best`), when, and when
    an overlap is seen first (-1: not, or it is known).
    """
    (x, y, yaw), radius, (i, j), result = poses, bodies.radius, pair, scratch[1]
    after = min(k + 1, len(x) - 1)
    result[0], result[1], result[2] = np.inf, 0.0, -1.0
    size_i, size_j = _size(bodies, i), _size(bodies, j)
    yaw_i, yaw_j, dx, dy = yaw[k, i], yaw[k, j], x[k, j] - x[k, i], y[k, j] - y[k, i]
    move_x, move_y = x[after, j] - x[after, i] - dx, y[after, j] - y[after, i] - dy
    turn_i, turn_j = short_way(yaw[after, i] - yaw_i), short_way(yaw[after, j] - yaw_j)
    if not np.isfinite(move_x + move_y):  # one of them comes or goes: they meet at one sample, or not at all
        f = 0.0
        if not np.isfinite(dx + dy):
            f = 1.0
            dx, dy, yaw_i, yaw_j = x[after, j] - x[after, i], y[after, j] - y[after, i], yaw[after, i], yaw[after, j]
        if np.isfinite(dx + dy):
            d = rectangle_distance(dx, dy, yaw_i, yaw_j, size_i, size_j)
            result[0], result[1] = max(d, 0.0), f
            if d < -TOUCH_M and not known:
                result[2] = f
        return
    # the circles around them first
    moved = np.hypot(move_x, move_y)
    f = 0.0 if moved == 0.0 else min(max(-(dx * move_x + dy * move_y) / moved**2, 0.0), 1.0)
    circles = np.hypot(dx + f * move_x, dy + f * move_y) - radius[i] - radius[j]
    if circles > 0.0 and circles >= best:
        return
    pace = moved + radius[i] * abs(turn_i) + radius[j] * abs(turn_j)  # m their points move against each other at most
    approach((dx, dy, yaw_i, yaw_j), (move_x, move_y, turn_i, turn_j), (size_i, size_j), pace, best, NONE if known else ANY, scratch)


@kernel
def approach(begin, change, sizes, pace, best, sought, scratch):
    """The least distance of two rectangles that move evenly for an interval, and when they overlap.

    Parameters
    ----------
    begin, change
        x and y from the first to the second, and the headings of both, at the begin of the interval; and what is added to them in it.
    sizes
        Half lengths and half widths of both.
    pace
        m that their points move against each other at most.
    best
        Distances from here on are of no interest.
    sought
        Which overlap: NONE, ANY, or the FIRST.
    scratch
        The second becomes the least distance (as far as it is below `best`), when, and when they overlap (-1: not).
    """
    (dx, dy, yaw_a, yaw_b), (move_x, move_y, turn_a, turn_b), (size_a, size_b), (stack, result) = begin, change, sizes, scratch
    first = rectangle_distance(dx, dy, yaw_a, yaw_b, size_a, size_b)
    result[0], result[1], result[2] = max(first, 0.0), 0.0, -1.0
    if first < -TOUCH_M and sought != NONE:
        result[2] = 0.0
        return
    if pace == 0.0:
        return
    last = rectangle_distance(dx + move_x, dy + move_y, yaw_a + turn_a, yaw_b + turn_b, size_a, size_b)
    if max(last, 0.0) < result[0]:
        result[0], result[1] = max(last, 0.0), 1.0
    touched = 1.0 if last < -TOUCH_M and sought != NONE else 2.0
    depth = 1 if sought == FIRST or touched > 1.0 else 0
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0.0, 1.0, max(first, 0.0), max(last, 0.0)
    while depth:
        depth -= 1
        a, b, distance_a, distance_b = stack[depth, 0], stack[depth, 1], stack[depth, 2], stack[depth, 3]
        least = (distance_a + distance_b - pace * (b - a)) / 2.0  # of all that may be in between
        nearer = max(least, 0.0) < min(best, result[0]) - CLOSE_ENOUGH_M
        if a >= touched or not (nearer or (least <= 0.0 and sought != NONE)) or pace * (b - a) <= TOUCH_M:
            continue
        f = (a + b) / 2.0
        d = rectangle_distance(dx + f * move_x, dy + f * move_y, yaw_a + f * turn_a, yaw_b + f * turn_b, size_a, size_b)
        if max(d, 0.0) < result[0]:
            result[0], result[1] = max(d, 0.0), f
        if d < -TOUCH_M and sought != NONE:
            touched = min(touched, f)
            if sought == ANY:
                break
        d = max(d, 0.0)
        stack[depth, 0], stack[depth, 1], stack[depth, 2], stack[depth, 3] = f, b, d, distance_b
        stack[depth + 1, 0], stack[depth + 1, 1], stack[depth + 1, 2], stack[depth + 1, 3] = a, f, distance_a, d
        depth += 2
    if touched <= 1.0:
        result[2] = touched


@kernel(allocates=True)
def over_limits(t, poses, speed, limits, first):
    """[6] how many samples of each kind are over the limits; the first of each go to `first` [6, F, 4]: sample, robot,
    value, limit.
    """
    (x, y, yaw), (max_speed, accel, decel, turn_rate) = poses, limits
    count = np.zeros(6, np.int64)
    for k in range(len(t)):
        for r in range(x.shape[1]):
            fast = abs(speed[k, r])
            if fast > max_speed[r] * (1.0 + SPEED_SLACK):
                _note(count, first, SPEED, k, r, fast, max_speed[r])
            if k == 0:
                continue
            dt, was = t[k] - t[k - 1], speed[k - 1, r]
            change = fast - abs(was)
            if speed[k, r] * was < 0.0:  # it brakes and drives back in the same interval
                if fast / accel[r] + abs(was) / decel[r] > dt * (1.0 + ACCEL_SLACK):
                    _note(count, first, DECEL, k, r, (fast + abs(was)) / dt, decel[r])
            elif change > accel[r] * dt * (1.0 + ACCEL_SLACK):
                _note(count, first, ACCEL, k, r, change / dt, accel[r])
            elif -change > decel[r] * dt * (1.0 + ACCEL_SLACK):
                _note(count, first, DECEL, k, r, -change / dt, decel[r])
            moved, furthest = np.hypot(x[k, r] - x[k - 1, r], y[k, r] - y[k - 1, r]), max_speed[r] * dt
            if moved > furthest * (1.0 + SPEED_SLACK) + JUMP_SLACK_M:
                _note(count, first, JUMP, k, r, moved, furthest)
            turned, most = abs(short_way(yaw[k, r] - yaw[k - 1, r])), turn_rate[r] * dt
            if turned > 2.0 * most + TURN_SLACK_RAD:
                _note(count, first, HEADING_JUMP, k, r, turned, most)
            elif turned > most * (1.0 + SPEED_SLACK) + TURN_SLACK_RAD:
                _note(count, first, TURN_RATE, k, r, turned / dt, turn_rate[r])
    return count


@kernel
def _note(count, first, kind, k, r, value, limit):
    if count[kind] < first.shape[1]:
        row = first[kind, count[kind]]
        row[0], row[1], row[2], row[3] = k, r, value, limit
    count[kind] += 1
