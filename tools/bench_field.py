"""From a map to an answer: `mrp-sumo run FILE` and nothing else on every map of some folders, and what came of it.

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
from dataclasses import dataclass
from pathlib import Path

SUFFIXES = (".building.yaml", ".lif.json", ".xml", ".site.json", ".geojson", ".nav.yaml", ".dxf")
COMMAND = (sys.executable, "-P", "-m", "mrp_sumo")
Call = Callable[[list[str], Path, int], tuple[int, str, float]]  # of a command in a folder: exit code, stderr, CPU time


@dataclass(frozen=True)
class Line:
    """One map, and what a command made of it."""

    map: str
    command: str
    status: str  # of the run; 'refused' with exit code 2, 'crashed' where there is a traceback, 'time' where it was stopped
    cpu_s: float
    robots: int | None = None
    off_m: float | None = None
    against_m: float | None = None
    note: str = ""

    @property
    def cells(self) -> str:
        """A row of the table."""
        numbers = ("" if n is None else f"{n:g}" for n in (self.robots, self.off_m, self.against_m))
        return "| " + " | ".join([self.map, self.command, self.status, *numbers, f"{self.cpu_s:.1f}", self.note.replace("|", "/")]) + " |"


def main() -> int:
    """Run all, write the table, print the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, metavar="MAPS", help="folders of maps, or maps")
    parser.add_argument("--types", nargs="+", default=[""], metavar="NAME", help="types of robots (default: run's own)")
    parser.add_argument("--init", action="store_true", help="init, run and capacity --quick instead of run alone")
    parser.add_argument("--cpu-s", type=int, default=240, metavar="S", help="CPU time of one command (default: 240)")
    parser.add_argument("--out", type=Path, metavar="FILE", help="where the table goes (default: printed)")
    parser.add_argument("--together", action="store_true", help="all commands in this process: sooner, and CPU times are without start")
    options = parser.parse_args()
    call = _called_here if options.together else _called
    lines: list[Line] = []
    for path in maps_in(options.folders):
        for each in _chain(path, call, options.cpu_s) if options.init else _types(path, call, options.types, options.cpu_s):
            lines.append(each)
            print(each.cells, flush=True)
            if options.out:
                options.out.write_text(table(lines), encoding="utf-8")
    print(summary(lines))
    return 0


def maps_in(folders: Sequence[Path]) -> Iterator[Path]:
    """The maps in some folders, by name; nav graphs that were made of another map are left out."""
    for folder in folders:
        files = sorted(folder.rglob("*")) if folder.is_dir() else [folder]
        yield from (
            path
            for path in files
            if path.is_file() and path.name.endswith(SUFFIXES) and not any(parent.suffix == ".nav" for parent in path.parents)
        )


def _types(path: Path, call: Call, types: Sequence[str], cpu_s: int) -> Iterator[Line]:
    for name in types:
        with tempfile.TemporaryDirectory() as folder:
            yield _run(path, call, [str(path), *(["--type", name] if name else [])], Path(folder), cpu_s)


def _chain(path: Path, call: Call, cpu_s: int) -> Iterator[Line]:
    """Init, and the commands that it leads to, as long as they succeed."""
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        code, said, spent_s = call(["init", str(path), "--out", str(work / "site")], work, cpu_s)
        yield Line(path.name, "init", _word(code, said), spent_s, note=_last(said) if code else "")
        if code:
            return
        scenario = str(work / "site" / "scenario.yaml")
        yield _run(path, call, [scenario, "--set", "execution.time_limit_s=600"], work, cpu_s)
        code, said, spent_s = call(["capacity", scenario, "--quick", "--out", str(work / "answer")], work, 4 * cpu_s)
        yield Line(path.name, "capacity", _word(code, said), spent_s, note=_last(said))


def _run(path: Path, call: Call, arguments: list[str], folder: Path, cpu_s: int) -> Line:
    code, said, spent_s = call(["run", *arguments, "--out", str(folder / "run")], folder, cpu_s)
    command, result = "run" + "".join(f" {a}" for a in arguments[1:]), folder / "run" / "result.json"
    if not result.is_file():
        return Line(path.name, command, _word(code, said), spent_s, note=_last(said))
    document = json.loads(result.read_text(encoding="utf-8"))
    lanes = document["lanes"] or {}
    return Line(
        path.name,
        command,
        document["status"] if code == 0 or document["status"] != "completed" else f"{document['status']}, exit code {code}",
        spent_s,
        document["metrics"]["num_robots"],
        lanes.get("off_m"),
        lanes.get("against_one_way_m"),
        document["note"],
    )


def _called(arguments: list[str], folder: Path, cpu_s: int) -> tuple[int, str, float]:
    """Exit code, what was said on stderr, and CPU time of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    limit = lambda: resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s + 5))  # noqa: E731
    done = subprocess.run(
        [*COMMAND, *arguments], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, preexec_fn=limit, check=False
    )
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


def table(lines: Sequence[Line]) -> str:
    """All lines as Markdown, and the counts."""
    head = (
        "| map | command | status | robots | off lanes (m) | against one-ways (m) | CPU (s) | note |\n|---|---|---|---|---|---|---|---|\n"
    )
    return head + "\n".join(line.cells for line in lines) + "\n\n" + summary(lines) + "\n"


def summary(lines: Sequence[Line]) -> str:
    """How many came to what."""
    counts = Counter((line.command.split(" --set")[0], line.status) for line in lines)
    off = sum(bool(line.off_m) for line in lines)
    against = sum(bool(line.against_m) for line in lines)
    parts = [f"{command}: {status} {count}" for (command, status), count in sorted(counts.items())]
    return "; ".join(parts) + f"; off lanes {off}; against one-ways {against}"


if __name__ == "__main__":
    sys.exit(main())
