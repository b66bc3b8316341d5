"""A closed ring of one lane, whose throughput is known by hand, from its length, the speed and the service time."""

import json

from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import carry_out
from mrp_sumo.io.scenario.read import scenario_of

SIDE_M, SPEED_MPS, TURN_RATE, ACCEL = 4.0, 0.22, 2.84, 2.5
LAP_S = 4 * (SIDE_M / SPEED_MPS + 3.1416 / 2 / TURN_RATE + SPEED_MPS / ACCEL)  # it stops to turn at every corner
MOVE_UP_S = 0.8 / SPEED_MPS + SPEED_MPS / ACCEL  # from the place to wait
HORIZON_S = 1200.0


def ring(folder, robots, service_s, horizon_s=HORIZON_S):
    """Robots go round and round, served at one place and turning to the next order at another; before both they queue."""
    named = {
        **{"a": (0.0, 0.0), "b": (SIDE_M, 0.0), "c": (SIDE_M, SIDE_M), "d_1": (1.0, SIDE_M), "d": (0.0, SIDE_M)},
        "a_1": (0.0, 0.8),
    }
    vertices = [[x, y, {"name": name}] for name, (x, y) in named.items()]
    lanes = [[k, (k + 1) % len(named), {}] for k in range(len(named))]
    (folder / "0.yaml").write_text(json.dumps({"building_name": "ring", "levels": {"L1": {"vertices": vertices, "lanes": lanes}}}))
    values = {
        "map": "0.yaml",
        "discretisation": "roadmap",
        "robots": {"starts": ["b", "c"][:robots], "goals": ["b", "c"][:robots]},
        "planner": {"name": "lacam", "time_limit_s": 1.0},
        "tasks": {
            "stations": {"stop": {"places": ["a"], "queue": ["a_1"]}, "gate": {"places": ["d"], "queue": ["d_1"]}},
            "streams": [{"arrivals": {"rate_per_h": 9.0}, "stops": ["stop", "gate"], "service": [service_s, 0.0]}],
            "open": 2 * robots,
        },
        "execution": {"engine": "kinematic", "time_limit_s": horizon_s, "planning": {"budget_s": 0.0}},
        "record": {"bag": False},
    }
    with MapCache() as maps:
        return carry_out(scenario_of(values, folder, "ring"), maps)
