"""The portfolio: who is asked first, who after that, and what the answer says."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest
from worlds import drawn as world
from worlds import random_grid

from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.errors import PlanError
from mrp_sumo.traffic.referee import judge
from planners.auto import Auto, portfolio_for

pytestmark = pytest.mark.kernel

BAY = "@@.@@ b0.1a"  # one robot has to step aside, which an order of robots cannot say
ROOM = "0.....1 b.....a"


def answer(picture, *planners, time_limit_s=20.0, **changed):
    auto = Auto(planners=planners)
    auto.prepare()
    problem = replace(world(picture), **changed)
    return problem, auto.plan(problem, time_limit_s)


def test_the_first_that_finds_a_plan_answers():
    problem, result = answer(ROOM, "prioritised", "lacam")
    assert (result.status, result.chosen, result.why) == (Status.SOLVED, "prioritised", "as the scenario says")
    assert judge(problem, result.plan).valid


def test_another_answers_where_the_first_finds_none():
    problem, result = answer(BAY, "prioritised", "lacam")
    assert (result.status, result.chosen) == (Status.SOLVED, "lacam")
    assert result.why == "as the scenario says; prioritised gave up"
    assert judge(problem, result.plan).valid


def test_where_nobody_finds_a_plan_the_last_has_the_word():
    _, result = answer(BAY, "pbs", "prioritised")
    assert (result.status, result.chosen, result.plan) == (Status.GAVE_UP, "prioritised", None)


def test_what_is_proved_to_have_no_plan_is_asked_of_nobody_else():
    _, result = answer("b01a", "prioritised", "lacam")
    assert (result.status, result.chosen) == (Status.INFEASIBLE, "prioritised")


def test_each_gets_an_equal_share_of_the_effort_that_is_left(monkeypatch):
    efforts = []

    class Counts:
        supports = frozenset({"effort"})

        def plan(self, problem, time_limit_s):
            efforts.append(problem.effort)
            return PlanResult(Status.GAVE_UP)

    monkeypatch.setattr("planners.auto.planner", lambda name, parameters: Counts())
    Auto(planners=("pibt", "lacam", "lns2", "prioritised")).plan(replace(world("0..a"), effort=122), 5.0)
    assert efforts == [30, 30, 31, 31]


def test_effort_is_shared():
    """Ten labels are not enough for either; half of many are enough for the first."""
    _, none = answer(BAY, "prioritised", "pibt", effort=2)
    assert none.plan is None
    _, some = answer(ROOM, "prioritised", "lacam", effort=100_000)
    assert some.chosen == "prioritised"


@pytest.mark.slow
@pytest.mark.compiled
def test_by_rule_everybody_gets_an_answer():
    for drivable in (False, True):
        problem, result = answer(BAY, drivable=drivable)
        assert result.status is Status.SOLVED
        assert result.chosen
        assert result.why
        assert judge(problem, result.plan, in_seconds=True).valid


@pytest.mark.parametrize(("planners", "steps"), [((), 78), (("ecbs",), 86)])
def test_by_rule_a_bounded_search_comes_near_the_optimum(planners, steps):
    """Ten robots with 78 steps to their goals at least; with its default `ecbs` answers with a plan of 86 as soon."""
    auto = Auto(planners=planners)
    auto.prepare()
    result = auto.plan(random_grid(10, 10, 9), 20.0)
    assert (result.chosen, result.plan.end_s.sum()) == ("ecbs", steps)


@pytest.mark.parametrize(("drivable", "kind", "robots", "quarter_s", "first"), [
    (True, "grid", 5, 0.5, "pbs"), (True, "grid", 6, 0.5, "ecbs"), (True, "roadmap", 5, 0.5, "ecbs"), (False, "grid", 5, 0.5, "ecbs"),
    (True, "grid", 20, 0.61, "pbs"), (True, "grid", 20, 0.59, "ecbs"), (True, "grid", 21, 0.61, "ecbs"), (False, "grid", 20, 0.61, "ecbs"),
    (False, "grid", 200, 0.5, "ecbs"), (False, "grid", 201, 0.5, "lacam"),
])  # fmt: skip
def test_real_motion_is_planned_on_grids_where_the_order_is_kept_and_robots_are_few(drivable, kind, robots, quarter_s, first):
    """More of them where a quarter turn takes 0.3 of a step of 2 s."""
    graph, fleet = SimpleNamespace(kind=kind), SimpleNamespace(turn_rate_rad_s=np.pi / 2 / np.array([quarter_s, 0.7]))
    problem = SimpleNamespace(num_robots=robots, graph=graph, fleet=fleet, step_s=2.0, drivable=drivable, window_steps=0)
    assert portfolio_for(problem).names[0] == first


def test_in_windows_robots_with_room_go_one_after_another_and_crowds_by_lacam():
    assert portfolio_for(replace(world("0.1 ... ..."), window_steps=20)).names[0] == "prioritised"  # 9 vertices for 2 robots
    assert portfolio_for(replace(world("01. 23."), window_steps=20)).names[0] == "lacam"  # 6 for 4


@dataclass(frozen=True)
class Says:
    """A planner that has one robot wait so many steps before it drives its three lanes."""

    waits: int

    def prepare(self):
        pass

    def plan(self, problem, time_limit_s):
        if self.waits < 0:
            return PlanResult(Status.GAVE_UP)
        return PlanResult(Status.SOLVED, plan_of_paths([[0] * self.waits + [0, 1, 2, 3]], 1.0), lower_bound_steps=3.0)


@pytest.mark.parametrize(("waits", "by"), [
    ({"ecbs": 2, "lacam": 0, "eecbs": 0, "lns2": 0, "prioritised": 0}, "ecbs"),  # less than 1.7 times its bound: taken at once
    ({"ecbs": -1, "lacam": 3, "eecbs": 0, "lns2": 4, "prioritised": 5}, "lacam"),  # the cheapest of all; eecbs is asked if there is none
    ({"ecbs": -1, "lacam": 4, "eecbs": 0, "lns2": 3, "prioritised": 5}, "lns2"),
    ({"ecbs": -1, "lacam": 4, "eecbs": 0, "lns2": 3, "prioritised": 0}, "prioritised"),
    ({"ecbs": -1, "lacam": 2, "eecbs": 0, "lns2": 0, "prioritised": 0}, "lacam"),
    ({"ecbs": -1, "lacam": -1, "eecbs": 2, "lns2": 0, "prioritised": 0}, "eecbs"),  # farther from the optimum than ecbs may be
    ({"ecbs": -1, "lacam": -1, "eecbs": -1, "lns2": -1, "prioritised": 5}, "prioritised"),
])  # fmt: skip
def test_the_first_plan_near_its_bound_or_the_cheapest_is_taken(waits, by, monkeypatch):
    monkeypatch.setattr("planners.auto.planner", lambda name, parameters: Says(waits[name]))
    result = Auto().plan(world("0..a"), 5.0)
    assert result.chosen == by
    assert result.why.count("gave up") == list(waits.values()).count(-1)


@pytest.mark.parametrize(("ends", "names", "by"), [
    ((3, 3), ["prioritised"], "prioritised"),  # nobody loses a step
    ((0, 3), ["prioritised", "lacam"], "lacam"),  # one stands where the other gets on
    ((2, 1), ["prioritised", "lacam"], "prioritised"),  # both get on, one farther
])  # fmt: skip
def test_in_windows_the_plan_is_taken_after_which_least_is_left(ends, names, by, monkeypatch):
    called = []

    @dataclass(frozen=True)
    class GoesTo(Says):
        def plan(self, problem, time_limit_s):
            return PlanResult(Status.SOLVED, plan_of_paths([list(range(self.waits + 1))], 1.0), lower_bound_steps=3.0)

    monkeypatch.setattr("planners.auto.planner", lambda name, parameters: called.append(name) or GoesTo(ends[len(called) - 1]))
    result = Auto().plan(replace(world("0..a"), window_steps=5), 5.0)
    assert (called, result.chosen) == (names, by)


def test_who_is_asked_for_a_cheaper_plan_has_a_bounded_effort(monkeypatch):
    """Without a plan lns2 may do what it wants, where it costs more than twice its bound ten times as much."""
    efforts = []

    @dataclass(frozen=True)
    class Counts(Says):
        def plan(self, problem, time_limit_s):
            efforts.append(problem.effort)
            return super().plan(problem, time_limit_s)

    for waits, wanted in (({"lacam": 3}, [1000, 1000]), ({"lacam": 4}, [10_000, 10_000]), ({"lns2": 3}, [40_000, 0, 1000])):
        efforts.clear()
        monkeypatch.setattr("planners.auto.planner", lambda name, parameters, waits=waits: Counts(waits.get(name, -1)))
        Auto().plan(world("0..a"), 5.0)
        assert efforts == [40_000, 0, *wanted]


@pytest.mark.parametrize(("names", "shares"), [((), [0.2, 0.5, 1 / 3, 0.5, 1.0]), (("ecbs", "lacam", "lns2"), [1 / 3, 0.5, 1.0])])
def test_by_rule_lacam_has_half_of_the_time_that_is_left(names, shares, monkeypatch):
    limits = []

    @dataclass(frozen=True)
    class Limited(Says):
        def plan(self, problem, time_limit_s):
            limits.append(time_limit_s)
            return super().plan(problem, time_limit_s)

    monkeypatch.setattr("planners.auto.planner", lambda name, parameters: Limited(-1))
    Auto(planners=names).plan(world("0..a"), 1e6)
    assert limits == pytest.approx([1e6 * share for share in shares], rel=1e-3)


@pytest.mark.parametrize(("parameters", "said"), [
    ({"planners": ("lacan",)}, "no planner 'lacan' for a portfolio (did you mean 'lacam'?)"),
    ({"planners": ("auto",)}, "no planner 'auto' for a portfolio"),
])  # fmt: skip
def test_other_portfolios_are_refused(parameters, said):
    with pytest.raises(PlanError, match=said.replace("(", r"\(").replace(")", r"\)").replace("?", r"\?")):
        Auto(**parameters)


def test_no_robots():
    problem = world(ROOM)
    none = np.zeros(0, np.int64)
    empty = replace(problem, fleet=replace(problem.fleet, robot_name=()), start=none, goal=none, goal_of=none)
    assert Auto().plan(empty, 5.0).status is Status.SOLVED
