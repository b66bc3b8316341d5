"""A crowd as its kernels see it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray

CELL_M = 0.2  # side of a cell
BODY_M = 0.25  # radius of people
ASIDE_M = 0.05  # between them and the field of a robot that they let pass


class Ground(NamedTuple):
    """A floor, see `crowd.floor.Floor`, and the bins that neighbours are looked for in."""

    x_m: float
    y_m: float
    width: int
    height: int
    walls: FloatArray  # [W, 4]
    first: IntArray  # [C + 1]
    near: IntArray
    free: BoolArray  # [C]
    back: NDArray[np.uint8]  # [C]
    columns: int  # of bins
    rows: int


class Walkers(NamedTuple):
    """Room for P people, [P], of whom the first are there; B bins."""

    x_m: FloatArray
    y_m: FloatArray
    vx_mps: FloatArray
    vy_mps: FloatArray
    ax_mps2: FloatArray
    ay_mps2: FloatArray
    wish_mps: FloatArray  # the speed at which each would like to walk
    headway_s: FloatArray  # that each keeps behind others
    spacing_m: FloatArray  # between centres, at which each stands behind others
    person: IntArray  # its number, in the order in which people came
    goal: IntArray  # row of the ways to where it goes
    home: IntArray  # and to where it came from
    away_until_s: FloatArray  # until when it goes back a little, since there was no way past
    stuck_s: FloatArray  # for how long it has made no way
    waited_s: FloatArray  # for how long it has stood before a robot
    is_there: BoolArray
    first: IntArray  # [B + 1] CSR: people by bin
    member: IntArray


class Machines(NamedTuple):
    """R robots, [R], as people see them; NaN: not on the floor. B bins."""

    x_m: FloatArray
    y_m: FloatArray
    yaw_rad: FloatArray
    along_mps: FloatArray  # speed towards where the robot faces, negative backwards
    half_length_m: FloatArray
    half_width_m: FloatArray
    side_m: float  # width of their fields beside the footprint
    is_halted: BoolArray  # whether it stands for somebody
    first: IntArray  # [B + 1] CSR: robots by bin
    member: IntArray
