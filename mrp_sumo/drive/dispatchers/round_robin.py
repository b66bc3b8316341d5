"""The dispatcher `round_robin`: orders go to free robots in turn, wherever these are; what others are held against."""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.task import NOBODY
from mrp_sumo.drive.dispatchers.by_task import ByTask
from mrp_sumo.drive.dispatchers.estimates import free, to_give
from mrp_sumo.drive.surroundings import Surroundings
from mrp_sumo.search.distance import UNREACHABLE, distances


@dataclass(frozen=True)
class RoundRobin(ByTask):
    """Each order goes to the free robot that was given one longest ago, wherever it is; the most urgent and oldest order first."""

    def assigned(self, now_s: float, context: Surroundings) -> dict[int, int]:
        crew, steps, start = context.crew, distances(context.graph), context.start
        orders, last_s = crew.orders, np.full(len(context.start), -np.inf)
        for task, robot in enumerate(orders.robot):
            if robot != NOBODY and orders.is_order(task):
                last_s[robot] = max(last_s[robot], orders.assigned_s(task))
        in_turn, assigned = sorted(free(context), key=lambda r: (last_s[r], r)), dict[int, int]()
        for task in to_give(context):
            to_place = steps.to_all(np.array(crew.tasks[task].stops[0].places)).min(0)
            able = (r for r in in_turn if r not in assigned and crew.can_do(r, task) and to_place[start[r]] < UNREACHABLE)
            if (robot := next(able, NOBODY)) != NOBODY:
                assigned[robot] = task
        return assigned
