"""Mutation: small changes of the rules that decide, one at a time, each of which the tests of its room have to catch.

    .venv/bin/pip install cosmic-ray==8.7.0                      once; only this tool needs it (MIT, cosmic-ray.readthedocs.io)
    python tools/mutate.py --sample 300 --seed 1                 hours on one core
    python tools/mutate.py --sample 10 --seed 1 --room ledger    minutes

The mutants are cosmic-ray's, and are made in a copy of the project in a temporary folder. Tests run in forks of a process that has
loaded the libraries; kernels run as plain Python where a file of kernels is changed, else compiled. First a place in the sources is
drawn, then one of its mutants. Of its room's tests those run that come to the changed statement, or all where that happens before
any test or in other processes. A mutant is caught when one fails or takes much longer than all of them do without it.
Those that survive are a missing test or dead code; those that change nothing which matters are listed with the reason in
`tools/mutants.yaml`, and do not count. Exit code 1 when there are others.
"""

import argparse
import ast
import difflib
import multiprocessing
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).resolve().parents[1]
LISTED = ROOT / "tools/mutants.yaml"
KERNELS = ("conflicts", "constraints", "disturbance", "earliest", "heap", "mdd", "motion", "occupancy", "space_time")
ROOMS = {  # the files of each, and the tests that hold it
    "referee": (
        ["mrp_sumo/traffic/referee.py", "mrp_sumo/traffic/step_wise_referee.py", "mrp_sumo/traffic/clashes.py"],
        [*(f"tests/traffic/test_{name}.py" for name in ("referee", "step_wise_referee", "clashes")), "tests/planning/test_vehicles.py"],
    ),
    "reorder": (
        ["mrp_sumo/traffic/reorder.py", "mrp_sumo/traffic/schedule.py", "mrp_sumo/traffic/passages.py"],
        ["tests/traffic/test_reorder.py", "tests/traffic/test_schedule.py"],
    ),
    "ledger": (["mrp_sumo/drive/ledger.py"], [f"tests/drive/test_{name}.py" for name in ("ledger", "turns", "rolling")]),
    "controller": (
        ["mrp_sumo/drive/controller.py", "mrp_sumo/drive/cycle.py"],
        [f"tests/drive/test_{name}.py" for name in ("loop", "deadlock", "policy", "ledger", "people")],
    ),
    "grants": (["mrp_sumo/drive/_grants.py", "mrp_sumo/drive/_observe.py"], ["tests/drive/test_rules.py"]),
    "work": (
        [
            *(f"mrp_sumo/drive/{name}.py" for name in ("work", "crew", "robot_work", "work_request", "stalling", "charging", "orders")),
        ],
        [f"tests/drive/test_{name}.py" for name in ("crew", "dispatchers", "looks", "places", "shifts", "states", "work")],
    ),
    "places": (
        ["mrp_sumo/drive/places.py", "mrp_sumo/drive/clearing.py"],
        ["tests/drive/test_places.py", "tests/drive/test_clearing.py", "tests/drive/test_dispatchers.py", "tests/drive/test_ways.py"],
    ),
    "batteries": (
        ["mrp_sumo/drive/batteries.py", "mrp_sumo/core/battery.py"],
        ["tests/drive/test_batteries.py", "tests/core/test_battery.py"],
    ),
    "dispatchers": (["mrp_sumo/drive/dispatchers/*.py"], ["tests/drive/test_dispatchers.py", "tests/drive/test_bundle.py"]),
    "sizing": ([f"mrp_sumo/sizing/{name}.py" for name in ("search", "points", "answer", "causes", "confirmation")], ["tests/sizing"]),
    "statistics": (
        ["mrp_sumo/experiments/statistics.py"],
        ["tests/experiments/test_statistics.py", "tests/experiments/test_replications.py"],
    ),
    "warm-up": (["mrp_sumo/metrics/warm_up.py"], ["tests/metrics/test_warm_up.py"]),
    "metrics": (
        ["mrp_sumo/metrics/tasks.py", "mrp_sumo/metrics/motion.py", "mrp_sumo/metrics/facilities.py", "mrp_sumo/metrics/zones.py"],
        [f"tests/metrics/test_{name}.py" for name in ("tasks", "evaluate", "facilities", "zones")],
    ),
    "bounds": (
        ["mrp_sumo/metrics/planning.py", "mrp_sumo/planning/costs.py", "mrp_sumo/planning/answer_check.py"],
        ["tests/planning", "tests/metrics/test_evaluate.py"],
    ),
    "searches": (
        [f"mrp_sumo/search/_{name}.py" for name in KERNELS],
        ["tests/search", "tests/planners/conflict_based/test_cover.py", "tests/planners/conflict_based/test_joint_mdd.py"],
    ),
    "bodies": (
        [f"mrp_sumo/metrics/{name}.py" for name in ("audit", "_audit", "_walls", "_people", "_whereabouts", "referee_in_seconds")],
        [f"tests/metrics/test_{name}.py" for name in ("audit", "walls", "people", "referee_in_seconds")],
    ),
    "operations": (["mrp_sumo/metrics/operations/*.py"], ["tests/metrics/test_operations_audit.py"]),
    "bands": (
        ["mrp_sumo/experiments/error_bands.py", "mrp_sumo/experiments/run_bands.py", "mrp_sumo/sizing/bands.py"],
        ["tests/experiments/test_error_bands.py", "tests/experiments/test_run_bands.py", "tests/sizing/test_bands.py"],
    ),
    "crowd": (["mrp_sumo/crowd/*.py"], ["tests/crowd", "tests/experiments/test_people.py"]),
    "calibration": (
        [f"mrp_sumo/calibration/{name}.py" for name in ("cruise", "estimates", "orders", "phases", "ramps", "stops", "turning")],
        [f"tests/calibration/test_{name}.py" for name in ("estimates", "orders")],
    ),
    "predict": (
        ["mrp_sumo/calibration/prediction.py", "mrp_sumo/calibration/held_out.py"],
        ["tests/calibration/test_prediction.py", "tests/calibration/test_held_out.py", "tests/cli/test_predict.py"],
    ),
}
LEFT_OUT = ("RemoveDecorator", "VariableReplacer", "VariableInserter")  # of the operators: decorators are @njit and @dataclass
SAME = {  # operators that mean the same where they are used here: comparisons, and those of truth values
    *(("Eq", "Is"), ("Is", "Eq"), ("NotEq", "IsNot"), ("IsNot", "NotEq")),
    *(("BitAnd", "Mul"), ("BitOr", "Add")),
}
FORKS = multiprocessing.get_context("forkserver")
PRELOADED = (  # all but numba, which reads its settings when it is loaded
    *("hypothesis.strategies", "pytest", "xdist", "pytest_cov", "yaml", "pydantic", "numpy", "pandas", "matplotlib.figure", "networkx"),
    *("scipy.optimize", "scipy.stats", "scipy.sparse.csgraph", "scipy.spatial", "scipy.ndimage", "rosbags.typesys", "pyarrow.parquet"),
)
LIMIT = 2.5  # times as long as the tests take without a mutant


@dataclass(frozen=True)
class Mutant:
    """One change of one file."""

    room: str
    file: str
    line: int
    operator: str
    occurrence: int  # of what the operator can change in the file


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sample", type=int, default=30, help="mutants, spread over the rooms (default: 30)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--room", choices=ROOMS, action="append", help="may be repeated; all rooms by default")
    options = parser.parse_args()
    try:
        import cosmic_ray.mutating  # noqa: F401
    except ImportError:
        print("mutate: cosmic-ray is missing, expected: .venv/bin/pip install cosmic-ray==8.7.0", file=sys.stderr)
        return 2
    with tempfile.TemporaryDirectory(prefix="mutate_") as folder:
        copy = Path(folder)
        copy_project(copy)
        return report(sorted(drawn(options.room or list(ROOMS), options.sample, options.seed), key=lambda mutant: mutant.room), copy)


def copy_project(copy: Path) -> None:
    """The files that git knows, as they are now."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in listed.split("\0"):
        if name and (ROOT / name).is_file():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, copy / name)


def drawn(rooms: Sequence[str], count: int, seed: int) -> list[Mutant]:
    """Mutants, as many of each room as of the others, as far as it has that many places to change."""
    chance, places = random.Random(seed), {room: places_of(room) for room in rooms}
    for room in rooms:
        chance.shuffle(places[room])
    in_turn = [(n, room) for room in rooms for n in range(len(places[room]))]
    return [chance.choice(places[room][n]) for n, room in sorted(in_turn, key=lambda pair: pair[0])[:count]]


def places_of(room: str) -> list[list[Mutant]]:
    """The places of a room's files that can be changed, each with its mutants."""
    from cosmic_ray.ast import ast_nodes, get_ast
    from cosmic_ray.plugins import get_operator, operator_names

    names = [name for name in operator_names() if not name.endswith(LEFT_OUT) and tuple(name.split("_")[1:]) not in SAME]
    places: dict[tuple[str, Any], list[Mutant]] = {}
    for path in sorted(path for pattern in ROOMS[room][0] for path in ROOT.glob(pattern)):
        text, file = path.read_text(), path.relative_to(ROOT).as_posix()
        nodes, lines = list(ast_nodes(get_ast(text))), text.splitlines()
        for name in names:
            operator, occurrence = get_operator(name)(), 0
            for node in nodes:
                for start, end in operator.mutation_positions(node):
                    if not is_no_rule(node) and lines[start[0] - 1] != "if TYPE_CHECKING:":
                        places.setdefault((file, (start, end)), []).append(Mutant(room, file, start[0], name, occurrence))
                    occurrence += 1
    return list(places.values())


def is_no_rule(node: Any) -> bool:
    """Whether a node of the syntax tree is within a type, which says nothing to a running program, or a decorator such as @dataclass."""
    while node.parent is not None:
        child, node = node, node.parent
        if node.type == "decorator":
            return True
        if node.type == "tfpdef" and child is node.children[-1]:
            return True
        if node.type == "annassign" and child is node.children[1]:
            return True
        if node.type == "funcdef" and child is node.annotation:
            return True
    return False


def report(mutants: Sequence[Mutant], copy: Path) -> int:
    """Try the mutants, print what becomes of each and a table, and return the exit code."""
    listed = {(row["file"], row["before"], row["after"]) for row in yaml.safe_load(LISTED.read_text()) or []}
    count: Counter[tuple[str, str]] = Counter()
    for mutant, outcome, changes in outcomes(mutants, copy):
        if outcome == "survived" and any((mutant.file, before, after) in listed for before, after in changes):
            outcome = "listed"
        count[mutant.room, outcome] += 1
        print(f"{outcome:9} {mutant.file}:{mutant.line} ({mutant.room}, {mutant.operator.removeprefix('core/')})", flush=True)
        for before, after in changes if outcome == "survived" else ():
            print(f"    - {before}\n    + {after}", flush=True)
    print(f"\n{'room':12} {'mutants':>8} {'caught':>8} {'listed':>8} {'survived':>9} {'share caught':>13}")
    for room in (*dict.fromkeys(mutant.room for mutant in mutants), "all"):
        caught, known, survived = (
            sum(n for (of, what), n in count.items() if room in (of, "all") and what == outcome) for outcome in OUTCOMES
        )
        share = f"{caught / (caught + survived):.0%}" if caught + survived else "-"
        print(f"{room:12} {caught + known + survived:8} {caught:8} {known:8} {survived:9} {share:>13}")
    return int(any(outcome == "survived" for _, outcome in count))


OUTCOMES = ("caught", "listed", "survived")


def outcomes(mutants: Sequence[Mutant], copy: Path) -> Iterator[tuple[Mutant, str, list[tuple[str, str]]]]:
    """Each mutant, whether it was caught, and the lines that it changes, before and after.

    Raises
    ------
    SystemExit
        When the tests of a room fail without a mutant.
    """
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    FORKS.set_forkserver_preload(list(PRELOADED))
    limit_s: dict[tuple[str, bool], float] = {}
    for mutant in mutants:
        file, tests = copy / mutant.file, ROOMS[mutant.room][1]
        plain = file.name.startswith("_")
        covered = copy / f"covered_{mutant.room}_{plain}"
        if (mutant.room, plain) not in limit_s:
            begin_s = time.monotonic()
            if not passes(tests, plain, copy, None, covered):
                raise SystemExit(f"mutate: the tests of '{mutant.room}' fail without a mutant")
            limit_s[mutant.room, plain] = 20.0 + LIMIT * (time.monotonic() - begin_s)
        source = file.read_text()
        mutated = mutate_code(source, get_operator(mutant.operator)(), mutant.occurrence)
        assert mutated is not None, mutant
        file.write_text(mutated)
        caught = not passes(tests_of(file, source, mutant.line, covered) or tests, plain, copy, limit_s[mutant.room, plain])
        file.write_text(source)
        yield mutant, "caught" if caught else "survived", changed_lines(source, mutated)


def tests_of(file: Path, source: str, line: int, covered: Path) -> list[str]:
    """The tests that come to the statement on a line of a file, and all of a file whose fixtures do; none where that cannot be told."""
    from coverage import CoverageData

    data = CoverageData(str(covered))
    data.read()
    inside = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.stmt) and node.lineno <= line <= (node.end_lineno or 0)]
    lines = range(inside[-1].lineno, (inside[-1].end_lineno or 0) + 1) if inside else ()  # the innermost one
    contexts = {name for number, names in data.contexts_by_lineno(str(file)).items() if number in lines for name in names}
    whole = {name.partition("::")[0] for name in contexts if name.endswith("|setup")}
    return [] if "" in contexts else sorted(whole | {name.rpartition("|")[0] for name in contexts if name.partition("::")[0] not in whole})


def passes(tests: Sequence[str], plain: bool, copy: Path, limit_s: float | None, covered: Path | None = None) -> bool:
    """Whether tests pass, in time; `plain`: kernels are plain Python. Which lines each comes to is written to `covered`."""
    process = FORKS.Process(target=run_tests, args=(tests, plain, copy, covered))
    process.start()
    process.join(limit_s)
    if process.is_alive():
        os.killpg(process.pid, signal.SIGKILL)
        process.join()
    return process.exitcode == 0


def run_tests(tests: Sequence[str], plain: bool, copy: Path, covered: Path | None) -> None:
    """Run tests as a process of its own; bytecode is kept of files without a mutant."""
    os.setsid()
    os.chdir(copy)
    os.environ |= {"NUMBA_DISABLE_JIT": str(int(plain)), "PYTHONPATH": str(copy)}
    sys.path[:] = [str(copy), *(path for path in sys.path if Path(path) not in (ROOT, ROOT / "tools"))]
    sys.dont_write_bytecode = covered is None
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    import pytest

    options = ["-p", "no:cacheprovider", "-W", "ignore::pytest.PytestAssertRewriteWarning"]  # of plugins that are loaded already
    if covered:
        os.environ["COVERAGE_FILE"] = str(covered)
        options += ["--cov=mrp_sumo", "--cov-context=test", "--cov-report="]
    os._exit(int(pytest.main(["-x", "-q", *options, *tests])))


def changed_lines(before: str, after: str) -> list[tuple[str, str]]:
    """Lines that differ, without what they are indented by."""
    lines = list(difflib.ndiff(before.splitlines(), after.splitlines()))
    removed, added = ([line[2:].strip() for line in lines if line.startswith(sign)] for sign in ("- ", "+ "))
    return list(zip(removed, added, strict=False))


if __name__ == "__main__":
    raise SystemExit(main())
