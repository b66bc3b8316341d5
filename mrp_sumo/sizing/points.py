"""A fleet size and its runs: throughput after the warm-up, served and punctual orders, each with limits."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.experiments.statistics import Interval, PairedMeans, paired_t, t_mean
from mrp_sumo.metrics.warm_up import warm_up_length

BINS = 60  # of a run, for the warm-up
MINUTE_S, HOUR_S = 60.0, 3600.0
TELLING = 0.25  # share of the orders of a run that must be due within it, so that it says whether they are on time
SETTLE = 0.2  # of the horizon, in which floors that are empty at first fill up, before orders are asked whether they are on time
LEAST_S = 60.0  # that is measured of a run, or it says nothing
UNANSWERED = 0.01  # share of requests, above which a run tells of the planner and not of the floor
DRIVEN = ("completed", "time_limit", "deadlock", "stalled")  # runs that ended as floor and fleet would have it
TIMES = ("released_s", "assigned_s", "done_s", "due_s")  # of orders, in observations
NOTHING = {"causes": [], "idle_share": 0.0, "batteries": None, "requests": [0, 0], "operations": []}  # of a run in which none of it was
Record = Mapping[str, Any]  # of a batch


def record_of(record: Record) -> Record:
    """A record as points take it: times of orders as arrays, inf for what never was."""
    if not record.get("observed"):
        return record
    observed = {**NOTHING, **record["observed"]}
    times = {name: np.array([np.inf if t is None else t for t in observed[name]], np.float64) for name in TIMES}
    return {**record, "observed": {**observed, **times}}


@dataclass(frozen=True, eq=False)
class Point:
    """A fleet of one size: one record a seed, in the order of the seeds."""

    robots: int
    horizon_s: float
    records: tuple[Record, ...]
    first_seed: int = 0

    @property
    def observed(self) -> list[Mapping[str, Any]]:
        """Observations of the runs that were driven."""
        return [record["observed"] for record in self.records if record.get("observed")]

    @property
    def num_done(self) -> int:
        """Orders done in all runs, the warm-up included."""
        return sum(int(np.isfinite(run["done_s"]).sum()) for run in self.observed)

    @property
    def requests(self) -> tuple[int, int]:
        """Asked of the planner while robots drove, and not answered, in all runs."""
        counts = [run["requests"] for run in self.observed]
        return sum(num for num, _ in counts), sum(unanswered for _, unanswered in counts)

    @property
    def unanswered_share(self) -> float:
        """Of what the planner was asked."""
        num_requests, unanswered = self.requests
        return unanswered / num_requests if num_requests else 0.0

    @property
    def fault(self) -> str:
        """Why the size supports no answer, '' where it does: all its runs were driven, passed the audits, and were planned."""
        num_requests, unanswered = self.requests
        if self.unanswered_share > UNANSWERED or any(record["status"] == "planner_stalled" for record in self.records):
            return f"the planner found no plan in {unanswered} of {num_requests} requests: not a property of your floor"
        if operations := [text for run in self.observed for text in run["operations"]]:
            return f"the operations audit failed: {operations[0]}"
        if self.num_empty:
            return f"batteries ran empty in {self.num_empty} of {len(self.records)} runs: places to charge are too few or too far"
        broken = [record for record in self.records if record["status"] not in DRIVEN]
        if broken:
            status, reason = broken[0]["status"].replace("_", " "), broken[0]["reason"]
            return f"{len(broken)} of {len(self.records)} runs do not count: {status}: {reason}"
        if self.observed and np.isnan(self.throughput.value):
            until = f"{self.until_s / MINUTE_S:.3g} min"
            if self.until_s < self.horizon_s:
                return f"robots ran empty after {until}, before a steady state was reached"
            return f"{until} are too short: {LEAST_S:.0f} s are measured once a warm-up is over, see --horizon"
        return ""

    @property
    def num_empty(self) -> int:
        """Runs in which a robot ran empty, although there are places to charge."""
        return sum(bool(of["empty"] and of["places"]) for run in self.observed if (of := run["batteries"]))

    @cached_property
    def until_s(self) -> float:
        """Time at which the first of robots that cannot charge ran empty, in any run, else the end."""
        deaths_s = [of["empty_s"] for run in self.observed if (of := run["batteries"]) and of["empty_s"] is not None and not of["places"]]
        return float(min([self.horizon_s, *deaths_s]))

    @cached_property
    def series(self) -> FloatArray:
        """[BINS] orders done in each part of the time that counts, the mean over runs (Welch's picture)."""
        edges = np.linspace(0, self.until_s, BINS + 1)
        counts = [np.histogram(run["done_s"][np.isfinite(run["done_s"])], edges)[0] for run in self.observed]
        return np.mean(counts, 0) if counts else np.zeros(BINS)

    @cached_property
    def is_steady(self) -> bool:
        """True if the runs are long enough to tell the warm-up."""
        return warm_up_length(self.series) is not None

    @cached_property
    def warm_up_s(self) -> float:
        """Warm-up, left out of every run: MSER-5 on `series`, and half of it where that cannot be told.

        At least until there have been as many orders done as robots: each begins with a whole order before it, while in a steady state
        they are at all points of one. With few orders a run, MSER-5 does not see that.
        """
        length = warm_up_length(self.series)
        if length is None:
            return self.until_s / 2
        return max(self.until_s * length / BINS, min(self.first_round_s, self.until_s / 2))

    @property
    def first_round_s(self) -> float:
        """Time by which as many orders are done as there are robots, the mean over runs; inf where one does fewer."""
        done_s = [np.sort(run["done_s"]) for run in self.observed]
        rounds_s = [of_run[self.robots - 1] if len(of_run) >= self.robots else np.inf for of_run in done_s]
        return float(np.mean(rounds_s)) if rounds_s else np.inf

    @cached_property
    def per_h(self) -> FloatArray:
        """[R] orders done an hour after the warm-up, run by run; NaN for a run that broke."""
        span_s = self.until_s - self.warm_up_s
        if span_s < LEAST_S:
            return np.full(len(self.records), np.nan)
        return self._by_run(lambda t: ((t["done_s"] > self.warm_up_s) & (t["done_s"] <= self.until_s)).sum() / span_s * HOUR_S)

    @property
    def step_per_h(self) -> float:
        """One order more or less, in orders an hour."""
        return HOUR_S / max(self.until_s - self.warm_up_s, LEAST_S)

    @property
    def throughput(self) -> Interval:
        """Orders an hour."""
        return t_mean(self.per_h, resolution=self.step_per_h)

    def punctual(self, within_s: float) -> FloatArray:
        """[R] share of orders that are done when they are due, of those that are due within the run; the first are left out.

        Orders without a due time are due `within_s` after they come. NaN for a run that broke, or is too short for most to be due.
        """

        def share(t: Mapping[str, FloatArray]) -> float:
            due_s = np.where(np.isfinite(t["due_s"]), t["due_s"], t["released_s"] + within_s)
            settled = (t["released_s"] >= SETTLE * self.horizon_s) & (t["released_s"] <= self.horizon_s)
            due = settled & (due_s <= self.horizon_s)
            enough = due.any() and due.sum() >= TELLING * settled.sum()
            return float((t["done_s"][due] <= due_s[due]).mean()) if enough else np.nan

        return self._by_run(share)

    def _by_run(self, measure: Callable[[Mapping[str, Any]], float]) -> FloatArray:
        """[R] a measure of what each run has left, NaN for one that broke."""
        return np.array([measure(record["observed"]) if record.get("observed") else np.nan for record in self.records], np.float64)

    @property
    def has_due_times(self) -> bool:
        """True if orders have due times."""
        return any(bool(np.isfinite(t["due_s"]).any()) for t in self.observed)

    @property
    def p95_s(self) -> Interval:
        """95th percentile of the time from release to done."""
        values = []
        for t in self.observed:
            done = (t["done_s"] > self.warm_up_s) & np.isfinite(t["done_s"])
            values.append(float(np.quantile((t["done_s"] - t["released_s"])[done], 0.95)) if done.any() else np.nan)
        return t_mean(values)

    @property
    def num_deadlocked(self) -> int:
        """Runs in which robots blocked each other for good."""
        return sum(run["deadlocks"] > 0 for run in self.observed)

    @property
    def num_stalled(self) -> int:
        """Runs in which work came to a stand for good."""
        return sum(record["status"] == "stalled" for record in self.records)

    @property
    def succeeded(self) -> FloatArray:
        """[R] of one-shot runs: 1 where plans were found and driven in time, else 0."""
        return np.array([float(bool(record["success"])) for record in self.records])

    @property
    def num_succeeded(self) -> int:
        """Of one-shot runs: plans that were found and driven in time."""
        return int(self.succeeded.sum())


def compared(one: Point, other: Point, share: float = 1.0, confidence: float = 0.95) -> PairedMeans:
    """`other`'s throughput beside a share of `one`'s, on the seeds that both have."""
    assert one.first_seed == other.first_seed
    count = min(len(one.per_h), len(other.per_h))
    step_per_h = float(np.hypot(share * one.step_per_h, other.step_per_h))
    return paired_t(share * one.per_h[:count], other.per_h[:count], confidence, step_per_h)
