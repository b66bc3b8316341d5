import json

import numpy as np
import pytest
from step_wise_worlds import ROUND, solution_of, write_problem

from mrp_sumo.core.step_wise import NOTHING, DelayLaw
from mrp_sumo.errors import PlanError
from mrp_sumo.formats.lorr import print_solution, read_problem, read_solution


def test_problem_is_read_with_its_cells(tmp_path):
    problem = read_problem(write_problem(tmp_path, ["..E", ".@S"], [0, 5], [[2], [3, 5]], numTasksReveal=1.5))
    assert problem.free.tolist() == [[True, True, True], [True, False, True]]
    assert problem.start.tolist() == [0, 5]
    assert [problem.errands_of(k).tolist() for k in range(3)] == [[2], [3, 5], [2]]
    assert problem.num_revealed == 3


@pytest.mark.parametrize(
    ("keys", "own"), [({}, False), ({"taskAssignmentStrategy": "greedy"}, False), ({"taskAssignmentStrategy": "roundrobin"}, True)]
)
def test_problem_of_2023_says_whether_robots_have_tasks_of_their_own(tmp_path, keys, own):
    problem = read_problem(write_problem(tmp_path, ["..E", ".@S"], [0, 5], [[2], [3], [1]], **keys))
    assert problem.own_tasks == own
    assert [problem.owner_of(task) for task in range(3)] == ([0, 1, 0] if own else [NOTHING] * 3)


def test_comments_and_commas_at_the_end_are_read_over(tmp_path):
    path = write_problem(tmp_path, ["..."], [0], [[2]])
    (tmp_path / "x.tasks").write_text("# version\n1\n2,1,\n")
    assert read_problem(path).errands_of(0).tolist() == [2, 1]


def test_solution_comes_back_as_it_was_written(tmp_path):
    problem = read_problem(write_problem(tmp_path, ROUND, [0, 1], [[2], [3], [8]]))
    solution = solution_of(problem, 12)
    path = tmp_path / "solution.json"
    path.write_text(print_solution(problem, solution, [0.0] * 12))
    result = read_solution(path, problem)
    for key in ("start", "heading", "action", "schedule", "event", "released"):
        np.testing.assert_array_equal(getattr(result, key), getattr(solution, key))
    assert (result.errands, result.num_done) == (solution.errands, solution.num_done)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"teamSize": 3}, "x.agents: 2 robots, but teamSize is 3"),
        ({"teamSize": 0}, "teamSize is 0, expected a whole number from 1 to 999999"),
        ({"numTasksReveal": "many"}, "numTasksReveal is 'many', expected a number above 0, at most 1000000"),
        ({"numTasksReveal": 1e12}, "numTasksReveal is 1000000000000.0, expected a number above 0, at most 1000000"),
        ({"taskAssignmentStrategy": "robin"}, "taskAssignmentStrategy is 'robin', expected greedy or roundrobin"),
        ({"mapFile": 7}, "mapFile is 7, expected the name of a file"),
        ({"taskFile": "none"}, "none: no such file or directory"),
        ({"agents": "2\n0\n4\n"}, "robot 1: cell 4 is blocked (row 1, column 1)"),
        ({"agents": "2\n0\n77\n"}, "robot 1: cell 77 is off the map"),
        ({"agents": "2\n0\n0\n"}, "robots 0 and 1 start at the same cell 0"),
        ({"agents": "2\n0\n-1\n"}, "x.agents:3: '-1', expected whole numbers separated by commas"),
        ({"tasks": "2\n1\n"}, "x.tasks: 1 lines after the first, which says 2"),
        ({"tasks": "1\n2,4\n"}, "task 0: cell 4 is blocked (row 1, column 1)"),
        ({"map": "type octile\nheight 2\nwidth 3\nmap\n..\n...\n"}, "x.map:5: a row of 2 characters, but the header says 3"),
        ({"map": "type octile\nheight 2\nwidth 3\nmap\n..x\n...\n"}, "x.map:5: column 3 is 'x', expected one of . E S G @ T O W"),
    ],
)
def test_bad_problem_is_one_line(tmp_path, changes, message):
    path = write_problem(tmp_path, ["...", ".@."], [0, 2], [[1]])
    document = json.loads(path.read_text())
    for key, value in changes.items():
        if key in ("agents", "tasks", "map"):
            (tmp_path / f"x.{key}").write_text(value)
        else:
            document[key] = value
    path.write_text(json.dumps(document))
    with pytest.raises(PlanError) as caught:
        read_problem(path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


DELAYS = {"seed": 3, "minDelay": 2, "maxDelay": 9, "eventModel": "poisson", "pDelay": 0.01, "durationModel": "uniform"}


def test_the_law_of_delays_is_read(tmp_path):
    keys = {"version": "2026 LoRR", "agentCounter": 3, "agentSize": 0.8, "delayConfig": DELAYS}
    problem = read_problem(write_problem(tmp_path, ["..."], [0], [[2]], **keys))
    assert (problem.ticks, problem.size) == (3, 0.8)
    assert problem.delays == DelayLaw(3, 2, 9, "poisson", 0.01, "uniform", 0.0, 0.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"pDelay": 2}, "delayConfig.pDelay is 2, expected a number from 0 to 1"),
        ({"minDelay": 0.5}, "delayConfig.minDelay is 0.5, expected a whole number from 1 to 1e+06"),
        ({"minDelay": 10}, "delayConfig.minDelay is 10, expected at most maxDelay, which is 9"),
        ({"eventModel": "always"}, "delayConfig.eventModel is 'always', expected bernoulli or poisson"),
        ({"durationModel": "gaussian"}, "delayConfig.gaussMeanRatio is missing"),
        ({"maxDelay": None}, "delayConfig.maxDelay is None"),
    ],
)
def test_bad_law_of_delays_is_one_line(tmp_path, changes, message):
    path = write_problem(tmp_path, ["..."], [0], [[2]], agentCounter=3, delayConfig=DELAYS | changes)
    with pytest.raises(PlanError) as caught:
        read_problem(path)
    assert message in str(caught.value)


def test_a_key_of_delays_that_is_misspelt_is_named(tmp_path):
    delays = {key.replace("pDelay", "pDelays"): value for key, value in DELAYS.items()}
    with pytest.raises(PlanError, match=r"x.json: delayConfig.pDelay is missing \(did you mean 'pDelays'\?\)"):
        read_problem(write_problem(tmp_path, ["..."], [0], [[2]], agentCounter=3, delayConfig=delays))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"mapFile": "x.map"}', "x.json: agentFile is missing"),  # and is not the key that is there
        ('{"mapFile": "x.map", "agentsFile": "x"}', "x.json: agentFile is missing (did you mean 'agentsFile'?)"),
        ('["x.map"]', 'x.json: found ["x.map"], expected an object with mapFile, agentFile, taskFile, teamSize, numTasksReveal'),
        ("null", "x.json: found null, expected an object with mapFile, agentFile, taskFile, teamSize, numTasksReveal"),
    ],
)
def test_what_is_no_problem_is_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "x.json"
    path.write_text(text)
    with pytest.raises(PlanError) as refused:
        read_problem(path)
    assert str(refused.value) == message


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("start", [[0, 0, "E"]], "1 robots in start, 2 in actualPaths"),
        ("start", [[0, 0, "Q"], [0, 1, "E"]], r"start\[0\] is"),
        ("actualPaths", ["F,X", "W,W"], r"actualPaths\[0\] has 'X', expected F, R, C or W"),
        ("actualPaths", ["F,F", "W"], r"actualPaths\[1\] has 1 steps, actualPaths\[0\] has 2"),
        ("actualSchedule", ["0;1", ""], r"actualSchedule\[0\] has '0;1', expected time:task"),
        ("events", [[1, 2, 3]], r"events\[0\] is"),
        ("tasks", [[5, 0, []]], r"tasks\[0\] is"),
        ("numTaskFinished", None, "numTaskFinished is None"),
    ],
)
def test_bad_solution_is_one_line(tmp_path, key, value, message):
    problem = read_problem(write_problem(tmp_path, ROUND, [0, 1], [[2], [3], [8]]))
    path = tmp_path / "solution.json"
    path.write_text(json.dumps(json.loads(print_solution(problem, solution_of(problem, 4), [0.0] * 4)) | {key: value}))
    with pytest.raises(PlanError, match=message):
        read_solution(path, problem)
