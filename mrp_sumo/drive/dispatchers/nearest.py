"""The dispatcher `nearest`: each task goes to the free robot that is nearest to its first stop, the most urgent and oldest task first."""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.drive.dispatchers.by_task import ByTask
from mrp_sumo.drive.dispatchers.estimates import free, to_give
from mrp_sumo.drive.surroundings import Surroundings
from mrp_sumo.search.distance import UNREACHABLE, distances


@dataclass(frozen=True)
class Nearest(ByTask):
    """Each order goes to the free robot nearest to its first stop; everything is replanned when an order comes or a stop is made."""

    def assigned(self, now_s: float, context: Surroundings) -> dict[int, int]:
        crew = context.crew
        steps, start = distances(context.graph), context.start
        left, assigned = set(free(context)), {}
        for task in to_give(context):
            if not left:
                break
            to_place = steps.to_all(np.array(crew.tasks[task].stops[0].places)).min(0)
            able = (r for r in left if crew.can_do(r, task))
            robot = min(able, key=lambda r: (int(to_place[start[r]]), r), default=None)
            if robot is not None and to_place[start[robot]] < UNREACHABLE:
                assigned[robot] = task
                left.remove(robot)
        return assigned
