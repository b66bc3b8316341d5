"""The roadmap discretisation: lanes cut into equal steps of about one cell, so that one step takes one time unit.

Refuses cells that are not above 0 or so short that no plan could be computed on the result.
"""

import math
from collections.abc import Collection
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mrp_sumo.core.csr import ranges
from mrp_sumo.core.graph import NO_PROPERTIES, BoolArray, FloatArray, IntArray, NavGraph, PlanGraph, frozen, nav_like, plan_graph
from mrp_sumo.errors import MapError
from mrp_sumo.maps.chains import Chains, chains_of
from mrp_sumo.maps.curves import traced

MAX_VERTICES = 2_000_000
SHORTEST_M = 1e-6  # between two places along a curve


def cut_lanes(nav: NavGraph, cell_m: float, two_way: bool | Collection[int] = False) -> PlanGraph:
    """Cut every lane into `max(1, round(length / cell_m))` equal steps; rides in lifts stay whole. A plan graph stays as it is.

    The vertices of `nav` come first and keep their numbers; a lane and its reverse share the cuts between them (a single track), or have
    their own beside each other, `cell_m` apart, keeping right. `two_way` says so of all lanes, or of these, but for lanes of one step and
    those through lifts. A vertex without lanes stands for the one with lanes at the same place, where there is one. A curve, drawn as lanes
    over bends, is cut as one lane; its bends remain as vertices without lanes. Raises MapError for a cell length that cannot be used.
    """
    if isinstance(nav, PlanGraph):
        return nav
    check_cell(cell_m)
    drawn, chains = nav, chains_of(nav)
    nav = chains.nav if chains else nav
    cuts = _cuts(nav, cell_m, _meeting(drawn, chains, two_way))
    on_lane, along_m = cuts.lane, cuts.share * nav.length_m[cuts.lane]
    places = _places(nav, cuts, cell_m)
    if chains:
        on_lane, along_m = chains.at(drawn, cuts.lane, along_m)
        places = _places(
            drawn, cuts._replace(lane=on_lane, share=along_m / drawn.length_m[on_lane], apart=_spread(cuts, drawn, on_lane)), cell_m
        )
    of = np.repeat(np.arange(nav.num_lanes), cuts.steps)  # [S] the lane of each step
    i = ranges(0, cuts.steps)  # [S] its number along the lane, from 0
    n = cuts.steps[of]
    length_m = nav.length_m[of] / n
    aslant = cuts.apart[of] & ((i == 0) | (i == n - 1))  # from a vertex to its own track, and back
    length_m = np.where(aslant, np.hypot(length_m, cell_m / 2), length_m)

    def place(j: np.ndarray) -> np.ndarray:
        """[S] vertex after j steps of the lane, whose cuts are counted along its owner, or against it."""
        between = cuts.first[of] + np.where(cuts.own[of], j, n - j) - 1
        return np.where(j == 0, nav.tail[of], np.where(j == n, nav.head[of], between))

    graph = nav_like(
        nav,
        xy=np.concatenate([nav.xy, places]),
        lanes=np.stack([place(i), place(i + 1)], axis=1),
        level=np.concatenate([nav.level, nav.level[nav.tail[cuts.lane]]]),
        vertex_name=nav.vertex_name + ("",) * len(cuts.lane),
        vertex_options=nav.vertex_options + (NO_PROPERTIES,) * len(cuts.lane),
        length_m=length_m,
        speed_mps=nav.speed_mps[of],
        lane_options=[nav.lane_options[j] for j in of],
    )
    return plan_graph(
        graph,
        kind="roadmap",
        cell_m=cell_m,
        vertex_of_station=_stations(nav),
        nav_lane=np.concatenate([np.full(nav.num_vertices, -1), on_lane]),
        offset_m=np.concatenate([np.zeros(nav.num_vertices), along_m]),
        curves=_curves(drawn, chains, cuts, np.stack([place(i), place(i + 1)], axis=1)) if chains else None,
    )


def _curves(drawn: NavGraph, chains: Chains, cuts: "_Cuts", ends: IntArray) -> dict[tuple[int, int], FloatArray]:
    """The parts of curves along which the steps between vertices [S, 2] lead, but for tracks beside each other."""
    curves, first = {}, np.cumsum(cuts.steps) - cuts.steps
    for lane in np.flatnonzero((np.diff(chains.first) > 1) & ~cuts.apart).tolist():
        curve = traced(drawn, chains.piece[chains.first[lane] : chains.first[lane + 1]].tolist())
        if curve is None:
            continue
        bounds_m = np.linspace(0.0, curve[-1, 0], int(cuts.steps[lane]) + 1)
        for k, (begin_m, end_m) in enumerate(pairwise(bounds_m.tolist())):
            inner = curve[(curve[:, 0] > begin_m + SHORTEST_M) & (curve[:, 0] < end_m - SHORTEST_M), 0]
            at_m = np.concatenate([[begin_m], inner, [end_m]])
            columns = [at_m - begin_m, *(np.interp(at_m, curve[:, 0], curve[:, n]) for n in (1, 2, 3))]
            tail, head = ends[first[lane] + k].tolist()
            curves[tail, head] = frozen(np.column_stack(columns))
    return curves


class _Cuts(NamedTuple):
    """Where lanes are cut. Of a lane and its reverse on a single track one owns the cuts."""

    steps: IntArray  # [L] of each lane
    first: IntArray  # [L] the first vertex between its ends, along the owner
    own: BoolArray  # [L] whether it owns its cuts
    apart: BoolArray  # [L] whether it has a track of its own beside its reverse
    lane: IntArray  # [C] the owner of each cut
    share: FloatArray  # [C] of the owner's length that lies before it


def _meeting(drawn: NavGraph, chains: Chains | None, two_way: bool | Collection[int]) -> BoolArray:
    """[L of what is cut] whether robots may meet on a lane; on a curve, if on one of its pieces."""
    if isinstance(two_way, bool):
        return np.full((chains.nav if chains else drawn).num_lanes, two_way)
    lanes = np.array(sorted(two_way), np.int64)
    either = np.isin(np.arange(drawn.num_lanes), np.concatenate([lanes, drawn.reverse[lanes]]))
    return np.logical_or.reduceat(either[chains.piece], chains.first[:-1]) if chains else either


def _cuts(nav: NavGraph, cell_m: float, two_way: BoolArray) -> _Cuts:
    num_vertices, num_lanes = nav.num_vertices, nav.num_lanes
    steps = np.where(nav.is_ride, 1, np.maximum(np.rint(nav.length_m / cell_m), 1))
    lane = np.arange(num_lanes)
    apart = two_way & (nav.reverse >= 0) & (steps > 1)
    shared = (nav.reverse >= 0) & (nav.reverse < lane) & ~apart
    owner = np.where(shared, nav.reverse, lane)
    own = owner == lane
    if steps[own].sum() + num_vertices > MAX_VERTICES:
        length_m = float(nav.length_m[own & ~nav.is_ride].sum())
        raise MapError(
            f"cells of {cell_m:g} m would cut the {length_m / 1000:.4g} km of lanes of '{nav.name}' into more than {MAX_VERTICES:,} "
            "pieces: is the map's scale right? Larger cells: discretisation.cell_m"
        )
    steps = steps[owner].astype(np.int64)
    first = np.zeros(num_lanes, np.int64)
    first[own] = num_vertices + np.concatenate([[0], np.cumsum(steps[own] - 1)[:-1]]) if num_lanes else 0
    first = first[owner]
    cut_lane = np.repeat(lane[own], steps[own] - 1)
    k = np.arange(len(cut_lane)) - (first[cut_lane] - num_vertices) + 1  # [C] its step along the owner, from 1
    return _Cuts(steps, first, own, apart, cut_lane, k / steps[cut_lane])


def _spread(cuts: _Cuts, drawn: NavGraph, on_lane: IntArray) -> BoolArray:
    """[L of drawn] whether the cuts on each drawn lane have a track of their own."""
    apart = np.zeros(drawn.num_lanes, np.bool_)
    apart[on_lane] = cuts.apart[cuts.lane]
    return apart


def _places(nav: NavGraph, cuts: _Cuts, cell_m: float) -> FloatArray:
    """[C, 2] of the cuts, in m: on the lane, or half a cell to its right."""
    along = nav.xy[nav.head[cuts.lane]] - nav.xy[nav.tail[cuts.lane]]
    right = along[:, ::-1] * [1, -1] / np.maximum(np.hypot(*along.T), 1e-9)[:, None]
    xy = nav.xy[nav.tail[cuts.lane]] + cuts.share[:, None] * along
    return np.asarray(xy + np.where(cuts.apart[cuts.lane], cell_m / 2, 0.0)[:, None] * right)


def cell_that_fits(length_m: FloatArray, step_m: float, least_m: float = 0.0) -> float:
    """A cell length, `least_m` or some whole centimetres above it, with which no step of these lanes is shorter than `step_m`.

    Lengths of lanes [L] are at least `step_m`; infinite for one that is cut into cells exactly, as on a grid.
    """
    finite = length_m[np.isfinite(length_m)]
    cell_m = least_m if least_m >= step_m - 1e-9 else math.ceil(100 * step_m - 1e-7) / 100
    while len(finite) and (finite / np.maximum(np.rint(finite / cell_m), 1) < step_m - 1e-9).any():
        cell_m = math.floor(100 * cell_m + 1 + 1e-7) / 100
    return cell_m


def check_cell(cell_m: float) -> None:
    """Raises MapError unless cells of this length make sense."""
    if not (math.isfinite(cell_m) and cell_m >= 0.01):
        raise MapError(f"the cell length is {cell_m:g} m, expected at least 0.01 m")


def _stations(nav: NavGraph) -> np.ndarray:
    """[V] the vertex that stands for each: itself, or its twin with lanes."""
    driven = np.zeros(nav.num_vertices, np.bool_)
    driven[nav.tail] = driven[nav.head] = True
    twin = {(int(nav.level[v]), *nav.xy[v].tolist()): v for v in np.flatnonzero(driven)}
    return np.array([v if driven[v] else twin.get((int(nav.level[v]), *nav.xy[v].tolist()), v) for v in range(nav.num_vertices)], np.int64)
