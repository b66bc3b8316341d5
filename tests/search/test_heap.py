"""Heaps in flat arrays give keys back as those of the standard library do."""

import heapq

import numpy as np
import pytest

from mrp_sumo.search._heap import pop, pop_by, push, push_by


@pytest.mark.parametrize("seed", range(4))
def test_the_smallest_key_comes_first_whatever_is_pushed_in_between(seed):
    rng, keys, entries, heap = np.random.default_rng(seed), np.zeros(64, np.int64), np.zeros(64, np.int64), np.zeros(64, np.int64)
    truth = []
    for key in rng.permutation(1000)[:200].tolist():
        while len(truth) == 64 or (truth and rng.random() < 0.4):
            least, num = heapq.heappop(truth), len(truth) + 1
            assert pop(heap, num) == least and pop_by(keys, entries, num) == least + 7
        push(heap, len(truth), key)
        push_by(keys, entries, len(truth), key, key + 7)
        heapq.heappush(truth, key)
