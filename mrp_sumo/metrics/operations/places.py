"""Rules about places: service only where and while a robot stands, one robot a place, first come first served; lifts and doors."""

import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.arrivals import DAY_S
from mrp_sumo.core.digraph import strong_components, weak_components
from mrp_sumo.core.facilities import DOOR_STATES, LIFT_STATES
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, PlanGraph
from mrp_sumo.core.grouping import grouped
from mrp_sumo.core.handling import load_change
from mrp_sumo.core.robot_states import STALLED
from mrp_sumo.metrics.operations.evidence import EPS_S, LOST, Finding, Logs
from mrp_sumo.search.route import reach_m, shortest_route

BESIDE_M = 0.05  # of a place, where a robot stands at it: bodies stop within millimetres, SUMO rounds lengths
CORNER = 0.5  # of the way between two samples that a straight line may cut off at a corner
NEAR = 5.0  # robots' least distances, as far from a place as who waits for it may stand
OFF_RAD = 0.2  # of a heading, as far as lanes are off it
LATER_S = 1.0  # after another has come to wait
LATER_ONES = 3  # that are served before one that waits, each time that it comes: fewer may have stood in its way
MOST = 0.5  # of its time, of one round whose place there is no way
STOOD = 0.8  # of its time, of one that waits farther away


def service(logs: Logs) -> Iterator[Finding]:
    """A robot stands at the place (to 5 cm) for as long as it is served, and is there when it passes a stop that takes no time.

    A vehicle that cannot turn in place may be on the arc that cuts a corner, and with its axle on a curve.
    """
    stops, xy = logs.stops, logs.graph.xy
    aside_m = logs.fleet.aside_m[stops.robot] + logs.graph.swing_m[stops.vertex]
    there = np.hypot(*(logs.xy_at(stops.robot, np.minimum(stops.begin_s, logs.end_s)) - xy[stops.vertex]).T)
    beside_m = BESIDE_M + np.where(_is_corner(logs.graph)[stops.vertex], aside_m, 0.0)
    passing_m = beside_m + CORNER * (logs.fleet.max_speed_mps * logs.period_s)[stops.robot]
    for row, (begin_s, end_s, robot) in enumerate(zip(stops.begin_s.tolist(), stops.end_s.tolist(), stops.robot.tolist())):
        if not there[row] <= passing_m[row]:
            yield logs.of_stop("service", row, f"begins {there[row]:.2f} m away")
            continue
        away_m, at_s = logs.strays_m(robot, begin_s + logs.period_s, end_s, xy[int(stops.vertex[row])])
        if away_m > beside_m[row]:
            yield logs.of_stop("service", row, f"is {away_m:.2f} m away while it is served from {begin_s:.2f} s to {end_s:.2f} s", at_s)


def _is_corner(graph: PlanGraph) -> BoolArray:
    """[V] True at ends of curves, and where a lane leads on in another direction than one that comes, neither straight on nor back."""
    lane, onward = graph.onward
    bend = np.abs(wrapped(graph.heading_rad[onward] - graph.heading_rad[lane]))
    corner = np.zeros(graph.num_vertices, np.bool_)
    corner[[v for ends in graph.curves for v in ends]] = True
    corner[graph.head[lane[(bend > OFF_RAD) & (bend < np.pi - OFF_RAD)]]] = True
    return corner


def shifts(logs: Logs) -> Iterator[Finding]:
    """No service that takes time begins outside the shifts of its station."""
    spans = {station.name: station.spans_s for source in logs.terms.sources for station in source.stations()}
    for row in np.flatnonzero(logs.stops.end_s > logs.stops.begin_s + EPS_S).tolist():
        of_day, begin_s = spans.get(logs.stops.station[row], ()), float(logs.stops.begin_s[row])
        days = [begin_s - d * DAY_S for d in range(int(begin_s // DAY_S) + 1)]
        if of_day and not any(a - EPS_S <= t_s < b for t_s in days for a, b in of_day):
            yield logs.of_stop("shifts", row, f"begins at {begin_s:.2f} s, when nobody is there to serve it")


def headings(logs: Logs) -> Iterator[Finding]:
    """Vehicles that cannot turn in place are served in the heading of their station."""
    stations = {station.name: station for source in logs.terms.sources for station in source.stations() if station.heading_rad is not None}
    yaw = logs.execution.yaw_rad
    for row in np.flatnonzero(np.isin(logs.stops.station, list(stations))).tolist() if stations else ():
        robot, wanted = int(logs.stops.robot[row]), stations[logs.stops.station[row]].heading_rad or 0.0
        sample = min(int(np.ceil(logs.stops.begin_s[row] / logs.period_s - EPS_S)), len(yaw) - 1)
        off = abs(math.remainder(float(yaw[sample, robot]) - wanted, 2 * math.pi))
        if logs.fleet.is_vehicle[robot] and off > OFF_RAD:
            yield logs.of_stop("heading", row, f"is served {math.degrees(off):.0f} degrees from the heading of the station")


def places(logs: Logs) -> Iterator[Finding]:
    """No place serves two robots at once, be it a station's or a charger."""
    stops = logs.stops
    order = np.lexsort((stops.end_s, stops.begin_s, stops.vertex))
    last = -1
    for row in order.tolist():
        if last >= 0 and stops.vertex[last] == stops.vertex[row] and stops.begin_s[row] < stops.end_s[last] - EPS_S:
            other, until_s = logs.robot(int(stops.robot[last])), float(stops.end_s[last])
            yield logs.of_stop("one robot a place", row, f"is served while {other} is until {until_s:.2f} s")
            if stops.end_s[row] <= until_s:
                continue
        last = row


def shares(logs: Logs) -> Iterator[Finding]:
    """Shares of time are between 0 and 1."""
    for name, value in logs.metrics.items():
        is_share = name.startswith(("station_utilisation", "robot_")) and name.endswith(("_share", "_max", "_mean"))
        if is_share and isinstance(value, int | float) and not -1e-9 <= value <= 1 + 1e-9:
            yield Finding("utilisation", logs.end_s, f"{name} is {value:.3f}, expected 0 to 1")


def held(logs: Logs) -> Iterator[Finding]:
    """No more loads are set down at a place than its station `holds`, less those that were picked up there."""
    count: dict[int, int] = {}
    stops, made = logs.stops, dict[int, int]()
    for row in np.lexsort((stops.task, stops.end_s)).tolist():
        task = int(stops.task[row])
        order, nth = logs.ordered.get(task), made.get(task, 0)
        made[task] = nth + 1
        if order is None or nth >= len(order.stops) or logs.tasks.reason[task] or stops.end_s[row] > logs.end_s:
            continue
        station, change, vertex = order.stops[nth].station, load_change(order, nth), int(stops.vertex[row])
        if station is None or not station.holds:
            continue
        count[vertex] = max(count.get(vertex, 0) - change, 0)
        if count[vertex] > station.holds:
            text = f"sets down load {count[vertex]} at {logs.graph.known_as(vertex)}, which holds {station.holds}"
            yield logs.of_stop("one load a place", row, text, float(stops.end_s[row]))


class Wish(NamedTuple):
    """A stop that a robot makes, or has yet to make at the end of the run."""

    task: int
    robot: int
    place: str
    vertices: list[int]  # the places where it can be made
    since_s: float  # when the robot set out for it
    begin_s: float  # of the service, inf: never
    end_s: float


def waits(logs: Logs) -> Iterator[Finding]:
    """No robot waits near a place while three or more are served there that set out later, unless their orders are more urgent.

    One that stands in the way of a more urgent one, in line or in an aisle without room, has to go first. One that waits where nobody can
    pass, as on a one-way ring, has to drive on for those behind it, and comes anew. Nobody is in line for stops without service.
    """
    wishes = [*_made(logs), *_left(logs)]
    at_place = grouped((wish.place, wish) for wish in wishes)
    urgent = {task: order.priority for task, order in logs.ordered.items()}
    for wish in wishes:
        until_s = min(wish.begin_s, logs.end_s)
        if until_s - wish.since_s < LATER_S + 2 * logs.terms.waits_s or len(at_place[wish.place]) < 2:
            continue
        since_s = _waits_since_s(logs, wish, until_s)
        first = [
            each
            for each in at_place[wish.place]
            if since_s + LATER_S < each.since_s and each.begin_s < min(until_s - EPS_S, each.end_s) and each.robot != wish.robot
            if urgent.get(each.task, 0) <= urgent.get(wish.task, 0)
            if logs.capacity[each.robot] == 1 or each.begin_s > each.since_s + EPS_S  # else it is there already, with another order
        ]
        if len(first) < LATER_ONES or logs.was_in(LOST, wish.robot, wish.since_s, until_s):
            continue
        behind = [each for each in at_place[wish.place] if urgent.get(each.task, 0) > urgent.get(wish.task, 0)]
        behind_s = [(_waits_since_s(logs, each, min(each.begin_s, logs.end_s)), each.begin_s) for each in behind]
        first = [each for each in first if not any(came_s < each.begin_s < served_s for came_s, served_s in behind_s)]
        if len(first) < LATER_ONES or sum(not _stands_between(logs, wish, each) for each in first) < LATER_ONES:
            continue
        if len(first) < LATER_ONES * (1 + _times_past(logs, wish, since_s, until_s)):
            continue
        if not _is_cut_off(logs, wish, since_s, until_s) and not _is_too_far_back(logs, wish):
            who, order = logs.robot(wish.robot), logs.tasks.name[wish.task]
            served = f"{len(first)} that set out later are served, at first order '{logs.tasks.name[first[0].task]}'"
            text = f"{who}, order '{order}' at {wish.place}: waits from {since_s:.2f} s to {until_s:.2f} s while {served}"
            yield Finding("first come, first served", since_s, text, who, wish.place, order)


def _made(logs: Logs) -> Iterator[Wish]:
    stops = logs.stops
    for row, (task, robot) in enumerate(zip(stops.task.tolist(), stops.robot.tolist())):
        times_s = (float(column[row]) for column in (stops.since_s, stops.begin_s, stops.end_s))
        yield Wish(task, robot, logs.place(row), [int(stops.vertex[row])], *times_s)


def _left(logs: Logs) -> Iterator[Wish]:
    """The stops for which robots are on their way at the end, of orders that were not handed over.

    Who has several orders sets out for the next stop when it has made another, of whichever order.
    """
    stops, tasks = logs.stops, logs.tasks
    for task in np.flatnonzero(np.isnan(tasks.ended_s) & (tasks.robot >= 0)).tolist():
        rows, order = np.flatnonzero(stops.task == task), logs.ordered.get(task)
        if order is None or tasks.reason[task] or len(rows) >= len(order.stops):
            continue
        stop, robot = order.stops[len(rows)], int(tasks.robot[task])
        since_s = float(stops.end_s[(stops.task == task) | (stops.robot == robot)].max(initial=tasks.assigned_s[task]))
        place = stop.station.name if stop.station else logs.graph.known_as(stop.vertex)
        yield Wish(task, robot, place, list(stop.places), since_s, np.inf, np.inf)


def _is_cut_off(logs: Logs, wish: Wish, since_s: float, until_s: float) -> bool:
    """True if there is no way round robots that are served for most of the time, as at chargers in an aisle, or round one that is lost."""
    stops, graph = logs.stops, logs.graph

    def closed(stood: Iterable[tuple[int, int, float, float]]) -> dict[int, float]:
        """Of vertices where others stand from one time to another those that they close, and since when."""
        others = ((v, max(begin_s, since_s), end_s) for v, robot, begin_s, end_s in stood if robot != wish.robot and v not in wish.vertices)
        return {v: from_s for v, from_s, end_s in others if (min(end_s, until_s) - from_s) / (until_s - since_s) > MOST}

    served = closed(zip(stops.vertex.tolist(), stops.robot.tolist(), stops.begin_s.tolist(), stops.end_s.tolist()))
    lost = closed((u, *rest) for v, *rest in _lost(logs) for u in (v, *graph.head[graph.tail == v].tolist()))  # or it was granted the next
    for each in filter(None, (served, *({v: from_s} for v, from_s in lost.items()))):
        leads = ~(np.isin(graph.tail, [*each]) | np.isin(graph.head, [*each]))
        at = np.array([vertex_at(logs, wish.robot, max(each.values()))])
        past, ever = (np.isfinite(reach_m(graph, lanes, at)[0, wish.vertices]).any() for lanes in (leads, leads | True))
        if ever and not past:
            return True
    return False


def _is_too_far_back(logs: Logs, wish: Wish) -> bool:
    """True on a line, where nobody passes another, if there is no room beyond the places for all who are before a robot."""
    graph = logs.graph
    at = vertex_at(logs, wish.robot, wish.since_s)
    piece = weak_components(graph.num_vertices, graph.tail, graph.head)
    beside = [set[int]() for _ in range(graph.num_vertices)]
    for a, b in zip(graph.tail.tolist(), graph.head.tolist()):
        beside[a].add(b)
        beside[b].add(a)
    row = [v for v in np.flatnonzero(piece == piece[at]).tolist() if len(beside[v]) == 1][:1]
    while row and (ahead := beside[row[-1]].difference(row)):
        row.append(min(ahead))
    if not row or (piece == piece[at]).sum() > len(row):
        return False
    where = [vertex_at(logs, robot, wish.since_s) for robot in range(logs.fleet.num_robots)]
    place = [row.index(v) for robot, v in enumerate(where) if v in row and robot != wish.robot]
    before = sum(each < row.index(at) for each in place)
    return not any(before <= row.index(v) < len(row) - (len(place) - before) for v in wish.vertices if v in row)


def _times_past(logs: Logs, wish: Wish, since_s: float, until_s: float) -> int:
    """How often a robot drove away from near its place, after it had stood there in the way of all behind it."""
    some = logs.samples_between(since_s, until_s)
    xy = np.stack([column[some, wish.robot] for column in (logs.execution.x_m, logs.execution.y_m)], 1)
    near = _away_m(logs, xy, wish) < NEAR * float(logs.fleet.apart_m.max())
    leaves_s = logs.execution.t_s[some][:-1][near[:-1] & ~near[1:]]
    stands_s = logs.standing[wish.robot][:, 0]
    stood_s = [stands_s[stands_s <= t_s].max(initial=since_s) for t_s in leaves_s.tolist()]
    return sum(_bars_all(logs.graph, vertex_at(logs, wish.robot, max(t_s, since_s))) for t_s in stood_s)


def _bars_all(graph: PlanGraph, v: int) -> bool:
    """True if there is no way round a vertex between some that have ways to each other."""
    leads = (graph.tail != v) & (graph.head != v)
    pieces = [strong_components(graph.num_vertices, graph.tail[lanes], graph.head[lanes]) for lanes in (leads | True, leads)]
    others = np.flatnonzero((pieces[0] == pieces[0][v]) & (np.arange(graph.num_vertices) != v))
    return len(np.unique(pieces[1][others])) > 1


def _away_m(logs: Logs, xy: FloatArray, wish: Wish) -> FloatArray:
    """[N] distances of points [N, 2] from the nearest place of a stop."""
    away_m: FloatArray = np.hypot(*(xy[:, None] - logs.graph.xy[wish.vertices][None]).transpose(2, 0, 1)).min(1)
    return away_m


def _stands_between(logs: Logs, wish: Wish, other: Wish) -> bool:
    """True if one that sets out later is on every way of a robot to its place then, and has no room to get off before the place.

    Nobody passes robots that are lost.
    """
    graph, t_s = logs.graph, other.since_s
    at, ahead = (vertex_at(logs, each.robot, t_s) for each in (wish, other))
    lost = [v for v, _, begin_s, end_s in _lost(logs) if begin_s <= t_s < end_s]
    free = ~np.isin(graph.head, lost) & ~np.isin(graph.tail, lost)
    past = free & (graph.tail != ahead) & (graph.head != ahead)
    if ahead in (at, *wish.vertices) or np.isfinite(reach_m(graph, past, np.array([at]))[0, wish.vertices]).any():
        return False
    routes = [route for v in wish.vertices if (route := shortest_route(graph, free, at, v)) is not None]
    before = free & ~np.isin(graph.head, [at, *wish.vertices])
    room = np.flatnonzero(np.isfinite(reach_m(graph, before, np.array([ahead]))[0]))
    shortest: list[int] = min(routes, key=len, default=[])
    return set(room.tolist()) <= set(shortest)


def _lost(logs: Logs) -> Iterator[tuple[int, int, float, float]]:
    """Robots that are lost: vertex, robot, from when and until when."""
    for robot in range(logs.fleet.num_robots):
        for begin_s, end_s in logs.times_in(LOST, robot):
            yield vertex_at(logs, robot, begin_s), robot, begin_s, end_s


def vertex_at(logs: Logs, robot: int, t_s: float) -> int:
    """The vertex nearest to a robot at a time."""
    return int(np.hypot(*(logs.graph.xy - logs.xy_at(np.array([robot]), np.array([t_s]))).T).argmin())


def _waits_since_s(logs: Logs, wish: Wish, until_s: float) -> float:
    """When a robot began to stand near where it wanted to, or to stand longest of one that stood for most of its time; inf: never.

    Who set out first need not have come first: robots come from near and far. One that stalls far away is in no line, and is said to stall.
    """
    stands = logs.standing[wish.robot]
    some = stands[(stands[:, 1] > wish.since_s) & (stands[:, 0] < until_s)]
    if not len(some):
        return np.inf
    since_s = np.maximum(some[:, 0], wish.since_s)
    lasts_s = np.minimum(some[:, 1], until_s) - since_s
    at = logs.xy_at(np.full(len(some), wish.robot), since_s)
    near = (_away_m(logs, at, wish) < NEAR * float(logs.fleet.apart_m.max())) & (lasts_s > LATER_S)
    near_s = float(since_s[near][0]) if near.any() else np.inf
    stood = float(lasts_s.sum() / (until_s - wish.since_s)) > STOOD and not logs.was_in((STALLED,), wish.robot, wish.since_s, until_s)
    return min(near_s, float(since_s[lasts_s.argmax()])) if stood else near_s


def lifts(logs: Logs) -> Iterator[Finding]:
    """Rides: a robot that changes levels is in a lift then, alone."""
    log, level, t = logs.execution.facilities, logs.execution.level, logs.execution.t_s
    if level is None or len(t) < 2:
        return
    at, robots = np.nonzero(level[1:] != level[:-1])
    for k, robot in zip(at.tolist(), robots.tolist()):
        who, t_s = logs.robot(robot), float(t[k + 1])
        if log is None or not any(_has(logs, lift, robot, t_s) for lift in range(len(log.lift_name))):
            yield Finding("lifts", t_s, f"{who} changes levels at {t_s:.2f} s, but no lift has it", who)


def _has(logs: Logs, lift: int, robot: int, t_s: float) -> bool:
    log = logs.execution.facilities
    assert log is not None
    row = _row_at(np.flatnonzero(log.lift == lift), log.lift_t_s, t_s)
    return row is not None and log.lift_robot[row] == robot and LIFT_STATES[log.lift_state[row]] == "taken"


def _row_at(rows: IntArray, at_s: FloatArray, t_s: float) -> int | None:
    """Of rows, whose times ascend, the one that says how it is at a time: the last until then, else the first; None without rows."""
    k = int(np.searchsorted(at_s[rows], t_s + EPS_S, side="right")) - 1
    return int(rows[max(k, 0)]) if len(rows) else None


def doors(logs: Logs) -> Iterator[Finding]:
    """Doors are open when robots drive through them."""
    log, graph = logs.execution.facilities, logs.graph
    if log is None or not log.door_name or not len(logs.terms.doors_xy):
        return
    for number, name in enumerate(log.door_name):
        lanes = [k for k, options in enumerate(graph.lane_options) if options.get("door") == name]
        tail, head, rows = graph.xy[graph.tail[lanes]], graph.xy[graph.head[lanes]], np.flatnonzero(log.door == number)
        for leaf in (leaf for leaf in logs.terms.doors_xy if _cross(tail, head, leaf).any()):
            for robot, t_s in _passes(logs, leaf):
                row = _row_at(rows, log.door_t_s, t_s)
                state = "closed" if row is None else DOOR_STATES[log.door_state[row]]
                if state != "open":
                    who = logs.robot(robot)
                    yield Finding("doors", t_s, f"{who} drives through door '{name}' at {t_s:.2f} s, which is {state}", who, name)


def _cross(a: FloatArray, b: FloatArray, door: FloatArray) -> FloatArray:
    """[N] whether the ways from a to b [N, 2] cross a door."""
    along, across = b - a, door[1] - door[0]
    turn = along[:, 0] * across[1] - along[:, 1] * across[0]
    to = door[0] - a
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (to[:, 0] * across[1] - to[:, 1] * across[0]) / turn
        w = (to[:, 0] * along[:, 1] - to[:, 1] * along[:, 0]) / turn
    crosses: FloatArray = (u > 0) & (u <= 1) & (w >= 0) & (w <= 1)
    return crosses


def _passes(logs: Logs, door: FloatArray) -> Iterator[tuple[int, float]]:
    run = logs.execution
    near_m = float(np.hypot(*(door[1] - door[0]))) / 2 + 1.0
    middle = door.mean(0)
    for robot in range(logs.fleet.num_robots):
        x, y = run.x_m[:, robot], run.y_m[:, robot]
        near = np.flatnonzero((np.abs(x - middle[0]) < near_m) & (np.abs(y - middle[1]) < near_m))
        near = near[near < len(x) - 1]
        points = np.stack([x, y], 1)
        for k in near[_cross(points[near], points[near + 1], door).astype(np.bool_)].tolist():
            yield robot, float(run.t_s[k])
