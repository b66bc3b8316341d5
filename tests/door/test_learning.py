"""The environment for policies that learn: PettingZoo's own tests, and that whatever policies do is a valid solution."""

import sys

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test
from step_wise_worlds import ROUND, problem_of, write_problem

import mrp_sumo as ms
from mrp_sumo.core.step_wise import FORWARD, WAIT
from mrp_sumo.door.environment import StepWiseEnv, safe
from mrp_sumo.planning.step_wise import StepWiseWorld
from mrp_sumo.traffic.step_wise_referee import judge_step_wise


def on_kiva():
    return ms.parallel_env("kiva", robots=5, steps=40, view=2)


@pytest.mark.filterwarnings("error")
def test_pettingzoo_finds_that_it_conforms(tmp_path):
    parallel_api_test(on_kiva(), num_cycles=50)
    parallel_api_test(ms.parallel_env(write_problem(tmp_path, ROUND, [0, 8], [[2], [6, 0]]), steps=9), num_cycles=20)


def test_pettingzoo_finds_that_a_seed_says_all():
    parallel_seed_test(on_kiva, num_cycles=40)


def test_whatever_agents_do_is_a_valid_solution_and_each_errand_is_rewarded_once():
    env = StepWiseEnv(
        problem_of(ROUND, [0, 1, 2, 5, 8, 7], [[k] for k in (2, 5, 8, 7, 6, 3, 0, 1)], 9), 300, 1, drawn=False, render_mode="ansi"
    )
    rng, reward = np.random.default_rng(3), 0.0
    seen, _ = env.reset()
    while env.agents:
        assert all(env.observation_space(agent).contains(seen[agent]) for agent in env.possible_agents)
        seen, rewards, _, truncated, infos = env.step({agent: int(rng.integers(4)) for agent in env.agents})
        reward += sum(rewards.values())
    verdict = judge_step_wise(env.problem, env.solution)
    assert verdict.valid and verdict.errands_done == reward > 0
    assert all(truncated.values()) and infos["robot_0"]["tasks_done"] == verdict.tasks_done
    assert sorted(env.render().replace("\n", "").replace(".", "")) != [] and env.render().count("@") == 1


def test_an_agent_sees_walls_robots_and_its_errand_north_up():
    env = StepWiseEnv(problem_of(("...", ".@.", "..."), [3, 8], [[0], [2]], 2), 5, 1, drawn=False)
    seen, _ = env.reset()
    assert seen["robot_0"]["view"].tolist() == [
        [[1, 0, 0], [1, 0, 1], [1, 0, 0]],  # off the map is blocked
        [[0, 0, 0], [0, 0, 0], [0, 0, 0]],
        [[0, 1, 0], [0, 0, 0], [0, 0, 0]],
    ]
    assert seen["robot_0"]["errand"] == pytest.approx([-1 / 3, 0]) and seen["robot_0"]["heading"] == 0
    assert seen["robot_1"]["errand"] == pytest.approx([-2 / 3, 0]) and not seen["robot_1"]["view"][2].any()  # out of sight


def test_moves_that_collide_become_waits_and_rows_of_robots_follow():
    world = StepWiseWorld(problem_of((".....",), [0, 1, 2], [[4]]))
    assert safe(world, np.array([FORWARD] * 3, np.int8)).tolist() == [FORWARD] * 3
    assert safe(world, np.array([FORWARD, FORWARD, WAIT], np.int8)).tolist() == [WAIT] * 3  # the last one holds up all
    world.heading[:] = [0, 2, 0]
    assert safe(world, np.array([FORWARD, FORWARD, WAIT], np.int8)).tolist() == [WAIT] * 3  # they would change places
    world = StepWiseWorld(problem_of(("...",), [0, 2], [[1]]))
    world.heading[:] = [0, 2]
    assert safe(world, np.array([FORWARD, FORWARD], np.int8)).tolist() == [FORWARD, WAIT]  # the first gets the cell


def test_what_is_missing_or_does_not_fit_is_one_line(monkeypatch):
    with pytest.raises(ms.MrpSumoError, match="parallel_env: robots is 5000, expected 1 to 12"):
        ms.parallel_env("kiva", robots=5000)
    monkeypatch.setitem(sys.modules, "pettingzoo", None)
    monkeypatch.delitem(sys.modules, "mrp_sumo.door.environment")
    with pytest.raises(ms.MrpSumoError, match=r"needs PettingZoo.*pip install 'mrp-sumo\[rl\]'"):
        ms.parallel_env("kiva", robots=5)
