"""One run, from scenario to run folder: the main path of the program, stage by stage.

What cannot be planned is refused by `set_up`. From then on failures are results: a plan that is not found,
an execution that does not arrive, are written like successes.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mrp_sumo.core.execution import Execution, as_believed
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import IntArray, NavGraph, PlanGraph
from mrp_sumo.core.plan import Plan, PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive.policy import policy_of
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.errors import MrpSumoError, PlanError, PlugInError, ScenarioError
from mrp_sumo.experiments.kernels import compiling
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.set_up import SetUp, set_up, with_time_limit
from mrp_sumo.io.record import RunRecord, record_of
from mrp_sumo.io.run_folder import check_replaceable, plain, result_document, write_run
from mrp_sumo.io.scenario import ScenarioFile
from mrp_sumo.io.summary import Summary, count, seconds, summary
from mrp_sumo.maps.clearance import standing_walls
from mrp_sumo.planning.answers import answer_of
from mrp_sumo.planning.costs import cost_matrix
from mrp_sumo.planning.outside import Outside, failed
from mrp_sumo.search import distance
from mrp_sumo.traffic.referee import Verdict, judge

if TYPE_CHECKING:
    import pandas

    from mrp_sumo.io.outline import Outline
    from mrp_sumo.io.trajectory import Trajectory
    from mrp_sumo.maps.costmap import Costmap

POLICY_FAILED = "policy_failed"  # the status of a run whose policy, a plug-in, broke its contract
PLUG_IN_FAILED = (str(Status.PLANNER_FAILED), POLICY_FAILED)
ASSIGNMENT = 3  # purpose of the stream of chance, beside those of traffic.draw

Progress = Callable[[str, float, float], None]  # (stage, done, of)


@dataclass(frozen=True, eq=False, repr=False)
class Solution:
    """What assignment and planning came to, judged."""

    setup: SetUp  # with the planner
    problem: Problem  # with the assignment the plan is for
    result: PlanResult
    verdict: Verdict | None  # of the plan, if there is one
    assignment_time_s: float

    @property
    def plan(self) -> Plan | None:
        """Timed visits as arrays; None when there is no plan."""
        return self.result.plan

    @property
    def status(self) -> Status:
        """How planning ended."""
        return self.result.status

    @property
    def message(self) -> str:
        """Why there is no plan."""
        return self.result.message

    @property
    def is_valid(self) -> bool:
        """Whether there is a plan, and the referee has nothing against it."""
        return self.verdict is not None and self.verdict.valid

    @property
    def cost_steps(self) -> float | None:
        """Sum of costs: the steps until each robot arrives to stay, over all robots."""
        return None if self.plan is None else round(float(self.plan.end_s.sum() / self.problem.step_s), 6)

    @property
    def lower_bound_steps(self) -> float:
        """What the planner proved about the sum of costs of any plan; 0 where it proved nothing."""
        return self.result.lower_bound_steps

    @property
    def makespan_s(self) -> float | None:
        """When the last robot arrives, as planned."""
        return None if self.plan is None else float(self.plan.end_s.max(initial=0.0))

    @property
    def planning_time_s(self) -> float:
        """Wall time of the planner, without compiling."""
        return self.result.planning_time_s

    @property
    def _summary(self) -> Summary:
        found = "" if self.verdict is None else self.verdict.summary(self.problem)
        cost = None if self.cost_steps is None else f"{self.cost_steps:g} steps (sum of costs)"
        rows = [
            ("planner", self.setup.scenario.planner.name),
            ("status", str(self.status).replace("_", " ")),
            ("why", self.message),
            ("referee", found),
            ("cost", cost),
            ("lower bound", f"{self.lower_bound_steps:g} steps" if self.lower_bound_steps > 0 else None),
            ("makespan", seconds(self.makespan_s)),
            ("planning time", seconds(self.planning_time_s)),
        ]
        return summary(f"Plan for {count(self.problem.num_robots, 'robot')} on {self.problem.graph.name}", rows)

    def __repr__(self) -> str:
        rows = dict(self._summary.rows)
        parts = [rows[key] for key in ("planner", "status", "cost", "makespan") if key in rows]
        doubt = "" if self.is_valid or self.plan is None else ", not valid"
        return f"<Plan for {count(self.problem.num_robots, 'robot')}: {', '.join(parts)}{doubt}>"

    def __str__(self) -> str:
        return self._summary.text

    def _repr_html_(self) -> str:
        return self._summary.html


@dataclass(frozen=True, eq=False)
class RunResult:
    """A run that has ended."""

    setup: SetUp
    status: str  # how it ended, in one word for machines
    note: str  # why, or what was done otherwise than the scenario says
    solution: Solution
    execution: Execution | None
    audit: dict[str, Any] | None
    metrics: dict[str, Any]  # JSON values by name
    details: str = ""  # the traceback of a plug-in that failed

    @property
    def source(self) -> str:
        """What it is called in messages."""
        return self.setup.scenario.name

    @property
    def executed(self) -> bool:
        """Whether there is a trajectory."""
        return self.execution is not None

    @property
    def plan(self) -> Plan | None:
        """Visits as arrays; None when there is no plan."""
        return self.solution.result.plan

    @property
    def graph(self) -> PlanGraph:
        """The graph that was planned on."""
        return self.solution.problem.graph

    @property
    def fleet(self) -> Fleet:
        return self.solution.problem.fleet

    @property
    def nav(self) -> NavGraph:
        """The map as drawn."""
        return self.setup.map.nav

    @property
    def record(self) -> RunRecord:
        """Everything logs are made of. Raises MrpSumoError when nothing was driven."""
        return record_of(self.setup.scenario, self.solution.problem, self.plan, self._driven, self.nav, self.costmap)

    @property
    def samples(self) -> "Trajectory":
        """The trajectory as arrays [T, R]."""
        from mrp_sumo.io.trajectory import trajectory_of

        return trajectory_of(self._driven, self.fleet.robot_name)

    @property
    def believed(self) -> "Trajectory | None":
        """Where robots took themselves to be, [T, R]; None where that is where they were."""
        from mrp_sumo.io.trajectory import trajectory_of

        execution = self._driven
        return None if execution.believed is None else trajectory_of(as_believed(execution), self.fleet.robot_name)

    @property
    def trajectory(self) -> "pandas.DataFrame":
        """One row per robot and sample: t_s, robot, x_m, y_m, yaw_rad, speed_mps."""
        from mrp_sumo.io.trajectory import trajectory_frame, trajectory_table

        return trajectory_frame(trajectory_table(self._driven, self.fleet.robot_name))

    @property
    def events(self) -> "pandas.DataFrame":
        """One row per event."""
        from mrp_sumo.io.events import event_documents, events_frame

        return events_frame(event_documents(self.execution, self.fleet, self.graph) if self.execution else [])

    @property
    def visits(self) -> "pandas.DataFrame":
        """One row per planned visit: robot, visit, vertex, x_m, y_m, arrive_s, depart_s, arrived_s."""
        from mrp_sumo.io.visits import visits_table

        execution = self._driven
        assert self.plan is not None
        frame: pandas.DataFrame = visits_table(self.solution.problem, self.plan, execution).to_pandas()
        return frame

    @property
    def _driven(self) -> Execution:
        if self.execution is None:
            raise MrpSumoError(f"{self.source}: the run was not executed ({self.status}), so it has no trajectory")
        return self.execution

    @cached_property
    def costmap(self) -> "Costmap | None":
        """The walls as sensors see them."""
        from mrp_sumo.maps.costmap import costmap

        map_ = self.setup.map
        return costmap(map_.building, map_.nav.level_names[0]) if map_.building else None

    @cached_property
    def outline(self) -> "Outline | None":
        """The building as drawn."""
        from mrp_sumo.io.outline import outline_of

        map_ = self.setup.map
        return outline_of(map_.building, map_.nav.level_names) if map_.building else None

    @cached_property
    def result(self) -> dict[str, Any]:
        """What `result.json` holds, but for its list of files."""
        return result_document(**self._told)

    @property
    def _told(self) -> dict[str, Any]:
        """What the run folder is told of the run."""
        return {
            "status": self.status,
            "note": self.note,
            "scenario": self.setup.scenario,
            "problem": self.solution.problem,
            "result": self.solution.result,
            "verdict": self.solution.verdict,
            "execution": self.execution,
            "metrics": self.metrics,
            "audit": self.audit,
        }

    def write(self, out: Path, maps: MapCache) -> None:
        """Write the run folder; one that is there already is replaced.

        Parameters
        ----------
        out
            The folder.
        maps
            Where the SUMO network comes from.

        Raises
        ------
        MrpSumoError
            When `out` holds something else, or the disk refuses. Nothing half-written stays.
        """
        from mrp_sumo.bags.writer import write_recorded_bag

        write_run(
            out,
            **self._told,
            network=maps.network(self.solution.problem.graph),
            nav=self.setup.map.nav,
            costmap=self.costmap,
            outline=self.outline,
            write_bag=write_recorded_bag,
        )


def solve(setup: SetUp, *, execute: bool = False, progress: Progress | None = None) -> Solution:
    """Assign and plan within the time limit, and judge the plan. A plug-in that fails is a result too.

    Parameters
    ----------
    setup
        Of one problem.
    execute
        Whether the plan will be driven: what that takes is compiled at the same time as what planning takes.
    progress
        Called with the stage and how far it is.
    """
    try:
        return _solve(setup, execute, progress or _silent)
    finally:
        for plug_in in (setup.planner, setup.assigner):
            if isinstance(plug_in, Outside):
                plug_in.close()


def _solve(setup: SetUp, execute: bool, report: Progress) -> Solution:
    scenario, problem = setup.scenario, setup.problem
    began = time.perf_counter()
    try:
        with compiling(report, execute=execute):
            distance.prepare()
            with _located(setup.file, "planner", "parameters"):
                setup.planner.prepare()
        assigns = setup.planner.assigns
        if isinstance(setup.assigner, Outside) and scenario.assignment.mode == "optimal" and not assigns:
            with _located(setup.file, "assignment", "parameters"):
                setup.assigner.prepare()
    except PlugInError as error:
        return Solution(setup, problem, failed(error), None, 0.0)
    prepare_time_s = time.perf_counter() - began
    report("planning", 0.0, 0.0)
    began = time.perf_counter()
    try:
        if not assigns:
            problem = problem.assigned(_assignment(setup))
    except PlugInError as error:
        return Solution(setup, problem, replace(failed(error), prepare_time_s=prepare_time_s), None, time.perf_counter() - began)
    except PlanError as error:
        result = PlanResult(Status.INFEASIBLE, prepare_time_s=prepare_time_s, message=str(error))
        return Solution(setup, problem, result, None, time.perf_counter() - began)
    assignment_time_s = time.perf_counter() - began
    result = answer_of(setup.planner, problem, scenario.planner.time_limit_s)
    result = replace(result, prepare_time_s=prepare_time_s)
    verdict = None
    if result.goal_of is not None:
        problem = problem.assigned(result.goal_of)
    if result.plan is not None:
        verdict = judge(problem, result.plan)
    return Solution(setup, problem, result, verdict, assignment_time_s)


def run_scenario(file: ScenarioFile, out: Path, *, progress: Progress | None = None, gui: bool = False) -> RunResult:
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

    Raises
    ------
    MrpSumoError
        When the scenario cannot be run at all; nothing is written.
    """
    check_replaceable(out)
    with MapCache() as maps:
        result = carry_out(file, maps, progress=progress, gui=gui)
        (progress or _silent)("writing the run folder", 0.0, 0.0)
        result.write(out, maps)
    return result


def carry_out(
    file: ScenarioFile, maps: MapCache, *, execute: bool = True, progress: Progress | None = None, gui: bool = False
) -> RunResult:
    """Run a scenario and measure it; writes nothing.

    Parameters
    ----------
    file
        The scenario.
    maps
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
    report = progress or _silent
    report("loading the map", 0.0, 0.0)
    setup = set_up(file, maps)
    return finish(setup, solve(setup, execute=execute, progress=progress), maps, execute=execute, progress=progress, gui=gui)


def finish(
    setup: SetUp, solution: Solution, maps: MapCache, *, execute: bool = True, progress: Progress | None = None, gui: bool = False
) -> RunResult:
    """Drive what was planned, if there is a plan, and measure it.

    Parameters
    ----------
    setup, solution
        Of one problem; the setup says how to drive.
    maps, execute, progress, gui
        As for `carry_out`.
    """
    from mrp_sumo.metrics.audit import at_walls, audit
    from mrp_sumo.metrics.evaluate import evaluate
    from mrp_sumo.metrics.own import guarded
    from mrp_sumo.metrics.registry import METRICS

    report = progress or _silent
    execution, note, details, broken = None, solution.result.message, solution.result.details, ""
    if execute and solution.result.plan is not None:
        setup = with_time_limit(setup, solution.result.plan)
        report("building the SUMO network", 0.0, 0.0)
        network = maps.network(solution.problem.graph, setup.map.building if gui else None)
        try:
            execution, note = _execute(setup, solution, network, report, gui)
        except PlugInError as error:
            note, details, broken = str(error), error.details, POLICY_FAILED
    report("measuring", 0.0, 0.0)
    problem, choice = solution.problem, setup.scenario.execution
    walls = standing_walls(setup.map.building, setup.map.nav.level_names) if setup.map.building else None
    audited = audit(execution, problem.fleet, problem.graph.level[problem.start], walls) if execution else None
    note = "; ".join(filter(None, (note, at_walls(audited) if audited else "")))
    faults: list[PlugInError] = []
    own = [guarded(name, setup.file.folder, faults.append) for name in setup.scenario.record.metrics]
    metrics = evaluate(
        solution.problem,
        solution.result,
        solution.verdict,
        execution,
        audited,
        assignment_time_s=solution.assignment_time_s,
        time_limit_s=setup.settings.time_limit_s,
        tolerance_m=choice.goal_tolerance_m,
        metrics=(*METRICS, *own),
    )
    if faults:
        note, details = "; ".join(filter(None, (note, *map(str, faults)))), details or faults[0].details
    status = broken or (_status(solution, execution, audited, metrics) if execute or solution.result.plan is None else "planned")
    return RunResult(setup, status, note, solution, execution, audited, plain(metrics), details)


@contextmanager
def _located(file: ScenarioFile, *place: str) -> Iterator[None]:
    """Say where the scenario is wrong, of which only a plug-in itself can tell."""
    try:
        yield
    except ScenarioError as error:
        raise ScenarioError(*(f"{file.at(*place)}: {line}" for line in error.lines)) from None


def _silent(stage: str, done: float, of: float) -> None:
    """Nobody wants to know."""


def _execute(setup: SetUp, solution: Solution, network: Path, report: Progress, gui: bool) -> tuple[Execution | None, str]:
    """The execution, and a line on what was done otherwise than the scenario says."""
    from mrp_sumo.drive import warm
    from mrp_sumo.drive.fit import lift_ride
    from mrp_sumo.drive.loop import simulate

    warm.prepare()
    plan, verdict, settings = solution.result.plan, solution.verdict, setup.settings
    name = setup.scenario.execution.policy.name
    with _located(setup.file, "execution", "policy"):
        policy = policy_of(settings.policy, settings.policy_parameters)
    assert plan is not None and verdict is not None

    def drive(settings: ExecutionSettings) -> Execution:
        def progress(t_s: float, at_goal: int) -> None:
            report(f"driving, {at_goal} of {solution.problem.num_robots} at their goals", t_s, settings.time_limit_s)

        run = simulate(solution.problem, plan, settings, network, progress=progress, gui=gui)
        return replace(run, policy=name) if settings is setup.settings else run

    if verdict.faults:
        return None, f"not executed: {verdict.summary(solution.problem)}"
    if ride := lift_ride(solution.problem, plan):
        return None, f"not executed: {ride}"
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
    return "completed" if metrics["all_goals_reached"] else str(execution.outcome)


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
