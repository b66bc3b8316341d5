"""The dispatcher `token_passing`: free robots in turn take the nearest task, those that are nearest to one first.

The choice of TP: Ma, Li, Kumar and Koenig, "Lifelong multi-agent path finding for online pickup and delivery tasks", AAMAS 2017,
algorithm 1. There a robot only takes a task if no other's way ends at its pick-up or delivery, since ways are planned one by one and end
there for good. Here the run's planner plans all together and makes room, so such tasks are merely taken last: where many tasks end at
few stations, the paper's rule leaves most robots without crew.
"""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.options import option
from mrp_sumo.core.task import Task
from mrp_sumo.drive.dispatchers.by_task import ByTask
from mrp_sumo.drive.dispatchers.estimates import FAR_S, free, steps_of, to_give
from mrp_sumo.drive.surroundings import Surroundings


@dataclass(frozen=True)
class TokenPassing(ByTask):
    """Free robots in turn take the most urgent and nearest order, preferably one that shares no end with another robot's order."""

    exclusive: bool = option(False, "as in the paper, only orders at whose ends no other robot's order ends")

    def assigned(self, now_s: float, context: Surroundings) -> dict[int, int]:
        crew = context.crew
        start, assigned, waiting = context.start, dict[int, int](), list(to_give(context))
        away = dict(zip(waiting, steps_of(context, start, waiting).T))
        ends = [crew.tasks[k].stops[-1].places for k in [robot.task for robot in crew.robots] if k >= 0]
        nearest = np.min([*away.values()], 0) if away else np.zeros(len(start))
        for r in sorted(free(context), key=lambda r: (nearest[r], r)):
            token = {v for places in ends for v in places}
            near = [k for k in waiting if away[k][r] < FAR_S]
            apart = [k for k in near if not _touches(crew.tasks[k], token)]
            best = min(apart or ([] if self.exclusive else near), key=lambda k: (-crew.tasks[k].priority, away[k][r], k), default=None)
            if best is not None:
                assigned[r] = best
                waiting.remove(best)
                ends.append(crew.tasks[best].stops[-1].places)
        return assigned


def _touches(task: Task, token: set[int]) -> bool:
    """True if all places of its first or of its last stop are ends of others."""
    return token.issuperset(task.stops[0].places) or token.issuperset(task.stops[-1].places)
