"""How occupied zones are, counted by hand on a short line."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import record_of_four

from mrp_sumo.metrics.zones import occupancy


def test_zones_count_the_looks_at_which_robots_are_there():
    record = record_of_four()
    execution, graph = record.execution, record.graph
    t_s = np.arange(0, 10.5, 0.5)  # 11 looks, a second apart
    at = np.where(t_s < 4, 0, graph.num_vertices - 1)  # robot 0 at the first vertex for 4 looks, then at the last
    x, y = np.tile(graph.xy[-1, 0], (len(t_s), 2)), np.tile(graph.xy[-1, 1], (len(t_s), 2))
    x[:, 0], y[:, 0] = graph.xy[at].T
    x[-1, 1] = np.nan  # robot 1 always at the last, but off the floor at the end
    found = occupancy(replace(execution, t_s=t_s, x_m=x, y_m=y), graph, record.nav or graph)
    order = np.argsort(found.occupied_share)[::-1]
    assert list(order) == list(range(len(found.name))) and len(found.name) == 2
    assert found.occupied_share == pytest.approx([1.0, 4 / 11]) and found.robots_mean == pytest.approx([17 / 11, 4 / 11])
    assert found.robots_max.tolist() == [2, 1]
