"""From a map to an answer: `mrp-sumo run FILE` and nothing else on every map of some folders.

    .venv/bin/python tools/bench_field.py MAPS MORE_MAPS --out table.md
    .venv/bin/python tools/bench_field.py MAPS --types turtlebot3 amr_600 forklift
    .venv/bin/python tools/bench_field.py MAPS --init        # init, run what it wrote, capacity --quick

One process at a time, each with a limit of CPU time; a table with a line for each map, and counts.
"""

import argparse
import io
import json
import resource
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import bench

SUFFIXES = (".building.yaml", ".lif.json", ".xml", ".site.json", ".geojson", ".nav.yaml", ".dxf")
Call = Callable[[list[str], Path, int], tuple[int, str, float]]  # of a command in a folder: exit code, stderr, CPU time


def maps_in(folders: Sequence[Path]) -> Iterator[Path]:
    """The maps in some folders, by name; nav graphs that were made of another map are left out."""
    for folder in folders:
        files = sorted(folder.rglob("*")) if folder.is_dir() else [folder]
        yield from (
            path
            for path in files
            if path.is_file() and path.name.endswith(SUFFIXES) and not any(parent.suffix == ".nav" for parent in path.parents)
        )


def _types(path: Path, call: Call, types: Sequence[str], cpu_s: int) -> Iterator[bench.Row]:
    for name in types:
        with tempfile.TemporaryDirectory() as folder:
            yield _run(path, call, [str(path), *(["--type", name] if name else [])], Path(folder), cpu_s)


def _chain(path: Path, call: Call, cpu_s: int) -> Iterator[bench.Row]:
    """Init, and the commands that it leads to, as long as they succeed."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        code, said, spent_s = call(["init", str(path), "--out", str(work / "site")], work, cpu_s)
        yield _row(path, "init", _word(code, said), spent_s, _last(said) if code else "")
        if code:
            return
        scenario = str(work / "site" / "scenario.yaml")
        yield _run(path, call, [scenario, "--set", "execution.time_limit_s=600"], work, cpu_s)
        code, said, spent_s = call(["capacity", scenario, "--quick", "--out", str(work / "answer")], work, 4 * cpu_s)
        yield _row(path, "capacity", _word(code, said), spent_s, _last(said))


def _run(path: Path, call: Call, arguments: list[str], folder: Path, cpu_s: int) -> bench.Row:
    code, said, spent_s = call(["run", *arguments, "--out", str(folder / "run")], folder, cpu_s)
    command, result = "run" + "".join(f" {a}" for a in arguments[1:]), folder / "run" / "result.json"
    if not result.is_file():
        return _row(path, command, _word(code, said), spent_s, _last(said))
    document = json.loads(result.read_text(encoding="utf-8"))
    lanes = document["lanes"] or {}
    status = document["status"] if code == 0 or document["status"] != "completed" else f"{document['status']}, exit code {code}"
    row = _row(path, command, status, spent_s, document["note"])
    return row | {"robots": document["metrics"]["num_robots"], "off_m": lanes.get("off_m"), "against_m": lanes.get("against_one_way_m")}


def _row(path: Path, command: str, status: str, cpu_s: float, note: str) -> bench.Row:
    """One map, and what a command made of it; status is 'refused' with exit code 2, 'crashed' with a traceback, 'time' where stopped."""
    row: bench.Row = {"map": path.name, "command": command, "status": status, "robots": None, "off_m": None, "against_m": None}
    return row | {"cpu_s": cpu_s, "note": note}


def _called(arguments: list[str], folder: Path, cpu_s: int) -> tuple[int, str, float]:
    """Exit code, what was said on stderr, and CPU time of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    limit = lambda: resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 5))  # noqa: E731
    words, where = [*bench.COMMAND, *arguments], {"cwd": folder, "stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE}
    done = subprocess.run(words, **where, text=True, preexec_fn=limit, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return done.returncode, done.stderr, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _called_here(arguments: list[str], _: Path, cpu_s: int) -> tuple[int, str, float]:
    """The same in this process."""
    from mrp_sumo.cli.main import main as command

    def stop(*_: object) -> None:
        raise TimeoutError(f"after {cpu_s} s of CPU time")

    said, begin_s = io.StringIO(), time.process_time()
    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, cpu_s)
    try:
        with redirect_stdout(io.StringIO()), redirect_stderr(said):
            code = command(arguments)
    except TimeoutError as error:
        code = -1
        said.write(str(error))
    except Exception:
        code = 1
        traceback.print_exc(file=said)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    return code, said.getvalue(), time.process_time() - begin_s


def _word(code: int, said: str) -> str:
    if "Traceback" in said:
        return "crashed"
    if code < 0:
        return "time"
    return {0: "done", 2: "refused"}.get(code, f"exit code {code}") + (f", {said.count(chr(10))} lines" if said.count("\n") > 1 else "")


def _last(said: str) -> str:
    return said.strip().splitlines()[-1].removeprefix("mrp-sumo: ") if said.strip() else ""


def summary(rows: Sequence[bench.Row], options: argparse.Namespace) -> str:
    """Counts of what commands came to."""
    counts = Counter((row["command"].split(" --set")[0], row["status"]) for row in rows)
    off = sum(bool(row["off_m"]) for row in rows)
    against = sum(bool(row["against_m"]) for row in rows)
    parts = [f"{command}: {status} {count}" for (command, status), count in sorted(counts.items())]
    return "; ".join(parts) + f"; off lanes {off}; against one-ways {against}"


def arguments(parser: argparse.ArgumentParser) -> None:
    """Maps, and how commands are called."""
    parser.add_argument("folders", nargs="+", type=Path, metavar="MAPS", help="folders of maps, or maps")
    parser.add_argument("--types", nargs="+", default=[""], metavar="NAME", help="types of robots (default: run's own)")
    parser.add_argument("--init", action="store_true", help="init, run and capacity --quick instead of run alone")
    parser.add_argument("--cpu-s", type=int, default=240, metavar="S", help="CPU time of one command (default: 240)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="a file for the table, too, after each row")
    parser.add_argument("--together", action="store_true", help="all commands in this process: sooner, and CPU times are without start")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row for each map and command."""
    call, made = _called_here if options.together else _called, []
    for path in maps_in(options.folders):
        for row in _chain(path, call, options.cpu_s) if options.init else _types(path, call, options.types, options.cpu_s):
            made.append(row)
            if options.out:
                lines = [bench.line(row), "|" + "---|" * len(row), *(bench.line(map(bench.in_words, one.values())) for one in made)]
                options.out.write_text("\n".join([*lines, "", summary(made, options), ""]), encoding="utf-8")
            yield row


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
