"""Limits of replications hold the truth of systems whose truth is known."""

import math

import numpy as np
import pytest
from queues import coverage, mean_wait_s, waits_s
from scipy import stats

from mrp_sumo.experiments.statistics import paired_t, t_mean


def test_limits_are_students():
    result = t_mean([4.0, 5.0, 6.0, 9.0, math.nan])
    assert (result.value, result.count) == (6.0, 4)
    assert (result.low, result.high) == pytest.approx(stats.t.interval(0.95, 3, 6.0, stats.sem([4, 5, 6, 9])))
    assert (t_mean([3.0]).low, t_mean([3.0]).high) == (-math.inf, math.inf)


def test_paired_test_is_that_of_the_differences():
    a, b = np.array([10.0, 12.0, 9.0, 14.0, 11.0]), np.array([11.0, 13.5, 9.5, 15.0, 12.5])
    result, known = paired_t(a, b), stats.ttest_rel(b, a)
    assert result.p_value == pytest.approx(known.pvalue)
    assert (result.difference.low, result.difference.high) == pytest.approx(tuple(known.confidence_interval()))
    assert result.variance_reduction == pytest.approx(1 - np.var(b - a, ddof=1) / (np.var(a, ddof=1) + np.var(b, ddof=1)))
    assert result.variance_reduction > 0.9


@pytest.mark.parametrize(
    ("first", "second", "p_value", "variance_reduction"),
    [
        ([3.0, 4.0, 5.0], [5.0, 6.0, 7.0], 0.0, 1.0),  # two more each time
        ([3.0, 3.0, 3.0], [3.0, 3.0, 3.0], 1.0, 0.0),
        ([3.0, math.nan], [5.0, 6.0], 1.0, math.nan),  # one pair
        ([3.0, 4.0], [5.0, 7.0], stats.ttest_rel([3, 4], [5, 7]).pvalue, 0.8),  # 1/2 of 1/2 + 2 is left
    ],
)
def test_pairs_that_differ_alike_are_as_sure_as_can_be_and_one_pair_says_nothing(first, second, p_value, variance_reduction):
    paired = paired_t(first, second)
    assert paired.p_value == pytest.approx(p_value) and paired.variance_reduction == pytest.approx(variance_reduction, nan_ok=True)


def test_counts_that_are_equal_are_not_believed_to_vary_by_less_than_half_a_step():
    limits, pairs = t_mean([6.0] * 4, resolution=1.0), paired_t([6.0] * 4, [8.0] * 4, resolution=1.0)
    assert (limits.low, limits.high) == pytest.approx(stats.t.interval(0.95, 3, 6.0, 0.25))
    assert (pairs.difference.low, pairs.difference.high) == pytest.approx(stats.t.interval(0.95, 3, 2.0, 0.25))
    assert pairs.p_value == pytest.approx(2 * stats.t.sf(8.0, 3))
    assert t_mean([4.0, 5.0, 6.0, 9.0], resolution=1.0) == t_mean([4.0, 5.0, 6.0, 9.0])  # they vary by more


def test_common_random_numbers_have_narrower_limits_than_independent_ones():
    """Servers of M/M/2 that are 5 % faster: the same customers come to both."""
    before, other = (waits_s(np.random.default_rng(seed), 12, 3000, 1.4, 1.0, 2).mean(1) for seed in (7, 8))
    after = waits_s(np.random.default_rng(7), 12, 3000, 1.4, 0.95, 2).mean(1)
    together, apart = paired_t(before, after), paired_t(other, after)
    assert together.variance_reduction > 0.8
    assert together.difference.high < 0
    assert (apart.difference.high - apart.difference.low) > 2 * (together.difference.high - together.difference.low)


def test_erlangs_formula_is_within_the_limits_of_replications():
    runs = waits_s(np.random.default_rng(1), 20, 4000, 2.4, 1.0, 3)[:, 500:].mean(1)
    limits = t_mean(runs)
    assert limits.low <= mean_wait_s(2.4, 1.0, 3) <= limits.high
    assert limits.high - limits.low < 0.5 * limits.value


def test_limits_cover_the_truth_as_often_as_they_say():
    assert 0.90 <= coverage(3, 200, 4, 4800) <= 0.99  # normal quantiles: 0.85
