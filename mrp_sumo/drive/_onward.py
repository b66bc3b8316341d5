"""The kernel that takes steps, as long as nothing happens in them that anybody but the controller has to see."""

from mrp_sumo.drive._controller import advance
from mrp_sumo.drive._observe import is_turned
from mrp_sumo.search._bodies import lane_limits, move_bodies
from mrp_sumo.search._kernel import kernel


@kernel
def drive_on(step, most, dt, sample_every, bodies, kinematics, rules, visits, needs, state, conditions, routed, log, news, tape):
    """Let the controller see the step `step`, which bodies have just made, and go on with it for `most` more steps at most.

    Parameters
    ----------
    bodies
        See `engines.kinematic.engine.Moving`.
    tape
        See `drive.state.Tape`. What is known of grants, and what is added to it, is written there.

    Returns
    -------
    made, num_logged, num_changed, num_due, num_samples, num_grants
        Steps beyond `step`; what `advance` returned after the last of them, whose commands have not been given, and which is not on
        the tape; samples and grants on the tape.
    """
    s_m, granted, rank = bodies.s_m, visits.granted, visits.rank
    command, changed, known, on_lane = state.grants.command_mps, news.changed, tape.known, state.grants.on_lane
    made, num_samples, num_grants = 0, 0, 0
    ended = num_ended(visits, state)
    while True:
        now = round((step + made) * dt, 9)
        num_logged, num_changed, num_due = advance(
            True, now, dt, s_m, kinematics, rules, visits, needs, state, conditions, routed, log, news
        )
        if num_logged > 0 or made == most or num_ended(visits, state) != ended:
            return made, num_logged, num_changed, num_due, num_samples, num_grants
        for r in range(len(s_m)):
            may = 2 * rank[granted[r]] + on_lane[r]
            if may != known[r]:
                known[r] = may
                tape.grant_s[num_grants], tape.grant_robot[num_grants], tape.granted[num_grants] = now, r, may
                num_grants += 1
        if (step + made) % sample_every == 0:
            tape.samples[num_samples, 0] = state.motion.s_m
            tape.samples[num_samples, 1] = state.motion.yaw_rad
            tape.samples[num_samples, 2] = state.motion.speed_mps
            num_samples += 1
        for i in range(num_changed):
            bodies.wanted_mps[changed[i]] = command[changed[i]]
        if bodies.has_limits:
            of_visits = visits.next, visits.reached, visits.at_m, visits.lane
            lane_limits(dt, bodies.limit_mps, kinematics.decel_mps2, *of_visits, bodies.speed_mps, s_m, bodies.cap_mps)
        move_bodies(dt, bodies.wanted_mps, bodies.accel_mps2, kinematics.decel_mps2, bodies.cap_mps, bodies.speed_mps, s_m)
        made += 1


@kernel
def num_ended(visits, state):
    """How many robots have come to the ends of their ways, and stand there as they are to."""
    count = 0
    for r in range(len(visits.reached)):
        if visits.next[visits.reached[r]] < 0 and is_turned(state.motion.yaw_rad[r], state.facing_rad[r]):
            count += 1
    return count
