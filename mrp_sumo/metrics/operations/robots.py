"""Rules about robots: states without gaps that fit their orders, ways that fit their visits, nobody idle beside work for long;
no order passed over.
"""

from collections import Counter
from collections.abc import Hashable, Iterator
from itertools import pairwise

import numpy as np

from mrp_sumo.core.disturbances import BREAKS, MAINTAINED
from mrp_sumo.core.execution import Outcome
from mrp_sumo.core.grouping import grouped
from mrp_sumo.core.robot_states import BROKEN, CHARGING, EMPTY, IDLE, ROBOT_STATES, STALLED, WORKING
from mrp_sumo.core.task import CANCELLED, FAILED, NOBODY, Task
from mrp_sumo.metrics.operations.evidence import EPS_S, LOST, Finding, Logs, end_of
from mrp_sumo.metrics.operations.places import BESIDE_M, CORNER, LATER_ONES, vertex_at
from mrp_sumo.search.route import shortest_route

CROWD = 4  # robots bound for each place of a station, beside which another is of no use there
IDLE_S = 120.0  # beside work, on top of twice the time to drive there
SETS_OUT_S = 1.0  # after a robot was given an order, once planners have had their time
STOOD_SHARE, STOOD_S = 0.02, 2.0  # by which a time stood may be off, which is booked in steps
SAYS = ("unresolved", "stalled")  # events that say why orders wait
NOBODY_WORKS = (Outcome.STALLED, Outcome.PLANNER_STALLED, Outcome.DEADLOCK)


def states(logs: Logs) -> Iterator[Finding]:
    """States of robots have no gaps, and are what orders and stops say."""
    log, stops, tasks = logs.execution.robot_states, logs.stops, logs.tasks
    if log is None:
        return
    for robot in range(logs.fleet.num_robots):
        who, mine = logs.robot(robot), np.flatnonzero(log.robot == robot)
        edges = [0.0, *np.stack([log.begin_s[mine], log.end_s[mine]], 1).ravel().tolist(), logs.end_s]
        gaps = [(a, b) for a, b in zip(edges[::2], edges[1::2]) if abs(a - b) > EPS_S]
        for a, b in gaps:
            yield Finding("states", a, f"{who}: its states end at {a:.2f} s and go on at {b:.2f} s, expected no gap", who)
        for k in mine[log.end_s[mine] < log.begin_s[mine]].tolist():
            yield Finding("states", float(log.begin_s[k]), f"{who}: {ROBOT_STATES[log.state[k]]} ends before it begins", who)
    odd = np.isin(log.state, (IDLE, CHARGING, EMPTY)) & (log.task >= 0) | (log.state == WORKING) & (log.task < 0)
    for k in np.flatnonzero(odd).tolist():
        who, state, t_s = logs.robot(int(log.robot[k])), ROBOT_STATES[log.state[k]], float(log.begin_s[k])
        has = f"has order '{tasks.name[log.task[k]]}'" if log.task[k] >= 0 else "has no order"
        yield Finding("states", t_s, f"{who} is {state} from {t_s:.2f} s, but {has}", who)
    for row, (task, robot) in enumerate(zip(stops.task.tolist(), stops.robot.tolist())):
        middle_s = (stops.begin_s[row] + min(stops.end_s[row], logs.end_s)) / 2
        is_order = bool(tasks.is_order[task])
        states = (WORKING, STALLED, BROKEN) if is_order else (CHARGING, STALLED, BROKEN, EMPTY)
        now = (log.robot == robot) & (log.begin_s <= middle_s + EPS_S) & (log.end_s >= middle_s - EPS_S)
        fits = now & np.isin(log.state, states) & ((log.task == (task if is_order else -1)) | (log.state == EMPTY))
        if stops.end_s[row] > stops.begin_s[row] + EPS_S and not fits.any():
            is_at = ", ".join(ROBOT_STATES[k] for k in log.state[now].tolist()) or "nothing"
            yield logs.of_stop("states", row, f"is served, but at {middle_s:.2f} s its state is {is_at}, or it has another order", middle_s)


def had(logs: Logs) -> Iterator[Finding]:
    """Each order is with its robot from when it was assigned until it ended, in both tables."""
    log, tasks = logs.execution.robot_states, logs.tasks
    if log is None:
        return
    rows = np.flatnonzero(np.isin(log.state, (WORKING, STALLED, BROKEN)) & (log.task >= 0))
    begin_s, end_s = np.full(len(tasks.name), np.inf), np.full(len(tasks.name), -np.inf)
    for k in rows.tolist():  # the last time that it was had without a break, by the one who has it
        task = int(log.task[k])
        if log.robot[k] != tasks.robot[task]:
            continue
        if log.begin_s[k] > end_s[task] + EPS_S:
            begin_s[task] = log.begin_s[k]
        end_s[task] = log.end_s[k]
    several = {task for task, robot in enumerate(tasks.robot.tolist()) if robot >= 0 and logs.capacity[robot] > 1}
    for task in np.flatnonzero(np.isfinite(begin_s) & np.isfinite(tasks.assigned_s)).tolist():
        if task in several:  # its robot may be on the way to stops of others
            yield from _has_work(logs, task)
            continue
        over_s, sets_out_s = end_of(logs, task), begin_s[task] - tasks.assigned_s[task]
        if not -EPS_S <= sets_out_s <= logs.terms.waits_s + SETS_OUT_S or abs(over_s - end_s[task]) > EPS_S:
            had, said = f"{begin_s[task]:.2f} to {end_s[task]:.2f} s", f"{tasks.assigned_s[task]:.2f} to {over_s:.2f} s"
            yield logs.of_order("Little's law", task, f"its robot has it from {had}, but its times are {said}", float(begin_s[task]))
    for task in np.flatnonzero(tasks.is_order & np.isfinite(tasks.assigned_s) & ~np.isfinite(begin_s)).tolist():
        over_s = end_of(logs, task)
        if task in several:
            yield from _has_work(logs, task)
        elif over_s > tasks.assigned_s[task] + logs.terms.waits_s + SETS_OUT_S and tasks.robot[task] >= 0:
            at_s = float(tasks.assigned_s[task])
            yield logs.of_order("Little's law", task, f"is assigned from {at_s:.2f} to {over_s:.2f} s, but its robot never has it", at_s)


def _has_work(logs: Logs, task: int) -> Iterator[Finding]:
    """A robot that has several orders has work from when one of them is assigned until it has ended."""
    tasks, robot = logs.tasks, int(logs.tasks.robot[task])
    at_s = float(tasks.assigned_s[task]) + logs.terms.waits_s + SETS_OUT_S
    over_s = end_of(logs, task)
    for begin_s, end_s in logs.times_in((WORKING, STALLED, BROKEN), robot):
        if begin_s <= at_s + EPS_S:
            at_s = max(at_s, end_s)
    if at_s < over_s - EPS_S:
        yield logs.of_order("Little's law", task, f"its robot has it until {over_s:.2f} s, but has no work from {at_s:.2f} s on", at_s)


def conservation(logs: Logs) -> Iterator[Finding]:
    """Recorded counts are those of the tables; waits are no longer than robots stood."""
    tasks, stops, orders = logs.tasks, logs.stops, logs.tasks.is_order
    ends = Counter(status for status, is_order in zip(tasks.status, orders.tolist()) if is_order)
    counts = {
        "tasks_done": int((np.isfinite(tasks.done_s) & orders).sum()),
        "tasks_open": int((np.isnan(tasks.ended_s) & orders).sum()),
        **{f"tasks_{end}": ends[end] for end in (FAILED, CANCELLED)},
    }
    for name, count in counts.items():
        if (recorded := logs.metrics.get(name)) is not None and recorded != count:
            yield Finding("conservation", logs.end_s, f"{name} is {recorded}, but the table of tasks has {count}")
    for row in range(len(stops.task)):
        way_s, stood_s = float(stops.begin_s[row] - stops.since_s[row]), float(stops.stood_s[row] + stops.queued_s[row])
        if not (way_s >= -EPS_S and stood_s <= way_s + EPS_S and min(stops.stood_s[row], stops.queued_s[row]) >= -EPS_S):
            yield logs.of_stop("conservation", row, f"stood for {stood_s:.2f} s of a way that took {way_s:.2f} s")
            continue
        if stood_s > STOOD_S and stood_s > _stood_s(logs, row) * (1 + STOOD_SHARE) + STOOD_S:
            yield logs.of_stop("conservation", row, f"stood for {stood_s:.2f} s on its way, but by its poses {_stood_s(logs, row):.2f} s")


def _stood_s(logs: Logs, row: int) -> float:
    """For how long a robot stood between setting out for a stop and its service, by its poses."""
    stands, stops = logs.standing[int(logs.stops.robot[row])], logs.stops
    lasts_s = np.minimum(stands[:, 1], stops.begin_s[row]) - np.maximum(stands[:, 0], stops.since_s[row])
    return float(np.clip(lasts_s, 0, None).sum())


def visits(logs: Logs) -> Iterator[Finding]:
    """Robots are at a vertex when they are said to reach it."""
    run = logs.execution
    parts = [(reply.vertex, np.repeat(reply.robot, np.diff(reply.first)), reply.arrived_s) for reply in run.replies]
    if logs.plan is not None and len(run.arrived_s) == logs.plan.num_visits:
        parts.append((logs.plan.vertex, logs.plan.robot, run.arrived_s))
    if not parts or not len(run.t_s):
        return
    vertex, robot, arrived_s = (np.concatenate(column) for column in zip(*parts))
    in_lift = np.array(["in_lift" in options for options in logs.graph.vertex_options], np.bool_)  # drawn beside each other
    some = np.isfinite(arrived_s) & ~in_lift[vertex]
    vertex, robot, arrived_s = vertex[some], robot[some], arrived_s[some]
    away_m = np.hypot(*(logs.xy_at(robot, arrived_s) - logs.graph.xy[vertex]).T)
    limit_m = BESIDE_M + CORNER * logs.fleet.max_speed_mps[robot] * logs.period_s + logs.fleet.aside_m[robot] + logs.graph.swing_m[vertex]
    for k in np.flatnonzero(~(away_m <= limit_m)).tolist():
        who, place, t_s = logs.robot(int(robot[k])), logs.graph.known_as(int(vertex[k])), float(arrived_s[k])
        yield Finding("visits", t_s, f"{who} is {away_m[k]:.2f} m from {place} when it reaches it at {t_s:.2f} s", who, place)


def idle(logs: Logs) -> Iterator[Finding]:
    """No robot is idle for 120 s plus twice the drive beside an order that it could have picked, unless events say why, or four others
    for each place are bound for one of its stations."""
    log, tasks = logs.execution.robot_states, logs.tasks
    if log is None or logs.execution.outcome in NOBODY_WORKS:
        return
    said_s = min((event.t_s for event in logs.execution.events if event.kind in SAYS), default=np.inf)
    smallest = np.flatnonzero(logs.fleet.radius_m <= logs.fleet.radius_m.min() + 1e-9)
    least_s = IDLE_S + 2 * logs.terms.waits_s
    spans = np.flatnonzero((log.state == IDLE) & (log.end_s - log.begin_s > least_s) & np.isin(log.robot, smallest))
    for task in np.flatnonzero(tasks.is_order).tolist() if len(spans) else ():
        order = logs.ordered.get(task)
        for begin_s, end_s in _unheld(logs, task) if order else ():
            for k in spans[(log.begin_s[spans] < end_s - least_s) & (log.end_s[spans] > begin_s + least_s)].tolist():
                robot, since_s = int(log.robot[k]), max(begin_s, float(log.begin_s[k]))
                until_s = min(end_s, float(log.end_s[k]))
                assert order is not None
                if until_s - since_s <= least_s or until_s > said_s or not logs.is_for(robot, order):
                    continue
                if until_s - since_s - _crowded_s(logs, task, since_s, until_s) > least_s + 2 * _drive_s(logs, robot, since_s, order):
                    who, text = logs.robot(robot), f"is idle from {since_s:.2f} s to {until_s:.2f} s, and nobody has order '{order.name}'"
                    yield Finding("idle beside work", since_s, f"{who} {text}", who, None, order.name)
                    return  # what else waits does for the same reason


def _crowded_s(logs: Logs, task: int, since_s: float, until_s: float) -> float:
    """For how long, between two times, enough robots were bound for one station of an order, of those for which there were most."""
    stops, tasks, longest_s = logs.stops, logs.tasks, 0.0
    for places in {stop.places for stop in logs.ordered[task].stops}:
        edges = list[tuple[float, int]]()
        for k, other in logs.ordered.items():
            if k == task or not np.isfinite(tasks.assigned_s[k]) or all(stop.places != places for stop in other.stops):
                continue
            made_s = stops.end_s[(stops.task == k) & np.isin(stops.vertex, places)].max(initial=-np.inf)
            over_s = made_s if np.isfinite(made_s) else end_of(logs, k)
            span_s = np.clip((float(tasks.assigned_s[k]), float(over_s)), since_s, until_s).tolist()
            edges += [(span_s[0], 1), (span_s[1], -1)]
        edges.sort()
        bound = np.cumsum([change for _, change in edges])
        lasts_s = np.diff([t_s for t_s, _ in edges], append=until_s)
        longest_s = max(longest_s, float(lasts_s[bound >= CROWD * len(places)].sum()))
    return longest_s


def passed_over(logs: Logs) -> Iterator[Finding]:
    """No order waits while three or more that are alike and came later are given to robots and begun, once a robot could have come to it.

    Alike are orders of the same stops, priority, robot and type, and of no less service.
    """
    log, tasks = logs.execution.robot_states, logs.tasks
    if log is None or logs.execution.outcome in NOBODY_WORKS:
        return
    said_s = min((event.t_s for event in logs.execution.events if event.kind in SAYS), default=np.inf)
    service_s = {k: sum(stop.service_s for stop in order.stops) for k, order in logs.ordered.items()}

    def kind(order: Task) -> Hashable:
        return order.priority, order.robot, order.robot_type, order.load_kg, tuple(stop.places for stop in order.stops)

    for alike in grouped((kind(order), k) for k, order in sorted(logs.ordered.items())).values():
        numbers, lasts_s = np.array(alike), np.array([service_s[k] for k in alike])
        opened_s, assigned_s = tasks.opened_s[numbers], tasks.assigned_s[numbers]
        until_s = np.where(np.isfinite(opened_s), opened_s, np.minimum(said_s, logs.end_s))
        for n in np.flatnonzero(until_s - tasks.released_s[numbers] > IDLE_S).tolist():
            task = alike[n]
            later = n + 1 + np.flatnonzero((opened_s[n + 1 :] < until_s[n] - EPS_S) & (lasts_s[n + 1 :] >= lasts_s[n] - EPS_S))
            if len(later) < LATER_ONES or until_s[n] > said_s or tasks.reason[task] or not _was_sound(logs, task, float(until_s[n])):
                continue
            comes_s = since_s = float(assigned_s[later].min())
            comes_s += IDLE_S + 2 * logs.terms.waits_s
            late = later[assigned_s[later] > comes_s]
            if len(late) >= LATER_ONES:
                drives_s = [_drive_s(logs, robot, since_s, logs.ordered[task]) for robot in range(logs.fleet.num_robots)]
                comes_s += 2 * max((each for each in drives_s if np.isfinite(each)), default=np.inf)
            late = late[assigned_s[late] > comes_s]
            if len(late) >= LATER_ONES:
                begun = f"{len(late)} that came later are begun, at first '{tasks.name[alike[late[0]]]}'"
                yield logs.of_order("oldest first", task, f"waits until {until_s[n]:.2f} s while {begun}")


def _was_sound(logs: Logs, task: int, until_s: float) -> bool:
    """True if no robot was lost that had an order, from its release on."""
    log, tasks = logs.execution.robot_states, logs.tasks
    assert log is not None
    holders = {int(tasks.robot[task]), *log.robot[log.task == task].tolist()} - {NOBODY}
    return not any(logs.was_in(LOST, robot, float(tasks.released_s[task]), until_s) for robot in holders)


def _unheld(logs: Logs, task: int) -> list[tuple[float, float]]:
    log, tasks = logs.execution.robot_states, logs.tasks
    assert log is not None
    end_s = end_of(logs, task)
    had = sorted((float(log.begin_s[k]), float(log.end_s[k])) for k in np.flatnonzero(log.task == task).tolist())
    if tasks.robot[task] != NOBODY and logs.capacity[int(tasks.robot[task])] > 1:  # between its stops it has others
        had = [span for span in had if span[1] <= tasks.assigned_s[task]]
    if np.isfinite(tasks.assigned_s[task]):
        had.append((float(tasks.assigned_s[task]), end_s))
    edges = [float(tasks.released_s[task]), *(edge for span in had for edge in span), end_s]
    return [(a, b) for a, b in zip(edges[::2], edges[1::2]) if b > a]


def _drive_s(logs: Logs, robot: int, at_s: float, order: Task) -> float:
    """How long a robot takes to an order's first stop by the shortest way, inf where there is none."""
    everywhere, start = np.ones(logs.graph.num_lanes, np.bool_), vertex_at(logs, robot, at_s)
    ways = [shortest_route(logs.graph, everywhere, start, place) for place in order.stops[0].places]
    return min((_route_s(logs, robot, route) for route in ways if route is not None), default=np.inf)


def _route_s(logs: Logs, robot: int, route: list[int]) -> float:
    """How long a robot takes along a route, turning at each vertex by a quarter at most."""
    graph, top = logs.graph, float(logs.fleet.max_speed_mps[robot])
    lanes = np.array([graph.lane_between(a, b) for a, b in pairwise(route)], np.int64)
    return float((graph.length_m[lanes] / np.minimum(graph.speed_mps[lanes], top)).sum())


def stands(logs: Logs) -> Iterator[Finding]:
    """An empty robot stands; one that broke down, once it has braked and until it is pushed; one that is maintained may move."""
    log, run, types = logs.execution.robot_states, logs.execution, logs.terms.fleet
    if log is None:
        return
    noted_s = grouped(((event.robot, event.text), event.t_s) for event in run.events if event.text in (BREAKS, MAINTAINED))
    for k in np.flatnonzero(np.isin(log.state, (EMPTY, BROKEN))).tolist():
        robot = int(log.robot[k])
        brakes_s = float(logs.fleet.max_speed_mps[robot] / logs.fleet.decel_mps2[robot]) + 1.0 + 2 * logs.period_s
        begin_s, end_s = float(log.begin_s[k]), float(log.end_s[k])
        if any(abs(t_s - begin_s) <= SETS_OUT_S for t_s in noted_s.get((robot, MAINTAINED), ())):
            continue
        tow_s = types.types[types.kind[robot]].tow_s
        if log.state[k] == BROKEN and tow_s is not None:  # who looks after orders notes it a little later
            broke_s = min((t_s for t_s in noted_s.get((robot, BREAKS), ()) if 0 <= begin_s - t_s <= SETS_OUT_S), default=begin_s)
            end_s = min(end_s, broke_s + tow_s)
        some = logs.samples_between(begin_s + brakes_s, end_s)
        x, y = run.x_m[some, robot], run.y_m[some, robot]
        if len(x) and (moved_m := float(np.hypot(np.ptp(x), np.ptp(y)))) > BESIDE_M:
            who, state = logs.robot(robot), ROBOT_STATES[int(log.state[k])]
            yield Finding("states", float(log.begin_s[k]), f"{who} moves by {moved_m:.2f} m while it is {state}", who)
