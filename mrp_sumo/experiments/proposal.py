"""A first scenario with work for a map: what its stations, chargers and parking are, which orders there could be, and for which robots.

What the map says is taken as it is; what it leaves open is guessed, and every guess is named.
"""

import re
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.graph import STATIONS, FloatArray, NavGraph, PlanGraph
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.core.task import TaskLog, some_tasks
from mrp_sumo.errors import MapError, MrpSumoError
from mrp_sumo.experiments.first_fleet import STATIONS_A_ROBOT, first_count
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.run import carry_out
from mrp_sumo.experiments.staging.places import obstacle_between
from mrp_sumo.experiments.staging.set_up import SetUp, set_up
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.names import robot_types
from mrp_sumo.io.scenario.read import scenario_of
from mrp_sumo.io.scenario.robots import robot_type, type_of_text
from mrp_sumo.maps.catalogue import bundled_folder
from mrp_sumo.maps.map import ListedVehicle
from mrp_sumo.maps.readers.opentcs import TYPE_KEY
from mrp_sumo.traffic.draw import most_drawn, stands_of

MOST_ROBOTS = 8
MOST_STATIONS = 60  # of a group
NUM_SPREAD = 24  # places of a floor that names none
SERVICE_S = (10.0, 20.0, 40.0)  # at a stop: least, usual and most
ORDERS_A_ROBOT = 5  # that a run has time for, at the least
BUSY = 0.25  # share of their time that robots would work if nobody were in their way
TRIAL_S = 600.0  # simulated: robots that stand in each other's way for good have been seen by then
AMPLE = 3.0  # times what an order takes undisturbed: of orders that have been there so long, some are done
ENDS = 20  # of each of two groups, whose ways to each other are measured
LARGE, MEDIUM, SMALL = "forklift", "amr_600", "turtlebot3"
SAME = 1.001e-3  # m and m/s: figures of plant models are in whole millimetres
SLENDER = 0.7  # width of a vehicle of which the map says its length alone, in lengths
KEPT = 0.8  # share of the small robot's stations that a larger one has to reach

CHARGES = re.compile(r"charg|battery|lade(station|platz)", re.IGNORECASE)
PARKS = re.compile(r"\bpark|_park|^park|home|wait|holding|standby|idle", re.IGNORECASE)
PICKS = re.compile(r"pick|(?<!un)load(?!ing_dock)|supply|source|storage|store|receiv|inbound|goods[ _-]?in|dispens|pantry", re.IGNORECASE)
DROPS = re.compile(r"drop|unload|destin|deliver|ingest|pack|ship|outbound|goods[ _-]?out|dock|sink", re.IGNORECASE)


@dataclass(frozen=True)
class Stations:
    """Names of places by what they are for, in the order of the map."""

    pick: tuple[str, ...] = ()  # where loads come from
    drop: tuple[str, ...] = ()  # where they go
    place: tuple[str, ...] = ()  # of neither kind
    charger: tuple[str, ...] = ()
    parking: tuple[str, ...] = ()
    unreached: tuple[str, ...] = ()  # places of any kind to which, or from which, robots do not come

    @property
    def groups(self) -> dict[str, list[str]]:
        """The first names of each group that has any, by the group's name."""
        return {name: list(members[:MOST_STATIONS]) for name, members in vars(self).items() if members and name != "unreached"}

    @property
    def stops(self) -> list[str]:
        """The two groups between which orders go."""
        ways = (("pick", "drop"), ("pick", "place"), ("place", "drop"), ("place", "place"), ("pick", "pick"), ("drop", "drop"))
        named = ((roles, [getattr(self, role) for role in roles]) for roles in ways)
        return next((list(roles) for roles, groups in named if all(groups) and len({*groups[0], *groups[1]}) > 1), [])


@dataclass(frozen=True)
class Wishes:
    """Choices that the user made; None and '' where the proposal decides."""

    robot_type: str = ""
    num_robots: int | None = None
    rate_per_h: float | None = None
    service_s: float | None = None
    hours: float | None = None


@dataclass(frozen=True)
class Proposal:
    """Values of a scenario, and a sentence on each that was guessed or read."""

    values: dict[str, Any]
    reasons: Mapping[str, str]  # by section, or group
    order_s: float  # what an order takes undisturbed
    unreached: tuple[str, ...]  # places that it leaves out
    doubts: tuple[str, ...]  # what makes the map's unit unlikely


def propose(map_values: Mapping[str, Any], folder: Path, name: str, wishes: Wishes) -> Proposal:
    """A scenario with work for a map, which was driven for ten simulated minutes.

    Raises MrpSumoError where no scenario with work comes of it, with the reason.
    """
    with MapCache() as maps:
        setup, why_type = _fitting_type(map_values, folder, maps, wishes.robot_type)
        stations = stations_of(setup.map.nav, setup.problem.graph, setup.problem.fleet.types[0])
        if not stations.stops:
            model, graph = setup.problem.fleet.types[0], setup.problem.graph
            why = "`mrp-sumo import` with --check says where lanes end or have no way back"
            if model.is_vehicle:
                why = obstacle_between(graph, model) or why
            raise MapError(f"'{setup.map.name}' has fewer than two stations that reach each other: there is nothing to carry; {why}")
        num_robots, why_number = _num_robots(setup, wishes.num_robots)
        fault = ""
        while num_robots:
            proposal = _proposal(map_values, name, setup, stations, num_robots, wishes)
            fault = _fault(scenario_of(proposal.values, folder, name), maps, proposal.order_s)
            if not fault or wishes.num_robots is not None:
                break
            why_number = f"fewer than guessed first, as {num_robots} did not get on with their work in ten simulated minutes"
            num_robots = num_robots * 2 // 3
    if fault:
        fewer = "; try fewer --robots" if (wishes.num_robots or 1) > 1 else ""
        raise MapError(f"'{setup.map.name}': what was proposed does not run: {fault}{fewer}")
    reasons = {**proposal.reasons, "type": why_type, "count": why_number}
    return replace(proposal, reasons=reasons)


def stations_of(nav: NavGraph, graph: PlanGraph, vehicle: RobotType | None = None) -> Stations:
    """Purposes of a map's places, of those that robots can reach from each other: by what the map says, else by their names."""
    reached = set(stands_of(graph, vehicle=vehicle).goal.tolist())  # where goals are drawn, too
    stopped = [v for v in range(nav.num_vertices) if not _is_passed(nav, graph, v)]
    usable = [v for v in stopped if int(graph.vertex_of_station[v]) in reached]
    tells_stations = sum("station" in nav.vertex_options[v] for v in usable) > 1  # from mere points
    named = [v for v in stopped if nav.vertex_name[v] or "station" in nav.vertex_options[v]]
    if tells_stations:
        named = [v for v in named if "station" in nav.vertex_options[v] or _role(nav, v) in ("charger", "parking")]
    roles, is_usable = defaultdict[str, list[str]](list), set(usable)
    for v in named:
        roles[_role(nav, v) if v in is_usable else "unreached"].append(_name(nav, v))
    used = {name for role, names in roles.items() if role != "unreached" for name in names}
    roles["unreached"] = [name for name in roles["unreached"] if name not in used]
    stations = Stations(**{role: tuple(dict.fromkeys(names)) for role, names in roles.items()})
    if not stations.stops and stations.parking:  # as on maps where every station is a parking spot
        stations = replace(stations, place=stations.place + stations.parking, parking=())
    if not stations.stops and stations.charger:
        stations = replace(stations, place=stations.place + stations.charger)
    if not stations.stops:
        is_named = set(named)
        unnamed = [v for v in usable if v not in is_named]
        if graph.kind == "grid":  # of free floor, whose cells with one neighbour are chance
            ends = [unnamed[k] for k in spread(nav.xy[unnamed], NUM_SPREAD)]
        else:
            ends = [v for v in unnamed if np.count_nonzero(nav.tail == v) == 1]
        stations = replace(stations, place=stations.place + tuple(nav.label(v) for v in (ends if len(ends) > 1 else unnamed)))
    return stations


def spread(xy: FloatArray, count: int) -> list[int]:
    """Up to `count` of the points [N, 2], ascending: the first, then again and again the one that is farthest from those before."""
    chosen: list[int] = []
    apart_m2 = np.full(len(xy), np.inf)
    while len(chosen) < min(count, len(xy)):
        chosen.append(int(apart_m2.argmax()))
        apart_m2 = np.minimum(apart_m2, ((xy - xy[chosen[-1]]) ** 2).sum(axis=1))
    return sorted(chosen)


def _is_passed(nav: NavGraph, graph: PlanGraph, v: int) -> bool:
    """True if robots do not stop at a vertex: bends, cabins of lifts, and what the map marks so."""
    options = nav.vertex_options[v]
    is_cabin = bool(graph.vertex_options[int(graph.vertex_of_station[v])].get("cabin"))
    return is_cabin or any(options.get(key) for key in ("is_bend", "is_passthrough_point", "cabin", "lift_cabin", "lift"))


def _role(nav: NavGraph, v: int) -> str:
    options = nav.vertex_options[v]
    text = " ".join(str(part) for part in (nav.vertex_name[v], options.get("station", ""), options.get("actions", "")) if part)
    for role, keys in (("pick", ("pickup_dispenser",)), ("drop", ("dropoff_ingestor",)), ("charger", ("is_charger",))):
        if any(options.get(key) for key in keys):
            return role
    if CHARGES.search(text):
        return "charger"
    is_pick, is_drop = PICKS.search(text) is not None, DROPS.search(text) is not None
    if is_pick != is_drop:
        return "pick" if is_pick else "drop"
    if not is_pick and (options.get("is_parking_spot") or options.get("is_holding_point") or PARKS.search(text)):
        return "parking"
    return "place"


def _name(nav: NavGraph, v: int) -> str:
    """What a vertex is called in a scenario: as its station, where that has no other."""
    stations = str(nav.vertex_options[v].get("station", "")).split(STATIONS)
    own = next((name for name in stations if name and nav.vertex_of_name.get(name) == v), "")
    return own or nav.label(v)


def _fitting_type(map_values: Mapping[str, Any], folder: Path, maps: MapCache, wanted: str) -> tuple[SetUp, str]:
    """A map with the vehicle that it lists, else the largest type that reaches nearly all its stations; with two, where two small ones fit.

    Forklifts are tried where the map was drawn for such vehicles.
    """

    def with_type(model: str | dict[str, Any], count: int = 1) -> SetUp:
        return set_up(scenario_of({"map": dict(map_values), "robots": {"count": count, "type": model}}, folder, "s"), maps)

    if wanted:
        return with_type(wanted), "as you say"
    smallest, refused = with_type(SMALL), []
    reached, count = _reached(smallest), max(1, min(2, _room(smallest)))
    is_industrial = any("path" in options or "edge_id" in options for options in smallest.map.nav.lane_options)
    guess = "guessed: the largest type that reaches the stations; `mrp-sumo list robots` names others, docs/robots.md your own"
    candidates: list[tuple[str, str | dict[str, Any], str]] = [(name, name, guess) for name in (LARGE, MEDIUM)[not is_industrial :]]
    if vehicle := smallest.map.longest_vehicle:
        read, known = "length and speed" if vehicle.width_m is None else "size and speed", type_of(vehicle)
        own = {key: value for key, value in asdict(known or type_like(vehicle)).items() if key not in ("name", "source")}
        said = f"{read} are those of the map's {vehicle.name!r}, the rest is guessed"
        candidates.insert(0, (vehicle.name, own, f"the map's {vehicle.name!r}" if known else said))
    for name, model, why in candidates:
        try:
            setup = with_type(model, count)
        except MrpSumoError as error:
            refused.append(f"{name}: {str(error).partition(': ')[2]}")
            continue
        if _reached(setup) >= KEPT * reached:
            return setup, why
        refused.append(
            f"{name}: reaches {_reached(setup):.0f} of {reached:.0f} {'m2' if setup.problem.graph.kind == 'grid' else 'stations'}"
        )
    return smallest, f"guessed, as larger ones do not fit ({refused[-1]})"


def type_of(vehicle: ListedVehicle) -> RobotType | None:
    """The type with which a map was written for a vehicle; None without, or where the vehicle has another size or speed by now."""
    if not vehicle.as_type:
        return None
    known = type_of_text(vehicle.name, vehicle.as_type, f"{TYPE_KEY} of vehicle '{vehicle.name}'")
    figures = ((known.length_m, vehicle.length_m), (known.width_m, vehicle.width_m), (known.max_speed_mps, vehicle.max_speed_mps))
    return known if all(b is not None and abs(a - b) < SAME for a, b in figures) else None


def type_like(vehicle: ListedVehicle) -> RobotType:
    """A type of robots with a vehicle's size and speed; the rest is that of the bundled type that is about as long."""
    folder = bundled_folder("robots")
    like = min((robot_type(name, folder, folder) for name in (LARGE, MEDIUM)), key=lambda each: abs(each.length_m - vehicle.length_m))
    width_m = round(SLENDER * vehicle.length_m, 3) if vehicle.width_m is None else vehicle.width_m
    return replace(like, length_m=vehicle.length_m, width_m=width_m, max_speed_mps=vehicle.max_speed_mps)


def _room(setup: SetUp) -> int:
    fleet = setup.problem.fleet
    return most_drawn(setup.problem.graph, 0, fleet.separation_m, vehicle=fleet.types[0])


def _reached(setup: SetUp) -> float:
    """Number of stations that robots reach from each other; of a grid, whose cells are as large as robots need, their area in m2."""
    graph = setup.problem.graph
    return len(stands_of(graph, vehicle=setup.problem.fleet.types[0]).goal) * (
        setup.scenario.discretisation.cell_m**2 if graph.kind == "grid" else 1.0
    )


def _num_robots(setup: SetUp, wanted: int | None) -> tuple[int, str]:
    if wanted is not None:
        return wanted, "as you say"
    room = _room(setup)
    if listed := min(len(setup.map.vehicles), room):
        return listed, f"as many vehicles as the map lists{'' if listed == len(setup.map.vehicles) else ' and has room for'}"
    why = f"guessed: {room} may stand at stations at once; a robot for {STATIONS_A_ROBOT} of them, at most {MOST_ROBOTS}"
    return first_count(room, MOST_ROBOTS), f"{why}; `capacity` knows better"


def _proposal(map_values: Mapping[str, Any], name: str, setup: SetUp, stations: Stations, num_robots: int, wishes: Wishes) -> Proposal:
    groups, stops, choice = stations.groups, stations.stops, setup.scenario.discretisation
    trip_s = _trip_s(setup, [groups[stop] for stop in stops])
    service_s = SERVICE_S[1] if wishes.service_s is None else wishes.service_s
    order_s = 2 * trip_s + 2 * service_s  # to the first stop and on to the second
    rate_per_h = float(f"{BUSY * num_robots * 3600 / order_s:.2g}") if wishes.rate_per_h is None else wishes.rate_per_h
    service: dict[str, Any] = {"triangular_s": list(SERVICE_S)} if wishes.service_s is None else {"constant_s": wishes.service_s}
    stream = {"name": "order", "arrivals": {"rate_per_h": rate_per_h}, "stops": stops, "service": [service]}
    tasks: dict[str, Any] = {"groups": groups, "streams": [stream]}
    why = {
        "groups": "guessed: cells far apart from each other, as the map names no places"
        if choice.kind == "grid"
        else "by what the map says of its places, else by their names: move names where that is wrong",
        "cell": f"the least {'cell' if choice.kind == 'grid' else 'step'} from 0.4 m that '{setup.problem.fleet.type_name[0]}' needs",
        "orders": f"guessed: a way between stops takes {trip_s:.0f} s, so robots work {BUSY:.0%} of their time if nobody is in their way"
        if wishes.rate_per_h is None
        else "as you say",
        "service": "guessed: least, usual and most" if wishes.service_s is None else "as you say",
    }
    if "charger" in groups and all(model.battery is not None for model in robot_types(setup.file)):
        tasks["charging"] = {"stations": ["charger"], "policy": "opportunity"}
        why["charging"] = "robots charge when they have nothing else to do; they begin with full batteries"
    robots = setup.scenario.robots
    if "parking" in groups:
        tasks["parking"] = ["parking"]
    values = {
        "name": name,
        "map": dict(map_values),
        "discretisation": {"kind": choice.kind, "cell_m": choice.cell_m},
        "robots": {"count": num_robots, "type": robots.model_dump(exclude_defaults=True).get("type", robots.type)},
        "planner": "auto",
        "tasks": tasks,
        "execution": {
            "dispatcher": "nearest",
            "time_limit_s": max(1200.0, round(ORDERS_A_ROBOT * order_s)) if wishes.hours is None else 3600.0 * wishes.hours,
        },
    }
    return Proposal(values, why, order_s, stations.unreached, setup.map.doubts)


def _trip_s(setup: SetUp, groups: Sequence[Sequence[str]]) -> float:
    """The mean time of a way between stops, at the speed that each lane allows and without turns."""
    from scipy.sparse import csr_array
    from scipy.sparse.csgraph import dijkstra

    graph, nav, fleet = setup.problem.graph, setup.map.nav, setup.problem.fleet
    starts, ends = ([int(graph.vertex_of_station[nav.vertex_of_name[name]]) for name in group[:ENDS]] for group in groups)
    lane_s = graph.length_m / np.minimum(graph.speed_mps, fleet.max_speed_mps[0])
    lane_s = np.where(graph.is_ride, setup.problem.step_s, lane_s)  # a ride is as many lanes as it takes steps
    way_s = dijkstra(csr_array((lane_s, graph.head, graph.first), shape=(graph.num_vertices,) * 2), indices=starts)[:, ends]
    reached = way_s[np.isfinite(way_s) & (way_s > 0)]
    return float(reached.mean()) if len(reached) else setup.problem.step_s


def _fault(file: ScenarioFile, maps: MapCache, order_s: float) -> str:
    """Why a scenario does not run for ten simulated minutes, in which orders are done that have been there for long; '' where it does."""
    execution = replace(file.scenario.execution, time_limit_s=TRIAL_S, engine="kinematic")
    record = file.scenario.record.model_copy(update={"bag": False})
    try:
        result = carry_out(file.having(execution=execution, record=record), maps)
    except MrpSumoError as error:
        return str(error)
    if result.status != "completed":
        return f"{result.status.replace('_', ' ')}: {result.note}"
    tasks = result.execution.tasks if result.execution is not None else None
    return "" if tasks is None or not stands_still(tasks, order_s) else "no order is done"


def stands_still(tasks: TaskLog, order_s: float) -> bool:
    """True if no order of a trial is done, though one has been there for `AMPLE` times what an order takes undisturbed."""
    orders = some_tasks(tasks, tasks.is_order)
    return not np.isfinite(orders.done_s).any() and bool((orders.released_s < TRIAL_S - AMPLE * order_s).any())
