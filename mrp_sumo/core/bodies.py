"""Bodies of robots and of what they tow, sample by sample: rectangles, one for each robot and one for each trailer."""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Rectangles:
    """B rectangles in T samples: R robots first, then trailers."""

    x_m: FloatArray  # [T, B] of their middles
    y_m: FloatArray  # [T, B]
    yaw_rad: FloatArray  # [T, B]
    owner: IntArray  # [B] robot
    name: tuple[str, ...]  # [B]
    length_m: FloatArray  # [B]
    width_m: FloatArray  # [B]
    bar_m: FloatArray  # [B] from the middle ahead to the hitch, 0 for what hangs on nothing


def bodies_of(execution: Execution, fleet: Fleet) -> Rectangles:
    """All bodies of a run. Trailers hang on the middle of the axle in front, `hitch_m` behind it; those of unknown angles are left out."""
    x, y, yaw = execution.x_m, execution.y_m, execution.yaw_rad
    owner, name = list(range(fleet.num_robots)), list(fleet.robot_name)
    length, width, bar = fleet.length_m.tolist(), fleet.width_m.tolist(), [0.0] * fleet.num_robots
    more_x, more_y, more_yaw = [], [], []
    for r, k in enumerate(fleet.kind.tolist() if fleet.vehicle_of_kind else ()):
        here_x, here_y = axle_of(x[:, r], y[:, r], yaw[:, r], fleet.types[k].kinematics.ahead_m)
        facing = yaw[:, r]
        for n, trailer in enumerate(fleet.types[k].trailers[: len(execution.hitch_rad)]):
            here_x, here_y = here_x - trailer.hitch_m * np.cos(facing), here_y - trailer.hitch_m * np.sin(facing)
            facing = facing + execution.hitch_rad[f"hitch_{n + 1}_rad"][:, r]
            here_x, here_y = here_x - trailer.length_m * np.cos(facing), here_y - trailer.length_m * np.sin(facing)
            more_x.append(here_x)
            more_y.append(here_y)
            more_yaw.append(facing)
            owner.append(r)
            name.append(f"{fleet.robot_name[r]}, trailer {n + 1}")
            length.append(trailer.body_m or trailer.length_m)
            width.append(trailer.width_m or float(fleet.width_m[r]))
            bar.append(trailer.length_m)
    if more_x:
        x, y, yaw = (np.column_stack([one, *more]) for one, more in ((x, more_x), (y, more_y), (yaw, more_yaw)))
    return Rectangles(x, y, yaw, np.array(owner, np.int64), tuple(name), np.array(length), np.array(width), np.array(bar))


def axle_of(x: FloatArray, y: FloatArray, yaw: FloatArray, ahead_m: float | FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places of the fixed axles of bodies whose middle is `ahead_m` before them."""
    return x - ahead_m * np.cos(yaw), y - ahead_m * np.sin(yaw)
