"""Statistics of replications: means with limits, and alternatives compared on common random numbers.

A replication is a run with a seed of its own; runs of two alternatives with the same seed meet the same orders, and are a pair. Law,
"Simulation Modeling and Analysis", 5th ed., chapters 9 and 10. Rates have Wilson's limits, and several tests Holm's adjustment
(`experiments.statistics`).
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mrp_sumo.experiments.statistics import Interval


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


def t_mean(values: ArrayLike, confidence: float = 0.95, resolution: float = 0.0) -> Interval:
    """A mean with Student's limits; infinite limits for one value, NaN for none. Values that are not finite are left out.

    `resolution` is the step in which values are counted. The count of a steady process in a span that begins at any time may vary by half a
    step without showing it in a few values, so that a deviation below that is not believed: equal counts have limits, too.
    """
    x = np.asarray(values, np.float64)
    x = x[np.isfinite(x)]
    if not len(x):
        return Interval(math.nan, math.nan, math.nan, 0)
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

    a, b = np.asarray(first, np.float64), np.asarray(second, np.float64)
    both = np.isfinite(a) & np.isfinite(b)
    a, b = a[both], b[both]
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
