"""Room that walls leave: the distance of every lane and vertex of a graph from the nearest wall of its level, or zone without robots.

Walls are the strokes of a building's drawing, without thickness; where a door is drawn on one, it is open. Grid maps have no building:
their free cells are those with room already. A robot needs half its width beside a lane, and at a vertex, where it may turn, the radius
of the circle around it, and the millimetre by which it stops short of the vertex. What vehicles that cannot turn in place sweep there is
held against the walls turn by turn, and on lanes that are curves (`traffic.turns`).
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, NavGraph, PlanGraph, frozen, with_lanes
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import MapError, count
from mrp_sumo.maps.boxes import boxes_of, overlapping
from mrp_sumo.maps.building import WALL_THICKNESS_M, Building, Level

ON_WALL_M = WALL_THICKNESS_M  # a door this near to a wall, and along it, is drawn on it
SAME_WAY = np.cos(np.radians(15))  # a door on a wall has its direction, about
SHORTEST_M = 1e-6  # of what doors leave of a wall
STOPS_SHORT_M = 0.001  # of a vertex: where robots wait and turn


@dataclass(frozen=True, eq=False)
class Clearance:
    """Distances in m from the nearest wall or zone, inf where none is as near as was asked for. Read-only."""

    lane_m: FloatArray  # [L] of the whole lane, its ends included; 0 when it meets a wall, or a part of it is in a zone
    vertex_m: FloatArray  # [V]


@dataclass(frozen=True, eq=False)
class Narrow:
    """Lanes and vertices without room beside the walls for a type of robot. Read-only."""

    robot: RobotType
    graph: NavGraph
    lane_m: FloatArray  # [L] distance from the nearest wall, inf where it is of no interest
    vertex_m: FloatArray  # [V]
    width_m: FloatArray  # [L] of lanes as they are drawn, inf where the map does not say
    is_narrow_lane: BoolArray  # [L] the robot touches a wall when it drives along, or is wider than the lane
    is_narrow_vertex: BoolArray  # [V] the robot touches a wall when it turns, and there are lanes
    limit: str = "a wall"  # what leaves no room, in words

    @property
    def is_barred(self) -> BoolArray:
        """[L] lanes without room, and those from and to vertices without."""
        return self.is_narrow_lane | self.is_narrow_vertex[self.graph.tail] | self.is_narrow_vertex[self.graph.head]

    @property
    def lanes(self) -> IntArray:
        """Lanes without room, a lane and its reverse once, the nearest to a wall first."""
        once = np.flatnonzero(self.is_narrow_lane & self.graph.is_once)
        return once[np.argsort(self.lane_m[once], kind="stable")]

    @property
    def vertices(self) -> IntArray:
        """Vertices without room, the nearest to a wall first."""
        vertices = np.flatnonzero(self.is_narrow_vertex)
        return vertices[np.argsort(self.vertex_m[vertices], kind="stable")]

    @property
    def slim(self) -> IntArray:
        """Lanes narrower than the robot, a lane and its reverse once, the narrowest first."""
        lanes = self.lanes
        slim = lanes[self.width_m[lanes] < 2 * self.robot.with_load.beside_m - SHORTEST_M]
        return slim[np.argsort(self.width_m[slim], kind="stable")]

    @property
    def radius_that_fits_m(self) -> float:
        """Of the circle around a robot with room everywhere; 0 where lanes lead through walls, inf where nothing is narrow."""
        return float(self.lane_m.min(initial=np.inf))  # whose ends are the vertices

    @property
    def notes(self) -> tuple[str, ...]:
        """A line on the lanes without room and one on the vertices; none where there is room everywhere."""
        lanes, vertices, name, notes = self.lanes, self.vertices, self.robot.name, []
        half_m = self.robot.with_load.beside_m
        if crossing := int(np.count_nonzero(self.lane_m[lanes] == 0)):
            notes.append(f"{count(crossing, 'lane leads', 'lanes lead')} through {self.limit}, such as {self._lane(lanes[0])}")
        if beside := lanes[crossing : crossing + int(np.count_nonzero((self.lane_m[lanes] > 0) & (self.lane_m[lanes] < half_m)))].tolist():
            room = f"{half_m:.2f} m to {self.limit}, too close for '{name}'"
            nearest = f"the closest {self._lane(beside[0])}: {self.lane_m[beside[0]]:.2f} m"
            notes.append(f"{count(len(beside), 'lane runs', 'lanes run')} closer than {room}, {nearest}")
        if len(vertices):
            room = f"{self.robot.radius_m:.2f} m to {self.limit}, too close for '{name}' to turn"
            nearest = f"the closest {self._vertex(vertices[0])}: {self.vertex_m[vertices[0]]:.2f} m"
            notes.append(f"{count(len(vertices), 'vertex is', 'vertices are')} closer than {room}, {nearest}")
        if len(slim := self.slim):
            which = f"{self._lane(slim[0])}: {self.width_m[slim[0]]:.2f} m"
            notes.append(f"{count(len(slim), 'lane is', 'lanes are')} narrower than '{name}' with {2 * half_m:.2f} m, such as {which}")
        return tuple(notes)

    @property
    def lane_notes(self) -> tuple[str, ...]:
        """A line for each lane without room, the nearest to a wall first."""
        half_m, slim = self.robot.with_load.beside_m, set(self.slim.tolist())
        return tuple(
            f"lane {self._lane(lane)} leads through {self.limit}"
            if self.lane_m[lane] == 0
            else f"lane {self._lane(lane)} is {self.width_m[lane]:.2f} m wide, '{self.robot.name}' needs {2 * half_m:.2f} m"
            if lane in slim
            else f"lane {self._lane(lane)} is {self.lane_m[lane]:.2f} m from {self.limit}, '{self.robot.name}' needs {half_m:.2f} m"
            for lane in self.lanes.tolist()
        )

    def _lane(self, lane: int) -> str:
        return f"{self._vertex(self.graph.tail[lane])} -> {self._vertex(self.graph.head[lane])}"

    def _vertex(self, vertex: int) -> str:
        x, y = self.graph.xy[vertex]
        return f"{self.graph.known_as(vertex)} ({x:.2f}, {y:.2f})"


def narrow(graph: NavGraph, building: Building | None, robot: RobotType) -> Narrow:
    """Places of a graph without room for a robot; without a building, lanes that are drawn too narrow."""
    width_m = np.array([float(options.get("width", np.inf)) for options in graph.lane_options], np.float64)
    slim = width_m < 2 * robot.with_load.beside_m - SHORTEST_M
    if building is None:
        far = np.full(graph.num_lanes, np.inf), np.full(graph.num_vertices, np.inf)
        return Narrow(robot, graph, *far, width_m, slim, np.isnan(far[1]))
    clearances = clearance(graph, building, robot.radius_m + STOPS_SHORT_M)
    turned = np.zeros(graph.num_vertices, np.bool_)
    turned[graph.tail] = turned[graph.head] = not robot.is_vehicle
    lanes = (clearances.lane_m == 0) | (clearances.lane_m < robot.with_load.beside_m - SHORTEST_M)
    if robot.is_vehicle and isinstance(graph, PlanGraph):
        lanes &= ~np.isin(
            np.arange(graph.num_lanes), [graph.lane_between(*ends) for ends in graph.curves]
        )  # the steps are no part of these
    vertices = turned & (clearances.vertex_m < robot.radius_m + STOPS_SHORT_M)
    limit = "a wall or a zone without robots" if any(level.zones for level in building.levels.values()) else "a wall"
    return Narrow(robot, graph, clearances.lane_m, clearances.vertex_m, width_m, lanes | slim, vertices, limit)


def pruned(graph: PlanGraph, without: Narrow) -> PlanGraph:
    """A plan graph less its lanes without room, and those from and to vertices without; vertices keep their numbers.

    Raises MapError when no lane is left.
    """
    keep = ~without.is_barred
    if not keep.any():
        raise MapError(f"no lane of '{graph.name}' leaves '{without.robot.name}' room beside the walls: {', '.join(without.notes)}")
    return graph if keep.all() else with_lanes(graph, keep)


def standing_walls(building: Building, level_names: Collection[str]) -> FloatArray:
    """[W, 2, 2] m, what doors leave of the walls of some levels, in the map's frame; names that the building lacks are ignored."""
    parts = [_without_doors(level) for name, level in building.levels.items() if name in level_names]
    return np.concatenate([np.zeros((0, 2, 2)), *parts])


def barriers(building: Building, level_name: str) -> FloatArray:
    """[W, 2, 2] m, what robots keep from on a level: standing walls, and sides of zones without robots."""
    walls = standing_walls(building, (level_name,))
    return np.concatenate([walls, building.levels[level_name].zone_sides_xy]) if level_name in building.levels else walls


def clearance(graph: NavGraph, building: Building, within_m: float) -> Clearance:
    """Distances of the lanes and vertices of a graph, in the frame of the building's map, from its walls; inf above `within_m`."""
    xy, tail, head = graph.xy, graph.tail, graph.head
    lane_m, vertex_m = np.full(graph.num_lanes, np.inf), np.full(graph.num_vertices, np.inf)
    is_once = graph.is_once & (graph.level[tail] == graph.level[head])  # a lift has walls of its own
    for k, name in enumerate(graph.level_names):
        walls = barriers(building, name)
        lanes = np.flatnonzero(is_once & (graph.level[tail] == k))
        near, wall = _near(xy[tail[lanes]], xy[head[lanes]], walls, within_m)
        lane = lanes[near]
        np.minimum.at(lane_m, lane, segment_distances(xy[tail[lane]], xy[head[lane]], *walls[wall].transpose(1, 0, 2)))
        vertices = np.flatnonzero(graph.level == k)
        near, wall = _near(xy[vertices], xy[vertices], walls, within_m)
        np.minimum.at(vertex_m, vertices[near], point_distances(xy[vertices[near]], *walls[wall].transpose(1, 0, 2)))
        for zone in building.levels[name].zone_xy if name in building.levels else ():
            vertex_m[vertices[_inside(xy[vertices], zone)]] = 0.0
            lane_m[lanes[_inside(xy[tail[lanes]], zone)]] = 0.0  # one that leads in or out meets a side
    back = np.flatnonzero((graph.reverse >= 0) & (tail > head))
    lane_m[back] = lane_m[graph.reverse[back]]
    lane_m[lane_m > within_m] = np.inf
    vertex_m[vertex_m > within_m] = np.inf
    return Clearance(frozen(lane_m), frozen(vertex_m))


def point_distances(point: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """[N] distance of each point from its segment a-b; all are [N, 2]."""
    along, off = b - a, point - a
    long = (along**2).sum(axis=1)
    share = np.clip((off * along).sum(axis=1) / np.where(long > 0, long, 1.0), 0.0, 1.0)
    apart: FloatArray = np.hypot(*(off - share[:, None] * along).T)
    return apart


def segment_distances(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> FloatArray:
    """[N] distance of each segment a-b from its segment c-d, 0 when they meet; all are [N, 2]."""

    def side(p: FloatArray, q: FloatArray, of: FloatArray) -> FloatArray:
        return (q[:, 0] - p[:, 0]) * (of[:, 1] - p[:, 1]) - (q[:, 1] - p[:, 1]) * (of[:, 0] - p[:, 0])

    meets = (side(a, b, c) * side(a, b, d) < 0) & (side(c, d, a) * side(c, d, b) < 0)
    ends = np.stack([point_distances(a, c, d), point_distances(b, c, d), point_distances(c, a, b), point_distances(d, a, b)])
    apart: FloatArray = np.where(meets, 0.0, ends.min(axis=0))
    return apart


def _inside(points: FloatArray, polygon: FloatArray) -> BoolArray:
    """[N] points within a polygon [P, 2]: a ray to the right of them crosses its sides an odd number of times."""
    (ax, ay), (bx, by) = polygon.T[..., None], np.roll(polygon, -1, axis=0).T[..., None]
    x, y = points.T
    with np.errstate(divide="ignore", invalid="ignore"):
        crosses = ((ay > y) != (by > y)) & (x < ax + (bx - ax) * (y - ay) / (by - ay))
    inside: BoolArray = np.count_nonzero(crosses, axis=0) % 2 == 1
    return inside


def _near(a: FloatArray, b: FloatArray, walls: FloatArray, within_m: float) -> tuple[IntArray, IntArray]:
    """Pairs of a segment a-b and a wall whose boxes are at most this far apart."""
    return overlapping(boxes_of(a, b, within_m), np.concatenate([walls.min(axis=1), walls.max(axis=1)], axis=1))


def _without_doors(level: Level) -> FloatArray:
    """[W, 2, 2] m, the walls of a level with a gap at every door that is drawn on one."""
    walls = level.wall_xy
    doors = level.xy[np.array([(door.start, door.end) for door in level.doors], np.int64).reshape(-1, 2)]  # [D, 2, 2]
    which, door = _near(doors[:, 0], doors[:, 1], walls, ON_WALL_M)[::-1]
    wall, across = walls[which, 1] - walls[which, 0], doors[door, 1] - doors[door, 0]
    long, wide = np.hypot(*wall.T), np.hypot(*across.T)
    safe = np.maximum(long, 1e-12)[:, None]
    unit = wall / safe
    from_a = doors[door] - walls[which, 0][:, None]  # [P, 2, 2]
    along = (from_a * unit[:, None]).sum(axis=2)  # [P, 2] m from the wall's first end
    away = np.abs(from_a[..., 0] * unit[:, None, 1] - from_a[..., 1] * unit[:, None, 0]).max(axis=1)
    is_on = (away <= ON_WALL_M) & (np.abs((across * unit).sum(axis=1)) >= SAME_WAY * wide) & (wide > 0) & (long > 0)
    gaps: dict[int, list[tuple[float, float]]] = {}
    for w, (begin, end) in zip(which[is_on].tolist(), np.sort(along[is_on], axis=1).tolist()):
        gaps.setdefault(w, []).append((begin, end))
    untouched = np.ones(len(walls), np.bool_)
    untouched[list(gaps)] = False
    parts = [walls[untouched]]
    for w, opened in gaps.items():
        a, b = walls[w]
        length_m, free_m = float(np.hypot(*(b - a))), 0.0
        for begin, end in [*sorted(opened), (np.inf, np.inf)]:  # what is left up to each gap, and up to the end
            if min(begin, length_m) - free_m > SHORTEST_M:
                parts.append((a + np.array([[free_m], [min(begin, length_m)]]) / length_m * (b - a))[None])
            free_m = max(free_m, end)
    return np.concatenate(parts)
