"""Small worlds for execution tests: a graph by hand, paths by hand, driven in SUMO."""

import numpy as np
from scipy.spatial.distance import pdist

from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.core.graph import PlanGraph, nav_graph
from mrp_sumo.core.plan import plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.engines.sumo.network import build_network

BURGER = RobotType("burger", 0.138, 0.178, 0.22, 2.5, 2.5, 2.84, 0.1)
CELL_M = 0.4


def graph_of(xy, pairs, cell_m=CELL_M, one_way=()):
    """Two-way lanes between pairs, and one-way lanes."""
    lanes = [lane for a, b in pairs for lane in ((a, b), (b, a))] + list(one_way)
    nav = nav_graph(name="world", xy=xy, lanes=lanes)
    return PlanGraph(**vars(nav), kind="roadmap", cell_m=cell_m, vertex_of_station=np.arange(nav.num_vertices))


def line(n, cell_m=CELL_M):
    """Vertices 0 to n - 1 in a row."""
    return graph_of([(i * cell_m, 0) for i in range(n)], [(i, i + 1) for i in range(n - 1)], cell_m)


def cross(arm=3, cell_m=CELL_M):
    """Vertex 0 in the middle; arms east, north, west, south with vertices 1.., arm + 1.., and so on, outwards."""
    xy, pairs = [(0.0, 0.0)], []
    for dx, dy in ((1, 0), (0, 1), (-1, 0), (0, -1)):
        for k in range(1, arm + 1):
            pairs.append((0 if k == 1 else len(xy) - 1, len(xy)))
            xy.append((dx * k * cell_m, dy * k * cell_m))
    return graph_of(xy, pairs, cell_m)


def square_grid(n, cell_m=CELL_M):
    """Vertex y * n + x."""
    index = np.arange(n * n).reshape(n, n)
    pairs = [*zip(index[:, :-1].flat, index[:, 1:].flat), *zip(index[:-1].flat, index[1:].flat)]
    return graph_of([(x * cell_m, y * cell_m) for y in range(n) for x in range(n)], pairs, cell_m)


def problem_of(graph, paths, robot=BURGER, step_s=3.0):
    """Robots from the first to the last vertices of paths, and the plan of these paths."""
    start, goal = (np.array([p[k] for p in paths]) for k in (0, -1))
    problem = Problem(graph, fleet_of(robot, len(paths)), start, goal, np.arange(len(paths)), step_s)
    return problem, plan_of_paths(paths, step_s)


def drive(tmp_path, graph, paths, policy="adg", robot=BURGER, step_s=3.0, **settings):
    """Execute the paths."""
    problem, plan = problem_of(graph, paths, robot, step_s)
    network = build_network(graph, tmp_path / "world.net.xml")
    return simulate(problem, plan, ExecutionSettings(**{"policy": policy, "time_limit_s": 120.0, **settings}), network)


def least_distance_m(execution):
    """The least distance of two robots' centres over all samples."""
    both = np.stack([execution.x_m, execution.y_m], -1)
    return min(float(pdist(frame).min(initial=np.inf)) for frame in both)


def kinds(execution):
    """Events by kind: robots, in order of time."""
    found = {}
    for event in execution.events:
        found.setdefault(event.kind, []).append(event.robot)
    return found
