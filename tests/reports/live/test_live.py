"""A run that is watched: the same files as without, pause and step, and nothing for those who do not know the address."""

import base64
import json
import socket
import threading
import time
import urllib.error
import urllib.request

import numpy as np
import pytest

from mrp_sumo.cli.main import main
from mrp_sumo.experiments.run import RunOptions, run_scenario
from mrp_sumo.io.run_reader import load_run
from mrp_sumo.io.scenario.file import find_scenario
from mrp_sumo.io.scenario.read import read_scenario, scenario_of
from mrp_sumo.reports.live.broadcast import Broadcast
from mrp_sumo.reports.live.server import LiveServer
from mrp_sumo.reports.live.watch import SAMPLE, LiveView
from mrp_sumo.reports.pictures.view import ABSENT, parts_of


def messages_of(address):
    """(name, data) of everything that a viewer is sent."""
    with urllib.request.urlopen(f"{address}events", timeout=60) as stream:
        text = stream.read().decode()
    parts = [part.split("\n") for part in text.split("\n\n") if part.startswith("event")]
    return [(name.removeprefix("event: "), data.removeprefix("data: ")) for name, data in parts]


def test_watched_run_has_the_same_files_and_says_every_sample(folder, tmp_path):
    live, outcome = LiveView(), []
    viewer = threading.Thread(target=lambda: outcome.extend(messages_of(live.address)))
    viewer.start()
    live.broadcast.control({"do": "speed", "speed": None})
    overrides = {("planner", "name"): ("--planner", "prioritised"), ("record", "bag"): ("", False)}
    result = run_scenario(read_scenario(find_scenario("office_5"), overrides), tmp_path / "run", RunOptions(watches=[live.watch]))
    with urllib.request.urlopen(live.address, timeout=60) as page:
        assert b'"live":true' in page.read()
    live.finish(result)
    viewer.join()

    files = sorted(path.name for path in (tmp_path / "run").iterdir() if path.is_file() and path.name != "result.json")
    different = [name for name in files if (tmp_path / "run" / name).read_bytes() != (folder / name).read_bytes()]
    assert not different and "trajectory.parquet" in files

    samples = np.frombuffer(b"".join(base64.b64decode(data) for name, data in outcome if name == "samples"), SAMPLE)
    driven = load_run(folder).execution
    x = samples["x"].reshape(-1, driven.num_robots) * 0.005
    assert x.shape == driven.x_m.shape
    assert np.abs((x - x[0]) - (driven.x_m - driven.x_m[0])).max() < 0.02
    said = [event for name, data in outcome if name == "events" for event in json.loads(data)]
    assert sorted((t / 1000, kind) for t, kind, *_ in said) == sorted((round(e.t_s, 3), e.kind) for e in driven.events)
    assert outcome[-1][0] == "end" and json.loads(outcome[-1][1])["status_text"] == "completed"


def test_watched_vehicles_are_on_their_arcs_with_trailers_and_loads(tmp_path):
    tugger = {"length_m": 1.4, "width_m": 0.8, "max_speed_mps": 1.2, "accel_mps2": 0.3, "decel_mps2": 0.5}
    tugger |= {"kinematics": {"kind": "tugger", "wheelbase_m": 0.9, "steering_max_rad": 0.7}, "loaded": {"width_m": 1.0}}
    tugger |= {"trailers": [{"length_m": 0.75, "hitch_m": 0.6, "width_m": 0.7, "body_m": 1.1}] * 2}
    stream = {"name": "raw", "arrivals": {"at_once": True}, "count": 2, "stops": ["B1", "R2"]}
    scenario = {
        **{"map": "plant", "discretisation": {"kind": "roadmap", "cell_m": 7, "clearance": "ignore"}, "planner": "lacam"},
        **{"robots": {"type": tugger, "starts": ["B2", "T3"], "goals": ["B2", "T3"]}, "tasks": {"streams": [stream]}},
        **{"execution": {"engine": "kinematic", "time_limit_s": 150}, "record": {"bag": False, "period_s": 0.5}},
    }
    live, outcome = LiveView(), []
    viewer = threading.Thread(target=lambda: outcome.extend(messages_of(live.address)))
    viewer.start()
    live.broadcast.control({"do": "speed", "speed": None})
    result = run_scenario(scenario_of(scenario, tmp_path, "milk"), tmp_path / "run", RunOptions(watches=[live.watch]))
    live.finish(result)
    viewer.join()
    record = load_run(tmp_path / "run").record
    execution, parts = record.execution, parts_of(record.execution, record.fleet)
    assert len(parts.owner) == 6 and not np.isnan(parts.x_m[:, 4:]).all()  # two trailers each, and each with a load for a while
    samples = np.frombuffer(b"".join(base64.b64decode(data) for name, data in outcome if name == "samples"), SAMPLE).reshape(-1, 8)
    x, y, yaw = (np.hstack([getattr(execution, name), getattr(parts, name)]) for name in ("x_m", "y_m", "yaw_rad"))
    assert samples.shape == x.shape
    is_there = samples["state"] != ABSENT
    assert (is_there == ~np.isnan(x)).mean() > 0.99  # but for the sample in which a load comes on board
    both = is_there & ~np.isnan(x)
    for name, driven in (("x", x), ("y", y)):
        assert np.abs(samples[name] * 0.005 - (driven - driven[0, 0]) - samples[name][0, 0] * 0.005)[both].max() < 0.02
    off = (samples["yaw"] * (np.pi / 128) - yaw + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(off[both]).max() < 0.03


def test_paused_run_makes_one_sample_for_each_step_that_is_asked_for():
    broadcast, seen = Broadcast(), []
    broadcast.begin(1)
    broadcast.control({"do": "speed", "speed": None})
    broadcast.control({"do": "pause"})
    viewer = threading.Thread(target=lambda: seen.extend(broadcast.stream()))
    viewer.start()
    while not broadcast._viewers:
        pass
    driver = threading.Thread(target=lambda: [broadcast.sample(bytes([k]), 0.1) for k in range(3)] and broadcast.end())
    driver.start()
    broadcast.control({"do": "step"})
    broadcast.control({"do": "step"})
    until = time.monotonic() + 60
    while len(broadcast._samples) < 3 and time.monotonic() < until:
        driver.join(0.01)
    driver.join(0.1)
    assert driver.is_alive() and broadcast._samples == b"\0\1\2"  # the third is out, and holds the run
    broadcast.control({"do": "play"})
    driver.join(60)
    viewer.join(60)
    assert b"".join(samples for _, samples in seen) == b"\0\1\2"


def test_nobody_watching_holds_no_run_up():
    broadcast = Broadcast()
    broadcast.control({"do": "speed", "speed": None})
    broadcast.control({"do": "pause"})
    broadcast.sample(b"x", 0.1)
    broadcast.end()


def test_only_who_knows_the_address_may_watch_and_steer():
    server = LiveServer(Broadcast())
    server.start()
    root = f"{server.address.rsplit('/', 2)[0]}/"

    def status(address, order=None):
        try:
            with urllib.request.urlopen(address, data=order, timeout=60) as answer:
                return answer.status
        except urllib.error.HTTPError as error:
            return error.code

    try:
        assert server.address.startswith("http://127.0.0.1:")
        assert [status(root), status(f"{root}events"), status(f"{root}control", b"{}")] == [403] * 3 and status(f"{server.address}x") == 404
        assert status(server.address) == 200
        orders = (b'{"do":"pause"}', b'{"do":"speed","speed":0}', b'{"do":"fly"}', b"{", b"[1]", b"[" * 900)
        assert [status(f"{server.address}control", order) for order in orders] == [204, 400, 400, 400, 400, 400]
    finally:
        server.close()


@pytest.mark.parametrize(("port", "message"), [("taken", "Address already in use"), ("70000", "expected a whole number up to 65535")])
def test_port_that_cannot_be_had_is_one_line(tmp_path, monkeypatch, capsys, port, message):
    monkeypatch.chdir(tmp_path)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        number = str(taken.getsockname()[1]) if port == "taken" else port
        assert main(["run", "office_5", "--live", "--port", number]) == 2
    said = capsys.readouterr().err
    assert message in said and len(said.splitlines()) == 1


def test_port_without_live_is_refused(capsys):
    assert main(["run", "office_5", "--port", "8000"]) == 2
    assert "--port is for --live" in capsys.readouterr().err
