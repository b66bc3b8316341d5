"""Charging: at which levels and where, and the states of charge of a run.

The levels at which robots charge are those of a VDA 5050 factsheet (`batteryCharging`), as shares.
"""

from dataclasses import dataclass

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.task import Station


@dataclass(frozen=True)
class Charging:
    """Charging of robots. Levels are shares of the capacity."""

    station: Station
    opportunity: bool  # whether robots charge, too, when there is nothing to do
    critical: float  # at or below it a robot without a load goes to charge
    minimum: float  # charged to it, a robot may be called off for a task, with `opportunity`
    maximum: float  # charging ends
    least_s: float  # charging takes, however little is missing
    first_share: float = 0.0  # of the robots, evenly spread, that begin with a charge


@dataclass(frozen=True, eq=False)
class BatteryLog:
    """States of charge of R robots at K times of a run."""

    t_s: FloatArray  # [K]
    level: FloatArray  # [K, R] shares of the capacity
    used_j: FloatArray  # [R] drawn in the whole run
    charged_j: FloatArray  # [R]
    critical: float  # the level at which robots go to charge; 0 where they do not
