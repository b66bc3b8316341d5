"""The dispatcher `hungarian`: robots and tasks are matched so that the sum of the times at which tasks will be done is least.

The assignment problem of Kuhn, "The Hungarian method for the assignment problem", Naval Research Logistics Quarterly 2, 1955.
"""

from dataclasses import dataclass

from mrp_sumo.core.options import option
from mrp_sumo.drive.dispatchers.by_task import ByTask
from mrp_sumo.drive.dispatchers.estimates import FAR_S, choice, held
from mrp_sumo.drive.surroundings import Surroundings


@dataclass(frozen=True)
class Hungarian(ByTask):
    """The sum of the times at which orders will be done is least, busy robots included; of too many orders the shortest go first."""

    reassign: bool = option(True, "orders may go to other robots until their first stops are made")
    busy: bool = option(True, "an order may wait for a robot that is at work")

    def assigned(self, now_s: float, context: Surroundings) -> dict[int, int]:
        from scipy.optimize import linear_sum_assignment

        options = choice(now_s, context, len(context.crew.robots), reassign=self.reassign, busy=self.busy)
        cost_s = options.pick_up_s + options.rest_s + options.later_s
        held(cost_s, options, context)
        matched = zip(*(side.tolist() for side in linear_sum_assignment(cost_s))) if options.task else ()
        able = set(options.able.tolist())
        return {r: options.task[c] for r, c in matched if r in able and options.pick_up_s[r, c] < FAR_S}
