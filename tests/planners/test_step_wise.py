import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from step_wise_worlds import ROUND, problem_of

from mrp_sumo.core.step_wise import StepWiseProblem
from mrp_sumo.planning.step_wise import run_step_wise
from mrp_sumo.plugins.registry import make, names
from mrp_sumo.traffic.step_wise_referee import judge_step_wise
from planners.step_wise.ground import FreeCells, moved_up, operations, outward
from planners.step_wise.traffic import CrowdRoom, let_out

LETTERS = "FRCW"


def crowd(seed, height=8, width=8, share=0.3):
    """Robots on a random map, and tasks of one to three errands."""
    rng = np.random.default_rng(seed)
    free = rng.random((height, width)) > 0.1
    cells = np.flatnonzero(free)
    first = np.cumsum([0, *rng.integers(1, 4, 300)])
    start = rng.permutation(cells)[: int(share * len(cells))]
    return StepWiseProblem("crowd", free, start, first, rng.choice(cells, first[-1]), int(1.5 * len(start)))


def ran(problem, num_steps, name="epibt", seed=0, **parameters):
    """A run that the referee accepts."""
    run = run_step_wise(problem, make("step_planners", name, parameters), num_steps, seed)
    assert judge_step_wise(problem, run.solution).fault == ""
    return run.solution


def letters(solution):
    return ["".join(LETTERS[a] for a in row) for row in solution.action]


@pytest.mark.kernel
def test_robot_alone_turns_and_drives_the_shortest_way():
    problem = problem_of(["...", ".@.", "..."], [0], [[8], [0]])
    solution = ran(problem, 11, tasks="in_turn")
    assert letters(solution)[0][:5] in ("FFRFF", "RFFCF")  # both ways take five steps
    assert solution.event[0].tolist() == [5, 0, 0, 1]
    assert solution.num_done == 2


@pytest.mark.kernel
def test_robot_in_the_way_makes_room():
    problem = problem_of(["....", "@.@@"], [0, 1], [[3], [1]], 2)
    solution = ran(problem, 40, tasks="in_turn")
    assert 3 in solution.event[solution.event[:, 1] == 0][:, 2] or (solution.event[:, 2] == 0).any()


@pytest.mark.kernel
def test_robots_drive_to_tasks_of_their_own_where_the_problem_says_so():
    """Both tasks are nearer to the other robot."""
    problem = problem_of(["......", "......"], [0, 11], [[10], [1]])
    assert dict(ran(problem, 30).event[:2, [1, 2]].tolist()) == {0: 1, 1: 0}
    assert {(robot, task % 2) for _, robot, task, _ in ran(replace(problem, own_tasks=True), 30).event.tolist()} == {(0, 0), (1, 1)}


@pytest.mark.kernel
def test_full_ring_turns():
    problem = problem_of(ROUND, [0, 1, 2, 5, 8, 7, 6, 3], [[c] for c in (1, 2, 5, 8, 7, 6, 3, 0)], 8)
    solution = ran(problem, 8, tasks="in_turn", depth=3)
    assert set(range(8)) <= set(solution.event[:, 2].tolist())
    assert (solution.action == 0).any(axis=1).all()


def test_a_crowd_that_stands_still_is_led_out():
    """Two rows that one aisle joins, where four robots stand off for good if each chooses for itself."""
    problem = problem_of([".....", "@@.@@", "@@.@@", "....."], [0, 4, 15, 19], [[0, 19], [15, 4], [12, 2]], 6)
    times = ran(problem, 400).event[:, 0]
    assert (np.diff([0, *times, 400]) < 100).all(), times


def test_robots_with_tasks_of_their_own_are_not_led_out_while_errands_are_done(monkeypatch):
    """The first robot goes to and fro; the second, which has done more tasks by then, is under way for long."""
    monkeypatch.setattr("planners.step_wise.stepper.way_out", lambda *_: pytest.fail("led out"))
    tasks = [[cell] for k in range(8) for cell in (3, 201 + 2 * k, 0, 202 + 2 * k)]
    problem = problem_of(["." * 100, "@" * 100, "." * 100], [0, 200], [*tasks, [3], [299]])
    assert ran(replace(problem, own_tasks=True), 90).num_done > 25


def test_a_robot_on_its_way_to_the_first_errand_is_not_led_out(monkeypatch):
    """Nothing is done yet, and no task of a number above 0 is in the pool."""
    monkeypatch.setattr("planners.step_wise.stepper.way_out", lambda *_: pytest.fail("led out"))
    assert ran(problem_of(["....."], [0], [[4]]), 4).num_done == 1


def test_a_crowd_for_which_there_is_no_way_out_stays():
    """Two robots in an aisle, each with errands behind the other."""
    problem = problem_of(["....."], [1, 3], [[4], [0]])
    assert not len(ran(replace(problem, own_tasks=True), 200).event)


@pytest.mark.kernel
def test_tasks_that_cannot_be_ended_are_not_begun():
    """The first of three tasks leads through a wall: robot 1 stands at its first errand. It is left until the pool has no other."""
    problem = problem_of(["..@.."], [0, 4], [[4, 0], [3, 4], [0, 1]], 3)
    solution = ran(problem, 40)
    assert solution.num_done == 4 and not (solution.event[:, 2] % 3 == 0).any()


@pytest.mark.kernel
def test_nearest_tasks_are_those_of_the_least_sum():
    problem = problem_of(["......."], [1, 5], [[6], [0], [3]], 3)
    solution = ran(problem, 6)
    params = {(r, k) for t, r, k in solution.schedule.tolist() if t == 1}
    assert params == {(0, 2), (1, 0)}  # 2 + 1 steps; the robots look east


@pytest.mark.kernel
@pytest.mark.parametrize(("beside", "task"), [(1, 0), (7, 1)])
def test_a_long_task_beside_a_robot_comes_before_a_short_one_far_away(beside, task):
    """One leads through 8 cells or fewer to the row's end, the other one from cell 6 to 7: 1 and 6 steps away, or 7 and 6."""
    solution = ran(problem_of(["." * 10], [0], [[beside, 9], [6, 7]], 2), 1)
    assert solution.schedule.tolist() == [[1, 0, task]]


@pytest.mark.kernel
@pytest.mark.parametrize(("errands", "first"), [([14, 12], 1), ([23], 0)])
def test_who_chose_first_waits_where_another_gains_more(errands, first):
    """Both come to cell 14 in the second step. Robot 0, which has less to do, goes straight on there, or turns round in two more."""
    aisle = "@@." + "@" * 9
    problem = problem_of([aisle, "." * 12, *[aisle] * 30], [12, 2], [errands, [12 * 31 + 2]])
    action = ran(replace(problem, own_tasks=True), 2).action
    assert action[:, 1].tolist() == [3 * (first == 1), 3 * (first == 0)]


@pytest.mark.kernel
def test_distances_count_turns():
    problem = problem_of(["..", ".."], [1], [[0, 3]])
    ground = FreeCells(problem, 1)
    table = ground.table[ground.slot(3)]
    assert table[:4].tolist() == [3, 3, 4, 4]  # from the upper left: east, south, west, north
    assert table[12:].tolist() == [0, 0, 0, 0]
    assert ground.steps_left(0) == [3, 0]


@pytest.mark.kernel
@pytest.mark.parametrize(("goal", "costs"), [(2, [1, 2, 3, 2]), (0, [8, 7, 6, 7])], ids=("with", "against"))
def test_steps_against_the_direction_of_a_row_cost_more(goal, costs):
    """From the middle of the upper row, which leads east, by heading; a step west costs 1 + 5, and the way round no less."""
    ground = FreeCells(problem_of(["...", "..."], [0], [[0]]), 1, against=5)
    assert ground.table[ground.slot(goal)][4:8].tolist() == costs


def test_what_is_farther_than_a_table_can_say_is_far_and_not_cut_off():
    ground = FreeCells(problem_of(["." * 66_000], [0], [[65_990]]), 3)
    table = ground.table[ground.slot(65_990)]
    assert table[4 * 65_000] == 990 and table[4 * 500] == 65_490 and table[0] == 65_534


def test_forgotten_tables_are_made_again():
    problem = problem_of(["." * 200] * 20, [0], [[3]])
    ground = FreeCells(problem, 1)
    assert len(ground.table) < problem.free.sum()
    first = ground.table[ground.slot(7)].copy()
    for goal in range(100, 100 + len(ground.table)):
        ground.slot(goal)
    assert (ground.table[ground.slot(7)] == first).all()


@pytest.mark.kernel
def test_tables_beyond_the_work_of_a_step_wait_for_the_next():
    """A table of these eight states is more than all the work of a step, but one that has been begun is made."""
    ground = FreeCells(problem_of(["..", ".."], [0], [[3, 0, 1]]), 1, work=1)
    assert ground.slot(3) >= 0 and ground.slot(0) == -1
    assert ground.steps_left(0) == [3, 1, 0]  # two and one as rows and columns count
    ground.begin_step()
    assert ground.slot(0) >= 0


@pytest.mark.kernel
def test_tables_of_old_prices_serve_until_there_is_time_for_new_ones():
    ground = FreeCells(problem_of(["..."], [0], [[2]]), 1, against=2, work=1)
    assert ground.table[ground.slot(2), 0] == 2
    ground.reprice(np.full(12, 3, np.int32))
    assert ground.table[ground.slot(2), 0] == 2
    ground.begin_step()
    assert ground.table[ground.slot(2), 0] == 6


@pytest.mark.kernel
def test_the_last_of_a_crowd_are_sent_to_where_it_leaves_room():
    """A row of forty cells, the first thirty of which are full."""
    ground = FreeCells(problem_of(["." * 40], [0], [[1]]), 1)
    room, state = CrowdRoom(ground, 30), 4 * np.arange(30, dtype=np.int32)
    for _ in range(20):
        sent, there = room.send(state, np.arange(30)[::-1])
    assert set(sent.tolist()) <= set(range(12)) and 0 in sent  # the last twelve in the order
    assert len(set(there.tolist())) == 1
    steps = ground.table[there[0], 0::4]  # of those that head east
    assert (np.diff(steps[:30].astype(int)) <= 0).all() and steps[0] > steps[29] and steps[39] == 0
    everywhere = 4 * np.array([c for c in range(40) if c % 4], np.int32)
    assert len(CrowdRoom(ground, 30).send(everywhere, np.arange(30))[0]) == 0
    assert len(CrowdRoom(ground, 20).send(state[:20], np.arange(20))[0]) == 0  # no crowd


@pytest.mark.kernel
def test_robots_are_held_back_while_others_stand_in_jams():
    """A row of a hundred cells, with fifteen robots at its head."""
    ground = FreeCells(problem_of(["." * 100], [0], [[1]]), 1, against=1)
    room, state, order = CrowdRoom(ground, 15), 4 * np.arange(15, dtype=np.int32), np.arange(15)[::-1]
    for _ in range(6):
        held, there = room.send(state, order)
    assert 0 < len(held) < 12 and held.tolist() == order[-len(held) :].tolist()  # the last in the order
    steps = ground.table[there[0], 0::4]
    assert len(set(there.tolist())) == 1 and steps[0] >= room.in_jam.sum() > 5 and steps[99] == 0  # out of the jam
    for t in range(200):
        held, there = room.send(state + t % 2, order)  # they turn, so nobody stands
    assert len(held) == 0 and not room.in_jam.any()
    for other in (CrowdRoom(ground, 25), CrowdRoom(FreeCells(problem_of(["." * 100], [0], [[1]]), 1), 15)):
        assert len(other.send(state, order)[0]) == 0  # too many for the floor to be empty; no directions, as of too few robots


DEAD_END = ["....", ".@@.", "....", "@.@@", "@.@@"]  # cells 0 to 9 are a ring, 10 and 11 a dead end below cell 7


def test_dead_ends_are_left_the_way_they_are_entered():
    ground = FreeCells(problem_of(DEAD_END, [0], [[1]]), 1)
    assert ground.outward.tolist() == [-1] * 10 + [7, 10]
    assert outward(np.array([[1, -1, -1, -1], [2, -1, 0, -1], [-1, -1, 1, -1]])).tolist() == [1, -1, 1]  # an aisle


@pytest.mark.parametrize(
    ("goal", "rank"),
    [
        ([11, 0, 3], [5, 4.25, 4.5]),  # from cell 6 into the dead end: the outermost in it goes first
        ([10, 0, 3], [5, 4.5, 9]),
        ([7, 0, 3], [5, 8, 9]),  # to before it
        ([-1, 0, 3], [5, 8, 9]),
        ([0, 11, 3], [5, 8, 7.5]),  # the one that is half in
        ([0, 3, 10], [5, 8, 9]),  # who is inside does not come before itself, nor does anybody before who is let out
    ],
)
def test_who_stands_in_a_dead_end_comes_before_who_has_to_go_in(goal, rank):
    """Robot 0 at cell 6, robot 1 at 10, and robot 2 at the end, 11."""
    ground = FreeCells(problem_of(DEAD_END, [0], [[1]]), 1)
    assert let_out(ground.outward, np.array([6, 10, 11]), np.array(goal), np.array([5, 8, 9])).tolist() == rank


@pytest.mark.kernel
def test_robots_without_a_table_wait_for_it():
    """Two robots, each in a row of its own: the second one sets out a step later."""
    problem = problem_of(["....", "@@@@", "...."], [0, 8], [[3], [11]])
    assert letters(ran(problem, 4, tasks="in_turn", work=1)) == ["FFFW", "WFFF"]


def test_operations_are_those_of_use_and_closed_under_moving_up():
    result = {"".join(LETTERS[a] for a in row) for row in operations(3)}
    assert len(result) == 19
    assert {"WWW", "FFF", "RRF", "WCF", "RFW"} < result
    assert not {"RCF", "CCF", "FFR", "RWW"} & result
    for depth in (1, 2, 3, 4):
        action = operations(depth)
        assert (action[moved_up(action)][:, :-1] == action[:, 1:]).all()
        assert action[0].tolist() == [3] * depth


@pytest.mark.parametrize("name", [name for name in names("step_planners") if name != "program"])
@pytest.mark.parametrize("seed", range(4))
def test_crowds_are_planned_without_a_fault_and_alike_each_time(name, seed):
    problem = crowd(seed, share=0.2 + 0.2 * seed)
    solution = ran(problem, 60, name)
    assert (solution.action == ran(problem, 60, name).action).all()
    assert solution.num_done > 5


def test_operations_beat_single_actions():
    problem = crowd(2, 12, 12)
    assert ran(problem, 150).num_done > 1.1 * ran(problem, 150, depth=1).num_done


@pytest.mark.parametrize(
    ("name", "parameters"), [("epibt", wrong) for wrong in ({"depth": 7}, {"tries": -2}, {"tasks": "none"}, {"limit": -1}, {"against": -2})]
)
def test_parameters_out_of_range_are_refused(name, parameters):
    from mrp_sumo.errors import ScenarioError

    with pytest.raises(ScenarioError, match="expected"):
        make("step_planners", name, parameters)


def test_too_little_memory_is_refused():
    from mrp_sumo.errors import PlanError

    problem = problem_of(["." * 400] * 50, list(range(30)), [[3]])
    with pytest.raises(PlanError, match="memory_mb is 1, expected 10 or more"):
        make("step_planners", "epibt", {"memory_mb": 1}).begin(problem, 0)


@pytest.mark.slow
def test_kernels_as_plain_python_answer_the_same():
    ask = "from test_step_wise import crowd, letters, ran\nprint(letters(ran(crowd(1), 12)), letters(ran(crowd(3, share=0.8), 6, depth=1)))"
    paths = os.pathsep.join([str(Path(__file__).parent), str(Path(__file__).parents[1]), str(Path(__file__).parents[2])])
    answers = []
    for extra in ({}, {"NUMBA_DISABLE_JIT": "1"}):
        environment = {**os.environ, "PYTHONPATH": paths, **extra}
        answers.append(subprocess.run([sys.executable, "-c", ask], env=environment, capture_output=True, text=True, check=True).stdout)
    assert answers[0] == answers[1]
    assert "F" in answers[0]
