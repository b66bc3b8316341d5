"""Tables of the documentation that the code makes: keys of scenarios, plug-ins, the order of `auto`, metrics, bundled maps.

    .venv/bin/python tools/doc_tables.py          # write them into docs/*.md
    .venv/bin/python tools/doc_tables.py --check  # exit code 1 when a page differs

A page says `<!-- table: NAME -->`, and what stands from there to `<!-- end -->` is replaced. `tests/test_docs.py` compares.
"""

import argparse
import json
import re
import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal, get_args, get_origin

import numpy as np
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from mrp_sumo.cli.listing import _plug_ins, _shown
from mrp_sumo.core.options import BOUNDS, Options
from mrp_sumo.drive.robot_work import Change
from mrp_sumo.io.documents import declared_in, keys_of
from mrp_sumo.io.scenario.model import SECTIONS, ScenarioModel
from mrp_sumo.metrics import registry
from mrp_sumo.metrics.operations.audit import RULES
from planners.auto import FEW, FEW_IN_WINDOW, FEW_SLOW, SLOW, SOME, THIN, portfolio_for

DOCS = Path(__file__).resolve().parents[1] / "docs"
SIGNS = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}  # of bounds
TINY, HUGE = 1e-3, 1e3  # bounds beyond are technical: more than nothing, and any number
PLACE = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def main() -> int:
    """Write the tables, or say which pages differ."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="change nothing")
    check = parser.parse_args().check
    differing = [path for path in sorted(DOCS.glob("*.md")) if (old := path.read_text(encoding="utf-8")) != with_tables(old)]
    for path in differing:
        print(path.relative_to(DOCS.parent))
        if not check:
            path.write_text(with_tables(path.read_text(encoding="utf-8")), encoding="utf-8")
    return 1 if check and differing else 0


def with_tables(text: str) -> str:
    """The text of a page with the tables that the code makes now."""
    return PLACE.sub(lambda place: f"{place[1]}\n{TABLES[place[2]]()}\n{place[3]}", text)


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """A table in Markdown."""
    lines = [tuple(head), *(tuple(row) for row in rows)]
    lines.insert(1, ("---",) * len(lines[0]))
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def planners() -> str:
    """Planners: method, guarantee."""
    rows = ((f"`{one['name']}`", one["summary"], one["guarantee"]) for one in _plug_ins("planners", []))
    return _table(("planner", "method", "guarantee"), rows)


def parameters(kind: str) -> str:
    """Parameters of a kind of plug-ins: those that mean the same in one row, with the usual default and those who have another."""
    of: dict[tuple[str, str], dict[str, str]] = {}
    for entry in _plug_ins(kind, []):
        for meaning in entry.get("meanings", {}).items():
            of.setdefault(meaning, {})[f"`{entry['name']}`"] = f"{_shown(entry['parameters'][meaning[0]]['default'])}"

    def default(of: dict[str, str]) -> str:
        usual = Counter(of.values()).most_common(1)[0][0]
        return usual + "".join(
            f" ({', '.join(n for n in of if of[n] == each)}: {each})" for each in dict.fromkeys(of.values()) if each != usual
        )

    rows = ((f"`{name}`", default(those), ", ".join(those), says) for (name, says), those in sorted(of.items()))
    return _table(("parameter", "default", "of", "meaning"), rows)


def auto() -> str:
    """Planners that `auto` asks, by the problem."""

    def asks(robots: int, vertices: float = 0, kind: str = "roadmap", turn_steps: float = 0.1, **problem: Any) -> tuple[str, str]:
        graph, fleet = (
            SimpleNamespace(num_vertices=vertices, kind=kind),
            SimpleNamespace(turn_rate_rad_s=np.full(1, np.pi / 2 / turn_steps)),
        )
        chosen = portfolio_for(SimpleNamespace(num_robots=robots, graph=graph, fleet=fleet, step_s=1.0, **problem))  # type: ignore[arg-type]
        plan = f"the cheapest of the first {chosen.compared}" if chosen.compared > 1 else "the first"
        return ", ".join(f"`{name}`" for name in chosen.names), plan

    one_shot, window = {"drivable": False, "window_steps": 0}, {"drivable": True, "window_steps": 1}
    grid: dict[str, Any] = {"kind": "grid", "drivable": True, "window_steps": 0}
    rows = (
        (f"one-shot, robots keep the plan's order, up to {FEW} robots on a grid", *asks(FEW, **grid)),
        (f"the same, up to {FEW_SLOW}, a quarter turn takes {SLOW:g} of a step or more", *asks(FEW_SLOW, turn_steps=SLOW, **grid)),
        (f"one-shot, robots keep the plan's order, up to {SOME} robots", *asks(SOME, drivable=True, window_steps=0)),
        (f"one-shot, robots need not, up to {SOME} robots", *asks(SOME, **one_shot)),
        ("one-shot, more", *asks(SOME + 1, **one_shot)),
        (f"in windows, {THIN:g} vertices or more a robot, up to {FEW_IN_WINDOW} robots", *asks(1, THIN, **window)),
        ("the same, more robots", *asks(FEW_IN_WINDOW + 1, THIN * (FEW_IN_WINDOW + 1), **window)),
        ("in windows, fewer", *asks(1, **window)),
    )
    return _table(("problem", "planners, in this order", "plan"), rows)


def policies() -> str:
    """Execution policies."""
    yes = {True: "yes", False: "no"}
    rows = (
        (f"`{one['name']}`", one["summary"], yes[one["keeps_order"]], yes[one["paced"]], yes[one["sound_plan_only"]])
        for one in _plug_ins("policies", [])
    )
    return _table(("policy", "rule", "keeps the plan's order", "waits for planned times", "needs a valid plan"), rows)


def dispatchers() -> str:
    """Dispatchers."""
    return _table(("dispatcher", "rule"), ((f"`{one['name']}`", one["summary"]) for one in _plug_ins("dispatchers", [])))


def maps() -> str:
    """Key facts of the bundled maps, as `mrp-sumo import` prints them."""
    from mrp_sumo.maps.catalogue import bundled_maps
    from mrp_sumo.maps.facts import facts
    from mrp_sumo.maps.load import load_map

    known = ((name, facts(load_map(path))) for name, path in bundled_maps().items())
    rows = ((f"`{name}`", "{:g} x {:g} m".format(*of["extent_m"]), str(of["vertices"]), str(of["edges"])) for name, of in known)
    return _table(("map", "extent", "vertices", "edges"), rows)


def robot_changes() -> str:
    """Changes of what a robot of a run with tasks is at: of its duty and of its condition."""

    def arrows(changes: Mapping[Any, Any] | None) -> str:
        then = {after: [f"`{before}`" for before, there in (changes or {}).items() if there is after] for after in (changes or {}).values()}
        return "; ".join(f"{', '.join(before)} → `{after}`" for after, before in then.items() if before != [f"`{after}`"])

    rules = [change.value for change in Change]
    return _table(("change", "duty", "condition"), ((rule.when, arrows(rule.duty), arrows(rule.condition)) for rule in rules))


def rules() -> str:
    """Rules of the operations audit, by the docstrings of what looks for findings."""
    proofs = ((name, " ".join(" ".join(str(each.__doc__).split()) for each in of)) for name, of in RULES.items())
    return _table(("rule", "proves"), ((f"`{name}`", proof) for name, proof in proofs))


def metrics(of: str) -> str:
    """Metrics of a table of `mrp_sumo.metrics`."""
    rows = ((f"`{one.name}`{' *' * one.of_machine}", one.sense, one.formula) for one in registry.TABLES[of])
    return _table(("metric", "better", "formula"), rows)


def keys(section: str = "") -> str:
    """Keys of a section of scenario files, as they are declared; those without sections of their own where none is named."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for key, field in keys_in(section):
        alike.setdefault((_values(field), str(field.description)), []).append(f"`{key}`")
    return _table(("key", "default", "meaning"), ((", ".join(names), *row) for row, names in alike.items()))


def keys_in(section: str) -> Iterator[tuple[str, FieldInfo]]:
    """Keys of a section; `[]` marks lists. What several keys are declared by is shown at the first of them."""
    shown: set[type] = set()

    def below(declared: type, above: str) -> Iterator[tuple[str, FieldInfo]]:
        for name, field in keys_of(declared).items():
            yield above + name, field
            for inner in declared_in(field.annotation):
                if inner not in shown:
                    shown.add(inner)
                    yield from below(inner, f"{above}{name}{_among(field.annotation, inner)}.")

    for name, field in keys_of(ScenarioModel).items():
        inner = next(declared_in(field.annotation), None)
        if name == section and inner:
            yield from below(inner, f"{name}.")
        elif not section and not inner:
            yield name, field


def _among(annotation: Any, inner: type) -> str:
    """What stands in a key for which of several models an annotation has: '[]' of lists, '.NAME' of dictionaries, nothing of one."""
    kind = get_origin(annotation)
    if kind in (list, tuple, dict) and inner in declared_in(annotation):
        return ".NAME" if kind is dict else "[]"
    return next((among for part in get_args(annotation) if (among := _among(part, inner))), "")


def _values(field: FieldInfo) -> str:
    """Default of a key, then its other choices, or the bounds of its values."""
    value = None if field.is_required() else field.get_default(call_default_factory=True)
    default = "required" if field.is_required() else "" if isinstance(value, BaseModel | Options) else f"`{json.dumps(value)}`"
    parts = [field.annotation, *get_args(field.annotation)]
    if choices := [f"`{one}`" for part in parts if get_origin(part) is Literal for one in get_args(part) if one != value]:
        return f"{default}, or {', '.join(choices)}"
    return ", ".join(filter(None, (default, _bounds(field))))


def _bounds(field: FieldInfo) -> str:
    bounds = {key: bound for part in field.metadata for key in BOUNDS if (bound := getattr(part, key, HUGE)) < HUGE}
    if 0 < bounds.get("ge", 0) < TINY:
        bounds["gt"] = 0
        del bounds["ge"]
    if {"ge", "le"} <= set(bounds):
        return f"{bounds['ge']:g} to {bounds['le']:g}"
    return ", ".join(f"{SIGNS[key]} {bounds[key]:g}" for key in BOUNDS if key in bounds)


TABLES: dict[str, Callable[[], str]] = {one.__name__: one for one in (planners, auto, policies, dispatchers, maps, robot_changes, rules)}
TABLES |= {"keys": keys} | {f"keys_{section}": partial(keys, section) for section in SECTIONS}
TABLES |= {f"parameters_{kind}": partial(parameters, kind) for kind in ("planners", "dispatchers", "policies")}
TABLES |= {f"metrics_{of}": partial(metrics, of) for of in registry.TABLES}


if __name__ == "__main__":
    sys.exit(main())
