"""Zones of a building and how occupied they are: crossings, aisles, doors and lifts of the map, squares of five cells on maps of cells.

Robots are looked at once a second, after nothing but their positions: each is in the zone of the vertex of the plan graph nearest to it.
"""

import numpy as np

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.graph import NavGraph, PlanGraph, frozen
from mrp_sumo.core.places import places_of
from mrp_sumo.core.zone_log import ZoneLog
from mrp_sumo.metrics.metric import NONE, TOGETHER, Evidence, Metric, of

LOOK_S = 1.0  # between looks at where robots are


def occupancy(execution: Execution, graph: PlanGraph, nav: NavGraph) -> ZoneLog:
    """Occupation of each zone of a map by robots that drove on a plan graph, with at least one sample. Looks at some at a time."""
    from scipy.spatial import cKDTree

    places, tree = places_of(graph, nav), cKDTree(graph.xy)
    num_zones, num_looks = len(places.name), 0
    total, occupied, most = (np.zeros(num_zones, np.int64) for _ in range(3))
    every = max(1, round(LOOK_S / execution.period_s))
    for begin in range(0, len(execution.t_s), every * TOGETHER):
        looks = slice(begin, begin + every * TOGETHER, every)
        there = np.stack([execution.x_m[looks], execution.y_m[looks]], -1)  # [K, R, 2]
        look, robot = np.nonzero(np.isfinite(there).all(-1))
        zone = places.of_vertex[tree.query(there[look, robot])[1]]
        robots = np.zeros((len(there), num_zones), np.int64)
        np.add.at(robots, (look, zone), 1)
        total += robots.sum(0)
        occupied += (robots > 0).sum(0)
        most = np.maximum(most, robots.max(0))
        num_looks += len(there)
    entered = np.flatnonzero(total)
    order = entered[np.argsort(-occupied[entered], kind="stable")]
    return ZoneLog(
        name=tuple(places.name[z] for z in order.tolist()),
        kind=tuple(places.kind[z] for z in order.tolist()),
        occupied_share=frozen(occupied[order] / num_looks),
        robots_mean=frozen(total[order] / num_looks),
        robots_max=frozen(most[order]),
    )


def _entered(run: Evidence) -> ZoneLog | None:
    return run.zones if run.zones and len(run.zones.name) else None


# fmt: off
METRICS = (
    Metric("zone_occupancy_max", "", NONE,
           "share of the time for which at least one robot was in the zone where that is most; see zones.parquet",
           of(_entered, lambda zones: zones.occupied_share.max().item())),
    Metric("zone_robots_mean_max", "", NONE, "mean number of robots in the zone where it is most",
           of(_entered, lambda zones: zones.robots_mean.max().item())),
    Metric("zone_robots_max", "", NONE, "most robots in one zone at a time", of(_entered, lambda zones: zones.robots_max.max().item())),
)
