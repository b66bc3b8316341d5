"""Points near each other, against scipy's trees."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist

from mrp_sumo.core.near import least_distance_m, pairs_within


@pytest.mark.parametrize("seed", range(100))
def test_pairs_are_those_of_a_tree(seed):
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-5, 5, (rng.integers(1, 60), 2)).round(seed % 3)  # rounded: many lie on the edges of cells
    distance_m = float(rng.choice([0.1, 0.5, 1.0, 20.0]))
    expected = cKDTree(xy).query_pairs(distance_m, output_type="ndarray")
    assert sorted(pairs_within(xy, distance_m).tolist()) == sorted(np.sort(expected, axis=1).tolist())


@pytest.mark.parametrize("seed", range(60))
def test_least_distance_is_the_same_number_to_the_last_bit(seed):
    rng = np.random.default_rng(seed)
    xy = rng.uniform(-5, 5, (rng.integers(2, 200), 2))
    xy[:, 0] = xy[:, 0].round(seed % 3)  # rounded: many lie in one column
    assert least_distance_m(xy) == pdist(xy).min() == cKDTree(xy).query(xy, k=2)[0][:, 1].min()


def test_fewer_than_two_points_have_no_pairs():
    for count in (0, 1):
        assert not len(pairs_within(np.zeros((count, 2)), 1.0)) and least_distance_m(np.zeros((count, 2))) == np.inf
