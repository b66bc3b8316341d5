from dataclasses import replace

import numpy as np
import pytest
from step_wise_worlds import ROUND, problem_of, solution_of

from mrp_sumo.core.step_wise import FORWARD, LEFT, RIGHT, WAIT, StepWiseSolution
from mrp_sumo.traffic.step_wise_referee import CrowdProgress, Pool, judge_step_wise, pace_of


def by_hand(problem, paths, schedule=(), events=(), released=None, done=0):
    """A solution of letters, one string a robot."""
    action = np.array([["FRCW".index(a) for a in path] for path in paths], np.int8)
    released = [0] * problem.num_revealed if released is None else released
    errands = tuple(tuple(problem.errands_of(k).tolist()) for k in range(len(released)))
    rows = [np.array(table, np.int64).reshape(-1, n) for table, n in ((schedule, 3), (events, 4))]
    heading = np.zeros(len(paths), np.int64)
    return StepWiseSolution(problem.start, heading, action, *rows, np.array(released, np.int64), errands, done)


def fault(problem, solution):
    return judge_step_wise(problem, solution).fault


def test_robot_drives_and_turns_to_its_errands():
    problem = problem_of(["...", "..."], [0], [[2, 5], [0]])
    events = [(2, 0, 0, 1), (4, 0, 0, 2)]
    solution = by_hand(problem, ["FFRF"], [(1, 0, 0)], events, [0, 4], 1)
    verdict = judge_step_wise(problem, solution)
    assert (verdict.fault, verdict.tasks_done, verdict.errands_done) == ("", 1, 2)


def test_errand_where_the_robot_stands_is_done_after_one_step():
    problem = problem_of(["..."], [1], [[1, 1], [0]])
    solution = by_hand(problem, ["WW"], [(1, 0, 0)], [(1, 0, 0, 1), (2, 0, 0, 2)], [0, 2], 1)
    assert fault(problem, solution) == ""


def test_errands_out_of_order_are_not_done():
    problem = problem_of(["..."], [0], [[2, 1]])
    assert "errand 1 of task 0 by robot 0 is stated, but" in fault(problem, by_hand(problem, ["F"], [(1, 0, 0)], [(1, 0, 0, 1)]))
    assert "errand 1 of task 0 by robot 0 is not stated" in fault(problem, by_hand(problem, ["FF"], [(1, 0, 0)]))


@pytest.mark.parametrize(
    ("rows", "start", "paths", "message"),
    [
        (["...."], [0, 2], ["F", "W"], ""),
        (["...."], [0, 1], ["F", "F"], ""),  # following
        (["...."], [0, 1], ["F", "W"], "time 1: vertex conflict of robots 0 and 1 at row 0, column 1"),
        (["...."], [0, 1], ["WWF", "RRF"], "time 3: edge conflict of robots 0 and 1 between row 0, column 0 and row 0, column 1"),
        (["...@"], [0, 2], ["F", "F"], "time 1: robot 1 drives from row 0, column 2 into what is not free"),
        (["...."], [0, 3], ["F", "F"], "time 1: robot 1 drives from row 0, column 3 into what is not free"),
        (["...."], [0], ["CF"], "time 2: robot 0 drives from row 0, column 0 into what is not free"),
        (["..", ".."], [0, 1, 3, 2], ["WWWF", "RWWF", "RRWF", "CWWF"], ""),  # a ring turns
    ],
)
def test_conflicts_are_named(rows, start, paths, message):
    problem = problem_of(rows, start, [[start[0]]] * len(start))
    assert fault(problem, by_hand(problem, paths)) == message


@pytest.mark.parametrize(
    ("schedule", "message"),
    [
        ([(1, 0, 9)], "time 1: robot 0 is given task 9, which is not revealed"),
        ([(1, 0, 1), (1, 1, 1)], "time 1: robot 1 is given task 1, which robot 0 has"),
        ([(1, 0, 0), (2, 0, 1)], "time 2: robot 0 is given task 1, but has opened task 0"),
        ([(1, 0, 0), (2, 1, 0)], "time 2: robot 1 is given task 0, which robot 0 has opened"),
        ([(1, 0, 0), (2, 0, -1)], "time 2: robot 0 is given no task, but has opened task 0"),
        ([(1, 2, 0)], "the schedule is of robots that there are not"),
        ([(1, -1, 0)], "the schedule is of robots that there are not"),
        ([(1, 0, -2)], "time 1: robot 0 is given task -2, which is not revealed"),
        ([(1, 0, 2)], "time 1: robot 0 is given task 2, which is not revealed"),
    ],
)
def test_tasks_that_a_robot_may_not_have_are_named(schedule, message):
    problem = problem_of(["....."], [0, 3], [[1, 2], [4]])
    events = [(1, 0, 0, 1)] if (1, 0, 0) in schedule else []
    assert fault(problem, by_hand(problem, ["FW", "WW"], schedule, events)) == message


def test_tasks_that_nobody_has_opened_may_change_hands():
    problem = problem_of(["....."], [0, 3], [[4], [1]])
    solution = by_hand(problem, ["WF", "WF"], [(1, 0, 0), (1, 1, 1), (2, 0, 1), (2, 1, 0)], [(2, 0, 1, 1), (2, 1, 0, 1)], [0, 0, 2, 2], 2)
    assert fault(problem, solution) == ""


def test_finished_task_is_not_given_again():
    problem = problem_of(["..."], [0], [[1], [2]])
    solution = by_hand(problem, ["FW"], [(1, 0, 0), (2, 0, 0)], [(1, 0, 0, 1)], [0, 1], 1)
    assert fault(problem, solution) == "time 2: robot 0 is given task 0, which is finished"


@pytest.mark.parametrize(("own", "released", "second", "message"), [
    (True, [0, 0, 1, 2, 2], 0, ""),  # a robot without a task of its own has the next ones revealed, up to its own
    (False, [0, 0, 1, 2], 0, ""),
    (True, [0, 0, 1], 1, "time 2: robot 1 is given task 2, which is robot 0's own"),
    (False, [0, 0, 1], 1, ""),
])  # fmt: skip
def test_robots_have_tasks_of_their_own_where_the_problem_says_so(own, released, second, message):
    problem = replace(problem_of(["....", "...."], [0, 4], [[1], [7], [2], [5]]), own_tasks=own)
    schedule, events = [(1, 0, 0), (1, 1, 1), (2, second, 2)], [(1, 0, 0, 1), (2, 0, 2, 1)]
    done = 2 - second
    assert fault(problem, by_hand(problem, ["FF", "FF"], schedule, events[:done], released, done)) == message


def test_what_is_stated_has_to_be_what_follows():
    problem = problem_of(ROUND, [0, 1], [[4 - 1], [8], [2, 6]])
    solution = solution_of(problem, 30)
    assert judge_step_wise(problem, solution).valid
    assert solution.num_done > 3
    late = solution.released.copy()
    late[-1] -= 1
    wrong = {
        "num_done": (solution.num_done + 1, "tasks are stated to be finished"),
        "released": (late, "is stated to be revealed at time"),
        "errands": (((2,), *solution.errands[1:]), "task 0 has other errands than the problem says"),
        "start": (solution.start[::-1], "robot 0 does not start at"),
        "heading": (solution.heading + 1, "robot 0 does not start at"),
        "event": (solution.event[1:], "is not stated"),
    }
    for key, (value, message) in wrong.items():
        assert message in fault(problem, replace(solution, **{key: value})), key
    assert "robots, but the problem has 2" in fault(problem, replace(solution, start=solution.start[:1]))


@pytest.mark.parametrize(
    ("schedule", "events", "released", "done", "message"),
    [
        ([(0, 0, 0)], [(2, 0, 0, 1)], [0, 2], 1, ""),  # what is given at time 0 holds from the first step on
        ([(3, 0, 0)], [], [0], 0, ""),  # when all is over
        ([(1, 0, 0)], [(2, 0, 0, 1)], [0], 1, "1 tasks are stated to be revealed, 2 are"),
        ([(1, 0, 0)], [(2, 0, 0, 1)], [0, 1], 1, "task 1 is stated to be revealed at time 1, but is at 2"),
        ([(1, 0, 0)], [(2, 0, 0, 1)], [0, 2], 0, "0 tasks are stated to be finished, 1 are"),
        ([(1, 0, 0)], [(0, 0, 0, 1)], [0, 2], 1, "an errand is done outside the times 1 to 2"),
        ([(1, 0, 0)], [(2, 0, 0, 1), (3, 0, 0, 1)], [0, 2], 1, "an errand is done outside the times 1 to 2"),
        (
            [(1, 0, 0)],
            [(1, 0, 0, 1)],
            [0, 1],
            1,
            "time 1: errand 1 of task 0 by robot 0 is stated, but the robot is at row 0, column 1 with its schedule",
        ),
        (
            [(1, 0, 0)],
            [(2, 0, 0, 1), (2, 1, 0, 1)],
            [0, 2],
            1,
            "time 2: errand 1 of task 0 by robot 1 is stated, but the robot is at no cell with its schedule",
        ),
        (
            [(1, 0, 0)],
            [],
            [0],
            0,
            "time 2: errand 1 of task 0 by robot 0 is not stated, though the robot is at row 0, column 2 with its schedule",
        ),
        ([], [], [0], 0, ""),
    ],
)
def test_statements_are_compared_with_what_follows(schedule, events, released, done, message):
    """One robot drives two cells to its errand, where it is at time 2."""
    problem = problem_of(["...."], [0], [[2], [0]])
    assert fault(problem, by_hand(problem, ["FF"], schedule, events, released, done)) == message


@pytest.mark.parametrize(("num_revealed", "released"), [(2, [0, 0, 1, 1]), (4, [0, 0, 0, 0, 1, 1]), (5, [0, 0, 0, 0, 1, 1])])
def test_robots_have_as_many_tasks_of_their_own_as_each_may(num_revealed, released):
    """Two robots, with every second task each; robot 1 finishes its first, and the next of its own follows one of the other's."""
    problem = replace(problem_of(["....", "...."], [0, 4], [[1], [7], [3], [5]]), own_tasks=True, num_revealed=num_revealed)
    pool = Pool(problem)
    assert pool.released == released[: num_revealed // 2 * 2] and pool.give([(1, 1)]) == ""
    pool.advance(1, [1, 7])
    assert (pool.num_finished, pool.num_errands) == (1, 1) and pool.released == released


def slow_truth(problem, solution):
    """Whether a solution is valid, by the rules once more, one robot and one step at a time, in plain Python."""
    height, width = problem.free.shape
    places, headings = [divmod(int(c), width) for c in problem.start], [0] * problem.num_robots
    task, done, finished, shown, events = {}, {}, set(), problem.num_revealed, []
    for t in range(1, solution.num_steps + 1):
        before = list(places)
        for r, a in enumerate(solution.action[:, t - 1].tolist()):
            headings[r] = (headings[r] + {RIGHT: 1, LEFT: -1}.get(a, 0)) % 4
            if a == FORWARD:
                y, x = places[r][0] + (0, 1, 0, -1)[headings[r]], places[r][1] + (1, 0, -1, 0)[headings[r]]
                if not (0 <= y < height and 0 <= x < width and problem.free[y, x]):
                    return False
                places[r] = (y, x)
        if len(set(places)) < len(places):
            return False
        if any(places[a] == before[b] and places[b] == before[a] for a in range(len(places)) for b in range(a)):
            return False
        new = {r: k for at, r, k in solution.schedule.tolist() if at == t or (at == 0 and t == 1)}
        for r, k in new.items():
            if r in task and done.get(task[r], 0) and k != task[r]:
                return False
        task = {r: k for r, k in {**task, **new}.items() if k >= 0}
        if len(set(task.values())) < len(task) or any(k in finished or k >= shown for k in task.values()):
            return False
        for r in sorted(task):
            k = task[r]
            errands = problem.errands_of(k).tolist()
            if places[r][0] * width + places[r][1] == errands[done.get(k, 0)]:
                done[k] = done.get(k, 0) + 1
                events.append((t, r, k, done[k]))
                if done[k] == len(errands):
                    finished.add(k)
        task = {r: k for r, k in task.items() if k not in finished}
        shown = problem.num_revealed + len(finished)
    return events == [tuple(row) for row in solution.event.tolist()] and len(finished) == solution.num_done


def test_mutations_are_judged_as_by_slow_truth_and_nearly_all_rejected():
    problem = problem_of(ROUND, [0, 1, 5], [[3], [8], [2, 6], [7], [1, 0]], 4)
    solution = solution_of(problem, 40)
    rng = np.random.default_rng(5)
    rejected = 0
    for trial in range(300):
        action, schedule, event = solution.action.copy(), solution.schedule.copy(), solution.event.copy()
        kind = trial % 3
        if kind == 0:
            r, t = rng.integers(0, 3), rng.integers(0, 40)
            action[r, t] = (action[r, t] + rng.integers(1, 4)) % 4
        elif kind == 1:
            schedule[rng.integers(0, len(schedule)), 2] += rng.choice([-1, 1])
        else:
            event[rng.integers(0, len(event)), rng.integers(1, 4)] += rng.choice([-1, 1])
        mutant = replace(solution, action=action, schedule=schedule, event=event)
        valid = judge_step_wise(problem, mutant).valid
        assert valid == slow_truth(problem, mutant), (trial, kind)
        rejected += not valid
    assert rejected > 280


def test_waiting_for_ever_is_valid():
    problem = problem_of(["..."], [0, 2], [[1]])
    idle = np.full((2, 9), WAIT, np.int8)
    assert fault(problem, replace(by_hand(problem, ["W", "W"]), action=idle)) == ""


@pytest.mark.parametrize(("steps", "since"), [(16, None), (17, 2), (100, 2)])
def test_a_crowd_without_errands_for_three_crossings_of_the_map_has_stalled(steps, since):
    """The map is one by four cells: the robot does its only errand at step 2, and stands."""
    problem = problem_of(["...."], [0], [[2, 0]])
    pace = pace_of(problem, by_hand(problem, ["FF" + "W" * (steps - 2)], [(1, 0, 0)], [(2, 0, 0, 1)]))
    assert pace.stalled_since_step == since and pace.wait_share == (steps - 2) / steps
    assert sum(pace.errands_by_tenth) == 1


def test_errands_of_each_tenth():
    """Two robots in twenty steps, which do errands at steps 1, 2, 3 and 20."""
    problem = problem_of(["....", "...."], [0, 4], [[0]])
    events = [(1, 0, 0, 1), (2, 1, 0, 1), (3, 0, 0, 1), (20, 0, 0, 1)]
    pace = pace_of(problem, by_hand(problem, ["W" * 20, "R" * 20], (), events))
    assert pace == CrowdProgress((2, 1, 0, 0, 0, 0, 0, 0, 0, 1), 0.5, None)


def test_a_run_in_which_nothing_is_ever_done_has_stalled_from_the_start():
    problem = problem_of(["...."], [0], [[2]])
    assert pace_of(problem, by_hand(problem, ["W" * 15])).stalled_since_step == 0
    assert pace_of(problem, by_hand(problem, ["W" * 14])).stalled_since_step is None
