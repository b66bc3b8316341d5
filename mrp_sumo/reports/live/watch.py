"""A run that is watched while it drives: a listener that says every sample, event and task to the page. It changes nothing."""

import math
import time
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.execution import Event
from mrp_sumo.core.graph import FloatArray
from mrp_sumo.drive._causes import DISTURBED, LETTING_PASS, PLANNED
from mrp_sumo.drive.ledger import planned_arrivals
from mrp_sumo.drive.listeners import Listener, Moment
from mrp_sumo.drive.robot_work import stop_log
from mrp_sumo.drive.train import Trains
from mrp_sumo.experiments.interventions import Interventions
from mrp_sumo.experiments.outset import record_at_outset
from mrp_sumo.experiments.result import RunResult
from mrp_sumo.experiments.solve import Solution
from mrp_sumo.experiments.staging.set_up import SetUp
from mrp_sumo.io.outline import outline_of
from mrp_sumo.io.record import AT_GOAL, BLOCKED, MOVING, STANDING_MPS, WAITING
from mrp_sumo.reports.live.broadcast import Broadcast
from mrp_sumo.reports.live.server import LiveServer
from mrp_sumo.reports.pictures.view import ABSENT, drawn_lanes, extent, parts_of, subtitle_of
from mrp_sumo.reports.replay.page import MAX_POSES, About, PageFrame, about_run, replay_page, task_document

SAMPLE = np.dtype([("x", "<u2"), ("y", "<u2"), ("yaw", "<u1"), ("state", "<u1"), ("waits", "<i2")])  # of a robot, trailer or load
REASONS = {PLANNED: -2, DISTURBED: -3, LETTING_PASS: -4}  # for waiting without a robot to wait for, as `waits`; live.js knows them
REPORT_S = 0.5  # of wall time, between reports of tasks and arrivals


class LiveView:
    """Shows runs of one command to a browser."""

    def __init__(self, port: int = 0) -> None:
        """Raises MrpSumoError where the port cannot be had."""
        self.broadcast = Broadcast()
        self.server = LiveServer(self.broadcast, port)
        self.server.start()

    @property
    def address(self) -> str:
        return self.server.address

    def stage(self, stage: str, done: float, of: float) -> None:
        """Say what is done before robots drive."""
        self.server.stage = stage

    def watch(self, setup: SetUp, solution: Solution) -> Listener:
        """The listener of a run that is about to be driven; from now on there is a page."""
        telling = Telling(self.broadcast, setup, solution)
        self.server.page = telling.page.encode()
        return telling

    def steer(self, setup: SetUp, _: Solution) -> Listener:
        """The listener that steps in as viewers ask for it."""
        wishes, lanes = Interventions(setup), drawn_lanes(setup.map.nav)

        def ask(order: dict[str, Any]) -> str:
            if order.get("do") == "close":  # the page knows lanes by the order in which it draws them
                if type(number := order.get("lane")) is not int or not 0 <= number < len(lanes):
                    return "expected the number of a lane"
                nav, lane = setup.map.nav, int(lanes[number])
                order = {**order, "between": [nav.label(int(nav.tail[lane])), nav.label(int(nav.head[lane]))]}
            return wishes.ask(order)

        self.broadcast.intervene = ask
        return wishes

    def finish(self, result: RunResult) -> None:
        """Say what the run came to, and let viewers go."""
        if result.executed:
            about = about_run(result, result.record)
            said = {name: getattr(about, name) for name in ("status_text", "is_good", "note", "facts", "metrics")}
            self.broadcast.say_last(said)
        else:
            self.server.stage = f"{result.status.replace('_', ' ')}: {result.note}"
        self.close()

    def close(self) -> None:
        """Nothing more comes."""
        self.broadcast.end()
        self.server.close()


class Telling(Listener):
    """A listener for one run."""

    def __init__(self, broadcast: Broadcast, setup: SetUp, solution: Solution) -> None:
        self._broadcast = broadcast
        settings, problem, plan = setup.settings, solution.problem, solution.result.plan
        assert plan is not None
        self._has_tasks = bool(settings.tasks)
        samples = settings.time_limit_s / settings.record_period_s
        self._every = max(1, math.ceil(samples * problem.num_robots / MAX_POSES))
        self._period_s = self._every * settings.record_period_s
        record = record_at_outset(setup, solution)
        if self._has_tasks:
            record = replace(record, plan=None, execution=replace(record.execution, arrived_s=np.zeros(0)))
        result = {"scenario": setup.scenario.model_dump(mode="json")}
        building, nav = setup.map.building, setup.map.nav
        outline = outline_of(building, nav.level_names) if building else None
        about = About(
            name=record.name,
            subtitle=subtitle_of(result, problem.num_robots),
            status_text="driving",
            note="The run is under way.",
            facts=(
                ("Robots", str(problem.num_robots)),
                ("Policy", settings.policy),
                ("Engine", settings.engine),
                ("Seed", str(record.seed)),
            ),
            outline=outline,
        )
        execution, fleet = record.execution, problem.fleet
        self._trains, straight = Trains(fleet), np.zeros_like(execution.x_m)
        loads = np.zeros(execution.x_m.shape, np.int64) if self._has_tasks and fleet.loaded is not None else None
        execution = replace(execution, hitch_rad=dict.fromkeys(self._trains.columns, straight), loads=loads)
        record = replace(record, execution=execution)
        self._fleet, self._execution = fleet, execution
        self._frame: PageFrame = PageFrame(*extent(record, outline))
        self.page = replay_page(record, about, live_period_s=self._period_s)
        self._arrived = np.full(len(plan.vertex), np.nan)
        self._tasks: list[Any] = []
        self._stops: set[Any] = set()
        self._count = self._reported = 0
        self._next_report = 0.0
        broadcast.begin(SAMPLE.itemsize * (problem.num_robots + len(parts_of(execution, fleet).owner)))

    def hear(self, state: Moment) -> None:
        if state.events:
            self._broadcast.say("events", [_event_document(event, state.now_s) for event in state.events])
        if not state.is_sample:
            return
        self._count += 1
        if time.monotonic() >= self._next_report or state.is_last:
            self._next_report = time.monotonic() + REPORT_S
            self._report(state)
        if (self._count - 1) % self._every == 0:
            self._broadcast.sample(self._sample(state), self._period_s)

    def _sample(self, shown: Moment) -> bytes:
        state, frame = shown.ledger.state, self._frame
        x, y = shown.bodies.positions().T[:, None].copy()
        yaw = np.nan_to_num(shown.ledger.yaw_rad)[None].copy()
        hitch = self._trains.place(shown.ledger, state.motion.s_m[None], x, y, yaw)
        loads = None if self._execution.loads is None else shown.crew.loads[None]
        parts = parts_of(replace(self._execution, x_m=x, y_m=y, yaw_rad=yaw, hitch_rad=hitch, loads=loads), self._fleet)
        row = np.zeros(len(state.motion.s_m), SAMPLE)
        _pose(row, x[0], y[0], yaw[0], frame)
        moving = (np.abs(state.motion.speed_mps) >= STANDING_MPS) | state.motion.turning
        row["state"] = np.where(moving, MOVING, np.where(state.waits.stuck, BLOCKED, WAITING))
        if self._has_tasks:
            crew = shown.crew
            row["state"][(row["state"] == WAITING) & crew.rests] = AT_GOAL
        else:
            row["state"][~moving & np.isfinite(state.waits.goal_s)] = AT_GOAL
        row["waits"] = state.grants.other
        for cause, code in REASONS.items():
            row["waits"][(state.grants.cause == cause) & (state.grants.other < 0)] = code
        more = row[parts.owner]
        more["state"][np.isnan(parts.x_m[0])] = ABSENT
        _pose(more, parts.x_m[0], parts.y_m[0], parts.yaw_rad[0], frame)
        return row.tobytes() + more.tobytes()

    def _report(self, state: Moment) -> None:
        """What changes more slowly: tasks, or which visits of the plan have been reached."""
        if self._has_tasks:
            self._report_tasks(task_document(state.crew.orders.log(), stop_log(state.crew.robots)))
            return
        arrived = planned_arrivals(state.ledger)
        new = np.flatnonzero(np.isfinite(arrived) & np.isnan(self._arrived))
        self._arrived = arrived
        if len(new):
            self._broadcast.say("arrived", [new.tolist(), np.rint(arrived[new] * 1000).astype(np.int64).tolist()])

    def _report_tasks(self, document: dict[str, Any]) -> None:
        """Tasks that are new or not what they were, and stops that were made since."""
        rows = list(zip(document["name"], document["robot"], document["times"]))
        changed = [(k, *row) for k, row in enumerate(rows) if k >= len(self._tasks) or self._tasks[k] != row]
        made = [(name, *stop) for name, stops in document["stations"] for stop in stops]
        new = [stop for stop in made if stop not in self._stops]
        self._tasks = rows
        self._stops.update(new)
        if changed or new:
            self._broadcast.say("tasks", {"changed": changed, "stops": new})


def _pose(row: NDArray[Any], x: FloatArray, y: FloatArray, yaw: FloatArray, frame: PageFrame) -> None:
    """Write where bodies [N] are, and how they face, into their samples."""
    row["x"], row["y"] = frame.cells(x, 0), frame.cells(y, 1)
    row["yaw"] = np.rint(np.nan_to_num(yaw) * (128 / np.pi)).astype(np.int64) % 256


def _event_document(event: Event, now_s: float) -> list[Any]:
    """An event as live.js reads it; null for what lasts for good."""
    lasts = round(1000 * event.duration_s) if math.isfinite(event.duration_s) else None
    return [round(1000 * event.t_s), event.kind, event.robot, event.other, event.vertex, lasts, event.text]
