"""Plug-ins and programs that scenarios name, and whether they are trusted."""

import shlex
from collections.abc import Iterator
from functools import reduce
from pathlib import Path
from typing import Any

from mrp_sumo.errors import ScenarioError
from mrp_sumo.io.columns import MAIN_KEYS
from mrp_sumo.io.documents import Place
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.model import ScenarioModel
from mrp_sumo.maps.catalogue import bundled_folder
from mrp_sumo.plugins.source import program_of
from mrp_sumo.plugins.trust import Program, in_trusted_folder, is_trusted, trust

PLUG_INS = {  # keys that name plug-ins, and their kinds
    "map.reader": "readers",
    "planner.name": "planners",
    "assignment.solver": "assigners",
    "execution.policy.name": "policies",
    "execution.dispatcher.name": "dispatchers",
    "execution.recovery.replanner": "planners",
}


def plug_ins_of(scenario: ScenarioModel) -> Iterator[tuple[Place, str, str]]:
    """(place, kind, name) of every plug-in that a scenario names."""
    for key, kind in PLUG_INS.items():
        place = tuple(key.split("."))
        if name := reduce(getattr, place, scenario):
            yield place, kind, str(name)
    for i, metric in enumerate(scenario.record.metrics):
        yield ("record", "metrics", i), "metrics", metric


def programs_of(file: ScenarioFile) -> Iterator[tuple[Place, Program]]:
    """(place, program) of every plug-in file, and of the command, that a scenario names."""
    for place, _, name in plug_ins_of(file.scenario):
        if program := program_of(name, file.folder):
            yield place, program
    planner = file.scenario.planner
    if planner.name == "external" and planner.parameters.get("command"):
        yield ("planner", "parameters", "command"), Program(None, str(planner.parameters["command"]))


def trust_programs(file: ScenarioFile) -> None:
    """Trust the programs that a scenario names, until this process ends."""
    for _, program in programs_of(file):
        trust(program)


def require_trust(file: ScenarioFile, *folders: Path) -> None:
    """Refuse a scenario that names programs which are not trusted, nor in a trusted folder, nor come with this program.

    `folders` are those of more files that had a say in it, such as a suite's base. Raises ScenarioError: one line per program: what would
    be run, and how to trust it.
    """
    unknown = [(place, program) for place, program in programs_of(file) if not is_trusted(program)]
    if not unknown:
        return
    places = [folder.resolve() for folder in (file.folder, *folders)]
    odd = [folder for folder in places if not folder.is_relative_to(bundled_folder("scenarios")) and not in_trusted_folder(folder)]
    if not odd:
        for _, program in unknown:
            trust(program)
        return
    how = f"name it on the command line, add --trust, or trust the folder once: mrp-sumo trust {shlex.quote(str(odd[0]))}"
    raise ScenarioError(*(f"{file.at(*place)}: would run {program.shown}, which is not trusted; {how}" for place, program in unknown))


def is_plug_in(key: str) -> bool:
    """True if a dotted key, or the key that it is short for, names a plug-in."""
    return f"{key}.{MAIN_KEYS.get(key)}" in PLUG_INS or key in PLUG_INS


def rename(data: dict[str, Any], place: Place, name: str) -> None:
    """Change the name of a plug-in in a dumped scenario; its parameters stay."""
    at: Any = data
    for key in place[:-1]:
        if isinstance(at[key], str):  # the short form
            at[key] = name
            return
        at = at[key]
    at[place[-1]] = name
