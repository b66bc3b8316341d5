"""The dispatcher `regret`: task by task, first the one that loses most if it does not get its best robot.

The insertion rule of Potvin and Rousseau, "A parallel route building algorithm for the vehicle routing and scheduling problem with time
windows", European Journal of Operational Research 66, 1993.
"""

from dataclasses import dataclass

from mrp_sumo.drive.dispatchers.by_task import ByTask
from mrp_sumo.drive.dispatchers.estimates import FAR_S, choice
from mrp_sumo.drive.surroundings import Surroundings


@dataclass(frozen=True)
class Regret(ByTask):
    """Of the orders that free robots can do soonest, the one that loses most with its second best robot goes first."""

    def assigned(self, now_s: float, context: Surroundings) -> dict[int, int]:
        options, assigned = choice(now_s, context, len(context.crew.free), reassign=False), dict[int, int]()
        free = options.able.tolist()
        done_s = options.pick_up_s + options.rest_s + options.later_s
        soonest = done_s[free].min(0, initial=FAR_S).argsort(kind="stable")
        left = sorted(soonest[: None if options.typed else len(free)].tolist())  # as many tasks as robots
        while left and free:
            ranked = {c: sorted((float(done_s[r, c]), r) for r in free) for c in left}
            second = {c: of[1][0] if len(of) > 1 else FAR_S for c, of in ranked.items()}
            c = max(left, key=lambda c: (second[c] - ranked[c][0][0], -c))
            left.remove(c)
            robot = ranked[c][0][1]
            if options.pick_up_s[robot, c] < FAR_S:
                assigned[robot] = options.task[c]
                free.remove(robot)
        return assigned
