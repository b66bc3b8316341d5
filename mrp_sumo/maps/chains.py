"""Curves of a nav graph as one lane each: chains of lanes over vertices with the option `is_bend` put together again.

Readers draw a curve as many short lanes, which is right for pictures, networks and checks. Robots drive it in steps of about a cell,
so it has to be cut as a whole.
"""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray, NavGraph, frozen, nav_like


@dataclass(frozen=True, eq=False)
class Chains:
    """A graph with curves as single lanes, M of them, over P pieces, which are lanes of the graph as drawn."""

    nav: NavGraph  # the same vertices; bends within chains have no lanes
    piece: IntArray  # [P] lanes of the drawn graph, along each lane of `nav` in turn
    first: IntArray  # [M + 1] CSR offsets
    begin_m: FloatArray  # [P] length of all pieces before, over all lanes

    def at(self, drawn: NavGraph, lane: IntArray, along_m: FloatArray) -> tuple[IntArray, FloatArray]:
        """The drawn lane [C] on which places [C] along lanes of `nav` lie, and how far along it, in m."""
        piece = np.searchsorted(self.begin_m, self.begin_m[self.first[lane]] + along_m, "right") - 1
        piece = np.clip(piece, self.first[lane], self.first[lane + 1] - 1)
        off_m = self.begin_m[self.first[lane]] + along_m - self.begin_m[piece]
        return self.piece[piece], np.clip(off_m, 0.0, drawn.length_m[self.piece[piece]])


def chains_of(nav: NavGraph) -> Chains | None:
    """The graph with its curves put together; None where it has none."""
    bends = nav.having("is_bend")
    if not bends.any():
        return None
    next_lane = _next_lanes(nav, bends)
    inner = np.zeros(nav.num_lanes, np.bool_)
    inner[next_lane[next_lane >= 0]] = True
    ways = []
    for lane in np.flatnonzero(~inner).tolist():
        chain = [lane]
        while (following := int(next_lane[chain[-1]])) >= 0:
            chain.append(following)
        ways.append(chain)
    seen = np.zeros(nav.num_lanes, np.bool_)
    seen[[lane for chain in ways for lane in chain]] = True
    ways += [[lane] for lane in np.flatnonzero(~seen).tolist()]  # rings of bends alone
    return _chains(nav, _apart(nav, ways))


def _next_lanes(nav: NavGraph, bends: np.ndarray) -> IntArray:
    """[L] the lane that goes on behind each lane whose head is a mere bend of it, else -1."""
    next_lane = np.full(nav.num_lanes, -1, np.int64)
    into: dict[int, list[int]] = {}
    for lane in np.flatnonzero(bends[nav.head]).tolist():
        into.setdefault(int(nav.head[lane]), []).append(lane)
    for v, lanes in into.items():
        out = list(range(int(nav.first[v]), int(nav.first[v + 1])))
        for lane in lanes:
            on = [k for k in out if nav.head[k] != nav.tail[lane]]
            if len(on) == 1 and len(lanes) == len(out) <= 2 and _alike(nav, lane, on[0]):
                next_lane[lane] = on[0]
    return next_lane


def _alike(nav: NavGraph, a: int, b: int) -> bool:
    return bool(nav.speed_mps[a] == nav.speed_mps[b]) and nav.lane_options[a] == nav.lane_options[b]


def _apart(nav: NavGraph, ways: list[list[int]]) -> list[list[int]]:
    """The ways, those halved at a bend that would be a second lane between two vertices, or the reverse of another line."""
    taken: dict[tuple[int, int], list[int]] = {}
    halves = []
    for chain in sorted(ways, key=lambda points: (len(points) > 1, points[0])):  # straight lanes have no bend to be halved at
        tail, head = int(nav.tail[chain[0]]), int(nav.head[chain[-1]])
        back = taken.get((head, tail))
        same_line = back is None or [int(nav.reverse[lane]) for lane in reversed(chain)] == back
        if len(chain) > 1 and (tail == head or (tail, head) in taken or not same_line):
            half = len(chain) // 2
            halves += [chain[:half], chain[half:]]
            continue
        taken[tail, head] = chain
        halves.append(chain)
    return halves


def _chains(nav: NavGraph, ways: list[list[int]]) -> Chains:
    merged = nav_like(
        nav,
        lanes=[(int(nav.tail[chain[0]]), int(nav.head[chain[-1]])) for chain in ways],
        length_m=[float(nav.length_m[chain].sum()) for chain in ways],
        speed_mps=[float(nav.speed_mps[chain[0]]) for chain in ways],
        lane_options=[nav.lane_options[chain[0]] for chain in ways],
    )
    ordered = [ways[k] for k in merged.source_lane.tolist()]
    first = np.concatenate([[0], np.cumsum([len(chain) for chain in ordered])])
    piece = np.array([lane for chain in ordered for lane in chain], np.int64)
    ends = np.concatenate([[0.0], np.cumsum(nav.length_m[piece])])
    return Chains(merged, frozen(piece), frozen(first.astype(np.int64)), frozen(ends[:-1]))
