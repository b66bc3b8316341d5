"""Benchmarks: one way to call them, to time, to print, and to compare with another checkout.

    .venv/bin/python tools/bench.py                           the cases, a line each
    .venv/bin/python tools/bench.py CASE [its options]        a table, below a line about the machine
    .venv/bin/python tools/bench.py CASE ... --json           a line of JSON for each row
    .venv/bin/python tools/bench.py CASE ... --against DIR    in turn here and in another checkout: medians of five, and their ratio

A case is a file `bench_CASE.py` beside this one and can be called by its own name, too. Its docstring says what it measures,
`arguments(parser)` adds its options, `rows(options)` measures and yields a dictionary for each row, and `summary(rows, options)`, where
there is one, says what all rows come to. A row with `failed` that is true gives exit code 1. Names of columns carry units; `cpu_s` is
processor time, which tells more than wall time where others use the machine.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
from ast import get_docstring, parse
from collections.abc import Callable, Iterable, Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

TOOLS = Path(__file__).resolve().parent
COMMAND = (sys.executable, "-P", "-m", "mrp_sumo")
Row = dict[str, Any]


def main(file: str | None = None) -> int:
    """Run the case of a file, or the one that the command line names. Exit code 2 for bad input."""
    from mrp_sumo.errors import MrpSumoError

    words, cases = sys.argv[1:], {path.stem.removeprefix("bench_"): path for path in sorted(TOOLS.glob("bench_*.py"))}
    if file is not None:
        name = Path(file).stem.removeprefix("bench_")
    elif words and words[0] in cases:
        name, *words = words
    else:
        for name, path in cases.items():
            print(f"{name:<12} {(get_docstring(parse(path.read_text(encoding='utf-8'))) or '').splitlines()[0]}")
        if words:
            print(f"bench.py: {words[0]}: no such case", file=sys.stderr)
        return 2 if words else 0
    sys.path[:0] = [str(TOOLS), str(TOOLS.parent / "tests")]
    case = import_module(f"bench_{name}")
    of_all = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    of_all.add_argument("--json", action="store_true", help="a line of JSON for each row")
    of_all.add_argument("--against", type=Path, metavar="DIR", help="another checkout of this project, measured in turn with this one")
    of_all.add_argument("--repeat", type=int, default=5, metavar="N", help="with --against: how often (default: 5)")
    how = {"formatter_class": argparse.RawDescriptionHelpFormatter, "parents": [of_all]}
    parser = argparse.ArgumentParser(f"bench_{name}.py", description=case.__doc__, **how)
    case.arguments(parser)
    options, (_, words) = parser.parse_args(words), of_all.parse_known_args(words)
    try:
        made = compared(f"bench_{name}.py", words, options.against.resolve(), options.repeat) if options.against else case.rows(options)
        rows = shown(made, options.json)
    except (MrpSumoError, ValueError) as error:
        print(f"bench_{name}.py: {error}", file=sys.stderr)
        return 2
    if hasattr(case, "summary") and not options.json and not options.against:
        print(f"\n{case.summary(rows, options)}")
    return int(any(row.get("failed") for row in rows))


def shown(made: Iterable[Row], as_json: bool) -> list[Row]:
    """Print rows as soon as they are there."""
    if not as_json:
        print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, Python {sys.version.partition(' ')[0]}\n")
    rows: list[Row] = []
    for row in made:
        if as_json:
            print(json.dumps(row), flush=True)
        else:
            if not rows or list(rows[-1]) != list(row):
                print("\n" * bool(rows) + line(row) + "\n|" + "---|" * len(row))
            print(line(map(in_words, row.values())), flush=True)
        rows.append(row)
    return rows


def line(cells: Iterable[str]) -> str:
    """A line of a table in Markdown."""
    return "| " + " | ".join(cell.replace("|", "/") for cell in cells) + " |"


def in_words(value: object) -> str:
    """A value as people read it: four significant digits."""
    if isinstance(value, float):
        return f"{value:.0f}" if 1000 <= abs(value) < 1e12 else f"{value:.4g}"
    return "–" if value is None else {True: "yes", False: "no"}.get(value, str(value)) if isinstance(value, bool) else str(value)


def compared(script: str, words: list[str], other: Path, repeat: int) -> Iterator[Row]:
    """Medians of each figure that differs between runs, here and in another checkout, whose own script measures it."""
    made: dict[Path, list[list[Row]]] = {TOOLS.parent: [], other: []}
    for root, runs in [*made.items()] * repeat:
        environment = {**os.environ, "PYTHONPATH": str(root)}
        command = [sys.executable, f"tools/{script}", *words, "--json"]
        done = subprocess.run(command, cwd=root, env=environment, stdout=subprocess.PIPE, text=True, check=True)
        runs.append([row for row in map(json.loads, done.stdout.splitlines()) if "machine" not in row])
    for here, there in zip(zip(*made[TOOLS.parent]), zip(*made[other])):
        both = {key: [[row[key] for row in runs if key in row] for runs in (here, there)] for key in here[0] if key in there[0]}
        measured = {key: values for key, values in both.items() if is_measured([*values[0], *values[1]])}
        before = list(both).index(next(iter(measured))) if measured else 0  # what stands before the first figure is the row's name
        label = ", ".join(f"{key} {in_words(here[0][key])}" for key in list(both)[:before])
        for key, values in measured.items():
            ours, theirs = map(statistics.median, values)
            yield {"row": label, "figure": key, "here": ours, "there": theirs, "here / there": round(ours / theirs, 3) if theirs else None}


def is_measured(values: list[Any]) -> bool:
    """True for numbers that are not all the same."""
    return all(isinstance(one, int | float) and not isinstance(one, bool) for one in values) and len(set(values)) > 1


def timed(work: Callable[[], Any]) -> tuple[Any, float, float]:
    """The result of a call, its CPU time and its wall time in s."""
    wall_s, cpu_s = time.perf_counter(), time.process_time()
    result = work()
    return result, time.process_time() - cpu_s, time.perf_counter() - wall_s


def process(command: Iterable[object], **how: Any) -> Row:
    """CPU and wall time in s and peak memory in MB of a program and those it waits for.

    Raises
    ------
    ValueError
        For another exit code than 0, with what was printed on stderr.
    """
    words = [str(word) for word in command]
    began = time.perf_counter()
    program = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, **how)
    assert program.stderr is not None
    with program.stderr:
        errors = program.stderr.read()
    _, status, used = os.wait4(program.pid, 0)
    program.returncode = os.waitstatus_to_exitcode(status)
    if program.returncode:
        raise ValueError(f"{' '.join(words)}: exit code {program.returncode}\n{errors}")
    wall_s = time.perf_counter() - began
    return {
        "cpu_s": round(used.ru_utime + used.ru_stime, 3),
        "wall_s": round(wall_s, 3),
        "peak_mb": round(used.ru_maxrss / 1024),
    }


if __name__ == "__main__":
    sys.exit(main())
