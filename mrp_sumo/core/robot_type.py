"""Types of robots, their wheels, trailers and batteries, as files of robots/ declare them.

A vehicle is a type that cannot turn in place. The middle of its fixed axle follows the lanes; it turns where two lanes meet along an arc
of a circle, which cuts the corner. Closed forms of bicycle and trailers: LaValle, Planning Algorithms, 13.1; Altafini, 2001.

The model of batteries is Open-RMF's (rmf_battery): power for acceleration, braking and turning, friction and devices, at a constant
voltage; charging at a constant current.

Refuses sizes, speeds, accelerations and figures of batteries that are out of bounds, wheels and trailers that cannot turn, and loads that
make a robot smaller or faster.
"""

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from annotated_types import Interval

from mrp_sumo.core.arrivals import ServiceTime
from mrp_sumo.core.options import INTERVALS, Figure, Options, meaning, option, require_intervals
from mrp_sumo.errors import OptionError

if TYPE_CHECKING:  # numpy is slow to load, and files are checked without it
    from mrp_sumo.core.graph import FloatArray
    from mrp_sumo.core.wheel_path import Turning

GRAVITY_MPS2 = 9.81
HOUR_S = 3600.0
STANDING_MPS, STANDING_RAD_S = 1e-3, 1e-3
OF_ROBOT = {"ge": 1e-4, "le": 1e3}  # sizes and speeds, generously
AT_ONCE_RAD_S = 1e3
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
    idle_w: float | None = option(None, "The same while it stands; `device_w` by default.", ge=0, le=1e5)
    lift_j: float = option(0.0, "Energy of lifting a load, at the first stop of an order that has several.", ge=0, le=1e7)

    @property
    def energy_j(self) -> float:
        """Of a full battery."""
        return self.voltage_v * self.capacity_ah * HOUR_S

    def power_w(
        self, speed_mps: "FloatArray", accel_mps2: "FloatArray", turn_rate_rad_s: "FloatArray", turn_rad_s2: "FloatArray"
    ) -> "FloatArray":
        """[R] what robots draw; braking costs as much as accelerating."""
        drives = self.mass_kg * (abs(accel_mps2) + self.friction * GRAVITY_MPS2) * abs(speed_mps)
        device_w: float | FloatArray = self.device_w
        if self.idle_w is not None:
            stands = (abs(speed_mps) < STANDING_MPS) & (abs(turn_rate_rad_s) < STANDING_RAD_S)
            device_w = stands * self.idle_w + ~stands * self.device_w
        power: FloatArray = drives + self.inertia_kgm2 * abs(turn_rad_s2 * turn_rate_rad_s) + device_w
        return power

    def charge_s(self, share: float) -> float:
        """Duration of charging by a share of the capacity."""
        return share * self.capacity_ah * HOUR_S / self.charging_a


@dataclass(frozen=True)
class Wheels(Options):
    """The wheels of a type, and the ways in which it can move."""

    kind: Literal["differential", "omni", "tricycle", "ackermann", "tugger"] = option(
        "differential",
        "'differential' turns in place, 'omni' drives to every side without turning; 'tricycle', 'ackermann' and 'tugger' have a fixed "
        "axle and steered wheels: they turn on arcs, never in place.",
    )
    wheelbase_m: float | None = option(None, "From the fixed axle to the steered wheels.", **OF_ROBOT)
    steering_max_rad: float | None = option(None, "Largest angle of the steered wheels.", gt=0.01, lt=1.57)
    reverse: bool = option(False, "Whether it may drive backwards.")
    fixed_axle: Literal["rear", "front"] = option("rear", "Axle that does not steer; of counterbalance forklifts the front one.")
    axle_m: float | None = option(None, "From the middle of the body to the fixed axle; half of the wheelbase by default.", ge=0, le=1e3)
    gear_s: float = option(1.0, "Time in which it changes from forward to backward and back, standing.", gt=0, le=60)
    lateral_mps2: float = option(0.7, "Most acceleration to the side, which limits the speed on arcs.", gt=0, le=100)
    reverse_mps: float | None = option(None, "Top speed backwards; the same as forward by default.", **OF_ROBOT)
    docking: Literal["any", "forks_first"] = option(
        "any", "'forks_first' comes to the places at dead ends with the fixed axle first, at which the forks are."
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        steered = {"wheelbase_m": self.wheelbase_m, "steering_max_rad": self.steering_max_rad}
        if self.is_steered and (missing := [key for key, value in steered.items() if value is None]):
            raise OptionError(f"kind {self.kind} without {' and '.join(missing)}, expected both: they say how tightly it can turn")
        if not self.is_steered and (extra := [key for key, value in steered.items() if value is not None]):
            raise OptionError(f"kind {self.kind} with {' and '.join(extra)}, expected kind tricycle, ackermann or tugger with that")
        if self.reverse_mps is not None and not self.reverse:
            raise OptionError("reverse_mps without reverse: true, expected both or neither")
        if self.docking == "forks_first" and not self.is_steered:
            raise OptionError(
                f"docking: forks_first with kind {self.kind}, expected kind tricycle or ackermann, which cannot turn in place"
            )
        if self.docking == "forks_first" and self.fixed_axle == "rear" and not self.reverse:
            raise OptionError("docking: forks_first without reverse: true, expected both, as the forks are at the rear (fixed_axle: rear)")

    @property
    def is_steered(self) -> bool:
        """True if it cannot turn in place."""
        return self.kind in ("tricycle", "ackermann", "tugger")

    @property
    def least_radius_m(self) -> float:
        """Of the arc of the middle of the fixed axle: wheelbase over the tangent of the steering angle. 0 where it turns in place."""
        return self.wheelbase_m / math.tan(self.steering_max_rad) if self.wheelbase_m and self.steering_max_rad else 0.0

    @property
    def ahead_m(self) -> float:
        """Distance by which the middle of the body is ahead of the fixed axle."""
        axle_m = (self.wheelbase_m or 0.0) / 2 if self.axle_m is None else self.axle_m
        return axle_m if self.fixed_axle == "rear" else -axle_m


@dataclass(frozen=True)
class Trailer(Options):
    """A trailer of a tugger, with one axle that does not steer, in the middle of its body."""

    length_m: float = field(metadata=meaning("From the hitch in front to its axle.", **OF_ROBOT))
    hitch_m: float = field(metadata=meaning("From the axle in front of it back to the hitch.", ge=0, le=1e3))
    width_m: float | None = option(None, "Of its body; as wide as the tugger by default.", **OF_ROBOT)
    body_m: float | None = option(None, "Length of its body; as long as `length_m` by default.", **OF_ROBOT)


DIFFERENTIAL = Wheels()
CORNER_M = 0.25  # least distance by which turns may leave a corner
CORNER_SHARE = 0.56  # of the least radius: what a bend of 100 degrees takes


@dataclass(frozen=True)
class Loaded(Options):
    """Figures of a robot that carries a load, however many; those left out are the same without."""

    speed_mps: float | None = option(None, "Top speed, no more than without a load.", **OF_ROBOT)
    accel_mps2: float | None = option(None, "Speeding up.", **OF_ROBOT)
    decel_mps2: float | None = option(None, "Braking.", **OF_ROBOT)
    turn_rate_rad_s: float | None = option(None, "Turning in place.", **OF_ROBOT)
    length_m: float | None = option(None, "Of robot and load, no less than without one.", **OF_ROBOT)
    width_m: float | None = option(None, "Of robot and load, no less than without one.", **OF_ROBOT)
    mass_kg: float | None = option(None, "Of robot and load; that of the battery is without one then.", **OF_BATTERY)


@dataclass(frozen=True)
class Actions(Options):
    """Times of what a robot does at stops, beside the service there."""

    pick: ServiceTime | None = field(default=None, metadata=meaning("At the first stop of an order that has several."))
    drop: ServiceTime | None = field(default=None, metadata=meaning("At the last stop of an order that has several."))
    lift: ServiceTime | None = field(default=None, metadata=meaning("At stations with this action."))
    dock: ServiceTime | None = field(default=None, metadata=meaning("At stations with this action."))

    @property
    def usual_s(self) -> dict[str, float]:
        """Usual times, of lognormal ones the median, by `actions.KIND`."""
        by_kind = {f"actions.{kind}": time for kind, time in vars(self).items() if time is not None}
        return {name: time.lognormal[0] if time.lognormal else time.mean_s for name, time in by_kind.items()}


@dataclass(frozen=True)
class Factors(Options):
    """Factors on figures of all types of a fleet, with a load and without."""

    max_speed_mps: float = option(1.0, "On top speeds, backwards, too.", gt=0, le=10)
    accel_mps2: float = option(1.0, "On speeding up.", gt=0, le=10)
    decel_mps2: float = option(1.0, "On braking.", gt=0, le=10)
    turn_rate_rad_s: float = option(1.0, "On turning in place.", gt=0, le=10)


AS_THEY_ARE = Factors()


@dataclass(frozen=True)
class Maintenance(Options):
    """Planned maintenance."""

    every_h: float = field(metadata=meaning("Hours with an order between two.", gt=0, le=1e6))
    takes_s: float = field(metadata=meaning("Time that it takes, the way to where it is done included.", gt=0, le=1e9))


OF_LOADED = {"speed_mps": "max_speed_mps"}  # whose names differ


@dataclass(frozen=True)
class RobotShape(Options):
    """A model of robot as a file of robots/ has it. The footprint is a rectangle around the centre, which is what drives along lanes."""

    length_m: float = field(metadata=meaning("Along the lane.", **OF_ROBOT))
    width_m: float = field(metadata=meaning("Across it.", **OF_ROBOT))
    max_speed_mps: float = field(metadata=meaning("Top speed.", **OF_ROBOT))
    accel_mps2: float = field(metadata=meaning("Speeding up.", **OF_ROBOT))
    decel_mps2: float = field(metadata=meaning("Braking.", **OF_ROBOT))
    turn_rate_rad_s: float | None = option(None, "Turning in place; types that do so need it.", **OF_ROBOT)
    gap_m: float = option(0.1, "Distance kept between robots, on top of their radii.", ge=0, le=1e3)
    source: str = option("", "Where the figures come from.")
    vehicle_type: str = option("", "Its name in LIF layouts and factsheets, 'manufacturer.series'; 'mrp_sumo.NAME' by default.")
    battery: Battery | None = field(default=None, metadata=meaning("Without one, a robot never runs empty."))
    kinematics: Wheels = field(default=DIFFERENTIAL, metadata=meaning("Its wheels; by default it turns in place."))
    trailers: tuple[Trailer, ...] = option((), "What a tugger tows, the first one first.")

    loaded: Loaded | None = field(default=None, metadata=meaning("What is different with a load; by default nothing is."))
    actions: Actions | None = field(default=None, metadata=meaning("What takes time at stops beside the service; by default nothing does."))
    max_load_kg: float | None = option(None, "Heaviest order that it can carry; any by default.", **OF_BATTERY)
    capacity: int = option(1, "Orders on board at once, for a dispatcher that bundles.", ge=1, le=100)

    mtbf_h: float | None = option(None, "Mean hours with an order between two failures, in runs with tasks; none by default.", gt=0, le=1e6)
    mtbf_shape: float = option(1.0, "Shape of their Weibull distribution; 1: exponential, above: by wear.", ge=0.1, le=100)
    mttr_h: float | None = option(None, "Mean hours to repair, exponential.", gt=0, le=1e6)
    mttr_sigma: float | None = option(None, "Of a lognormal time to repair instead: standard deviation of its logarithm.", ge=0, le=5)
    tow_s: float | None = option(
        None,
        "Time after which people push a broken robot out of the way at 0.5 m/s, to `tasks.parking` if there is a place; never by default, "
        "nor where it is being served.",
        ge=0,
        le=1e9,
    )
    maintenance: Maintenance | None = field(
        default=None,
        metadata=meaning("As soon as it is done with its order, out of the way or at a place of `tasks.parking`; none by default."),
    )
    lane_class_mps: dict[str, Annotated[float, Interval(ge=1e-4, le=1e3)]] = field(
        default_factory=dict,
        hash=False,
        metadata=meaning("Top speeds on lanes by the `class` that the map gives these, such as {ramp: 0.5}."),
    )
    intervals: dict[str, tuple[Figure, Figure]] = field(default_factory=dict, hash=False, metadata=meaning(INTERVALS))

    def __post_init__(self) -> None:
        super().__post_init__()
        require_intervals(self, self.actions.usual_s if self.intervals and self.actions is not None else {})
        self._check_loaded()
        self._check_availability()
        wheels = self.kinematics
        if wheels.kind == "differential" and self.turn_rate_rad_s is None:
            raise OptionError("turn_rate_rad_s is missing, expected the rate of turning in place, or kinematics of a type that does not")
        if self.trailers and wheels.kind != "tugger":
            raise OptionError(f"trailers with kinematics of kind {wheels.kind}, expected kind tugger")
        if self.trailers and wheels.reverse:
            raise OptionError("trailers with reverse: true would jack-knife, expected reverse: false, or no trailers")
        if (behind_m := abs(wheels.ahead_m)) > self.length_m / 2 + 1e-9:
            key = "wheelbase_m" if wheels.axle_m is None else "axle_m"
            raise OptionError(
                f"kinematics.{key} is {getattr(wheels, key):g}: the fixed axle is {behind_m:g} m from the middle of the body, expected at "
                f"most half of length_m, {self.length_m / 2:g}"
            )
        self._towed()

    def _check_loaded(self) -> None:
        loaded = self.loaded or Loaded()
        if (speed_mps := loaded.speed_mps or 0.0) > self.max_speed_mps:
            raise OptionError(f"loaded.speed_mps is {speed_mps:g}, expected at most max_speed_mps, {self.max_speed_mps:g}")
        for key in ("length_m", "width_m"):
            if (size_m := getattr(loaded, key)) is not None and size_m < getattr(self, key):
                raise OptionError(f"loaded.{key} is {size_m:g}, expected at least {key}, {getattr(self, key):g}")
        if loaded.mass_kg is not None and self.battery is None:
            raise OptionError("loaded.mass_kg has no effect without a battery")

    def _check_availability(self) -> None:
        if (self.mtbf_h is None) != (self.mttr_h is None):
            present, missing = ("mttr_h", "mtbf_h") if self.mtbf_h is None else ("mtbf_h", "mttr_h")
            raise OptionError(f"{present} without {missing}, expected both: a robot that fails is repaired")
        if self.mtbf_h is None:
            wrong = next((key for key in ("mttr_sigma", "tow_s") if getattr(self, key) is not None), "")
            wrong = "mtbf_shape" if self.mtbf_shape != 1.0 else wrong
            if wrong:
                raise OptionError(f"{wrong} without mtbf_h and mttr_h, expected these, too")

    @property
    def with_load(self) -> Self:
        """The same robot as long as it carries a load."""
        figures = {OF_LOADED.get(key, key): value for key, value in vars(self.loaded or Loaded()).items() if value is not None}
        if self.battery is not None and "mass_kg" in figures:
            figures["battery"] = replace(self.battery, mass_kg=figures.pop("mass_kg"))
        return replace(self, loaded=None, intervals={}, **figures)

    @property
    def is_vehicle(self) -> bool:
        """True if it cannot turn in place."""
        return self.kinematics.is_steered

    @property
    def radius_m(self) -> float:
        """Of the circle in which it is with its load, around where a robot would be that turns in place.

        Of a tugger each trailer is in such a circle around where it is on the path.
        """
        if self.loaded is not None:
            return self.with_load.radius_m
        if not self.is_vehicle:
            return abs(complex(self.length_m, self.width_m)) / 2  # the C library's hypot, as numpy has it
        body_m = math.hypot(self.length_m, self.width_m) / 2 + self.aside_m
        return max([body_m, *(inward + math.hypot(length, width) / 2 + self.corner_m for inward, length, width in self._towed())])

    @property
    def corner_m(self) -> float:
        """Distance by which the middle of the fixed axle leaves a corner at most where it turns."""
        return max(CORNER_M, CORNER_SHARE * self.kinematics.least_radius_m) if self.is_vehicle else 0.0

    @property
    def aside_m(self) -> float:
        """Distance of the middle of its body, on arcs at most, from where a robot would be that turns in place. Where it changes gear at a
        corner it is farther away: see `PlanGraph.swing_m`.
        """
        if not self.is_vehicle:
            return 0.0
        from mrp_sumo.core.wheel_path import most_aside_m

        return most_aside_m(self.turning)

    @property
    def beside_m(self) -> float:
        """Room that it needs beside the middle of a lane."""
        return max([self.width_m, *(each.width_m or self.width_m for each in self.trailers)]) / 2

    @property
    def behind_m(self) -> float:
        """From the middle of the body back along the path to the end of the last trailer; 0 without trailers."""
        towed = self.kinematics.ahead_m + sum(trailer.hitch_m + trailer.length_m for trailer in self.trailers)
        return towed + (self.trailers[-1].body_m or self.trailers[-1].length_m) / 2 if self.trailers else 0.0

    @property
    def turning(self) -> "Turning":
        """Figures that decide its paths round corners."""
        from mrp_sumo.core.wheel_path import Turning

        wheels = self.kinematics
        return Turning(wheels.ahead_m, wheels.least_radius_m, self.corner_m, wheels.reverse, self.length_m)

    def _towed(self) -> list[tuple[float, float, float]]:
        """Of each trailer, how far it runs inside the arc of least radius, and length and width of its body. Refuses what jack-knifes."""
        least = radius_m = self.kinematics.least_radius_m
        towed = []
        for k, trailer in enumerate(self.trailers):
            square = radius_m**2 + trailer.hitch_m**2 - trailer.length_m**2
            if square <= 0:
                raise OptionError(
                    f"trailers[{k}] would jack-knife: on the arc of {radius_m:.2f} m of the axle in front, hitch_m {trailer.hitch_m:g} and "
                    f"length_m {trailer.length_m:g} leave it none, expected a shorter length_m, or a smaller steering_max_rad"
                )
            radius_m = math.sqrt(square)
            towed.append((least - radius_m, trailer.body_m or trailer.length_m, trailer.width_m or self.width_m))
        return towed

    @property
    def rate_rad_s(self) -> float:
        """Rate at which it changes the direction in which it drives, standing: by turning, by changing gear, at once if it is omni."""
        if self.is_vehicle:
            return math.pi / self.kinematics.gear_s
        return self.turn_rate_rad_s if self.turn_rate_rad_s and self.kinematics.kind == "differential" else AT_ONCE_RAD_S


@dataclass(frozen=True, init=False)
class RobotType(RobotShape):
    """A model of robot with its name, which is the first argument; the others are those of `RobotShape`."""

    name: str = ""

    def __init__(self, name: str, *figures: Any, **more: Any) -> None:
        object.__setattr__(self, "name", name)
        super().__init__(*figures, **more)

    @property
    def in_layouts(self) -> str:
        """Its name in maps that know types of vehicles, manufacturer and series."""
        return self.vehicle_type or f"mrp_sumo.{self.name}"


def scaled(model: RobotType, factors: Factors) -> RobotType:
    """The type with other figures, and without their intervals."""
    if factors == AS_THEY_ARE:
        return model
    by_name = vars(factors)
    figures: dict[str, Any] = {key: by_name[key] * value for key in by_name if (value := getattr(model, key)) is not None}
    if model.loaded is not None:
        loaded = {key: value for key, value in vars(model.loaded).items() if value is not None}
        figures["loaded"] = replace(model.loaded, **{key: by_name.get(OF_LOADED.get(key, key), 1.0) * loaded[key] for key in loaded})
    if (reverse_mps := model.kinematics.reverse_mps) is not None:
        figures["kinematics"] = replace(model.kinematics, reverse_mps=factors.max_speed_mps * reverse_mps)
    return replace(model, intervals={}, **figures)
