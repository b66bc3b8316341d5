"""Vehicles that cannot turn in place, drawn: wheels, sizes, trailers, on drawn roads and on real maps, by all planners, in both engines.

Each plan is driven undisturbed, within a step of what is planned, and then again and again with drawn noise. Each run is judged by the
program's audit and by one of its own, which follows bodies with shapely and wheels by finite differences: nobody overlaps anybody or a
wall of the building (lanes without room are left out before), no fixed axle slips aside or turns tighter than it can, and nobody drives
backward who may not.
"""

import re
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from campaigns.driver import Trial

from mrp_sumo.core.bodies import axle_of, bodies_of
from mrp_sumo.core.disturbances import Breakdown, Disturbances
from mrp_sumo.core.execution import Execution, Outcome
from mrp_sumo.core.fleet import fleet_of_types
from mrp_sumo.core.graph import NavGraph, PlanGraph, nav_graph
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.robot_type import RobotType, Trailer, Wheels
from mrp_sumo.drive.fit import check_room
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.engines.sumo.network import build_network
from mrp_sumo.errors import MrpSumoError, OptionError, PlanError
from mrp_sumo.io.scenario.robots import robot_type
from mrp_sumo.maps.catalogue import bundled_folder, bundled_maps
from mrp_sumo.maps.clearance import narrow, pruned, standing_walls
from mrp_sumo.maps.curves import Line, bezier_knots, flattened
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.repair import join_short
from mrp_sumo.maps.roadmap import cell_that_fits, cut_lanes
from mrp_sumo.metrics.audit import audit, in_words
from mrp_sumo.planning.answers import planned_by
from mrp_sumo.planning.registry import planner
from mrp_sumo.traffic.draw import draw_by_type
from mrp_sumo.traffic.referee import judge
from mrp_sumo.traffic.turns import with_swings

PLANNERS = ("lacam", "pibt", "prioritised", "lns2", "cbs", "ecbs", "eecbs", "pbs", "continuous", "auto")
FIELD = Path(__file__).resolve().parents[3] / "shared" / "maps" / "field"
STEP_S, LOOK_EVERY, NUM_NOISY = 0.1, 3, 8
ALWAYS: dict[str, Any] = {"step_length_s": STEP_S, "time_limit_s": 3000.0}
TOUCH_M2 = 1e-4  # of two bodies that is no overlap


class Vehicles:
    """Trials by number."""

    size = None

    def __init__(self, seed: int) -> None:
        self.seed = seed

    def trial(self, number: int, folder: Path) -> Trial:
        """Draw, plan, drive, judge."""
        rng = np.random.default_rng([self.seed, number])
        try:
            types = bundled_types(rng) if rng.random() < 0.2 else drawn_types(rng)
            graph, walls, kind = drawn_world(rng, types)
            graph = with_swings(graph, types)
            problem = drawn_problem(rng, graph, types)
        except (OptionError, MrpSumoError, ValueError) as error:
            return Trial("drawn", plain(str(error)), num_runs=0)
        kind = f"{kind}, {'tows' if problem.fleet.behind_m.any() else 'reverses' if types[0].kinematics.reverse else 'forward only'}"
        for name in (PLANNERS[number % len(PLANNERS)], "lacam"):
            chosen = planner(name, {})
            chosen.prepare()
            result = planned_by(chosen, replace(problem, effort=50_000), 2.0)
            if result.plan is not None:
                break
        else:
            return Trial(kind, f"no plan: {result.status}, {plain(result.message)}", num_runs=0)
        verdict = judge(problem, result.plan, in_seconds="seconds" in chosen.supports)
        if not verdict.valid:
            return Trial(kind, "invalid plan", (f"{name}: {verdict.summary(problem)}",))
        with_sumo = number % 8 == 0
        network = build_network(graph, folder / "world.net.xml") if with_sumo else folder
        faults = list[str]()
        for again in range(NUM_NOISY + 1):
            settings = drawn_settings(rng, again) if again else ExecutionSettings(engine="kinematic", **ALWAYS)
            settings = replace(settings, engine="sumo" if with_sumo and again < 2 else "kinematic")
            try:
                plan = retime(problem, result.plan, settings)
            except PlanError as error:
                return Trial(kind, "not drivable", (f"{name}: {error}",))
            run = simulate(problem, plan, settings, network)
            judged = self.judged(run, problem, walls)
            if run.outcome is not Outcome.COMPLETED:
                judged.append(str(run.outcome))
            if not again and (late_s := float(np.nanmax(np.abs(run.arrived_s - plan.arrive_s)))) > STEP_S + 1e-9:
                judged.append(f"{late_s:.3f} s from the plan")
            faults += [f"{name}, run {again}: {fault}" for fault in judged]
        return Trial(kind, "driven", tuple(faults), num_runs=NUM_NOISY + 1)

    @staticmethod
    def judged(run: Execution, problem: Problem, walls: np.ndarray) -> list[str]:
        """Faults of a run."""
        answer = audit(run, problem.fleet, walls=walls if len(walls) else None)
        faults = [] if answer["passed"] else [in_words(answer)]
        bodies = bodies_of(run, problem.fleet)
        reach = np.hypot(bodies.length_m, bodies.width_m) / 2
        lines = shapely.STRtree(shapely.linestrings(walls)) if len(walls) else None
        for t in range(0, len(run.t_s), LOOK_EVERY):
            xy, yaw = np.stack([bodies.x_m[t], bodies.y_m[t]], 1), bodies.yaw_rad[t]
            away = np.hypot(*(xy[:, None] - xy[None]).transpose(2, 0, 1)) - reach[:, None] - reach
            pairs = np.argwhere(np.triu(away < 0, 1) & (bodies.owner[:, None] != bodies.owner))
            shapes = rectangles(xy, yaw, bodies.length_m, bodies.width_m)
            faults += [
                f"{bodies.name[a]} and {bodies.name[b]} overlap after {run.t_s[t]:.1f} s"
                for a, b in pairs.tolist()
                if shapes[a].intersection(shapes[b]).area > TOUCH_M2
            ]
            if lines is not None and len(hits := lines.query(shapes, predicate="intersects")[0]):
                faults.append(f"{bodies.name[int(hits[0])]} is in a wall after {run.t_s[t]:.1f} s")
            if len(faults) > 3:
                break
        return faults + wheels_of(run, problem)


def wheels_of(run: Execution, problem: Problem) -> list[str]:
    """Moves that wheels cannot make."""
    faults = []
    for r, k in enumerate(problem.fleet.kind.tolist()):
        each = problem.fleet.types[k]
        if not each.is_vehicle:
            continue
        yaw = np.unwrap(run.yaw_rad[:, r])
        x, y = axle_of(run.x_m[:, r], run.y_m[:, r], yaw, each.kinematics.ahead_m)
        moved, turned, mean = np.hypot(np.diff(x), np.diff(y)), np.abs(np.diff(yaw)), (yaw[1:] + yaw[:-1]) / 2
        aside = np.abs(np.diff(y) * np.cos(mean) - np.diff(x) * np.sin(mean))
        back = np.diff(x) * np.cos(mean) + np.diff(y) * np.sin(mean) < -2e-3
        if (2 * each.kinematics.least_radius_m * np.sin(turned / 2) > 1.02 * moved + 3e-3).any():
            faults.append(f"robot_{r} turns too tightly")
        if (aside > 0.25 * moved * turned + 3e-3).any():
            faults.append(f"robot_{r} slips aside")
        if back.any() and not each.kinematics.reverse:
            faults.append(f"robot_{r} drives backward")
    return faults


def rectangles(xy: np.ndarray, yaw: np.ndarray, length: np.ndarray, width: np.ndarray) -> np.ndarray:
    """[B] of shapely."""
    along, left = np.stack([np.cos(yaw), np.sin(yaw)], 1), np.stack([-np.sin(yaw), np.cos(yaw)], 1)
    corners = [xy + f * length[:, None] / 2 * along + g * width[:, None] / 2 * left for f, g in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
    return shapely.polygons(np.stack(corners, 1))


def drawn_types(rng: np.random.Generator) -> list[RobotType]:
    """One type of vehicles, sometimes with another type of robots."""
    size = float(rng.choice([0.3, 0.6, 1.0]))
    length, width = size * float(rng.uniform(1.0, 2.2)), size * float(rng.uniform(0.5, 0.9))
    limits = {"max_speed_mps": float(rng.uniform(0.5, 2.0)), "accel_mps2": float(rng.uniform(0.3, 1.0)), "decel_mps2": 0.6, "gap_m": 0.1}
    tows, reverse = bool(rng.random() < 0.25), bool(rng.random() < 0.6)
    wheels = Wheels(
        kind="tugger" if tows else str(rng.choice(["tricycle", "ackermann"])),
        wheelbase_m=length * float(rng.uniform(0.4, 0.8)),
        steering_max_rad=float(rng.uniform(0.3, 0.7) if tows else rng.uniform(0.5, 1.3)),
        reverse=reverse and not tows,
        fixed_axle="front" if reverse and not tows and rng.random() < 0.3 else "rear",
        reverse_mps=0.4 if reverse and not tows and rng.random() < 0.5 else None,
        lateral_mps2=float(rng.uniform(0.2, 1.0)),
    )
    if wheels.reverse and rng.random() < 0.3:
        wheels = replace(wheels, docking="forks_first")
    trailers = ()
    if tows:
        drawbar = size * float(rng.uniform(0.6, 1.0))
        trailers = (Trailer(length_m=drawbar, hitch_m=size * 0.4),) * int(rng.integers(1, 4))
    types = [RobotType("vehicle", length_m=length, width_m=width, kinematics=wheels, trailers=trailers, **limits)]
    if rng.random() < 0.3:
        other = Wheels(kind="omni") if rng.random() < 0.5 else Wheels()
        types.append(RobotType("cart", length_m=size, width_m=size * 0.8, turn_rate_rad_s=1.0, kinematics=other, **limits))
    return types


def bundled_types(rng: np.random.Generator) -> list[RobotType]:
    """A type of vehicles that comes with the program, with its load or without, sometimes with another type of robots."""
    vehicles, others = ["pallet_truck", "counterbalance_forklift", "tugger"], ["unit_load_agv", "amr_lift", "omni_mover"]
    names = [str(rng.choice(vehicles))] + ([str(rng.choice(others))] if rng.random() < 0.3 else [])
    types = [robot_type(name, bundled_folder("robots"), Path()) for name in names]
    return [each.with_load for each in types] if rng.random() < 0.5 else types


def plain(message: str) -> str:
    """A refusal without its names and figures."""
    return re.sub(r"'[^']*'|\S*\d\S*", "_", message.rpartition("/")[2])[:100]


@cache
def real_maps() -> list[Path]:
    """The bundled maps, and real layouts where they are there."""
    bundled = sorted(bundled_maps().values())
    return bundled + sorted(FIELD.rglob("*.building.yaml"))


def drawn_world(rng: np.random.Generator, types: list[RobotType]) -> tuple[PlanGraph, np.ndarray, str]:
    """A graph whose steps are long enough, the walls beside it, and what it is."""
    one_of_each = fleet_of_types(types, np.arange(len(types)))
    step_m = max(one_of_each.separation_m, float(one_of_each.behind_m.max()) + 0.1)
    if (world := rng.random()) < 0.6:
        roads = drawn_roads(rng, step_m * float(rng.uniform(1.1, 1.8)), curved=world > 0.3)
        return roads, np.zeros((0, 2, 2)), "curves" if roads.curves else "roads"
    map_ = load_map(real_maps()[int(rng.integers(len(real_maps())))], graph="all")
    if len(map_.nav.level_names) > 1:
        map_ = load_map(map_.path, graph="all", level=map_.nav.level_names[int(rng.integers(len(map_.nav.level_names)))])
    nav, _ = join_short(map_.nav, step_m)
    long_m = nav.length_m[nav.length_m >= step_m]
    if len(long_m) < nav.num_lanes and one_of_each.behind_m.any():
        raise ValueError("lanes too short")
    graph = cut_lanes(nav, cell_that_fits(long_m, step_m))
    for each in types:
        graph = pruned(graph, narrow(graph, map_.building, each))
    walls = standing_walls(map_.building, graph.level_names) if map_.building else np.zeros((0, 2, 2))
    return replace(graph, walls=walls), walls, "real map"


def drawn_roads(rng: np.random.Generator, cell_m: float, *, curved: bool) -> PlanGraph:
    """Drawn roads in steps of this length, about."""
    return cut_lanes(drawn_nav(rng, cell_m, curved=curved), cell_m)


def drawn_nav(rng: np.random.Generator, cell_m: float, *, curved: bool) -> NavGraph:
    """Roads of squares or slightly bent ones, two-way or one-way, some missing, some of them curves."""
    columns, rows = (int(n) for n in rng.integers(4, 8, 2))
    xy = np.array([(x * cell_m, y * cell_m) for y in range(rows) for x in range(columns)])
    xy = xy + rng.uniform(-0.08, 0.08, xy.shape) * cell_m * (rng.random() < 0.5)
    one_way, lanes = rng.random() < 0.4, list[tuple[int, int]]()
    for v in range(rows * columns):
        row, column = divmod(v, columns)
        for w, there, forward in ((v + 1, column + 1 < columns, row % 2), (v + columns, row + 1 < rows, column % 2)):
            if there and rng.random() < 0.92:
                lanes += [(v, w) if forward else (w, v)] if one_way else [(v, w), (w, v)]
    if curved:
        return with_curves(rng, float(rng.choice([1.0, 2.0])) * xy, lanes)
    return nav_graph(name="roads", xy=xy, lanes=lanes)


def with_curves(rng: np.random.Generator, xy: np.ndarray, lanes: list[tuple[int, int]]) -> NavGraph:
    """A graph in which half of the lanes swing out to a side and back, the same both ways."""
    places, options, pieces = list(map(tuple, xy.tolist())), [{} for _ in xy], []
    for a, b in lanes:
        if (b, a) in lanes and b < a:
            continue
        along = (xy[b] - xy[a]) / 4
        aside, middle = np.array([-along[1], along[0]]) * float(rng.uniform(-1.0, 1.0)), (xy[a] + xy[b]) / 2
        points = np.array([xy[a], xy[a] + along, middle - along + aside, middle + aside, middle + along + aside, xy[b] - along, xy[b]])
        line = flattened(3, bezier_knots(3, 2), points) if rng.random() < 0.5 else Line(xy[[a, b]])
        chain = [a, *range(len(places), len(places) + len(line.xy) - 2), b]
        places += [tuple(place) for place in line.xy[1:-1].tolist()]
        options += [{"is_bend": True, **line.courses_at(k)} for k in range(1, len(line.xy) - 1)]
        pieces += list(pairwise(chain)) + (list(pairwise(chain[::-1])) if (b, a) in lanes else [])
    return nav_graph(name="curves", xy=places, lanes=pieces, vertex_options=options)


def drawn_problem(rng: np.random.Generator, graph: PlanGraph, types: list[RobotType]) -> Problem:
    """As many robots as there is room for, eight at most, at starts and goals."""
    count, seed = int(rng.integers(max(2, len(types)), 9)), int(rng.integers(2**31))
    while True:
        fleet = fleet_of_types(types, np.arange(count) % len(types))
        none = np.full(count, -1)
        try:
            apart_m = float(fleet.apart_m.max())
            start, goal = draw_by_type([(each, graph) for each in types], fleet.kind, none, none, seed, apart_m, anywhere=True)
            break
        except PlanError:
            if count <= max(2, len(types)):
                raise
            count -= 1
    step_s = round(float(graph.length_m.max()) / float(fleet.max_speed_mps.min()) + 3.0, 1)
    problem = Problem(graph, fleet, start, goal, np.arange(count), step_s, drivable=True)
    check_room(problem)
    return problem


def drawn_settings(rng: np.random.Generator, seed: int) -> ExecutionSettings:
    """Noise of several kinds, and who gives way."""
    noise: dict[str, Any] = {"speed_noise": float(rng.uniform(0.02, 0.2)), "stops_per_s": float(rng.choice([0.0, 0.02, 0.1]))}
    noise |= {"start_delay_s": float(rng.choice([0.0, 3.0, 20.0])), "speed_spread": float(rng.choice([0.0, 0.08]))}
    noise |= {"latency_s": 0.5, "message_loss": 0.1} if rng.random() < 0.3 else {}
    if rng.random() < 0.2:
        noise["breakdowns"] = (Breakdown(0, float(rng.uniform(0, 40)), 60.0),)
    policy = "adg_timed" if rng.random() < 0.2 else "adg"
    return ExecutionSettings(policy=policy, seed=seed, disturbances=Disturbances(**noise), **ALWAYS)
