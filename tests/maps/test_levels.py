"""Levels on one plane, in as many columns as show them largest on a screen."""

import numpy as np
import pytest

from mrp_sumo.core.graph import nav_graph
from mrp_sumo.maps.levels import LEVEL_GAP_M, laid_out


def storeys(*sizes):
    """A graph with a diagonal lane on each level, of these widths and heights."""
    xy = [corner for width, height in sizes for corner in ((0.3, 0.3), (0.3 + width, 0.3 + height))]
    lanes = [(2 * k, 2 * k + 1) for k in range(len(sizes))]
    names = tuple(f"L{k}" for k in range(len(sizes)))
    return nav_graph(name="tower", xy=xy, lanes=lanes, level_names=names, level=[k // 2 for k in range(2 * len(sizes))])


@pytest.mark.parametrize(
    ("size", "num_levels", "columns"),
    [
        ((60, 10), 3, 1),  # wide storeys lie one below the other
        ((10, 60), 3, 3),  # deep ones beside each other
        ((30, 14), 3, 2),  # 74 m by 40 m, where one column is 60 m high and a row 108 m wide
        ((30, 20), 4, 2),
    ],
)
def test_levels_lie_in_as_many_columns_as_show_them_largest(size, num_levels, columns):
    shift = list(laid_out(storeys(*[size] * num_levels), None).values())
    assert len({x for x, _ in shift}) == columns
    assert shift[0] == (0.0, 0.0)
    assert all(y <= 0 for _, y in shift)


def test_levels_of_any_sizes_are_a_gap_apart():
    graph = storeys((7.7, 3.1), (21.4, 9.9), (0.4, 33.3), (12.0, 12.0), (5.5, 1.2))
    by = np.array(list(laid_out(graph, None).values()))
    low, high = graph.xy[::2] + by, graph.xy[1::2] + by
    for i in range(5):
        for j in range(i):
            apart = np.maximum(low[i] - high[j], low[j] - high[i])
            assert apart.max() >= LEVEL_GAP_M - 1e-9
    assert (by == np.round(by)).all()
