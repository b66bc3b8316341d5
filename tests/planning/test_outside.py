"""Planners and assigners from outside: whatever they do, the caller gets an answer in time, and a line that names theirs."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest
from processes import gone

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.plan import Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError, PlugInError, ScenarioError
from mrp_sumo.formats.instances import POINT
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.planning.registry import assigner, planner
from mrp_sumo.traffic.referee import judge

HEAD = """
from dataclasses import dataclass, replace
from typing import ClassVar
import os, sys, time
import numpy as np
from mrp_sumo.core.plan import Plan, PlanResult, Status, plan_of_paths
"""

PLANNER = (
    HEAD
    + """
@dataclass(frozen=True)
class Mine:
    pause_s: float = 0.0
    assigns: ClassVar[bool] = False
    guarantee: ClassVar[str] = "none"

    def prepare(self):
        pass

    def plan(self, problem, time_limit_s):
        paths = [[0, 1, 2], [5, 5, 5, 4]]
        plan = plan_of_paths(paths, problem.step_s)
        return PlanResult(Status.SOLVED, plan)
"""
)

ASSIGNER = (
    HEAD
    + """
@dataclass(frozen=True)
class Mine:
    def assign(self, cost, time_limit_s):
        return np.arange(len(cost))
"""
)


@pytest.fixture
def problem():
    graph = grid_graph(np.ones((2, 3), bool), 1.0, (0.0, 0.0))  # vertices 0 1 2 are the lower row
    return Problem(graph, fleet_of(POINT, 2), np.array([0, 5]), np.array([2, 4]), np.array([0, 1]), 1.0)


@pytest.fixture
def of(tmp_path):
    """Makes the plug-in of a file with this text."""

    def make(text, make=planner, parameters={}):  # noqa: B006
        (tmp_path / "mine.py").write_text(text)
        return make("mine.py:Mine", parameters, tmp_path)

    return make


def before_planning(statement):
    """The planner with a statement at the beginning of `plan`."""
    return PLANNER.replace("        paths =", f"        {statement}\n        paths =")


def line_of(text, words):
    return next(i for i, line in enumerate(text.splitlines(), 1) if words in line)


def test_planner_of_a_file_plans(problem, of):
    mine = of(PLANNER)
    mine.prepare()
    result = mine.plan(problem, 60.0)
    assert (mine.assigns, mine.guarantee) == (False, "none")
    assert result.status is Status.SOLVED
    assert judge(problem, result.plan).valid
    assert result.plan.vertex.dtype == np.int64


def test_planning_time_is_measured(problem, of):
    text = before_planning("time.sleep(0.2)").replace("SOLVED, plan)", "SOLVED, plan, planning_time_s=77.0)")
    assert 0.2 <= of(text).plan(problem, 60.0).planning_time_s < 77


WRONG = {
    "plan() returned None, expected a PlanResult": "None",
    "plan() returned a dict, expected a PlanResult": "{'status': 'solved'}",
    "plan() returned the status 'solved' without a plan": "PlanResult(Status.SOLVED)",
    "plan() returned the status 'fine', expected one of Status.SOLVED": "PlanResult('fine', plan)",
    "plan() returned vertex 99 for robot_1, but there are 6 vertices": "PlanResult(Status.SOLVED, plan_of_paths([[0], [5, 99]], 1.0))",
    "plan() returned vertex -1 for robot_0": "PlanResult(Status.SOLVED, plan_of_paths([[-1], [5]], 1.0))",
    "plan() returned plan.first of length 2, expected 3, the": "PlanResult(Status.SOLVED, plan_of_paths([[0]], 1.0))",
    "plan() returned a plan.first from 1 to 5, expected to rise": "PlanResult(Status.SOLVED, replace(plan, first=plan.first + [1, 0, 0]))",
    "plan() returned a plan.first from 0 to 4, expected": "PlanResult(Status.SOLVED, replace(plan, first=plan.first - [0, 0, 1]))",
    "plan() returned a plan.first from 0 to 5, expected to rise": "PlanResult(Status.SOLVED, replace(plan, first=plan.first + [0, 9, 0]))",
    "plan() returned a plan without a visit of robot": "PlanResult(Status.SOLVED, replace(plan, first=plan.first * [0, 0, 1] + [0, 5, 0]))",
    "plan() returned vertex 6 for robot_1, but there are 6 vertices": "PlanResult(Status.SOLVED, plan_of_paths([[0], [5, 6]], 1.0))",
    "plan() returned plan.vertex of float64, expected whole numbers": "PlanResult(Status.SOLVED, replace(plan, vertex=plan.vertex * 1.0))",
    "plan() returned plan.arrive_s of length 1, expected 5": "PlanResult(Status.SOLVED, replace(plan, arrive_s=np.zeros(1)))",
    "plan() returned times that are not finite": "PlanResult(Status.SOLVED, replace(plan, arrive_s=plan.arrive_s * np.nan))",
    "plan() returned a list as plan, expected a Plan": "PlanResult(Status.SOLVED, paths)",
    "plan() returned goal 2, but there are 2 goals": "PlanResult(Status.SOLVED, plan, np.array([0, 2]))",
    "plan() returned goal -2, but there are 2 goals": "PlanResult(Status.SOLVED, plan, np.array([0, -2]))",
    "plan() returned goal 1 for two robots": "PlanResult(Status.SOLVED, plan, np.array([1, 1]))",
    "plan() returned another goal_of": "PlanResult(Status.SOLVED, plan, np.array([1, 0]))",
    "plan() returned the lower bound None, expected a number of steps": "PlanResult(Status.SOLVED, plan, lower_bound_steps=None)",
    "plan() returned the stats {'a': 'b'}, expected numbers by name": "PlanResult(Status.SOLVED, plan, stats={'a': 'b'})",
}


def in_turn(answers):
    """An expression of each of these expressions in turn, so that one process gives them all."""
    return f"[{', '.join(f'lambda: {answer}' for answer in answers)}][next(TURN)]()"


TURN = "import itertools\nTURN = itertools.count()\n"


def test_wrong_answer_is_a_line_with_the_method(problem, of):
    text = TURN + PLANNER.replace("PlanResult(Status.SOLVED, plan)", in_turn(WRONG.values()))
    mine = of(text)
    for says in WRONG:
        result = mine.plan(problem, 60.0)
        assert result.status is Status.PLANNER_FAILED
        assert f"mine.py:{line_of(text, 'def plan')}: {says}" in result.message
        assert "\n" not in result.message


def test_planner_that_assigns_has_to_say_whom_it_sends_where(problem, of):
    text = PLANNER.replace("assigns: ClassVar[bool] = False", "assigns: ClassVar[bool] = True")
    free = replace(problem, goal_of=np.full(2, -1))
    assert "returned no goal_of, expected the assignment that the plan is for" in of(text).plan(free, 5.0).message
    assert of(text).plan(problem, 60.0).status is Status.SOLVED  # it is known there


EXCEPTIONS = {
    "in plan: ZeroDivisionError: division by zero": "1 / 0",
    "in plan: ended the program (SystemExit: 0)": "sys.exit(0)",
    "in plan: KeyboardInterrupt": "raise KeyboardInterrupt",
    "in plan: the path of robot 0 is empty": "plan_of_paths([[]], 1.0)",
}


@pytest.mark.parametrize("says", EXCEPTIONS)
def test_exception_is_a_line_with_their_last_frame(problem, of, says):
    text = before_planning(EXCEPTIONS[says])
    result = of(text).plan(problem, 60.0)
    assert result.status is Status.PLANNER_FAILED
    assert f"mine.py:{line_of(text, EXCEPTIONS[says])}: {says}" in result.message
    assert "Traceback" in result.details


def test_process_that_is_ended_is_told(problem, of):
    text = before_planning("os._exit(0)")
    result = of(text).plan(problem, 60.0)
    assert result.status is Status.PLANNER_FAILED
    assert f"mine.py:{line_of(text, 'def plan')}: ended its process with exit code 0 during plan()" in result.message
    text = before_planning("os.kill(os.getpid(), 11)")
    assert "its process was killed by SIGSEGV during plan()" in of(text).plan(problem, 60.0).message
    assert "ended its process with exit code 0 during load()" in of(text.replace("@data", "os._exit(0)\n@data")).plan(problem, 60.0).message


def test_time_limit_is_hard_and_children_die_too(problem, of, tmp_path):
    note = tmp_path / "child"
    text = before_planning(
        "import subprocess; child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)']); "
        f"open('{note}', 'w').write(str(child.pid)); time.sleep(60)"
    )
    mine = of(text)
    mine.prepare()
    result = mine.plan(problem, 0.5)
    assert (result.status, result.message) == (Status.TIMED_OUT, "killed after 0.5 s")
    assert gone(int(note.read_text()))


def test_planner_goes_on_after_it_was_killed(problem, of):
    text = before_planning("time.sleep(60 if time_limit_s < 1 else 0)")
    mine = of(text)
    assert mine.plan(problem, 0.1).status is Status.TIMED_OUT
    assert mine.plan(problem, 60.0).status is Status.SOLVED


def test_memory_is_refused_as_to_ours(problem, of):
    mine = of(before_planning("raise MemoryError"))
    with pytest.raises(MemoryError):
        mine.plan(problem, 60.0)


def test_preparation_is_not_planning(problem, of):
    mine = of(PLANNER.replace("        pass", "        time.sleep(1.2)"))
    mine.prepare()
    result = mine.plan(problem, 1.0)
    assert result.status is Status.SOLVED


def test_what_a_plug_in_prints_is_not_our_output(problem, of, capfd):
    of(before_planning("print('hello')")).plan(problem, 60.0)
    output = capfd.readouterr()
    assert output.out == ""


def test_unknown_parameter_is_bad_input(of):
    with pytest.raises(ScenarioError, match="unknown parameter 'paus_s'"):
        of(PLANNER, parameters={"paus_s": 1}).prepare()


def test_nothing_is_loaded_before_it_is_needed(of):
    mine = of("raise RuntimeError('loaded')\n" + PLANNER)
    with pytest.raises(PlugInError, match=r"mine.py:1: RuntimeError: loaded"):
        mine.prepare()


def test_planner_may_assign(problem, of):
    text = PLANNER.replace("assigns: ClassVar[bool] = False", "assigns: ClassVar[bool] = True")
    result = of(text.replace("SOLVED, plan)", "SOLVED, plan, np.array([0, 1]))")).plan(problem, 60.0)
    assert result.goal_of.tolist() == [0, 1]


def test_assigner_of_a_file_assigns(of):
    assert of(ASSIGNER, assigner).assign(np.ones((2, 3)), 5.0).tolist() == [0, 1]


ASSIGNMENTS = {
    "assign() returned an assignment of length 1, expected 2, the number of robots": "[0]",
    "assign() returned None as an assignment, expected an array of one dimension": "None",
    "assign() returned goal 7, but there are 3 goals": "[0, 7]",
    "assign() returned goal 1 for two robots": "[1, 1]",
    "assign() returned goals for 1 robots, expected 2": "[1, -1]",
    "assign() returned goal 2 for robot 0, which cannot reach it": "[2, 1]",
    "assign() returned an assignment of float64, expected whole numbers": "np.zeros(2)",
}
COST = np.array([[1.0, 1.0, np.inf], [1.0, 1.0, 1.0]])


def test_wrong_assignment_is_a_line(of):
    mine = of(TURN + ASSIGNER.replace("np.arange(len(cost))", in_turn(ASSIGNMENTS.values())), assigner)
    for says in ASSIGNMENTS:
        with pytest.raises(PlugInError, match=f"mine.py:.*{re.escape(says)}"):
            mine.assign(COST, 5.0)


def test_assigner_that_fails_is_a_line(of):
    with pytest.raises(PlugInError, match=r"mine.py:.*in assign: ZeroDivisionError: division by zero"):
        of(ASSIGNER.replace("np.arange(len(cost))", "1 / 0"), assigner).assign(COST, 5.0)


def test_assigner_may_say_that_there_is_none(of):
    text = "from mrp_sumo.errors import PlanError\n" + ASSIGNER.replace(
        "        return", "        raise PlanError('too few goals')\n        return"
    )
    with pytest.raises(PlanError, match="too few goals"):
        of(text, assigner).assign(np.ones((2, 2)), 5.0)


def test_process_ends_with_its_planner(of):
    mine = of(PLANNER)
    mine.prepare()
    pid = mine.process._process.pid
    del mine
    assert gone(pid)


def test_python_path_reaches_the_process(problem, of, tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "found_there.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path / "elsewhere")
    assert of("import found_there\n" + PLANNER).plan(problem, 60.0).status is Status.SOLVED
    assert "found_there" not in sys.modules
