"""The warm-up is found where the beginning differs from the rest, and nowhere else."""

import numpy as np

from mrp_sumo.metrics.warm_up import warm_up_length


def test_the_error_of_what_is_left_is_least():
    series = np.concatenate([np.full(13, 0.0), np.tile([4.0, 6.0, 5.0, 5.0, 5.0], 12)])
    assert warm_up_length(series) == 15  # whole batches of five


def test_half_of_a_series_is_too_much_to_leave_out():
    assert warm_up_length(np.concatenate([np.zeros(30), np.full(30, 9.0)])) is None
    assert warm_up_length(np.ones(19)) is None
    assert warm_up_length(np.ones(20)) == 0
