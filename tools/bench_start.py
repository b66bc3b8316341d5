"""How quick commands are from the first second: CPU time, wall time and peak memory of whole processes.

    python tools/bench_start.py                        the table: medians of five
    python tools/bench_start.py --against DIR          and of another checkout, run in turn with this one, with the ratio of CPU times
    python tools/bench_start.py --only plan --repeats 9
    python tools/bench_start.py --fresh                the slow rows too: tools/run.sh and tools/test.sh in a new clone, a wheel's first run
    python tools/bench_start.py --json                 a line for each row

Each command is run once before it is measured, so that byte code, kernels and networks are there. Compiled kernels are those
of your own cache, which are stored by the hash of their sources; maps are imported with an empty cache. A row is printed as
soon as it is measured. `report` writes the report of 180 made-up runs. CPU time and memory include the processes that a command
starts (the peak is that of the largest). Targets are CPU seconds and MB; wall seconds for the rows of --fresh, which
download packages.
"""

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
MAIN = "import sys; from mrp_sumo.cli.main import main; sys.exit(main())"
NUM_RUNS = 180  # of the report
MADE_UP = "import sys; sys.path.insert(0, sys.argv[1]); from bench_report import results; results(int(sys.argv[2])).to_parquet(sys.argv[3])"


@dataclass(frozen=True)
class Row:
    """A command, and what it may need."""

    name: str
    arguments: tuple[str, ...]  # of mrp-sumo; {scratch} is an empty folder, {runs} the made-up results
    cpu_s: float
    peak_mb: float | None = None
    is_cold: bool = False  # with an empty cache of maps


ROWS = (
    Row("run office_9", ("run", "office_9", "--out", "{scratch}/run"), 1.6, 250),
    Row("run airport_9", ("run", "airport_9", "--out", "{scratch}/run"), 3.5, 350),
    Row("plan office_9 eecbs", ("plan", "office_9", "--planner", "eecbs", "--json"), 0.8),
    Row("import airport", ("import", "airport", "--out", "{scratch}/map"), 1.2, is_cold=True),
    Row("report of 180 runs", ("report", "{runs}", "--out", "{scratch}/report"), 4.0),
)
FRESH = {"tools/run.sh, fresh": 90.0, "tools/test.sh: set-up": 60.0, "tools/test.sh: tests": 120.0, "first run, cold kernels": 40.0}

Figures = dict[str, float]


def measured(command: list[str], folder: Path, environment: dict[str, str]) -> Figures:
    """CPU and wall time in s and peak memory in MB of a process and those it waits for."""
    began = time.perf_counter()
    process = subprocess.Popen(command, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    said = process.stderr.read()
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        sys.exit(f"{' '.join(command)}: exit code {process.returncode}\n{said}")
    wall_s = time.perf_counter() - began
    return {"cpu_s": used.ru_utime + used.ru_stime, "wall_s": wall_s, "peak_mb": used.ru_maxrss / 1024}


def once(row: Row, checkout: Path, runs: Path) -> Figures:
    """One process of a row, in new folders; a checkout's cache of maps stays beside the made-up results."""
    with tempfile.TemporaryDirectory() as scratch:
        arguments = [argument.format(scratch=scratch, runs=runs) for argument in row.arguments]
        cache = Path(scratch) if row.is_cold else runs.parent / checkout.as_posix().strip("/").replace("/", "-")
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
        environment |= {
            "PYTHONPATH": str(checkout),
            "PYTHONPYCACHEPREFIX": str(runs.parent / "bytecode"),
            "NUMBA_CACHE_DIR": os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache"),
            "XDG_CACHE_HOME": f"{cache}/cache",
        }
        return measured([sys.executable, "-c", MAIN, *arguments], checkout, environment)


def median(figures: list[Figures]) -> Figures:
    """Of each figure by itself."""
    return {name: round(statistics.median(each[name] for each in figures), 2) for name in figures[0]}


def in_turn(row: Row, checkouts: list[Path], repeats: int, runs: Path) -> list[Figures]:
    """Medians for each checkout; measured alternately, so that a busy machine slows all alike."""
    for checkout in checkouts:
        once(row, checkout, runs)
    found: list[list[Figures]] = [[] for _ in checkouts]
    for _ in range(repeats):
        for checkout, figures in zip(checkouts, found):
            figures.append(once(row, checkout, runs))
    return [median(figures) for figures in found]


def fresh(checkout: Path) -> dict[str, Figures]:
    """The slow rows, once, in a clone of what is committed."""
    found: dict[str, Figures] = {}
    with tempfile.TemporaryDirectory() as scratch:
        clone, cache = Path(scratch) / "clone", Path(scratch) / "cache"
        subprocess.run(["git", "clone", "--quiet", str(checkout), str(clone)], check=True)
        environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "NUMBA_CACHE_DIR", "VIRTUAL_ENV")}
        environment["XDG_CACHE_HOME"] = str(cache)
        found["tools/run.sh, fresh"] = measured(["./tools/run.sh", "--out", f"{scratch}/run"], clone, environment)
        found["tools/test.sh: set-up"] = measured(["./tools/setup.sh", "test"], clone, environment)
        found["tools/test.sh: tests"] = measured([".venv/bin/python", "-m", "pytest", "-n", "auto"], clone, environment)
        for folder in list(clone.rglob("__pycache__")):
            if ".venv" not in folder.parts:
                shutil.rmtree(folder)
        environment |= {"XDG_CACHE_HOME": f"{scratch}/empty", "NUMBA_CACHE_DIR": f"{scratch}/kernels"}
        command = [".venv/bin/mrp-sumo", "run", "office_9", "--out", f"{scratch}/run"]
        found["first run, cold kernels"] = measured(command, clone, environment)
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, metavar="DIR", help="another checkout")
    parser.add_argument("--only", default="", metavar="TEXT", help="rows whose name holds this")
    parser.add_argument("--repeats", type=int, default=5, metavar="N")
    parser.add_argument("--fresh", action="store_true", help="the rows of a fresh machine, too")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    checkouts = [HERE, *([options.against.resolve()] if options.against else [])]
    say: Callable[[dict[str, object]], None] = _print_json if options.json else _print_row
    machine = subprocess.run([sys.executable, str(HERE / "tools/bench_machine.py"), "--json"], capture_output=True, text=True, check=True)
    if options.json:
        print(machine.stdout.strip(), flush=True)
    else:
        figures = json.loads(machine.stdout)["machine"]
        print("machine: loop {loop_msteps_per_s} million steps/s, copy {copy_gb_per_s} GB/s, {cores} cores, load {load}".format(**figures))
        print(
            f"{'':24} {'CPU s':>7} {'wanted':>7} {'wall s':>7} {'MB':>5} {'wanted':>7}"
            + "  against: CPU s, MB, ratio" * bool(options.against)
        )
    with tempfile.TemporaryDirectory() as folder:
        runs = Path(folder) / "results.parquet"
        subprocess.run([sys.executable, "-c", MADE_UP, str(HERE / "tools"), str(NUM_RUNS), str(runs)], check=True)
        for row in ROWS:
            if options.only in row.name:
                ours, *others = in_turn(row, checkouts, options.repeats, runs)
                shown: dict[str, object] = {"row": row.name, **ours, "wanted_cpu_s": row.cpu_s, "wanted_peak_mb": row.peak_mb}
                if others:
                    shown |= {"against": others[0], "cpu_ratio": round(ours["cpu_s"] / others[0]["cpu_s"], 3)}
                say(shown)
    if options.fresh:
        for name, figures in fresh(HERE).items():
            say({"row": name, **{k: round(v, 1) for k, v in figures.items()}, "wanted_wall_s": FRESH[name]})


def _print_json(shown: dict[str, object]) -> None:
    print(json.dumps(shown), flush=True)


def _print_row(shown: dict[str, object]) -> None:
    wanted_mb, against = shown.get("wanted_peak_mb"), shown.get("against")
    line = f"{shown['row']:24} {shown['cpu_s']:7.2f} {shown.get('wanted_cpu_s', ''):>7} {shown['wall_s']:7.2f} {shown['peak_mb']:5.0f}"
    line += f" {wanted_mb or '':>7}" if "wanted_cpu_s" in shown else f"  wanted: {shown['wanted_wall_s']:g} s of wall time"
    if isinstance(against, dict):
        line += f"  {against['cpu_s']:.2f}, {against['peak_mb']:.0f}, {shown['cpu_ratio']}"
    print(line, flush=True)


if __name__ == "__main__":
    main()
