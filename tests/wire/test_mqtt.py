"""Vehicles at a real broker, on the loopback: what is said when connections come and go, and what is refused."""

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import pytest
import yaml
from wire.worlds import PLACES, scenario

from mrp_sumo.cli.main import main
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.formats.vda.messages import Dialect
from mrp_sumo.wire.link import Received
from mrp_sumo.wire.mqtt import Broker, Connections, MasterLink, VehicleLink, broker_at

pytest.importorskip("amqtt")


def free_port():
    with socket.socket() as result:
        result.bind(("127.0.0.1", 0))
        return result.getsockname()[1]


@pytest.fixture(scope="module")
def broker(tmp_path_factory):
    """A broker that lets `fleet` in, with the password `secret`."""
    folder = tmp_path_factory.mktemp("broker")
    with running(folder, one_user(folder)) as port:
        yield Broker("127.0.0.1", port, "fleet", "secret")


def one_user(folder):
    """The plugins of a broker that lets `fleet` in, with the password `secret`."""
    from pwdlib import PasswordHash
    from pwdlib.hashers.argon2 import Argon2Hasher

    (folder / "passwords").write_text(f"fleet:{PasswordHash((Argon2Hasher(),)).hash('secret')}\n")
    return {"amqtt.plugins.authentication.FileAuthPlugin": {"password_file": str(folder / "passwords")}}


@pytest.fixture
def open_port(tmp_path):
    """The port of a broker that lets everybody in."""
    with running(tmp_path, {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}}) as port:
        yield port


@contextmanager
def running(folder, plugins, **listener):
    """A broker on the loopback. Yields its port."""
    port = free_port()
    settings = {"listeners": {"default": {"type": "tcp", "bind": f"127.0.0.1:{port}", **listener}}, "plugins": plugins}
    (folder / "broker.yaml").write_text(yaml.safe_dump(settings))
    command = [sys.executable, "-m", "amqtt.scripts.broker_script", "-c", str(folder / "broker.yaml")]
    with (folder / "log").open("w") as log, subprocess.Popen(command, stdout=log, stderr=log) as process:
        for _ in range(1200):
            try:
                socket.create_connection(("127.0.0.1", port), 0.1).close()
                break
            except OSError:
                time.sleep(0.05)
        try:
            yield port
        finally:
            process.terminate()


@contextmanager
def theirs(script, *arguments):
    """A program of vda-5050-lib (npm, MIT), for version 2.0."""
    node, modules = shutil.which("node"), Path(sys.prefix) / "node" / "node_modules"
    if not node or not (modules / "vda-5050-lib").is_dir():
        pytest.skip("no node or vda-5050-lib (tools/ci_tools.sh installs it)")
    command = [node, str(Path(__file__).parent / "others" / script), *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env={**os.environ, "NODE_PATH": str(modules)}) as process:
        try:
            yield process
        finally:
            process.terminate()


@pytest.mark.slow
def test_our_master_drives_the_vehicles_of_others(open_port, tmp_path):
    scenario(tmp_path)
    with theirs("vehicles.cjs", open_port) as vehicles:
        assert vehicles.stdout.readline() == "ready\n"
        at = ["--broker", f"127.0.0.1:{open_port}", "--version", "2.0", "--as", "master"]
        assert main(["vda5050", str(tmp_path / "carts.yaml"), *at, "--out", str(tmp_path / "run")]) == 0
    result = json.loads((tmp_path / "run" / "result.json").read_text())
    assert result["status"] == "completed" and result["audit"]["num_overlaps"] == 0


@pytest.mark.slow
def test_the_master_of_others_drives_our_vehicles(open_port, tmp_path):
    scenario(tmp_path)
    at = ["--broker", f"127.0.0.1:{open_port}", "--version", "2.0", "--duration", "60"]
    command = [sys.executable, "-m", "mrp_sumo", "vda5050", str(tmp_path / "carts.yaml"), *at]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as fleet:
        assert "2 vehicles" in fleet.stdout.readline()
        with theirs("master.cjs", open_port, json.dumps(PLACES)) as master:
            said = master.stdout.read().splitlines()
        fleet.send_signal(signal.SIGINT)
        assert fleet.wait(120) == 0
    assert [line for line in said if "robot_0" in line] == [
        *("action robot_0 WAITING", "node robot_0 a", "node robot_0 b", "node robot_0 c"),
        *("action robot_0 RUNNING", "action robot_0 FINISHED", "processed robot_0 ok false false"),
    ]
    assert "processed robot_1 ok false false" in said


def heard(link, wanted):
    """What comes in until all that is wanted has, by vehicle and kind."""
    result, until = [], time.monotonic() + 60
    while time.monotonic() < until and not wanted <= {(one.serial, one.kind) for one in result}:
        result += link.receive(0.05)
    return result


@pytest.mark.slow
def test_broken_connection_is_said_by_the_broker(broker):
    dialect = Dialect("3.0")
    vehicles = VehicleLink(Connections(broker, dialect, "maker"))
    for serial in ("one", "two"):
        vehicles.join(serial, b'"online"', b'"broken"')
    master = MasterLink(Connections(broker, dialect, "maker"), frozenset(("one", "two")))
    master.join()
    both = {("one", "connection"), ("two", "connection")}
    assert {one.payload for one in heard(master, both)} == {b'"online"'}
    master.publish("two", "order", b"7")
    assert heard(vehicles, {("two", "order")}) == [Received("two", "order", b"7")]
    vehicles.connections._clients["one"].socket().shutdown(socket.SHUT_RDWR)
    assert Received("one", "connection", b'"broken"') in heard(master, {("one", "connection")})
    assert Received("one", "connection", b'"online"') in heard_while(master, vehicles)
    vehicles.close()
    master.close()


def heard_while(master, vehicles):
    """What the master hears while vehicles come back."""
    result, until = [], time.monotonic() + 60
    while time.monotonic() < until and not result:
        vehicles.receive(0.05)
        result += master.receive(0.05)
    return result


@pytest.mark.slow
def test_fleet_at_a_broker_from_the_command_line(broker, tmp_path, capsys):
    scenario(tmp_path)
    (tmp_path / "password").write_text("secret\n")
    at = ["--broker", f"127.0.0.1:{broker.port}", "--user", "fleet", "--password-file", str(tmp_path / "password")]
    log = tmp_path / "messages.jsonl"
    command = ["vda5050", str(tmp_path / "carts.yaml"), *at, "--duration", "3", "--speed", "10", "--log", str(log)]
    assert main(command) == 0
    assert "2 vehicles" in capsys.readouterr().out
    assert main(["validate", "--vda5050", str(log)]) == 0
    kinds = {json.loads(line)["topic"].rpartition("/")[2] for line in log.read_text().splitlines()}
    assert kinds == {"connection", "factsheet", "state", "visualization"}


@pytest.mark.slow
@pytest.mark.parametrize("version", ["2.1", "3.0"])
def test_our_master_drives_our_vehicles_through_a_broker_to_all_goals(broker, tmp_path, version):
    scenario(tmp_path)
    (tmp_path / "password").write_text("secret\n")
    at = ["vda5050", str(tmp_path / "carts.yaml"), "--broker", f"127.0.0.1:{broker.port}", "--user", "fleet", "--version", version]
    at += ["--password-file", str(tmp_path / "password"), "--speed", "10"]
    command = [sys.executable, "-m", "mrp_sumo", *at, "--duration", "600", "--log", str(tmp_path / "fleet.jsonl")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as fleet:
        assert "2 vehicles" in fleet.stdout.readline()
        assert main([*at, "--as", "master", "--out", str(tmp_path / "run"), "--log", str(tmp_path / "master.jsonl")]) == 0
        fleet.send_signal(signal.SIGINT)
        assert fleet.wait(120) == 0
    result = json.loads((tmp_path / "run" / "result.json").read_text())
    assert result["status"] == "completed" and result["audit"]["num_overlaps"] == 0
    for name in ("fleet.jsonl", "master.jsonl"):
        assert main(["validate", "--vda5050", str(tmp_path / name)]) == 0


def certificate(folder, name):
    """A certificate of its own making for 127.0.0.1, and its key."""
    if not shutil.which("openssl"):
        pytest.skip("no openssl to make a certificate with")
    made, key = folder / f"{name}.pem", folder / f"{name}.key"
    about = ["-subj", f"/CN={name}", "-addext", "subjectAltName=IP:127.0.0.1", "-days", "2"]
    command = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-keyout", str(key), "-out", str(made), *about]
    subprocess.run(command, check=True, capture_output=True)
    return made, key


@pytest.mark.slow
@pytest.mark.filterwarnings(
    "ignore:Exception ignored in. <ssl.SSLSocket:pytest.PytestUnraisableExceptionWarning"
)  # paho leaves them to be collected
def test_broker_with_tls_is_trusted_by_its_own_authority_alone(tmp_path, capsys):
    scenario(tmp_path)
    (trusted, key), (other, other_key) = certificate(tmp_path, "broker"), certificate(tmp_path, "other")
    (tmp_path / "password").write_text("secret\n")
    with running(tmp_path, one_user(tmp_path), ssl=True, certfile=str(trusted), keyfile=str(key)) as port:
        who = ["--user", "fleet", "--password-file", str(tmp_path / "password"), "--duration", "2", "--speed", "10"]
        at = ["vda5050", str(tmp_path / "carts.yaml"), "--broker", f"127.0.0.1:{port}"]
        assert main([*at, *who, "--tls", "--ca", str(trusted), "--json"]) == 0
        output = capsys.readouterr()
        said = json.loads(output.out)
        assert said["vehicles"] == 2 and said["sent"] > 0 and said["lost"] == 0 and "2 vehicles at" in output.err
        why = f"mrp-sumo: no connection to the broker 127.0.0.1:{port}: "
        refused = "its certificate is not trusted: self"  # "-signed", or " signed", as OpenSSL has it
        cases = {
            ("--tls", "--ca", str(other)): f"{why}{refused}",
            ("--tls",): f"{why}{refused}",  # the system's authorities do not know it
            ("--tls", "--ca", str(other_key)): f"mrp-sumo: TLS: {other_key}: ",
            ("--tls", "--ca", str(tmp_path / "none")): f"mrp-sumo: {tmp_path / 'none'}: no such file",
            (): f"mrp-sumo: the broker 127.0.0.1:{port} does not let 'robot_0' in: ",  # without TLS
        }
        for options, line in cases.items():
            assert main([*at, *who, *options]) == 2
            result = capsys.readouterr()
            assert result.err.startswith(line) and result.err.count("\n") == 1 and not result.out
        assert main([*at, "--user", "fleet", "--tls", "--ca", str(trusted)]) == 2, "the password is asked for, too"
        assert "does not let 'robot_0' in: " in capsys.readouterr().err


@pytest.mark.slow
def test_wrong_password_is_a_line(broker, tmp_path, capsys):
    scenario(tmp_path)
    assert main(["vda5050", str(tmp_path / "carts.yaml"), "--broker", f"127.0.0.1:{broker.port}", "--user", "fleet"]) == 2
    line = capsys.readouterr().err
    assert "does not let 'robot_0' in: " in line and line.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--broker", "127.0.0.1:1", "--log", "new.jsonl"], "no connection to the broker 127.0.0.1:1: connection refused"),
        (["--broker", "127.0.0.1:99999"], "--broker 127.0.0.1:99999: expected HOST or HOST:PORT"),
        (["--broker", "x", "--version", "1.1"], "VDA 5050 1.1: expected 2.0, 2.1 or 3.0"),
        (["--broker", "x", "--speed", "0"], "--speed: found 0"),
        (["--broker", "x", "--ca", "a.pem"], "--ca is for --tls"),
        (["--broker", "x", "--tls", "--key", "a.pem"], "--cert and --key belong together"),
        (["--broker", "x", "--password-file", "none"], "--password-file is for --user"),
        (["--broker", "x", "--user", "u", "--password-file", "none"], "none: no such file"),
        (["--broker", "x", "--manufacturer", "a/b"], "--manufacturer a/b: expected letters"),
        (["--broker", "x", "--fault", "robot_0:explosion@3"], "'explosion' is no fault"),
        (["--broker", "x", "--fault", "robot_9:breakdown@3"], "'robot_9' is not a robot"),
        (["--broker", "x", "--fault", "robot_0:breakdown@soon"], "expected ROBOT:KIND@SECONDS"),
        (["--broker", "x", "--as", "master", "--fault", "robot_0:breakdown@3"], "--fault is for --as fleet"),
        (["--broker", "x", "--out", "run"], "--out is for --as master"),
        (["--broker", "127.0.0.1:1", "--as", "master"], "no connection to the broker 127.0.0.1:1: connection refused"),
        (["--broker", "127.0.0.1:1", "--tls", "--ca", "carts.yaml"], "TLS: carts.yaml"),
    ],
)
def test_bad_input_is_a_line(options, said, tmp_path, monkeypatch, capsys):
    scenario(tmp_path)
    monkeypatch.chdir(tmp_path)
    assert main(["vda5050", "carts.yaml", *options]) == 2
    line = capsys.readouterr().err
    assert said in line and line.count("\n") == 1 and not Path("new.jsonl").exists()


def test_broker_that_is_gone_is_said_once_and_that_it_is_back(tmp_path):
    said = []
    with running(tmp_path, one_user(tmp_path)) as port:
        connections = Connections(Broker("127.0.0.1", port, "fleet", "secret"), Dialect("2.1"), "us", said.append)
        connections.add("one", ())

    def wait(lines):
        until = time.monotonic() + 120
        while len(said) < lines and time.monotonic() < until:
            connections.receive(0.05)

    wait(1)
    for _ in range(100):
        connections.receive(0.05)
    with socket.create_server(("127.0.0.1", port)):
        wait(2)
    at = f"the broker 127.0.0.1:{port}"
    assert said == [f"no connection to {at}: connection refused; trying again", f"{at} is back"]


def test_addresses():
    assert [(b.host, b.port) for b in map(broker_at, ("h", "h:1", "[::1]:2", "::1"))] == [("h", 1883), ("h", 1), ("::1", 2), ("::1", 1883)]
    assert broker_at("h", tls=True).port == 8883
    with pytest.raises(MrpSumoError):
        broker_at(":3")
