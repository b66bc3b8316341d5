"""The search: which runs to make next, and what those that are made say.

A search is a plain function that asks for trials and is handed their records; where one is not made yet, `Missing` carries what is
wanted to the batch, and the search is run again from the beginning when there is more. So an answer depends on finished runs alone, not
on who made them, in which order, or how often the study was killed. Three questions: `limits` (knee, peak and collapse of throughput),
`demand` (the smallest fleet that serves it), `one_shot` (the largest whose plans are found and driven in time).

The throughput of a saturated fleet is taken to rise up to its peak. That is checked; where it is not so, nothing is parted further and
the coarse grid is the answer.

`limits` has two stages. The best of many sizes is partly the luckiest, and knee and collapse hang on it; so sizes are *chosen* on some
seeds, and those chosen are then *measured* on as many new ones, from which alone the intervals come. An interval ends at a size only where
the new runs confirm it; where they do not, the next size outwards is tried.
"""

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice, pairwise
from math import isnan, sqrt
from typing import TypeVar

from mrp_sumo.experiments.statistics import Interval, t_mean, wilson
from mrp_sumo.io.documents import Place
from mrp_sumo.sizing.points import UNANSWERED, Point, Record, compared
from mrp_sumo.sizing.question import DEMAND, ONE_SHOT, SATURATED, Effort, Question, Trial, predicted_s
from mrp_sumo.sizing.reasons import undisturbed_s

FALLBACK = ("auto",)  # planners that are tried where the one of the scenario has no plans
LEVEL = 0.95  # of the peak: the knee reaches it, the collapse falls below it
NEW_SEEDS = 1000  # the first of those on which chosen sizes are measured
ONE_SIDED = 0.90  # two-sided limits whose each side is a one-sided 95 % limit
PATIENCE = 3.0  # times what an order takes undisturbed, in which one without a due time is to be done
LEAST_SEEDS = 2  # of a size that counts
STEP = 2  # seeds that are added at a time

K = TypeVar("K", bound=Hashable)
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
    """Requests for trials and the budget that pays them, in predicted seconds, so that it buys the same on every machine."""

    question: Question
    recorded: Recorded
    trials: dict[Trial, None] = field(default_factory=dict)  # in order
    spent_s: float = 0.0
    left_out: list[str] = field(default_factory=list)  # for want of budget
    share: float = 1.0  # of the budget that may be spent by now: the rest is for what comes after
    closed: bool = False  # no more runs can be made: the clock has reached the budget

    def affords(self, trials: Sequence[Trial], reason: str) -> bool:
        """True if the budget pays for these trials; those that it does not are noted."""
        cost = predicted_s((trial for trial in trials if trial not in self.trials), self.question)
        made = not self.closed or all(self.recorded(trial) is not None for trial in trials)
        if made and self.spent_s + cost <= self.share * self.question.effort.budget_s:
            return True
        self.leave_out(reason)
        return False

    def leave_out(self, reason: str) -> None:
        """Note what the budget is too small for."""
        if reason not in self.left_out:
            self.left_out.append(reason)

    def records(self, trials: Sequence[Trial]) -> list[Record]:
        """The records of trials, which are paid for. Raises Missing."""
        for trial in trials:
            if trial not in self.trials:
                self.trials[trial] = None
                self.spent_s += predicted_s([trial], self.question)
        records = [self.recorded(trial) for trial in trials]
        if missing := [trial for trial, record in zip(trials, records) if record is None]:
            raise Missing(missing)
        return [record for record in records if record is not None]

    def points(self, wanted: Mapping[K, Sequence[Trial]]) -> dict[K, Point]:
        """Fleets by the trials of each, which are of one size and paid for. Raises Missing."""
        records = iter(self.records([trial for trials in wanted.values() for trial in trials]))
        horizon_s = self.question.effort.horizon_s
        return {key: Point(of[0].robots, horizon_s, tuple(islice(records, len(of))), of[0].seed) for key, of in wanted.items()}


@dataclass
class Curve:
    """Points by number of robots, all of one kind and with one planner, which grow."""

    desk: Desk
    kind: str
    points: dict[int, Point] = field(default_factory=dict)  # that count
    unfit: dict[int, Point] = field(default_factory=dict)  # whose runs support no answer
    planner: str = ""  # '': the scenario's
    first_seed: int = 0
    chosen: int | None = None  # the best, once that is settled
    moves: tuple[tuple[Place, float], ...] = ()  # of quantities within their intervals

    def ask(self, wanted: dict[int, int], reason: str) -> bool:
        """Have so many seeds at sizes. All are asked for at once; False where the budget buys nothing that is not there yet."""
        if self.desk.closed:
            wanted = {n: self._made(n, seeds) for n, seeds in wanted.items()}
            if all(seeds <= self.seeds(n) for n, seeds in wanted.items()):
                self.desk.leave_out(reason)
                return False
        trials = {n: [self._trial(n, k) for k in range(seeds)] for n, seeds in wanted.items()}
        if not self.desk.affords([trial for of_size in trials.values() for trial in of_size], reason):
            return False
        for n, point in self.desk.points(trials).items():
            for sizes in (self.points, self.unfit):
                sizes.pop(n, None)
            (self.unfit if self.kind != ONE_SHOT and point.fault else self.points)[n] = point
        return True

    def _trial(self, n: int, k: int) -> Trial:
        return Trial(self.kind, n, self.first_seed + k, planner=self.planner, moves=self.moves)

    def _made(self, n: int, seeds: int) -> int:
        """How many of the first seeds of a size there are; at least the two that a mean with limits takes."""
        made = next((k for k in range(seeds) if self.desk.recorded(self._trial(n, k)) is None), seeds)
        return made if made >= LEAST_SEEDS else seeds

    @property
    def sizes(self) -> list[int]:
        """Ascending."""
        return sorted(self.points)

    @property
    def best(self) -> int:
        """The size with the most throughput; the smaller of equals."""
        if self.chosen is not None:
            return self.chosen
        return max(self.sizes, key=lambda n: (self.points[n].throughput.value, -n))

    def seeds(self, n: int) -> int:
        """Number of seeds of a size."""
        return len(self.points[n].records) if n in self.points else 0


@dataclass(frozen=True)
class Limits:
    """Throughput of saturated fleets by size, with peak, knee and collapse."""

    curve: Curve
    peak: Bracket
    knee: Bracket
    collapse: Bracket
    rises: bool  # whether throughput rises up to the peak, as was taken for granted
    first_deadlock: int | None  # the smallest size of which a run had one
    measured: bool = True  # whether intervals come from runs on which nothing was chosen


def grid(question: Question) -> list[int]:
    """Sizes of the coarse grid, geometric from the least to the most that can be kept going; none where no fleet can."""
    low, high, growth = question.sizes[0], question.most_robots, question.effort.growth
    if high < low:
        return []
    sizes, at = [low], float(low)
    while sizes[-1] < high:
        at = max(at * growth, sizes[-1] + 1)
        sizes.append(min(high, round(at)))
    return sizes


def coarse(desk: Desk, planner: str = "") -> Curve:
    """Saturated fleets of the coarse grid, until throughput has fallen, the planner has no plans, or two in a row do not count."""
    curve = Curve(desk, SATURATED, planner=planner)
    sizes = grid(desk.question)
    for k, n in enumerate(sizes):
        if not curve.ask({n: desk.question.effort.seeds}, f"fleets of {n} and more") or _fell(curve):
            break
        if _without_plans(curve) or all(size in curve.unfit for size in sizes[max(k - 1, 0) : k + 1]):
            break
    return curve


def _without_plans(curve: Curve) -> bool:
    """True if the planner had no plans for a size."""
    return any(point.unanswered_share > UNANSWERED for point in curve.unfit.values())


def planned(desk: Desk) -> Curve:
    """The coarse grid with the scenario's planner, or with the next one where that has no plans; the one that goes furthest counts."""
    curves: list[Curve] = []
    for planner in ("", *(name for name in FALLBACK if name != desk.question.file.scenario.planner.name)):
        curves.append(coarse(desk, planner))
        if not _without_plans(curves[-1]):
            break
    return max(curves, key=lambda curve: max(curve.points, default=0))


def limits(curve: Curve) -> Limits:
    """Knee, peak and collapse of fleets that are there, with more sizes and seeds where something is undecided.

    A size whose new runs do not count does not count, and the rest is searched again.
    """
    while curve.points:
        while (wanted := _next(curve, curve.desk.question.effort)) and curve.ask(wanted, "closer limits"):
            pass
        measured = _Measured(curve)
        answer = measured.limits()
        if not measured.again.unfit:
            return answer
        curve.unfit |= measured.again.unfit
        for n in measured.again.unfit:
            del curve.points[n]
    return Limits(curve, Bracket(), Bracket(), Bracket(), True, None)


def side(curve: Curve, n: int) -> int:
    """1: a size has at least LEVEL of the best one's throughput, -1: it has less, 0: undecided."""
    best = curve.best
    if n == best:
        return 1
    difference = compared(curve.points[best], curve.points[n], LEVEL, ONE_SIDED).difference
    return 1 if difference.low > 0 else -1 if difference.high < 0 else 0


def _fell(curve: Curve) -> bool:
    """True if the last two sizes are clearly beyond the collapse: one alone may be a dip."""
    last = curve.sizes[-2:]
    if len(last) < 2:
        return False
    peak = curve.points[curve.best].throughput.value
    return all(n > curve.best and side(curve, n) < 0 and curve.points[n].throughput.value < 0.9 * peak for n in last)


def _next(curve: Curve, effort: Effort) -> dict[int, int]:
    """Sizes that should have more seeds, and how many; {}: the answer is known."""
    sizes, best = curve.sizes, curve.best
    gaps = [(a, b) for a, b in pairwise(sizes) if b > a + 1 and b > effort.gap * a and _middle(a, b) not in curve.unfit]
    at = sizes.index(best)
    brackets = {pair for pair in pairwise(sizes) if best in pair}  # the peak
    below = [n for n in sizes[:at] if curve.points[n].throughput.value < LEVEL * curve.points[best].throughput.value]
    above = [n for n in sizes[at + 1 :] if curve.points[n].throughput.value < LEVEL * curve.points[best].throughput.value]
    if below:
        knee = below[-1], sizes[sizes.index(below[-1]) + 1]
        brackets.add(knee)
    beyond = min((n for n in curve.unfit if n > best == sizes[-1]), default=0)
    if beyond > max(best + 1, effort.gap * best):
        return {_middle(best, beyond): effort.seeds}  # where runs begin not to count
    if best == sizes[-1]:  # no peak is known, only where little is added on the way there
        gaps = [pair for pair in gaps if below and pair == knee]
    if above:
        brackets.add((sizes[sizes.index(above[0]) - 1], above[0]))  # the collapse
    if _rises(curve) and (parted := [pair for pair in gaps if pair in brackets]):
        widest = max(parted, key=lambda pair: pair[1] / pair[0])
        return {_middle(*widest): effort.seeds}
    ends = sorted({n for pair in brackets for n in pair})
    vague = [n for n in ends if curve.seeds(n) < effort.most_seeds and _is_vague(curve, n, effort)]
    return {n: min(effort.most_seeds, curve.seeds(n) + STEP) for n in vague}


def _middle(a: int, b: int) -> int:
    return round(sqrt(a * b))


def _is_vague(curve: Curve, n: int, effort: Effort) -> bool:
    mean = curve.points[n].throughput
    return (mean.high - mean.low) / 2 > effort.precision * mean.value or (n != curve.best and side(curve, n) == 0)


def _rises(curve: Curve) -> bool:
    """True if no size below the peak has clearly less throughput than a smaller one."""
    rising = [n for n in curve.sizes if n <= curve.best]
    return all(compared(curve.points[a], curve.points[b]).difference.high >= 0 for a, b in pairwise(rising))


class _Measured:
    """Sizes that were chosen, on new seeds."""

    def __init__(self, curve: Curve) -> None:
        best = curve.best
        self.curve = replace(curve, chosen=best)  # as chosen on
        self.again = replace(curve, points={}, unfit={}, first_seed=NEW_SEEDS, chosen=best)
        self.num_seeds = max(curve.desk.question.effort.seeds, curve.seeds(best))

    def limits(self) -> Limits:
        """Peak, knee and collapse, with intervals that new runs confirm."""
        curve, best = self.curve, self.curve.best
        below, above = [n for n in curve.sizes if n < best], [n for n in curve.sizes if n > best]
        worse = {n for n in curve.sizes if _is_worse(curve, n)}
        judged = {n: side(curve, n) for n in curve.sizes}
        short = [n for n in reversed(below) if judged[n] < 0]  # where the knee may begin, the nearest first
        sure = [n for n in below if judged[n] > 0]  # where it may end
        fallen = [n for n in above if judged[n] < 0]
        under, over = [n for n in reversed(below) if n in worse], [n for n in above if n in worse]
        self._have({best, *(sizes[0] for sizes in (short, sure, fallen, under, over) if sizes)})
        high = self._first(over, _is_worse)
        low = self._first(under, _is_worse)
        least = curve.desk.question.sizes[0]  # asked about; smaller ones than those that were tried may do more
        peak = Bracket(best if above else None, least if low is None else low + 1, None if high is None else high - 1)
        collapse = Bracket()
        if (fell := self._first(fallen, _is_short)) is not None:
            holds = self._first([n for n in reversed(above) if n < fell and judged[n] > 0], _reaches)
            collapse = Bracket(fell, (best if holds is None else holds) + 1, fell)
        short_of, enough = self._first(short, _is_short), self._first(sure, _reaches)
        whole = replace(curve, points={**curve.points, **self.again.points})
        knee = Bracket()
        if above or enough is not None:  # else it still rises
            least, most = curve.sizes[0] if short_of is None else short_of + 1, best if enough is None else enough
            likely = min(n for n in whole.sizes if n <= best and (n == best or _share(whole, n) >= LEVEL))
            knee = Bracket(min(max(likely, least), most), None if short_of is None else least, most)
        deadlocked = [n for n in whole.sizes if whole.points[n].num_deadlocked]
        return Limits(whole, peak, knee, collapse, _rises(curve), min(deadlocked, default=None), best in self.again.points)

    def _have(self, sizes: Iterable[int]) -> bool:
        wanted = {n: self.num_seeds for n in sorted(sizes) if n not in self.again.points and n not in self.again.unfit}
        return not wanted or self.again.ask(wanted, "new runs of the sizes that were chosen, from which limits come")

    def _first(self, sizes: Sequence[int], holds: Callable[[Curve, int], bool]) -> int | None:
        """The first size of which new runs confirm what it was chosen for; of old ones where the budget does not buy new ones."""
        for n in sizes:
            new = self._have({n, self.curve.best}) and self.curve.best in self.again.points
            if (not new or n in self.again.points) and holds(self.again if new else self.curve, n):
                return n
        return None


def _is_short(curve: Curve, n: int) -> bool:
    return side(curve, n) < 0


def _reaches(curve: Curve, n: int) -> bool:
    return side(curve, n) > 0


def _is_worse(curve: Curve, n: int) -> bool:
    """True if a size has clearly less throughput than the best."""
    return n != curve.best and compared(curve.points[curve.best], curve.points[n], 1.0, ONE_SIDED).difference.high < 0


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
    doubt: Point | None = None  # of the smallest fleet that serves it in these runs, where it does less if work is always waiting

    def punctual(self, n: int) -> Interval:
        """Share of orders that a fleet that was tried has done on time."""
        return t_mean(self.curve.points[n].punctual(self.within_s), ONE_SIDED)

    @property
    def undecided(self) -> int | None:
        """The largest fleet of those that may meet the demand, by the limits of the share that they have done on time, where none does."""
        if self.smallest.estimate is not None:
            return None
        return max((n for n in self.curve.points if self.punctual(n).high >= self.target), default=None)

    def beside(self, saturated: Curve) -> "Served":
        """The same beside the throughput of saturated fleets: one that does less than the demand may have served it from full batteries."""
        question, point = self.curve.desk.question, saturated.points.get(self.smallest.estimate or 0)
        wanted = self.target * (question.demand_per_h or 0.0)
        if point is None or point.throughput.value >= wanted:
            return self
        keeps_up = next((n for n in saturated.sizes if n > point.robots and saturated.points[n].throughput.value >= wanted), None)
        return replace(self, smallest=Bracket(keeps_up, self.smallest.low, keeps_up), doubt=point)


def demand(desk: Desk, saturated: Curve) -> Served:
    """The smallest fleet whose share of punctual orders reaches the target: a guess from the saturated curve, a bracket, bisection."""
    question, curve = desk.question, Curve(desk, DEMAND, planner=saturated.planner)
    if not saturated.points:
        return Served(curve, Bracket(), question.on_time)
    target, least, most, wanted = question.on_time, question.sizes[0], question.most_robots, question.demand_per_h or 0.0
    short = [n for n in saturated.sizes if n <= saturated.best and saturated.points[n].throughput.high < target * wanted]
    least = min(max([least, *(n + 1 for n in short)]), most)  # who cannot do it with always work waiting does not do it at all
    within_s = PATIENCE * undisturbed_s(saturated.points[saturated.sizes[0]])
    return serving(curve, (least, most), max(least, _guess(saturated, question)), within_s)


def serving(curve: Curve, sizes: tuple[int, int], guess: int, within_s: float) -> Served:
    """The smallest fleet from the least to the most whose share of punctual orders reaches the target; it is near a guess."""
    question = curve.desk.question

    def share(point: Point) -> Interval:
        return t_mean(point.punctual(within_s), ONE_SIDED)

    def judge(n: int) -> int | None:
        return _judge(curve, n, question.effort, "the smallest fleet for the demand", share, question.on_time)

    return Served(curve, _smallest(judge, share, curve, sizes, guess), question.on_time, within_s)


def demand_first(desk: Desk) -> None:
    """Have the runs for a demand before those of larger fleets, where the smallest fleet has the throughput: a study that is over early
    has that answer at least. They are those that `demand` wants in the end, so what they cost is added to the share of the coarse grid.
    """
    curve, wanted = Curve(desk, SATURATED), desk.question.demand_per_h
    smallest = grid(desk.question)[:1]
    if wanted is None or not smallest or not curve.ask({smallest[0]: desk.question.effort.seeds}, f"fleets of {smallest[0]} and more"):
        return
    before_s = desk.spent_s
    if curve.points and curve.points[smallest[0]].throughput.value >= wanted:
        demand(desk, curve)
    desk.share = min(1.0, desk.share + (desk.spent_s - before_s) / desk.question.effort.budget_s)


def one_shot(desk: Desk) -> Served:
    """The largest fleet whose plans are found and driven in time, in at least the wanted share of draws."""
    question, curve = desk.question, Curve(desk, ONE_SHOT)
    target, least = question.on_time, question.sizes[0]

    def rate(point: Point) -> Interval:
        return wilson(point.num_succeeded, len(point.records), ONE_SIDED)

    def judge(n: int) -> int | None:
        return _judge(curve, n, question.effort, f"fleets of {n} and more", rate, target)

    fails = None
    for n in grid(question):
        if (verdict := judge(n)) is None or verdict < 0:
            fails = n if verdict is not None else None
            break
    good = max((n for n in curve.sizes if n != fails and rate(curve.points[n]).value >= target), default=None)
    while good is not None and fails is not None and fails > max(good + 1, good * question.effort.gap):
        middle = (good + fails) // 2
        verdict = judge(middle)
        if verdict is None:
            break
        good, fails = (good, middle) if verdict < 0 or rate(curve.points[middle]).value < target else (middle, fails)
    if good is None:
        return Served(curve, Bracket(None, None, None if fails is None else max(0, fails - 1)), target)
    sure = max((n for n in curve.sizes if n <= good and rate(curve.points[n]).low > target), default=least if good == least else None)
    return Served(curve, Bracket(good, sure, None if fails is None else fails - 1), target)


def _judge(curve: Curve, n: int, effort: Effort, reason: str, interval: Callable[[Point], Interval], target: float) -> int | None:
    """1: the target is reached, -1: it is not, or the runs do not count; 0: undecided with all the seeds allowed; None: it cannot be told,
    or the budget is spent.
    """
    for seeds in (*range(effort.seeds, effort.most_seeds, STEP), effort.most_seeds):
        if not curve.ask({n: max(seeds, curve.seeds(n))}, reason):
            return None if n not in curve.points else 0
        if n not in curve.points:
            return -1
        mean = interval(curve.points[n])
        if isnan(mean.value):
            return None  # no run is long enough to tell
        if mean.low >= target or mean.high < target:
            return 1 if mean.value >= target else -1
    return 0


def _guess(saturated: Curve, question: Question) -> int:
    """Where a saturated fleet's throughput reaches the demand, straight between sizes."""
    least, most, wanted = question.sizes[0], question.most_robots, question.demand_per_h or 0.0
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
    while (verdict := judge(at)) is not None:
        if verdict > 0 or (verdict == 0 and share(curve.points[at]).value >= target):
            yes = at
        else:
            no = at
        if yes is None:
            if no >= most:
                break
            at = min(most, max(no + 1, round(no * 1.3)))
        elif yes > max(no + 1, round(no * (1 + (effort.gap - 1) / 2))):
            at = max(no + 1, min(yes - 1, round(yes / 1.3))) if no == least - 1 else (no + yes) // 2
        else:
            break
    limits = {n: share(curve.points[n]) for n in curve.sizes}
    low = max((n for n, mean in limits.items() if mean.high < target and (yes is None or n < yes)), default=least - 1)
    sure = min((n for n, mean in limits.items() if mean.low >= target and n > low), default=None)
    return Bracket(yes, low + 1, sure)
