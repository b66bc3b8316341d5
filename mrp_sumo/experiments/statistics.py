"""Statistics of runs: intervals for rates and means, paired comparisons with effect sizes, and the benchmark's own rates.

Two planners or two versions are compared on the same scenarios and seeds, run by run. Rates are those
of a set of runs in which every run counts, time-outs included. Functions take arrays; `rates` and `pairs` take
the table of `mrp_sumo.load_results`.

A replication is a run with a seed of its own; runs of two alternatives with the same seed meet the same orders, and are a pair (Law,
"Simulation Modeling and Analysis", 5th ed., chapters 9 and 10): their means have Student's limits.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from mrp_sumo.core.graph import BoolArray, FloatArray

if TYPE_CHECKING:
    import pandas

NORMAL = NormalDist()
CONFIDENCE = 0.95  # of bootstraps
RESAMPLES = 10_000  # of a bootstrap
MAX_EXACT = 1000  # runs that differ up to which the sign test counts in whole numbers
MAX_ENUMERATED = 13  # pairs up to which the signed-rank test looks at every assignment of signs
MAX_WALSH = 1500  # pairs up to which the Hodges-Lehmann estimate is taken of all averages


@dataclass(frozen=True)
class Interval:
    """An estimate and its confidence interval; NaN where there is nothing to estimate from."""

    value: float
    low: float
    high: float
    count: int  # of observations

    def __str__(self) -> str:
        return f"{self.value:.4g} [{self.low:.4g}, {self.high:.4g}]"


NOTHING = Interval(math.nan, math.nan, math.nan, 0)  # to estimate from


@dataclass(frozen=True)
class PairedRates:
    """Two yes-or-no outcomes of the same runs. Differences are second minus first."""

    count: int
    first: float
    second: float
    only_first: int  # runs that only the first did
    only_second: int
    difference: Interval
    p_value: float


@dataclass(frozen=True)
class PairedValues:
    """Two measurements of the same runs. Differences are second minus first."""

    count: int
    first: float  # means
    second: float
    difference: Interval  # of the mean, by bootstrap
    shift: float  # Hodges-Lehmann: the median of averages of two differences
    rank_biserial: float  # -1: the second is smaller in every run, 1: larger in every run
    p_value: float


@dataclass(frozen=True)
class PairedMeans:
    """Two alternatives on the same seeds. Differences are second minus first."""

    first: float  # means
    second: float
    difference: Interval
    p_value: float  # two-sided, of no difference
    variance_reduction: float  # share of the variance of independent samples that pairing took away; negative: it added some

    @property
    def count(self) -> int:
        """Pairs."""
        return self.difference.count


def wilson(successes: int, count: int, confidence: float = 0.95) -> Interval:
    """A rate with Wilson's score interval (Wilson, JASA 1927), which holds for few runs and rates near 0 or 1."""
    if count == 0:
        return NOTHING
    z = NORMAL.inv_cdf((1 + confidence) / 2)
    rate = successes / count
    middle = rate + z * z / (2 * count)
    half = z * math.sqrt(rate * (1 - rate) / count + z * z / (4 * count * count))
    scale = 1 + z * z / count
    low = 0.0 if successes == 0 else (middle - half) / scale
    return Interval(rate, low, 1.0 if successes == count else (middle + half) / scale, count)


def bootstrap_mean(values: ArrayLike) -> Interval:
    """A mean with its bias-corrected and accelerated bootstrap interval (Efron, JASA 1987); NaN values are left out."""
    x = _finite(values)
    if not len(x):
        return NOTHING
    mean = float(x.mean())
    if len(x) == 1:
        return Interval(mean, math.nan, math.nan, 1)
    return _bootstrap(x, mean, lambda rows: rows.mean(1), (x.sum() - x) / (len(x) - 1))


def bootstrap_deviation(values: ArrayLike) -> Interval:
    """A sample's standard deviation with its interval, as `bootstrap_mean`; NaN of fewer than three values."""
    x = _finite(values)
    if len(x) < 3:
        return Interval(math.nan, math.nan, math.nan, len(x))
    squares = (x - x.mean()) ** 2
    left = np.maximum(squares.sum() - squares * len(x) / (len(x) - 1), 0)  # sums of squares, each without one
    return _bootstrap(x, float(x.std(ddof=1)), lambda rows: rows.std(1, ddof=1), np.sqrt(left))


def _finite(values: ArrayLike) -> FloatArray:
    x = np.asarray(values, np.float64)
    return x[np.isfinite(x)]


def _both(first: ArrayLike, second: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Pairs that have both values."""
    a, b = np.asarray(first, np.float64), np.asarray(second, np.float64)
    there = np.isfinite(a) & np.isfinite(b)
    return a[there], b[there]


def _bootstrap(x: FloatArray, value: float, statistic: Callable[[FloatArray], FloatArray], without: FloatArray) -> Interval:
    """The interval of a statistic of at least two values [N]; it is taken of rows [n, N] of resampled ones.

    `without` [N] is a multiple of it without each value.
    """
    if np.ptp(x) == 0:
        return Interval(value, value, value, len(x))
    rng = np.random.default_rng([0, len(x)])
    share = max(1, 2_000_000 // len(x))  # resamples at a time: bounded memory
    drawn = (x[rng.integers(0, len(x), (min(share, RESAMPLES - at), len(x)))] for at in range(0, RESAMPLES, share))
    resampled = np.concatenate([statistic(rows) for rows in drawn])
    below = np.clip((np.count_nonzero(resampled < value) + np.count_nonzero(resampled == value) / 2) / RESAMPLES, 1e-6, 1 - 1e-6)
    bias = NORMAL.inv_cdf(float(below))
    away = without.mean() - without
    acceleration = (away**3).sum() / (6 * (away**2).sum() ** 1.5)
    ends = (bias + NORMAL.inv_cdf(share) for share in ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2))
    low, high = np.quantile(resampled, [NORMAL.cdf(bias + z / (1 - acceleration * z)) for z in ends])
    return Interval(value, float(low), float(high), len(x))


def mcnemar(first: ArrayLike, second: ArrayLike) -> PairedRates:
    """McNemar's exact test of whether two yes-or-no outcomes of the same runs differ.

    The interval of the difference is Newcombe's tenth (Statistics in Medicine 17, 1998, 2635-2650).
    """
    a, b = np.asarray(first, np.bool_), np.asarray(second, np.bool_)
    n = len(a)
    both, only_a, only_b, neither = (int(np.count_nonzero(c)) for c in (a & b, a & ~b, b & ~a, ~a & ~b))
    if n == 0:
        return PairedRates(0, math.nan, math.nan, 0, 0, NOTHING, 1.0)
    p_value = _sign_test(only_a, only_b)
    one, two = wilson(both + only_a, n), wilson(both + only_b, n)
    margins = (both + only_a) * (only_b + neither) * (both + only_b) * (only_a + neither)
    excess = both * neither - only_a * only_b
    corrected = max(excess - n / 2, 0.0) if excess > 0 else excess
    phi = corrected / math.sqrt(margins) if margins else 0.0
    difference = two.value - one.value
    low = difference - _joint(two.value - two.low, one.high - one.value, phi)
    high = difference + _joint(two.high - two.value, one.value - one.low, phi)
    return PairedRates(n, one.value, two.value, only_a, only_b, Interval(difference, low, high, n), p_value)


def wilcoxon(first: ArrayLike, second: ArrayLike) -> PairedValues:
    """Wilcoxon's signed-rank test, exact for few runs, of whether two measurements of the same runs differ.

    The effect size is the matched-pairs rank-biserial correlation (Kerby, Comprehensive Psychology 3, 2014).
    Runs without both values are left out.
    """
    a, b = _both(first, second)
    if not len(a):
        return PairedValues(0, math.nan, math.nan, NOTHING, math.nan, math.nan, 1.0)
    d = b - a
    moved = d[d != 0]
    p_value, rank_biserial = 1.0, 0.0
    if len(moved):
        ranks = _ranks(np.abs(moved))
        rank_biserial = float((ranks[moved > 0].sum() - ranks[moved < 0].sum()) / ranks.sum())
        p_value = _signed_rank_test(ranks, moved > 0)
    return PairedValues(len(a), float(a.mean()), float(b.mean()), bootstrap_mean(d), _hodges_lehmann(d), rank_biserial, p_value)


def _sign_test(num_first: int, num_second: int) -> float:
    """How likely counts at least as uneven are if both sides are equally likely: the two-sided binomial test, exact."""
    count, fewer = num_first + num_second, range(min(num_first, num_second) + 1)
    if count <= MAX_EXACT:
        return min(1.0, 2 * sum(math.comb(count, k) for k in fewer) / (1 << count))
    every = math.lgamma(count + 1) - count * math.log(2)
    return min(1.0, 2 * math.fsum(math.exp(every - math.lgamma(k + 1) - math.lgamma(count - k + 1)) for k in fewer))


def _ranks(values: FloatArray) -> FloatArray:
    """[N] ranks from 1 on; equal values share the mean of theirs."""
    _, which, count = np.unique(values, return_inverse=True, return_counts=True)
    ranks: FloatArray = (np.cumsum(count) - (count - 1) / 2)[which.reshape(-1)]
    return ranks


def _signed_rank_test(ranks: FloatArray, rose: BoolArray) -> float:
    """How likely a sum of ranks at least as uneven is if every sign is as likely as its opposite, two-sided."""
    count, plus = len(ranks), float(ranks[rose].sum())
    if count <= MAX_ENUMERATED:
        sums = (np.arange(2**count)[:, None] >> np.arange(count) & 1) @ ranks
        return float(min(1.0, 2 * min((sums <= plus).mean(), (sums >= plus).mean())))
    tied = np.unique(ranks, return_counts=True)[1]
    variance = (count * (count + 1) * (2 * count + 1) - (tied**3 - tied).sum() / 2) / 24
    return math.erfc(abs(plus - count * (count + 1) / 4) / math.sqrt(2 * variance))


def t_mean(values: ArrayLike, confidence: float = 0.95, resolution: float = 0.0) -> Interval:
    """A mean with Student's limits; infinite limits for one value, NaN for none. Values that are not finite are left out.

    `resolution` is the step in which values are counted. The count of a steady process in a span that begins at any time may vary by half a
    step without showing it in a few values, so that a deviation below that is not believed: equal counts have limits, too.
    """
    x = _finite(values)
    if not len(x):
        return NOTHING
    mean = float(x.mean())
    if len(x) == 1:
        return Interval(mean, -math.inf, math.inf, 1)
    deviation = max(float(x.std(ddof=1)), resolution / 2)
    half = t_quantile((1 + confidence) / 2, len(x) - 1) * deviation / math.sqrt(len(x))
    return Interval(mean, mean - half, mean + half, len(x))


def paired_t(first: ArrayLike, second: ArrayLike, confidence: float = 0.95, resolution: float = 0.0) -> PairedMeans:
    """Student's test of whether two alternatives differ, of their differences on common random numbers, seed by seed.

    Pairs without both values are left out; confidence and resolution are those of `t_mean`, of the differences.
    """
    from scipy.special import stdtr

    a, b = _both(first, second)
    d = b - a
    of_a, of_b = t_mean(a, confidence), t_mean(b, confidence)
    mean = t_mean(d, confidence, resolution)
    if len(d) < 2:
        return PairedMeans(of_a.value, of_b.value, mean, 1.0, math.nan)
    apart, spread = float(a.var(ddof=1) + b.var(ddof=1)), float(d.var(ddof=1))
    error = max(math.sqrt(spread), resolution / 2) / math.sqrt(len(d))
    p_value = 2 * float(stdtr(len(d) - 1, -abs(mean.value) / error)) if error else float(mean.value == 0)
    return PairedMeans(of_a.value, of_b.value, mean, p_value, 1 - spread / apart if apart else 0.0)


def t_quantile(share: float, freedom: int) -> float:
    from scipy.special import stdtrit

    return float(stdtrit(freedom, share))


def holm(p_values: Sequence[float]) -> list[float]:
    """p-values of several tests adjusted so that the chance of any false alarm stays as stated (Holm 1979)."""
    p, order = np.array(p_values, np.float64), np.argsort(p_values, kind="stable")
    p[order] = np.maximum.accumulate(np.minimum(1.0, np.arange(len(p), 0, -1) * p[order]))
    return list(p.tolist())


def success_rates(planned: ArrayLike, succeeded: ArrayLike, confidence: float = 0.95) -> tuple[Interval, Interval]:
    """MRP-Bench's two success rates of N executed runs: normalised, what the execution is worth, and overall, with the planner.

    `planned` tells whether the planner found a plan that counts within its time limit: a valid one for us, any one for MRP-Bench;
    `succeeded` whether all robots then reached their goals within theirs. The first is of the runs that had a plan, the second of all.
    """
    p, s = np.asarray(planned, np.bool_), np.asarray(succeeded, np.bool_)
    won = int(np.count_nonzero(p & s))
    return wilson(won, int(np.count_nonzero(p)), confidence), wilson(won, len(p), confidence)


def par2(time_s: ArrayLike, solved: ArrayLike, limit_s: float) -> float:
    """Penalised average run time: a run that was not solved counts as twice the limit; NaN for no run."""
    won = np.asarray(solved, np.bool_)
    if not len(won):
        return math.nan
    spent = np.asarray(time_s, np.float64)
    return float(np.where(won & np.isfinite(spent) & (spent <= limit_s), spent, 2 * limit_s).mean())


def rates(results: "pandas.DataFrame", by: Sequence[str], confidence: float = 0.95) -> "pandas.DataFrame":
    """Success rates of groups of runs.

    Parameters
    ----------
    results
        As `mrp_sumo.load_results` gives it.
    by
        Columns that make the groups, such as `["map", "num_robots", "planner"]`.
    confidence
        Of the intervals.

    Returns
    -------
    DataFrame
        A row for each group: `num_runs`; success rates with `_low` and `_high`: `planning` (valid plans of all runs),
        `normalised` (successes of the runs with a valid plan), `overall` (successes of all runs), and `mrp_bench_planning`, which
        counts any plan; and `planning_par2_s`, in which a run without a valid plan counts as twice the limit.
    """
    import pandas as pd

    rows = []
    for values, group in results.groupby(list(by), sort=False, dropna=False):
        has_plan = _flags(group, "plan_success")
        planned = has_plan & _flags(group, "plan_valid")
        normalised, overall = success_rates(planned, _flags(group, "success"), confidence)
        row: dict[str, Any] = dict(zip(by, values, strict=True)) | {"num_runs": len(group)}
        for name, rate in (
            ("planning", wilson(int(planned.sum()), len(group), confidence)),
            ("normalised", normalised),
            ("overall", overall),
            ("mrp_bench_planning", wilson(int(has_plan.sum()), len(group), confidence)),
        ):
            row |= {name: rate.value, f"{name}_low": rate.low, f"{name}_high": rate.high}
        limit_s = float(group["planner.time_limit_s"].max())
        time_s = (
            group["planning_time_s"].to_numpy(np.float64, na_value=np.nan) if "planning_time_s" in group else np.full(len(group), np.nan)
        )
        row["planning_par2_s"] = par2(time_s, planned, limit_s)
        rows.append(row)
    return pd.DataFrame(rows)


def pairs(results: "pandas.DataFrame", factor: str, first: Any, second: Any) -> "tuple[pandas.DataFrame, pandas.DataFrame]":
    """The runs of two values of a factor, such as two planners, that are equal in all else: row by row the same scenario and seed.

    Parameters
    ----------
    results
        As `mrp_sumo.load_results` gives it.
    factor
        A scenario column; what belongs to it (`planner.parameters...`) may differ too.
    first, second
        Its values.
    """
    from mrp_sumo.io.columns import SECTIONS

    same = [
        c
        for c in results.columns
        if (c.split(".")[0] in SECTIONS or c == "repeat") and c != factor and not c.startswith(f"{factor}.parameters.")
    ]
    keyed = results.assign(_pair=[repr(row) for row in results[same].itertuples(index=False, name=None)])
    a, b = (keyed[keyed[factor] == value].drop_duplicates("_pair").set_index("_pair") for value in (first, second))
    shared = a.index.intersection(b.index, sort=False)
    return a.loc[shared].reset_index(drop=True), b.loc[shared].reset_index(drop=True)


def _flags(results: "pandas.DataFrame", column: str) -> Any:
    """[N] of a yes-or-no column, missing is no."""
    if column not in results:
        return np.zeros(len(results), np.bool_)
    return results[column].fillna(False).to_numpy(np.bool_)


def _joint(one: float, other: float, phi: float) -> float:
    return math.sqrt(max(0.0, one * one - 2 * phi * one * other + other * other))


def _hodges_lehmann(d: Any) -> float:
    if len(d) > MAX_WALSH:
        return float(np.median(d))
    i, j = np.triu_indices(len(d))
    return float(np.median((d[i] + d[j]) / 2))
