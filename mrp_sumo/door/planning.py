"""Problems, plans and verdicts: a scenario is set up, planned with any planner, and its plan judged."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass, replace
from time import perf_counter
from typing import Any, cast

import numpy as np

from mrp_sumo.core import problem as core
from mrp_sumo.core.graph import frozen
from mrp_sumo.core.plan import Plan, PlanResult, Status, as_planned_in_steps, plan_of_paths
from mrp_sumo.door.maps import Site, shared_maps, site_of
from mrp_sumo.door.scenario import Scenario, dotted, required
from mrp_sumo.errors import PlanError, count
from mrp_sumo.experiments.solve import Solution, retimed, solve
from mrp_sumo.experiments.staging.set_up import SetUp, planned_as, set_up
from mrp_sumo.formats.peers import goals_reached
from mrp_sumo.io.documents import Place
from mrp_sumo.io.scenario.read import changed
from mrp_sumo.io.summary import Summary, summary, with_summary
from mrp_sumo.planning.protocol import Planner
from mrp_sumo.traffic import referee
from mrp_sumo.traffic.referee import Conflict, describe

LISTED = 8  # faults and conflicts that a verdict prints

Paths = Sequence[Sequence[int]]  # a vertex per step, for each robot


@with_summary
@dataclass(frozen=True, eq=False, repr=False)
class ScenarioProblem(core.Problem):
    """A planning problem with the scenario it comes from: graph, fleet, starts and goals; nothing is planned yet."""

    setup: SetUp = field(kw_only=True)

    @property
    def scenario(self) -> Scenario:
        return Scenario._of(self.setup.file)

    @property
    def site(self) -> Site:
        """The map."""
        return site_of(self.setup.map, self.setup.scenario.map)

    @property
    def starts(self) -> tuple[str, ...]:
        """The vertex at which each robot starts."""
        return tuple(map(self.graph.label, self.start.tolist()))

    @property
    def goals(self) -> tuple[str, ...]:
        """The goals; robot i is not bound for goal i unless the assignment is fixed."""
        return tuple(map(self.graph.label, self.goal.tolist()))

    @property
    def _summary(self) -> Summary:
        graph, chosen = self.graph, self.setup.scenario
        rows = [
            ("map", f"{graph.name}, {graph.kind} of {graph.cell_m:g} m: {_size(graph)}"),
            ("robots", f"{count(self.num_robots, 'robot')}, {self.fleet.separation_m:.2f} m apart"),
            ("starts", _listed(self.starts)),
            ("goals", _listed(self.goals)),
            ("assignment", chosen.assignment.mode),
            ("step", f"{self.step_s:g} s"),
            ("seed", self.seed),
        ]
        return summary(f"Problem {chosen.name}", rows)

    def __repr__(self) -> str:
        robots, goals = count(self.num_robots, "robot"), count(len(self.goal), "goal")
        return (
            f"<Problem {self.setup.scenario.name}: {robots}, {goals}, {self.graph.kind} of {_size(self.graph)}, {self.step_s:g} s a step>"
        )


Problem = ScenarioProblem  # as scripts know it
Function = Callable[[ScenarioProblem, float], PlanResult | Plan | Paths]


@dataclass(frozen=True, eq=False, repr=False)
class Judgement:
    """The referee's judgement of a plan; true when the plan is valid."""

    problem: core.Problem
    verdict: referee.Verdict | None  # None where there is no plan
    message: str = ""  # why there is none

    @property
    def valid(self) -> bool:
        """True for a plan of the problem without vertex and edge conflicts."""
        return self.verdict is not None and self.verdict.valid

    @property
    def faults(self) -> tuple[str, ...]:
        """Why it is no plan for this problem at all."""
        return self.verdict.faults if self.verdict else (self.message,)

    @property
    def conflicts(self) -> tuple[Conflict, ...]:
        """Vertex and edge conflicts, by time."""
        return self.verdict.conflicts if self.verdict else ()

    @property
    def following(self) -> tuple[Conflict, ...]:
        """Entries of robots into a vertex before the one on it has arrived elsewhere, by time; no plan is invalid for them."""
        return self.verdict.following if self.verdict else ()

    @property
    def lines(self) -> tuple[str, ...]:
        """Every fault, or else every conflict, in words."""
        return self.faults or tuple(describe(conflict, self.problem) for conflict in self.conflicts)

    @property
    def _head(self) -> str:
        if self.verdict is None:
            return "no plan"
        if self.valid:
            return f"valid, {count(len(self.following), 'following conflict')}"
        return f"not valid: {count(len(self.faults), 'fault')}, {count(len(self.conflicts), 'conflict')}"

    def __bool__(self) -> bool:
        return self.valid

    def __repr__(self) -> str:
        return f"<Judgement: {self._head}>"

    def __str__(self) -> str:
        more = [f"and {len(self.lines) - LISTED} more"] if len(self.lines) > LISTED else []
        return "\n  ".join([self._head, *self.lines[:LISTED], *more])

    def _repr_html_(self) -> str:
        return summary(self._head, [("", line) for line in self.lines[:LISTED]]).html


def problem(scenario: Scenario) -> ScenarioProblem:
    """Set a scenario up: load its map, draw or look up starts and goals.

    Parameters
    ----------
    scenario
        From `Scenario(...)` or `Scenario.read(...)`.

    Returns
    -------
    ScenarioProblem
        What planners plan; give it to `plan`.

    Raises
    ------
    MrpSumoError
        One line per fault: names that the map does not have, robots that do not fit, goals out of reach.

    Examples
    --------
    >>> problem = ms.problem(ms.Scenario(map="office", robots=9))
    """
    required(scenario, Scenario, "problem", "a Scenario; ms.Scenario.read(...) reads a file")
    setup = set_up(scenario.file, shared_maps())
    drawn = setup.problem
    return ScenarioProblem(**{each.name: getattr(drawn, each.name) for each in fields(drawn)}, setup=setup)


def plan(
    problem: ScenarioProblem, planner: str | Planner | Function | None = None, *, time_limit_s: float | None = None, **parameters: Any
) -> Solution:
    """Assign goals and plan.

    Parameters
    ----------
    problem
        From `problem`.
    planner
        A name such as "cbs", a file's class as "mine.py:OneByOne", an object with a planner's methods, or a function of the
        problem and the time limit that returns a Plan or a path for each robot. The scenario's planner by default.
    time_limit_s
        Wall time; the scenario's by default.
    parameters
        Of the planner, by name: `w=1.2`.

    Returns
    -------
    Solution
        With `plan`, `status`, `cost_steps`, `lower_bound_steps`, `planning_time_s`. There may be no plan: see `status` and `message`.

    Raises
    ------
    MrpSumoError
        For an unknown planner or parameter, with the nearest right one.

    Examples
    --------
    >>> ms.plan(problem, "ecbs", w=1.2, time_limit_s=10)
    """
    required(problem, ScenarioProblem, "plan", "a Problem; make one with ms.problem(scenario)")
    places: dict[Place, Any] = {}
    if time_limit_s is not None:
        places["planner", "time_limit_s"] = time_limit_s
    if planner is None:
        places["planner", "parameters"] = {**problem.setup.scenario.planner.parameters, **parameters}
    elif isinstance(planner, str):
        places |= {("planner", "name"): planner, ("planner", "parameters"): parameters}
    elif parameters:
        raise PlanError(f"plan: found {_listed(tuple(parameters))}, but a planner that is no name has its parameters already")
    setup = planned_as(problem.setup, changed(problem.setup.file, {place: (dotted(place), value) for place, value in places.items()}))
    if planner is None or isinstance(planner, str):
        return solve(setup)
    own = _with_own(setup, planner)
    solution = solve(replace(own, problem=problem))
    plain = problem.setup.problem.assigned(solution.problem.goal_of)  # replanning may send it to another process
    return replace(solution, setup=own, problem=plain)


def judge(problem: ScenarioProblem, plan: Solution | Plan) -> Judgement:
    """Ask the referee, who knows no planner, about a plan.

    Parameters
    ----------
    problem
        What the plan is for.
    plan
        From `plan`, or a Plan of your own.

    Returns
    -------
    Judgement
        True when the plan is valid; it prints its faults and conflicts.

    Raises
    ------
    MrpSumoError
        For a plan of another problem.

    Examples
    --------
    >>> print(ms.judge(problem, plan))
    valid, 3 following conflicts
    """
    solution = solution_of(problem, plan, "judge")
    return Judgement(solution.problem, solution.verdict, f"{solution.status}: {solution.message}".rstrip(": ").replace("_", " "))


def solution_of(problem: ScenarioProblem, plan: Solution | Plan, call: str) -> Solution:
    """The plan as a solution of the problem; one that was not made for it is judged first."""
    required(problem, ScenarioProblem, call, "a Problem; make one with ms.problem(scenario)")
    if isinstance(plan, Solution):
        return plan if plan.setup.problem is problem.setup.problem else _moved(problem, plan, call)
    required(plan, Plan, call, "what ms.plan returns, or a Plan")
    own = _named(problem.setup, "given", {})
    drawn = problem.setup.problem
    if plan.num_robots == drawn.num_robots:
        fixed = problem.setup.scenario.assignment.mode == "fixed"
        drawn = drawn.assigned(np.arange(drawn.num_robots) if fixed else goals_reached(drawn, plan))
    return Solution(own, drawn, PlanResult(Status.SOLVED, plan), referee.judge(drawn, plan), 0.0)


def _moved(problem: ScenarioProblem, other: Solution, call: str) -> Solution:
    """A plan made for other robots or another execution, in this problem: its paths and its order, at the pace of these robots."""
    theirs, setup, plan = other.problem, problem.setup, other.plan
    if theirs.graph.num_vertices != problem.graph.num_vertices or not np.array_equal(theirs.start, problem.start):
        raise PlanError(f"{call}: the plan is for another problem, '{other.setup.scenario.name}'")
    scenario = setup.scenario.model_copy(update={"planner": other.setup.scenario.planner})
    setup = replace(setup, file=replace(setup.file, scenario=scenario), planner=other.setup.planner)
    drawn = setup.problem.assigned(theirs.goal_of)
    if plan is None:
        return replace(other, setup=setup, problem=drawn)
    in_seconds = as_planned_in_steps(plan, theirs.step_s) is None
    plan, pace = plan.in_steps or plan, problem.step_s / theirs.step_s
    plan = Plan(plan.first, plan.vertex, frozen(plan.arrive_s * pace), frozen(plan.depart_s * pace))
    verdict = referee.judge(drawn, plan, in_seconds=in_seconds)
    moved = replace(other, setup=setup, problem=drawn, result=replace(other.result, plan=plan), verdict=verdict)
    return retimed(moved) if verdict.valid else moved


@dataclass(frozen=True)
class _Own:
    """A planner of the caller's, timed by us. It runs in this process, so that its errors and breakpoints are the caller's."""

    function: Function
    prepare: Callable[[], None]
    assigns: bool
    guarantee: str

    def plan(self, problem: core.Problem, time_limit_s: float) -> PlanResult:
        began = perf_counter()
        assert isinstance(problem, ScenarioProblem)  # the caller's, with the goals assigned
        answer = self.function(problem, time_limit_s)
        time_s = perf_counter() - began
        if isinstance(answer, PlanResult):
            return replace(answer, planning_time_s=time_s)
        if isinstance(answer, Plan):
            return PlanResult(Status.SOLVED, answer, planning_time_s=time_s)
        if isinstance(answer, Iterable) and not isinstance(answer, str | Mapping):
            plan = plan_of_paths([np.asarray(path) for path in answer], problem.step_s)
            return PlanResult(Status.SOLVED, plan, planning_time_s=time_s)
        name = getattr(self.function, "__qualname__", "the planner").rpartition("<locals>.")[2]
        raise PlanError(f"{name} returned {type(answer).__name__}, expected a PlanResult, a Plan, or a path for each robot")


def _with_own(setup: SetUp, planner: Planner | Function) -> SetUp:
    from mrp_sumo.plugins.face import check_face

    if callable(planner) and not hasattr(planner, "plan"):
        own = _Own(planner, lambda: None, False, "none")
        return replace(_named(setup, getattr(planner, "__name__", type(planner).__name__), {}), planner=own)
    check_face(planner, Planner, "planner")
    chosen = cast(Planner, planner)
    values: dict[str, Any] = {each.name: getattr(chosen, each.name) for each in fields(chosen)} if is_dataclass(chosen) else {}
    shown = {key: value for key, value in values.items() if isinstance(value, bool | int | float | str)}
    own = _Own(chosen.plan, chosen.prepare, chosen.assigns, chosen.guarantee)
    return replace(_named(setup, type(chosen).__name__, shown), planner=own)


def _named(setup: SetUp, name: str, parameters: Mapping[str, Any]) -> SetUp:
    """The setup with the name of a planner that no scenario could choose, for what is written of the run."""
    file = setup.file
    chosen = file.scenario.planner.model_copy(update={"name": name, "parameters": dict(parameters)})
    return replace(setup, file=file.having(planner=chosen))


def _size(graph: Any) -> str:
    return f"{count(graph.num_vertices, 'vertex', 'vertices')}, {count(graph.num_edges, 'edge')}"


def _listed(names: Sequence[str], limit: int = 12) -> str:
    return ", ".join(names[:limit]) + (f", ... ({len(names)})" if len(names) > limit else "")
