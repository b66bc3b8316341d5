"""The audit's kernel for walls: how near footprints come to them, also between samples, and which they touch.

Moves between samples are straight and even, as for `_audit`; an interval is left aside, or halved, until nothing in it can matter.
"""

import numpy as np

from mrp_sumo.metrics._audit import FIRST, NONE, approach, short_way
from mrp_sumo.search._kernel import kernel


@kernel(allocates=True)
def wall_closeness(poses, bodies, cell, first, listed, walls, best):
    """Least distances of footprints to walls in T samples of R robots.

    Parameters
    ----------
    poses, bodies
        See `_audit`.
    cell
        [T, R] the place each robot is at, -1 where there is no wall near.
    first, listed
        CSR: the walls that a robot in the interval after it was at a place can matter to.
    walls
        [W, 6] middle x, y, direction, half length, cosine and sine of the direction.
    best
        What is farther than this is of no interest.

    Returns
    -------
    best, where
        The least distance (0 when any touches) as far as it is below the given one, and [4] the interval (the sample
        before), the share of it that has passed, robot and wall.
    hits
        [H, 5] the same for the first contact of every robot with every wall, and 1 where its centre ever crosses that wall.
    """
    (x, y, yaw), (num_samples, num_robots) = poses, poses.x.shape
    num_walls = len(walls)
    where, hits, num_hits = np.full(4, -1.0), np.empty((64, 5)), 0
    known, crossed = {np.int64(-1)}, {np.int64(-1)}
    scratch = np.empty((128, 4)), np.empty(3)
    result = scratch[1]
    for k in range(num_samples):
        after = min(k + 1, num_samples - 1)
        for r in range(num_robots):
            if cell[k, r] < 0:
                continue
            if k > 0 and x[k, r] == x[after, r] and y[k, r] == y[after, r] and yaw[k, r] == yaw[after, r] and x[k - 1, r] == x[k, r]:
                continue  # it stands: the interval before ended as this one goes on
            moved = np.hypot(x[after, r] - x[k, r], y[after, r] - y[k, r])
            reach = bodies.radius[r] + (moved if np.isfinite(moved) else 0.0)
            for at in range(first[cell[k, r]], first[cell[k, r] + 1]):
                wall = listed[at]
                # the circle around it, wherever it is in this interval, first
                dx, dy, cos, sin = x[k, r] - walls[wall, 0], y[k, r] - walls[wall, 1], walls[wall, 4], walls[wall, 5]
                along, outside = max(abs(cos * dx + sin * dy) - walls[wall, 3], 0.0), best + reach
                if along**2 + (cos * dy - sin * dx) ** 2 > outside**2:
                    continue
                pair = np.int64(r) * num_walls + wall
                _meet_wall(poses, bodies, (k, r), walls[wall], best, pair in known, scratch)
                if _crosses(x[k, r], y[k, r], x[after, r], y[after, r], walls[wall]):
                    crossed.add(pair)
                if result[0] < best:
                    best = result[0]
                    where[0], where[1], where[2], where[3] = k, result[1], r, wall
                if result[2] >= 0.0:
                    known.add(pair)
                    if num_hits == len(hits):
                        hits = np.concatenate((hits, np.empty_like(hits)))
                    hits[num_hits, 0], hits[num_hits, 1], hits[num_hits, 2], hits[num_hits, 3] = k, result[2], r, wall
                    num_hits += 1
    for hit in range(num_hits):
        hits[hit, 4] = 1.0 if np.int64(hits[hit, 2]) * num_walls + np.int64(hits[hit, 3]) in crossed else 0.0
    return best, where, hits[:num_hits]


@kernel
def _crosses(x0, y0, x1, y1, wall):
    """Whether a centre comes from one side of a wall to the other, or to the wall."""
    cos, sin = wall[4], wall[5]
    v0, v1 = cos * (y0 - wall[1]) - sin * (x0 - wall[0]), cos * (y1 - wall[1]) - sin * (x1 - wall[0])
    if not v0 * v1 <= 0.0 or v0 == v1:
        return False
    f = v0 / (v0 - v1)
    return abs(cos * (x0 + f * (x1 - x0) - wall[0]) + sin * (y0 + f * (y1 - y0) - wall[1])) <= wall[3]


@kernel
def _meet_wall(poses, bodies, at, wall, best, known, scratch):
    """A robot and a wall in one interval, `at`: what `approach` leaves in `scratch`, with the first contact."""
    (x, y, yaw), (k, r) = poses, at
    after, sizes = min(k + 1, len(x) - 1), ((bodies.half_length[r], bodies.half_width[r]), (wall[3], 0.0))
    move_x, move_y, turn = x[k, r] - x[after, r], y[k, r] - y[after, r], short_way(yaw[after, r] - yaw[k, r])
    if not np.isfinite(move_x + move_y):  # it goes: it is looked at where it was
        move_x, move_y, turn = 0.0, 0.0, 0.0
    begin, pace = (wall[0] - x[k, r], wall[1] - y[k, r], yaw[k, r], wall[2]), np.hypot(move_x, move_y) + bodies.radius[r] * abs(turn)
    approach(begin, (move_x, move_y, turn, 0.0), sizes, pace, best, NONE if known else FIRST, scratch)
