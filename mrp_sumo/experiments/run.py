"""One run, from scenario to run folder: the main path of the program, stage by stage.

What cannot be planned is refused by `set_up`. From then on failures are results: a plan that is not found,
an execution that does not arrive, are written like successes.
"""

import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from threading import current_thread, main_thread
from typing import TYPE_CHECKING, Any

from mrp_sumo.core.execution import Execution, let_go_of_samples
from mrp_sumo.core.interrupts import end
from mrp_sumo.core.plan import Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive.listeners import Listener, ProgressReport
from mrp_sumo.drive.policy import policy_of
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.engines.protocol import Engine
from mrp_sumo.errors import PlanError, PlanningOverrun, PlugInError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.solve import Solution, StageReport, silent, solve
from mrp_sumo.experiments.staging.set_up import SetUp, set_up, with_time_limit
from mrp_sumo.io.run_folder import check_replaceable, plain
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.maps.clearance import standing_walls
from mrp_sumo.maps.facts import driven_levels
from mrp_sumo.maps.lifts import cabins_of

if TYPE_CHECKING:
    from mrp_sumo.experiments.result import RunResult

POLICY_FAILED, DISPATCHER_FAILED = "policy_failed", "dispatcher_failed"  # statuses of runs whose plug-in broke its contract
PLUG_IN_FAILED = (str(Status.PLANNER_FAILED), POLICY_FAILED, DISPATCHER_FAILED)


Watch = Callable[[SetUp, Solution], Listener]  # makes the listener of a run that is about to be driven


@dataclass(frozen=True)
class RunOptions:
    """Options of a run, beside what its scenario says."""

    execute: bool = True  # drive the plan; without, a plan that was found ends the run with status `planned`
    gui: bool = False  # drive in sumo-gui, for people to look at
    progress: StageReport = silent  # called now and then with the stage and how far it is
    watches: Sequence[Watch] = ()  # what Interventions among the listeners do becomes a part of the run's scenario
    keeps_interrupted: bool = False  # Ctrl-C while robots drive ends a run with tasks with what there is, status `interrupted`
    engine: AbstractContextManager[Engine] | None = None  # moves the bodies instead of that of the settings
    bounds: Mapping[str, tuple[float, float]] | None = None  # intervals of its quantities, for error bands; None: none are wanted


DEFAULT = RunOptions()


def run_scenario(file: ScenarioFile, out: Path, options: RunOptions = DEFAULT) -> "RunResult":
    """Run a scenario and write its run folder. Ctrl-C while robots drive keeps what there is of a run with tasks.

    Raises MrpSumoError when the scenario cannot be run at all; nothing is written.
    """
    check_replaceable(out)
    with MapCache() as maps:
        result = carry_out(file, maps, replace(options, keeps_interrupted=True))
        if options.bounds is not None and result.status != "interrupted":
            from mrp_sumo.experiments.run_bands import with_error_bands

            result = with_error_bands(result, options.bounds, lambda other: carry_out(other, maps))
        options.progress("writing the run folder", 0.0, 0.0)
        result.write(out, maps)
    return result


@dataclass
class Interrupt(Listener):
    """Ends an execution once the user has pressed Ctrl-C."""

    is_pressed: bool = False
    is_patient = True

    def wants_end(self) -> bool:
        return self.is_pressed


@contextmanager
def interrupts() -> Iterator[Interrupt]:
    """The listener that Ctrl-C reaches, which ends nothing by itself the first time; none reaches it where Ctrl-C means something else."""
    usual, interrupt = signal.getsignal(signal.SIGINT), Interrupt()
    if usual not in (signal.default_int_handler, end) or current_thread() is not main_thread():
        yield interrupt
        return

    def note(number: int, frame: object) -> None:
        interrupt.is_pressed = True
        signal.signal(signal.SIGINT, usual)

    signal.signal(signal.SIGINT, note)
    try:
        yield interrupt
    finally:
        signal.signal(signal.SIGINT, usual)


def carry_out(file: ScenarioFile, maps: MapCache, options: RunOptions = DEFAULT) -> "RunResult":
    """Run a scenario and measure it; writes nothing. Raises MrpSumoError when the scenario cannot be run at all."""
    options.progress("loading the map", 0.0, 0.0)
    setup = set_up(file, maps)
    return finish(setup, solve(setup, execute=options.execute, progress=options.progress), maps, options)


def finish(setup: SetUp, solution: Solution, maps: MapCache, options: RunOptions = DEFAULT) -> "RunResult":
    """Drive what was planned, if there is a plan, and measure it."""
    from mrp_sumo.drive.outside_dispatcher import DispatcherError
    from mrp_sumo.experiments.interventions import Interventions
    from mrp_sumo.experiments.result import RunResult
    from mrp_sumo.metrics.audit import in_words
    from mrp_sumo.metrics.evaluate import evaluate
    from mrp_sumo.metrics.lane_keeping import lane_keeping, on_lane_m
    from mrp_sumo.metrics.metric import Evidence
    from mrp_sumo.metrics.own import guarded
    from mrp_sumo.metrics.registry import METRICS
    from mrp_sumo.metrics.zones import occupancy

    execute, report = options.execute, options.progress
    execution, note, details, broken = None, solution.result.message or solution.note, solution.result.details, ""
    if execute and solution.result.plan is not None:
        setup = with_time_limit(setup, solution.result.plan)
        report("building the SUMO network", 0.0, 0.0)
        network = maps.network(solution.problem.graph, setup.map.building if options.gui else None)
        listeners: list[Listener] = []
        try:
            execution, otherwise = _execute(setup, solution, network, options, listeners)
            note = "; ".join(filter(None, (note, otherwise)))
        except PlugInError as error:
            note, details = str(error), error.details
            broken = DISPATCHER_FAILED if isinstance(error, DispatcherError) else POLICY_FAILED
            if isinstance(error, PlanningOverrun):
                broken = str(Status.PLANNER_FAILED)
        for steering in (listener for listener in listeners if isinstance(listener, Interventions)):
            setup = replace(setup, file=steering.recorded(setup.file))
    report("measuring", 0.0, 0.0)
    problem, choice = solution.problem, setup.scenario.execution
    audited = _audited(setup, problem, execution) if execution else None
    seen = in_words(audited) if audited else ""
    note = "; ".join(filter(None, (note, seen, *(_remarks(execution, problem.fleet.robot_name) if execution else ()), *setup.notes)))
    cut = setup.scenario.discretisation
    apart_m = cut.cell_m if cut.kind == "roadmap" and (cut.lanes == "two_way" or cut.doubled) else 0.0  # of the two tracks of a lane
    lanes = lane_keeping(execution, setup.map.nav, on_lane_m(apart_m)) if execution else None
    if execution:
        let_go_of_samples(execution)
    faults: list[PlugInError] = []
    own = [guarded(name, setup.file.folder, faults.append) for name in setup.scenario.record.metrics]
    zones = occupancy(execution, problem.graph, setup.map.nav) if execution and execution.tasks and len(execution.t_s) else None
    evidence = Evidence(
        solution.problem,
        solution.result,
        solution.verdict,
        execution,
        audited,
        solution.assignment_time_s,
        choice.goal_tolerance_m,
        setup.settings.time_limit_s,
        zones,
    )
    metrics = evaluate(evidence, (*METRICS, *own))
    if faults:
        note, details = "; ".join(filter(None, (note, *map(str, faults)))), details or faults[0].details
    status = broken or (_status(solution, execution, audited, metrics) if execute or solution.result.plan is None else "planned")
    result = RunResult(setup, status, note, solution, execution, audited, plain(metrics), details, zones, lanes, tuple(map(str, faults)))
    return _with_work_judged(result) if execution and execution.tasks is not None else result


def _audited(setup: SetUp, problem: Problem, execution: Execution) -> dict[str, Any]:
    """What the audit says of bodies among the walls and cabins of the building."""
    from mrp_sumo.metrics.audit import audit

    building, level_names = setup.map.building, problem.graph.level_names
    # levels without lanes lie where they are drawn: above or below others
    walls = standing_walls(building, driven_levels(setup.map.nav)) if building else None
    cabins = cabins_of(building, level_names, setup.map.level_shift_m) if building and building.lifts else None
    return audit(execution, problem.fleet, problem.graph.level[problem.start], walls, cabins)


def _remarks(execution: Execution, names: Sequence[str]) -> Iterator[str]:
    """What a run's note says of orders, batteries, robots and the planner's answers; some are empty."""
    from mrp_sumo.metrics.fleet_use import ran_empty, stalled_robots
    from mrp_sumo.metrics.tasks import overload

    yield overload(execution.tasks, execution.sim_time_s, len(names)) if execution.tasks else ""
    yield ran_empty(execution.batteries, names) if execution.batteries else ""
    yield stalled_robots(execution, names)
    yield _unanswered(execution)


def _with_work_judged(result: "RunResult") -> "RunResult":
    from mrp_sumo.experiments.audit_work import logs_of
    from mrp_sumo.metrics.operations.audit import in_words, operations_audit

    work = operations_audit(logs_of(result))
    note = "; ".join(filter(None, (result.note, in_words(work))))
    return replace(result, operations_audit=plain(work), note=note, status=result.status if work["passed"] else "audit_failed")


def _unanswered(execution: Execution) -> str:
    """A line for people where the planner had no answer to most of what it was asked while robots drove, '' elsewhere."""
    calls = execution.calls
    if calls is None or calls.failed + calls.late <= calls.requests / 2:
        return ""
    why = next((event.text for event in execution.events if event.kind == "unresolved"), "")
    return f"{calls.failed + calls.late} of {calls.requests} requests had no answer{f', at first: {why}' if why else ''}"


def _execute(
    setup: SetUp, solution: Solution, network: Path, options: RunOptions, listeners: list[Listener]
) -> tuple[Execution | None, str]:
    """The execution, and a line on what was done otherwise than the scenario says. `listeners` are there from when robots set out."""
    from mrp_sumo.drive import warm
    from mrp_sumo.drive.loop import simulate

    warm.prepare(setup.settings.engine)
    plan, verdict, settings = solution.result.plan, solution.verdict, setup.settings
    name = setup.scenario.execution.policy.name
    with setup.file.located("execution", "policy"):
        policy = policy_of(settings.policy, settings.policy_parameters)
    assert plan is not None and verdict is not None

    def drive(settings: ExecutionSettings) -> Execution:
        def progress(t_s: float, at_goal: int) -> None:
            options.progress(f"driving, {at_goal} of {solution.problem.num_robots} at their goals", t_s, settings.time_limit_s)

        listeners[:] = listeners or [watch(setup, solution) for watch in options.watches]
        who = [ProgressReport(progress), *listeners]
        with interrupts() if options.keeps_interrupted and settings.tasks else nullcontext(Interrupt()) as interrupt:
            who.append(interrupt)
            run = simulate(solution.problem, plan, settings, network, listeners=who, gui=options.gui, engine=options.engine)
        return replace(run, policy=name) if settings is setup.settings else run

    if verdict.faults:
        return None, f"not executed: {verdict.summary(solution.problem)}"
    if not policy.sound_plan_only:
        return drive(settings), ""
    unsound = "" if verdict.valid else verdict.summary(solution.problem, limit=1)
    if not unsound:
        try:
            return drive(settings), ""
        except PlanError as error:  # an order that nobody can keep
            unsound = str(error)
    if setup.scenario.execution.invalid_plan == "refuse":
        return None, f"not executed: policy '{name}' needs a sound plan; {unsound}"
    note = f"driven with open_loop, since policy '{name}' needs a sound plan; {unsound}"
    return drive(replace(settings, policy="open_loop", policy_parameters={})), note


def _status(solution: Solution, execution: Execution | None, audited: dict[str, Any] | None, metrics: dict[str, Any]) -> str:
    """How the run ended, in one word for machines. A robot within the goal tolerance has reached its goal."""
    if solution.result.status is Status.PLANNER_FAILED:
        return str(Status.PLANNER_FAILED)
    if solution.result.plan is None:
        return f"planning_{solution.result.status}"
    if execution is None:
        return "refused"
    if audited is not None and not audited["passed"]:
        return "audit_failed"
    if execution.tasks is not None:
        return str(execution.outcome)
    return "completed" if metrics["all_goals_reached"] else str(execution.outcome)
