"""Measures imports: wall time and memory of `mrp-sumo import` in a new process, the first time and again from the cache.

    python tools/bench_import.py                           the bundled airport, and a generated warehouse of 50,000 vertices
    python tools/bench_import.py FILE ... --graph all      other maps
    python tools/bench_import.py --json                    a line a map, for machines

"import" is everything: interpreter, reading, findings, network, nav graph, pictures, facts. "load" is `load_map` and
the imports it needs, in a new process. The cache is an empty folder of its own. Wall times mean something on an idle machine
only: the load is told with them. Targets: the airport in 1.5 s; 50,000 vertices in 60 s and 2 GB, loaded again in 1 s.
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import bench

TARGETS = {  # file -> what is measured -> at most
    "airport.building.yaml": {"import_s": 1.5},
    "warehouse.building.yaml": {"import_s": 60.0, "peak_mb": 2000.0, "load_again_s": 1.0},
}
LOAD = """
import sys
from pathlib import Path
from mrp_sumo.maps.load import load_map
graph = sys.argv[2]
nav = load_map(Path(sys.argv[1]), graph=int(graph) if graph.isdecimal() else graph or None).nav
Path(sys.argv[3]).write_text(f"{nav.num_vertices} {nav.num_lanes}")
"""


def measure(path: Path, graph: str, folder: Path) -> bench.Row:
    """One map."""
    out, counts = folder / "out", folder / "counts"
    env = {**os.environ, "XDG_CACHE_HOME": str(folder / "cache")}
    command = [*bench.COMMAND, "import", path, "--out", out, *(["--graph", graph] if graph else [])]
    load = [sys.executable, "-c", LOAD, path, graph, counts]
    first, again = (bench.process(command, env=env) for _ in range(2))
    load_again = bench.process(load, env=env)
    load_first = bench.process(load, env={**env, "XDG_CACHE_HOME": str(folder / "empty")})
    num_vertices, num_lanes = map(int, counts.read_text().split())
    return {
        "map": path.name,
        "vertices": num_vertices,
        "lanes": num_lanes,
        "import_s": first["wall_s"],
        "import_cpu_s": first["cpu_s"],
        "import_again_s": again["wall_s"],
        "load_s": load_first["wall_s"],
        "load_again_s": load_again["wall_s"],
        "vertices_per_s": round(num_vertices / first["wall_s"]),
        "peak_mb": first["peak_mb"],
    }


def arguments(parser: argparse.ArgumentParser) -> None:
    """Maps."""
    parser.add_argument("files", metavar="FILE", nargs="*", type=Path)
    parser.add_argument("--graph", default="", help="graph of the files, or all")
    parser.add_argument("--vertices", type=int, default=50_000, help="of the generated warehouse")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row a map."""
    with tempfile.TemporaryDirectory() as temporary:
        files = options.files
        if not files:
            warehouse = Path(temporary) / "warehouse.building.yaml"
            bench.process([*bench.COMMAND, "generate", "warehouse", "--vertices", options.vertices, "--out", warehouse])
            files = [Path(__file__).parents[1] / "networks/airport/airport.building.yaml", warehouse]
        for k, path in enumerate(files):
            folder = Path(temporary) / str(k)
            folder.mkdir()
            row = measure(path, options.graph, folder)
            missed = [f"{name} over {most:g}" for name, most in TARGETS.get(path.name, {}).items() if row[name] > most]
            yield row | {"missed": ", ".join(missed)}


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
