"""Draws of the paper on MRP-Bench's own airport: two places of it are one cell, so some have no plan."""

import pytest
from golden import MRP_BENCH

from mrp_sumo.core.plan import Status
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.staging.set_up import set_up
from mrp_sumo.io.scenario.file import find_scenario
from mrp_sumo.io.scenario.read import read_scenario
from mrp_sumo.planning.registry import planner

AIRPORT = MRP_BENCH / "airport_terminal.building.yaml"


@pytest.mark.parametrize("name", ["cbs", "ecbs", "eecbs", "cbs_ta", "ecbs_ta", "lacam"])
def test_draw_with_two_goals_in_one_cell_is_infeasible(name):
    chosen = {("map",): ("map", {"file": str(AIRPORT), "graph": "all"}), ("seed",): ("seed", 3029), ("planner", "name"): ("planner", name)}
    with MapCache() as maps:
        problem = set_up(read_scenario(find_scenario("airport_9"), chosen), maps).problem
        result = planner(name, {}).plan(problem, 1.0)
    assert result.status is Status.INFEASIBLE
    assert "havanese_a" in result.message
