"""Whole buildings that Open-RMF's users draw: robots ride lifts and pass doors as planned. The corpus may be beside the checkout."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import carry_out
from mrp_sumo.io.scenario.read import read_scenario

CORPUS = Path(__file__).resolve().parents[3] / "shared" / "maps" / "corpus"
STEP_S = 0.1
MAPS = [  # and how many robots, with a seed that has them ride
    ("cardboardcode+rmf_gym_lite/simple_lift", 2, 7),
    ("osrf+rmf_demos/lift_test@2020-10-07", 4, 0),
    *(
        pytest.param(*each, marks=pytest.mark.slow)
        for each in (
            ("hospital_levels", 6, 0),
            ("cardboardcode+rmf_gym_lite/lift_queue@2025-12-10", 4, 0),
            ("pinklab-art+rosconkr_rmf/workshop", 4, 0),
            ("open-rmf+roscon_workshop/workshop", 4, 4),
            ("open-rmf+rmf_demos/hotel", 6, 0),
            ("open-rmf+rmf_demos/clinic", 6, 0),
        )
    ),
]


@pytest.mark.parametrize(("name", "robots", "seed"), MAPS)
def test_robots_ride_the_lifts_of_a_building_as_planned(tmp_path, name, robots, seed):
    file = CORPUS / f"{name}.building.yaml" if "/" in name else name
    if "/" in name and not file.is_file():
        pytest.skip("the corpus is not here")
    path = tmp_path / "ride.yaml"
    path.write_text(
        yaml.safe_dump(
            {
                "map": {"file": str(file), "join_short_m": 0.45},
                "discretisation": {"kind": "roadmap", "cell_m": 0.4},
                "robots": {"count": robots, "draw": "anywhere"},
                "assignment": {"mode": "random"},
                "planner": "prioritised",
                "execution": {"engine": "kinematic", "doors": "automatic"},
                "seed": seed,
            }
        )
    )
    with MapCache() as maps:
        result = carry_out(read_scenario(path), maps)
    assert (result.status, result.metrics["num_overlaps"]) == ("completed", 0)
    assert result.metrics["lift_rides"] > 0
    assert np.abs(result.execution.arrived_s - result.plan.arrive_s).max() <= STEP_S + 1e-9
