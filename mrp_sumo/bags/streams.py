"""Topics with a message per moment: copies of serialised messages whose numbers are set, many moments at a time."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.bags.messages import EPOCH_NS, FLEET_NAME, Messages
from mrp_sumo.bags.template import Copies, Template
from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.execution import positions_at
from mrp_sumo.core.graph import BoolArray, IntArray
from mrp_sumo.core.near import least_distance_m
from mrp_sumo.io.record import (
    AT_GOAL,
    BLOCKED,
    MOVING,
    STATE_NAMES,
    WAITING,
    RunRecord,
    battery_percent_at,
    charging_at,
    goal_name,
    robot_states,
    task_names_at,
)

COLOURS = {MOVING: (0.18, 0.55, 0.95), WAITING: (0.95, 0.70, 0.10), BLOCKED: (0.90, 0.20, 0.15), AT_GOAL: (0.25, 0.70, 0.35)}
RMF_CHARGING = 1
RMF_MODES = {MOVING: 2, WAITING: 4, BLOCKED: 4, AT_GOAL: 0}  # RobotMode: MODE_MOVING, MODE_WAITING, MODE_IDLE
CLOUD = np.dtype(
    {
        "names": ["x", "y", "z", "rgb", "speed", "yaw", "id", "blocked"],
        "formats": ["<f4", "<f4", "<f4", "<u4", "<f4", "<f4", "<u4", "u1"],
        "offsets": [0, 4, 8, 12, 16, 20, 24, 28],
        "itemsize": 32,
    }
)
STAMP = ("<i4", "<u4")  # kinds of the numbers of a header's time
ABSENT = -1  # as a level
TOGETHER_BYTES = 2**20  # of messages that are made at once
CDR_HEADER = b"\x00\x01\x00\x00"  # little endian; alignment counts from its end


class Samples:
    """Positions and states of R robots at K times of a topic, of which `first` came before in the bag, the last at `before_ns`."""

    def __init__(self, record: RunRecord, t_ns: IntArray, first: int = 0, before_ns: int = -1) -> None:
        execution = record.execution
        self.t_ns, self.first = t_ns, first
        self.before_ns = before_ns
        self.yaw_before = positions_at(execution, np.array([before_ns / 1e9]))[2][0] if first else None  # [R]
        self.x, self.y, self.yaw = positions_at(execution, t_ns / 1e9)
        sample = np.clip(np.searchsorted(execution.t_s, t_ns / 1e9 - 1e-9), 0, len(execution.t_s) - 1)
        self.speed = execution.speed_mps[sample]
        self.level = None if execution.level is None else execution.level[sample]  # [K, R], where robots change levels
        self.state = robot_states(execution, t_ns / 1e9)
        self.there: BoolArray = np.isfinite(self.x) & np.isfinite(self.y)


Fill = Callable[[Copies, slice, Any], None]


class Stream:
    """Messages over time, asked for in their order; the template is rebuilt when robots appear, disappear, or change level or task."""

    def __init__(
        self,
        samples: Samples,
        template: Callable[[IntArray, NDArray[Any]], Template],
        fill: Fill,
        *,
        nanosec: bool = True,
        only: int | None = None,
        now: NDArray[Any] | None = None,  # [K, R, ...] what templates differ by
    ) -> None:
        self.samples = samples
        self._make, self._fill, self._nanosec, self._only = template, fill, nanosec, only
        self._all = np.where(samples.there, 0, ABSENT).astype(np.int8) if now is None else now
        self._now: NDArray[Any] | None = None
        self._template: Template | None = None
        self._robots: Any = slice(None)
        self._copies: Copies | None = None
        self._at = self._next = 0  # the first of the copies, and the message that follows the last one asked for

    def message(self, k: int) -> bytes | None:
        """The message at the k-th time; None for no message."""
        if self._copies is None or k != self._next or k >= self._at + len(self._copies):
            self._at, self._copies = k, self._from(k)
        self._next = k + 1
        is_there = self._only is None or self.samples.there[k, self._only]
        return self._copies.message(k - self._at) if is_there else None

    def _from(self, k: int) -> Copies:
        """The messages from the k-th on, as many as have its layout and are made together."""
        now = self._all[k]
        if self._template is None or self._now is None or (self._only is None and not np.array_equal(now, self._now)):
            there = self.samples.there[k]
            self._now, self._robots = now, slice(None) if there.all() else np.flatnonzero(there)
            self._template = self._make(np.flatnonzero(there), now)
        following = self._all[k + 1 : k + max(1, TOGETHER_BYTES // self._template.size)]
        if self._only is None:
            differ = (following != now).reshape(len(following), now.size).any(1)
            following = following[: int(differ.argmax()) if differ.any() else len(differ)]
        part = slice(k, k + 1 + len(following))
        copies = self._template.copies(1 + len(following))
        sec, nanosec = np.divmod(EPOCH_NS + self.samples.t_ns[part], 10**9)
        copies.set("<i4", sec[:, None])
        if self._nanosec:
            copies.set("<u4", nanosec[:, None])
        self._fill(copies, part, self._robots)
        return copies


def transforms(m: Messages, samples: Samples) -> Stream:
    """/tf: all robots in one message."""
    frames = [f"{name}/base_link" for name in m.robots]

    def make(robots: IntArray, _: Any, v: list[Any]) -> Any:
        moved = [
            m.make(
                "geometry_msgs/TransformStamped",
                m.make("std_msgs/Header", m.make("builtin_interfaces/Time", sec, nanosec), "map"),
                frames[r],
                m.make("geometry_msgs/Transform", m.make("geometry_msgs/Vector3", x, y, 0.0), m.turn(qz, qw)),
            )
            for r, sec, nanosec, x, y, qz, qw in zip(robots, *(v[k::6] for k in range(6)))
        ]
        return m.make("tf2_msgs/TFMessage", moved)

    return Stream(samples, _layout(m, make, each=("<i4", "<u4", "<f8", "<f8", "<f8", "<f8")), _fill_poses(samples))


def poses(m: Messages, samples: Samples) -> Stream:
    """/robot_poses: all robots in one message."""

    def make(robots: IntArray, _: Any, v: list[Any]) -> Any:
        header = m.make("std_msgs/Header", m.make("builtin_interfaces/Time", v[0], v[1]), "map")
        rows = zip(v[2::4], v[3::4], v[4::4], v[5::4])
        made = [m.make("geometry_msgs/Pose", m.make("geometry_msgs/Point", x, y, 0.0), m.turn(qz, qw)) for x, y, qz, qw in rows]
        return m.make("geometry_msgs/PoseArray", header, made)

    return Stream(samples, _layout(m, make, STAMP, each=("<f8",) * 4), _fill_poses(samples))


def _layout(
    m: Messages, make: Callable[[IntArray, NDArray[Any], list[Any]], Any], once: tuple[str, ...] = (), each: tuple[str, ...] = ()
) -> Callable[[IntArray, NDArray[Any]], Template]:
    """What makes a template for some robots: `make` has a message of these, what layouts differ by, and numbers.

    The kinds of the numbers are those that a message has once, and then those of each robot.
    """
    return lambda robots, now: Template(m.typestore, partial(make, robots, now), once + each * len(robots))


def _fill_poses(samples: Samples) -> Fill:
    """Sets x, y and the turn about z (quaternion z, w) of each robot."""

    def fill(copies: Copies, part: slice, robots: Any) -> None:
        half = samples.yaw[part, robots] / 2
        copies.set("<f8", _by_robot(samples.x[part, robots], samples.y[part, robots], np.sin(half), np.cos(half)))

    return fill


def _by_robot(*columns: NDArray[Any]) -> NDArray[Any]:
    """[K, N R] numbers of K messages: those of the first robot, then of the second, from [K, R] each."""
    return np.stack(columns, 2).reshape(len(columns[0]), -1)


def fleet_states(m: Messages, samples: Samples) -> Stream:
    """/fleet_states, as Open-RMF publishes them."""
    mode = np.array([RMF_MODES[state] for state in range(len(STATE_NAMES))])
    names, task = np.unique(task_names_at(m.record, samples.t_ns / 1e9).astype(str), return_inverse=True)
    level = _levels(m.record, samples)
    level = np.where(samples.there, 0, ABSENT) if level is None else level
    now = np.stack((level, task.reshape(level.shape)), 2)  # [K, R, 2] level and task of each robot
    x, y = samples.x, samples.y
    if samples.level is not None:  # each level has a frame of its own
        x, y = x - m.shift_m[samples.level, 0], y - m.shift_m[samples.level, 1]
    battery, charging = battery_percent_at(m.record, samples.t_ns / 1e9), charging_at(m.record, samples.t_ns / 1e9)
    more = ("",) if m.generation == "kilted" else ()  # performing_action

    def make(robots: IntArray, now: NDArray[Any], v: list[Any]) -> Any:
        states = [
            m.make(
                "rmf_fleet_msgs/RobotState",
                m.robots[r],
                FLEET_NAME,
                str(names[now[r, 1]]),
                number,
                m.make("rmf_fleet_msgs/RobotMode", mode_now, 0, *more),
                percent,
                m.location(x, y, yaw, int(now[r, 0]), t=m.make("builtin_interfaces/Time", sec, nanosec)),
                [],
            )
            for r, number, mode_now, sec, nanosec, percent, x, y, yaw in zip(robots, *(v[k::8] for k in range(8)))
        ]
        return m.make("rmf_fleet_msgs/FleetState", FLEET_NAME, states)

    def fill(copies: Copies, part: slice, robots: Any) -> None:
        now = np.where(charging[part, robots], RMF_CHARGING, mode[samples.state[part, robots]])
        nanosec = np.broadcast_to(samples.t_ns[part, None] % 10**9, now.shape)
        copies.set("<u8", samples.first + np.arange(part.start, part.stop)[:, None])
        copies.set("<u4", _by_robot(now, nanosec))
        copies.set("<f4", _by_robot(*(column[part, robots] for column in (battery, x, y, samples.yaw))))

    layout = _layout(m, make, each=("<u8", "<u4", "<i4", "<u4", "<f4", "<f4", "<f4", "<f4"))
    return Stream(samples, layout, fill, nanosec=False, now=now)


def cloud(m: Messages, samples: Samples) -> Stream:
    """/robot_cloud: one point per robot, coloured by state."""
    fields = [("x", 7), ("y", 7), ("z", 7), ("rgb", 7), ("speed", 7), ("yaw", 7), ("id", 6), ("blocked", 2)]
    rgb = np.array([int("".join(f"{round(255 * c):02x}" for c in COLOURS[state]), 16) for state in range(len(STATE_NAMES))], np.uint32)

    def make(robots: IntArray, _: Any, v: list[Any]) -> Any:
        described = [m.make("sensor_msgs/PointField", name, CLOUD.fields[name][1], kind, 1) for name, kind in fields]  # type: ignore[index]
        data = np.zeros(len(robots) * CLOUD.itemsize, np.uint8)
        header = m.make("std_msgs/Header", m.make("builtin_interfaces/Time", *v), "map")
        return m.make("sensor_msgs/PointCloud2", header, 1, len(robots), described, False, CLOUD.itemsize, len(data), data, True)

    def fill(copies: Copies, part: slice, robots: Any) -> None:
        state = samples.state[part, robots]
        points = np.zeros(state.shape, CLOUD)
        points["x"], points["y"], points["yaw"] = samples.x[part, robots], samples.y[part, robots], samples.yaw[part, robots]
        points["speed"], points["rgb"], points["blocked"] = samples.speed[part, robots], rgb[state], state == BLOCKED
        points["id"] = np.arange(samples.x.shape[1])[robots]
        copies.set_before_end(points.view(np.uint8).reshape(len(points), -1), after=1)

    return Stream(samples, _layout(m, make, STAMP), fill)


def odometry(m: Messages, samples: Samples, robot: int) -> Stream:
    """/<robot>/odom of one robot; no messages while it is not on the floor."""
    covariance = np.zeros(36)
    yaw, t_ns = samples.yaw[:, robot], samples.t_ns
    before, since_ns = (yaw[:1], t_ns[:1] - 1) if samples.yaw_before is None else (samples.yaw_before[[robot]], [samples.before_ns])
    turn = wrapped(np.diff(yaw, prepend=before))
    turn_rate = np.nan_to_num(turn / (np.diff(t_ns, prepend=since_ns) / 1e9))

    def make(_robots: IntArray, _now: Any, v: list[Any]) -> Any:
        header = m.make("std_msgs/Header", m.make("builtin_interfaces/Time", v[0], v[1]), "map")
        pose = m.make("geometry_msgs/Pose", m.make("geometry_msgs/Point", v[2], v[3], 0.0), m.turn(v[4], v[5]))
        twist = m.make("geometry_msgs/Twist", m.vector(v[6]), m.make("geometry_msgs/Vector3", 0.0, 0.0, v[7]))
        return m.make(
            "nav_msgs/Odometry",
            header,
            f"{m.robots[robot]}/base_link",
            m.make("geometry_msgs/PoseWithCovariance", pose, covariance),
            m.make("geometry_msgs/TwistWithCovariance", twist, covariance),
        )

    def fill(copies: Copies, part: slice, _: Any) -> None:
        half = samples.yaw[part, robot] / 2
        x, y, speed = (column[part, robot] for column in (samples.x, samples.y, samples.speed))
        copies.set("<f8", np.stack((x, y, np.sin(half), np.cos(half), speed, turn_rate[part]), 1))

    return Stream(samples, _layout(m, make, (*STAMP, *("<f8",) * 6)), fill, only=robot)


class Diagnostics:
    """/diagnostics: the state of each robot in words. Strings vary in length, so the bytes are assembled here."""

    def __init__(self, m: Messages, samples: Samples) -> None:
        self.samples = samples
        states = range(len(STATE_NAMES))
        self._statuses = [[_status(m, robot, state) for state in states] for robot in range(len(m.robots))]
        self._said: tuple[tuple[int, int], ...] | None = None  # robots and their states of the last message
        self._body = b""  # and what follows its stamp

    def message(self, k: int) -> bytes:
        """The message at the k-th time."""
        robots = np.flatnonzero(self.samples.there[k])
        now = tuple(zip(robots.tolist(), self.samples.state[k, robots].tolist()))
        if now != self._said:
            self._said, self._body = now, self._listed(now)
        sec, nanosec = divmod(EPOCH_NS + int(self.samples.t_ns[k]), 10**9)
        return CDR_HEADER + sec.to_bytes(4, "little") + nanosec.to_bytes(4, "little") + self._body

    def _listed(self, now: Sequence[tuple[int, int]]) -> bytes:
        """The frame of a message, and robots with their states; it begins on a multiple of four."""
        parts = bytearray(_padded(_string("")))
        parts += len(now).to_bytes(4, "little")
        for robot, state in now:
            parts.append(1 if state == BLOCKED else 0)  # level WARN or OK
            parts += bytes(-len(parts) % 4) + self._statuses[robot][state]
        return bytes(parts)


def metrics(samples: Samples, k: int) -> dict[str, bytes]:
    """/metrics/*: numbers about the fleet at one time."""
    there = samples.there[k]
    state, speed = samples.state[k, there], samples.speed[k, there]
    xy = np.column_stack((samples.x[k, there], samples.y[k, there]))
    figures = {
        "robots_moving": float((state == MOVING).sum()),
        "robots_waiting": float((state == WAITING).sum()),
        "robots_blocked": float((state == BLOCKED).sum()),
        "robots_at_goal": float((state == AT_GOAL).sum()),
        "mean_speed_mps": float(speed.mean()) if len(speed) else 0.0,
    }
    if len(xy) > 1:
        figures["min_distance_m"] = least_distance_m(xy)
    return {name: CDR_HEADER + np.array(value, "<f8").tobytes() for name, value in figures.items()}


def _levels(record: RunRecord, samples: Samples) -> NDArray[np.int8] | None:
    """[K, R] level of the vertex nearest to each robot, ABSENT off the floor; None where there is one level."""
    if len(record.graph.level_names) < 2:
        return None
    if samples.level is not None:
        return np.where(samples.there, samples.level, ABSENT).astype(np.int8)
    from scipy.spatial import cKDTree

    level = np.full(samples.x.shape, ABSENT, np.int8)
    xy = np.column_stack((samples.x[samples.there], samples.y[samples.there]))
    level[samples.there] = record.graph.level[cKDTree(record.graph.xy).query(xy)[1]]
    return level


def _status(m: Messages, robot: int, state: int) -> bytes:
    """A DiagnosticStatus after its level, from a multiple of four on."""
    values = (("state", STATE_NAMES[state]), ("goal", goal_name(m.record, robot)))
    texts = [m.robots[robot], STATE_NAMES[state], m.record.fleet.robot_name[robot]]
    out = b"".join(_padded(_string(text)) for text in texts) + len(values).to_bytes(4, "little")
    pairs = [_string(text) for pair in values for text in pair]
    return out + b"".join(map(_padded, pairs[:-1])) + pairs[-1]


def _string(text: str) -> bytes:
    """A CDR string: length with the final zero, bytes, zero."""
    raw = text.encode() + b"\x00"
    return len(raw).to_bytes(4, "little") + raw


def _padded(raw: bytes) -> bytes:
    return raw + bytes(-len(raw) % 4)
