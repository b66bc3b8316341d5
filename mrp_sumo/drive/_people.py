"""The kernels of robots among people: how fast people ahead let a robot drive, and where people see robots.

The protective field reaches S_L(v) ahead of a robot at speed v, as wide as its footprint and a margin; somebody in it makes the robot
stop, and go on once the field of its slowest speed has been free for a while. The warning field is what it takes to slow down in time:
robots drive no faster than v with S_L(v) <= the distance, less a step, but for their slowest speed. Who turns in place has a field
all around. That of a vehicle which cannot lies ahead of its body as it faces, on arcs, too, or behind it where it reverses.
"""

import numpy as np

from mrp_sumo.drive._causes import GRAINS
from mrp_sumo.search._kernel import kernel

STRAIGHT_RAD = 1e-12  # a robot that is less off its heading does not turn
EDGE_M = 2.0 / GRAINS  # so near the end of a field is outside


@kernel
def book_lost(dt, people):
    """Time that the step that has ended cost robots because of people."""
    robots = people.robots
    for r in range(len(robots.lost_s)):
        robots.lost_s[r] += dt * robots.lost_share[r]


@kernel(inline="always")
def heed(r, wanted, now, dt, kinematics, visits, motion, facing_rad, people):
    """The speed for the next step, at most `wanted`, that people and lanes leave a robot."""
    halted, robots = people.halted, people.robots
    since, free_since, share = robots.since_s, robots.free_since_s, robots.lost_share
    v = min(wanted, robots.cap_mps[r])
    turns = v == 0.0 and abs(off_heading(heading_ahead(r, visits, facing_rad), motion.yaw_rad[r])) > STRAIGHT_RAD
    speed_mps = in_grains(motion.speed_mps[r])
    share[r] = 0.0
    if people.watches and (v > 0.0 or speed_mps > 0.0 or turns):
        decel, slowest = kinematics.decel_mps2[r], people.slowest_mps
        room, is_free = np.inf, True
        if v > 0.0 or speed_mps > 0.0:
            speed = slowest if halted[r] else max(speed_mps, slowest)
            most = reach(max(wanted, speed), decel, people) + max(wanted, speed) * dt
            room = room_ahead(r, most, visits, motion, people)
            is_free = room >= reach(speed, decel, people) - EDGE_M
        if turns:
            is_free &= is_clear_around(r, visits, motion, people)
        if halted[r]:
            if not is_free:
                free_since[r] = np.inf
            elif free_since[r] == np.inf:
                free_since[r] = now
            halted[r] = not (is_free and now - free_since[r] >= people.restart_s - 1e-9)
        elif not is_free:
            halted[r], since[r], free_since[r] = True, now, np.inf
            robots.in_motion[r] = turns or speed_mps > 0.0
        slowed = max(speed_within(room - people.extra_m, people.reaction_s + dt, decel), slowest)
        v = 0.0 if halted[r] else min(v, slowed)
    elif halted[r]:
        halted[r] = False
    if wanted > 0.0:
        share[r] = 1.0 - v / wanted
    elif turns and halted[r]:
        share[r] = 1.0
    return v


@kernel(inline="always")
def heading_ahead(r, visits, facing_rad):
    """The heading to which a robot turns: that of the lane that comes next, or at the end of its way the one in which it stays."""
    ahead, stays_rad = visits.next[visits.reached[r]], facing_rad[r]
    return visits.heading_rad[ahead] if ahead >= 0 else visits.heading_rad[visits.last[r]] if np.isnan(stays_rad) else stays_rad


@kernel(inline="always")
def off_heading(heading_rad, yaw_rad):
    """The angle from one heading to another, in [-pi, pi)."""
    return (heading_rad - yaw_rad + np.pi) % (2 * np.pi) - np.pi


@kernel(inline="always")
def reach(speed, decel, people):
    """S_L: how far the protective field reaches."""
    return speed * speed / (2.0 * decel) + speed * people.reaction_s + people.extra_m


@kernel(inline="always")
def speed_within(room, reaction_s, decel):
    """The speed from which a robot that reacts so late stops within so many metres."""
    if room <= 0.0:
        return 0.0
    if room == np.inf:
        return np.inf
    late = reaction_s * decel
    return np.sqrt(late * late + 2.0 * decel * room) - late


@kernel
def room_ahead(r, most, visits, motion, people):
    """Distance from a robot's front to the nearest person in its field, inf where nobody is within `most`."""
    k = visits.next[visits.reached[r]]
    if k < 0:
        return np.inf
    lane, lanes, robots = visits.lane[k], people.lanes, people.robots
    if lanes.is_ride[lane]:
        return np.inf
    before = visits.at_m[k] - in_grains(motion.s_m[r])
    x, y = lanes.head_x[lane] - before * lanes.along_x[lane], lanes.head_y[lane] - before * lanes.along_y[lane]
    size = np.hypot(lanes.along_x[lane], lanes.along_y[lane])
    ux, uy = lanes.along_x[lane] / size, lanes.along_y[lane] / size
    if not np.isnan(robots.body_yaw[r]):
        x, y, sign = robots.body_x[r], robots.body_y[r], 1.0 - 2.0 * visits.gear[k]
        ux, uy = sign * np.cos(robots.body_yaw[r]), sign * np.sin(robots.body_yaw[r])
    front, half = robots.half_length_m[r], robots.half_width_m[r] + people.side_m
    body = people.body_m
    end, best = front + most, np.inf
    x0, y0, x1, y1 = x + front * ux, y + front * uy, x + end * ux, y + end * uy
    wide = half + body
    left, right = min(x0, x1) - wide, max(x0, x1) + wide
    low, high = min(y0, y1) - wide, max(y0, y1) + wide
    for row in range(bin_row(low, people), bin_row(high, people) + 1):
        begin = people.first[row * people.columns + bin_column(left, people)]
        last = people.first[row * people.columns + bin_column(right, people) + 1]
        for m in range(begin, last):
            p = people.member[m]
            dx, dy = people.x_m[p] - x, people.y_m[p] - y
            along, aside = dx * ux + dy * uy, abs(dy * ux - dx * uy)
            if along <= front or aside >= wide:
                continue
            over = max(aside - half, 0.0)
            best = min(best, max(along - front - np.sqrt(body * body - over * over), 0.0))
    return best


@kernel
def is_clear_around(r, visits, motion, people):
    """True if nobody is where a robot that turns in place could touch them."""
    x, y = place_of(in_grains(motion.s_m[r]), visits.reached[r], visits, people)
    robots = people.robots
    if not np.isnan(robots.body_yaw[r]):
        x, y = robots.body_x[r], robots.body_y[r]
    most = np.hypot(robots.half_length_m[r], robots.half_width_m[r]) + people.side_m + people.body_m
    for row in range(bin_row(y - most, people), bin_row(y + most, people) + 1):
        begin = people.first[row * people.columns + bin_column(x - most, people)]
        last = people.first[row * people.columns + bin_column(x + most, people) + 1]
        for m in range(begin, last):
            p = people.member[m]
            if np.hypot(people.x_m[p] - x, people.y_m[p] - y) < most:
                return False
    return True


@kernel(inline="always")
def bin_row(y, people):
    """The row of bins of a place, at the edge for those beyond."""
    return min(max(int((y - people.low_y) / people.bin_m), 0), people.rows - 1)


@kernel(inline="always")
def bin_column(x, people):
    """The column of bins of a place, at the edge for those beyond."""
    return min(max(int((x - people.low_x) / people.bin_m), 0), people.columns - 1)


@kernel(inline="always")
def place_of(s, reached, visits, people):
    """Place of a robot that has driven so far."""
    following, at_m, lane, vertex = visits.next, visits.at_m, visits.lane, visits.vertex
    k = following[reached]
    while k >= 0 and s > at_m[k] and following[k] >= 0:
        reached, k = k, following[k]
    if k < 0 or s <= at_m[reached]:  # it is at its end, or has not set out
        return people.vertex_xy[vertex[reached], 0], people.vertex_xy[vertex[reached], 1]
    before, on, lanes = at_m[k] - s, lane[k], people.lanes
    return lanes.head_x[on] - before * lanes.along_x[on], lanes.head_y[on] - before * lanes.along_y[on]


@kernel(inline="always")
def in_grains(where):
    """A distance or a speed without what an engine's rounding adds: people would never again walk as with another engine."""
    return np.rint(where * GRAINS) / GRAINS


@kernel
def see_robots(dt, driven_m, visits, motion, people, machines, trailers):
    """Places in which people see robots, as `machines`, that have driven `driven_m` [R]: those when the step is over. Headings of robots
    that turn in place are one step old. Behind them come trailers: robots that tow them [N], and their x, y, yaw [N, 3].
    """
    following, at_m, lane, robots, lanes = visits.next, visits.at_m, visits.lane, people.robots, people.lanes
    towed_by, bodies = trailers
    x, y, yaw, along_mps = machines.x_m, machines.y_m, machines.yaw_rad, machines.along_mps
    for r in range(len(driven_m)):
        reached, s, was = visits.reached[r], in_grains(driven_m[r]), in_grains(motion.s_m[r])
        x[r], y[r] = place_of(s, reached, visits, people)
        yaw[r] = motion.yaw_rad[r]
        is_vehicle = not np.isnan(robots.body_yaw[r])
        if is_vehicle:
            x[r], y[r], yaw[r] = robots.body_x[r], robots.body_y[r], robots.body_yaw[r]
        along = (s - was) / dt
        k = following[reached]
        if k >= 0:
            on = lane[k]
            if lanes.is_ride[on] and s > at_m[reached] + 1e-6:
                x[r] = np.nan
            faces = np.cos(motion.yaw_rad[r]) * lanes.along_x[on] + np.sin(motion.yaw_rad[r]) * lanes.along_y[on]
            along = along if faces >= 0.0 else -along
            if is_vehicle:
                along = (s - was) / dt * (1.0 - 2.0 * visits.gear[k])
        along_mps[r] = along
    for k in range(len(towed_by)):
        r, t = towed_by[k], len(driven_m) + k
        x[t] = np.nan if np.isnan(x[r]) else bodies[k, 0]  # in a lift with its vehicle
        y[t], yaw[t], along_mps[t] = bodies[k, 1], bodies[k, 2], along_mps[r]
