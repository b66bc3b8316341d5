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


class RobotSamples(NamedTuple):
    """R robots in T samples; x is NaN where one is not on the floor."""

    x: np.ndarray  # [T, R] m
    y: np.ndarray
    yaw: np.ndarray  # rad
    speed: np.ndarray
    half_length: np.ndarray  # [R] m
    half_width: np.ndarray
    radius: np.ndarray  # of the circle around the footprint
    decel: np.ndarray
    steered: np.ndarray  # whether it cannot turn in place: its field lies ahead of it as it faces, or behind
    period_s: float  # between samples


class Sightings(NamedTuple):
    """People in T samples in CSR form, see `core.people.PeopleLog`."""

    first: np.ndarray  # [T + 1]
    person: np.ndarray  # number of each
    x: np.ndarray  # m
    y: np.ndarray
    radius: float  # of people


class FieldRules(NamedTuple):
    """Protective fields, see `core.people.PeopleLog`."""

    extra: float  # NaN: there are none
    reaction_s: float
    side: float
    slowest: float


@kernel(allocates=True)
def meet_people(robots, people, fields):
    """Robots and people in the same samples.

    Returns
    -------
    touches
        [H, 4] sample, robot, person and STANDING, LAWFUL or TOO_FAST, for each time that a pair begins to touch.
    too_fast
        [K, 3] sample, robot and speed: faster than its field allowed and not braking.
    nearest
        [3] least distance of a moving footprint from a body (inf: none), sample and robot.
    """
    (num_samples, num_robots), x = robots.x.shape, robots.x
    has_fields = fields.extra == fields.extra
    window = max(1, int(np.ceil(fields.reaction_s / robots.period_s - 1e-9)))
    room, clear = np.full((num_robots, window + 1), -np.inf), np.zeros((num_robots, window + 1), np.bool_)  # in the last samples
    touches, num_touches = np.empty((64, 4)), 0
    fast, num_fast = np.empty((64, 3)), 0
    nearest = np.array([np.inf, -1.0, -1.0])
    touching, touched = {np.int64(-1)}, {np.int64(-1)}
    for k in range(num_samples):
        touching, touched = touched, {np.int64(-1)}
        for r in range(num_robots):
            room[r, k % (window + 1)], clear[r, k % (window + 1)] = np.inf, True
            if x[k, r] != x[k, r]:
                continue
            look = looked_at(robots, people, fields, k, r)
            room[r, k % (window + 1)], clear[r, k % (window + 1)] = room_ahead(robots, people, fields, look, k, r)
            is_fast = has_fields and is_too_fast(robots, fields, room[r].max(), k, r)
            if is_fast:
                if num_fast == len(fast):
                    fast = np.concatenate((fast, np.empty_like(fast)))
                fast[num_fast, 0], fast[num_fast, 1], fast[num_fast, 2] = k, r, robots.speed[k, r]
                num_fast += 1
            after = k + 1 if k + 1 < num_samples and x[k + 1, r] == x[k + 1, r] else k
            moves = np.hypot(x[after, r] - x[k, r], robots.y[after, r] - robots.y[k, r]) > MOVES_M
            kind = STANDING
            if moves:
                kind = TOO_FAST if is_fast else LAWFUL
            elif abs(turn_until(robots, after, k, r)) > TURNS_RAD:
                kind = LAWFUL if clear[r].any() or not has_fields else TOO_FAST
            for p in range(people.first[k], people.first[k + 1]):
                if abs(people.x[p] - x[k, r]) > look or abs(people.y[p] - robots.y[k, r]) > look:
                    continue
                least = distance_until(robots, people, after, k, r, p)
                if moves and max(least, 0.0) < nearest[0]:
                    nearest[0], nearest[1], nearest[2] = max(least, 0.0), k, r
                if least >= -TOUCH_M:
                    continue
                pair = np.int64(r) << 32 | np.int64(people.person[p])
                touched.add(pair)
                if pair in touching:
                    continue
                if num_touches == len(touches):
                    touches = np.concatenate((touches, np.empty_like(touches)))
                touches[num_touches, 0], touches[num_touches, 1] = k, r
                touches[num_touches, 2], touches[num_touches, 3] = people.person[p], kind
                num_touches += 1
    return touches[:num_touches], fast[:num_fast], nearest


@kernel(inline="always")
def looked_at(robots, people, fields, k, r):
    """The distance in x or y beyond which people matter to nobody."""
    speed = robots.speed[k, r]
    brakes = speed**2 / (2.0 * robots.decel[r]) + speed * (fields.reaction_s + robots.period_s)
    return robots.radius[r] + people.radius + 1.0 + brakes + max(fields.extra, 0.0)


@kernel
def room_ahead(robots, people, fields, look, k, r):
    """Room ahead of a robot, the way it has come since the last sample, and whether nobody is where its corners may come."""
    x, y, half, radius = robots.x[k, r], robots.y[k, r], robots.half_width[r] + fields.side, people.radius
    before = sample_before(robots, k, r)
    moved_x, moved_y = x - robots.x[before, r], y - robots.y[before, r]
    moved = np.hypot(moved_x, moved_y)
    ux, uy = (moved_x / moved, moved_y / moved) if moved > MOVES_M else (0.0, 0.0)
    heading_x, heading_y = np.cos(robots.yaw[k, r]), np.sin(robots.yaw[k, r])
    straight = abs(moved_x * heading_y - moved_y * heading_x) <= SLACK_M  # a short way tells less than the heading
    if moved > MOVES_M and (straight or robots.steered[r]):
        sign = 1.0 if moved_x * heading_x + moved_y * heading_y >= 0.0 else -1.0
        ux, uy = sign * heading_x, sign * heading_y
    room, clear = np.inf, True
    for p in range(people.first[k], people.first[k + 1]):
        dx, dy = people.x[p] - x, people.y[p] - y
        if abs(dx) > look or abs(dy) > look:
            continue
        along, aside = dx * ux + dy * uy, abs(dy * ux - dx * uy)
        if moved > MOVES_M and along > robots.half_length[r] and aside < half + radius:
            over = max(aside - half, 0.0)
            ahead = along - robots.half_length[r] - np.sqrt(max(radius * radius - over * over, 0.0))
            room = min(room, max(ahead, 0.0))
        if np.hypot(dx, dy) < robots.radius[r] + fields.side + radius:
            clear = False
    return room, clear


@kernel(inline="always")
def sample_before(robots, k, r):
    """The sample before, or the same where a robot was not on the floor then."""
    return k - 1 if k > 0 and robots.x[k - 1, r] == robots.x[k - 1, r] else k


@kernel
def is_too_fast(robots, fields, room, k, r):
    """True if a robot does not brake, and its protective field does not end before somebody who is so far ahead."""
    decel, speed, before = robots.decel[r], robots.speed[k, r], sample_before(robots, k, r)
    allowed, left, late = 0.0, room - fields.extra + SLACK_M, fields.reaction_s * decel
    if left > 0.0:
        allowed = np.sqrt(late * late + 2.0 * decel * left) - late
    if allowed < fields.slowest * (1.0 - SLACK):
        allowed = 0.0
    brakes = before == k or speed <= robots.speed[before, r] - (1.0 - SLACK) * decel * robots.period_s + 1e-6
    return speed > allowed * (1.0 + SLACK) + 1e-6 and not brakes


@kernel(inline="always")
def turn_until(robots, after, k, r):
    """By how much a robot turns until a sample, rad."""
    return (robots.yaw[after, r] - robots.yaw[k, r] + np.pi) % (2.0 * np.pi) - np.pi


@kernel
def distance_until(robots, people, after, k, r, p):
    """The least distance of a footprint from a body until the next sample, less than 0 where they touch."""
    turn, half_length, half_width = turn_until(robots, after, k, r), robots.half_length[r], robots.half_width[r]
    next_x, next_y = robots.x[after, r] - robots.x[k, r], robots.y[after, r] - robots.y[k, r]
    q = find(people.person, people.first[after], people.first[after + 1], people.person[p])
    step_x, step_y = (people.x[q] - people.x[p], people.y[q] - people.y[p]) if q >= 0 else (0.0, 0.0)
    dx, dy = people.x[p] - robots.x[k, r], people.y[p] - robots.y[k, r]
    least = np.inf
    for part in range(PARTS + 1):
        f = part / PARTS
        cos, sin = np.cos(robots.yaw[k, r] + f * turn), np.sin(robots.yaw[k, r] + f * turn)
        ox, oy = dx + f * (step_x - next_x), dy + f * (step_y - next_y)
        out_u, out_v = abs(cos * ox + sin * oy) - half_length, abs(cos * oy - sin * ox) - half_width
        away = np.hypot(max(out_u, 0.0), max(out_v, 0.0)) if max(out_u, out_v) > 0.0 else max(out_u, out_v)
        least = min(least, away - people.radius)
    return least


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
