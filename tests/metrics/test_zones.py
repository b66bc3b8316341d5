"""How occupied zones are, counted by hand on a short line."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import record_of_four

from mrp_sumo.metrics import zones
from mrp_sumo.metrics.metric import Evidence
from mrp_sumo.metrics.zones import occupancy


@pytest.mark.parametrize(("period_s", "together"), [(0.5, 4096), (0.5, 4), (1.0, 4), (0.25, 1)])
def test_zones_count_the_looks_at_which_robots_are_there(monkeypatch, period_s, together):
    monkeypatch.setattr(zones, "TOGETHER", together)
    record = record_of_four()
    execution, graph = record.execution, record.graph
    t_s = np.arange(0, 10 + period_s, period_s)  # 11 looks, a second apart
    at = np.where(t_s < 4, 0, graph.num_vertices - 1)  # robot 0 at the first vertex for 4 looks, then at the last
    x, y = np.tile(graph.xy[-1, 0], (len(t_s), 2)), np.tile(graph.xy[-1, 1], (len(t_s), 2))
    x[:, 0], y[:, 0] = graph.xy[at].T
    x[-1, 1] = np.nan  # robot 1 always at the last, but off the floor at the end
    result = occupancy(replace(execution, t_s=t_s, x_m=x, y_m=y), graph, record.nav or graph)
    order = np.argsort(result.occupied_share)[::-1]
    assert list(order) == list(range(len(result.name))) and len(result.name) == 2
    assert result.occupied_share == pytest.approx([1.0, 4 / 11]) and result.robots_mean == pytest.approx([17 / 11, 4 / 11])
    assert result.robots_max.tolist() == [2, 1]


@pytest.mark.parametrize(("num_samples", "period_s", "looks"), [(1, 1.0, 1), (2, 1.0, 2), (2, 0.5, 1), (3, 0.5, 2)])
def test_robots_are_looked_at_once_a_second_however_few_samples_there_are(num_samples, period_s, looks):
    record = record_of_four()
    execution, graph = record.execution, record.graph
    x = np.tile(graph.xy[-1, 0], (num_samples, 1))
    x[0] = graph.xy[0, 0]
    one = replace(execution, t_s=np.arange(num_samples) * period_s, x_m=x, y_m=np.full_like(x, graph.xy[0, 1]))
    assert occupancy(one, graph, record.nav or graph).occupied_share.tolist() == [1 / looks] * looks


def test_one_look_is_enough():
    record = record_of_four()
    execution, graph = record.execution, record.graph
    first = replace(execution, t_s=execution.t_s[:1], x_m=execution.x_m[:1], y_m=execution.y_m[:1])
    seen = occupancy(first, graph, record.nav or graph)
    assert seen.occupied_share.tolist() == [1.0] and seen.robots_max.tolist() == [4]
    metrics = [metric(Evidence(None, None, None, None, zones=seen)) for metric in zones.METRICS]
    assert metrics == [1.0, 4.0, 4]
    nowhere = replace(seen, name=(), kind=(), occupied_share=np.zeros(0), robots_mean=np.zeros(0), robots_max=np.zeros(0))
    assert {metric(Evidence(None, None, None, None, zones=each)) for metric in zones.METRICS for each in (None, nowhere)} == {None}
