"""Dispatchers: what decides what robots do next, and knows when all is done. A plug-in is a class with this face.

Every run begins with `OneShot`, whose one request is answered by the plan of the scenario's planner; the scenario's own dispatcher
goes on from there, and recovery (`drive.recovery`) beside it.
"""

from collections.abc import Iterable, Mapping
from typing import Any, Protocol, cast

from mrp_sumo.core.request import Request
from mrp_sumo.drive.outside_dispatcher import OutsideDispatcher
from mrp_sumo.drive.replanning import request_for
from mrp_sumo.drive.reroute import Replan
from mrp_sumo.drive.surroundings import Surroundings
from mrp_sumo.plugins import registry


class Dispatcher(Protocol):
    """Decides what robots do next. One is made for every run; its fields are its parameters."""

    def finished(self, now_s: float, context: Surroundings) -> bool:
        """True if all is done that there is to do. The run ends then, if recovery has nothing under way."""

    def due(self, now_s: float, context: Surroundings) -> Iterable[Request]:
        """Requests to be decided now, the most important first; nothing more is asked once one of them has been answered.

        Parameters
        ----------
        context
            `context.ledger` has the robots' visits, `context.crew` robots and tasks, `context.closed` the lanes that nobody may use.
        """

    def answer(self, request: Request, context: Surroundings) -> Replan | None:
        """Ways for robots, from the last visits that they have been granted; None: they go on as they are.

        `context.plan(request)` has them from the planner of the run. Raises PlanError where there are none.
        """


class OneShot:
    """All tasks are there at the start: a plan for all robots at once, and done when each stands where its tasks end."""

    def finished(self, now_s: float, context: Surroundings) -> bool:
        """See Dispatcher."""
        visits = context.ledger.visits
        return bool((visits.reached == visits.last).all() and context.state.home.all() and context.ledger.turned.all())

    def due(self, now_s: float, context: Surroundings) -> Iterable[Request]:
        """See Dispatcher."""
        if not context.ledger.entries:
            yield request_for(now_s, context, range(context.ledger.num_robots), "plan")

    def answer(self, request: Request, context: Surroundings) -> Replan | None:
        """See Dispatcher."""
        return context.plan(request)


def dispatcher_of(name: str, parameters: Mapping[str, Any]) -> Dispatcher:
    """A dispatcher of this name, as registered or `FILE.py:CLASS`, for one run; parameters have their defaults otherwise.

    Raises ScenarioError for an unknown name or parameter (with the nearest right one) and a value that does not fit, and PlugInError for a
    plug-in that cannot be loaded, or is no dispatcher.
    """
    source = registry.find("dispatchers", name)
    made = registry.make("dispatchers", name, parameters)
    return cast(Dispatcher, made if source.ours else OutsideDispatcher(made, source))
