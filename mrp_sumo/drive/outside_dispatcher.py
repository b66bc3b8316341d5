"""Dispatchers from outside, in this process: their exceptions become one line that names theirs, and their answers are checked.

The ledger and the kernels take what a dispatcher answers as it is, so a vertex that does not exist must not get through.
"""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from mrp_sumo.core.request import Request
from mrp_sumo.drive.reroute import Replan, Reroute
from mrp_sumo.drive.surroundings import Surroundings
from mrp_sumo.errors import PlanError, PlanningOverrun, PlugInError
from mrp_sumo.plugins.face import place_of
from mrp_sumo.plugins.source import Source, calling


class DispatcherError(PlugInError):
    """A dispatcher that broke its contract."""


class OutsideDispatcher:
    """A dispatcher; see `Dispatcher`. Every call raises DispatcherError for whatever the plug-in does wrong."""

    def __init__(self, dispatcher: Any, source: Source) -> None:
        self._dispatcher, self._source = dispatcher, source

    def finished(self, now_s: float, context: Surroundings) -> bool:
        """See `Dispatcher`."""
        return bool(self._guarded(self._dispatcher.finished, now_s, context))

    def due(self, now_s: float, context: Surroundings) -> Iterable[Request]:
        """See `Dispatcher`."""
        requests = self._guarded(lambda: tuple(self._dispatcher.due(now_s, context)))
        odd = next((type(each).__name__ for each in requests if not isinstance(each, Request)), "")
        if odd:
            raise DispatcherError(f"{place_of(self._dispatcher.due)}: due() gave {odd}, expected a Request")
        return tuple(requests)

    def answer(self, request: Request, context: Surroundings) -> Replan | None:
        """See `Dispatcher`."""
        reply = self._guarded(self._dispatcher.answer, request, context)
        if reply is None:
            return None
        wrong = f"returned {type(reply).__name__}, expected a Replan or None" if not isinstance(reply, Replan) else fault(reply, context)
        if wrong:
            raise DispatcherError(f"{place_of(self._dispatcher.answer)}: answer() {wrong}")
        return reply  # type: ignore[no-any-return]

    def _guarded(self, call: Callable[..., Any], *arguments: Any) -> Any:
        try:
            with calling(self._source, call, PlanError, PlanningOverrun):  # there is no plan
                return call(*arguments)
        except PlanningOverrun:
            raise
        except PlugInError as wrong:
            raise DispatcherError(str(wrong), details=wrong.details) from wrong


def fault(reply: Replan, context: Surroundings) -> str:
    """Fault of a reply, '' if it can be driven."""
    names = context.ledger.problem.fleet.robot_name
    for robot, route in reply.reroute.items():
        if not isinstance(robot, int | np.integer) or not 0 <= robot < len(names):
            return f"sends robot {robot!r}, expected 0 to {len(names) - 1}"
        if not isinstance(route, Reroute):
            return f"sends {names[robot]} by {type(route).__name__}, expected a Reroute"
        if wrong := _fault_of_way(route, context, robot):
            return f"sends {names[robot]} {wrong}"
    return ""


def _fault_of_way(route: Reroute, context: Surroundings, robot: int) -> str:
    graph = context.graph
    vertex, times = np.asarray(route.vertex), [np.asarray(route.arrive_s), np.asarray(route.depart_s)]
    if vertex.ndim != 1 or (len(vertex) and vertex.dtype.kind not in "iu") or any(t.shape != vertex.shape for t in times):
        return "by arrays that are not one vertex, one arrival and one departure for each visit"
    if any(np.isnan(t).any() for t in times) or np.isnan(route.leave_s):
        return "at times that are no times"
    outside = (vertex < 0) | (vertex >= graph.num_vertices)
    if outside.any():
        return f"to vertex {int(vertex[outside][0])}, which does not exist"
    before = int(context.ledger.visits.vertex[context.granted(robot)])
    if context.ledger.is_driving_back[robot]:
        if not len(vertex) or int(vertex[0]) != before:
            return f"elsewhere than back to '{graph.known_as(before)}', to which it has turned round on its lane"
        vertex = vertex[1:]
    elif route.back:
        if not len(vertex) or int(vertex[0]) != before or not context.state.grants.on_lane[robot]:
            return "back on a lane on which it does not stand"
        vertex = vertex[1:]
    for v in vertex.tolist():
        if graph.lane_between(before, v) < 0:
            return f"from '{graph.known_as(before)}' to '{graph.known_as(v)}', where there is no lane"
        before = v
    return ""
