"""The commands that a workbench may start, as words of the command line.

Each names files of the folder, and a folder for its results that is not there yet.
"""

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.files.reading import read_text
from mrp_sumo.files.writing import write_whole
from mrp_sumo.maps.readers.reader import map_name
from mrp_sumo.maps.yaml_edit import document_of, text_of
from mrp_sumo.maps.yaml_text import MAX_BYTES, Text
from mrp_sumo.studio.workspace import VARIANTS, Workspace

Values = Mapping[str, Any]
FORMATS = {"lif": ".lif.json", "opentcs": ".xml", "nav": ".nav.yaml"}
MOST_SEEDS = 100


def words_of(workspace: Workspace, values: Values) -> tuple[list[str], str]:
    """The words of a command after `mrp-sumo`, and the folder or file of its results. Raises MrpSumoError for what it does not know."""
    make = COMMANDS.get(str(values.get("what")))
    if make is None:
        raise MrpSumoError(f"unknown command '{str(values.get('what'))[:40]}'")
    return make(workspace, values)


def _init(workspace: Workspace, values: Values) -> tuple[list[str], str]:
    name = _file(workspace, values, "map")
    out = _free(workspace, values.get("out") or map_name(Path(name)).replace(".", "_"))
    words = ["init", name, "--out", out]
    for option, key in (("--type", "robot"), ("--robots", "robots"), ("--rate", "rate_per_h")):
        if values.get(key):
            words += [option, str(values[key])]
    return words, f"{out}/scenario.yaml"


def _run(workspace: Workspace, values: Values) -> tuple[list[str], str]:
    """Drive a scenario, or a map alone, and show it."""
    name = _file(workspace, values, "scenario")
    out = _free(workspace, f"runs/{_stem(name)}")
    return ["run", name, "--out", out, *(["--live"] if values.get("live", True) else [])], out


def _capacity(workspace: Workspace, values: Values) -> tuple[list[str], str]:
    name = _file(workspace, values, "scenario")
    out = _free(workspace, f"studies/{_stem(name)}")
    words = ["capacity", name, "--json", "--out", out, *(["--quick"] if values.get("quick", True) else [])]
    for option in ("demand", "robots", "budget", "horizon"):
        if values.get(option):
            words += [f"--{option}", str(values[option])]
    for change in values.get("what_if") or ():
        words += ["--what-if", str(change)]
    return words, out


def _variants(workspace: Workspace, values: Values) -> tuple[list[str], str]:
    """Drive two layouts on the same orders, seed by seed."""
    scenario, maps = _file(workspace, values, "scenario"), [_file(workspace, {"map": name}, "map") for name in values.get("maps") or ()]
    seeds = values.get("seeds", 5)
    if len(maps) != 2 or maps[0] == maps[1]:
        raise MrpSumoError("expected two maps that differ")
    if type(seeds) is not int or not 2 <= seeds <= MOST_SEEDS:
        raise MrpSumoError(f"seeds: found {str(seeds)[:20]}, expected 2 to {MOST_SEEDS}")
    out = _free(workspace, f"{VARIANTS}/{'_to_'.join(_stem(name) for name in maps)}")
    suite = f"{out}.yaml"
    root, folder = workspace.root, (workspace.root / suite).parent
    document = {
        "base": os.path.relpath(root / scenario, folder),
        "grid_search": {
            "map": [os.path.relpath(root / name, folder) for name in maps],
            "execution.engine": ["kinematic"],
            "record.bag": [False],
            "seed": list(range(1, seeds + 1)),
        },
    }
    write_whole(root / suite, text_of(document).encode())
    return ["batch", suite, "--out", out], out


def first_map(workspace: Workspace, out: str) -> str:
    """The layout that a comparison began with, as its suite names it; '' where that is not there."""
    suite = workspace.path(f"{out}.yaml")
    if not suite.is_file():
        return ""
    values = document_of(Text(suite, read_text(suite, MAX_BYTES)))
    return str(values["grid_search"]["map"][0]) if isinstance(values, dict) and values.get("grid_search") else ""


def _report(workspace: Workspace, values: Values) -> tuple[list[str], str]:
    run = _file(workspace, values, "run")
    out = _free(workspace, f"{run}_report")
    return ["report", run, "--out", out], f"{out}/index.html"


def _video(workspace: Workspace, values: Values) -> tuple[list[str], str]:
    run = _file(workspace, values, "run")
    out = f"{run}.gif"
    return ["render", run, "--video", out, "--to", "60"], out


def _replay(workspace: Workspace, values: Values) -> tuple[list[str], str]:
    run = _file(workspace, values, "run")
    return ["replay", run], f"{run}/replay.html"


def _convert(workspace: Workspace, values: Values) -> tuple[list[str], str]:
    """A drawing in another format, under a name that is free or beside it."""
    name, out, suffix = _file(workspace, values, "map"), str(values.get("out") or ""), FORMATS.get(str(values.get("format")))
    if suffix is not None:
        out = (Path(name).parent / f"{map_name(Path(name))}{suffix}").as_posix()
    elif not out.endswith(tuple(FORMATS.values())):
        raise MrpSumoError(f"format: found '{str(values.get('format') or out)[:80]}', expected one of {', '.join(FORMATS)}")
    elif workspace.path(out).exists() or out.startswith("-"):
        raise MrpSumoError(f"{out[:80]}: is there already: choose another name")
    return ["convert", name, out], out


COMMANDS: Mapping[str, Callable[[Workspace, Values], tuple[list[str], str]]] = {
    "init": _init,
    "run": _run,
    "capacity": _capacity,
    "variants": _variants,
    "report": _report,
    "video": _video,
    "replay": _replay,
    "convert": _convert,
}


def _file(workspace: Workspace, values: Values, key: str) -> str:
    """The name of a file or folder that is there, which no command takes for an option."""
    name = values.get(key)
    if not isinstance(name, str) or not name:
        raise MrpSumoError(f"{key}: expected the name of a file")
    path = workspace.path(name)
    if not path.exists():
        raise MrpSumoError(f"{name[:80]}: is not there: save it first")
    relative = path.relative_to(workspace.root).as_posix()
    return f"./{relative}" if relative.startswith("-") else relative


def _free(workspace: Workspace, wanted: object) -> str:
    """A name for a folder that is not there yet: runs/site, runs/site_2."""
    name = workspace.path(str(wanted)).relative_to(workspace.root).as_posix()
    number, free = 2, name
    while workspace.path(free).exists() or workspace.path(f"{free}.yaml").exists():
        free, number = f"{name}_{number}", number + 1
    return f"./{free}" if free.startswith("-") else free


def _stem(name: str) -> str:
    """What a scenario's results are called: the folder that it has to itself, or its own name."""
    path = Path(name)
    stem = path.parent.name if path.stem == "scenario" and path.parent.name else map_name(path)
    return "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in stem)
