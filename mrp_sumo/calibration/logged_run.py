"""The later part of a log as a run, so that metrics, replays and pages take it like the simulation that it is held against."""

import math
from dataclasses import replace

import numpy as np

from mrp_sumo.calibration.held_out import HeldOut
from mrp_sumo.calibration.log import levels_on, shift_on
from mrp_sumo.core.execution import Execution
from mrp_sumo.core.graph import FloatArray, frozen
from mrp_sumo.core.plan import plan_of_visits
from mrp_sumo.core.task import NOBODY, TASK_STATES, StopLog, TaskLog
from mrp_sumo.experiments.recorded import SAMPLE_S, between, finished, recorded_execution, samples_s
from mrp_sumo.experiments.result import RunResult
from mrp_sumo.experiments.staging.set_up import SetUp

GAP_S = 60.0  # without poses, in which nobody knows where a vehicle is


def logged_run(held: HeldOut, setup: SetUp) -> RunResult:
    """The run that the later part of a log tells of, on the problem that simulates it; its clock begins at the cut."""
    problem = replace(setup.problem, fleet=replace(setup.problem.fleet, robot_name=held.vehicles))
    setup = replace(setup, problem=problem)
    plan = plan_of_visits([(problem.start[r : r + 1], np.zeros(1), np.full(1, np.inf)) for r in range(problem.num_robots)])
    note = f"recorded: {len(held.vehicles)} vehicles of {held.log.source}, {held.span_s:.0f} s from {held.cut_s - held.begin_s:.0f} s on"
    return replace(finished(setup, plan, _execution(held, setup), note, held.span_s), status="completed")


def _execution(held: HeldOut, setup: SetUp) -> Execution:
    t_s = samples_s(held.span_s)
    x, y, yaw, speed = (np.full((len(t_s), len(held.vehicles)), np.nan) for _ in range(4))
    level, by, on = np.zeros(x.shape, np.int64), shift_on(held.log, setup.map), levels_on(held.log, setup.map)
    for r, name in enumerate(held.vehicles):
        rows = np.array(held.log.poses[name], np.float64)
        rows = rows[np.argsort(rows[:, 0], kind="stable")]
        at_s, here = rows[:, 0] - held.cut_s, np.array([on.get(number, 0) for number in rows[:, 5].tolist()], np.int64)
        place = rows[:, 1:3] + by[here]
        poses = between(t_s, at_s, place, _headings(rows[:, 3], place), here)
        there = (t_s >= at_s[0]) & (t_s <= at_s[-1]) & (poses.gap_s < GAP_S)
        x[there, r], y[there, r] = poses.xy[there].T
        yaw[there, r], level[:, r] = poses.yaw_rad[there], poses.level
        speed[there, r] = np.hypot(*(np.gradient(column[:, r], SAMPLE_S) for column in (x, y)))[there]
    tasks, stops = _logs(held, setup)
    arrived_s, goal_s = np.zeros(len(held.vehicles)), np.full(len(held.vehicles), np.nan)
    speed = np.where(np.isfinite(x), np.nan_to_num(speed), np.nan)
    more = {"arrived_s": frozen(arrived_s), "goal_s": frozen(goal_s), "tasks": tasks, "stops": stops}
    return recorded_execution(setup.problem.graph, t_s, (x, y, yaw, speed), level, more)


def _headings(yaw_rad: FloatArray, place: FloatArray) -> FloatArray:
    """Headings as the log says them, else those of the way."""
    if np.isfinite(yaw_rad).all():
        return yaw_rad
    if len(place) < 2:
        return np.zeros(len(place))
    moved = np.gradient(place, axis=0)
    moves = np.hypot(*moved.T) > 0.05
    last = np.maximum.accumulate(np.where(moves, np.arange(len(place)), 0))
    return np.arctan2(moved[:, 1], moved[:, 0])[last]


def _logs(held: HeldOut, setup: SetUp) -> tuple[TaskLog, StopLog]:
    """Orders and stops, with times from the cut on; those before are negative."""
    graph, tasks = setup.problem.graph, setup.scenario.tasks
    robot_of = {name: r for r, name in enumerate(held.vehicles)}
    places = {name: station.places[0] for name, station in (tasks.stations if tasks else {}).items()}
    robots = [robot_of.get(order.vehicle, NOBODY) for order in held.orders]
    rows, times, status = list[tuple[float, ...]](), list[tuple[float, ...]](), []
    for n, (order, robot) in enumerate(zip(held.orders, robots)):
        begun = [begin_s for begin_s, _ in order.services if begin_s < held.end_s]
        is_known = (order.assigned_s < held.end_s, bool(begun), order.done_s < held.end_s)
        status.append(TASK_STATES[sum(is_known)] if not order.ended_s < held.end_s or is_known[2] else TASK_STATES[4])
        at_s = (order.release_s, order.assigned_s, begun[0] if begun else math.nan, order.done_s, order.ended_s)
        times.append(tuple(t - held.cut_s if t < held.end_s else math.nan for t in at_s))
        since_s = order.assigned_s - held.cut_s
        for k, (begin_s, end_s) in enumerate(order.services):
            if begin_s < held.end_s and robot != NOBODY:
                name = order.stops[k]
                vertex = int(graph.vertex_of_station[setup.map.nav.vertex_of_name[places.get(name, name)]])
                rows.append((n, robot, k, vertex, since_s, begin_s - held.cut_s, end_s - held.cut_s))
                since_s = end_s - held.cut_s
    table = np.array(rows, np.float64).reshape(-1, 7)
    whole = table[:, :4].astype(np.int64)
    stations = tuple(held.orders[n].stops[k] for n, _, k, _ in whole.tolist())
    none = frozen(np.zeros(len(table)))
    due_s = np.array([held.orders[n].asks.get("due_s", math.inf) - held.cut_s for n in whole[:, 0].tolist()])
    task, by, _, at = (frozen(column) for column in whole.T)
    since, begin, end = (frozen(column) for column in table[:, 4:].T)
    stops = StopLog(task, by, stations, at, since, begin, end, none, none, frozen(due_s))
    released, assigned, opened, done, ended = (frozen(column) for column in np.array(times, np.float64).reshape(-1, 5).T)
    names, reasons, of = tuple(order.name for order in held.orders), ("",) * len(robots), frozen(np.array(robots, np.int64))
    return TaskLog(names, of, released, assigned, opened, done, ended, tuple(status), reasons), stops
