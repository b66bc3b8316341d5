"""Error bands: the answer as the quantities that it rests on move within their intervals.

A fleet of the size that the answer names is driven at the settings of a design, which tells the effect of each quantity. Then the answer
is looked for once more with all quantities at their worse ends, and at their better ones, on the same orders. Bands hold the limits that
the study has for its answer where nothing moves, too.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import ceil, inf, isfinite, nan
from typing import Any

import numpy as np

from mrp_sumo.errors import count
from mrp_sumo.experiments.error_bands import (
    Effect,
    Moves,
    Quantity,
    between,
    corner,
    design,
    effects,
    most,
    quantities,
    rounded,
    spans,
    values_at,
)
from mrp_sumo.experiments.statistics import NOTHING, Interval
from mrp_sumo.io.documents import Place
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.sizing.question import DEMAND, SATURATED, Question, Trial
from mrp_sumo.sizing.reasons import Reasons, Share
from mrp_sumo.sizing.search import LEVEL, STEP, Bracket, Curve, Desk, Limits, Served, serving

Ordered = tuple[tuple[Place, float], ...]  # values of quantities

SEARCHED = 2  # times the answer: how large a fleet is tried at the worse ends
SIZES = 3  # that the search looks at there, roughly: for estimates
DEMANDED, KNEE, UNKNOWN = "demand", "knee", "unknown"  # answers; of one that is not known, the largest fleet that was tried
SAYS = {DEMANDED: "serve the demand", KNEE: "do 95 % of the most"}


@dataclass(frozen=True)
class End:
    """The answer with all quantities at their worse, or at their better ends."""

    throughput_per_h: float  # of the size that the answer names
    robots: int | None  # that answer the question there; None: none of those that were tried
    tried: int  # the largest


@dataclass(frozen=True, eq=False)
class Bands:
    """Error bands of an answer."""

    answer: str  # DEMANDED: the smallest fleet that serves it, KNEE or UNKNOWN
    robots: int  # the answer
    limits: Bracket  # of the answer by chance, where nothing moves
    throughput_per_h: Interval  # of that fleet, likewise
    effects: tuple[Effect, ...]  # on its throughput, the largest first
    worse: End
    better: End
    num_runs: int  # beside those of the study

    @property
    def fewest(self) -> int:
        """Robots that do at best."""
        return min(n for n in (self.robots, self.better.robots, self.limits.low) if n)

    @property
    def largest(self) -> int | None:
        """Robots that it takes at worst; None where none of those that were tried do."""
        return None if self.worse.robots is None else max(n for n in (self.robots, self.worse.robots, self.limits.high) if n)

    @property
    def span_per_h(self) -> tuple[float, float]:
        """Throughput of that fleet at least and at most, NaN where no run tells it."""
        ends = self.throughput_per_h.low, self.throughput_per_h.high, self.worse.throughput_per_h, self.better.throughput_per_h
        known = [each for each in ends if isfinite(each)]
        return min(known, default=nan), max(known, default=nan)

    @property
    def sentence(self) -> str:
        within = f"if your robots and stations are within {spans([effect.quantity for effect in self.effects])}"
        per_h = f"{between(*self.span_per_h, '.0f')} orders an hour"
        if self.answer == UNKNOWN:
            return f"{count(self.robots, 'robot')} do {per_h} {within}; {most(self.effects)}."
        serve = SAYS[self.answer]
        if self.largest is None:
            how_many = f"{count(self.fewest, 'robot')} {serve} at best, and not even {self.worse.tried} at worst,"
        elif self.fewest == self.largest:
            how_many = f"{count(self.fewest, 'robot')} {serve} all the same"
        else:
            how_many = f"Between {self.fewest} and {self.largest} robots {serve}"
        return f"{how_many} {within}; {most(self.effects)}. {count(self.robots, 'robot')} do {per_h} then."

    @property
    def document(self) -> dict[str, Any]:
        known = self.answer != UNKNOWN
        return {
            "sentence": self.sentence,
            "answer": self.answer,
            "robots": {"estimate": self.robots, "low": self.fewest if known else None, "high": self.largest if known else None},
            "throughput_per_h": dict(zip(("estimate", "low", "high"), map(rounded, (self.throughput_per_h.value, *self.span_per_h)))),
            "quantities": [effect.document for effect in self.effects],
            "runs": self.num_runs,
        }


def bands(desk: Desk, limit: Limits, served: Served | None, why: Sequence[Reasons]) -> Bands | None:
    """Error bands of an answer, on top of the budget; None where no size counts. Raises Missing."""
    if not limit.curve.points:
        return None
    effort = replace(desk.question.effort, budget_s=inf, most_seeds=desk.question.effort.seeds + STEP)
    before, desk = len(desk.trials), Desk(replace(desk.question, effort=effort), desk.recorded, trials=desk.trials)
    if served and served.smallest.estimate is not None:
        answer, robots, within = DEMANDED, served.smallest.estimate, served.smallest
    elif limit.knee.estimate is not None:
        answer, robots, within = KNEE, limit.knee.estimate, limit.knee
    else:
        answer, robots, within = UNKNOWN, limit.curve.best, Bracket()
    near = min(why, key=lambda each: (abs(each.robots - robots), each.robots))
    of = quantities(desk.question.file, dict(desk.question.bounds or ()), stations_of(desk.question.file, near.stations))
    by_quantity = _effects(desk, limit.curve.planner, robots, of)
    as_is = _saturated(desk, limit.curve.planner, {robots}).points.get(robots)
    as_is_per_h, ends = as_is.throughput if as_is else NOTHING, []
    for better in (False, True):
        moves = _ordered(corner(by_quantity, better))
        there = _saturated(desk, limit.curve.planner, {robots, *(_sizes_near(limit, robots) if answer == KNEE else ())}, moves)
        per_h = there.points[robots].throughput.value if robots in there.points else nan
        if answer == DEMANDED and served:
            ends.append(_serving(desk, served, robots, moves, per_h, as_is_per_h.value))
        else:
            ends.append(End(per_h, _knee(there) if answer == KNEE else robots, max([*there.sizes, robots])))
    return Bands(answer, robots, within, as_is_per_h, by_quantity, ends[0], ends[1], len(desk.trials) - before)


def stations_of(file: ScenarioFile, shares: Sequence[Share]) -> list[str]:
    """Groups and stations by how busy they are; the busiest station speaks for its group."""
    group_of = file.scenario.tasks.group_of if file.scenario.tasks else {}
    return list(dict.fromkeys(group_of.get(share.name, share.name) for share in shares if share.utilisation > 0))


def likely_trials(question: Question, robots: int, count: int) -> list[Trial]:
    """Roughly the trials that error bands of so many quantities take, for a fleet of so many robots."""
    seeds = question.effort.seeds
    settings = len(design(count))
    return [Trial(SATURATED, robots, k) for k in range(settings + 2 * seeds)] + [Trial(DEMAND, robots, k) for k in range(2 * SIZES * seeds)]


def _effects(desk: Desk, planner: str, robots: int, of: Sequence[Quantity]) -> tuple[Effect, ...]:
    """Effects of quantities on what a fleet does: the design on one seed, its mirror image on the next."""
    settings = design(len(of))
    seed = np.repeat((0, 1), len(settings) // 2)
    trials = [
        Trial(SATURATED, robots, s, planner=planner, moves=_ordered(values_at(of, row))) for row, s in zip(settings.tolist(), seed.tolist())
    ]
    return effects(of, settings, seed, desk.points({robots: trials})[robots].per_h)


def _saturated(desk: Desk, planner: str, sizes: Iterable[int], moves: Ordered = ()) -> Curve:
    """Fleets that always have work waiting."""
    curve = Curve(desk, SATURATED, planner=planner, moves=moves)
    curve.ask(dict.fromkeys(sorted(sizes), desk.question.effort.seeds), "error bands")
    return curve


def _sizes_near(limit: Limits, robots: int) -> list[int]:
    """Sizes among which the knee is looked for: those of the study from half of it to twice."""
    return [n for n in limit.curve.sizes if robots / SEARCHED <= n <= SEARCHED * robots]


def _knee(curve: Curve) -> int | None:
    """The smallest fleet that does nearly as much as the best."""
    most_per_h = max((point.throughput.value for point in curve.points.values()), default=0.0)
    return next((n for n in curve.sizes if curve.points[n].throughput.value >= LEVEL * most_per_h), None)


def _serving(desk: Desk, served: Served, robots: int, moves: Ordered, per_h: float, as_is_per_h: float) -> End:
    """The smallest fleet that serves the demand; it is looked for where the throughput says."""
    curve = Curve(desk, DEMAND, planner=served.curve.planner, moves=moves)
    least, largest = desk.question.sizes[0], min(desk.question.most_robots, SEARCHED * robots)
    ratio = as_is_per_h / per_h if per_h > 0 and as_is_per_h > 0 else 1.0
    searched = serving(curve, (least, largest), min(max(ceil(ratio * robots), least), largest), served.within_s)
    return End(per_h, searched.smallest.estimate, max([*curve.points, *curve.unfit, robots]))


def _ordered(moves: Moves) -> Ordered:
    return tuple(sorted(moves.items(), key=str))
