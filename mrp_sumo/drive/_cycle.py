"""The kernels of the cycle: all between two steps of an engine, and steps in which nothing happens that anybody else has to see.

Runs, retimings and virtual fleets are driven by these.
"""

from mrp_sumo.drive._facilities import note_requests, run_doors, run_lifts
from mrp_sumo.drive._grants import command, grant, release
from mrp_sumo.drive._observe import is_turned, observe
from mrp_sumo.drive._people import book_lost
from mrp_sumo.search._bodies import lane_limits, move_bodies
from mrp_sumo.search._kernel import kernel

AT_VERTEX_M = 1e-6  # beyond it by more, a robot has left a vertex


@kernel
def advance(look, now, s_m, routed, scene):
    """All between two steps of the engine: observe, run lifts and doors, grant, command.

    One call, since handing the arrays over costs more than the work for few robots.

    Parameters
    ----------
    look
        Whether a step has been made since the last call.
    now
        Simulated time, s.
    s_m
        [R] what the engine says robots have driven.
    routed
        [R] rank of the last visit that the engine knows the way to.

    Returns
    -------
    num_logged, num_changed, num_due
        Entries in the log, robots with another speed, robots whose routes end soon.
    """
    kinematics, rules, visits, needs, state, conditions, log, _ = scene
    margin, facilities, people, grants, dt = conditions.margin, conditions.facilities, conditions.people, state.grants, rules.step_s
    if look:
        observe(now, s_m, scene)
        if len(margin.steps) > 0:
            look_late(s_m, visits, margin)
            release(margin.left_m, visits, needs, grants, state.holds)
        else:
            release(s_m, visits, needs, grants, state.holds)
        if people.any:
            book_lost(dt, people)
    if facilities.any:
        note_requests(dt, kinematics, visits, needs, state, facilities)
        run_lifts(now, visits, state, facilities)
        run_doors(now, facilities)
    grant(now, scene)
    num_changed = command(now, scene)
    due, num_due = scene.notices.due, 0
    for r in range(len(s_m)):
        if visits.rank[visits.granted[r]] + grants.on_lane[r] >= routed[r]:
            due[num_due] = r
            num_due += 1
    return log.num_entries[0] if look else 0, num_changed, num_due


@kernel
def drive_on(step, most, bodies, routed, scene, tape):
    """See the step `step`, which bodies have just made, and go on with it for `most` more steps at most, while nothing happens.

    Parameters
    ----------
    bodies
        See `engines.kinematic.engine.Moving`.
    tape
        See `drive.state.Tape`. What is known of grants, and what is added to it, is written there.

    Returns
    -------
    made, num_logged, num_changed, num_due
        Steps beyond `step`; what `advance` returned after the last of them, whose commands have not been given, and which is not on
        the tape.
    """
    s_m, dt, decel, visits = bodies.s_m, scene.rules.step_s, scene.kinematics.decel_mps2, scene.visits
    changed, command_mps, made = scene.notices.changed, scene.state.grants.command_mps, 0
    while True:
        goes_on, num_logged, num_changed, num_due = watch(step + made, made == most, s_m, routed, scene, tape)
        if not goes_on:
            return made, num_logged, num_changed, num_due
        for i in range(num_changed):
            bodies.wanted_mps[changed[i]] = command_mps[changed[i]]
        if bodies.has_limits:
            lane_limits(dt, decel, visits, bodies.speed_mps, s_m, bodies.cap_mps)
        move_bodies(dt, bodies.wanted_mps, bodies.accel_mps2, decel, bodies.cap_mps, bodies.speed_mps, s_m)
        made += 1


@kernel
def watch(step, is_last, s_m, routed, scene, tape):
    """`advance` for the step `step`, which the engine has just made. It goes on the tape, and the next one may follow if nothing happens.

    Parameters
    ----------
    is_last
        Whether no other is to follow.
    tape
        See `drive.state.Tape`. What is known of grants, and what is added to it, is written there.

    Returns
    -------
    goes_on, num_logged, num_changed, num_due
        Whether the next one may follow, and what `advance` returned. The last step is not on the tape.
    """
    visits, state, dt, filled = scene.visits, scene.state, scene.rules.step_s, tape.filled
    now, ended = step * dt, num_ended(visits, state)
    if len(tape.left_s) == 0:
        now = round(now, 9)  # as everybody else knows it; the times of plans have all their digits
    else:
        depart(now - dt, s_m, visits, state.motion, tape)
    num_logged, num_changed, num_due = advance(True, now, s_m, routed, scene)
    if len(tape.left_s) > 0:
        pass_through(now, visits, tape)
    is_over = num_logged > 0 or is_last or num_ended(visits, state) != ended
    if is_over or (step % tape.look_every == 0 and has_to_look(visits, state, tape)):
        return False, num_logged, num_changed, num_due
    for r in range(len(tape.known)):
        may = 2 * visits.rank[visits.granted[r]] + state.grants.on_lane[r]
        if may != tape.known[r]:
            tape.known[r], n = may, filled[1]
            tape.grant_s[n], tape.grant_robot[n], tape.granted[n] = now, r, may
            filled[1] += 1
    if step % tape.sample_every == 0:
        for r in range(len(s_m)):
            tape.samples[filled[0], 0, r] = state.motion.s_m[r]
            tape.samples[filled[0], 1, r] = state.motion.yaw_rad[r]
            tape.samples[filled[0], 2, r] = state.motion.speed_mps[r]
        filled[0] += 1
    return True, num_logged, num_changed, num_due


@kernel
def num_ended(visits, state):
    """Number of robots that have come to the ends of their ways, and stand there as they are to."""
    count = 0
    for r in range(len(visits.reached)):
        if visits.next[visits.reached[r]] < 0 and is_turned(state.motion.yaw_rad[r], state.facing_rad[r]):
            count += 1
    return count


@kernel
def has_to_look(visits, state, tape):
    """True if somebody waits for another robot, stands or gets on though it should not, or has come farther than it may unseen."""
    waits, motion = state.waits, state.motion
    for r in range(len(tape.rests)):
        if waits.waiting[r] or waits.stuck[r] or (tape.watched[r] >= 0 and visits.reached[r] != tape.watched[r]):
            return True
        gets_on = motion.speed_mps[r] > 0.0 or motion.turning[r]
        if tape.held[r] if gets_on else not (tape.rests[r] or tape.held[r]):
            return True
    return False


@kernel
def look_late(s_m, visits, margin):
    """Positions of robots at the last step that is as long ago as what they had left then has to stay theirs."""
    past_m, past_steps, num_past = margin.past_m, margin.past_steps, len(margin.past_m)
    margin.step[0] += 1
    step = margin.step[0]
    for r in range(len(s_m)):
        past_m[step % num_past, r] = s_m[r]
        past_steps[step % num_past, r] = margin.steps[visits.rank[visits.reached[r]]]
        k = margin.seen[r]
        while k < step and k + 1 + past_steps[(k + 1) % num_past, r] <= step:
            k += 1
        margin.seen[r] = k
        margin.left_m[r] = past_m[k % num_past, r]


@kernel
def depart(began, s_m, visits, motion, tape):
    """Departures of robots that stood on a vertex and set out in the step that began at `began`, before it is observed."""
    for r in range(len(s_m)):
        m = visits.reached[r]
        tape.before[0, r], tape.before[1, r] = m, visits.granted[r]
        if s_m[r] > motion.s_m[r] and motion.speed_mps[r] == 0.0 and motion.s_m[r] <= visits.at_m[m] + AT_VERTEX_M:
            tape.left_s[m] = began


@kernel
def pass_through(now, visits, tape):
    """Visits that were made in this step are left at once, unless the robot stops there: then at the end of the step, or later."""
    for r in range(len(visits.reached)):
        k = tape.before[0, r]
        while k != visits.reached[r]:
            k = visits.next[k]
            tape.left_s[k] = visits.arrived_s[k]
        if k != tape.before[0, r] and k == tape.before[1, r]:
            tape.left_s[k] = now
