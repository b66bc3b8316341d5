"""The co-simulation: a plan driven in SUMO, or another engine, step by step, under a policy.

Tasks go in, commitments come out: the ledger keeps what robots have been given, the controller grants what it allows, the
engine moves the bodies, the dispatcher sends robots other ways where they do not get on, listeners write and show. Refuses plans
and robots that cannot be driven (`drive.fit`) before the first step. Robots at their goals stay there as
obstacles; nothing is ever teleported. Same input, same trajectory, bit for bit.
"""

import math
import time
from collections.abc import Sequence
from contextlib import AbstractContextManager, closing, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

import numpy as np

from mrp_sumo.core.execution import Event, Execution, Outcome
from mrp_sumo.core.fleet import with_loads
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, frozen
from mrp_sumo.core.plan import Plan, as_planned_in_steps
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.request import Request
from mrp_sumo.core.task import Task
from mrp_sumo.drive.arrivals import with_goals_within
from mrp_sumo.drive.batteries import Batteries
from mrp_sumo.drive.controller import Controller
from mrp_sumo.drive.crew import Crew
from mrp_sumo.drive.cycle import DriveCycle
from mrp_sumo.drive.deadlock import LOOK_EVERY_S
from mrp_sumo.drive.dispatcher import Dispatcher, OneShot, dispatcher_of
from mrp_sumo.drive.facilities import FacilityRecorder, facilities_of
from mrp_sumo.drive.fit import resources_for
from mrp_sumo.drive.ledger import Ledger, planned_arrivals, replies_of
from mrp_sumo.drive.listeners import EventLog, GrantRecorder, Listener, Moment, Recorder, Witness
from mrp_sumo.drive.localisation import believed_poses
from mrp_sumo.drive.motion_plan import lanes_along
from mrp_sumo.drive.people import Bystanders, PeopleInGui, PeopleRecorder
from mrp_sumo.drive.policy import DecidingPolicy, Policy, policy_of
from mrp_sumo.drive.recovery import Recovery
from mrp_sumo.drive.reroute import Replan, first_of
from mrp_sumo.drive.robot_work import Change, state_log, stop_log
from mrp_sumo.drive.rolling import Rolling, steps_ahead
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.drive.stalling import STALLED_S
from mrp_sumo.drive.state import NEVER, Tape, tape_for
from mrp_sumo.drive.surroundings import Surroundings
from mrp_sumo.drive.wear import Wear
from mrp_sumo.drive.work import Work
from mrp_sumo.drive.work_request import WorkRequest, still_fits
from mrp_sumo.drive.world import World
from mrp_sumo.engines.kinematic.engine import KinematicEngine
from mrp_sumo.engines.protocol import Engine
from mrp_sumo.engines.sumo.engine import sumo_engine
from mrp_sumo.errors import PlanError, PlugInError


def simulate(
    problem: Problem,
    plan: Plan,
    settings: ExecutionSettings,
    network: Path,
    *,
    listeners: Sequence[Listener] = (),
    gui: bool = False,
    engine: AbstractContextManager[Engine] | None = None,
) -> Execution:
    """Drive a plan on the SUMO network of its graph (`engines.sumo.network.build_network`).

    Listeners watch it beside those that record, and may step in or end it. `gui` shows it in sumo-gui, whatever the engine; everything else
    is the same. `engine` moves the bodies instead of that of the settings. Raises ExecutionError when the plan cannot be driven, and when
    SUMO fails, and PlanError when the policy keeps the plan's order and that is cyclic.
    """
    policy = policy_of(settings.policy, settings.policy_parameters)
    ledger = Ledger(problem, resources_for(problem, plan))
    bystanders = Bystanders(settings, problem)
    world = World(problem, settings, facilities_of(problem.graph, ledger.resources), bystanders.seen)
    work = dispatcher_of(settings.dispatcher, settings.dispatcher_parameters)
    # a plan in steps lets robots be early, one with the times of real motion does not
    controller = Controller(ledger, policy, settings, paced=as_planned_in_steps(plan, problem.step_s) is plan)
    recovery = Recovery(ledger, world, settings)
    drive = Drive(settings, ledger, world, controller, work, recovery, policy, plan, bystanders, listeners)
    drive.set_out()
    only_first = type(work) is OneShot and settings.on_deadlock != "resolve"  # nobody is ever sent another way
    ways = (plan.vertex, lanes_along(problem.graph, plan)[0]) if only_first else None
    with closing(Records(problem, world, bystanders)) as records:
        with engine or _engine(problem, settings, network, gui, ways) as bodies:
            bodies.place(ledger.visits)
            shown = [PeopleInGui(bystanders.crowd)] if gui and bystanders.crowd is not None else []
            alone = records.few and not (gui or engine)
            alone = alone and all(listener.is_patient for listener in listeners)
            drive.run(DriveCycle(world, controller, bodies, bystanders), records, [*listeners, *shown], alone=alone)
        return _execution(drive, plan, records)


def _engine(
    problem: Problem, settings: ExecutionSettings, network: Path, gui: bool, ways: tuple[IntArray, IntArray] | None
) -> AbstractContextManager[Engine]:
    if settings.engine == "kinematic" and not gui:
        return nullcontext(KinematicEngine(problem.graph, problem.fleet, settings.step_length_s))
    return sumo_engine(problem.graph, problem.fleet, network, settings.step_length_s, settings.seed, gui, ways=ways)


class Records:
    """Records of an execution."""

    def __init__(self, problem: Problem, world: World, people: Bystanders) -> None:
        self.events, self.witness, self.grants = EventLog(), Witness(), GrantRecorder(problem.num_robots)
        self.samples = Recorder(problem.fleet, levels=bool(problem.graph.is_ride.any()))
        self.facilities = FacilityRecorder(problem.graph, world.facilities) if world.facilities.any else None
        self.people = PeopleRecorder(people) if people.any else None

    @property
    def few(self) -> bool:
        """True if nothing is kept of what changes in steps in which nothing happens to robots."""
        return self.facilities is None and self.people is None

    @property
    def listeners(self) -> list[Listener]:
        """Those who keep it."""
        always: list[Listener] = [self.events, self.samples, self.witness, self.grants]
        return always + [each for each in (self.facilities, self.people) if each is not None]

    def close(self) -> None:
        """Let go of files."""
        self.samples.close()


@dataclass
class Drive:
    """An execution under way."""

    settings: ExecutionSettings
    ledger: Ledger
    world: World
    controller: Controller
    work: Dispatcher
    recovery: Recovery
    chosen: Policy  # of the scenario; a new plan may be driven by another
    first: Plan
    people: Bystanders
    listeners: Sequence[Listener] = ()  # who may step in or end it
    events: list[Event] = field(default_factory=list)  # since the last moment that listeners heard of
    findings: list[str] = field(default_factory=list)  # what the engine finds wrong
    outcome: Outcome = Outcome.TIME_LIMIT
    cycle: DriveCycle = field(init=False)
    wall_s: float = 0.0
    cpu_s: float = 0.0

    def __post_init__(self) -> None:
        settings = self.settings
        self.crew = Crew(self.ledger, settings, steps_ahead(settings, self.ledger.problem))
        self.tasks = Work(self.crew)
        self.batteries: Batteries | None = None
        fleet = self.ledger.problem.fleet
        if settings.tasks and fleet.batteries:
            period_s = settings.steps_per_sample * settings.step_length_s
            self.batteries = Batteries(fleet, settings.start_level, settings.seed, period_s, settings.charging)
            self._most_per_s = self.batteries.most_per_s()
        self.wear = Wear([fleet.types[k] for k in fleet.kind.tolist()] if fleet.types else (), settings.seed)
        self.context = Surroundings(self.ledger, self.world, self.tasks, self._plan)
        self.rolling = Rolling(self.settings, self.context, self.work, self.controller)
        self._loads = [(0.0, self.crew.loads)]  # [R] loads on board, since when
        self._reported: set[str] = set()  # why there was no plan
        self._tape: Tape | None = None  # room for what is kept of steps that nobody is shown

    def set_out(self) -> None:
        """Have the first plan in the ledger, in which all robots have their ways.

        Raises PlanError when the policy keeps an order and the plan's cannot be kept.
        """
        first = OneShot()
        for request in first.due(0.0, self.context):
            answer = first.answer(request, self.context)
            if answer is not None:
                self.ledger.append(answer, self.controller.policy, 0.0)

    @property
    def now_s(self) -> float:
        return self.cycle.now_s

    def run(self, cycle: DriveCycle, records: Records, listeners: Sequence[Listener], *, alone: bool) -> None:
        """Until all tasks are done, or time is up. The ledger forgets what is over, once every listener that needs it has been called.

        Where nobody else wants every moment (`alone`), nobody is called for steps in which nothing happens.
        """
        self.cycle, state = cycle, self.ledger.state
        wall, cpu = time.perf_counter(), time.process_time()
        hear = [*records.listeners, *listeners]
        while True:
            self._take_wishes()
            self.events += cycle.look()
            is_sample = cycle.step % self.settings.steps_per_sample == 0
            if is_sample and self.batteries is not None:
                self.batteries.add(state.motion.yaw_rad[None], state.motion.speed_mps[None])
            is_last = is_sample and self._is_over()
            if is_last:
                self._close()
            about = self.ledger, self.events, self.crew, self.world.facilities
            snapshot = Moment(cycle.step, cycle.now_s, is_sample, is_last, cycle.bodies, *about)
            self.events = []
            for listener in hear:
                listener.hear(snapshot)
            if is_last:
                break
            if self.ledger.is_full:
                records.samples.settle(self.ledger)
                cycle.forget(self.crew.seen)
            self._find(cycle.go(sent=self._send_robots_on()))
            if alone and self.world.calm_until_s > self.now_s:
                self._go_on(records)
        self.wall_s, self.cpu_s = time.perf_counter() - wall, time.process_time() - cpu

    def _find(self, wrong: Sequence[str]) -> None:
        """Note what the engine finds wrong now."""
        self.findings += [f"{self.now_s:.2f} s: {each}" for each in wrong]

    def _send_robots_on(self) -> bool:
        """Let who decides do so, where something is due. Returns whether robots are to go elsewhere, or in another order."""
        step = self.cycle.step
        decided = step > 0 and self._decide(step)
        due = step % self._look_every == 0 or self.now_s >= self._wake_s - 1e-9
        return (due and self._dispatch(self.cycle.bodies)) or decided

    def _take_wishes(self) -> None:
        """Tasks and disturbances that nobody knew of."""
        for listener in self.listeners:
            for wish in listener.interventions(self.now_s):
                if isinstance(wish, Task):
                    self.tasks.add(wish)
                else:
                    self.world.add(wish)

    def _go_on(self, records: Records) -> None:
        """Take steps as long as nothing happens in them."""
        if self.outcome is not Outcome.TIME_LIMIT or self.work.finished(self.now_s, self.context):
            return
        settings, cycle, dt = self.settings, self.cycle, self.settings.step_length_s
        row = records.samples.room(self.ledger)
        decides_every_s, quiet_until_s = getattr(self.controller.policy, "decides_every_s", None), self._quiet_until_s
        quiet = quiet_until_s > cycle.now_s
        until = cycle.step + len(row) * settings.steps_per_sample
        for every in (max(1, round(decides_every_s / dt)) if decides_every_s else until, until if quiet else self._look_every):
            until = min(until, -(-cycle.step // every) * every)
        for due_s in (
            settings.time_limit_s,
            records.witness.due_s,
            self._wake_s,
            self.world.calm_until_s,
            quiet_until_s if quiet else np.inf,
        ):
            until = min(until, math.ceil(steps)) if (steps := due_s / dt - 1e-9) < np.inf else until
        if until <= cycle.step:
            return
        held = self.crew.held if quiet else None
        begin, tape = cycle.step, self._tape_for(until - cycle.step, row, records.grants, held)
        self._find(cycle.go_on(until - begin, tape))
        num_samples, num_grants = tape.filled.tolist()
        records.samples.add(num_samples)
        if self.batteries is not None:
            self.batteries.add(row[:num_samples, 1], row[:num_samples, 2])
        if num_grants:
            part = slice(num_grants)
            records.grants.add(tape.grant_s[part].copy(), tape.grant_robot[part].copy(), tape.granted[part].copy())
        if held is not None and settings.tasks:
            self._pass_over(begin, num_samples, held)

    def _pass_over(self, begin: int, num_samples: int, held: BoolArray) -> None:
        """Make up for the looks that nobody took since the step `begin`, with as many samples since; some robots were `held` [R]."""
        every, sample_every, dt = self._look_every, self.settings.steps_per_sample, self.settings.step_length_s
        looks = range(-(-begin // every) * every, self.cycle.step, every)
        looks_s = [round(look * dt, 9) for look in looks]
        if self.batteries is not None and looks:
            before = self.batteries.num_samples - num_samples
            first = -(-begin // sample_every)
            self.batteries.observe_each(
                looks_s, [before + look // sample_every - first + 1 for look in looks], self.crew.at_charger, self.crew.loads > 0
            )
        self.tasks.pass_over(looks_s[-2:], None if self.batteries is None else self.batteries.level, held)

    def _tape_for(self, most: int, samples: FloatArray, grants: GrantRecorder, held: BoolArray | None) -> Tape:
        """Room for what is kept of so many steps, in which nobody looks if some are `held` [R] and all others get on."""
        robots, tape = self.ledger.num_robots, self._tape
        if tape is None or len(tape.granted) < most * robots:
            tape = self._tape = tape_for(robots, most * robots, self.settings.steps_per_sample)
        rests, watched = np.ones(robots, np.bool_), np.full(robots, -1)
        if held is not None and self.settings.tasks:
            rests, watched = self.crew.rests, np.where(self.tasks.watched, self.crew.seen, -1)
        return tape._replace(
            filled=np.zeros(2, np.int64),
            samples=samples,
            known=grants.known,
            look_every=NEVER if held is None else self._look_every,
            rests=rests,
            held=np.zeros(robots, np.bool_) if held is None else held,
            watched=watched,
        )

    @property
    def _quiet_until_s(self) -> float:
        """Until when nobody has anything to do before robots wait, or stand that should not, or something is known to be due."""
        if not self.recovery.is_quiet:
            return -np.inf
        if not self.settings.tasks:
            return np.inf if type(self.work) is OneShot else -np.inf
        is_quiet = self.tasks.is_quiet(self.now_s, self.world.down_until_s, self.world.stands_until_s)
        if not is_quiet or not self.wear.is_current(self.crew.robots):
            return -np.inf
        level_s = np.inf if self.batteries is None else self.tasks.level_wake_s(self.now_s, self._most_per_s)
        return min(self.rolling.window_over_s, level_s)

    @property
    def _look_every(self) -> int:
        return max(1, round(LOOK_EVERY_S / self.settings.step_length_s))

    @property
    def _wake_s(self) -> float:
        """When something is to be decided that is known by now, but for what robots have yet to do."""
        if not self.settings.tasks:
            return math.inf
        return min(self.tasks.wake_s, self.wear.wake_s, math.inf if self.rolling.answer is None else self.rolling.answer.ready_s)

    def _close(self) -> None:
        self._update_tasks()
        self.crew.close(self.now_s)
        self.events += self.rolling.close(self.now_s)
        self.events += self.recovery.close(self.now_s)
        self.events += self.controller.unfinished_waits(self.now_s)
        self.events += self.people.close(self.now_s)

    def _is_over(self) -> bool:
        if self.outcome is Outcome.DEADLOCK:
            return True
        if any(listener.wants_end() for listener in self.listeners):
            self.outcome = Outcome.INTERRUPTED
            return True
        if all(dispatcher.finished(self.now_s, self.context) for dispatcher in (self.work, self.recovery)):
            self.outcome = Outcome.COMPLETED
            return True
        if self.now_s < self.settings.time_limit_s - 1e-9:
            return False
        if self.settings.tasks and self.tasks.progress.has_stalled(self.now_s):
            refused = self.now_s - self.rolling.refused_since_s >= STALLED_S
            self.outcome = Outcome.PLANNER_STALLED if refused else Outcome.STALLED
        elif self.settings.tasks and self.crew.orders.endless:
            self.outcome = Outcome.COMPLETED  # there is always more to do: the run ends when its time is over
        return True

    def _decide(self, step: int) -> bool:
        """Let the policy change the order of passages, if it is one that does. Returns whether it did."""
        policy = self.controller.policy
        every_s = getattr(policy, "decides_every_s", None)
        if every_s is None or step % max(1, round(every_s / self.settings.step_length_s)):
            return False
        try:
            changed = self.ledger.decide(cast(DecidingPolicy, policy), self.now_s)
        except PlanError as error:  # the policy's own doing, not the plan's
            raise PlugInError(f"execution policy '{self.settings.policy}': decide() at {self.now_s:g} s: {error}") from error
        if changed:
            self.controller.send_again()
        return changed

    def _dispatch(self, bodies: Engine) -> bool:
        """Report new deadlocks and final blockings, and send robots that do not get on other ways. Returns whether any were sent."""
        cycles = self.recovery.watch.look(self.ledger.state)
        self.events += [self.controller.deadlock(self.now_s, cycle) for cycle in cycles]
        blocked = self.recovery.finally_blocked(self.now_s) if self.settings.on_deadlock != "resolve" else []
        self.events += blocked
        if (cycles or blocked) and self.settings.on_deadlock == "stop":
            self.outcome = Outcome.DEADLOCK
        sent = self._send_others(bodies)
        self.events += self.recovery.drain()
        return sent

    def _send_others(self, bodies: Engine) -> bool:
        """Let what the planner was asked for take effect, or send robots other ways that do not get on. Returns whether any were sent."""
        if self.settings.tasks:
            self._update_tasks()
        sent = self._deliver(bodies)
        for request in () if sent else self.recovery.due(self.now_s, self.context):
            answer = self._answer(self.recovery, request)
            if answer is not None and self._append(answer, bodies):
                self.rolling.drop(self.now_s, failed=False)
                sent = True
                break
        self.rolling.ask(self.now_s, self._report)
        self.events += self.rolling.drain()
        return self._deliver(bodies) or sent  # an answer that takes no time is there

    def _update_tasks(self) -> None:
        """Note what robots have done, and what that took from their batteries. Those that have run empty stay where they are."""
        level = None
        if self.batteries is not None:
            for robot in self.batteries.observe(self.now_s, self.crew.at_charger, self.crew.loads > 0, self.crew.num_lifts):
                self.events.append(self.world.strand(robot, self.now_s))
                self.crew.lose(self.crew.robots[robot], self.now_s, Change.EMPTIED)
            level = self.batteries.level
        self.tasks.update(self.now_s, level, self.world.down_until_s, self.world.stands_until_s)
        if self.wear.any:
            for failure in self.wear.look(self.now_s, self.crew.robots):
                self.world.add(failure)
        self._note_loads()
        self.events += self.crew.drain()

    def _note_loads(self) -> None:
        """Robots that have other loads on board stand, and have other limits from now on."""
        loads, fleet = self.crew.loads, self.ledger.problem.fleet
        if np.array_equal(loads, self._loads[-1][1]):
            return
        self._loads.append((self.now_s, loads))
        if fleet.loaded is not None:
            fleet = with_loads(fleet, loads > 0)
            self.controller.load(fleet)
            self.cycle.bodies.load(fleet)

    def loads_at(self, t_s: FloatArray) -> IntArray | None:
        """[T, R] loads on board at times [T]; None where robots carry one at most, and it makes no difference."""
        fleet = self.ledger.problem.fleet
        if not self.settings.tasks or (fleet.loaded is None and not fleet.carries_several):
            return None
        since_s, loads = zip(*self._loads)
        return np.stack(loads)[np.searchsorted(since_s, t_s + 1e-9) - 1]

    def _deliver(self, bodies: Engine) -> bool:
        """Have the ledger take the answer that is due. Returns whether it has."""
        answer = self.rolling.due(self.now_s)
        if answer is None:
            return False
        if answer.ways is not None and isinstance(answer.request, WorkRequest):
            moved = {r for r, route in answer.ways.reroute.items() if len(route.vertex)}
            if not still_fits(self.crew, answer.request, moved):
                self.rolling.drop(self.now_s, failed=False)
                return False
        if answer.ways is None or not self._append(answer.ways, bodies):
            self.rolling.drop(self.now_s, failed=True)
            return False
        self.rolling.taken(answer, self.now_s)
        return True

    def _plan(self, request: Request) -> Replan:
        """The plan of the scenario's planner: at first that which the run was given."""
        if not self.ledger.entries:
            return first_of(self.first)
        return self.rolling.plan(request, self.now_s)

    def _answer(self, dispatcher: Dispatcher, request: Request) -> Replan | None:
        try:
            return dispatcher.answer(request, self.context)
        except PlanError as error:  # robots go on as they are
            self._report(str(error))
            return None

    def _report(self, why: str) -> None:
        """Say once why there is no plan."""
        if why not in self._reported:
            self._reported.add(why)
            self.events.append(Event(self.now_s, "unresolved", -1, text=why))

    def _append(self, answer: Replan, bodies: Engine) -> bool:
        """Have the ledger take an answer. A new plan is driven in its order if that can be kept: it is for who is where now,
        not for the clock.
        """
        robots = sorted(answer.reroute)
        backs = [r for r in robots if answer.reroute[r].back]
        waits = self.controller.unfinished_waits(self.now_s, robots)
        policies = self._policies(answer)
        for policy in policies:
            try:
                self.ledger.append(answer, policy, self.now_s)
                break
            except PlanError as error:
                if policy is policies[-1]:
                    self.recovery.refused(error, self.now_s)
                    return False
        self.events += waits
        self.controller.follow(policy)
        self.controller.divert(robots, backs, bodies)
        self.world.inform(backs, self.ledger.state.grants.allowed_m)
        self.recovery.accepted(answer, self.now_s)
        return True

    def _policies(self, answer: Replan) -> list[Policy]:
        if not answer.reordered:
            return [self.controller.policy]
        if self.chosen.sound_plan_only:
            return [policy_of("adg")]
        return [policy_of("adg"), policy_of("open_loop")]


def _execution(drive: Drive, plan: Plan, records: Records) -> Execution:
    settings, ledger, what = drive.settings, drive.ledger, drive.settings.disturbances
    x, y, yaw, speed, level, hitch = records.samples.samples(ledger)
    believed = None
    if what.localisation_m or what.localisation_rad:
        believed = frozen(believed_poses(x, y, yaw, settings.record_period_s, what, settings.seed))
    stays = ledger.state.home & (not settings.tasks)  # where tasks come, nobody has a goal of its own
    goal_s = np.where(stays, ledger.state.waits.goal_s, np.nan)
    arrived_s = planned_arrivals(ledger)
    ends = plan.first[1:] - 1  # where a way was given up, robots still reach the ends
    arrived_s[ends] = np.where(np.isfinite(arrived_s[ends]), arrived_s[ends], goal_s)
    t_s = np.round(np.arange(len(x)) * settings.steps_per_sample * settings.step_length_s, 9)
    driven = Execution(
        t_s=frozen(t_s),
        x_m=x,  # read-only, and on the disk where they are many: a copy would take their whole size
        y_m=y,
        yaw_rad=yaw,
        speed_mps=speed,
        arrived_s=frozen(arrived_s),
        goal_s=frozen(goal_s),
        outcome=drive.outcome,
        policy=settings.policy,
        sim_time_s=drive.now_s,
        wall_time_s=drive.wall_s,
        cpu_time_s=drive.cpu_s,
        events=tuple(sorted(records.events.events, key=lambda event: (event.t_s, event.robot, event.kind))),
        findings=tuple(drive.findings),
        booked_s=frozen(ledger.state.waits.booked_s),
        tasks=drive.crew.orders.log() if settings.tasks else None,
        stops=stop_log(drive.crew.robots) if settings.tasks else None,
        robot_states=state_log(drive.crew.robots, drive.now_s) if settings.tasks else None,
        calls=drive.rolling.calls if settings.tasks else None,
        batteries=drive.batteries.log(drive.now_s, settings.charging.critical if settings.charging else 0.0) if drive.batteries else None,
        facilities=records.facilities.log() if records.facilities else None,
        people=records.people.log(ledger.graph) if records.people else None,
        level=None if level is None else frozen(level),
        hitch_rad=hitch,
        loads=None if (loads := drive.loads_at(t_s)) is None else frozen(loads),
        believed=believed,
        sumo_t_s=frozen(np.array(records.witness.t_s)),
        sumo_xy_m=frozen(np.array(records.witness.xy_m)),
        replies=replies_of(ledger),
        grants=records.grants.log(),
    )
    return driven if settings.tasks else with_goals_within(driven, ledger.graph.xy, ledger.end_of_tasks, settings.goal_tolerance_m)
