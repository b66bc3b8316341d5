"""The co-simulation: a plan driven in SUMO, step by step, under a policy.

Each step: see what robots did, let them claim what they need next, command speeds, let SUMO move. Refuses plans
and robots that cannot be driven (`drive.fit`) before the first step. Robots at their goals stay there as
obstacles; nothing is ever teleported. Same input, same trajectory, bit for bit.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mrp_sumo.core.execution import Event, Execution, Outcome
from mrp_sumo.core.graph import FloatArray, frozen
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive import _controller
from mrp_sumo.drive.change import Change, changed_course
from mrp_sumo.drive.deadlock import LOOK_EVERY_S, DeadlockWatch, deadlock_event, events_of, waits_at_the_end
from mrp_sumo.drive.disturber import Disturber
from mrp_sumo.drive.localisation import believed_poses
from mrp_sumo.drive.motion_plan import Course, course_of, empty_log, empty_news, fresh_state
from mrp_sumo.drive.policy import Policy, policy_of
from mrp_sumo.drive.recorder import Recorder
from mrp_sumo.drive.recovery import Recovery
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.engines.sumo.routes import Routes
from mrp_sumo.engines.sumo.session import Sumo, running_sumo, type_of
from mrp_sumo.errors import PlanError

A_CELL_LESS_M = 0.01  # robots stop a millimetre before a vertex: what they drive to the next is a cell all the same
WAIT_LEAST_S = 0.5  # shorter waits are booked, but are no events
COMPARE_EVERY_S = 10.0  # SUMO's own positions are kept this often for the audit, and at the end
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
        Policy, clock, recording, disturbances.
    network
        The SUMO network of `problem.graph` (`engines.sumo.network.build_network`).
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
    policy, fleet, dt = policy_of(settings.policy, settings.policy_parameters), problem.fleet, settings.step_length_s
    course = course_of(problem, plan, policy, dt)
    disturber = Disturber(
        settings.disturbances, problem.graph, problem.num_robots, dt, problem.step_s, float(fleet.radius_m.max()), settings.seed
    )
    with running_sumo(network, fleet, fleet.separation_m, dt, settings.seed, gui) as sumo:
        routes = Routes(problem.graph, course.path, sumo, fresh_state(course))
        routes.begin(type_of(fleet), float(fleet.max_speed_mps.max()))
        run = _Run(problem, plan, settings, policy, course, routes, sumo, disturber, Recorder(problem.graph.xy[plan.vertex], course.path))
        run.drive(progress)
    return run.execution()


@dataclass
class _Run:
    """An execution under way."""

    problem: Problem
    plan: Plan
    settings: ExecutionSettings
    policy: Policy
    course: Course  # of the plan, or of the last new one
    routes: Routes
    sumo: Sumo
    disturber: Disturber
    recorder: Recorder

    def __post_init__(self) -> None:
        self.state = self.routes.state
        self.names = self.problem.fleet.robot_name
        self.labels = [self.problem.graph.label(v) for v in range(self.problem.graph.num_vertices)]
        self.events: list[Event] = []
        self.findings: list[str] = []
        self.watch = DeadlockWatch()
        self.outcome = Outcome.TIME_LIMIT
        self.now = 0.0
        self.sumo_s: list[float] = []  # when SUMO was asked where it has the robots
        self.sumo_xy: list[FloatArray] = []  # [R, 2] each
        self.recovery = Recovery(self.problem, self.settings, self.disturber) if self.settings.on_deadlock == "resolve" else None
        self.visit = np.arange(self.plan.num_visits)  # [N] of the plan, for each visit of the course, -1: none
        self.arrived = np.full(self.plan.num_visits, np.nan)  # [N] of the plan's visits, before the course was changed

    def drive(self, progress: Progress | None) -> None:
        """Until all robots are at the ends of their paths, or time is up."""
        settings, dt, state, sumo = self.settings, self.settings.step_length_s, self.state, self.sumo
        num_robots = self.problem.num_robots
        log, news = empty_log(num_robots), empty_news(num_robots)
        tolerances = (self.problem.graph.cell_m - A_CELL_LESS_M, settings.blocking_window_s, settings.goal_tolerance_m, WAIT_LEAST_S)
        look_every, tell_every = max(1, round(LOOK_EVERY_S / dt)), max(1, round(1 / dt))
        disturbed, step, s = settings.disturbances.any, 0, np.zeros(num_robots)
        around = self.disturber.around

        def advance(look: bool) -> tuple[int, int, int]:
            course = self.course
            counts: tuple[int, int, int] = _controller.advance(
                *(look, self.now, dt, s, course.drive, course.path, course.need, self.state, log, news, around, *tolerances),
                *(self.policy.look_ahead, self.policy.paced),
            )
            return counts

        wall, cpu = time.perf_counter(), time.process_time()
        while True:
            if disturbed:
                self.events += self.disturber.happen(self.now, state)
            logged, changed, due = advance(step > 0)
            if logged:
                self.events += events_of(log, logged, self.course.path, self.names)
            if step % settings.steps_per_sample == 0:
                self.recorder.sample(s, state.yaw, state.speed)
                over = self._is_over()
                if over or self.now >= len(self.sumo_s) * COMPARE_EVERY_S:
                    self.sumo_s.append(self.now)
                    self.sumo_xy.append(sumo.positions())
                if over:
                    break
            if step % look_every == 0 and self._look_for_deadlocks():
                state, s = self.state, self.state.s.copy()
                _, changed, due = advance(False)
            if progress and step and step % tell_every == 0:
                progress(self.now, int(np.isfinite(state.goal).sum()))
            for r in news.changed[:changed].tolist():
                sumo.set_speed(sumo.names[r], state.command[r])
            if due:
                self.routes.renew(news.due[:due].tolist())
            sumo.step()
            step += 1
            self.now = round(step * dt, 9)
            sumo.read_driven(s, (state.command > 0) | (state.speed > 0))
            self.findings += [f"{self.now:.2f} s: SUMO reports a {kind} of {one} and {two}" for one, two, kind in sumo.collisions()]
        self.wall_s, self.cpu_s = time.perf_counter() - wall, time.process_time() - cpu
        if self.recovery:
            self.recovery.end(self.now)
            self.events += self.recovery.events
        self.events += waits_at_the_end(self.now, state, self.course.path, self.names, WAIT_LEAST_S)

    def _is_over(self) -> bool:
        if self.outcome is Outcome.DEADLOCK:
            return True
        if (self.state.nx >= self.course.path.first[1:]).all() and self.state.home.all():
            self.outcome = Outcome.COMPLETED
            return True
        return self.now >= self.settings.time_limit_s - 1e-9

    def _look_for_deadlocks(self) -> bool:
        """Tell new deadlocks, and do about robots that do not get on what the settings say. Whether the course was changed."""
        found = self.watch.look(self.state)
        self.events += [deadlock_event(self.now, cycle, self.state, self.course.path, self.labels, self.names) for cycle in found]
        if found and self.settings.on_deadlock == "stop":
            self.outcome = Outcome.DEADLOCK
        if self.recovery is None:
            return False
        self.recovery.let_go(self.now, self.course, self.state)
        return self.recovery.look(self.now, self.watch.known, self.course, self.state, self.policy.keeps_order, self._change)

    def _change(self, change: Change, anew: bool) -> None:
        """Send robots other ways. A new plan is driven in its order if that can be kept: it is for who is where now,
        not for the clock.
        """
        before, path, graph = self.state, self.course.path, self.problem.graph
        policies = [self.policy]
        if anew:
            policies = [policy_of("adg")] if policy_of(self.settings.policy).sound_plan_only else [policy_of("adg"), policy_of("open_loop")]
        for policy in policies:
            try:
                course, state, was = changed_course(
                    self.problem, self.course, before, change, policy, self.settings.step_length_s, self.now
                )
                break
            except PlanError:
                if policy is policies[-1]:
                    raise
        self.events += waits_at_the_end(self.now, before, path, self.names, WAIT_LEAST_S, list(change.way))
        turned = [r for r, way in change.way.items() if way.back]
        offset = before.s - state.s
        offset[turned] = np.nan
        known = np.flatnonzero((self.visit >= 0) & np.isfinite(before.arrived))
        self.arrived[self.visit[known]] = before.arrived[known]
        self.visit = np.where(was >= 0, self.visit[was], -1)
        self.policy, self.course, self.state = policy, course, state
        self.sumo.rebase(state.s)
        self.recorder.turn_to(graph.xy[course.path.vertex], course.path)
        self.disturber.count_from(offset, state.allowed)
        self.routes.change(course.path, state)
        for r in turned:
            self.routes.turn_back(r)
        self.watch.known = {ring for ring in self.watch.known if not set(ring) & set(change.way)}

    def execution(self) -> Execution:
        """All that was recorded."""
        x, y, yaw, speed = self.recorder.samples()
        state, settings = self.state, self.settings
        yaw = (yaw + np.pi) % (2 * np.pi) - np.pi
        what, believed = settings.disturbances, None
        if what.localisation_m or what.localisation_rad:
            believed = frozen(believed_poses(x, y, yaw, settings.record_period_s, what, settings.seed))
        goal, arrived = np.where(self.course.plan.last_vertex == self.problem.target, state.goal, np.nan), self.arrived
        known = np.flatnonzero((self.visit >= 0) & np.isfinite(state.arrived))
        arrived[self.visit[known]] = state.arrived[known]
        ends = self.plan.first[1:] - 1  # where a way was given up, robots still reach the ends
        arrived[ends] = np.where(np.isfinite(arrived[ends]), arrived[ends], goal)
        return Execution(
            t_s=frozen(np.round(np.arange(len(x)) * settings.steps_per_sample * settings.step_length_s, 9)),
            x_m=frozen(x),
            y_m=frozen(y),
            yaw_rad=frozen(yaw),
            speed_mps=frozen(speed),
            arrived_s=frozen(arrived),
            goal_s=frozen(goal),
            outcome=self.outcome,
            policy=settings.policy,
            sim_time_s=self.now,
            wall_time_s=self.wall_s,
            cpu_time_s=self.cpu_s,
            events=tuple(sorted(self.events, key=lambda event: (event.t_s, event.robot, event.kind))),
            findings=tuple(self.findings),
            booked_s=frozen(state.booked),
            believed=believed,
            sumo_t_s=frozen(np.array(self.sumo_s)),
            sumo_xy_m=frozen(np.array(self.sumo_xy)),
        )
