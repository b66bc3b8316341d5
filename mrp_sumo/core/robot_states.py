"""States of the robots of a run with tasks, without gaps."""

from dataclasses import dataclass

from mrp_sumo.core.graph import FloatArray, IntArray

ROBOT_STATES = (
    "working",  # it has an order: drives, waits or is served
    "idle",
    "charging",  # or on its way to a charger
    "empty",  # its battery is: it stands for good
    "broken",
    "stalled",  # it has an order or is to charge, and does not get on, for nothing that the work itself asks for
)
WORKING, IDLE, CHARGING, EMPTY, BROKEN, STALLED = range(len(ROBOT_STATES))


@dataclass(frozen=True, eq=False)
class RobotStateLog:
    """N intervals by robot and time; those of a robot follow each other from 0 to the end of the run."""

    robot: IntArray  # [N]
    state: IntArray  # [N] indices of `ROBOT_STATES`
    begin_s: FloatArray  # [N]
    end_s: FloatArray  # [N]
    task: IntArray  # [N] number in the `TaskLog` of the order that it had, -1: none
