"""Mutated plans in seconds, judged by the referee in seconds, and by linear programs with sampled footprints.

A plan of a planner of ours, retimed, is mutated: stays get longer or shorter, single visits earlier or later, runs slower or faster,
turns at goals shorter.
Whether a robot can drive its runs is a linear program: speeds on a fine grid of time, bounded in value and change, such that every
lane is as long as it is, but for the least error that does. The motion that is farthest along in sum is a second program, and is
sampled: circles, and rectangles with shapely, another author's geometry. No motion is the farthest along at every moment (who hurries
to a visit passes it slowly), so where the referee says that two are too close, a third program has both as far along as they can be then.
Verdicts within a small band around a bound are left alone: there the two differ by how finely they look.
"""

import json
import random
from dataclasses import replace
from functools import cache, lru_cache
from itertools import combinations, pairwise
from pathlib import Path

import numpy as np
import shapely
from campaigns.driver import Trial
from scipy.optimize import linprog

from mrp_sumo.core.fleet import Fleet, fleet_of
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.errors import PlanError
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.metrics.referee_in_seconds import CLOSE_M, Meeting, describe_meeting, judge_in_seconds
from mrp_sumo.planning.registry import planner

WORLDS = 400  # planned once; mutated many times
STEP_S = 0.1
GRID_S = 0.05  # of the linear programs
SAMPLE_S = 0.02
BAND_M, BAND_S = 0.02, 0.02  # of distances that nobody is blamed for, and as much again for each m/s
ARRIVES_M = 0.003
TYPES = (
    RobotType("small", 0.3, 0.2, 0.8, 0.6, 0.9, 1.2, 0.05),
    RobotType("heavy", 0.6, 0.6, 1.0, 0.5, 0.5, 1.5, 0.1),
    RobotType("quick", 0.2, 0.2, 2.0, 2.0, 2.5, 3.0, 0.05),
)

LESSER_RAD = 0.2  # bends that are driven through

Visits = list[tuple[int, float, float]]  # vertex, arrival and departure in s


class RefereeInSeconds:
    """One mutated plan a trial."""

    size = None

    def __init__(self, seed: int) -> None:
        self._seed = seed

    def trial(self, number: int, folder: Path) -> Trial:
        chance = random.Random(f"{self._seed} {number}")
        problem, params, last_turn_s = world(chance.randrange(WORLDS))
        ways = [list(route) for route in params]
        for _ in range(chance.choice((0, 1, 1, 2, 3, 4))):
            chance.choice(MUTATIONS)(ways, chance)
        turn_s = [each * chance.choice((1.0, 1.0, 1.0, 0.0, chance.uniform(0.7, 1.2))) for each in last_turn_s]
        plan = plan_of(ways)
        plan = replace(plan, turned_s=plan.end_s + turn_s)
        verdict = judge_in_seconds(problem, plan, STEP_S)
        motions = [motion(problem, robot, tuple(route)) for robot, route in enumerate(ways)]
        of_turns = [fault for fault in verdict.faults if "turned there" in fault]
        of_times = tuple(fault for fault in verdict.faults if fault not in of_turns)
        faults = [*wrong_times(problem, of_times, motions), *wrong_distances(problem, verdict.meetings, motions, ways)]
        faults += wrong_last_turns(problem, of_turns, ways, turn_s)
        if faults:
            (folder / "plan.json").write_text(json.dumps([ways, turn_s], indent=1))
        ended = "impossible times" if verdict.faults else "too close" if verdict.meetings else "drivable"
        command = f"python tools/campaign.py referee_in_seconds --seed {self._seed}  # trial {number}; plan.json has the visits"
        return Trial(problem.graph.name, ended, tuple(faults), command)


@cache
def world(which: int) -> tuple[Problem, tuple[tuple[tuple[int, float, float], ...], ...], tuple[float, ...]]:
    """A small grid with obstacles, the visits of a retimed plan, and how long its last turns take; the next one where there is none."""
    rng = np.random.default_rng([which, 83])
    robot = TYPES[int(rng.integers(len(TYPES)))]
    free = rng.random((int(rng.integers(3, 7)), int(rng.integers(3, 7)))) < 0.9
    free[0, :2] = True
    cell_m = float(fleet_of(robot, 1).separation_m * rng.uniform(1.02, 1.9))  # nobody can wait between two vertices
    graph = grid_graph(free, cell_m, (0.0, 0.0), name=robot.name)
    served = np.unique(graph.tail)
    num = min(int(rng.integers(2, 9)), len(served))
    start, goal = rng.permutation(served)[:num], rng.permutation(served)[:num]
    problem = Problem(graph, fleet_of(robot, num), start, goal, np.arange(num), 3.0, seed=which)
    if which % 2:
        headings = np.random.default_rng([which, 84]).choice([np.nan, 0.0, np.pi / 2, np.pi, -np.pi / 2, 0.7], (2, num))
        problem = replace(problem, start_heading_rad=headings[0], goal_heading_rad=headings[1])
    plan = planner(str(rng.choice(["prioritised", "lacam"])), {}).plan(problem, 2.0).plan
    try:
        if plan is None:
            raise PlanError("no plan")
        plan = retime(problem, plan, ExecutionSettings(step_length_s=STEP_S))
    except PlanError:
        return world(which + WORLDS)
    columns = list(zip(plan.vertex.tolist(), plan.arrive_s.tolist(), plan.depart_s.tolist()))
    last_turn_s = plan.end_s - plan.arrive_s[plan.first[1:] - 1]
    return problem, tuple(tuple(columns[a:b]) for a, b in pairwise(plan.first.tolist())), tuple(last_turn_s.tolist())


def plan_of(ways: list[Visits]) -> Plan:
    first = np.cumsum([0, *map(len, ways)])
    vertex, arrive, depart = (np.array(column) for column in zip(*(visit for route in ways for visit in route)))
    return Plan(first, vertex.astype(np.int64), arrive.astype(np.float64), depart.astype(np.float64))


def later(route: Visits, k: int, by_s: float) -> None:
    """Leave a visit later, and make all others after it later."""
    v, arrive, depart = route[k]
    route[k] = (v, arrive, max(arrive, depart + by_s))
    by_s = route[k][2] - depart
    route[k + 1 :] = [(v, a + by_s, d + by_s) for v, a, d in route[k + 1 :]]


def _stays(route: Visits) -> list[int]:
    return [k for k, (_, a, d) in enumerate(route[:-1]) if d > a or k == 0]


def _longer(ways: list[Visits], chance: random.Random) -> None:
    route = chance.choice(ways)
    if stays := _stays(route):
        later(route, chance.choice(stays), chance.choice((0.3, 1.0, 3.0, 10.0)) * chance.random())


def _shorter(ways: list[Visits], chance: random.Random) -> None:
    route = chance.choice(ways)
    if stays := _stays(route):
        later(route, chance.choice(stays), -chance.choice((0.3, 1.0, 3.0, 10.0)) * chance.random())


def _one_visit(ways: list[Visits], chance: random.Random) -> None:
    route = chance.choice(ways)
    if len(route) > 1:
        k, by_s = chance.randrange(1, len(route)), chance.choice((0.1, 0.3, 1.0)) * chance.uniform(-1, 1)
        v, a, d = route[k]
        route[k] = (v, a + by_s, max(d, a + by_s) if d > a else a + by_s)


def _slower_from(ways: list[Visits], chance: random.Random) -> None:
    """What comes after a visit takes longer, without a stay."""
    route = chance.choice(ways)
    if len(route) > 1:
        k, by_s = chance.randrange(1, len(route)), chance.choice((0.3, 1.0, 3.0, 10.0)) * chance.random()
        route[k:] = [(v, a + by_s, d + by_s) for v, a, d in route[k:]]


def _other_pace(ways: list[Visits], chance: random.Random) -> None:
    route, factor = chance.choice(ways), chance.uniform(0.93, 1.2)
    route[:] = [(v, a * factor, d * factor) for v, a, d in route]


MUTATIONS = (_longer, _longer, _shorter, _shorter, _one_visit, _slower_from, _slower_from, _other_pace)


class Motion:
    """How one robot drives, sampled; `error_m` is the least by which lanes have to be longer or shorter for it."""

    def __init__(self, error_m: float, slack_m: float, t_s: np.ndarray, xy: np.ndarray, yaw: np.ndarray) -> None:
        self.error_m, self.slack_m, self.t_s, self.xy, self.yaw = error_m, slack_m, t_s, xy, yaw


@lru_cache(maxsize=4096)
def motion(
    problem: Problem, robot: int, route: tuple[tuple[int, float, float], ...], time_s: float | None = None, *, loose: bool = False
) -> Motion:
    """By linear programs, run by run; as far along as it can be at a moment, or in sum; `loose`: with all that the referee grants."""
    fleet, graph = problem.fleet, problem.graph
    top, accel, decel = (float(x[robot]) for x in (fleet.max_speed_mps, fleet.accel_mps2, fleet.decel_mps2))
    xy = graph.xy[[v for v, _, _ in route]]
    along = np.diff(xy, axis=0)
    heading = headings_of(problem, robot, xy)  # before each visit, and after the first of them on the next lane
    bend = [*np.abs((np.diff(heading) + np.pi) % (2 * np.pi) - np.pi).tolist(), 0.0]
    turn_s = [b / float(fleet.turn_rate_rad_s[robot]) if b > LESSER_RAD else 0.0 for b in bend]
    leave = [max(d, a + t) for (_, a, d), t in zip(route, turn_s)]
    stops = [k for k, ((_, a, d), t) in enumerate(zip(route, turn_s)) if k == 0 or d > a + 1e-6 or t > 0]
    slack = ARRIVES_M + (min(accel * STEP_S, top) + min(decel * STEP_S, top)) * STEP_S / 8
    at_rest = decel * STEP_S + np.sqrt(2 * decel * ARRIVES_M)
    times, places, yaws = [0.0], [xy[0]], [heading[0]]
    worst = 0.0
    for a, b in pairwise(stops):
        begin = leave[a] - STEP_S / 2
        passes = [route[k][1] for k in range(a + 1, b + 1)]
        lengths = np.hypot(*along[a:b].T)
        since = time_s - begin if time_s is not None and begin < time_s < passes[-1] else None
        error, t, s = run(tuple(p - begin for p in passes), tuple(lengths.tolist()), top, accel, decel, at_rest, slack, since, loose)
        worst = max(worst, error)
        if not np.isfinite(error):
            break
        turned = np.linspace(route[a][1], route[a][1] + turn_s[a], 12) if turn_s[a] else []
        for share, time_s in enumerate(turned):
            swing = (heading[a + 1] - heading[a] + np.pi) % (2 * np.pi) - np.pi
            times, places, yaws = [*times, float(time_s)], [*places, xy[a]], [*yaws, heading[a] + swing * share / 11]
        lane = np.minimum(np.searchsorted(np.cumsum(lengths), s, side="right"), len(lengths) - 1)
        on = s - np.append(0.0, np.cumsum(lengths))[lane]
        times += (begin + t).tolist()
        places += list(xy[a + lane] + (on / lengths[lane])[:, None] * along[a + lane])
        yaws += heading[a + 1 + lane].tolist()
    return Motion(worst, slack, np.array(times), np.array(places), np.array(yaws))


@lru_cache(maxsize=65536)
def run(
    passes: tuple[float, ...],
    lengths: tuple[float, ...],
    top: float,
    accel: float,
    decel: float,
    at_rest: float,
    slack: float,
    farthest_at: float | None,
    loose: bool,
) -> tuple[float, np.ndarray, np.ndarray]:
    """(least error of a lane, moments, places) of a run from rest, with visits at these moments; farthest at one, or in sum."""
    nothing = np.zeros(0)
    if min(np.diff(passes, prepend=0.0)) <= 0:
        return np.inf, nothing, nothing
    end = passes[-1]
    n = int(np.ceil(end / GRID_S))
    t = np.linspace(0.0, end, n + 1)
    h = end / n
    moments = np.array([0.0, *passes] if farthest_at is None else [0.0, *passes, farthest_at])
    cell = np.minimum((moments / h).astype(int), n - 1)
    since = moments - cell * h
    # place at a moment: trapezoids of the cells before, and a part of the one it is in, as sums of speeds [n + 1]
    weight = np.zeros((len(moments), n + 1))
    for k, (i, x) in enumerate(zip(cell, since)):
        weight[k, :i] += h / 2
        weight[k, 1 : i + 1] += h / 2
        weight[k, i] += x - x * x / (2 * h)
        weight[k, i + 1] += x * x / (2 * h)
    weight, farthest = weight[: len(passes) + 1], weight[len(passes) + 1 :]
    lanes = np.diff(weight, axis=0)
    rows = np.arange(n)
    change = np.zeros((n, n + 1))
    change[rows, rows], change[rows, rows + 1] = -1.0, 1.0
    none = np.zeros((n, 1))
    less = np.block([[change, none], [-change, none], [lanes, -np.ones((len(lengths), 1))], [-lanes, -np.ones((len(lengths), 1))]])
    bound = np.concatenate([np.full(n, accel * h), np.full(n, decel * h), lengths, [-x for x in lengths]])
    bounds = [(0.0, 0.0), *[(0.0, top)] * (n - 1), (0.0, min(top, at_rest)), (0.0, None)]
    result = linprog(np.append(np.zeros(n + 1), 1.0), A_ub=less, b_ub=bound, bounds=bounds)
    if not result.success:
        return np.inf, nothing, nothing
    error = float(result.fun)
    if error > slack:
        return error, nothing, nothing
    bounds[-1] = (0.0, slack if loose else error + 1e-5)
    sums = np.concatenate([np.cumsum(np.ones(n + 1)[::-1])[::-1], [0.0]])  # of all places, about
    aim = sums if farthest_at is None else np.append(farthest[0], 0.0)
    result = linprog(-aim, A_ub=less, b_ub=bound, bounds=bounds)
    if not result.success:
        return np.inf, nothing, nothing
    v = result.x[:-1]
    driven = np.append(0.0, np.cumsum((v[1:] + v[:-1]) / 2 * h))
    at = weight @ v  # stretched so that every visit is where it shall be
    return error, t, np.interp(driven, at, np.append(0.0, np.cumsum(lengths)))


def headings_of(problem: Problem, robot: int, xy: np.ndarray) -> np.ndarray:
    """[N] in which a robot comes to each visit: to the first as its start says, or as it goes on."""
    along = np.diff(xy, axis=0)
    heading = np.arctan2(along[:, 1], along[:, 0])
    at_start = float(problem.heading_at_start[robot])
    if np.isnan(at_start):
        at_start = float(heading[0]) if len(heading) else 0.0
    return np.append(at_start, heading)


def wrong_last_turns(problem: Problem, faults: list[str], ways: list[Visits], turn_s: list[float]) -> list[str]:
    result = []
    for robot, (name, route) in enumerate(zip(problem.fleet.robot_name, ways)):
        wanted, heading = float(problem.heading_at_target[robot]), headings_of(problem, robot, problem.graph.xy[[v for v, _, _ in route]])
        if np.isnan(wanted) or (len(route) == 1 and np.isnan(problem.heading_at_start[robot])):
            need_s = 0.0
        else:
            came = (
                heading[-2:] if len(route) > 1 and abs(np.angle(np.exp(1j * np.diff(heading[-2:])))).max() <= LESSER_RAD else heading[-1:]
            )
            need_s = float(np.abs(np.angle(np.exp(1j * (wanted - came)))).min()) / float(problem.fleet.turn_rate_rad_s[robot])
        said = any(fault.startswith(f"{name} ") for fault in faults)
        if abs(turn_s[robot] - need_s) > 0.01 and said != (turn_s[robot] < need_s):
            result.append(f"{name} turns at its goal in {turn_s[robot]:.3f} s and needs {need_s:.3f} s, and the referee says {faults}")
    return result


def wrong_times(problem: Problem, faults: tuple[str, ...], motions: list[Motion]) -> list[str]:
    result = []
    for name, motion in zip(problem.fleet.robot_name, motions):
        said = [fault for fault in faults if fault.startswith(f"{name} ")]
        if said and motion.error_m < motion.slack_m - 1e-3:
            result.append(f"the referee says '{said[0]}', but lanes are wrong by {motion.error_m:.4f} m only")
        if not said and motion.error_m > motion.slack_m + 1e-3:
            result.append(
                f"the referee has nothing against the times of {name}, but lanes would have to be {motion.error_m:.4f} m longer or shorter"
            )
    return result


def wrong_distances(problem: Problem, meetings: tuple[Meeting, ...], motions: list[Motion], ways: list[Visits]) -> list[str]:
    end = max((float(m.t_s[-1]) for m in motions), default=0.0) + 0.5
    t = np.arange(0.0, end, SAMPLE_S)
    xy = [np.stack([np.interp(t, m.t_s, m.xy[:, axis]) for axis in (0, 1)], 1) for m in motions]
    yaw = [np.interp(t, m.t_s, np.unwrap(m.yaw)) for m in motions]
    fleet, result = problem.fleet, []
    apart = float(fleet.separation_m) - CLOSE_M
    band = BAND_M + BAND_S * float(fleet.max_speed_mps.max())
    said = {(m.robot, m.other): m for m in reversed(meetings)}
    for i, j in combinations(range(len(motions)), 2):
        if max(motions[i].error_m - motions[i].slack_m, motions[j].error_m - motions[j].slack_m) > -1e-3:
            continue  # who cannot drive his times is nowhere
        distance = np.hypot(*(xy[i] - xy[j]).T)
        least, k = float(distance.min()), int(distance.argmin())
        if (i, j) in said and least > apart + band and (then := distance_at(problem, said[i, j], ways)) > apart + band:
            result.append(f"{describe_meeting(said[i, j], problem)}; sampled, they stay {least:.3f} m apart, {then:.3f} m then")
        if (i, j) not in said and least < apart - band and not apart_if_loose(problem, (i, j), ways, t, apart - band):
            result.append(f"robots {i} and {j} come {least:.3f} m close at {t[k]:.2f} s, and the referee says nothing")
        near = np.flatnonzero(distance < 2 * float(fleet.radius_m[0]))
        if len(near) and (i, j) not in said:
            shapes = [footprints(fleet, r, xy[r][near], yaw[r][near]) for r in (i, j)]
            if shapely.intersects(*shapes).any():
                result.append(f"the footprints of robots {i} and {j} overlap, and the referee says nothing")
    return result


def apart_if_loose(problem: Problem, robots: tuple[int, int], ways: list[Visits], t: np.ndarray, least_m: float) -> bool:
    """Whether two robots keep apart with all that the referee grants: it takes them to be a little farther along."""
    there = [motion(problem, robot, tuple(ways[robot]), loose=True) for robot in robots]
    xy = [np.stack([np.interp(t, m.t_s, m.xy[:, axis]) for axis in (0, 1)], 1) for m in there]
    return bool(np.hypot(*(xy[0] - xy[1]).T).min() >= least_m)


def distance_at(problem: Problem, meeting: Meeting, ways: list[Visits]) -> float:
    """How far apart two robots are at the moment of a meeting when both are as far along as they can be then."""
    there = []
    for robot in (meeting.robot, meeting.other):
        farthest = motion(problem, robot, tuple(ways[robot]), meeting.t_s)
        there.append([float(np.interp(meeting.t_s, farthest.t_s, farthest.xy[:, axis])) for axis in (0, 1)])
    return float(np.hypot(*np.subtract(*there)))


def footprints(fleet: Fleet, robot: int, xy: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    corner = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * (fleet.length_m[robot] / 2, fleet.width_m[robot] / 2)
    cos, sin = np.cos(yaw)[:, None], np.sin(yaw)[:, None]
    x = xy[:, :1] + corner[:, 0] * cos - corner[:, 1] * sin
    y = xy[:, 1:] + corner[:, 0] * sin + corner[:, 1] * cos
    return shapely.polygons(np.stack([x, y], 2))
