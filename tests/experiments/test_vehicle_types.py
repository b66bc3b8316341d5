"""Lanes, limits and headings that a LIF has for some types of vehicles, in runs of such types."""

import json

import numpy as np
import pytest
import yaml
from lif_worlds import TYPE, edge, lif, node

import mrp_sumo as ms
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import carry_out
from mrp_sumo.experiments.staging.set_up import set_up
from mrp_sumo.io.scenario.read import read_scenario

SLOW = "maker.slow"
CORNERS = {"A": (0.0, 0.0), "B": (10.0, 0.0), "C": (10.0, 8.0), "D": (0.0, 8.0)}
CART = {"length_m": 0.8, "width_m": 0.6, "max_speed_mps": 1.0, "accel_mps2": 1.0, "decel_mps2": 1.0, "turn_rate_rad_s": 1.0}


def rectangle(folder):
    """Both types may use all lanes but those between A and B, which the slow one may not; elsewhere it has a limit."""
    document = lif()
    layout = document["layouts"][0]
    layout["nodes"] = [node(name, *xy) for name, xy in CORNERS.items()]
    pairs = [*zip("ABCD", "BCDA"), *zip("BCDA", "ABCD")]
    layout["edges"] = [edge(a, b, maxSpeed=0.9) for a, b in pairs]
    for each in layout["nodes"]:
        each["vehicleTypeNodeProperties"].append({"vehicleTypeId": SLOW})
    for each in layout["edges"]:
        if {each["startNodeId"], each["endNodeId"]} != {"A", "B"}:
            own = {"vehicleTypeId": SLOW, "rotationAllowed": False, "maxSpeed": 0.4}
            each["vehicleTypeEdgeProperties"].append(own)
    layout["stations"] = []
    path = folder / "rectangle.lif.json"
    path.write_text(json.dumps(document))
    return path


def file_of(folder, *groups, **more):
    """A scenario of robots of types, each with its name in the layout, a start and a goal."""
    rectangle(folder)
    fleet = [{"type": {**CART, "vehicle_type": name}, "count": 1, "starts": [start], "goals": [goal]} for name, start, goal in groups]
    scenario = {
        "map": "rectangle.lif.json",
        "robots": fleet,
        "discretisation": {"kind": "roadmap", "cell_m": 2.0},
        "planner": "prioritised",
        "execution": {"engine": "kinematic"},
        **more,
    }
    path = folder / "scenario.yaml"
    path.write_text(yaml.safe_dump(scenario))
    return read_scenario(path)


def driven(folder, *groups, **more):
    with MapCache() as maps:
        result = carry_out(file_of(folder, *groups, **more), maps)
    assert result.status == "completed" and result.audit["passed"], result.note
    return result


def corners_of(result, robot=0):
    """Names of the corners that a robot passes."""
    execution = result.execution
    at = np.stack([execution.x_m[:, robot], execution.y_m[:, robot]], 1)
    return {name for name, xy in CORNERS.items() if (np.hypot(*(at - xy).T) < 0.3).any()}


def test_type_that_is_barred_goes_round_and_the_other_does_not(tmp_path):
    assert corners_of(driven(tmp_path, (TYPE, "A", "B"))) == {"A", "B"}
    assert corners_of(driven(tmp_path, (SLOW, "A", "B"))) == {"A", "B", "C", "D"}


def test_limit_of_the_type_that_is_driven_holds(tmp_path):
    assert driven(tmp_path, (TYPE, "B", "C")).execution.speed_mps.max() == pytest.approx(0.9, abs=0.01)
    assert driven(tmp_path, (SLOW, "B", "C")).execution.speed_mps.max() == pytest.approx(0.4, abs=0.01)


def test_each_of_two_types_keeps_to_its_lanes(tmp_path):
    result = driven(tmp_path, (TYPE, "A", "B"), (SLOW, "B", "A"))
    assert corners_of(result, 0) == {"A", "B"}
    assert corners_of(result, 1) == {"A", "B", "C", "D"}
    assert result.execution.speed_mps[:, 1].max() <= 0.4 + 1e-6
    assert result.execution.speed_mps[:, 0].max() > 0.8  # nobody else has a limit on its lane


def test_type_that_the_layout_does_not_know_may_go_everywhere(tmp_path):
    assert corners_of(driven(tmp_path, ("other", "A", "B"))) == {"A", "B"}
    result = driven(tmp_path, ("other", "A", "B"), (SLOW, "B", "A"))
    assert (corners_of(result, 0), len(corners_of(result, 1))) == ({"A", "B"}, 4)


def test_type_without_a_name_of_its_own_is_known_in_layouts_as_ours(tmp_path):
    (tmp_path / "cart.yaml").write_text(yaml.safe_dump(CART))
    file = file_of(tmp_path, (TYPE, "A", "B"))
    path = tmp_path / "rectangle.lif.json"
    path.write_text(path.read_text().replace(SLOW, "mrp_sumo.cart"))
    (tmp_path / "scenario.yaml").write_text(
        yaml.safe_dump({"map": "rectangle.lif.json", "robots": {"count": 1, "type": "./cart.yaml"}, "planner": "prioritised"})
    )
    with MapCache() as maps:
        assert set_up(read_scenario(tmp_path / "scenario.yaml"), maps).map.nav.num_lanes == 6
        assert set_up(file, maps).map.nav.num_lanes == 8


def test_chosen_type_of_the_scenario_counts_more_than_that_of_its_robots(tmp_path):
    with MapCache() as maps:
        chosen = file_of(tmp_path, (TYPE, "A", "B"), map={"file": "rectangle.lif.json", "vehicle_type": SLOW})
        assert set_up(chosen, maps).map.nav.num_lanes == 6


@pytest.mark.slow
@pytest.mark.parametrize("name", ["plant_forklifts", "plant_tuggers"])
def test_vehicles_of_the_bundled_plant_keep_working_on_its_curves(name):
    result = ms.run(ms.Scenario.read(name).replace(execution={"time_limit_s": 7200}, record={"bag": False}))
    assert result.status == "completed" and result.audit["passed"]
    assert result.metrics["planner_calls_failed"] == 0
