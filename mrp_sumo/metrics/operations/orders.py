"""Rules about orders: each released once, when it was due to be; in one state; its stops made in order, by one robot, loads first."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from mrp_sumo.core.execution import Outcome
from mrp_sumo.core.grouping import grouped
from mrp_sumo.core.handling import stop_s
from mrp_sumo.core.robot_states import BROKEN
from mrp_sumo.core.stream import TaskSource
from mrp_sumo.core.task import ASSIGNED, CANCELLED, DONE, FAILED, HANDED_OVER, NOBODY, PICKED, RELEASED, TASK_STATES, TASK_TIMES, Task
from mrp_sumo.metrics.operations.evidence import EPS_S, LOST, Finding, Logs

SHOWN_S = 1.5  # until robots have the limits of what they have on board
REVEALED_S = 2.0  # at most until the next order of a closed loop is known
TIMES = {  # of a state: those of `TASK_TIMES` that an order in it has; the others it has not, or may have
    RELEASED: (("released_s",), ("done_s", "ended_s", "assigned_s", "opened_s")),
    ASSIGNED: (("released_s", "assigned_s"), ("done_s", "ended_s")),
    PICKED: (("released_s", "assigned_s", "opened_s"), ("done_s", "ended_s")),
    DONE: (TASK_TIMES, ()),
    FAILED: (("released_s", "ended_s"), ("done_s",)),
    CANCELLED: (("released_s", "ended_s"), ("done_s",)),
    HANDED_OVER: (("released_s", "opened_s"), ("done_s", "ended_s", "assigned_s")),
}


def releases(logs: Logs) -> Iterator[Finding]:
    """Each order of the scenario becomes known once, at its time, and no others; in a closed loop the right number is open."""
    tasks, asked_for = logs.tasks, set[str]()
    number: dict[str, int] = {}
    for k in np.flatnonzero(tasks.is_order).tolist():
        if tasks.name[k] in number:
            yield logs.of_order("released once", k, "is released twice")
        number[tasks.name[k]] = k
    for source, known in zip(logs.terms.sources, logs.known):
        asked_for.update(task.name for task in known)
        if source.num_open:
            yield from _closed_loop(logs, source, [number[task.name] for task in known])
            continue
        for task in known:
            if task.name not in number:
                text = f"order '{task.name}': never released, expected at {task.release_s:.2f} s"
                yield Finding("released once", task.release_s, text, order=task.name)
            elif abs(tasks.released_s[number[task.name]] - task.release_s) > EPS_S:
                k = number[task.name]
                text = f"is released at {tasks.released_s[k]:.2f} s, expected at {task.release_s:.2f} s"
                yield logs.of_order("released once", k, text)
    if logs.terms.sources:
        for name, k in number.items():
            if name not in asked_for and tasks.released_s[k] < logs.end_s - EPS_S:
                yield logs.of_order("released once", k, "nobody asked for it")


def _closed_loop(logs: Logs, source: TaskSource, known: Sequence[int]) -> Iterator[Finding]:
    """So many are always known and have not ended."""
    tasks, most = logs.tasks, source.num_open
    released_s = np.sort(tasks.released_s[list(known)])
    ended_s = np.sort(tasks.ended_s[list(known)])  # those that have not, last
    due_s = np.concatenate([np.zeros(most), ended_s])[: len(known)]
    order = np.array(known, np.int64)[np.argsort(tasks.released_s[list(known)], kind="stable")]
    for k, is_s, from_s in zip(order.tolist(), released_s.tolist(), due_s.tolist()):
        if not from_s - EPS_S <= is_s <= from_s + REVEALED_S:
            text = f"is released at {is_s:.2f} s, expected when fewer than {most} are open, at {from_s:.2f} s"
            yield logs.of_order("released once", k, text)
    num_open = int(np.isnan(ended_s).sum() + (ended_s > logs.end_s - REVEALED_S).sum())
    if len(known) < most + int(np.isfinite(ended_s).sum()) and num_open < most and _goes_on(source, len(known)):
        text = f"{num_open} orders are open at the end, expected {most}"
        yield Finding("released once", logs.end_s, text)


def _goes_on(source: TaskSource, count: int) -> bool:
    """True if a source has more tasks than that."""
    return any(n == count for n, _ in enumerate(source.tasks()))


def states(logs: Logs) -> Iterator[Finding]:
    """The state of each order fits its times, which ascend."""
    tasks, end_s = logs.tasks, logs.end_s
    columns = {name: getattr(tasks, name) for name in TASK_TIMES}
    for k, status in enumerate(tasks.status):
        if status not in TASK_STATES:
            yield logs.of_order("one state", k, f"is '{status}', which is no state of an order")
            continue
        has, lacks = TIMES[status]
        at_s = {name: float(column[k]) for name, column in columns.items()}
        if wrong := [name for name in has if np.isnan(at_s[name])] + [name for name in lacks if np.isfinite(at_s[name])]:
            what = "has no" if np.isnan(at_s[wrong[0]]) else "has a"
            yield logs.of_order("one state", k, f"is {status}, but {what} {wrong[0]}")
        there = [t for t in at_s.values() if np.isfinite(t)]
        begins = [at_s[name] for name in ("released_s", "assigned_s", "opened_s", "ended_s") if np.isfinite(at_s[name])]
        if status == HANDED_OVER or tasks.reason[k]:  # what was done before the robot was lost
            begins = [t for t in (at_s["released_s"], at_s["ended_s"]) if np.isfinite(t)]
        if any(a > b + EPS_S for a, b in pairwise(begins)) or any(not -EPS_S <= t <= end_s + EPS_S for t in there):
            listed = ", ".join(f"{name} {t:.2f}" for name, t in at_s.items() if np.isfinite(t))
            yield logs.of_order("one state", k, f"its times do not ascend within the run of {end_s:.2f} s: {listed}")
        if status == DONE and abs(at_s["done_s"] - at_s["ended_s"]) > EPS_S:
            yield logs.of_order("one state", k, f"is done at {at_s['done_s']:.2f} s, but ended at {at_s['ended_s']:.2f} s")
        if status in (FAILED, CANCELLED) and not tasks.reason[k]:
            yield logs.of_order("one state", k, f"is {status}, but nothing says why")
        if (tasks.robot[k] == NOBODY) != (status in (RELEASED, HANDED_OVER)) and status not in (FAILED, CANCELLED):
            yield logs.of_order("one state", k, f"is {status}, but {'nobody has' if tasks.robot[k] == NOBODY else 'somebody has'} it")


def stops_in_order(logs: Logs) -> Iterator[Finding]:
    """All stops of an order are made, in order, at places of the right stations, by one robot unless it was lost."""
    stops, tasks = logs.stops, logs.tasks
    rows_of = grouped((task, row) for row, task in enumerate(stops.task.tolist()))
    for task, rows in rows_of.items():
        rows.sort(key=lambda row: (stops.begin_s[row], stops.end_s[row]))
        made, before, order = 0, None, logs.ordered.get(task)
        first = rows[0]
        for row in rows:
            if before is not None and stops.robot[row] != stops.robot[before]:
                if logs.was_in(LOST, int(stops.robot[before]), float(stops.end_s[before]), float(stops.begin_s[row])) is False:
                    yield logs.of_stop("stops in order", row, f"goes on with what {logs.robot(int(stops.robot[before]))} began")
                if stops.station[row] == f"beside {logs.robot(int(stops.robot[before]))}":  # there it fetches the load
                    before = row
                    continue
                made, first = 0, row
            if before is not None and stops.begin_s[row] < stops.end_s[before] - EPS_S:
                yield logs.of_stop("stops in order", row, f"begins before its stop at {logs.place(before)} is over")
            if order is not None:
                yield from _as_asked(logs, row, order, made)
            made, before = made + 1, row
        yield from _ends(logs, task, first, rows, made, order)
    for task in np.flatnonzero(np.isfinite(tasks.opened_s)).tolist():
        if task not in rows_of and tasks.status[task] in (PICKED, DONE):
            yield logs.of_order(
                "stops in order", task, f"is {tasks.status[task]}, but none of its stops was made", float(tasks.opened_s[task])
            )


def _as_asked(logs: Logs, row: int, order: Task, nth: int) -> Iterator[Finding]:
    """A stop is made by a robot that the order is for, at a place of the one that was asked for, and takes as long."""
    stops = logs.stops
    if not logs.is_for(int(stops.robot[row]), order):
        others = f"robots of type '{order.robot_type}'" if order.robot_type else f"robots that carry {order.load_kg:g} kg"
        whom = logs.robot(order.robot) or others
        yield logs.of_stop("stops in order", row, f"the order is for {whom}")
    if nth >= len(order.stops):
        yield logs.of_stop("stops in order", row, f"is stop {nth + 1} of {len(order.stops)}")
        return
    stop, takes_s = order.stops[nth], float(stops.end_s[row] - stops.begin_s[row])
    name = stop.station.name if stop.station else ""
    if int(stops.vertex[row]) not in stop.places or stops.station[row] != name:
        wanted = name or logs.graph.known_as(stop.vertex)
        yield logs.of_stop("stops in order", row, f"stop {nth + 1} at {logs.graph.known_as(int(stops.vertex[row]))}, expected {wanted}")
    expected_s = stop_s(logs.terms.fleet, logs.terms.seed, int(stops.robot[row]), order, nth)
    if takes_s < expected_s - EPS_S:
        yield logs.of_stop("service", row, f"is served for {takes_s:.2f} s, which takes {expected_s:.2f} s")
    elif takes_s > expected_s + EPS_S and logs.was_in((BROKEN,), int(stops.robot[row]), stops.begin_s[row], stops.end_s[row]) is False:
        yield logs.of_stop("service", row, f"is served for {takes_s:.2f} s, which takes {expected_s:.2f} s only")
    due_s = order.due_s - order.release_s + float(logs.tasks.released_s[stops.task[row]])
    if not (due_s == stops.due_s[row] or abs(due_s - stops.due_s[row]) <= EPS_S):
        yield logs.of_stop("stops in order", row, f"is due at {stops.due_s[row]:.2f} s, expected {due_s:.2f} s")


def _ends(logs: Logs, task: int, first: int, rows: Sequence[int], made: int, order: Task | None) -> Iterator[Finding]:
    stops, tasks = logs.stops, logs.tasks
    last, status = rows[-1], tasks.status[task]
    if status in (RELEASED, ASSIGNED, CANCELLED) and not tasks.reason[task]:
        yield logs.of_stop("loads", last, f"is made, but the order is {status}")
    begun = first if np.isfinite(tasks.opened_s[task]) and tasks.opened_s[task] >= stops.begin_s[first] - EPS_S else rows[0]
    if status in (PICKED, DONE) and abs(tasks.opened_s[task] - stops.begin_s[begun]) > EPS_S:
        yield logs.of_stop("loads", begun, f"its first stop, begins, but the order counts as picked at {tasks.opened_s[task]:.2f} s")
    if status == DONE and abs(tasks.done_s[task] - stops.end_s[last]) > EPS_S:
        yield logs.of_stop("loads", last, f"its last stop, ends at {stops.end_s[last]:.2f} s, but it is done at {tasks.done_s[task]:.2f} s")
    if status == DONE and order is not None and made != len(order.stops):
        yield logs.of_stop("stops in order", last, f"it is done, but {made} of {len(order.stops)} stops were made")
    if status == DONE and tasks.robot[task] != stops.robot[last]:
        yield logs.of_stop("stops in order", last, f"was done by {logs.robot(int(tasks.robot[task]))}, says the table of tasks")
    if status != DONE and order is not None and made == len(order.stops) and stops.end_s[last] < logs.end_s - 1.0:
        yield logs.of_stop("stops in order", last, f"its last stop is over at {stops.end_s[last]:.2f} s, but it is {status}")


def loads(logs: Logs) -> Iterator[Finding]:
    """A robot makes no stop of another order until it is done with the one it has picked, unless it can carry several, and is served
    once at a time.
    """
    stops, tasks = logs.stops, logs.tasks
    order = np.lexsort((tasks.opened_s[stops.task], stops.end_s, stops.begin_s, stops.robot))  # of one instant: who was picked first
    for one, other in zip(order.tolist(), order.tolist()[1:]):
        if stops.robot[one] != stops.robot[other]:
            continue
        if stops.begin_s[other] < stops.end_s[one] - EPS_S:
            yield logs.of_stop("loads", other, f"begins while it is served at {logs.place(one)} until {stops.end_s[one]:.2f} s")
        task = int(stops.task[one])
        fills = logs.capacity[int(stops.robot[one])] == 1 and tasks.status[task] in (PICKED, DONE) and not tasks.reason[task]
        if fills and task != stops.task[other]:
            over_s = tasks.ended_s[task] if np.isfinite(tasks.ended_s[task]) else np.inf
            if stops.begin_s[other] < over_s - EPS_S:
                yield logs.of_stop("loads", other, f"is made with order '{tasks.name[task]}' on board")


def on_board(logs: Logs) -> Iterator[Finding]:
    """No robot has more orders on board than its `capacity`, and `loaded` of the trajectory is what its stops put there.

    Robots that were lost with orders, or fetched those of others, are left out.
    """
    changes: dict[int, list[tuple[float, int]]] = {}  # by robot
    tasks, stops, shown = logs.tasks, logs.stops, logs.execution.loads
    lost = {int(stops.robot[row]) for row, task in enumerate(stops.task.tolist()) if tasks.reason[task]}
    several = {task for task, order in logs.ordered.items() if len(order.stops) > 1}
    rows = [row for row, task in enumerate(stops.task.tolist()) if task in several and int(stops.robot[row]) not in lost]
    rows.sort(key=lambda row: float(stops.end_s[row]))
    first = {int(stops.task[row]): row for row in reversed(rows)}
    for task in first:
        of_robot = changes.setdefault(int(stops.robot[first[task]]), [])
        of_robot += [(float(stops.end_s[first[task]]), 1), *([(float(tasks.done_s[task]), -1)] if tasks.status[task] == DONE else [])]
    for robot, of_robot in changes.items():
        who, most = logs.robot(robot), logs.capacity[robot]
        at_s, change = (np.array(column) for column in zip(*sorted(of_robot)))
        count = np.cumsum(change)
        for k in np.flatnonzero(count > most).tolist()[:1]:
            yield Finding("loads", at_s[k], f"{who} has {count[k]} orders on board from {at_s[k]:.2f} s on, and can carry {most}", who)
        if shown is None:
            continue
        t_s = logs.execution.t_s
        now, before = (np.searchsorted(at_s, t_s - ago_s, side="right") for ago_s in (0.0, SHOWN_S + logs.terms.waits_s))
        for k in np.flatnonzero((now == before) & (np.append(0, count)[now] != shown[:, robot])).tolist()[:1]:
            text = f"{who} has {shown[k, robot]} loads on board at {t_s[k]:.2f} s, expected {np.append(0, count)[now[k]]} after its stops"
            yield Finding("loads", float(t_s[k]), text, who)


def ends_are_events(logs: Logs) -> Iterator[Finding]:
    """Failed and cancelled orders have an event."""
    texts = [event.text for event in logs.execution.events if event.kind in (FAILED, CANCELLED)]
    tasks = logs.tasks
    for k in np.flatnonzero(tasks.is_order).tolist():
        if tasks.status[k] in (FAILED, CANCELLED) and not any(f"'{tasks.name[k]}'" in text for text in texts):
            yield logs.of_order("one state", k, f"is {tasks.status[k]}, but no event says so", float(tasks.ended_s[k]))
    if logs.execution.outcome is Outcome.COMPLETED and not _all_open_end(logs):
        left = next(k for k in np.flatnonzero(tasks.is_order).tolist() if np.isnan(tasks.ended_s[k]))
        yield logs.of_order("one state", left, "is open, but the run has ended as completed before its time", logs.end_s)


def _all_open_end(logs: Logs) -> bool:
    """True if no order is open, or more would have come: a run is over when all is done, or with its time."""
    tasks = logs.tasks
    if not (np.isnan(tasks.ended_s) & tasks.is_order).any() or not logs.terms.sources:
        return True
    return any(_goes_on(source, len(known)) for source, known in zip(logs.terms.sources, logs.known))
