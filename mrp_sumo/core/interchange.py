"""Nav graphs as networkx graphs and back, for people and their own algorithms.

Refuses vertices without coordinates. `core.graph` imports this file when it is first needed, not the other way round.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

from mrp_sumo.errors import MapError

if TYPE_CHECKING:
    import networkx

OWN = ("name", "x_m", "y_m", "level", "pos")  # attributes of a node that are no options


def digraph_of(graph: Any) -> "networkx.DiGraph":
    """The directed graph of a NavGraph, as `NavGraph.to_networkx`."""
    import networkx as nx

    about = {"name": graph.name, "level_names": graph.level_names}
    digraph = nx.DiGraph(**about, **{key: getattr(graph, key) for key in ("kind", "cell_m") if hasattr(graph, key)})
    for v, (x, y) in enumerate(graph.xy.tolist()):
        level = graph.level_names[graph.level[v]]
        digraph.add_node(v, **{**graph.vertex_options[v], "name": graph.vertex_name[v], "x_m": x, "y_m": y, "level": level})
    lanes = zip(graph.tail.tolist(), graph.head.tolist(), graph.length_m.tolist(), graph.speed_mps.tolist(), graph.lane_options)
    for tail, head, length_m, speed_mps, options in lanes:
        digraph.add_edge(tail, head, **{**options, "length_m": length_m, **({"speed_mps": speed_mps} if np.isfinite(speed_mps) else {})})
    return digraph


def parts_of(digraph: "networkx.Graph", name: str) -> dict[str, Any]:
    """Arguments of `nav_graph`, from a graph of networkx; as `NavGraph.from_networkx`."""
    number = {node: v for v, node in enumerate(digraph)}
    nodes = [attributes for _, attributes in digraph.nodes(data=True)]
    level_names = list(digraph.graph.get("level_names", ())) or list(dict.fromkeys(a.get("level", "L1") for a in nodes)) or ["L1"]
    edges = [(number[a], number[b], attributes) for a, b, attributes in digraph.edges(data=True)]
    if not digraph.is_directed():
        edges += [(b, a, attributes) for a, b, attributes in edges]
    xy = np.array([_place(node, attributes) for node, attributes in digraph.nodes(data=True)], np.float64).reshape(-1, 2)
    for attributes in nodes:
        if attributes.get("level", level_names[0]) not in level_names:
            raise MapError(f"level '{attributes['level']}' is not among the graph's level_names ({', '.join(level_names)})")
    straight = [float(np.hypot(*(xy[b] - xy[a]))) for a, b, _ in edges]
    return {
        "name": name or digraph.graph.get("name") or "graph",
        "level_names": level_names,
        "xy": xy,
        "level": [level_names.index(attributes.get("level", level_names[0])) for attributes in nodes],
        "vertex_name": [
            str(attributes.get("name", node if isinstance(node, str) else "")) for node, attributes in digraph.nodes(data=True)
        ],
        "vertex_options": [{key: value for key, value in attributes.items() if key not in OWN} for attributes in nodes],
        "lanes": [(a, b) for a, b, _ in edges],
        "length_m": [attributes.get("length_m", length_m) for (_, _, attributes), length_m in zip(edges, straight)],
        "speed_mps": [attributes.get("speed_mps", np.inf) for _, _, attributes in edges],
        "lane_options": [{k: v for k, v in attributes.items() if k not in ("length_m", "speed_mps")} for _, _, attributes in edges],
    }


def _place(node: Any, attributes: dict[str, Any]) -> tuple[float, float]:
    """Where a node is: `x_m` and `y_m`, `pos`, or the node itself where it is a pair of numbers, as in a grid of networkx."""
    place = (attributes["x_m"], attributes["y_m"]) if {"x_m", "y_m"} <= set(attributes) else attributes.get("pos", node)
    try:
        x, y = map(float, place)
    except (TypeError, ValueError):
        raise MapError(f"node {node!r} has no place: give it x_m and y_m in m, or pos") from None
    return x, y
