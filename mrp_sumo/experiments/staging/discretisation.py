"""Choice of a plan graph where the scenario leaves it open: lanes are driven where the map has them, else a grid of cells.

Steps are as fine as the scenario asks for and as long as its robots need.
"""

import math
from collections.abc import Sequence

import numpy as np

from mrp_sumo.core.fleet import fleet_of_types
from mrp_sumo.core.graph import NavGraph, PlanGraph, with_lanes
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.map import Discretisation
from mrp_sumo.maps.beside_lanes import beside_lanes
from mrp_sumo.maps.chains import chains_of
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.roadmap import cell_that_fits

ON_LANE_CELLS = 1.1  # from a lane within which cells belong to it: lanes of a grid are two cells wide
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
    return file.having(discretisation=chosen)


def separation_m(models: Sequence[RobotType]) -> float:
    """The least distance between the centres of any two robots; lanes for trains are as long as these."""
    return max([float(fleet_of_types(models, np.arange(len(models))).separation_m), *(model.behind_m for model in models)])


def _step_m(nav: NavGraph, wanted_m: float, needed_m: float) -> float:
    """The least cell length, from the wanted one on, with which no lane that is long enough is cut into steps that are too short."""
    chains = chains_of(nav)
    nav = chains.nav if chains else nav
    length_m = nav.length_m[~nav.is_ride]
    return cell_that_fits(length_m[length_m >= needed_m - 1e-9], needed_m, wanted_m)


def with_drawn_one_ways(nav: NavGraph, graph: PlanGraph) -> tuple[PlanGraph, tuple[str, ...]]:
    """A grid without the steps that go against one-way lanes of its map, and a line about them; graphs that are no such grid as they are.

    A step belongs to the lane that it is nearest to, of those that lead its way or the opposite way.
    """
    one_way = (nav.reverse < 0) & ~nav.is_ride
    if graph.kind != "grid" or isinstance(nav, PlanGraph) or not one_way.any():
        return graph, ()
    reach_m = ON_LANE_CELLS * graph.cell_m
    lanes = beside_lanes(nav, graph.xy[graph.tail], graph.xy[graph.head], reach_m, graph.level[graph.tail])
    against = (lanes.against_m < reach_m) & (lanes.against_m < lanes.along_m - 1e-9) & ~graph.is_ride
    num_lanes = int((~nav.is_ride).sum())
    share = np.count_nonzero(one_way) / num_lanes
    note = (
        f"a grid leaves the lanes of '{nav.name}', of which {np.count_nonzero(one_way)} of {num_lanes} ({share:.0%}) are one-way: "
        f"{np.count_nonzero(against)} steps against them are left out; discretisation.kind: roadmap keeps to lanes"
    )
    return (with_lanes(graph, ~against) if against.any() else graph), (note,)
