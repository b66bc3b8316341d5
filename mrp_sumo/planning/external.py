"""Planners that are other programs: a command with places for the instance and for the plan.

`{map}` and `{scen}` are the instance as MovingAI files, `{yaml}` as libMultiRobotPlanning's, `{yaml_free}` the same with
every goal free for every robot (for programs that assign: CBS-TA, ECBS-TA), `{agents}` the number of robots,
`{time_limit}` whole seconds, `{seed}` the problem's, `{out}` the file to write the plan to, in any format that
`peers` reads. The program is killed with all its children soon after the time limit; what it has written by then still
counts. What it writes is data to be judged by the referee, whatever its exit code says. Refuses templates with other places.
"""

import os
import re
import shlex
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from math import ceil
from pathlib import Path
from time import perf_counter

from mrp_sumo.core import children
from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError, nearest
from mrp_sumo.formats.peers import Cells, cells_of, goals_reached, movingai_map, movingai_scen, own_time_s, read_paths, yaml_instance
from mrp_sumo.planning.processes import await_end
from mrp_sumo.traffic.referee import judge

PLACES = ("map", "scen", "yaml", "yaml_free", "agents", "time_limit", "seed", "out")
TAIL_BYTES = 65536  # of what a program prints, enough for its last words
SAYS_INFEASIBLE = re.compile(r"no solution exists|unsolvable|infeasible", re.IGNORECASE)


def check_command(command: str) -> None:
    """Refuse a template that cannot work. Raises PlanError for an empty command, unbalanced quotes, an unknown place, or no {out}."""
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise PlanError(f"command '{command}': {error}") from None
    if not words:
        raise PlanError("the command of the external planner is empty")
    for place in re.findall(r"\{([^{}]*)\}", command):
        if place not in PLACES:
            raise PlanError(f"command '{command}': unknown place '{{{place}}}'{nearest(place, PLACES, limit=len(PLACES))}")
    if "{out}" not in command:
        raise PlanError(f"command '{command}': no {{out}}, so there is no plan to read")


def assigns(command: str) -> bool:
    """True if the program chooses the goals' robots itself."""
    return "{yaml_free}" in command


def plan_externally(command: str, problem: Problem, time_limit_s: float) -> PlanResult:
    """Run the command, split like a shell's line but run without a shell, on a problem with an assignment unless the program `assigns`.

    Grids are written in all formats, other graphs only to {yaml} and {yaml_free}. The limit is wall time, but for what the program waits
    for a processor. One that ends by itself at the limit may still write its plan; what runs 4 % later (at least 0.08 s) is killed.

    The result is SOLVED with a plan that has been read (the message says if the referee finds fault with it), TIMED_OUT, with a plan where
    a valid one was written before the end, or GAVE_UP with the last line that the program printed. `stats` has the process's `cpu_s`, and
    `own_time_s` where the program's output has its solver's own time. Raises PlanError for a command that cannot be started, or one that
    wants a map of a graph that is no grid.
    """
    check_command(command)
    cells = cells_of(problem.graph)
    if cells is None and ("{map}" in command or "{scen}" in command):
        raise PlanError(f"'{problem.graph.name}' is not a grid, so there is no {{map}} and {{scen}}: use {{yaml}}")
    with tempfile.TemporaryDirectory(prefix="mrp_sumo_") as name:
        folder = Path(name)
        files = {key: folder / f"instance.{key}" for key in ("map", "scen", "yaml")}
        files |= {"yaml_free": folder / "instance_free.yaml", "out": folder / "plan"}
        for key, text in _instance(command, problem, cells).items():
            files[key].write_text(text)
        values = {
            **{key: str(file) for key, file in files.items()},
            "agents": str(problem.num_robots),
            "time_limit": str(ceil(time_limit_s)),
            "seed": str(problem.seed),
        }
        words = [re.sub(r"\{(\w+)\}", lambda place: values[place[1]], word) for word in shlex.split(command)]
        ran = _run(words, folder, time_limit_s + max(0.08, 0.04 * time_limit_s))
        text = files["out"].read_text(errors="replace") if files["out"].is_file() else ""
    program = Path(words[0]).name
    stats = {"cpu_s": ran.cpu_s}
    if (own := own_time_s(text)) is not None:
        stats["own_time_s"] = own
    if ran.exit_code is not None:
        stats["exit_code"] = float(ran.exit_code)
    late = PlanResult(Status.TIMED_OUT, planning_time_s=ran.time_s, stats=stats, message=f"killed after {time_limit_s:g} s")
    if not text.strip():
        if ran.exit_code is None:
            return late
        status = Status.INFEASIBLE if SAYS_INFEASIBLE.search(ran.said) else Status.GAVE_UP
        lines = ran.said.strip().splitlines()
        last_line = f": {lines[-1][:200]}" if lines else ""
        message = f"{program} wrote no plan, exit code {ran.exit_code}{last_line}"
        return PlanResult(status, planning_time_s=ran.time_s, stats=stats, message=message)
    try:
        plan = read_paths(text, problem, cells, program)
    except PlanError as error:
        if ran.exit_code is None:
            return late
        return PlanResult(Status.GAVE_UP, planning_time_s=ran.time_s, stats=stats, message=str(error))
    goal_of = goals_reached(problem, plan) if assigns(command) else None
    verdict = judge(problem, plan, goal_of)
    if ran.exit_code is None:  # an older answer may be whole, the last one may be cut off
        return PlanResult(Status.TIMED_OUT, plan, goal_of, ran.time_s, stats=stats, message=late.message) if verdict.valid else late
    message = "" if verdict.valid else verdict.summary(problem)
    return PlanResult(Status.SOLVED, plan, goal_of, ran.time_s, stats=stats, message=message)


def _instance(command: str, problem: Problem, cells: Cells | None) -> dict[str, str]:
    """Texts of the instance by place, those that the command has."""
    texts: dict[str, Callable[[], str]] = {
        "map": lambda: movingai_map(cells) if cells else "",
        "scen": lambda: movingai_scen(problem, cells, "instance.map") if cells else "",
        "yaml": lambda: yaml_instance(problem, cells),
        "yaml_free": lambda: yaml_instance(problem, cells, free=True),
    }
    return {key: text() for key, text in texts.items() if f"{{{key}}}" in command}


@dataclass(frozen=True)
class _Ran:
    """A process that has ended."""

    exit_code: int | None  # None when it was killed at its limit
    said: str  # the end of what it printed
    time_s: float
    cpu_s: float  # with the children it waited for


def _run(words: list[str], folder: Path, limit_s: float) -> _Ran:
    """Run to the end or the limit; nothing of it is left afterwards."""
    if not hasattr(os, "pidfd_open"):
        raise PlanError("external planners are run on Linux only")
    log = folder / "log"
    began = perf_counter()
    with log.open("wb") as printed:
        try:
            process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=printed, stderr=subprocess.STDOUT, start_new_session=True)
        except OSError as error:
            raise PlanError(f"'{words[0]}' cannot be started: {error.strerror}") from None
        ended = False
        try:
            ended = await_end(process.pid, limit_s)
        finally:
            time_s = perf_counter() - began
            children.kill_family(process.pid)  # not waited for yet, so that its number cannot be another's by now
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
    with log.open("rb") as printed:
        printed.seek(max(0, log.stat().st_size - TAIL_BYTES))
        said = printed.read().decode(errors="replace")
    return _Ran(process.returncode if ended else None, said, time_s, usage.ru_utime + usage.ru_stime)
