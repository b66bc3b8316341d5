"""Ways of people in a run, and what they cost robots."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class PeopleLog:
    """N sightings of P people at the T samples of a run, in CSR form, and S stops of R robots by time."""

    first: IntArray  # [T + 1] who is there at sample k: first[k]:first[k + 1]
    person: NDArray[np.int32]  # [N] numbered in the order in which people came
    x_m: NDArray[np.float32]  # [N] centre, map frame
    y_m: NDArray[np.float32]  # [N]
    level: IntArray  # [P] that each is on, in the order of the graph's names
    waited_s: FloatArray  # [P] for how long each stood before robots
    radius_m: float  # of everybody
    lost_s: FloatArray  # [R] time that people cost each robot
    stop_robot: IntArray  # [S]
    stop_s: FloatArray  # [S] when somebody came into its protective field
    stop_duration_s: FloatArray  # [S] until it went on
    stop_in_motion: BoolArray  # [S] whether it was in motion then, or about to set out
    extra_m: float  # of the fields: see `crowd.model.Fields`; NaN where robots take no notice of people
    reaction_s: float
    side_m: float
    slowest_mps: float

    @property
    def num_people(self) -> int:
        return len(self.level)
