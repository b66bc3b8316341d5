"""Ways cleared of robots without work: who stands where another has to pass, or too near, and cannot be driven round, is sent on before it.

As pushes in multi-robot planning do (Luna, Bekris, "Push and swap", IJCAI 2011): one with work is followed along its way, and whoever it
meets moves on to the nearest vertex off that way, pushing others on in turn. So robots on a one-way ring keep their order, and the places
to which they are sent can all be reached.
"""

from collections import deque
from collections.abc import Callable, Mapping, Sequence

from mrp_sumo.core.graph import PlanGraph

Near = Callable[[int, Sequence[int]], bool]  # whether a robot on a vertex is in the way of one on some others
Passable = Callable[[int, int], bool]  # whether a way, by its number, can lead from its first vertex to its last past a robot on a vertex


def cleared(
    graph: PlanGraph,
    ways: Sequence[Sequence[int]],
    idle: Mapping[int, int],
    closed: set[int],
    taken: set[int],
    near: Near,
    passable: Passable,
) -> dict[int, int]:
    """Vertices of robots that have to move on, by robot.

    `ways` are vertices that robots with work pass, from where they stand to where they go, the most urgent first; `idle` is where those
    without stand, on lanes of `graph`. Nobody may go to vertices that are `closed`, where robots stand that stay; others are to be at
    `taken`.
    """
    at = {v: r for r, v in idle.items()}
    for n in _front_first(ways):
        route = ways[n]
        for k in range(1, len(route)):
            for v in [v for v in at if v == route[k] or near(v, route[k : k + 1])]:
                if v not in at or (k < len(route) - 1 and passable(n, v)):
                    continue
                path = _path_off(graph, route, k, v, closed, taken | at.keys(), near)
                for behind, ahead in _moves(path, at):
                    at[ahead] = at.pop(behind)
    return {r: v for v, r in at.items() if idle[r] != v}


def _front_first(ways: Sequence[Sequence[int]]) -> list[int]:
    """Numbers of ways, each after those that begin on it, as far as that can be."""
    left, order = list(range(len(ways))), list[int]()
    while left:
        free = (n for n in left if not any(ways[m][0] in ways[n] for m in left if m != n))
        order.append(next(free, left[0]))
        left.remove(order[-1])
    return order


def _path_off(graph: PlanGraph, route: Sequence[int], k: int, stands: int, closed: set[int], taken: set[int], near: Near) -> list[int]:
    """The vertices from where a robot stands to the nearest off a route that is driven from its k-th on, best ahead of who comes and clear
    of it; none but the first: none. Who is beside the route goes only where it is clear of it.
    """
    rest = route[k:]

    def off(v: int) -> bool:
        return v not in route and v not in taken and not graph.vertex_options[v].get("is_passthrough_point")

    for barred in (closed | set(route[:k]), closed):
        path = _nearest(graph, stands, barred, lambda v: off(v) and not near(v, rest))
        if path := path or (_nearest(graph, stands, barred, off) if stands in rest else []):
            return path
    return [stands]


def _nearest(graph: PlanGraph, start: int, barred: set[int], fits: Callable[[int], bool]) -> list[int]:
    """A path of the fewest lanes to a vertex that fits; empty where there is none."""
    before, queue = {start: start}, deque([start])
    while queue:
        v = queue.popleft()
        if v != start and fits(v):
            path = [v]
            while path[-1] != start:
                path.append(before[path[-1]])
            return path[::-1]
        for u in graph.head[graph.first[v] : graph.first[v + 1]].tolist():
            if u not in before and u not in barred:
                before[u] = v
                queue.append(u)
    return []


def _moves(path: Sequence[int], at: Mapping[int, int]) -> list[tuple[int, int]]:
    """Moves by which all on a path but its last vertex move up, the last of them to its end."""
    moves, free = list[tuple[int, int]](), path[-1]
    for v in reversed(path[:-1]):
        if v in at:
            moves.append((v, free))
            free = v
    return moves
