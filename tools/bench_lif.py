"""The import of large LIF files, in CPU seconds: a grid of N edges, one in ten a curve.

tools/bench_lif.py --edges 50000
"""

import argparse
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bench

from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.readers.lif import Lif
from mrp_sumo.maps.readers.reader import Selection, map_file

KIND = "maker.series"


def lif_of(num_edges: int) -> dict[str, Any]:
    """A square grid with edges both ways, two metres apart, with a station every fifty nodes."""
    side = 2
    while 4 * side * (side - 1) < num_edges:
        side += 1
    nodes = [
        {
            "nodeId": f"N{x}_{y}",
            "mapId": "hall",
            "nodePosition": {"x": 2.0 * x, "y": 2.0 * y},
            "vehicleTypeNodeProperties": [{"vehicleTypeId": KIND}],
        }
        for y in range(side)
        for x in range(side)
    ]
    edges: list[dict[str, Any]] = []
    for y in range(side):
        for x in range(side):
            for dx, dy in ((1, 0), (0, 1)):
                if x + dx < side and y + dy < side:
                    for a, b in (((x, y), (x + dx, y + dy)), ((x + dx, y + dy), (x, y))):
                        edges.append(_edge(a, b, curved=len(edges) % 10 == 0))
    stations = [{"stationId": f"S{i}", "interactionNodeIds": [node["nodeId"]]} for i, node in enumerate(nodes[::50])]
    about = {"projectIdentification": "grid", "creator": "bench", "exportTimestamp": "2026-01-01T00:00:00.00Z", "lifVersion": "1.0.0"}
    layout = {"layoutId": "ground", "layoutVersion": "1", "nodes": nodes, "edges": edges[:num_edges], "stations": stations}
    return {"metaInformation": about, "layouts": [layout]}


def _edge(a: tuple[int, int], b: tuple[int, int], curved: bool) -> dict[str, Any]:
    of_kind: dict[str, Any] = {"vehicleTypeId": KIND, "rotationAllowed": False, "maxSpeed": 1.5}
    if curved:
        (x, y), (u, v) = ((2.0 * i, 2.0 * j) for i, j in (a, b))
        aside = ((v - y) / 4, (x - u) / 4)
        points = [(x, y), (x + aside[0], y + aside[1]), (u + aside[0], v + aside[1]), (u, v)]
        knots = [0, 0, 0, 0, 1, 1, 1, 1]
        of_kind["trajectory"] = {"degree": 3, "knotVector": knots, "controlPoints": [{"x": px, "y": py} for px, py in points]}
    ends = {"startNodeId": "N{}_{}".format(*a), "endNodeId": "N{}_{}".format(*b)}
    return {"edgeId": "E{}_{}-{}_{}".format(*a, *b), **ends, "vehicleTypeEdgeProperties": [of_kind]}


def arguments(parser: argparse.ArgumentParser) -> None:
    """The size."""
    parser.add_argument("--edges", type=int, default=50_000)


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """One row."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "grid.lif.json"
        path.write_text(json.dumps(lif_of(options.edges)))
        map_, read_cpu_s, _ = bench.timed(lambda: Lif().read(map_file(path), Selection()))
        _, load_cpu_s, _ = bench.timed(lambda: load_map(path))
        row = {"edges": options.edges, "lanes": map_.nav.num_lanes, "size_mb": round(path.stat().st_size / 1e6, 1)}
        yield row | {"read_cpu_s": read_cpu_s, "load_cpu_s": load_cpu_s}


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
