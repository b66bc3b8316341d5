"""A prediction held against what came: robots calibrated on the earlier part of a log, driven on the orders of the later one.

Some runs are made, each with a seed of its own, calibrated figures drawn from their intervals, and services drawn anew. What they have in
the median is predicted, and a band of 90 % is where the log, as one more of them, is expected. How far vehicles differ is not drawn: they
are the same ones. Figures of both are made by the same functions: lead times of orders that are released after the cut, not done by the
end counting as longer than any; standing before services at stations; orders done an hour; shares of the time for which vehicles have
orders, and the station of the most services serves.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.calibration.estimates import ANY_NOISE, LIMITS, Calibration, calibrated
from mrp_sumo.calibration.files import differing, disturbances_of, drift, type_of, write_options
from mrp_sumo.calibration.held_out import HeldOut, ServiceTimes, cut, scenario_of_later, stations_of, with_seed, with_stations
from mrp_sumo.calibration.log import MotionLog, require_here
from mrp_sumo.calibration.logged_run import logged_run
from mrp_sumo.core.disturbances import Disturbances
from mrp_sumo.core.execution import Execution
from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.robot_type import RobotShape
from mrp_sumo.core.task import StopLog, orders_of
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.error_bands import as_changes, quantities, rounded
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.result import RunResult
from mrp_sumo.experiments.run import carry_out
from mrp_sumo.experiments.staging.set_up import set_up
from mrp_sumo.experiments.statistics import t_quantile
from mrp_sumo.io.documents import Place
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.names import robot_types
from mrp_sumo.io.scenario.read import changed

BAND = 0.9
NORMAL = 1.6449  # of a 90 % interval
OF_STOPS = ("stops_per_s", "stop_median_s", "stop_sigma")
DRAWN = 89  # purpose of the stream of chance
FEW = 5  # orders, from which on distributions are compared
NEAR_M, STANDS_MPS, WITHIN_S = 5.0, 0.1, 3.0  # of a station, where standing is waiting for it; over how long speeds are taken
HOUR_S = 3600.0

Report = Callable[[str, float, float], None]


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Outcomes of a run, or of a log, over the later part."""

    lead_time_s: FloatArray  # [N] inf: not done by the end
    station_wait_s: FloatArray  # [S]
    done_s: FloatArray  # ascending, of all orders that were done
    throughput_per_h: float
    robots_busy_share: float
    station_busy_share: float


@dataclass(frozen=True)
class ComparedFigure:
    """A figure of the log beside what was predicted."""

    name: str
    label: str
    unit: str
    logged: float
    predicted: float
    low: float
    high: float

    @property
    def error(self) -> float:
        """Share by which the prediction is above the log; NaN where the log has nothing to divide by."""
        return self.predicted / self.logged - 1 if self.logged > 0 else math.nan

    @property
    def holds(self) -> bool:
        """True if the log is within the band."""
        return self.low <= self.logged <= self.high

    @property
    def document(self) -> dict[str, Any]:
        figures = {key: rounded(getattr(self, key), 6) for key in ("logged", "predicted", "low", "high", "error")}
        return {**figures, "unit": self.unit, "band_holds": self.holds}


@dataclass(frozen=True, eq=False)
class Prediction:
    """A log beside what was predicted of it."""

    held: HeldOut
    calibrations: tuple[Calibration, ...]  # by type
    station: str  # the one of the most services in the log
    logged: Outcomes
    simulated: tuple[Outcomes, ...]  # by run
    figures: tuple[ComparedFigure, ...]
    log_run: RunResult
    run: RunResult  # the simulation whose median lead time is in the middle
    drift: dict[str, str]  # figures of the later part that no longer fit those of the earlier one
    files: tuple[Path, ...]  # types, each with its disturbances beside it
    notes: list[str] = field(default_factory=list)

    @property
    def document(self) -> dict[str, Any]:
        held = self.held
        return {
            "log": held.log.source,
            "kind": held.log.kind,
            "begin_s": round(held.begin_s, 3),
            "cut_s": round(held.cut_s, 3),
            "end_s": round(held.end_s, 3),
            "vehicles": list(held.vehicles),
            "orders": {"logged": len(self.logged.lead_time_s), "done": len(self.logged.done_s)},
            "runs": len(self.simulated),
            "band": BAND,
            "figures": {each.name: each.document for each in self.figures},
            "bands_hold": all(each.holds for each in self.figures),
            "busiest_station": self.station,
            "calibrated": {
                path.stem: {name: each.document for name, each in one.quantities.items()}
                for path, one in zip(self.files, self.calibrations)
            },
            "drift": self.drift,
            "notes": self.notes,
        }


def predicted(
    file: ScenarioFile, log: MotionLog, *, hold_out: float, runs: int, folder: Path, maps: MapCache, report: Report
) -> Prediction:
    """Predict the later part of a log, a share of its time, by some simulations. Raises MrpSumoError: one line, for one that does not fit.

    `file` is the site: map, stations, planner, dispatcher, and types as far as the log does not tell them. Files of the types are written
    into `folder`.
    """
    setup = set_up(file, maps)
    require_here(log, setup.map, on_grid=file.scenario.discretisation.kind == "grid")
    log = replace(log, orders=with_stations(log.orders, setup, log.source))
    held = cut(log, setup, hold_out)
    _require_orders(held)
    report("calibrating", 0.0, 0.0)
    before = held.earlier()
    times = ServiceTimes(before.visits, stations_of(file))
    is_mixed = len(robot_types(file)) > 1
    calibrations = tuple(calibrated(held.earlier(kind), before) if is_mixed else calibrated(before) for kind in held.kinds)
    held.notes.extend(note for one in calibrations for note in one.log.notes)
    disturbing, files = _write(held, calibrations, file, folder, times.is_known)
    _note_what_is_assumed(held, file, times)
    _note_what_is_not_told(held, file, calibrations)
    base, seed = scenario_of_later(held, setup, files, disturbing, times), file.scenario.seed
    made: list[RunResult] = []
    station, standing = _busiest(held), []
    for n, moves in enumerate(_drawn(base, runs, seed)):
        report(f"driving run {n + 1} of {runs}", float(n), float(runs))
        result = carry_out(changed(with_seed(base, held, file, times, seed + n), as_changes(moves)), maps)
        if result.execution is None or result.execution.tasks is None:
            raise MrpSumoError(f"the simulation of {held.log.source}: {result.status.replace('_', ' ')}: {result.note}")
        if result.status == "stalled":
            standing.append(result.note)
        else:
            made.append(result)
    _note_standstills(held, standing, runs, bool(made))
    simulated = tuple(outcomes_of(each, held, station) for each in made)
    middle = made[_middle(simulated)]
    report("comparing", 0.0, 0.0)
    log_run = logged_run(held, middle.setup)
    logged = outcomes_of(log_run, held, station)
    figures = tuple(_compared(logged, simulated, station, (HOUR_S / held.span_s, _period_s(held))))
    gone = _drift(held, files, calibrations)
    return Prediction(held, calibrations, station, logged, simulated, figures, log_run, middle, gone, files, held.notes)


def _note_standstills(held: HeldOut, standing: Sequence[str], runs: int, is_enough: bool) -> None:
    """Say of simulations that came to a standstill. Raises MrpSumoError where no others are left to predict from."""
    if standing:
        said = f"{len(standing)} of {runs} simulations came to a standstill ({standing[0]})"
        if not is_enough:
            raise MrpSumoError(f"{held.log.source}: {said}, expected some that do not")
        held.notes.append(f"{said}; they are not counted, and a planner with less in the way may not have them")


def _require_orders(held: HeldOut) -> None:
    new = [order for order in held.orders if order.release_s >= held.cut_s]
    if len(new) < FEW:
        what = "the log has no orders"
        if held.log.orders:
            first_s, last_s = held.log.orders[0].release_s, held.log.orders[-1].release_s
            what = f"{len(new)} orders are released in {held.cut_s:.0f} to {held.end_s:.0f} s, all in {first_s:.0f} to {last_s:.0f} s"
        more = "" if held.log.orders else "; give them with --orders FILE.csv"
        actions = sorted({visit.action for visit in held.log.visits})
        if actions and "pick" not in actions:
            more += f"; its actions are {', '.join(actions[:5])}, expected pick and drop"
        raise MrpSumoError(f"{held.log.source}: {what}, expected {FEW} or more to compare{more}")
    if sum(order.done_s < held.end_s for order in new) < FEW:
        raise MrpSumoError(
            f"{held.log.source}: fewer than {FEW} orders that came after {held.cut_s:.0f} s were done by the end of the log, as far as it "
            f"tells; expected {FEW} or more, with actions at stations, or a longer log"
        )


def _write(
    held: HeldOut, calibrations: Sequence[Calibration], file: ScenarioFile, folder: Path, is_served: bool
) -> tuple[dict[str, Any], tuple[Path, ...]]:
    """Write the types, and beside each what disturbs all: one set, in which each type counts by its episodes."""
    types = robot_types(file)
    models = [types[kind] for kind in held.kinds]
    disturbing = _together([disturbances_of(one) for one in calibrations], calibrations)
    disturbing["intervals"].setdefault("speed_noise", [0.0, ANY_NOISE])  # where no log tells it
    if file.scenario.people is not None:  # who walk there, and stop robots, themselves
        for figures in (disturbing, disturbing["intervals"]):
            for name in OF_STOPS:
                figures.pop(name, None)
    paths = []
    for model, one in zip(models, calibrations):
        shape = RobotShape(**{name: value for name, value in vars(model).items() if name != "name"})
        made = type_of(one, shape)
        plain = replace(made, actions=None, intervals={name: ends for name, ends in made.intervals.items() if name in LIMITS})
        path = folder / f"{model.name}.yaml"
        write_options(plain if is_served else made, path)
        write_options(Disturbances(**disturbing), path.with_name(f"{path.stem}.disturbances.yaml"))
        paths.append(path)
    return disturbing, tuple(paths)


def _together(each: Sequence[Disturbances], calibrations: Sequence[Calibration]) -> dict[str, Any]:
    """Figures of several types as one, by weight of the episodes that they are from."""
    figures: dict[str, Any] = {"intervals": {}}
    for name in dict.fromkeys(name for one in each for name in one.intervals):
        known = [(one, calibration) for one, calibration in zip(each, calibrations) if name in one.intervals]
        # rates count by time, all others by their episodes
        weights = np.array([one.span_s if name == "stops_per_s" else max(one.quantities[name].count, 1) for _, one in known])
        rows = np.array([(getattr(one, name), *one.intervals[name]) for one, _ in known])
        value, low, high = (float(f"{number:.4g}") for number in weights @ rows / weights.sum())
        figures[name], figures["intervals"][name] = value, [min(low, value), max(high, value)]
    if "stops_per_s" in figures:  # whose rate is that of stops as long as these
        figures = {name: getattr(each[0], name) for name in ("stop_median_s", "stop_sigma")} | figures
    return figures


def _note_what_is_assumed(held: HeldOut, file: ScenarioFile, times: ServiceTimes) -> None:
    if not times.is_known:
        held.notes.append("the log does not say how long services take: as the scenario's types and the orders have it")
    if file.scenario.people is not None:
        held.notes.append("stops on the way are those that the scenario's people cause")
    if any(order.release_s == order.assigned_s for order in held.orders) and held.log.kind != "run folder":
        held.notes.append("orders count as released when a vehicle has them, since the log does not say it; --orders FILE.csv does")


def _note_what_is_not_told(held: HeldOut, file: ScenarioFile, calibrations: Sequence[Calibration]) -> None:
    untold = {name: why for one in calibrations for name, why in one.unknown.items()}
    usual = dict.fromkeys(LIMITS, "as in the scenario's types") | {"speed_noise": f"drawn up to {ANY_NOISE:g}"}
    usual |= {} if file.scenario.people else {"stops_per_s": "none"}
    held.notes.extend(f"{name} is not told by the earlier part ({untold[name]}): {usual[name]}" for name in usual if name in untold)


def _drawn(file: ScenarioFile, runs: int, seed: int) -> Iterator[dict[Place, float]]:
    """Calibrated figures of each run, drawn from their intervals: evenly over the lognormal ones, in an order of their own each.

    But for the rate of stops and how long they last, one high where the other is low: many short ones or few long ones explain a log.
    """
    from scipy.special import ndtri

    rng = np.random.default_rng([seed, DRAWN])
    of = [quantity for quantity in quantities(file, {}, ()) if quantity.is_given and quantity.ends[0][0][-1] != "speed_spread"]
    deviates = np.stack([rng.permutation(ndtri((np.arange(runs) + 0.5) / runs)) for _ in of], 1) if of else np.zeros((runs, 0))
    names = [quantity.ends[0][0][-1] for quantity in of]
    if {"stops_per_s", "stop_median_s"} <= set(names):
        deviates[:, names.index("stop_median_s")] = -deviates[:, names.index("stops_per_s")]
    disturbances = file.scenario.execution.disturbances
    for row in np.clip(deviates / NORMAL, -1, 1).tolist():
        moves = {}
        for quantity, share in zip(of, row):
            for place, low, high in quantity.ends:
                usual = 1.0 if place[0] == "robots" else float(getattr(disturbances, str(place[-1])))
                moves[place] = _moved(usual, low, high, share)
        yield moves


def _moved(usual: float, low: float, high: float, share: float) -> float:
    """A value on the way from the usual one to the end of its interval, by factors where it is more than 0."""
    end = high if share > 0 else low
    moved = usual * (end / usual) ** abs(share) if min(usual, end) > 0 else usual + abs(share) * (end - usual)
    return float(f"{moved:.6g}")


def _busiest(held: HeldOut) -> str:
    """The station of the most services. One that was chosen for the longest would be one whose services happened to be long."""
    served = Counter(
        name
        for order in held.orders
        for name, (begin_s, end_s) in zip(order.stops, order.services)
        if end_s > held.cut_s and begin_s < held.end_s
    )
    return max(sorted(served), key=lambda name: served[name], default="")


def outcomes_of(run: RunResult, held: HeldOut, station: str) -> Outcomes:
    """Outcomes of a simulation of the later part, or of the part itself."""
    execution = run.execution
    assert execution is not None and execution.tasks is not None and execution.stops is not None
    tasks, stops = orders_of(execution.tasks, execution.stops)
    assert stops is not None
    span_s = held.span_s
    before = {order.name: order.release_s - held.cut_s for order in held.orders if order.release_s < held.cut_s}
    released_s = np.array([before.get(name, float(t)) for name, t in zip(tasks.name, tasks.released_s.tolist())])
    done_s = np.where(tasks.done_s <= span_s, tasks.done_s, np.inf)
    lead_s = done_s - released_s
    counts = (released_s >= 0) & (released_s <= span_s - _usual_lead_s(held))
    busy_s = np.clip(np.minimum(done_s, span_s) - np.maximum(tasks.assigned_s, 0.0), 0.0, None)
    served_s = np.clip(np.minimum(stops.end_s, span_s) - np.maximum(stops.begin_s, 0.0), 0.0, None)
    there = np.array([name == station for name in stops.station], np.bool_)
    return Outcomes(
        lead_s[counts],
        _waits_s(execution, stops),
        np.sort(done_s[np.isfinite(done_s)]),
        float(np.isfinite(done_s).sum() / span_s * HOUR_S),
        float(np.nansum(busy_s) / (span_s * len(held.vehicles))),
        float(served_s[there].sum() / span_s),
    )


def _usual_lead_s(held: HeldOut) -> float:
    """What 95 % of the orders take: those released so short before the end are not compared. At most a quarter of the part."""
    times = [order.done_s - order.release_s for order in held.log.orders if order.done_s < held.end_s]
    return min(float(np.quantile(times, 0.95)) if times else 0.0, held.span_s / 4)


def _waits_s(execution: Execution, stops: StopLog) -> FloatArray:
    """[S] for how long robots stood near a station, after the stop before, until they were served there."""
    t, period_s = execution.t_s, float(execution.t_s[1] - execution.t_s[0])
    half = max(1, round(WITHIN_S / 2 / period_s))
    waits = []
    for robot, since_s, begin_s in zip(stops.robot.tolist(), stops.since_s.tolist(), stops.begin_s.tolist()):
        a, b = np.searchsorted(t, (max(since_s, 0.0), begin_s))
        if b - a < 2 or b >= len(t):
            continue
        x, y = execution.x_m[:, robot], execution.y_m[:, robot]
        k = np.arange(a, b)
        one, other = np.clip(k - half, 0, len(t) - 1), np.clip(k + half, 0, len(t) - 1)
        moved = np.hypot(x[other] - x[one], y[other] - y[one])
        stands = moved < STANDS_MPS * (t[other] - t[one])
        near = np.hypot(x[k] - x[b], y[k] - y[b]) < NEAR_M
        waits.append(float((stands & near).sum() * period_s))
    return np.array(waits)


def _compared(logged: Outcomes, simulated: Sequence[Outcomes], station: str, least: tuple[float, float]) -> Iterator[ComparedFigure]:
    """Figures side by side. Also where all simulations are alike, bands reach as far as a log tells: `least`, an order more or less done
    an hour, and the time between two poses for a wait."""
    order_per_h, period_s = least

    def figure(name: str, label: str, unit: str, read: Callable[[Outcomes], float], least: float = 0.0) -> ComparedFigure:
        values, reach = np.array([read(each) for each in simulated]), math.inf
        if len(values) > 1 and np.isfinite(values).all():
            reach = t_quantile((1 + BAND) / 2, len(values) - 1) * float(values.std(ddof=1)) * math.sqrt(1 + 1 / len(values))
            reach = max(reach, least)
        middle = float(values.mean())
        return ComparedFigure(name, label, unit, read(logged), float(np.median(values)), max(0.0, middle - reach), middle + reach)

    def quantile(name: str, share: float) -> Callable[[Outcomes], float]:
        return lambda run: _quantile(getattr(run, name), share)

    for name, words, least_s in (("lead_time", "lead time", 0.0), ("station_wait", "wait at stations", period_s)):
        for share, word in ((0.5, "p50"), (0.95, "p95")):
            yield figure(f"{name}_{word}_s", f"{words}, {word}", "s", quantile(f"{name}_s", share), least_s)
    yield figure("throughput_per_h", "orders done an hour", "1/h", lambda run: run.throughput_per_h, order_per_h)
    yield figure("robots_busy_share", "robots with an order", "", lambda run: run.robots_busy_share)
    yield figure("station_busy_share", f"'{station}' serves", "", lambda run: run.station_busy_share)


def _period_s(held: HeldOut) -> float:
    """The usual time between two poses of a vehicle of a log."""
    return float(np.median(np.concatenate([np.diff([row[0] for row in held.log.poses[name]]) for name in held.vehicles])))


def _middle(outcomes: Sequence[Outcomes]) -> int:
    """The run whose median lead time is in the middle, of two the lower."""
    return int(np.argsort([_quantile(each.lead_time_s, 0.5) for each in outcomes], kind="stable")[(len(outcomes) - 1) // 2])


def _quantile(values: FloatArray, share: float) -> float:
    """A quantile of values of which some may be infinite; NaN: there are none."""
    if not len(values):
        return math.nan
    at = share * (len(values) - 1)
    ordered = np.sort(values)
    low, high = float(ordered[math.floor(at)]), float(ordered[math.ceil(at)])
    return low if low == high else low + (at - math.floor(at)) * (high - low)


def _drift(held: HeldOut, files: Sequence[Path], calibrations: Sequence[Calibration]) -> dict[str, str]:
    """Figures of the later part that no longer fit; of a fleet of one type, since its vehicles are those of a file."""
    if len(files) > 1:
        return {}
    try:
        later = calibrated(held.later())
    except MrpSumoError:  # too short to tell
        return {}
    services = {n: (q.value, q.low, q.high) for n, q in calibrations[0].quantities.items() if n.startswith("actions.") and n.endswith("_s")}
    return drift(later, files[0]) | differing(later, services)
