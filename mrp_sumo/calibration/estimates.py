"""A log of a fleet becomes figures with intervals: how vehicles drive, what disturbs them, how long stops take.

Each figure is fitted to episodes: starts, stops, turns, windows at top speed, actions. Intervals are those of scores by episode (or by
minute of a vehicle, where neighbours depend on each other), of profile likelihoods, or of Student's t; where vehicles differ from each
other by more than their episodes explain, each vehicle counts once. What a log does not show is left out, with the reason.
"""

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mrp_sumo.calibration.cruise import (
    HELD,
    LEAST_SCATTER,
    MEAN_LOSS,
    SCATTER_HELD,
    TELLING_STEPS,
    Cruise,
    Scatter,
    fit_cruise,
    of_top_speed,
    student,
    top_windows,
)
from mrp_sumo.calibration.log import ActionTime, Charge, MotionLog, Track, require_different
from mrp_sumo.calibration.phases import Noise, Phases, noise_of, phases_of, refined, usual_speed
from mrp_sumo.calibration.ramps import Ramp, fit_ramp, marginal
from mrp_sumo.calibration.stops import Stops, fit_stops
from mrp_sumo.calibration.turning import TurnFit, fit_turning
from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.grouping import grouped
from mrp_sumo.errors import MrpSumoError

LIMITS = ("max_speed_mps", "accel_mps2", "decel_mps2", "turn_rate_rad_s")
CONFIDENCE = 0.9
ROUNDS = 3
MISFIT_M, MISFIT_RAD = 0.001, 0.0012  # by which vehicles may be elsewhere than the law of motion has them
ROUNDED = 0.5  # of the scatter squared, by which accelerations seem less: a speed that scatters rounds where a ramp meets it
AT_ONCE, TURNS_AT_ONCE = 0.25, 0.5  # of a log's period: ramps and turns that are shorter are not told
COARSE_S, ANY_NOISE = 2.5, 0.15  # period from which on logs do not tell how speed scatters; it may be as much as this
SLOWEST_MPS = 0.02  # at which vehicles drive that are vehicles
LEAST_EXTENT_M = 0.2  # of where a vehicle is that drives
FEW = 3  # actions of a kind
LEAST_DRIVEN_S = 10.0  # on which a stop would be seen
NO_SPREAD = 1 / 3  # how likely vehicles are as fast as each other, where nobody knows better
USUAL_SPREAD = 0.1  # by how much they are not, else
WIDEST = 3.0  # half of an interval, as a logarithm: beyond it nothing is known
PLACE_M, OFTEN = 0.5, 3  # within which stands are at one place, and how many make one
APART_M = 1e6  # levels, and frames that are a vehicle's own


@dataclass(frozen=True)
class CalibratedFigure:
    """A figure with its interval."""

    name: str
    unit: str
    value: float
    low: float
    high: float
    count: int  # of the episodes that it is from
    of: str  # what these are

    @property
    def symbol(self) -> str:
        """Its unit as people write it."""
        return self.unit.replace("^2", "²")

    @property
    def basis(self) -> str:
        """Its episodes, counted in words."""
        return counted(self.count, self.of)

    @property
    def document(self) -> dict[str, object]:
        return {"value": self.value, "low": self.low, "high": self.high, "unit": self.unit, "count": self.count, "of": self.of}


def counted(count: int, of: str) -> str:
    """Episodes in words."""
    return f"{count} {of}" if count != 1 else f"1 {of.replace('stops', 'stop').replace('vehicles', 'vehicle')}"


class Unknown(NamedTuple):
    """A figure that the log does not show, and why."""

    name: str
    reason: str


@dataclass(frozen=True, eq=False)
class Fits:
    """Fits that the figures are from, for pictures."""

    noise: Noise
    phases: list[Phases]
    speed_mps: float  # that vehicles usually drive
    speeding: Ramp | None
    braking: Ramp | None
    cruise: Cruise | None
    turning: TurnFit | None
    stops: Stops


@dataclass(frozen=True)
class Calibration:
    """Figures of a log."""

    log: MotionLog
    vehicles: list[str]
    span_s: float
    quantities: Mapping[str, CalibratedFigure]
    unknown: Mapping[str, str] = field(default_factory=dict)  # figure -> why the log does not show it
    fits: Fits | None = None


def calibrated(log: MotionLog, others: MotionLog | None = None) -> Calibration:
    """All figures of a log, whose vehicles may have waited for `others`, too.

    Raises MrpSumoError where nothing drives in it, or it is too short to tell anything.
    """
    require_different(log)
    tracks = log.tracks()
    vehicles = sorted({track.vehicle for track in tracks})
    if not tracks:
        raise MrpSumoError(f"{log.source}: no vehicle has four poses in a row without a gap: too short to tell anything")
    speed, noise = usual_speed(tracks), noise_of(tracks)
    if max(_extent_m(track) for track in tracks) < max(LEAST_EXTENT_M, 12 * noise.position_m):
        raise MrpSumoError(f"{log.source}: no vehicle drives: positions change by no more than their noise, {noise.position_m:.3f} m")
    if speed < SLOWEST_MPS:
        raise MrpSumoError(
            f"{log.source}: vehicles drive at {speed:.2g} m/s, expected {SLOWEST_MPS:g} or more: other units than metres and seconds "
            "(a column of milliseconds is called t_ms)"
        )
    phases: list[Phases] = []
    for _ in range(2):
        phases = [phases_of(track, noise, speed) for track in tracks]
        noise = refined(noise, phases)
    fits = _fitted(log.visits, tracks if others is None else tracks + others.tracks(), phases, noise, speed)
    figures = [*_driving(fits), *_services(log.visits), *_accuracy(phases, noise), *_battery(log.charges)]
    if log.is_commanded:
        figures = [each if each.name in LIMITS else Unknown(each.name, "a commanded speed is not a driven one") for each in figures]
    _note_several_types(log, fits, vehicles, figures)
    if not log.is_commanded and len(fits.stops.hold_s) and not others and len({track.level for track in tracks}) == len(vehicles):
        log.notes.append("no two vehicles share a frame: where one stands for another, it counts as a stop on the way")
    return Calibration(
        log,
        vehicles,
        sum(float(track.t_s[-1] - track.t_s[0]) for track in tracks),
        {each.name: each for each in figures if isinstance(each, CalibratedFigure)},
        {each.name: each.reason for each in figures if isinstance(each, Unknown)},
        fits,
    )


def _note_several_types(log: MotionLog, fits: Fits, vehicles: list[str], figures: list[CalibratedFigure | Unknown]) -> None:
    """Say whose top speeds differ by more than those of one type do."""
    spread = next((each for each in figures if each.name == "speed_spread" and isinstance(each, CalibratedFigure)), None)
    if fits.cruise is None or spread is None or spread.low <= USUAL_SPREAD:
        return
    known = sorted((speed, name) for speed, name in zip(fits.cruise.mean_mps.tolist(), vehicles) if math.isfinite(speed))
    (least, slowest), (most, fastest) = known[0], known[-1]
    log.notes.append(
        f"top speeds differ by more than those of one type, from {least:.2g} m/s of {slowest} to {most:.2g} m/s of {fastest}: "
        "calibrate logs of each type alone"
    )


def _extent_m(track: Track) -> float:
    """How far apart the places of a track are, but for a few."""
    return float(np.hypot(*(np.subtract(*np.quantile(each, (0.98, 0.02))) for each in (track.x_m, track.y_m))))


def _fitted(visits: list[ActionTime], all_tracks: list[Track], phases: list[Phases], noise: Noise, speed: float) -> Fits:
    """Ramps and cruise by turns, since each is fitted with what the other says; then turns and stops."""
    vehicles = sorted({each.track.vehicle for each in phases})
    guess, scatter, driving = (0.5 * speed, 0.5 * speed), Scatter(0.05, 3.0), noise
    cruise: Cruise | None = None
    speeding: Ramp | None = None
    braking: Ramp | None = None
    for k in range(ROUNDS):
        mean = None if cruise is None else cruise.mean_mps
        speeding, braking = (
            fit_ramp(phases, vehicles, driving, scatter, (speed, *guess), before, braking=each, mean_mps=mean)
            for each, before in ((False, speeding), (True, braking))
        )
        guess = (speeding.value if speeding else guess[0]), (braking.value if braking else guess[1])
        if k < ROUNDS - 1:
            windows = of_top_speed(top_windows(phases, vehicles, speed, *guess), noise, len(vehicles))
            cruise = fit_cruise(windows, noise, len(vehicles), CONFIDENCE if k == ROUNDS - 2 else None)
        if cruise is not None:
            scatter, speed = cruise.scatter, float(np.nanmedian(cruise.mean_mps))
            driving = Noise(cruise.noise_m, noise.heading_rad)
    speeding, braking = (None if each is None else marginal(each, driving, scatter) for each in (speeding, braking))
    turning = fit_turning([each.track for each in phases], noise, speed)
    drop = student(CONFIDENCE, 30) ** 2 / 2
    stops = fit_stops(phases, visits, all_tracks, speed / guess[1], _times(speeding, 1.0), _times(braking, -1.0), drop)
    return Fits(noise, phases, speed, speeding, braking, cruise, turning, stops)


def _times(ramp: Ramp | None, sign: float) -> dict[tuple[int, int], float]:
    if ramp is None:
        return {}
    at = sign * (ramp.episodes.begin_s + ramp.t0_s)
    return {(int(n), int(k)): float(t) for (n, k), t, used in zip(ramp.episodes.stand, at, ramp.used) if used}


def _driving(fits: Fits) -> Iterator[CalibratedFigure | Unknown]:
    """How vehicles drive, turn and stop on the way."""
    speed, turning, stops = fits.speed_mps, fits.turning, fits.stops
    period_s = float(np.median(np.concatenate([np.diff(each.track.t_s) for each in fits.phases])))
    if fits.cruise is None:
        yield Unknown("max_speed_mps", f"no vehicle is at a steady speed for long enough; {speed:.2g} m/s is seen")
    else:
        yield from _speeds(fits.cruise, period_s)
    for name, ramp, of in (("accel_mps2", fits.speeding, "starts"), ("decel_mps2", fits.braking, "stops")):
        if ramp is None:
            yield Unknown(name, "too few vehicles leave a stand of three samples or come to one on a straight way")
        elif ramp.value * AT_ONCE * period_s > speed:
            yield Unknown(name, f"vehicles reach {speed:.2g} m/s, or stand, sooner than the log shows")
        else:
            rounded = 0.0 if fits.cruise is None else ROUNDED * min(fits.cruise.scatter.noise, ANY_NOISE) ** 2
            reach = _reach(ramp.scores, ramp.episodes.vehicle, math.hypot(MISFIT_M * 8 * ramp.value / speed**2, rounded))
            yield _within_factor(name, "m/s^2", ramp.value * math.exp(rounded), reach, ramp.count, of)
    if turning is None:
        any_heading = any(each.track.has_headings for each in fits.phases)
        yield Unknown("turn_rate_rad_s", "fewer than five turns in place" if any_heading else "the log has no headings")
    elif float(np.median(turning.angle_rad)) < turning.value * TURNS_AT_ONCE * period_s:
        yield Unknown("turn_rate_rad_s", f"turns are over sooner than a pose every {period_s:.2g} s shows")
    else:
        count = len(turning.scores)
        reach = _reach(turning.scores, turning.vehicle, MISFIT_RAD * 2 / float(np.median(turning.angle_rad)))
        yield _within_factor("turn_rate_rad_s", "rad/s", turning.value, reach, count, "turns")
    count, of = len(stops.hold_s), "stops on the way"
    if stops.driven_s < LEAST_DRIVEN_S:
        yield Unknown("stops_per_s", f"{stops.driven_s:.0f} s of driving with nobody near, expected {LEAST_DRIVEN_S:.0f} s or more")
    else:
        yield CalibratedFigure("stops_per_s", "1/s", *stops.rate_per_s, count, of)
    for name, unit, figure in (("stop_median_s", "s", stops.median_s), ("stop_sigma", "", stops.sigma)):
        if figure is None:
            yield Unknown(name, f"{counted(count, of)}, expected five or more")
        else:
            yield CalibratedFigure(name, unit, *figure, count, of)


def _within_factor(name: str, unit: str, value: float, reach: float, count: int, of: str) -> CalibratedFigure:
    """A figure whose logarithm is known to a reach."""
    return CalibratedFigure(name, unit, value, value * math.exp(-reach), value * math.exp(reach), count, of)


def _reach(scores: FloatArray, vehicle: IntArray, misfit: float) -> float:
    """Half the interval of a logarithm that has a score for each episode; by vehicle where these differ by more than episodes explain."""
    used = np.flatnonzero(scores)
    deviation = math.sqrt(float((scores**2).sum()) * len(used) / max(len(used) - 1, 1))
    freedom = len(used) - 1
    sums = np.bincount(vehicle, scores)
    own = np.bincount(vehicle, scores**2)
    there = own > 0
    if there.sum() > 2:
        ratio = float((sums[there] ** 2).sum() / own.sum())
        if ratio > 1 + 3.0 * math.sqrt(2 / there.sum()):
            deviation, freedom = math.sqrt(float((sums**2).sum()) * there.sum() / (there.sum() - 1)), int(there.sum()) - 1
    return min(math.hypot(HELD * student(CONFIDENCE, freedom) * deviation, student(CONFIDENCE, 1000) * misfit), WIDEST)


def _speeds(cruise: Cruise, period_s: float) -> Iterator[CalibratedFigure | Unknown]:
    """Top speed, the spread of vehicles about it, and the scatter in time."""
    known = np.flatnonzero(np.isfinite(cruise.mean_mps))
    blocks = len(np.unique(cruise.windows.block))
    factor = student(CONFIDENCE, max(blocks - 1, 1)) / student(CONFIDENCE, 100000)
    top, spread = _spread_of(np.log(cruise.mean_mps[known]), np.maximum(cruise.mean_deviation[known], 1e-4) * factor)
    steps = cruise.num_steps, "steps at top speed"
    why = f"{counted(*steps)}, expected {TELLING_STEPS} or more" if cruise.num_steps < TELLING_STEPS else ""
    why = f"a pose every {period_s:.2g} s, expected every {COARSE_S:g} s or oftener" if period_s > COARSE_S else why
    s, (low, high) = (0.0, (0.0, ANY_NOISE)) if why else (cruise.scatter.noise, cruise.noise_range)
    low = 0.0 if low < 1.01 * LEAST_SCATTER else low  # the fit knows no less

    def loss(noise: float) -> float:
        return -math.log(1 - MEAN_LOSS * min(noise, 0.9))

    wider = SCATTER_HELD if low > 0 else 1.0  # than what it is to the mean loss
    below = math.hypot(top[0] - top[1], (loss(s) - loss(low)) / wider)
    above = math.hypot(top[2] - top[0], (loss(high) - loss(s)) / wider)
    value = top[0] + loss(s)
    yield CalibratedFigure("max_speed_mps", "m/s", math.exp(value), math.exp(value - below), math.exp(value + above), *steps)
    if why:
        yield from (Unknown("speed_noise", why), Unknown("speed_noise_tau_s", why))
    else:
        yield CalibratedFigure("speed_noise", "", s, low, high, *steps)
        yield CalibratedFigure("speed_noise_tau_s", "s", cruise.scatter.tau_s, *cruise.tau_range, *steps)
    if len(known) < 3:
        yield Unknown("speed_spread", f"{counted(len(known), 'vehicles')} at top speed, expected three or more")
    else:
        yield CalibratedFigure("speed_spread", "", *spread, len(known), "vehicles")


def _spread_of(means: FloatArray, deviation: FloatArray) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Logarithm of the speed of vehicles that lose nothing, and the spread of the others: half of the vehicles lose |N(0, sd)|.

    Medians and intervals of both, of the posterior on a grid: any speed, and a spread of 0 or about as much as usual.
    """
    from scipy.special import log_ndtr

    tops = np.linspace(means.min() - 4 * deviation.max(), means.max() + 4 * deviation.max() + 0.7 * float(np.ptp(means)), 241)
    spreads = np.concatenate(([0.0], np.geomspace(1e-3, 0.4, 79)))
    off = means - tops[:, None, None]
    width = np.hypot(deviation, spreads[None, :, None])
    alone = -((off / deviation) ** 2) / 2 - np.log(deviation)
    z = off / width
    skewed = math.log(2) - z**2 / 2 - np.log(width) + log_ndtr(-z * spreads[None, :, None] / deviation)
    log = np.logaddexp(alone, skewed).sum(2)
    usual = np.gradient(spreads) * np.exp(-((spreads / USUAL_SPREAD) ** 2) / 2)
    usual[0] = NO_SPREAD / (1 - NO_SPREAD) * usual[1:].sum()
    weight = np.exp(log - log.max()) * usual
    return _quantiles(tops, weight.sum(1)), _quantiles(spreads, weight.sum(0))


def _quantiles(at: FloatArray, weight: FloatArray) -> tuple[float, float, float]:
    """The median of weights, and the ends of their interval."""
    median, low, high = np.interp((0.5, (1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2), np.cumsum(weight) / weight.sum(), at).tolist()
    return median, low, high


def _services(visits: Iterable[ActionTime]) -> Iterator[CalibratedFigure | Unknown]:
    """Median and sigma of lognormal times, by action."""
    by_action = grouped((visit.action, visit.end_s - visit.begin_s) for visit in visits)
    if not by_action:
        yield Unknown("actions", "the log does not say what vehicles do at stops")
    for action, lasted in sorted(by_action.items()):
        times = np.array([each for each in lasted if each > 0])
        if len(times) < FEW:
            yield Unknown(f"actions.{action}", f"{len(times)} times, expected three or more")
            continue
        logs, n, of = np.log(times), len(times), f"times of {action}"
        sigma = float(logs.std(ddof=1))
        reach = student(CONFIDENCE, n - 1) * sigma / math.sqrt(n)
        yield _within_factor(f"actions.{action}.median_s", "s", float(np.exp(logs.mean())), reach, n, of)
        low, high = (sigma * math.sqrt((n - 1) / chi2) for chi2 in _chi2(n - 1))
        yield CalibratedFigure(f"actions.{action}.sigma", "", sigma, low, high, n, of)


def _chi2(freedom: int) -> tuple[float, float]:
    """The upper and lower end of the interval of chi squared."""
    from scipy.special import chdtri

    return float(chdtri(freedom, (1 - CONFIDENCE) / 2)), float(chdtri(freedom, (1 + CONFIDENCE) / 2))


def _accuracy(phases: list[Phases], noise: Noise) -> Iterator[CalibratedFigure | Unknown]:
    """How far apart the places are at which vehicles stop for one place: standard deviation in x and y, without the noise of positions."""
    from scipy.spatial import cKDTree

    long = [(stand.x_m, stand.y_m, APART_M * each.track.level, stand.last - stand.first - 1) for each in phases for stand in each.stands]
    xy, count = np.array([row[:3] for row in long if row[3] > 3]).reshape(-1, 3), np.array([row[3] for row in long if row[3] > 3])
    squares, freedom, taken = 0.0, 0, np.zeros(len(xy), np.bool_)
    groups = cKDTree(xy).query_ball_point(xy, PLACE_M) if len(xy) else []
    for k in sorted(range(len(xy)), key=lambda k: -len(groups[k])):
        mine = np.array([i for i in groups[k] if not taken[i]], np.int64)
        if len(mine) < OFTEN:
            continue
        taken[mine] = True
        near = mine[np.hypot(*(xy[mine] - np.median(xy[mine], 0)).T[:2]) < 0.6 * PLACE_M]
        if len(near) >= OFTEN:
            of_noise = float((math.pi / 2 * noise.position_m**2 / np.maximum(count[near], 1)).sum())
            squares += float(((xy[near] - xy[near].mean(0)) ** 2).sum())
            squares -= 2 * of_noise * (len(near) - 1) / len(near)
            freedom += 2 * (len(near) - 1)
    if freedom < 6:
        yield Unknown("stopping_m", "no place at which vehicles stop three times for five samples or more")
        return
    mean_noise = noise.position_m**2 * math.pi / 2 / float(np.median(count))
    variance = max(squares / freedom, 0.0)
    total = variance + mean_noise
    low, high = (math.sqrt(max(total * freedom / chi2 - mean_noise, 0.0)) for chi2 in _chi2(freedom))
    yield CalibratedFigure("stopping_m", "m", math.sqrt(variance), low, high, freedom // 2, "stops at the same places")


def _battery(charges: Iterable[Charge]) -> Iterator[CalibratedFigure | Unknown]:
    """Shares of the capacity an hour: drawn without charging, and charged."""
    slopes: dict[bool, list[float]] = {False: [], True: []}
    by_vehicle = grouped((each.vehicle, (each.t_s, each.share, each.charging)) for each in charges)
    if not by_vehicle:
        yield Unknown("battery", "the log has no state of charge")
        return
    for rows in by_vehicle.values():
        rows.sort()
        begin = 0
        for k in range(1, len(rows) + 1):
            if k == len(rows) or rows[k][2] != rows[begin][2] or rows[k][0] - rows[begin][0] > 1200.0:
                (t, share, charging), (end_t, end_share, _) = rows[begin], rows[k - 1]
                if end_t - t > 300.0:
                    slopes[charging].append((end_share - share) / (end_t - t) * 3600.0)
                begin = k
    for name, charging in (("battery_drawn_per_h", False), ("battery_charged_per_h", True)):
        rates = np.array(slopes[charging]) * (1 if charging else -1)
        if len(rates) and not rates.any():
            yield Unknown(name, "the state of charge never changes")
            continue
        if len(rates) < FEW:
            yield Unknown(name, f"{len(rates)} stretches of five minutes, expected three or more")
            continue
        mean, reach = float(rates.mean()), student(CONFIDENCE, len(rates) - 1) * float(rates.std(ddof=1)) / math.sqrt(len(rates))
        yield CalibratedFigure(name, "of the capacity an hour", mean, mean - reach, mean + reach, len(rates), "stretches")
