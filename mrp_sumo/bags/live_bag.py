"""Messages of a run's bag while the run drives, for viewers.

Ways that robots are sent later are shown as they are then ahead of the robots; the bag shows all of each plan. The topics that a scenario
asks for (`record.robots`, `record.poses`), paths and people are in the bag alone.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mrp_sumo.bags import streams
from mrp_sumo.bags.live import LiveMessages
from mrp_sumo.bags.messages import EPOCH_NS
from mrp_sumo.bags.task_states import TOPIC, TYPE, task_states
from mrp_sumo.bags.writer import SECOND_NS
from mrp_sumo.core.execution import Execution
from mrp_sumo.core.graph import frozen
from mrp_sumo.core.plan import Plan
from mrp_sumo.drive.ledger import Ledger
from mrp_sumo.drive.listeners import Moment
from mrp_sumo.io.record import BLOCKED, WAITING, RunRecord

FAST_NS = 100_000_000
TF, CLOUD = ("/tf", "tf2_msgs/TFMessage"), ("/robot_cloud", "sensor_msgs/PointCloud2")
STATIC, MAP = ("/tf_static", "tf2_msgs/TFMessage"), ("/map", "nav_msgs/OccupancyGrid")
MARKERS = "visualization_msgs/MarkerArray"
PLANS, REQUESTS = ("/plan_markers", MARKERS), ("/robot_path_requests", "rmf_fleet_msgs/PathRequest")
LOG, DIAGNOSTICS = ("/rosout", "rcl_interfaces/Log"), ("/diagnostics", "diagnostic_msgs/DiagnosticArray")

Said = tuple[str, str, bytes]  # topic, type, message


class LiveBag(LiveMessages):
    """As LiveMessages, with all that viewers show."""

    def __init__(self, record: RunRecord, generation: str = "jazzy") -> None:
        super().__init__(record, generation)
        self._fast: tuple[streams.Samples, streams.Stream, streams.Stream] | None = None
        self._num_fast = self._num_seconds = 0
        self._num_entries = 1
        self._tasks_until_s = -1.0  # to which changes of tasks have been reported

    @property
    def later(self) -> list[tuple[str, str]]:
        """Topics on which nothing may be said for a long time, and their types."""
        return [LOG, *([(TOPIC, TYPE)] if self._at_outset.execution.tasks is not None else [])]

    def at_outset(self) -> Iterator[Said]:
        """Messages that are sent once, before anything moves."""
        m, ns = self.messages, EPOCH_NS
        yield *STATIC, m.tf_static(ns)
        yield *MAP, m.map(ns)
        yield "/map_markers", MARKERS, m.map_markers(ns)
        yield "/robot_markers", MARKERS, m.robot_markers(ns)
        yield *PLANS, m.plan_markers(ns)
        for request in m.path_requests():
            yield *REQUESTS, request

    def of(self, state: Moment) -> Iterator[Said]:
        yield from super().of(state)
        m, now_ns = self.messages, round(state.now_s * 1e9)
        if state.events:
            m.record = replace(self._at_outset, execution=replace(self._at_outset.execution, events=tuple(state.events)))
            for _, text in m.logs():
                yield *LOG, text
        is_fast = state.is_sample and now_ns >= self._num_fast * FAST_NS
        is_second = now_ns >= self._num_seconds * SECOND_NS
        if not (is_fast or is_second):
            return
        execution = self.now(state)
        samples = self.robots(execution, state)
        if is_fast:
            self._num_fast = now_ns // FAST_NS + 1
            yield from self._poses(samples)
        if is_second:
            self._num_seconds = now_ns // SECOND_NS + 1
            yield *DIAGNOSTICS, streams.Diagnostics(m, samples).message(0)
            for name, figure in streams.metrics(samples, 0).items():
                yield f"/metrics/{name}", "std_msgs/Float64", figure
            if execution.tasks is not None:
                yield from self._tasks(execution, state.now_s)
            if len(state.ledger.entries) > self._num_entries:
                self._num_entries = len(state.ledger.entries)
                m.plan = ways_ahead(state.ledger)
                yield *PLANS, m.plan_markers(EPOCH_NS + now_ns)

    def robots(self, execution: Execution, state: Moment) -> streams.Samples:
        """Poses and states of the robots."""
        samples = streams.Samples(replace(self._at_outset, execution=execution), np.array([round(state.now_s * 1e9)]))
        samples.state[:, state.ledger.state.waits.stuck & (samples.state[0] == WAITING)] = BLOCKED
        return samples

    def _poses(self, samples: streams.Samples) -> Iterator[Said]:
        """/tf and /robot_cloud, from templates that are made once."""
        if self._fast is None:
            self._fast = samples, streams.transforms(self.messages, samples), streams.cloud(self.messages, samples)
        held, transforms, cloud = self._fast
        for name in ("t_ns", "x", "y", "yaw", "speed", "state"):
            getattr(held, name)[:] = getattr(samples, name)
        for topic, stream in ((TF, transforms), (CLOUD, cloud)):
            if (message := stream.message(0)) is not None:
                yield *topic, message

    def _tasks(self, execution: Execution, now_s: float) -> Iterator[Said]:
        self.messages.record = replace(self._at_outset, execution=execution)
        for ns, state in task_states(self.messages, now_s):
            if ns > EPOCH_NS + self._tasks_until_s * 1e9:
                yield TOPIC, TYPE, state
        self._tasks_until_s = now_s


def ways_ahead(ledger: Ledger) -> Plan:
    """The ways that robots are still to drive, without times."""
    reached, vertex = ledger.visits.reached, ledger.visits.vertex
    ways = [vertex[ledger.ids(r, int(reached[r]))] for r in range(ledger.num_robots)]
    first = np.concatenate([[0], np.cumsum([len(path) for path in ways])]).astype(np.int64)
    times = frozen(np.zeros(int(first[-1])))
    return Plan(frozen(first), frozen(np.concatenate(ways)), times, times)
