"""Batteries: what driving and standing take from them, what charging gives, and when robots go to charge.

The model is Open-RMF's (rmf_battery): power for acceleration, braking and turning, friction and devices, at a constant voltage; charging
at a constant current. The levels at which robots charge are those of a VDA 5050 factsheet (`batteryCharging`), as shares.
"""

from dataclasses import dataclass, field

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.options import Options, meaning, option
from mrp_sumo.core.task import Station

GRAVITY_MPS2 = 9.81
HOUR_S = 3600.0


OF_BATTERY = {"ge": 1e-5, "le": 1e5}


@dataclass(frozen=True)
class Battery(Options):
    """The battery of a type of robots, and what drains it."""

    voltage_v: float = field(metadata=meaning("Nominal.", **OF_BATTERY))
    capacity_ah: float = field(metadata=meaning("Of a full battery.", **OF_BATTERY))
    charging_a: float = field(metadata=meaning("Current of the charger.", **OF_BATTERY))
    mass_kg: float = field(metadata=meaning("Of the robot with its load.", **OF_BATTERY))
    inertia_kgm2: float = field(metadata=meaning("Around the vertical axis.", ge=0, le=1e5))
    friction: float = field(metadata=meaning("Coefficient.", ge=0, le=10))
    device_w: float = option(0.0, "Drawn by computer and sensors all the time.", ge=0, le=1e5)

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
