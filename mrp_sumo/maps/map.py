"""A map as the rest of the program takes it: its nav graph, its building where there is one, and what was found.

Content of a map that has no effect here is kept where a format can hold it, and reported in one line.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mrp_sumo.core.graph import BoolArray, NavGraph
from mrp_sumo.maps.building import Building
from mrp_sumo.maps.costmap import Costmap
from mrp_sumo.maps.finding import MapFinding

UNUSED_OF_VERTICES = {  # options that are read, by why nothing comes of them
    "dock_name": "docking takes no time of its own",
    "merge_radius": "robots start on vertices",
    "is_cleaning_zone": "",
    "human_goal_set_name": "",
    "spawn_robot_name": "a scenario says where robots start",
}


@dataclass(frozen=True)
class ListedVehicle:
    """A vehicle as a map lists it."""

    name: str
    length_m: float
    width_m: float | None  # None where the map does not say
    max_speed_mps: float
    reverse_mps: float = 0.0
    clear_m: float = 0.0  # room that the map keeps around where it stands; 0 where the map does not say
    as_type: str = ""  # the text of a file of robots/, in maps that were written with one


@dataclass(frozen=True, eq=False, kw_only=True)
class Map:
    """A read map. `nav` and `building` share one frame, in which levels that are driven on do not overlap."""

    name: str
    path: Path
    nav: NavGraph
    building: Building | None = None
    findings: tuple[MapFinding, ...] = ()
    graphs: tuple[int, ...] = (0,)  # all graphs of the file that have lanes
    chosen: tuple[int, ...] = (0,)  # those in `nav`
    documents: Mapping[int, Mapping[str, Any]] = field(default_factory=dict)  # the chosen nav graphs, as Open-RMF writes them
    origin_m: tuple[float, float] = (0.0, 0.0)  # subtracted from the coordinates of the documents
    level_shift_m: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # added to those of a level; they lie on one plane
    changes: tuple[str, ...] = ()  # what repairs have done to `nav`
    free: BoolArray | None = None  # [H, W] cells of a map that is a grid, row 0 has the lowest y
    vehicles: tuple[ListedVehicle, ...] = ()  # that the file lists
    floor: Costmap | None = None  # of a plan of a floor
    vehicle_types: tuple[str, ...] = ()  # that lanes are for; the option `vehicle_types` has those of a lane that is not for all of them

    @property
    def longest_vehicle(self) -> ListedVehicle | None:
        """Of those that have a length and a speed."""
        return max(
            (each for each in self.vehicles if min(each.length_m, each.max_speed_mps) > 0), key=lambda each: each.length_m, default=None
        )

    @property
    def doubts(self) -> tuple[str, ...]:
        """Lines of what makes the unit of the file unlikely."""
        return tuple(finding.line for finding in self.findings if finding.kind == "extent_above_1_km")


def unused(map_: Map) -> str:
    """One line of what has no effect, '' where everything that the map says is used."""
    lines = list(map_.building.unused) if map_.building else []
    for option, why in UNUSED_OF_VERTICES.items():
        if count := sum(bool(options.get(option)) for options in map_.nav.vertex_options):
            lines.append(f"{option}: {count}{f' ({why})' if why else ''}")
    return f"not used: {', '.join(lines)}" if lines else ""
