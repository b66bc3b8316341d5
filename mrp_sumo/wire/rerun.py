"""A run in Rerun while it drives, or as a recording for its viewer: the floor from above, robots by state, plans, figures, events.

Needs the extra `rerun`. The viewer keeps what it has been shown, and goes back in it by itself; nothing comes back from there.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from shutil import disk_usage
from types import TracebackType
from typing import Any, Self

import numpy as np

from mrp_sumo.bags.live_bag import LiveBag, ways_ahead
from mrp_sumo.bags.streams import COLOURS
from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.plan import Plan
from mrp_sumo.drive.listeners import Listener, Moment
from mrp_sumo.errors import MrpSumoError, first_line
from mrp_sumo.experiments.outset import record_at_outset
from mrp_sumo.experiments.solve import Solution
from mrp_sumo.experiments.staging.set_up import SetUp
from mrp_sumo.io.outline import outline_of
from mrp_sumo.io.record import STATE_NAMES, RunRecord
from mrp_sumo.wire.rerun_place import VIEWER, is_file, require_place

TIMELINE = "time"
PERIOD_S = 0.1  # between poses
PAPER = [245, 245, 245]
WALL, DOOR, LANE, STATION, PLAN, WAIT = (70, 76, 88), (190, 130, 60), (170, 178, 192), (90, 98, 112), (70, 130, 220, 110), (220, 50, 45)
WORDS = {"goal": "reached its goal", "blocked": "is blocked", "waited": "waits", "yielded": "yields", "started": "sets off"}
LEAST_FREE_BYTES = 2**20  # on the disk, before a recording is begun
PATIENCE_S = 20.0  # with a recording that is to be ended
MOST_NAMED = 60  # robots that carry their names


class RerunView:
    """Shows the runs of one command to a viewer, or writes them to a file. To be used with `with`."""

    def __init__(self, to: str = VIEWER) -> None:
        """Find out whether it can be done, to a file that ends with .rrd, or where a viewer listens: rerun+http://HOST:PORT/proxy.

        Raises MrpSumoError: without the extra `rerun`, when no viewer is there, and when the file cannot be written.
        """
        os.environ.setdefault("RUST_LOG", "off")  # or its threads print what is said here in a line
        try:
            import rerun
        except ImportError:
            raise MrpSumoError("--rerun needs rerun-sdk: pip install 'mrp-sumo[rerun]'") from None
        self._rerun, self.to = rerun, to
        self._recording: Any = None
        require_place(to)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None) -> None:
        if self._recording is None:
            return
        fault: Exception | None = None
        try:
            self._recording.flush(timeout_sec=PATIENCE_S)  # a full disk ends the thread that it waits for
            self._recording.disconnect()
        except (RuntimeError, ValueError) as raised:
            fault = raised
        if is_file(self.to) and (fault or isinstance(error, MrpSumoError)):
            Path(self.to).unlink(missing_ok=True)
        if fault and error is None:
            raise MrpSumoError(f"--rerun {self.to}: cannot be written: {first_line(fault)}")

    def watch(self, setup: SetUp, solution: Solution) -> Listener:
        """The listener of a run that is about to be driven."""
        record = record_at_outset(setup, solution)
        self._recording = recording = self._rerun.RecordingStream(f"mrp_sumo {record.name}")
        recording.disable_timeline("log_time")
        blueprint = _blueprint(record)
        if is_file(self.to):
            folder = Path(self.to).parent
            folder.mkdir(parents=True, exist_ok=True)
            if disk_usage(folder).free < LEAST_FREE_BYTES:  # where it fails, Rerun may wait for ever
                raise MrpSumoError(f"--rerun {self.to}: the disk is full")
            recording.save(self.to, default_blueprint=blueprint)
        else:
            recording.connect_grpc(self.to, default_blueprint=blueprint)
        logging = Logging(self._rerun, recording, LiveBag(record), record)
        logging.floor(setup)
        return logging


@dataclass
class Logging(Listener):
    """A listener for one run."""

    rerun: Any
    recording: Any
    bag: LiveBag
    record: RunRecord
    due_s: float = 0.0  # of poses
    due_figures_s: float = 0.0
    num_entries: int = 1  # of the ledger, whose plans are shown
    num_waits: int = 0  # lines that are shown now

    def floor(self, setup: SetUp) -> None:
        """Log the floor, which does not change."""
        rr, building, nav, graph = self.rerun, setup.map.building, setup.map.nav, self.record.graph
        log = self.recording.log
        if building:
            outline = outline_of(building, nav.level_names)
            log("floor/walls", rr.LineStrips3D(_flat(outline.walls), colors=WALL, radii=0.05), static=True)
            log("floor/doors", rr.LineStrips3D(_flat(outline.doors), colors=DOOR, radii=0.04), static=True)
        lanes = nav if building else graph
        once = lanes.is_once
        ends = np.stack([lanes.xy[lanes.tail[once]], lanes.xy[lanes.head[once]]], 1)
        log("floor/lanes", rr.LineStrips3D(_flat(ends), colors=LANE, radii=0.015), static=True)
        named = [v for v in range(nav.num_vertices) if nav.vertex_name[v]]
        if named:
            places = rr.Points3D(
                _lifted(nav.xy[named]), colors=STATION, radii=0.08, labels=[nav.known_as(v) for v in named], show_labels=False
            )
            log("floor/stations", places, static=True)
        for state, name in enumerate(STATE_NAMES):
            log(_figure(name), rr.SeriesLines(colors=_byte_colour(state), widths=2.0, names=name), static=True)
        self._at(0.0)
        if self.record.plan is not None:
            self._plan(self.record.plan)

    def hear(self, state: Moment) -> None:
        for event in state.events:
            self._at(event.t_s)
            robot = self.record.fleet.robot_name[event.robot] if event.robot >= 0 else ""
            words = " ".join(part for part in (robot, WORDS.get(event.kind, event.kind.replace("_", " ")), event.text) if part)
            self.recording.log(
                "events", self.rerun.TextLog(words, level="WARN" if event.kind.startswith(("blocked", "deadlock")) else "INFO")
            )
        if not state.is_sample or state.now_s < self.due_s - 1e-9:
            return
        self.due_s = state.now_s + PERIOD_S
        self._at(state.now_s)
        self._robots(state)
        if len(state.ledger.entries) > self.num_entries:
            self.num_entries = len(state.ledger.entries)
            self._plan(ways_ahead(state.ledger))

    def _robots(self, shown: Moment) -> None:
        """Bodies, whom the blocked wait for, and how many are in which state."""
        rr, fleet = self.rerun, self.record.fleet
        now = self.bag.robots(self.bag.now(shown), shown)
        state, xy = now.state[0], np.column_stack([now.x[0], now.y[0]])
        half, height = now.yaw[0] / 2, fleet.width_m / 2
        turn = np.column_stack([np.zeros_like(half), np.zeros_like(half), np.sin(half), np.cos(half)])
        bodies = rr.Boxes3D(
            centers=np.column_stack([xy, height / 2]),
            half_sizes=np.column_stack([fleet.length_m, fleet.width_m, height]) / 2,
            quaternions=turn,
            colors=np.array([_byte_colour(k) for k in range(len(STATE_NAMES))], np.uint8)[state],
            labels=list(fleet.robot_name),
            show_labels=fleet.num_robots <= MOST_NAMED,
            fill_mode="solid",
        )
        self.recording.log("robots", bodies)
        waits = shown.ledger.state.waits.stuck & (shown.ledger.state.grants.other >= 0)
        lines = np.stack([xy[waits], xy[shown.ledger.state.grants.other[waits]]], 1)
        if len(lines) or self.num_waits:
            self.recording.log("waits", rr.LineStrips3D(_flat(lines), colors=WAIT, radii=0.04))
        self.num_waits = len(lines)
        if shown.now_s >= self.due_figures_s - 1e-9:
            self.due_figures_s = shown.now_s + 1.0
            for k, name in enumerate(STATE_NAMES):
                self.recording.log(_figure(name), rr.Scalars(float((state == k).sum())))

    def _plan(self, plan: Plan) -> None:
        ways = [_lifted(self.record.graph.xy[plan.vertex[a:b]]) for a, b in zip(plan.first, plan.first[1:]) if b - a > 1]
        self.recording.log("plans", self.rerun.LineStrips3D(ways, colors=PLAN, radii=0.03))

    def _at(self, t_s: float) -> None:
        self.recording.set_time(TIMELINE, duration=t_s)


def _blueprint(record: RunRecord) -> Any:
    """The floor from above, and under it figures and events."""
    import rerun.blueprint as rrb

    low, high = record.graph.xy.min(axis=0), record.graph.xy.max(axis=0)
    centre, away_m = (low + high) / 2, 0.8 * float((high - low).max()) + 2.0
    eye = rrb.EyeControls3D(position=(*centre, away_m), look_target=(*centre, 0), eye_up=(0, 1, 0))
    floor = rrb.Spatial3DView(
        name="floor", origin="/", contents=["/floor/**", "/plans", "/waits", "/robots"], background=PAPER, eye_controls=eye
    )
    figures = rrb.TimeSeriesView(name="robots by state", origin="/figures")
    events = rrb.TextLogView(name="events", origin="/events")
    return rrb.Blueprint(rrb.Vertical(floor, rrb.Horizontal(figures, events), row_shares=[3, 1]), collapse_panels=True)


def _figure(state_name: str) -> str:
    return f"figures/{state_name.replace(' ', '_')}"


def _byte_colour(state: int) -> list[int]:
    return [round(255 * part) for part in COLOURS[state]]


def _lifted(xy: FloatArray) -> FloatArray:
    """[..., 3] points on the floor."""
    return np.concatenate([xy, np.zeros((*xy.shape[:-1], 1))], -1)


def _flat(strokes: FloatArray) -> FloatArray:
    """[N, 2, 3] strokes on the floor."""
    return _lifted(strokes.reshape(-1, 2, 2))
