"""Planners that are other programs: a command with places for the instance and for the plan.

`{map}` and `{scen}` are the instance as MovingAI files, `{yaml}` as libMultiRobotPlanning's, `{agents}` the number of
robots, `{time_limit}` whole seconds, `{seed}` the problem's, `{out}` the file to write the plan to, in any format that
`peers` reads. The program runs in a session of its own and is killed with all its children at the time limit. What it
writes is data to be judged by the referee, whatever its exit code says. Refuses templates with other places.
"""

import os
import re
import shlex
import signal
import subprocess
import tempfile
from contextlib import suppress
from math import ceil
from pathlib import Path
from time import perf_counter

from mrp_sumo.core.plan import PlanResult, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.referee import judge
from mrp_sumo.errors import PlanError, nearest
from mrp_sumo.planning.peers import cells_of, movingai_map, movingai_scen, read_paths, yaml_instance

PLACES = ("map", "scen", "yaml", "agents", "time_limit", "seed", "out")
SAYS_INFEASIBLE = re.compile(r"no solution exists|unsolvable|infeasible", re.IGNORECASE)


def check_command(command: str) -> None:
    """Refuse a template that cannot work.

    Raises
    ------
    PlanError
        For an empty command, unbalanced quotes, an unknown place, or no {out}.
    """
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


def plan_externally(command: str, problem: Problem, time_limit_s: float) -> PlanResult:
    """Run the command on a problem with an assignment.

    Parameters
    ----------
    command
        The template; it is split like a shell's line, but run without a shell.
    problem
        Grids are written in all formats, other graphs only to {yaml}.
    time_limit_s
        Wall time; children that are left at its end are killed.

    Returns
    -------
    PlanResult
        SOLVED with a plan that has been read (the message says if the referee finds fault with it), TIMED_OUT, or GAVE_UP
        with the last line that the program printed.

    Raises
    ------
    PlanError
        For a command that cannot be started, or one that wants a map of a graph that is no grid.
    """
    check_command(command)
    cells = cells_of(problem.graph)
    if cells is None and ("{map}" in command or "{scen}" in command):
        raise PlanError(f"'{problem.graph.name}' is not a grid, so there is no {{map}} and {{scen}}: use {{yaml}}")
    with tempfile.TemporaryDirectory(prefix="mrp_sumo_") as name:
        folder = Path(name)
        files = {"map": folder / "instance.map", "scen": folder / "instance.scen", "yaml": folder / "instance.yaml", "out": folder / "plan"}
        if cells:
            files["map"].write_text(movingai_map(cells))
            files["scen"].write_text(movingai_scen(problem, cells, files["map"].name))
        files["yaml"].write_text(yaml_instance(problem, cells))
        values = {
            **{key: str(file) for key, file in files.items()},
            "agents": str(problem.num_robots),
            "time_limit": str(ceil(time_limit_s)),
            "seed": str(problem.seed),
        }
        words = [re.sub(r"\{(\w+)\}", lambda found: values[found[1]], word) for word in shlex.split(command)]
        begin_s = perf_counter()
        exit_code, said = _run(words, folder, time_limit_s)
        time_s = perf_counter() - begin_s
        if exit_code is None:
            return PlanResult(Status.TIMED_OUT, planning_time_s=time_s, message=f"killed after {time_limit_s:g} s")
        text = files["out"].read_text(errors="replace") if files["out"].is_file() else ""
    if not text.strip():
        status = Status.INFEASIBLE if SAYS_INFEASIBLE.search(said) else Status.GAVE_UP
        lines = said.strip().splitlines()
        told = f": {lines[-1][:200]}" if lines else ""
        return PlanResult(status, planning_time_s=time_s, message=f"{Path(words[0]).name} wrote no plan, exit code {exit_code}{told}")
    try:
        plan = read_paths(text, problem, cells, Path(words[0]).name)
    except PlanError as error:
        return PlanResult(Status.GAVE_UP, planning_time_s=time_s, message=str(error))
    verdict = judge(problem, plan)
    message = "" if verdict.valid else verdict.summary(problem)
    return PlanResult(Status.SOLVED, plan, planning_time_s=time_s, stats={"exit_code": float(exit_code)}, message=message)


def _run(words: list[str], folder: Path, time_limit_s: float) -> tuple[int | None, str]:
    """(exit code, or None when it was killed; what it printed)."""
    log = folder / "log"
    with log.open("wb") as printed:
        try:
            process = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=printed, stderr=subprocess.STDOUT, start_new_session=True)
        except OSError as error:
            raise PlanError(f"'{words[0]}' cannot be started: {error.strerror}") from None
        try:
            exit_code: int | None = process.wait(time_limit_s)
        except subprocess.TimeoutExpired:
            exit_code = None
        finally:
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(process.pid, signal.SIGKILL)  # the session began with it, so this is all its children
            process.wait()
    return exit_code, log.read_text(errors="replace")
