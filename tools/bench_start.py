"""Commands from the first second: CPU time, wall time and peak memory of whole processes.

    python tools/bench_start.py --times 5              the table: medians of five
    python tools/bench_start.py --against DIR          beside another checkout, in turn
    python tools/bench_start.py --only plan
    python tools/bench_start.py --fresh                the slow rows too: tools/run.sh and tools/test.sh in a new clone, a wheel's first run

Each command is run once before it is measured, so that byte code, kernels and networks are there. Compiled kernels are those
of your own cache, which are stored by the hash of their sources; maps are imported with an empty cache. A row is printed as
soon as it is measured. `report` writes the report of 180 made-up runs. CPU time and memory include the processes that a command
starts (the peak is that of the largest). Targets are CPU seconds and MB; wall seconds for the rows of --fresh, which
download packages.
"""

import argparse
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import bench
from bench_report import results

HERE = Path(__file__).resolve().parents[1]
NUM_RUNS = 180  # of the report


@dataclass(frozen=True)
class Timed:
    """A command, and what it may need."""

    name: str
    arguments: tuple[str, ...]  # of mrp-sumo; {scratch} is an empty folder, {runs} the made-up results
    cpu_s: float
    peak_mb: float | None = None
    is_cold: bool = False  # with an empty cache of maps


COMMANDS = (
    Timed("run office_9", ("run", "office_9", "--out", "{scratch}/run"), 1.6, 250),
    Timed("run airport_9", ("run", "airport_9", "--out", "{scratch}/run"), 3.5, 350),
    Timed("plan office_9 eecbs", ("plan", "office_9", "--planner", "eecbs", "--json"), 0.8),
    Timed("import airport", ("import", "airport", "--out", "{scratch}/map"), 1.2, is_cold=True),
    Timed("report of 180 runs", ("report", "{runs}", "--out", "{scratch}/report"), 4.0),
)
FRESH = {"tools/run.sh, fresh": 90.0, "tools/test.sh: set-up": 60.0, "tools/test.sh: tests": 120.0, "first run, cold kernels": 40.0}


def once(command: Timed, runs: Path) -> bench.Row:
    """One process of a command, in new folders; the cache of maps stays beside the made-up results."""
    with tempfile.TemporaryDirectory() as scratch:
        arguments = [argument.format(scratch=scratch, runs=runs) for argument in command.arguments]
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        environment |= {
            "PYTHONPATH": str(HERE),
            "PYTHONPYCACHEPREFIX": str(runs.parent / "bytecode"),
            "NUMBA_CACHE_DIR": os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache"),
            "XDG_CACHE_HOME": f"{scratch if command.is_cold else runs.parent}/cache",
        }
        return bench.process([*bench.COMMAND, *arguments], cwd=HERE, env=environment)


def fresh() -> Iterator[tuple[str, bench.Row]]:
    """The slow rows, once, in a clone of what is committed."""
    with tempfile.TemporaryDirectory() as scratch:
        clone = Path(scratch) / "clone"
        subprocess.run(["git", "clone", "--quiet", str(HERE), str(clone)], check=True)
        environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "NUMBA_CACHE_DIR", "VIRTUAL_ENV")}
        how = {"cwd": clone, "env": environment | {"XDG_CACHE_HOME": f"{scratch}/cache"}}
        yield "tools/run.sh, fresh", bench.process(["./tools/run.sh", "--out", f"{scratch}/run"], **how)
        yield "tools/test.sh: set-up", bench.process(["./tools/setup.sh", "test"], **how)
        yield "tools/test.sh: tests", bench.process([".venv/bin/python", "-m", "pytest", "-n", "auto"], **how)
        for folder in list(clone.rglob("__pycache__")):
            if ".venv" not in folder.parts:
                shutil.rmtree(folder)
        how["env"] |= {"XDG_CACHE_HOME": f"{scratch}/empty", "NUMBA_CACHE_DIR": f"{scratch}/kernels"}
        yield "first run, cold kernels", bench.process([".venv/bin/mrp-sumo", "run", "office_9", "--out", f"{scratch}/run"], **how)


def arguments(parser: argparse.ArgumentParser) -> None:
    """Rows."""
    parser.add_argument("--only", default="", metavar="TEXT", help="rows whose name holds this")
    parser.add_argument("--times", type=int, default=1, metavar="N", help="how often each is measured: medians (default: 1)")
    parser.add_argument("--fresh", action="store_true", help="the rows of a fresh machine, too")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row a command."""
    with tempfile.TemporaryDirectory() as folder:
        runs = Path(folder) / "results.parquet"
        results(NUM_RUNS).to_parquet(runs)
        for command in COMMANDS:
            if options.only in command.name:
                once(command, runs)
                all_figures = [once(command, runs) for _ in range(options.times)]
                figures = {name: statistics.median(each[name] for each in all_figures) for name in all_figures[0]}
                yield {"command": command.name, **figures, "wanted_cpu_s": command.cpu_s, "wanted_peak_mb": command.peak_mb}
    if options.fresh:
        for name, figures in fresh():
            yield {"command": name, **figures, "wanted_wall_s": FRESH[name]}


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
