"""CPU time of a virtual fleet of VDA 5050 vehicles in real time: 100 vehicles on a warehouse grid, state at 1 Hz, visualization at 10 Hz.

    python tools/bench_vda5050.py [--vehicles 100] [--seconds 60] [--json]

Three processes: a broker on the loopback (a few lines that know as much of MQTT as this takes), the fleet, which is measured, and a
master that sends each vehicle an order of twelve nodes whenever it is done. What brokers and masters need is their own affair. A row
has the fleet's share of one core, messages a second, how far it fell behind the clock.
"""

import argparse
import asyncio
import itertools
import json
import math
import random
import resource
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import ClassVar

import bench
import numpy as np

from mrp_sumo.drive import warm
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.staging.set_up import set_up
from mrp_sumo.formats.vda.messages import Dialect, Sender, node, serials_of
from mrp_sumo.io.scenario.read import scenario_of
from mrp_sumo.wire.fleet import GraphSite, Reporting, VirtualFleet
from mrp_sumo.wire.mqtt import Broker, Connections, MasterLink, VehicleLink, encoded
from mrp_sumo.wire.pace import Pace

VERSION = "2.1"


def scenario(vehicles: int, engine: str):
    """Robots anywhere in the warehouse."""
    return scenario_of(
        {
            "map": "warehouse",
            "robots": {"count": vehicles, "type": "turtlebot3", "draw": "anywhere"},
            "planner": "lacam",
            "execution": {"engine": engine},
        },
        Path.cwd(),
        "bench",
    )


def fleet(port: int, vehicles: int, engine: str, seconds: float) -> dict[str, float]:
    """Be the fleet, and measure oneself."""
    warm.prepare()
    dialect = Dialect(VERSION)
    with MapCache() as maps:
        setup = set_up(scenario(vehicles, engine), maps)
        link = VehicleLink(Connections(Broker("127.0.0.1", port), dialect, "mrp_sumo"))
        reporting = Reporting(state_s=1.0, view_s=0.1, epoch_s=time.time())
        virtual = VirtualFleet(setup, maps.network(setup.problem.graph), link, dialect, reporting)
        for vehicle in virtual.vehicles:
            link.join(vehicle.sender.serial, encoded(virtual.connection(vehicle, "ONLINE")), encoded(virtual.last_will(vehicle)))
        with virtual:
            print("ready", flush=True)
            pace, until_s = Pace(1.0), math.inf
            cpu_s = begun_s = sent = 0.0
            while virtual.now_s < until_s:
                if until_s == math.inf and sum(vehicle.is_busy for vehicle in virtual.vehicles) > 0.9 * vehicles:
                    until_s, pace.behind_s = virtual.now_s + seconds, 0.0
                    begun_s, cpu_s, sent = time.monotonic(), time.process_time(), virtual.sent
                virtual.step(pace.wait(virtual.now_s, link.receive))
            wall_s, cpu_s = time.monotonic() - begun_s, time.process_time() - cpu_s
            driving = sum(vehicle.body.moves for vehicle in virtual.vehicles)
            sent = virtual.sent - sent
        link.close()
    return {
        "vehicles": vehicles,
        "engine": engine,
        "cpu_share": round(cpu_s / wall_s, 3),
        "messages_per_s": round(sent / wall_s, 1),
        "us_per_message": round(1e6 * cpu_s / sent, 1),
        "behind_s": round(pace.behind_s, 3),
        "driving_at_the_end": driving,
        "memory_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
    }


def master(port: int, vehicles: int) -> None:
    """Send each vehicle on whenever it has nothing to do."""
    dialect, rng = Dialect(VERSION), random.Random(0)
    with MapCache() as maps:
        setup = set_up(scenario(vehicles, "kinematic"), maps)
        graph, site = setup.problem.graph, GraphSite(setup.problem.graph, setup.map.level_shift_m)
    serials = serials_of(setup.problem.fleet.robot_name)
    link = MasterLink(Connections(Broker("127.0.0.1", port), dialect, "mrp_sumo"), frozenset(serials))
    link.join()
    senders, orders = {serial: Sender(dialect, serial) for serial in serials}, dict.fromkeys(serials, 0)
    vertex = {graph.label(v): v for v in range(graph.num_vertices)}
    while True:
        for serial, kind, payload in link.receive(0.1):
            state = json.loads(payload) if kind == "state" else {}
            if not state or state["nodeStates"] or state["orderId"] not in ("", f"{serial}-{orders[serial] - 1}"):
                continue
            names = [state["lastNodeId"]]
            while len(names) < 12:
                v = vertex[names[-1]]
                heads = graph.head[graph.first[v] : graph.first[v + 1]].tolist()
                new = [h for h in heads if len(names) < 2 or graph.label(h) != names[-2]] or heads
                names.append(graph.label(rng.choice(new)))
            nodes = [node(n, 2 * k, True, site.place(n)[:2], site.place(n)[2]) for k, n in enumerate(names)]
            edges = [dialect.edge(f"{a}-{b}", 2 * k + 1, True, (a, b), 0.4, np.inf) for k, (a, b) in enumerate(itertools.pairwise(names))]
            order = {"orderId": f"{serial}-{orders[serial]}", "orderUpdateId": 0, "nodes": nodes, "edges": edges}
            orders[serial] += 1
            link.publish(serial, "order", encoded(senders[serial].message("order", 0.0, order)))


class Peer(asyncio.Protocol):
    """A client of a broker that knows just enough of MQTT 3.1.1: topics without wildcards, nothing kept."""

    subscribers: ClassVar[dict[bytes, set["Peer"]]] = {}

    def connection_made(self, transport):
        self.transport, self.buffer = transport, bytearray()

    def connection_lost(self, error):
        for listening in self.subscribers.values():
            listening.discard(self)

    def data_received(self, data):
        self.buffer += data
        while (packet := self._packet()) is not None:
            self._take(*packet)

    def _packet(self):
        """First byte, and what is behind the length, of the next whole packet."""
        length = 0
        for k in range(1, min(len(self.buffer), 5)):
            length |= (self.buffer[k] & 127) << 7 * (k - 1)
            if self.buffer[k] < 128:
                if len(self.buffer) < k + 1 + length:
                    return None
                first, body = self.buffer[0], bytes(self.buffer[k + 1 : k + 1 + length])
                del self.buffer[: k + 1 + length]
                return first, body
        return None

    def _take(self, first, body):
        kind = first >> 4
        if kind == 1:
            self.transport.write(b"\x20\x02\x00\x00")
        elif kind == 8:
            size = int.from_bytes(body[2:4], "big")
            self.subscribers.setdefault(body[4 : 4 + size], set()).add(self)
            self.transport.write(b"\x90\x03" + body[:2] + b"\x00")
        elif kind == 12:
            self.transport.write(b"\xd0\x00")
        elif kind == 3:
            size = int.from_bytes(body[:2], "big")
            topic, rest = body[2 : 2 + size], body[2 + size :]
            if first & 6:
                self.transport.write(b"\x40\x02" + rest[:2])
                rest = rest[2:]
            for peer in self.subscribers.get(topic, ()):
                sent, length = body[: 2 + size] + rest, bytearray()
                left = len(sent)
                while left > 127:
                    length.append(left & 127 | 128)
                    left >>= 7
                peer.transport.write(b"\x30" + bytes(length) + bytes([left]) + sent)


async def serve(port: int) -> None:
    """Be the broker."""
    server = await asyncio.get_running_loop().create_server(Peer, "127.0.0.1", port)
    await server.serve_forever()


def arguments(parser: argparse.ArgumentParser) -> None:
    """Size of the fleet."""
    parser.add_argument("--vehicles", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--engine", default="sumo", choices=("sumo", "kinematic"))
    parser.add_argument("--part", choices=("fleet", "broker", "master"), help=argparse.SUPPRESS)
    parser.add_argument("--port", type=int, help=argparse.SUPPRESS)


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """One row: the three processes are this file with --part."""
    if options.part == "fleet":
        yield fleet(options.port, options.vehicles, options.engine, options.seconds)
    elif options.part == "broker":
        asyncio.run(serve(options.port))
    elif options.part == "master":
        master(options.port, options.vehicles)
    else:
        yield together(options)


def together(options: argparse.Namespace) -> bench.Row:
    """Start the three."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    again = [
        sys.executable,
        __file__,
        "--json",
        "--vehicles",
        str(options.vehicles),
        "--port",
        str(port),
        "--seconds",
        str(options.seconds),
    ]
    broker = subprocess.Popen([*again, "--part", "broker"])
    time.sleep(3)
    measured = subprocess.Popen([*again, "--engine", options.engine, "--part", "fleet"], stdout=subprocess.PIPE, text=True)
    driver = None
    try:
        assert measured.stdout is not None
        if measured.stdout.readline().strip() == "ready":
            driver = subprocess.Popen([*again, "--part", "master"])
        return dict(json.loads(measured.stdout.readline()))
    finally:
        for process in (driver, measured, broker):
            if process is not None:
                process.terminate()
                process.wait()


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
