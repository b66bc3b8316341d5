"""The dispatcher `central`: robots without a load and all tasks that are not begun are matched again, for the least times to pick-ups.

The assignment of CENTRAL: Ma, Li, Kumar and Koenig, "Lifelong multi-agent path finding for online pickup and delivery tasks", AAMAS 2017,
section 5. Ways are those of the run's planner, which plans all robots together and makes room: so robots without a task are given no
places to park, and tasks with one end are not kept apart.
"""

from dataclasses import dataclass

from mrp_sumo.drive.dispatchers.by_task import ByTask
from mrp_sumo.drive.dispatchers.estimates import FAR_S, choice, held
from mrp_sumo.drive.surroundings import Surroundings


@dataclass(frozen=True)
class Central(ByTask):
    """All robots that carry nothing and all orders not begun are matched again each time; the sum of times to pick-ups is least."""

    def assigned(self, now_s: float, context: Surroundings) -> dict[int, int]:
        from scipy.optimize import linear_sum_assignment

        options = choice(now_s, context, len(context.crew.robots), reassign=True)
        held(options.pick_up_s, options, context)
        pick_up_s = options.pick_up_s[options.able]
        robots, columns = linear_sum_assignment(pick_up_s + options.later_s)
        matched = [(int(options.able[i]), options.task[c]) for i, c in zip(robots, columns) if pick_up_s[i, c] < FAR_S]
        return dict(matched)
