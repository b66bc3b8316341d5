"""Who walks in a building: how many, between which places, at which times of day and how fast; and what robots do about it."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.stream import Arrivals

if TYPE_CHECKING:  # loads kernels
    from mrp_sumo.crowd.floor import Floor


@dataclass(frozen=True)
class Flow:
    """People who go from one of some places to one of others."""

    origins: tuple[int, ...]  # places
    destinations: tuple[int, ...]
    arrivals: Arrivals  # when they set out


@dataclass(frozen=True)
class Group:
    """People who walk alike: their speeds are normally distributed, cut off two standard deviations from the mean."""

    share: float  # of all people, to be divided by the sum of all shares
    speed_mps: float = 1.34
    spread_mps: float = 0.26


@dataclass(frozen=True)
class ProtectiveFields:
    """The warning and protective fields of robots.

    At speed v the protective field reaches S_L = S_A + TZ + Z_R + Z_F + Z_B with S_A = v^2 / (2 d) + v (t_control + t_scanner), where d is
    the deceleration of the robot's type.
    """

    scanner_s: float = 0.1  # until the scanner has seen somebody
    control_s: float = 0.1  # and the brakes take hold
    tolerance_m: float = 0.1  # TZ, of the scanner's distances
    reflection_m: float = 0.2  # Z_R, for reflectors nearby
    ground_m: float = 0.05  # Z_F, for want of ground clearance
    braking_m: float = 0.1  # Z_B, for brakes that have worn
    side_m: float = 0.1  # beside the footprint
    slowest_mps: float = 0.1  # the warning field slows a robot down to this
    restart_s: float = 2.0  # for which the protective field has to be free before the robot goes on

    @property
    def extra_m(self) -> float:
        """TZ + Z_R + Z_F + Z_B."""
        return self.tolerance_m + self.reflection_m + self.ground_m + self.braking_m


@dataclass(frozen=True, eq=False)
class People:
    """Who walks where. Either `count` people are there all the time, or they come by `flows`."""

    floor: "Floor"
    place: IntArray  # [K] cells of the places between which people walk
    count: int = 0
    flows: tuple[Flow, ...] = ()
    groups: tuple[Group, ...] = (Group(1.0),)
    fields: ProtectiveFields | None = ProtectiveFields()  # None: robots take no notice of people
    seed: int = 0


@dataclass(frozen=True)
class LaneSpeeds:
    """Instead of people: a robot's speed is drawn for each lane it enters, from a triangular distribution."""

    least_mps: float = 0.274
    usual_mps: float = 0.508
    most_mps: float = 0.63
    seed: int = 0


def joint_places(people: People) -> list[list[int]]:
    """[K] the places that can be reached from each place, itself excluded."""
    region = people.floor.region[people.place]
    return [np.flatnonzero((region == region[k]) & (np.arange(len(region)) != k)).tolist() for k in range(len(region))]
