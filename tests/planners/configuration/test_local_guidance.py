"""Local guidance: short paths round each other before each step."""

from itertools import pairwise

import numpy as np
import pytest
from worlds import graph_of, problem_on, random_grid

from mrp_sumo.core.plan import Status
from mrp_sumo.errors import PlanError
from mrp_sumo.traffic.referee import judge
from planners.configuration._flow import STEP
from planners.configuration._local_guidance import COLLISION, SEARCH, guide_locally
from planners.configuration.guides import local_guidance
from planners.configuration.lacam import Lacam
from planners.configuration.pibt import Pibt
from planners.world import ByConfigurations, build_world

WINDOW = 4


@pytest.fixture(scope="module", autouse=True)
def compiled():
    Lacam().prepare()
    Pibt().prepare()


def ladder(length):
    """Two corridors side by side, joined at each cell: vertices 0 to length - 1, and length further the other side's."""
    along = [(i, i + 1) for i in range(length - 1)]
    pairs = along + [(a + length, b + length) for a, b in along] + [(i, i + length) for i in range(length)]
    return graph_of([[i % length, i // length] for i in range(2 * length)], pairs)


class Guided:
    """Robots led step by step, or put elsewhere."""

    def __init__(self, problem, **rules):
        self.world = build_world(problem, np.inf, packed=False, rules=ByConfigurations(**rules))[0]
        self.local, self.num_robots = local_guidance(self.world, WINDOW), problem.num_robots
        self.onward = np.full(self.num_robots, -1)
        self.rng = np.random.default_rng(0)

    def next(self, here):
        order = np.arange(self.num_robots, dtype=np.int32)
        guide_locally(self.world, self.local, self.onward, np.array(here, np.int32), order, self.rng)
        return self.onward.tolist()

    @property
    def num_searches(self):
        return int(self.local.count[SEARCH])


@pytest.mark.kernel
def test_robots_that_meet_are_led_past_each_other():
    guided = Guided(problem_on(ladder(6), [0, 5], [5, 0]))
    here, steps = [0, 5], 0
    while here != [5, 0]:
        onward = guided.next(here)
        assert onward[0] != onward[1]
        assert onward != here[::-1]
        here, steps = onward, steps + 1
    assert steps == 7  # one of them goes round, two steps longer than straight on


@pytest.mark.kernel
def test_robots_apart_search_once():
    guided = Guided(problem_on(ladder(40), [0, 79], [30, 50]))
    here = [0, 79]
    for _ in range(20):
        here = guided.next(here)
    assert guided.num_searches == 2
    assert here == [20, 59]


@pytest.mark.kernel
def test_what_is_counted_is_the_paths_that_there_are_wherever_robots_were_put():
    problem = random_grid(6, 12, 0)
    guided, rng = Guided(problem), np.random.default_rng(1)
    here = np.array(problem.start)
    for n in range(20):
        here = rng.permutation(problem.graph.num_vertices)[:12] if n % 4 == 3 else np.array(guided.onward if n else here)
        guided.next(here)
        local, now = guided.local, guided.local.count[0]
        slots = np.arange(now, now + WINDOW + 1) % local.path.shape[1]
        assert (local.path[:, slots[0]] == here).all()
        expected = np.zeros(local.num_at.shape, int)
        for slot in slots:
            np.add.at(expected[slot], local.path[:, slot], 1)
        assert (local.num_at == expected).all()
        moves = sum(int((local.path[:, a] != local.path[:, b]).sum()) for a, b in pairwise(slots))
        assert local.num_on[slots[1:]].sum() == moves


def test_a_robot_at_its_goal_makes_way_where_that_costs_less_than_a_collision():
    assert COLLISION > 2 * STEP
    guided = Guided(problem_on(graph_of([[0, 0], [1, 0], [2, 0], [1, 1]], [(0, 1), (1, 2), (1, 3)]), [0, 1], [2, 1]))
    assert guided.next([0, 1]) == [1, 3]


@pytest.mark.parametrize("planner", [Lacam, Pibt])
def test_local_guidance_lowers_the_cost_of_crowds(planner):
    cost = {0: 0.0, 14: 0.0}
    for seed in range(3):
        problem = random_grid(16, 90, seed, blocked=0.1)
        for local in cost:
            result = planner(local=local, **({"polish": 0} if planner is Lacam else {})).plan(problem, 20.0)
            assert result.status is Status.SOLVED
            assert judge(problem, result.plan).valid
            cost[local] += result.stats["cost"]
    assert cost[14] < 0.95 * cost[0]


@pytest.mark.parametrize("planner", [Lacam, Pibt])
def test_longer_windows_than_tables_have_room_for_are_refused(planner):
    with pytest.raises(PlanError, match=r"local is 127, expected 0 to 126"):
        planner(local=127)
