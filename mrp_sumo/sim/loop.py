"""The co-simulation: a plan driven in SUMO, step by step, under a policy.

Each step: let robots claim what they need next, command speeds, let SUMO move, look where everybody is. Refuses
plans and robots that cannot be driven (`sim.course`) before the first step. Robots at their goals stay there as
obstacles; nothing is ever teleported. Same input, same trajectory, bit for bit.
"""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from mrp_sumo.core.execution import Execution, Outcome
from mrp_sumo.core.graph import frozen
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.sim import _control
from mrp_sumo.sim.blocking import LOOK_EVERY_S, DeadlockWatch, deadlock_event, events_of, waits_at_the_end
from mrp_sumo.sim.course import Course, course_of, fresh_state
from mrp_sumo.sim.policy import policy_of
from mrp_sumo.sim.recorder import Recorder, positions_m
from mrp_sumo.sim.routes import insert
from mrp_sumo.sim.settings import ExecutionSettings
from mrp_sumo.sim.sumo import Sumo, running_sumo, type_of

A_CELL_LESS_M = 0.01  # robots stop a millimetre before a vertex: what they drive to the next is a cell all the same
WAIT_LEAST_S = 0.5  # shorter waits are booked, but are no events
Progress = Callable[[float, int], None]


def simulate(
    problem: Problem, plan: Plan, settings: ExecutionSettings, network: Path, *, progress: Progress | None = None, gui: bool = False
) -> Execution:
    """Drive a plan.

    Parameters
    ----------
    problem
        What the plan is for.
    settings
        Policy, clock and recording.
    network
        The SUMO network of `problem.graph` (`maps.sumo.build_network`).
    progress
        Called about once a simulated second with the time in s and the number of robots at their goals.
    gui
        Show it in sumo-gui; everything else is the same.

    Raises
    ------
    ExecutionError
        When it cannot be driven, and when SUMO fails.
    PlanError
        When the policy keeps the plan's order and that is cyclic.
    """
    course = course_of(problem, plan, policy_of(settings.policy), settings.step_length_s)
    with running_sumo(network, problem.fleet, problem.fleet.separation_m, settings.step_length_s, settings.seed, gui) as sumo:
        return drive(problem, plan, settings, course, sumo, progress)


def drive(problem: Problem, plan: Plan, settings: ExecutionSettings, course: Course, sumo: Sumo, progress: Progress | None) -> Execution:
    """The loop itself, on a running SUMO."""
    policy, dt, path, names = policy_of(settings.policy), settings.step_length_s, course.path, problem.fleet.robot_name
    num_robots, state = course.num_robots, fresh_state(course)
    routes = insert(problem.graph, path, state, sumo, type_of(problem.fleet), float(problem.fleet.max_speed_mps.max()))
    labels = [problem.graph.label(v) for v in range(problem.graph.num_vertices)]
    recorder, watch, findings = Recorder(num_robots), DeadlockWatch(), []
    log, news = _empty_log(num_robots), _control.News(np.zeros(num_robots, np.int64), np.zeros(num_robots, np.int64))
    factor, hold_until = np.ones(num_robots), np.zeros(num_robots)
    tolerances = (problem.graph.cell_m - A_CELL_LESS_M, settings.blocking_window_s, settings.goal_tolerance_m, WAIT_LEAST_S)
    look_every, tell_every = max(1, round(LOOK_EVERY_S / dt)), max(1, round(1 / dt))
    outcome = Outcome.TIME_LIMIT
    step, now, s = 0, 0.0, np.zeros(num_robots)
    wall, cpu = time.perf_counter(), time.process_time()
    while True:
        logged, changed, due = _control.advance(
            *(now, dt, s, course.drive, path, course.need, state, log, news, factor, hold_until, *tolerances),
            *(policy.look_ahead, policy.paced),
        )
        if logged:
            recorder.events += events_of(log, logged, path, names)
        if step % look_every == 0:
            recorder.events += [deadlock_event(now, cycle, state, path, labels, names) for cycle in watch.look(state)]
        if progress and step and step % tell_every == 0:
            progress(now, int(np.isfinite(state.goal).sum()))
        if step % settings.steps_per_sample == 0:
            recorder.sample(s, state.yaw, state.speed)
            if (state.nx >= path.first[1:]).all():
                outcome = Outcome.COMPLETED
                break
            if now >= settings.time_limit_s - 1e-9:
                break
        for r in news.changed[:changed].tolist():
            sumo.set_speed(sumo.names[r], state.command[r])
        if due:
            routes.renew(news.due[:due].tolist())
        sumo.step()
        step += 1
        now = round(step * dt, 9)
        sumo.read_driven(s, (state.command > 0) | (state.speed > 0))
        findings += [f"{now:.2f} s: SUMO reports a {kind} of {one} and {two}" for one, two, kind in sumo.collisions()]
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    recorder.events += waits_at_the_end(now, state, path, names, WAIT_LEAST_S)
    return _execution(problem, plan, settings, course, state, recorder, outcome, (now, wall, cpu), findings)


def _execution(
    problem: Problem,
    plan: Plan,
    settings: ExecutionSettings,
    course: Course,
    state: _control.State,
    recorder: Recorder,
    outcome: Outcome,
    clocks: tuple[float, float, float],
    findings: list[str],
) -> Execution:
    s, yaw, speed = recorder.samples()
    x, y = positions_m(s, plan.first, course.path.at, problem.graph.xy[plan.vertex])
    goal = np.where(plan.last_vertex == problem.target, state.goal, np.nan)
    events = sorted(recorder.events, key=lambda event: (event.t_s, event.robot, event.kind))
    return Execution(
        t_s=frozen(np.round(np.arange(len(s)) * settings.steps_per_sample * settings.step_length_s, 9)),
        x_m=frozen(x),
        y_m=frozen(y),
        yaw_rad=frozen((yaw + np.pi) % (2 * np.pi) - np.pi),
        speed_mps=frozen(speed),
        arrived_s=frozen(state.arrived),
        goal_s=frozen(goal),
        outcome=outcome,
        policy=settings.policy,
        sim_time_s=clocks[0],
        wall_time_s=clocks[1],
        cpu_time_s=clocks[2],
        events=tuple(events),
        findings=tuple(findings),
        booked_s=frozen(state.booked),
    )


def _empty_log(num_robots: int) -> _control.Log:
    room = 4 * num_robots  # at most a blocking, a wait, a departure and an arrival a robot and step
    whole = [np.zeros(room, np.int64) for _ in range(5)]
    return _control.Log(*whole, np.zeros(room), np.zeros(room))
