"""Tables over rows and steps: hashed ones hold what whole ones do."""

import numpy as np
import pytest
from worlds import random_grid

from planners.neighbourhood import _traffic
from planners.neighbourhood.lns2 import Lns2


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
    assert truth and np.count_nonzero(cells.key) == len(truth)
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
