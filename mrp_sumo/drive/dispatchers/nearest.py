"""The dispatcher `nearest`: each task goes to the free robot that is nearest to its first stop, the most urgent and oldest task first."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.request import Request
from mrp_sumo.drive.reroute import Replan
from mrp_sumo.drive.surroundings import Surroundings
from mrp_sumo.search.distance import UNREACHABLE, distances


@dataclass(frozen=True)
class Nearest:
    """Each task goes to the free robot nearest to its first stop; all ways are planned anew when a task comes or a stop is made."""

    def finished(self, now_s: float, around: Surroundings) -> bool:
        """See Dispatcher."""
        return around.work.all_done

    def due(self, now_s: float, around: Surroundings) -> Iterable[Request]:
        """See Dispatcher."""
        work = around.work
        if not work.news:
            return
        steps, start = distances(around.graph), around.start
        free, given = set(work.free.tolist()), {}
        for task in work.unassigned:
            if not free:
                break
            to_place = steps.to_all(np.array(work.tasks[task].stops[0].places)).min(0)
            robot = min(free, key=lambda r: (int(to_place[start[r]]), r))
            if to_place[start[robot]] < UNREACHABLE:
                given[robot] = task
                free.remove(robot)
        yield work.request(now_s, start, around.closed, given)

    def answer(self, request: Request, around: Surroundings) -> Replan | None:
        """See Dispatcher."""
        return around.plan(request)
