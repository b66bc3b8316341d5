"""What a run says of a portfolio: who planned, and why."""

import pytest

import mrp_sumo as ms

DRIVEN = {"engine": "kinematic", "time_limit_s": 120}


def driven(**keys):
    return ms.run(ms.Scenario(map="office", robots=3, seed=1, record={"bag": False}, execution=DRIVEN, **keys)).result


def test_run_says_who_planned_and_why():
    result = driven()
    assert result["scenario"]["planner"]["name"] == "auto"
    assert result["planner"] == {"chosen": "ecbs", "why": "few enough robots (3) to try a bounded search first"}
    assert result["metrics"]["plan_valid"]


def test_other_planners_have_no_choice_to_tell_of():
    assert "planner" not in driven(planner="cbs")


@pytest.mark.parametrize(("portfolio", "by"), [(["pibt", "lacam"], "pibt"), (["lacam", "pibt"], "lacam")])
def test_run_with_tasks_counts_the_plans_of_each(portfolio, by):
    planner = {"name": "auto", "parameters": {"planners": portfolio}}
    result = driven(planner=planner, tasks={"streams": [{"name": "o", "stops": ["pantry", "lobby"], "arrivals": {"open": 3}}]})
    assert result["metrics"]["planner_calls_failed"] == 0
    assert result["planner"]["plans"] == {by: result["metrics"]["planner_calls"]}
    assert result["planner"]["chosen"] == by
