"""Prioritised planning: paths that are longer than looked for at first, and starts that nobody can leave at once."""

from worlds import corridor, on_a_circle, problem_on

from mrp_sumo.core.plan import Status
from mrp_sumo.planning.registry import planner
from planners.safe_interval import prioritised

LENGTH = 120
PASSAGE = [(v, v + 1) for v in range(LENGTH - 1)]
BAY = on_a_circle([lane for a, b in [*PASSAGE, (LENGTH - 2, LENGTH)] for lane in ((a, b), (b, a))], LENGTH + 1)


def passing():
    """A robot that waits in a bay at one end of a corridor until another has come, and then goes all the way back."""
    return problem_on(BAY, [0, LENGTH], [LENGTH - 1, 0])


def test_a_path_may_take_longer_than_all_shortest_ones_and_some_steps():
    result = planner("prioritised", {}).plan(passing(), 60.0)
    assert result.status is Status.SOLVED and result.plan.end_s.tolist() == [LENGTH - 1, 2 * LENGTH - 3]
    assert result.stats["orders"] == 1


def test_no_order_has_a_plan_where_there_is_no_memory_for_long_paths(monkeypatch):
    monkeypatch.setattr(prioritised, "MOST_BYTES", 1)
    result = planner("prioritised", {"restarts": 3}).plan(passing(), 60.0)
    assert result.status is Status.GAVE_UP and result.stats["orders"] == 4


def test_nobody_enters_a_start_that_cannot_be_left_in_time_where_following_is_refused():
    """So that the first order has a plan, though the robot behind goes first in it."""
    result = planner("prioritised", {"following": True}).plan(problem_on(corridor(6), [0, 1], [4, 5]), 60.0)
    assert result.plan.end_s.tolist() == [5, 4] and result.stats["orders"] == 1
