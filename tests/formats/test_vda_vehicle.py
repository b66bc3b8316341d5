"""A vehicle takes orders and instant actions as VDA 5050 says, in both versions, and refuses what the standard refuses, by its name."""

import copy
import json
import math
from itertools import pairwise
from pathlib import Path

import pytest

from mrp_sumo.formats.vda.abilities import EMERGENCY_STOP, LOST
from mrp_sumo.formats.vda.errors import Reason
from mrp_sumo.formats.vda.inbox import receive
from mrp_sumo.formats.vda.messages import Dialect, Sender, action, node
from mrp_sumo.formats.vda.order import LONGEST_PAYLOAD, MOST_NODES, check_sequence, read_document, read_order
from mrp_sumo.formats.vda.report import state_of
from mrp_sumo.formats.vda.vehicle import Body, Vehicle

REFERENCE = Path(__file__).resolve().parents[3] / "shared" / "reference" / "data"
PLACES = {name: (2.0 * k, 0.0, "hall") for k, name in enumerate("abcdef")}


class Row:
    """Nodes a to f, 2 m apart."""

    maps = ("hall",)

    def place(self, node):
        return PLACES.get(node)

    def is_joined(self, tail, head):
        return abs(PLACES[tail][0] - PLACES[head][0]) == 2.0

    def arrival_rad(self, tail, head):
        return math.nan if tail == head else 0.0 if head > tail else math.pi


class World:
    """A vehicle in a row of nodes, and its fleet manager; the body drives as told, at once."""

    def __init__(self, version="3.0", at="a"):
        self.dialect = Dialect(version)
        self.vehicle = Vehicle(Sender(self.dialect, "agv"), Row(), at, Body(*PLACES[at][:2], 0.0, "hall"))
        self.master = Sender(self.dialect, "agv")
        self.now_s = 0.0

    def order(self, names, *, released=99, update=0, order="o1", begin=0, actions=(), **changes):
        """An order along nodes, of which the first so many are released; `actions` by name of the node."""
        at, here = dict(actions), list(enumerate(names))
        nodes = [node(n, begin + 2 * k, k < released, PLACES.get(n, (0, 0))[:2], "hall", at.get(n, ())) for k, n in here]
        edges = [self.dialect.edge(begin + 2 * k + 1, k + 1 < released, (a, b), 2.0, 1.0) for k, (a, b) in enumerate(pairwise(names))]
        return {"orderId": order, "orderUpdateId": update, "nodes": nodes, "edges": edges} | changes

    def send(self, content, kind="order"):
        payload = content if isinstance(content, bytes) else json.dumps(self.master.message(kind, self.now_s, content)).encode()
        receive(self.vehicle, kind, payload, self.now_s)
        return self.state()

    def instant(self, kind, name=None, **parameters):
        name = name or f"{kind}{self.master.count.get('instantActions', 0)}"
        return self.send({"actions": [action(kind, name, **parameters)]}, "instantActions")

    def drive(self, nodes=99):
        """Let the body drive to so many of the nodes that are free to it. Returns those that it came to."""
        route = self.vehicle.new_way()
        if route and not self.vehicle.holds:
            self.vehicle.sent(route)
        reached = []
        for one, _ in route[:nodes]:
            x, y, _ = PLACES[one.name]
            self.vehicle.body = Body(x, y, 0.0, "hall")
            self.vehicle.reach(one.sequence, self.now_s)
            reached.append(one.name)
        return "".join(reached)

    def wait(self, seconds):
        self.now_s += seconds
        self.vehicle.advance(self.now_s)

    def state(self):
        return state_of(self.vehicle, self.now_s)

    def statuses(self):
        said = self.state()
        return {one["actionId"]: one["actionStatus"] for one in [*said["actionStates"], *said.get("instantActionStates", ())]}


def kinds(state):
    return [(error["errorType"], error["errorLevel"]) for error in state["errors"]]


@pytest.fixture(params=["2.1", "3.0"])
def world(request):
    return World(request.param)


def test_order_is_driven_to_the_end_of_its_base_and_on_when_that_grows(world):
    said = world.send(world.order("abcd", released=3))
    assert (said["orderId"], said["lastNodeId"], [n["nodeId"] for n in said["nodeStates"]]) == ("o1", "a", ["b", "c", "d"])
    assert world.drive() == "bc"
    said = world.state()
    assert (said["lastNodeId"], said["lastNodeSequenceId"], said["newBaseRequest"]) == ("c", 4, True)
    said = world.send(world.order("cde", update=1, begin=4))
    assert (said["orderUpdateId"], said["errors"], [n["released"] for n in said["nodeStates"]]) == (1, [], [True, True])
    assert world.drive() == "de"
    assert not world.vehicle.is_busy and world.state()["nodeStates"] == []


def test_update_changes_the_horizon_and_nothing_else_while_the_base_is_driven(world):
    world.send(world.order("abcde", released=3))
    assert world.drive(1) == "b"
    said = world.send(world.order("cb", update=1, begin=4))
    assert [(n["nodeId"], n["sequenceId"]) for n in said["nodeStates"]] == [("c", 4), ("b", 6)] and not said["errors"]


@pytest.mark.parametrize(
    ("theta", "deviation", "free"),
    [(math.pi / 2, 0.0, "b"), (0.4, 0.3, "b"), (0.4, 0.5, "bcd"), (-0.4, -0.5, "bcd"), (0.01, 0.0, "bcd"), (None, 0.0, "bcd")],
)
def test_vehicle_stops_at_a_node_at_which_it_has_to_face_another_way(world, theta, deviation, free):
    order = world.order("abcd")
    if theta is not None:
        order["nodes"][1]["nodePosition"] |= {
            "theta": theta,
            "allowedDeviationTheta": abs(deviation) if world.dialect.is_new else deviation,
        }
    world.send(order)
    assert "".join(one.name for one, _ in world.vehicle.new_way()) == free
    assert world.drive() == free and world.drive() == "bcd"[len(free) :]


def test_vehicle_stands_for_a_blocking_action_and_drives_on_when_it_is_done(world):
    pick, look = action("pick", "p", "HARD", duration=3), action("detectObject", "l", "NONE")
    world.send(world.order("abc", actions={"b": [look, pick]}))
    assert world.drive() == "b" and world.drive() == ""
    assert world.statuses() == {"l": "RUNNING", "p": "WAITING"}, "a hard action is alone"
    world.wait(1.0)
    assert world.statuses() == {"l": "FINISHED", "p": "RUNNING"} and world.drive() == ""
    world.wait(3.0)
    assert world.statuses()["p"] == "FINISHED" and world.state()["loads"] == [{"loadId": ""}]
    assert world.drive() == "c"


def test_action_that_lets_drive_does_not_hold(world):
    world.send(world.order("abc", actions={"b": [action("detectObject", "l", "NONE")]}))
    assert world.drive() == "bc" and world.statuses() == {"l": "RUNNING"}


def test_pause_holds_and_no_more_when_it_is_over(world):
    assert world.instant("startPause")["paused"] and world.vehicle.holds
    assert not world.instant("stopPause")["paused"] and not world.vehicle.holds
    assert set(world.statuses().values()) == {"FINISHED"}


def test_cancelled_order_ends_where_the_vehicle_stands_and_takes_no_update(world):
    world.send(world.order("abcd", released=3, actions={"c": [action("drop", "d", "HARD")]}))
    world.drive(1)
    said = world.instant("cancelOrder", "stop")
    assert world.statuses() == {"d": "FAILED", "stop": "RUNNING"} and said["nodeStates"] and world.vehicle.new_way() == []
    world.vehicle.stand("b")
    said = world.state()
    assert (said["orderId"], said["nodeStates"], said["edgeStates"], world.statuses()["stop"]) == ("o1", [], [], "FINISHED")
    said = world.send(world.order("cd", update=1, begin=4))
    assert kinds(said) == [name_of(world, "after_cancel")]
    assert world.send(world.order("bc", order="o2"))["errors"] == [] and world.drive() == "c"


def test_factsheet_is_asked_for(world):
    world.instant("factsheetRequest")
    assert world.vehicle.asked_for_factsheet


def test_lost_vehicle_holds_and_takes_no_order_until_it_is_told_where_it_is(world):
    said = world.instant("simulateFault", fault=LOST)
    key = "localized" if world.dialect.is_new else "positionInitialized"
    assert world.vehicle.holds and said[world.dialect.place_key][key] is False and kinds(said) == [name_of(world, "localization")]
    assert name_of(world, "not_available") in kinds(world.send(world.order("ab")))
    assert name_of(world, "instant_action") in kinds(world.instant("initPosition", x=8.0, y=0.0, theta=0.0, mapId="hall"))
    world.instant("initPosition", x=0.1, y=0.0, theta=0.1, mapId="hall", lastNodeId="a")
    assert not world.vehicle.holds and world.send(world.order("ab"))["errors"] == []


def test_emergency_stop_holds_for_as_long_as_was_asked(world):
    said = world.instant("simulateFault", fault=EMERGENCY_STOP, duration=5)
    key = "activeEmergencyStop" if world.dialect.is_new else "eStop"
    assert said["safetyState"][key] == "MANUAL" and world.vehicle.holds
    world.wait(5.0)
    assert not world.vehicle.holds and world.state()["safetyState"][key] == "NONE"


def name_of(world, reason):
    return Reason[reason.upper()].value[world.dialect.is_new]


def broken(order, path, value):
    """An order with another value in one place; `...`: with none."""
    changed = copy.deepcopy(order)
    *route, last = path
    at = changed
    for key in route:
        at = at[key]
    if value is ...:
        del at[last]
    else:
        at[last] = value
    return changed


REFUSED = {  # name -> reason, and what is sent to a vehicle that drives o1 from a along b to c and is at b
    "not_json": ("malformed", lambda w: b'{"orderId": '),
    "not_text": ("malformed", lambda w: b"\xff\xfe\x00"),
    "number_without_end": ("malformed", lambda w: b'{"headerId": NaN}'),
    "number_that_nobody_computes_with": ("malformed", lambda w: w.order("bc", order="o2") | {"unknown": 1e308}),
    "too_deep": ("malformed", lambda w: b"[" * 100_000),
    "too_long": ("too_large", lambda w: b" " * (LONGEST_PAYLOAD + 1)),
    "too_many_nodes": ("too_large", lambda w: w.order("ab" * MOST_NODES, order="o2")),
    "for_another": ("malformed", lambda w: w.order("bc", order="o2") | {"serialNumber": "other"}),
    "of_another_version": ("malformed", lambda w: w.order("bc", order="o2") | {"version": "1.1.0"}),
    "no_nodes": ("malformed", lambda w: w.order("bc", order="o2") | {"nodes": []}),
    "an_edge_too_few": ("malformed", lambda w: w.order("bc", order="o2") | {"edges": []}),
    "wrong_sequence": ("malformed", lambda w: broken(w.order("bcd", order="o2"), ("nodes", 2, "sequenceId"), 5)),
    "released_after_horizon": ("malformed", lambda w: broken(w.order("bcd", order="o2", released=1), ("nodes", 2, "released"), True)),
    "missing": ("malformed", lambda w: broken(w.order("bc", order="o2"), ("edges", 0, "edgeId"), ...)),
    "of_another_type": ("malformed", lambda w: broken(w.order("bc", order="o2"), ("nodes", 1, "nodePosition", "x"), "3")),
    "larger_than_any": ("malformed", lambda w: broken(w.order("bc", order="o2"), ("nodes", 1, "nodePosition", "theta"), 10**400)),
    "degrees": ("malformed", lambda w: broken(w.order("bc", order="o2"), ("nodes", 1, "nodePosition", "theta"), 90.0)),
    "another_order": ("other_active", lambda w: w.order("bc", order="o2")),
    "outdated": ("outdated", lambda w: w.order("cd", update=0, begin=4)),
    "same_update_with_other_content": ("same_update", lambda w: w.order("cde", update=1, begin=4)),
    "not_from_the_end_of_the_base": ("not_continued", lambda w: w.order("bc", update=2, begin=2)),
    "wrong_stitch": ("not_continued", lambda w: w.order("cd", update=2, begin=6)),
    "unknown_node": ("route", lambda w: w.order("cx", update=2, begin=4)),
    "no_lane": ("route", lambda w: w.order("ce", update=2, begin=4)),
    "elsewhere_on_the_map": ("route", lambda w: broken(w.order("cd", update=2, begin=4), ("nodes", 1, "nodePosition", "x"), 600.0)),
    "unknown_map": ("map", lambda w: broken(w.order("cd", update=2, begin=4), ("nodes", 1, "nodePosition", "mapId"), "roof")),
    "trajectory": ("unsupported", lambda w: broken(w.order("cd", update=2, begin=4), ("edges", 0, "trajectory"), {"degree": 1})),
    "unknown_action": ("order_action", lambda w: w.order("cd", update=2, begin=4, actions={"d": [action("fly", "f")]})),
    "odd_duration": ("order_action", lambda w: w.order("cd", update=2, begin=4, actions={"d": [action("pick", "f", duration="soon")]})),
    "used_action": ("order_action", lambda w: w.order("cd", update=2, begin=4, actions={"d": [action("pick", "p")]})),
}


@pytest.mark.parametrize("case", REFUSED)
def test_order_is_refused_by_the_name_that_the_standard_has_for_it(world, case):
    reason, made = REFUSED[case]
    world.send(world.order("ab", released=1, actions={"a": [action("pick", "p")]}))
    world.send(world.order("abc", update=1, actions={"a": [action("pick", "p")]}))
    world.drive(1)
    before = world.state()
    content = made(world)
    if isinstance(content, dict):
        content = json.dumps(world.master.message("order", 0.0, {}) | content).encode()
    said = world.send(content)
    assert kinds(said) == [name_of(world, reason)], said["errors"]
    assert (
        said["errors"][0]["errorDescription"]
        and {"referenceKey": "topic", "referenceValue": "order"} in said["errors"][0]["errorReferences"]
    )
    rest = ("orderId", "orderUpdateId", "nodeStates", "edgeStates", "lastNodeId")
    assert [said[key] for key in rest] == [before[key] for key in rest], "the order before goes on"
    assert world.drive() == "" and world.send(world.order("cd", update=2, begin=4))["errors"] == [], "until one is accepted"


def test_new_order_begins_where_the_vehicle_stands(world):
    assert kinds(world.send(world.order("bc"))) == [name_of(world, "start")]
    deviation = {"a": 3.0, "b": 3.0, "theta": 0.0} if world.dialect.is_new else 3.0
    near = broken(world.order("bc"), ("nodes", 0, "nodePosition", "allowedDeviationXY"), deviation)
    assert kinds(world.send(near)) == [name_of(world, "route")], "it has to get from a, where it stands, to c"
    near = broken(world.order("bab"), ("nodes", 0, "nodePosition", "allowedDeviationXY"), deviation)
    assert world.send(near)["errors"] == []


def test_temporary_node_where_the_vehicle_stands_is_a_start(world):
    order = broken(world.order("tb"), ("nodes", 0, "nodePosition", "x"), 0.05)
    assert world.send(order)["errors"] == [] and world.drive() == "b"


def test_order_that_is_sent_twice_is_ignored(world):
    world.send(world.order("abc", released=2))
    assert world.send(world.order("abc", released=2))["errors"] == []


@pytest.mark.parametrize(
    ("kind", "parameters", "reason"),
    [
        ("cancelOrder", {}, "no_order"),
        ("dance", {}, "instant_action"),
        ("initPosition", {"x": "here"}, "instant_action"),
        ("simulateFault", {"fault": "__class__"}, "instant_action"),
    ],
)
def test_instant_action_that_cannot_be_done_fails_by_its_name(world, kind, parameters, reason):
    said = world.instant(kind, "i", **parameters)
    assert kinds(said) == [name_of(world, reason)] and world.statuses() == {"i": "FAILED"}
    assert {"referenceKey": "actionId", "referenceValue": "i"} in said["errors"][0]["errorReferences"]


def test_messages_of_others_are_read():
    """openTCS's own examples: the small one is an order, in the full one all sequence numbers are 0."""
    folder = REFERENCE / "opentcs" / "messages"
    if not folder.is_dir():
        pytest.skip("no reference data here")
    small, full = (
        read_order(read_document((folder / f"v2_0.OrderTest.jsonSample{name}.approved.txt").read_bytes()), Dialect("2.1"))
        for name in ("Minimal", "Full")
    )
    check_sequence(small)
    assert [n.name for n in full.nodes] == ["source-node", "destination-node"] and full.edges[0].has_trajectory
    assert full.nodes[1].actions[0].parameters == {"some-key": "some-value", "some-other-key": "some-other-value"}
    with pytest.raises(Exception, match=r"nodes\[1\]\.sequenceId is 0, expected 2"):
        check_sequence(full)


@pytest.mark.parametrize("version", ["2.1", "3.0"])
def test_states_are_what_the_official_schemas_say(version):
    jsonschema = pytest.importorskip("jsonschema")
    folder = REFERENCE / "vda5050" / version / "json_schemas"
    if not folder.is_dir():
        pytest.skip("no reference data here")
    schema = jsonschema.Draft202012Validator(json.loads((folder / "state.schema").read_text()))
    world = World(version)
    said = [world.state(), world.send(b"{"), world.instant("simulateFault", fault=LOST), world.instant("cancelOrder")]
    world.instant("initPosition", x=0, y=0, theta=0)
    order = broken(
        world.order("abcd", released=3, actions={"b": [action("pick", "p", "HARD")]}), ("nodes", 0, "nodePosition", "theta"), math.pi
    )
    said.append(world.send(order))
    world.drive()
    world.vehicle.blocked_by = "behind another"
    said += [world.state(), world.instant("startPause")]
    assert [error for state in said for error in schema.iter_errors(state)] == []
