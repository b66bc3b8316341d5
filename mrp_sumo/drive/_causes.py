"""Codes that the controller's kernels share: why robots wait, how their time is booked, what the log says."""

# why a robot does not go on
FREE, TURNING, PLANNED, OTHER, ONCOMING, FOLLOWING, DISTURBED, FINISHED, LETTING_PASS, FACILITY = range(10)
# how a robot's time is booked, the columns of `core.execution.BOOKINGS`
MOVING, TURN, PLANNED_WAIT, DEPENDENCY_WAIT, YIELDING, BLOCKED, DISTURBANCE, AT_GOAL = range(8)
# kinds of entries in the log
WAITED, STOOD_BLOCKED, ARRIVED_AT_GOAL, SET_OUT = range(4)

ARRIVED_M = 0.002  # a robot this close to a vertex has arrived there: it stops MARGIN_M before
MARGIN_M = 0.001  # a robot is stopped this far before the end of what it may drive
GRAINS = 2.0**20  # in a metre or a second: as finely as robots, people and policies see each other; half a grain is no decimal
TURNED_RAD = 1e-9  # a robot that has to turn by no more need not turn
