"""One run, from scenario to run folder: the main path of the program, stage by stage.

`set_up` refuses what cannot be planned: names the map does not have, robots that do not fit, goals that
cannot be reached. From then on failures are results: a plan that is not found, an execution that does not
arrive, are written like successes.
"""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.fleet import Fleet, RobotType, fleet_of
from mrp_sumo.core.graph import IntArray, NavGraph, PlanGraph
from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.referee import Verdict, judge
from mrp_sumo.errors import MrpSumoError, PlanError, ScenarioError, nearest
from mrp_sumo.experiments.workshop import Workshop
from mrp_sumo.io.scenario import BreakdownChoice, DisturbanceChoice, ObstacleChoice, Scenario, ScenarioFile, robot_type
from mrp_sumo.maps.catalogue import bundled_folder
from mrp_sumo.maps.load import Map
from mrp_sumo.planning import distance
from mrp_sumo.planning.costs import cost_matrix
from mrp_sumo.planning.draw import mrp_bench_draw, uniform_draw
from mrp_sumo.planning.protocol import Assigner, Planner
from mrp_sumo.planning.registry import assigner, planner
from mrp_sumo.sim.disturbances import Breakdown, Disturbances, Obstacle
from mrp_sumo.sim.policy import needs_sound_plan, policy_of
from mrp_sumo.sim.settings import ExecutionSettings

ASSIGNMENT = 3  # purpose of the stream of chance, beside those of planning.draw

Progress = Callable[[str, float, float], None]  # (stage, done, of)


@dataclass(frozen=True)
class SetUp:
    """A scenario with its map loaded and its problem drawn. Nothing is planned yet."""

    file: ScenarioFile
    map: Map
    problem: Problem
    assigner: Assigner
    planner: Planner
    settings: ExecutionSettings

    @property
    def scenario(self) -> Scenario:
        return self.file.scenario


@dataclass(frozen=True)
class Solution:
    """What assignment and planning came to, judged."""

    problem: Problem  # with the assignment the plan is for
    result: PlanResult
    verdict: Verdict | None  # of the plan, if there is one
    assignment_time_s: float


@dataclass(frozen=True)
class Outcome:
    """A run that has ended."""

    setup: SetUp
    status: str  # how it ended, in one word for machines
    note: str  # why, or what was done otherwise than the scenario says
    solution: Solution
    execution: Execution | None
    audit: dict[str, Any] | None
    metrics: dict[str, Any]


def set_up(file: ScenarioFile, workshop: Workshop) -> SetUp:
    """Load the map, fit the robots, draw or look up starts and goals.

    Raises
    ------
    MrpSumoError
        One line a fault, naming file and key.
    """
    scenario = file.scenario
    model, chosen_planner, chosen_assigner, settings = choices(file)
    cell_m = scenario.discretisation.cell_m
    map_ = _located(file, ("map",), lambda: workshop.map(scenario.map, file.folder, cell_m, model.radius_m))
    graph = workshop.graph(map_, scenario.discretisation)
    _require_fit(file, graph, model)
    start, goal = _places(file, map_.nav, graph)
    fleet = fleet_of(model, len(start))
    for i, name in enumerate(scenario.record.robots):
        if name not in fleet.robot_name:
            raise ScenarioError(f"{file.at('record', 'robots', i)}: '{name}' is not a robot{nearest(name, fleet.robot_name)}")
    problem = _located(
        file,
        ("robots",),
        lambda: Problem(
            graph=graph,
            fleet=fleet,
            start=start,
            goal=goal,
            goal_of=np.full(len(start), -1),
            step_s=scenario.planner.step_s or planned_step_s(graph, fleet, scenario.execution.step_length_s),
            seed=scenario.seed,
        ),
    )
    if scenario.robots.starts is not None:
        _require_reachable(file, problem)
    return SetUp(file, map_, problem, chosen_assigner, chosen_planner, settings)


def choices(file: ScenarioFile) -> tuple[RobotType, Planner, Assigner, ExecutionSettings]:
    """What a scenario chooses by name, apart from its map.

    Raises
    ------
    MrpSumoError
        One line a fault, naming file and key.
    """
    scenario = file.scenario
    return (
        _located(file, ("robots", "type"), lambda: robot_type(scenario.robots.type, bundled_folder("robots"), file.folder)),
        _located(file, ("planner", "name"), lambda: planner(scenario.planner.name, scenario.planner.parameters)),
        _located(file, ("assignment", "solver"), lambda: assigner(scenario.assignment.solver, scenario.assignment.parameters)),
        _settings(file),
    )


def planned_step_s(graph: PlanGraph, fleet: Fleet, step_length_s: float) -> float:
    """The time planned for a lane: the slowest robot drives the longest lane and turns by a right angle.

    Every step of a plan can then be kept, at rest or in motion. Rounded up to whole simulation steps.
    """
    speed = np.minimum(graph.speed_mps, fleet.max_speed_mps.min())
    drive = float((graph.length_m / speed).max()) if graph.num_lanes else 0.0
    turn = math.pi / 2 / float(fleet.turn_rate_rad_s.min())
    return round(math.ceil((drive + turn) / step_length_s - 1e-9) * step_length_s, 9)


def solve(setup: SetUp) -> Solution:
    """Assign and plan within the time limit, and judge the plan."""
    scenario, problem = setup.scenario, setup.problem
    began = time.perf_counter()
    distance.prepare()
    setup.planner.prepare()
    prepare_time_s = time.perf_counter() - began
    began = time.perf_counter()
    try:
        if not setup.planner.assigns:
            problem = problem.assigned(_assignment(setup))
    except PlanError as error:
        result = PlanResult(Status.INFEASIBLE, prepare_time_s=prepare_time_s, message=str(error))
        return Solution(problem, result, None, time.perf_counter() - began)
    assignment_time_s = time.perf_counter() - began
    result = setup.planner.plan(problem, scenario.planner.time_limit_s)
    result = replace(result, prepare_time_s=prepare_time_s)
    verdict = None
    if result.goal_of is not None:
        problem = problem.assigned(result.goal_of)
    if result.plan is not None:
        verdict = judge(problem, result.plan)
    return Solution(problem, result, verdict, assignment_time_s)


def run_scenario(file: ScenarioFile, out: Path, *, progress: Progress | None = None, gui: bool = False) -> dict[str, Any]:
    """Run a scenario and write its run folder.

    Parameters
    ----------
    file
        The scenario.
    out
        The run folder; a run folder that is there already is replaced once the new one is complete.
    progress
        Called now and then with the stage and how far it is.
    gui
        Drive in sumo-gui, for people to look at.

    Returns
    -------
    dict
        What `result.json` holds.

    Raises
    ------
    MrpSumoError
        When the scenario cannot be run at all; nothing is written.
    """
    from mrp_sumo.io.outline import outline_of
    from mrp_sumo.io.run_folder import check_replaceable, write_run
    from mrp_sumo.maps.costmap import costmap

    report = progress or _silent
    check_replaceable(out)
    with Workshop() as workshop:
        outcome = carry_out(file, workshop, progress=progress, gui=gui)
        setup, solution = outcome.setup, outcome.solution
        report("writing the run folder", 0.0, 0.0)
        return write_run(
            out,
            status=outcome.status,
            note=outcome.note,
            scenario=setup.scenario,
            problem=solution.problem,
            result=solution.result,
            verdict=solution.verdict,
            execution=outcome.execution,
            metrics=outcome.metrics,
            audit=outcome.audit,
            network=workshop.network(solution.problem.graph),
            nav=setup.map.nav,
            costmap=costmap(setup.map.building, setup.map.nav.level_names[0]) if setup.map.building else None,
            outline=outline_of(setup.map.building, setup.map.nav.level_names) if setup.map.building else None,
        )


def carry_out(
    file: ScenarioFile, workshop: Workshop, *, execute: bool = True, progress: Progress | None = None, gui: bool = False
) -> Outcome:
    """Run a scenario and measure it; writes nothing.

    Parameters
    ----------
    file
        The scenario.
    workshop
        Where maps and networks come from; give the same one to many runs.
    execute
        Drive the plan; without, a plan that was found ends the run with status `planned`.
    progress
        Called now and then with the stage and how far it is.
    gui
        Drive in sumo-gui.

    Raises
    ------
    MrpSumoError
        When the scenario cannot be run at all.
    """
    from mrp_sumo.metrics.audit import audit
    from mrp_sumo.metrics.evaluate import evaluate

    report = progress or _silent
    report("loading the map", 0.0, 0.0)
    setup = set_up(file, workshop)
    scenario = file.scenario
    report("planning", 0.0, 0.0)
    solution = solve(setup)
    execution, note = None, solution.result.message
    if execute and solution.result.plan is not None:
        report("building the SUMO network", 0.0, 0.0)
        network = workshop.network(solution.problem.graph, setup.map.building if gui else None)
        execution, note = _execute(setup, solution, network, report, gui)
    report("measuring", 0.0, 0.0)
    audited = audit(execution, solution.problem.fleet) if execution else None
    metrics = evaluate(
        solution.problem,
        solution.result,
        solution.verdict,
        execution,
        audited,
        assignment_time_s=solution.assignment_time_s,
        time_limit_s=scenario.execution.time_limit_s,
        tolerance_m=scenario.execution.goal_tolerance_m,
    )
    status = _status(solution, execution, audited, metrics) if execute or solution.result.plan is None else "planned"
    return Outcome(setup, status, note, solution, execution, audited, metrics)


def _silent(stage: str, done: float, of: float) -> None:
    """Nobody wants to know."""


def _execute(setup: SetUp, solution: Solution, network: Path, report: Progress, gui: bool) -> tuple[Execution | None, str]:
    """The execution, and a line on what was done otherwise than the scenario says."""
    from mrp_sumo.sim import warm
    from mrp_sumo.sim.loop import simulate

    warm.prepare()
    plan, verdict, settings = solution.result.plan, solution.verdict, setup.settings
    assert plan is not None and verdict is not None

    def drive(settings: ExecutionSettings) -> Execution:
        def progress(t_s: float, at_goal: int) -> None:
            report(f"driving, {at_goal} of {solution.problem.num_robots} at their goals", t_s, settings.time_limit_s)

        return simulate(solution.problem, plan, settings, network, progress=progress, gui=gui)

    if verdict.faults:
        return None, f"not executed: {verdict.summary(solution.problem)}"
    if not needs_sound_plan(settings.policy):
        return drive(settings), ""
    unsound = "" if verdict.valid else verdict.summary(solution.problem, limit=1)
    if not unsound:
        try:
            return drive(settings), ""
        except PlanError as error:  # an order that nobody can keep
            unsound = str(error)
    if setup.scenario.execution.invalid_plan == "refuse":
        return None, f"not executed: policy '{settings.policy}' needs a sound plan; {unsound}"
    note = f"driven with open_loop, since policy '{settings.policy}' needs a sound plan; {unsound}"
    return drive(replace(settings, policy="open_loop")), note


def _status(solution: Solution, execution: Execution | None, audited: dict[str, Any] | None, metrics: dict[str, Any]) -> str:
    """How the run ended, in one word for machines. A robot within the goal tolerance has reached its goal."""
    if solution.result.plan is None:
        return f"planning_{solution.result.status}"
    if execution is None:
        return "refused"
    if audited is not None and not audited["passed"]:
        return "audit_failed"
    return "completed" if metrics["all_goals_reached"] else str(execution.outcome)


def _settings(file: ScenarioFile) -> ExecutionSettings:
    execution = file.scenario.execution
    _located(file, ("execution", "policy"), lambda: policy_of(execution.policy))
    settings: ExecutionSettings = _located(
        file,
        ("execution",),
        lambda: ExecutionSettings(
            policy=execution.policy,
            step_length_s=execution.step_length_s,
            time_limit_s=execution.time_limit_s,
            record_period_s=file.scenario.record.period_s,
            seed=file.scenario.seed,
            on_deadlock=execution.on_deadlock,
            disturbances=_disturbances(execution.disturbances),
        ),
    )
    return settings


def _disturbances(choice: DisturbanceChoice) -> Disturbances:
    """A duration that is not given is for good."""

    def parts(listed: Sequence[BreakdownChoice | ObstacleChoice], kind: Callable[..., Any]) -> tuple[Any, ...]:
        return tuple(kind(**each.model_dump(exclude={"duration_s"}), duration_s=each.duration_s or math.inf) for each in listed)

    scalars = choice.model_dump(exclude={"breakdowns", "obstacles"})
    return Disturbances(**scalars, breakdowns=parts(choice.breakdowns, Breakdown), obstacles=parts(choice.obstacles, Obstacle))


def _require_fit(file: ScenarioFile, graph: PlanGraph, model: RobotType) -> None:
    fleet = fleet_of(model, 1)
    shortest = float(graph.length_m.min(initial=np.inf))
    if fleet.separation_m > shortest + 1e-9:
        raise ScenarioError(
            f"{file.at('robots', 'type')}: '{model.name}' does not fit: two of them need {fleet.separation_m:.3f} m between centres, "
            f"the shortest step of '{graph.name}' is {shortest:.3f} m (raise discretisation.cell_m)"
        )


def _places(file: ScenarioFile, nav: NavGraph, graph: PlanGraph) -> tuple[IntArray, IntArray]:
    """Plan vertices of starts and goals, not assigned yet."""
    robots = file.scenario.robots
    if robots.starts is not None and robots.goals is not None:
        start = _looked_up(file, nav, graph, "starts", robots.starts[: robots.count])
        fixed = file.scenario.assignment.mode == "fixed"
        goal = _looked_up(file, nav, graph, "goals", robots.goals[: len(start)] if fixed else robots.goals)
        values, times = np.unique(goal, return_counts=True)
        if (times > 1).any():
            i, j = np.flatnonzero(goal == values[times > 1][0])[:2]
            raise ScenarioError(
                f"{file.at('robots', 'goals', int(j))}: '{robots.goals[j]}' is the goal of two robots, as '{robots.goals[i]}' is"
            )
        if fixed and len(goal) < len(start):
            raise ScenarioError(f"{file.at('robots', 'goals')}: {len(goal)} goals for {len(start)} robots with a fixed assignment")
        return start, goal
    assert robots.count is not None
    where = ("robots", "count")
    if robots.draw == "uniform":
        start, goal = _located(file, where, lambda: uniform_draw(graph, robots.count or 0, file.scenario.seed))
        return start, goal
    start, goal = _located(file, where, lambda: mrp_bench_draw(len(graph.vertex_of_station), robots.count or 0, file.scenario.seed))
    return graph.vertex_of_station[start], graph.vertex_of_station[goal]


def _looked_up(file: ScenarioFile, nav: NavGraph, graph: PlanGraph, key: str, names: list[str]) -> IntArray:
    faults, found = [], []
    for i, name in enumerate(names):
        vertex = nav.vertex_of_name.get(name)
        if vertex is None:
            known = [n for n in nav.vertex_name if n]
            faults.append(f"{file.at('robots', key, i)}: '{name}' is not a vertex of '{nav.name}'{nearest(name, known)}")
        else:
            found.append(int(graph.vertex_of_station[vertex]))
    if faults:
        raise ScenarioError(*faults)
    return np.array(found, np.int64)


def _require_reachable(file: ScenarioFile, problem: Problem) -> None:
    """Named starts and goals that can never meet are a mistake in the file, not a hard problem."""
    reach = np.isfinite(cost_matrix(problem.graph, problem.start, problem.goal, "path"))
    label, name = problem.graph.label, problem.fleet.robot_name
    if file.scenario.assignment.mode == "fixed":
        reach = reach[:, : problem.num_robots] & np.eye(problem.num_robots, dtype=bool)
    for robot in np.flatnonzero(~reach.any(1)) if len(problem.goal) >= problem.num_robots else ():
        raise ScenarioError(
            f"{file.at('robots', 'starts', int(robot))}: {name[robot]} cannot reach "
            + (f"its goal '{label(problem.goal[robot])}'" if file.scenario.assignment.mode == "fixed" else "any goal")
            + f" from '{label(problem.start[robot])}'"
        )
    for goal in np.flatnonzero(~reach.any(0)) if len(problem.goal) <= problem.num_robots else ():
        raise ScenarioError(f"{file.at('robots', 'goals', int(goal))}: no robot can reach '{label(problem.goal[goal])}'")


def _assignment(setup: SetUp) -> IntArray:
    choice, problem = setup.scenario.assignment, setup.problem
    match choice.mode:
        case "fixed":
            return np.arange(problem.num_robots, dtype=np.int64)
        case "random":
            goals = np.full(max(problem.num_robots, len(problem.goal)), -1)
            goals[: len(problem.goal)] = np.random.default_rng([problem.seed, ASSIGNMENT]).permutation(len(problem.goal))
            return goals[: problem.num_robots]
        case _:
            cost = cost_matrix(problem.graph, problem.start, problem.goal, choice.cost)
            return setup.assigner.assign(cost, setup.scenario.planner.time_limit_s)


def _located(file: ScenarioFile, place: tuple[str, ...], make: Callable[[], Any]) -> Any:
    """What `make` makes; its refusal is told with file, line and key."""
    try:
        return make()
    except MrpSumoError as error:
        raise type(error)(*(f"{file.at(*place)}: {line}" for line in str(error).splitlines())) from None
