"""The answer of a capacity study: the sentences for people, and the JSON."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import isnan
from typing import Any

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.replications import PairedMeans
from mrp_sumo.experiments.statistics import holm
from mrp_sumo.sizing.confirmation import Confirmation, confirmations
from mrp_sumo.sizing.points import Point, compared
from mrp_sumo.sizing.question import SATURATED, Question, Trial, spendable
from mrp_sumo.sizing.reasons import Reasons, Share, reasons, undisturbed_s
from mrp_sumo.sizing.search import Bracket, Desk, Limits, Missing, Recorded, Served, coarse, demand, limits, one_shot
from mrp_sumo.sizing.what_if import AUTO, obvious

SPREADSHEET = 0.8  # utilisation of robots that planning sheets count with


@dataclass(frozen=True, eq=False)
class Gain:
    """What a change brings: throughput beside that of the scenario as it is, on the same orders."""

    change: str
    difference: PairedMeans  # orders an hour
    p_value: float  # adjusted for all that were tried (Holm)
    refusal: str = ""  # why no run with it could be driven

    @property
    def share(self) -> float | None:
        """Of the throughput as it is; None where no run could be driven."""
        if self.refusal:
            return None
        return self.difference.difference.value / self.difference.first if self.difference.first else 0.0


@dataclass(frozen=True, eq=False)
class Answer:
    """What a study has found. Everything in it follows from the question and finished runs."""

    question: Question
    trials: tuple[Trial, ...]  # that it stands on
    limits: Limits | None  # None of a one-shot scenario
    served: Served | None  # None where no demand is known
    reasons: tuple[Reasons, ...]  # of every size, ascending
    gains: tuple[Gain, ...]  # the best first
    confirmed: tuple[Confirmation, ...]  # sizes that were driven in SUMO, too
    left_out: tuple[str, ...]  # what the budget did not buy
    spent_s: float  # predicted, of the budget

    @property
    def points(self) -> list[Point]:
        """Fleets by size: saturated ones, or one-shot ones."""
        curve = self.limits.curve if self.limits else self.served.curve if self.served else None
        return [curve.points[n] for n in curve.sizes] if curve else []

    @property
    def at_peak(self) -> Reasons | None:
        """What binds at the peak, or at the last size where none was found."""
        if not (self.limits and self.reasons):
            return None
        best = self.limits.curve.best
        return next(found for found in self.reasons if found.robots == best)

    @property
    def spreadsheet(self) -> float | None:
        """Robots that a planning sheet would buy for the demand: orders by hand of one robot alone, at a utilisation of 80 %."""
        if not (self.limits and self.question.demand_per_h and self.limits.curve.points):
            return None
        cycle_s = undisturbed_s(self.limits.curve.points[self.limits.curve.sizes[0]])
        return self.question.demand_per_h / 3600 * cycle_s / SPREADSHEET

    @property
    def notes(self) -> tuple[str, ...]:
        """What the reader should know before the figures are believed."""
        found = [f"the budget did not buy {text}" for text in self.left_out]
        if self.limits and not self.limits.rises:
            found.append("throughput does not rise steadily up to its peak, so sizes between those of the grid were not tried")
        if self.limits and self.served and _too_short(self.served):
            found.append("runs are too short to tell whether orders are on time: most are due after the end; give a longer --horizon")
        short = [p.robots for p in self.points if self.limits and not p.is_steady]
        if short:
            found.append(f"runs are too short to tell the warm-up with {_listed(short)} robots; the first half is left out there")
        if failed := sum(point.num_failed for point in self.points):
            found.append(f"{failed} of {sum(len(p.records) for p in self.points)} runs broke, or robots overlapped in them")
        if self.limits and self.limits.first_deadlock is not None:
            point = self.limits.curve.points[self.limits.first_deadlock]
            found.append(
                f"robots blocked each other for good in {point.num_deadlocked} of {len(point.records)} runs with {point.robots} robots, "
                "and in none with fewer"
            )
        found += [
            f"SUMO does not confirm the {size.name} at {_robots(size.robots)}: {size.difference.second:.4g} instead of "
            f"{size.difference.first:.4g}"
            for size in self.confirmed
            if not size.agrees
        ]
        return tuple(found)

    @property
    def sentence(self) -> str:
        """The answer in words."""
        if self.limits is None:
            return _of_one_shot(self)
        parts = [_of_peak(self.limits, self.question.sizes)]
        if self.served and self.question.demand_per_h:
            parts.append(_of_demand(self.served, self.question))
        if (collapse := self.limits.collapse).estimate is not None:
            parts.append(f"From {_between(collapse)} robots on they are in each other's way: throughput falls by more than 5 %.")
        return " ".join(parts)

    @property
    def document(self) -> dict[str, Any]:
        """As JSON."""
        limit, served = self.limits, self.served
        peak, knee, collapse = (limit.peak, limit.knee, limit.collapse) if limit else (Bracket(), Bracket(), Bracket())
        demanded = {"demand_per_h": self.question.demand_per_h, "on_time": self.question.on_time} if limit and served else {}
        return {
            "answer": {
                "scenario": self.question.file.scenario.name,
                "sentence": self.sentence,
                "peak_robots": _bracket(peak),
                "knee_robots": _bracket(knee),
                "collapse_robots": _bracket(collapse),
                "smallest_for_demand": {**_bracket(served.smallest), **demanded} if limit and served else None,
                "largest_that_succeeds": _bracket(served.smallest) if served and not limit else None,
                "limit": _share(self.at_peak.limit) if self.at_peak else None,
                "curve": [_row(point, self.question) for point in self.points],
                "what_if": [_gain(gain) for gain in self.gains],
                "confirmed": [_confirmed(size) for size in self.confirmed],
                "notes": list(self.notes),
                "seeds": sorted({self.question.first_seed + trial.seed for trial in self.trials}),
                "command": self.question.command,
            }
        }


def answer_of(question: Question, recorded: Recorded) -> tuple[Answer | None, tuple[Trial, ...]]:
    """The answer, or None while runs are missing, and the trials that are wanted."""
    desk = Desk(question, recorded)
    try:
        found = _one_shot(desk) if not question.has_tasks else _lifelong(desk)
    except Missing:
        return None, tuple(desk.asked)
    return found, tuple(desk.asked)


def _one_shot(desk: Desk) -> Answer:
    served, spent_s = one_shot(desk), desk.spent_s
    confirmed = confirmations(desk, None, served) if desk.question.confirm else ()
    return Answer(desk.question, tuple(desk.asked), None, served, (), (), confirmed, tuple(desk.left_out), spent_s)


def _lifelong(desk: Desk) -> Answer:
    question = desk.question
    desk.share, before_changes = spendable(question)
    curve = coarse(desk)
    _require_driven(curve.points.values())
    desk.share = before_changes
    served = demand(desk, curve) if question.demand_per_h is not None else None
    limit = limits(curve)
    desk.share = 1.0
    why = tuple(reasons(limit.curve.points[n]) for n in limit.curve.sizes)
    gains = _gains(desk, limit, why) if question.what_if and limit.curve.points else ()
    spent_s = desk.spent_s  # of the budget; confirmation comes on top
    confirmed = confirmations(desk, limit, served) if question.confirm else ()
    return Answer(question, tuple(desk.asked), limit, served, why, gains, confirmed, tuple(desk.left_out), spent_s)


def _require_driven(points: Iterable[Point]) -> None:
    """Refuse to answer from nothing."""
    records = [record for point in points for record in point.records]
    if records and not any(record.get("observed") for record in records):
        raise MrpSumoError(f"none of {len(records)} runs could be driven: {records[0]['status']}: {records[0]['reason']}")


def _gains(desk: Desk, limit: Limits, why: Sequence[Reasons]) -> tuple[Gain, ...]:
    """Changes tried at the peak, on the seeds that it has."""
    question, best = desk.question, limit.curve.best
    at_peak = next(found for found in why if found.robots == best)
    changes = list(dict.fromkeys(c for text in question.what_if for c in (obvious(question, at_peak) if text == AUTO else (text,))))
    base = limit.curve.points[best]
    tried = {}
    for change in changes:
        trials = [Trial(SATURATED, best, seed, change) for seed in range(min(len(base.records), question.effort.seeds + 2))]
        if desk.affords(trials, f"what if '{change}'"):
            tried[change] = trials
    records = iter(desk.records([trial for trials in tried.values() for trial in trials]))
    points = {c: Point(best, question.effort.horizon_s, tuple(next(records) for _ in trials)) for c, trials in tried.items()}
    tests = {change: compared(base, point) for change, point in points.items()}
    adjusted = holm([test.p_value for test in tests.values()])
    found = [
        Gain(change, test, p, "" if test.difference.count else str(points[change].records[0]["reason"]))
        for (change, test), p in zip(tests.items(), adjusted)
    ]
    return tuple(sorted(found, key=lambda gain: (bool(gain.refusal), -gain.difference.difference.value if not gain.refusal else 0.0)))


def _row(point: Point, question: Question) -> dict[str, Any]:
    if not question.has_tasks:
        return {"robots": point.robots, "throughput_per_h": None, "low": None, "high": None, "replications": len(point.records)} | {
            "succeeded": point.num_succeeded
        }
    mean = point.throughput
    return {
        "robots": point.robots,
        "throughput_per_h": _number(mean.value),
        "low": _number(max(0.0, mean.low)),
        "high": _number(mean.high),
        "replications": len(point.records),
    }


def _bracket(found: Bracket) -> dict[str, int | None]:
    return {"estimate": found.estimate, "low": found.low, "high": found.high}


def _share(found: Share) -> dict[str, Any]:
    return {"kind": found.kind, "name": found.name, "utilisation": round(found.utilisation, 4)}


def _gain(gain: Gain) -> dict[str, Any]:
    mean = gain.difference.difference
    return {
        "change": gain.change,
        "gain_per_h": _number(mean.value),
        "low": _number(mean.low),
        "high": _number(mean.high),
        "gain": None if gain.share is None else round(gain.share, 4),
        "p_value": round(gain.p_value, 5),
        "replications": mean.count,
        "variance_reduction": _number(gain.difference.variance_reduction),
        "refusal": gain.refusal or None,
    }


def _confirmed(size: Confirmation) -> dict[str, Any]:
    mean = size.difference.difference
    return {
        "name": size.name,
        "robots": size.robots,
        "measure": size.measure,
        "kinematic": _number(size.difference.first),
        "sumo": _number(size.difference.second),
        "difference": _number(mean.value),
        "low": _number(mean.low),
        "high": _number(mean.high),
        "replications": mean.count,
        "agrees": size.agrees,
    }


def _number(value: float) -> float | None:
    return round(value, 3) if abs(value) < float("inf") else None


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers))


def _robots(count: int) -> str:
    return "1 robot" if count == 1 else f"{count} robots"


def _between(found: Bracket) -> str:
    """'34', or '32 to 36': an interval, where that is what is known."""
    if found.low is not None and found.high is not None and found.low < found.high:
        return f"{found.low} to {found.high}"
    return str(found.estimate)


def _of_peak(found: Limits, sizes: tuple[int, int]) -> str:
    peak, knee = found.peak, found.knee
    best = found.curve.points[found.curve.best].throughput
    if len(found.curve.sizes) == 1:
        return f"{_robots(found.curve.best)} do {best.value:.0f} orders an hour; other fleets were not tried."
    if peak.estimate is None:
        return f"More robots bring more up to {found.curve.best}, the most that were tried: {best.value:.0f} orders an hour there."
    within = f"between {peak.low} and {peak.high}" if peak.high is not None else f"at {peak.low} or more"
    text = f"Up to {peak.estimate} robots are worth having (the peak lies {within}): {best.value:.0f} orders an hour."
    if knee.estimate is not None and knee.estimate < peak.estimate:
        text += f" {knee.estimate} robots do 95 % of that" + (f" ({_between(knee)})." if _between(knee) != str(knee.estimate) else ".")
    return text


def _of_demand(served: Served, question: Question) -> str:
    found, wanted = served.smallest, f"A demand of {question.demand_per_h:.0f} orders an hour"
    if not served.curve.points:
        return f"Whether a{wanted[1:]} is met was not tried."
    if _too_short(served):
        return f"Whether a{wanted[1:]} is met cannot be told from runs this short."
    if found.estimate is None:
        return f"{wanted} is not met by any fleet that was tried on it, up to {_robots(served.curve.sizes[-1])}."
    sure = _between(found)
    return f"{wanted} is met from {found.estimate} robots on" + (f" ({sure})." if sure != str(found.estimate) else ".")


def _too_short(served: Served) -> bool:
    shares = [share for point in served.curve.points.values() for share in point.punctual(served.within_s).tolist()]
    return bool(shares) and all(map(isnan, shares))


def _of_one_shot(answer: Answer) -> str:
    served = answer.served
    if served is None or not served.curve.points:
        return "Nothing is known."
    found, target = served.smallest, f"in at least {100 * served.target:.0f} % of draws"
    if found.estimate is None:
        return f"Not even {_robots(served.curve.sizes[0])} have plans that are found and driven in time {target}."
    most = f", {found.high + 1} do not" if found.high is not None else ", the most that were tried"
    sure = f" (certain up to {found.low})" if found.low is not None and found.low < found.estimate else ""
    return f"Plans of up to {_robots(found.estimate)} are found and driven in time {target}{sure}{most}."
