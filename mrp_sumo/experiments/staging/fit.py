"""Check that robots fit a plan graph: steps long enough for two of them, room beside the walls, a place to brake.

Refuses what does not fit in one line, with what would help.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mrp_sumo.core.facilities import CABIN_M, beyond_cabin_m
from mrp_sumo.core.fleet import fleet_of, fleet_of_types
from mrp_sumo.core.graph import BoolArray, NavGraph, PlanGraph
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.errors import ScenarioError, listed, nearest
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.names import type_at
from mrp_sumo.maps.chains import chains_of
from mrp_sumo.maps.clearance import Narrow, narrow, pruned
from mrp_sumo.maps.lifts import cabins_of
from mrp_sumo.maps.load import Map
from mrp_sumo.maps.repair import join_short
from mrp_sumo.maps.roadmap import cell_that_fits
from mrp_sumo.planning.protocol import Planner
from mrp_sumo.traffic.draw import main_piece

NAMED = 5  # stations in a line


def require_fit(file: ScenarioFile, nav: NavGraph, graph: PlanGraph, models: Sequence[RobotType], *, is_auto: bool = False) -> None:
    """Every step is at least as long as any two robots' centres are apart; `is_auto` where the cell length follows from that.

    With `short_lanes: drive` lanes may be shorter, but not than trains, which hold one lane and the vertex before it.

    A robot that is alone on its map keeps clear of nobody.
    """
    if graph.kind == "grid" and not graph.num_lanes:
        across_m = " x ".join(f"{length_m:.4g}" for length_m in np.ptp(nav.xy, axis=0))
        raise ScenarioError(
            f"{file.at('discretisation', 'cell_m')}: found {graph.cell_m:g} m, but the stations of '{nav.name}' lie within {across_m} m: "
            "no robot could go from cell to cell"
        )
    if file.scenario.robots.size == 1:
        return
    one_of_each = fleet_of_types(models, np.arange(len(models)))
    kind, model = max(enumerate(models), key=lambda each: fleet_of(each[1], 1).separation_m)
    needed_m, train_m = one_of_each.separation_m, float(one_of_each.behind_m.max())
    shortest_m = float(graph.length_m.min(where=~graph.is_ride, initial=np.inf))
    if needed_m <= shortest_m + 1e-9:
        return
    chains = chains_of(nav)
    nav = chains.nav if chains else nav
    with_load = " with its load" if fleet_of(replace(model, loaded=None), 1).separation_m < needed_m - 1e-9 else ""
    what = f"{file.at(*type_at(file, kind))}: '{model.name}'{with_load} does not fit: two of them need {needed_m:.3f} m between centres, "
    length_m = nav.length_m[~nav.is_ride] if graph.kind == "roadmap" else np.full(1, np.inf)
    may_be_short = file.scenario.discretisation.short_lanes == "drive"
    if may_be_short and (length_m < needed_m - 1e-9).any() and length_m.min() >= train_m - 1e-9:
        length_m = length_m[length_m >= needed_m - 1e-9]
        step_m = length_m / np.maximum(np.rint(length_m / graph.cell_m), 1)
        if min(graph.cell_m, step_m.min(initial=np.inf)) >= needed_m - 1e-9:
            return
    if (short := np.flatnonzero(length_m < needed_m - 1e-9)).size:
        lane = int(short[np.argmin(length_m[short])])
        count = len({frozenset((int(nav.tail[k]), int(nav.head[k]))) for k in short})
        raise ScenarioError(
            f"{what}lane {_ends(nav, lane)} of '{nav.name}' is {length_m[lane]:.3f} m "
            + (f"and {count - 1} more are too short; " if count > 1 else "long; ")
            + _remedy(nav, np.inf if is_auto else graph.cell_m, needed_m, is_train=train_m > 0)
        )
    cell_m = cell_that_fits(length_m, needed_m)
    raise ScenarioError(f"{what}the shortest step of '{graph.name}' is {shortest_m:.3f} m (discretisation.cell_m: {cell_m:g} would do)")


def require_cabins(file: ScenarioFile, map_: Map, graph: PlanGraph, models: Sequence[RobotType]) -> None:
    """Every type of robots rides wholly inside the cabins of lifts, as it faces there."""
    if map_.building is None or not map_.building.lifts:
        return
    lifts = [*map_.building.lifts]
    cabins = cabins_of(map_.building, graph.level_names, map_.level_shift_m)
    rides = [k for k in np.flatnonzero(graph.is_ride).tolist() if graph.lane_options[k]["lift"] in lifts]
    for kind, model in enumerate(models):
        body = model.with_load
        for lane, v in ((k, int(v)) for k in rides for v in (graph.tail[k], graph.head[k])):
            name = str(graph.lane_options[lane]["lift"])
            row = cabins[[int(graph.level[v]) * len(lifts) + lifts.index(name)]]
            x_m, y_m, heading_rad = (float(a) for a in (*graph.xy[v], graph.heading_rad[lane]))
            if (beyond_m := beyond_cabin_m(row, x_m, y_m, heading_rad, body.length_m, body.width_m)[0]) > CABIN_M:
                size = f"'{model.name}', {body.length_m:g} x {body.width_m:g} m"
                raise ScenarioError(
                    f"{file.at(*type_at(file, kind))}: {size}, stands {beyond_m:.2f} m out of the cabin of lift '{name}', "
                    f"{row[0, 4]:g} x {row[0, 5]:g} m: name a smaller type, or one level with map.level"
                )


def _remedy(nav: NavGraph, cell_m: float, needed_m: float, *, is_train: bool) -> str:
    """What helps against lanes shorter than two robots' centres are apart."""
    millimetres = math.ceil(1000 * needed_m - 1e-6) / 1000
    joined, _ = join_short(nav, millimetres)
    left = np.flatnonzero(joined.length_m < needed_m - 1e-9)
    if not left.size:
        hint = f"map.join_short_m: {millimetres:g} would join its ends"
        step_m = joined.length_m / np.maximum(np.rint(joined.length_m / cell_m), 1)
        if step_m.min(initial=np.inf) >= needed_m - 1e-9:
            return hint
        return f"{hint}, with discretisation.cell_m: {cell_that_fits(joined.length_m, needed_m):g}"
    cures = "lengthen it in the map, or choose smaller robots, or one alone"
    return f"{_ends(joined, int(left[0]))} cannot be joined, as both ends have a name or properties: {cures}" + (
        "" if is_train else ", or let one at a time drive there (discretisation.short_lanes: drive)"
    )


def _ends(graph: NavGraph, lane: int) -> str:
    return f"'{graph.known_as(int(graph.tail[lane]))}' - '{graph.known_as(int(graph.head[lane]))}'"


def require_brakes(file: ScenarioFile, graph: PlanGraph, models: Sequence[RobotType]) -> None:
    """Robots may brake over several lanes, which they then hold; over more than the whole map none would ever come to its speed."""
    shapes = [
        (kind, each.name, says, shape) for kind, each in enumerate(models) for says, shape in (("", each), (" with a load", each.with_load))
    ]
    for kind, name, says, model in shapes:
        top = min(model.max_speed_mps, float(graph.speed_mps.max(initial=0.0)))
        across_m = float(np.hypot(*np.ptp(graph.xy, axis=0))) if graph.num_lanes else np.inf
        braking_m = top**2 / (2 * model.decel_mps2)
        if braking_m > across_m:
            slower = _rounded(math.sqrt(2 * across_m * model.decel_mps2), math.floor)
            raise ScenarioError(
                f"{file.at(*type_at(file, kind))}: '{name}'{says} cannot stop: from {top:g} m/s at {model.decel_mps2:g} m/s2 it takes "
                f"{braking_m:.4g} m, and '{graph.name}' is {across_m:.4g} m across (decel_mps2: "
                f"{_rounded(top**2 / (2 * across_m), math.ceil)} or max_speed_mps: {slower} would do)"
            )


def _rounded(value: float, towards: Callable[[float], int]) -> str:
    """Two digits, rounded up or down."""
    unit = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{towards(value / unit) * unit:.6g}"


def with_room(
    file: ScenarioFile, maps: MapCache, map_: Map, graph: PlanGraph, models: Sequence[RobotType]
) -> tuple[PlanGraph, tuple[str, ...]]:
    """The graph, or what walls leave of it, and a line on what they do not; or a refusal, as the scenario chooses.

    Of several types each has lanes of its own, see `without_room`.
    """
    choice = file.scenario.discretisation.clearance
    if choice == "ignore" or (choice == "prune" and len(models) > 1):
        return graph, ()
    for without in (maps.of(narrow, graph, map_.building, model) for model in models):
        if choice == "prune":
            with file.located("discretisation", "clearance"):
                left = maps.of(pruned, graph, without)
            return left, () if left is graph else (_left_out(map_.nav, graph, left, without),)
        if not without.notes:
            continue
        fits = "; clearance: prune leaves them out"
        if (radius_m := without.radius_that_fits_m) > 0:
            fits = f"; a robot that needs no more than {radius_m:.2f} m around its centre would fit{fits}"
        raise ScenarioError(f"{file.at('discretisation', 'clearance')}: '{graph.name}': {', '.join(without.notes)}{fits}")
    return graph, ()


def _left_out(nav: NavGraph, graph: PlanGraph, left: PlanGraph, without: Narrow) -> str:
    """A line on the lanes that walls leave no room on, and on the stations that robots cannot reach and leave any more."""
    before, after = (np.isin(np.arange(each.num_vertices), main_piece(each)) for each in (graph, left))
    station = graph.vertex_of_station
    lost = [v for v in range(nav.num_vertices) if before[station[v]] and not after[station[v]]]
    cut_off = [nav.known_as(v) for v in sorted(lost, key=lambda v: nav.known_as(v) == f"v{v}")]  # those with a name first
    what = f"{graph.num_lanes - left.num_lanes} of {graph.num_lanes} {'steps' if graph.kind == 'grid' else 'pieces of lanes'} left out"
    return f"{what}: {', '.join(without.notes)}" + (f"; cut off by that: {listed(cut_off, NAMED)}" if cut_off else "")


def by_vehicle_type(map_: Map, graph: PlanGraph, barred: BoolArray | None, models: Sequence[RobotType]) -> BoolArray | None:
    """[K, L] lanes that are barred for each of several types, those included that the map has for other types of vehicles only."""
    of_lane = [set(str(options.get("vehicle_types", "")).split(", ")) - {""} for options in graph.lane_options]
    names = [model.in_layouts for model in models]
    foreign = np.array([[bool(of) and name in map_.vehicle_types and name not in of for of in of_lane] for name in names], np.bool_)
    if not foreign.any():
        return barred
    return foreign if barred is None else barred | foreign


def by_class(maps: MapCache, graph: PlanGraph, models: Sequence[RobotType]) -> tuple[PlanGraph, tuple[str, ...]]:
    """The graph with the speeds that types have on lanes by class, the lowest of several, and lines on classes that the map lacks."""
    if not any(model.lane_class_mps for model in models):
        return graph, ()
    of_lane = [str(options.get("class", "")) for options in graph.lane_options]
    known = set(of_lane) - {""}
    notes = [
        f"lane_class_mps of '{model.name}': no lane of '{graph.name}' has class '{name}'{nearest(name, known)}"
        for model in models
        for name in sorted(set(model.lane_class_mps) - known)
    ]
    limits = {name: min(model.lane_class_mps.get(name, math.inf) for model in models) for name in set(of_lane)}
    if len(models) > 1 and (differ := [name for name in limits if len({model.lane_class_mps.get(name) for model in models}) > 1]):
        notes.append(f"types have several speeds on lanes of class {', '.join(sorted(differ))}; the lowest holds for all of them")
    return maps.of(_no_faster, graph, tuple(limits[name] for name in of_lane)), tuple(notes)


def _no_faster(graph: PlanGraph, most_mps: tuple[float, ...]) -> PlanGraph:
    return replace(graph, speed_mps=graph.speed_mps.clip(max=most_mps))


def by_load(file: ScenarioFile, graph: PlanGraph, barred: BoolArray | None, num_types: int) -> tuple[BoolArray | None, bool]:
    """[2 K, L] lanes that are barred for each of several types, and for the same with a load; and if these differ, in runs with work."""
    load = [options.get("load", "") for options in graph.lane_options]
    only = [np.array([each == kind for each in load], np.bool_) for kind in ("loaded", "unloaded")]
    if file.scenario.tasks is None or not any(lanes.any() for lanes in only):
        return barred, False
    room = np.zeros((num_types, graph.num_lanes), np.bool_) if barred is None else barred
    return np.concatenate([room | lanes for lanes in only]), True


def without_room(
    file: ScenarioFile, maps: MapCache, map_: Map, graph: PlanGraph, models: Sequence[RobotType], chosen_planner: Planner
) -> tuple[BoolArray | None, tuple[str, ...]]:
    """[K, L] lanes on which walls leave each of several types no room, None where all have room everywhere; and lines about them."""
    if len(models) == 1:
        return None, ()
    barred, notes = np.zeros((len(models), graph.num_lanes), np.bool_), []
    for kind, model in enumerate(models):
        without = maps.of(narrow, graph, map_.building, model)
        barred[kind] = without.is_barred & ~graph.is_ride  # cabins have walls of their own
        if barred[kind].all():
            raise ScenarioError(f"{file.at(*type_at(file, kind))}: no lane of '{graph.name}' leaves '{model.name}' room beside the walls")
        if barred[kind].any():
            lane = int(np.flatnonzero(barred[kind])[np.argmin(without.lane_m[barred[kind]])])
            where = f"the narrowest {_ends(graph, lane)}: {without.lane_m[lane]:.2f} m to a wall"
            notes.append(f"'{model.name}' has no room on {np.count_nonzero(barred[kind])} of {graph.num_lanes} lanes, {where}")
    supports = getattr(chosen_planner, "supports", ())
    if "types" not in supports:
        lanes = ", on lanes with room for all types" if notes and "reach" not in supports else ""
        notes.append(f"'{file.scenario.planner.name}' plans for all robots as for the slowest and largest{lanes}")
    return (barred if barred.any() else None), tuple(notes)
