"""A log in two parts by time, and the scenario that drives the later one as the earlier one was calibrated.

Of the later part only what a planner of the day would know is taken: when orders were released, and for where. At the cut vehicles are at
the vertices nearest to where they were; orders that were open then are released at once, and those on board go on from the stop at which
they were. How long services take is drawn from those of the earlier part, at that station where it has enough, else of that action.
"""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.calibration.log import ActionTime, LoggedOrder, MotionLog, levels_on, require_different, shift_on
from mrp_sumo.calibration.orders import CHARGING
from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.grouping import grouped
from mrp_sumo.core.problem import graphs_of_kinds
from mrp_sumo.errors import MrpSumoError, duration, nearest
from mrp_sumo.experiments.staging.set_up import SetUp
from mrp_sumo.io.documents import Place
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.names import robot_types
from mrp_sumo.io.scenario.read import changed
from mrp_sumo.traffic.draw import Name, shared_at, stands_of

ABSENT_S = 120.0  # without a pose, after which nobody knows where a vehicle is
SEEN = 0.9  # share of the later part: who is seen for less is said
BACK_S = 60.0  # by which a clock may jump back
SHORTEST_S = 120.0  # of each part
ENOUGH = 8  # services at a station, from which on it has times of its own
SERVICES = 83  # purpose of the stream of chance
CARRIED = 10**6  # priority of an order that is on board: its robot has nothing else to do


@dataclass(frozen=True, eq=False)
class HeldOut:
    """A log with its cut."""

    log: MotionLog
    begin_s: float
    cut_s: float
    end_s: float
    vehicles: tuple[str, ...]  # that are there at the cut, by type and name
    kind: IntArray  # [R] types
    xy: FloatArray  # [R, 2] m, at the cut, laid out
    level: IntArray  # [R]
    orders: tuple[LoggedOrder, ...]  # released or not done in the later part
    notes: list[str] = field(default_factory=list)

    @property
    def span_s(self) -> float:
        """Length of the later part."""
        return self.end_s - self.cut_s

    @property
    def kinds(self) -> list[int]:
        """Types that vehicles are of, ascending."""
        return sorted(set(self.kind.tolist()))

    def earlier(self, kind: int | None = None) -> MotionLog:
        """The log before the cut; of one type of vehicles only."""
        others = {v for v, k in zip(self.vehicles, self.kind.tolist()) if kind is not None and k != kind}
        return _between(self.log, -math.inf, self.cut_s, others)

    def later(self) -> MotionLog:
        """The log from the cut on."""
        return _between(self.log, self.cut_s, math.inf)


def _between(log: MotionLog, begin_s: float, end_s: float, others: Collection[str] = ()) -> MotionLog:
    """The log of a time, without some other vehicles."""
    poses = {name: [row for row in rows if begin_s <= row[0] < end_s] for name, rows in log.poses.items() if name not in others}
    visits = [v for v in log.visits if v.vehicle not in others and begin_s <= v.begin_s and v.end_s <= end_s]
    charges = [c for c in log.charges if c.vehicle not in others and begin_s <= c.t_s < end_s]
    return replace(log, poses={name: rows for name, rows in poses.items() if rows}, visits=visits, charges=charges, notes=[])


def cut(log: MotionLog, setup: SetUp, share: float) -> HeldOut:
    """The log cut such that a share of its time is held out. Raises MrpSumoError for what cannot be compared, in one line."""
    times = {name: np.array([row[0] for row in rows]) for name, rows in log.poses.items() if len(rows) > 1}
    if not times:
        raise MrpSumoError(f"{log.source}: too short to tell anything: no vehicle has two poses")
    for name, t in times.items():
        back = np.diff(t)
        if (back < -BACK_S).any():
            k = int(np.argmin(back))
            raise MrpSumoError(
                f"{log.source}: the clock of '{name}' jumps back by {duration(-float(back[k]))} at {t[k]:.0f} s, so that nobody knows "
                "when its orders were done: cut the log there"
            )
    require_different(log)
    begin_s, end_s = (float(np.median([getattr(t, end)() for t in times.values()])) for end in ("min", "max"))
    odd = [name for name, t in times.items() if t.max() < begin_s or t.min() > end_s]
    if odd:
        t = times[odd[0]]
        off = duration(float(begin_s - t.min() if t.max() < begin_s else t.min() - begin_s))
        raise MrpSumoError(f"{log.source}: the clock of '{odd[0]}' is {off} off those of the others")
    cut_s = end_s - share * (end_s - begin_s)
    if min(cut_s - begin_s, end_s - cut_s) < SHORTEST_S:
        raise MrpSumoError(
            f"{log.source}: {duration(end_s - begin_s)} in all, too short to tell anything: expected {SHORTEST_S:.0f} s in each part"
        )
    notes = list(log.notes)
    there = [name for name, t in times.items() if np.abs(t - cut_s).min() < ABSENT_S]
    if gone := sorted(set(log.poses) - set(there)):
        notes.append(f"left out, since nobody knows where they are at the cut: {', '.join(gone)}")
    if not there:
        raise MrpSumoError(f"{log.source}: no vehicle says where it is around {cut_s:.0f} s, where the log is cut")
    seen = {name: _seen(times[name], cut_s, end_s) for name in there}
    missing = [f"{name} for {share:.0%}" for name, share in sorted(seen.items()) if share < SEEN]
    if missing:
        notes.append(f"seen for a part of the later part only, and driven for all of it: {', '.join(missing)}")
    kinds = _kinds(log, setup.file, there)
    vehicles = sorted(there, key=lambda name: (kinds[name], _natural(name)))
    on, by = levels_on(log, setup.map), shift_on(log, setup.map)
    rows = [log.poses[name][int(np.argmin(np.abs(times[name] - cut_s)))] for name in vehicles]
    level = np.array([on.get(row[5], 0) for row in rows], np.int64)
    xy = np.array([row[1:3] for row in rows]) + by[level]
    orders = tuple(order for order in log.orders if not order.ended_s < cut_s and order.release_s < end_s)
    if lost := sorted({order.vehicle for order in orders} - {"", *vehicles}):
        notes.append(f"orders of {', '.join(lost)}, of which there are no poses at the cut, are left out")
        orders = tuple(order for order in orders if order.vehicle not in lost)
    return HeldOut(log, begin_s, cut_s, end_s, tuple(vehicles), np.array([kinds[name] for name in vehicles]), xy, level, orders, notes)


def _seen(pose_s: FloatArray, begin_s: float, end_s: float) -> float:
    """Share of a time in which a vehicle has a pose that is not too long ago or ahead."""
    at_s, pose_s = np.linspace(begin_s, end_s, 101), np.sort(pose_s)
    k = np.clip(np.searchsorted(pose_s, at_s), 1, len(pose_s) - 1)
    return float((np.minimum(np.abs(at_s - pose_s[k - 1]), np.abs(pose_s[k] - at_s)) < ABSENT_S).mean())


def _natural(name: str) -> list[Any]:
    """A key by which robot_10 comes after robot_9."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", name)]


def _kinds(log: MotionLog, file: ScenarioFile, vehicles: Sequence[str]) -> dict[str, int]:
    """Types of vehicles: that of the scenario, or the one that the log, or the scenario's fleet, names."""
    models = robot_types(file)
    if len(models) == 1:
        return dict.fromkeys(vehicles, 0)
    names = [model.name for model in models]
    sizes = [group.size for group in file.scenario.robots.groups]
    fleet = {f"robot_{n}": k for n, k in enumerate(np.repeat(np.arange(len(sizes)), sizes).tolist())}
    kinds = {}
    for vehicle in vehicles:
        kind = names.index(log.types[vehicle]) if log.types.get(vehicle) in names else fleet.get(vehicle)
        if kind is None:
            raise MrpSumoError(
                f"{log.source}: nobody knows whether '{vehicle}' is of type {' or '.join(names)}, expected names of the scenario's fleet, "
                f"robot_0 to robot_{len(fleet) - 1}"
            )
        kinds[vehicle] = kind
    return kinds


def starts_at(held: HeldOut, setup: SetUp) -> list[str]:
    """[R] names of the vertices at which vehicles start: the nearest on which they may stand at once, the nearer vehicle first.

    Raises MrpSumoError where there is none for one.
    """
    problem, nav = setup.problem, setup.map.nav
    graphs, of = graphs_of_kinds(problem.graph, problem.barred, len(problem.fleet.types)), problem.graph.vertex_of_station
    stands = [stands_of(graph, vehicle=model if model.is_vehicle else None).start for graph, model in zip(graphs, robot_types(setup.file))]
    free = [np.flatnonzero(np.isin(of, each)) for each in stands]
    shared, taken = shared_at(problem.graph, np.unique(np.concatenate(stands)), problem.fleet.separation_m), set[Name]()
    by_type, start = [free[k] for k in held.kind.tolist()], np.full(len(held.xy), -1)
    away = [
        np.hypot(*(nav.xy[vertices] - place).T) + 1e6 * (nav.level[vertices] != on)
        for place, on, vertices in zip(held.xy, held.level, by_type)
    ]
    for r in sorted(range(len(away)), key=lambda r: (float(away[r].min(initial=np.inf)), r)):
        for v in by_type[r][np.argsort(away[r], kind="stable")].tolist():
            own = {*shared.get(int(of[v]), ()), ("vertex", int(of[v]))}
            if taken.isdisjoint(own):
                taken |= own
                start[r] = v
                break
        else:
            odd = held.vehicles[r]
            raise MrpSumoError(f"{held.log.source}: '{nav.name}' has no vertex left for '{odd}' to start at: too many vehicles for the map")
    return [nav.label(v) for v in start.tolist()]


class ServiceTimes:
    """Times of services in the earlier part, by station and action."""

    def __init__(self, visits: Sequence[ActionTime], station_of: Mapping[str, str]) -> None:
        self._visits, self._station_of = visits, station_of
        served = [(visit, visit.end_s - visit.begin_s) for visit in visits if visit.action not in CHARGING]
        self._at = grouped(((station_of.get(visit.station, visit.station), visit.action), lasted_s) for visit, lasted_s in served)
        self._of = grouped((visit.action, lasted_s) for visit, lasted_s in served)

    @property
    def is_known(self) -> bool:
        return bool(self._of)

    def another(self, rng: np.random.Generator) -> "ServiceTimes":
        """Times that such a part might have had instead (bootstrap, Efron, 1979): what is predicted moves by what the log does not tell."""
        return ServiceTimes([self._visits[k] for k in rng.integers(len(self._visits), size=len(self._visits))], self._station_of)

    def drawn_s(self, station: str, action: str, rng: np.random.Generator, beyond_s: float = 0.0) -> float:
        """A time, or what is left of one that has lasted for a while."""
        mine = self._at.get((station, action), [])
        times = np.array(mine if len(mine) >= ENOUGH else self._of.get(action) or [t for each in self._of.values() for t in each])
        times = times[times > beyond_s] - beyond_s
        return round(float(rng.choice(times)), 3) if len(times) else 0.0


def action_of(nth: int, count: int) -> str:
    """The action at the n-th of so many stops of an order."""
    return "pick" if nth == 0 else "drop" if nth == count - 1 else "service"


def stations_of(file: ScenarioFile) -> dict[str, str]:
    """Stations of a scenario by their places, where these have one each."""
    stations = file.scenario.tasks.stations if file.scenario.tasks else {}
    by_place = grouped((place, name) for name, station in stations.items() for place in station.places)
    return {place: names[0] for place, names in by_place.items() if len(names) == 1 and place not in stations}


def with_stations(orders: Sequence[LoggedOrder], setup: SetUp, source: str) -> list[LoggedOrder]:
    """Orders whose stops have the scenario's names. Raises MrpSumoError for one that it does not have."""
    tasks, nav = setup.scenario.tasks, setup.map.nav
    stations, station_of = (tasks.stations if tasks else {}), stations_of(setup.file)
    known = {*stations, *nav.vertex_of_name}
    named = [*stations, *filter(None, nav.vertex_name)]
    for order in orders:
        where = order.where or f"{source}: order '{order.name}'"
        for stop in order.stops:
            if not stop:
                raise MrpSumoError(f"{where}: the log does not say at which station '{order.vehicle}' was served")
            if stop not in known:
                raise MrpSumoError(f"{where}: '{stop}' is no station or vertex of the scenario{nearest(stop, named)}")
    return [replace(order, stops=tuple(station_of.get(stop, stop) for stop in order.stops)) for order in orders]


def tasks_of(held: HeldOut, times: ServiceTimes, seed: int) -> list[dict[str, Any]]:
    """Orders of the later part as tasks of a scenario, whose clock begins at the cut."""
    rng = np.random.default_rng([seed, SERVICES])
    times, robot_of = times.another(rng) if times.is_known else times, {name: f"robot_{r}" for r, name in enumerate(held.vehicles)}
    made = []
    for order in held.orders:
        asks = {key: value for key, value in order.asks.items() if key not in ("robot", "due_s", "service_s")}
        release_s = max(0.0, order.release_s - held.cut_s)
        if "due_s" in order.asks:
            asks["due_s"] = max(release_s, order.asks["due_s"] - held.cut_s)
        if order.asks.get("robot") in robot_of:
            asks["robot"] = robot_of[order.asks["robot"]]
        begun = [k for k, (begin_s, _) in enumerate(order.services) if begin_s < held.cut_s]
        first, lasted_s = 0, 0.0
        if begun and order.vehicle in robot_of:
            is_served = order.services[begun[-1]][1] > held.cut_s
            first = begun[-1] if is_served else begun[-1] + 1
            lasted_s = held.cut_s - order.services[first][0] if is_served else 0.0
            asks |= {"robot": robot_of[order.vehicle], "priority": CARRIED}
        count = len(order.stops)
        if first >= count:
            continue
        service_s: Any = order.asks.get("service_s", 0.0)
        if times.is_known:
            service_s = [
                times.drawn_s(order.stops[k], action_of(k, count), rng, lasted_s if k == first else 0.0) for k in range(first, count)
            ]
        elif isinstance(service_s, list):
            service_s = service_s[first:]
        made.append({"name": order.name, "stops": list(order.stops[first:]), "release_s": release_s, "service_s": service_s, **asks})
    return made


def more_of(tasks: Sequence[Mapping[str, Any]], span_s: float) -> list[dict[str, Any]]:
    """A third of the tasks once more, for simulations that always have some open and may be faster than the log."""
    new = [task for task in tasks if task["release_s"] > 0]
    return [{**task, "name": f"{task['name']} again", "release_s": span_s, "due_s": None} for task in new[: len(new) // 3 + 1]]


def scenario_of_later(
    held: HeldOut, setup: SetUp, types: Sequence[Path], disturbances: Mapping[str, Any], times: ServiceTimes
) -> ScenarioFile:
    """The scenario whose run is the later part, with files of calibrated types and disturbances. Raises MrpSumoError."""
    file, starts = setup.file, starts_at(held, setup)
    ends = np.searchsorted(held.kind, np.arange(len(types) + 1)).tolist()
    groups = [{"type": str(path), "starts": starts[a:b]} for path, (a, b) in zip(types, pairwise(ends)) if b > a]
    tasks = {} if file.scenario.tasks is None else file.scenario.tasks.model_dump()
    tasks |= {"file": None, "streams": (), "profile": (), "open": _open(file), "list": _listed(held, file, times, file.scenario.seed)}
    if times.is_known:
        tasks["service_factor"] = {}
    if tasks.get("charging") and (levels := _levels_at(held)):
        tasks["charging"] = {**tasks["charging"], "start_level": levels}
    data: dict[Place, Any] = {
        ("robots",): groups,
        ("tasks",): tasks,
        ("record", "bag"): False,
        ("execution", "time_limit_s"): round(held.span_s, 3),
        **{("execution", "disturbances", name): value for name, value in disturbances.items()},
    }
    if file.scenario.people is not None:
        data["people", "clock_h"] = (file.scenario.people.clock_h + (held.cut_s - held.begin_s) / 3600) % 24
    return changed(file, {place: ("the log", value) for place, value in data.items()})


def with_seed(scenario: ScenarioFile, held: HeldOut, file: ScenarioFile, times: ServiceTimes, seed: int) -> ScenarioFile:
    """The scenario of the later part of a site's scenario with another seed, and other draws of services."""
    return changed(scenario, {("seed",): ("the log", seed), ("tasks", "list"): ("the log", _listed(held, file, times, seed))})


def _listed(held: HeldOut, file: ScenarioFile, times: ServiceTimes, seed: int) -> list[dict[str, Any]]:
    listed = tasks_of(held, times, seed)
    return listed + (more_of(listed, held.span_s) if _open(file) else [])


def _open(file: ScenarioFile) -> int | None:
    """Number of orders that are always open, where the scenario has it so."""
    tasks = file.scenario.tasks
    if tasks is None:
        return None
    always = [stream.arrivals.open for stream in tasks.streams if stream.arrivals.open]
    return tasks.open or (sum(always) if always and len(always) == len(tasks.streams) and not tasks.list and not tasks.file else None)


def _levels_at(held: HeldOut) -> list[float]:
    """Least and most state of charge at the cut, in percent; nothing where nobody says it."""
    last: dict[str, float] = {}
    for each in held.log.charges:
        if each.t_s <= held.cut_s:
            last[each.vehicle] = each.share
    levels = [100 * share for name, share in last.items() if name in held.vehicles]
    return [round(min(levels), 3), round(max(levels), 3)] if levels else []
