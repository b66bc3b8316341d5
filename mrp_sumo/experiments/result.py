"""A run that has ended, in memory: what it came to, and everything that its run folder would hold."""

import json
import shutil
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from mrp_sumo.core.execution import Execution, as_believed
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import NavGraph, PlanGraph
from mrp_sumo.core.plan import Plan, PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.zone_log import ZoneLog
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.solve import Solution
from mrp_sumo.experiments.staging.set_up import SetUp
from mrp_sumo.files.folders import RESULT
from mrp_sumo.formats.plan_json import write_plan
from mrp_sumo.io.floor_plan import write_costmap, write_floor
from mrp_sumo.io.outline import write_outline
from mrp_sumo.io.record import RunRecord, record_of
from mrp_sumo.io.run_folder import SCHEMA_VERSION, plain, versions, write_run
from mrp_sumo.maps.lifts import Shift
from mrp_sumo.traffic.referee import Conflict, Verdict

if TYPE_CHECKING:
    import pandas

    from mrp_sumo.io.outline import Outline
    from mrp_sumo.io.scenario.model import ScenarioModel
    from mrp_sumo.io.trace import Trace
    from mrp_sumo.io.trajectory import Trajectory
    from mrp_sumo.maps.costmap import Costmap

LISTED_CONFLICTS = 20
FIRST_LOOK = 0.5  # of its time limit: before, no planner does anything that depends on the clock


def levels_of(setup: SetUp, graph: PlanGraph) -> Shift:
    """The levels of a graph, and how they lie side by side."""
    return {name: setup.map.level_shift_m.get(name, (0.0, 0.0)) for name in graph.level_names}


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
    zones: ZoneLog | None = None  # how occupied they were, of a run with tasks
    lanes: dict[str, float] | None = None  # how far robots drove off the lanes of the map; None where it has none
    metric_faults: tuple[str, ...] = ()  # a line for each of the user's metrics that failed; in `note`, too
    operations_audit: dict[str, Any] | None = None  # of a run with tasks
    error_bands: dict[str, Any] | None = None  # how much its main figure moves, where that was asked for

    @property
    def source(self) -> str:
        """Name in messages."""
        return self.setup.scenario.name

    @property
    def executed(self) -> bool:
        """True if there is a trajectory."""
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
        return record_of(self.setup.scenario, self.solution.problem, self.plan, self._driven, self.nav, self.costmap, self.levels)

    @property
    def samples(self) -> "Trajectory":
        """The trajectory as arrays [T, R]."""
        from mrp_sumo.io.trajectory import trajectory_of

        return trajectory_of(self._driven, self.fleet.robot_name)

    @property
    def believed(self) -> "Trajectory | None":
        """Believed poses of robots, [T, R]; None if they are the true ones."""
        from mrp_sumo.io.trajectory import trajectory_of

        execution = self._driven
        return None if execution.believed is None else trajectory_of(as_believed(execution), self.fleet.robot_name)

    @property
    def trajectory(self) -> "pandas.DataFrame":
        """One row per robot and sample: t_s, robot, x_m, y_m, yaw_rad, speed_mps."""
        from mrp_sumo.io.trajectory import trajectory_frame, trajectory_table

        return trajectory_frame(trajectory_table(self._driven, self.fleet.robot_name, self.levels))

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

    @property
    def levels(self) -> Shift | None:
        """Those of the graph, where robots change them."""
        return None if self.execution is None or self.execution.level is None else levels_of(self.setup, self.graph)

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
        """Content of `result.json`, but for its list of files."""
        return document_of(self)

    def write(self, out: Path, maps: MapCache) -> None:
        """Write the run folder; one that is there already is replaced.

        Raises MrpSumoError when `out` holds something else, or the disk refuses. Nothing half-written stays.
        """

        def write_files(folder: Path) -> None:
            if self.graph.num_lanes:  # that of a recorded fleet of which nobody moved has none
                shutil.copyfile(maps.network(self.graph), folder / "network.net.xml")
            if self.costmap is not None:
                write_costmap(folder, "map", self.costmap)
            if self.outline is not None:
                write_outline(folder / "building.json", self.outline)
            self._write_evidence(folder)
            if self.execution is not None and self.setup.scenario.record.bag and len(self.execution.t_s):
                from mrp_sumo.bags.writer import write_recorded_bag

                write_recorded_bag(folder / "bag", self.record, self.setup.scenario.record)
            if self.zones is not None:
                from mrp_sumo.io.logs import ZONES, write_zones

                write_zones(folder / ZONES, self.zones)

        write_run(out, document_of(self), write_files)

    @property
    def trace(self) -> "Trace | None":
        """Trace from which metrics can be computed later; None for a run that is too long to keep.

        It is made of a run folder without what its map alone gives, and without a bag.
        """
        from mrp_sumo.io.trace import trace_of

        with TemporaryDirectory(prefix="mrp_sumo_trace_") as scratch:
            folder = Path(scratch)
            self._write_evidence(folder)
            document = {**document_of(self), "files": {path.name: {} for path in sorted(folder.iterdir())}}
            (folder / RESULT).write_text(json.dumps(document, ensure_ascii=False, allow_nan=False), encoding="utf-8")
            return trace_of(folder)

    def _write_evidence(self, folder: Path) -> None:
        """Write what metrics are computed from: graphs, fleet, plan and logs."""
        scenario, problem = self.setup.scenario, self.solution.problem
        write_floor(folder / "floor.json", problem.graph, problem.fleet, self.nav)
        if self.plan is not None:
            write_plan(folder / "plan.json", problem, self.plan, has_goals=scenario.tasks is None)
        if self.execution is not None:
            from mrp_sumo.io.logs import write_logs

            about = {"scenario": scenario.name, "seed": scenario.seed, "versions": versions()}
            write_logs(folder, problem, self.plan, self.execution, self.levels, about)


def document_of(run: RunResult) -> dict[str, Any]:
    """The document of a run that has ended, in JSON's types."""
    scenario, execution = run.setup.scenario, run.execution
    problem, result = run.solution.problem, run.solution.result
    document: dict[str, Any] = plain(
        {
            "schema_version": SCHEMA_VERSION,
            "status": run.status,
            "note": run.note,
            "policy": execution.policy if execution else None,
            "engine": scenario.execution.engine if execution else None,
            "outcome": str(execution.outcome) if execution else None,
            "scenario": scenario.model_dump(mode="json"),
            "seed": scenario.seed,
            "versions": versions(),
            "metrics": run.metrics,
            "audit": run.audit,
            **({} if run.operations_audit is None else {"operations_audit": run.operations_audit}),
            **({} if run.error_bands is None else {"error_bands": run.error_bands}),
            "discretisation": {"kind": problem.graph.kind, "cell_m": problem.graph.cell_m},
            "lanes": run.lanes,
            "plan": _answers(problem, result, run.solution.verdict) | {"clock_limited": _clock_limited(scenario, result)},
            **_portfolio(scenario, result, execution),
            "robots": _robots(problem, execution, has_goals=scenario.tasks is None),
            "findings": list(execution.findings) if execution else [],
        }
    )
    return document


def _answers(problem: Problem, result: PlanResult, verdict: Verdict | None) -> dict[str, Any]:
    def conflict(c: Conflict) -> dict[str, Any]:
        names, graph = problem.fleet.robot_name, problem.graph
        conflict = {"kind": c.kind, "robots": [names[c.robot], names[c.other]], "vertex": graph.label(c.vertex), "t_s": c.t_s}
        return conflict | ({"next_vertex": graph.label(c.next_vertex)} if c.next_vertex >= 0 else {})

    return {
        "status": str(result.status),
        "message": result.message,
        "stats": dict(result.stats),
        "step_s": problem.step_s,
        "summary": verdict.summary(problem) if verdict else None,
        "faults": list(verdict.faults) if verdict else [],
        "conflicts": [conflict(c) for c in verdict.conflicts[:LISTED_CONFLICTS]] if verdict else [],
    }


def _portfolio(scenario: "ScenarioModel", result: PlanResult, execution: Execution | None) -> dict[str, Any]:
    """Who answered of a portfolio, and why: of the plan, or most often while robots drove. Nothing for other planners."""
    calls = execution.calls if execution else None
    if calls is not None and scenario.planner.name == "auto":
        most = max(calls.plans_of, key=lambda name: (calls.plans_of[name], name), default="")
        return {
            "planner": {
                "chosen": most,
                "why": "most plans while robots drove" if most else "",
                "plans": dict(sorted(calls.plans_of.items())),
            }
        }
    return {"planner": {"chosen": result.chosen, "why": result.why}} if result.chosen else {}


def _clock_limited(scenario: "ScenarioModel", result: PlanResult) -> bool:
    """True if the time limit may have shaped the answer, so that another machine need not give it again."""
    used_s = result.planning_time_s if result.planning_cpu_s is None else result.planning_cpu_s
    if scenario.planner.budget:
        return used_s >= scenario.planner.time_limit_s
    return result.status is Status.TIMED_OUT or used_s >= FIRST_LOOK * scenario.planner.time_limit_s


def _robots(problem: Problem, execution: Execution | None, has_goals: bool) -> list[dict[str, Any]]:
    """Each robot's name, start, goal (None where tasks come instead) and when it came to stand there."""
    graph, goal_s = problem.graph, execution.goal_s.tolist() if execution else [None] * problem.num_robots
    ends = zip(problem.fleet.robot_name, problem.start.tolist(), problem.target.tolist(), goal_s)
    return [{"name": name, "start": graph.label(a), "goal": graph.label(b) if has_goals else None, "goal_s": t} for name, a, b, t in ends]
