"""The audit's kernel for people: who touched whom, and whether robots kept to the speeds that their fields allow.

Sees nothing but samples: where people were, and where footprints were, how fast, and how hard they braked. Between two samples both are
taken to move on straight lines, which are looked at in four parts.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel

PARTS = 4
TOUCH_M = 1e-3  # bodies that share less are not called touching: positions of people have seven digits
MOVES_M, TURNS_RAD = 1e-4, 1e-4  # in an interval
SLACK = 0.02  # of speeds and decelerations, relative
SLACK_M = 2e-3
STANDING, LAWFUL, TOO_FAST = range(3)  # what a robot did that was touched


class Sightings(NamedTuple):
    """People in T samples in CSR form, see `core.people.PeopleLog`."""

    first: np.ndarray  # [T + 1]
    person: np.ndarray  # number of each
    x: np.ndarray  # m
    y: np.ndarray
    radius: float  # of people


@kernel
def meet_people(poses, speed, period_s, bodies, decel, steered, people, fields):
    """Robots and people in T samples of R robots.

    Parameters
    ----------
    poses, bodies
        See `_audit`.
    speed
        [T, R]
    period_s
        Between samples.
    decel
        [R]
    steered
        [R] whether a robot cannot turn in place: its field lies ahead of it as it faces, or behind.
    people
        Where they are seen.
    fields
        [4] `extra_m`, NaN for none, `reaction_s`, `side_m`, `slowest_mps`.

    Returns
    -------
    touches
        [H, 4] sample, robot, person and STANDING, LAWFUL or TOO_FAST, for each time that a pair begins to touch.
    too_fast
        [K, 3] sample, robot and speed: faster than its field allowed and not braking.
    nearest
        [3] least distance of a moving footprint from a body (inf: none), sample and robot.
    """
    (x, y, yaw), (first, person, px, py, radius), (num_samples, num_robots) = poses, people, poses.x.shape
    half_length, half_width = bodies.half_length, bodies.half_width
    extra, reaction, side, slowest = fields[0], fields[1], fields[2], fields[3]
    has_fields = extra == extra
    window = max(1, int(np.ceil(reaction / period_s - 1e-9)))
    room, clear = np.full((window + 1, num_robots), np.inf), np.ones((window + 1, num_robots), np.bool_)  # of the last samples
    touches, num_touches = np.empty((64, 4)), 0
    fast, num_fast = np.empty((64, 3)), 0
    nearest = np.array([np.inf, -1.0, -1.0])
    touching, touched = {np.int64(-1)}, {np.int64(-1)}
    for k in range(num_samples):
        now, after = k % (window + 1), min(k + 1, num_samples - 1)
        touching, touched = touched, {np.int64(-1)}
        for r in range(num_robots):
            room[now, r], clear[now, r] = np.inf, True
            if x[k, r] != x[k, r]:
                continue
            before = k - 1 if k > 0 and x[k - 1, r] == x[k - 1, r] else k
            moved_x, moved_y = x[k, r] - x[before, r], y[k, r] - y[before, r]
            moved = np.hypot(moved_x, moved_y)
            going = after != k and x[after, r] == x[after, r]
            next_x, next_y = (x[after, r] - x[k, r], y[after, r] - y[k, r]) if going else (0.0, 0.0)
            turn = (yaw[after, r] - yaw[k, r] + np.pi) % (2.0 * np.pi) - np.pi if going else 0.0
            ux, uy = (moved_x / moved, moved_y / moved) if moved > MOVES_M else (0.0, 0.0)
            heading_x, heading_y = np.cos(yaw[k, r]), np.sin(yaw[k, r])
            straight = abs(moved_x * heading_y - moved_y * heading_x) <= SLACK_M  # a short way tells less than the heading
            if moved > MOVES_M and (straight or steered[r]):
                sign = 1.0 if moved_x * heading_x + moved_y * heading_y >= 0.0 else -1.0
                ux, uy = sign * heading_x, sign * heading_y
            around = bodies.radius[r]
            look = around + radius + 1.0 + speed[k, r] ** 2 / (2.0 * decel[r]) + speed[k, r] * (reaction + period_s) + max(extra, 0.0)
            for p in range(first[k], first[k + 1]):
                dx, dy = px[p] - x[k, r], py[p] - y[k, r]
                if abs(dx) > look or abs(dy) > look:
                    continue
                if moved > MOVES_M:
                    along, aside = dx * ux + dy * uy, abs(dy * ux - dx * uy)
                    half = half_width[r] + side
                    if along > half_length[r] and aside < half + radius:
                        over = max(aside - half, 0.0)
                        ahead = along - half_length[r] - np.sqrt(max(radius * radius - over * over, 0.0))
                        room[now, r] = min(room[now, r], max(ahead, 0.0))
                if np.hypot(dx, dy) < around + side + radius:
                    clear[now, r] = False
            allowed = np.inf
            if has_fields:
                allowed = 0.0
                for j in range(min(k, window) + 1):
                    allowed = max(allowed, speed_for(room[(k - j) % (window + 1), r], extra, reaction, slowest, decel[r]))
                was = speed[before, r] if before != k else np.inf
                brakes = speed[k, r] <= was - (1.0 - SLACK) * decel[r] * period_s + 1e-6
                if speed[k, r] > allowed * (1.0 + SLACK) + 1e-6 and not brakes:
                    if num_fast == len(fast):
                        fast = np.concatenate((fast, np.empty_like(fast)))
                    fast[num_fast, 0], fast[num_fast, 1], fast[num_fast, 2] = k, r, speed[k, r]
                    num_fast += 1
                    allowed = -1.0
            turns_unseen = False
            for j in range(min(k, window) + 1):
                turns_unseen |= clear[(k - j) % (window + 1), r]
            moves = np.hypot(next_x, next_y) > MOVES_M
            for p in range(first[k], first[k + 1]):
                dx, dy = px[p] - x[k, r], py[p] - y[k, r]
                if abs(dx) > look or abs(dy) > look:
                    continue
                q = find(person, first[after], first[after + 1], person[p]) if going else -1
                step_x, step_y = (px[q] - px[p], py[q] - py[p]) if q >= 0 else (0.0, 0.0)
                least = np.inf
                for part in range(PARTS + 1):
                    f = part / PARTS
                    cos, sin = np.cos(yaw[k, r] + f * turn), np.sin(yaw[k, r] + f * turn)
                    ox, oy = dx + f * (step_x - next_x), dy + f * (step_y - next_y)
                    out_u, out_v = abs(cos * ox + sin * oy) - half_length[r], abs(cos * oy - sin * ox) - half_width[r]
                    away = np.hypot(max(out_u, 0.0), max(out_v, 0.0)) if max(out_u, out_v) > 0.0 else max(out_u, out_v)
                    least = min(least, away - radius)
                if moves and max(least, 0.0) < nearest[0]:
                    nearest[0], nearest[1], nearest[2] = max(least, 0.0), k, r
                if least >= -TOUCH_M:
                    continue
                pair = np.int64(r) << 32 | np.int64(person[p])
                touched.add(pair)
                if pair in touching:
                    continue
                kind = STANDING
                if moves:
                    kind = TOO_FAST if allowed < 0.0 else LAWFUL
                elif abs(turn) > TURNS_RAD:
                    kind = LAWFUL if turns_unseen or not has_fields else TOO_FAST
                if num_touches == len(touches):
                    touches = np.concatenate((touches, np.empty_like(touches)))
                touches[num_touches, 0], touches[num_touches, 1] = k, r
                touches[num_touches, 2], touches[num_touches, 3] = person[p], kind
                num_touches += 1
    return touches[:num_touches], fast[:num_fast], nearest


@kernel(inline="always")
def speed_for(room, extra, reaction, slowest, decel):
    """The highest speed at which a protective field ends before somebody who is so far ahead."""
    left = room - extra + SLACK_M
    if left <= 0.0:
        return 0.0
    late = reaction * decel
    found = np.sqrt(late * late + 2.0 * decel * left) - late
    return found if found >= slowest * (1.0 - SLACK) else 0.0


@kernel(inline="always")
def find(person, begin, end, number):
    """The row of a person among those of a sample, -1: it is not there."""
    last = end
    while begin < end:
        middle = (begin + end) // 2
        if person[middle] < number:
            begin = middle + 1
        else:
            end = middle
    return begin if begin < last and person[begin] == number else -1
