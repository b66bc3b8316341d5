"""A run as a ROS 2 bag that RViz, Foxglove, Rerun, PlotJuggler and `ros2 bag` open, without ROS.

mcap with zstd chunks by default, sqlite3 on request; metadata version 8, which Humble to Rolling read.
Refuses unknown storages, generations and robots, and folders that exist. Equal runs give equal bytes. An interrupted
write leaves complete chunks in the mcap file but no index.
"""

import json
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime

from mrp_sumo.bags import people
from mrp_sumo.bags import streams as say
from mrp_sumo.bags.facility_states import TOPICS, facility_states
from mrp_sumo.bags.messages import EPOCH_NS, Messages
from mrp_sumo.bags.parts import STORAGES, PartedWriter
from mrp_sumo.bags.paths import ODD, plain_path
from mrp_sumo.bags.task_states import TOPIC, TYPE, task_states
from mrp_sumo.core.execution import Reply, as_believed, let_go_of_samples, plans_in_force
from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.plan import Plan
from mrp_sumo.errors import MrpSumoError, nearest
from mrp_sumo.io.record import RunRecord
from mrp_sumo.io.scenario.model import Recording

FLEET_STATES_NS = 500_000_000  # 2 Hz, as MRP-Bench
SECOND_NS = 1_000_000_000
SAMPLES_TOGETHER = 500_000  # robots times stamps of the fast topics, so that long runs take little memory
FAST_NS = 100_000_000  # between messages of /tf, /robot_cloud, poses and odometry; never shorter than the record's
INFINITE = QosTime(9223372036, 854775807)  # as rosbag2 writes it


@dataclass(frozen=True)
class BagOptions:
    """Contents and form of a bag."""

    storage: str = "mcap"  # or 'sqlite3'
    rmf: str = "jazzy"  # generation of rmf_fleet_msgs: 'galactic', 'jazzy' or 'kilted'
    robots: tuple[str, ...] = ()  # robots with topics of their own: /<robot>/odom and /<robot>/plan
    poses: bool = False  # also write /robot_poses: what /tf says, as one PoseArray
    repeat_latched_s: float = 0.0  # repeat /map and markers, for players that start in the middle; 0: never
    split_s: float = 0.0  # a file for each so many seconds, each with /map and markers at its beginning; 0: one file


def write_recorded_bag(folder: Path, record: RunRecord, choice: Recording) -> None:
    """Write the bag of a run with its scenario's options."""
    options = BagOptions(
        storage=choice.storage, rmf=choice.rmf_messages, robots=choice.robots, poses=choice.poses, split_s=choice.split_s or 0.0
    )
    write_bag(folder, record, options)


def write_bag(folder: Path, record: RunRecord, options: BagOptions = BagOptions()) -> None:
    """Write the bag of a run into a new folder; the bag file in it gets the same name.

    Raises MrpSumoError for unknown options, a folder that exists, or a record without samples, and OSError when the disk refuses.
    """
    if options.storage not in STORAGES:
        raise MrpSumoError(f"unknown storage '{options.storage}'{nearest(options.storage, STORAGES)}")
    if not len(record.execution.t_s):
        raise MrpSumoError(f"'{record.name}' has no samples to make a bag of")
    if folder.exists():
        raise MrpSumoError(f"{folder}: exists already, a bag needs a new folder")
    if options.storage == "sqlite3" and (bad := [c for c in folder.name if c in ODD]):
        raise MrpSumoError(f"'{folder.name}': the name of a sqlite3 bag cannot have a '{bad[0]}'; use mcap or another name")
    record = replace(record, execution=as_believed(record.execution))  # robots report the poses that they believe
    messages = Messages(record, options.rmf)
    chosen = _chosen(record, options.robots)
    renamed = {token: name for token, name in zip(messages.robots, record.fleet.robot_name) if token != name}
    custom = {"scenario": record.name, "seed": str(record.seed), "epoch_ns": str(EPOCH_NS), "rmf_generation": options.rmf}
    custom |= {name: repr(float(value)) for name, value in record.constants.items()}
    if renamed:
        custom["robot_names"] = json.dumps(renamed, ensure_ascii=False)
    folder.parent.mkdir(parents=True, exist_ok=True)
    with plain_path(folder) as place:
        try:
            with PartedWriter(place, options.storage, custom, parted=options.split_s > 0) as writer:
                _write(writer, messages, record, options, chosen)
        except sqlite3.Error as error:  # a full disk, above all
            raise OSError(str(error)) from error


class _Stream(NamedTuple):
    """Messages at stamps of their own, of which some are made at a time."""

    t_ns: IntArray
    over: Callable[
        [slice], Callable[[int, int], None]
    ]  # for some of the stamps: what writes the k-th of them, given its time since the epoch


def _write(writer: PartedWriter, messages: Messages, record: RunRecord, options: BagOptions, chosen: list[int]) -> None:
    """All messages, latched ones first, then by time; at equal times in the order of the streams."""
    topic = _Topics(writer, messages)
    latched = _Latched(writer, messages, topic, chosen)
    end_ns = round(float(record.execution.t_s[-1]) * 1e9)
    fast_ns = _ticks(record, end_ns, FAST_NS)
    second_ns = np.arange(0, end_ns + 1, SECOND_NS, dtype=np.int64)
    streams = [
        _Stream(_every(options.split_s, end_ns - 1), lambda _: latched.begin_part),
        _Stream(_every(options.repeat_latched_s, end_ns), lambda _: latched.repeat),
        *_sampled(writer, messages, record, _makers(messages, record, options, chosen, topic, fast_ns, end_ns)),
    ]
    log_topic = topic("/rosout", "rcl_interfaces/Log", 1000, latched=True)
    logs = _listed((ns - EPOCH_NS, partial(writer.write, log_topic, data=data)) for ns, data in messages.logs())
    states = list(task_states(messages, end_ns / 1e9))
    state_topic = topic(TOPIC, TYPE, 1000, latched=True) if states else log_topic
    facilities = list(facility_states(messages, end_ns / 1e9))
    facility_topics = {name: topic(name, kind, 100) for name, kind in TOPICS if any(at == name for _, at, _ in facilities)}
    replies = record.execution.replies if record.plan else ()
    plans = plans_in_force(record.plan, replies) if record.plan else iter(())
    streams += [
        logs,
        _diagnosed(writer, messages, record, topic, second_ns),
        _listed((round(reply.t_s * 1e9), partial(latched.replan, reply, plans)) for reply in replies),
        _listed((ns, partial(writer.write, state_topic, data=data)) for ns, data in states),
        _listed((ns, partial(writer.write, facility_topics[name], data=data)) for ns, name, data in facilities),
    ]
    times = [stream.t_ns for stream in streams]
    for parts in _spans(times, fast_ns[:: max(1, SAMPLES_TOGETHER // max(1, record.fleet.num_robots))]):
        let_go_of_samples(record.execution)
        write = [stream.over(part) for stream, part in zip(streams, parts)]
        for ns, stream, k in _merged([t_ns[part] for t_ns, part in zip(times, parts)]):
            write[stream](ns, k)


class _Latched:
    """Topics of which late listeners get the last message: the building, the robots' shapes, and the plan in force."""

    def __init__(self, writer: PartedWriter, messages: Messages, topic: "_Topics", chosen: list[int]) -> None:
        self._writer, self._messages = writer, messages
        self._once = [  # (connection, message at a stamp)
            (topic("/tf_static", "tf2_msgs/TFMessage", 1, latched=True), messages.tf_static),
            (topic("/map", "nav_msgs/OccupancyGrid", 1, latched=True), messages.map),
            (topic("/map_markers", "visualization_msgs/MarkerArray", 1, latched=True), messages.map_markers),
            (topic("/robot_markers", "visualization_msgs/MarkerArray", 1, latched=True), messages.robot_markers),
            (plan_markers := topic("/plan_markers", "visualization_msgs/MarkerArray", 1, latched=True), messages.plan_markers),
        ]
        self._plan_markers = plan_markers
        self._paths = {robot: topic(f"/{messages.robots[robot]}/plan", "nav_msgs/Path", 1, latched=True) for robot in chosen}
        self._once += [(path, partial(messages.path, robot=robot)) for robot, path in self._paths.items()]
        self.repeat(EPOCH_NS)
        self._requests = topic("/robot_path_requests", "rmf_fleet_msgs/PathRequest", max(100, len(messages.robots)), latched=True)
        for raw in messages.path_requests():
            writer.write(self._requests, EPOCH_NS, raw)

    def repeat(self, ns: int, _k: int = 0) -> None:
        """Write them again, for players that start in the middle."""
        for connection, message in self._once:
            self._writer.write(connection, ns, message(ns))

    def begin_part(self, ns: int, _k: int) -> None:
        """Begin another file of the bag with them."""
        self._writer.next_part()
        self.repeat(ns)

    def replan(self, reply: Reply, plans: Iterator[Plan], ns: int) -> None:
        """The next plan is in force: all of it as markers, and the requests of the robots that were sent other ways."""
        self._messages.plan = next(plans)
        self._writer.write(self._plan_markers, ns, self._messages.plan_markers(ns))
        for raw in self._messages.path_requests(dict(zip(reply.robot.tolist(), reply.since.tolist())), ns):
            self._writer.write(self._requests, ns, raw)
        for robot in reply.robot.tolist():
            if robot in self._paths:
                self._writer.write(self._paths[robot], ns, self._messages.path(ns, robot))


def _makers(
    messages: Messages, record: RunRecord, options: BagOptions, chosen: list[int], topic: "_Topics", fast_ns: IntArray, end_ns: int
) -> list[tuple[Connection, IntArray, Any]]:
    """Topics that are made of samples: the connection, the stamps, and what makes the stream of messages of messages and samples."""
    slow_ns = np.arange(0, end_ns + 1, FLEET_STATES_NS, dtype=np.int64)
    makers: list[tuple[Connection, IntArray, Any]] = [
        (topic("/tf", "tf2_msgs/TFMessage", 100), fast_ns, say.transforms),
        (topic("/robot_cloud", "sensor_msgs/PointCloud2"), fast_ns, say.cloud),
        (topic("/fleet_states", "rmf_fleet_msgs/FleetState"), slow_ns, say.fleet_states),
    ]
    if options.poses:
        makers.append((topic("/robot_poses", "geometry_msgs/PoseArray"), fast_ns, say.poses))
    makers += [(topic(f"/{messages.robots[r]}/odom", "nav_msgs/Odometry"), fast_ns, partial(say.odometry, robot=r)) for r in chosen]
    if record.execution.people is not None:
        people_ns = np.arange(0, end_ns + 1, people.PERIOD_NS, dtype=np.int64)
        makers += [(topic(*people.PEOPLE), people_ns, people.PeopleTopic), (topic(*people.MARKERS), people_ns, people.Markers)]
    return makers


def _sampled(
    writer: PartedWriter, messages: Messages, record: RunRecord, makers: Sequence[tuple[Connection, IntArray, Any]]
) -> Iterator[_Stream]:
    """Streams of messages that are made of samples; those with the same stamps share them."""
    latest: dict[int, tuple[slice, say.Samples]] = {}

    def over(part: slice, connection: Connection, t_ns: IntArray, make: Any) -> Callable[[int, int], None]:
        if latest.get(id(t_ns), (None,))[0] != part:
            latest[id(t_ns)] = part, _samples(record, t_ns, part)
        stream = make(messages, latest[id(t_ns)][1])

        def write(ns: int, k: int) -> None:
            if (data := stream.message(k)) is not None:
                writer.write(connection, ns, data)

        return write

    for connection, t_ns, make in makers:
        yield _Stream(t_ns, partial(over, connection=connection, t_ns=t_ns, make=make))


def _diagnosed(writer: PartedWriter, messages: Messages, record: RunRecord, topic: "_Topics", t_ns: IntArray) -> _Stream:
    diagnosed = topic("/diagnostics", "diagnostic_msgs/DiagnosticArray")
    metrics = {name: topic(f"/metrics/{name}", "std_msgs/Float64") for name in say.metrics(say.Samples(record, t_ns[:1]), 0)}

    def over(part: slice) -> Callable[[int, int], None]:
        samples = _samples(record, t_ns, part)
        diagnostics = say.Diagnostics(messages, samples)

        def write(ns: int, k: int) -> None:
            writer.write(diagnosed, ns, diagnostics.message(k))
            for name, data in say.metrics(samples, k).items():
                if name in metrics:
                    writer.write(metrics[name], ns, data)

        return write

    return _Stream(t_ns, over)


def _listed(messages: Iterable[tuple[int, Callable[[int], None]]]) -> _Stream:
    """Messages that are there already, each with its stamp and what writes it."""
    listed = list(messages)

    def over(part: slice) -> Callable[[int, int], None]:
        return lambda ns, k: listed[part.start + k][1](ns)

    return _Stream(np.array([ns for ns, _ in listed], np.int64), over)


def _every(period_s: float, until_ns: int) -> IntArray:
    """Stamps at each period, but 0; none for a period of 0."""
    every = round(period_s * 1e9)
    return np.arange(every, until_ns + 1, every, dtype=np.int64) if every else np.zeros(0, np.int64)


def _spans(times: Sequence[IntArray], begins_ns: IntArray) -> Iterator[list[slice]]:
    """Which stamps of each stream come from each beginning until the next, and all that is before and after."""
    edges = [np.searchsorted(t_ns, begins_ns[1:]).tolist() for t_ns in times]
    for k in range(len(begins_ns)):
        yield [slice(edge[k - 1] if k else 0, edge[k] if k < len(edge) else len(t_ns)) for edge, t_ns in zip(edges, times)]


def _samples(record: RunRecord, t_ns: IntArray, part: slice) -> say.Samples:
    before_ns = int(t_ns[part.start - 1]) if part.start else -1
    return say.Samples(record, t_ns[part], part.start, before_ns)


class _Topics:
    """Adds topics to a bag; a type is described once, however many topics have it."""

    def __init__(self, writer: PartedWriter, messages: Messages) -> None:
        self._writer, self._store = writer, messages.typestore
        self._described: dict[str, tuple[str, str]] = {}

    def __call__(self, name: str, typename: str, depth: int = 10, latched: bool = False) -> Connection:
        package, short = typename.split("/")
        full = f"{package}/msg/{short}"
        if full not in self._described:
            self._described[full] = self._store.generate_msgdef(full, ros_version=2)[0], self._store.hash_rihs01(full)
        definition, digest = self._described[full]
        profiles = [_qos(depth, latched)]
        return self._writer.add_connection(name, full, msgdef=definition, rihs01=digest, offered_qos_profiles=profiles)


def _merged(times: Sequence[IntArray]) -> Iterator[tuple[int, int, int]]:
    """Streams of stamps merged by time, at equal stamps in their own order: the stamp since the epoch, the stream, the place in it."""
    stamp = np.concatenate(times)
    stream = np.repeat(np.arange(len(times)), [len(t) for t in times])
    place = np.concatenate([np.arange(len(t)) for t in times])
    order = np.lexsort((place, stream, stamp))
    return zip((stamp[order] + EPOCH_NS).tolist(), stream[order].tolist(), place[order].tolist())


def _ticks(record: RunRecord, end_ns: int, period_ns: int) -> IntArray:
    """Stamps of the fast topics: every period, or every sample where those are rarer."""
    sample_ns = np.rint(record.execution.t_s * 1e9).astype(np.int64)
    if len(sample_ns) > 1 and int(sample_ns[1] - sample_ns[0]) >= period_ns:
        return sample_ns
    return np.arange(0, end_ns + 1, period_ns, dtype=np.int64)


def _chosen(record: RunRecord, names: tuple[str, ...]) -> list[int]:
    known = {name: i for i, name in enumerate(record.fleet.robot_name)}
    for name in names:
        if name not in known:
            raise MrpSumoError(f"'{name}' is not a robot of '{record.name}'{nearest(name, known)}")
    return sorted({known[name] for name in names})


def _qos(depth: int, latched: bool) -> Any:
    durability = QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE
    return Qos(
        QosHistory.KEEP_LAST, depth, QosReliability.RELIABLE, durability, INFINITE, INFINITE, QosLiveliness.AUTOMATIC, INFINITE, False
    )
