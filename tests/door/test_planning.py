"""Problems, plans and verdicts from the front door."""

import pickle
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

import mrp_sumo as ms

CORRIDOR = "type octile\nheight 2\nwidth 5\nmap\n.....\n.....\n"


@pytest.fixture(scope="module")
def problem(tmp_path_factory):
    folder = tmp_path_factory.mktemp("maps")
    (folder / "lane.map").write_text(CORRIDOR)
    ends = {"starts": ["v0", "v4"], "goals": ["v4", "v0"]}
    return ms.problem(ms.Scenario("lane.map", ends, assignment={"mode": "fixed"}, folder=folder))


def refusal(call):
    with pytest.raises(ms.MrpSumoError) as caught:
        call()
    return str(caught.value)


def across(problem, time_limit_s):
    """Both robots drive straight at each other."""
    return [[0, 1, 2, 3, 4], [4, 3, 2, 1, 0]]


def detour(problem, time_limit_s):
    """The second robot takes the other row."""
    return [[0, 1, 2, 3, 4], [4, 9, 8, 7, 6, 5, 0]]


@dataclass(frozen=True)
class Around:
    """As `detour`, but the first robot sets out late: right into the other."""

    delay: int = 0
    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "none"

    def prepare(self) -> None:
        """Nothing to compile."""

    def plan(self, problem, time_limit_s):
        first, second = detour(problem, time_limit_s)
        return ms.PlanResult(ms.Status.SOLVED, ms.plan_of_paths([[0] * self.delay + first, second], problem.step_s))


def test_problem_tells_starts_and_goals(problem):
    assert (problem.starts, problem.goals) == (("v0", "v4"), ("v4", "v0"))
    assert repr(problem).startswith("<Problem lane_2: 2 robots, 2 goals, grid of 10 vertices, 13 edges, ")
    assert "v0, v4" in str(problem) and "<table>" in problem._repr_html_()
    assert repr(problem.scenario).startswith("<Scenario lane_2")


def test_problem_is_one_for_planners_of_ones_own(problem):
    assigned = problem.assigned(np.arange(2))
    assert assigned.target.tolist() == [4, 0] and assigned.setup is problem.setup


def test_plan_takes_parameters_by_name(problem):
    plan = ms.plan(problem, "ecbs", w=1.5, time_limit_s=5)
    chosen = plan.setup.scenario.planner
    assert (chosen.name, chosen.parameters, chosen.time_limit_s) == ("ecbs", {"w": 1.5}, 5)
    assert plan.status == "solved" and plan.cost_steps == 10 and 8 <= plan.lower_bound_steps <= 10
    assert plan.makespan_s == plan.plan.end_s.max()
    assert repr(plan).startswith("<Plan for 2 robots: ecbs, solved, 10 steps (sum of costs), ")
    assert "referee" in str(plan) and "<table>" in plan._repr_html_()


def test_planner_of_the_scenario_is_the_default_and_keeps_its_parameters(problem):
    scenario = problem.scenario.replace(planner={"name": "ecbs", "parameters": {"w": 1.3}})
    plan = ms.plan(ms.problem(scenario))
    assert plan.setup.scenario.planner.parameters == {"w": 1.3}
    assert ms.plan(ms.problem(scenario), symmetries=False).setup.scenario.planner.parameters == {"w": 1.3, "symmetries": False}


def test_unknown_names_are_refused_with_the_nearest(problem):
    assert refusal(lambda: ms.plan(problem, "cbx")) == "planner.name: unknown planner 'cbx' (did you mean 'cbs'?)"
    assert "unknown parameter 'ww' (did you mean 'w'?)" in refusal(lambda: ms.plan(problem, "ecbs", ww=2))
    assert refusal(lambda: ms.plan(problem, "cbs", time_limit_s=0)) == "planner.time_limit_s: found 0, expected greater than 0"
    assert refusal(lambda: ms.plan(problem.scenario)) == "plan: found Scenario, expected a Problem; make one with ms.problem(scenario)"


def test_function_plans(problem):
    plan = ms.plan(problem, detour)
    assert ms.judge(problem, plan) and plan.cost_steps == 10
    assert plan.setup.scenario.planner.name == "detour" and plan.planning_time_s > 0
    assert refusal(lambda: ms.plan(problem, lambda problem, time_limit_s: 3)) == (
        "<lambda> returned int, expected a PlanResult, a Plan, or a path for each robot"
    )


def test_class_in_a_file_plans(problem, tmp_path):
    (tmp_path / "mine.py").write_text(
        "import mrp_sumo as ms\n\n\n"
        "class Around:\n"
        "    assigns, guarantee = False, 'none'\n\n"
        "    def __init__(self, delay: int = 0) -> None:\n        self.delay = delay\n\n"
        "    def prepare(self) -> None:\n        pass\n\n"
        "    def plan(self, problem, time_limit_s):\n"
        "        paths = [[0] * self.delay + [0, 1, 2, 3, 4], [4, 9, 8, 7, 6, 5, 0]]\n"
        "        return ms.PlanResult(ms.Status.SOLVED, ms.plan_of_paths(paths, problem.step_s))\n"
    )
    place = f"{tmp_path / 'mine.py'}:Around"
    assert ms.judge(problem, ms.plan(problem, place, time_limit_s=30))
    assert not ms.judge(problem, ms.plan(problem, place, delay=6, time_limit_s=30))


def test_planner_of_ones_own_is_given_the_problem_with_goals_assigned(problem):
    params = []
    ms.plan(problem, lambda problem, time_limit_s: params.append((problem, time_limit_s)) or detour(problem, 1), time_limit_s=7)
    (result, limit_s), *more = params
    assert isinstance(result, ms.Problem) and result.target.tolist() == [4, 0] and result.starts == problem.starts
    assert limit_s == 7 and not more


def test_plan_of_a_function_can_be_sent_to_another_process(problem):
    assert pickle.loads(pickle.dumps(ms.plan(problem, detour).problem)).num_robots == 2


def test_object_plans_under_its_own_name(problem):
    assert ms.judge(problem, ms.plan(problem, Around()))
    plan = ms.plan(problem, Around(delay=6))
    chosen = plan.setup.scenario.planner
    assert (chosen.name, chosen.parameters) == ("Around", {"delay": 6})
    assert not ms.judge(problem, plan)
    assert "object is no planner: it has no method" in refusal(lambda: ms.plan(problem, object()))
    assert "parameters already" in refusal(lambda: ms.plan(problem, Around(), delay=1))


def test_verdict_names_the_conflict(problem):
    verdict = ms.judge(problem, ms.plan(problem, across))
    assert not verdict and not verdict.valid
    assert str(verdict).splitlines()[0] == "not valid: 0 faults, 1 conflict"
    assert "robot_0 and robot_1 meet at 'v2'" in str(verdict) and "meet at" in verdict._repr_html_()
    assert repr(verdict) == "<Judgement: not valid: 0 faults, 1 conflict>"


def test_verdict_of_a_valid_plan(problem):
    verdict = ms.judge(problem, ms.plan(problem, "cbs"))
    assert verdict and not verdict.conflicts and str(verdict).startswith("valid, ")


def test_bare_plan_is_judged_by_where_its_robots_end(problem):
    free = ms.problem(problem.scenario.replace(assignment={"mode": "optimal"}))
    plan = ms.plan_of_paths(detour(free, 1), free.step_s)
    assert ms.judge(free, plan) and ms.judge(problem, plan)
    stay = ms.plan_of_paths([[0], [4]], free.step_s)
    assert ms.judge(free, stay) and not ms.judge(problem, stay)


def test_verdict_without_a_plan_says_why(problem):
    def hopeless(problem, time_limit_s):
        return ms.PlanResult(ms.Status.TIMED_OUT, message="out of ideas")

    plan = ms.plan(problem, hopeless)
    verdict = ms.judge(problem, plan)
    assert not verdict and str(verdict) == "no plan\n  timed out: out of ideas"
    assert refusal(lambda: ms.simulate(problem, plan)) == "simulate: there is no plan to drive, hopeless ran out of time: out of ideas"


def test_plan_of_another_problem_is_refused(problem):
    other = ms.problem(problem.scenario.replace(robots={"starts": ["v1", "v3"], "goals": ["v3", "v1"]}))
    assert refusal(lambda: ms.judge(other, ms.plan(problem, "cbs"))) == "judge: the plan is for another problem, 'lane_2'"
    assert refusal(lambda: ms.judge(problem, None)) == "judge: found NoneType, expected what ms.plan returns, or a Plan"
