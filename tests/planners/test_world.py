"""The arrays that PIBT, LaCAM and LNS2 plan on."""

from dataclasses import replace

import numpy as np
import pytest
from worlds import problem_on, random_grid

from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.search.distance import UNREACHABLE, Distances, distances, steps_to_targets
from planners.configuration._pibt_instance import UNKNOWN, read_code
from planners.configuration.pibt import Pibt
from planners.world import build_world, is_large, tiled


@pytest.fixture(scope="module", autouse=True)
def compiled():
    Pibt().prepare()


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("vast", [False, True])
def test_packed_distances_tell_which_neighbour_is_nearer(seed, vast, monkeypatch):
    monkeypatch.setattr("planners.world.is_vast", lambda problem: vast)
    problem = random_grid(24, 6, seed)
    world, steps = build_world(problem, np.inf, packed=True)
    table, plain_steps = build_world(problem, np.inf, packed=False)
    assert (steps == plain_steps).all()
    graph = problem.graph
    for robot in range(6):
        known = np.array([read_code(world.compass.code, robot, v) for v in range(graph.num_vertices)])
        inside = known != UNKNOWN
        assert inside[problem.start[robot]]
        assert (known[inside] == table.table[robot][inside] % 3 + 1).all()  # nobody is far enough from its goal for a band
        assert vast or (inside == (table.table[robot] < UNREACHABLE)).all()


def test_far_from_its_goal_a_robot_knows_a_band_about_the_line(monkeypatch):
    monkeypatch.setattr("planners.world.is_vast", lambda problem: True)
    free = np.ones((90, 90), np.bool_)
    problem = problem_on(grid_graph(free, 1.0, (0.0, 0.0)), [0, 89], [8099, 0])  # from corner to corner, and along a side
    world, steps = build_world(problem, np.inf, packed=True)
    known = np.array([[read_code(world.compass.code, robot, v) for v in range(8100)] for robot in range(2)]) != UNKNOWN
    assert steps.tolist() == [178, 89]
    off = np.array([45 * 90 + 45, 0 * 90 + 45, 89, 30 * 90])  # the middle, the middle of the lower side, a corner, 30 up on the left
    assert known[0][off].tolist() == [True, False, False, False] and known[1][off].tolist() == [False, True, True, False]


def test_round_a_wall_the_band_is_not_enough(monkeypatch):
    monkeypatch.setattr("planners.world.is_vast", lambda problem: True)
    free = np.ones((60, 60), np.bool_)
    free[:50, 30] = False
    problem = problem_on(grid_graph(free, 1.0, (0.0, 0.0)), [0], [58])  # along the lower side
    assert build_world(problem, np.inf, packed=True)[1].tolist() == [159]


def test_who_plans_again_and_again_keeps_tables_for_longer(monkeypatch):
    monkeypatch.setattr("planners.world.TABLE_CELLS", 0)
    problem = random_grid(8, 4, 0)
    assert is_large(problem) and not is_large(replace(problem, window_steps=10))


def test_tiles_only_change_the_numbers():
    problem = random_grid(40, 5, 0)
    other, original = tiled(problem)
    assert (original[other.start] == problem.start).all() and (original[other.target] == problem.target).all()
    graph, renumbered = problem.graph, other.graph
    lanes = set(zip(graph.tail.tolist(), graph.head.tolist(), strict=True))
    assert set(zip(original[renumbered.tail].tolist(), original[renumbered.head].tolist(), strict=True)) == lanes
    assert (renumbered.head[renumbered.reverse] == renumbered.tail).all()
    assert (renumbered.xy == graph.xy[original]).all()


@pytest.mark.parametrize("size", [8, 200])  # of the larger one not all tables are made at once
def test_tables_are_shared_with_others_on_the_graph(size):
    problem = random_grid(size, 120 if size == 200 else 4, 0)
    table, goal = steps_to_targets(problem), int(problem.target[2])
    assert (table[2] == distances(problem.graph).to(goal)).all()
    assert (table[2] == Distances(problem.graph.first, problem.graph.head).to(goal)).all()
    with pytest.raises(TimeoutError):
        build_world(problem, -np.inf, packed=False)
