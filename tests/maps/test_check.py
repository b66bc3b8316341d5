"""Findings about graphs, on small drawings."""

import numpy as np
import pytest

from mrp_sumo.core.graph import nav_graph
from mrp_sumo.maps.boxes import overlapping
from mrp_sumo.maps.check import check_graph, crossings, near_misses


def test_a_stub_that_ends_beside_a_corridor_is_a_near_miss():
    xy = np.array([[0, 0], [10, 0], [5, 0.1], [5, 3]], float)
    vertex, lane, away, along = near_misses(xy, np.array([[0, 1], [2, 3]]), 0.15)
    assert (vertex.tolist(), lane.tolist(), away.tolist(), along.tolist()) == ([2], [0], [0.1], [5.0])


def test_vertices_near_the_ends_of_a_lane_are_no_near_misses():
    xy = np.array([[0, 0], [10, 0], [9.9, 0.1], [5, 3]], float)
    assert not len(near_misses(xy, np.array([[0, 1], [2, 3]]), 0.15)[0])


def test_lanes_cross_only_without_a_common_vertex():
    xy = np.array([[0, 0], [2, 2], [0, 2], [2, 0]], float)
    i, j, at = crossings(xy, np.array([[0, 1], [2, 3], [1, 2]]))
    assert (i.tolist(), j.tolist(), at.tolist()) == ([0], [1], [[1.0, 1.0]])


def test_overlapping_boxes_are_those_of_brute_force():
    rng = np.random.default_rng(1)
    low = rng.uniform(0, 100, (400, 2))
    boxes = np.concatenate([low, low + rng.exponential(3, (400, 2))], axis=1)
    i, j = overlapping(boxes[:150], boxes[150:])
    a, b = boxes[:150, None], boxes[None, 150:]
    brute = (a[..., 0] <= b[..., 2]) & (b[..., 0] <= a[..., 2]) & (a[..., 1] <= b[..., 3]) & (b[..., 1] <= a[..., 3])
    assert np.stack([i, j], axis=1).tolist() == np.argwhere(brute).tolist()


@pytest.mark.parametrize(("limit_mps", "is_slow"), [(0.019, True), (0.02, False)])
def test_a_lane_on_which_a_metre_takes_a_minute_is_a_finding_that_names_its_direction(limit_mps, is_slow):
    nav = nav_graph(name="two", xy=[[0, 0], [5, 0]], lanes=[[0, 1], [1, 0]], speed_mps=[1.0, limit_mps])
    lines = [finding.line for finding in check_graph(nav) if finding.kind == "very_slow_lanes"]
    assert lines == [f"very slow lanes: from v1 to v0: {limit_mps} m/s: raise the limit, or leave such a direction out"] * is_slow
