"""Giving way in a deadlock: by whom, where to, and until when.

The rule of right of way: of the robots in a ring of waiting, the one gives way that has the shortest way to a place
where it is in none of the others' way; on a tie the one with the higher number. Its way there must be free, lead
over two-way lanes, since it comes back the same way, and not over a vertex where one of the others ends. If none of
them has such a place, robots that stand behind them are asked, so that those can back out. It goes on when none of
the others has to pass its way back any more, or can any more.

Robots that give way turn in place and drive forward, out of their lane if that is where they stand. Refuses to
ask robots that are disturbed or still move.
"""

import heapq
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.graph import BoolArray, IntArray
from mrp_sumo.drive.live_plan import in_grains
from mrp_sumo.drive.reroute import Reroute
from mrp_sumo.drive.state import State
from mrp_sumo.drive.surroundings import Surroundings

SEARCHED = 2000  # vertices, before a robot gives up looking for a place


@dataclass(frozen=True, eq=False)
class GivingWay:
    """A robot that lets others pass."""

    robot: int
    others: tuple[int, ...]
    place: int  # vertex where it lets them pass
    begin_s: float
    back: IntArray  # resources of its way back


def who_gives_way(context: Surroundings, ring: Sequence[int], disturbed: BoolArray, now: float) -> tuple[GivingWay, Reroute] | None:
    """The robot of a ring of waiting ones that gives way, and how; None if nobody can."""
    for candidates in (list(ring), _behind(context.state, ring)):
        best: tuple[float, int, list[int], tuple[int, ...]] | None = None
        for robot in candidates:
            if disturbed[robot] or not context.stands(robot):
                continue
            others = tuple(other for other in ring if other != robot)
            place = _place(context, robot, others)
            if place is None:
                continue
            cost, out = place
            if best is None or (round(cost, 6), -robot) < (round(best[0], 6), -best[1]):
                best = (cost, robot, out, others)
        if best is not None:
            _, robot, out, others = best
            return _giving_way(context, robot, others, out, now)
    return None


def still_to_pass(context: Surroundings, giving: GivingWay, broken: BoolArray) -> int:
    """One of the others that is to pass the way back yet, -1: none."""
    visits = context.ledger.visits
    for other in giving.others:
        if broken[other] or visits.next[visits.reached[other]] < 0:
            continue
        if np.isin(context.still_needed(other), giving.back).any():
            return other
    return -1


def _behind(state: State, ring: Sequence[int]) -> list[int]:
    """Robots that wait for one of the ring, or for one who does, nearest first."""
    behind, known = [], set(ring)
    front = list(ring)
    waits = state.waits.since_s < np.inf
    while front:
        front = [r for r in np.flatnonzero(waits & np.isin(state.grants.other, front)).tolist() if r not in known]
        known.update(front)
        behind += front
    return behind


def _place(context: Surroundings, robot: int, others: tuple[int, ...]) -> tuple[float, list[int]] | None:
    """The nearest place in nobody's way: metres, and the vertices from where the robot stands to it."""
    graph, grants, visits, granted = context.graph, context.state.grants, context.ledger.visits, context.granted(robot)
    avoid, goals = np.zeros(len(context.state.holds.holder), np.bool_), np.zeros(len(context.state.holds.holder), np.bool_)
    for other in others:
        avoid[context.still_needed(other)] = True
        goals[context.of_vertex(other, int(visits.vertex[visits.last[other]]))] = True
    start = int(visits.vertex[granted])
    begin = float(in_grains(context.state.motion.s_m[robot] - visits.at_m[granted])) if grants.on_lane[robot] else 0.0
    if not context.free_for(robot, context.of_vertex(robot, start)):
        return None
    came: dict[int, int] = {}
    barred = context.barred(robot)
    heap = [(begin, start, -1)]
    while heap and len(came) < SEARCHED:
        cost, vertex, before = heapq.heappop(heap)
        if vertex in came:
            continue
        came[vertex] = before
        if goals[vertex]:
            continue  # it could not come back from beyond
        if not avoid[context.of_vertex(robot, vertex)].any():
            out = [vertex]
            while (vertex := came[vertex]) >= 0:
                out.append(vertex)
            return cost, out[::-1]
        for lane in range(int(graph.first[vertex]), int(graph.first[vertex + 1])):
            head, back = int(graph.head[lane]), int(graph.reverse[lane])
            usable = head not in came and back >= 0 and not barred[lane] and not context.state.claims.number[back]
            if usable and context.free_for(robot, context.of_lane(robot, lane)):
                heapq.heappush(heap, (cost + float(graph.length_m[lane]), head, vertex))
    return None


def _giving_way(context: Surroundings, robot: int, others: tuple[int, ...], out: list[int], now: float) -> tuple[GivingWay, Reroute]:
    graph, ledger, granted = context.graph, context.ledger, context.granted(robot)
    vertex, arrive_s, depart_s = ledger.visits.vertex, ledger.visits.arrive_s, ledger.visits.depart_s
    turns_back = bool(context.state.grants.on_lane[robot])
    there = out if turns_back else out[1:]
    home = out[-2::-1]  # the way back, after the place
    rest = ledger.ids(robot, granted)[1:]
    while len(home) > 1 and len(rest) and home[-2] == vertex[rest[0]]:  # no need to go to a dead end and back
        home, rest = home[:-1], rest[1:]
    if len(home) == 1 and len(rest) and out[-1] == vertex[rest[0]]:  # its path leads to the place anyway
        home, rest = [], rest[1:]
    new = np.array(there + home, np.int64)
    times = np.full(len(new), now)
    route = Reroute(
        vertex=np.concatenate([new, vertex[rest]]),
        arrive_s=np.concatenate([times, arrive_s[rest]]),
        depart_s=np.concatenate([times, depart_s[rest]]) if len(rest) else np.append(times[1:], np.inf),
        leave_s=now,
        back=turns_back,
        pause=len(there),
    )
    passed = [context.of_vertex(robot, v) for v in out[:-1]]
    passed += [context.of_lane(robot, graph.lane_between(a, b)) for a, b in zip(out[1:], out[:-1])]
    back = np.unique(np.concatenate(passed)) if passed else np.zeros(0, np.int64)
    held = np.isin(back, context.of_vertex(robot, out[-1]))  # needed at the place itself
    return GivingWay(robot, others, out[-1], now, back[~held]), route
