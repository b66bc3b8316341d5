"""Runs of real fleets: a recorded stream of VDA 5050 as a run folder, so that pages, metrics and the audit serve it like any other run.

The graph is that of the orders: their nodes and edges, and whatever vehicles drove besides. There is no plan but what was driven: visits
have the times at which vehicles said that they passed nodes. Poses are those of states and visualizations, straight in between. Errors
become events. Each `mapId` is a level; levels lie side by side as those of maps do, and what leads from one to another is a ride.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.battery import BatteryLog
from mrp_sumo.core.execution import RECORDED, Event, Execution, Outcome
from mrp_sumo.core.fleet import LIMITS, Fleet, fleet_of_types
from mrp_sumo.core.graph import FloatArray, IntArray, NavGraph, PlanGraph, Properties, frozen, nav_graph, plan_graph
from mrp_sumo.core.plan import Plan, PlanResult, Status, plan_of_visits
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.result import RunResult
from mrp_sumo.experiments.solve import Solution
from mrp_sumo.experiments.staging.choices import choices
from mrp_sumo.experiments.staging.set_up import SetUp
from mrp_sumo.formats.vda.messages import STANDING_MPS, serials_of
from mrp_sumo.formats.vda.recorded import Recorded, RecordedLog, read_log
from mrp_sumo.io.run_folder import plain
from mrp_sumo.io.scenario.read import scenario_of
from mrp_sumo.maps.clearance import standing_walls
from mrp_sumo.maps.levels import laid_out, shifts_of
from mrp_sumo.maps.lifts import Shift
from mrp_sumo.maps.map import Map

SAMPLE_S = 0.1
LONGEST_S = 24 * 3600.0
SHORTEST_LANE_M = 1e-3
STAYS_M = 0.05  # of a node, for as long as a vehicle has not left it
LIFT = "lift"  # by which vehicles change levels; nothing says what it is called
WAITS = ("blocked",)  # types of errors that are waits; others are disturbances


def recorded_run(path: Path, model: RobotType, drawn: Map | None = None) -> RunResult:
    """The run that a log (see `formats.vda.recorded`) tells of, of vehicles as a model has them where their factsheets do not say.

    Without a map, for its walls, the nodes of orders are all there is. Raises MrpSumoError for a log that cannot be read, of more than a
    day, or that says too little.
    """
    log = read_log(path)
    vehicles = list(log.vehicles.values())
    begin_s = min(vehicle.t_s[0] for vehicle in vehicles)
    span_s = max(vehicle.t_s[-1] for vehicle in vehicles) - begin_s
    if span_s > LONGEST_S:
        raise MrpSumoError(f"{path.name}: {span_s / 3600:.1f} h from the first pose to the last, expected a day at most: cut it")
    fleet = _fleet(vehicles, model)
    graph, shift, ways = _graph(log, vehicles, begin_s, path.stem, drawn)
    xy = graph.xy - shifts_of(graph.level_names, shift)[graph.level]
    leave_s = [_departures(vehicle, xy[vertex], at_s + begin_s) - begin_s for vehicle, (vertex, at_s) in zip(vehicles, ways)]
    plan = plan_of_visits([(vertex, at_s, left_s) for (vertex, at_s), left_s in zip(ways, leave_s)])
    step_s = round(float(graph.length_m.max(initial=1.0)) / float(fleet.max_speed_mps.min()), 3)  # for the longest lane, as for others
    problem = Problem(graph, fleet, plan.vertex[plan.first[:-1]], plan.last_vertex, np.arange(plan.num_robots), step_s)
    execution = _execution(vehicles, begin_s, span_s, plan, graph, shift)
    values = {
        "map": str(drawn.path if drawn else path),
        "discretisation": {"kind": "roadmap", "cell_m": graph.cell_m},
        "robots": {"count": len(vehicles), "type": {key: getattr(model, key) for key in LIMITS}},
        "planner": "prioritised",
        "execution": {"engine": "kinematic", "time_limit_s": max(execution.sim_time_s, SAMPLE_S)},
        "record": {"bag": False, "period_s": SAMPLE_S},
    }
    file = scenario_of(values, Path.cwd(), path.stem)
    _, planner, assigner, settings = choices(file)
    map_ = replace(drawn, nav=graph, level_shift_m=shift) if drawn else Map(name=graph.name, path=path, nav=graph, level_shift_m=shift)
    setup = SetUp(file, map_, problem, assigner, planner, settings)
    walls = standing_walls(drawn.building, graph.level_names) if drawn and drawn.building else None
    note = f"recorded: {len(vehicles)} vehicles of {path.name}, {span_s:.0f} s"
    return finished(setup, plan, execution, note, settings.time_limit_s, walls)


def finished(setup: SetUp, plan: Plan, execution: Execution, note: str, time_limit_s: float, walls: FloatArray | None = None) -> RunResult:
    """The result of a run that was recorded: judged, audited and measured."""
    from mrp_sumo.metrics.audit import audit
    from mrp_sumo.metrics.evaluate import evaluate
    from mrp_sumo.metrics.metric import Evidence
    from mrp_sumo.traffic.referee import judge

    problem = setup.problem
    result, verdict = PlanResult(Status.SOLVED, plan, np.arange(problem.num_robots)), judge(problem, plan, in_seconds=True)
    audited = audit(execution, problem.fleet, problem.graph.level[problem.start], walls)
    metrics = evaluate(Evidence(problem, result, verdict, execution, audited, time_limit_s=time_limit_s))
    status = "audit_failed" if audited["num_overlaps"] else "completed"
    return RunResult(setup, status, note, Solution(setup, problem, result, verdict, 0.0), execution, audited, plain(metrics))


def samples_s(span_s: float) -> FloatArray:
    """[T] times of the samples of a span."""
    return np.round(np.arange(math.floor(span_s / SAMPLE_S + 1e-6) + 1) * SAMPLE_S, 9)


class Between(NamedTuple):
    """Poses at T times, straight in between reports; on the way from one level to another as the nearer report has it."""

    xy: FloatArray  # [T, 2] m
    yaw_rad: FloatArray  # [T]
    level: IntArray  # [T]
    gap_s: FloatArray  # [T] between the reports around


def between(t_s: FloatArray, at_s: FloatArray, xy: FloatArray, yaw_rad: FloatArray, level: IntArray) -> Between:
    """Poses at times [T], of N reports at ascending ones."""
    after = np.clip(np.searchsorted(at_s, t_s), min(1, len(at_s) - 1), len(at_s) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(t_s - at_s[before] <= at_s[after] - t_s, before, after)
    rides = level[before] != level[after]  # nothing lies between
    places = [np.where(rides, xy[nearest, k], np.interp(t_s, at_s, xy[:, k])) for k in (0, 1)]
    yaw = wrapped(np.interp(t_s, at_s, np.unwrap(yaw_rad)))
    return Between(np.stack(places, 1), yaw, level[nearest], at_s[after] - at_s[before])


def _fleet(vehicles: list[Recorded], model: RobotType) -> Fleet:
    """Names are serial numbers, bodies those of factsheets: vehicles with equal ones are of one type."""
    bodies = [tuple(vehicle.body.get(name, getattr(model, name)) for name in LIMITS) for vehicle in vehicles]
    distinct = sorted(set(bodies))
    fleet = fleet_of_types([replace(model, **dict(zip(LIMITS, body))) for body in distinct], np.array([distinct.index(b) for b in bodies]))
    return replace(fleet, robot_name=tuple(serials_of([vehicle.serial for vehicle in vehicles])))


def _graph(
    log: RecordedLog, vehicles: list[Recorded], begin_s: float, name: str, drawn: Map | None
) -> tuple[PlanGraph, Shift, list[tuple[IntArray, FloatArray]]]:
    """The graph, how far its levels were moved to lie side by side, and each vehicle's visits with their times.

    A vehicle that begins where another did begins at a vertex of its own.
    """
    places = dict(log.nodes)
    for vehicle in vehicles:
        for t_s, node, _, _ in vehicle.passed:
            if node not in places:
                places[node] = _pose_at(vehicle, t_s)
    edges, starts, visits = {e for e in log.edges if all(n in places for n in e)}, set[str](), []
    for vehicle in vehicles:
        nodes = [(node, max(0.0, t_s - begin_s)) for t_s, node, _, _ in vehicle.passed]
        nodes = [here for k, here in enumerate(nodes) if not k or here[0] != nodes[k - 1][0]]
        if not nodes or nodes[0][0] in starts:
            own = f"{vehicle.serial} begins"
            places[own] = _pose_at(vehicle, vehicle.t_s[0])
            nodes.insert(0, (own, max(0.0, vehicle.t_s[0] - begin_s)))
        starts.add(nodes[0][0])
        edges |= {(a, b) for (a, _), (b, _) in pairwise(nodes)}
        visits.append(nodes)
    names = list(places)
    number = {node: k for k, node in enumerate(names)}
    level_names = sorted({map_id for _, _, map_id in places.values()} | {m for vehicle in vehicles for m in vehicle.map_id}) or ["map"]
    xy = np.array([places[node][:2] for node in names])
    lanes = sorted((number[a], number[b]) for a, b in edges if a != b)
    length_m = [max(float(np.hypot(*(xy[b] - xy[a]))), SHORTEST_LANE_M) for a, b in lanes]
    level = np.array([level_names.index(places[node][2]) for node in names], np.int64)
    options: list[Properties] = [{} if level[a] == level[b] else {"lift": LIFT} for a, b in lanes]
    nav = nav_graph(
        name=name,
        xy=xy,
        lanes=lanes,
        level_names=level_names,
        level=level,
        vertex_name=names,
        length_m=length_m,
        lane_options=options,
    )
    shift: Shift = laid_out(nav, None)
    if drawn is not None and set(shift) <= set(drawn.level_shift_m):
        shift = {key: drawn.level_shift_m[key] for key in shift}
    nav = replace(nav, xy=frozen(xy + shifts_of(level_names, shift)[level]))
    graph = plan_graph(nav, kind="roadmap", cell_m=round(float(np.median(length_m)), 3) if lanes else 1.0)
    ways = []
    for nodes in visits:  # a first one is at 0 s, whatever else is known
        at_s = np.maximum.accumulate(np.array([0.0, *(t_s for _, t_s in nodes[1:])]))
        ways.append((np.array([number[node] for node, _ in nodes], np.int64), at_s))
    return graph, shift, ways


def _departures(vehicle: Recorded, xy: FloatArray, at_s: FloatArray) -> FloatArray:
    """[N] when a vehicle left the places [N, 2] at which it came at times [N]: as long as its poses are there, it stays."""
    t_s, place, leave_s = np.array(vehicle.t_s), np.column_stack((vehicle.x_m, vehicle.y_m)), at_s.copy()
    bounds = np.searchsorted(t_s, at_s)
    for k, (a, b) in enumerate(pairwise(bounds.tolist())):
        there = np.hypot(*(place[a:b] - xy[k]).T) < STAYS_M
        stayed = int(np.argmin(there)) if not there.all() else len(there)
        if stayed:
            leave_s[k] = min(float(t_s[a + stayed - 1]), float(at_s[k + 1]))
    leave_s[-1] = np.inf
    return leave_s


def _pose_at(vehicle: Recorded, t_s: float) -> tuple[float, float, str]:
    k = int(np.argmin(np.abs(np.array(vehicle.t_s) - t_s)))
    return vehicle.x_m[k], vehicle.y_m[k], vehicle.map_id[k]


def _execution(vehicles: list[Recorded], begin_s: float, span_s: float, plan: Plan, graph: NavGraph, shift: Shift) -> Execution:
    t_s = samples_s(span_s)
    x, y, yaw, speed = (np.full((len(t_s), len(vehicles)), np.nan) for _ in range(4))
    level, by = np.zeros((len(t_s), len(vehicles)), np.int64), shifts_of(graph.level_names, shift)
    events = []
    for r, vehicle in enumerate(vehicles):
        at_s, on = np.array(vehicle.t_s) - begin_s, np.array([graph.level_names.index(name) for name in vehicle.map_id])
        there = (t_s >= at_s[0] - 1e-6) & (t_s <= at_s[-1] + 1e-6)
        poses = between(t_s[there], at_s, np.column_stack((vehicle.x_m, vehicle.y_m)) + by[on], np.array(vehicle.yaw_rad), on)
        x[there, r], y[there, r] = poses.xy.T
        yaw[there, r], level[there, r] = poses.yaw_rad, poses.level
        said = np.array(vehicle.speed_mps)
        known = np.isfinite(said)
        speed[there, r] = np.interp(t_s[there], at_s[known], said[known]) if known.any() else _derived_mps(poses)
        for (kind, text), spans in vehicle.errors.items():
            for since_s, until_s in spans:
                what = "blocked" if kind in WAITS else "disturbed"
                lasts_s = min(until_s, begin_s + span_s) - since_s
                events.append(Event(since_s - begin_s, what, r, duration_s=lasts_s, text=f"{kind}: {text}" if text else kind))
    still = np.nan_to_num(speed, nan=0.0) < STANDING_MPS
    last_moved = np.where((~still).any(0), len(t_s) - 1 - np.argmax(~still[::-1], 0), 0)
    more: dict[str, Any] = {"arrived_s": frozen(plan.arrive_s.copy()), "goal_s": frozen(t_s[last_moved])}
    by_time = tuple(sorted(events, key=lambda event: (event.t_s, event.robot)))
    more |= {"events": by_time, "batteries": _batteries(vehicles, begin_s, float(t_s[-1]))}
    return recorded_execution(graph, t_s, (x, y, yaw, speed), level, more)


def recorded_execution(
    graph: NavGraph, t_s: FloatArray, columns: Sequence[FloatArray], level: IntArray, more: Mapping[str, Any]
) -> Execution:
    """The execution of a run that was recorded: x, y, yaw and speed [T, R] at times [T], on levels [T, R] of a graph, and more fields."""
    x_m, y_m, yaw_rad, speed_mps = map(frozen, columns)
    return Execution(
        **{"t_s": frozen(t_s), "x_m": x_m, "y_m": y_m, "yaw_rad": yaw_rad, "speed_mps": speed_mps, **more},
        outcome=Outcome.COMPLETED,
        policy=RECORDED,
        sim_time_s=float(t_s[-1]),
        wall_time_s=0.0,
        cpu_time_s=0.0,
        level=frozen(level) if len(graph.level_names) > 1 else None,
    )


def _derived_mps(poses: Between) -> FloatArray:
    """[T] speeds by positions before and after; where the level changes, those are in other frames."""
    if len(poses.xy) < 2:
        return np.zeros(len(poses.xy))
    moves = np.where(np.diff(poses.level) != 0, 0.0, np.diff(poses.xy, axis=0).T)
    moved = np.concatenate([moves[:, :1], (moves[:, :-1] + moves[:, 1:]) / 2, moves[:, -1:]], 1)
    speed: FloatArray = np.hypot(*moved) / SAMPLE_S
    return speed


def _batteries(vehicles: list[Recorded], begin_s: float, end_s: float) -> BatteryLog | None:
    """Where all vehicles say their state of charge."""
    if not all(vehicle.percent for vehicle in vehicles):
        return None
    t_s = np.arange(0.0, end_s + 1e-9, 10.0)
    level = np.stack([np.interp(t_s, *np.array(vehicle.percent).T - [[begin_s], [0.0]]) / 100 for vehicle in vehicles], 1)
    none = frozen(np.zeros(len(vehicles)))
    return BatteryLog(frozen(t_s), frozen(level), none, none, 0.0)
