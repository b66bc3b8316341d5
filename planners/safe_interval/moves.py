"""Moves of robots of one type on a graph: turn in place, drive straight runs from rest to rest, wait; and what each of it needs, when.

Times are whole steps of the simulation, so that a plan is kept exactly. A run is a number of lanes of a ray, see `_rays`. Needs are the
executor's: the vertex, zones and groups of `traffic.resources`. What the lane alone needs is left on it, what a vertex needs on the lane
by which it is left.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray, NavGraph, frozen
from mrp_sumo.core.plan import Plan
from mrp_sumo.traffic.moves import MoveGraph
from mrp_sumo.traffic.resources import Course, Resources, left_after_m, needs_of
from planners.safe_interval._rays import STRAIGHT_RAD, DrivenRay, lay_course, lay_tails, steps_of_turns

SHORTEST_M = 0.1  # shorter lanes are driven as if they were so long
LONGEST_RAY = 1000  # lanes
MOST_RUNS = 500_000  # to lay out, about


class Moves(NamedTuple):
    """L lanes between V vertices, P courses of K runs in all. A robot at rest has come by a lane, or has not moved yet (-1)."""

    first: IntArray  # [V + 1] lanes that leave each vertex
    tail: IntArray  # [L]
    head: IntArray  # [L]
    first_in: IntArray  # [V + 1] CSR: lanes that enter each vertex
    lane_in: IntArray  # [L]
    heading_rad: FloatArray  # [L]
    turn_first: IntArray  # [L + 1] CSR: steps of turning from each lane to each that leaves its head
    turn: IntArray
    alike: IntArray  # [L] the first of those that lead to one vertex along one lane of the map: robots go on alike from these
    onward: IntArray  # [L] the lane straight on, -1: none
    behind_first: IntArray  # [L + 1] CSR: the lanes whose `onward` it is
    behind: IntArray
    length: IntArray  # [L] lanes of the ray that begins with each lane
    at_first: IntArray  # [V + 1] CSR: resources of each vertex
    at: IntArray
    off_first: IntArray  # [L + 1] CSR: how far along a lane each resource of its tail has been left, in the order of `at`
    off_m: FloatArray
    on_first: IntArray  # [L + 1] CSR: resources that the lane alone needs, and how far along it they have been left
    on: IntArray
    on_m: FloatArray
    course: IntArray  # [L] the course of each ray
    run_first: IntArray  # [P + 1] CSR: runs of each course, of 1, 2, ... lanes
    end_m: FloatArray  # [K] where each run ends
    brake: IntArray  # [K] the step before which it brakes: the next lane is needed from then on
    time: IntArray  # [K] the step after which it has arrived
    tail_first: IntArray  # [K] in `tail_m`: positions from `brake` to `time`
    tail_m: FloatArray
    along_first: IntArray  # [P + 1] CSR: positions after 0, 1, ... steps
    along_m: FloatArray
    turn_rad: float  # in a step
    concave: bool  # whether all lanes are driven at one top speed
    steps_per_m: float  # at the highest speed
    many_states: bool  # whether the graph is one of moves, where a place of the map has many vertices


def moves_of(graph: NavGraph, resources: Resources, limits: tuple[float, float, float, float], dt: float, kind: int = 0) -> Moves:
    """Moves on the straight lanes of a graph, in simulation steps of `dt` s, of robots of a type that resources know by `kind`.

    `limits` are their top speed, acceleration, deceleration and turn rate.
    """
    top, accel, decel, turn_rate = limits
    heading = np.array(graph.heading_rad)
    onward = _straight_on(graph, heading)
    driven = np.asarray(np.round(np.maximum(graph.length_m, SHORTEST_M), 6), np.float64)
    limit = np.minimum(graph.speed_mps, top)
    alike = bool((driven == driven[:1]).all() and (limit == limit[:1]).all())
    length = _ray_lengths(onward, alike=alike)
    course, lanes_of = _courses(onward, length, driven, limit, alike=alike)
    runs = [_runs(driven[lanes], limit[lanes], (top, accel, decel), dt) for lanes in lanes_of]
    off, on = _left_on(graph, resources, driven, kind)
    in_order = np.argsort(graph.head, kind="stable")
    behind = np.argsort(onward, kind="stable")
    behind = behind[onward[behind] >= 0]
    num_vertices, lane = graph.num_vertices, np.arange(graph.num_lanes + 1)
    of_kind = resources.zones_first[kind * resources.num_places :][: num_vertices + 1]
    zones = np.diff(of_kind)
    at_first = np.concatenate([[0], np.cumsum(zones + 1)])
    at = np.empty(at_first[-1], np.int64)
    own = np.zeros(len(at), np.bool_)
    own[at_first[:-1]] = True
    at[own] = np.arange(num_vertices)
    at[~own] = num_vertices + resources.zones_of[of_kind[0] : of_kind[-1]]
    turn_first = np.concatenate([[0], np.cumsum(np.diff(graph.first)[graph.head])]).astype(np.int64)
    turn = np.zeros(turn_first[-1], np.int64)
    steps_of_turns(graph.first, graph.head, heading, turn_first, turn_rate * dt, turn)
    tails = np.cumsum([0, *(len(run[4]) for run in runs)])
    return Moves(
        first=graph.first,
        tail=graph.tail,
        head=graph.head,
        first_in=np.searchsorted(graph.head[in_order], np.arange(num_vertices + 1)).astype(np.int64),
        lane_in=in_order.astype(np.int64),
        heading_rad=heading,
        turn_first=turn_first,
        turn=turn,
        alike=_alike(graph),
        onward=onward,
        behind_first=np.searchsorted(onward[behind], lane).astype(np.int64),
        behind=behind.astype(np.int64),
        length=length,
        at_first=at_first.astype(np.int64),
        at=at,
        off_first=off[0],
        off_m=off[1],
        on_first=on[0],
        on=on[1],
        on_m=on[2],
        course=course,
        run_first=np.cumsum([0, *(len(run[0]) for run in runs)]).astype(np.int64),
        end_m=_joined([run[0] for run in runs]),
        brake=_joined([run[1] for run in runs]),
        time=_joined([run[2] for run in runs]),
        tail_first=_joined([run[3] + begin for run, begin in zip(runs, tails.tolist())]),
        tail_m=_joined([run[4] for run in runs]),
        along_first=np.cumsum([0, *(len(run[5]) for run in runs)]).astype(np.int64),
        along_m=_joined([run[5] for run in runs]),
        turn_rad=turn_rate * dt,
        concave=bool((limit == limit[:1]).all()),
        steps_per_m=1.0 / (float(limit.max(initial=1e-9)) * dt),
        many_states=isinstance(graph, MoveGraph),
    )


def _alike(graph: NavGraph) -> IntArray:
    """[L] see `Moves`."""
    if not isinstance(graph, MoveGraph):
        return np.arange(graph.num_lanes)
    _, lane, which = np.unique(np.stack([graph.head, graph.base_lane]), axis=1, return_index=True, return_inverse=True)
    return lane[which.reshape(-1)].astype(np.int64)


def _straight_on(graph: NavGraph, heading: FloatArray) -> IntArray:
    """[L] of the lanes that leave each lane's head, the one that bends least, if it does not bend much."""
    lane, following = graph.onward
    bend = np.abs((heading[following] - heading[lane] + np.pi) % (2 * np.pi) - np.pi)
    place = graph.place if isinstance(graph, MoveGraph) else np.arange(graph.num_vertices)
    turns_back = (place[graph.head[following]] == place[graph.tail[lane]]) | (graph.is_backward[following] != graph.is_backward[lane])
    fits = (bend <= STRAIGHT_RAD) & ~turns_back
    lane, following, bend = lane[fits], following[fits], bend[fits]
    order = np.lexsort((following, np.round(bend, 9), lane))[::-1]
    onward = np.full(graph.num_lanes, -1, np.int64)
    onward[lane[order]] = following[order]  # of several assignments the last one stands
    return onward


def _ray_lengths(onward: IntArray, *, alike: bool) -> IntArray:
    """[L] lanes of each ray; where it comes round, until then. Shorter where all runs together would be too many."""
    length, at, lane = np.zeros(len(onward), np.int64), np.arange(len(onward)), np.arange(len(onward))
    longest = LONGEST_RAY if alike else max(8, MOST_RUNS // max(len(onward), 1))
    for _ in range(longest):
        lane, at = lane[at >= 0], at[at >= 0]
        if not len(at):
            break
        length[lane] += 1
        at = onward[at]
    return length


def _courses(onward: IntArray, length: IntArray, driven: FloatArray, limit: FloatArray, *, alike: bool) -> tuple[IntArray, list[IntArray]]:
    """[L] the course of each ray, and the lanes of each course. Rays of equal lanes share one."""
    course = np.full(len(onward), -1, np.int64)
    lanes_of: list[IntArray] = []
    same: dict[bytes, int] = {}
    if alike and len(onward):
        lane = int(np.argmax(length))
        return np.zeros(len(onward), np.int64), [_ray(onward, lane, length)]
    for lane in range(len(onward)):
        lanes = _ray(onward, lane, length)
        key = driven[lanes].tobytes() + limit[lanes].tobytes()
        if key not in same:
            same[key] = len(lanes_of)
            lanes_of.append(lanes)
        course[lane] = same[key]
    return course, lanes_of


def _ray(onward: IntArray, lane: int, length: IntArray) -> IntArray:
    path = np.empty(length[lane], np.int64)
    for k in range(len(path)):
        path[k] = lane
        lane = onward.item(lane)
    return path


def _runs(driven: FloatArray, limit: FloatArray, limits: tuple[float, float, float], dt: float) -> tuple[np.ndarray, ...]:
    """Of one course: end_m, brake, time, tail_first, tail_m, along_m."""
    ray = DrivenRay(np.cumsum(driven), limit, *limits, dt)
    s, v = lay_course(ray)
    return ray.end_m, *lay_tails(ray, s, v), s


def _left_on(
    graph: NavGraph, resources: Resources, driven: FloatArray, kind: int
) -> tuple[tuple[IntArray, FloatArray], tuple[IntArray, IntArray, FloatArray]]:
    """CSR by lane: how far along it what its tail needs is left, and what the lane alone needs with where that is left."""
    num_lanes = graph.num_lanes
    visits = np.stack([graph.tail, graph.head], 1).reshape(-1)  # as if a robot drove each lane, and nothing else
    plan = Plan(2 * np.arange(num_lanes + 1), visits, np.zeros(2 * num_lanes), np.zeros(2 * num_lanes))
    lane = np.stack([np.full(num_lanes, -1), np.arange(num_lanes)], 1).reshape(-1)
    at_m = np.stack([np.zeros(num_lanes), driven], 1).reshape(-1)
    kinds = np.full(num_lanes, kind)
    needs = needs_of(graph, plan, lane, resources, kinds)
    left = left_after_m(graph, resources, Course(plan, lane, np.zeros(2 * num_lanes), at_m, driven / graph.length_m, kinds), needs)
    visit = needs.visit
    off, on = visit % 2 == 0, (visit % 2 == 1) & needs.on_lane
    lanes = np.arange(num_lanes + 1)
    return (
        (np.searchsorted(visit[off] // 2, lanes).astype(np.int64), left[off]),
        (np.searchsorted(visit[on] // 2, lanes).astype(np.int64), needs.resource[on], left[on]),
    )


def _joined(parts: list[np.ndarray]) -> np.ndarray:
    return frozen(np.concatenate(parts)) if parts else np.zeros(0)
