"""Carrying out plans of steps in ticks, in small worlds known by hand, and on drawn ones before the referee."""

from dataclasses import replace

import numpy as np
import pytest
from step_wise_worlds import problem_of

from mrp_sumo.core.step_wise import ACTION_LETTERS, FORWARD, NOTHING, RIGHT, WAIT, DelayLaw
from mrp_sumo.planning.step_wise import Decision, run_step_wise
from mrp_sumo.planning.ticks import Delays
from mrp_sumo.traffic.step_wise_referee import judge_step_wise
from planners.step_wise.epibt import Epibt

LAW = DelayLaw(seed=1, least=2, most=5, event="bernoulli", p=0.05, duration="uniform", mean_share=0.5, std_share=0.2)


class Letters:
    """A planner that has a word for each robot, a letter a step; nobody has a task."""

    def __init__(self, *words):
        self.words = words

    def prepare(self):
        pass

    def begin(self, problem, seed):
        return self

    def step(self, seen):
        letters = [word[seen.time : seen.time + 1] or "W" for word in self.words]
        action = np.array([ACTION_LETTERS.index(letter) for letter in letters], np.int8)
        return Decision(action, np.full(len(action), NOTHING))


def driven(rows, start, words, num_ticks, ticks=3, size=1.0, delays=None):
    """What robots do, a letter a tick, after the referee has passed it."""
    problem = replace(problem_of(rows, start, [[start[0]]]), ticks=ticks, size=size, delays=delays)
    solution = run_step_wise(problem, Letters(*words), num_ticks).solution
    assert judge_step_wise(problem, solution).fault == ""
    return ["".join(ACTION_LETTERS[a] for a in row) for row in solution.action]


def test_an_action_takes_its_ticks():
    assert driven(["...."], [0], ["FRW"], 10) == ["FFFRRRWWWW"]


def test_a_run_ends_within_a_step():
    assert driven(["...."], [0], ["FF"], 4) == ["FFFF"]


def test_who_follows_sets_out_a_tick_later():
    assert driven(["....."], [0, 1], ["FF", "FF"], 8) == ["WFFFFFFW", "FFFFFFWW"]


def test_who_leaves_round_a_corner_is_gone_before_another_enters():
    """Robot 1 turns in two steps and leaves downwards; robot 0, told to enter with it, waits in the plan and asks again."""
    rows = ["...", "..."]
    assert driven(rows, [0, 1], ["WFF", "RFW"], 12) == ["WWWWWWFFFWWW", "RRRFFFWWWWWW"]


def test_a_ring_of_robots_does_not_turn():
    """Four squares of a whole cell cannot change places round the middle; what is planned becomes waits, and nobody is lost."""
    assert driven(["..", ".."], [0, 1, 3, 2], ["WWF", "RWF", "RRF", "CWF"], 15) == [
        "W" * 15,
        "RRR" + "W" * 12,
        "RRRRRR" + "W" * 9,
        "CCC" + "W" * 12,
    ]


def test_who_is_delayed_is_waited_for():
    """Robot 1 is always delayed after its first tick: robot 0 does not enter its cell, and the plan goes on without it."""
    always = DelayLaw(seed=0, least=50, most=50, event="bernoulli", p=1.0, duration="uniform", mean_share=0.5, std_share=0.2)
    assert driven(["....."], [0, 1], ["FF", "FF"], 8, delays=always) == ["W" * 8, "W" * 8]


class TestDelays:
    """Laws of delays beside their means."""

    def test_bernoulli(self):
        """A delay of 3.5 ticks, then 1 / p - 1 = 19 without in the mean: who is ready again may be hit in the same tick."""
        assert share(LAW) == pytest.approx(3.5 / (3.5 + 19), rel=0.03)

    def test_poisson(self):
        """As many begin a tick as are drawn, from those that are ready: 0.01 of all, for 3.5 ticks."""
        assert share(replace(LAW, event="poisson", p=0.01)) == pytest.approx(0.01 * 3.5, rel=0.03)

    def test_gaussian(self):
        """Half of the way from 2 to 12, hardly scattered."""
        law = replace(LAW, event="poisson", p=0.01, most=12, duration="gaussian", mean_share=0.5, std_share=0.01)
        assert share(law) == pytest.approx(0.01 * 7, rel=0.03)

    def test_without_a_law_nobody_is_delayed(self):
        assert not Delays(None, 5, 0).draw().any()

    def test_other_seeds_delay_others(self):
        one, same, other = (Delays(LAW, 500, seed).draw().tolist() for seed in (1, 1, 2))
        assert one == same != other


def share(law):
    delays = Delays(law, 1000, 3)
    return np.mean([delays.draw().mean() for _ in range(1000)][50:])


@pytest.mark.parametrize("size", [1.0, 0.5])
@pytest.mark.parametrize("seed", range(3))
def test_plans_in_ticks_pass_the_referee(seed, size):
    """A planner that knows the rules, in a crowd with many delays, where robots do 11 to 40 tasks, as they stand off for long or not."""
    rng = np.random.default_rng(seed)
    rows = ["." * 9, ".@.@.@.@.", "." * 9, "..@@@@@..", "." * 9]
    cells = np.flatnonzero(np.array([c == "." for c in "".join(rows)]))
    start = rng.permutation(cells)[:14]
    problem = problem_of(rows, start.tolist(), rng.choice(cells, (40, 3)).tolist(), num_revealed=20)
    problem = replace(problem, ticks=3, size=size, delays=LAW)
    solution = run_step_wise(problem, Epibt(), 400, seed).solution
    verdict = judge_step_wise(problem, solution)
    assert verdict.fault == "" and verdict.tasks_done == solution.num_done > 8
    assert set(np.unique(solution.action)) >= {FORWARD, RIGHT, WAIT}
