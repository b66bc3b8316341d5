"""Small floors that capacity studies are made of, driven for real: a ring with a busy station, a dead end, too few places to charge.

A floor's runs are made once, for every size a few hundred seeds (`pool`), by what makes the runs of a study. Their mean over all seeds is
the truth, and `Drawn` lets any number of studies draw their runs from them. So studies cost little, and what is counted is the product:
its runs, its observations, its search.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np
from floors import BATTERY, SMALL

from mrp_sumo.experiments.batch import Making, Watcher, run_batch
from mrp_sumo.io.scenario.read import scenario_of
from mrp_sumo.sizing.observe import FUNCTION
from mrp_sumo.sizing.points import Point, Record, record_of
from mrp_sumo.sizing.question import FULL, SATURATED, Question, Trial, effort_of
from mrp_sumo.sizing.search import NEW_SEEDS
from mrp_sumo.sizing.study import Study

EFFORT = replace(FULL, horizon_s=1200.0, budget_s=1e9)
LIGHT = {**BATTERY, "capacity_ah": 0.4, "charging_a": 2.0, "mass_kg": 10.0, "inertia_kgm2": 0.5, "friction": 0.05}
AT = {"A": (5, 0), "c1": (10, 0), "c2": (10, 10), "B": (5, 10), "c3": (0, 10), "c4": (0, 0), "w": (10, 8), "P": (10, 24)}
AT |= {"p1": (13, 0), "p2": (13, 10)}
RING = "A c1 w c2 B c3 c4 A"  # 40 m, one way
AS_DRAWN = {"triangular_s": [5, 20, 40]}


@dataclass(frozen=True)
class Floor:
    """A floor, its orders, and the fleets that are asked about."""

    name: str
    sizes: tuple[int, int]
    one_way: str  # names of vertices in the order in which they are driven through
    both_ways: tuple[str, ...]
    tasks: Mapping
    robot: Mapping = field(default_factory=lambda: SMALL)
    known_per_h: Mapping[int, float] = field(default_factory=dict)  # by hand, of some sizes

    def study(self, folder: Path) -> Study:
        """A study of it, of runs of 20 min."""
        rows = ["from,to,from_x_m,from_y_m,to_x_m,to_y_m,both_ways"]
        for ways, both in (((self.one_way,), "no"), (self.both_ways, "yes")):
            rows += [f"{a},{b},{AT[a][0]},{AT[a][1]},{AT[b][0]},{AT[b][1]},{both}" for route in ways for a, b in pairwise(route.split())]
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "floor.csv").write_text("\n".join(rows) + "\n")
        values = {
            "map": "floor.csv",
            "discretisation": {"kind": "roadmap", "cell_m": 1.0},
            "robots": {"count": 1, "type": dict(self.robot)},
            "planner": "prioritised",
            "tasks": dict(self.tasks),
            "record": {"bag": False},
        }
        file = scenario_of(values, folder, self.name.replace(" ", "_"))
        return Study(Question(file, self.sizes, effort_of(False, EFFORT.budget_s, EFFORT.horizon_s)))


def orders(service, **more):
    return {"streams": [{"name": "o", "stops": ["A", more.pop("to", "B")], "service": service, "arrivals": {"open": 2}}], **more}


FLOORS = (
    Floor("ring", (1, 5), RING, (), orders([30, 5]), known_per_h={1: 43.4, 2: 86.8, 4: 109.1}),
    Floor("dead end", (1, 5), RING, ("c2 P",), orders([2, AS_DRAWN], to="end", stations={"end": {"places": ["P"], "queue": ["w"]}})),
    Floor(
        "charging",
        (1, 8),
        RING,
        ("c1 p1", "c2 p2"),
        orders(
            [{"triangular_s": [5, 10, 20]}, 5],
            charging={"stations": ["p1", "p2"], "critical_low_charging_level": 60, "minimum_desired_charging_level": 60},
        ),
        {**SMALL, "battery": LIGHT},
    ),
)


@dataclass(frozen=True, eq=False)
class Pool:
    """Runs of a floor: of every size as many seeds."""

    floor: Floor
    question: Question
    records: Mapping[tuple[int, int], Record]  # by size and seed

    @cached_property
    def points(self) -> dict[int, Point]:
        """All runs of each size."""
        sizes = sorted({n for n, _ in self.records})
        return {n: Point(n, EFFORT.horizon_s, tuple(record for (m, _), record in self.records.items() if m == n)) for n in sizes}

    @property
    def num_seeds(self) -> int:
        return len({seed for _, seed in self.records})

    @cached_property
    def per_h(self) -> dict[int, float]:
        """Throughput of each size that may count, the mean over all runs: robots run empty in less than half of these, if at all."""
        return {n: point.throughput.value for n, point in self.points.items() if 2 * point.num_empty < len(point.records)}


def pool(floor: Floor, folder: Path, seeds: int, workers: int) -> Pool:
    """Make the runs of a floor that its folder does not hold yet."""
    study = floor.study(folder)
    question = replace(study.charged, effort=EFFORT)
    study.question = question
    trials = [Trial(SATURATED, n, seed) for seed in range(seeds) for n in range(question.sizes[0], question.most_robots + 1)]
    records: dict[tuple[int, int], Record] = {}

    def choose(lookup):
        for trial in trials:
            key = trial.robots, trial.seed
            if key not in records and (record := lookup(study.planned(trial).key)) is not None:
                records[key] = record_of(record)
        return [study.planned(trial) for trial in trials]

    run_batch(study.variations.suite, folder / "runs", Watcher(), Making(workers), function=FUNCTION, chooser=choose)
    return Pool(floor, question, {(trial.robots, trial.seed): records[trial.robots, trial.seed] for trial in trials})


class Drawn:
    """Records of trials of one study: its seeds are drawn from a pool with replacement, the same for all sizes; the pool's mean is true."""

    def __init__(self, of: Pool, study: int) -> None:
        self.pool, self.question = of, of.question
        self._seeds = np.random.default_rng(study).integers(of.num_seeds, size=2 * EFFORT.most_seeds).tolist()

    def __call__(self, trial: Trial) -> Record:
        nth = trial.seed if trial.seed < NEW_SEEDS else EFFORT.most_seeds + trial.seed - NEW_SEEDS
        return self.pool.records[trial.robots, self._seeds[nth]]
