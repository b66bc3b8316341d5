"""Types of robots and their batteries, as files of robots/ declare them.

The model of batteries is Open-RMF's (rmf_battery): power for acceleration, braking and turning, friction and devices, at a constant
voltage; charging at a constant current.

Refuses sizes, speeds, accelerations and figures of batteries that are out of bounds.
"""

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from mrp_sumo.core.options import Options, meaning, option

if TYPE_CHECKING:  # numpy is slow to load, and files are checked without it
    from mrp_sumo.core.graph import FloatArray

GRAVITY_MPS2 = 9.81
HOUR_S = 3600.0
OF_ROBOT = {"ge": 1e-4, "le": 1e3}  # sizes and speeds, generously
OF_BATTERY = {"ge": 1e-5, "le": 1e5}


@dataclass(frozen=True)
class Battery(Options):
    """The battery of a type of robots, and what drains it."""

    voltage_v: float = field(metadata=meaning("Nominal voltage.", **OF_BATTERY))
    capacity_ah: float = field(metadata=meaning("Capacity when full.", **OF_BATTERY))
    charging_a: float = field(metadata=meaning("Current of the charger.", **OF_BATTERY))
    mass_kg: float = field(metadata=meaning("Mass of the robot with its load.", **OF_BATTERY))
    inertia_kgm2: float = field(metadata=meaning("Moment of inertia around the vertical axis.", ge=0, le=1e5))
    friction: float = field(metadata=meaning("Coefficient.", ge=0, le=10))
    device_w: float = option(0.0, "Constant power of computer and sensors.", ge=0, le=1e5)

    @property
    def energy_j(self) -> float:
        """Of a full battery."""
        return self.voltage_v * self.capacity_ah * HOUR_S

    def power_w(
        self, speed_mps: "FloatArray", accel_mps2: "FloatArray", turn_rate_rad_s: "FloatArray", turn_rad_s2: "FloatArray"
    ) -> "FloatArray":
        """[R] what robots draw; braking costs as much as accelerating."""
        drives = self.mass_kg * (abs(accel_mps2) + self.friction * GRAVITY_MPS2) * abs(speed_mps)
        power: FloatArray = drives + self.inertia_kgm2 * abs(turn_rad_s2 * turn_rate_rad_s) + self.device_w
        return power

    def charge_s(self, share: float) -> float:
        """Duration of charging by a share of the capacity."""
        return share * self.capacity_ah * HOUR_S / self.charging_a


@dataclass(frozen=True)
class RobotShape(Options):
    """A model of robot as a file of robots/ has it. The footprint is a rectangle around the centre, which is what drives along lanes."""

    length_m: float = field(metadata=meaning("Along the lane.", **OF_ROBOT))
    width_m: float = field(metadata=meaning("Across it.", **OF_ROBOT))
    max_speed_mps: float = field(metadata=meaning("Top speed.", **OF_ROBOT))
    accel_mps2: float = field(metadata=meaning("Speeding up.", **OF_ROBOT))
    decel_mps2: float = field(metadata=meaning("Braking.", **OF_ROBOT))
    turn_rate_rad_s: float = field(metadata=meaning("Turning in place.", **OF_ROBOT))
    gap_m: float = option(0.1, "Distance kept between robots, on top of their radii.", ge=0, le=1e3)
    source: str = option("", "Where the figures come from.")
    battery: Battery | None = field(default=None, metadata=meaning("Without one, a robot never runs empty."))

    @property
    def radius_m(self) -> float:
        """Of the circle around the footprint."""
        return abs(complex(self.length_m, self.width_m)) / 2  # the C library's hypot, as numpy has it


@dataclass(frozen=True, init=False)
class RobotType(RobotShape):
    """A model of robot with its name, which is the first argument; the others are those of `RobotShape`."""

    name: str = ""

    def __init__(self, name: str, *figures: Any, **more: Any) -> None:
        object.__setattr__(self, "name", name)
        super().__init__(*figures, **more)
