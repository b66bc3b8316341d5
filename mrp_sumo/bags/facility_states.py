"""/lift_states and /door_states: what lifts and doors do, as Open-RMF's adapters publish it, at each change and once a second."""

from collections.abc import Iterator

import numpy as np

from mrp_sumo.bags.messages import EPOCH_NS, FLEET_NAME, Messages
from mrp_sumo.core.facilities import DOOR_STATES, PEOPLE, FacilityLog
from mrp_sumo.core.graph import IntArray

LIFTS, DOORS = ("/lift_states", "rmf_lift_msgs/LiftState"), ("/door_states", "rmf_door_msgs/DoorState")
MODE_HUMAN, MODE_AGV = 1, 2
DOOR_MODE = {"closed": 0, "opening": 1, "open": 2, "closing": 1}
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
    for ns, topic, number, row in sorted(moments):
        yield ns, topic, _lift(m, log, floors[number], ns, row) if topic == LIFTS[0] else _door(m, log, ns, row)


def _floors(m: Messages, log: FacilityLog) -> list[list[str]]:
    """The levels that each lift serves: those with a vertex in its cabin."""
    graph = m.record.graph
    served: dict[str, set[int]] = {}
    for v, options in enumerate(graph.vertex_options):
        if name := options.get("in_lift"):
            served.setdefault(str(name), set()).add(int(graph.level[v]))
    return [[graph.level_names[k] for k in sorted(served.get(name, ()))] for name in log.lift_name]


def _lift(m: Messages, log: FacilityLog, floors: list[str], ns: int, row: int) -> bytes:
    robot = int(log.lift_robot[row])
    names = m.record.graph.level_names
    modes: IntArray = np.array([MODE_HUMAN, MODE_AGV], np.uint8)
    message = m.make(
        LIFTS[1],
        m.time(EPOCH_NS + ns),
        log.lift_name[log.lift[row]],
        floors,
        names[log.lift_level[row]],
        names[log.lift_target[row]],
        int(log.lift_doors[row]),
        int(log.lift_motion[row]),
        modes,
        MODE_HUMAN if robot == PEOPLE else MODE_AGV,
        f"{FLEET_NAME}/{m.robots[robot]}" if robot >= 0 else "",
    )
    return m.serialised(message)


def _door(m: Messages, log: FacilityLog, ns: int, row: int) -> bytes:
    mode = m.make("rmf_door_msgs/DoorMode", DOOR_MODE[DOOR_STATES[log.door_state[row]]])
    return m.serialised(m.make(DOORS[1], m.time(EPOCH_NS + ns), log.door_name[log.door[row]], mode))
