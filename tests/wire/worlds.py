"""A fleet of two carts on a small map, and messages for it."""

import itertools
import json
import math
from contextlib import contextmanager

import yaml

from mrp_sumo.cli.main import main
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.staging.set_up import set_up
from mrp_sumo.formats.vda.messages import Dialect, Sender, action, node
from mrp_sumo.io.scenario.read import read_scenario
from mrp_sumo.wire.fleet import Reporting, VirtualFleet
from mrp_sumo.wire.link import Received

# a corridor with a way round
LANES = """from,to,from_x_m,from_y_m,to_x_m,to_y_m,both_ways
a,b,0,0,4,0,yes
b,c,4,0,8,0,yes
b,d,4,0,4,4,yes
d,e,4,4,8,4,yes
e,c,8,4,8,0,yes
"""
PLACES = {"a": (0, 0), "b": (4, 0), "c": (8, 0), "d": (4, 4), "e": (8, 4)}
TYPE = {"length_m": 0.6, "width_m": 0.4, "max_speed_mps": 1.0, "accel_mps2": 1.0, "decel_mps2": 1.0, "turn_rate_rad_s": 2.0}
SCENARIO = {
    "map": "lanes.csv",
    "discretisation": {"kind": "roadmap", "cell_m": 1.0},
    "robots": {"count": 2, "type": TYPE, "starts": ["a", "e"], "goals": ["e", "a"]},
    "assignment": {"mode": "fixed"},
    "planner": "prioritised",
    "execution": {"engine": "kinematic", "time_limit_s": 300},
    "record": {"bag": False},
}


def driven(folder, document=SCENARIO):
    """A run of a scenario, in `run`."""
    (folder / "lanes.csv").write_text(LANES)
    (folder / "case.yaml").write_text(yaml.safe_dump(document))
    assert main(["run", str(folder / "case.yaml"), "--out", str(folder / "run")]) == 0
    return folder / "run"


def scenario(folder, **changes):
    """The scenario's file."""
    (folder / "lanes.csv").write_text(LANES)
    (folder / "carts.yaml").write_text(yaml.safe_dump(SCENARIO | changes))
    return read_scenario(folder / "carts.yaml")


class Master:
    """Sends orders to a fleet over a link, and keeps the last state of each vehicle."""

    def __init__(self, fleet, link, dialect):
        self.fleet, self.link, self.dialect = fleet, link, dialect
        self.senders = {serial: Sender(dialect, serial) for serial in fleet.serials}
        self.states, self.all = {}, []

    def order(self, serial, names, *, released=99, update=0, order="o1", begin=0, actions=(), limit_mps=2.0, deviation=None, theta=()):
        """Send an order along nodes of the map; `actions` and headings `theta` by name of the node."""
        at, facing = dict(actions), dict(theta)
        nodes = [node(n, begin + 2 * k, k < released, PLACES[n], "L1", at.get(n, ()), facing.get(n, math.nan)) for k, n in enumerate(names)]
        if deviation is not None:
            nodes[0]["nodePosition"]["allowedDeviationXY"] = deviation
        edges = [
            self.dialect.edge(begin + 2 * k + 1, k + 1 < released, (a, b), 4.0, limit_mps)
            for k, (a, b) in enumerate(itertools.pairwise(names))
        ]
        self._send(serial, "order", {"orderId": order, "orderUpdateId": update, "nodes": nodes, "edges": edges})

    def instant(self, serial, kind, **parameters):
        """Send an instant action."""
        name = f"{kind}{self.senders[serial].count.get('instantActions', 0)}"
        self._send(serial, "instantActions", {"actions": [action(kind, name, **parameters)]})

    def _send(self, serial, kind, content):
        payload = self.senders[serial].message(kind, self.fleet.now_s, content)
        self.link.publish(serial, kind, json.dumps(payload).encode())

    def run(self, seconds):
        """Let the fleet drive, and hear what it says."""
        until = self.fleet.now_s + seconds
        while self.fleet.now_s < until - 1e-9:
            self.fleet.step(self.fleet.link.receive(0.0))
            self.hear()

    def hear(self):
        """Take what vehicles have said."""
        for serial, kind, payload in self.link.receive(0.0):
            document = json.loads(payload)
            self.all.append((self.fleet.now_s, self.dialect.topic(serial, kind), document))
            if kind == "state":
                self.states[serial] = document

    def at(self, serial):
        """Where a vehicle says that it is."""
        place = self.states[serial][self.dialect.place_key]
        return round(place["x"], 1), round(place["y"], 1)


class Loopback:
    """One of two ends of a link within a process."""

    def __init__(self):
        self.inbox, self.other = [], None

    def publish(self, serial, kind, payload):
        self.other.inbox.append(Received(serial, kind, payload))

    def receive(self, wait_s):
        messages, self.inbox = self.inbox, []
        return messages

    def close(self): ...


def loopback():
    one, other = Loopback(), Loopback()
    one.other, other.other = other, one
    return one, other


@contextmanager
def carts(folder, version="3.0", faults=(), reporting=None, **changes):
    """A fleet and its master."""
    with MapCache() as maps:
        setup = set_up(scenario(folder, **changes), maps)
        ours, theirs = loopback()
        reporting = reporting or Reporting(state_s=0.1, view_s=0.0)
        with VirtualFleet(setup, maps.network(setup.problem.graph), ours, Dialect(version), reporting, faults) as fleet:
            fleet.greet()
            yield Master(fleet, theirs, Dialect(version))


class Coupled:
    """A master's end of a loopback whose fleet lives a step whenever the master waits."""

    def __init__(self, fleet, link):
        self.fleet, self.link, self.said = fleet, link, []

    def publish(self, serial, kind, payload):
        self.said.append((self.fleet.now_s, serial, kind, json.loads(payload)))
        self.link.publish(serial, kind, payload)

    def receive(self, wait_s):
        self.fleet.step(self.fleet.link.receive(0.0))
        result = self.link.receive(0.0)
        self.said += [(self.fleet.now_s, one.serial, one.kind, json.loads(one.payload)) for one in result]
        return result

    def close(self):
        pass
