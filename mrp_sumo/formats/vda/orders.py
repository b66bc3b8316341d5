"""A robot's way as orders of VDA 5050: the base is what it has been granted, the horizon the rest.

Whatever is granted, and every other way that a robot is sent, is an update of the order, with the last node of its base as the
stitching node. A robot that has made its way to the end gets a new order with its next way.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from mrp_sumo.core.graph import PlanGraph
from mrp_sumo.formats.vda.messages import Dialect, Json

MakeNode = Callable[[int, int, bool], Json]  # number of the visit along the way, sequence number, whether released
MakeEdge = Callable[[int, int, bool], Json]  # the edge after a visit, likewise


@dataclass
class VehicleOrders:
    """The orders of one vehicle so far. Visits are counted along its whole way."""

    serial: str
    number: int = -1  # of the order
    update: int = 0
    begin: int = 0  # the visit with which the order begins
    last_base: int = 0  # the visit that ended the base when the order was sent
    nodes: list[Json] = field(default_factory=list)  # all since the order began
    edges: list[Json] = field(default_factory=list)

    @property
    def name(self) -> str:
        return f"{self.serial}-{self.number}" if self.number >= 0 else ""

    @property
    def document(self) -> dict[str, Any]:
        """All nodes and edges of the order."""
        return {"nodes": self.nodes, "edges": self.edges}

    def is_driven(self, reached: int) -> bool:
        """True where there is nothing left of the order to drive."""
        return reached == self.last_base and len(self.nodes) == self.last_base - self.begin + 1

    def next(
        self, length: int, granted: int, reached: int, done: bool, make_node: MakeNode, make_edge: MakeEdge, *, is_at_work: bool = False
    ) -> Json | None:
        """The order, or its update, that says what the robot may do now; None where that has been said.

        The way has `length` visits, of which the robot may drive to `granted` and has come to `reached`. When the order is driven and its
        actions are over (`done`), a new one may come. `is_at_work` is whether the robot has more to do where it is.
        """
        if done or not self.nodes:
            if length - 1 <= reached and not is_at_work:
                return None
            self.number, self.update, self.begin, self.last_base = self.number + 1, 0, reached, reached
            nodes, edges, stitch = list[Json](), list[Json](), 0
        else:
            stitch = self.last_base - self.begin
            nodes, edges = self.nodes[: stitch + 1], self.edges[:stitch]
        first, base = self.begin, min(granted, length - 1)
        nodes += [make_node(k, 2 * (k - first), k <= granted) for k in range(first + len(nodes), length)]
        edges += [make_edge(k, 2 * (k - first) + 1, k < granted) for k in range(first + len(edges), length - 1)]
        if (nodes, edges) == (self.nodes, self.edges):
            return None
        if self.nodes and not done:
            self.update += 1
        self.nodes, self.edges, self.last_base = nodes, edges, base
        return {"orderId": self.name, "orderUpdateId": self.update, "nodes": nodes[stitch:], "edges": edges[stitch:]}


def edge_of(dialect: Dialect, graph: PlanGraph, tail: int, head: int, sequence: int, released: bool) -> Json:
    """The edge of an order for the lane between two vertices."""
    ends, lane = (graph.label(tail), graph.label(head)), graph.lane_between(tail, head)
    backward = graph.lane_options[lane].get("orientation_constraint") == "backward"
    length_m, limit_mps = float(graph.length_m[lane]), float(graph.speed_mps[lane])
    return dialect.edge(sequence, released, ends, length_m, limit_mps, backward)
