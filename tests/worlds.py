"""Small worlds, where the answer is known by hand: graphs, paths driven in SUMO, and records of runs that were never driven."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from scipy.spatial.distance import pdist

from mrp_sumo.core.execution import Event, Execution, Outcome
from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.engines.sumo.network import build_network
from mrp_sumo.experiments.result import RunResult
from mrp_sumo.experiments.solve import Solution
from mrp_sumo.io.record import RunRecord
from mrp_sumo.io.scenario.model import ScenarioModel
from mrp_sumo.maps.costmap import Costmap
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.maps.lifts import with_rides
from mrp_sumo.maps.roadmap import cut_lanes
from mrp_sumo.traffic.draw import uniform_draw
from mrp_sumo.traffic.referee import judge

BURGER = RobotType("burger", 0.138, 0.178, 0.22, 2.5, 2.5, 2.84, 0.1)
CELL_M = 0.4
CART = RobotType("cart", 0.6, 0.4, max_speed_mps=1.0, accel_mps2=1.0, decel_mps2=1.0, turn_rate_rad_s=1.0)
POINT = RobotType("point", 0.2, 0.2, 1.0, 1.0, 1.0, 1.0)
SQUARE = RobotType("square", 0.3, 0.3, 1.0, 1.0, 1.0, 1.0)
SMALL_CART = RobotType("cart", 0.4, 0.3, 1.0, 1.0, 1.0, 2.0)
LENGTH = 8  # cells of 1 m in a corridor
NASTY = "</script><img src=x onerror=alert(1)> & \u2028 'ö'"


def graph_of(xy, pairs, cell_m=CELL_M, one_way=()):
    """Two-way lanes between pairs, and one-way lanes."""
    lanes = [lane for a, b in pairs for lane in ((a, b), (b, a))] + list(one_way)
    nav = nav_graph(name="world", xy=xy, lanes=lanes)
    return plan_graph(nav, kind="roadmap", cell_m=cell_m)


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


def two_levels(ride_s=10.0, step_s=3.0, lifts=("goods",)):
    """Vertices 0 to 3 in a row below and 4 to 7 above, 50 m beside them; bays 8 at 1 and 9 at 6. The first lift leads from 3 to 4, a
    second one from 0 to 7.
    """
    xy = [(i * CELL_M, 0) for i in range(4)] + [(50 + i * CELL_M, 0) for i in range(4)] + [(CELL_M, CELL_M), (50 + 2 * CELL_M, CELL_M)]
    pairs = [(a, b) for i, j in ((0, 1), (1, 2), (2, 3), (4, 5), (5, 6), (6, 7), (1, 8), (6, 9)) for a, b in ((i, j), (j, i))]
    rides = [(a, b) for one, other in ((3, 4), (0, 7))[: len(lifts)] for a, b in ((one, other), (other, one))]
    options = [{"lift": name, "ride_s": ride_s, "close_s": 3.0, "open_s": 3.0} for name in lifts for _ in range(2)]
    nav = nav_graph(
        name="levels",
        xy=xy,
        lanes=pairs + rides,
        level_names=("L1", "L2"),
        level=[0] * 4 + [1] * 4 + [0, 1],
        lane_options=[{}] * len(pairs) + options,
    )
    return with_rides(plan_graph(nav, kind="roadmap", cell_m=CELL_M), step_s, BURGER.radius_m, None, {})


def on_a_circle(lanes, num_vertices):
    """Directed lanes of length 1 between vertices on a circle."""
    turn = np.arange(num_vertices) * 2 * np.pi / num_vertices
    nav = nav_graph(name="lanes", xy=np.column_stack([np.cos(turn), np.sin(turn)]), lanes=lanes, length_m=np.ones(len(lanes)))
    return cut_lanes(nav, 1.0)


def corridor(length):
    """Vertices 0 to length - 1, each with a lane to the next and back."""
    return on_a_circle([(a, b) for i in range(length - 1) for a, b in ((i, i + 1), (i + 1, i))], length)


def problem_on(graph, start, goal, seed=0):
    """Robots that are points, each with its goal."""
    return Problem(graph, fleet_of(POINT, len(start)), np.array(start), np.array(goal), np.arange(len(start)), 1.0, seed)


def ending_there(problem, plan):
    """The problem of going where a plan for a window ends."""
    return replace(problem, goal=plan.vertex[plan.first[1:] - 1])


def drawn(picture, *, seed=0):
    """A Problem from a drawing: '.' free, '@' blocked, '0'..'9' starts, 'a'..'j' goals of those robots, at their starts where none."""
    rows = picture.split()
    free = np.array([[c != "@" for c in row] for row in rows])
    number = np.cumsum(free.ravel()).reshape(free.shape) - 1
    places = {c: int(number[y, x]) for y, row in enumerate(rows) for x, c in enumerate(row) if c not in ".@"}
    count = sum(c.isdigit() for c in places)
    return Problem(
        graph=grid_graph(free, 1.0, (0.0, 0.0)),
        fleet=fleet_of(SQUARE, count),
        start=np.array([places[str(r)] for r in range(count)], np.int64),
        goal=np.array([places.get("abcdefghij"[r], places[str(r)]) for r in range(count)], np.int64),
        goal_of=np.arange(count),
        step_s=1.0,
        seed=seed,
    )


def random_grid(size, num_robots, seed, blocked=0.2):
    """A square of cells of which a share is blocked, with starts and goals drawn in one component."""
    free = np.random.default_rng([seed, 99]).random((size, size)) >= blocked
    graph = grid_graph(free, 1.0, (0.0, 0.0))
    return problem_on(graph, *uniform_draw(graph, num_robots, seed), seed)


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
    outcome = {}
    for event in execution.events:
        outcome.setdefault(event.kind, []).append(event.robot)
    return outcome


def record_of_four(seconds=12.0, costmap=True, absent=False):
    """Robots drive along four corridors at 1 m/s; robot_1 is blocked from 3 s to 6 s, robot_3 stays at its start."""
    xy = [(float(x), float(y)) for y in range(4) for x in range(LENGTH)]
    pairs = [(LENGTH * row + i, LENGTH * row + i + 1) for row in range(4) for i in range(LENGTH - 1)]
    names = ["dock <1>", *[""] * (len(xy) - 2), "Tür 9"]
    nav = nav_graph(name="four", xy=xy, lanes=pairs + [(b, a) for a, b in pairs], vertex_name=names)
    graph = plan_graph(nav, kind="grid", cell_m=1.0)
    starts = [0, LENGTH, 2 * LENGTH, 3 * LENGTH]
    ends = [LENGTH - 1, 2 * LENGTH - 1, 3 * LENGTH - 1, 3 * LENGTH]
    plan = plan_of_paths([list(range(a, b + 1)) for a, b in zip(starts, ends)], 1.0)
    t = np.arange(round(seconds * 10) + 1) * 0.1
    held = np.clip(t - 3, 0, 3)
    x = np.stack((np.clip(t, 0, 7), np.clip(t - held, 0, 7), np.clip(t - 0.05, 0, 7), np.zeros(len(t))), 1)
    y = np.broadcast_to([0.0, 1.0, 2.0, 3.0], x.shape).copy()
    speed = np.diff(x, axis=0, prepend=x[:1]) / 0.1
    yaw = np.broadcast_to([0.0, 0.1, 0.0, np.pi / 2], x.shape).copy()
    if absent:
        for column in (x, y, yaw, speed):
            column[:20, 2] = np.nan
    events = (
        Event(0.0, "started", 0, vertex=0),
        Event(3.0, "blocked", 1, vertex=LENGTH + 3, other=2, duration_s=3.0, text="behind 'robot_2' <b>"),
        Event(7.0, "goal", 0, vertex=LENGTH - 1),
    )
    goal_s = np.array([7.0, 10.0, 7.1, 0.0])
    arrived = plan.arrive_s.copy()
    execution = Execution(t, x, y, yaw, speed, arrived, goal_s, Outcome.COMPLETED, "adg", seconds, 0.1, 0.1, events)
    occupied = np.zeros((30, 50), np.bool_)
    occupied[0] = occupied[:, 0] = True
    walls = Costmap((-1.0, -1.5), 0.2, occupied) if costmap else None
    return RunRecord("four", 7, fleet_of(CART, 4), graph, np.array(ends), plan, execution, nav, walls)


def run_of_four(out, network, *, executed=True, **changes):
    record = record_of_four(seconds=3.0)
    problem = Problem(
        graph=record.graph, fleet=record.fleet, start=np.array([0, 8, 16, 24]), goal=record.target, goal_of=np.arange(4), step_s=1.0, seed=7
    )
    network.write_text("<net/>")
    scenario = changes.pop("scenario", None) or ScenarioModel.model_validate(
        {"name": "four", "seed": 7, "map": "four", "robots": {"count": 4}, "execution": {"time_limit_s": 300}}
    )
    setup = SimpleNamespace(scenario=scenario, map=SimpleNamespace(nav=record.nav, building=None, level_shift_m={}))
    result = PlanResult(Status.SOLVED, plan=record.plan) if executed else PlanResult(Status.TIMED_OUT, message="no time")
    params = {
        "status": "completed",
        "note": "",
        "execution": record.execution if executed else None,
        "audit": {"passed": True} if executed else None,
        "metrics": {"min_distance_m": np.float64(1.5), "real_time_factor": float("inf"), "time_blocked_s": [0.0, 1.0], "flag": np.True_},
    }
    solution = Solution(setup, problem, result, judge(problem, record.plan) if executed else None, 0.0)
    run = RunResult(setup=setup, solution=solution, **{**params, **changes})
    vars(run)["costmap"] = record.costmap  # of no building
    run.write(out, SimpleNamespace(network=lambda graph: network))
    return json.loads((out / "result.json").read_text())


def record_of_two(names=("a", "b"), num_samples=41):
    """Robot 0 drives three cells to the right in 3 s; robot 1 waits above it for 2 s, drives a cell up, and is gone at the end."""
    graph = grid_graph(np.ones((3, 4), bool), 1.0, (0.0, 0.0), name="floor")
    fleet = replace(fleet_of(SMALL_CART, 2), robot_name=tuple(names))
    plan = plan_of_paths([[0, 1, 2, 3], [4, 4, 4, 8]], 1.0)
    t = np.arange(num_samples) * 0.1
    x = np.column_stack((0.5 + np.minimum(t, 3), np.full(num_samples, 0.5)))
    y = np.column_stack((np.full(num_samples, 0.5), 1.5 + np.clip(t - 2, 0, 1)))
    yaw = np.column_stack((np.zeros(num_samples), np.full(num_samples, np.pi / 2)))
    x[-1, 1] = np.nan
    speed = np.vstack([np.diff(x, axis=0)[:1], np.diff(x, axis=0)]) * 10 + np.vstack([np.diff(y, axis=0)[:1], np.diff(y, axis=0)]) * 10
    events = (Event(0.0, "blocked", 1, 8, 0, 1.0, f"because of {names[0]}"), Event(3.0, "goal", 0, 3))
    arrived = np.array([0.0, 1, 2, 3, 0, 3])
    execution = Execution(t, x, y, yaw, speed, arrived, np.array([3.0, np.nan]), Outcome.TIME_LIMIT, "adg", 4.0, 1.0, 1.0, events)
    return RunRecord("trial", 0, fleet, graph, plan.last_vertex, plan, execution)
