"""Constraints forbid what their rows say, and nothing beside it."""

from itertools import product

import numpy as np
from truth import ROBOT

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.problem import Problem
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.search import _records as st
from mrp_sumo.search._constraints import forbidden, load
from planners.conflict_based.tree import SearchLimits, Tree


def test_a_vertex_is_forbidden_for_a_time_a_lane_from_one_side_and_all_but_a_vertex_where_it_has_to_be():
    """In a row of four: not at 1 in steps 2 and 3, not from 2 to 1 in step 5, and at 2 in step 7."""
    problem = Problem(grid_graph(np.ones((1, 4), bool), 1.0, (0.0, 0.0)), fleet_of(ROBOT, 1), *np.array([[0], [3], [0]]), 1.0)
    tree = Tree(problem, SearchLimits(np.inf, 4000))
    tree.root(1.0)
    store, scratch = tree._buffers.store, tree._buffers.scratch
    begin = store.used[st.ROWS]
    assert st.add_row(store, st.RANGE, 1, -1, 2, 3) and st.add_row(store, st.EDGE, 1, 2, 5, 5) and st.add_row(store, st.MUST, 2, -1, 7, 7)
    record = st.add_record(store, -1, 0, begin, store.used[st.ROWS])
    assert load(tree.instance, store, scratch, record) == st.OK
    result = [(u, v, t) for u, v, t in product(range(4), range(4), range(9)) if abs(u - v) <= 1 and forbidden(scratch, u, v, t)]
    expected = {(u, 1, t) for u in (0, 1, 2) for t in (2, 3)} | {(2, 1, 5)}
    assert set(result) == expected | {(u, v, 7) for u, v in product(range(4), (0, 1, 3)) if abs(u - v) <= 1}
