"""Mutated plans, in steps and in continuous time, judged by the referee and by sampling footprints with shapely, another author's geometry.

On a grid of 1 m two small footprints overlap at some moment exactly when two robots are at one vertex at one time, or pass each other on
a lane: the nearest that robots come without either is 0.7 m in steps, where one turns off before the one behind it. In continuous
time all moments are multiples of a quarter of a step, and lanes take one to two steps, so that robots meet or stay 0.088 m apart. Faults
(jumps, wrong starts and goals, times that go back) are looked for by a second, plain reading of the rules.
"""

import json
import random
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import shapely
from campaigns.driver import Trial

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.graph import PlanGraph
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.planning.registry import planner
from mrp_sumo.traffic.referee import judge

WORLDS = 400  # planned once; mutated many times
ROBOT = RobotType("small", 0.4, 0.3, 1.0, 1.0, 1.0, 1.0)
STEP_S = 1.0

Visits = list[tuple[int, float, float]]  # vertex, arrival and departure in s


@dataclass(frozen=True)
class Sampling:
    """Footprints and how often they are looked at."""

    length_m: float
    width_m: float
    every_s: float


IN_STEPS, CONTINUOUS = Sampling(0.44, 0.3, 0.25), Sampling(0.05, 0.05, 1 / 32)


class Referee:
    """One mutated plan a trial, by turns in steps and in continuous time."""

    size = None

    def __init__(self, seed: int) -> None:
        self._seed = seed

    def trial(self, number: int, folder: Path) -> Trial:
        chance = random.Random(f"{self._seed} {number}")
        problem, ways = world(chance.randrange(WORLDS))
        ways = [list(route) for route in ways]
        continuous = bool(number % 2)
        for _ in range(chance.choice((0, 1, 1, 2, 4))):
            chance.choice(MUTATIONS)(ways, chance, problem.graph)
        if continuous:
            ways = [at_other_times(route, chance) for route in ways]
        plan = plan_of(ways)
        verdict = judge(problem, plan)
        kind = "continuous" if continuous else "in steps"
        faulty = faults_of(problem, ways)
        if faulty or verdict.faults:
            faults = () if faulty == bool(verdict.faults) else (f"faults: referee {verdict.faults[:2]}, expected {faulty}",)
            ended = "not a plan"
        else:
            result = {}
            for conflict in verdict.conflicts:
                result.setdefault((conflict.robot, conflict.other), (conflict.t_s, conflict.kind))
            seen = overlaps(problem.graph, ways, CONTINUOUS if continuous else IN_STEPS)
            faults = tuple(
                f"robots {a} and {b}: referee {result.get((a, b))}, footprints {seen.get((a, b))}"
                for a, b in sorted(result.keys() ^ seen.keys())
            )
            faults += tuple(
                f"robots {pair}: referee {result[pair]}, footprints {seen[pair]}: more than a lane apart"
                for pair in result.keys() & seen.keys()
                if abs(result[pair][0] - seen[pair]) > 2 * STEP_S
            )
            ended = "conflicts" if seen else "valid"
        if faults:
            (folder / "plan.json").write_text(json.dumps({"world": [problem.graph.num_vertices], "visits": ways}, indent=1))
        return Trial(
            kind, ended, faults, f"python tools/campaign.py referee --seed {self._seed}  # trial {number}; plan.json has the visits"
        )


@cache
def world(which: int) -> tuple[Problem, tuple[tuple[tuple[int, float, float], ...], ...]]:
    """A small grid with obstacles, and a plan that a planner made; random walks where it finds none."""
    rng = np.random.default_rng([which, 79])
    free = rng.random((int(rng.integers(3, 8)), int(rng.integers(3, 8)))) < 0.85
    free[0, :2] = True
    graph = grid_graph(free, 1.0, (0.0, 0.0))
    served = np.unique(graph.tail)
    num = min(int(rng.integers(2, 9)), len(served))
    start, goal = rng.permutation(served)[:num], rng.permutation(served)[:num]
    problem = Problem(graph, fleet_of(ROBOT, num), start, goal, np.arange(num), STEP_S, seed=which)
    plan = planner(str(rng.choice(["prioritised", "lacam", "astar"])), {}).plan(problem, 2.0).plan
    if plan is not None:
        columns = list(zip(plan.vertex.tolist(), plan.arrive_s.tolist(), plan.depart_s.tolist()))
        return problem, tuple(tuple(columns[a:b]) for a, b in pairwise(plan.first.tolist()))
    chance = random.Random(which)
    paths = [walk(graph, int(v), chance.randint(0, 12), chance) for v in start]
    problem = Problem(graph, fleet_of(ROBOT, num), start, np.array([path[-1] for path in paths]), np.arange(num), STEP_S, seed=which)
    return problem, tuple(tuple(timed(path)) for path in paths)


def walk(graph: PlanGraph, vertex: int, steps: int, chance: random.Random) -> list[int]:
    path = [vertex]
    for _ in range(steps):
        path.append(chance.choice([path[-1], *graph.head[graph.tail == path[-1]].tolist()]))
    return path


def timed(path: list[int]) -> Visits:
    """Visits of a path in steps; staying is one visit."""
    visits: Visits = []
    for t, vertex in enumerate(path):
        if visits and visits[-1][0] == vertex:
            visits[-1] = (vertex, visits[-1][1], t * STEP_S)
        else:
            visits.append((vertex, t * STEP_S, t * STEP_S))
    return [*visits[:-1], (visits[-1][0], visits[-1][1], np.inf)]


def plan_of(ways: list[Visits]) -> Plan:
    first = np.cumsum([0, *map(len, ways)])
    vertex, arrive, depart = (np.array(column) for column in zip(*(visit for route in ways for visit in route)))
    return Plan(first, vertex.astype(np.int64), arrive.astype(np.float64), depart.astype(np.float64))


def later(route: Visits, since: int, by_s: float) -> None:
    """Stay longer at a visit."""
    v, arrive, depart = route[since]
    route[since] = (v, arrive, depart + by_s)
    route[since + 1 :] = [(v, a + by_s, d + by_s) for v, a, d in route[since + 1 :]]


def _wait(ways: list[Visits], chance: random.Random, graph: PlanGraph) -> None:
    route = chance.choice(ways)
    later(route, chance.randrange(len(route)), chance.randint(1, 3) * STEP_S)


def _hurry(ways: list[Visits], chance: random.Random, graph: PlanGraph) -> None:
    """Wait less somewhere; too little, now and then."""
    route = chance.choice(ways)
    waits = [k for k, (_, a, d) in enumerate(route[:-1]) if d > a] or [0]
    later(route, chance.choice(waits), -STEP_S)


def _elsewhere(ways: list[Visits], chance: random.Random, graph: PlanGraph) -> None:
    route = chance.choice(ways)
    k = chance.randrange(len(route))
    route[k] = (chance.randrange(graph.num_vertices), *route[k][1:])


def _other_corner(ways: list[Visits], chance: random.Random, graph: PlanGraph) -> None:
    """Another vertex between the ones before and after."""
    route = chance.choice(ways)
    if len(route) < 3:
        return
    k = chance.randrange(1, len(route) - 1)
    after = set(graph.head[graph.tail == route[k - 1][0]].tolist())
    before = set(graph.tail[graph.head == route[k + 1][0]].tolist())
    if between := sorted(after & before):
        route[k] = (chance.choice(between), *route[k][1:])


def _backwards(ways: list[Visits], chance: random.Random, graph: PlanGraph) -> None:
    """There and back again, on the way."""
    route = chance.choice(ways)
    if len(route) < 2:
        return
    k = chance.randrange(1, len(route))
    u, (v, arrive, _) = route[k - 1][0], route[k]
    route[k:k] = [(v, arrive, arrive), (u, arrive + STEP_S, arrive + STEP_S)]
    route[k + 2 :] = [(w, a + 2 * STEP_S, d + 2 * STEP_S) for w, a, d in route[k + 2 :]]


def _cut_short(ways: list[Visits], chance: random.Random, graph: PlanGraph) -> None:
    route = chance.choice(ways)
    del route[chance.randrange(1, len(route) + 1) :]
    route[-1] = (*route[-1][:2], np.inf)


def _left_out(ways: list[Visits], chance: random.Random, graph: PlanGraph) -> None:
    route = chance.choice(ways)
    if len(route) > 1:
        del route[chance.randrange(len(route) - 1)]


def _swapped(ways: list[Visits], chance: random.Random, graph: PlanGraph) -> None:
    """Two robots drive each other's way; their starts are wrong then."""
    a, b = chance.randrange(len(ways)), chance.randrange(len(ways))
    ways[a], ways[b] = ways[b], ways[a]


MUTATIONS = (
    _wait,
    _wait,
    _wait,
    _hurry,
    _hurry,
    _elsewhere,
    _other_corner,
    _other_corner,
    _backwards,
    _backwards,
    _cut_short,
    _left_out,
    _swapped,
)


def at_other_times(route: Visits, chance: random.Random) -> Visits:
    """The same way with slower lanes and longer stays, in quarters of a step."""
    result, by_s = [], 0.0
    for k, (v, arrive, depart) in enumerate(route):
        if k and chance.random() < 0.2:
            by_s += chance.choice((0.5, 1.0)) * STEP_S  # a slower lane
        arrive += by_s
        if chance.random() < 0.2:
            by_s += chance.choice((0.25, 0.5, 0.75)) * STEP_S
        result.append((v, arrive, depart + by_s))
    return result


def faults_of(problem: Problem, ways: list[Visits]) -> bool:
    """Whether this is no plan for the problem, by the rules as they are written."""
    graph = problem.graph
    lanes = set(zip(graph.tail.tolist(), graph.head.tolist()))
    for robot, route in enumerate(ways):
        if route[0][0] != problem.start[robot] or route[-1][0] != problem.goal[problem.goal_of[robot]]:
            return True
        if route[0][1] != 0.0 or route[-1][2] != np.inf:
            return True
        for (u, arrive, depart), (v, then, _) in pairwise(route):
            if (u, v) not in lanes or depart < arrive or then - depart < problem.step_s:
                return True
    return False


def overlaps(graph: PlanGraph, ways: list[Visits], how: Sampling) -> dict[tuple[int, int], float]:
    """When footprints of two robots first overlap, by pair, as far as samples show it."""
    end_s = max(route[-1][1] for route in ways) + 1.0
    t = np.arange(0.0, end_s + how.every_s / 2, how.every_s)
    xy, yaw = np.empty((len(ways), len(t), 2)), np.empty((len(ways), len(t)))
    for robot, route in enumerate(ways):
        vertex = np.array([v for v, _, _ in route])
        times = np.array([m for _, a, d in route for m in (a, min(d, end_s + 1.0))])
        places = np.repeat(graph.xy[vertex], 2, axis=0)
        for axis in (0, 1):
            xy[robot, :, axis] = np.interp(t, times, places[:, axis])
        going = np.diff(graph.xy[vertex], axis=0)
        heading = np.append(0.0, np.arctan2(going[:, 1], going[:, 0]))  # at rest at the start, then as it came
        yaw[robot] = heading[np.searchsorted([d for _, _, d in route[:-1]], t, side="left")]
    corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (how.length_m / 2, how.width_m / 2)
    cos, sin = np.cos(yaw)[..., None], np.sin(yaw)[..., None]
    x = xy[..., 0, None] + cos * corners[:, 0] - sin * corners[:, 1]
    y = xy[..., 1, None] + sin * corners[:, 0] + cos * corners[:, 1]
    shapes = shapely.polygons(np.stack((x, y), -1).reshape(-1, 4, 2)).reshape(len(ways), len(t))
    result = {}
    for a in range(len(ways)):
        for b in range(a + 1, len(ways)):
            near = np.flatnonzero(np.abs(xy[a] - xy[b]).max(-1) < how.length_m + how.width_m)  # no others can touch
            hit = near[shapely.intersects(shapes[a, near], shapes[b, near])]
            if len(hit):
                result[a, b] = float(t[hit[0]])
    return result
