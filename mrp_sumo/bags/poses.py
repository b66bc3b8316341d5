"""Poses of vehicles from any bag: `/fleet_states`, transforms, odometry or stamped poses, whichever a bag has first in this order.

Stamps are those of the messages, where they have one. Transforms are chained from `map` (or `odom`, or `world`) to the frames of bases.
Refuses bags with none of them, in one line.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mrp_sumo.bags.reader import FLEET_STATES, Message, read_bag
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.files.names import fault_of

TF, ODOMETRY = "tf2_msgs/msg/TFMessage", "nav_msgs/msg/Odometry"
POSES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped")
FLEET = "rmf_fleet_msgs/msg/FleetState"
GOALS = ("goal", "target", "setpoint", "initialpose")  # topics of poses where nobody is
NAMELESS = "robot"  # a vehicle without a namespace
BASES = ("base_link", "base_footprint", "base")
ROOTS = ("map", "odom", "world")
CHARGING = 1  # of rmf_fleet_msgs/RobotMode
Pose = tuple[float, float, float, float]  # s, m, m, rad


@dataclass
class PoseLog:
    """Poses by vehicle, and states of charge."""

    kind: str  # where they are from
    poses: dict[str, list[Pose]] = field(default_factory=dict)
    levels: dict[str, list[str]] = field(default_factory=dict)  # of each pose, where there are several
    charges: list[tuple[str, float, float, bool]] = field(default_factory=list)  # vehicle, s, share, charging
    others: tuple[str, ...] = ()  # sources that were not used
    frames: tuple[str, ...] = ()  # of transforms


def read_poses(path: Path) -> PoseLog:
    """Read a bag. Raises MrpSumoError where it cannot be read, or says nowhere where a vehicle is."""
    topics: set[tuple[str, str]] = set()

    def is_wanted(topic: str, kind: str) -> bool:
        topics.add((topic, kind))
        return kind in (TF, ODOMETRY, FLEET, *POSES)

    logs = read_bag(path, _gather, is_wanted)
    for log in logs:
        log.poses = {name: rows for name, rows in log.poses.items() if rows}
    full = [log for log in logs if log.poses]
    if not full:
        listed = ", ".join(sorted(topic for topic, _ in topics)[:8]) or "none"
        if frames := next((log.frames for log in logs if log.frames), ()):
            listed += f"; /tf has {', '.join(frames[:4])}, expected a chain of frames from {', '.join(ROOTS)} to {', '.join(BASES)}"
        raise MrpSumoError(f"{path}: expected {FLEET_STATES}, /tf, odometry or stamped poses, found topics: {listed}")
    if fault := next(filter(None, map(fault_of, full[0].poses)), ""):
        raise MrpSumoError(f"{path}: name of a vehicle: {fault}")
    full[0].others = tuple(log.kind for log in full[1:])
    return full[0]


def _gather(messages: Iterator[Message]) -> list[PoseLog]:
    fleet, frames, odometry, stamped = PoseLog("/fleet_states"), PoseLog("/tf"), PoseLog("odometry"), PoseLog("stamped poses")
    parents: dict[str, tuple[str, Pose]] = {}
    for topic, ns, message in messages:
        if hasattr(message, "robots"):
            for robot in message.robots:
                place = robot.location
                t_s = place.t.sec + place.t.nanosec * 1e-9 or ns * 1e-9
                fleet.poses.setdefault(robot.name, []).append((t_s, float(place.x), float(place.y), float(place.yaw)))
                fleet.levels.setdefault(robot.name, []).append(place.level_name)
                if math.isfinite(robot.battery_percent) and 0 < robot.battery_percent <= 100:
                    fleet.charges.append((robot.name, t_s, robot.battery_percent / 100, robot.mode.mode == CHARGING))
        elif hasattr(message, "transforms"):
            for transform in message.transforms:
                _chain(frames, parents, transform, ns)
        elif hasattr(message, "child_frame_id"):
            vehicle = _vehicle(topic) or _vehicle(message.child_frame_id) or NAMELESS
            odometry.poses.setdefault(vehicle, []).append(_pose(message, message.pose.pose, ns))
        elif hasattr(message, "pose") and not any(word in topic.lower() for word in GOALS):
            pose = message.pose.pose if hasattr(message.pose, "pose") else message.pose
            stamped.poses.setdefault(_vehicle(topic) or NAMELESS, []).append(_pose(message, pose, ns))
    frames.frames = tuple(sorted(parents))
    return [fleet, frames, odometry, stamped]


def _chain(frames: PoseLog, parents: dict[str, tuple[str, Pose]], transform: Any, ns: int) -> None:
    """Note a transform; that of a base is a pose of its vehicle."""
    child, parent = transform.child_frame_id.strip("/"), transform.header.frame_id.strip("/")
    away, turned = transform.transform.translation, transform.transform.rotation
    t_s = _stamp(transform, ns)
    parents[child] = parent, (t_s, float(away.x), float(away.y), _yaw(turned))
    if child.rpartition("/")[2] not in BASES:
        return
    x, y, yaw, frame = 0.0, 0.0, 0.0, child
    for _ in range(8):
        if frame not in parents:
            break
        frame, (_, dx, dy, turn) = parents[frame]
        x, y, yaw = dx + math.cos(turn) * x - math.sin(turn) * y, dy + math.sin(turn) * x + math.cos(turn) * y, yaw + turn
        if frame.rpartition("/")[2] == ROOTS[0]:
            break
    if frame.rpartition("/")[2] in ROOTS:
        frames.poses.setdefault(_vehicle(child) or NAMELESS, []).append((t_s, x, y, yaw))


def _vehicle(name: str) -> str:
    """The namespace of a topic, or of a frame."""
    return name.strip("/").rpartition("/")[0]


def _pose(message: Any, pose: Any, ns: int) -> Pose:
    return _stamp(message, ns), float(pose.position.x), float(pose.position.y), _yaw(pose.orientation)


def _stamp(message: Any, ns: int) -> float:
    stamp = message.header.stamp
    return float(stamp.sec + stamp.nanosec * 1e-9 or ns * 1e-9)


def _yaw(q: Any) -> float:
    return math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y * q.y + q.z * q.z))
