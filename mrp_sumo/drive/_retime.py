"""The kernel of `drive.retime`: the controller drives bodies through a plan, undisturbed, and only the times are kept."""

import numpy as np

from mrp_sumo.drive._causes import FACILITY, PLANNED
from mrp_sumo.drive._controller import command, grant
from mrp_sumo.drive._facilities import run_facilities
from mrp_sumo.drive._observe import arrive, is_turned, move, release
from mrp_sumo.search._arrays import write_over
from mrp_sumo.search._bodies import lane_limits, move_bodies
from mrp_sumo.search._kernel import kernel

AT_VERTEX_M = 1e-6  # beyond it by more, a robot has left a vertex


@kernel
def drive_out(dt, most_steps, lag, accel, limit_mps, kinematics, rules, visits, needs, state, conditions, log, news, left_s):
    """Drive until everybody has made its last visit, and stands there as it is to. Writes `visits.arrived_s`, the departures `left_s`
    [N], and `state.waits.goal_s`.

    Parameters
    ----------
    dt
        Step length, s.
    most_steps
        After which it gives up.
    lag
        [K] steps by which what a robot has left is free later than that, after 0, 1, ... visits. They never decrease.
    accel
        [R] m/s2.
    limit_mps
        [L] of lanes.

    Returns
    -------
    steps
        How many it took; -1 when nobody can go on, or not within `most_steps`.
    """
    # arrays are taken out of their tuples once: numba counts references each time
    motion, grants, facilities = state.motion, state.grants, conditions.facilities
    facing, yaw = state.facing_rad, motion.yaw_rad
    reached, following = visits.reached, visits.next
    commanded, cause, turning, speed = grants.command_mps, grants.cause, motion.turning, motion.speed_mps
    num_robots = len(accel)
    s_m, velocity, was_mps, cap = motion.s_m.copy(), np.zeros(num_robots), np.zeros(num_robots), np.full(num_robots, np.inf)
    has_limits = np.min(limit_mps) < np.inf
    most_lag, rank, before, left_m = lag[-1], visits.rank, reached.copy(), np.zeros(num_robots)
    past_m, past_lag = np.zeros((most_lag + 1, num_robots)), np.zeros((most_lag + 1, num_robots), np.int64)
    seen = np.zeros(num_robots, np.int64)
    idle = 0  # steps in which nobody could do anything
    for step in range(most_steps):
        now = step * dt
        if step > 0:
            write_over(was_mps, speed)
            move(dt, s_m, kinematics, visits, facing, conditions.people.halted, motion)
            depart(now - dt, motion.s_m, motion.moved_m, was_mps, visits, left_s)
            write_over(before, reached)
            arrive(now, dt, s_m, visits, state, log, 0)
            pass_through(now, before, visits, left_s)
            look_late(step, s_m, rank, reached, lag, past_m, past_lag, seen, left_m)
            release(left_m, visits, needs, grants)
            write_over(motion.s_m, s_m)
        if facilities.any:
            run_facilities(now, dt, kinematics, visits, needs, state, facilities)
        grant(now, kinematics, rules, visits, needs, state, conditions.closed, facilities.shut)
        command(now, dt, kinematics, rules, visits, state, conditions, news.changed)
        finished, stuck = True, True
        for r in range(num_robots):
            if following[reached[r]] >= 0 or not is_turned(yaw[r], facing[r]):
                finished = False
                if commanded[r] > 0.0 or turning[r] or cause[r] == PLANNED or cause[r] == FACILITY or speed[r] > 0.0:
                    stuck = False
        if finished:
            return step
        idle = idle + 1 if stuck else 0
        if idle > most_lag + 2:
            return -1
        if has_limits:
            lane_limits(dt, limit_mps, kinematics.decel_mps2, following, reached, visits.at_m, visits.lane, velocity, s_m, cap)
        move_bodies(dt, commanded, accel, kinematics.decel_mps2, cap, velocity, s_m)
    return -1


@kernel
def look_late(step, s_m, rank, reached, lag, past_m, past_lag, seen, left_m):
    """Where robots were at the last step `seen` [R] that is as long ago as what they had left then has to stay theirs.

    `past_m` and `past_lag` [K, R] are rings of the last steps.
    """
    num_past = len(past_m)
    for r in range(len(s_m)):
        past_m[step % num_past, r] = s_m[r]
        past_lag[step % num_past, r] = lag[rank[reached[r]]]
        k = seen[r]
        while k < step and k + 1 + past_lag[(k + 1) % num_past, r] <= step:
            k += 1
        seen[r] = k
        left_m[r] = past_m[k % num_past, r]


@kernel(inline="always")
def depart(began, was_m, moved_m, was_mps, visits, left_s):
    """Who stood on a vertex and set out in the step that began at `began`."""
    for r in range(len(was_m)):
        m = visits.reached[r]
        if moved_m[r] > 0.0 and was_mps[r] == 0.0 and was_m[r] <= visits.at_m[m] + AT_VERTEX_M:
            left_s[m] = began


@kernel(inline="always")
def pass_through(now, before, visits, left_s):
    """Visits that were made in this step are left at once, unless the robot stops there: then at the end of the step, or later."""
    for r in range(len(before)):
        k = before[r]
        while k != visits.reached[r]:
            k = visits.next[k]
            left_s[k] = visits.arrived_s[k]
        if k != before[r] and k == visits.granted[r]:
            left_s[k] = now
