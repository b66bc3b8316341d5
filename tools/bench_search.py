"""The cost of a low-level expansion: processor time of long searches, nanoseconds for each state expanded.

    tools/bench_search.py INSTANCES [--times N]

INSTANCES is the folder that `tools/bench_planners.py` takes. Space-time A*: each robot in turn among all others, within 1.2
times its least cost, to the end. SIPP: the earliest arrival under a constraint that makes it look everywhere. LNS: a label of
MAPF-LNS2 and of the neighbourhoods after it, with all that a neighbourhood costs besides.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from time import process_time

import bench
import numpy as np
from bench_planners import problem_of, scens

from mrp_sumo.core.problem import Problem
from mrp_sumo.planning.registry import planner
from mrp_sumo.search import _records as records
from mrp_sumo.search._constraints import EXPANSIONS, load
from mrp_sumo.search._earliest import NO_EDGE, earliest_arrival
from mrp_sumo.search._occupancy import install_all, uninstall
from mrp_sumo.search._space_time import TreeTables, find_path
from planners.conflict_based.incumbent import Incumbent
from planners.conflict_based.tree import SearchLimits, Tree

ASKED = (("random-32-32-20", 100), ("random-32-32-10", 200), ("airport_terminal_0.4", 20), ("warehouse-10-20-10-2-1", 200))
PLENTY = 1 << 40
W = 1.2


def focal(problem: Problem) -> tuple[int, float]:
    """(expansions, seconds) of space-time A*."""
    tree = Tree(problem, SearchLimits(np.inf, 4000))
    root = tree.root(W)
    assert root is not None
    for _ in range(6):  # so much room that no search is broken off for want of it
        tree._buffers.grow_scratch()
    store, occupancy, scratch = tree._buffers.store, tree._buffers.occupancy, tree._buffers.scratch
    tables = TreeTables(tree.instance, store, occupancy, scratch)
    seconds, before = 0.0, int(scratch.number[EXPANSIONS])
    for robot, record in enumerate(root.records.tolist()):
        install_all(store, occupancy, root.records, -1)
        uninstall(store, occupancy, robot)
        load(tree.instance, store, scratch, record)
        least = int(tree.instance.distance[robot, tree.instance.start[robot]])
        began = process_time()
        find_path(tables, robot, least, int(W * least), False, PLENTY)
        seconds += process_time() - began
        began = process_time()  # what the call from Python costs is not the search's: one that may do nothing is taken off
        find_path(tables, robot, least, int(W * least), False, 0)
        seconds -= process_time() - began
        before += 1
    return int(scratch.number[EXPANSIONS]) - before, seconds


def earliest(problem: Problem) -> tuple[int, float]:
    """(expansions, seconds) of SIPP."""
    tree = Tree(problem, SearchLimits(np.inf, 4000))
    for _ in range(4):
        tree._buffers.grow_scratch()
    world, store, scratch = tree.instance, tree._buffers.store, tree._buffers.scratch
    seconds = 0.0
    for robot in range(problem.num_robots):
        least, goal = int(world.distance[robot, world.start[robot]]), int(world.goal[robot])
        begin, end = tree._rows([(records.RANGE, goal, -1, 0, 2 * least + 100)])
        record = records.add_record(store, -1, robot, begin, end)
        load(world, store, scratch, record)
        began = process_time()
        earliest_arrival(world, scratch, world.start[robot], world.distance[robot], True, NO_EDGE, PLENTY)
        seconds += process_time() - began
    return int(scratch.number[EXPANSIONS]), seconds


def lns(problem: Problem) -> tuple[int, float]:
    """(labels, seconds) of large neighbourhood search, laying out its tables not counted."""
    tree = Tree(problem, SearchLimits(np.inf, 4000))
    other = Incumbent(problem, tree.instance.distance, np.inf)
    other.work(1, 0.0)
    before, began = other.labels, process_time()
    other.work(400_000, 0.0)
    return other.labels - before, process_time() - began


def arguments(parser: argparse.ArgumentParser) -> None:
    """Instances."""
    parser.add_argument("instances", type=Path)
    parser.add_argument("--times", type=int, default=3, metavar="N", help="searches of each, of which the least time counts (default: 3)")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row for each instance and search."""
    planner("eecbs", {}).prepare()
    for name, robots in ASKED:
        problem = problem_of(options.instances, name, scens(options.instances, name, robots)[0], robots)
        for kind, search in (("space-time A*", focal), ("SIPP", earliest), ("LNS", lns)) if problem is not None else ():
            count, seconds = min((search(problem) for _ in range(options.times)), key=lambda m: m[1] / m[0])
            yield {"map": name, "robots": robots, "search": kind, "expansions": count, "ns_each": 1e9 * seconds / count}


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
