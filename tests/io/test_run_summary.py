"""A run in a few lines."""

import pytest

from mrp_sumo.io.run_summary import planner_of, run_summary

RESULT = {
    "status": "time_limit",
    "note": "",
    "policy": "adg",
    "seed": 7,
    "scenario": {"name": "lane", "map": {"file": "lane.map"}, "planner": {"name": "pibt"}},
    "metrics": {
        **{"num_robots": 2, "plan_success": True, "plan_valid": False, "planning_time_s": 0.0125, "lower_bound_steps": 0},
        **{"soc_steps": 14, "goals_reached": 1, "execution_time_s": 30.0, "execution_timed_out": True, "lateness_mean_s": -0.6},
    },
}


def test_run_is_told_in_order_without_what_is_not_known():
    assert run_summary(RESULT).rows == (
        ("status", "time limit"),
        ("to change", "a planner that coordinates robots, such as lacam: this plan has conflicts"),
        ("map", "lane.map, 2 robots, seed 7"),
        ("planner", "pibt, plan has conflicts"),
        ("planning time", "12.5 ms"),
        ("cost", "14 steps (sum of costs)"),
        ("goals reached", "1 of 2, policy adg"),
        ("lateness", "mean 0.6 s early"),
    )


def test_lateness_of_less_than_is_shown_is_0_s():
    metrics = {**RESULT["metrics"], "lateness_mean_s": 1e-13, "lateness_max_s": None}
    assert dict(run_summary({**RESULT, "metrics": metrics}).rows)["lateness"] == "mean 0 s"


@pytest.mark.parametrize(("saved", "said"), [(0.254, ", 25 % of the way saved by bundling"), (0.0, ""), (None, "")])
def test_what_bundling_saved_is_told_where_orders_were_bundled(saved, said):
    metrics = RESULT["metrics"] | {"tasks_done": 3, "tasks_open": 1, "throughput_per_h": 6.0, "bundled_saved_share": saved}
    assert dict(run_summary({**RESULT, "metrics": metrics}).rows)["orders"] == f"3 done, 1 open, 6 an hour{said}"


def test_plug_ins_go_by_the_stems_of_their_files():
    scenario = RESULT["scenario"] | {"planner": {"name": "./my/greedy.py:Greedy"}}
    rows = dict(run_summary({**RESULT, "scenario": scenario, "policy": "/work/late.py:LateStart"}).rows)
    assert rows["planner"].startswith("greedy, ") and rows["goals reached"] == "1 of 2, policy late"


def test_portfolio_names_who_planned():
    scenario = RESULT["scenario"] | {"planner": {"name": "auto"}}
    assert planner_of({**RESULT, "scenario": scenario, "planner": {"chosen": "lns2", "why": "few robots"}}) == "auto: lns2"
    assert planner_of({**RESULT, "scenario": scenario}) == "auto"


def test_run_without_a_plan_says_so():
    metrics = {"num_robots": 2, "plan_success": False}
    output = run_summary({**RESULT, "status": "planning_timed_out", "note": "no time", "policy": None, "metrics": metrics})
    names, texts = zip(*output.rows)
    assert names == ("status", "to change", "map", "planner")
    assert (texts[0], texts[3]) == ("planning timed out, no time", "pibt, no plan")
