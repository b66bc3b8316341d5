"""Suites: a base scenario and lists of values over any of its keys, as YAML; all combinations are the runs.

Refuses unknown keys, empty lists, values that a scenario refuses, and exclusions that exclude nothing,
one line each with file and line.
"""

import itertools
import json
import math
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AliasChoices, Field

from mrp_sumo.errors import MrpSumoError, ScenarioError, nearest, sentence
from mrp_sumo.experiments.identity import input_hash, plug_in_hash, run_key, scenario_key
from mrp_sumo.files.names import fault_of_folder
from mrp_sumo.files.reading import shortened
from mrp_sumo.io.columns import parameter_columns, short_key
from mrp_sumo.io.documents import Document, Place, read_document, validated
from mrp_sumo.io.scenario.file import ScenarioFile, find_scenario
from mrp_sumo.io.scenario.keys import unknown_key
from mrp_sumo.io.scenario.model import ScenarioModel
from mrp_sumo.io.scenario.programs import plug_ins_of, rename, require_trust
from mrp_sumo.io.scenario.read import changed, read_scenario, set_key
from mrp_sumo.io.scenario.strict import Strict
from mrp_sumo.maps.catalogue import bundled_folder, find_map
from mrp_sumo.plugins.source import place_in_file

MAX_RUNS = 1_000_000
_RANGE = re.compile(r"(\d+)\.\.(\d+)")

Until = Literal["map", "plan", "execution"]


class RunLimits(Strict):
    """Limits of one run, beyond which it is killed with its children."""

    wall_s: Annotated[float, Field(gt=0)] | None = Field(
        None, description="Wall time; by default a minute, twice the planner's time limit and twice the execution's."
    )
    memory_mb: Annotated[float, Field(gt=0)] | None = Field(None, description="Resident memory; unlimited by default.")


class Suite(Strict):
    """Content of a suite file."""

    name: str = Field("", pattern=r"^[\w.+-]*$", description="The file's name by default.")
    description: str = ""
    base: str | dict[str, Any] = Field(description="A scenario file, relative to the suite, the name of a bundled one, or one written out.")
    grid_search: dict[str, list[Any] | str] = Field(
        {},
        validation_alias=AliasChoices("grid_search", "grid"),
        description="Lists of values by dotted key; 0..53 is a range, ends included. All combinations are run.",
    )
    exclude: list[dict[str, Any]] = Field(
        [], description="Runs to leave out: those with all these values; a list stands for any of its values."
    )
    repeat: Annotated[int, Field(ge=1, le=100_000)] = Field(1, description="How often each run is made.")
    until: Until = Field("execution", description="How far runs go: 'map' loads and counts it, 'plan' does not drive.")
    limits: RunLimits = RunLimits()
    views: dict[str, str] = Field({}, description="Named SQL queries on the table `results`, for `mrp-sumo query`.")


@dataclass(frozen=True)
class SuiteFile:
    """A checked suite and where it came from."""

    suite: Suite
    document: Document
    base: dict[str, Any]  # the scenario's document, paths relative to the suite's folder
    axes: tuple[tuple[str, tuple[Any, ...]], ...]  # dotted key -> values
    places: "_AxisPlaces"
    base_folder: Path | None  # of the base's file; None for one written out

    @property
    def name(self) -> str:
        return self.suite.name or self.document.path.stem

    @property
    def folder(self) -> Path:
        """Folder where relative paths of its runs begin."""
        return self.document.path.resolve().parent


@dataclass(frozen=True, slots=True)
class PlannedRun:
    """A run of a suite. Its scenario stays JSON: there may be many."""

    key: str  # of scenario, inputs, plug-ins and code
    scenario_key: str  # of the scenario alone: equal in other versions of the code
    scenario: str  # JSON, the same for the same scenario
    repeat: int
    plug_ins: str  # hash of the sources of its plug-ins from outside


def find_suite(name_or_path: str) -> Path:
    """The file of a suite: a path, or the name of a bundled one. Raises ScenarioError when there is neither."""
    path = Path(name_or_path)
    folder = bundled_folder("scenarios") / "suites"
    if path.is_file() or path.suffix:
        return path
    if (folder / f"{name_or_path}.yaml").is_file():
        return folder / f"{name_or_path}.yaml"
    known = nearest(name_or_path, (p.stem for p in sorted(folder.glob("*.yaml"))), limit=20)
    if (folder.parent / f"{name_or_path}.yaml").is_file():
        known = f"; it is a scenario: `mrp-sumo run {name_or_path}`"
    raise ScenarioError(f"no suite '{name_or_path}': neither a file nor a bundled suite{known}")


def read_suite(path: Path) -> SuiteFile:
    """Read and check a suite file; its runs are checked by `runs_of`. Raises ScenarioError: one line a fault."""
    document = read_document(path)
    if isinstance(document.content, dict) and "map" in document.content and "base" not in document.content:
        raise ScenarioError(f"{shortened(path)}: a scenario, expected a suite, with `base` and `grid_search`; see `mrp-sumo run`")
    suite = validated(document, Suite)
    if fault := fault_of_folder(suite.name or document.path.stem):
        raise ScenarioError(f"{document.at(('name',))}: {fault}")
    if not suite.grid_search and suite.repeat == 1:
        raise ScenarioError(f"{document.at(('grid_search',))}: nothing to vary; give lists by key, or repeat")
    faults: list[str] = []
    axes = []
    section = "grid_search" if "grid_search" in document.content else "grid"
    places = _AxisPlaces(document, {tuple(key.split(".")): (section, key) for key in suite.grid_search})
    for key, values in suite.grid_search.items():
        place = document.at((section, key))
        if fault := unknown_key(key):
            faults.append(f"{place}: {fault}")
        try:
            axes.append((key, tuple(_expanded(values))))
        except ValueError as error:
            faults.append(f"{place}: {error}")
    for (a, _), (b, _) in itertools.permutations(axes, 2):
        if a.startswith(b + ".") and [k for k, _ in axes].index(a) < [k for k, _ in axes].index(b):
            faults.append(f"{document.at((section, b))}: would undo '{a}' above it; put it first")
    if faults:
        raise ScenarioError(*faults)
    base, base_folder = _base(document, suite, path)
    return SuiteFile(suite, document, base, tuple(axes), places, base_folder)


def runs_of(file: SuiteFile, code: str, *, run_programs: bool = True) -> list[PlannedRun]:
    """Every run of a suite, in the order of its axes, the last fastest; the version of the code is part of their keys.

    Where plug-in files may run, those that are not trusted are refused. Raises ScenarioError: one line a fault of a scenario.
    """
    count = file.suite.repeat * math.prod(len(values) for _, values in file.axes)
    if count > MAX_RUNS:
        raise ScenarioError(f"{file.document.path.name}: {count} runs, expected at most {MAX_RUNS}")
    excluded = _Exclusions(file)
    runs: list[PlannedRun] = []
    seen: set[str] = set()
    inputs = _Inputs(file.document, file.places, file.folder, file.base_folder, run_programs)
    for values in itertools.product(*(values for _, values in file.axes)):
        try:
            scenario = _scenario_of(file, values)
            canonical = scenario.model_dump_json()
            if excluded(canonical):
                continue
            read, plug_ins = inputs(scenario, canonical)
        except MrpSumoError as error:
            raise ScenarioError(*_faults_of_axes(file, run_programs) or str(error).splitlines()) from None
        for repeat in range(file.suite.repeat):
            shared = scenario_key(canonical, file.suite.until, repeat)
            if shared in seen:  # two values that mean the same
                continue
            seen.add(shared)
            runs.append(PlannedRun(run_key(shared, read, plug_ins, code), shared, canonical, repeat, plug_ins))
    excluded.require_used()
    if not runs:
        raise ScenarioError(f"{file.document.at(('exclude',))}: nothing is left to run")
    return runs


class Variations:
    """Runs of one scenario with other values, for suites that choose their runs as they go."""

    def __init__(self, file: ScenarioFile, name: str, code: str) -> None:
        folder = file.document.path.resolve().parent
        self.suite = SuiteFile(Suite(name=name, base=""), file.document, {}, (), _AxisPlaces(file.document, {}), folder)
        self._file, self.code = file, code
        self._inputs = _Inputs(file.document, file.options, folder, folder)

    def run(self, values: Mapping[Place, tuple[str, Any]]) -> PlannedRun:
        """The run with these values, as for `io.scenario.changed`. Raises ScenarioError: one line a fault."""
        scenario = changed(self._file, values).scenario.model_copy(update={"name": ""})
        canonical = scenario.model_dump_json()
        read, plug_ins = self._inputs(scenario, canonical)
        shared = scenario_key(canonical, "execution", 0)
        return PlannedRun(run_key(shared, read, plug_ins, self.code), shared, canonical, 0, plug_ins)


def _expanded(values: list[Any] | str) -> Iterator[Any]:
    """The values of an axis, ranges written out. Raises ValueError for what is neither a list nor a range, and for nothing."""
    if isinstance(values, str) and not _RANGE.fullmatch(values):
        raise ValueError(f"found {values!r}, expected a list, such as [{values}], or a range, such as 0..53")
    listed = [values] if isinstance(values, str) else values
    if not listed:
        raise ValueError("an empty list: give at least one value")
    for value in listed:
        if isinstance(value, str) and (span := _RANGE.fullmatch(value)):
            first, last = int(span[1]), int(span[2])
            if last < first:
                raise ValueError(f"the range {value} is empty")
            if last - first >= MAX_RUNS:
                raise ValueError(f"the range {value} has {last - first + 1} values, expected at most {MAX_RUNS}")
            yield from range(first, last + 1)
        else:
            yield value


def _base(document: Document, suite: Suite, path: Path) -> tuple[dict[str, Any], Path | None]:
    """The base scenario as keys and values, its relative paths made relative to the suite, and the folder of its file."""
    if isinstance(suite.base, dict):
        return suite.base, None
    beside = path.parent / suite.base
    try:
        file = read_scenario(beside if beside.is_file() else find_scenario(suite.base))
    except MrpSumoError as error:
        raise ScenarioError(*(f"{document.at(('base',))}: {line}" for line in str(error).splitlines())) from None
    base: dict[str, Any] = file.scenario.model_dump()

    def moved(name: Any) -> str:
        return Path(os.path.relpath(file.folder / name, path.parent)).as_posix()

    types = [(group, "type") for group in (base["robots"], *(base["robots"]["fleet"] or ()))]
    for section, key in [(base["map"], "file"), *types]:
        if isinstance(section[key], str) and (file.folder / section[key]).is_file():
            section[key] = moved(section[key])
    for place, _, name in plug_ins_of(file.scenario):
        if source := place_in_file(name):
            rename(base, place, f"{moved(source[0])}:{source[1]}")
    return base, file.folder


def _scenario_of(file: SuiteFile, values: tuple[Any, ...]) -> ScenarioModel:
    """The scenario of a combination of values. It has no name: a name is no reason to run it again."""
    data = dict(file.base)
    for (key, _), value in zip(file.axes, values, strict=True):
        set_key(data, tuple(key.split(".")), value, file.document.path.parent)
    data["name"] = ""
    for section in ("planner", "assignment"):  # the model keeps the order of other keys
        inner = data.get(section)
        if isinstance(inner, dict) and isinstance(inner.get("parameters"), dict) and inner["parameters"]:
            data[section] = {**inner, "parameters": dict(sorted(inner["parameters"].items()))}
    return validated(file.document, ScenarioModel, data, options=file.places)


class _AxisPlaces(dict[Place, str]):
    """`file:line: key` of a place in a run's scenario: the axis that set it, else the base."""

    def __init__(self, document: Document, axes: Mapping[Place, Place]) -> None:
        super().__init__({place: document.at(axis) for place, axis in axes.items()})
        self._document = document

    def __bool__(self) -> bool:
        return True  # it has an answer for every place

    def get(self, place: Place, default: Any = None) -> Any:
        for end in range(len(place), 0, -1):
            if place[:end] in self:
                return self[place[:end]]
        return self._document.at(("base", *place) if isinstance(self._document.content.get("base"), dict) else ("base",))


def _faults_of_axes(file: SuiteFile, run_programs: bool) -> list[str]:
    """What is wrong with each value of the axes beside the first of the others, so that all faults are reported at once."""
    first = tuple(values[0] for _, values in file.axes)
    faults: dict[str, None] = {}
    inputs = _Inputs(file.document, file.places, file.folder, file.base_folder, run_programs)
    for i, (_, values) in enumerate(file.axes):
        for value in values:
            try:
                scenario = _scenario_of(file, (*first[:i], value, *first[i + 1 :]))
                inputs(scenario, scenario.model_dump_json())
            except MrpSumoError as error:
                faults.update(dict.fromkeys(str(error).splitlines()))
            if len(faults) >= 10:
                break
    return list(faults)


class _Exclusions:
    """Tells which runs are excluded, and which exclusion did nothing."""

    def __init__(self, file: SuiteFile) -> None:
        self._file = file
        self._rules: list[dict[str, list[Any]]] = [{} for _ in file.suite.exclude]
        self._used = [False] * len(self._rules)
        faults = []
        for i, rule in enumerate(file.suite.exclude):
            for key, value in rule.items():
                place = file.document.at(("exclude", i, key))
                if fault := unknown_key(key):
                    faults.append(f"{place}: {fault}")
                try:
                    self._rules[i][short_key(key)] = list(_expanded(value if isinstance(value, list) else [value]))
                except ValueError as error:
                    faults.append(f"{place}: {error}")
        if faults:
            raise ScenarioError(*faults)

    def __call__(self, scenario: str) -> bool:
        if not self._rules:
            return False
        have = parameter_columns(json.loads(scenario))
        hits = [i for i, rule in enumerate(self._rules) if all(have.get(key) in values for key, values in rule.items())]
        for i in hits:
            self._used[i] = True
        return bool(hits)

    def require_used(self) -> None:
        unused = [self._file.document.at(("exclude", i)) for i, used in enumerate(self._used) if not used]
        if unused:
            raise ScenarioError(*(f"{place}: no run has these values" for place in unused))


class _Inputs:
    """Hashes of the files that a scenario reads, and of its plug-ins.

    What a scenario names is checked on the way, once for all with the same names.
    """

    def __init__(
        self, document: Document, places: Mapping[Place, str], folder: Path, base_folder: Path | None, run_programs: bool = True
    ) -> None:
        self._document, self._places = document, places
        self._folder = folder  # where relative paths begin
        self._base_folder = base_folder  # of a scenario whose programs are to be trusted
        self._run_programs = run_programs
        self._of_scenario: dict[str, tuple[str, str]] = {}  # by JSON from the map on: what comes before is the seed
        self._of_names: dict[tuple[str, ...], tuple[str, str]] = {}

    def __call__(self, scenario: ScenarioModel, canonical: str) -> tuple[str, str]:
        rest = canonical[canonical.index('"map":') :]
        if rest not in self._of_scenario:
            names = _names(scenario)
            if names not in self._of_names:
                self._of_names[names] = self._read(scenario)
            self._of_scenario[rest] = self._of_names[names]
        return self._of_scenario[rest]

    def _read(self, scenario: ScenarioModel) -> tuple[str, str]:
        from mrp_sumo.experiments.staging.choices import choices, named_files
        from mrp_sumo.maps.load import files_of

        whole = ScenarioFile(scenario, self._document, self._places)
        if self._run_programs and self._base_folder:
            require_trust(whole, self._base_folder)
        choices(whole, run_programs=self._run_programs)
        try:
            path, reader = find_map(scenario.map.file, self._folder), scenario.map.reader
            listed = self._run_programs or not place_in_file(reader or "")
            paths = list(files_of(path, reader, self._folder)) if listed else [path]
        except MrpSumoError as error:
            raise ScenarioError(f"{whole.at('map', 'file')}: {error}") from None
        paths += named_files(scenario, self._folder)
        try:
            return input_hash(paths), plug_in_hash(scenario, self._folder)
        except OSError as error:
            raise ScenarioError(f"{error.filename}: cannot be read: {sentence(error)}") from None


def _names(scenario: ScenarioModel) -> tuple[str, ...]:
    """What a scenario names: files, map reader, planner, tasks, assigner, policy, metrics."""
    sections = (scenario.planner, scenario.tasks, scenario.assignment, scenario.execution, scenario.record)
    return tuple(map(str, (scenario.map.file, scenario.map.reader, [group.type for group in scenario.robots.groups], *sections)))
