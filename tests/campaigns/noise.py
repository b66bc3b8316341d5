"""Thousands of disturbed executions on all maps, by all policies and recoveries, each judged by an audit of its own and by the program's.

Everything about a run is drawn from its number: the world (bundled maps, each as a grid and as a roadmap; generated warehouses and
roads; racks with narrow aisles; tangles of lanes with acute angles and crossings; or, as buildings, all levels of a map with
its lifts and doors), robots, policy, step length, disturbances and what is done about deadlocks. The audit of its own follows footprints
with shapely, another author's geometry, and knows nothing of ours: they overlap nobody and no wall of the building (lanes without room are
left out before), vertices are passed in the plan's order where a policy keeps it, robots that stand on their goals count as there, and none
stands to the end for no reason.
"""

import collections
import hashlib
import json
import re
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from campaigns.driver import Trial
from scipy.spatial import Delaunay, cKDTree

from mrp_sumo.core.disturbances import Breakdown, ClosedLane, Disturbances, Fire, Obstacle, Outage
from mrp_sumo.core.driving import RecoveryOptions
from mrp_sumo.core.execution import Execution
from mrp_sumo.core.facilities import door_names, lift_names
from mrp_sumo.core.fleet import Fleet, fleet_of, fleet_of_types
from mrp_sumo.core.graph import PlanGraph, nav_graph
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.crowd.floor import floor_of
from mrp_sumo.crowd.model import People, joint_places
from mrp_sumo.drive import replanning
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.policy import policies, policy_of
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.engines.sumo.network import build_network
from mrp_sumo.errors import ExecutionError, MrpSumoError, PlanError
from mrp_sumo.maps.building import Building
from mrp_sumo.maps.catalogue import bundled_maps
from mrp_sumo.maps.clearance import narrow, pruned, standing_walls
from mrp_sumo.maps.doors import with_doors
from mrp_sumo.maps.generate import GENERATORS
from mrp_sumo.maps.grid import grid_graph, paper_grid
from mrp_sumo.maps.lifts import with_rides
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.repair import join_short
from mrp_sumo.maps.roadmap import cut_lanes
from mrp_sumo.metrics.audit import audit
from mrp_sumo.planning.registry import planner

BURGER = RobotType("burger", 0.138, 0.178, 0.22, 2.5, 2.5, 2.84)
BOX = RobotType("box", 0.3, 0.2, 0.8, 0.6, 0.9, 1.2, 0.04)  # brakes harder than it speeds up, tight gap
STEPS_S = (0.1, 0.2, 0.5, 1.0)
LARGEST = 9000  # vertices
SWITCHES = "adg_switch"  # changes the plan's order, which then has no cycles either: nobody is in a deadlock
TIME_LIMIT_S = 150.0
MIXED = 0.3  # of the runs on maps with room for boxes are driven by both types, half of those in the kinematic engine
SHARES = {"bundled": 0.25, "corpus": 0.25, "warehouse": 0.15, "roads": 0.1, "racks": 0.1, "tangle": 0.15}  # of the runs
BUILDINGS = {"building": 1.0}  # the same, of whole buildings
RIDING, MOST_RIDING = 4.0, 20  # times as long as other runs; robots
PEOPLED = 0.4  # of the runs in buildings are among people
CORPUS = Path(__file__).resolve().parents[3] / "shared" / "maps" / "corpus"
TOUCHES = "num_person_touches"  # people come to touch a robot that stands
NOISE = ("speed_spread", "speed_noise", "stops_per_s", "start_delay_s", "delay_probability", "latency_s", "message_loss", "localisation_m")

World = tuple[str, str]  # family, and which of it


def _has_lifts(path: Path) -> bool:
    try:
        return bool(load_map(path).nav.is_ride.any())
    except MrpSumoError:
        return False


def tangle(rng: np.random.Generator) -> PlanGraph:
    """Points in a square, most edges of their Delaunay triangulation, and some long lanes across it."""
    num = int(rng.integers(8, 40))
    xy = rng.uniform(0, 5.0 + 0.1 * num, (num, 2))
    triangles = Delaunay(xy).simplices
    pairs = {tuple(sorted(p)) for t in triangles.tolist() for p in ((t[0], t[1]), (t[1], t[2]), (t[0], t[2]))}
    rest = [p for p in sorted(pairs) if rng.random() < 0.8]
    rest += [tuple(sorted(rng.choice(num, 2, replace=False).tolist())) for _ in range(3)]
    lanes = [lane for a, b in sorted(set(rest)) for lane in (((a, b), (b, a)) if rng.random() < 0.9 else ((a, b),))]
    return cut_lanes(nav_graph(name="tangle", xy=xy, lanes=lanes), float(rng.choice([0.5, 5.0])))


def racks(rng: np.random.Generator) -> PlanGraph:
    """Racks with aisles one cell wide."""
    free = np.ones((int(rng.integers(7, 30)), int(rng.integers(10, 60))), np.bool_)
    for y in range(2, len(free) - 2, 3):
        for x in range(2, free.shape[1] - 5, 6):
            free[y : y + 2, x : x + 5] = False
    return grid_graph(free, float(rng.choice([0.4, 0.5])), (0.0, 0.0), name="racks")


PASSING = {"racks": racks, "tangle": tangle}  # worlds of one run


class Noise:
    """One run a trial."""

    size = None
    shares: Mapping[str, float] = SHARES

    def __init__(self, seed: int) -> None:
        self._scratch = tempfile.TemporaryDirectory(prefix="noise-")
        self._worlds, self._first = Worlds(None, Path(self._scratch.name), self.shares), seed * 10_000_000

    def trial(self, number: int, folder: Path) -> Trial:
        row = one(self._first + number, self._worlds)
        (folder / "run.json").write_text(json.dumps(row, indent=1, default=str))
        wrong = tuple(row.get("wrong", ()))
        return Trial(f"{row['family']}, {row['policy']}", row["ended"], wrong, "cat run.json  # all follows from the number")


class Buildings(Noise):
    """Whole buildings only: all levels of a map, its lifts and its doors."""

    shares = BUILDINGS


class Worlds:
    """Graphs and their networks, made once."""

    def __init__(self, maps: Path | None, scratch: Path, shares: Mapping[str, float] = SHARES) -> None:
        corpus = sorted(maps.rglob("*.building.yaml")) if maps else []
        self._scratch, self._shares = scratch, shares
        bundled = sorted(bundled_maps().values())
        whole = [path for path in [*bundled, *sorted(CORPUS.rglob("*.building.yaml"))] if _has_lifts(path)] if "building" in shares else []
        self._paths = {"bundled": bundled, "corpus": corpus, "building": whole}
        self._lasting_graph = cache(self._graph)
        self._building: dict[World, Building | None] = {}
        self._map: dict[World, Map] = {}

    def draw(self, rng: np.random.Generator, number: int) -> World:
        """A family, and one of its worlds."""
        families = [family for family in self._shares if self._paths.get(family, [0])]
        share = np.array([self._shares[family] for family in families])
        family = str(rng.choice(families, p=share / share.sum()))
        if family in self._paths:
            which = f"{int(rng.integers(len(self._paths[family])))} {int(rng.integers(12))} {rng.choice(['grid', 'roadmap', 'two_way'])}"
        elif family == "warehouse":
            which = f"{rng.choice([40, 150, 400])} {rng.choice(['True', 'False'])} {rng.choice(['grid', 'roadmap', 'two_way'])}"
        elif family == "roads":
            which = f"{rng.choice(['grid', 'ring', 'random'])} {rng.choice([40, 200])} {rng.choice(['roadmap', 'two_way'])}"
        else:
            return family, str(number)
        return family, f"{which} {rng.choice(['0.4', '0.5'])}"

    def name(self, world: World) -> str:
        """Of the map."""
        family, which = world
        return self._paths[family][int(which.split()[0])].name.removesuffix(".building.yaml") if family in self._paths else family

    def graph(self, world: World) -> PlanGraph:
        return self._graph(world) if world[0] in PASSING else self._lasting_graph(world)

    def network(self, world: World, graph: PlanGraph, robot: RobotType) -> Path:
        if world[0] in PASSING:
            return build_network(graph, self._scratch / "passing.net.xml")
        name = re.sub(r"\W", "_", " ".join((*world, robot.name, str(graph.num_vertices))))
        path = self._scratch / f"{name}.net.xml"
        return path if path.is_file() else build_network(graph, path)

    def with_room(self, world: World, graph: PlanGraph, robot: RobotType) -> tuple[PlanGraph, np.ndarray]:
        """The graph without what walls leave no room for, and the walls [W, 2, 2]."""
        building = self._building.get(world)
        if building is None:
            return graph, np.zeros((0, 2, 2))
        return pruned(graph, narrow(graph, building, robot)), standing_walls(building, graph.level_names)

    def facilities(self, world: World, graph: PlanGraph, radius_m: float, step_s: float) -> PlanGraph:
        """The graph with the lifts and doors of a whole building, for robots up to a radius and planned steps."""
        if world[0] != "building":
            return graph
        ridden = with_rides(graph, step_s, radius_m, self._building[world], self._map[world].level_shift_m)
        return with_doors(ridden, self._building[world], radius_m)

    def people(self, world: World, graph: PlanGraph, chance: np.random.Generator, seed: int) -> People | None:
        """Who walks between the places of a whole building; None where there is no room."""
        floor = floor_of(self._map[world], graph)
        cells = [floor.place_at(xy) for xy in self._map[world].nav.xy[chance.permutation(self._map[world].nav.num_vertices)[:20]]]
        place = np.unique([cell for cell in cells if cell >= 0]).astype(np.int64)
        people = People(floor, place, count=int(chance.integers(1, 30)), seed=seed)
        return people if len(place) > 1 and any(joint_places(people)) else None

    def _graph(self, world: World) -> PlanGraph:
        family, which = world
        if family in PASSING:
            return PASSING[family](np.random.default_rng([int(which), 78]))
        *parts, kind, cell = which.split()
        if family in self._paths:
            path = self._paths[family][int(parts[0])]
            map_ = load_map(path, graph=None if family == "building" else "all")
            names = map_.nav.level_names
            if len(names) > 1 and family != "building":
                map_ = load_map(path, graph="all", level=names[int(parts[1]) % len(names)])
            nav, self._building[world], self._map[world] = map_.nav, map_.building, map_
            if family == "building":
                nav, _ = join_short(nav, 0.45)
                kind = "roadmap" if kind == "grid" else kind
        else:
            path = self._scratch / f"{family}_{'_'.join(parts)}.building.yaml"
            if family == "warehouse":
                GENERATORS["warehouse"](int(parts[0]), one_way=parts[1] == "True").write(path)
            else:
                GENERATORS[parts[0]](int(parts[1])).write(path)
            nav = load_map(path).nav
        graph = paper_grid(nav, float(cell)) if kind == "grid" else cut_lanes(nav, float(cell), kind == "two_way")
        if graph.num_vertices > LARGEST:
            raise MrpSumoError("too large for the campaign")
        return graph


def disturbed(rng: np.random.Generator, graph: PlanGraph, num_robots: int) -> tuple[Disturbances, tuple[ClosedLane, ...]]:
    """Disturbances, and lanes that are closed; one run in ten is not disturbed."""
    if rng.random() < 0.1:
        return Disturbances(), ()
    what = Disturbances(
        speed_spread=float(rng.choice([0.0, 0.08])),
        speed_noise=float(rng.choice([0.0, 0.05, 0.2])),
        stops_per_s=float(rng.choice([0.0, 1 / 120, 1 / 20])),
        start_delay_s=float(rng.choice([0.0, 5.0])),
        delay_probability=float(rng.choice([0.0, 0.01, 0.1])),
    )
    if rng.random() < 0.3:
        what = replace(what, latency_s=float(rng.choice([0.0, 0.5, 2.0])), message_loss=float(rng.choice([0.1, 0.5])))
    if rng.random() < 0.2:
        what = replace(what, localisation_m=0.05, localisation_rad=0.05, localisation_tau_s=1.0)
    if rng.random() < 0.2:
        broken = [Breakdown(int(rng.integers(num_robots)), 20.0, _lasts_s(rng, 20.0)) for _ in range(int(rng.integers(1, 4)))]
        what = replace(what, breakdowns=tuple(broken))
    if rng.random() < 0.2:
        x, y = graph.xy[int(rng.integers(graph.num_vertices))].tolist()
        what = replace(what, obstacles=(Obstacle(x, y, float(rng.uniform(0, 40)), _lasts_s(rng, 15.0)),))
    if lifts := lift_names(graph):
        what = replace(what, lift_rides_per_h=float(rng.choice([0.0, 20.0, 60.0])), door_passages_per_h=float(rng.choice([0.0, 30.0])))
        span = {"begin_s": float(rng.uniform(0, 100)), "duration_s": _lasts_s(rng, 20.0, 60.0)}
        if rng.random() < 0.2:
            what = replace(what, outages=(Outage(str(rng.choice(lifts)), **span),))
        elif (doors := door_names(graph)) and rng.random() < 0.2:
            what = replace(what, outages=(Outage(door=str(rng.choice(doors)), **span),))
        elif rng.random() < 0.1:
            what = replace(what, fires=(Fire(**span),))
    if rng.random() < 0.2:
        lane = int(rng.integers(graph.num_lanes))
        return what, (ClosedLane(int(graph.tail[lane]), int(graph.head[lane]), float(rng.uniform(0, 40)), _lasts_s(rng, 15.0)),)
    return what, ()


def _lasts_s(rng: np.random.Generator, *durations_s: float) -> float | None:
    """One of some durations, or for good."""
    drawn = float(rng.choice([*durations_s, np.inf]))
    return drawn if np.isfinite(drawn) else None


def kinds_of(what: Disturbances, closed: tuple[ClosedLane, ...]) -> list[str]:
    """What there is of it."""
    return ["closures"] * bool(closed) + [
        name
        for name in (*NOISE, "breakdowns", "obstacles", "outages", "fires", "lift_rides_per_h", "door_passages_per_h")
        if getattr(what, name)
    ]


def apart(graph: PlanGraph, rng: np.random.Generator, num: int, distance: float) -> np.ndarray:
    """Up to `num` vertices with lanes in one component, at least `distance` apart."""
    served = np.unique(np.concatenate([graph.tail, graph.head]))
    served = served[~graph.having("cabin")[served]]
    served = served[graph.component[served] == np.bincount(graph.component[served]).argmax()]
    chosen: list[int] = []
    for v in rng.permutation(served).tolist():
        if not chosen or np.hypot(*(graph.xy[chosen] - graph.xy[v]).T).min() >= distance:
            chosen.append(v)
        if len(chosen) == num:
            break
    return np.array(chosen, np.int64)


def one(number: int, worlds: Worlds, again_with: str = "") -> dict[str, Any]:
    """Drive run `number`: what it was, how it ended, and what is wrong with it. Again with the planner that it was driven
    with, planning takes the time it takes.
    """
    replanning.EFFORT = 60_000_000 if again_with else 1_000_000  # many worlds have no room for a new plan
    drawn = draw(number, worlds)
    if isinstance(drawn, dict):
        return drawn
    row, problem, settings, network, why = drawn.row, drawn.problem, drawn.settings, drawn.network, ""
    for name, method in drawn.methods:
        if again_with not in ("", name):
            continue
        plan = method(problem, 60.0 if again_with else 2.0)
        if plan is None:
            continue
        try:
            run = simulate(problem, plan, settings, network())
        except (PlanError, ExecutionError) as error:
            why = plain(error)
            continue
        return row | {"planner": name, "ended": str(run.outcome), "why": ""} | findings(run, plan, problem, settings, drawn.walls)
    return row | {"ended": "refused" if why else "no plan", "why": why}


Method = tuple[str, Callable[[Problem, float], Plan | None]]


@dataclass(frozen=True)
class Drawn:
    """What a run is, before it is planned."""

    row: dict[str, Any]
    problem: Problem
    settings: ExecutionSettings
    network: Callable[[], Path]
    walls: np.ndarray
    methods: list[Method]


def draw(number: int, worlds: Worlds) -> Drawn | dict[str, Any]:
    """What run `number` is; only how it ended, where there is nothing to plan."""
    rng = np.random.default_rng([number, 77])
    world = worlds.draw(rng, number)
    boxes = rng.random() < 0.6  # of those they fit on
    wanted = int(np.exp(rng.uniform(np.log(2), np.log(300))))
    policy, dt = str(rng.choice(policies())), float(rng.choice(STEPS_S))
    on_deadlock, give_way = str(rng.choice(["report", "resolve", "resolve"])), bool(rng.random() < 0.7)
    row: dict[str, Any] = {"number": number, "family": world[0], "map": worlds.name(world), "policy": policy, "dt_s": dt, "ended": ""}
    try:
        graph = worlds.graph(world)
    except MrpSumoError as error:
        return row | {"ended": "no map", "why": plain(error)}
    robot = BOX if boxes and fleet_of(BOX, 1).separation_m <= graph.cell_m else BURGER
    try:
        graph, walls = worlds.with_room(world, graph, robot)
    except MrpSumoError:
        return row | {"ended": "no room beside walls"}
    distance, slowest = fleet_of(robot, 1).separation_m, min(robot.max_speed_mps, BURGER.max_speed_mps)
    step_s = graph.cell_m / slowest + 1.0 if world[0] == "building" else 0.0
    graph = worlds.facilities(world, graph, max(robot.radius_m, BURGER.radius_m), step_s)
    if world[0] == "building":
        wanted = min(wanted, MOST_RIDING)
    wanted = min(wanted, graph.num_vertices // (4 if graph.kind == "grid" else 10))
    start, goal = apart(graph, rng, wanted, distance), apart(graph, rng, wanted, distance)
    num = min(len(start), len(goal))
    if num < 2:
        return row | {"ended": "no room"}
    start, goal, fleet, engine = start[:num], goal[:num], fleet_of(robot, num), "sumo"
    chance = np.random.default_rng([number, 78])
    if robot is BOX and chance.random() < MIXED:
        fleet = fleet_of_types([BOX, BURGER], chance.integers(0, 2, num))
        engine = str(chance.choice(["sumo", "kinematic"]))
    what, closed = disturbed(rng, graph, num)
    settings = ExecutionSettings(
        policy=policy,
        step_length_s=dt,
        time_limit_s=TIME_LIMIT_S * (RIDING if world[0] == "building" else 1.0),
        record_period_s=dt,
        seed=number,
        disturbances=what,
        closed_lanes=closed,
        on_deadlock=on_deadlock,
        recovery=RecoveryOptions(give_way=give_way),
        engine=engine,
    )
    if world[0] == "building" and chance.random() < PEOPLED:
        settings = replace(settings, people=worlds.people(world, graph, chance, number))
    row["people"] = settings.people.count if settings.people else 0
    types = " and ".join(sorted(set(fleet.type_name)))
    row |= {
        "kind": graph.kind,
        "robots": num,
        "robot": types,
        "engine": engine,
        "on_deadlock": on_deadlock,
        "disturbed_by": kinds_of(what, closed),
    }
    step_s = step_s or graph.cell_m / float(fleet.max_speed_mps.min()) + 1.0
    problem = Problem(graph, fleet, start, goal, np.arange(num), step_s, seed=number, drivable=policy_of(policy).sound_plan_only)
    return Drawn(row, problem, settings, lambda: worlds.network(world, graph, robot), walls, methods(rng))


def methods(rng: np.random.Generator) -> list[Method]:
    """Planners in the order in which they are tried; the next when there is no plan, or its order cannot be kept."""

    def of(name: str) -> Callable[[Problem, float], Plan | None]:
        def plan(problem: Problem, limit_s: float) -> Plan | None:
            return planner(name, {}).plan(problem, limit_s).plan

        return plan

    names = ["lacam", "prioritised"]
    return [(name, of(name)) for name in (names if rng.random() < 0.6 else names[::-1])]


def plain(error: Exception) -> str:
    """The message without names and figures."""
    return re.sub(r"'[^']*'|robot_\d+|\d[\d.]*", "_", str(error).replace("the plan's", "its"))[:90]


def findings(run: Execution, plan: Plan, problem: Problem, settings: ExecutionSettings, walls: np.ndarray) -> dict[str, Any]:
    """What the audit and a few other looks find."""
    fleet, level, policy = problem.fleet, problem.graph.level[problem.start], settings.policy
    level = level if run.level is None else np.zeros_like(level)  # they lie beside each other
    result = audit(run, fleet, level, walls if len(walls) else None)
    wrong = [f"{result[key]} {key.removeprefix('num_')}" for key in result if key.startswith("num_") and key != TOUCHES and result[key]]
    wrong += [str(result["violations"][0])] if result["violations"] else []
    events = collections.Counter(event.kind for event in run.events)
    if abs(run.booked_s.sum(1) - run.sim_time_s).max() > 1e-6:
        wrong.append("bookings do not add up")
    if policy_of(policy).sound_plan_only and events["deadlock"] and not events["resolved"]:  # a new plan may be driven otherwise
        wrong.append("deadlock in plan order")
    wrong += overlaps(run, fleet, level) + in_walls(run, fleet, walls)
    if policy_of(policy).sound_plan_only and policy != SWITCHES and not run.replies:
        wrong += out_of_order(run, plan)
    wrong += uncounted(run, problem) + idle(run, settings, events)
    most_short, short = 0.004, ""
    for k in np.unique(np.linspace(0, len(run.t_s) - 1, 150).astype(int)):
        for floor in np.unique(level):
            there = np.flatnonzero((level == floor) & np.isfinite(run.x_m[k]))
            xy = np.c_[run.x_m[k], run.y_m[k]][there]
            i, j = cKDTree(xy).query_pairs(fleet.separation_m, output_type="ndarray").T if len(xy) > 1 else np.zeros((2, 0), int)
            apart_m, needed_m = np.hypot(*(xy[i] - xy[j]).T), fleet.apart_m[fleet.kind[there[i]], fleet.kind[there[j]]]
            if len(i) and (needed_m - apart_m).max() > most_short:
                worst = int(np.argmax(needed_m - apart_m))
                most_short, short = float((needed_m - apart_m)[worst]), f"{apart_m[worst]:.4f} m apart, expected {needed_m[worst]:.4f}"
    wrong += [short] if short else []
    digest = hashlib.sha256(b"".join(a.tobytes() for a in (run.x_m, run.y_m, run.yaw_rad, run.speed_mps, run.goal_s))).hexdigest()[:16]
    return {
        "sim_s": run.sim_time_s,
        "at_goal": int(np.isfinite(run.goal_s).sum()),
        "overlaps": result["num_overlaps"],
        "other_faults": sum(v or 0 for k, v in result.items() if k.startswith("num_") and k not in ("num_overlaps", TOUCHES)),
        "clearance_m": result["min_clearance_m"],
        "deadlocks": events["deadlock"],
        "resolved": events["resolved"],
        "unresolved": events["unresolved"],
        "gave_way": events["gave_way"],
        "detours": events["detour"],
        "blocked": events["blocked"],
        "wrong": wrong,
        "digest": digest,
        "cpu_s": round(run.cpu_time_s, 3),
    }


def footprints(run: Execution, fleet: Fleet, k: int, there: np.ndarray, less_m: float = 0.0) -> np.ndarray:
    """[N] rectangles of some robots at a sample, smaller by a margin on each side."""
    half = np.column_stack((fleet.length_m, fleet.width_m))[there] / 2 - less_m
    corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)])[None] * half[:, None]  # [N, 4, 2]
    c, s = np.cos(run.yaw_rad[k, there, None]), np.sin(run.yaw_rad[k, there, None])
    x, y = np.moveaxis(corners, -1, 0)
    at_x, at_y = run.x_m[k, there, None], run.y_m[k, there, None]
    return shapely.polygons(np.stack((at_x + c * x - s * y, at_y + s * x + c * y), -1))


def in_walls(run: Execution, fleet: Fleet, walls: np.ndarray) -> list[str]:
    """Footprints, less a millimetre, that meet a wall; the first of each robot."""
    if not len(walls):
        return []
    tree = shapely.STRtree(shapely.linestrings(walls))
    result: dict[int, str] = {}
    for k in range(len(run.t_s)):
        there = np.flatnonzero(np.isfinite(run.x_m[k]))
        for i, wall in tree.query(footprints(run, fleet, k, there, 0.001), predicate="intersects").T.tolist():
            robot = int(there[i])
            result.setdefault(robot, f"shapely: robot {robot} meets wall {walls[wall].round(2).tolist()} at {run.t_s[k]:.1f} s")
    return list(result.values())


def out_of_order(run: Execution, plan: Plan) -> list[str]:
    """Vertices at which a robot arrived before one that the plan has there earlier."""
    robot, result = plan.robot, []
    arrived = np.where(np.isfinite(run.arrived_s), run.arrived_s, np.inf)
    for vertex in np.unique(plan.vertex):
        visits = np.flatnonzero(plan.vertex == vertex)
        visits = visits[np.argsort(plan.arrive_s[visits], kind="stable")]
        latest, who = -np.inf, -1
        for k in visits.tolist():
            if arrived[k] < latest - 1e-6 and robot[k] != who:
                result.append(f"robot {robot[k]} is at {vertex} before robot {who}, against the plan")
            if arrived[k] >= latest:
                latest, who = arrived[k], robot[k]
    return result[:3]


def uncounted(run: Execution, problem: Problem) -> list[str]:
    """Robots that stand on their goals at the end, and count as elsewhere; and the other way round."""
    goal = problem.graph.xy[problem.target]
    away = np.hypot(run.x_m[-1] - goal[:, 0], run.y_m[-1] - goal[:, 1])
    stands = (away < 0.001) & (np.abs(run.speed_mps[-1]) < 1e-6)
    counts = np.isfinite(run.goal_s)
    result = [f"robot {r} stands on its goal, but does not count as there" for r in np.flatnonzero(stands & ~counts).tolist()]
    return result + [f"robot {r} counts as at its goal, {away[r]:.3f} m away" for r in np.flatnonzero(counts & (away > 0.01)).tolist()]


def idle(run: Execution, settings: ExecutionSettings, events: Any) -> list[str]:
    """A run at whose end nobody moves any more, though some are not at their goals and nothing is known to stand in the way for good."""
    what = settings.disturbances
    listed = (*what.breakdowns, *what.obstacles, *settings.closed_lanes, *what.outages, *what.fires)
    lasting = any(d.duration_s is None for d in listed)
    seen = {"deadlock", "unresolved", "blocked_for_good"} & set(events)
    last = run.t_s > run.t_s[-1] - 60.0
    moved = np.hypot(np.ptp(run.x_m[last], axis=0), np.ptp(run.y_m[last], axis=0)).max(initial=0.0)
    if run.all_at_goal or lasting or seen or run.t_s[-1] < 120.0 or moved > 0.01:
        return []
    return ["nobody moves in the last minute, and nothing says why"]


def overlaps(run: Execution, fleet: Fleet, level: np.ndarray, touch_m2: float = 1e-6) -> list[str]:
    """Pairs of footprints that overlap at a sample, by shapely; the first of each pair."""
    result: dict[tuple[int, int], str] = {}
    for k in range(len(run.t_s)):
        there = np.flatnonzero(np.isfinite(run.x_m[k]))
        shapes = footprints(run, fleet, k, there)
        for i, j in shapely.STRtree(shapes).query(shapes, predicate="intersects").T.tolist():
            pair = a, b = int(there[i]), int(there[j])
            if a < b and level[a] == level[b] and pair not in result and shapely.intersection(shapes[i], shapes[j]).area > touch_m2:
                result[pair] = f"shapely: robots {a} and {b} overlap at {run.t_s[k]:.1f} s"
    return list(result.values())
