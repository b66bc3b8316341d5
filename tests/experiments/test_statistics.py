"""Statistics give the textbook's figures on small samples."""

import math

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from mrp_sumo.experiments.statistics import (
    MAX_WALSH,
    _hodges_lehmann,
    bootstrap_deviation,
    bootstrap_mean,
    holm,
    mcnemar,
    pairs,
    par2,
    rates,
    success_rates,
    wilcoxon,
    wilson,
)


@pytest.mark.parametrize(
    ("successes", "count", "low", "high"),
    [(8, 10, 0.4902, 0.9433), (0, 10, 0.0, 0.2775), (10, 10, 0.7225, 1.0), (1, 1, 0.2065, 1.0)],
)
def test_wilson_interval_of_small_samples(successes, count, low, high):
    interval = wilson(successes, count)
    assert interval.value == successes / count
    assert (interval.low, interval.high) == pytest.approx((low, high), abs=1e-4)


def test_rate_of_no_runs_is_unknown():
    assert math.isnan(wilson(0, 0).value)


def test_mcnemar_is_a_sign_test_of_the_runs_that_differ():
    first = np.array([True] * 30 + [False] * 8 + [True] * 1 + [False] * 5)
    second = np.array([True] * 30 + [True] * 8 + [False] * 1 + [False] * 5)
    result = mcnemar(first, second)
    assert (result.only_first, result.only_second, result.count) == (1, 8, 44)
    assert result.p_value == pytest.approx(2 * (1 + 9) / 2**9)
    assert result.difference.value == pytest.approx(7 / 44)


def test_paired_difference_has_newcombes_interval():
    first = np.array([True] * 20 + [False] * 12 + [True] * 2 + [False] * 16)
    second = np.array([True] * 20 + [True] * 12 + [False] * 2 + [False] * 16)
    difference = mcnemar(first, second).difference
    assert difference.value == pytest.approx(0.2)
    assert (difference.low, difference.high) == pytest.approx((0.0562, 0.3290), abs=2e-3)


@pytest.mark.parametrize("counts", [(30, 2, 8, 20), (20, 9, 9, 12), (4, 3, 9, 6)])  # both, only one of them, only the other, neither
def test_paired_difference_has_the_interval_that_scipys_figures_give(counts):
    """phi by Yates' chi-squared where outcomes go together by more than that corrects, 0 where by less, and as it is where they part."""
    first, second = (np.repeat(outcomes, counts) for outcomes in ([True, True, False, False], [True, False, True, False]))
    n, table = sum(counts), np.reshape(counts, (2, 2))
    one, two = (stats.binomtest(int(each.sum()), n).proportion_ci(method="wilson") for each in (first, second))
    excess = np.linalg.det(table)
    phi = math.copysign(math.sqrt(stats.chi2_contingency(table, correction=excess > 0).statistic / n), excess)
    phi = 0.0 if 0 < excess < n / 2 else phi
    p, q = first.mean(), second.mean()
    parts = [((q - two.low), (one.high - p)), ((two.high - q), (p - one.low))]
    low, high = (math.sqrt(a * a - 2 * phi * a * b + b * b) for a, b in parts)
    difference = mcnemar(first, second).difference
    assert (difference.low, difference.high) == pytest.approx((q - p - low, q - p + high))


def test_outcomes_that_never_differ_are_no_evidence():
    result = mcnemar([True, False, True], [True, False, True])
    assert (result.p_value, result.difference.value) == (1.0, 0.0)
    nothing = mcnemar([], [])
    assert (nothing.p_value, nothing.count) == (1.0, 0) and math.isnan(nothing.difference.value)


def test_wilcoxon_of_five_runs_that_all_got_larger_is_exact():
    result = wilcoxon([1, 2, 3, 4, 5], [2, 4, 6, 8, 10])
    assert result.p_value == pytest.approx(2 / 2**5)
    assert result.rank_biserial == 1
    assert result.shift == 3
    assert (result.first, result.second) == (3, 6)


def test_wilcoxon_leaves_out_runs_without_both_values():
    result = wilcoxon([1, np.nan, 3], [1, 2, np.nan])
    assert (result.count, result.p_value, result.rank_biserial) == (1, 1.0, 0.0)
    assert wilcoxon([np.nan], [1]).count == 0


def test_runs_that_got_larger_and_smaller_are_weighed_by_the_ranks_of_their_differences():
    """Three larger, of ranks 2, 3 and 4, one smaller, of rank 1, and one that is equal."""
    assert wilcoxon([5, 5, 5, 5, 5], [6, 8, 4.5, 7, 5]).rank_biserial == pytest.approx((2 + 3 + 4 - 1) / 10)


def test_wilcoxon_of_many_runs_is_that_of_scipy():
    rng = np.random.default_rng(3)
    a = rng.normal(size=80)
    b = a + rng.normal(0.3, 1, 80)
    assert wilcoxon(a, b).p_value == pytest.approx(stats.wilcoxon(b - a, method="approx").pvalue)


def test_bootstrap_interval_is_that_of_scipy():
    x = np.random.default_rng(1).exponential(size=60)
    ours, theirs = bootstrap_mean(x), stats.bootstrap((x,), np.mean, rng=0).confidence_interval
    assert ours.value == x.mean()
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=0.02)
    assert bootstrap_mean(x) == ours  # the same every time


def test_bootstrap_interval_of_few_values_leans_to_the_side_of_the_largest():
    x = np.array([1.0, 1.0, 2.0, 2.0, 3.0, 4.0, 8.0, 30.0])
    ours, theirs = bootstrap_mean(x), stats.bootstrap((x,), np.mean, rng=0, n_resamples=99_999).confidence_interval
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=0.5)


def test_bootstrap_interval_of_a_deviation_is_that_of_scipy():
    x = np.random.default_rng(2).normal(size=60)

    def deviation(rows, axis):
        return np.std(rows, ddof=1, axis=axis)

    ours, theirs = bootstrap_deviation(x), stats.bootstrap((x,), deviation, rng=0).confidence_interval
    assert ours.value == x.std(ddof=1)
    assert (ours.low, ours.high) == pytest.approx((theirs.low, theirs.high), abs=0.01)
    assert math.isnan(bootstrap_deviation([1.0, 2.0]).value)


def test_bootstrap_of_one_value_or_equal_ones():
    assert bootstrap_mean([2.0, 2.0, np.nan]).low == 2.0
    assert math.isnan(bootstrap_mean([2.0]).low)
    assert math.isnan(bootstrap_mean([]).value)


def test_holm_adjusts_for_the_number_of_tests():
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([]) == []


def test_normalised_rate_is_of_runs_with_a_plan_and_overall_of_all():
    normalised, overall = success_rates([True, True, True, False], [True, False, True, False])
    assert (normalised.value, normalised.count) == (pytest.approx(2 / 3), 3)
    assert (overall.value, overall.count) == (0.5, 4)


def test_unsolved_runs_count_twice_the_limit():
    assert par2([1.0, math.nan, 30.0, 61.0], [True, False, False, True], 60.0) == pytest.approx((1 + 120 + 120 + 120) / 4)


RESULTS = pd.DataFrame(
    {
        "map": ["office"] * 6,
        "planner": ["cbs", "cbs", "cbs", "ecbs", "ecbs", "ecbs"],
        "planner.parameters.w": [math.nan] * 3 + [1.2] * 3,
        "planner.time_limit_s": [60.0] * 6,
        "seed": [0, 1, 2, 2, 0, 5],
        "repeat": [0] * 6,
        "plan_success": pd.array([True, False, None, True, True, True], "boolean"),
        "plan_valid": pd.array([True, None, None, True, True, True], "boolean"),
        "success": pd.array([True, False, False, True, False, True], "boolean"),
        "planning_time_s": [1.0, 60.0, math.nan, 2.0, 3.0, 4.0],
    }
)


@pytest.mark.parametrize("column", ["planning_time_s", "plan_success"])
def test_runs_without_a_time_or_a_plan_count_twice_the_limit_and_no_run_has_no_time(column):
    first = rates(RESULTS.drop(columns=column), ["planner"]).to_dict("records")[0]
    assert first["planning_par2_s"] == 120.0 and first["mrp_bench_planning"] == pytest.approx((column != "plan_success") / 3)
    assert par2([60.0, 60.1], [True, True], 60.0) == 90.0 and math.isnan(par2([], [], 60.0))


def test_rates_of_groups_count_every_run():
    cbs, ecbs = rates(RESULTS, ["planner"]).to_dict("records")
    assert (cbs["num_runs"], cbs["planning"], cbs["normalised"], cbs["overall"]) == (3, pytest.approx(1 / 3), 1.0, pytest.approx(1 / 3))
    assert cbs["planning_par2_s"] == pytest.approx((1 + 120 + 120) / 3)
    assert (ecbs["normalised"], ecbs["planning_par2_s"]) == (pytest.approx(2 / 3), 3.0)


def test_invalid_plan_is_no_success_but_counts_for_mrp_bench():
    ecbs = rates(RESULTS.assign(plan_valid=pd.array([True, None, None, False, True, True], "boolean")), ["planner"]).to_dict("records")[1]
    assert (ecbs["planning"], ecbs["mrp_bench_planning"]) == (pytest.approx(2 / 3), 1.0)
    assert ecbs["planning_par2_s"] == pytest.approx((120 + 3 + 4) / 3)


def test_pairs_are_runs_equal_in_all_but_the_factor():
    a, b = pairs(RESULTS, "planner", "cbs", "ecbs")
    assert list(a["seed"]) == list(b["seed"]) == [0, 2]
    assert list(a["planner"]) == ["cbs", "cbs"]
    assert list(b["planner"]) == ["ecbs", "ecbs"]


@pytest.mark.parametrize("seed", range(40))
def test_p_values_are_those_of_scipy(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 40))
    moved = rng.integers(1, 6, count) * rng.choice([-1.0, 1.0], count)  # with ties
    method = stats.PermutationMethod(n_resamples=2**13) if count <= 13 else "approx"
    assert wilcoxon(np.zeros(count), moved).p_value == pytest.approx(stats.wilcoxon(moved, method=method).pvalue, rel=1e-9)
    only_first, only_second = rng.integers(1, 60, 2)
    first = np.repeat([True, False], [only_first, only_second])
    assert mcnemar(first, ~first).p_value == pytest.approx(stats.binomtest(only_first, len(first)).pvalue, rel=1e-9)


@pytest.mark.parametrize("counts", [(470, 530), (471, 530), (5, 2000), (700, 700)])
def test_the_sign_test_of_many_runs_is_that_of_scipy(counts):
    """Up to 1000 runs in whole numbers."""
    first = np.repeat([True, False], counts)
    assert mcnemar(first, ~first).p_value == pytest.approx(stats.binomtest(counts[0], sum(counts)).pvalue, rel=1e-9)


@pytest.mark.parametrize(("more", "shift"), [(0, 0.5), (1, 0.0)])
def test_a_shift_is_the_median_of_averages_or_of_the_differences_where_there_are_too_many(more, shift):
    """A third of the differences is 1, the rest 0: four ninths of the averages are 0 and as many one half."""
    assert _hodges_lehmann(np.repeat([0.0, 1.0], [1000, MAX_WALSH - 1000 + more])) == shift
