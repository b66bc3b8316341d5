"""Draws of the paper on MRP-Bench's own airport, where they are at hand: two places of it are one cell, so some have no plan."""

from pathlib import Path

import pytest

from mrp_sumo.core.plan import Status
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.set_up import set_up
from mrp_sumo.io.scenario import find_scenario, read_scenario
from mrp_sumo.planning.registry import planner

AIRPORT = Path(__file__).parents[3] / "shared/maps/corpus/boschresearch+mrp_bench/airport_terminal.building.yaml"


@pytest.mark.parametrize("name", ["cbs", "ecbs", "eecbs", "cbs_ta", "ecbs_ta", "lacam"])
def test_draw_with_two_goals_in_one_cell_is_infeasible(name):
    if not AIRPORT.exists():
        pytest.skip(f"{AIRPORT.name} of MRP-Bench is not here")
    chosen = {("map",): ("map", {"file": str(AIRPORT), "graph": "all"}), ("seed",): ("seed", 3029), ("planner", "name"): ("planner", name)}
    with MapCache() as maps:
        problem = set_up(read_scenario(find_scenario("airport_9"), chosen), maps).problem
        result = planner(name, {}).plan(problem, 1.0)
    assert result.status is Status.INFEASIBLE
    assert "havanese_a" in result.message
