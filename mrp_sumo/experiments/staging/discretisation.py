"""How a map becomes a plan graph where the scenario leaves that open: lanes are driven where the map has them, else a grid of cells.

Steps are as fine as the scenario asks for and as long as its robots need.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mrp_sumo.core.fleet import RobotType, fleet_of_types
from mrp_sumo.core.graph import BoolArray, FloatArray, NavGraph, PlanGraph, with_lanes
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.map import Discretisation
from mrp_sumo.maps.boxes import overlapping
from mrp_sumo.maps.chains import chains_of
from mrp_sumo.maps.clearance import point_distances
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.roadmap import cell_that_fits

ON_LANE_CELLS = 1.1  # from a lane within which cells belong to it: lanes of a grid are two cells wide
AGAINST = -0.3  # cosine of the angle between a step and a lane from which the step goes against it
CENTIMETRES = 100


def loaded_cell_m(choice: Discretisation, models: Sequence[RobotType]) -> float:
    """The side of the cells that are laid over maps without lanes: as stated, or as large as two of the robots need."""
    if choice.kind != "auto":
        return choice.cell_m
    return max(choice.cell_m, math.ceil(CENTIMETRES * separation_m(models) - 1e-7) / CENTIMETRES)


def as_discretised(file: ScenarioFile, map_: Map, models: Sequence[RobotType]) -> ScenarioFile:
    """The scenario with the kind and the cell length that `auto` stands for on a map; any other as it is."""
    choice = file.scenario.discretisation
    if choice.kind != "auto":
        return file
    if isinstance(map_.nav, PlanGraph):
        chosen = choice.model_copy(update={"kind": "grid", "cell_m": map_.nav.cell_m, "lanes": "single_track"})
    else:
        chosen = choice.model_copy(update={"kind": "roadmap", "cell_m": _step_m(map_.nav, choice.cell_m, separation_m(models))})
    return replace(file, scenario=file.scenario.model_copy(update={"discretisation": chosen}))


def separation_m(models: Sequence[RobotType]) -> float:
    """The least distance between the centres of any two robots."""
    return float(fleet_of_types(models, np.arange(len(models))).separation_m)


def _step_m(nav: NavGraph, wanted_m: float, needed_m: float) -> float:
    """The least cell length, from the wanted one on, with which no lane that is long enough is cut into steps that are too short."""
    chains = chains_of(nav)
    nav = chains.nav if chains else nav
    length_m = nav.length_m[~nav.is_ride]
    return cell_that_fits(length_m[length_m >= needed_m - 1e-9], needed_m, wanted_m)


def with_drawn_one_ways(nav: NavGraph, graph: PlanGraph) -> tuple[PlanGraph, tuple[str, ...]]:
    """A grid without the steps that go against one-way lanes of its map, and a line about them.

    A step belongs to the lane that it is nearest to, of those that lead its way or the opposite way.

    Parameters
    ----------
    nav
        The map's lanes.
    graph
        Its plan graph; one that is no grid of those lanes is returned as it is.
    """
    one_way = (nav.reverse < 0) & ~nav.is_ride
    if graph.kind != "grid" or isinstance(nav, PlanGraph) or not one_way.any():
        return graph, ()
    against = _against(nav, graph, one_way)
    num_lanes = int((~nav.is_ride).sum())
    share = np.count_nonzero(one_way) / num_lanes
    note = (
        f"a grid leaves the lanes of '{nav.name}', of which {np.count_nonzero(one_way)} of {num_lanes} ({share:.0%}) are one-way: "
        f"{np.count_nonzero(against)} steps against them are left out; discretisation.kind: roadmap keeps to lanes"
    )
    return (with_lanes(graph, ~against) if against.any() else graph), (note,)


def _against(nav: NavGraph, graph: PlanGraph, one_way: BoolArray) -> BoolArray:
    """[L of graph] steps that are nearer to a one-way lane which they go against than to a lane that leads their way."""
    within_m = ON_LANE_CELLS * graph.cell_m
    lanes = np.flatnonzero(~nav.is_ride)
    a, b = nav.xy[nav.tail[lanes]], nav.xy[nav.head[lanes]]
    middle = (graph.xy[graph.tail] + graph.xy[graph.head]) / 2
    boxes = np.concatenate([np.minimum(a, b) - within_m, np.maximum(a, b) + within_m], axis=1)
    near, step = overlapping(boxes, np.tile(middle, 2))
    near, step = near[~graph.is_ride[step]], step[~graph.is_ride[step]]
    away_m = point_distances(middle[step], a[near], b[near])
    cosine = (_unit(b - a)[near] * _unit(graph.xy[graph.head] - graph.xy[graph.tail])[step]).sum(axis=1)
    same_level = nav.level[nav.tail[lanes]][near] == graph.level[graph.tail][step]
    with_m, against_m = np.full(graph.num_lanes, np.inf), np.full(graph.num_lanes, np.inf)
    for least_m, counts in ((with_m, cosine > -AGAINST), (against_m, (cosine < AGAINST) & one_way[lanes][near])):
        counts = counts & same_level & (away_m < within_m)
        np.minimum.at(least_m, step[counts], away_m[counts])
    closed: BoolArray = np.isfinite(against_m) & (against_m < with_m - 1e-9)
    return closed


def _unit(step: FloatArray) -> FloatArray:
    """[N, 2] directions; 0 of what has no length."""
    long: FloatArray = np.hypot(*step.T)[:, None]
    return step / np.where(long > 0, long, 1.0)
