"""Why a fleet does no more: how busy stations, planner and robots are, where robots wait for each other, what an order's time is spent on.

The macroscopic fundamental diagram follows Edie's definitions over all lanes of the map: density k = robot-seconds / (length x time), flow
q = distance / (length x time); Geroliminis and Daganzo, Transportation Research Part B 42, 2008.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.sizing.points import Point

MINUTE_S, HOUR_S = 60.0, 3600.0
FULL = 0.85  # utilisation above which a station or the planner is what binds
CROWDED = 0.15  # share of an order's time on the way spent standing above which the floor is
PARTS = ("assignment", "empty_travel", "loaded_travel", "standing", "queue", "serving")  # of the cycle, metrics `cycle_..._s`


@dataclass(frozen=True)
class Share:
    """How busy something is."""

    kind: str  # 'station', 'lift', 'planner', 'fleet', 'crossing', 'aisle', 'door' or 'area'
    name: str
    utilisation: float  # share of the time
    waited_s_per_h: float = 0.0  # of robots, for it


@dataclass(frozen=True, eq=False)
class Reasons:
    """What binds a fleet of one size."""

    robots: int
    limit: Share
    stations: tuple[Share, ...]  # the busiest first
    lifts: tuple[Share, ...]  # the busiest first
    places: tuple[Share, ...]  # where most is waited first
    planner: Share
    fleet: Share
    vertices: tuple[tuple[int, float], ...]  # of the plan graph, with seconds waited an hour; the heaviest first

    @property
    def worst(self) -> tuple[Share, ...]:
        """The three places that bind: full stations and lifts first, then where most is waited."""
        full = [share for share in (*self.stations, *self.lifts) if share.utilisation >= FULL]
        return tuple(dict.fromkeys([*full, *self.places]))[:3]


def reasons(point: Point) -> Reasons:
    """What binds, from the runs of a fleet."""
    runs = point.observed
    hours = sum((point.horizon_s - run["steady_s"]) / HOUR_S for run in runs) or 1.0
    served, queued, room = defaultdict[str, float](float), defaultdict[str, float](float), defaultdict[str, float](float)
    rides, before = defaultdict[str, float](float), defaultdict[str, float](float)
    waited, occupied, kinds = defaultdict[str, float](float), defaultdict[str, float](float), dict[str, str]()
    vertices = defaultdict[int, float](float)
    for run in runs:
        for name, station in run["stations"].items():
            served[name] += station["served_s"]
            queued[name] += station["queued_s"]
            room[name] += station["places"] * station["over_s"]
        for name, (kind, seconds, share) in run["places"].items():
            waited[name] += seconds
            occupied[name] += share / len(runs)
            kinds[name] = kind
        for name, (share, seconds) in run["lifts"].items():
            rides[name] += share / len(runs)
            before[name] += seconds
        for vertex, seconds in run["vertices"]:
            vertices[vertex] += seconds / hours
    stations = [Share("station", n, served[n] / room[n] if room[n] else 0.0, queued[n] / hours) for n in served]
    lifts = [Share("lift", n, rides[n], before[n] / hours) for n in rides]
    places = lifts + [Share(kinds[n], n, occupied[n], waited[n] / hours) for n in waited if n not in rides]
    for busiest_first in (stations, lifts):
        busiest_first.sort(key=lambda share: (-share.utilisation, share.name))
    places.sort(key=lambda share: (-share.waited_s_per_h, share.name))
    planner = Share("planner", "", mean_of([run["planning_share"] for run in runs]))
    fleet = Share("fleet", "", mean_of([r["metrics"].get("robot_busy_share") for r in point.records]))
    parts = cycle(point)
    on_the_way = sum(seconds for name, seconds in parts.items() if name not in ("assignment", "serving"))
    crowded = on_the_way > 0 and (parts["standing"] + parts["queue"]) / on_the_way >= CROWDED
    limit = fleet
    full = [share for share in (*stations, *lifts) if share.utilisation >= FULL]
    if full:
        limit = max(full, key=lambda share: share.utilisation)
    elif planner.utilisation >= FULL:
        limit = planner
    elif crowded and places:
        limit = places[0]
    heaviest = sorted(vertices.items(), key=lambda item: (-item[1], item[0]))
    return Reasons(point.robots, limit, tuple(stations), tuple(lifts), tuple(places), planner, fleet, tuple(heaviest))


def cycle(point: Point) -> dict[str, float]:
    """Mean parts of an order's time, s, over the runs of a fleet."""
    return {part: mean_of([record["metrics"].get(f"cycle_{part}_s") for record in point.records]) for part in PARTS}


def undisturbed_s(point: Point) -> float:
    """What an order takes from when a robot has it, in the smallest fleet: nearly alone."""
    parts = cycle(point)
    return sum(parts.values()) - parts["assignment"]


def diagram(point: Point) -> tuple[FloatArray, FloatArray]:
    """[M] density in robots/m and flow in robots/s of every minute of every run after the warm-up."""
    first = int(np.ceil(point.warm_up_s / MINUTE_S))
    bins = [
        (robots / run["lane_m"], metres / run["lane_m"] / MINUTE_S)
        for run in point.observed
        for robots, metres in run["minutes"][first:]
        if run["lane_m"]
    ]
    k, q = np.array(bins, np.float64).reshape(-1, 2).T
    return k, q


def mean_of(values: Sequence[float | None]) -> float:
    """The mean of what is there; 0 of nothing."""
    there = [value for value in values if value is not None]
    return sum(there) / len(there) if there else 0.0
