"""Assignment, planning and the referee's verdict: what a scenario comes to before anything is driven."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.plan import Plan, PlanResult, Status, as_planned_in_steps, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive.policy import policy_of
from mrp_sumo.errors import ExecutionError, MrpSumoError, PlanError, PlugInError, count
from mrp_sumo.experiments.kernels import compiling
from mrp_sumo.experiments.staging.set_up import SetUp
from mrp_sumo.io.summary import Summary, seconds, summary, with_summary
from mrp_sumo.planning.answers import answer_of, as_supported
from mrp_sumo.planning.costs import costs_of
from mrp_sumo.planning.outside import Outside, failed
from mrp_sumo.planning.protocol import Planner
from mrp_sumo.search import distance
from mrp_sumo.traffic.clashes import clashes_of
from mrp_sumo.traffic.referee import Verdict, judge

ASSIGNMENT = 3  # purpose of the stream of chance, beside those of traffic.draw

StageReport = Callable[[str, float, float], None]  # stage, done, of


def silent(stage: str, done: float, of: float) -> None:
    """Nobody wants to know."""


@with_summary
@dataclass(frozen=True, eq=False, repr=False)
class Solution:
    """Outcome of assignment and planning, judged."""

    setup: SetUp  # with the planner
    problem: Problem  # with the assignment the plan is for
    result: PlanResult
    verdict: Verdict | None  # of the plan, if there is one
    assignment_time_s: float
    note: str = ""  # why the plan is still in steps, where that was not asked for

    @property
    def plan(self) -> Plan | None:
        """Timed visits as arrays; None when there is no plan."""
        return self.result.plan

    @property
    def status(self) -> Status:
        """Status in which planning ended."""
        return self.result.status

    @property
    def message(self) -> str:
        """Why there is no plan."""
        return self.result.message

    @property
    def is_valid(self) -> bool:
        """True if there is a plan, and the referee finds no fault in it."""
        return self.verdict is not None and self.verdict.valid

    @property
    def cost_steps(self) -> float | None:
        """Sum of costs: the steps until each robot arrives to stay, over all robots."""
        in_steps = None if self.plan is None else as_planned_in_steps(self.plan, self.problem.step_s)
        return None if in_steps is None else round(float(in_steps.end_s.sum() / self.problem.step_s), 6)

    @property
    def lower_bound_steps(self) -> float:
        """Bound that the planner proved on the sum of costs of any plan; 0 if it proved none."""
        return self.result.lower_bound_steps

    @property
    def makespan_s(self) -> float | None:
        """Planned arrival of the last robot."""
        return None if self.plan is None else float(self.plan.end_s.max(initial=0.0))

    @property
    def planning_time_s(self) -> float:
        """Wall time of the planner, without compiling."""
        return self.result.planning_time_s

    @property
    def planning_cpu_s(self) -> float | None:
        """CPU time of all threads and programs of the planner; None where it is not known."""
        return self.result.planning_cpu_s

    @property
    def _bound(self) -> str | None:
        """In the unit of the planner's costs."""
        if self.lower_bound_steps <= 0:
            return None
        if plans_in_seconds(self.setup.planner):
            return f"{seconds(self.lower_bound_steps * self.problem.step_s)} (sum of the times at which robots are there)"
        return f"{self.lower_bound_steps:g} steps"

    @property
    def _doubt(self) -> str | None:
        """Why robots may not be where the plan has them, though nothing disturbs them."""
        if self.result.retime_time_s is None or _keeps_order(self.setup):
            return None
        return f"of the plan's order; {self.setup.settings.policy} lets go whoever comes first, so robots may drive otherwise"

    @property
    def _summary(self) -> Summary:
        judged = "" if self.verdict is None else self.verdict.summary(self.problem)
        cost = None if self.cost_steps is None else f"{self.cost_steps:g} steps (sum of costs)"
        rows = [
            ("planner", self.setup.scenario.planner.name + (f": {self.result.chosen}, {self.result.why}" if self.result.chosen else "")),
            ("status", str(self.status).replace("_", " ")),
            ("why", self.message),
            ("referee", judged),
            ("cost", cost),
            ("lower bound", self._bound),
            ("makespan", seconds(self.makespan_s)),
            ("times", self._doubt),
            ("planning time", seconds(self.planning_time_s)),
            ("CPU time", seconds(self.planning_cpu_s)),
        ]
        return summary(f"Plan for {count(self.problem.num_robots, 'robot')} on {self.problem.graph.name}", rows)

    def __repr__(self) -> str:
        rows = dict(self._summary.rows)
        parts = [rows[key] for key in ("planner", "status", "cost", "makespan") if key in rows]
        doubt = "" if self.is_valid or self.plan is None else ", not valid"
        return f"<Plan for {count(self.problem.num_robots, 'robot')}: {', '.join(parts)}{doubt}>"


def solve(setup: SetUp, *, execute: bool = False, progress: StageReport = silent) -> Solution:
    """Assign and plan within the time limit, and judge the plan. A plug-in that fails is a result too.

    Where the plan will be driven, what that takes is compiled at the same time as what planning takes.
    """
    try:
        return _solve(setup, execute, progress)
    finally:
        for plug_in in (setup.planner, setup.assigner):
            if isinstance(plug_in, Outside):
                plug_in.close()


def _solve(setup: SetUp, execute: bool, report: StageReport) -> Solution:
    scenario, problem = setup.scenario, replace(setup.problem, drivable=_keeps_order(setup))
    began = time.perf_counter()
    try:
        with compiling(report, execute=execute):
            distance.prepare()
            clashes_of(problem)  # what the map's zones come to is known before planning begins, as its graph is
            with setup.file.located("planner", "parameters"):
                setup.planner.prepare()
        assigns = setup.planner.assigns
        if isinstance(setup.assigner, Outside) and scenario.assignment.mode == "optimal" and not assigns:
            with setup.file.located("assignment", "parameters"):
                setup.assigner.prepare()
    except PlugInError as error:
        return Solution(setup, problem, failed(error), None, 0.0)
    prepare_time_s = time.perf_counter() - began
    if scenario.tasks is not None:  # robots stand at their starts until they are given tasks
        stay = plan_of_paths([[v] for v in problem.start.tolist()], problem.step_s)
        return Solution(setup, problem, PlanResult(Status.SOLVED, stay, prepare_time_s=prepare_time_s), judge(problem, stay), 0.0)
    report("planning", 0.0, 0.0)
    began = time.perf_counter()
    try:
        if not assigns or scenario.assignment.mode == "fixed":
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
    if result.status is Status.INFEASIBLE and problem.barred is not None and as_supported(setup.planner, problem) is not problem:
        hint = f"'{scenario.planner.name}' uses lanes only on which all types have room; continuous, pbs and prioritised give each its own"
        result = replace(result, message=f"{result.message}; {hint}")
    if result.goal_of is not None:
        problem = problem.assigned(result.goal_of)
    if result.plan is not None:
        in_seconds = plans_in_seconds(setup.planner) and as_planned_in_steps(result.plan, problem.step_s) is None
        verdict = judge(problem, result.plan, in_seconds=in_seconds)
    solution = Solution(setup, problem, result, verdict, assignment_time_s)
    return retimed(solution, report) if verdict is not None and verdict.valid else solution


def retimed(solution: Solution, report: StageReport = silent) -> Solution:
    """Give the plan the times of real motion, if the scenario wants that and its order can be kept."""
    choice, plan = solution.setup.scenario.planner.retime, solution.result.plan
    if choice is False or plan is None:
        return solution
    from mrp_sumo.drive.retime import retime
    from mrp_sumo.drive.warm import prepare_retime

    with compiling(report, execute=False):
        prepare_retime()
    settings, problem = solution.setup.settings, solution.problem
    slack = {} if choice is True else choice.model_dump()
    began = time.perf_counter()
    try:
        plan = retime(problem, plan, settings, **slack)
    except PlugInError:  # of a policy, which is named when it is to drive
        return solution
    except (ExecutionError, PlanError) as error:
        return replace(solution, note=f"the plan is in steps of one length still: {error}")
    return replace(solution, result=replace(solution.result, plan=plan, retime_time_s=time.perf_counter() - began))


def _keeps_order(setup: SetUp) -> bool:
    """True if robots will keep the plan's order. A policy that cannot be made is reported when it has to drive."""
    try:
        return policy_of(setup.settings.policy, setup.settings.policy_parameters).keeps_order
    except MrpSumoError:
        return False


def plans_in_seconds(planner: Planner) -> bool:
    """True for planners whose times are those of real motion; others count steps."""
    return "seconds" in getattr(planner, "supports", ())


def _assignment(setup: SetUp) -> IntArray:
    choice, problem = setup.scenario.assignment, setup.problem
    match choice.mode:
        case "fixed":
            return np.arange(problem.num_robots, dtype=np.int64)
        case "random":
            rng, robot_kind = np.random.default_rng([problem.seed, ASSIGNMENT]), problem.fleet.kind
            goal_of = np.full(problem.num_robots, -1)
            for k in np.unique(robot_kind).tolist() if problem.goal_kind is not None else [-1]:
                robots = np.flatnonzero((robot_kind == k) | (k < 0))
                goals = np.arange(len(problem.goal)) if k < 0 else np.flatnonzero(problem.goal_kind == k)
                drawn = np.full(max(len(robots), len(goals)), -1)
                drawn[: len(goals)] = goals[rng.permutation(len(goals))]
                goal_of[robots] = drawn[: len(robots)]
            return goal_of
        case _:
            cost = costs_of(problem, choice.cost)
            assert setup.assigner is not None
            return setup.assigner.assign(cost, setup.scenario.planner.time_limit_s)
