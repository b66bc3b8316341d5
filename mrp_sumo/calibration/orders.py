"""Orders of a fleet's log: of a run folder as its tables have them, else as the actions of vehicles show them, or those of a CSV.

A log of actions tells of an order when a vehicle has it: from then on it counts as released. Where nobody says when a vehicle was sent,
that is when it set out from where it had stood for long. An order begins with a `pick` and ends with the next `drop`, or before the next
`pick`; other actions at stations in between are its stops, too.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import islice, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mrp_sumo.calibration.log import ActionTime, LoggedOrder
from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.grouping import grouped
from mrp_sumo.core.task import NOBODY, Task
from mrp_sumo.errors import MrpSumoError

if TYPE_CHECKING:
    from mrp_sumo.io.run_reader import RunFolder

CHARGING = ("startCharging", "stopCharging", "charge", "charging")
AHEAD = 1000  # orders of a stream that may be looked at beyond those that were known
IDLE_S, STILL_M, AT_STOP_M = 20.0, 0.3, 5.0  # who stands so long, within so much, farther from its next stop, had nothing to do
SAME_S = 1.0  # by which a service may begin before its order is released, for clocks that differ


def orders_of_run(run: "RunFolder") -> list[LoggedOrder]:
    """Orders that were known in a run, by release; those of which nobody knows all stops are left out."""
    execution, names = run.record.execution, run.fleet.robot_name
    tasks, stops = execution.tasks, execution.stops
    if tasks is None or stops is None:
        return []
    requested = _asked_for(run, [name for name, is_order in zip(tasks.name, tasks.is_order.tolist()) if is_order])
    orders = []
    for k in np.flatnonzero(tasks.is_order).tolist():
        rows = np.flatnonzero(stops.task == k)
        task, at = requested.get(tasks.name[k]), tuple(stops.station[row] for row in rows.tolist())
        if task is None and not math.isfinite(tasks.done_s[k]):
            continue
        robot = int(tasks.robot[k])
        services = tuple(zip(stops.begin_s[rows].tolist(), stops.end_s[rows].tolist()))
        stations = at if task is None else tuple(s.station.name if s.station else run.graph.label(s.vertex) for s in task.stops)
        orders.append(
            LoggedOrder(
                tasks.name[k],
                stations,
                float(tasks.released_s[k]),
                float(tasks.assigned_s[k]),
                "" if robot == NOBODY else names[robot],
                services if len(services) <= len(stations) else (),  # begun anew, or handed over
                float(tasks.done_s[k]),
                float(tasks.ended_s[k]),
                {} if task is None else _asks(task, names),
            )
        )
    return sorted(orders, key=lambda order: order.release_s)


def _asked_for(run: "RunFolder", names: Sequence[str]) -> dict[str, Task]:
    from mrp_sumo.experiments.audit_work import logs_in

    try:
        logs = logs_in(run)
    except MrpSumoError:
        return {}
    wanted = set(names)
    sources = () if logs is None else logs.terms.sources
    return {task.name: task for source in sources for task in islice(source.tasks(), len(names) + AHEAD) if task.name in wanted}


def _asks(task: Task, names: Sequence[str]) -> dict[str, Any]:
    asks = {"priority": task.priority, "robot_type": task.robot_type, "load_kg": task.load_kg}
    asks |= {"due_s": task.due_s} if math.isfinite(task.due_s) else {}
    return {key: value for key, value in asks.items() if value} | ({} if task.robot == NOBODY else {"robot": names[task.robot]})


def orders_of_visits(
    visits: Iterable[ActionTime],
    poses: Mapping[str, Sequence[tuple[float, ...]]] | None = None,
    sent: Mapping[str, Sequence[tuple[float, str]]] | None = None,
) -> list[LoggedOrder]:
    """Orders as the actions of vehicles show them, by release; `sent` has when each vehicle was sent to which node."""
    by_begin = sorted(visits, key=lambda visit: visit.begin_s)
    by_vehicle = grouped((visit.vehicle, visit) for visit in by_begin if visit.action not in CHARGING)
    orders = []
    for vehicle, mine in by_vehicle.items():
        track = np.array(sorted((poses or {}).get(vehicle, ()))).reshape(-1, 6)[:, :3]
        parts: list[list[ActionTime]] = []
        for visit in mine:
            if not parts or visit.action == "pick" or parts[-1][-1].action == "drop":
                parts.append([])
            parts[-1].append(visit)
        free_s = -math.inf
        for n, part in enumerate(parts):
            told_s = [visit.told_s for visit in part if math.isfinite(visit.told_s)]
            told_s += _sent_s((sent or {}).get(vehicle, ()), {visit.station for visit in part}, free_s, part[0].begin_s)
            since_s = min(told_s) if told_s else _set_out_s(track, free_s, part[0].begin_s)
            assigned_s = min(since_s, part[0].begin_s) if since_s > -math.inf else part[0].begin_s
            services = tuple((visit.begin_s, visit.end_s) for visit in part)
            stops = tuple(visit.station for visit in part)
            free_s = part[-1].end_s
            orders.append(LoggedOrder(f"{vehicle}_{n}", stops, assigned_s, assigned_s, vehicle, services, free_s, free_s))
    return sorted(orders, key=lambda order: order.release_s)


def _set_out_s(track: FloatArray, free_s: float, begin_s: float) -> float:
    """When a vehicle whose times and places are [N, 3] last left a long stand for its next stop; `free_s` where it had none."""
    a, b = np.searchsorted(track[:, 0], (free_s, begin_s)).tolist()
    rows, set_out_s = track[a : b + 1].tolist(), free_s
    first_s, *first = rows[0] if rows else (0.0,)
    for before, row in pairwise(rows):
        if math.dist(row[1:], first) > STILL_M:
            if before[0] - first_s >= IDLE_S and math.dist(first, rows[-1][1:]) > AT_STOP_M:
                set_out_s = before[0]
            first_s, *first = row
    return float(set_out_s)


def _sent_s(sent: Sequence[tuple[float, str]], nodes: set[str], free_s: float, begin_s: float) -> list[float]:
    """Since when a vehicle was on its way to one of some nodes without being sent elsewhere; nothing where nobody says it."""
    since_s: list[float] = []
    for t_s, node in reversed(sent):
        if t_s <= begin_s:
            if t_s < free_s or node not in nodes:
                break
            since_s = [t_s]
    return since_s


def orders_of_file(path: Path) -> list[LoggedOrder]:
    """Orders of a CSV, as a scenario's `tasks.file` has them, with times of the log. Raises MrpSumoError with file and line."""
    from mrp_sumo.io.tasks import choices_in

    orders = []
    for number, (line, task) in enumerate(choices_in(path)):
        asks = {key: value for key in ("priority", "robot_type", "load_kg", "due_s", "robot", "service_s") if (value := getattr(task, key))}
        orders.append(LoggedOrder(task.name or f"order_{number}", tuple(task.stops), task.release_s, asks=asks, where=line))
    if not orders:
        raise MrpSumoError(f"{path}: no orders, expected a row for each")
    return sorted(orders, key=lambda order: order.release_s)


def matched(orders: Sequence[LoggedOrder], seen: Sequence[LoggedOrder]) -> list[LoggedOrder]:
    """Orders of a file with what a log shows of them: those of the same name, else the first of the same stops after the release."""
    by_name = {order.name: order for order in seen}
    left = sorted((order for order in seen if order.services), key=lambda order: order.services[0][0])
    result = []
    for order in orders:
        mine = by_name.get(order.name)
        if mine is None:
            mine = next((o for o in left if o.stops == order.stops and o.services[0][0] >= order.release_s - SAME_S), None)
            if mine is not None:
                left.remove(mine)
        if mine is None:
            result.append(order)
            continue
        assigned_s = max(mine.assigned_s, order.release_s)
        times: dict[str, Any] = {"vehicle": mine.vehicle, "services": mine.services, "done_s": mine.done_s, "ended_s": mine.ended_s}
        result.append(replace(order, assigned_s=assigned_s, **times))
    return result
