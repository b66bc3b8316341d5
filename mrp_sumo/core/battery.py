"""Batteries: what driving and standing take from them, what charging gives, and when robots go to charge.

The model is Open-RMF's (rmf_battery): power for acceleration, braking and turning, friction and devices, at a constant voltage; charging
at a constant current. The levels at which robots charge are those of a VDA 5050 factsheet (`batteryCharging`), as shares.
Refuses figures that no battery has.
"""

from dataclasses import dataclass, fields

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.task import Station
from mrp_sumo.errors import ScenarioError

GRAVITY_MPS2 = 9.81
HOUR_S = 3600.0


@dataclass(frozen=True)
class Battery:
    """The battery of a type of robots, and what drains it."""

    voltage_v: float
    capacity_ah: float
    charging_a: float
    mass_kg: float
    inertia_kgm2: float  # around the vertical axis
    friction: float  # coefficient
    device_w: float  # computer and sensors

    def __post_init__(self) -> None:
        for key in (field.name for field in fields(self)):
            value, least = getattr(self, key), 0.0
            if not (np.isfinite(value) and value >= least) or (value == 0 and key in ("voltage_v", "capacity_ah", "charging_a")):
                raise ScenarioError(f"battery: {key} is {value}, expected a number above 0")

    @property
    def energy_j(self) -> float:
        """Of a full battery."""
        return self.voltage_v * self.capacity_ah * HOUR_S

    def power_w(self, speed_mps: FloatArray, accel_mps2: FloatArray, turn_rate_rad_s: FloatArray, turn_rad_s2: FloatArray) -> FloatArray:
        """[R] what robots draw; braking costs as much as accelerating."""
        drives = self.mass_kg * (np.abs(accel_mps2) + self.friction * GRAVITY_MPS2) * np.abs(speed_mps)
        power: FloatArray = drives + self.inertia_kgm2 * np.abs(turn_rad_s2 * turn_rate_rad_s) + self.device_w
        return power

    def charge_s(self, share: float) -> float:
        """How long charging by a share of the capacity takes."""
        return share * self.capacity_ah * HOUR_S / self.charging_a


@dataclass(frozen=True)
class Charging:
    """When and where robots charge. Levels are shares of the capacity."""

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
