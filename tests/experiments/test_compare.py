"""The second of two tables is worse when it is worse beyond chance and tolerance, on the runs they share."""

import pandas as pd
import pytest

from mrp_sumo.errors import BatchError
from mrp_sumo.experiments.compare import compare


def table(success, soc_steps=None, first=0):
    keys = [f"k{first + i}" for i in range(len(success))]
    steps = [100] * len(success) if soc_steps is None else soc_steps
    return pd.DataFrame({"scenario_key": keys, "success": pd.array(success, "boolean"), "soc_steps": steps, "reason": "x"})


def test_equal_tables_are_not_worse():
    result = compare(table([True] * 10), table([True] * 10))
    assert not result.worse
    assert result.num_pairs == 10
    assert [d.metric for d in result.differences] == ["success", "soc_steps"]


def test_lost_successes_beyond_chance_are_worse_and_gained_ones_are_not():
    before, after = table([True] * 20), table([True] * 12 + [False] * 8)
    assert compare(before, after).worse
    assert not compare(after, before).worse


def test_a_single_lost_success_is_worse_only_in_strict_mode():
    before, after = table([True] * 20), table([True] * 19 + [False])
    assert not compare(before, after).worse
    assert compare(before, after, strict=True).worse


def test_higher_cost_is_worse_beyond_the_tolerance():
    before, after = table([True] * 20), table([True] * 20, [103] * 20)
    assert compare(before, after).worse
    assert not compare(before, after, tolerance=0.05).worse
    assert not compare(after, before).worse
    assert compare(before, after).differences[1].num_worse == 20


def test_only_runs_in_both_are_compared():
    result = compare(table([True] * 10), table([True] * 10, first=4))
    assert (result.num_pairs, result.num_only_first, result.num_only_second) == (6, 4, 4)


def test_tables_without_a_common_run_are_refused():
    with pytest.raises(BatchError, match="the two have no run in common"):
        compare(table([True]), table([True], first=5))


def test_words_where_truth_values_are_expected_are_refused():
    with pytest.raises(BatchError, match="metric 'success' is neither a number nor yes or no"):
        compare(table([True, False]), table([True, False]).assign(success=["a", "b"]))


@pytest.mark.parametrize(
    ("metric", "output"),
    [("soc_step", r"no metric 'soc_step' \(did you mean 'soc_steps'\?\)"), ("reason", "metric 'reason' is neither a number nor yes or no")],
)
def test_metric_that_cannot_be_compared_is_refused(metric, output):
    with pytest.raises(BatchError, match=output):
        compare(table([True]), table([True]), [metric])


@pytest.mark.parametrize(
    ("metric", "before", "after", "worse"),
    [
        ("min_distance_delta_m", 0.1, 0.5, True),  # robots come nearer to each other than before
        ("min_distance_delta_m", 0.5, 0.1, False),
        ("min_distance_m", 0.5, 0.1, True),
        ("min_distance_m", 0.1, 0.5, False),
        ("min_distance_at_start_m", 0.5, 0.1, False),  # says nothing about either
        ("num_vertices", 10, 20, False),
        ("run_wall_s", 1.0, 2.0, True),
    ],
)
def test_what_is_worse_is_said_by_the_table_of_metrics(metric, before, after, worse):
    a, b = (table([True] * 20).assign(**{metric: value}) for value in (before, after))
    result = compare(a, b, [metric])
    assert result.worse is worse
    assert result.differences[0].num_worse == 20 * worse
