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
    """Gives tasks to robots; everything is replanned when a task comes or a stop is made."""

    @abstractmethod
    def given(self, now_s: float, around: Surroundings) -> Mapping[int, int]:
        """Tasks, by the robots that are to have them from now on; also what they have already."""

    def finished(self, now_s: float, around: Surroundings) -> bool:
        """See Dispatcher."""
        return around.crew.all_done

    def due(self, now_s: float, around: Surroundings) -> Iterable[Request]:
        """See Dispatcher."""
        if around.crew.is_changed:
            given = oldest_first(self.given(now_s, around), around)
            yield work_request(around.crew, now_s, around.closed, given)

    def answer(self, request: Request, around: Surroundings) -> Replan | None:
        """See Dispatcher."""
        return around.plan(request)
