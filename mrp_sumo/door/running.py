"""Runs: plans driven in SUMO, looked at, kept and replayed."""

import html
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import PlanGraph
from mrp_sumo.core.plan import Plan, Status
from mrp_sumo.door.maps import shared_maps
from mrp_sumo.door.planning import Problem, solution_of
from mrp_sumo.door.scenario import Scenario, required
from mrp_sumo.errors import MrpSumoError, PlanError, count
from mrp_sumo.experiments.result import RunResult
from mrp_sumo.experiments.run import RunOptions, carry_out, finish
from mrp_sumo.experiments.solve import Solution, StageReport, retimed, silent
from mrp_sumo.experiments.staging.set_up import driven_as
from mrp_sumo.io import run_reader
from mrp_sumo.io.documents import Place
from mrp_sumo.io.run_summary import run_summary
from mrp_sumo.io.scenario.read import changed
from mrp_sumo.io.summary import Summary, seconds, summary, with_summary

if TYPE_CHECKING:
    import pandas

    from mrp_sumo.io.trajectory import Trajectory
    from mrp_sumo.reports.pictures.picture import Picture

SHAPES_PROBLEM = ("mutex_groups", "one_way", "doors", "manual_doors", "step_length_s")  # keys of `execution` that say what is planned


@with_summary
@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A run that has ended: just now, or long ago in the folder it was read from."""

    content: RunResult | run_reader.RunFolder

    @property
    def status(self) -> str:
        """Its end in one word: 'completed', 'time_limit', 'refused', 'planning_timed_out', ..."""
        return str(self.result["status"])

    @property
    def note(self) -> str:
        """Why, or what was done otherwise than the scenario says."""
        return str(self.result.get("note", ""))

    @property
    def metrics(self) -> dict[str, Any]:
        """Every metric by name; None where one does not exist."""
        return self.content.metrics

    @property
    def audit(self) -> dict[str, Any] | None:
        """The audit of the trajectory; None where nothing was driven."""
        return self.content.audit

    @property
    def result(self) -> dict[str, Any]:
        """As in `result.json`."""
        return self.content.result

    @property
    def folder(self) -> Path | None:
        """The run folder it was read from; None for a run in memory."""
        return self.content.folder if isinstance(self.content, run_reader.RunFolder) else None

    @property
    def executed(self) -> bool:
        """True where there is a trajectory."""
        return self.content.executed

    @property
    def plan(self) -> Plan | None:
        """Visits as arrays; None when there is no plan."""
        return self.content.plan

    @property
    def graph(self) -> PlanGraph:
        """The graph that was planned on."""
        return self.content.graph

    @property
    def fleet(self) -> Fleet:
        return self.content.fleet

    @property
    def trajectory(self) -> "pandas.DataFrame":
        """One row per robot and sample: t_s, robot, x_m, y_m, yaw_rad, speed_mps."""
        return self.content.trajectory

    @property
    def visits(self) -> "pandas.DataFrame":
        """One row per planned visit: robot, visit, vertex, x_m, y_m, arrive_s, depart_s, arrived_s."""
        return self.content.visits

    @property
    def events(self) -> "pandas.DataFrame":
        """One row per event: t_s, kind, robot, vertex, x_m, y_m, other, duration_s, text."""
        return self.content.events

    @property
    def samples(self) -> "Trajectory":
        """The trajectory as arrays [T, R]."""
        return self.content.samples

    @property
    def believed(self) -> "Trajectory | None":
        """The poses that robots believed to have, [T, R]; None where these are the true ones."""
        return self.content.believed

    @property
    def execution(self) -> Execution | None:
        """Trajectory, arrivals and events as arrays."""
        return self.content.execution

    def plot(self, at_s: float | None = None) -> "Picture":
        """Draw the run at a moment: robots with heading and state, where they came from, where the plan has them.

        Parameters
        ----------
        at_s
            Simulated time; halfway by default.

        Returns
        -------
        Picture
            A matplotlib figure that notebooks show by themselves; `write` saves it as PNG or SVG.

        Raises
        ------
        MrpSumoError
            For a time outside the run, and for a run without plan and trajectory.
        """
        from mrp_sumo.reports.pictures.still import still
        from mrp_sumo.reports.pictures.view import view_record

        if at_s is None:
            at_s = round(float(view_record(self.content).execution.t_s[-1]) / 2, 1)
        return still(self.content, at_s)

    def replay(self) -> "Replay":
        """The page that replays the run; notebooks show it, `write` makes a file of it for any browser.

        Raises
        ------
        MrpSumoError
            For a run without plan and trajectory.
        """
        from mrp_sumo.reports.replay.page import page_of

        return Replay(self.content.source, page_of(self.content))

    def save(self, folder: str | Path) -> Path:
        """Write the run folder, as `mrp-sumo run` does: everything above, and the rosbag.

        Parameters
        ----------
        folder
            A run folder that is there already is replaced.

        Raises
        ------
        MrpSumoError
            When the folder holds something else, or the run is in a folder already.
        """
        if isinstance(self.content, run_reader.RunFolder):
            raise MrpSumoError(f"{self.content.source}: is a run folder already; copy it")
        self.content.write(Path(folder), shared_maps())
        return Path(folder)

    @property
    def _summary(self) -> Summary:
        lines = run_summary(self.result)
        return summary(f"Run {lines.title}", [*lines.rows, ("folder", self.folder)])

    def __repr__(self) -> str:
        m, result = self.metrics, self.result
        parts = [self.status.replace("_", " "), count(m["num_robots"], "robot"), result["scenario"]["planner"]["name"], result["policy"]]
        parts.append(seconds(m.get("execution_time_s")))
        return f"<Run {result['scenario']['name']}: {', '.join(part for part in parts if part)}>"


@dataclass(frozen=True, repr=False)
class Replay:
    """A page that replays a run, without a network."""

    name: str
    page: str  # HTML

    def write(self, path: str | Path) -> Path:
        """Write the page for any browser.

        Raises
        ------
        MrpSumoError
            When it cannot be written.
        """
        from mrp_sumo.reports.replay.page import write_page

        return write_page(self.page, Path(path))

    def __repr__(self) -> str:
        return f"<Replay {self.name}: {len(self.page.encode()) / 1e6:.1f} MB of HTML; write(path) makes a file of it>"

    def _repr_html_(self) -> str:
        return f'<iframe srcdoc="{html.escape(self.page)}" style="width: 100%; height: 640px; border: 0"></iframe>'


def simulate(
    problem: Problem,
    plan: Solution | Plan,
    policy: str | Mapping[str, Any] | None = None,
    *,
    progress: StageReport | None = None,
    **execution: Any,
) -> Run:
    """Drive a plan in SUMO, and measure it.

    Parameters
    ----------
    problem
        What the plan is for.
    plan
        From `plan`, or a Plan of your own.
    policy
        Who may enter which vertex when: "adg", "timed", "open_loop", "mine.py:Mine", or name and parameters; the scenario's by default.
    progress
        Called with the stage, the simulated time in s and its limit.
    execution
        Other keys of a scenario's section `execution`: `time_limit_s=600`, `disturbances={"stops_per_s": 0.01}`.

    Returns
    -------
    Run
        With `metrics`, `trajectory`, `plot()`, `replay()`, `save(folder)`.

    Raises
    ------
    MrpSumoError
        When there is no plan to drive, for an unknown policy or key, and when it cannot be driven.

    Examples
    --------
    >>> run = ms.simulate(problem, plan, policy="adg")
    >>> run.metrics["execution_time_s"]
    """
    solution = solution_of(problem, plan, "simulate")
    if isinstance(plan, Plan) and solution.is_valid:
        solution = retimed(solution)
    if solution.plan is None:
        why = f": {solution.message}" if solution.message else ""
        raise PlanError(f"simulate: there is no plan to drive, {solution.setup.scenario.planner.name} {_ended(solution)}{why}")
    for key in SHAPES_PROBLEM:
        if key in execution:
            raise PlanError(f"simulate: {key} decides what there is to plan; give it to the scenario")
    keys: Mapping[str, Any] = execution if policy is None else {"policy": policy, **execution}
    places: dict[Place, tuple[str, Any]] = {("execution", key): (f"simulate: {key}", value) for key, value in keys.items()}
    setup = driven_as(solution.setup, changed(solution.setup.file, places))
    return Run(finish(setup, solution, shared_maps(), RunOptions(progress=progress or silent)))


def run(scenario: Scenario, *, progress: StageReport | None = None) -> Run:
    """Plan, drive and measure a scenario.

    Parameters
    ----------
    scenario
        From `Scenario(...)` or `Scenario.read(...)`.
    progress
        Called with the stage, and how far it is of how much.

    Returns
    -------
    Run
        Also when no plan was found: see its `status`.

    Raises
    ------
    MrpSumoError
        When the scenario cannot be run at all.

    Examples
    --------
    >>> ms.run(ms.Scenario(map="office", robots=9)).save("runs/office")
    """
    required(scenario, Scenario, "run", "a Scenario; ms.Scenario.read(...) reads a file")
    return Run(carry_out(scenario.file, shared_maps(), RunOptions(progress=progress or silent)))


def load_run(folder: str | Path) -> Run:
    """Read a run folder.

    Parameters
    ----------
    folder
        As `mrp-sumo run --out` or `Run.save` made it.

    Raises
    ------
    MrpSumoError
        When there is no complete run.
    """
    return Run(run_reader.load_run(folder))


def _ended(solution: Solution) -> str:
    ends = {Status.TIMED_OUT: "ran out of time", Status.INFEASIBLE: "found it infeasible", Status.GAVE_UP: "gave up"}
    return ends.get(solution.status, "failed")
