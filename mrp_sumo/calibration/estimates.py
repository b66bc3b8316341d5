"""A log of a fleet becomes figures with intervals: how vehicles drive, what disturbs them, how long stops take.

Each figure is fitted to episodes: starts, stops, turns, windows at top speed, actions. Intervals are those of scores by episode (or by
minute of a vehicle, where neighbours depend on each other), of profile likelihoods, or of Student's t; where vehicles differ from each
other by more than their episodes explain, each vehicle counts once. What a log does not show is left out, with the reason.
"""

import math
from dataclasses import dataclass, field

import numpy as np

from mrp_sumo.calibration.cruise import HELD, MEAN_LOSS, Cruise, Scatter, fit_cruise, of_top_speed, student, top_windows
from mrp_sumo.calibration.log import MotionLog, Track
from mrp_sumo.calibration.phases import Noise, Phases, noise_of, phases_of, refined, usual_speed
from mrp_sumo.calibration.ramps import Ramp, fit_ramp
from mrp_sumo.calibration.stops import Stops, fit_stops
from mrp_sumo.calibration.turning import TurnFit, fit_turning
from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.errors import MrpSumoError

CONFIDENCE = 0.9
ROUNDS = 3
MISFIT_M = 0.001  # by which vehicles may be elsewhere than the law of motion has them
AT_ONCE_S = 0.02  # within which no vehicle reaches its speed
LEAST_EXTENT_M = 0.2  # of where a vehicle is that drives
FEW = 3  # actions of a kind
WIDEST = 3.0  # half of an interval, as a logarithm: beyond it nothing is known
PLACE_M, OFTEN = 0.5, 3  # within which stands are at one place, and how many make one


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
    def document(self) -> dict[str, object]:
        """As JSON has it."""
        return {"value": self.value, "low": self.low, "high": self.high, "unit": self.unit, "count": self.count, "of": self.of}


@dataclass(frozen=True, eq=False)
class Fits:
    """Fits that the figures are from, for pictures."""

    noise: Noise
    phases: list[Phases]
    speeding: Ramp | None
    braking: Ramp | None
    cruise: Cruise | None
    turning: TurnFit | None
    stops: Stops | None


@dataclass
class Calibration:
    """Figures of a log."""

    log: MotionLog
    vehicles: list[str]
    span_s: float
    quantities: dict[str, CalibratedFigure] = field(default_factory=dict)
    unknown: dict[str, str] = field(default_factory=dict)  # figure -> why the log does not tell it
    fits: Fits | None = None


def calibrated(log: MotionLog) -> Calibration:
    """All figures of a log. Raises MrpSumoError where nothing drives in it, or it is too short to tell anything."""
    tracks = log.tracks()
    vehicles = sorted({track.vehicle for track in tracks})
    if not tracks:
        raise MrpSumoError(f"{log.source}: no vehicle has four poses in a row without a gap: too short to tell anything")
    speed = usual_speed(tracks)
    noise = noise_of(tracks)
    if max(_extent_m(track) for track in tracks) < max(LEAST_EXTENT_M, 12 * noise.position_m):
        raise MrpSumoError(f"{log.source}: no vehicle drives: positions change by no more than their noise, {noise.position_m:.3f} m")
    result = Calibration(log, vehicles, sum(float(track.t_s[-1] - track.t_s[0]) for track in tracks))
    phases: list[Phases] = []
    for _ in range(2):
        phases = [phases_of(track, noise, speed) for track in tracks]
        noise = refined(noise, phases)
    _motion(result, phases, noise, speed, tracks)
    _services(result)
    _accuracy(result, phases, noise)
    _battery(result)
    return result


def _extent_m(track: Track) -> float:
    """How far apart the places of a track are, but for a few."""
    return float(np.hypot(*(np.subtract(*np.quantile(each, (0.98, 0.02))) for each in (track.x_m, track.y_m))))


def _motion(result: Calibration, phases: list[Phases], noise: Noise, speed: float, tracks: list[Track]) -> None:
    vehicles, guess, scatter, driving = result.vehicles, (0.5 * speed, 0.5 * speed), Scatter(0.05, 3.0), noise
    cruise: Cruise | None = None
    speeding = braking = None
    for k in range(ROUNDS):
        mean = None if cruise is None else cruise.mean_mps
        speeding, braking = (
            fit_ramp(phases, vehicles, driving, scatter, (speed, *guess), braking=each, mean_mps=mean) for each in (False, True)
        )
        guess = (speeding.value if speeding else guess[0]), (braking.value if braking else guess[1])
        if k < ROUNDS - 1:
            windows = of_top_speed(top_windows(phases, vehicles, speed, *guess), noise, len(vehicles))
            cruise = fit_cruise(windows, noise, len(vehicles), CONFIDENCE)
        if cruise is not None:
            scatter, speed = cruise.scatter, float(np.nanmedian(cruise.mean_mps))
            driving = Noise(cruise.noise_m, noise.heading_rad)
    if cruise is None:
        result.unknown["max_speed_mps"] = "no vehicle is at a steady speed for long enough on a straight way"
    else:
        _speeds(result, cruise)
    for name, ramp in (("accel_mps2", speeding), ("decel_mps2", braking)):
        if ramp is None:
            result.unknown[name] = "too few vehicles leave a stand of three samples or come to one on a straight way"
        elif ramp.value * AT_ONCE_S > speed:
            result.unknown[name] = f"vehicles reach {speed:.2g} m/s, or stand, sooner than the log shows"
        else:
            misfit = MISFIT_M * 8 * ramp.value / speed**2
            figure = _by_scores(name, "m/s^2", ramp.value, ramp.scores, ramp.episodes.vehicle, misfit)
            result.quantities[name] = CalibratedFigure(*figure, ramp.count, "stops" if ramp is braking else "starts")
    turning = fit_turning(tracks, noise, speed)
    if turning is None:
        any_heading = any(track.has_headings for track in tracks)
        result.unknown["turn_rate_rad_s"] = "fewer than five turns in place" if any_heading else "the log has no headings"
    else:
        figure = _by_scores("turn_rate_rad_s", "rad/s", turning.value, turning.scores, np.arange(len(turning.scores)), 0.0)
        result.quantities["turn_rate_rad_s"] = CalibratedFigure(*figure, len(turning.scores), "turns")
    left_s, came_s = _times(speeding, 1.0), _times(braking, -1.0)
    drop = student(CONFIDENCE, 30) ** 2 / 2
    stops = fit_stops(phases, result.log.visits, noise, speed / guess[1], left_s, came_s, drop)
    result.quantities["stops_per_s"] = CalibratedFigure("stops_per_s", "1/s", *stops.rate_per_s, len(stops.hold_s), "stops on the way")
    for name, unit, figure3 in (("stop_median_s", "s", stops.median_s), ("stop_sigma", "", stops.sigma)):
        if figure3 is None:
            result.unknown[name] = f"{len(stops.hold_s)} stops on the way, expected five or more"
        else:
            result.quantities[name] = CalibratedFigure(name, unit, *figure3, len(stops.hold_s), "stops on the way")
    result.fits = Fits(noise, phases, speeding, braking, cruise, turning, stops)


def _times(ramp: Ramp | None, sign: float) -> dict[tuple[int, int], float]:
    if ramp is None:
        return {}
    at = sign * (ramp.episodes.begin_s + ramp.t0_s)
    return {(int(n), int(k)): float(t) for (n, k), t, used in zip(ramp.episodes.stand, at, ramp.used) if used}


def _by_scores(
    name: str, unit: str, value: float, scores: FloatArray, vehicle: IntArray, misfit: float
) -> tuple[str, str, float, float, float]:
    """A figure whose logarithm has a score for each episode; by vehicle where these differ by more than episodes explain."""
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
    reach = math.hypot(HELD * student(CONFIDENCE, freedom) * deviation, student(CONFIDENCE, 1000) * misfit)
    reach = min(reach, WIDEST)
    return name, unit, value, value * math.exp(-reach), value * math.exp(reach)


def _speeds(result: Calibration, cruise: Cruise) -> None:
    """Top speed, the spread of vehicles about it, and the scatter in time."""
    known = np.flatnonzero(np.isfinite(cruise.mean_mps))
    means, blocks = np.log(cruise.mean_mps[known]), int(np.count_nonzero(np.abs(cruise.mean_influence).sum(0)))
    deviation = np.maximum(np.sqrt((cruise.mean_influence[known] ** 2).sum(1)), 1e-4)
    factor = student(CONFIDENCE, max(blocks - 1, 1)) / student(CONFIDENCE, 100000)
    top, spread = _spread_of(means, deviation * factor)
    s, (low, high) = cruise.scatter.noise, cruise.noise_range

    def loss(noise: float) -> float:
        return -math.log(1 - MEAN_LOSS * min(noise, 0.9))

    below = math.hypot(top[0] - top[1], loss(s) - loss(low))
    above = math.hypot(top[2] - top[0], loss(high) - loss(s))
    value = top[0] + loss(s)
    steps = int(cruise.windows.count.sum())
    ends = math.exp(value), math.exp(value - below), math.exp(value + above)
    result.quantities["max_speed_mps"] = CalibratedFigure("max_speed_mps", "m/s", *ends, steps, "steps at top speed")
    result.quantities["speed_noise"] = CalibratedFigure("speed_noise", "", s, low, high, steps, "steps at top speed")
    tau = (cruise.scatter.tau_s, *cruise.tau_range)
    result.quantities["speed_noise_tau_s"] = CalibratedFigure("speed_noise_tau_s", "s", *tau, steps, "steps at top speed")
    if len(known) < 3:
        result.unknown["speed_spread"] = f"{len(known)} vehicles at top speed, expected three or more"
    else:
        result.quantities["speed_spread"] = CalibratedFigure("speed_spread", "", *spread, len(known), "vehicles")


def _spread_of(means: FloatArray, deviation: FloatArray) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
    """Logarithm of the speed of vehicles that lose nothing, and the spread of the others: half of the vehicles lose |N(0, sd)|."""
    from scipy.special import log_ndtr

    tops = np.linspace(means.min() - 3 * deviation.max(), means.max() + 4 * deviation.max() + 0.5 * float(np.ptp(means)), 201)
    spreads = np.concatenate(([0.0], np.geomspace(1e-3, 0.4, 79)))
    off = means - tops[:, None, None]
    width = np.hypot(deviation, spreads[None, :, None])
    alone = -((off / deviation) ** 2) / 2 - np.log(deviation)
    z = off / width
    skewed = math.log(2) - z**2 / 2 - np.log(width) + log_ndtr(-z * spreads[None, :, None] / deviation)
    log = np.logaddexp(alone, skewed).sum(2)
    i, j = np.unravel_index(int(np.argmax(log)), log.shape)
    drop = student(CONFIDENCE, max(len(means) - 1, 2)) ** 2 / 2
    top = _ends(tops, log.max(1), drop)
    spread = _ends(spreads, log.max(0), drop) if len(means) > 1 else (0.0, 0.0)
    return (float(tops[i]), *top), (float(spreads[j]), *spread)


def _ends(at: FloatArray, log: FloatArray, drop: float) -> tuple[float, float]:
    inside = at[log > log.max() - drop]
    return float(inside[0]), float(inside[-1])


def _services(result: Calibration) -> None:
    """Median and sigma of lognormal times, by action."""
    from scipy.stats import chi2

    by_action: dict[str, list[float]] = {}
    for visit in result.log.visits:
        by_action.setdefault(visit.action, []).append(visit.end_s - visit.begin_s)
    if not by_action:
        result.unknown["actions"] = "the log does not say what vehicles do at stops"
    for action, lasted in sorted(by_action.items()):
        times = np.array([each for each in lasted if each > 0])
        if len(times) < FEW:
            result.unknown[f"actions.{action}"] = f"{len(times)} times, expected three or more"
            continue
        logs = np.log(times)
        sigma, n = float(logs.std(ddof=1)), len(logs)
        median, reach = float(np.exp(logs.mean())), student(CONFIDENCE, n - 1) * sigma / math.sqrt(n)
        ends = median, median * math.exp(-reach), median * math.exp(reach)
        result.quantities[f"actions.{action}.median_s"] = CalibratedFigure(
            f"actions.{action}.median_s", "s", *ends, n, f"times of {action}"
        )
        low, high = (sigma * math.sqrt((n - 1) / float(chi2.ppf(q, n - 1))) for q in ((1 + CONFIDENCE) / 2, (1 - CONFIDENCE) / 2))
        result.quantities[f"actions.{action}.sigma"] = CalibratedFigure(
            f"actions.{action}.sigma", "", sigma, low, high, n, f"times of {action}"
        )


def _accuracy(result: Calibration, phases: list[Phases], noise: Noise) -> None:
    """How far apart the places are at which vehicles stop for one place: standard deviation in x and y, without the noise of positions."""
    from scipy.spatial import cKDTree
    from scipy.stats import chi2

    long = [
        (stand.x_m, stand.y_m, stand.last - stand.first - 1) for each in phases for stand in each.stands if stand.last - stand.first > 4
    ]
    xy = np.array([row[:2] for row in long]).reshape(-1, 2)
    squares, freedom, taken = 0.0, 0, np.zeros(len(xy), np.bool_)
    if len(xy):
        count = np.array([row[2] for row in long])
        groups = cKDTree(xy).query_ball_point(xy, PLACE_M)
        for k in sorted(range(len(xy)), key=lambda k: -len(groups[k])):
            mine = np.array([i for i in groups[k] if not taken[i]], np.int64)
            if len(mine) >= OFTEN:
                taken[mine] = True
                middle = np.median(xy[mine], 0)
                near = mine[np.hypot(*(xy[mine] - middle).T) < 0.6 * PLACE_M]
                if len(near) >= OFTEN:
                    squares += float(((xy[near] - xy[near].mean(0)) ** 2).sum())
                    squares -= (
                        2 * float((math.pi / 2 * noise.position_m**2 / np.maximum(count[near], 1)).sum()) * (len(near) - 1) / len(near)
                    )
                    freedom += 2 * (len(near) - 1)
    if freedom < 6:
        result.unknown["stopping_m"] = "no place at which vehicles stop three times for five samples or more"
        return
    mean_noise = noise.position_m**2 * math.pi / 2 / float(np.median([row[2] for row in long]))
    variance = max(squares / freedom, 0.0)
    total = variance + mean_noise
    low, high = (math.sqrt(max(total * freedom / float(chi2.ppf(q, freedom)) - mean_noise, 0.0)) for q in (0.95, 0.05))
    result.quantities["stopping_m"] = CalibratedFigure(
        "stopping_m", "m", math.sqrt(variance), low, high, freedom // 2, "stops at the same places"
    )


def _battery(result: Calibration) -> None:
    """Shares of the capacity an hour: drawn without charging, and charged."""
    if not result.log.charges:
        result.unknown["battery"] = "the log has no state of charge"
        return
    slopes: dict[bool, list[float]] = {False: [], True: []}
    by_vehicle: dict[str, list[tuple[float, float, bool]]] = {}
    for each in result.log.charges:
        by_vehicle.setdefault(each.vehicle, []).append((each.t_s, each.share, each.charging))
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
        if len(rates) < FEW:
            result.unknown[name] = f"{len(rates)} stretches of five minutes, expected three or more"
            continue
        reach = student(CONFIDENCE, len(rates) - 1) * float(rates.std(ddof=1)) / math.sqrt(len(rates))
        mean = float(rates.mean())
        result.quantities[name] = CalibratedFigure(
            name, "of the capacity an hour", mean, mean - reach, mean + reach, len(rates), "stretches"
        )
