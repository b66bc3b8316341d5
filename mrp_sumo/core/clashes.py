"""Moves that two robots cannot make in one planning step because they would come too close, as kernels of planners see it."""

from typing import NamedTuple

import numpy as np

from mrp_sumo.core.graph import IntArray, frozen


class Clashes(NamedTuple):
    """Moves of a graph with V vertices and L lanes: move m is driving along lane m, move L + v is waiting at v.

    A robot that drives holds its lane and both ends of it for the step, a robot that waits holds its vertex. While
    a robot makes move m, nobody else may be at `vertex[vertex_first[m]:vertex_first[m + 1]]`, neither when the step begins
    nor when it ends, or drive along `lane[lane_first[m]:lane_first[m + 1]]`. That goes beyond the rules of MAPF, which
    planners know: nobody else at its vertices or on its lane. All moves clash mutually. Where they are those of spots, see `Spots`, these
    are the vertices, and the moves between them the lanes.
    """

    vertex_first: IntArray  # [L + V + 1] CSR
    vertex: IntArray  # ascending by move; a move's own vertices are among them where they are in a mutex group
    lane_first: IntArray  # [L + V + 1] CSR
    lane: IntArray  # ascending by move; without those that begin or end at one of the vertices
    any: bool  # whether there are clashes at all
    rotations: bool  # whether robots in a ring may all move at once, each to where the next one was


class Spots(NamedTuple):
    """Spots that robots take: a place of the map, and, with trailers, the place behind it, too. S spots, N moves between them.

    On a map each vertex is a spot. On a graph of moves the states at a place are one, whichever way a vehicle faces there.
    """

    of: IntArray  # [V] spot of a vertex
    move: IntArray  # [L] move between spots of a lane
    first: IntArray  # [S + 1] CSR, moves that leave a spot
    head: IntArray  # [N]
    tail: IntArray  # [N]
    back: IntArray  # [N] the move the other way between two spots, -1: none
    first_in: IntArray  # [S + 1] CSR, moves that enter one
    tail_in: IntArray  # [N]
    place: IntArray  # [S] vertex of the map
    beside_first: IntArray  # [S + 1] CSR
    beside: IntArray  # others at the same place: a robot at s keeps others off `beside[beside_first[s]:beside_first[s + 1]]` at that step


def vertices_alone(first: IntArray, head: IntArray, tail: IntArray, reverse: IntArray) -> Spots:
    """Every vertex is a spot of its own. `reverse` [L] is the lane that leads back along each, -1: none."""
    vertices = frozen(np.arange(len(first) - 1))
    entering = (first, head) if (reverse >= 0).all() else lanes_in(tail, head, len(first) - 1)
    none = frozen(np.zeros(len(first), np.int64)), frozen(np.zeros(0, np.int64))
    return Spots(vertices, frozen(np.arange(len(head))), first, head, tail, reverse, *entering, vertices, *none)


def lanes_in(tail: IntArray, head: IntArray, num_vertices: int) -> tuple[IntArray, IntArray]:
    """CSR of the tails of the lanes that enter each vertex."""
    order = np.argsort(head, kind="stable")
    return frozen(np.searchsorted(head[order], np.arange(num_vertices + 1)).astype(np.int64)), frozen(tail[order])


def no_clashes(num_vertices: int, num_lanes: int, *, rotations: bool) -> Clashes:
    """The rules of MAPF alone."""
    first, nothing = frozen(np.zeros(num_lanes + num_vertices + 1, np.int64)), frozen(np.zeros(0, np.int64))
    return Clashes(first, nothing, first, nothing, False, rotations)
