"""A run over DDS, heard by a process of its own that knows ROS 2's names and types and nothing of ours."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from rosbags.highlevel import AnyReader

from mrp_sumo.cli.main import main

pytest.importorskip("cyclonedds")
NODE = Path(__file__).parents[1] / "data" / "bag_checkers" / "hear_dds.py"
DOMAIN = str(100 + os.getpid() % 100)


@pytest.mark.slow
def test_a_node_hears_what_the_bag_says(tmp_path):
    topics = ("/fleet_states", "/door_states", "/clock")
    heard_file = tmp_path / "heard"
    with heard_file.open("w") as out, subprocess.Popen([sys.executable, NODE, DOMAIN, *topics], stdout=out, text=True) as node:
        while not heard_file.read_text().startswith("ready\n"):
            assert node.poll() is None
            time.sleep(0.05)
        ran = ["run", "office_doors", "--dds", "--domain", DOMAIN, "--speed", "20", "--out", str(tmp_path / "run")]
        assert main(ran) == 0
        node.kill()
    lines = [line.split() for line in heard_file.read_text().splitlines()[1:]]
    heard = {topic: [bytes.fromhex(text) for name, text in lines if name == topic] for topic in topics}
    with AnyReader([tmp_path / "run" / "bag"]) as reader:
        bag = {topic: [bytes(raw) for c, _, raw in reader.messages() if c.topic == topic] for topic in topics[:2]}
    for topic, said in bag.items():
        assert len(said) > 100
        assert len(heard[topic]) > 0.8 * len(said)  # all but those before the node was found, and those that a busy machine lets it miss
        rest = iter(said)
        assert all(one in rest for one in heard[topic]), "each as it is in the bag, in its order"
    assert len(heard["/clock"]) > 500


def test_dds_that_is_not_to_be_had_is_one_line(tmp_path, capsys, monkeypatch):
    out = ["--out", str(tmp_path / "run")]
    cases = {
        ("--dds", "--domain", "300"): "--domain 300: expected 0 to 232",
        (
            "--dds",
            "--interface",
            "203.0.113.7",
        ): "--interface 203.0.113.7: expected the IPv4 address of a network interface of this machine",
        ("--dds", "--speed", "0"): "--speed: found 0, expected 0.001 or more",
        ("--dds", "--live", "--speed", "2"): "--speed is for --dds and --foxglove without --live",
        ("--domain", "3"): "--domain is for --dds",
    }
    for options, line in cases.items():
        assert main(["run", "office_5", *options, *out]) == 2
        assert capsys.readouterr().err.startswith(f"mrp-sumo: {line}")
    monkeypatch.setitem(sys.modules, "cyclonedds.domain", None)
    assert main(["run", "office_5", "--dds", *out]) == 2
    assert capsys.readouterr().err == "mrp-sumo: --dds needs cyclonedds: pip install 'mrp-sumo[dds]'\n"
    assert not (tmp_path / "run").exists()
