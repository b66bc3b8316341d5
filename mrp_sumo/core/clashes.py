"""Moves that two robots cannot make in one planning step because they would come too close, as kernels of planners see it."""

from typing import NamedTuple

import numpy as np

from mrp_sumo.core.graph import IntArray, frozen


class Clashes(NamedTuple):
    """Moves of a graph with V vertices and L lanes: move m is driving along lane m, move L + v is waiting at v.

    A robot that drives holds its lane and both ends of it for the step, a robot that waits holds its vertex. While
    a robot makes move m, nobody else may be at `vertex[vertex_first[m]:vertex_first[m + 1]]`, neither when the step begins
    nor when it ends, or drive along `lane[lane_first[m]:lane_first[m + 1]]`. That goes beyond the rules of MAPF, which
    planners know: nobody else at its vertices or on its lane. All moves clash mutually.
    """

    vertex_first: IntArray  # [L + V + 1] CSR
    vertex: IntArray  # ascending by move; a move's own vertices are among them where they are in a mutex group
    lane_first: IntArray  # [L + V + 1] CSR
    lane: IntArray  # ascending by move; without those that begin or end at one of the vertices
    any: bool  # whether there are clashes at all
    rotations: bool  # whether robots in a ring may all move at once, each to where the next one was


class Beside(NamedTuple):
    """Vertices of a graph that are one place: while a robot is at v, nobody else is at `vertex[first[v]:first[v + 1]]` at the same step."""

    first: IntArray  # [V + 1] CSR
    vertex: IntArray
    place: IntArray  # [V] a number of the place


def none_beside(num_vertices: int) -> Beside:
    """Every vertex is a place of its own."""
    return Beside(frozen(np.zeros(num_vertices + 1, np.int64)), frozen(np.zeros(0, np.int64)), frozen(np.arange(num_vertices)))


def no_clashes(num_vertices: int, num_lanes: int, *, rotations: bool) -> Clashes:
    """The rules of MAPF alone."""
    first, nothing = frozen(np.zeros(num_lanes + num_vertices + 1, np.int64)), frozen(np.zeros(0, np.int64))
    return Clashes(first, nothing, first, nothing, False, rotations)
