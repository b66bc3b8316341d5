"""Campaigns: long searches for faults, run by hand or by night; those that failed before are in tests/campaigns.

    python tools/campaign.py keys                                every key of scenario files, alone and in pairs
    python tools/campaign.py fuzz --minutes 30 --seed 2          damaged files of every format, through every command that reads it
    python tools/campaign.py keys --minutes 30 --out DIR         started again with the same folder and seed, it goes on

Files of trials with a fault go to DIR/failed, each with the command that shows it. Exit code 1 when there are any.
"""

import argparse
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
CAMPAIGNS = {  # name -> (module:class, wall time of a trial in s)
    "keys": ("campaigns.keys:Keys", 60.0),
    "fuzz": ("campaigns.fuzz:Fuzz", 600.0),
    "repeat": ("campaigns.repeat:Repeat", 600.0),
    "kills": ("campaigns.kills:Kills", 300.0),
    "noise": ("campaigns.noise:Noise", 300.0),
    "buildings": ("campaigns.noise:Buildings", 300.0),
    "engines": ("campaigns.engines:Engines", 600.0),
    "engines_in_buildings": ("campaigns.engines:EnginesInBuildings", 600.0),
    "operations": ("campaigns.operations:Operations", 1200.0),
    "working_vehicles": ("campaigns.working_vehicles:WorkingVehicles", 1200.0),
    "vehicles": ("campaigns.vehicles:Vehicles", 300.0),
    "times": ("campaigns.times:Times", 300.0),
    "referee": ("campaigns.referee:Referee", 60.0),
    "referee_in_seconds": ("campaigns.referee_in_seconds:RefereeInSeconds", 60.0),
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaign", choices=CAMPAIGNS)
    parser.add_argument("--minutes", type=float, default=30.0, help="after which no trial begins (default: 30)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=Path("runs/campaigns"), metavar="DIR", help="default: runs/campaigns")
    options = parser.parse_args()
    sys.path[:0] = [str(ROOT / "tests"), str(ROOT)]
    from campaigns import driver

    name, limit_s = CAMPAIGNS[options.campaign]
    module, _, kind = name.partition(":")
    campaign: Any = getattr(import_module(module), kind)(options.seed)
    return driver.run(campaign, driver.Places(options.campaign, options.seed, options.out), options.minutes, limit_s)


if __name__ == "__main__":
    sys.exit(main())
