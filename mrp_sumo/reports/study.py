"""The runs of a report: those of a batch, of a folder of run folders, or a single run, sorted into maps, series and instances.

A *series* is what is compared: a planner, with whatever else of it varies (policy, parameters, assignment). An *instance*
is what all series are given: map, robots, seed and all other values. Refuses folders without results, and tables
that are not those of runs.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.errors import BatchError, MrpSumoError
from mrp_sumo.files.folders import PLAN, RESULT
from mrp_sumo.io.columns import SECTIONS, parameter_columns
from mrp_sumo.io.results import load_results, read_plan
from mrp_sumo.io.run_reader import RunFolder, load_run
from mrp_sumo.metrics.evaluate import succeeded
from mrp_sumo.metrics.registry import FLAGS as METRIC_FLAGS
from mrp_sumo.metrics.registry import NUMBERS as METRIC_NUMBERS
from mrp_sumo.plugins.source import short_name
from mrp_sumo.reports.pictures.view import title_of
from mrp_sumo.reports.tables.table import whole

PLANNER_NAMES = {  # as papers write them, in the order of MRP-Bench's tables
    "astar": "A*",
    "cbs": "CBS",
    "ecbs": "ECBS",
    "eecbs": "EECBS",
    "cbs_ta": "CBS-TA",
    "ecbs_ta": "ECBS-TA",
    "prioritised": "Prioritised",
    "pibt": "PIBT",
    "lacam": "LaCAM",  # LaCAM* with `anytime`
    "lns2": "LNS2",
    "continuous": "Continuous",
    "pbs": "PBS",
    "ccbs": "CCBS",
}
ANYTIME = "planner.parameters.anytime"  # makes LaCAM LaCAM*
NUMBERS = (*METRIC_NUMBERS, "run_wall_s", "planner.time_limit_s", "execution.time_limit_s", "seed")  # absent ones are filled in as missing
FLAGS = ("success", *METRIC_FLAGS)
NEEDED = ("status", "success", "planner", "map")
MANY_MAPS = 6  # beyond which they are not told apart in charts
MAX_FOLDERS = 200  # run folders that are opened beside a batch


@dataclass(frozen=True, eq=False)
class ReportedRuns:
    """Runs, one per row of `frame`: the columns of `load_results`, and

    `_map`, `_robots`, `_series`: what the row belongs to; `_instance`: number of its instance; `_planned`: whether a plan was found,
    valid or not, as MRP-Bench counts; `_valid`: whether a valid one was; `_arrived`: whether all robots then reached their goals without
    an overlap; `_succeeded`: whether they did, on a valid plan.
    """

    name: str
    description: str
    until: str  # how far its runs go, 'map', 'plan' or 'execution'
    frame: pd.DataFrame
    maps: tuple[str, ...]
    series: tuple[str, ...]
    factors: tuple[str, ...]  # numeric scenario columns that vary, apart from seeds and the number of robots
    gaps: tuple[str, ...]  # what could not be used
    folders: dict[str, RunFolder]  # run folders that are there, by the key of their row

    @property
    def is_planned(self) -> bool:
        return self.until != "map"

    @property
    def is_executed(self) -> bool:
        return self.until == "execution"

    @property
    def outcome(self) -> str:
        """The column that says whether a run did what was asked of it."""
        return "_succeeded" if self.is_executed else "_valid"

    @cached_property
    def by_instance(self) -> dict[str, pd.DataFrame]:
        """The rows of each series, one for each instance, by its number."""
        grouped = self.frame.groupby("_series", sort=False)
        return {str(name): rows.drop_duplicates("_instance").set_index("_instance") for name, rows in grouped}

    def by_map(self) -> list[tuple[str, pd.DataFrame]]:
        """Maps with their runs; all together where there are very many maps."""
        if len(self.maps) > MANY_MAPS:
            return [("all maps", self.frame)]
        return [(name, self.frame[self.frame["_map"] == name]) for name in self.maps]

    @property
    def robots(self) -> list[int]:
        """Numbers of robots, ascending."""
        return sorted(int(n) for n in self.frame["_robots"].dropna().unique())

    def groups(self, *by: str) -> list[tuple[tuple[Any, ...], pd.DataFrame]]:
        """Rows by some of `_map`, `_robots`, `_series` and factors, in the order of the study."""
        groups = dict(iter(self.frame.groupby(list(by), sort=False, dropna=False)))
        order = {"_map": self.maps, "_series": self.series}
        return sorted(groups.items(), key=lambda item: tuple(order[k].index(v) if k in order else v for k, v in zip(by, item[0])))

    def blocks(self) -> Iterator[tuple[dict[str, Any], pd.DataFrame]]:
        """Runs by map, number of robots and series, and what tables call these."""
        for (name, robots, series), runs in self.groups("_map", "_robots", "_series"):
            yield {"map": name, "robots": whole(robots), "planner": series}, runs


def short_key(key: str) -> str:
    """Name of a run on the page: the first eight digits of a batch's key, or the name of its folder as it is."""
    return key[:8] if re.fullmatch(r"[0-9a-f]{20}", key) else key


def read_study(path: Path) -> ReportedRuns:
    """The study of a batch, of one run, of a folder that holds run folders, or of a `results.parquet`.

    Raises MrpSumoError when there is nothing to report on.
    """
    if path.is_file() and path.suffix != ".parquet":
        raise BatchError(f"{path}: expected a folder of results, or its results.parquet")
    gaps: list[str] = []
    folders: dict[str, RunFolder] = {}
    name, description, until = path.resolve().name, "", ""
    if path.is_file() or ((path / PLAN).is_file() and not (path / RESULT).is_file()):
        frame = load_results(path, gaps.append)
        if path.is_dir():
            plan = read_plan(path)
            name, description, until = plan["suite"], " ".join(plan["description"].split()), plan["until"]
            missing = len(plan["keys"]) - len(frame)
            if missing:
                gaps.append(f"{missing} of {len(plan['keys'])} runs have no result yet; this report is of the others")
            folders = _run_folders(path, gaps)
        else:
            name = path.stem
    elif (path / RESULT).is_file():
        run = load_run(path)
        folders = {path.resolve().name: run}
        name = title_of(run.result)
        frame = pd.DataFrame([_row(path.resolve().name, run)])
    elif path.is_dir():
        folders = _run_folders(path, gaps)
        if not folders:
            raise BatchError(f"{path}: neither a batch nor a run: there is no {PLAN} and no {RESULT}")
        frame = pd.DataFrame([_row(key, run) for key, run in folders.items()])
    else:
        raise BatchError(f"{path}: no such folder")
    return _study(name, description, until, frame, gaps, folders)


def floats(runs: pd.DataFrame, column: str) -> FloatArray:
    """[N] the values of a column, NaN where one is missing."""
    values: FloatArray = runs[column].to_numpy(np.float64, na_value=np.nan)
    return values


def numbers(runs: pd.DataFrame, column: str) -> FloatArray:
    """The values of a column that are not missing, [N]."""
    values = floats(runs, column)
    return values[np.isfinite(values)]


def _run_folders(path: Path, gaps: list[str]) -> dict[str, RunFolder]:
    """Run folders one or two levels below, by name."""
    folders = {}
    places = [p for pattern in (f"*/{RESULT}", f"*/*/{RESULT}") for p in sorted(path.glob(pattern))]
    if len(places) > MAX_FOLDERS:
        gaps.append(f"{len(places)} run folders, the first {MAX_FOLDERS} are used")
    for place in places[:MAX_FOLDERS]:
        try:
            folders[place.parent.name] = load_run(place.parent)
        except MrpSumoError as error:
            gaps.append(f"{error}; left out")
    return folders


def _row(key: str, run: RunFolder) -> dict[str, Any]:
    metrics = {name: value for name, value in run.metrics.items() if not isinstance(value, list)}
    return {
        "key": key,
        "status": run.result["status"],
        "success": succeeded(run.result["status"], metrics),
        "reason": run.result.get("note", ""),
        "repeat": 0,
        **parameter_columns(run.result["scenario"]),
        **metrics,
        "code": run.result.get("versions", {}).get("mrp_sumo"),
        "libsumo": run.result.get("versions", {}).get("libsumo"),
    }


def _study(name: str, description: str, until: str, frame: pd.DataFrame, gaps: list[str], folders: dict[str, RunFolder]) -> ReportedRuns:
    lacking = [column for column in NEEDED if column not in frame]
    if lacking:
        raise BatchError(f"{name}: not a table of runs: there is no column '{lacking[0]}'")
    if not len(frame):
        raise BatchError(f"{name}: the table has no rows")
    frame = frame.reset_index(drop=True).copy()
    if not until:
        only_maps = "num_vertices" in frame and "plan_success" not in frame
        until = "map" if only_maps else "execution" if "sim_time_s" in frame and frame["sim_time_s"].notna().any() else "plan"
    frame = frame.reindex(columns=[*frame.columns, *(column for column in NUMBERS if column not in frame)])  # at once, as pandas wants it
    for column in NUMBERS:
        if not (frame[column].isna().all() or pd.api.types.is_numeric_dtype(frame[column])):
            raise BatchError(f"{name}: column '{column}' holds {frame[column].dtype}, expected numbers")
    for column in FLAGS:
        values = frame[column] if column in frame else pd.Series(pd.NA, index=frame.index)
        try:
            frame[column] = values.astype("boolean")
        except (TypeError, ValueError):
            raise BatchError(f"{name}: column '{column}' holds {values.dtype}, expected yes or no") from None
    frame["_map"] = _map_names(frame)
    robots = pd.to_numeric(frame["robots.count"], errors="coerce") if "robots.count" in frame else pd.Series(np.nan, frame.index)
    frame["_robots"] = robots.fillna(pd.to_numeric(frame["num_robots"], errors="coerce")).astype("Float64").astype("Int64")
    varying = [c for c in frame.columns if c.split(".")[0] in SECTIONS and frame[c].nunique(dropna=True) > 1]
    mixed = _series_columns(frame, varying)
    rows = frame[["planner", *mixed]].astype(object).itertuples(index=False, name=None)
    anytime = frame[ANYTIME].eq(True).fillna(False) if ANYTIME in frame else np.zeros(len(frame), np.bool_)
    frame["_series"] = _series_names(list(rows), mixed, [bool(star) for star in anytime])
    known = list(PLANNER_NAMES)
    first = {s: i for i, s in reversed(list(enumerate(frame["_series"])))}
    rank = {s: (known.index(p) if p in known else len(known), first[s]) for s, p in zip(frame["_series"], frame["planner"])}
    instance = [c for c in varying if c not in mixed and c != "planner" and not c.startswith("planner.parameters.")]
    instance += [c for c in ("repeat",) if c in frame]
    frame["_instance"] = frame.groupby(instance, sort=False, dropna=False).ngroup() if instance else 0
    frame["_planned"] = frame["plan_success"].fillna(False).to_numpy(np.bool_)
    frame["_valid"] = frame["_planned"] & frame["plan_valid"].fillna(False).to_numpy(np.bool_)
    frame["_arrived"] = (frame["status"] == "completed").to_numpy(np.bool_)
    frame["_succeeded"] = (frame["success"].fillna(False) & frame["plan_valid"].fillna(True)).to_numpy(np.bool_)
    factors = tuple(
        c
        for c in varying
        if c not in (*mixed, "seed", "robots.count", "map", "planner")
        and c.split(".")[0] not in ("record", "map")
        and pd.api.types.is_numeric_dtype(frame[c])
        and not pd.api.types.is_bool_dtype(frame[c])
        and np.isfinite(frame[c].dropna().to_numpy(np.float64)).all()
    )
    return ReportedRuns(
        name=name,
        description=description,
        until=until,
        frame=frame.copy(),  # in one piece of memory for each type: its rows are chosen hundreds of times
        maps=tuple(dict.fromkeys(frame["_map"])),
        series=tuple(sorted(first, key=lambda s: rank[s])),
        factors=factors,
        gaps=tuple(gaps),
        folders=folders,
    )


def _map_names(frame: pd.DataFrame) -> list[str]:
    """A short name for each map; maps with the same file name keep their folders."""
    files = frame["map"].astype(object).fillna("no map").astype(str)
    short = {file: re.sub(r"\.(building\.yaml|yaml|yml|map|json|geojson)$", "", file.rsplit("/", 1)[-1]) for file in files.unique()}
    if len(set(short.values())) < len(short):
        short = {file: file for file in short}
    names = [short[file] for file in files]
    for column in ("map.level", "map.graph"):
        if column in frame:
            varies = frame[column].groupby(files).transform(lambda values: values.nunique(dropna=False) > 1)
            word = column.split(".")[1]
            chosen = zip(names, frame[column], varies)
            names = [f"{name}, {word} {_plain(v)}" if several and not pd.isna(v) else name for name, v, several in chosen]
    return names


def _series_columns(frame: pd.DataFrame, varying: list[str]) -> list[str]:
    """What varies and belongs to a series, apart from the planner: words, and parameters of planner and assignment."""
    own = []
    for column in varying:
        section = column.split(".")[0]
        is_fleet = section == "robots" and column != "robots.type"
        if column in ("planner", "map", "seed") or section in ("map", "record") or is_fleet:
            continue
        is_word = not pd.api.types.is_numeric_dtype(frame[column]) or pd.api.types.is_bool_dtype(frame[column])
        if is_word or column.startswith("planner.parameters.") or section == "assignment":
            own.append(column)
    return own


def _series_names(rows: list[tuple[Any, ...]], columns: list[str], anytime: list[bool]) -> list[str]:
    """The series of each row; plug-ins by the stems of their files where these tell them apart."""
    short, full = ([_series_name(row, columns, star, shown) for row, star in zip(rows, anytime)] for shown in (short_name, str))
    return short if len(set(short)) == len(set(full)) else full


def _series_name(row: tuple[Any, ...], columns: list[str], anytime: bool, shown: Callable[[str], str]) -> str:
    planner = str(row[0])
    parts = [PLANNER_NAMES.get(planner, shown(planner))]
    if planner == "lacam":
        parts[0] += "*" * anytime
    for column, value in zip(columns, row[1:]):
        if pd.isna(value) or (planner == "lacam" and column == ANYTIME):
            continue
        word = column.rsplit(".", 1)[-1].replace("_", " ")
        parts.append(
            f"{word} {_plain(value)}" if column.startswith("planner.parameters.") or isinstance(value, bool) else shown(_plain(value))
        )
    return ", ".join(parts)


def _plain(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
