"""A building as data: levels with vertices, lanes, walls and doors, joined by lifts, in metres.

What `rmf.py` reads. Coordinates are x right, y up. Indices count from 0 in the lists of the level in the file.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, Properties
from mrp_sumo.maps.finding import MapFinding

WALL_THICKNESS_M = 0.1  # of Open-RMF's generator (wall.py)


@dataclass(frozen=True, slots=True)
class Lane:
    """A lane as drawn. `options` are those of the nav graph that need no geometry, in the generator's order."""

    start: int
    end: int
    graph: int
    is_bidirectional: bool
    options: Properties


@dataclass(frozen=True, slots=True)
class Door:
    """A door between two vertices."""

    start: int
    end: int
    name: str
    kind: str  # hinged, double_hinged, sliding, double_sliding, or ''
    is_manual: bool = False  # only people open it


@dataclass(frozen=True, slots=True)
class Model:
    """A thing that stands on a level; what size it is, only its mesh says."""

    name: str  # of the model, which things alike share
    x_m: float  # in the frame of Open-RMF's nav graphs
    y_m: float
    yaw_rad: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Level:
    """A floor of the building."""

    name: str
    elevation_m: float
    raw_xy: FloatArray  # [N, 2] in units of the file, y up
    world_xy: FloatArray  # [N, 2] m, in the frame of Open-RMF's nav graphs
    xy: FloatArray  # [N, 2] m, in the frame of the map: less `Building.origin_m`, levels laid apart
    vertex_name: tuple[Any, ...]  # [N] as in the file, '' without one
    vertex_options: tuple[Properties, ...]  # [N] as in the file
    lanes: tuple[Lane, ...] = ()
    walls: IntArray = field(default_factory=lambda: np.zeros((0, 2), np.int64))  # [W, 2] vertices
    doors: tuple[Door, ...] = ()
    floors: tuple[tuple[int, ...], ...] = ()  # polygons of vertices
    holes: tuple[tuple[int, ...], ...] = ()
    zones: tuple[tuple[int, ...], ...] = ()  # polygons of vertices, where no robot may be
    models: tuple[Model, ...] = ()
    furniture_xy: FloatArray = field(default_factory=lambda: np.zeros((0, 2, 2)))  # [F, 2, 2] m, sides of models whose size is known

    @cached_property
    def wall_xy(self) -> FloatArray:
        """[W + F, 2, 2] m, the two ends of each wall and of each side of furniture."""
        return np.concatenate([self.xy[self.walls], self.furniture_xy])

    @property
    def zone_xy(self) -> tuple[FloatArray, ...]:
        """[N, 2] m, the corners of each zone without robots."""
        return tuple(self.xy[list(zone)] for zone in self.zones if len(zone) > 2)

    @property
    def zone_sides_xy(self) -> FloatArray:
        """[S, 2, 2] m, the two ends of each side of zones."""
        return np.concatenate([np.zeros((0, 2, 2)), *(np.stack((zone, np.roll(zone, -1, axis=0)), axis=1) for zone in self.zone_xy)])

    @cached_property
    def lane_vertices(self) -> IntArray:
        """Vertices on lanes of any graph, ascending."""
        return np.unique(np.array([v for lane in self.lanes for v in (lane.start, lane.end)], np.int64))


@dataclass(frozen=True, kw_only=True)
class Lift:
    """A cabin and the floors it serves."""

    name: str
    x_m: float  # in the frame of Open-RMF's nav graphs
    y_m: float
    yaw_rad: float
    width_m: float  # along the cabin's x
    depth_m: float
    lowest_m: float = -np.inf  # elevations it serves
    highest_m: float = np.inf
    level_doors: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # none: it is no shaft
    door_width_m: Mapping[str, float] = field(default_factory=dict)  # of its doors, by name
    initial_level: str = ""  # where the car stands at first, where the file says so

    def holds(self, xy: FloatArray, elevation_m: float) -> BoolArray:
        """[N] whether each point is in the cabin, 5 cm beyond its walls included (level.py, is_in_lift)."""
        if not self.level_doors or not self.lowest_m <= elevation_m <= self.highest_m:
            return np.zeros(len(xy), np.bool_)
        along, across = self._beyond(xy)
        held: BoolArray = (along <= 0.05) & (across <= 0.05)
        return held

    def distance_m(self, xy: FloatArray) -> FloatArray:
        """[N] of points from the cabin, 0 inside."""
        along, across = self._beyond(xy)
        away_m: FloatArray = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))
        return away_m

    def room_m(self, xy: FloatArray) -> FloatArray:
        """[N] of points in the cabin to its nearest wall, negative outside."""
        room: FloatArray = -self._beyond(xy).max(axis=0)
        return room

    def _beyond(self, xy: FloatArray) -> FloatArray:
        """[2, N] how far points are outside the cabin's side walls, and its front and back; negative inside."""
        dx, dy = (xy - (self.x_m, self.y_m)).T
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        beyond: FloatArray = np.abs([c * dx + s * dy, c * dy - s * dx]) - [[self.width_m / 2], [self.depth_m / 2]]
        return beyond


@dataclass(frozen=True, eq=False, kw_only=True)
class Building:
    """Everything of a building that robots, their sensors and pictures of them need."""

    name: str
    path: Path
    coordinate_system: str
    levels: Mapping[str, Level]
    lifts: Mapping[str, Lift]
    crs_name: str = ""
    offset: tuple[float, float] | None = None  # of the file, for georeferenced systems
    origin_m: tuple[float, float] = (0.0, 0.0)  # what `Level.xy` has less than the nav graphs of Open-RMF
    findings: tuple[MapFinding, ...] = ()  # of reading the file
    unused: tuple[str, ...] = ()  # what is drawn and has no effect here, with counts

    @cached_property
    def graphs(self) -> Mapping[int, int]:
        """Number of lanes of each graph that has any, in ascending order."""
        return dict(sorted(Counter(lane.graph for level in self.levels.values() for lane in level.lanes).items()))

    def lift_of_vertex(self, level: Level) -> dict[int, str]:
        """The lift around each vertex of a level that is in one; of several, the first in the file."""
        lift_of: dict[int, str] = {}
        for lift in reversed(list(self.lifts.values())):
            lift_of |= dict.fromkeys(np.flatnonzero(lift.holds(level.world_xy, level.elevation_m)).tolist(), lift.name)
        return lift_of

    def moved(self, shift_m: Mapping[str, tuple[float, float]]) -> "Building":
        """The building with levels laid elsewhere in the map's frame, each by its (x, y) in m."""
        by = {name: shift_m.get(name, (0.0, 0.0)) for name in self.levels}
        levels = {
            name: replace(level, xy=level.xy + by[name], furniture_xy=level.furniture_xy + by[name]) for name, level in self.levels.items()
        }
        return replace(self, levels=levels)
