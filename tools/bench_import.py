"""Measures imports: wall time and memory of `mrp-sumo import` in a new process, the first time and again from the cache.

    python tools/bench_import.py                           the bundled airport, and a generated warehouse of 50,000 vertices
    python tools/bench_import.py FILE ... --graph all      other maps
    python tools/bench_import.py --json                    a line a map, for machines

"import" is everything: interpreter, reading, findings, network, nav graph, pictures, facts. "load" is `load_map` and
the imports it needs, in a new process. The cache is an empty folder of its own. Wall times mean something on an idle machine
only: the load is told with them. Targets: the airport in 1.5 s; 50,000 vertices in 60 s and 2 GB, loaded again in 1 s.
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TARGETS = {  # file -> what is measured -> at most
    "airport.building.yaml": {"import_s": 1.5},
    "warehouse.building.yaml": {"import_s": 60.0, "peak_mb": 2000.0, "load_again_s": 1.0},
}
MAIN = "import sys; from mrp_sumo.cli.main import main; sys.exit(main())"
LOAD = """
import sys
from pathlib import Path
from mrp_sumo.maps.load import load_map
graph = sys.argv[2]
nav = load_map(Path(sys.argv[1]), graph=int(graph) if graph.isdecimal() else graph or None).nav
print(nav.num_vertices, nav.num_lanes)
"""


def cpu_s() -> float:
    """CPU time of all processes that were started and have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def timed(command: list[str], cache: Path) -> tuple[float, float, str]:
    """Wall and CPU time of a process in s, and what it printed."""
    begun, used = time.perf_counter(), cpu_s()
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "XDG_CACHE_HOME": str(cache)})
    if done.returncode:
        sys.exit(done.stderr.strip())
    return time.perf_counter() - begun, cpu_s() - used, done.stdout


def measure(path: Path, graph: str, folder: Path) -> dict[str, float | int | str]:
    """One map."""
    cache, out = folder / "cache", folder / "out"
    run_import = [sys.executable, "-c", MAIN, "import", str(path), "--out", str(out), *(["--graph", graph] if graph else [])]
    first_s, first_cpu_s, _ = timed(run_import, cache)
    peak_mb = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024
    again_s, _, _ = timed(run_import, cache)
    load_again_s, _, counts = timed([sys.executable, "-c", LOAD, str(path), graph], cache)
    load_first_s, _, _ = timed([sys.executable, "-c", LOAD, str(path), graph], folder / "empty")
    num_vertices, num_lanes = map(int, counts.split())
    return {
        "map": path.name,
        "vertices": num_vertices,
        "lanes": num_lanes,
        "import_s": round(first_s, 3),
        "import_cpu_s": round(first_cpu_s, 3),
        "import_again_s": round(again_s, 3),
        "load_s": round(load_first_s, 3),
        "load_again_s": round(load_again_s, 3),
        "vertices_per_s": round(num_vertices / first_s),
        "peak_mb": round(peak_mb),  # of the largest process so far
        "machine_load": round(os.getloadavg()[0], 1),  # processes that ran or waited, in the last minute
    }


def missed(told: dict[str, float | int | str]) -> list[str]:
    """The targets of a map that were not reached."""
    targets = TARGETS.get(str(told["map"]), {})
    return [f"{name} {told[name]} > {most:g}" for name, most in targets.items() if float(told[name]) > most]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("files", metavar="FILE", nargs="*", type=Path)
    parser.add_argument("--graph", default="", help="graph of the files, or all")
    parser.add_argument("--vertices", type=int, default=50_000, help="of the generated warehouse")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        files = options.files
        if not files:
            warehouse = Path(temporary) / "warehouse.building.yaml"
            timed(
                [sys.executable, "-c", MAIN, "generate", "warehouse", "--vertices", str(options.vertices), "--out", str(warehouse)],
                Path(temporary),
            )
            files = [Path(__file__).parents[1] / "networks/airport/airport.building.yaml", warehouse]
        for k, path in enumerate(files):
            folder = Path(temporary) / str(k)
            folder.mkdir()
            told = measure(path, options.graph, folder)
            if options.json:
                print(json.dumps({**told, "targets": TARGETS.get(path.name, {}), "missed": missed(told)}), flush=True)
            else:
                print("{map}: {vertices} vertices, {lanes} lanes, {vertices_per_s} vertices/s, {peak_mb} MB".format(**told))
                print("  import {import_s:.2f} s ({import_cpu_s:.2f} s CPU), again {import_again_s:.2f} s".format(**told), end=", ")
                print("load {load_s:.2f} s, again {load_again_s:.2f} s; machine load {machine_load}".format(**told), flush=True)
                if path.name in TARGETS:
                    print("  targets: " + ("; ".join(missed(told)) or "all reached"), flush=True)


if __name__ == "__main__":
    main()
