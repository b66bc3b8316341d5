"""Our numbers beside those of the MRP-Bench paper."""

import math

import numpy as np
import pandas as pd
import pytest

from mrp_sumo.experiments.paper import kinds_of
from mrp_sumo.experiments.statistics import Interval
from mrp_sumo.reports.paper import beside
from mrp_sumo.reports.paper.beside import BesidePaper
from mrp_sumo.reports.paper.printed import map_of_paper, printed
from mrp_sumo.reports.study import _study

SEEDS = 20


def study(arrived):
    """Driven runs on the warehouse; `arrived[planner, robots]` says how many of 20 seeds arrive, the first ones."""
    rows = [
        {
            "status": "completed" if seed < count else "time_limit",
            "success": seed < count,
            "planner": planner,
            "map": "warehouse",
            "robots.count": robots,
            "num_robots": robots,
            "seed": seed,
            "execution.policy": "open_loop",
            "execution.recovery.replanner": None,
            "plan_success": True,
            "plan_valid": planner != "astar",
            "all_goals_reached": seed < count,
            "makespan_steps": 50 + seed % 7 + (planner == "cbs") * 5,
            "cost_steps": 200 + seed % 7,
        }
        for (planner, robots), count in arrived.items()
        for seed in range(SEEDS)
    ]
    return _study("paper_table_3", "", "execution", pd.DataFrame(rows), [], {})


def test_paper_agrees_within_the_digits_that_it_prints():
    assert BesidePaper({}, "percent", Interval(80, 70, 83.6, 100), 84).agrees  # anything from 83.5 is printed as 84
    assert not BesidePaper({}, "percent", Interval(80, 70, 83.4, 100), 84).agrees
    assert BesidePaper({}, "cells", Interval(65, 64, 65.26, 10), 65.3).agrees
    assert BesidePaper({}, "percent", Interval(80, 70, 90, 100)).agrees is None


def test_number_without_an_interval_is_null_in_json():
    document = BesidePaper({"map": "office"}, "mean_s", Interval(1.0, math.nan, math.nan, 1)).document
    assert (document["ours"], document["low"], document["high"], document["paper_value"]) == (1.0, None, None, None)


def test_printed_numbers_are_found_by_table_and_row():
    assert printed("table_3", "normalised", map_of_paper("warehouse"), "ecbs") == 89
    assert printed("table_1", map_of_paper("airport_terminal"), "cells") == 105700
    assert printed("table_2", "airport", "cbs") is None
    assert printed("table_4", "cost_cells", "lacam") is None


def test_paper_stands_beside_5_and_9_robots_together_driven_without_order():
    rows = beside.table_3(study({("cbs", 5): 18, ("cbs", 9): 12}))
    (both,) = (r for r in rows if r.quantity == "overall_percent" and r.labels["robots"] == "5 and 9")
    assert (both.ours.value, both.ours.count, both.paper_value) == (75, 2 * SEEDS, 70)
    assert all(r.paper_value is None for r in rows if r.labels["robots"] in ("5", "9"))


def test_normalised_rate_is_of_scenarios_that_every_planner_solved():
    result = study({("cbs", 9): 10, ("ecbs", 9): 20})
    unsolved = result.frame["planner"].eq("cbs") & result.frame["seed"].isin(range(15, 20))
    result.frame.loc[unsolved, "_planned"] = False
    normalised = {r.labels["planner"]: r for r in beside.table_3(result) if r.quantity == "normalised_percent"}
    assert (normalised["cbs"].ours.count, normalised["ecbs"].ours.count) == (15, 15)
    assert normalised["cbs"].ours.value == pytest.approx(100 * 10 / 15)


def test_order_is_tested_on_the_same_runs():
    result = study({("astar", 9): 2, ("cbs", 9): 18})
    arrived, makespan, cost = beside.order(result, result)
    assert (arrived.first, arrived.second) == ("astar", "cbs")
    assert arrived.difference.value == pytest.approx(80)
    assert arrived.p_value < 0.001
    assert arrived.paper_difference == 70 - 77
    assert arrived.verdict == "the other way round"
    assert (makespan.difference.value, makespan.verdict) == (5, "as in the paper")
    assert (cost.p_value, cost.verdict) == (1, "too close to tell")


def test_times_of_planners_that_solve_nothing_are_missing():
    result = study({("cbs", 5): 1})
    result.frame["planning_time_s"] = np.nan
    mean, spread = beside.figure_5(result)
    assert mean.document["ours"] is None
    assert spread.document["low"] is None


def test_scenarios_of_the_paper_s_kinds_are_looked_for_with_five_robots_first():
    both = study({("astar", 5): 18, ("ecbs", 5): 19, ("eecbs", 5): 19, ("astar", 9): 0, ("ecbs", 9): 0, ("eecbs", 9): 0})
    kinds = kinds_of(both.frame)
    assert (kinds.robots, kinds.hard, kinds.easy) == (5, (19,), (18,))  # of seed 18 only A*'s plan fails
    more = study({("astar", 5): 20, ("ecbs", 5): 20, ("eecbs", 5): 20, ("astar", 9): 3, ("ecbs", 9): 3, ("eecbs", 9): 3})
    kinds = kinds_of(more.frame)
    assert (kinds.robots, kinds.hard, kinds.easy) == (9, (3, 4), (0,))  # all with five survive; of nine none survives by chance
