"""Step-wise planners that are other programs."""

import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from step_wise_worlds import ROUND, problem_of, write_problem

from mrp_sumo.cli.main import main
from mrp_sumo.core.step_wise import FORWARD, RIGHT, WAIT
from mrp_sumo.errors import PlugInError
from mrp_sumo.planning.step_wise import run_step_wise
from mrp_sumo.plugins.registry import make
from mrp_sumo.traffic.step_wise_referee import judge_step_wise

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "step_wise.md").read_text()
PROBLEM = problem_of(ROUND, [0, 2], [[8, 0], [6], [2]], 3)


def answering(line, then="pass"):
    """A program that reads the problem, answers one step with a line, and then does something else."""
    code = f"import sys, json; sys.stdin.readline(); seen = json.loads(sys.stdin.readline()); print({line}, flush=True); {then}"
    return make("step_planners", "program", {"command": f'{sys.executable} -c "{code}"', "limit_s": 5.0})


def test_program_of_the_page_walks_validly(tmp_path, capsys, monkeypatch):
    text = next(text for text in re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL) if text.startswith('"""walk.py:'))
    (tmp_path / "walk.py").write_text(text)
    problem = write_problem(tmp_path, ROUND, [0, 2, 8], [[2], [8, 6], [0], [6]])
    monkeypatch.chdir(tmp_path)
    command = ["plan", str(problem), "--steps", "30", "--command", f"{sys.executable} walk.py", "--out", "s.json", "--json"]
    assert main(command) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["planner"] == "program" and result["valid"] and result["errands_done"] > 3
    assert main(["validate", "s.json", "--problem", str(problem)]) == 0


def test_program_may_choose_tasks_and_is_shown_what_is_left():
    code = (
        "import sys, json; sys.stdin.readline(); first = json.loads(sys.stdin.readline()); "
        "print(json.dumps(dict(actions=[0, 3], tasks=[-1, 2])), flush=True); second = json.loads(sys.stdin.readline()); "
        "assert (first['task_of'], second['task_of'], second['cell']) == ([-1, -1], [-1, -1], [1, 2]); "  # task 2 was done at once
        "assert first['pool'][0] == dict(task=0, errands=[8, 0], open=False); print(json.dumps(dict(actions='WR')), flush=True)"
    )
    run = run_step_wise(PROBLEM, make("step_planners", "program", {"command": f'{sys.executable} -c "{code}"'}), 2)
    assert run.solution.action.tolist() == [[FORWARD, WAIT], [WAIT, RIGHT]] and judge_step_wise(PROBLEM, run.solution).valid
    assert run.solution.event[0].tolist() == [1, 1, 2, 1]


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("'{}'", "step 0: answers '{}', expected a JSON object with actions"),
        ("'FF'", "step 0: answers 'FF', expected a JSON object with actions"),
        ("json.dumps(dict(actions='F'))", "step 0: actions: found 1 of them, expected 2"),
        ("json.dumps(dict(actions='FX'))", "step 0: actions: robot 1 has none that there is"),
        ("json.dumps(dict(actions='WW', tasks=[True, 0]))", "step 0: tasks .* robot 0 has none that there is"),
        ("json.dumps(dict(actions='WW', tasks=[9, 0]))", "step 0: robot 0 is given task 9, which is not revealed"),
        ("json.dumps(dict(actions='WF'))", "step 0: robot 1 drives into what is not free"),
        ("json.dumps(dict(actions='WW'))", "step 1: ended with exit code 0"),
    ],
)
def test_answers_that_are_none_are_one_line(line, message):
    with pytest.raises(PlugInError, match=message):
        run_step_wise(PROBLEM, answering(line), 3)


def test_program_that_does_not_answer_in_time_is_ended():
    planner = make("step_planners", "program", {"command": "sleep 60", "limit_s": 0.2})
    with pytest.raises(PlugInError, match=r"program .sleep., step 0: has not answered within 0\.2 s"):
        run_step_wise(PROBLEM, planner, 3)


def test_class_that_answers_with_actions_has_tasks_by_the_nearest_errand():
    class Waits:
        def prepare(self):
            pass

        def begin(self, problem, seed):
            return self

        def step(self, seen):
            return np.full(len(seen.cell), WAIT)

    run = run_step_wise(PROBLEM, Waits(), 2)
    assert run.solution.schedule[:2].tolist() == [[1, 0, 1], [1, 1, 2]]  # cells 6 and 2 are as near to robot 0: the older task
