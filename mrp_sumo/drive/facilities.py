"""Lifts and doors of one execution: their arrays for the kernels, laid out from the options of a plan graph, and what they did.

A lift is what rides and the vertices in its cabin say (`maps.lifts`), a door what the lanes through it say (`maps.doors`).
"""

import numpy as np

from mrp_sumo.core.facilities import FacilityLog, door_names, lift_names
from mrp_sumo.core.graph import FloatArray, IntArray, NavGraph, frozen
from mrp_sumo.drive import _facilities
from mrp_sumo.drive.listeners import Listener, Moment
from mrp_sumo.drive.state import Doors, Facilities, Lifts, packed
from mrp_sumo.traffic.resources import Resources, cabin_group

DOORS_MOVE, OPEN = 1, 2  # of `core.facilities.LIFT_DOORS`
AGV, HUMAN, FIRE, OFFLINE = range(4)  # `core.facilities.LIFT_MODES`
SOON_S = 1e-6
AT_STOP_M = 1e-6  # from it by more, a ride has begun
UNKNOWN = -9  # no state of anything


def facilities_of(graph: NavGraph, resources: Resources, *, people_open: bool = True) -> Facilities:
    """The lifts and doors of a graph, closed; cabins are where robots or the map have them at first.

    Manual doors open for people only, or, without `people_open`, for robots like others.
    """
    lifts, doors = lift_names(graph), door_names(graph)
    tail, head = graph.tail, graph.head
    vertex_lift = _numbered([options.get("in_lift") for options in graph.vertex_options] if lifts else [], lifts, graph.num_vertices)
    enters = (vertex_lift[head] >= 0) & (vertex_lift[tail] != vertex_lift[head]) & ~graph.is_ride
    lane_lift = np.where(enters, vertex_lift[head], -1)
    gates = np.flatnonzero(enters)
    ride_s, close_s, open_s, car = _times(graph, lifts)
    lane_door = _numbered([options.get("door") for options in graph.lane_options] if doors else [], doors, graph.num_lanes)
    door_s, manual = np.zeros(len(doors)), np.zeros(len(doors), np.bool_)
    vertex_door = np.full(graph.num_vertices, -1)
    for k in np.flatnonzero(lane_door >= 0).tolist():
        door_s[lane_door[k]] = graph.lane_options[k]["door_s"]
        manual[lane_door[k]] = people_open and graph.lane_options[k].get("door_manual", False)
    for v, options in enumerate(graph.vertex_options if doors else ()):
        if options.get("door"):
            vertex_door[v] = doors.index(options["door"])
    reach = np.where(np.isfinite(ride_s), ride_s, 0.0)
    call_s = reach.max(axis=(1, 2), initial=0.0)
    group = {name: len(resources.zone) + graph.num_vertices + g for g, name in enumerate(resources.group_name)}
    through = np.flatnonzero(lane_door >= 0)

    def index(value: int, count: int) -> IntArray:
        return np.full(count, value, np.int64)

    num_lifts, num_doors = len(lifts), len(doors)
    return Facilities(
        any=bool(lifts or doors),
        lifts=packed(
            Lifts(
                resource=np.array([group[cabin_group(name)] for name in lifts], np.int64),
                call_s=call_s,
                recall=car,
                mode=index(_facilities.CLOSED, num_lifts),
                car=car,
                target=car,
                until_s=np.zeros(num_lifts),
                session=index(_facilities.NOBODY, num_lifts),
                caller=index(_facilities.NOBODY, num_lifts),
                visit=index(-1, num_lifts),
                since_s=np.zeros(num_lifts),
                service=index(_facilities.IN_SERVICE, num_lifts),
                ride_since_s=np.full(num_lifts, np.inf),
                ride_begin=index(0, num_lifts),
                ride_end=index(0, num_lifts),
                ride_hold_s=np.zeros(num_lifts),
                ride_stage=index(0, num_lifts),
            )
        ),
        doors=packed(
            Doors(
                move_s=door_s,
                manual=manual,
                mode=index(_facilities.SHUT, num_doors),
                until_s=np.zeros(num_doors),
                called=np.zeros(num_doors, np.bool_),
                soon=np.zeros(num_doors, np.bool_),
                robot=index(_facilities.NOBODY, num_doors),
                service=index(_facilities.IN_SERVICE, num_doors),
                held_until_s=np.zeros(num_doors),
            )
        ),
        shut=np.zeros(graph.num_lanes, np.bool_),
        level=np.array(graph.level),
        vertex_lift=vertex_lift,
        vertex_door=vertex_door,
        lane_lift=lane_lift,
        lane_door=lane_door,
        gate_lane=gates,
        gate_lift=lane_lift[gates],
        gate_level=np.array(graph.level[head[gates]]),
        through=through,
        through_door=lane_door[through],
        ride_s=ride_s,
        close_s=close_s,
        open_s=open_s,
        longest_s=float(max(call_s.max(initial=0.0), 2 * door_s.max(initial=0.0))),
    )


def _numbered(names: list[str | None], known: list[str], count: int) -> IntArray:
    """[count] the place of each name among those that are known, -1 for none."""
    number = {name: k for k, name in enumerate(known)}
    return np.array([number.get(str(name), -1) for name in names], np.int64) if names else np.full(count, -1)


def _times(graph: NavGraph, lifts: list[str]) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
    """[F, K, K] seconds from level to level, by other levels where there is no other way, inf where there is none; [F, K] until doors
    are closed, and open; [F] the level where each cabin is at first.
    """
    num_levels = len(graph.level_names)
    ride_s = np.full((len(lifts), num_levels, num_levels), np.inf)
    close_s, open_s, car = np.zeros(ride_s.shape[:2]), np.zeros(ride_s.shape[:2]), np.zeros(len(lifts), np.int64)
    for k in np.flatnonzero(graph.is_ride & (graph.level[graph.tail] != graph.level[graph.head])).tolist():
        options, one, other = graph.lane_options[k], graph.level[graph.tail[k]], graph.level[graph.head[k]]
        f = lifts.index(str(options["lift"]))
        ride_s[f, one, other], close_s[f, one], open_s[f, other] = options["ride_s"], options["close_s"], options["open_s"]
    for by in range(num_levels):
        np.minimum(ride_s, ride_s[:, :, by, None] + ride_s[:, None, by, :], out=ride_s)
    for f, name in enumerate(lifts):
        stops = [v for v, options in enumerate(graph.vertex_options) if options.get("in_lift") == name]
        first = [v for v in stops if graph.vertex_options[v].get("car_at_first")]
        car[f] = graph.level[(first or stops)[0]]
    return ride_s, close_s, open_s, car


class FacilityRecorder(Listener):
    """Keeps what lifts and doors do."""

    def __init__(self, graph: NavGraph, facilities: Facilities) -> None:
        self._names = tuple(lift_names(graph)), tuple(door_names(graph))
        self._facilities = facilities
        self._lifts: list[tuple[float, ...]] = []
        self._doors: list[tuple[float, ...]] = []
        self._lift_was = np.full((len(self._names[0]), 7), UNKNOWN)
        self._door_was = np.full((len(self._names[1]), 2), UNKNOWN)
        self._from = facilities.lifts.car.copy()  # levels where rides begin

    def hear(self, snapshot: Moment) -> None:
        now, gate = self._facilities.lifts, self._facilities.doors
        target = np.where(now.mode == _facilities.COMING, now.target, now.car)
        doors, motion = np.where(now.mode == _facilities.CLOSED, 0, OPEN), np.zeros(len(target), np.int64)
        for f in np.flatnonzero((now.mode == _facilities.COMING) | (now.mode == _facilities.TAKEN)).tolist():
            left_s, target[f] = (
                (now.until_s[f] - snapshot.now_s, target[f]) if now.mode[f] == _facilities.COMING else self._ride(f, snapshot)
            )
            if now.mode[f] == _facilities.COMING:
                self._from[f] = now.car[f]
            if left_s > 0:
                doors[f], motion[f] = self._phase(f, int(self._from[f]), int(target[f]), left_s)
            else:
                self._from[f] = now.car[f]
        runs_for = np.where(now.session == _facilities.PEOPLE, HUMAN, AGV)
        runs_for = np.where(now.service == _facilities.IN_SERVICE, runs_for, np.where(now.service == _facilities.FIRE, FIRE, OFFLINE))
        lift = np.stack([now.mode, now.car, target, now.session, doors, motion, runs_for], 1)
        door = np.stack([gate.mode, np.where(gate.mode == _facilities.SHUT, _facilities.NOBODY, gate.robot)], 1)
        for f in np.flatnonzero((lift != self._lift_was).any(1)).tolist():
            self._lifts.append((snapshot.now_s, f, *lift[f].tolist()))
        for d in np.flatnonzero((door != self._door_was).any(1)).tolist():
            self._doors.append((snapshot.now_s, d, *door[d].tolist()))
        self._lift_was, self._door_was = lift, door

    def _ride(self, f: int, snapshot: Moment) -> tuple[float, int]:
        """How long the ride of who is in a lift still lasts, 0 before and after it, and to which level it leads."""
        now, ledger = self._facilities.lifts, snapshot.ledger
        visits, graph, robot = ledger.visits, ledger.graph, int(now.session[f])
        s_m, k, left_s, level = float(ledger.state.motion.s_m[robot]), int(visits.next[visits.reached[robot]]), 0.0, int(now.car[f])
        begun = graph.is_ride[visits.lane[visits.reached[robot]]] or (k >= 0 and s_m > visits.from_m[k] + AT_STOP_M)
        while begun and k >= 0 and graph.is_ride[visits.lane[k]]:
            left_s = float((visits.at_m[k] - s_m) / graph.speed_mps[visits.lane[k]])
            level, k = int(graph.level[visits.vertex[k]]), int(visits.next[k])
        return left_s, level

    def _phase(self, f: int, begin: int, end: int, left_s: float) -> tuple[int, int]:
        """The state of a lift's doors, and which way it moves, so long before it is at another level with open doors."""
        now = self._facilities
        if left_s <= now.open_s[f, end]:
            return DOORS_MOVE, 0
        if begin != end and left_s > now.ride_s[f, begin, end] - now.close_s[f, begin] + SOON_S:
            return DOORS_MOVE, 0
        return 0, 1 if end > begin else 2

    def log(self) -> FacilityLog:
        """All of it."""
        lift, door = (np.array(rows).reshape(-1, n).T for rows, n in ((self._lifts, 9), (self._doors, 4)))

        def whole(column: FloatArray) -> IntArray:
            return frozen(column.astype(np.int64))

        return FacilityLog(
            lift_name=self._names[0],
            lift_t_s=frozen(lift[0]),
            lift=whole(lift[1]),
            lift_state=whole(lift[2]),
            lift_level=whole(lift[3]),
            lift_target=whole(lift[4]),
            lift_robot=whole(lift[5]),
            lift_doors=whole(lift[6]),
            lift_motion=whole(lift[7]),
            lift_mode=whole(lift[8]),
            door_name=self._names[1],
            door_t_s=frozen(door[0]),
            door=whole(door[1]),
            door_state=whole(door[2]),
            door_robot=whole(door[3]),
        )
