"""Bags: other people's readers open them, every byte is the library's own, equal runs give equal bags."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rosbags.rosbag2.metadata
import rosbags.rosbag2.writer
from golden import BAG_CHECKERS
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import Reader
from worlds import LENGTH, record_of_four

from mrp_sumo.bags import writer
from mrp_sumo.bags.messages import EPOCH_NS, GENERATIONS, Messages, ros_names, typestore
from mrp_sumo.bags.reader import read_fleet_log
from mrp_sumo.bags.streams import Samples, transforms
from mrp_sumo.bags.writer import BagOptions, write_bag
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.io.record import AT_GOAL, BLOCKED, MOVING, robot_states

PROJECT = Path(__file__).resolve().parents[2]
MODULES = PROJECT / ".venv" / "node" / "node_modules"
TOPICS = {
    "/tf", "/tf_static", "/map", "/map_markers", "/robot_markers", "/plan_markers", "/robot_cloud", "/fleet_states",
    "/robot_path_requests", "/rosout", "/diagnostics",
}  # fmt: skip
DETAILED = BagOptions(robots=("robot_1",), poses=True)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bags") / "bag"
    write_bag(folder, record_of_four(), DETAILED)
    return folder


def decoded(bag, generation="jazzy"):
    """[(topic, ns, message)] in the order of the file's index."""
    store = typestore(generation)
    with Reader(bag) as reader:
        return [(c.topic, ns, store.deserialize_cdr(raw, c.msgtype)) for c, ns, raw in reader.messages()]


@pytest.mark.parametrize("absent", [False, True])
def test_foxgloves_reader_accepts_the_bag(tmp_path, absent):
    write_bag(tmp_path / "bag", record_of_four(absent=absent), DETAILED)
    latched = ["/map", "/tf_static", "/map_markers", "/robot_markers", "/plan_markers", "/robot_1/plan"]
    command = [sys.executable, str(BAG_CHECKERS / "verify_mcap.py"), str(tmp_path / "bag"), "--latched", *latched, "--min-moving", "3"]
    output = subprocess.run(command, capture_output=True, text=True, check=False)
    assert output.returncode == 0 and "OK:" in output.stdout, output.stdout + output.stderr


def test_foxgloves_reader_for_browsers_accepts_the_bag(bag, tmp_path):
    if not shutil.which("node") or not (MODULES / "@mcap" / "core").is_dir():
        pytest.skip("no node, or no mcap readers from npm (tools/ci_tools.sh installs them)")
    (tmp_path / "node_modules").symlink_to(MODULES)  # modules are looked for beside the script
    script = shutil.copy(BAG_CHECKERS / "check.mjs", tmp_path)
    latched = "--latched=/map,/tf_static,/map_markers,/robot_markers,/plan_markers,/robot_1/plan"
    output = subprocess.run(["node", script, str(bag), latched, "--min-moving=3"], capture_output=True, text=True, check=False)
    assert output.returncode == 0 and "OK:" in output.stdout, output.stdout + output.stderr


@pytest.mark.slow
def test_the_rosbag_of_ros_1_accepts_the_converted_bag(bag):
    converter = Path(sys.executable).with_name("rosbags-convert")
    if (
        not shutil.which("rosbag")
        or subprocess.run(["/usr/bin/python3", "-c", "import rosbag"], capture_output=True, check=False).returncode
    ):
        pytest.skip("no ROS 1 rosbag (Debian's python3-rosbag; tools/ci_tools.sh installs it)")
    command = [BAG_CHECKERS / "ros1.sh", bag, "/map", "/tf_static", "/map_markers", "/robot_markers", "/plan_markers", "/robot_1/plan"]
    output = subprocess.run(command, capture_output=True, text=True, check=False, env={**os.environ, "ROSBAGS_CONVERT": str(converter)})
    assert output.returncode == 0 and "OK:" in output.stdout, output.stdout + output.stderr


@pytest.mark.parametrize("generation", GENERATIONS)
def test_cyclone_dds_accepts_sqlite_bags_of_every_generation(tmp_path, generation):
    pytest.importorskip("cyclonedds", reason="no cyclonedds for this machine")
    write_bag(tmp_path / "bag", record_of_four(seconds=3.0), BagOptions(storage="sqlite3", rmf=generation, robots=("robot_0",), poses=True))
    command = [sys.executable, "-W", "ignore", str(BAG_CHECKERS / "verify_cyclone.py"), str(tmp_path / "bag"), "--rmf", generation]
    output = subprocess.run(command, capture_output=True, text=True, check=False)
    assert output.returncode == 0 and "OK:" in output.stdout, output.stdout + output.stderr


@pytest.mark.parametrize("generation", GENERATIONS)
def test_every_byte_is_what_the_library_would_write(tmp_path, generation):
    """Streams are templates with numbers set; decoding and serialising again must give the same bytes."""
    write_bag(tmp_path / "bag", record_of_four(absent=True), BagOptions(rmf=generation, robots=("robot_0", "robot_2"), poses=True))
    store, seen = typestore(generation), set()
    with Reader(tmp_path / "bag") as reader:
        for connection, _, raw in reader.messages():
            again = store.serialize_cdr(store.deserialize_cdr(raw, connection.msgtype), connection.msgtype)
            assert bytes(again) == bytes(raw), connection.topic
            seen.add(connection.topic)
    assert TOPICS | {"/robot_poses", "/robot_0/odom", "/robot_2/plan", "/metrics/robots_blocked"} <= seen


def test_tf_carries_the_trajectory(bag):
    record = record_of_four()
    transforms = [(ns, m) for topic, ns, m in decoded(bag) if topic == "/tf"]
    assert len(transforms) == len(record.execution.t_s)
    for k, (ns, message) in enumerate(transforms):
        assert ns == EPOCH_NS + k * 100_000_000
        for r, t in enumerate(message.transforms):
            assert t.header.frame_id == "map" and t.child_frame_id == f"robot_{r}/base_link"
            assert t.header.stamp.sec * 10**9 + t.header.stamp.nanosec == ns
            assert (t.transform.translation.x, t.transform.translation.y) == (record.execution.x_m[k, r], record.execution.y_m[k, r])
            yaw = 2 * np.arctan2(t.transform.rotation.z, t.transform.rotation.w)
            assert yaw == pytest.approx(record.execution.yaw_rad[k, r])


def test_poses_are_those_of_tf(bag):
    said = decoded(bag)
    moved = [
        [(t.transform.translation.x, t.transform.translation.y, t.transform.rotation.z) for t in m.transforms]
        for n, _, m in said
        if n == "/tf"
    ]
    posed = [[(p.position.x, p.position.y, p.orientation.z) for p in m.poses] for n, _, m in said if n == "/robot_poses"]
    assert posed == moved and len(posed) == len(record_of_four().execution.t_s)


def test_cloud_says_who_is_blocked(bag):
    dtype = np.dtype({"names": ["x", "id", "blocked"], "formats": ["<f4", "<u4", "u1"], "offsets": [0, 24, 28], "itemsize": 32})
    clouds = [m.data.view(dtype) for topic, _, m in decoded(bag) if topic == "/robot_cloud"]
    assert [c["blocked"].tolist() for c in (clouds[25], clouds[35], clouds[65])] == [[0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 0]]
    assert clouds[10]["id"].tolist() == [0, 1, 2, 3] and clouds[10]["x"][0] == np.float32(1.0)


def test_fleet_states_come_twice_a_second_with_mode_and_task(bag):
    fleets = [(ns, m) for topic, ns, m in decoded(bag) if topic == "/fleet_states"]
    assert [ns - EPOCH_NS for ns, _ in fleets] == [k * 500_000_000 for k in range(25)]
    assert [r.mode.mode for r in fleets[2][1].robots] == [2, 2, 2, 0]  # moving, moving, moving, at its goal
    assert [r.mode.mode for r in fleets[9][1].robots] == [2, 4, 2, 0]  # robot_1 waits
    assert fleets[3][1].robots[0].seq == 3 and fleets[3][1].robots[3].task_id == f"v{3 * LENGTH}"


def test_plan_is_requested_with_its_times(bag):
    requests = [m for topic, _, m in decoded(bag) if topic == "/robot_path_requests"]
    assert [r.robot_name for r in requests] == [f"robot_{i}" for i in range(4)]
    assert [(p.t.sec - 1_700_000_000, p.x) for p in requests[1].path] == [(k, float(k)) for k in range(8)]


def test_graph_markers_are_what_mrp_bench_reads(bag):
    (markers,) = [m.markers for topic, _, m in decoded(bag) if topic == "/map_markers"]
    vertices, lanes, *names = markers
    assert (vertices.type, lanes.type, {n.type for n in names}) == (8, 5, {9})
    points = {(p.x, p.y) for p in vertices.points}
    assert len(points) == 4 * LENGTH and {(p.x, p.y) for p in lanes.points} <= points
    assert len(lanes.points) == 2 * 4 * (LENGTH - 1)
    label = names[0]
    assert label.text == "dock <1>"
    assert label.pose.position.x == 0.4 * np.cos(0.7853) and label.pose.position.y == 0.4 * np.sin(0.7853)


def test_map_shows_walls_and_without_them_where_no_lane_leads(bag, tmp_path):
    (grid,) = [m for topic, _, m in decoded(bag) if topic == "/map"]
    cells = grid.data.reshape(grid.info.height, grid.info.width)
    assert (cells[0] == 100).all() and (cells[1, 1:] == 0).all()
    assert (grid.info.origin.position.x, grid.info.origin.position.y) == (-1.0, -1.5)
    write_bag(tmp_path / "bag", record_of_four(costmap=False))
    (grid,) = [m for topic, _, m in decoded(tmp_path / "bag") if topic == "/map"]
    assert (grid.info.width, grid.info.height, grid.info.resolution) == (LENGTH, 4, 1.0)


def test_events_are_json_in_rosout(bag):
    logs = [(ns, m) for topic, ns, m in decoded(bag) if topic == "/rosout"]
    output = json.loads(logs[1][1].msg)
    assert output["kind"] == "blocked" and output["robot"] == "robot_1" and output["other"] == "robot_2" and output["duration_s"] == 3.0
    assert logs[1][0] == EPOCH_NS + 3 * 10**9 and logs[1][1].level == 30


def test_diagnostics_and_metrics_tell_the_state_each_second(bag):
    messages = decoded(bag)
    at_4 = next(m for topic, ns, m in messages if topic == "/diagnostics" and ns == EPOCH_NS + 4 * 10**9)
    assert [(s.level, s.message) for s in at_4.status] == [(0, "moving"), (1, "blocked"), (0, "moving"), (0, "at goal")]
    blocked = {(ns - EPOCH_NS) // 10**9: m.data for topic, ns, m in messages if topic == "/metrics/robots_blocked"}
    assert (blocked[2], blocked[4], blocked[7]) == (0.0, 1.0, 0.0)


def test_states_follow_speed_events_and_goals():
    record = record_of_four()
    state = robot_states(record.execution, np.array([1.0, 4.0, 8.0]))
    assert state.T.tolist() == [[MOVING, MOVING, AT_GOAL], [MOVING, BLOCKED, MOVING], [MOVING, MOVING, AT_GOAL], [AT_GOAL] * 3]


def test_equal_runs_give_equal_bags(tmp_path):
    digests = []
    for number in (1, 2):
        folder = tmp_path / str(number) / "bag"
        write_bag(folder, record_of_four(absent=True), DETAILED)
        digests.append([hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in ("bag.mcap", "metadata.yaml")])
    assert digests[0] == digests[1]


def test_latched_topics_are_said_again_on_request(tmp_path):
    write_bag(tmp_path / "bag", record_of_four(), BagOptions(repeat_latched_s=5.0))
    assert [(ns - EPOCH_NS) // 10**9 for topic, ns, _ in decoded(tmp_path / "bag") if topic == "/map"] == [0, 5, 10]


def test_names_become_tokens_of_ros_and_stay_apart():
    assert ros_names(["robot.1", "robot:1", "9", "", "Bär"]) == ["robot_1", "robot_1_2", "r_9", "_", "B_r"]


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_paths_with_odd_characters_are_fine(tmp_path, storage):
    bag = tmp_path / "a #1 ü%20?" / "bag"
    write_bag(bag, record_of_four(seconds=1.0), BagOptions(storage=storage))
    assert [p.stem for p in sorted(bag.iterdir())] == ["bag", "metadata"]
    assert read_fleet_log(bag).robot_name == ("robot_0", "robot_1", "robot_2", "robot_3")


def test_a_sqlite_bag_cannot_have_odd_characters_in_its_own_name(tmp_path):
    with pytest.raises(MrpSumoError, match="'a #1': the name of a sqlite3 bag cannot have a '#'"):
        write_bag(tmp_path / "a #1", record_of_four(seconds=1.0), BagOptions(storage="sqlite3"))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (BagOptions(storage="mcapp"), r"unknown storage 'mcapp' \(did you mean 'mcap'\?\)"),
        (BagOptions(rmf="jazy"), r"unknown generation 'jazy' of rmf_fleet_msgs \(did you mean 'jazzy'\?\)"),
        (BagOptions(robots=("robot_9",)), "'robot_9' is not a robot of 'four'"),
    ],
)
def test_unknown_options_are_refused_before_anything_is_written(tmp_path, options, message):
    with pytest.raises(MrpSumoError, match=message):
        write_bag(tmp_path / "bag", record_of_four(seconds=1.0), options)
    assert not (tmp_path / "bag").exists()


def test_a_folder_that_exists_is_refused(tmp_path):
    with pytest.raises(MrpSumoError, match="exists already"):
        write_bag(tmp_path, record_of_four(seconds=1.0))


def test_hashes_of_rmf_types_are_those_of_ros():
    known = {"galactic": "6cb960c0bb5a2bf2", "jazzy": "ab4c31fc97ae2ed5", "kilted": "9ea5bb9f2c076a58"}
    for generation, digest in known.items():
        assert typestore(generation).hash_rihs01("rmf_fleet_msgs/msg/FleetState").startswith(f"RIHS01_{digest}")


@pytest.mark.slow
def test_a_writer_that_is_killed_leaves_complete_chunks(tmp_path):
    """What was complete stays readable: a stream reader takes it, though there is no index."""
    from mcap.stream_reader import StreamReader

    code = (
        "import os, sys\nsys.path.insert(0, sys.argv[2])\n"
        "from pathlib import Path\nfrom worlds import record_of_four\nfrom mrp_sumo.bags import parts, writer\n"
        "parts.FastWriter.close = lambda self: os._exit(9)\n"
        "writer.write_bag(Path(sys.argv[1]), record_of_four(seconds=1500.0))\n"
    )
    output = subprocess.run([sys.executable, "-c", code, str(tmp_path / "bag"), str(Path(__file__).parents[1])], check=False)
    assert output.returncode == 9 and [p.name for p in (tmp_path / "bag").iterdir()] == ["bag.mcap"]
    kinds = set()
    with (tmp_path / "bag" / "bag.mcap").open("rb") as stream:
        try:
            for item in StreamReader(stream).records:
                kinds.add(type(item).__name__)
        except Exception:  # the end is missing, whatever the reader says of it
            pass
    assert {"Message", "Channel", "Schema"} <= kinds


def test_every_reader_of_the_library_counts_the_same(bag):
    with AnyReader([bag], default_typestore=typestore("jazzy")) as reader:
        assert reader.message_count == len(decoded(bag))
        qos = {c.topic: c.ext.offered_qos_profiles[0] for c in reader.connections}
    assert qos["/map"].durability.name == "TRANSIENT_LOCAL" and qos["/tf"].durability.name == "VOLATILE"
    assert qos["/rosout"].durability.name == "TRANSIENT_LOCAL" and qos["/robot_poses"].durability.name == "VOLATILE"
    assert qos["/tf"].depth == 100 and qos["/rosout"].depth == 1000


def test_moments_without_any_robot_are_silent_but_stamped(tmp_path):
    record = record_of_four(seconds=4.0)
    columns = {name: np.array(getattr(record.execution, name)) for name in ("x_m", "y_m", "yaw_rad", "speed_mps")}
    for column in columns.values():
        column[:20] = np.nan
    write_bag(tmp_path / "bag", replace(record, execution=replace(record.execution, **columns)), DETAILED)
    messages = decoded(tmp_path / "bag")
    clouds = [(ns, m) for topic, ns, m in messages if topic == "/robot_cloud"]
    assert [m.width for _, m in clouds[18:22]] == [0, 0, 4, 4]
    assert all(m.header.stamp.sec * 10**9 + m.header.stamp.nanosec == ns for ns, m in clouds)
    assert [len(m.robots) for topic, _, m in messages if topic == "/fleet_states"][:5] == [0, 0, 0, 0, 4]
    assert sum(topic == "/robot_1/odom" for topic, _, _ in messages) == 21


def test_templates_hold_for_robots_that_come_later():
    messages = Messages(record_of_four(absent=True))
    samples = Samples(messages.record, np.arange(0, 5 * 10**9, 10**9, dtype=np.int64))
    stream = transforms(messages, samples)
    counts = [len(messages.typestore.deserialize_cdr(stream.message(k), "tf2_msgs/msg/TFMessage").transforms) for k in range(5)]
    assert counts == [3, 3, 4, 4, 4]


@pytest.mark.parametrize("generation", GENERATIONS)
@pytest.mark.parametrize("length", range(1, 9))
def test_requests_are_right_however_the_names_align(generation, length):
    record = record_of_four()
    fleet = replace(record.fleet, robot_name=tuple(chr(97 + i) * length for i in range(4)))
    messages = Messages(replace(record, fleet=fleet), generation)
    for i, raw in enumerate(messages.path_requests()):
        request = messages.typestore.deserialize_cdr(raw, "rmf_fleet_msgs/msg/PathRequest")
        assert bytes(messages.typestore.serialize_cdr(request, "rmf_fleet_msgs/msg/PathRequest")) == raw
        visits = slice(record.plan.first[i], record.plan.first[i + 1])
        assert [p.index for p in request.path] == record.plan.vertex[visits].tolist()
        assert [p.t.sec - 1_700_000_000 for p in request.path] == record.plan.arrive_s[visits].tolist()
        assert [(p.x, p.y) for p in request.path] == list(map(tuple, record.graph.xy[record.plan.vertex[visits]]))
        assert (request.robot_name, len(request.path)) == (fleet.robot_name[i], visits.stop - visits.start)


@pytest.mark.parametrize("generation", GENERATIONS)
def test_levels_are_named_where_there_are_several(tmp_path, generation):
    """The right half of the corridors is upstairs: states and requests say so, and still are the library's bytes."""
    record = record_of_four(seconds=8.0)
    upstairs = (record.graph.xy[:, 0] > 3.5).astype(np.int64)
    graph = replace(record.graph, level=upstairs, level_names=("ground", "first floor"))
    write_bag(tmp_path / "bag", replace(record, graph=graph), BagOptions(rmf=generation))
    store = typestore(generation)
    with Reader(tmp_path / "bag") as reader:
        for connection, _, raw in reader.messages():
            assert bytes(store.serialize_cdr(store.deserialize_cdr(raw, connection.msgtype), connection.msgtype)) == bytes(raw)
    messages = decoded(tmp_path / "bag", generation)
    fleets = [m for topic, _, m in messages if topic == "/fleet_states"]
    assert [[r.location.level_name[0] for r in m.robots] for m in (fleets[0], fleets[8], fleets[15])] == [
        ["g", "g", "g", "g"],
        ["f", "g", "f", "g"],
        ["f", "f", "f", "g"],
    ]
    requests = [m for topic, _, m in messages if topic == "/robot_path_requests"]
    assert [p.level_name for p in requests[0].path] == ["ground"] * 4 + ["first floor"] * 4
    assert {p.level_name for p in requests[3].path} == {"ground"}


def test_the_library_is_the_same_for_others_in_the_process():
    assert rosbags.rosbag2.writer.dump_qos_v8 is rosbags.rosbag2.metadata.dump_qos_v8


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_split_bag_is_read_as_one_and_says_latched_topics_in_every_part(tmp_path, storage, monkeypatch):
    record, latched = (
        record_of_four(absent=True),
        {"/map", "/tf_static", "/map_markers", "/robot_markers", "/plan_markers", "/robot_1/plan"},
    )
    options = replace(DETAILED, storage=storage)
    write_bag(tmp_path / "whole", record, options)
    monkeypatch.setattr(writer, "SAMPLES_TOGETHER", 40)  # of 4 robots: blocks of a second, which begin within parts
    write_bag(tmp_path / "bag", record, replace(options, split_s=2.5))
    suffix = "mcap" if storage == "mcap" else "db3"
    assert sorted(p.name for p in (tmp_path / "bag").iterdir()) == [*(f"bag_{k}.{suffix}" for k in range(5)), "metadata.yaml"]
    with Reader(tmp_path / "whole") as one, Reader(tmp_path / "bag") as parts:
        whole, split = ([(c.topic, ns, bytes(raw)) for c, ns, raw in reader.messages()] for reader in (one, parts))
        assert (parts.duration, parts.message_count) == (one.duration, len(split))
        assert {c.topic: c.msgcount for c in parts.connections}["/map"] == 5
    repeated = [m for m in split if m[0] in latched and m[1] > EPOCH_NS and m not in whole]
    assert [m for m in split if m not in repeated] == whole
    assert sorted(m[0] for m in repeated) == sorted(4 * list(latched))
    log, again = read_fleet_log(tmp_path / "whole"), read_fleet_log(tmp_path / "bag")
    assert np.array_equal(log.x_m, again.x_m, equal_nan=True) and np.array_equal(log.t_ns, again.t_ns)
