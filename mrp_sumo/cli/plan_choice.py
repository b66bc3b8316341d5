"""Plan files on the command line: which format one is in, reading and writing it."""

from pathlib import Path
from typing import TYPE_CHECKING

from mrp_sumo.errors import MrpSumoError, PlanError, nearest
from mrp_sumo.files.reading import require_regular
from mrp_sumo.files.writing import write_text, written_for_user

if TYPE_CHECKING:
    from mrp_sumo.core.plan import Plan
    from mrp_sumo.core.problem import Problem
    from mrp_sumo.formats.peers import Cells

SUFFIXES = {".json": "json", ".yaml": "yaml", ".yml": "yaml", ".txt": "paths"}


def kind_of(path: Path, chosen: str | None) -> str:
    """The format to write: the chosen one, else by the suffix. Raises PlanError for a format or a suffix that is not known."""
    from mrp_sumo.formats.peers import FORMATS

    kinds = ["json", *FORMATS]
    if chosen is not None:
        if chosen not in kinds:
            raise PlanError(f"no plan format '{chosen}'{nearest(chosen, kinds)}")
        return chosen
    if path.suffix not in SUFFIXES:
        raise PlanError(f"'{path}': no plan format ends in '{path.suffix}'{nearest(path.suffix, SUFFIXES)}; or choose --format")
    return SUFFIXES[path.suffix]


def is_plan(path: Path) -> bool:
    """True if a file is a plan rather than a map; False where there is no such file."""
    import re

    from mrp_sumo.formats.peers import format_of
    from mrp_sumo.formats.plan_files import is_json

    try:
        require_regular(path)
        with path.open(encoding="utf-8") as file:
            head = file.read(4000)
    except (OSError, ValueError, MrpSumoError):
        return False
    if is_json(head):
        return '"robots"' in head and '"step_s"' in head
    return not re.search(r"^(levels|lanes|image)\s*:", head, re.MULTILINE) and format_of(head) is not None


def step_of(text: str) -> float:
    """The seconds a step takes in this program's plan file."""
    import json

    step_s = json.loads(text).get("step_s")
    if not isinstance(step_s, int | float) or not 0 < step_s < 1e6:
        raise PlanError(f"step_s is {step_s!r:.20}, expected a number above 0, below a million")
    return float(step_s)


def write(path: Path, kind: str, problem: "Problem", plan: "Plan", cells: "Cells | None") -> None:
    """Write a plan, whole or not at all."""
    from mrp_sumo.formats.peers import print_paths
    from mrp_sumo.formats.plan_json import write_plan

    if kind == "json":
        with written_for_user(path) as part:
            write_plan(part, problem, plan)
    else:
        write_text(path, print_paths(problem, plan, cells, kind))
