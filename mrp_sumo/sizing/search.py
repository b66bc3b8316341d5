"""The search: which runs to make next, and what those that are made say.

A search is a plain function that asks for trials and is handed their records; where one is not made yet, `Missing` carries what is
wanted to the batch, and the search is run again from the beginning when there is more. So an answer depends on finished runs alone, not
on who made them, in which order, or how often the study was killed. Three questions: `limits` (knee, peak and collapse of throughput),
`demand` (the smallest fleet that serves it), `one_shot` (the largest whose plans are found and driven in time).

The throughput of a saturated fleet is taken to rise up to its peak. That is checked; where it is not so, nothing is parted further and
the coarse grid is the answer.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from math import isnan

from mrp_sumo.experiments.replications import t_mean
from mrp_sumo.experiments.statistics import Interval, holm, wilson
from mrp_sumo.sizing.points import Point, Record, compared
from mrp_sumo.sizing.question import CORES, DEMAND, ONE_SHOT, SATURATED, Effort, Question, Trial, predicted_cpu_s
from mrp_sumo.sizing.reasons import undisturbed_s

LEVEL = 0.95  # of the peak: the knee reaches it, the collapse falls below it
ONE_SIDED = 0.90  # two-sided limits whose each side is a one-sided 95 % limit
PATIENCE = 3.0  # times what an order takes undisturbed, in which one without a due time is to be done
STEP = 2  # seeds that are added at a time

Recorded = Callable[[Trial], Record | None]


class Missing(Exception):
    """Trials that are wanted and not made yet."""

    def __init__(self, trials: Sequence[Trial]) -> None:
        super().__init__(f"{len(trials)} trials")
        self.trials = tuple(trials)


@dataclass(frozen=True)
class Bracket:
    """A number of robots that is known to lie in an interval; None: not found, or no bound on that side."""

    estimate: int | None = None
    low: int | None = None
    high: int | None = None


@dataclass
class Desk:
    """Where trials are asked for and paid: a budget in predicted seconds, so that it buys the same on every machine."""

    question: Question
    recorded: Recorded
    asked: dict[Trial, None] = field(default_factory=dict)  # in order
    spent_s: float = 0.0
    left_out: list[str] = field(default_factory=list)  # what the budget did not buy
    share: float = 1.0  # of the budget that may be spent by now: the rest is for what comes after

    def affords(self, trials: Sequence[Trial], reason: str) -> bool:
        """Whether the budget buys these trials; what it does not is noted."""
        cost = sum(predicted_cpu_s(trial, self.question) for trial in trials if trial not in self.asked) / CORES
        if self.spent_s + cost <= self.share * self.question.effort.budget_s:
            return True
        if reason not in self.left_out:
            self.left_out.append(reason)
        return False

    def records(self, trials: Sequence[Trial]) -> list[Record]:
        """The records of trials, which are paid for. Raises Missing."""
        for trial in trials:
            if trial not in self.asked:
                self.asked[trial] = None
                self.spent_s += predicted_cpu_s(trial, self.question) / CORES
        found = [self.recorded(trial) for trial in trials]
        if missing := [trial for trial, record in zip(trials, found) if record is None]:
            raise Missing(missing)
        return [record for record in found if record is not None]


@dataclass
class Curve:
    """Points by number of robots, all of one kind, which grow."""

    desk: Desk
    kind: str
    points: dict[int, Point] = field(default_factory=dict)

    def ask(self, wanted: dict[int, int], reason: str) -> bool:
        """Have so many seeds at sizes. All are asked for at once; False where the budget does not buy them."""
        trials = [Trial(self.kind, n, seed) for n, seeds in wanted.items() for seed in range(seeds)]
        if not self.desk.affords(trials, reason):
            return False
        records = iter(self.desk.records(trials))
        for n, seeds in wanted.items():
            self.points[n] = Point(n, self.desk.question.effort.horizon_s, tuple(next(records) for _ in range(seeds)))
        return True

    @property
    def sizes(self) -> list[int]:
        """Ascending."""
        return sorted(self.points)

    @property
    def best(self) -> int:
        """The size with the most throughput; the smaller of equals."""
        return max(self.sizes, key=lambda n: (self.points[n].throughput.value, -n))

    def seeds(self, n: int) -> int:
        """How many seeds a size has."""
        return len(self.points[n].records) if n in self.points else 0


@dataclass(frozen=True)
class Limits:
    """What a saturated fleet comes to by its size."""

    curve: Curve
    peak: Bracket
    knee: Bracket
    collapse: Bracket
    rises: bool  # whether throughput rises up to the peak, as was taken for granted
    first_deadlock: int | None  # the smallest size of which a run had one


def grid(question: Question) -> list[int]:
    """Sizes of the coarse grid, geometric from the least to the most."""
    (low, high), growth = question.sizes, question.effort.growth
    sizes, at = [low], float(low)
    while sizes[-1] < high:
        at = max(at * growth, sizes[-1] + 1)
        sizes.append(min(high, round(at)))
    return sizes


def coarse(desk: Desk) -> Curve:
    """Saturated fleets of the coarse grid, until throughput has clearly fallen."""
    curve = Curve(desk, SATURATED)
    for n in grid(desk.question):
        if not curve.ask({n: desk.question.effort.seeds}, f"fleets from {n} robots on") or _fell(curve):
            break
    return curve


def limits(curve: Curve) -> Limits:
    """Knee, peak and collapse of fleets that are there, with more sizes and seeds where something is undecided."""
    if not curve.points:
        return Limits(curve, Bracket(), Bracket(), Bracket(), True, None)
    while (wanted := _next(curve, curve.desk.question.effort)) and curve.ask(wanted, "closer limits"):
        pass
    deadlocked = [n for n in curve.sizes if curve.points[n].num_deadlocked]
    return Limits(curve, _peak(curve), _knee(curve), _collapse(curve), _rises(curve), min(deadlocked, default=None))


def side(curve: Curve, n: int) -> int:
    """1: a size has at least LEVEL of the best one's throughput, -1: it has less, 0: undecided."""
    best = curve.best
    if n == best:
        return 1
    difference = compared(curve.points[best], curve.points[n], LEVEL, ONE_SIDED).difference
    return 1 if difference.low > 0 else -1 if difference.high < 0 else 0


def _fell(curve: Curve) -> bool:
    """Whether the last two sizes are clearly beyond the collapse: one alone may be a dip."""
    last, peak = curve.sizes[-2:], curve.points[curve.best].throughput.value
    return len(last) == 2 and all(n > curve.best and side(curve, n) < 0 and curve.points[n].throughput.value < 0.9 * peak for n in last)


def _next(curve: Curve, effort: Effort) -> dict[int, int]:
    """Sizes that should have more seeds, and how many; {}: the answer is known."""
    sizes, best = curve.sizes, curve.best
    gaps = [(a, b) for a, b in pairwise(sizes) if b > a + 1 and b > effort.gap * a]
    at = sizes.index(best)
    around = {pair for pair in pairwise(sizes) if best in pair}  # the peak
    if best == sizes[-1]:  # there is none
        gaps = []
    below = [n for n in sizes[:at] if curve.points[n].throughput.value < LEVEL * curve.points[best].throughput.value]
    above = [n for n in sizes[at + 1 :] if curve.points[n].throughput.value < LEVEL * curve.points[best].throughput.value]
    if below:
        around.add((below[-1], sizes[sizes.index(below[-1]) + 1]))  # the knee
    if above:
        around.add((sizes[sizes.index(above[0]) - 1], above[0]))  # the collapse
    if _rises(curve) and (parted := [pair for pair in gaps if pair in around]):
        widest = max(parted, key=lambda pair: pair[1] / pair[0])
        return {round((widest[0] * widest[1]) ** 0.5): effort.seeds}
    ends = sorted({n for pair in around for n in pair})
    vague = [n for n in ends if curve.seeds(n) < effort.most_seeds and _is_vague(curve, n, effort)]
    return {n: min(effort.most_seeds, curve.seeds(n) + STEP) for n in vague}


def _is_vague(curve: Curve, n: int, effort: Effort) -> bool:
    mean = curve.points[n].throughput
    return (mean.high - mean.low) / 2 > effort.precision * mean.value or (n != curve.best and side(curve, n) == 0)


def _rises(curve: Curve) -> bool:
    """Whether no size below the peak has clearly less throughput than a smaller one."""
    rising = [n for n in curve.sizes if n <= curve.best]
    return all(compared(curve.points[a], curve.points[b]).difference.high >= 0 for a, b in pairwise(rising))


def _peak(curve: Curve) -> Bracket:
    """The size with the most throughput, and how far those reach that are not clearly worse, by Holm's adjustment over all sizes."""
    best, others = curve.best, [n for n in curve.sizes if n != curve.best]
    if best == curve.sizes[-1]:
        return Bracket(None, best, None)  # it still rises at the last size
    tests = [compared(curve.points[best], curve.points[n]) for n in others]
    worse = {n for n, p, test in zip(others, holm([t.p_value for t in tests]), tests) if p < 0.05 and test.difference.value < 0}
    below = [n for n in curve.sizes if n < best and (n in worse or side(curve, n) < 0)]  # the peak is not below the knee
    high = min((n for n in worse if n > best), default=None)
    return Bracket(best, below[-1] + 1 if below else curve.sizes[0], None if high is None else high - 1)


def _knee(curve: Curve) -> Bracket:
    """The smallest size with LEVEL of the peak."""
    best = curve.best
    if best == curve.sizes[-1]:
        return Bracket()  # the peak is not known
    if best == curve.sizes[0]:
        return Bracket(best, None, best)
    reached = [n for n in curve.sizes if n <= best and _share(curve, n) >= LEVEL]
    sure = min(n for n in curve.sizes if n <= best and side(curve, n) > 0)
    short = max((n for n in curve.sizes if n < sure and side(curve, n) < 0), default=None)
    return Bracket(min(reached), None if short is None else short + 1, sure)


def _collapse(curve: Curve) -> Bracket:
    """The smallest size above the peak that clearly falls below LEVEL of it."""
    best = curve.best
    sure = [n for n in curve.sizes if n > best and side(curve, n) < 0]
    if not sure:
        return Bracket()
    still = max(n for n in curve.sizes if n < sure[0] and (n == best or side(curve, n) > 0 or _share(curve, n) >= LEVEL))
    return Bracket(sure[0], still + 1, sure[0])


def _share(curve: Curve, n: int) -> float:
    peak = curve.points[curve.best].throughput.value
    return curve.points[n].throughput.value / peak if peak else 1.0


@dataclass(frozen=True)
class Served:
    """The smallest fleet that serves a demand, or the largest that succeeds."""

    curve: Curve
    smallest: Bracket
    target: float
    within_s: float = 0.0  # after they come, orders without due times are due


def demand(desk: Desk, saturated: Curve) -> Served:
    """The smallest fleet whose share of punctual orders reaches the target: a guess from the saturated curve, a bracket, bisection."""
    question, curve = desk.question, Curve(desk, DEMAND)
    target, (least, most), wanted = question.on_time, question.sizes, question.demand_per_h or 0.0
    short = [n for n in saturated.sizes if n <= saturated.best and saturated.points[n].throughput.high < target * wanted]
    least = min(max([least, *(n + 1 for n in short)]), most)  # who cannot do it with always work waiting does not do it at all
    within_s = PATIENCE * undisturbed_s(saturated.points[saturated.sizes[0]]) if saturated.points else 0.0

    def share(point: Point) -> Interval:
        return t_mean(point.punctual(within_s), ONE_SIDED)

    def judge(n: int) -> int | None:
        return _judge(curve, n, question.effort, "the smallest fleet for the demand", share, target)

    return Served(curve, _smallest(judge, share, curve, (least, most), max(least, _guess(saturated, question))), target, within_s)


def one_shot(desk: Desk) -> Served:
    """The largest fleet whose plans are found and driven in time, in at least the wanted share of draws."""
    question, curve = desk.question, Curve(desk, ONE_SHOT)
    target, least = question.on_time, question.sizes[0]

    def judge(n: int) -> int | None:
        return _judge(
            curve, n, question.effort, f"fleets from {n} robots on", lambda p: wilson(p.num_succeeded, len(p.records), ONE_SIDED), target
        )

    fails = None
    for n in grid(question):
        if (found := judge(n)) is None or found < 0:
            fails = n if found is not None else None
            break
    good = max((n for n in curve.sizes if n != fails and _succeeded(curve, n) >= target), default=None)
    while good is not None and fails is not None and fails > max(good + 1, good * question.effort.gap):
        middle = (good + fails) // 2
        found = judge(middle)
        if found is None:
            break
        good, fails = (good, middle) if found < 0 or _succeeded(curve, middle) < target else (middle, fails)
    if good is None:
        return Served(curve, Bracket(None, None, None if fails is None else max(0, fails - 1)), target)
    sure = max((n for n in curve.sizes if n <= good and _sure(curve, n, target)), default=least if good == least else None)
    return Served(curve, Bracket(good, sure, None if fails is None else fails - 1), target)


def _sure(curve: Curve, n: int, target: float) -> bool:
    point = curve.points[n]
    return wilson(point.num_succeeded, len(point.records), ONE_SIDED).low > target


def _succeeded(curve: Curve, n: int) -> float:
    return curve.points[n].num_succeeded / len(curve.points[n].records)


def _judge(curve: Curve, n: int, effort: Effort, reason: str, interval: Callable[[Point], Interval], target: float) -> int | None:
    """1: the target is reached, -1: it is not, 0: undecided with all the seeds allowed, None: it cannot be told, or the budget is spent."""
    for seeds in _growing(effort):
        if not curve.ask({n: max(seeds, curve.seeds(n))}, reason):
            return None if n not in curve.points else 0
        found = interval(curve.points[n])
        if isnan(found.value):
            return None  # no run is long enough to tell
        if found.low >= target or found.high < target:
            return 1 if found.value >= target else -1
    return 0


def _growing(effort: Effort) -> Iterator[int]:
    yield from range(effort.seeds, effort.most_seeds, STEP)
    yield effort.most_seeds


def _guess(saturated: Curve, question: Question) -> int:
    """Where a saturated fleet's throughput reaches the demand, straight between sizes."""
    (least, most), wanted = question.sizes, question.demand_per_h or 0.0
    if not saturated.points:
        return least
    before = (0, 0.0)
    for n in saturated.sizes:
        value = saturated.points[n].throughput.value
        if value >= wanted:
            share = (wanted - before[1]) / max(value - before[1], 1e-9)
            return min(max(round(before[0] + share * (n - before[0]) + 0.5), least), most)
        before = (n, value)
    return saturated.best


def _smallest(
    judge: Callable[[int], int | None], share: Callable[[Point], Interval], curve: Curve, sizes: tuple[int, int], guess: int
) -> Bracket:
    """Bracket and bisect a yes-or-no question that turns to yes once as fleets grow."""
    (least, most), effort, target = sizes, curve.desk.question.effort, curve.desk.question.on_time
    no, yes, at = least - 1, None, guess
    while (found := judge(at)) is not None:
        if found > 0 or (found == 0 and share(curve.points[at]).value >= target):
            yes = at
        else:
            no = at
        if yes is None:
            if no >= most:
                break
            at = min(most, max(no + 1, round(no * 1.3)))
        elif yes > max(no + 1, round(no * (1 + (effort.gap - 1) / 2))):
            at = max(no + 1, round(yes / 1.3)) if no == least - 1 else (no + yes) // 2
        else:
            break
    limits = {n: share(curve.points[n]) for n in curve.sizes}
    low = max((n for n, found in limits.items() if found.high < target and (yes is None or n < yes)), default=least - 1)
    sure = min((n for n, found in limits.items() if found.low >= target and n > low), default=None)
    return Bracket(yes, low + 1, sure)
