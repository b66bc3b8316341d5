"""The graphs robots drive on: NavGraph as the map draws it, PlanGraph as planners step on it.

Refuses what no later floor could survive: lanes between unknown vertices, self loops, lanes of no
length, two lanes from one vertex to the same other, coordinates that are not finite.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.csr import ranges
from mrp_sumo.core.digraph import weak_components
from mrp_sumo.errors import MapError

if TYPE_CHECKING:
    import networkx

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
Properties = Mapping[str, Any]

NO_PROPERTIES: Properties = {}
STATIONS = "; "  # between the names of several stations at one vertex, in its option `station`


@dataclass(frozen=True, eq=False, kw_only=True)
class NavGraph:
    """Vertices and directed lanes, in the map's frame. V vertices, L lanes; arrays are read-only.

    A bidirectional lane of a map is two lanes here, each the other's `reverse`. Build one with
    `nav_graph`, which sorts the lanes and checks them.
    """

    name: str
    level_names: tuple[str, ...]
    xy: FloatArray  # [V, 2] m, x right, y up
    level: IntArray  # [V] index into level_names
    vertex_name: tuple[str, ...]  # [V] '' where the map gives none
    vertex_options: tuple[
        Properties, ...
    ]  # [V] properties by RMF's names: is_charger, lift, dock_name, mutex, ...; station; is_bend of curves
    tail: IntArray  # [L] vertex a lane leaves; ascending
    head: IntArray  # [L] vertex it enters; ascending for one tail
    length_m: FloatArray  # [L] > 0
    speed_mps: FloatArray  # [L] speed limit, inf without one
    reverse: IntArray  # [L] the lane back, -1 where there is none
    lane_options: tuple[Properties, ...]  # [L] properties by RMF's names: door_name, mutex, orientation_constraint, ...
    source_lane: IntArray  # [L] position of the lane in the source's list
    source: str = ""  # the file it was read from

    @property
    def num_vertices(self) -> int:
        return len(self.xy)

    @property
    def num_lanes(self) -> int:
        return len(self.tail)

    @property
    def num_edges(self) -> int:
        """Lanes with a pair of opposite ones counted once."""
        return int(np.count_nonzero(self.is_once))

    @cached_property
    def first(self) -> IntArray:
        """[V + 1] CSR offsets: the lanes that leave v are `first[v]:first[v + 1]`."""
        return frozen(np.searchsorted(self.tail, np.arange(self.num_vertices + 1)).astype(np.int64))

    @property
    def onward(self) -> tuple[IntArray, IntArray]:
        """Pairs of a lane and one that leaves its head, both ascending."""
        count = np.diff(self.first)[self.head]
        return np.repeat(np.arange(self.num_lanes), count), ranges(self.first[self.head], count)

    @cached_property
    def vertex_of_name(self) -> Mapping[str, int]:
        """Vertex by its name, or by that of a station at it; unnamed vertices are found as `v<index>`. First wins on duplicates."""
        vertex_of = {f"v{v}": v for v in range(self.num_vertices)}
        for v in reversed(range(self.num_vertices)):
            if "station" in self.vertex_options[v]:
                vertex_of |= dict.fromkeys(str(self.vertex_options[v]["station"]).split(STATIONS), v)
        for v in reversed(range(self.num_vertices)):
            if self.vertex_name[v]:
                vertex_of[self.vertex_name[v]] = v
        return vertex_of

    @property
    def is_once(self) -> BoolArray:
        """[L] whether a lane counts where a lane and its reverse are one: of the two that from the lower vertex does."""
        return (self.reverse < 0) | (self.tail < self.head)

    @property
    def driven(self) -> IntArray:
        """Vertices that have lanes, ascending."""
        return np.unique(np.concatenate([self.tail, self.head]))

    def label(self, vertex: int) -> str:
        """The vertex's name, or `v<index>` where it has none."""
        return self.vertex_name[vertex] or f"v{vertex}"

    def known_as(self, vertex: int) -> str:
        """The name by which people know a vertex: of the first station at it that is found under its name, else its own label.

        For what people read; files name vertices by `label`. `vertex_of_name` finds both.
        """
        return self._station_at.get(vertex) or self.label(vertex)

    @cached_property
    def _station_at(self) -> Mapping[int, str]:
        """Stations by the vertex that `vertex_of_name` finds under their names."""
        stations: dict[int, str] = {}
        for v, options in enumerate(self.vertex_options):
            for name in str(options.get("station", "")).split(STATIONS):
                if name and self.vertex_of_name[name] == v:
                    stations.setdefault(v, name)
        return stations

    def lane_between(self, tail: int, head: int) -> int:
        """The lane from `tail` to `head`, -1 where there is none."""
        a, b = self.first[tail], self.first[tail + 1]
        k = a + int(np.searchsorted(self.head[a:b], head))
        return int(k) if k < b and self.head[k] == head else -1

    def having(self, option: str) -> BoolArray:
        """[V] whether the option is set and true at each vertex."""
        return np.array([bool(o.get(option)) for o in self.vertex_options], dtype=np.bool_)

    @cached_property
    def is_ride(self) -> BoolArray:
        """[L] whether a lane is a ride in a lift, or part of one (option `lift`)."""
        if self.lane_options.count(NO_PROPERTIES) == self.num_lanes:  # the common case, quickly
            return frozen(np.zeros(self.num_lanes, np.bool_))
        return frozen(np.array(["lift" in options for options in self.lane_options], np.bool_))

    @cached_property
    def is_backward(self) -> BoolArray:
        """[L] whether robots drive backwards on a lane (option `orientation_constraint`)."""
        if self.lane_options.count(NO_PROPERTIES) == self.num_lanes:
            return frozen(np.zeros(self.num_lanes, np.bool_))
        return frozen(np.array([options.get("orientation_constraint") == "backward" for options in self.lane_options], np.bool_))

    @cached_property
    def heading_rad(self) -> FloatArray:
        """[L] which way robots face on a lane, -pi to pi; in a lift, the way that they will leave it: they turn before the ride."""
        along = self.xy[self.head] - self.xy[self.tail]
        along[self.is_backward] *= -1.0
        heading: FloatArray = np.arctan2(along[:, 1], along[:, 0])
        for lane in np.flatnonzero(self.is_ride).tolist():
            at, behind, passed = int(self.head[lane]), int(self.tail[lane]), set[int]()
            while True:  # to the stop at which the ride ends; rides whose stops have lost their lanes may go round for ever
                onward = range(int(self.first[at]), int(self.first[at + 1]))
                out = [k for k in onward if not self.is_ride[k]]
                ahead = [int(self.head[k]) for k in onward if self.head[k] != behind]
                if out or len(ahead) != 1 or at in passed:
                    break
                passed.add(at)
                at, behind = ahead[0], at
            heading[lane] = heading[out[0]] if out else 0.0
        return frozen(heading)

    @cached_property
    def has_stations(self) -> bool:
        """True where the map says which of its vertices are stations; else all that have a name are."""
        return any("station" in options for options in self.vertex_options)

    @cached_property
    def component(self) -> IntArray:
        """[V] weakly connected component of each vertex, numbered from the largest down.

        Levels are joined where vertices of one lift (option `lift`) stand.
        """
        tail, head = list(self.tail), list(self.head)
        cabin: dict[str, int] = {}
        for v, options in enumerate(self.vertex_options):
            if lift := options.get("lift"):
                tail.append(cabin.setdefault(lift, v))
                head.append(v)
        return frozen(_components(self.num_vertices, np.array(tail, np.int64), np.array(head, np.int64)))

    @property
    def num_components(self) -> int:
        return int(self.component.max()) + 1 if self.num_vertices else 0

    def to_networkx(self) -> "networkx.DiGraph":
        """The graph for networkx: a node per vertex, an edge per lane.

        Nodes are vertex indices with `name`, `x_m`, `y_m`, `level` and the vertex's options. Edges have `length_m`, `speed_mps` where
        there is a limit, and the lane's options; `nx.shortest_path(graph, a, b, weight="length_m")` is a shortest route.
        """
        from mrp_sumo.core.interchange import digraph_of

        return digraph_of(self)

    @staticmethod
    def from_networkx(graph: "networkx.Graph", name: str = "") -> "NavGraph":
        """A NavGraph of a graph of networkx; the edges of an undirected one are lanes in both directions.

        Parameters
        ----------
        graph
            Nodes with `x_m` and `y_m` (or `pos`) in m, `name`, `level` and options; edges with `length_m`, straight by default, `speed_mps`
            and options. Vertices are numbered in the order of the nodes.
        name
            Of the map; the graph's own by default.

        Raises
        ------
        MapError
            For nodes without coordinates, and as `nav_graph` refuses.
        """
        from mrp_sumo.core.interchange import parts_of

        return nav_graph(**parts_of(graph, name))


@dataclass(frozen=True, eq=False, kw_only=True)
class PlanGraph(NavGraph):
    """A NavGraph whose lanes are one time step each: what planners plan on and SUMO drives on.

    Made by `plan_graph`: of a nav graph whose lanes were cut, of the paper's grid, of a grid map as it is.
    """

    kind: str  # 'roadmap' or 'grid'
    cell_m: float  # length of a step, about (roadmap) or exactly (grid)
    vertex_of_station: IntArray  # [Vnav] the vertex here for each vertex of the nav graph
    nav_lane: IntArray  # [V] lane of the nav graph a cut lies on, -1 elsewhere
    offset_m: FloatArray  # [V] distance from that lane's tail
    frame_m: FloatArray | None = None  # [2, 2] lower left and upper right corner of all cells of a grid, free or not; None: not known
    walls: FloatArray = field(default_factory=lambda: np.zeros((0, 2, 2)))  # [W, 2, 2] m, which vehicles' turns have to keep clear of
    curves: Mapping[tuple[int, int], FloatArray] = field(default_factory=dict)
    """By tail and head of lanes that vehicles follow as curves [N, 4]: m along the lane, x, y, course in rad without jumps."""
    closed_to: Mapping[str, frozenset[tuple[int, int]]] = field(default_factory=dict)
    """By the name of a type of vehicles, tail and head of lanes that it never takes, so that it stops where it can go on along others."""
    beyond_m: FloatArray = field(default_factory=lambda: np.zeros(0))
    """[V] distance from each vertex, beyond their radii, that vehicles need which change gear there on a corner; empty: nobody does."""

    @property
    def swing_m(self) -> FloatArray:
        """[V] `beyond_m`, 0 where nobody needs any."""
        return self.beyond_m if len(self.beyond_m) else np.zeros(self.num_vertices)


def nav_graph(
    *,
    name: str,
    xy: Any,
    lanes: Any,
    level_names: Sequence[str] = ("L1",),
    level: Any = None,
    vertex_name: Sequence[str] = (),
    vertex_options: Sequence[Properties] = (),
    length_m: Any = None,
    speed_mps: Any = None,
    lane_options: Sequence[Properties] = (),
    source: str = "",
) -> NavGraph:
    """Build a NavGraph from vertices at `xy` [V, 2] m and `lanes` [L, 2], pairs (tail, head) in any order.

    `level` [V] is by default the first for all, `length_m` [L] the straight distance; `speed_mps` [L] are limits, inf for none. Names and
    options of vertices, and options of lanes, are [V] and [L], or nothing. `source` is the file that it comes from.

    Raises MapError for a lane to an unknown vertex, from a vertex to itself or of no length, for a lane given twice, and for coordinates
    that are not finite.
    """
    xy = np.asarray(xy, np.float64).reshape(-1, 2)
    lanes = np.asarray(lanes, np.int64).reshape(-1, 2)
    num_vertices, num_lanes = len(xy), len(lanes)
    where = source or name
    if not np.isfinite(xy).all():
        raise MapError(f"{where}: vertex {int(np.flatnonzero(~np.isfinite(xy).all(1))[0])} has coordinates that are not finite")
    outside = np.flatnonzero(((lanes < 0) | (lanes >= num_vertices)).any(1))
    if len(outside):
        raise MapError(f"{where}: lane {outside[0]} joins vertices {lanes[outside[0]].tolist()}, but there are {num_vertices}")
    if length_m is None:
        length_m = np.hypot(*(xy[lanes[:, 1]] - xy[lanes[:, 0]]).T) if num_lanes else np.zeros(0)
    length_m = np.asarray(length_m, np.float64)
    flawed = np.flatnonzero((lanes[:, 0] == lanes[:, 1]) | ~(length_m > 0) | ~np.isfinite(length_m))
    if len(flawed):
        raise MapError(f"{where}: lane {flawed[0]} from vertex {lanes[flawed[0], 0]} to {lanes[flawed[0], 1]} has no length")
    order = np.lexsort((lanes[:, 1], lanes[:, 0]))
    tail, head = lanes[order, 0], lanes[order, 1]
    twice = np.flatnonzero((tail[1:] == tail[:-1]) & (head[1:] == head[:-1]))
    if len(twice):
        raise MapError(f"{where}: two lanes lead from vertex {tail[twice[0]]} to vertex {head[twice[0]]}")
    return NavGraph(
        name=name,
        level_names=tuple(level_names),
        xy=frozen(xy),
        level=frozen(np.zeros(num_vertices, np.int64) if level is None else np.asarray(level, np.int64)),
        vertex_name=tuple(vertex_name) or ("",) * num_vertices,
        vertex_options=tuple(vertex_options) or (NO_PROPERTIES,) * num_vertices,
        tail=frozen(tail),
        head=frozen(head),
        length_m=frozen(length_m[order]),
        speed_mps=frozen(np.full(num_lanes, np.inf) if speed_mps is None else np.asarray(speed_mps, np.float64)[order]),
        reverse=frozen(_opposite(tail, head, num_vertices)),
        lane_options=tuple(lane_options[i] for i in order) if lane_options else (NO_PROPERTIES,) * num_lanes,
        source_lane=frozen(order.astype(np.int64)),
        source=source,
    )


def nav_like(nav: NavGraph, **parts: Any) -> NavGraph:
    """A graph like another. `parts` are arguments of `nav_graph`: its lanes, and what else is not the other's."""
    own = {key: getattr(nav, key) for key in ("name", "xy", "level_names", "level", "vertex_name", "vertex_options", "source")}
    return nav_graph(**{**own, **parts})


def plan_graph(
    graph: NavGraph,
    *,
    kind: str,
    cell_m: float,
    vertex_of_station: Any = None,
    nav_lane: Any = None,
    offset_m: Any = None,
    frame_m: FloatArray | None = None,
    curves: Mapping[tuple[int, int], FloatArray] | None = None,
) -> PlanGraph:
    """A graph whose lanes are single steps, as a PlanGraph, whose fields say what the parts are.

    By default the vertices of the nav graph are the first, in order, and there are neither cuts nor curves.
    """
    num_vertices = graph.num_vertices
    return PlanGraph(
        **{field.name: getattr(graph, field.name) for field in fields(NavGraph)},
        kind=kind,
        cell_m=cell_m,
        vertex_of_station=frozen(np.asarray(np.arange(num_vertices) if vertex_of_station is None else vertex_of_station, np.int64)),
        nav_lane=frozen(np.asarray(np.full(num_vertices, -1) if nav_lane is None else nav_lane, np.int64)),
        offset_m=frozen(np.asarray(np.zeros(num_vertices) if offset_m is None else offset_m, np.float64)),
        frame_m=frame_m,
        curves=curves or {},
    )


def with_lanes(graph: PlanGraph, open_: BoolArray) -> PlanGraph:
    """The same vertices with these lanes [L] only."""
    lanes = np.flatnonzero(open_)
    return relaid(
        graph,
        lanes=np.stack([graph.tail[lanes], graph.head[lanes]], 1),
        length_m=graph.length_m[lanes],
        speed_mps=graph.speed_mps[lanes],
        lane_options=[graph.lane_options[lane] for lane in lanes.tolist()],
    )


def relaid(graph: PlanGraph, **parts: Any) -> PlanGraph:
    """The graph with other lanes. `parts` are arguments of `nav_graph`: what there is of lanes, and what is new of vertices.

    Vertices keep their order; new ones come after them and have no names.
    """
    num_new = len(parts.get("xy", graph.xy)) - graph.num_vertices
    laid = plan_graph(
        nav_like(graph, **{"vertex_name": graph.vertex_name + ("",) * num_new, **parts}),
        kind=graph.kind,
        cell_m=graph.cell_m,
        vertex_of_station=graph.vertex_of_station,
        nav_lane=np.append(graph.nav_lane, np.full(num_new, -1)),
        offset_m=np.append(graph.offset_m, np.zeros(num_new)),
        frame_m=graph.frame_m,
        curves=graph.curves,
    )
    beyond_m = np.append(graph.beyond_m, np.zeros(num_new)) if len(graph.beyond_m) else graph.beyond_m
    return replace(laid, walls=graph.walls, closed_to=graph.closed_to, beyond_m=beyond_m)


def frozen(array: NDArray[Any]) -> NDArray[Any]:
    """The array as a contiguous read-only copy."""
    array = np.array(array, order="C")
    array.setflags(write=False)
    return array


def _opposite(tail: IntArray, head: IntArray, num_vertices: int) -> IntArray:
    key, wanted = tail * num_vertices + head, head * num_vertices + tail
    at = np.searchsorted(key, wanted)
    hit = at < len(key)
    hit[hit] = key[at[hit]] == wanted[hit]
    return np.where(hit, at, -1).astype(np.int64)


def _components(num_vertices: int, tail: IntArray, head: IntArray) -> IntArray:
    """[V] weakly connected component of each vertex; the largest is 0, ties by lowest vertex."""
    label = weak_components(num_vertices, tail, head)
    _, lowest, size = np.unique(label, return_index=True, return_counts=True)
    rank = np.empty(len(size), np.int64)
    rank[np.lexsort((lowest, -size))] = np.arange(len(size))
    numbered: IntArray = rank[label]
    return numbered
