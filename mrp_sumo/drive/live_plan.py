"""A plan under way, as policies see it that change the order of passages while robots drive."""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.graph import BoolArray, FloatArray
from mrp_sumo.core.plan import Plan
from mrp_sumo.drive._causes import GRAINS
from mrp_sumo.traffic.passages import Schedule


@dataclass(frozen=True, eq=False, kw_only=True)
class LivePlan(Plan):
    """The rest of a plan: the visits from the last one that each robot has reached on, and where robots are.

    `arrive_s` and `depart_s` are as planned, and below 0 for what robots have been granted already.
    """

    order: Schedule | None  # in force; None: first come, first served
    driven_m: FloatArray  # [R] beyond the last visit that it has reached
    late_s: FloatArray  # [R] how much later than planned each robot made its last visit, or will make its next one; below 0: earlier
    held: BoolArray  # [R] whether a disturbance keeps it from driving now; nobody knows for how long


def in_grains(where: FloatArray | np.float64) -> FloatArray:
    """Distances or times as those see them who decide by them: without what an engine's rounding adds."""
    grains: FloatArray = np.rint(where * GRAINS) / GRAINS
    return grains
