"""Why a fleet does no more: how busy stations, planner and robots are, where robots wait for each other, what an order's time is spent on.

The macroscopic fundamental diagram follows Edie's definitions over all lanes of the map: density k = robot-seconds / (length x time), flow
q = distance / (length x time); Geroliminis and Daganzo, Transportation Research Part B 42, 2008.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.graph import FloatArray, NavGraph
from mrp_sumo.core.places import beside
from mrp_sumo.sizing.points import UNANSWERED, Point

MINUTE_S, HOUR_S = 60.0, 3600.0
FULL = 0.85  # share of the time above which something that is pressed binds
FELT = 0.05  # share of the robots' time that must be lost to a place on the floor, so that it can bind
CROWDED = 0.15  # share of the robots' time lost to waiting, or without an order, above which the fleet itself is not what binds
PARTS = ("assignment", "empty_travel", "loaded_travel", "standing", "queue", "serving")  # of the cycle, metrics `cycle_..._s`
SERVERS = ("station", "lift", "charger", "planner")


@dataclass(frozen=True)
class Share:
    """Share of time for which a place or the fleet is busy."""

    kind: str  # 'station', 'lift', 'charger', 'planner', 'fleet', 'orders', 'crossing', 'aisle', 'door' or 'area'
    name: str
    utilisation: float  # share of the time for which it serves, or somebody waits because of it
    waited_s_per_h: float = 0.0  # of robots, because of it


@dataclass(frozen=True, eq=False)
class Reasons:
    """Limits that bind a fleet of one size."""

    robots: int
    limit: Share
    stations: tuple[Share, ...]  # by the time that they serve, the busiest first
    places: tuple[Share, ...]  # all that robots wait for, stations, lifts and chargers included, the worst first
    fleet: Share
    vertices: tuple[tuple[int, float], ...]  # of the plan graph, with seconds waited an hour; the heaviest first

    @property
    def worst(self) -> tuple[Share, ...]:
        """The three that cost most, of those that cost a minute an hour or are in use nearly all the time."""
        return tuple(p for p in self.places if p.waited_s_per_h >= MINUTE_S or p.utilisation >= FULL)[:3]


def reasons(point: Point) -> Reasons:
    """Limits that bind, from the runs of a fleet."""
    runs = point.observed
    seconds = sum(point.until_s - min(run["steady_s"], point.until_s) for run in runs) or 1.0
    served, queued, room = defaultdict[str, float](float), defaultdict[str, float](float), defaultdict[str, float](float)
    waited, pressed = defaultdict[tuple[str, str], float](float), defaultdict[tuple[str, str], float](float)
    vertices = defaultdict[int, float](float)
    for run in runs:
        for name, station in run["stations"].items():
            served[name] += station["served_s"]
            queued[name] += station["queued_s"]
            room[name] += station["places"] * station["over_s"]
        for kind, name, wait_s, share in run["causes"]:
            waited[kind, name] += wait_s
            pressed[kind, name] += share / len(runs)
        for vertex, wait_s in run["vertices"]:
            vertices[vertex] += wait_s / seconds * HOUR_S
    stations = [Share("station", n, served[n] / room[n] if room[n] else 0.0, queued[n] / seconds * HOUR_S) for n in served]
    stations.sort(key=lambda share: (-share.utilisation, share.name))
    places = [Share(kind, name, pressed[kind, name], waited[kind, name] / seconds * HOUR_S) for kind, name in waited]
    places.sort(key=lambda share: (-share.waited_s_per_h, -share.utilisation, share.name))
    fleet = Share("fleet", "", mean_of([r["metrics"].get("robot_busy_share") for r in point.records]))
    heaviest = sorted(vertices.items(), key=lambda item: (-item[1], item[0]))
    return Reasons(point.robots, _limit(point, places, fleet), tuple(stations), tuple(places), fleet, tuple(heaviest))


def _limit(point: Point, places: Sequence[Share], fleet: Share) -> Share:
    """The planner where it has no plans; chargers where robots run empty; orders where robots stand idle for want of them; else what costs
    most, if it is pressed or the waiting is much; else the fleet itself. `places` are sorted, the worst first.
    """
    if point.unanswered_share > UNANSWERED:
        return Share("planner", "", point.unanswered_share)
    if point.num_empty:
        return next((share for share in places if share.kind == "charger"), Share("charger", "charger", 0.0))
    idle = mean_of([run["idle_share"] for run in point.observed])
    lost = {share: share.waited_s_per_h / HOUR_S / point.robots for share in places}
    if idle >= CROWDED and idle > sum(lost.values()):
        return Share("orders", "", 1 - idle)
    full = [share for share in places if share.utilisation >= FULL and (share.kind in SERVERS or lost[share] >= FELT)]
    if full or (places and sum(lost.values()) >= CROWDED):
        return full[0] if full else places[0]
    return fleet


def in_words(share: Share, nav: NavGraph) -> str:
    """Limit that binds, where on the map, and how much, in words."""
    percent = f"{100 * share.utilisation:.0f} %"
    match share.kind:
        case "fleet":
            return f"the fleet itself, at work {percent} of the time: nothing else holds it up"
        case "orders":
            return f"a lack of orders that these robots may do: they have one {percent} of the time"
        case "charger":
            return f"the places to charge, in use or waited for {percent} of the time"
        case "planner" if not share.waited_s_per_h:
            return f"the planner, which found no plan in {percent} of its requests: not a property of your floor"
    waited = f", {share.waited_s_per_h / MINUTE_S:.0f} robot-minutes waited an hour" if share.waited_s_per_h >= 90 else ""
    place = ", ".join(filter(None, (f"the {share.kind} {share.name}".strip(), beside(nav, share.name))))
    return f"{place}, in use or waited for {percent} of the time{waited}"


def cycle(point: Point) -> dict[str, float]:
    """Mean parts of an order's time, s, over the runs of a fleet."""
    return {part: mean_of([record["metrics"].get(f"cycle_{part}_s") for record in point.records]) for part in PARTS}


def undisturbed_s(point: Point) -> float:
    """Time from an order's assignment to its end in the smallest fleet, where robots are nearly alone."""
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
