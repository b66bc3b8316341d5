"""The co-simulation: a plan driven in SUMO, step by step, under a policy.

Each step: see what robots did, let them claim what they need next, command speeds, let SUMO move. Refuses plans
and robots that cannot be driven (`sim.course`) before the first step. Robots at their goals stay there as
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
from mrp_sumo.errors import PlanError
from mrp_sumo.sim import _control
from mrp_sumo.sim.blocking import LOOK_EVERY_S, DeadlockWatch, deadlock_event, events_of, waits_at_the_end
from mrp_sumo.sim.course import Course, continued, course_of, empty_log, empty_news, fresh_state
from mrp_sumo.sim.disturber import Disturber
from mrp_sumo.sim.localisation import believed_poses
from mrp_sumo.sim.policy import Policy, policy_of
from mrp_sumo.sim.recorder import Recorder
from mrp_sumo.sim.recovery import plan_from
from mrp_sumo.sim.routes import Routes
from mrp_sumo.sim.settings import ExecutionSettings
from mrp_sumo.sim.sumo import Sumo, running_sumo, type_of

A_CELL_LESS_M = 0.01  # robots stop a millimetre before a vertex: what they drive to the next is a cell all the same
WAIT_LEAST_S = 0.5  # shorter waits are booked, but are no events
COMPARE_EVERY_S = 10.0  # SUMO's own positions are kept this often for the audit, and at the end
QUIET_WITHIN_S = 30.0  # in which all robots must come to stand at vertices for a new plan
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
    policy, fleet, dt = policy_of(settings.policy), problem.fleet, settings.step_length_s
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
        self.quiet_since = np.inf  # since when robots stop for a new plan, inf: they do not
        self.given_up = self.settings.on_deadlock != "resolve"
        self.first_arrived: FloatArray | None = None  # [N] of the plan's visits, once there is a new plan

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
            course, stopping = self.course, self.quiet_since < np.inf
            counts: tuple[int, int, int] = _control.advance(
                *(look, self.now, dt, s, course.drive, course.path, course.need, self.state, log, news, around, *tolerances),
                *(0 if stopping else self.policy.look_ahead, self.policy.paced, stopping),
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
            if step % look_every == 0:
                self._look_for_deadlocks()
            if self.quiet_since < np.inf and self._renew_plan():
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
        self.events += waits_at_the_end(self.now, state, self.course.path, self.names, WAIT_LEAST_S)

    def _is_over(self) -> bool:
        if self.outcome is Outcome.DEADLOCK:
            return True
        if (self.state.nx >= self.course.path.first[1:]).all():
            self.outcome = Outcome.COMPLETED
            return True
        return self.now >= self.settings.time_limit_s - 1e-9

    def _look_for_deadlocks(self) -> None:
        """Tell new deadlocks, and do about deadlocks and long blockings what the settings say."""
        found = self.watch.look(self.state)
        self.events += [deadlock_event(self.now, cycle, self.state, self.course.path, self.labels, self.names) for cycle in found]
        if found and self.settings.on_deadlock == "stop":
            self.outcome = Outcome.DEADLOCK
        if self.given_up or self.quiet_since < np.inf:
            return
        stuck = self.state.stuck & (self.now - self.state.mark_t >= self.settings.patience_s)
        if self.watch.known or stuck.any():
            self.quiet_since = self.now

    def _renew_plan(self) -> bool:
        """Once all robots stand at vertices, plan anew and go on from there. Gives up when that does not work."""
        state, path = self.state, self.course.path
        done = (state.nx == state.won + 1) & ~state.on_lane
        held = self.disturber.hold_until > self.now  # they drive none of what they have claimed
        at_vertex = (done | held) & (state.speed == 0) & (np.abs(state.s - path.at[state.nx - 1]) <= _control.ARRIVED_M)
        waited = self.now - self.quiet_since
        if not at_vertex.all() and waited < QUIET_WITHIN_S:
            return False
        why = ""
        if at_vertex.all():
            try:
                problem, plan = plan_from(self.problem, path.vertex[state.nx - 1], self.disturber.broken, self.settings.replanner)
                course = self._course(problem, plan)
            except PlanError as error:
                why = str(error)
        else:
            why = f"{self.names[int(np.flatnonzero(~at_vertex)[0])]} does not come to stand at a vertex"
        begun, self.quiet_since = self.quiet_since, np.inf
        if why:
            self.given_up = True
            self.events.append(Event(begun, "unresolved", -1, duration_s=round(waited, 9), text=why))
            return False
        text = f"all robots stopped and {self.settings.replanner} planned anew"
        self.events.append(Event(begun, "resolved", -1, duration_s=round(waited, 9), text=text))
        if self.first_arrived is None:
            self.first_arrived = state.arrived
        self.state = continued(course, state, path, self.now)
        self.sumo.rebase(self.state.s)
        self.recorder.turn_to(self.problem.graph.xy[plan.vertex], course.path)
        self.disturber.forget_messages(self.state.allowed)
        self.watch.known.clear()
        self.course, self.routes = course, self.routes.renewed(course.path, self.state)
        return True

    def _course(self, problem: Problem, plan: Plan) -> Course:
        """A new plan is driven in its order if that can be kept: it is for who stands where now, not for the clock."""
        try:
            self.policy = policy_of("adg")
            return course_of(problem, plan, self.policy, self.settings.step_length_s, self.now)
        except PlanError:
            if policy_of(self.settings.policy).sound_plan_only:
                raise
            self.policy = policy_of("open_loop")
            return course_of(problem, plan, self.policy, self.settings.step_length_s, self.now)

    def execution(self) -> Execution:
        """All that was recorded."""
        x, y, yaw, speed = self.recorder.samples()
        path, state, settings = self.course.path, self.state, self.settings
        yaw = (yaw + np.pi) % (2 * np.pi) - np.pi
        what, believed = settings.disturbances, None
        if what.localisation_m or what.localisation_rad:
            believed = frozen(believed_poses(x, y, yaw, settings.record_period_s, what, settings.seed))
        ends = path.vertex[path.first[1:] - 1]
        goal = np.where(ends == self.problem.target, state.goal, np.nan)
        arrived = state.arrived
        if self.first_arrived is not None:  # of a plan that was given up, robots still reach the ends
            arrived = self.first_arrived
            arrived[self.plan.first[1:] - 1] = goal
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
