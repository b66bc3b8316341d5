"""The dispatcher `min_cost_flow`: each robot gets a row of tasks, so that the sum of the times at which tasks will be done is least.

A task that is the k-th from the last of n in a row makes k of them later, itself included: it costs k times its own time. So the best rows
are a flow from tasks to slots (robot, k), one unit each: Horn, "Minimizing average flow time with parallel machines", Operations
Research 21, 1973. Its own time is the way from where the robot will be free, and the task; only the first of a row is given, all are laid
out again when something has changed.
"""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.options import option
from mrp_sumo.drive.dispatchers.by_task import ByTask
from mrp_sumo.drive.dispatchers.estimates import FAR_S, choice, held
from mrp_sumo.drive.surroundings import Surroundings
from mrp_sumo.errors import ScenarioError
from mrp_sumo.plugins import registry


@dataclass(frozen=True)
class MinCostFlow(ByTask):
    """Several orders in a row for each robot, busy ones included: the flow with the least sum of the times at which orders are done."""

    depth: int = option(3, "orders in a row at most")
    reassign: bool = option(True, "orders may go to other robots until their first stops are made")

    def __post_init__(self) -> None:
        if self.depth < 1:
            raise ScenarioError(f"depth is {self.depth}, expected 1 or more")

    def assigned(self, now_s: float, context: Surroundings) -> dict[int, int]:
        num_robots = len(context.crew.robots)
        options = choice(now_s, context, self.depth * num_robots, reassign=self.reassign, busy=True)
        depth = max(1, min(self.depth, -(-len(options.task) // num_robots)))  # no longer rows than all need
        first_s = options.pick_up_s - options.ready_s[:, None]  # [R, K]
        after_s = np.broadcast_to(options.between_s, first_s.shape)  # from the end of a task that is not known yet
        way_s = np.stack([first_s if k == depth else after_s for k in range(depth, 0, -1)], 1)
        last = np.arange(depth, 0, -1)[None, :, None]  # a slot's number from the last
        cost_s = options.ready_s[:, None, None] + last * (way_s + options.rest_s)  # [R, slot, K]
        held(cost_s, options, context)
        cost_s[np.broadcast_to((options.pick_up_s >= FAR_S)[:, None], cost_s.shape)] = FAR_S  # not later in the row, either
        slots = (np.minimum(cost_s, FAR_S) + options.later_s).reshape(num_robots * depth, len(options.task))
        column_of = registry.make("assigners", "min_cost_flow", {}).assign(slots, np.inf).reshape(num_robots, depth)
        assigned = {}
        for r in options.able.tolist():
            row = [c for c in column_of[r].tolist() if c >= 0 and options.pick_up_s[r, c] < FAR_S]
            if row:
                assigned[r] = options.task[min(row, key=lambda c: options.later_s[c])]  # the first in the row of the most urgent
        return assigned
