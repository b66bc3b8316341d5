"""Tables over rows and steps: hashed ones hold what whole ones do."""

import numpy as np
import pytest
from worlds import problem_on, random_grid

from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.search.distance import distances
from planners.neighbourhood import _sipps, _traffic
from planners.neighbourhood._neighbourhoods import find_collisions, room_for_hood
from planners.neighbourhood.lns2 import Lns2
from planners.neighbourhood.refinement import task_of


@pytest.fixture
def sparse(monkeypatch):
    monkeypatch.setattr(_traffic, "MOST_CELLS", 0)


@pytest.mark.kernel
def test_hashed_cells_count_as_a_dictionary_does(sparse):
    rng = np.random.default_rng(5)
    cells, truth = _traffic.no_holders(50, 40, 60), {}
    for robot in range(1500):
        row, t = int(rng.integers(50)), int(rng.integers(40))
        if len(truth) < 60 and (truth.get((row, t), 0) == 0 or rng.random() < 0.5):
            k = _traffic.enter(cells, row, t)
            cells.who[k] = robot % 1000
            truth[row, t] = truth.get((row, t), 0) + 1
        if truth and rng.random() < 0.6:
            row, t = list(truth)[int(rng.integers(len(truth)))]
            truth[row, t] -= 1
            assert _traffic.leave(cells, row, t) == truth[row, t]
            if truth[row, t] == 0:
                del truth[row, t]
    assert truth and np.count_nonzero(cells.key) == len(truth) == cells.used[1] and cells.used[0] > _traffic.FEWEST_SLOTS
    for row in range(50):
        for t in range(40):
            assert _traffic.num_in(cells, row, t) == truth.get((row, t), 0)
            assert (_traffic.anyone_in(cells, row, t) >= 0) == ((row, t) in truth)


@pytest.mark.parametrize("following", [False, True])
def test_plans_are_the_same_with_hashed_tables(following, request):
    problem = random_grid(12, 40, 3, blocked=0.1)
    lns2 = Lns2(following=following, rotations=False)
    lns2.prepare()
    whole = lns2.plan(problem, 60.0)
    request.getfixturevalue("sparse")
    hashed = lns2.plan(problem, 60.0)
    assert whole.plan is not None and hashed.stats["cost"] == whole.stats["cost"]
    assert np.array_equal(whole.plan.vertex, hashed.plan.vertex) and np.array_equal(whole.plan.arrive_s, hashed.plan.arrive_s)


def shortest_paths(task, table):
    """[T, R] of robots that look out for nobody."""
    path = [task.start]
    while (path[-1] != task.goal).any():
        at = path[-1]
        nearest = [min([v, *task.head[task.first[v] : task.first[v + 1]]], key=lambda u, r=r: table[r, u]) for r, v in enumerate(at)]
        path.append(np.array(nearest))
    return np.array(path, np.int32)


def counted(traffic):
    """Robots in each cell, the bits of those that anybody is in, and pairs in collision."""
    horizon, num_vertices = traffic.at.shape[1], len(traffic.busy)
    num = [[_traffic.num_in(traffic.on, v, t) for t in range(horizon)] for v in range(num_vertices)]
    anyone = [[_traffic.anyone_in(traffic.on, v, t) >= 0 for t in range(horizon)] for v in range(num_vertices)]
    hood = room_for_hood(traffic.task, horizon, 2, with_hits=True)
    return num, anyone, traffic.busy.tolist(), traffic.along.tolist(), find_collisions(traffic, hood), hood.hit.tolist()


@pytest.mark.kernel
@pytest.mark.parametrize("following", [False, True])
def test_robots_that_stay_are_one_entry_and_count_as_if_they_were_many(following, request):
    problem = random_grid(6, 12, 4, blocked=0.1)
    table = distances(problem.graph).to_all(problem.target)
    task = task_of(problem, table, following=following)
    path = shortest_paths(task, table)
    whole = _traffic.traffic_of(task, path, 4)
    request.getfixturevalue("sparse")
    hashed = _traffic.traffic_of(task, path, 4)
    assert np.count_nonzero(hashed.on.key) <= (1 + following) * whole.end.sum() < np.count_nonzero(whole.on.num)
    for robot in range(problem.num_robots):
        truth = counted(whole)
        assert counted(hashed) == truth
        assert robot > 0 or truth[-2] > 0
        for traffic in (whole, hashed):
            _traffic.remove_path(traffic, robot)
            traffic.end[robot] = -1
    assert not hashed.busy.any() and not hashed.on.key.any()


@pytest.mark.kernel
@pytest.mark.parametrize("crossing", [False, True])
def test_search_that_makes_more_labels_than_were_thought_goes_on(crossing):
    """A wall of robots that stand for good, whose end only one who searches finds."""
    side = 300
    graph = grid_graph(np.ones((side, side), bool), 1.0, (0.0, 0.0))
    wall = [side // 2 + side * y for y in range(side - 1)]
    start, goal = np.array([side // 4, *wall]), np.array([3 * side // 4, *wall])
    steps = np.zeros((len(start), graph.num_vertices), np.int32)
    steps[0] = distances(graph).to_all(goal[:1])[0]
    shortest = side // 2 + 2 * (side - 1)
    traffic = _traffic.empty_traffic(task_of(problem_on(graph, start, goal), steps), 32 * (shortest // 32 + 2))
    labels = _sipps.room_for_labels(graph.num_vertices, graph.num_lanes, traffic.at.shape[1], cells=0)
    for robot in range(1, len(start)):
        traffic.at[robot], traffic.end[robot] = start[robot], 0
        _traffic.add_path(traffic, robot)
    assert _sipps.plan_one(traffic, labels, 0, traffic.at.shape[1] - 2, crossing) == shortest
    assert labels.count[0] > _sipps.FEW_LABELS
    assert not set(traffic.at[0].tolist()) & set(wall)
