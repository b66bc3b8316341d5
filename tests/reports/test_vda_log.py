"""Runs as messages of VDA 5050: by the official schemas, by our own checks, which find what is changed."""

import copy
import json
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml
from wire.worlds import SCENARIO, driven

from mrp_sumo.cli.main import main
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.formats.vda.check import check
from mrp_sumo.formats.vda.messages import KINDS, Dialect, serials_of
from mrp_sumo.formats.vda.recorded import read_log
from mrp_sumo.io.run_reader import load_run
from mrp_sumo.reports.vda_log import write_vda

SCHEMAS = Path(__file__).resolve().parents[3] / "shared" / "reference" / "data" / "vda5050"
LIFT = SCHEMAS.parents[2] / "maps" / "corpus" / "cardboardcode+rmf_gym_lite" / "simple_lift.building.yaml"
# on a corridor with a way round two robots carry things, and are replanned with every task
WORK = {
    "map": "lanes.csv",
    "discretisation": {"kind": "roadmap", "cell_m": 1.0},
    "robots": {"count": 2, "type": "turtlebot3", "starts": ["a", "e"]},
    "planner": "lacam",
    "tasks": [{"name": f"t{k}", "stops": ["c", "a"] if k % 2 else ["d", "c"], "release_s": 8.0 * k, "service_s": 2.0} for k in range(3)],
    "execution": {"engine": "kinematic", "time_limit_s": 300},
    "record": {"bag": False},
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return driven(tmp_path_factory.mktemp("vda"), WORK)


@pytest.fixture(scope="module")
def logs(folder):
    """The messages of both versions."""
    result = {}
    for version in ("2.1", "3.0"):
        write_vda(folder / version, load_run(folder).record, version)
        result[version] = [json.loads(line) for line in (folder / version / "messages.jsonl").read_text().splitlines()]
    return result


def of(messages, kind):
    return [m for m in messages if m["topic"].endswith(f"/{kind}")]


def faults(messages):
    return [fault.text for fault in check(json.dumps(m) for m in messages)]


@pytest.mark.parametrize("version", ["2.1", "3.0"])
def test_orders_ask_for_the_headings_in_which_robots_stay(tmp_path, version):
    folder = driven(tmp_path, SCENARIO | {"robots": {**SCENARIO["robots"], "goal_heading_deg": [90, None]}})
    write_vda(tmp_path / "vda", load_run(folder).record, version)
    messages = [json.loads(line) for line in (tmp_path / "vda" / "messages.jsonl").read_text().splitlines()]
    assert faults(messages) == []
    ends = {m["topic"].split("/")[-2]: m["payload"]["nodes"][-1]["nodePosition"] for m in of(messages, "order")}
    assert ends["robot_0"]["theta"] == pytest.approx(math.pi / 2, abs=1e-6) and "theta" not in ends["robot_1"]
    key, states = Dialect(version).place_key, [m["payload"] for m in of(messages, "state") if "robot_0" in m["topic"]]
    passed = next(state for state in states if state["lastNodeId"] == "e")
    assert passed[key]["theta"] == pytest.approx(math.pi / 2, abs=1e-5) and passed["nodeStates"] == [], "it is there once it faces so"


@pytest.mark.parametrize("version", ["2.1", "3.0"])
def test_every_message_is_valid_by_the_official_schema(logs, version):
    jsonschema = pytest.importorskip("jsonschema")
    if not SCHEMAS.is_dir():
        pytest.skip("the official schemas are not beside this repository")
    for kind in KINDS:
        validator = jsonschema.Draft202012Validator(json.loads((SCHEMAS / version / "json_schemas" / f"{kind}.schema").read_text()))
        assert of(logs[version], kind)
        for message in of(logs[version], kind):
            assert not list(validator.iter_errors(message["payload"]))


@pytest.mark.parametrize("version", ["2.1", "3.0"])
def test_the_log_keeps_the_standard_and_says_what_was_driven(logs, folder, version):
    messages = logs[version]
    assert faults(messages) == []
    assert [m["t_s"] for m in messages] == sorted(m["t_s"] for m in messages)
    run = load_run(folder)
    for robot, name in enumerate(run.fleet.robot_name):
        states = [m["payload"] for m in of(messages, "state") if m["topic"].split("/")[3] == name]
        passed = [s["lastNodeId"] for k, s in enumerate(states) if k == 0 or s["lastNodeId"] != states[k - 1]["lastNodeId"]]
        xy = [run.graph.xy[run.graph.vertex_of_name[label]] for label in passed]
        assert all(1e-9 < ((a - b) ** 2).sum() < 1.1**2 for a, b in pairwise(xy))  # node by node
        assert len(passed) > 5
        done = {a["actionId"] for s in states for a in s["actionStates"] if a["actionStatus"] == "FINISHED"}
        assert len({a for a in done if "factsheet" not in a}) == (run.execution.stops.robot == robot).sum()


def test_the_base_is_what_the_ledger_has_granted(logs, folder):
    grants = load_run(folder).execution.grants
    for m in of(logs["3.0"], "order"):
        robot = int(m["topic"].split("/")[3].removeprefix("robot_"))
        rows = (grants.robot == robot) & (grants.t_s <= m["t_s"] + 1e-9)
        assert sum(n["released"] for n in m["payload"]["nodes"]) <= (grants.visit + grants.enters)[rows].max() + 1
    assert any(not n["released"] for m in of(logs["3.0"], "order") for n in m["payload"]["nodes"])


def test_a_lane_is_in_the_base_once_a_robot_is_on_it(logs, folder):
    run = load_run(folder)
    grants = run.execution.grants
    waited = np.flatnonzero(grants.enters)
    assert len(waited), "somebody waits on a lane, short of the next vertex"
    for row in waited.tolist():
        t_s, name = float(grants.t_s[row]), run.fleet.robot_name[grants.robot[row]]
        orders = [m["payload"] for m in of(logs["3.0"], "order") if m["topic"].split("/")[3] == name and m["t_s"] <= t_s + 1e-9]
        base = [n["nodeId"] for n in orders[-1]["nodes"] if n["released"]]
        states = [m["payload"] for m in of(logs["3.0"], "state") if m["topic"].split("/")[3] == name and m["t_s"] > t_s]
        assert states[0]["lastNodeId"] != base[-1], "it is on its way to the last node of its base"


def test_files_by_vehicle_hold_the_same_messages(logs, folder):
    for kind in KINDS:
        lines = (folder / "3.0" / "robot_0" / f"{kind}.jsonl").read_text().splitlines()
        assert [json.loads(line) for line in lines] == [m["payload"] for m in of(logs["3.0"], kind) if "/robot_0/" in m["topic"]]


def payload_of(messages, kind, n=0):
    return of(messages, kind)[n]["payload"]


def updated(messages):
    """The first update of an order."""
    return next(m["payload"] for m in of(messages, "order") if m["payload"]["orderUpdateId"] > 0)


def long_order(messages):
    return max((m["payload"] for m in of(messages, "order")), key=lambda p: len(p["nodes"]))


def busy(messages):
    """A state with much ahead."""
    return max((m["payload"] for m in of(messages, "state")), key=lambda p: len(p["nodeStates"]))


def acting(messages):
    return [m["payload"] for m in of(messages, "state") if any("factsheet" not in a["actionId"] for a in m["payload"]["actionStates"])][-1]


def turned_away(messages):
    """The last node of robot_0's way asks for another heading than that in which it came."""
    for message in messages:
        if "robot_0" in message["topic"] and message["topic"].endswith("/order"):
            node, last = message["payload"]["nodes"][-1], message["payload"]
    node["nodePosition"]["theta"] = 0.7
    assert node["released"], last


MUTATIONS = {
    "a header is counted twice": (lambda m: payload_of(m, "state", 3).update(headerId=77), "headerId"),
    "a message is lost": (lambda m: m.remove(of(m, "order")[1]), "order"),
    "a message comes twice": (lambda m: m.insert(m.index(of(m, "state")[4]), of(m, "state")[4]), "headerId"),
    "time runs back": (lambda m: payload_of(m, "state", 6).update(timestamp="1969-12-31T23:59:59.000Z"), "timestamp"),
    "local time": (lambda m: payload_of(m, "state").update(timestamp="1970-01-01T00:00:00"), "timestamp"),
    "the log is not in order": (lambda m: m.append({**m[0]}), "comes after"),
    "somebody else's serial": (lambda m: payload_of(m, "state").update(serialNumber="robot_9"), "serialNumber"),
    "another version": (lambda m: payload_of(m, "order").update(version="1.1.0"), "version"),
    "a misspelt member": (lambda m: payload_of(m, "state").update(velocty={}), "velocty is unknown (did you mean 'velocity'?)"),
    "a misspelt member of an edge": (lambda m: long_order(m)["edges"][0].update(lenght=1.0), "lenght is unknown"),
    "a member is missing": (lambda m: payload_of(m, "state").pop("safetyState"), "safetyState is missing"),
    "a number as text": (lambda m: payload_of(m, "order").update(orderUpdateId="0"), "orderUpdateId is 0, expected a whole number"),
    "a flag as a number": (lambda m: long_order(m)["nodes"][0].update(released=1), "released is 1"),
    "an update is skipped": (lambda m: updated(m).update(orderUpdateId=7), "orderUpdateId 7 follows"),
    "an update begins elsewhere": (lambda m: updated(m)["nodes"][0].update(nodeId="nowhere"), "nodes[0] is another"),
    "an update begins later": (lambda m: (updated(m)["nodes"].pop(0), updated(m)["edges"].pop(0)), "the end of the base"),
    "an edge is missing": (lambda m: long_order(m)["edges"].pop(), "edges, expected"),
    "a sequence number is missing": (lambda m: long_order(m)["nodes"][2].update(sequenceId=99), "sequenceId is 99"),
    "odd nodes": (lambda m: long_order(m)["nodes"][0].update(sequenceId=1), "expected an even number"),
    "released beyond the base": (lambda m: long_order(m)["nodes"][-1].update(released=True), "released"),
    "an edge released alone": (lambda m: long_order(m)["edges"][-1].update(released=True), "its nodes say otherwise"),
    "an order that begins in its horizon": (lambda m: payload_of(m, "order")["nodes"][0].update(released=False), "begins in its base"),
    "an order without nodes": (lambda m: payload_of(m, "order").update(nodes=[]), "has one at least"),
    "a new order too early": (lambda m: updated(m).update(orderId="new", orderUpdateId=0), "is not done"),
    "a state of another order": (lambda m: busy(m).update(orderId="other"), "orderId 'other'"),
    "a state of an old update": (lambda m: busy(m).update(orderUpdateId=99), "orderUpdateId 99"),
    "a node that was not released": (lambda m: busy(m).update(lastNodeSequenceId=busy(m)["nodeStates"][-1]["sequenceId"]), "not released"),
    "another last node": (lambda m: busy(m).update(lastNodeId="x"), "lastNodeId 'x'"),
    "a node state too few": (lambda m: busy(m)["nodeStates"].pop(0), "nodeStates are"),
    "an edge state with another flag": (lambda m: busy(m)["edgeStates"][-1].update(released=True), "edgeStates are"),
    "off the way": (lambda m: busy(m)["mobileRobotPosition"].update(y=50.0), "off the way"),
    "the wrong way round": (lambda m: turned_away(m), "whose theta is"),
    "faster than it can": (lambda m: payload_of(m, "visualization", 9)["mobileRobotPosition"].update(x=-9.0), "faster than"),
    "an action nobody sent": (lambda m: acting(m)["actionStates"][-1].update(actionId="x"), "none that was sent"),
    "an unknown status": (lambda m: acting(m)["actionStates"][-1].update(actionStatus="DONE"), "actionStatus 'DONE'"),
    "a picture of another state": (lambda m: payload_of(m, "visualization", 5).update(referenceStateHeaderId=77), "referenceStateHeaderId"),
    "offline": (lambda m: payload_of(m, "connection").update(connectionState="OFFLINE"), "not online"),
    "no such state of connection": (lambda m: payload_of(m, "connection").update(connectionState="UP"), "connectionState 'UP'"),
    "long silence": (lambda m: [m.remove(s) for s in of(m, "state") if s["t_s"] > 1 and "robot_0" in s["topic"]][:-1], "state"),
}


@pytest.mark.parametrize("name", MUTATIONS)
def test_what_is_changed_is_found(logs, name):
    messages = copy.deepcopy(logs["3.0"])
    change, words = MUTATIONS[name]
    change(messages)
    assert any(words in fault.text for fault in check(json.dumps(m) for m in messages))


def test_lines_that_are_no_messages_are_found():
    assert [fault.text for fault in check(["{", '{"t_s": 1e200}', "[]", '{"t_s": 0, "topic": "a/b", "payload": {}}'])] == [
        *2 * ["not JSON with numbers up to 1e+15"],
        "expected an object with t_s, topic and payload",
        "expected a topic INTERFACE/vN/MANUFACTURER/SERIAL/KIND",
    ]


def test_messages_of_opentcs_are_read(tmp_path):
    folder = SCHEMAS.parent / "opentcs" / "messages"
    if not folder.is_dir():
        pytest.skip("openTCS's messages are not beside this repository")
    result = {}
    for path in folder.glob("*.txt"):
        payload = json.loads(path.read_text()) | {"version": "2.0.0"}
        kind = "order" if "Order" in path.name else "state"
        header = {key: payload[key] for key in ("headerId", "timestamp", "version", "manufacturer", "serialNumber")}
        topic = f"uagv/v2/{payload['manufacturer']}/{payload['serialNumber']}"
        online = {"t_s": 0, "topic": f"{topic}/connection", "payload": header | {"connectionState": "ONLINE"}}
        result[path.name.split(".")[1]] = result.get(path.name.split(".")[1], []) + faults(
            [online, {"t_s": 0, "topic": f"{topic}/{kind}", "payload": payload}]
        )
        if kind == "state":  # another's vehicle, recorded
            lines = [json.dumps({"t_s": 0, "topic": f"{topic}/state", "payload": payload})]
            (tmp_path / "log.jsonl").write_text("\n".join(lines))
            if "agvPosition" in payload:
                (vehicle,) = read_log(tmp_path / "log.jsonl").vehicles.values()
                place = payload["agvPosition"]
                assert (vehicle.x_m, vehicle.y_m, vehicle.map_id) == ([place["x"]], [place["y"]], [place["mapId"]])
                assert vehicle.passed[0][1] == payload["lastNodeId"] and {kind for kind, _ in vehicle.errors} == {"some-error"}
            else:
                with pytest.raises(MrpSumoError, match="no state or visualization says where a vehicle is"):
                    read_log(tmp_path / "log.jsonl")
    assert result["StateTest"] == []
    assert result["OrderTest"] == ["nodes[1].sequenceId is 0, expected 2", "edges[0].sequenceId is 0, expected 1"]  # they test the layout


def test_export_and_validate_from_the_command_line(folder, tmp_path, capsys):
    assert main(["export", str(folder), "--vda5050", "2.1", "--out", str(tmp_path / "log")]) == 0
    assert main(["validate", "--vda5050", str(tmp_path / "log" / "messages.jsonl")]) == 0
    assert "keeps the standard" in capsys.readouterr().out
    broken = tmp_path / "broken.jsonl"
    broken.write_text((tmp_path / "log" / "messages.jsonl").read_text().replace('"headerId":1,', '"headerId":5,', 1))
    assert main(["validate", "--vda5050", str(broken)]) == 1
    assert "headerId 5 follows 0, expected 1" in capsys.readouterr().out


def test_whoever_is_served_twice_without_driving_has_an_order_for_each(tmp_path):
    """robot_0 drops t0 at c, and takes t1 up there, which comes while it stands, and t2, which it had before."""
    rows = [("t0", 0.0, ["b", "c"]), ("t1", 60.0, ["c", "a"]), ("t2", 60.0, ["a", "b"])]
    tasks = [{"name": name, "stops": stops, "release_s": at, "service_s": 2.0} for name, at, stops in rows]
    run = driven(tmp_path, WORK | {"robots": {"count": 1, "type": "turtlebot3", "starts": ["a"]}, "tasks": tasks})
    write_vda(tmp_path / "vda", load_run(run).record, "3.0")
    messages = [json.loads(line) for line in (tmp_path / "vda" / "messages.jsonl").read_text().splitlines()]
    assert faults(messages) == []
    done = {}
    for message in of(messages, "state"):
        for each in message["payload"]["actionStates"]:
            done.setdefault((each["actionId"], each["actionType"]), []).append(each["actionStatus"])
    kinds = [kind for (_, kind), status in done.items() if status[-1] == "FINISHED" and "RUNNING" in status]
    assert kinds == ["pick", "drop"] * 3
    asked_s = {each["actionId"]: m["t_s"] for m in reversed(of(messages, "order")) for n in m["payload"]["nodes"] for each in n["actions"]}
    assert sorted(asked_s.values())[2] == pytest.approx(60.0, abs=0.2)  # nobody asks for what is not known


def test_other_versions_are_refused():
    with pytest.raises(MrpSumoError, match=r"VDA 5050 1\.1: expected 2\.0, 2\.1 or 3\.0"):
        Dialect("1.1")


def test_serials_are_no_paths_and_each_another():
    assert serials_of(["../../etc", "a b", "a_b", ".."]) == ["_.._etc", "a_b", "a_b_2", "robot"]


@pytest.mark.skipif(not LIFT.is_file(), reason="the corpus of maps is not there")
def test_positions_are_in_the_frame_of_the_level_that_they_name(tmp_path):
    """A robot that rides is on the other level's map at once, at the same place, and nobody is faster than its type."""
    work = {"map": str(LIFT), "robots": 2, "planner": "lacam", "seed": 1, "execution": {"engine": "kinematic"}, "record": {"bag": False}}
    (tmp_path / "ride.yaml").write_text(yaml.safe_dump(work))
    assert main(["run", str(tmp_path / "ride.yaml"), "--out", str(tmp_path / "run")]) == 0
    record = load_run(tmp_path / "run").record
    write_vda(tmp_path / "vda", record, "3.0")
    messages = [json.loads(line) for line in (tmp_path / "vda" / "messages.jsonl").read_text().splitlines()]
    assert faults(messages) == []
    places = [m["payload"]["mobileRobotPosition"] for m in of(messages, "visualization")]
    assert {place["mapId"] for place in places} == set(record.levels)
    assert min(place["y"] for place in places) > record.graph.xy[:, 1].min() + 5.0
