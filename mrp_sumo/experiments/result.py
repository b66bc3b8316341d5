"""A run that has ended, in memory: what it came to, and everything that its run folder would hold."""

import shutil
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from mrp_sumo.core.execution import Execution, as_believed
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import NavGraph, PlanGraph
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.zone_log import ZoneLog
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.solve import Solution
from mrp_sumo.experiments.staging.set_up import SetUp
from mrp_sumo.io.floor_plan import write_costmap
from mrp_sumo.io.outline import write_outline
from mrp_sumo.io.record import RunRecord, record_of
from mrp_sumo.io.run_folder import EndedRun, result_document, write_run, write_trace_files
from mrp_sumo.maps.lifts import Shift

if TYPE_CHECKING:
    import pandas

    from mrp_sumo.io.outline import Outline
    from mrp_sumo.io.trace import Trace
    from mrp_sumo.io.trajectory import Trajectory
    from mrp_sumo.maps.costmap import Costmap


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
        return result_document(self._ended)

    @property
    def _ended(self) -> EndedRun:
        return EndedRun(
            status=self.status,
            note=self.note,
            scenario=self.setup.scenario,
            problem=self.solution.problem,
            result=self.solution.result,
            verdict=self.solution.verdict,
            execution=self.execution,
            metrics=self.metrics,
            audit=self.audit,
            operations_audit=self.operations_audit,
            error_bands=self.error_bands,
            lanes=self.lanes,
            zones=self.zones,
            nav=self.nav,
            levels=self.levels,
        )

    def write(self, out: Path, maps: MapCache) -> None:
        """Write the run folder; one that is there already is replaced.

        Raises MrpSumoError when `out` holds something else, or the disk refuses. Nothing half-written stays.
        """

        def write_map_and_bag(folder: Path) -> None:
            if self.graph.num_lanes:  # that of a recorded fleet of which nobody moved has none
                shutil.copyfile(maps.network(self.graph), folder / "network.net.xml")
            if self.costmap is not None:
                write_costmap(folder, "map", self.costmap)
            if self.outline is not None:
                write_outline(folder / "building.json", self.outline)
            if self.execution is not None and self.setup.scenario.record.bag and len(self.execution.t_s):
                from mrp_sumo.bags.writer import write_recorded_bag

                write_recorded_bag(folder / "bag", self.record, self.setup.scenario.record)

        write_run(out, self._ended, write_map_and_bag)

    @property
    def trace(self) -> "Trace | None":
        """Trace from which metrics can be computed later; None for a run that is too long to keep."""
        from mrp_sumo.io.trace import trace_of

        with TemporaryDirectory(prefix="mrp_sumo_trace_") as folder:
            write_trace_files(Path(folder), self._ended)
            return trace_of(Path(folder))
