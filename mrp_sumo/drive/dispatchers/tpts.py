"""The dispatcher `tpts`: token passing with task swaps. A robot may take a task from another that would be at its pick-up later.

Source: Ma, Li, Kumar and Koenig, "Lifelong multi-agent path finding for online pickup and delivery tasks", AAMAS 2017, algorithm 2, with
the run's planner for ways, and without the rule on ends (see `token_passing`).
"""

from dataclasses import dataclass

from mrp_sumo.drive.dispatchers.by_task import ByTask
from mrp_sumo.drive.dispatchers.estimates import FAR_S, free, steps_of, to_give
from mrp_sumo.drive.surroundings import Surroundings

WORTH_STEPS = 1  # by more than which a robot is nearer to a task that it takes from another


@dataclass(frozen=True)
class Tpts(ByTask):
    """Free robots in turn take the nearest order, also from a robot that would reach its first stop over a step later and chooses next."""

    def assigned(self, now_s: float, context: Surroundings) -> dict[int, int]:
        crew, start = context.crew, context.start
        holder = crew.holder
        tasks = [*holder, *to_give(context)]
        away = dict(zip(tasks, steps_of(context, start, tasks).T))
        turn = free(context)
        while turn:
            r = turn.pop(0)
            for task in sorted(tasks, key=lambda k: (-crew.tasks[k].priority, away[k][r], k)):
                if away[task][r] >= FAR_S:
                    continue
                if task in holder and away[task][holder[task]] <= away[task][r] + WORTH_STEPS:
                    continue
                if task in holder:
                    turn.insert(0, holder[task])  # it has the token next
                holder[task] = r
                break
        return {r: k for k, r in holder.items()}
