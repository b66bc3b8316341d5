"""Answers that all planners give alike."""

from types import SimpleNamespace

import pytest

from mrp_sumo.core.plan import Status
from mrp_sumo.errors import PlanError, ScenarioError
from mrp_sumo.planning.answers import answer_of, require_least
from mrp_sumo.planning.registry import parameter_names, planner, planner_names
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


def test_parameter_out_of_bounds_is_told_with_its_value_and_without_the_planner_whom_the_caller_names():
    for key, least, most in (("threads", 1, 256), ("neighbourhood", 1, 1000), ("polish", 0, None)):
        require_least(SimpleNamespace(**{key: most or 10**30}), **{key: least})
        require_least(SimpleNamespace(**{key: least}), **{key: least})
        expected = f"{least} or more" if most is None else f"{least} to {most}"
        for value in (least - 1, *(() if most is None else (most + 1,))):
            with pytest.raises(PlanError, match=rf"^{key} is {value}, expected {expected}$"):
                require_least(SimpleNamespace(**{key: value}), **{key: least})


@pytest.mark.parametrize("name", planner_names())
def test_no_message_on_a_parameter_names_its_planner_twice(name):
    for key in parameter_names(name):
        with pytest.raises(ScenarioError, match=rf"^(?:(?!\b{name}\b).)*'{name}'(?:(?!\b{name}\b).)*$"):
            planner(name, {key: -1.5})
