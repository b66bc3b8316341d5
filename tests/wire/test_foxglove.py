"""A run in Foxglove, watched by a client of its WebSocket."""

import json
import socket
import struct
import subprocess
import sys

import pytest
from rosbags.highlevel import AnyReader

from mrp_sumo.bags.messages import EPOCH_NS
from mrp_sumo.cli.main import main
from mrp_sumo.wire.foxglove import FoxgloveView

pytest.importorskip("foxglove")
MESSAGE, STATE, CONTROL, PLAY = 1, 5, 3, 0
PLAYBACK_CONTROL = "<BBfBQI"  # opcode, command, speed, whether to seek, where, length of the request's name


def free_port():
    with socket.socket() as result:
        result.bind(("127.0.0.1", 0))
        return result.getsockname()[1]


def connected(address, **options):
    client = pytest.importorskip("websockets.sync.client")
    return client.connect(address, subprotocols=["foxglove.sdk.v1"], max_size=None, open_timeout=60, **options)


def address_of(program, port):
    address, _, app = program.stdout.readline().partition(", in Foxglove: ")
    assert address.startswith(f"ws://127.0.0.1:{port}/") and app.startswith("https://app.foxglove.dev/") and address in app
    return address


@pytest.mark.slow
def test_client_reads_the_messages_of_the_bag_and_goes_back_and_the_files_are_those_of_an_unwatched_run(tmp_path):
    port, scenario = free_port(), ["office_doors", "--set", "record.bag=true"]
    run = [sys.executable, "-m", "mrp_sumo", "run", *scenario]
    watched = [*run, "--foxglove", "--port", str(port), "--speed", "4", "--out", tmp_path / "watched"]
    channels, said, back, request = {}, {}, [], False
    with subprocess.Popen(watched, stdout=subprocess.PIPE, text=True) as program, connected(address_of(program, port)) as viewer:
        for data in viewer:
            if isinstance(data, str):
                document = json.loads(data)
                if document["op"] == "serverInfo":
                    assert "playbackControl" in document["capabilities"] and document["dataStartTime"]["sec"] * 10**9 == EPOCH_NS
                if document["op"] == "advertise":
                    channels |= {each["id"]: each for each in document["channels"]}
                    new = [{"id": each["id"], "channelId": each["id"]} for each in document["channels"]]
                    viewer.send(json.dumps({"op": "subscribe", "subscriptions": new}))
            elif data[0] == MESSAGE:
                channel, ns = struct.unpack_from("<IQ", data, 1)
                said.setdefault(channels[channel]["topic"], {})[ns - EPOCH_NS] = data[13:]
                if not request and ns - EPOCH_NS > 10 * 10**9:
                    request = True
                    viewer.send(struct.pack(PLAYBACK_CONTROL, CONTROL, PLAY, 1000.0, 1, EPOCH_NS + 2 * 10**9, 4) + b"back")
            elif data[0] == STATE and data.endswith(b"back"):
                back.append(struct.unpack_from("<Q", data, 2)[0] - EPOCH_NS)
        assert "completed" in program.stdout.read()
    assert program.returncode == 0 and back == [2 * 10**9]
    with AnyReader([tmp_path / "watched" / "bag"]) as reader:
        bag = {}
        for connection, ns, raw in reader.messages():
            bag.setdefault(connection.topic, {})[ns - EPOCH_NS] = bytes(raw)
        tf = next(each for each in channels.values() if each["topic"] == "/tf")
        assert (tf["encoding"], tf["schemaName"], tf["schemaEncoding"]) == ("cdr", "tf2_msgs/msg/TFMessage", "ros2msg")
    for topic in ("/tf", "/robot_cloud", "/fleet_states", "/metrics/robots_moving"):
        late = {ns: message for ns, message in bag[topic].items() if ns > 10**9}
        assert len(late) > 30 and {ns: said[topic][ns] for ns in late} == late
    assert set(said["/map"].values()) == set(bag["/map"].values())

    subprocess.run([*run, "--out", tmp_path / "unwatched"], check=True, stdout=subprocess.DEVNULL)
    files = sorted(path.relative_to(tmp_path / "unwatched") for path in (tmp_path / "unwatched").rglob("*") if path.is_file())
    assert len(files) > 10
    same = [path for path in files if (tmp_path / "unwatched" / path).read_bytes() == (tmp_path / "watched" / path).read_bytes()]
    assert {path.name for path in set(files) - set(same)} <= {"result.json", "summary.txt"}  # they have clock times


def test_foxglove_that_is_not_to_be_had_is_one_line(tmp_path, capsys, monkeypatch):
    out = ["--out", str(tmp_path / "run")]
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        assert main(["run", "office_5", "--foxglove", "--port", port, *out]) == 2
    assert capsys.readouterr().err == f"mrp-sumo: --port {port}: Address already in use\n"
    assert main(["run", "office_5", "--foxglove", "--port", "70000", *out]) == 2
    assert capsys.readouterr().err == "mrp-sumo: --port: found '70000', expected a whole number up to 65535\n"
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(Exception, match=r"--foxglove needs foxglove-sdk: pip install 'mrp-sumo\[live\]'"):
        FoxgloveView()
    assert not (tmp_path / "run").exists()
