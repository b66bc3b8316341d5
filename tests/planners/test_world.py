"""The arrays that PIBT, LaCAM and LNS2 plan on."""

import numpy as np
import pytest
from worlds import random_grid

from mrp_sumo.search.distance import distances
from planners._compass import UNKNOWN, read_code
from planners._world import build_world, steps_table, tiled
from planners.configuration.pibt import Pibt


@pytest.fixture(scope="module", autouse=True)
def compiled():
    Pibt().prepare()


@pytest.mark.parametrize("seed", range(5))
def test_packed_distances_tell_which_neighbour_is_nearer(seed):
    problem = random_grid(24, 6, seed)
    world, steps = build_world(problem, np.inf, packed=True)
    table, plain_steps = build_world(problem, np.inf, packed=False)
    assert (steps == plain_steps).all()
    graph = problem.graph
    for robot in range(6):
        known = np.array([read_code(world.code, robot, v) for v in range(graph.num_vertices)])
        inside = known != UNKNOWN
        assert inside[problem.start[robot]]
        assert (known[inside] == table.table[robot][inside] % 3).all()


def test_tiles_only_change_the_numbers():
    problem = random_grid(40, 5, 0)
    other, original = tiled(problem)
    assert (original[other.start] == problem.start).all() and (original[other.target] == problem.target).all()
    graph, renumbered = problem.graph, other.graph
    lanes = set(zip(graph.tail.tolist(), graph.head.tolist(), strict=True))
    assert set(zip(original[renumbered.tail].tolist(), original[renumbered.head].tolist(), strict=True)) == lanes
    assert (renumbered.head[renumbered.reverse] == renumbered.tail).all()
    assert (renumbered.xy == graph.xy[original]).all()


def test_tables_are_shared_with_others_on_the_graph():
    problem = random_grid(8, 4, 0)
    assert (steps_table(problem, np.inf)[2] == distances(problem.graph).to(int(problem.target[2]))).all()
    assert steps_table(problem, -np.inf) is None
