"""Rules of 2026: actions that take several ticks, and squares that must not overlap, beside a slow truth of sampled squares."""

from dataclasses import replace

import numpy as np
import pytest
from step_wise_worlds import problem_of

from mrp_sumo.core.step_wise import FORWARD, WAIT, StepWiseSolution, cell_ahead
from mrp_sumo.traffic.step_wise_referee import judge_step_wise

TICKS, SAMPLES = 3, 4
COLUMN, ROW = (1, 0, -1, 0), (0, 1, 0, -1)


def solution_of(problem, paths, schedule=(), events=(), released=None, done=0):
    action = np.array([["FRCW".index(a) for a in path] for path in paths], np.int8)
    released = [0] * problem.num_revealed if released is None else released
    errands = tuple(tuple(problem.errands_of(k).tolist()) for k in range(len(released)))
    rows = [np.array(table, np.int64).reshape(-1, n) for table, n in ((schedule, 3), (events, 4))]
    return StepWiseSolution(problem.start, np.zeros(len(paths), np.int64), action, *rows, np.array(released), errands, done, in_ticks=True)


@pytest.mark.parametrize(
    ("rows", "start", "size", "paths", "fault"),
    [
        (["..."], [0], 1.0, ["FFFFFF"], ""),
        (["..."], [0], 1.0, ["FWFWFWWFFF"], ""),  # held up on the way
        (["..."], [0], 1.0, ["FFRRR"], "tick 3: robot 0 begins another action after 2 of 3 ticks of its last"),
        (["..@"], [0], 1.0, ["FFFF"], "tick 4: robot 0 drives from row 0, column 1 into what is not free"),
        (["..", ".."], [0], 1.0, ["RRRFFF"], ""),
        (["...."], [0, 1], 1.0, ["FFFW", "FFFW"], "tick 1: robots 0 and 1 come too close at row 0, column 1"),
        (["...."], [0, 1], 1.0, ["WFFF", "FFFW"], ""),  # a tick behind
        (["...."], [0, 1], 0.6, ["FFFW", "FFFW"], ""),  # small squares at once
        (["...."], [0, 1], 1.0, ["WFFFW", "FWFFW"], "tick 3: robots 0 and 1 come too close at row 0, column 1"),
        (["..", ".."], [0, 3], 1.0, ["FFFWWW", "WWWWWW"], ""),
        (["..", ".."], [0, 3], 1.0, ["FFFWWWWWW", "CCCWWFFFW"], "tick 6: robots 0 and 1 come too close at row 0, column 1"),
    ],
)
def test_squares_keep_apart_and_actions_are_finished(rows, start, size, paths, fault):
    problem = replace(problem_of(rows, start, [[start[0]]] * len(start)), ticks=TICKS, size=size)
    assert judge_step_wise(problem, solution_of(problem, paths)).fault == fault


def test_errands_are_done_where_a_robot_arrives():
    problem = replace(problem_of(["..."], [0], [[1, 2], [0]]), ticks=TICKS)
    solution = solution_of(problem, ["FFFWFFF"], [(1, 0, 0)], [(3, 0, 0, 1), (7, 0, 0, 2)], [0, 7], 1)
    assert judge_step_wise(problem, solution).tasks_done == 1 and not judge_step_wise(problem, solution).fault
    early = replace(solution, event=np.array([[2, 0, 0, 1], [7, 0, 0, 2]]))
    assert judge_step_wise(problem, early).fault.startswith("tick 2: errand 1 of task 0 by robot 0 is stated, but the robot is at no cell")


def wandering(problem, num_ticks, rng):
    """Letters [R, T] of robots that go anywhere, and wait where progress would bring squares together."""
    robots, ahead = problem.num_robots, cell_ahead(problem.free)
    cell, heading, doing, progress = problem.start.copy(), np.zeros(robots, int), np.full(robots, WAIT), np.zeros(robots, int)
    letters = np.full((robots, num_ticks), WAIT, np.int8)
    unsafe = []  # (robot, tick, action) that would have brought squares together
    for t in range(num_ticks):
        step = np.zeros(robots, int)  # ticks of progress that have been decided
        for r in rng.permutation(robots):
            action = int(doing[r]) if progress[r] else int(rng.choice([0, 0, 0, 1, 2]))
            if action == FORWARD and ahead[cell[r], heading[r]] < 0:
                action = 1
            old, doing[r], step[r] = doing[r], action, 1
            if all(o == r or apart(problem, cell, heading, doing, progress, step, r, o) for o in range(robots)):
                letters[r, t] = action
            else:
                unsafe.append((r, t, action))
                doing[r], step[r] = old, 0
        progress += step
        for r in np.flatnonzero(progress == problem.ticks):
            progress[r] = 0
            if doing[r] == FORWARD:
                cell[r] = ahead[cell[r], heading[r]]
            else:
                heading[r] = (heading[r] + (1 if doing[r] == 1 else -1)) % 4
    return letters, unsafe


def apart(problem, cell, heading, doing, progress, step, one, other):
    """Whether no moment of one's tick overlaps with any moment of the other's."""

    def places(r):
        y, x = divmod(int(cell[r]), problem.free.shape[1])
        for part in np.linspace(0, 1, SAMPLES):
            share = (progress[r] + part * step[r]) / problem.ticks * (doing[r] == FORWARD)
            yield np.array([y + share * ROW[heading[r]], x + share * COLUMN[heading[r]]])

    return all(np.abs(a - b).max() >= problem.size - 1e-9 for a in places(one) for b in places(other))


def test_safe_wandering_is_accepted_and_every_unsafe_tick_is_rejected():
    accepted = rejected = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        size = (1.0, 0.8)[seed % 2]
        problem = replace(problem_of(["....."] * 4, rng.permutation(20)[:7].tolist(), [[0]]), ticks=TICKS, size=size, num_revealed=1)
        letters, unsafe = wandering(problem, 40, rng)
        paths = ["".join("FRCW"[a] for a in row) for row in letters]
        assert judge_step_wise(problem, solution_of(problem, paths)).fault == ""
        accepted += 1
        for r, t, action in unsafe[:30]:
            row = paths[r]
            changed = [*paths[:r], row[:t] + "FRCW"[action] + row[t + 1 :], *paths[r + 1 :]]
            fault = judge_step_wise(problem, solution_of(problem, changed)).fault
            assert fault.startswith(f"tick {t + 1}: robots"), fault
            rejected += 1
    assert accepted == 6 and rejected > 50
