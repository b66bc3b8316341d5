"""Answers that all planners give alike."""

from mrp_sumo.core.plan import Status
from mrp_sumo.planning.answers import answer_of
from planners.world import small_problem


class Hungry:
    """Asks for more than there is, as a search that has grown does."""

    assigns = False
    guarantee = "none"

    def prepare(self):
        """Nothing to compile."""

    def plan(self, problem, time_limit_s):
        raise MemoryError("Allocation failed (probably too large).")


def test_planner_that_is_refused_memory_has_given_up():
    result = answer_of(Hungry(), small_problem(), 1.0)
    assert result.status is Status.GAVE_UP
    assert result.plan is None
    assert result.message.startswith("no memory left after")
