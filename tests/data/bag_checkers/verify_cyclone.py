#!/usr/bin/env python3
"""Check a sqlite3 bag with Eclipse Cyclone DDS: the CDR code that a real ROS 2 middleware uses.

    python verify_cyclone.py BAG [--rmf galactic|jazzy|kilted] [--latched /map /tf_static]

BAG is a bag directory or a .db3 file. Every message of a type declared below is decoded and encoded again;
the bytes must come back unchanged. Exit status 0 and "OK: ...", or 1 and "FAIL: ...".
"""

import argparse
import math
import re
import sqlite3
import sys
from dataclasses import make_dataclass
from pathlib import Path

import yaml
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, float32, float64, int8, int32, sequence, uint8, uint32, uint64


class Fail(Exception):
    pass


def need(ok, text):
    if not ok:
        raise Fail(text)


def struct(typename, /, **fields):
    return make_dataclass(typename, fields.items(), bases=(IdlStruct,))


def ros_types(rmf):
    """Message types written down by hand from the .msg files, independent of the library that wrote the bag."""
    Time = struct("Time", sec=int32, nanosec=uint32)
    Header = struct("Header", stamp=Time, frame_id=str)
    V3 = struct("V3", x=float64, y=float64, z=float64)
    Quat = struct("Quat", x=float64, y=float64, z=float64, w=float64)
    Pose = struct("Pose", position=V3, orientation=Quat)
    PoseStamped = struct("PoseStamped", header=Header, pose=Pose)
    PoseCov = struct("PoseCov", pose=Pose, covariance=array[float64, 36])
    Twist = struct("Twist", linear=V3, angular=V3)
    TwistCov = struct("TwistCov", twist=Twist, covariance=array[float64, 36])
    Transform = struct("Transform", translation=V3, rotation=Quat)
    TransformStamped = struct("TransformStamped", header=Header, child_frame_id=str, transform=Transform)
    MapMeta = struct("MapMeta", map_load_time=Time, resolution=float32, width=uint32, height=uint32, origin=Pose)
    Color = struct("Color", r=float32, g=float32, b=float32, a=float32)
    Image = struct("Image", header=Header, format=str, data=sequence[uint8])
    UV = struct("UV", u=float32, v=float32)
    Mesh = struct("Mesh", filename=str, data=sequence[uint8])
    Marker = struct(
        "Marker",
        header=Header,
        ns=str,
        id=int32,
        type=int32,
        action=int32,
        pose=Pose,
        scale=V3,
        color=Color,
        lifetime=Time,
        frame_locked=bool,
        points=sequence[V3],
        colors=sequence[Color],
        texture_resource=str,
        texture=Image,
        uv_coordinates=sequence[UV],
        text=str,
        mesh_resource=str,
        mesh_file=Mesh,
        mesh_use_embedded_materials=bool,
    )  # Humble and later
    PointField = struct("PointField", name=str, offset=uint32, datatype=uint8, count=uint32)
    KeyValue = struct("KeyValue", key=str, value=str)
    Status = struct("Status", level=uint8, name=str, message=str, hardware_id=str, values=sequence[KeyValue])

    limit = {} if rmf == "galactic" else {"obey_approach_speed_limit": bool, "approach_speed_limit": float32}
    action = {"performing_action": str} if rmf == "kilted" else {}
    Location = struct("Location", t=Time, x=float32, y=float32, yaw=float32, **limit, level_name=str, index=uint64)
    Mode = struct("Mode", mode=uint32, mode_request_id=uint64, **action)
    Robot = struct(
        "Robot",
        name=str,
        model=str,
        task_id=str,
        seq=uint64,
        mode=Mode,
        battery_percent=float32,
        location=Location,
        path=sequence[Location],
    )

    return {
        "builtin_interfaces/msg/Time": Time,
        "rosgraph_msgs/msg/Clock": struct("Clock", clock=Time),
        "std_msgs/msg/String": struct("String", data=str),
        "std_msgs/msg/Float64": struct("Float64", data=float64),
        "geometry_msgs/msg/PoseStamped": PoseStamped,
        "geometry_msgs/msg/PoseArray": struct("PoseArray", header=Header, poses=sequence[Pose]),
        "tf2_msgs/msg/TFMessage": struct("TFMessage", transforms=sequence[TransformStamped]),
        "nav_msgs/msg/Odometry": struct("Odometry", header=Header, child_frame_id=str, pose=PoseCov, twist=TwistCov),
        "nav_msgs/msg/Path": struct("Path", header=Header, poses=sequence[PoseStamped]),
        "nav_msgs/msg/OccupancyGrid": struct("OccupancyGrid", header=Header, info=MapMeta, data=sequence[int8]),
        "sensor_msgs/msg/PointCloud2": struct(
            "PointCloud2",
            header=Header,
            height=uint32,
            width=uint32,
            fields=sequence[PointField],
            is_bigendian=bool,
            point_step=uint32,
            row_step=uint32,
            data=sequence[uint8],
            is_dense=bool,
        ),
        "visualization_msgs/msg/MarkerArray": struct("MarkerArray", markers=sequence[Marker]),
        "rcl_interfaces/msg/Log": struct("Log", stamp=Time, level=uint8, name=str, msg=str, file=str, function=str, line=uint32),
        "diagnostic_msgs/msg/DiagnosticArray": struct("DiagnosticArray", header=Header, status=sequence[Status]),
        "rmf_fleet_msgs/msg/FleetState": struct("FleetState", name=str, robots=sequence[Robot]),
        "rmf_fleet_msgs/msg/PathRequest": struct("PathRequest", fleet_name=str, robot_name=str, path=sequence[Location], task_id=str),
    }


def same(a, b):
    """Equal after the 4-byte encapsulation header, but for up to 3 bytes of zero padding at the end."""
    a, b = a[4:], b[4:]
    n = min(len(a), len(b))
    return a[:n] == b[:n] and max(len(a), len(b)) - n < 4 and not any(a[n:]) and not any(b[n:])


def main():
    ap = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    ap.add_argument("bag", type=Path)
    ap.add_argument("--rmf", choices=("galactic", "jazzy", "kilted"), default="jazzy", help="generation of rmf_fleet_msgs")
    ap.add_argument("--latched", nargs="*", default=["/map", "/tf_static"], help="topics that must be there, transient local")
    a = ap.parse_args()
    files = sorted(a.bag.glob("*.db3")) if a.bag.is_dir() else [a.bag]
    need(len(files) == 1, f"{a.bag}: expected exactly one .db3 file, found {len(files)}")
    need(files[0].is_file(), f"{files[0]}: no such file")
    db = sqlite3.connect(f"{files[0].resolve().as_uri()}?mode=ro", uri=True)
    need(db.execute("pragma integrity_check").fetchone()[0] == "ok", "sqlite integrity check failed")
    topics = db.execute("select id, name, type, serialization_format, offered_qos_profiles from topics order by name").fetchall()
    need(topics, "no topics")
    need(all(t[3] == "cdr" for t in topics), "a topic is not serialised as cdr")
    types, done, counts, moved, skipped = ros_types(a.rmf), 0, {}, {}, []

    for tid, name, typ, _, qos in topics:
        rows = db.execute("select timestamp, data from messages where topic_id = ? order by id", (tid,))
        last = n = 0
        for stamp, data in rows:
            n += 1
            need(stamp >= last, f"{name}: time stamp goes back at {stamp}")
            last = stamp
            need(data[:4] == b"\0\1\0\0", f"{name}: encapsulation header {data[:4].hex()}, expected plain little-endian CDR")
            if typ not in types:
                continue
            try:
                msg = types[typ].deserialize(data)
                back = msg.serialize(use_version_2=False)
            except Exception as e:
                raise Fail(f"{name}: {typ} ({a.rmf}) does not decode at {stamp}: {type(e).__name__}: {e}") from e
            need(same(back, data), f"{name}: {typ} ({a.rmf}) comes back with other bytes at {stamp} ({len(data)} -> {len(back)})")
            done += 1
            if name == "/tf":
                for t in msg.transforms:
                    x, y = t.transform.translation.x, t.transform.translation.y
                    need(math.isfinite(x) and math.isfinite(y), f"/tf: {t.child_frame_id} has a position that is not finite at {stamp}")
                    b = moved.setdefault(t.child_frame_id, [x, x, y, y])
                    b[:] = min(b[0], x), max(b[1], x), min(b[2], y), max(b[3], y)
        counts[name] = n
        if typ not in types:
            skipped.append(f"{name} ({typ})")
        print(f"{n:8d}  {name}  {typ}{'' if typ in types else '  (type not declared here: not decoded)'}")
        if name in a.latched:
            need(re.search(r"durability: (1|transient_local)\b", qos), f"{name}: QoS durability is not transient local")

    for name in a.latched:
        need(counts.get(name), f"{name}: latched topic has no message")
    need(done, "no message of a known type")
    if (files[0].parent / "metadata.yaml").exists():
        info = yaml.safe_load((files[0].parent / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
        listed = {t["topic_metadata"]["name"]: t["message_count"] for t in info["topics_with_message_count"]}
        need(info["version"] <= 8, f"metadata.yaml has version {info['version']}: Humble and Iron read at most 8")
        need(listed == counts, f"metadata.yaml counts differ from the file: {sorted(set(listed.items()) ^ set(counts.items()))[:4]}")
    moving = sum(math.hypot(b[1] - b[0], b[3] - b[2]) > 0.5 for b in moved.values())
    need(moving or not moved, "no robot moves")
    print(
        f"OK: {done} of {sum(counts.values())} messages decoded and encoded again to the same bytes, {moving} of {len(moved)} robots move"
        + (f"; not decoded: {', '.join(skipped)}" if skipped else "")
    )


if __name__ == "__main__":
    try:
        main()
    except Fail as e:
        sys.exit(f"FAIL: {e}")
    except Exception as e:  # damaged file: whatever sqlite or yaml raised
        sys.exit(f"FAIL: {type(e).__name__}: {e}")
