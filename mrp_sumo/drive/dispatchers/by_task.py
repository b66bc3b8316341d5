"""Parts that dispatchers of tasks share: they decide when there is news, and the run's planner has ways for all robots.

Each dispatcher says in `given` who gets which task.
"""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping

from mrp_sumo.core.request import Request
from mrp_sumo.drive.dispatchers.estimates import oldest_first
from mrp_sumo.drive.reroute import Replan
from mrp_sumo.drive.surroundings import Surroundings
from mrp_sumo.drive.work_request import work_request


class ByTask(ABC):
    """Gives orders to robots; everything is replanned when an order comes or a stop is made."""

    @abstractmethod
    def assigned(self, now_s: float, context: Surroundings) -> Mapping[int, int]:
        """Tasks, by the robots that are to have them from now on; also what they have already."""

    def finished(self, now_s: float, context: Surroundings) -> bool:
        """See Dispatcher."""
        return context.crew.all_done

    def due(self, now_s: float, context: Surroundings) -> Iterable[Request]:
        """See Dispatcher."""
        if context.crew.is_changed:
            assigned = oldest_first(self.assigned(now_s, context), context)
            yield work_request(context.crew, now_s, context.closed, assigned)

    def answer(self, request: Request, context: Surroundings) -> Replan | None:
        """See Dispatcher."""
        return context.plan(request)
