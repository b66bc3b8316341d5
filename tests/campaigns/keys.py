"""Every key of scenario files, alone and in pairs, gets a run: keys and values follow from the models in mrp_sumo.io.scenario.

A key whose values cannot be told from its type (a name, a file) has them in NAMED; a new one without fails the test.
"""

import itertools
import json
import random
from dataclasses import replace
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

import annotated_types
import yaml
from campaigns.driver import Trial

from mrp_sumo.drive.policy import policies
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.run import run_scenario
from mrp_sumo.io.columns import put
from mrp_sumo.io.documents import declared_in, keys_of
from mrp_sumo.io.run_reader import load_run
from mrp_sumo.io.scenario.model import ScenarioModel
from mrp_sumo.io.scenario.read import read_scenario
from mrp_sumo.maps.generate import GENERATORS
from mrp_sumo.planning.registry import planner_names
from mrp_sumo.plugins import registry
from mrp_sumo.reports.replay.page import write_replay

MAP, METRIC = "small.building.yaml", "own.py"
BASE = {"map": MAP, "robots": {"count": 2}, "seed": 1, "planner": {"name": "cbs", "time_limit_s": 5.0}, "execution": {"time_limit_s": 60.0}}
FLOATS, INTS = (0.3, 1.0, 3.0, 0.05, 20.0), (0, 1, 2, 5)
NAMED: dict[str, list[Any]] = {
    "name": ["night-1"],
    "map.file": [MAP],
    "map.reader": ["rmf_building"],
    "map.level": ["L1"],
    "map.graph": [0, "all", [0]],
    "map.meters_per_pixel": [0.05],
    "map.vehicle_type": ["maker.series"],
    "discretisation.cell_m": [0.4, 0.5, 1.0],
    "robots.type": ["turtlebot3"],
    "robots.type.source": ["a data sheet"],
    "robots.type.vehicle_type": ["maker.series"],
    "robots.type.intervals": [{}, {"max_speed_mps": [0.01, 900.0]}],
    "robots.type.lane_class_mps": [{}, {"ramp": 0.5}],
    "execution.disturbances.intervals": [{}, {"stops_per_s": [0.0, 1.0]}],
    **{f"robots.type.actions.{action}.triangular_s": [[1.0, 2.0, 4.0]] for action in ("pick", "drop", "lift", "dock")},
    **{f"robots.type.actions.{action}.lognormal": [[10.0, 0.5]] for action in ("pick", "drop", "lift", "dock")},
    "robots.fleet": [[{"type": "turtlebot3", "count": 1}, {"type": "turtlebot3", "starts": ["crossing_1_1"], "goals": ["crossing_4_3"]}]],
    "robots.starts": [["crossing_1_1", "crossing_4_3"]],
    "robots.goals": [["crossing_4_3", "crossing_1_1"]],
    "robots.start_heading_deg": [90, [-45.5, None]],
    "robots.goal_heading_deg": [[None, None], [90, None]],
    "assignment.solver": list(registry.names("assigners")),
    "assignment.parameters": [{}],
    "planner.name": [name for name in planner_names() if name not in ("external", "plan_file")],
    "planner.parameters": [{}],
    "planner.budget": [100_000],
    "execution.policy.name": list(policies()),
    "execution.dispatcher.name": ["", "one_shot"],
    "execution.dispatcher.parameters": [{}],
    "tasks": [None],
    "execution.policy.parameters": [{}],
    "people.places": [["crossing_1_1", "crossing_4_3"]],
    "people.flows.origin": ["crossing_1_1", ["crossing_1_1", "crossing_2_2"]],
    "people.flows.destination": ["crossing_4_3"],
    "people.profile": [[0.5, 1.5]],
    "people.flows.profile": [[0.5, 1.5]],
    "people.groups.name": ["staff"],
    "people.lane_speeds": [[0.274, 0.508, 0.63]],
    "execution.recovery.replanner": [None, "lacam", "cbs"],
    "execution.mutex_groups": [{"middle": ["crossing_2_2", "crossing_3_2"]}],
    "execution.one_way": [[["crossing_2_1", "crossing_4_1"]]],
    "discretisation.doubled": [[["crossing_2_1", "crossing_4_1"]]],
    "execution.disturbances.name": ["nav2_like"],
    "execution.disturbances.closures.between": [["crossing_2_1", "crossing_4_1"], ["crossing_2_2", "crossing_3_2"]],
    "execution.disturbances.outages.lift": ["lift_1"],
    "execution.disturbances.outages.door": ["gate"],
    "execution.manual_doors": [["gate"]],
    "map.furniture.model": ["Table"],
    "record.robots": [["robot_0"], []],
    "record.metrics": [[f"{METRIC}:top_speed_mps"]],
}
TOGETHER = {"robots.starts": "robots.goals", "robots.goals": "robots.starts"}  # keys that come with another

WHOLE = ("tasks", "robots.fleet")  # keys below them have tests of their own, in tests/io

DRAWS = 4

Case = dict[str, Any]  # values by dotted key


def keys(model: type = ScenarioModel, above: str = "") -> dict[str, list[Any]]:
    """Sample values of every key, by dotted key; keys of a list's items stand below the list's own."""
    outcome: dict[str, list[Any]] = {}
    for name, field in keys_of(model).items():
        key = above + name
        kind = Annotated[field.annotation, *field.metadata] if field.metadata else field.annotation
        inner = list(declared_in(kind)) if key not in WHOLE else []
        if not inner or key in NAMED:
            outcome[key] = NAMED.get(key) or _values(kind, key)
        for part in inner:
            outcome |= keys(part, f"{key}.")
    return outcome


def document_of(case: Case) -> dict[str, Any]:
    """The scenario that has the values of a case, and otherwise those of BASE and the defaults."""
    lists = _lists()
    known = keys()
    document: dict[str, Any] = json.loads(json.dumps(BASE))
    case = dict(case)
    for key in list(case):
        if key in TOGETHER:
            case.setdefault(TOGETHER[key], NAMED[TOGETHER[key]][0])
    items: dict[str, dict[str, Any]] = {}
    for key, value in case.items():
        parent, _, last = key.rpartition(".")
        if parent in lists:
            items.setdefault(parent, {})[last] = value
        else:
            put(document, key.split("."), value)
    for parent, params in items.items():
        needed = {name: known[f"{parent}.{name}"][0] for name, field in keys_of(lists[parent][0]).items() if field.is_required()}
        item = {**needed, **params}
        put(document, parent.split("."), [item, item] if lists[parent][1] else item)  # two of the same: equal begin and duration
    if ("robots.fleet" in case or "robots.starts" in case) and "robots.count" not in case:
        document["robots"].pop("count", None) if isinstance(document["robots"], dict) else None
    return document


def alone() -> list[Case]:
    """A case for each value of each key."""
    return [{key: value} for key, values in keys().items() for value in values]


def pairs() -> list[tuple[str, str]]:
    """All pairs of keys."""
    return list(itertools.combinations(keys(), 2))


class Keys:
    """Each value alone first, then pairs in the order of the seed, with values drawn."""

    def __init__(self, seed: int) -> None:
        self._alone, self._pairs, self._seed = alone(), pairs(), seed
        random.Random(seed).shuffle(self._pairs)

    @property
    def size(self) -> int:
        return len(self._alone) + len(self._pairs)

    def trial(self, number: int, folder: Path) -> Trial:
        if number < len(self._alone):
            return try_case(self._alone[number], folder, "alone")
        known, chance = keys(), random.Random(f"{self._seed} {number}")
        pair = self._pairs[number - len(self._alone)]
        for attempt in range(DRAWS):  # until values go together
            place = folder / str(attempt)
            place.mkdir()
            trial = try_case({key: chance.choice(known[key]) for key in pair}, place, "pair")
            if trial.ended != "refused" or trial.faults:
                break
        return replace(trial, command=f"cd {place.name} && {trial.command}")


def try_case(case: Case, folder: Path, kind: str) -> Trial:
    """Run a case to the written folder, read it again, and write its page."""
    GENERATORS["grid"](9).write(folder / MAP)
    (folder / METRIC).write_text('def top_speed_mps(run):\n    """The fastest."""\n    return float(run.execution.speed_mps.max())\n')
    path, out = folder / "case.yaml", folder / "out"
    path.write_text(yaml.safe_dump(document_of(case), sort_keys=False))
    command = "mrp-sumo run case.yaml --out out --replay"
    (folder / "command.sh").write_text(command + "\n")
    shown = json.dumps(case)
    try:
        result = run_scenario(read_scenario(path), out)
    except MrpSumoError as error:
        faults = _faults_of_refusal(error, case)
        left = [f"{shown}: refused, but {entry.name} is left" for entry in folder.glob("*out*")]
        return Trial(kind, "refused", (*(f"{shown}: {fault}" for fault in faults), *left), command)
    except Exception as error:
        return Trial(kind, "traceback", (f"{shown}: {type(error).__name__}: {error}",), command)
    try:
        wanted = ["result.json"] if result.status.startswith("planning_") else ["result.json", "plan.json", "trajectory.parquet"]
        faults = [f"{shown}: {name} is not written" for name in wanted if not (out / name).is_file()]
        if (out / "plan.json").is_file():
            load_run(out)
            write_replay(out)
    except Exception as error:
        faults = [f"{shown}: written, but cannot be read: {type(error).__name__}: {error}"]
    return Trial(kind, result.status, tuple(faults), command)


def _faults_of_refusal(error: MrpSumoError, case: Case) -> list[str]:
    """A refusal is fair when its one line names a key of the case."""
    line = str(error).splitlines()[0]
    if not line.startswith("case.yaml"):
        return [f"refused without file and key: {line}"]
    words = {part for key in case for part in key.split(".")}
    return [] if any(word in str(error) for word in words) else [f"refused, but for what? {line}"]


def _lists() -> dict[str, tuple[type, bool]]:
    """Keys whose values are models: in a list, or beside a name (no list)."""

    def below(model: type, above: str) -> Any:
        for name, field in keys_of(model).items():
            for part in declared_in(field.annotation):
                listed = get_origin(field.annotation) in (list, tuple)
                if listed or field.annotation is not part:
                    yield f"{above}{name}", (part, listed)
                yield from below(part, f"{above}{name}.")

    return dict(below(ScenarioModel, ""))


def _values(kind: Any, key: str) -> list[Any]:
    """Values of a type, the usual first."""
    origin = get_origin(kind)
    if origin in (Union, UnionType):
        return [value for part in get_args(kind) if part is not NoneType for value in _values(part, key)]
    if origin is Literal:
        return list(get_args(kind))
    bounds: list[Any] = []
    if origin is Annotated:
        kind, *bounds = get_args(kind)
        if get_origin(kind) in (Union, UnionType):
            return _values(kind, key)
    if kind is bool:
        return [True, False]
    if kind in (int, float):
        return [value for value in (INTS if kind is int else FLOATS) if all(_within(value, bound) for bound in bounds)]
    raise LookupError(f"{key}: give it sample values in {__name__}.NAMED")


def _within(value: float, bound: Any) -> bool:
    for part in bound.metadata if hasattr(bound, "metadata") else [bound]:
        match part:
            case annotated_types.Gt(gt=least) if not value > least:
                return False
            case annotated_types.Ge(ge=least) if not value >= least:
                return False
            case annotated_types.Lt(lt=most) if not value < most:
                return False
            case annotated_types.Le(le=most) if not value <= most:
                return False
    return True
