"""The answer of a capacity study: the sentences for people, and the JSON."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from math import inf, isfinite, isnan
from typing import Any

from mrp_sumo.errors import MrpSumoError, count, duration
from mrp_sumo.experiments.statistics import PairedMeans, holm
from mrp_sumo.sizing.bands import Bands, bands
from mrp_sumo.sizing.confirmation import Confirmation, confirmations
from mrp_sumo.sizing.points import UNANSWERED, Point, compared
from mrp_sumo.sizing.question import SATURATED, Question, Trial, spendable
from mrp_sumo.sizing.reasons import Reasons, Share, mean_of, reasons, undisturbed_s
from mrp_sumo.sizing.search import Bracket, Curve, Desk, Limits, Missing, Recorded, Served, demand, demand_first, limits, one_shot, planned
from mrp_sumo.sizing.what_if import AUTO, obvious

PLAIN = {"door": "aisle", "area": "crossing"}  # kinds of places as `limit.kind` has them
SPREADSHEET = 0.8  # utilisation of robots that planning sheets count with


@dataclass(frozen=True, eq=False)
class Gain:
    """Gain of a change: throughput beside that of the scenario as it is, on the same orders."""

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
    """Answer of a study. Everything in it follows from the question and finished runs."""

    question: Question
    trials: tuple[Trial, ...]  # that it stands on
    limits: Limits | None  # None of a one-shot scenario
    served: Served | None  # None where no demand is known
    reasons: tuple[Reasons, ...]  # of every size, ascending
    gains: tuple[Gain, ...]  # the best first
    confirmed: tuple[Confirmation, ...]  # sizes that were driven in SUMO, too
    left_out: tuple[str, ...]  # for want of budget
    spent_s: float  # predicted, of the budget
    bands: Bands | None = None  # None: not asked for
    in_time: bool = True  # whether all runs that were wanted had ended when the clock reached the budget

    @property
    def points(self) -> list[Point]:
        """Fleets by size that count: saturated ones, or one-shot ones."""
        return [self._curve.points[n] for n in self._curve.sizes] if self._curve else []

    @property
    def unfit(self) -> list[Point]:
        """Fleets by size whose runs support no answer."""
        return [self._curve.unfit[n] for n in sorted(self._curve.unfit)] if self._curve else []

    @property
    def _curve(self) -> Curve | None:
        return self.limits.curve if self.limits else self.served.curve if self.served else None

    @property
    def planner(self) -> str:
        """Planner of the runs of the answer."""
        return (self._curve.planner if self._curve else "") or self.question.file.scenario.planner.name

    @property
    def limit(self) -> Share | None:
        """Limit that binds: what the next larger fleets do not count for, planner or chargers, else as at the peak.

        Where nothing binds at the peak, though larger fleets do no more: as in the smallest of these in which something does.
        """
        if not self.points:
            return reasons(self.unfit[0]).limit if self.unfit and _tells_a_limit(self.unfit[0]) else None
        if self.limits and self.limits.peak.estimate is None and (beyond := self._beyond):
            return reasons(beyond).limit
        if (
            self._kept_from_more
            and self.limits
            and self.limits.curve.best == self.question.most_robots
            and (cycle := self.question.charging)
        ):
            measured = (share for share in self.at_peak.places if share.kind == "charger") if self.at_peak else iter(())
            return next(measured, Share("charger", "charger", min(1.0, self.limits.curve.best * cycle.charging_share / cycle.places)))
        if self.at_peak is None:
            return None
        beyond_peak = (each.limit for each in self.reasons if each.robots >= self.at_peak.robots)
        return next((limit for limit in beyond_peak if limit.kind != "fleet"), self.at_peak.limit)

    @property
    def _kept_from_more(self) -> bool:
        """True if larger fleets were not tried since the places to charge keep no more robots going."""
        return self.question.most_robots < self.question.sizes[1]

    @property
    def _beyond(self) -> Point | None:
        """The smallest fleet above those that count for which the planner had no plans, or that ran empty."""
        last = self.points[-1].robots if self.points else 0
        return next((point for point in self.unfit if point.robots > last and _tells_a_limit(point)), None)

    @property
    def at_peak(self) -> Reasons | None:
        """Limit that binds at the peak, or at the last size if there is no peak."""
        if not (self.limits and self.reasons):
            return None
        best = self.limits.curve.best
        return next(reasons for reasons in self.reasons if reasons.robots == best)

    @property
    def spreadsheet(self) -> float | None:
        """Robots that a planning sheet would buy for the demand: orders by hand of one robot alone, at a utilisation of 80 %."""
        if not (self.limits and self.question.demand_per_h and self.limits.curve.points):
            return None
        cycle_s = undisturbed_s(self.limits.curve.points[self.limits.curve.sizes[0]])
        return self.question.demand_per_h / 3600 * cycle_s / SPREADSHEET

    @property
    def notes_of_curve(self) -> list[str]:
        """Those of sizes that do not count."""
        return [f"{count(point.robots, 'robot')}: not counted; {point.fault}" for point in self.unfit]

    @property
    def notes(self) -> tuple[str, ...]:
        """Caveats that a reader should know before believing the figures."""
        notes, own = [], self.question.file.scenario.planner.name
        if not self.in_time:
            over = f"{duration(self.question.effort.budget_s)} were over before all runs were made"
            more = "the same command with a larger --budget goes on from there"
            notes.append(f"{over}; the answer is from those that were; {more}")
        if self.planner != own and self.question.has_tasks:
            notes.append(f"planned with {self.planner}, since {own} left more than 1 % of its requests unanswered")
        notes += self.notes_of_curve
        if self.limits and self.served:
            at_demand = sorted(self.served.curve.unfit.items())
            notes += [f"{count(n, 'robot')} at the demand: not counted; {point.fault}" for n, point in at_demand]
        if self.left_out:
            notes.append(f"left out for want of budget: {'; '.join(self.left_out)}")
        if self.question.bounds is not None and self.bands is None:
            notes.append("no error bands: there is no size whose runs count, to move quantities at")
        if self.limits and not self.limits.rises:
            notes.append("throughput does not rise steadily up to its peak, so sizes between those of the grid were not tried")
        if self.limits and self.points and not self.limits.measured:
            notes.append("the limits are of the runs on which sizes were chosen, and may be too narrow: there were no new ones")
        if self.limits and self.served and _too_short(self.served):
            notes.append("runs are too short to tell whether orders are on time: most are due after the end; give a longer --horizon")
        short = ", ".join(str(p.robots) for p in self.points if self.limits and not p.is_steady)
        if short:
            notes.append(f"runs are too short to tell the warm-up with {short} robots; the first half is left out there")
        if self.limits and self.limits.first_deadlock is not None:
            point = self.limits.curve.points[self.limits.first_deadlock]
            notes.append(
                f"robots blocked each other for good in {point.num_deadlocked} of {len(point.records)} runs with {point.robots} robots, "
                "and in none with fewer"
            )
        if stalled := [f"{p.num_stalled} of {len(p.records)} runs with {count(p.robots, 'robot')}" for p in self.points if p.num_stalled]:
            notes.append(f"work came to a stand for good in {', '.join(stalled)}, which count with what they did until then")
        notes += self.of_batteries
        notes += [
            f"SUMO does not confirm the {size.name} at {count(size.robots, 'robot')}: {size.difference.second:.4g} instead of "
            f"{size.difference.first:.4g}"
            for size in self.confirmed
            if not size.agrees
        ]
        return tuple(notes)

    @property
    def of_batteries(self) -> list[str]:
        """Notes on batteries and chargers."""
        cycle = self.question.charging
        if not self.limits or cycle is None or not self.points:
            return []
        if not cycle.places:
            return [
                f"robots have nowhere to charge (tasks.charging) and run empty after about {duration(cycle.drive_s)}: the figures are of "
                "the time before, and no fleet keeps them up"
            ]
        point = self.limits.curve.points[self.limits.curve.best]
        charging = [run["batteries"] for run in point.observed if run["batteries"]]
        at_once = mean_of([of["charging"] for of in charging])
        lines = [f"{at_once:.1f} of {count(point.robots, 'robot')} charge at a time, at {count(cycle.places, 'place')}"]
        if cycle.charge_s > self.question.effort.horizon_s:
            lines.append(
                f"a charge takes {duration(cycle.charge_s)}, longer than a run of {duration(self.question.effort.horizon_s)}: robots start "
                f"at all points of a cycle of driving ({duration(cycle.drive_s)}) and charging, and none is followed through it"
            )
        return lines

    @property
    def sentence(self) -> str:
        """The answer in words."""
        if self.limits is None:
            return _of_one_shot(self)
        if not self.points:
            return _of_nothing(self)
        if not any(point.num_done for point in self.points):
            return f"No order was done in runs of {duration(self.question.effort.horizon_s)}: a longer --horizon may tell."
        parts = [_of_peak(self.limits)]
        if self._kept_from_more:
            parts.append(_of_places_to_charge(self.question))
        if beyond := self._beyond:
            parts.append(f"With {count(beyond.robots, 'robot')} {beyond.fault}.")
        if self.served:
            parts.append(_of_demand(self.served, self.question, self.points[-1].robots))
        if (collapse := self.limits.collapse).estimate is not None:
            parts.append(f"From {_between(collapse)} robots on they are in each other's way: throughput falls by more than 5 %.")
        return " ".join(parts)

    @property
    def document(self) -> dict[str, Any]:
        limit, served = self.limits, self.served
        peak, knee, collapse = (limit.peak, limit.knee, limit.collapse) if limit else (Bracket(), Bracket(), Bracket())
        demanded = {"demand_per_h": self.question.demand_per_h, "on_time": self.question.on_time} if limit and served else {}
        return {
            "answer": {
                "scenario": self.question.file.scenario.name,
                "sentence": self.sentence,
                "peak_robots": asdict(peak),
                "knee_robots": asdict(knee),
                "collapse_robots": asdict(collapse),
                "smallest_for_demand": {**asdict(served.smallest), **demanded} if limit and served else None,
                "largest_that_succeeds": asdict(served.smallest) if served and not limit else None,
                "limit": _share(self.limit) if self.limit else None,
                "planner": self.planner,
                "curve": [_row(p, self.question) for p in sorted([*self.points, *self.unfit], key=lambda point: point.robots)],
                "what_if": [_gain(gain) for gain in self.gains],
                "confirmed": [_confirmed(size) for size in self.confirmed],
                **({"error_bands": self.bands.document} if self.bands else {}),
                "notes": list(self.notes),
                "seeds": sorted({self.question.first_seed + trial.seed for trial in self.trials}),
                "command": self.question.command,
            }
        }


def answer_of(question: Question, recorded: Recorded, *, closed: bool = False) -> tuple[Answer | None, tuple[Trial, ...]]:
    """The answer, or None while runs are missing, and the trials that are wanted; of a study that is closed, from what there is."""
    desk = Desk(question, recorded, closed=closed)
    try:
        answer = _one_shot(desk) if not question.has_tasks else _lifelong(desk)
    except Missing:
        return None, tuple(desk.trials)
    return answer, tuple(desk.trials)


def _tells_a_limit(point: Point) -> bool:
    """True if a fleet does not count for a reason that is a limit of fleets."""
    return point.unanswered_share > UNANSWERED or point.num_empty > 0


def _one_shot(desk: Desk) -> Answer:
    served, spent_s = one_shot(desk), desk.spent_s
    confirmed = confirmations(desk, None, served) if desk.question.confirm else ()
    return Answer(desk.question, tuple(desk.trials), None, served, (), (), confirmed, tuple(desk.left_out), spent_s, None, not desk.closed)


def _lifelong(desk: Desk) -> Answer:
    question = desk.question
    desk.share, before_changes = spendable(question)
    demand_first(desk)
    curve = planned(desk)
    _require_driven([*curve.points.values(), *curve.unfit.values()])
    desk.share = before_changes
    served = demand(desk, curve) if question.demand_per_h is not None else None
    limit = limits(curve)
    served = served and served.beside(limit.curve)
    desk.share = 1.0
    why = tuple(reasons(limit.curve.points[n]) for n in limit.curve.sizes)
    gains = _gains(desk, limit, why) if question.what_if and limit.curve.points else ()
    spent_s = desk.spent_s  # of the budget; confirmation comes on top
    confirmed = confirmations(desk, limit, served) if question.confirm else ()
    moved = bands(desk, limit, served, why) if question.bounds is not None else None
    return Answer(question, tuple(desk.trials), limit, served, why, gains, confirmed, tuple(desk.left_out), spent_s, moved, not desk.closed)


def _require_driven(points: Iterable[Point]) -> None:
    """Refuse to answer from nothing."""
    records = [record for point in points for record in point.records]
    if records and not any(record.get("observed") for record in records):
        raise MrpSumoError(f"none of {len(records)} runs could be driven: {records[0]['status']}: {records[0]['reason']}")


def _gains(desk: Desk, limit: Limits, why: Sequence[Reasons]) -> tuple[Gain, ...]:
    """Changes tried at the peak, on the seeds that it has."""
    question, best = desk.question, limit.curve.best
    at_peak = next(reasons for reasons in why if reasons.robots == best)
    changes = list(dict.fromkeys(c for text in question.what_if for c in (obvious(question, at_peak) if text == AUTO else (text,))))
    base = limit.curve.points[best]
    tried = {}
    for change in changes:
        seeds = range(base.first_seed, base.first_seed + min(len(base.records), question.effort.seeds + 2))
        trials = [Trial(SATURATED, best, seed, change, limit.curve.planner) for seed in seeds]
        if desk.affords(trials, f"what if '{change}'"):
            tried[change] = trials
    points = desk.points(tried)
    tests = {change: compared(base, point) for change, point in points.items()}
    adjusted = holm([test.p_value for test in tests.values()])
    gains = [
        Gain(change, test, p, "" if test.difference.count else str(points[change].records[0]["reason"]))
        for (change, test), p in zip(tests.items(), adjusted)
    ]
    return tuple(sorted(gains, key=lambda gain: (bool(gain.refusal), -gain.difference.difference.value if not gain.refusal else 0.0)))


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
        "unanswered_share": round(point.unanswered_share, 4),
        "counts": not point.fault,
        "why_not": point.fault or None,
    }


def _share(share: Share) -> dict[str, Any]:
    return {"kind": PLAIN.get(share.kind, share.kind), "name": share.name, "utilisation": round(share.utilisation, 4)}


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
    return round(value, 3) if isfinite(value) else None


def _robots_do(num: int, limits: str = "") -> str:
    return f"{count(num, 'robot')}{limits} {'does' if num == 1 else 'do'}"


def _between(bracket: Bracket) -> str:
    """'34', or '32 to 36': an interval, where that is what is known."""
    if bracket.low is not None and bracket.high is not None and bracket.low < bracket.high:
        return f"{bracket.low} to {bracket.high}"
    return str(bracket.estimate)


def _of_peak(limits: Limits) -> str:
    curve, knee, peak = limits.curve, limits.knee, limits.peak
    best = curve.points[curve.best].throughput
    most = f"{best.value:.0f} orders an hour"
    if best.low > -inf:
        most += f" ({max(best.low, 0.0):.0f} to {best.high:.0f})"
    if len(curve.sizes) == 1:
        return f"{_robots_do(curve.best)} {most}; other fleets were not tried."
    if knee.estimate is None:
        tried = "were tried" if max(curve.unfit, default=0) < curve.best else "count"
        return f"More robots bring more up to {curve.best}, the most that {tried}: {most} there."
    sure = "" if (knee.low or 1) == knee.high else f" ({_span(knee)})"
    few = _robots_do(knee.estimate, sure)
    if knee.estimate == curve.best:
        text = f"{few} the most that was found, {most}."
    else:
        text = f"{few} 95 % of the most that was found, {most} with {curve.best}."
    if limits.collapse.estimate is None:
        last = curve.sizes[-1]
        text += f" More add little, and up to {last}, the most that were tried, nothing is lost." if last > knee.estimate else ""
    elif peak.high is not None and peak.high > knee.estimate:
        text += f" More than {peak.high} robots are not worth having."
    return text


def _span(bracket: Bracket) -> str:
    """'32 to 36', 'up to 36' or 'from 32 on'."""
    if bracket.low is None:
        return f"at most {bracket.high}"
    return f"{bracket.low} to {bracket.high}" if bracket.high is not None else f"{bracket.low} or more"


def _of_nothing(answer: Answer) -> str:
    """Without a size that counts there is no headline."""
    if not answer.unfit and answer.question.most_robots < answer.question.sizes[0]:
        return f"No answer: {_of_places_to_charge(answer.question).lower()}"
    if not answer.unfit:
        return "Nothing is known: the budget was over before a fleet was measured."
    first = answer.unfit[0]
    return f"No answer: with {count(first.robots, 'robot')} {first.fault}."


def _of_places_to_charge(question: Question) -> str:
    cycle = question.charging
    assert cycle is not None
    verb = "keeps" if cycle.places == 1 else "keep"
    return f"The {count(cycle.places, 'place')} to charge {verb} no more than {count(cycle.most_robots, 'robot')} going."


def _of_demand(served: Served, question: Question, most_robots: int) -> str:
    smallest, wanted = served.smallest, f"A demand of {question.demand_per_h:.0f} orders an hour"
    on_time = f"{wanted} with {100 * served.target:.0f} % of them on time"
    tried = max([*served.curve.points, *served.curve.unfit], default=0)
    if not tried:
        return f"Whether a{wanted[1:]} is met was not tried."
    if not served.curve.points:
        return f"Whether a{wanted[1:]} is met cannot be told: the runs on it do not count."
    if _too_short(served):
        return f"Whether a{wanted[1:]} is met cannot be told from runs this short."
    if served.doubt is not None and smallest.estimate is None:
        does = f"they do it in runs this short, but {served.doubt.throughput.value:.0f} when work is always waiting"
        return f"Whether a{wanted[1:]} is met by {count(served.doubt.robots, 'robot')} cannot be told: {does}."
    if (n := served.undecided) is not None:
        runs, share = count(served.curve.seeds(n), "run"), 100 * served.punctual(n).value
        others = "; larger fleets were not tried on it" if tried < most_robots else ""
        return f"Whether a{on_time[1:]} is met by {count(n, 'robot')} cannot be told: {share:.0f} % were on time in {runs}{others}."
    if smallest.estimate is None and tried < most_robots:
        return f"{on_time} is not met by {count(tried, 'robot')}; larger fleets were not tried on it."
    if smallest.estimate is None:
        return f"{on_time} is not met by any fleet that was tried on it, up to {count(tried, 'robot')}."
    sure = _between(smallest) if smallest.high is not None else "or more" if smallest.low == smallest.estimate else _span(smallest)
    return f"{wanted} is met from {count(smallest.estimate, 'robot')} on" + (f" ({sure})." if sure != str(smallest.estimate) else ".")


def _too_short(served: Served) -> bool:
    shares = [share for point in served.curve.points.values() for share in point.punctual(served.within_s).tolist()]
    return bool(shares) and all(map(isnan, shares))


def _of_one_shot(answer: Answer) -> str:
    served = answer.served
    if served is None or not served.curve.points:
        return "Nothing is known."
    largest, target = served.smallest, f"in at least {100 * served.target:.0f} % of draws"
    if largest.estimate is None:
        return f"Not even {count(served.curve.sizes[0], 'robot')} have plans that are found and driven in time {target}."
    most = f", {largest.high + 1} do not" if largest.high is not None else ", the most that were tried"
    sure = f" (certain up to {largest.low})" if largest.low is not None and largest.low < largest.estimate else ""
    return f"Plans of up to {count(largest.estimate, 'robot')} are found and driven in time {target}{sure}{most}."
