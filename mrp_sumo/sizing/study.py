"""A capacity study: a batch that chooses its next runs, and the answer that its runs give.

Killed and started again, it goes on where it was, and the answer is the same to the last byte.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from math import ceil
from pathlib import Path
from time import monotonic
from typing import Any

from mrp_sumo.core.graph import NavGraph
from mrp_sumo.errors import MrpSumoError, PlanError, ScenarioError
from mrp_sumo.experiments.batch import NOW, Lookup, Making, Watcher, run_batch
from mrp_sumo.experiments.error_bands import MOST_QUANTITIES, Quantity, design, quantities, values_at
from mrp_sumo.experiments.identity import code_version
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import carry_out
from mrp_sumo.experiments.staging.set_up import SetUp, set_up
from mrp_sumo.experiments.suite import PlannedRun, Variations
from mrp_sumo.io.scenario.read import changed
from mrp_sumo.sizing.answer import Answer, answer_of
from mrp_sumo.sizing.bands import likely_trials
from mrp_sumo.sizing.confirmation import most_trials
from mrp_sumo.sizing.observe import FUNCTION
from mrp_sumo.sizing.points import Record, record_of
from mrp_sumo.sizing.question import (
    AS_MANY_AS_FIT,
    CORES,
    ONE_SHOT,
    SATURATED,
    Cycle,
    Question,
    Trial,
    driving_cpu_s,
    own_demand_per_h,
    predicted_s,
    require_answerable,
    spendable,
    values_of,
)
from mrp_sumo.sizing.search import grid
from mrp_sumo.sizing.what_if import AUTO, values_of_change

PILOT_S, PILOT_ROBOTS = 120.0, 24  # simulated, and at most
LOADING_S = 20.0  # simulated before a pilot is measured
LEAST_ROBOTS, MOST_ROBOTS = 4, 200  # by default; fewer where the map holds fewer


def completed(question: Question) -> Question:
    """The question with what follows from the scenario where it leaves that open: demand, and sizes of fleets."""
    tasks = question.file.scenario.tasks
    if question.demand_per_h is None and tasks:
        question = replace(question, demand_per_h=own_demand_per_h(tasks.streams))
    require_answerable(question)
    if question.sizes == AS_MANY_AS_FIT:
        most = max(1, most_robots(question, MOST_ROBOTS))
        least = min(LEAST_ROBOTS, most, max(1, question.file.scenario.robots.size))  # what the scenario runs is tried
        question = replace(question, sizes=(least, most))
    return question


def most_robots(question: Question, limit: int) -> int:
    """The largest fleet that the map holds, up to a limit; 0 where even one robot cannot be set up."""
    fits, fails = 0, limit + 1
    while fails > fits + 1:
        middle = limit if fails > limit else (fits + fails) // 2
        try:
            fleet_on_map(question, middle)
            fits = middle
        except (PlanError, ScenarioError):
            fails = middle
    return fits


def fleet_on_map(question: Question, robots: int) -> SetUp:
    """A fleet of the scenario on its map, nothing planned."""
    trial = Trial(SATURATED if question.has_tasks else ONE_SHOT, robots, 0)
    with MapCache() as maps:
        return set_up(changed(question.file, values_of(trial, question, {})), maps)


@dataclass(frozen=True)
class Pilot:
    """A short run of the study that is measured beforehand."""

    robots: int
    slower: float  # CPU time of a simulated second, as a multiple of the predicted one
    power_w: float  # that a robot draws, 0 where robots have no batteries


@dataclass(frozen=True)
class Estimate:
    """Likely time of a study on `CORES` cores; measured on a pilot where orders come while robots drive."""

    sizes: tuple[int, ...]  # of the coarse grid, as far as the budget goes
    grid_s: float  # the grid alone
    budget_s: float  # at most, with all that follows from it
    confirm_s: float  # at most, what confirmation takes on top
    bands_s: float  # about what error bands take on top


class _Clock:
    """Ends a batch, and the runs under way, when the budget is over; before, what the user asks for."""

    def __init__(self, ends_s: float, stop: Callable[[], int]) -> None:
        self._ends_s, self._stop = ends_s, stop
        self.is_over = False

    def __call__(self) -> int:
        self.is_over = monotonic() >= self._ends_s
        return NOW if self.is_over else self._stop()


class Study:
    """A question, the map that it is about, and the runs that it may ask for."""

    def __init__(self, question: Question) -> None:
        """Check the question.

        Raises MrpSumoError: one line, for what the scenario cannot answer, sizes that the map cannot hold, changes that cannot be made, and
        a budget that buys nothing.
        """
        self.question = question = completed(question)
        self._began_s = monotonic()  # the pilot counts, too
        self._runs: dict[Trial, PlannedRun] = {}
        self._records: dict[str, Record] = {}
        self.variations = Variations(question.file, f"capacity_{question.file.scenario.name}", code_version())
        self._require_budget()
        self.setup = self._fits(question.sizes[1])
        for text in question.what_if:
            if text != AUTO:
                self._check(Trial(SATURATED, question.sizes[0], 0, text))
        if question.bounds is not None:
            design(len(self._quantities))
            for level in (-1.0, 1.0):
                moves = tuple(values_at(self._quantities, [level] * MOST_QUANTITIES).items())
                self._check(Trial(SATURATED, question.sizes[0], 0, moves=moves))

    @property
    def nav(self) -> NavGraph:
        """The map as drawn."""
        return self.setup.map.nav

    @property
    def estimate(self) -> Estimate:
        """Likely time of the study, stated before it begins."""
        question = self.charged
        kind, sizes, spent_s = SATURATED if question.has_tasks else ONE_SHOT, [], 0.0
        slower = self.pilot.slower if question.has_tasks else 1.0
        for n in grid(question):
            cost = question.effort.seeds * predicted_s([Trial(kind, n, 0)], question, slower)
            if spent_s + cost > self._grid_s:
                break
            sizes.append(n)
            spent_s += cost
        last = most_trials(question.has_tasks, sizes[-1]) if question.confirm and sizes else []
        moved = likely_trials(question, sizes[len(sizes) // 2], len(self._quantities)) if question.bounds is not None and sizes else []
        confirm_s, bands_s = (predicted_s(trials, question, slower) for trials in (last, moved))
        return Estimate(tuple(sizes), spent_s, question.effort.budget_s, confirm_s, bands_s)

    @cached_property
    def pilot(self) -> Pilot:
        """Two simulated minutes of a small fleet, after some seconds that are not measured: kernels are compiled and loaded in them."""
        sizes = [n for n in grid(self.question) if n <= PILOT_ROBOTS] or [self.question.sizes[0]]
        trial, question = Trial(SATURATED, sizes[-1], 0), replace(self.question, engine="kinematic")
        with MapCache() as maps:
            for until_s in (LOADING_S, min(PILOT_S, question.effort.horizon_s)):
                values = {**values_of(trial, question, {}), ("execution", "time_limit_s"): ("capacity", until_s)}
                execution = carry_out(changed(question.file, values), maps).execution
        if execution is None or not execution.sim_time_s:
            return Pilot(trial.robots, 1.0, 0.0)
        robot_s = execution.sim_time_s * trial.robots
        used_j = float(execution.batteries.used_j.sum()) if execution.batteries else 0.0
        return Pilot(trial.robots, execution.cpu_time_s / driving_cpu_s(trial.robots, execution.sim_time_s), used_j / robot_s)

    @cached_property
    def charged(self) -> Question:
        """The question, with how long robots drive and charge where they have batteries."""
        return replace(self.question, charging=self._cycle())

    def _cycle(self) -> Cycle | None:
        """Of robots with batteries, the slowest to charge of its types."""
        batteries = [battery for battery in self.setup.problem.fleet.batteries if battery.energy_j > 0]
        if not (self.question.has_tasks and batteries) or self.pilot.power_w <= 0:
            return None
        battery = max(batteries, key=lambda battery: battery.charge_s(1.0))
        charging, chargers = self.setup.settings.charging, self.setup.settings.chargers
        if charging is None or not chargers:
            return Cycle(battery.energy_j / self.pilot.power_w, 0.0, 0)
        highest = charging.minimum if charging.opportunity else charging.maximum  # where orders always wait
        share = highest - charging.critical
        return Cycle(share * battery.energy_j / self.pilot.power_w, battery.charge_s(share), len(chargers), highest)

    def run(
        self, folder: Path, watcher: Watcher, making: Making, *, wondered: Callable[[Answer | None], None] = lambda answer: None
    ) -> Answer | None:
        """Make the runs that are missing, kept in a folder, and answer; None where the study was stopped before an answer is known.

        `wondered` is called whenever the search has looked at what there is, with the answer once it is known. Raises MrpSumoError as
        `run_batch` does.
        """
        self.question = self.charged
        answer: Answer | None = None
        clock = _Clock(self._began_s + self.question.effort.budget_s, making.stop)

        def choose(lookup: Lookup) -> list[PlannedRun]:
            nonlocal answer
            answer, trials = answer_of(self.question, lambda trial: self._recorded(trial, lookup), closed=clock.is_over)
            wondered(answer)
            return [self.planned(trial) for trial in trials]

        def make(until: Callable[[], int]) -> None:
            run_batch(self.variations.suite, folder, watcher, replace(making, stop=until), function=FUNCTION, chooser=choose)

        make(clock)
        if answer is None and clock.is_over:
            make(making.stop)  # from what there is: only what confirms it is missing, which comes on top of the budget
        return answer

    def planned(self, trial: Trial) -> PlannedRun:
        """The run of a trial."""
        if trial not in self._runs:
            self._runs[trial] = self.variations.run(self.values(trial))
        return self._runs[trial]

    def values(self, trial: Trial) -> Mapping[Any, tuple[str, Any]]:
        """Values of a trial that differ from the scenario's."""
        change = values_of_change(trial.change, self.question, self.nav) if trial.change else {}
        return values_of(trial, self.question, change)

    @property
    def _grid_s(self) -> float:
        """What the coarse grid may spend of the budget; one-shot fleets are nothing but a grid."""
        question = self.question
        return question.effort.budget_s * (spendable(question)[0] if question.has_tasks else 1.0)

    def _recorded(self, trial: Trial, lookup: Lookup) -> Record | None:
        key = self.planned(trial).key
        if key not in self._records and (record := lookup(key)) is not None:
            self._records[key] = record_of(record)
        return self._records.get(key)

    def _require_budget(self) -> None:
        """At least two sizes of the grid, or there is nothing to say."""
        question = self.question
        kind = SATURATED if question.has_tasks else ONE_SHOT
        sizes = grid(question)[:2]
        least_s = question.effort.seeds * predicted_s([Trial(kind, n, 0) for n in sizes], question)
        if least_s > self._grid_s:
            fleets = " and with ".join(map(str, sizes))
            runs = f"{question.effort.seeds} runs of {question.effort.horizon_s / 60:g} min with {fleets} robots"
            raise MrpSumoError(
                f"--budget {question.effort.budget_s:g}s: too little to say anything: {runs} alone take about {ceil(least_s)} s on {CORES} "
                f"cores; {ceil(2 * least_s / spendable(question)[0])}s would do"
            )

    def _fits(self, most: int) -> SetUp:
        """The set-up of the largest fleet: a map that holds it holds all."""
        first, last = self.question.sizes
        try:
            return fleet_on_map(self.question, most)
        except (PlanError, ScenarioError) as error:
            fits = most_robots(self.question, last)
            if fits < first:
                raise
            reason = str(error).splitlines()[0].split(": ", 1)[-1]
            raise MrpSumoError(f"--robots {first}..{last}: more than the map holds ({reason}); {first}..{fits} would do") from None

    @cached_property
    def _quantities(self) -> tuple[Quantity, ...]:
        """Those that error bands will move, the stations by order of the scenario."""
        tasks = self.question.file.scenario.tasks
        served = {name for stream in tasks.streams for name in (*(stream.stops or ()), *(stream.matrix or {}))} if tasks else set()
        return quantities(self.question.file, dict(self.question.bounds or ()), sorted(served))

    def _check(self, trial: Trial) -> None:
        with MapCache() as maps:
            set_up(changed(self.question.file, self.values(trial)), maps)
