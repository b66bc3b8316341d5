"""Lifts and doors as Open-RMF has them: /lift_states and /door_states at each change and once a second, and requests of robots.

A robot asks for a lift with the level to which it is to come, then with the level to which it rides, and ends its session when it has left
(/lift_requests). It asks for a door to be open, and to be closed when it is through (/door_requests). People use the buttons.
"""

from collections.abc import Iterator
from heapq import merge
from typing import NamedTuple

import numpy as np

from mrp_sumo.bags.messages import EPOCH_NS, FLEET_NAME, Messages
from mrp_sumo.core.facilities import DOOR_STATES, LIFT_MODES, FacilityLog
from mrp_sumo.core.graph import IntArray

LIFTS, DOORS = ("/lift_states", "rmf_lift_msgs/LiftState"), ("/door_states", "rmf_door_msgs/DoorState")
LIFT_REQUESTS, DOOR_REQUESTS = ("/lift_requests", "rmf_lift_msgs/LiftRequest"), ("/door_requests", "rmf_door_msgs/DoorRequest")
TOPICS = (LIFTS, DOORS, LIFT_REQUESTS, DOOR_REQUESTS)
MODE_HUMAN, MODE_AGV = 1, 2
CURRENT_MODE = {"agv": MODE_AGV, "human": MODE_HUMAN, "fire": 3, "offline": 4}
END_SESSION, AGV_MODE, LIFT_DOOR_OPEN = 0, 1, 2
DOOR_CLOSED, DOOR_OPEN = 0, 2
DOOR_MODE = {"closed": 0, "opening": 1, "open": 2, "closing": 1}
NOBODY = -1
SECOND_NS = 1_000_000_000


def facility_states(m: Messages, until_s: float, after_s: float = -1.0) -> Iterator[tuple[int, str, bytes]]:
    """(ns of the run, topic, message) of each lift and each door after a time and until another, by time; none of maps without."""
    log = m.record.execution.facilities
    if log is None:
        return
    after_ns, until_ns = round(after_s * 1e9), round(until_s * 1e9)
    ticks = np.arange(-(-max(after_ns + 1, 0) // SECOND_NS) * SECOND_NS, until_ns + 1, SECOND_NS, dtype=np.int64)
    moments: list[tuple[int, str, int, int]] = []
    for topic, names, t_s, which in ((LIFTS[0], log.lift_name, log.lift_t_s, log.lift), (DOORS[0], log.door_name, log.door_t_s, log.door)):
        for number in range(len(names)):
            rows = np.flatnonzero(which == number)
            begin = np.rint(t_s[rows] * 1e9).astype(np.int64)
            times = np.union1d(begin[(begin > after_ns) & (begin <= until_ns)], ticks)
            last = rows[np.searchsorted(begin, times, side="right") - 1]
            moments += [(ns, topic, number, k) for ns, k in zip(times.tolist(), last.tolist())]
    floors = _floors(m, log) if moments else []
    stated = (
        (ns, topic, _lift(m, log, floors[number], ns, row) if topic == LIFTS[0] else _door(m, log, ns, row))
        for ns, topic, number, row in sorted(moments)
    )
    requests = [ask for ask in (*_of_lifts(log), *_of_doors(log)) if after_ns < ask.ns <= until_ns]
    stream = ((ask.ns, ask.topic, _request(m, ask)) for ask in sorted(requests, key=lambda ask: ask.ns))
    yield from merge(stream, stated, key=lambda each: each[0])


class Ask(NamedTuple):
    """A robot's request."""

    ns: int
    topic: str
    name: str  # of the lift or door
    robot: int
    kind: int  # END_SESSION or AGV_MODE; DOOR_OPEN or DOOR_CLOSED
    level: int = -1


def _of_lifts(log: FacilityLog) -> Iterator[Ask]:
    for lift, name in enumerate(log.lift_name):
        was, level = NOBODY, -1
        for row in np.flatnonzero(log.lift == lift).tolist():
            ns, robot, wanted = round(log.lift_t_s[row] * 1e9), max(NOBODY, int(log.lift_robot[row])), int(log.lift_target[row])
            if was not in (NOBODY, robot):
                yield Ask(ns, LIFT_REQUESTS[0], name, was, END_SESSION, level)
            if robot != NOBODY and (robot, wanted) != (was, level):
                yield Ask(ns, LIFT_REQUESTS[0], name, robot, AGV_MODE, wanted)
            was, level = robot, wanted


def _of_doors(log: FacilityLog) -> Iterator[Ask]:
    shut = [k for k, state in enumerate(DOOR_STATES) if state in ("closed", "closing")]
    for door, name in enumerate(log.door_name):
        was = NOBODY
        for row in np.flatnonzero(log.door == door).tolist():
            ns, robot = round(log.door_t_s[row] * 1e9), max(NOBODY, int(log.door_robot[row]))
            robot = NOBODY if log.door_state[row] in shut else robot
            if was not in (NOBODY, robot):
                yield Ask(ns, DOOR_REQUESTS[0], name, was, DOOR_CLOSED)
            if robot not in (NOBODY, was):
                yield Ask(ns, DOOR_REQUESTS[0], name, robot, DOOR_OPEN)
            was = robot


def _request(m: Messages, ask: Ask) -> bytes:
    stamp, session = m.time(EPOCH_NS + ask.ns), _session(m, ask.robot)
    if ask.topic == LIFT_REQUESTS[0]:
        to = m.record.graph.level_names[ask.level]
        return m.message(LIFT_REQUESTS[1], ask.name, stamp, session, ask.kind, to, LIFT_DOOR_OPEN)
    return m.message(DOOR_REQUESTS[1], stamp, session, ask.name, m.make("rmf_door_msgs/DoorMode", ask.kind))


def _session(m: Messages, robot: int) -> str:
    return f"{FLEET_NAME}/{m.robots[robot]}" if robot >= 0 else ""


def _floors(m: Messages, log: FacilityLog) -> list[list[str]]:
    """The levels that each lift serves: those with a vertex in its cabin."""
    graph = m.record.graph
    served: dict[str, set[int]] = {}
    for v, options in enumerate(graph.vertex_options):
        if name := options.get("in_lift"):
            served.setdefault(str(name), set()).add(int(graph.level[v]))
    return [[graph.level_names[k] for k in sorted(served.get(name, ()))] for name in log.lift_name]


def _lift(m: Messages, log: FacilityLog, floors: list[str], ns: int, row: int) -> bytes:
    names = m.record.graph.level_names
    modes: IntArray = np.array([MODE_HUMAN, MODE_AGV], np.uint8)
    return m.message(
        LIFTS[1],
        m.time(EPOCH_NS + ns),
        log.lift_name[log.lift[row]],
        floors,
        names[log.lift_level[row]],
        names[log.lift_target[row]],
        int(log.lift_doors[row]),
        int(log.lift_motion[row]),
        modes,
        CURRENT_MODE[LIFT_MODES[log.lift_mode[row]]],
        _session(m, int(log.lift_robot[row])),
    )


def _door(m: Messages, log: FacilityLog, ns: int, row: int) -> bytes:
    mode = m.make("rmf_door_msgs/DoorMode", DOOR_MODE[DOOR_STATES[log.door_state[row]]])
    return m.message(DOORS[1], m.time(EPOCH_NS + ns), log.door_name[log.door[row]], mode)
