#!/usr/bin/env python3
"""Check an mcap bag with Foxglove's Python readers (mcap + mcap-ros2-support).

    python verify_mcap.py BAG [--latched /map /tf_static] [--min-moving 1] [--max-skew 0]

BAG is a bag directory or an .mcap file. Exit status 0 and a line "OK: ..." when every check passes,
1 and a line "FAIL: ..." at the first one that does not.
"""

import argparse
import math
import sys
from collections import Counter
from pathlib import Path

import yaml
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

MOVED = 0.5  # a robot counts as moving when its positions span more than this (m)
SAME_PLACE = 2e-3  # /fleet_states is float32: allowed distance to /tf at the same stamp (m)


class Fail(Exception):
    pass


def need(ok, text):
    if not ok:
        raise Fail(text)


def nanoseconds(stamp):
    need(0 <= stamp.nanosec < 10**9 and stamp.sec >= 0, f"bad stamp {stamp.sec}.{stamp.nanosec}")
    return stamp.sec * 10**9 + stamp.nanosec


class Motion:
    """Bounding box per /tf child frame, and /fleet_states against /tf."""

    def __init__(self, skew):
        self.skew = skew
        self.box, self.last, self.tf, self.fleet, self.compared = {}, {}, None, None, 0

    def on_tf(self, log_time, msg):
        now = {}
        for t in msg.transforms:
            p, q, child = t.transform.translation, t.transform.rotation, t.child_frame_id
            need(child and t.header.frame_id, "/tf: empty frame id")
            need(child[0] != "/" and t.header.frame_id[0] != "/", f"/tf: frame id {child} starts with a slash")
            need(all(map(math.isfinite, (p.x, p.y, p.z))), f"/tf: {child} has a position that is not finite")
            need(abs(q.x**2 + q.y**2 + q.z**2 + q.w**2 - 1) < 1e-3, f"/tf: {child} has a quaternion that is not of unit length")
            ns = nanoseconds(t.header.stamp)
            need(ns > self.last.get(child, -1), f"/tf: stamps of {child} do not increase at {ns}")
            need(abs(ns - log_time) <= self.skew, f"/tf: stamp {ns} of {child} is {abs(ns - log_time) / 1e9} s from log time {log_time}")
            self.last[child] = ns
            b = self.box.setdefault(child, [p.x, p.x, p.y, p.y])
            b[:] = min(b[0], p.x), max(b[1], p.x), min(b[2], p.y), max(b[3], p.y)
            now[child] = (p.x, p.y)
        self.tf = (log_time, now)
        self.compare()

    def on_fleet(self, log_time, msg):
        self.fleet = (log_time, {r.name: (r.location.x, r.location.y) for r in msg.robots})
        self.compare()

    def compare(self):  # whichever of the two comes second at one log time
        if not (self.tf and self.fleet and self.tf[0] == self.fleet[0]):
            return
        for name, a in self.fleet[1].items():
            b = self.tf[1].get(f"{name}/base_link")
            if b:
                need(math.dist(a, b) <= SAME_PLACE, f"/fleet_states and /tf disagree on {name} at {self.tf[0]}: {a} {b}")
                self.compared += 1

    def moving(self):
        return [c for c, b in self.box.items() if math.hypot(b[1] - b[0], b[3] - b[2]) > MOVED]


def check_metadata(path, counts):
    """metadata.yaml beside the bag must say the same as the file."""
    info = yaml.safe_load(path.read_text())["rosbag2_bagfile_information"]
    need(info["version"] <= 8, f"metadata.yaml has version {info['version']}: Humble and Iron read at most 8")
    listed = {t["topic_metadata"]["name"]: t["message_count"] for t in info["topics_with_message_count"]}
    need(listed == dict(counts), f"metadata.yaml counts differ from the file: {sorted(set(listed.items()) ^ set(counts.items()))[:4]}")
    need(info["message_count"] == sum(counts.values()), "metadata.yaml: message_count is not the sum over the topics")


def main():
    ap = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    ap.add_argument("bag", type=Path)
    ap.add_argument(
        "--latched", nargs="*", default=["/map", "/tf_static"], help="topics that must be there once, at the start, transient local"
    )
    ap.add_argument("--min-moving", type=int, default=1, help="so many /tf frames must move")
    ap.add_argument("--max-skew", type=float, default=0.0, help="allowed |header.stamp - log time| in seconds")
    a = ap.parse_args()
    skew = a.max_skew * 1e9
    files = sorted(a.bag.glob("*.mcap")) if a.bag.is_dir() else [a.bag]
    need(len(files) == 1, f"{a.bag}: expected exactly one .mcap file, found {len(files)}")
    need(files[0].is_file(), f"{files[0]}: no such file")

    with files[0].open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        need(reader.get_header().profile == "ros2", f"profile is {reader.get_header().profile!r}, not ros2")
        summary = reader.get_summary()
        need(summary is not None and summary.statistics is not None, "no summary section: the writer was not closed")
        channels = {c.topic: c for c in summary.channels.values()}
        need(len(channels) == len(summary.channels), "two channels have the same topic")
        for c in channels.values():
            s = summary.schemas[c.schema_id]
            need(
                c.message_encoding == "cdr" and s.encoding == "ros2msg" and s.data,
                f"{c.topic}: {c.message_encoding}/{s.encoding}, expected cdr/ros2msg with a definition",
            )

        factory, decoders = DecoderFactory(), {}
        counts, last_log, last_stamp, first, motion = Counter(dict.fromkeys(channels, 0)), {}, {}, {}, Motion(skew)
        for schema, channel, message in reader.iter_messages(log_time_order=False):  # file order
            topic, log = channel.topic, message.log_time
            if channel.id not in decoders:
                decoders[channel.id] = factory.decoder_for(channel.message_encoding, schema)
            try:
                decoded = decoders[channel.id](message.data)
            except Exception as e:
                raise Fail(f"{topic}: message at {log} does not decode as {schema.name}: {type(e).__name__}: {e}") from e
            counts[topic] += 1
            first.setdefault(topic, log)
            need(log >= last_log.get(topic, 0), f"{topic}: log time goes back at {log}")
            need(message.publish_time == log, f"{topic}: publish time {message.publish_time} differs from log time {log}")
            last_log[topic] = log
            stamp = getattr(getattr(decoded, "header", None), "stamp", None)
            if stamp is not None:
                ns = nanoseconds(stamp)
                need(ns >= last_stamp.get(topic, 0), f"{topic}: header.stamp goes back at {ns}")
                need(abs(ns - log) <= skew, f"{topic}: header.stamp {ns} is {abs(ns - log) / 1e9} s from log time {log}")
                last_stamp[topic] = ns
            if topic == "/tf":
                motion.on_tf(log, decoded)
            elif topic == "/fleet_states":
                motion.on_fleet(log, decoded)

        total = sum(counts.values())
        need(total == summary.statistics.message_count, f"decoded {total} of {summary.statistics.message_count} messages")
        for c in channels.values():
            need(
                counts[c.topic] == summary.statistics.channel_message_counts.get(c.id, 0),
                f"{c.topic}: count differs from the statistics record",
            )

    need(total, "the bag is empty")
    start = min(first.values())
    for topic in a.latched:
        need(counts.get(topic), f"{topic}: latched topic has no message")
        need(first[topic] - start <= 10**9, f"{topic}: first message comes {(first[topic] - start) / 1e9} s after the start")
        qos = yaml.safe_load(channels[topic].metadata.get("offered_qos_profiles") or "[]")
        need(qos and qos[0]["durability"] in (1, "transient_local"), f"{topic}: QoS durability is not transient local")
    moving = motion.moving()
    need(len(moving) >= a.min_moving, f"only {len(moving)} of {len(motion.box)} robots move more than {MOVED} m, expected {a.min_moving}")
    if (files[0].parent / "metadata.yaml").exists():
        check_metadata(files[0].parent / "metadata.yaml", counts)

    for topic in sorted(counts):
        print(f"{counts[topic]:8d}  {topic}  {summary.schemas[channels[topic].schema_id].name}")
    print(
        f"OK: {total} messages of {len(channels)} topics decoded in {len(summary.chunk_indexes)} chunks "
        f"({', '.join(sorted({c.compression or 'uncompressed' for c in summary.chunk_indexes}))}), "
        f"{len(moving)} of {len(motion.box)} robots move, {motion.compared} fleet positions equal to /tf"
    )


if __name__ == "__main__":
    try:
        main()
    except Fail as e:
        sys.exit(f"FAIL: {e}")
    except Exception as e:  # unreadable or damaged file: whatever the reader raised
        sys.exit(f"FAIL: {type(e).__name__}: {e}")
