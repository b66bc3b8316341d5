"""The sizes that an answer names, driven again in SUMO: the same orders, planner and policy, another engine.

Studies are driven on the kinematic engine, which is ten times as fast. Two engines that agree on the sizes that matter are worth more than
one that is believed.
"""

from collections.abc import Iterator
from dataclasses import dataclass

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.experiments.statistics import PairedMeans, paired_t
from mrp_sumo.sizing.points import Point
from mrp_sumo.sizing.question import DEMAND, IN_SUMO, ONE_SHOT, SATURATED, Trial
from mrp_sumo.sizing.search import Curve, Desk, Limits, Served

SEEDS = 3  # of each size, at most
TOLERANCE = 0.05  # of a figure: as near as this, and engines agree whatever the limits of their difference are


@dataclass(frozen=True, eq=False)
class Confirmation:
    """A size that the answer names, on both engines and the same seeds."""

    name: str  # 'knee', 'peak', 'largest tried' (where no peak was found), 'collapse', 'demand' or 'largest'; several joined by ', '
    robots: int
    measure: str  # 'throughput_per_h', 'on_time' (share of orders) or 'succeeded' (share of draws)
    difference: PairedMeans  # SUMO's minus the kinematic engine's

    @property
    def agrees(self) -> bool:
        """True if the engines differ by no more than chance, or by little."""
        mean = self.difference.difference
        return mean.low <= 0 <= mean.high or abs(mean.value) <= TOLERANCE * self.difference.first


def confirmations(desk: Desk, limit: Limits | None, served: Served | None) -> tuple[Confirmation, ...]:
    """Have the sizes of the answer driven in SUMO, and compare. Raises Missing."""
    sizes = list(_named(limit, served))
    trials = {}
    for _, kind, n, curve in sizes:  # the first runs of each again
        first, num = curve.points[n].first_seed, min(SEEDS, len(curve.points[n].records))
        trials[kind, n] = [Trial(kind, n, seed, IN_SUMO, curve.planner) for seed in range(first, first + num)]
    points, within_s = desk.points(trials), served.within_s if served else 0.0
    confirmed = []
    for name, kind, n, curve in sizes:
        measure, before, after = _measured(kind, curve.points[n], points[kind, n], within_s)
        confirmed.append(Confirmation(name, n, measure, paired_t(before[: len(after)], after)))
    return tuple(confirmed)


def most_trials(has_tasks: bool, robots: int) -> list[Trial]:
    """No confirmation asks for more than these, if no fleet is larger."""
    kinds = (SATURATED, SATURATED, SATURATED, DEMAND) if has_tasks else (ONE_SHOT,)
    return [Trial(kind, robots, seed, IN_SUMO) for kind in kinds for seed in range(SEEDS)]


def _named(limit: Limits | None, served: Served | None) -> Iterator[tuple[str, str, int, Curve]]:
    """Name, kind of trial and size, and the curve that has it; sizes with several names once."""
    if limit and limit.curve.points:
        names: dict[int, list[str]] = {}
        best = "peak" if limit.peak.estimate is not None else "largest tried"
        for name, n in (("knee", limit.knee.estimate), (best, limit.curve.best), ("collapse", limit.collapse.estimate)):
            if n is not None:
                names.setdefault(n, []).append(name)
        yield from ((", ".join(of_size), SATURATED, n, limit.curve) for n, of_size in names.items())
    if served and served.smallest.estimate is not None:
        yield "demand" if limit else "largest", served.curve.kind, served.smallest.estimate, served.curve


def _measured(kind: str, one: Point, other: Point, within_s: float) -> tuple[str, FloatArray, FloatArray]:
    if kind == SATURATED:
        return "throughput_per_h", one.per_h, other.per_h
    if kind == DEMAND:
        return "on_time", one.punctual(within_s), other.punctual(within_s)
    return "succeeded", one.succeeded, other.succeeded
