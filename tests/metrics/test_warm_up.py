"""The warm-up is found where the beginning differs from the rest, and nowhere else."""

import numpy as np
import pytest

from mrp_sumo.metrics.warm_up import warm_up_length


def test_the_error_of_what_is_left_is_least():
    series = np.concatenate([np.full(13, 0.0), np.tile([4.0, 6.0, 5.0, 5.0, 5.0], 12)])
    assert warm_up_length(series) == 15  # whole batches of five


def test_half_of_a_series_is_too_much_to_leave_out():
    assert warm_up_length(np.concatenate([np.zeros(30), np.full(30, 9.0)])) is None
    assert warm_up_length(np.ones(19)) is None
    assert warm_up_length(np.ones(20)) == 0


@pytest.mark.parametrize(("first", "cut"), [(1.3, 5), (1.15, 0)])
def test_it_is_the_variance_that_is_weighed_against_what_is_left(first, cut):
    """Eight batch means: `first`, then 0 and 1 in turn, whose seven have the variance 12 / 49, and so the squared error 0.0350.

    With 1.3 all eight have 0.297 / 8 = 0.0372, which is more, and with 1.15 they have 0.271 / 8 = 0.0339, which is less. By deviations
    instead of variances it would be less both times.
    """
    assert warm_up_length(np.repeat([first, 0, 1, 0, 1, 0, 1, 0], 5)) == cut


@pytest.mark.parametrize(("means", "cut"), [([9, 9, 9, 0, 0, 0], None), ([9, 9, 0, 0, 0, 0], 10), ([9, 9, 9, 9, 0, 0], 0)])
def test_the_half_is_looked_at_too_of_an_odd_half_and_nothing_beyond(means, cut):
    """Of six batches the best cut is at the half, three; before it; or beyond it, and of those up to it at the beginning."""
    assert warm_up_length(np.repeat(means, 5)) == cut
