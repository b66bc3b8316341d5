"""Poses of foreign bags."""

import math

import numpy as np
import pytest
from rosbags.rosbag2 import Writer

from mrp_sumo.bags.messages import typestore
from mrp_sumo.bags.poses import read_poses
from mrp_sumo.calibration.archive import ArchiveHead, write_archive
from mrp_sumo.calibration.log import require_here
from mrp_sumo.calibration.reading import read_fleet
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.maps.catalogue import find_map
from mrp_sumo.maps.load import load_map

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


def test_of_two_odometries_of_a_vehicle_the_longer_counts(tmp_path):
    messages = [("/a/odometry/filtered", "nav_msgs/msg/Odometry", k * 10**9 + 1, odometry(k + 1, 0.5 * k, 0.3)) for k in range(4)]
    messages += [
        ("/a/odom", "nav_msgs/msg/Odometry", 1, odometry(1, 9.0, 0.0)),
        ("/b/odom", "nav_msgs/msg/Odometry", 1, odometry(1, 9.0, 0.0)),
    ]
    log = read_poses(bag(tmp_path / "bag", messages))
    assert {name: [row[1] for row in rows] for name, rows in log.poses.items()} == {"a": [0.0, 0.5, 1.0, 1.5], "b": [9.0]}
    assert log.others == ("/a/odom",)


def test_transforms_of_namespaces_are_of_different_vehicles(tmp_path):
    """As of navigation with a namespace for each robot: frames have the same names."""
    frames = kind("tf2_msgs/msg/TFMessage")
    messages = []
    for k, name in enumerate("ab"):
        chain = [transform(1, "map", "odom", 10.0 * k, 0.0, 0.0), transform(2, "odom", "base_link", 1.0, 0.0, 0.0)]
        messages += [(f"/{name}/tf", "tf2_msgs/msg/TFMessage", 2 * i + k, frames(transforms=[each])) for i, each in enumerate(chain)]
    log = read_poses(bag(tmp_path / "bag", messages))
    assert log.poses == {"a": [(2.0, 1.0, 0.0, 0.0)], "b": [(2.0, 11.0, 0.0, 0.0)]}
    assert log.levels == {"a": [""], "b": [""]}  # one map


@pytest.mark.parametrize(("frame", "levels"), [("odom", {"a/odom": 1, "b/odom": 1}), ("map", {"": 2})])
def test_frames_of_odometry_are_a_vehicles_own_unless_they_are_the_map(tmp_path, frame, levels):
    messages = []
    for name in "ab":
        message = odometry(1, 0.0, 0.0)
        message.header.frame_id = frame
        messages.append((f"/{name}/odom", "nav_msgs/msg/Odometry", 1, message))
    log = read_fleet(bag(tmp_path / "bag", messages))
    on = [log.levels[rows[0][5]] for rows in log.poses.values()]
    assert {level: on.count(level) for level in on} == levels


def twist(ahead, turn):
    vector = kind("geometry_msgs/msg/Vector3")
    return kind("geometry_msgs/msg/Twist")(linear=vector(x=ahead, y=0.0, z=0.0), angular=vector(x=0.0, y=0.0, z=turn))


def test_commanded_speeds_add_up_to_where_a_vehicle_would_be(tmp_path):
    """1 m/s for 0.4 s; a quarter turn in 0.4 s; 1 m/s, which lasts for half a second since nothing follows; then it stands."""
    output = [(0.0, 1.0, 0.0), (0.4, 0.0, math.pi / 0.8), (0.8, 1.0, 0.0), (100.0, 0.0, 0.0)]
    messages = [("/a/cmd_vel", "geometry_msgs/msg/Twist", int(1e9 * (1 + t)), twist(*v)) for t, *v in output]
    log = read_poses(bag(tmp_path / "bag", messages))
    rows = np.array(log.poses["a"])
    assert log.kind == "commanded speeds"
    assert rows[:3] == pytest.approx(np.array([[1, 0, 0, 0], [1.4, 0.4, 0, 0], [1.8, 0.4, 0, math.pi / 2]]))
    assert rows[3:, 1:] == pytest.approx(np.tile([0.4, 0.5, math.pi / 2], (len(rows) - 3, 1)))
    assert np.diff(rows[:, 0]).max() == pytest.approx(98.7 - 60.0, abs=0.2)  # half a minute after a command, and before the next
    with pytest.raises(MrpSumoError, match="found commanded speeds alone, expected poses"):
        write_archive(read_fleet(tmp_path / "bag"), ArchiveHead("a"), tmp_path / "a.zip")
    with pytest.raises(MrpSumoError, match="they do not say where on 'office' vehicles were"):
        require_here(read_fleet(tmp_path / "bag"), load_map(find_map("office", tmp_path)))


def test_who_is_seen_is_not_where_it_was_told_to_be(tmp_path):
    messages = [
        ("/a/cmd_vel", "geometry_msgs/msg/Twist", 1, twist(1.0, 0.0)),
        ("/a/odom", "nav_msgs/msg/Odometry", 1, odometry(1, 5.0, 0.0)),
    ]
    log = read_poses(bag(tmp_path / "bag", messages))
    assert (log.kind, log.others) == ("odometry", ("commanded speeds",))


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
    with pytest.raises(MrpSumoError, match="expected /fleet_states, /tf, odometry, stamped poses or cmd_vel, found topics: /chatter"):
        read_poses(bag(tmp_path / "bag", [("/chatter", "std_msgs/msg/String", 1, text)]))
