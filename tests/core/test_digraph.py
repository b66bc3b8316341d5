"""Components and cycles of small digraphs, against scipy and known by hand."""

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from mrp_sumo.core.digraph import has_cycle, strong_components, weak_components


@pytest.mark.parametrize("seed", range(200))
def test_components_are_those_of_scipy_and_numbered_alike(seed):
    rng = np.random.default_rng(seed)
    size = int(rng.integers(1, 30))
    tail, head = rng.integers(0, size, (2, rng.integers(0, 60)))
    if seed % 2:  # no arc is one-way
        tail, head = np.append(tail, head), np.append(head, tail)
    arcs = coo_array((np.ones(len(tail)), (tail, head)), shape=(size, size))
    strong = connected_components(arcs, connection="strong")[1]
    assert weak_components(size, tail, head).tolist() == connected_components(arcs, directed=False)[1].tolist()
    assert strong_components(size, tail, head).tolist() == strong.tolist()
    assert has_cycle(size, tail, head) == (strong.max() + 1 < size or bool((tail == head).any()))


def test_long_chain_is_one_component_without_a_cycle():
    node = np.arange(1000)
    chain = np.random.default_rng(0).permutation(node)
    assert not has_cycle(1000, chain[:-1], chain[1:])
    assert has_cycle(1000, chain, np.roll(chain, 1))
    assert not weak_components(1000, chain[:-1], chain[1:]).any()


def test_graph_without_nodes_has_nothing():
    none = np.zeros(0, np.int64)
    assert not has_cycle(0, none, none) and not len(weak_components(0, none, none)) and not len(strong_components(0, none, none))
