"""Poses of vehicles from any bag: `/fleet_states`, transforms, odometry, stamped poses or commanded speeds, the first that it has.

Stamps are those of the messages, where they have one. Transforms are chained from `map` (or `odom`, or `world`) to the frames of bases.
Of several topics or frames of a vehicle, that with the most poses counts. Speeds that vehicles are told to drive are added up to where
they would be. Refuses bags with none of them, in one line.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.bags.reader import FLEET_STATES, Message, read_bag
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.files.names import fault_of

TF, ODOMETRY = "tf2_msgs/msg/TFMessage", "nav_msgs/msg/Odometry"
POSES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped")
FLEET = "rmf_fleet_msgs/msg/FleetState"
COMMANDS, COMMANDED = ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"), "commanded speeds"
HELD_S, PERIOD_S = 0.5, 0.1  # for which a command lasts, and between poses of a stand
STOOD_S = 30.0  # how much of a longer stand is written down after a command, and before the next
GOALS = ("goal", "target", "setpoint", "initialpose")  # topics of poses where nobody is
NAMELESS = "robot"  # a vehicle without a namespace
BASES = ("base_link", "base_footprint", "base")
ROOTS = ("map", "odom", "world")
SHARED = ("map", "world")  # whose origin is that of other vehicles, too
CHARGING = 1  # of rmf_fleet_msgs/RobotMode
Pose = tuple[float, float, float, float]  # s, m, m, rad


@dataclass
class PoseLog:
    """Poses by vehicle, and states of charge."""

    kind: str  # where they are from
    rows: dict[str, dict[str, list[tuple[Pose, str]]]] = field(default_factory=dict)  # by vehicle and topic or frame, with levels
    charges: list[tuple[str, float, float, bool]] = field(default_factory=list)  # vehicle, s, share, charging
    others: tuple[str, ...] = ()  # sources that were not used
    frames: tuple[str, ...] = ()  # of transforms

    def add(self, vehicle: str, source: str, pose: Pose, level: str = "") -> None:
        """Note a pose of a vehicle, which a topic or frame tells, and the level or frame that it is on."""
        self.rows.setdefault(vehicle, {}).setdefault(source, []).append((pose, level))

    @property
    def sources(self) -> dict[str, str]:
        """The topic or frame of each vehicle that tells most, the command that is driven before those that it was made of."""
        return {name: max(rows, key=lambda source: (source.endswith("cmd_vel"), len(rows[source]))) for name, rows in self.rows.items()}

    @property
    def poses(self) -> dict[str, list[Pose]]:
        """Poses by vehicle."""
        return {vehicle: [pose for pose, _ in self.rows[vehicle][source]] for vehicle, source in self.sources.items()}

    @property
    def levels(self) -> dict[str, list[str]]:
        """Level of each of the poses, or their frame where it is one of this vehicle alone."""
        return {vehicle: [level for _, level in self.rows[vehicle][source]] for vehicle, source in self.sources.items()}


def read_poses(path: Path) -> PoseLog:
    """Read a bag. Raises MrpSumoError where it cannot be read, or says nowhere where a vehicle is."""
    topics: set[tuple[str, str]] = set()

    def is_wanted(topic: str, kind: str) -> bool:
        topics.add((topic, kind))
        return kind in (TF, ODOMETRY, FLEET, *POSES) or (kind in COMMANDS and "cmd_vel" in topic)

    logs = read_bag(path, _gather, is_wanted)
    full = [log for log in logs if log.rows]
    if not full:
        listed = ", ".join(sorted(topic for topic, _ in topics)[:8]) or "none"
        if frames := next((log.frames for log in logs if log.frames), ()):
            listed += f"; /tf has {', '.join(frames[:4])}, expected a chain of frames from {', '.join(ROOTS)} to {', '.join(BASES)}"
        raise MrpSumoError(f"{path}: expected {FLEET_STATES}, /tf, odometry, stamped poses or cmd_vel, found topics: {listed}")
    if fault := next(filter(None, map(fault_of, full[0].rows)), ""):
        raise MrpSumoError(f"{path}: name of a vehicle: {fault}")
    used = set(full[0].sources.values())
    unused = sorted({source for rows in full[0].rows.values() for source in rows} - used)
    full[0].others = (*unused, *(log.kind for log in full[1:]))
    return full[0]


def _gather(messages: Iterator[Message]) -> list[PoseLog]:
    kinds = ("/fleet_states", "/tf", "odometry", "stamped poses", COMMANDED)
    fleet, frames, odometry, stamped, commanded = logs = [PoseLog(kind) for kind in kinds]
    parents: dict[tuple[str, str], tuple[str, Pose]] = {}
    speeds: dict[str, tuple[float, float, float]] = {}
    for topic, ns, message in messages:
        vehicle = _vehicle(topic)
        if hasattr(message, "robots"):
            for robot in message.robots:
                place = robot.location
                t_s = place.t.sec + place.t.nanosec * 1e-9 or ns * 1e-9
                fleet.add(robot.name, topic, (t_s, float(place.x), float(place.y), float(place.yaw)), place.level_name)
                if math.isfinite(robot.battery_percent) and 0 < robot.battery_percent <= 100:
                    fleet.charges.append((robot.name, t_s, robot.battery_percent / 100, robot.mode.mode == CHARGING))
        elif hasattr(message, "transforms"):
            for transform in message.transforms:
                _chain(frames, parents, transform, vehicle, ns)
        elif hasattr(message, "child_frame_id"):
            name = vehicle or _vehicle(message.child_frame_id) or NAMELESS
            odometry.add(name, topic, _pose(message, message.pose.pose, ns), _own(message.header.frame_id, name))
        elif hasattr(message, "pose"):
            if not any(word in topic.lower() for word in GOALS):
                pose, name = message.pose.pose if hasattr(message.pose, "pose") else message.pose, vehicle or NAMELESS
                stamped.add(name, topic, _pose(message, pose, ns), _own(message.header.frame_id, name))
        else:
            _command(commanded, speeds, topic, _stamp(message, ns), getattr(message, "twist", message))
    frames.frames = tuple(sorted({child for _, child in parents}))
    return logs


def _chain(frames: PoseLog, parents: dict[tuple[str, str], tuple[str, Pose]], transform: Any, namespace: str, ns: int) -> None:
    """Note a transform; that of a base is a pose of its vehicle."""
    child, parent = transform.child_frame_id.strip("/"), transform.header.frame_id.strip("/")
    away, turned = transform.transform.translation, transform.transform.rotation
    t_s = _stamp(transform, ns)
    parents[namespace, child] = parent, (t_s, float(away.x), float(away.y), _yaw(turned))
    if child.rpartition("/")[2] not in BASES:
        return
    x, y, yaw, frame = 0.0, 0.0, 0.0, child
    for _ in range(8):
        if (namespace, frame) not in parents:
            break
        frame, (_, dx, dy, turn) = parents[namespace, frame]
        x, y, yaw = dx + math.cos(turn) * x - math.sin(turn) * y, dy + math.sin(turn) * x + math.cos(turn) * y, yaw + turn
        if frame.rpartition("/")[2] == ROOTS[0]:
            break
    if frame.rpartition("/")[2] in ROOTS:
        vehicle = namespace or _vehicle(child) or NAMELESS
        frames.add(vehicle, child, (t_s, x, y, yaw), _own(frame, vehicle))


def _command(log: PoseLog, speeds: dict[str, tuple[float, float, float]], topic: str, t_s: float, twist: Any) -> None:
    """Add up speeds that a vehicle is told: one lasts until the next, at most `HELD_S`, after which it stands."""
    vehicle = _vehicle(topic) or NAMELESS
    if topic in speeds:
        (began_s, x, y, yaw), _ = log.rows[vehicle][topic][-1]
        ahead, left, turn = speeds[topic]
        dt = min(max(t_s - began_s, 0.0), HELD_S)
        yaw, half = yaw + turn * dt, yaw + turn * dt / 2
        x += (ahead * math.cos(half) - left * math.sin(half)) * dt
        y += (ahead * math.sin(half) + left * math.cos(half)) * dt
        stood_s = began_s + HELD_S
        after = np.arange(stood_s, min(t_s, stood_s + STOOD_S), PERIOD_S)
        for at in (*after, *np.arange(max(t_s - STOOD_S, stood_s + STOOD_S), t_s, PERIOD_S)):
            log.add(vehicle, topic, (float(at), x, y, yaw), _own("", vehicle))
    else:
        x = y = yaw = 0.0
    log.add(vehicle, topic, (t_s, x, y, yaw), _own("", vehicle))
    speeds[topic] = float(twist.linear.x), float(twist.linear.y), float(twist.angular.z)


def _own(frame: str, vehicle: str) -> str:
    """The frame of poses, where others do not share it: what is near there is not near the vehicle."""
    return "" if frame.rpartition("/")[2] in SHARED else f"{vehicle}/odom"


def _vehicle(name: str) -> str:
    """The namespace of a topic, or of a frame, but for what says who computes odometry."""
    space, _, last = name.strip("/").rpartition("/")[0].rpartition("/")
    return space if last == "odometry" or last.endswith("_controller") else f"{space}/{last}".strip("/")


def _pose(message: Any, pose: Any, ns: int) -> Pose:
    return _stamp(message, ns), float(pose.position.x), float(pose.position.y), _yaw(pose.orientation)


def _stamp(message: Any, ns: int) -> float:
    stamp = message.header.stamp if hasattr(message, "header") else None
    return float((stamp and stamp.sec + stamp.nanosec * 1e-9) or ns * 1e-9)


def _yaw(q: Any) -> float:
    return math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
