"""Poses of foreign bags."""

import math

import numpy as np
import pytest
from rosbags.rosbag2 import Writer

from mrp_sumo.bags.messages import typestore
from mrp_sumo.bags.poses import read_poses
from mrp_sumo.calibration.reading import read_fleet
from mrp_sumo.errors import MrpSumoError

STORE = typestore("jazzy")


def kind(name):
    return STORE.types[name]


def header(second, frame):
    stamp = kind("builtin_interfaces/msg/Time")(sec=second, nanosec=0)
    return kind("std_msgs/msg/Header")(stamp=stamp, frame_id=frame)


def transform(second, parent, child, x, y, yaw):
    away = kind("geometry_msgs/msg/Vector3")(x=x, y=y, z=0.0)
    turned = kind("geometry_msgs/msg/Quaternion")(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    moved = kind("geometry_msgs/msg/Transform")(translation=away, rotation=turned)
    return kind("geometry_msgs/msg/TransformStamped")(header=header(second, parent), child_frame_id=child, transform=moved)


def odometry(second, x, yaw, child="base_link"):
    point = kind("geometry_msgs/msg/Point")(x=x, y=0.0, z=0.0)
    turned = kind("geometry_msgs/msg/Quaternion")(x=0.0, y=0.0, z=math.sin(yaw / 2), w=math.cos(yaw / 2))
    pose = kind("geometry_msgs/msg/PoseWithCovariance")(
        pose=kind("geometry_msgs/msg/Pose")(position=point, orientation=turned), covariance=np.zeros(36)
    )
    zero = kind("geometry_msgs/msg/Vector3")(x=0.0, y=0.0, z=0.0)
    twist = kind("geometry_msgs/msg/TwistWithCovariance")(
        twist=kind("geometry_msgs/msg/Twist")(linear=zero, angular=zero), covariance=np.zeros(36)
    )
    return kind("nav_msgs/msg/Odometry")(header=header(second, "odom"), child_frame_id=child, pose=pose, twist=twist)


def bag(path, messages):
    with Writer(path, version=9) as writer:
        connections = {}
        for topic, name, ns, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, name, typestore=STORE)
            writer.write(connections[topic], ns, STORE.serialize_cdr(message, name))
    return path


def test_odometry_alone_is_named_by_its_topic(tmp_path):
    messages = [("/cart_3/odom", "nav_msgs/msg/Odometry", k * 10**9 + 1, odometry(k + 1, 0.5 * k, 0.3)) for k in range(4)]
    log = read_poses(bag(tmp_path / "bag", messages))
    assert log.kind == "odometry"
    assert log.poses["cart_3"][2] == pytest.approx((3.0, 1.0, 0.0, 0.3))


def test_odometry_on_one_topic_is_named_by_its_frames(tmp_path):
    messages = [
        ("/odom", "nav_msgs/msg/Odometry", k * 10**9 + 1, odometry(k + 1, 0.5 * k, 0.3, f"cart_{k % 2}/base_link")) for k in range(4)
    ]
    assert {name: [row[1] for row in rows] for name, rows in read_poses(bag(tmp_path / "bag", messages)).poses.items()} == {
        "cart_0": [0.0, 1.0],
        "cart_1": [0.5, 1.5],
    }


def test_poses_that_are_no_numbers_are_one_line(tmp_path):
    messages = [("/odom", "nav_msgs/msg/Odometry", k * 10**9 + 1, odometry(k + 1, math.nan, 0.3)) for k in range(4)]
    with pytest.raises(MrpSumoError, match="odometry: no pose is one of a floor: found no numbers"):
        read_fleet(bag(tmp_path / "bag", messages))


def test_transforms_are_chained_from_the_map(tmp_path):
    frames = kind("tf2_msgs/msg/TFMessage")
    chain = [
        frames(transforms=[transform(1, "map", "a/odom", 10.0, 0.0, math.pi / 2)]),
        frames(transforms=[transform(2, "a/odom", "a/base_link", 1.0, 0.0, 0.0)]),
    ]
    log = read_poses(bag(tmp_path / "bag", [("/tf", "tf2_msgs/msg/TFMessage", k + 1, each) for k, each in enumerate(chain)]))
    assert log.poses["a"] == [pytest.approx((2.0, 10.0, 1.0, math.pi / 2))]


def test_transforms_to_no_base_are_named(tmp_path):
    frames = kind("tf2_msgs/msg/TFMessage")(transforms=[transform(1, "map", "a/laser", 1.0, 0.0, 0.0)])
    with pytest.raises(MrpSumoError, match="/tf has a/laser, expected a chain of frames from map, odom, world to base_link"):
        read_poses(bag(tmp_path / "bag", [("/tf", "tf2_msgs/msg/TFMessage", 1, frames)]))


def test_bag_without_poses_says_what_it_has(tmp_path):
    text = kind("std_msgs/msg/String")(data="x")
    with pytest.raises(MrpSumoError, match="expected /fleet_states, /tf, odometry or stamped poses, found topics: /chatter"):
        read_poses(bag(tmp_path / "bag", [("/chatter", "std_msgs/msg/String", 1, text)]))
