"""Priority-based search in a window of unit steps, by the stops that robots have ahead: rolling-horizon collision resolution.

Source: Li, Tinka, Kiesel, Durham, Kumar, Koenig, "Lifelong multi-agent path finding in large-scale warehouses", AAAI 2021.
"""

from time import process_time

import numpy as np

from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.planning.answers import used_up, without_effort
from mrp_sumo.search.distance import distances
from mrp_sumo.traffic.clashes import clashes_of
from planners.safe_interval import _window_tree as tree_kernels
from planners.safe_interval._window_way import WindowTask, room_for

CHANCE = 43  # purpose of the stream of chance
NODES_AT_ONCE = 20  # until the clock is read
POLISH_LABELS = 2000  # a robot
AT_A_TIME = 6  # robots planned again
MOST_STEPS = 1000


def plan_window(problem: Problem, time_limit_s: float, most_nodes: int) -> PlanResult:
    """The plan of a problem with a window; GAVE_UP where the tree is searched or has that many nodes."""
    began = process_time()
    if problem.window_steps > MOST_STEPS:
        raise PlanError(f"pbs plans in windows of at most {MOST_STEPS} steps, found {problem.window_steps}")
    task = task_of(problem)
    least = np.array([_least(task, r) for r in range(problem.num_robots)], np.int64)
    room = room_for(task)
    tree = tree_kernels.room_for_tree(problem.num_robots, problem.graph.num_vertices, problem.window_steps)
    code = tree_kernels.UNDER_WAY if tree_kernels.plant(task, room, tree) else tree_kernels.NO_PLAN
    while code == tree_kernels.UNDER_WAY and tree.count[1] < most_nodes:
        if process_time() - began > time_limit_s:
            return PlanResult(Status.TIMED_OUT, planning_time_s=process_time() - began, message=f"no plan within {time_limit_s:g} s")
        if used_up(problem, float(room.count[1])):
            return without_effort(problem, began, float(least.sum()), nodes=float(tree.count[1]))
        code = tree_kernels.search(task, room, tree, NODES_AT_ONCE, problem.effort or np.iinfo(np.int64).max)
    stats = {"nodes": float(tree.count[1]), "labels": float(room.count[1])}
    if code != tree_kernels.SOLVED:
        message = f"no plan among {int(tree.count[1])} orders of priorities"
        return PlanResult(Status.GAVE_UP, planning_time_s=process_time() - began, stats=stats, message=message)
    labels = int(room.count[1]) + POLISH_LABELS * problem.num_robots
    rng = np.random.default_rng([problem.seed, CHANCE])
    first_cost = int(tree.own_cost[0].sum())
    tree_kernels.polish(task, room, tree, least, AT_A_TIME, 1 << 30, min(labels, problem.effort or labels), rng)
    cost = float(tree.own_cost[0].sum())
    return PlanResult(
        Status.SOLVED,
        plan=plan_of_paths(list(tree.own_at[0].astype(np.int64)), problem.step_s),
        planning_time_s=process_time() - began,
        lower_bound_steps=float(least.sum()),
        stats=stats | {"first_solution_cost": float(first_cost), "cost": cost},
    )


def task_of(problem: Problem) -> WindowTask:
    """The problem as kernels see it."""
    graph, known = problem.graph, distances(problem.graph)
    ahead = [[*via, goal] for via, goal in zip(problem.via or [()] * problem.num_robots, problem.target.tolist())]
    stop = np.array([v for stops in ahead for v in stops], np.int64)
    first = np.cumsum([0, *map(len, ahead)]).astype(np.int64)
    steps = known.to_all(stop)
    after = np.zeros(len(stop), np.int64)
    for begin, end in zip(first[:-1].tolist(), first[1:].tolist()):
        for k in range(end - 2, begin - 1, -1):
            after[k] = after[k + 1] + steps[k + 1, stop[k]]
    return WindowTask(
        graph.first, graph.head, graph.tail, clashes_of(problem), problem.start, first, stop, steps, after, problem.window_steps
    )


def _least(task: WindowTask, robot: int) -> int:
    row = task.stop_first[robot]
    return int(task.steps[row, task.start[robot]]) + int(task.after[row])
