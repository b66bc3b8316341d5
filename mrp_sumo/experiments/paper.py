"""All runs of the MRP-Bench paper: the bundled suites of its tables, its Figure 5 and its replicability study, made one after the other.

Each suite is a batch of its own in the folder, so that everything resumes. The suites can be made on MRP-Bench's own map files, and
with fewer seeds.
"""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.batch import BROKEN, Making, Watcher, run_batch
from mrp_sumo.experiments.suite import find_suite, read_suite
from mrp_sumo.files.writing import write_whole
from mrp_sumo.io.results import load_results

if TYPE_CHECKING:
    import pandas

SUITES = (
    *("paper_table_1", "paper_table_2", "paper_table_3", "paper_table_4", "paper_figure_5"),
    *("replicability_single", "replicability_five", "paper_no_yielding", "paper_slow_cbs", "paper_other_seeds"),
)
MRP_BENCH = {"office": "office", "warehouse": "warehouse", "airport": "airport_terminal"}  # our map -> their file
UNITED = ("airport",)  # maps of which the paper unites the graphs of all fleets
OWN_PATH = {"starts": ["mandrill"], "goals": ["sun_bear"]}  # 45 cells of 0.35 m on MRP-Bench's warehouse
RESULTS = "results"  # folder of the batches
NUM_HARD, NUM_EASY = 2, 1  # scenarios of each kind that are driven a hundred times


@dataclass(frozen=True)
class Campaign:
    """Studies to make, and their folder."""

    folder: Path
    maps: Path | None = None  # an MRP-Bench checkout, or a folder with its maps; bundled maps by default
    num_seeds: int | None = None  # of every suite, the first so many; all by default

    def results(self, suite: str) -> Path:
        return self.folder / RESULTS / suite


@dataclass(frozen=True)
class Made:
    """Result of a call that made a campaign, or part of it."""

    num_runs: int  # of the campaign
    num_made: int  # by this call
    num_broken: int  # that crashed or took too much
    seconds: float
    finished: bool


@dataclass(frozen=True)
class Kinds:
    """Scenarios on the warehouse of the two kinds that the paper's replicability study has."""

    robots: int
    hard: tuple[int, ...]  # seeds of which no planner's plan survives undisturbed
    easy: tuple[int, ...]  # that most survive, ECBS's and EECBS's plans among them
    survivors: dict[int, int]  # how many planners' plans survive each
    num_seeds: int  # looked at


def run_campaign(campaign: Campaign, watcher: Watcher, making: Making) -> Made:
    """Make all runs that have no result yet.

    Raises MrpSumoError for a folder that holds something else or was made by another version, and maps that are not there.
    """
    begin = time.monotonic()
    maps = maps_in(campaign.maps) if campaign.maps else {}
    num_runs = num_broken = 0
    for name in SUITES:
        path = campaign.folder / "suites" / f"{name}.yaml"
        suite = suite_of(name, campaign.num_seeds, maps)
        if name == "replicability_five":
            suite = _of_kinds(suite, kinds_of(load_results(campaign.results("paper_table_3"))))
        write_whole(path, yaml.safe_dump(suite, sort_keys=False, width=120).encode())
        batch = run_batch(read_suite(path), campaign.results(name), watcher, making)
        num_runs += len(batch.runs)
        num_broken += sum(batch.counts()[status] for status in BROKEN)
        if is_stopped := len(batch.status) < len(batch.runs):
            break
    return Made(num_runs, watcher.num_made, num_broken, time.monotonic() - begin, not is_stopped)


def maps_in(folder: Path) -> dict[str, str]:
    """Files of MRP-Bench's maps, by our names. Raises MrpSumoError when one is missing."""
    files_of = {}
    for ours, theirs in MRP_BENCH.items():
        files = sorted(folder.rglob(f"{theirs}.building.yaml"))
        if not files:
            raise MrpSumoError(f"{folder}: there is no {theirs}.building.yaml in it, expected an MRP-Bench checkout")
        files_of[ours] = str(files[0].resolve())
    return files_of


def suite_of(name: str, num_seeds: int | None, maps: dict[str, str]) -> dict[str, Any]:
    """A bundled suite as a document, with the first seeds and on other maps."""
    suite: dict[str, Any] = yaml.safe_load(find_suite(name).read_text(encoding="utf-8"))
    grid = suite["grid_search"]
    if maps:
        names = grid.get("map") or ["warehouse"]  # the base's
        grid = {"map": [{"file": maps[key]} | ({"graph": "all"} if key in UNITED else {}) for key in names]} | {
            key: values for key, values in grid.items() if key != "map"
        }
    if maps and name == "replicability_single":
        suite = {**suite, "base": {**suite["base"], "robots": OWN_PATH}}
    for key in ("seed", "execution.disturbances.seed"):
        if num_seeds is not None and isinstance(grid.get(key), str):
            first, last = map(int, grid[key].split(".."))
            grid = {**grid, key: f"{first}..{min(last, first + num_seeds - 1)}"}
    return {"name": name, **suite, "grid_search": grid}


def kinds_of(driven: "pandas.DataFrame") -> Kinds:
    """The scenarios among the runs of Table III: with five robots, as in the paper, unless every scenario with five survives."""
    there = driven["map"].str.contains("warehouse") & (driven["execution.policy"] == "open_loop")
    runs = driven[there & driven["execution.recovery.replanner"].isna()]
    for robots in sorted(runs["robots.count"].unique()):
        of = runs[runs["robots.count"] == robots]
        arrived = (
            of.assign(arrived=of["all_goals_reached"].fillna(False)).pivot(index="seed", columns="planner", values="arrived").astype(int)
        )
        survivors = {int(seed): int(count) for seed, count in arrived.sum(axis=1).items()}
        hard = tuple(seed for seed, count in survivors.items() if not count)
        both = [int(seed) for seed in arrived.index[arrived[["ecbs", "eecbs"]].all(axis=1)]]
        easy = tuple(sorted(both, key=lambda seed: (survivors[seed] == arrived.shape[1], -survivors[seed], seed)))
        if hard:
            break
    return Kinds(int(robots), hard[:NUM_HARD], easy[:NUM_EASY], survivors, len(survivors))


def _of_kinds(suite: dict[str, Any], kinds: Kinds) -> dict[str, Any]:
    """The suite of the study with five robots, of these scenarios; the hard ones by EECBS, as in the paper."""
    grid = {**suite["grid_search"], "robots.count": [kinds.robots], "seed": [*kinds.hard, *kinds.easy]}
    exclude = [{"seed": list(kinds.hard), "planner": "ecbs"}] if kinds.hard else []
    return {**suite, "grid_search": grid, "exclude": exclude}
