"""A run as pictures show it: as driven, or else the plan as if it had been driven; and which walls are furniture."""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.bodies import Rectangles, bodies_of
from mrp_sumo.core.digraph import weak_components
from mrp_sumo.core.disturbances import BREAKS
from mrp_sumo.core.execution import RECORDED, Execution, Outcome, positions_at
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, PlanGraph
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import MrpSumoError, count
from mrp_sumo.io.record import AT_GOAL, BLOCKED, MOVING, STATE_NAMES, WAITING, RunRecord, robot_states
from mrp_sumo.io.run_summary import planner_of
from mrp_sumo.traffic.courses import course_rad
from mrp_sumo.traffic.turns import BACKWARD, FORWARD, NEVER, turns_of

if TYPE_CHECKING:
    from mrp_sumo.core.graph import NavGraph
    from mrp_sumo.experiments.result import RunResult
    from mrp_sumo.io.outline import Outline
    from mrp_sumo.io.run_reader import RunFolder

ABSENT = 4  # a state in addition to those of io.record: not on the floor
AT_REST = "idle or served"  # what AT_GOAL is called in runs with tasks
MAP_FILES = (".building.yaml", ".nav.yaml", ".yaml", ".map")  # ends of names
TURNING_RAD = 0.02  # a sample
MARGIN_M = 0.6  # around all that is drawn
PERIOD_S = 0.2  # between samples of a plan that was not driven
MANY_NAMES = 80  # from which on not all that have one are stations
NARROW_M = 3.0  # closed walls narrower than this are furniture

AnyRun: TypeAlias = "RunResult | RunFolder"  # that has just ended, or was read from its folder


def title_of(result: Mapping[str, Any]) -> str:
    """Title of a run: its scenario's name, or words where that has none, as in batches."""
    scenario = result["scenario"]
    if scenario["name"]:
        return str(scenario["name"])
    robots = scenario["robots"]
    count = robots["count"] or len(robots["starts"])
    return f"{map_name_of(result)}, {count} robots, {scenario['planner']['name']}, seed {result['seed']}"


def map_name_of(result: Mapping[str, Any]) -> str:
    """Name of a run's map: its file, without the ends that formats ask for."""
    name = Path(result["scenario"]["map"]["file"]).name
    return next((name.removesuffix(end) for end in MAP_FILES if name.endswith(end)), name)


def subtitle_of(result: Mapping[str, Any], num_robots: int) -> str:
    """Map, robots and planner of a run in a line; nobody knows who planned what is read from a log."""
    by = RECORDED if result.get("policy") == RECORDED else planner_of(result)
    return f"{map_name_of(result)} · {count(num_robots, 'robot')} · {by}"


def view_record(run: AnyRun) -> RunRecord:
    """The run as it is shown: as driven, or as planned where it was not executed.

    Raises MrpSumoError when there is neither a plan nor a trajectory.
    """
    if run.executed:
        record = replace(run.record, name=title_of(run.result))
        return record if record.execution.tasks is None else replace(record, plan=None)  # the first plan is to stay
    if run.plan is None:
        raise MrpSumoError(f"{run.source}: nothing to replay, the run has neither a plan nor a trajectory ({run.result['status']})")
    return RunRecord(
        name=title_of(run.result),
        seed=run.result["seed"],
        fleet=run.fleet,
        graph=run.graph,
        target=run.plan.last_vertex,
        plan=run.plan,
        execution=plan_as_execution(run.plan, run.graph, run.fleet),
        nav=run.nav,
    )


def view_states(execution: Execution) -> NDArray[np.int8]:
    """[T, R] the state of each robot at each sample: `robot_states`, with ABSENT, and turning in place counted as moving.

    In runs with tasks, who stands without a task, or is being served, does not wait: that is AT_GOAL there. Who is broken is BLOCKED.
    """
    state = robot_states(execution, execution.t_s)
    turning = np.zeros(state.shape, np.bool_)
    with np.errstate(invalid="ignore"):
        turning[1:] = np.abs(2 * np.sin(np.diff(execution.yaw_rad, axis=0) / 2)) > TURNING_RAD
    state[turning & (state == WAITING)] = MOVING
    if execution.tasks is not None:
        state[(state == WAITING) & _at_rest(execution)] = AT_GOAL
    for event in (event for event in execution.events if event.text == BREAKS):
        a, b = np.searchsorted(execution.t_s, (event.t_s - 1e-9, event.t_s + event.duration_s - 1e-9))
        state[a:b, event.robot] = np.where(state[a:b, event.robot] == MOVING, MOVING, BLOCKED)
    state[np.isnan(execution.x_m) | np.isnan(execution.y_m)] = ABSENT
    return state


def parts_of(execution: Execution, fleet: Fleet) -> Rectangles:
    """Parts of robots that are drawn below them: trailers, then bodies with loads where these are larger, NaN while there is none."""
    bodies, loaded, loads = bodies_of(execution, fleet), fleet.loaded or fleet, execution.loads
    if loads is None:
        loads, loaded = np.zeros(execution.x_m.shape, np.int64), fleet
    larger = np.flatnonzero((loaded.length_m > fleet.length_m) | (loaded.width_m > fleet.width_m))
    with_load = loads[:, larger] > 0
    towed = np.arange(fleet.num_robots, len(bodies.name))
    part = np.append(towed, larger)
    is_there = np.hstack([np.ones((len(with_load), len(towed)), np.bool_), with_load])
    x_m, y_m, yaw_rad = (np.where(is_there, column[:, part], np.nan) for column in (bodies.x_m, bodies.y_m, bodies.yaw_rad))
    return Rectangles(
        x_m,
        y_m,
        yaw_rad,
        bodies.owner[part],
        tuple(bodies.name[k] for k in part.tolist()),
        np.append(bodies.length_m[towed], loaded.length_m[larger]),
        np.append(bodies.width_m[towed], loaded.width_m[larger]),
        bodies.bar_m[part],
    )


def forks_of(fleet: Fleet) -> IntArray:
    """[R] 1 for robots with forks in front, -1 behind, 0 without: trucks have them at the axle that does not steer."""
    wheels = [each.kinematics for each in fleet.types]
    ends = [1 if each.fixed_axle == "front" else -1 if each.kind == "tricycle" else 0 for each in wheels]
    side = np.array([end if each.is_steered else 0 for end, each in zip(ends, wheels)], np.int64)
    return side[fleet.kind] if len(side) else np.zeros(fleet.num_robots, np.int64)


def parts_at(parts: Rectangles, execution: Execution, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """[K, N, 2] and [K, N] places and headings of parts at ascending times."""
    x, y, yaw = positions_at(replace(execution, x_m=parts.x_m, y_m=parts.y_m, yaw_rad=parts.yaw_rad), t_s)
    return np.stack([x, y], -1), yaw


def drawbars(parts: Rectangles, xy: FloatArray, yaw: FloatArray, robots: FloatArray) -> list[tuple[int, FloatArray]]:
    """Trailers, and [3, 2] the line of each from its middle to its hitch and to the middle of what is in front of it.

    `xy` [N, 2] and `yaw` [N] are those of the parts, `robots` [R, 2] of robots.
    """
    lines = []
    for k in np.flatnonzero(parts.bar_m).tolist():
        robot = int(parts.owner[k])
        front = xy[k - 1] if k and parts.owner[k - 1] == robot else robots[robot]
        lines.append((k, np.array([xy[k], xy[k] + parts.bar_m[k] * np.array([np.cos(yaw[k]), np.sin(yaw[k])]), front])))
    return lines


def state_names(has_tasks: bool) -> tuple[str, ...]:
    """Names of states, for people."""
    return (*STATE_NAMES[:AT_GOAL], AT_REST) if has_tasks else STATE_NAMES


def _at_rest(execution: Execution) -> NDArray[np.bool_]:
    """[T, R] who has no task, or is being served at a stop."""
    tasks, stops, t_s = execution.tasks, execution.stops, execution.t_s
    assert tasks is not None
    rest = np.ones((len(t_s), execution.num_robots), np.bool_)
    done_s = np.where(np.isnan(tasks.done_s), np.inf, tasks.done_s)
    for robot, begin_s, end_s in zip(tasks.robot.tolist(), tasks.assigned_s, done_s):
        if robot >= 0 and np.isfinite(begin_s):
            rest[slice(*np.searchsorted(t_s, (begin_s, end_s))), robot] = False
    if stops is not None:
        for robot, begin_s, end_s in zip(stops.robot.tolist(), stops.begin_s, stops.end_s):
            rest[slice(*np.searchsorted(t_s, (begin_s, end_s))), robot] = True
    return rest


def is_grid_map(record: RunRecord) -> bool:
    """True where the map itself is a grid: then its cells are drawn, not lanes."""
    nav, graph = record.nav, record.graph
    return graph.kind == "grid" and (nav is None or np.array_equal(nav.xy, graph.xy))


def extent(record: RunRecord, outline: "Outline | None") -> tuple[FloatArray, FloatArray]:
    """Lower left and upper right [2] of everything that is drawn, in m, with a margin."""
    execution = record.execution
    nav = record.drawn
    points = [nav.xy]
    if not np.isnan(execution.x_m).all():
        points += [bodies_extent(record, MARGIN_M)]
    if record.plan is not None:
        points.append(record.graph.xy[record.plan.vertex])
    if outline is not None:
        points += [outline.walls.reshape(-1, 2), *outline.floors]
    every = np.concatenate(points)
    return every.min(axis=0) - MARGIN_M, every.max(axis=0) + MARGIN_M


def bodies_extent(record: RunRecord, margin_m: float) -> FloatArray:
    """[2, 2] lower left and upper right of where robots were, and of bodies that stand out from there beyond a margin, in m."""
    x, y, fleet = record.execution.x_m, record.execution.y_m, record.fleet
    beyond_m = max(float((np.hypot(fleet.length_m, fleet.width_m) / 2).max(initial=0.0)) - margin_m, 0.0)
    return np.array([(f(x) + side * beyond_m, f(y) + side * beyond_m) for side, f in ((-1, np.nanmin), (1, np.nanmax))])


def driven_backward(plan: Plan, graph: PlanGraph, fleet: Fleet, yaw_rad: FloatArray | None = None) -> BoolArray:
    """[N] visits of a plan to which robots come backward; the first of a robot has it from the second.

    `yaw_rad` [R] is how robots face at first; by default vehicles go forward where they may.
    """
    backward, types = np.zeros(len(plan.vertex), np.bool_), fleet.vehicle_of_kind
    for r in range(plan.num_robots if types or graph.is_backward.any() else 0):
        vehicle, gear, before = types[int(fleet.kind[r])] if types else None, -1, -1
        ids = range(int(plan.first[r]), int(plan.first[r + 1]))
        for k in ids[1:]:
            lane = graph.lane_between(int(plan.vertex[k - 1]), int(plan.vertex[k]))
            if lane >= 0 and vehicle is None:
                gear = int(graph.is_backward[lane])
            elif lane >= 0 and vehicle is not None:
                gear = _next_gear(graph, vehicle, (before, lane), gear, math.nan if yaw_rad is None else float(yaw_rad[r]))
                before = lane
            backward[k] = gear == BACKWARD
        if len(ids) > 1:
            backward[ids[0]] = backward[ids[1]]
    return backward


def _next_gear(graph: PlanGraph, vehicle: RobotType, lanes: tuple[int, int], gear: int, yaw_rad: float) -> int:
    """The gear in which a vehicle goes from a lane, -1: its start, on to another."""
    (before, lane), turns = lanes, turns_of(graph, vehicle)
    if before < 0 and not math.isnan(yaw_rad):
        return BACKWARD if math.cos(yaw_rad - float(course_rad(graph)[lane, 0])) < 0 else FORWARD
    if before < 0:
        return turns.first_gear(lane)
    turn = turns.between(before, lane)
    moves = [int(gears[turn, gear]) for gears in (turns.next_gear, turns.may_stand)] if turn >= 0 else []
    return next((move for move in moves if move != NEVER), gear)


def planned_at(plan: Plan, graph: PlanGraph, t_s: FloatArray) -> FloatArray:
    """[2, K, R] x and y of each robot at [K] times, as the plan has them, m."""
    xy, end_s = np.empty((2, len(t_s), plan.num_robots)), plan.end_s
    for r in range(plan.num_robots):
        visits = slice(int(plan.first[r]), int(plan.first[r + 1]))
        at_s = np.column_stack((plan.arrive_s[visits], np.minimum(plan.depart_s[visits], end_s[r] + 1))).ravel()
        xy[:, :, r] = [np.interp(t_s, at_s, np.repeat(axis, 2)) for axis in graph.xy[plan.vertex[visits]].T]
    return xy


def plan_as_execution(plan: Plan, graph: PlanGraph, fleet: Fleet) -> Execution:
    """A plan as if it had been driven exactly, for runs that were not executed."""
    end_s, backward = float(plan.end_s.max(initial=0.0)), driven_backward(plan, graph, fleet)
    t_s: FloatArray = PERIOD_S * np.arange(math.ceil(end_s / PERIOD_S) + 2, dtype=np.float64)
    (x, y), yaw = planned_at(plan, graph, t_s), np.zeros((len(t_s), plan.num_robots))
    for r in range(plan.num_robots):
        visits = slice(int(plan.first[r]), int(plan.first[r + 1]))
        step = np.diff(graph.xy[plan.vertex[visits]], axis=0)
        course = np.arctan2(step[:, 1], step[:, 0]) + np.pi * backward[visits][1:] if len(step) else np.zeros(1)
        yaw[:, r] = course[np.clip(np.searchsorted(plan.depart_s[visits], t_s, side="left") - 1, 0, len(course) - 1)]
    speed = np.hypot(np.diff(x, axis=0, prepend=x[:1]), np.diff(y, axis=0, prepend=y[:1])) / PERIOD_S
    return Execution(
        t_s=t_s,
        x_m=x,
        y_m=y,
        yaw_rad=yaw,
        speed_mps=speed,
        arrived_s=plan.arrive_s,
        goal_s=plan.end_s,
        outcome=Outcome.COMPLETED,
        policy="plan",
        sim_time_s=float(t_s[-1]),
        wall_time_s=0.0,
        cpu_time_s=0.0,
    )


def furniture_and_walls(walls: FloatArray, narrow_m: float = NARROW_M) -> tuple[list[FloatArray], FloatArray, FloatArray]:
    """Tell furniture (racks, desks, pillars) from walls [N, 2, 2]: islands of walls that are closed and narrow.

    Returns outlines, [N, 2] polygons, each the ring itself or the convex hull of an island with inner walls; all walls of furniture
    [F, 2, 2]; and the others.
    """
    corners, end = np.unique(walls.reshape(-1, 2).round(3), axis=0, return_inverse=True)
    end = end.reshape(-1, 2)
    island = weak_components(len(corners), *end.T)
    num_islands = int(island.max(initial=-1)) + 1
    degree = np.bincount(end.ravel(), minlength=len(corners))
    is_furniture = np.zeros(num_islands, np.bool_)
    outlines = []
    order = np.argsort(island, kind="stable")
    of_island = np.split(order, np.flatnonzero(np.diff(island[order])) + 1) if len(order) else []
    beside: dict[int, list[int]] = {}
    for a, b in end.tolist():
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    for members in of_island:
        xy = corners[members]
        if len(members) < 3 or degree[members].min() < 2 or np.ptp(xy, axis=0).min() >= narrow_m:
            continue
        is_furniture[island[members[0]]] = True
        if degree[members].max() == 2:
            ring = [int(members[0])]
            while len(ring) < len(members):
                ring.append(next(c for c in beside[ring[-1]] if len(ring) < 2 or c != ring[-2]))
            outlines.append(corners[ring])
        elif np.ptp(xy, axis=0).min() > 0:
            from scipy.spatial import ConvexHull

            outlines.append(xy[ConvexHull(xy).vertices])
    fine = is_furniture[island[end[:, 0]]] if len(end) else np.zeros(0, np.bool_)
    return outlines, walls[fine], walls[~fine]


def crossings(nav: "NavGraph") -> NDArray[np.bool_]:
    """[V] named vertices that are crossings to people: no stations, where the map says which are; and all of very many names."""
    named = np.array([bool(name) for name in nav.vertex_name], np.bool_)
    if nav.has_stations:
        return named & ~nav.having("station")
    return named & (np.count_nonzero(named) > MANY_NAMES)


def drawn_lanes(nav: "NavGraph") -> IntArray:
    """Lanes that are drawn: one of two opposite ones, and no rides, which are on no floor."""
    return np.flatnonzero(nav.is_once & (nav.level[nav.tail] == nav.level[nav.head]))


def level_boxes(record: RunRecord, outline: "Outline | None") -> dict[str, tuple[FloatArray, FloatArray]]:
    """Lower left and upper right corner, m, of each level that is driven on. A wall is of the level whose lanes it is nearest to."""
    nav = record.drawn
    on = {name: xy for k, name in enumerate(nav.level_names) if len(xy := nav.xy[nav.level == k])}
    walls = np.zeros((0, 2)) if outline is None else outline.walls.reshape(-1, 2)
    away = np.array([np.hypot(*np.maximum(np.maximum(xy.min(0) - walls, walls - xy.max(0)), 0.0).T) for xy in on.values()])
    nearest = away.argmin(0)
    own = [np.concatenate([xy, walls[nearest == k]]) for k, xy in enumerate(on.values())]
    return {name: (points.min(0), points.max(0)) for name, points in zip(on, own)}


def level_corners(record: RunRecord, outline: "Outline | None") -> list[tuple[str, float, float]]:
    """Name and upper left corner, m, of each level; none where there is one only."""
    boxes = level_boxes(record, outline)
    return [(name, float(low[0]), float(high[1])) for name, (low, high) in boxes.items()] if len(boxes) > 1 else []
