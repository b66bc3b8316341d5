"""The same questions to PIBT, LaCAM and LNS2."""

import os
import subprocess
import sys
from dataclasses import replace

import pytest
from worlds import corridor, on_a_circle, problem_on, random_grid

from mrp_sumo.core.plan import Status
from mrp_sumo.errors import PlanError
from mrp_sumo.traffic.referee import judge
from mrp_sumo.traffic.schedule import schedule_of
from planners import world
from planners.configuration.lacam import Lacam
from planners.configuration.pibt import Pibt
from planners.neighbourhood.lns2 import Lns2


@pytest.fixture(scope="module", autouse=True)
def compiled():
    for planner in (Pibt(), Lacam(), Lns2(threads=2)):
        planner.prepare()


@pytest.mark.parametrize(
    "planner", [Pibt(), Lacam(), Lacam(num_tries=3, flow=0, hindrance=False), Lacam(threads=2), Lns2(), Lns2(threads=3)]
)
@pytest.mark.parametrize("seed", range(3))
def test_crowded_grids_are_solved_and_repeat_themselves(planner, seed):
    problem = random_grid(14, 50, seed)
    one, two = planner.plan(problem, 20.0), planner.plan(problem, 20.0)
    assert one.status is Status.SOLVED, one.message
    verdict = judge(problem, one.plan)
    assert verdict.valid, verdict.summary(problem)
    assert one.lower_bound_steps <= one.plan.end_s.sum() == one.stats["cost"]
    assert (one.plan.vertex == two.plan.vertex).all() and (one.plan.arrive_s == two.plan.arrive_s).all()


@pytest.mark.parametrize("planner", [Pibt(), Lacam()])
def test_packed_distances_lead_to_the_same_plans(planner):
    problem = random_grid(40, 60, 2)
    packed, plain = planner._plan(problem, 20.0, True), planner._plan(problem, 20.0, False)
    assert judge(problem, packed.plan).valid
    assert (packed.plan.vertex == plain.plan.vertex).all() and (packed.plan.arrive_s == plain.plan.arrive_s).all()


@pytest.mark.parametrize("planner", [Pibt(), Lacam()])
@pytest.mark.parametrize("num_robots", [60, 400])
def test_distances_about_the_ways_alone_lead_to_valid_plans(planner, num_robots, monkeypatch):
    monkeypatch.setattr(world, "is_vast", lambda problem: True)
    problem = random_grid(40, num_robots, 2)
    assert judge(problem, planner._plan(problem, 20.0, True).plan).valid


STRICT = [made(**kind) for made in (Pibt, Lacam, Lns2) for kind in ({"following": True}, {"rotations": False})]


@pytest.mark.parametrize("planner", STRICT)
@pytest.mark.parametrize("seed", range(6))
def test_nobody_follows_or_no_ring_turns_where_that_is_asked(planner, seed):
    problem = random_grid(10, 15 if planner.following else 30, seed, blocked=0.0)  # PIBT soon gives up where nobody may follow
    result = planner.plan(problem, 20.0)
    assert result.status is Status.SOLVED, result.message
    verdict = judge(problem, result.plan)
    assert verdict.valid, verdict.summary(problem)
    schedule_of(problem, result.plan)  # refuses rings
    if planner.following:
        assert not verdict.following


def full_star():
    """Three robots on the three leaves of a star; whoever comes to the middle can only go back."""
    return problem_on(on_a_circle([lane for i in (1, 2, 3) for lane in ((0, i), (i, 0))], 4), [1, 2, 3], [2, 1, 3])


def test_lacam_proves_that_a_star_is_too_full_to_swap_in():
    result = Lacam().plan(full_star(), 20.0)
    assert result.status is Status.INFEASIBLE
    assert "every configuration" in result.message


def test_incomplete_planners_give_up_on_the_same_star():
    problem = full_star()
    result = Pibt(max_steps=100, num_attempts=2).plan(problem, 20.0)
    assert result.status is Status.GAVE_UP
    assert "2 attempts of 100 steps" in result.message
    result = Lns2().plan(problem, 0.2)
    assert result.status is Status.TIMED_OUT
    assert "left in collision" in result.message


@pytest.mark.parametrize("planner", [Pibt(), Lacam(), Lns2()])
def test_goal_against_one_way_lanes_is_infeasible_and_named(planner):
    problem = problem_on(on_a_circle([(0, 1), (1, 2), (2, 1)], 3), [1, 0], [0, 2])
    result = planner.plan(problem, 5.0)
    assert result.status is Status.INFEASIBLE
    assert result.message == "robot_0 cannot reach its goal 'v0' from 'v1'"


@pytest.mark.parametrize("planner", [Pibt(), Lacam(), Lns2()])
def test_one_way_ring_is_driven_round(planner):
    ring = on_a_circle([(i, (i + 1) % 6) for i in range(6)], 6)
    problem = problem_on(ring, [0, 2, 4], [2, 4, 0])
    result = planner.plan(problem, 20.0)
    assert result.status is Status.SOLVED, result.message
    assert judge(problem, result.plan).valid
    assert result.plan.end_s.tolist() == [2.0, 2.0, 2.0]


@pytest.mark.parametrize("threads", [1, 2])
def test_anytime_never_returns_worse_than_first(threads):
    problem = random_grid(12, 40, 3)
    result = Lacam(anytime=True, threads=threads).plan(problem, 0.4)
    assert result.stats["cost"] <= result.stats["polished_cost"] <= result.stats["first_solution_cost"]
    assert judge(problem, result.plan).valid
    result = Lns2(anytime=True, threads=threads).plan(problem, 0.4)
    assert result.stats["cost"] <= result.stats["first_solution_cost"]
    assert judge(problem, result.plan).valid


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan")])
@pytest.mark.parametrize("planner", [Pibt(), Lacam(), Lns2()])
def test_time_limits_have_to_be_positive(planner, limit):
    with pytest.raises(PlanError, match="time limit"):
        planner.plan(problem_on(corridor(3), [0], [2]), limit)


@pytest.mark.parametrize(
    ("made", "field"), [(Pibt, "num_attempts"), (Lacam, "num_tries"), (Lns2, "neighbourhood"), (Lacam, "threads"), (Lns2, "threads")]
)
def test_parameters_have_to_make_sense(made, field):
    with pytest.raises(PlanError, match=field):
        replace(made(), **{field: 0})


@pytest.mark.slow
def test_kernels_say_the_same_without_the_compiler():
    """In new processes: one as Python, one from the cache of compiled code."""
    script = """
import numpy as np
from worlds import random_grid
from planners.configuration.lacam import Lacam
from planners.neighbourhood.lns2 import Lns2
from planners.configuration.pibt import Pibt

problem = random_grid(7, 12, 4)
for planner in (Pibt(), Lacam(polish=300), Lns2(polish=300)):
    planner.prepare()
    result = planner.plan(problem, 60.0)
    print(result.status, result.plan.vertex.tolist(), result.plan.arrive_s.tolist())
print(Lacam()._plan(problem, 60.0, True).plan.vertex.tolist())
"""
    said = [
        subprocess.run(
            [sys.executable, "-W", "error", "-c", script],
            env={**os.environ, "NUMBA_DISABLE_JIT": disabled, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p) + os.pathsep + "."},
            capture_output=True,
            text=True,
            check=False,
        )
        for disabled in ("0", "1")
    ]
    assert said[0].stdout == said[1].stdout, said[1].stderr[-2000:]
    assert said[0].stdout.count("solved") == 3
