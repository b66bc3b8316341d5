"""A finished run as the messages of VDA 5050 that a fleet manager and its vehicles would have exchanged.

The base of an order is what the ledger had granted by then, to the end of a lane that is entered, its horizon the rest of the robot's
way. What is granted, and every other way that a robot is sent, is an update of the order with the last node of its base as the stitching
node. A robot that has made its way to the end gets a new order with its next way. Simulated time begins on the first of January 1970.
"""

import json
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import chain, groupby
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mrp_sumo.core.execution import Execution, GrantLog
from mrp_sumo.core.graph import FloatArray
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.formats.vda.errors import error
from mrp_sumo.formats.vda.factsheet import factsheet
from mrp_sumo.formats.vda.messages import (
    KINDS,
    STANDING_MPS,
    Dialect,
    Json,
    Sender,
    StateContent,
    action,
    line_of,
    node,
    serials_of,
    state,
    states_of,
)
from mrp_sumo.formats.vda.orders import VehicleOrders, edge_of
from mrp_sumo.io.record import RunRecord
from mrp_sumo.reports.exports import replacing

KEEP_ALIVE_S = 30.0  # a vehicle reports at least this often
MOST_HZ = 10.0  # of visualization
ERRORS = {  # events that a robot reports while they last -> level in 2.1, and in 3.0
    "blocked": ("WARNING", "WARNING"),
    "deadlock": ("WARNING", "URGENT"),
    "disturbed": ("WARNING", "WARNING"),
    "blocked_for_good": ("FATAL", "CRITICAL"),
    "battery_empty": ("FATAL", "FATAL"),
}
# what happens at one moment, in this order
WAY, GRANT, ARRIVE, ACT, ERROR, DRIVE, ALIVE, SHOW = range(8)


class Visit(NamedTuple):
    """A visit of a robot's way, as it was planned at some time."""

    vertex: int
    arrived_s: float  # NaN: never
    reply: int  # number of the reply that it came with, -1: the first plan


class Done(NamedTuple):
    """An action with its times."""

    document: Json
    since_s: float  # the robot had it to do next
    begin_s: float
    end_s: float


class Happening(NamedTuple):
    """Something at a time that messages follow from."""

    t_s: float
    kind: int
    number: int = 0
    route: tuple[Visit, ...] = ()


def write_vda(path: Path, record: RunRecord, version: str) -> None:
    """Write a folder: `messages.jsonl`, all in time order, and each vehicle's messages by topic; of version '2.1' or '3.0'.

    Raises MrpSumoError for another version, a folder that is there, a run without a plan, and one of which it is not known what was
    granted when.
    """
    dialect = Dialect(version)
    if record.plan is None or record.execution.grants is None:
        lacks = "has no plan" if record.plan is None else "does not say when robots were granted their ways; no recording does"
        raise MrpSumoError(f"the run '{record.name}' {lacks}")
    serials = serials_of(record.fleet.robot_name)
    with replacing(path) as partial:
        partial.mkdir(parents=True)
        times, offsets = [], [0]
        scratch = partial / "messages.part"
        with scratch.open("wb") as out:
            for robot, serial in enumerate(serials):
                (partial / serial).mkdir()
                with ExitStack() as stack:
                    opened = (stack.enter_context((partial / serial / f"{kind}.jsonl").open("w", encoding="utf-8")) for kind in KINDS)
                    files = dict(zip(KINDS, opened))
                    for t_s, kind, payload in LoggedVehicle(record, record.execution.grants, robot, Sender(dialect, serial)).messages():
                        files[kind].write(json.dumps(payload, separators=(",", ":"), allow_nan=False) + "\n")
                        line = line_of(t_s, dialect.topic(serial, kind), payload).encode()
                        out.write(line)
                        times.append(t_s)
                        offsets.append(offsets[-1] + len(line))
        _sort(scratch, np.array(times), np.array(offsets), partial / "messages.jsonl")
        scratch.unlink()


def _sort(source: Path, times: FloatArray, offsets: np.ndarray, target: Path) -> None:
    """Write lines by time; at one time by vehicle, and as they were sent."""
    with source.open("rb") as read, target.open("wb") as out:
        for k in np.argsort(times, kind="stable").tolist():
            read.seek(offsets[k])
            out.write(read.read(int(offsets[k + 1] - offsets[k])))


@dataclass
class LoggedVehicle:
    """One robot of a run, and what messages say of it."""

    record: RunRecord
    grants: GrantLog
    robot: int
    sender: Sender
    route: tuple[Visit, ...] = ()
    granted: int = 0  # number of the last visit that it may drive to
    reached: int = 0
    actions: dict[tuple[int, int], list[Done]] = field(default_factory=dict)  # by visit and reply
    past: set[str] = field(default_factory=set)  # actions of earlier orders
    now_s: float = 0.0
    errors: list[tuple[float, float, str, str]] = field(default_factory=list)  # from, until, type, description
    charging: list[tuple[float, float]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.orders = VehicleOrders(self.sender.serial)

    @property
    def execution(self) -> Execution:
        return self.record.execution

    @property
    def dialect(self) -> Dialect:
        return self.sender.dialect

    def messages(self) -> Iterator[tuple[float, str, Json]]:
        """Time, kind and payload of all messages, in time order."""
        send, end_s = self.sender.message, float(self.execution.t_s[-1])
        happenings = self._happenings()
        yield 0.0, "connection", send("connection", 0.0, {"connectionState": "ONLINE"})
        request = action("factsheetRequest", f"{self.sender.serial}-factsheet")
        yield 0.0, "instantActions", send("instantActions", 0.0, {"actions": [request]})
        yield 0.0, "factsheet", send("factsheet", 0.0, factsheet(self.dialect, self.record.fleet.types[self.record.fleet.kind[self.robot]]))
        for t_s, together in groupby(happenings, key=lambda h: h.t_s):
            kinds = set()
            for happening in together:
                kinds.add(happening.kind)
                self._take(happening)
            before, at_end = self.orders.number, self._state(t_s) if ACT in kinds else {}
            if kinds & {WAY, GRANT} and (order := self._order(t_s)):
                if at_end and self.orders.number > before:  # what ends an order is said before the next one comes
                    yield t_s, "state", send("state", t_s, at_end)
                yield t_s, "order", send("order", t_s, order)
                kinds.add(ARRIVE)
            if kinds - {SHOW, GRANT, WAY}:
                yield t_s, "state", send("state", t_s, self._state(t_s))
            if SHOW in kinds:
                yield t_s, "visualization", send("visualization", t_s, self._view(t_s))
        yield end_s, "connection", send("connection", end_s, {"connectionState": "OFFLINE"})

    def _happenings(self) -> list[Happening]:
        plan, execution, r = self.record.plan, self.execution, self.robot
        assert plan is not None
        mine = slice(int(plan.first[r]), int(plan.first[r + 1]))
        visits = tuple(Visit(v, t, -1) for v, t in zip(plan.vertex[mine].tolist(), execution.arrived_s[mine].tolist()))
        happenings = [Happening(0.0, WAY, 0, visits)]
        for n, reply in enumerate(execution.replies):
            for k in np.flatnonzero(reply.robot == r).tolist():
                new = slice(int(reply.first[k]), int(reply.first[k + 1]))
                more = tuple(Visit(v, t, n) for v, t in zip(reply.vertex[new].tolist(), reply.arrived_s[new].tolist()))
                visits = visits[: int(reply.since[k]) + 1] + more
                happenings.append(Happening(float(reply.t_s), WAY, 0, visits))
        rows = np.flatnonzero(self.grants.robot == r)
        may = self.grants.visit[rows] + self.grants.enters[rows]  # an order's base ends at a node: that of the lane which is entered
        happenings += [Happening(t, GRANT, v) for t, v in zip(self.grants.t_s[rows].tolist(), may.tolist())]
        end_s = float(execution.t_s[-1])
        if self.record.goal_heading_rad is not None and len(visits) > 1 and execution.goal_s[r] > visits[-1].arrived_s:
            visits = (*visits[:-1], visits[-1]._replace(arrived_s=float(execution.goal_s[r])))  # it is there once it faces as it is to
        happenings += [Happening(v.arrived_s, ARRIVE, k) for k, v in enumerate(visits) if k and v.arrived_s <= end_s]
        self._note_actions(visits)
        for made in chain.from_iterable(self.actions.values()):
            happenings += [Happening(t, ACT) for t in made[2:] if t <= end_s]
            happenings.append(Happening(made.since_s, GRANT))  # nothing more but to be there, perhaps
        for event in execution.events:
            if event.kind in ERRORS and event.robot == r:
                until_s = event.t_s + event.duration_s if event.duration_s > 0 else np.inf
                self.errors.append((event.t_s, until_s, event.kind, event.text or event.kind.replace("_", " ")))
                happenings += [Happening(t, ERROR) for t in (event.t_s, until_s) if t <= end_s]
        there = np.isfinite(execution.x_m[:, r])
        drives = (np.abs(execution.speed_mps[:, r]) >= STANDING_MPS) & there
        happenings += [Happening(t, DRIVE) for t in execution.t_s[1:][drives[1:] != drives[:-1]].tolist()]
        happenings += [Happening(float(t), ALIVE) for t in np.arange(0.0, end_s + 1e-9, KEEP_ALIVE_S)] + [Happening(end_s, ALIVE)]
        every = max(1, round(1 / (MOST_HZ * execution.period_s)))
        happenings += [Happening(t, SHOW) for t in execution.t_s[::every][there[::every]].tolist()]
        return sorted((h._replace(t_s=round(h.t_s, 9)) for h in happenings), key=lambda h: (h.t_s, h.kind))

    def _note_actions(self, visits: tuple[Visit, ...]) -> None:
        """Stops become actions of the nodes at which they were made."""
        stops, tasks = self.execution.stops, self.execution.tasks
        if stops is None or tasks is None:
            return
        arrived = np.array([v.arrived_s for v in visits])
        for s in np.flatnonzero(stops.robot == self.robot).tolist():
            begin_s, end_s, task = round(float(stops.begin_s[s]), 9), round(float(stops.end_s[s]), 9), int(stops.task[s])
            k = int(np.flatnonzero(~(arrived > begin_s + 1e-6) & np.isfinite(arrived))[-1])
            if visits[k].vertex != stops.vertex[s] or not np.isfinite(end_s):
                continue
            of_task = np.flatnonzero(stops.task == task)
            is_order = bool(tasks.is_order[task])
            kind = ("pick" if s == of_task[0] else "drop" if s == of_task[-1] else "service") if is_order else "startCharging"
            made = action(kind, f"{self.sender.serial}-{s}", "HARD", station=stops.station[s], duration=round(end_s - begin_s, 3))
            self.actions.setdefault((k, visits[k].reply), []).append(Done(made, max(0.0, float(stops.since_s[s])), begin_s, end_s))
            if not is_order:
                self.charging.append((begin_s, end_s))

    def _take(self, happening: Happening) -> None:
        if happening.kind == WAY:
            self.route = happening.route
        elif happening.kind == GRANT:
            self.granted = max(self.granted, happening.number)
        elif happening.kind == ARRIVE:
            self.reached = max(self.reached, happening.number)
            self.granted = max(self.granted, self.reached)

    def _order(self, t_s: float) -> Json | None:
        """The order, or its update, that says what the robot may do now; nothing where that has been said."""
        self.now_s, mine = t_s, self._of_order()
        done = self.orders.is_driven(self.reached) and all(made.end_s <= t_s for made in mine)
        if done:
            self.past |= {made.document["actionId"] for made in mine}
        is_at_work = done and bool(self._made_at(self.reached))
        return self.orders.next(len(self.route), self.granted, self.reached, done, self._node, self._edge, is_at_work=is_at_work)

    def _made_at(self, k: int) -> list[Json]:
        """Actions of a visit: the first, and those that the robot has to do by now, without what earlier orders had."""
        made = self.actions.get((k, self.route[k].reply), [])
        known = [each.document for n, each in enumerate(made) if not n or each.since_s <= self.now_s]
        return [each for each in known if each["actionId"] not in self.past]

    def _node(self, k: int, sequence: int, released: bool) -> Json:
        v, graph = self.route[k].vertex, self.record.graph
        xy = (graph.xy[v] - self.record.shift_m[graph.level[v]]).tolist()
        return node(graph.label(v), sequence, released, xy, graph.level_names[graph.level[v]], self._made_at(k), self._heading(k))

    def _heading(self, k: int) -> float:
        """How the robot is to face at a visit, NaN: in any way; only at its goal is that said."""
        headings = self.record.goal_heading_rad
        if headings is None or k < len(self.route) - 1 or self.route[k].vertex != self.record.target[self.robot]:
            return np.nan
        return float(headings[self.robot])

    def _edge(self, k: int, sequence: int, released: bool) -> Json:
        return edge_of(self.dialect, self.record.graph, self.route[k].vertex, self.route[k + 1].vertex, sequence, released)

    def _state(self, t_s: float) -> Json:
        at = self.route[self.reached].vertex
        graph, sequence = self.record.graph, 2 * (self.reached - self.orders.begin)
        nodes, edges = states_of(self.orders.document, sequence)
        pose, velocity, driving = self._motion(t_s)
        now = [(kind, text) for begin_s, until_s, kind, text in self.errors if begin_s <= t_s < until_s]
        content = StateContent(
            order=(self.orders.name, self.orders.update),
            last=(graph.label(at), sequence),
            nodes=nodes,
            edges=edges,
            place=pose,
            velocity=velocity,
            driving=driving,
            away_m=float(np.hypot(*(graph.xy[at] - self.record.shift_m[graph.level[at]] - (pose["x"], pose["y"])))) if pose else 0.0,
            actions=[self._action_state(made, t_s) for made in self._of_order()],
            instants=[{"actionId": f"{self.sender.serial}-factsheet", "actionType": "factsheetRequest", "actionStatus": "FINISHED"}],
            power=(self._percent(t_s), any(a <= t_s < b for a, b in self.charging)),
            errors=[error(kind, ERRORS[kind][self.dialect.is_new], text, {}) for kind, text in now],
        )
        return state(self.dialect, content)

    def _of_order(self) -> list[Done]:
        sent = {one_action["actionId"] for one in self.orders.nodes for one_action in one["actions"]}
        return [made for made in chain.from_iterable(self.actions.values()) if made.document["actionId"] in sent]

    def _action_state(self, made: Done, t_s: float) -> Json:
        document = made.document
        status = "WAITING" if t_s < made.begin_s else "RUNNING" if t_s < made.end_s else "FINISHED"
        return {"actionId": document["actionId"], "actionType": document["actionType"], "actionStatus": status}

    def _view(self, t_s: float) -> Json:
        pose, velocity, _ = self._motion(t_s)
        reference = {"referenceStateHeaderId": max(0, self.sender.count.get("state", 0) - 1)} if self.dialect.is_new else {}
        return {**reference, self.dialect.place_key: pose, "velocity": velocity}

    def _motion(self, t_s: float) -> tuple[Json, Json, bool]:
        """Pose, velocity and whether it drives, between samples."""
        execution, r = self.execution, self.robot
        k = int(np.clip(np.searchsorted(execution.t_s, t_s + 1e-9, "right") - 1, 0, len(execution.t_s) - 1))
        j = min(k + 1, len(execution.t_s) - 1)
        x, y, yaw = (float(a[k, r]) for a in (execution.x_m, execution.y_m, execution.yaw_rad))
        speed = float(execution.speed_mps[k, r])
        if not np.isfinite(x):
            return {}, {"vx": 0.0, "vy": 0.0, "omega": 0.0}, False
        omega, on = 0.0, self._level(k)
        if j > k and np.isfinite(execution.x_m[j, r]) and self._level(j) == on:
            span = float(execution.t_s[j] - execution.t_s[k])
            share, turn = (t_s - float(execution.t_s[k])) / span, float(execution.yaw_rad[j, r]) - yaw
            turn = float(np.arctan2(np.sin(turn), np.cos(turn)))
            x, y = x + share * (float(execution.x_m[j, r]) - x), y + share * (float(execution.y_m[j, r]) - y)
            yaw, omega = yaw + share * turn, turn / span
        (x, y), level = (x, y) - self.record.shift_m[on], self.record.graph.level_names[on]
        velocity = {"vx": round(speed, 6), "vy": 0.0, "omega": round(omega, 6)}
        return self.dialect.place(float(x), float(y), yaw, level), velocity, abs(speed) >= STANDING_MPS

    def _level(self, sample: int) -> int:
        if self.execution.level is None:
            return int(self.record.graph.level[self.route[self.reached].vertex])
        return int(self.execution.level[sample, self.robot])

    def _percent(self, t_s: float) -> float:
        log = self.execution.batteries
        return 100.0 if log is None else float(100 * np.interp(t_s, log.t_s, log.level[:, self.robot]))
