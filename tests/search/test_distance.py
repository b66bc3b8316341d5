"""Distance tables and cost matrices on graphs small enough to count by hand."""

import numpy as np
import pytest

from mrp_sumo.core.graph import nav_graph
from mrp_sumo.errors import ScenarioError
from mrp_sumo.planning.costs import cost_matrix
from mrp_sumo.search.distance import UNREACHABLE, Distances, distances

pytestmark = pytest.mark.kernel


def one_way_ring():
    return nav_graph(name="ring", xy=[(0, 0), (1, 0), (1, 1), (0, 1), (5, 5)], lanes=[(0, 1), (1, 2), (2, 3), (3, 0)])


def test_distance_follows_the_lanes_direction():
    table = distances(one_way_ring()).to(0)
    assert table[:4].tolist() == [0, 3, 2, 1]
    assert table[4] == UNREACHABLE


def test_tables_of_known_and_new_goals_are_the_same():
    ring = one_way_ring()
    tables = Distances(ring.first, ring.head)
    tables.to(2)
    assert np.array_equal(tables.to_all(np.array([3, 2, 3, 0])), [Distances(ring.first, ring.head).to(g) for g in (3, 2, 3, 0)])


def test_graph_shares_its_tables():
    ring = one_way_ring()
    assert distances(ring) is distances(ring)
    assert distances(ring).to(1) is not None
    assert not distances(ring).to(1).flags.writeable


@pytest.mark.parametrize(("kind", "expected"), [("path", 3), ("euclidean", np.sqrt(2)), ("manhattan", 2)])
def test_cost_by_kind(kind, expected):
    ring = nav_graph(name="ring", xy=[(0, 0), (1, 0), (1, 1), (0, 2)], lanes=[(0, 1), (1, 3), (3, 2), (2, 0)])
    assert cost_matrix(ring, np.array([0]), np.array([2]), kind) == pytest.approx(expected)


def test_unreachable_costs_inf_whatever_the_kind():
    for kind in ("path", "euclidean", "manhattan"):
        assert np.isinf(cost_matrix(one_way_ring(), np.array([0]), np.array([4]), kind)).all()


def test_costs_are_given_up_between_goals_when_the_clock_says_so():
    ring = nav_graph(name="ring", xy=[(0, k) for k in range(40)], lanes=[(k, (k + 1) % 40) for k in range(40)])
    looks = []

    def check_clock():
        looks.append(len(distances(ring)._table))
        if len(looks) == 3:
            raise TimeoutError

    with pytest.raises(TimeoutError):
        cost_matrix(ring, np.array([0]), np.arange(40), "path", check_clock)
    assert looks == [0, 8, 16]
    assert cost_matrix(ring, np.array([0, 3]), np.arange(40), "path").tolist() == [list(range(40)), [*range(37, 40), *range(37)]]


def test_unknown_cost_names_the_nearest():
    with pytest.raises(ScenarioError, match="did you mean 'manhattan'"):
        cost_matrix(one_way_ring(), np.array([0]), np.array([1]), "manhatan")
