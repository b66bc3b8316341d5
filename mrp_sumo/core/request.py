"""Requests to a planner while robots drive: from where each is committed to be, by which stops, over which lanes.

One-shot planning is the request of time 0, in which every robot stands at its start and has one stop.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np

from mrp_sumo.core.fleet import some_of
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, frozen, with_lanes
from mrp_sumo.core.problem import Problem, Standing
from mrp_sumo.errors import PlanError


@dataclass(frozen=True, eq=False)
class Request:
    """K robots of a fleet, and the stops ahead of each, S in all.

    `site` has the graph, the fleet, the planned time for a lane and the seed.
    """

    now_s: float
    site: Problem
    robot: IntArray  # [K] numbers in the fleet
    start: IntArray  # [K] vertex that each is committed to reach, and free to leave
    stop_first: IntArray  # [K + 1] CSR
    stop: IntArray  # [S] vertices
    closed: BoolArray  # [L] lanes that nobody may use
    reason: str = ""  # why it is made, for people
    since_s: FloatArray | None = None  # [K] since when each has been on its way to its next stop; inf: it has no work; None: unknown
    there_s: Mapping[int, float] = field(default_factory=dict)  # robots that are where they have their stop, and how long that takes
    standing: Standing | None = None  # [K] how vehicles are at their starts; None: there are none
    end_heading_rad: FloatArray | None = None  # [K] in which vehicles are to come to their last stops, NaN: any; None: all in any

    @property
    def end(self) -> IntArray:
        """[K] the last stop of each robot, which has one or more."""
        return self.stop[self.stop_first[1:] - 1]

    @property
    def via(self) -> tuple[tuple[int, ...], ...]:
        """[K] the stops of each robot before its last."""
        return tuple(tuple(self.stop[a : b - 1].tolist()) for a, b in zip(self.stop_first[:-1].tolist(), self.stop_first[1:].tolist()))


AnyRequest = TypeVar("AnyRequest", bound=Request)


def next_stops(request: Request) -> Request:
    """The request without the stops that come after each robot's next one."""
    first = request.stop_first[:-1]
    return replace(request, stop_first=np.arange(len(first) + 1), stop=frozen(request.stop[first]))


def with_stops_before(request: AnyRequest, via: Sequence[Sequence[int]]) -> AnyRequest:
    """A request of one stop each, with these [K] stops to be made before."""
    count = [len(stops) + 1 for stops in via]
    stop = [v for stops, end in zip(via, request.stop.tolist()) for v in (*stops, end)]
    return replace(request, stop_first=frozen(np.cumsum([0, *count]).astype(np.int64)), stop=frozen(np.array(stop, np.int64)))


def a_stop_each(request: Request) -> None:
    """Refuse a request in which a robot has no stop. Raises PlanError."""
    count = np.diff(request.stop_first)
    if (count < 1).any():
        name = request.site.fleet.robot_name[int(request.robot[np.flatnonzero(count < 1)[0]])]
        raise PlanError(f"{name} has no stops ahead, expected one or more")


def one_shot(request: Request) -> Problem:
    """The request as a problem: a start and a goal for each of its robots, on the lanes that are open.

    Stops before a robot's last are to be passed on its way. Raises PlanError when a robot has no stop.
    """
    a_stop_each(request)
    several = len(request.stop) > len(request.robot)
    site, any_closed = request.site, bool(request.closed.any())
    if site.fleet.vehicle_of_kind and any_closed:  # lanes keep their numbers, by which one knows how vehicles stand
        shut = np.tile(request.closed, (site.fleet.num_kinds, 1))
        site, any_closed = replace(site, barred=shut if site.barred is None else site.barred | shut), False
    return replace(
        site,
        graph=with_lanes(site.graph, ~request.closed) if any_closed else site.graph,
        barred=site.barred[:, ~request.closed] if any_closed and site.barred is not None else site.barred,
        fleet=some_of(site.fleet, request.robot),
        start=frozen(request.start),
        goal=frozen(request.end),
        goal_of=frozen(np.arange(len(request.robot))),
        since_s=request.since_s,
        via=request.via if several else (),
        start_heading_rad=None,
        goal_heading_rad=request.end_heading_rad,
        goal_kind=None,
        standing=request.standing,
    )
