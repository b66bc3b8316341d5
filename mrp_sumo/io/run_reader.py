"""Reading run folders: arrays for programs, DataFrames for notebooks.

Files are read on first use. Refuses folders without a complete run.
"""

from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from mrp_sumo.core.execution import Execution, Outcome, PlannerCalls, Reply
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import IntArray, NavGraph, PlanGraph, frozen
from mrp_sumo.core.plan import Plan
from mrp_sumo.errors import MrpSumoError, first_line
from mrp_sumo.files.folders import RESULT, require_run
from mrp_sumo.files.reading import read_json
from mrp_sumo.formats.plan_json import goal_headings, read_plan
from mrp_sumo.io.events import events_frame, events_of_documents, read_events
from mrp_sumo.io.floor_plan import read_floor, read_walls
from mrp_sumo.io.record import RunRecord, constants_of
from mrp_sumo.io.run_folder import SCHEMA_VERSION
from mrp_sumo.io.tables import read_table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    import pandas

    from mrp_sumo.io.outline import Outline
    from mrp_sumo.io.trajectory import Trajectory
    from mrp_sumo.maps.costmap import Costmap

T = TypeVar("T")
KINDS: dict[str, tuple[type, ...]] = {  # key of it -> types of its value
    **{"status": (str,), "scenario": (dict,), "metrics": (dict,), "files": (dict,), "versions": (dict,)},
    "plan": (dict, type(None)),
    "seed": (int,),
    "scenario.name": (str,),
}

# what readers raise for a file that was changed
DAMAGE = (ArithmeticError, AttributeError, LookupError, NotImplementedError, OSError, TypeError, ValueError)


def load_run(folder: str | Path) -> "RunFolder":
    """The run in a folder. Raises MrpSumoError when there is no complete run."""
    folder = Path(folder)
    require_run(folder)
    path = folder / RESULT
    result = read_json(path)
    if not (isinstance(result, dict) and {"status", "scenario", "metrics"} <= set(result)):
        raise MrpSumoError(f"{path}: is not the result of a run")
    for key, kinds in KINDS.items():
        first, _, last = key.rpartition(".")
        place = result[first] if first else result
        if last in place and not isinstance(place[last], kinds):
            raise MrpSumoError(f"{path}: {key}: found {type(place[last]).__name__}, expected {kinds[0].__name__}")
    if (schema := result.get("schema_version", SCHEMA_VERSION)) != SCHEMA_VERSION:
        made = result.get("versions")
        by = f", written by mrp_sumo {made['mrp_sumo']}" if isinstance(made, dict) and "mrp_sumo" in made else ""
        raise MrpSumoError(f"{path}: schema version {schema}{by}, expected {SCHEMA_VERSION}")
    return RunFolder(folder, result)


@contextmanager
def damage_in(source: str | Path) -> "Iterator[None]":
    """Faults of a source's files, as one line: while they are read, whatever is raised is damage."""
    try:
        yield
    except DAMAGE as error:
        raise MrpSumoError(f"{source}: damaged, or of another version: {type(error).__name__}: {first_line(error)}") from None


def _whole(read: "Callable[[RunFolder], T]") -> "Callable[[RunFolder], T]":
    """A reader of a run folder that says in a line what is damaged."""

    @wraps(read)
    def checked(run: "RunFolder") -> T:
        with damage_in(run.folder):
            return read(run)

    return checked


@dataclass(frozen=True, eq=False)
class RunFolder:
    """One run on disk."""

    folder: Path
    result: dict[str, Any]  # of result.json

    @property
    def source(self) -> str:
        """Origin, for messages."""
        return str(self.folder)

    @property
    def metrics(self) -> dict[str, Any]:
        return dict(self.result["metrics"])

    @property
    def audit(self) -> dict[str, Any] | None:
        audit: dict[str, Any] | None = self.result["audit"]
        return audit

    @property
    def executed(self) -> bool:
        """True if there is a trajectory. Raises MrpSumoError where it is lost."""
        return self.has("trajectory.parquet")

    @cached_property
    @_whole
    def _floor(self) -> tuple[PlanGraph, Fleet, NavGraph | None]:
        return read_floor(self.folder / "floor.json")

    @property
    def graph(self) -> PlanGraph:
        """The graph that was planned on."""
        return self._floor[0]

    @property
    def fleet(self) -> Fleet:
        return self._floor[1]

    @property
    def nav(self) -> NavGraph | None:
        """The map as drawn."""
        return self._floor[2]

    @cached_property
    @_whole
    def costmap(self) -> "Costmap | None":
        return read_walls(self.folder)

    @cached_property
    @_whole
    def outline(self) -> "Outline | None":
        """The building as drawn."""
        from mrp_sumo.io.outline import read_outline

        return read_outline(self.folder / "building.json")

    @cached_property
    @_whole
    def plan(self) -> Plan | None:
        """Visits as arrays; None when there is no plan."""
        plan = read_plan(self.folder / "plan.json", self.fleet.robot_name) if self.has("plan.json") else None
        if plan is not None and not ((plan.vertex >= 0) & (plan.vertex < self.graph.num_vertices)).all():
            raise MrpSumoError(f"{self.folder / 'plan.json'}: a visit of a vertex that floor.json does not have")
        return plan

    @cached_property
    @_whole
    def samples(self) -> "Trajectory":
        """The trajectory as arrays [T, R]."""
        from mrp_sumo.io.trajectory import read_trajectory

        self._require_trajectory()
        samples = read_trajectory(self.folder / "trajectory.parquet", self.graph.level_names)
        if samples.robot_name != self.fleet.robot_name:
            raise MrpSumoError(f"{self.folder / 'trajectory.parquet'}: its robots are others than those of floor.json")
        if not np.isfinite(samples.x_m).any():
            raise MrpSumoError(f"{self.folder / 'trajectory.parquet'}: no robot is on the floor at any time")
        return samples

    @cached_property
    @_whole
    def believed(self) -> "Trajectory | None":
        """The poses that robots believed to have, [T, R]; None where these are the true ones."""
        from mrp_sumo.io.trajectory import read_trajectory

        path = self.folder / "believed.parquet"
        return read_trajectory(path, self.graph.level_names) if self.has(path.name) else None

    @cached_property
    @_whole
    def execution(self) -> Execution:
        """Trajectory, arrivals and events as the simulation gave them; clocks from the metrics."""
        from mrp_sumo.io.facilities import DOORS, LIFTS, read_facilities
        from mrp_sumo.io.logs import BATTERY, GRANTS, STATES, read_batteries, read_grants, read_robot_states
        from mrp_sumo.io.people_table import PEOPLE, read_people
        from mrp_sumo.io.replans import REPLANS, read_replans
        from mrp_sumo.io.tasks_table import STOPS, TASKS, read_stops, read_tasks
        from mrp_sumo.io.visits import VISITS, read_arrivals

        folder, fleet, graph, metrics = self.folder, self.fleet, self.graph, self.metrics
        names, num_robots, samples, believed = fleet.robot_name, fleet.num_robots, self.samples, self.believed
        documents = read_events(folder / "events.jsonl")
        goal_s = [robot["goal_s"] for robot in self.result["robots"]]
        if len(goal_s) != num_robots:
            raise MrpSumoError(f"{folder / RESULT}: robots: found {len(goal_s)}, expected {num_robots}")
        arrived_s = read_arrivals(folder / VISITS)
        if self.plan is not None and len(arrived_s) != self.plan.num_visits:
            line = f"found {len(arrived_s)} rows, expected one for each of the plan's {self.plan.num_visits} visits"
            raise MrpSumoError(f"{folder / VISITS}: {line}")
        replies = read_replans(folder / REPLANS, graph, names) if self.has(REPLANS) else ()
        tasks = read_tasks(folder, names) if self.has(TASKS) else None
        num_orders = 0 if tasks is None else int(tasks.is_order.sum())
        has_facilities = any([self.has(LIFTS), self.has(DOORS)])
        return Execution(
            t_s=frozen(samples.t_s),
            x_m=frozen(samples.x_m),
            y_m=frozen(samples.y_m),
            yaw_rad=frozen(samples.yaw_rad),
            speed_mps=frozen(samples.speed_mps),
            arrived_s=arrived_s,
            goal_s=frozen(np.array(goal_s, np.float64)),
            outcome=Outcome(self.result["outcome"]),
            policy=self.result["policy"],
            sim_time_s=float(metrics["sim_time_s"]),
            wall_time_s=float(metrics["wall_time_s"] or 0.0),
            cpu_time_s=float(metrics["cpu_time_s"] or 0.0),
            events=events_of_documents(documents, fleet, graph),
            findings=tuple(self.result["findings"]),
            level=None if samples.level is None else frozen(samples.level),
            hitch_rad=samples.hitch_rad,
            loads=None if samples.loads is None else frozen(samples.loads),
            facilities=read_facilities(folder, names, graph.level_names) if has_facilities else None,
            people=read_people(folder / PEOPLE, samples.t_ns, samples.levels, num_robots) if self.has(PEOPLE) else None,
            believed=frozen(np.stack((believed.x_m, believed.y_m, believed.yaw_rad))) if believed else None,
            replies=replies,
            grants=read_grants(folder / GRANTS, names, num_visits(self, replies)) if self.has(GRANTS) else None,
            tasks=tasks,
            stops=read_stops(folder / STOPS, tasks, names, graph.vertex_of_name) if tasks and self.has(STOPS) else None,
            robot_states=read_robot_states(folder / STATES, names, num_orders) if tasks and self.has(STATES) else None,
            calls=_calls(self),
            batteries=read_batteries(folder / BATTERY, num_robots) if self.has(BATTERY) else None,
        )

    @property
    @_whole
    def record(self) -> RunRecord:
        """Everything that logs are made of. Raises MrpSumoError where a file is missing or damaged."""
        return RunRecord(
            name=self.result["scenario"]["name"],
            seed=self.result["seed"],
            fleet=self.fleet,
            graph=self.graph,
            target=self._target(),
            plan=self.plan,
            execution=self.execution,
            nav=self.nav,
            costmap=self.costmap,
            levels=self.samples.levels,
            goal_heading_rad=goal_headings(self.folder / "plan.json", self.fleet.robot_name) if self.plan else None,
            constants=constants_of(self.result["scenario"]),
        )

    @property
    def trajectory(self) -> "pandas.DataFrame":
        """One row per robot and sample: t_s, robot, x_m, y_m, yaw_rad, speed_mps."""
        from mrp_sumo.io.trajectory import trajectory_frame

        self._require_trajectory()
        return trajectory_frame(read_table(self.folder / "trajectory.parquet").as_written())

    @property
    def events(self) -> "pandas.DataFrame":
        """One row per event."""
        path = self.folder / "events.jsonl"
        return events_frame(read_events(path) if path.is_file() else [])

    @property
    def visits(self) -> "pandas.DataFrame":
        """One row per planned visit: robot, visit, vertex, x_m, y_m, arrive_s, depart_s, arrived_s."""
        self._require_trajectory()
        frame: pandas.DataFrame = read_table(self.folder / "visits.parquet").as_written().to_pandas()
        return frame

    def has(self, name: str) -> bool:
        """True where a file is there; raises for one that the run wrote and that is lost."""
        there = (self.folder / name).is_file()
        if not there and name in self.result.get("files", ()):
            raise MrpSumoError(f"{self.folder / name}: lost, the run wrote it")
        return there

    def _target(self) -> IntArray:
        """[R] goal vertices: where the plan ends, by index, since vertices may share a name; by name where it ends elsewhere."""
        graph = self.graph
        ends = self.plan.last_vertex.tolist() if self.plan is not None else [-1] * self.fleet.num_robots
        goals = [robot["goal"] for robot in self.result["robots"]]
        if all(goal is None for goal in goals):  # tasks come instead
            return frozen(np.zeros(0, np.int64))
        vertices = [v if v >= 0 and graph.label(v) == goal else graph.vertex_of_name[goal] for v, goal in zip(ends, goals)]
        return frozen(np.array(vertices, np.int64))

    def _require_trajectory(self) -> None:
        if not self.executed:
            raise MrpSumoError(f"{self.folder}: the run was not executed ({self.result['status']}), so it has no trajectory")


def num_visits(run: RunFolder, replies: "Sequence[Reply]") -> IntArray:
    """[R] visits of each robot along its whole way, replans included."""
    num = np.zeros(run.fleet.num_robots, np.int64) if run.plan is None else np.diff(run.plan.first)
    now = num.copy()
    for reply in replies:
        if (reply.since >= now[reply.robot]).any():
            raise MrpSumoError(f"{run.folder / 'replans.parquet'}: at {reply.t_s:g} s a robot goes on from a visit that it does not have")
        now[reply.robot] = reply.since + 1 + np.diff(reply.first)
        num = np.maximum(num, now)
    return num


def _calls(run: RunFolder) -> PlannerCalls | None:
    """How often the planner was called while robots drove, which the metrics say."""
    metrics = run.metrics
    if metrics.get("planner_calls") is None:
        return None
    counts = {name: int(metrics.get(f"planner_calls_{name}") or 0) for name in ("late", "failed", "stepped", "stopped")}
    return PlannerCalls(metrics["planner_calls"], **counts, plans_of=(run.result.get("planner") or {}).get("plans", {}))
