"""People who walk in a building: how many, between which places, at which times of day and how fast; and what robots do about it."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mrp_sumo.core.arrivals import Arrivals
from mrp_sumo.core.graph import IntArray
from mrp_sumo.crowd.options import EVERYBODY, USUAL_FIELDS, Group, ProtectiveFields

if TYPE_CHECKING:  # loads kernels
    from mrp_sumo.crowd.floor import Floor


@dataclass(frozen=True)
class Flow:
    """People who go from one of some places to one of others."""

    origins: tuple[int, ...]  # places
    destinations: tuple[int, ...]
    arrivals: Arrivals  # when they set out


@dataclass(frozen=True, eq=False)
class People:
    """People and their ways. Either `count` people are there all the time, or they come by `flows`."""

    floor: "Floor"
    place: IntArray  # [K] cells of the places between which people walk
    count: int = 0
    flows: tuple[Flow, ...] = ()
    clock_s: float = 0.0  # how much of the day is over as the run begins
    groups: tuple[Group, ...] = EVERYBODY
    fields: ProtectiveFields | None = USUAL_FIELDS  # None: robots take no notice of people
    seed: int = 0


def joint_places(people: People) -> list[list[int]]:
    """[K] the places that can be reached from each place, itself excluded."""
    region = people.floor.region[people.place]
    return [np.flatnonzero((region == region[k]) & (np.arange(len(region)) != k)).tolist() for k in range(len(region))]
