"""/task_states: what becomes of the tasks of a run, as Open-RMF's fleet adapters report it to its API server.

A message for each change of a task, one JSON document of the schema `task_state.json` of Open-RMF's rmf_api_msgs in a std_msgs/String.
Open-RMF has no message of its own for it. A task is `queued` from its release, `standby` once a robot has it, `underway` from its first
stop and `completed` after its last; one that ended otherwise is `failed` or `canceled`. Each stop that was begun is a phase. Times are Unix
time in ms on the clock of the bag's stamps.
"""

import json
from collections.abc import Iterator
from typing import Any

import numpy as np

from mrp_sumo.bags.messages import EPOCH_NS, FLEET_NAME, Messages
from mrp_sumo.core.task import CANCELLED, CHARGE, DONE, FAILED, NOBODY, StopLog, TaskLog

TOPIC, TYPE = "/task_states", "std_msgs/String"
CATEGORIES = {CHARGE: "charge_battery"}
ENDS = {DONE: "completed", FAILED: "failed", CANCELLED: "canceled"}  # as Open-RMF spells them
ORDERED = "compose"  # Open-RMF's category of tasks that are a series of stops


def task_states(m: Messages, until_s: float) -> Iterator[tuple[int, bytes]]:
    """(ns since the epoch, message) of each change of a task until then, by time; of runs without tasks none."""
    execution = m.record.execution
    if execution.tasks is None:
        return
    rows = _rows_of(execution.tasks, execution.stops)
    changes = [(t_s, k) for k in range(len(execution.tasks.name)) for t_s in _changes(execution.tasks, execution.stops, k, rows[k])]
    for t_s, k in sorted(changes):
        if t_s <= until_s:
            text = json.dumps(_state(m, execution.tasks, execution.stops, k, rows[k], t_s), ensure_ascii=False, allow_nan=False)
            yield round(t_s * 1e9), m.message(TYPE, text)


def _rows_of(tasks: TaskLog, stops: StopLog | None) -> list[list[int]]:
    """[K] the stops of each task, in the order in which they were made."""
    rows: list[list[int]] = [[] for _ in tasks.name]
    for row, k in enumerate(stops.task.tolist() if stops else ()):
        rows[k].append(row)
    return rows


def _changes(tasks: TaskLog, stops: StopLog | None, k: int, rows: list[int]) -> list[float]:
    """When the state of a task changes, s."""
    times = {float(tasks.released_s[k]), float(tasks.assigned_s[k]), float(tasks.opened_s[k]), float(tasks.ended_s[k])}
    if stops is not None:
        times |= {float(t) for t in (*stops.begin_s[rows], *stops.end_s[rows])}
    return sorted(t for t in times if np.isfinite(t))


def _state(m: Messages, tasks: TaskLog, stops: StopLog | None, k: int, rows: list[int], t_s: float) -> dict[str, Any]:
    released_s, assigned_s, opened_s, ended_s = (
        float(column[k]) for column in (tasks.released_s, tasks.assigned_s, tasks.opened_s, tasks.ended_s)
    )
    robot = int(tasks.robot[k]) if assigned_s <= t_s else NOBODY
    status = ENDS[tasks.status[k]] if ended_s <= t_s else "underway" if opened_s <= t_s else "queued" if robot == NOBODY else "standby"
    kind = tasks.kind[k] if tasks.kind else ""
    document: dict[str, Any] = {
        "booking": {
            "id": tasks.name[k],
            "unix_millis_earliest_start_time": _millis(released_s),
            "unix_millis_request_time": _millis(released_s),
        },
        "category": CATEGORIES.get(kind, ORDERED),
        "status": status,
        "dispatch": {"status": "queued"},
    }
    if robot != NOBODY:
        name = m.robots[robot]
        document["assigned_to"] = {"group": FLEET_NAME, "name": name}
        document["dispatch"] = {"status": "dispatched", "assignment": {"fleet_name": FLEET_NAME, "expected_robot_name": name}}
    if opened_s <= t_s:
        document["unix_millis_start_time"] = _millis(opened_s)
    if ended_s <= t_s:
        document["unix_millis_finish_time"] = _millis(ended_s)
    if stops is not None:
        begun = [row for row in rows if stops.begin_s[row] <= t_s]
        over = [stops.end_s[row] <= t_s for row in begun]
        document["phases"] = {
            str(n): {
                "id": n,
                "category": "stop",
                "detail": stops.station[row],
                "unix_millis_start_time": _millis(float(stops.begin_s[row])),
                **({"unix_millis_finish_time": _millis(float(stops.end_s[row]))} if ended else {}),
            }
            for n, (row, ended) in enumerate(zip(begun, over))
        }
        document["completed"] = [n for n, ended in enumerate(over) if ended]
        if begun and not over[-1]:
            document["active"] = len(begun) - 1
    return document


def _millis(t_s: float) -> int:
    return round(EPOCH_NS / 1e6) + round(t_s * 1000)
