"""Make the fleet log archive that comes with the program, `logs/warehouse_hour.zip`: an hour of a fleet whose true figures it says.

    python tools/make_log.py [--out logs/warehouse_hour.zip]

Five robots work in the bundled warehouse, with scatter of speed and stops on the way. They are seen once a second, with 1.5 cm of noise,
losses and gaps. The manifest has the figures that drove them, as `truth`.
"""

import argparse
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from bench_calibrate import observed

import mrp_sumo as ms
from mrp_sumo.calibration.archive import ArchiveHead, write_archive

OUT = Path(__file__).resolve().parents[1] / "logs" / "warehouse_hour.zip"
SEED = 11
TYPE = {"max_speed_mps": 1.35, "accel_mps2": 0.55, "decel_mps2": 0.75, "turn_rate_rad_s": 1.1}
DISTURBANCES = {"speed_noise": 0.06, "speed_noise_tau_s": 3.0, "stops_per_s": 0.004, "stop_median_s": 7.0, "stop_sigma": 0.5}
TIMES = {"pick": (9.0, 0.3), "drop": (7.0, 0.25)}
SIZES = {"length_m": 0.5, "width_m": 0.45, "gap_m": 0.05}
SITE: dict[str, Any] = {
    "map": "warehouse",
    "seed": SEED,
    "discretisation": {"kind": "roadmap", "cell_m": 1.5, "clearance": "ignore"},
    "planner": "lacam",
    "tasks": {
        "groups": {
            "shelf": ["pick_a1", "pick_a2", "pick_b1", "pick_c1", "pick_c2", "pick_d1", "pick_e1"],
            "packing": ["packing_1", "packing_2", "dock_2"],
        },
        "streams": [{"arrivals": {"rate_per_h": 120}, "stops": ["shelf", "packing"]}],
    },
    "record": {"bag": False},
}


def main() -> int:
    """Drive, observe, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=OUT)
    options = parser.parse_args()
    actions = {name: {"lognormal": list(time)} for name, time in TIMES.items()}
    scenario = ms.Scenario(
        **SITE,
        robots={"count": 5, "type": {**SIZES, **TYPE, "actions": actions}},
        execution={"engine": "kinematic", "time_limit_s": 3600.0, "disturbances": DISTURBANCES},
    )
    with TemporaryDirectory() as scratch:
        folder = Path(scratch) / "warehouse_hour"
        ms.run(scenario).save(folder)
        log = observed(folder, np.random.default_rng([SEED, 5]))
    log.types = dict.fromkeys(log.poses, "cart")
    times = {f"actions.{kind}.{name}": value for kind, pair in TIMES.items() for name, value in zip(("median_s", "sigma"), pair)}
    about = ArchiveHead(
        "warehouse_hour",
        "CC0-1.0",
        who="mrp_sumo, tools/make_log.py",
        map_name="warehouse",
        levels=tuple(log.levels.values()),
        is_laid_out=True,
        types={"cart": {key: SIZES[key] for key in ("length_m", "width_m")}},
        truth=TYPE | DISTURBANCES | times,
    )
    options.out.parent.mkdir(exist_ok=True)
    options.out.unlink(missing_ok=True)
    print(f"{write_archive(log, about, options.out)}: {options.out.stat().st_size / 1e3:.0f} kB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
