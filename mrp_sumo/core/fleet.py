"""Robots: their sizes and limits, as arrays by robot so that fleets may be mixed."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, frozen
from mrp_sumo.core.robot_type import Battery, RobotShape, RobotType


@dataclass(frozen=True, eq=False)
class Fleet:
    """R robots of K types. Arrays are [R] unless said, and read-only."""

    robot_name: tuple[str, ...]
    length_m: FloatArray
    width_m: FloatArray
    max_speed_mps: FloatArray
    accel_mps2: FloatArray
    decel_mps2: FloatArray
    turn_rate_rad_s: FloatArray
    gap_m: FloatArray
    kind: IntArray  # index of the type
    apart_m: FloatArray  # [K, K] the least centre distance at which robots of two types cannot touch, gap included
    type_name: tuple[str, ...] = ()  # [R]; empty where types are not known
    types: tuple[RobotType, ...] = ()  # [K]; empty where they are not known
    capacity: IntArray | None = None  # [R] orders on board at once; None: one each
    loaded: "Fleet | None" = None  # the same robots, each with a load; None: they are the same without

    @property
    def num_robots(self) -> int:
        return len(self.robot_name)

    @property
    def num_kinds(self) -> int:
        return len(self.apart_m)

    @property
    def vehicle_of_kind(self) -> tuple[RobotType | None, ...]:
        """[K] the types that cannot turn in place, None for others; empty where there are none."""
        return tuple(each if each.is_vehicle else None for each in self.types) if any(each.is_vehicle for each in self.types) else ()

    @property
    def is_vehicle(self) -> BoolArray:
        """[R] True for robots that cannot turn in place."""
        return self._by_type([each.is_vehicle for each in self.types], np.zeros(self.num_robots, np.bool_))

    @property
    def aside_m(self) -> FloatArray:
        """[R] see `RobotShape.aside_m`."""
        return self._by_type([each.aside_m for each in self.types], np.zeros(self.num_robots))

    @property
    def axle_m(self) -> FloatArray:
        """[R] from the middle of the body to the fixed axle of vehicles, 0 for others."""
        return np.abs(self.ahead_m)

    @property
    def ahead_m(self) -> FloatArray:
        """[R] distance by which the middle of the body is ahead of the fixed axle of vehicles, 0 for others."""
        ahead = [each.kinematics.ahead_m if each.is_vehicle else 0.0 for each in self.types]
        return self._by_type(ahead, np.zeros(self.num_robots))

    @property
    def least_radius_m(self) -> FloatArray:
        """[R] of the arcs of vehicles, 0 for others."""
        return self._by_type([each.kinematics.least_radius_m for each in self.types], np.zeros(self.num_robots))

    @property
    def behind_m(self) -> FloatArray:
        """[R] from what drives along lanes to the end of the last trailer."""
        return self._by_type([each.behind_m for each in self.types], np.zeros(self.num_robots))

    @property
    def radius_m(self) -> FloatArray:
        """[R] radius of the circle around the footprint, loaded or not: a robot that turns in place needs it; for vehicles see
        `RobotShape.radius_m`.
        """
        body = self.loaded or self
        return self._by_type([each.radius_m for each in self.types], np.hypot(body.length_m, body.width_m) / 2)

    def _by_type(self, figures: Sequence[Any], without: NDArray[Any]) -> NDArray[Any]:
        """[R] figures by type, where any is a vehicle."""
        return np.array(figures)[self.kind] if self.vehicle_of_kind else without

    @property
    def max_load_kg(self) -> FloatArray:
        """[R] weight of the heaviest order that each robot can carry; inf: any."""
        most = [np.inf if each.max_load_kg is None else each.max_load_kg for each in self.types]
        return np.array(most)[self.kind] if most else np.full(self.num_robots, np.inf)

    @property
    def batteries(self) -> tuple[Battery, ...]:
        """[K] of each type; empty where one has none."""
        return batteries_of(self.types)

    @property
    def batteries_loaded(self) -> tuple[Battery, ...]:
        """[K] of each type with a load; empty where it is the same robot, or one type has none."""
        return () if self.loaded is None else batteries_of([each.with_load for each in self.types])

    @property
    def is_by_load(self) -> bool:
        """True if robots are of other types with a load, since some lanes are for those with one or without only."""
        return self.loaded is not None and bool((self.loaded.kind != self.kind).any())

    @property
    def carries_several(self) -> bool:
        """True if a robot may have more than one order on board."""
        return self.capacity is not None and bool((self.capacity > 1).any())

    @property
    def separation_m(self) -> float:
        """The least centre distance at which no two robots of the fleet can touch, gap included."""
        return float(self.apart_m.max()) if self.num_robots else 0.0


LIMITS = ("length_m", "width_m", "max_speed_mps", "accel_mps2", "decel_mps2", "turn_rate_rad_s", "gap_m")
OF_TYPE = {"turn_rate_rad_s": "rate_rad_s"}  # columns by other names


def fleet_of(robot_type: RobotType, num_robots: int) -> Fleet:
    """A fleet of one type, robots named `robot_0` and on."""
    return fleet_of_types([robot_type], np.zeros(num_robots, np.int64))


def fleet_of_types(types: Sequence[RobotType], kind: IntArray, *, by_load: bool = False) -> Fleet:
    """A fleet of several types, robots named `robot_0` and on; `kind` [R] says which each of them is.

    With `by_load` the k-th of K types is the (K + k)-th with a load.
    """
    bodies, num_types, types = [each.with_load for each in types], len(types), [*types, *types] if by_load else types
    radius, gap = np.array([(each.radius_m, each.gap_m) for each in types], np.float64).reshape(-1, 2).T
    several = any(each.capacity > 1 for each in types)
    fleet = Fleet(
        robot_name=tuple(f"robot_{i}" for i in range(len(kind))),
        **_columns(types, kind),
        kind=frozen(kind),
        apart_m=frozen(radius[:, None] + radius + np.maximum(gap[:, None], gap)),
        type_name=tuple(types[k].name for k in kind.tolist()),
        types=tuple(types),
        capacity=frozen(np.array([each.capacity for each in types], np.int64)[kind]) if several else None,
    )
    if all(each.loaded is None for each in types) and not by_load:
        return fleet
    return replace(fleet, loaded=replace(fleet, **_columns(bodies, kind), kind=frozen(kind + num_types * by_load)))


def with_loads(fleet: Fleet, is_loaded: BoolArray) -> Fleet:
    """The fleet as it is while some of its robots [R] carry loads."""
    if fleet.loaded is None or not is_loaded.any():
        return fleet
    columns: dict[str, Any] = {
        name: frozen(np.where(is_loaded, getattr(fleet.loaded, name), getattr(fleet, name))) for name in (*LIMITS, "kind")
    }
    return replace(fleet, **columns)


def _columns(types: Sequence[RobotShape], kind: IntArray) -> dict[str, Any]:
    return {name: frozen(np.array([getattr(each, OF_TYPE.get(name, name)) for each in types], np.float64)[kind]) for name in LIMITS}


def batteries_of(types: Sequence[RobotShape]) -> tuple[Battery, ...]:
    """[K] the batteries of some types; none where a type has none. Turning costs only those that turn in place."""
    of_types = ((each.battery, each.kinematics.kind == "differential") for each in types if each.battery is not None)
    batteries = tuple(battery if turns else replace(battery, inertia_kgm2=0.0) for battery, turns in of_types if battery is not None)
    return batteries if len(batteries) == len(types) else ()


def some_of(fleet: Fleet, robots: IntArray) -> Fleet:
    """A fleet of some of the robots [K], in this order; types keep their indices."""
    robot_name, type_name = (tuple(names[r] for r in robots.tolist()) if names else () for names in (fleet.robot_name, fleet.type_name))
    columns = {name: getattr(fleet, name)[robots] for name in (*LIMITS, "kind")}
    loaded, capacity = fleet.loaded and some_of(fleet.loaded, robots), fleet.capacity if fleet.capacity is None else fleet.capacity[robots]
    more: dict[str, Any] = {"types": fleet.types, "capacity": capacity, "loaded": loaded}
    return Fleet(robot_name=robot_name, type_name=type_name, apart_m=fleet.apart_m, **more, **columns)
