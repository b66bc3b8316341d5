"""Speeding up and braking: our own motion law fitted to vehicles that leave a stand or come to one, all with one acceleration.

A vehicle stands, speeds up at `a` to a speed and keeps it:

    s(t) = s0 for t < t0,  s0 + a (t - t0)^2 / 2 until the speed v is reached at t0 + v / a,  s0 + v (t - t0) - v^2 / 2a from then on.

Place, time and speed (s0, t0, v) are each episode's own, `a` is shared; braking is the same, backward in time. The fit is by maximum
likelihood with noise of positions, and with the scatter of speed, both from elsewhere: so samples of 1 Hz tell accelerations that
differences of speeds never show. Episodes that no such motion explains, such as of a vehicle that has to brake again, are left out.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mrp_sumo.calibration.cruise import Scatter, explained, integrated_cov
from mrp_sumo.calibration.phases import Noise, Phases, padded, taken, thinned
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray

MOST_SAMPLES = 20  # of an episode
REST_SAMPLES = 4
LEAST_REST, SURE = 3, 0.25  # samples at rest, and by which part of a period: whether one on a ramp seems to rest is a matter of its noise
CRUISE_S = 3.0  # of cruise that an episode holds
LEAST_SAMPLES = 5
SPEED_PRIOR, KNOWN_SPEED = 0.3, 0.02  # deviations of an episode's speed, about what its last samples say, or its vehicle's mean
MOST_EPISODES, FEW = 600, 8
ROUNDS = 12
NODES, REACH = 41, 5.0  # times that are integrated over, to that many standard deviations
SAME_SPEED = 0.25  # share by which a vehicle's speeds differ where they are its usual one
UNEXPLAINED = 4.5  # standard deviations by which an episode's residuals may be larger than they should


@dataclass(frozen=True, eq=False)
class Episodes:
    """E starts or, backward in time, stops, of n samples at most."""

    begin_s: FloatArray  # [E] time of its first sample, backward for stops
    t_s: FloatArray  # [E, n] from there
    along_m: FloatArray  # [E, n]
    there: BoolArray  # [E, n]
    speed_mps: FloatArray  # [E] at its end
    prior_mps: FloatArray  # [E] standard deviation of what is known of it
    period_s: FloatArray  # [E] between its samples
    vehicle: IntArray  # [E] number of its vehicle
    stand: IntArray  # [E, 2] numbers of its track and stand


@dataclass(frozen=True, eq=False)
class Ramp:
    """An acceleration with what each episode says of it."""

    value: float  # m/s^2
    scores: FloatArray  # [E] of its logarithm, over the whole information: their sum is 0, their squares its variance
    episodes: Episodes
    t0_s: FloatArray  # [E] times at which vehicles leave stands, or come to them
    fitted_mps: FloatArray  # [E]
    at_m: FloatArray  # [E] places of the stands along the leg
    used: BoolArray  # [E]
    t0_deviation_s: FloatArray  # [E] of the times

    @property
    def count(self) -> int:
        """Number of episodes that it is fitted to."""
        return int(self.used.sum())


def fit_ramp(
    phases: list[Phases],
    vehicles: list[str],
    noise: Noise,
    scatter: Scatter,
    guess: tuple[float, float, float],
    before: Ramp | None,
    *,
    braking: bool,
    mean_mps: FloatArray | None = None,
) -> Ramp | None:
    """The acceleration of starts, or of stops, with each episode's time at its best; None where there are too few.

    `guess` is what vehicles usually drive at, and accelerations of speeding up and braking so far, which choose samples, as do the times of
    a fit before; `mean_mps` [R] are mean speeds of vehicles at the top, as far as they are known.
    """
    if before is None:
        first = _episodes(phases, vehicles, guess, {}, braking=braking)
        before = None if first is None else fit_episodes(first, noise, scatter, guess[2 if braking else 1])
    if before is None:
        return None
    left_s = {(int(n), int(k)): float(t) for (n, k), t in zip(before.episodes.stand, before.episodes.begin_s + before.t0_s)}
    guess = (*guess[:2], before.value) if braking else (guess[0], before.value, guess[2])
    episodes = _episodes(phases, vehicles, guess, left_s, braking=braking)
    if episodes is not None and mean_mps is not None:
        own = mean_mps[episodes.vehicle]
        usual = np.flatnonzero(np.abs(episodes.speed_mps / own - 1) < SAME_SPEED)
        if len(usual) >= FEW:
            episodes = replace(taken(episodes, usual), speed_mps=own[usual], prior_mps=KNOWN_SPEED * own[usual])
    return None if episodes is None else fit_episodes(episodes, noise, scatter, before.value)


def marginal(ramp: Ramp, noise: Noise, scatter: Scatter) -> Ramp:
    """The maximum of the likelihood in which each episode's time is integrated out, not fitted.

    A sample or two lie on a ramp, if any: fitted times lean to where ramps hide between samples, which makes all of them steep.
    """
    episodes, used = ramp.episodes, ramp.used
    keep = np.flatnonzero(used)
    part = taken(episodes, keep)
    whiten = _whitening(part, ramp.t0_s[keep], part.speed_mps, ramp.value, noise, scatter)
    reach = np.clip(REACH * ramp.t0_deviation_s[keep], 1e-4, part.period_s)
    t0 = ramp.t0_s[keep, None] + reach[:, None] * np.linspace(-1, 1, NODES)

    def value(log_a: float) -> FloatArray:
        return _log_marginal(part, whiten, t0, ramp.at_m[keep], float(np.exp(log_a)))

    log_a, h = float(np.log(ramp.value)), 0.02
    for _ in range(6):
        low, middle, high = value(log_a - h), value(log_a), value(log_a + h)
        bend = -float((high - 2 * middle + low).sum()) / h**2
        step = float((high - low).sum()) / (2 * h) / bend if bend > 0 else float(np.sign((high - low).sum())) * 0.1
        log_a += float(np.clip(step, -0.2, 0.2))
        if abs(step) < 1e-4:
            break
    scores = np.zeros(len(used))
    scores[keep] = (value(log_a + h) - value(log_a - h)) / (2 * h) / max(bend, 1e-9)
    return replace(ramp, value=float(np.exp(log_a)), scores=scores)


def _log_marginal(part: Episodes, whiten: FloatArray, t0: FloatArray, at_m: FloatArray, a: float) -> FloatArray:
    """[E] logarithms of likelihoods, integrated over times on the nodes t0 [E, G] and, as for normal errors, over places and speeds."""
    u = part.t_s[:, None, :] - t0[:, :, None]
    v, there = part.speed_mps[:, None, None], part.there[:, None, :]
    residual = np.where(there, part.along_m[:, None, :] - at_m[:, None, None] - position(u, v, a), 0.0)
    by_speed = np.where(there & (u > v / a), u - v / a, 0.0)
    turned = whiten.transpose(0, 2, 1)
    r, s = residual @ turned, by_speed @ turned
    one = (whiten @ part.there[:, :, None].astype(np.float64))[:, :, 0][:, None, :]
    aa, bb, ab = (one**2).sum(2), (s**2).sum(2) + part.prior_mps[:, None] ** -2.0, (s * one).sum(2)
    ra, rb = (r * one).sum(2), (r * s).sum(2)
    determinant = aa * bb - ab**2
    explained = (bb * ra**2 - 2 * ab * ra * rb + aa * rb**2) / determinant
    log = -((r**2).sum(2) - explained + np.log(determinant)) / 2
    top = log.max(1)
    summed: FloatArray = top + np.log(np.exp(log - top[:, None]).sum(1))
    return summed


def _episodes(
    phases: list[Phases], vehicles: list[str], guess: tuple[float, float, float], left_s: Mapping[tuple[int, int], float], *, braking: bool
) -> Episodes | None:
    """Samples about each stand that begins or ends a leg.

    Until it is known when vehicles leave stands, by number of track and stand, samples are chosen by where they are, which their noise
    decides, too; then by time alone.
    """
    speed_mps, accel, decel = guess
    here, there = (decel, accel) if braking else (accel, decel)
    rows: list[tuple[float, FloatArray, FloatArray, float, int, tuple[int, int], float]] = []
    for number, each in enumerate(phases):
        t = -each.track.t_s if braking else each.track.t_s
        period_s = each.track.period_s
        vehicle = vehicles.index(each.track.vehicle)
        for leg in each.legs:
            k, other = (leg.to_stand, leg.from_stand) if braking else (leg.from_stand, leg.to_stand)
            if k < 0 or (left_s and (number, k) not in left_s):
                continue
            stand = each.stands[k]
            if braking:
                picked = np.arange(leg.first, min(stand.first + 2 * REST_SAMPLES, stand.last + 1))[::-1]
            else:
                picked = np.arange(max(stand.last - 2 * REST_SAMPLES + 1, stand.first), leg.last + 1)
            direction = np.array([np.cos(leg.heading_rad), np.sin(leg.heading_rad)]) * (-1 if braking else 1)
            time = t[picked]
            along = (each.track.xy_m[picked] - (stand.x_m, stand.y_m)) @ direction
            is_cut = (leg.first if braking else leg.last) in (0, len(t) - 1) and other < 0
            length_m = np.inf if is_cut else float(np.ptp(leg.along_m))
            own = min(speed_mps, np.sqrt(2 * here * there * length_m / (here + there)) if np.isfinite(length_m) else np.inf)
            if left_s:
                left = left_s[number, k]
                cruise_s = min(CRUISE_S, max(0.0, (length_m - own**2 / 2 * (1.1 / there + 1 / here)) / own))
                fits = (time > left - (REST_SAMPLES + 0.5) * period_s) & (time < left + 0.97 * own / here + cruise_s)
                enough = np.count_nonzero(fits & (time > left)) >= 2
                enough &= np.count_nonzero(fits & (time < left - SURE * period_s)) >= LEAST_REST
            else:
                fits = along <= min(length_m - own**2 / (2 * there) * 1.1, own**2 / (2 * here) + own * CRUISE_S)
                fits &= np.cumsum(~fits) == 0
                enough = np.count_nonzero(fits) >= min(len(picked), LEAST_SAMPLES)
            time, along = time[fits][:MOST_SAMPLES], along[fits][:MOST_SAMPLES]
            if not enough or len(time) < LEAST_SAMPLES:
                continue
            last = min(3, max(1, len(time) - LEAST_REST - 1))
            slope = float((along[-1] - along[-1 - last]) / (time[-1] - time[-1 - last]))
            has_cruise = along[-1] > 1.2 * own**2 / (2 * here)
            rows.append((float(time[0]), time - time[0], along, slope if has_cruise else speed_mps, vehicle, (number, k), period_s))
    if len(rows) < 3:
        return None
    begin, times, alongs, speed, robot, place, period = zip(*thinned(rows, MOST_EPISODES))
    speeds = np.clip(np.array(speed), 0.1 * speed_mps, 2 * speed_mps)
    samples = padded(times, alongs)
    return Episodes(np.array(begin), *samples, speeds, SPEED_PRIOR * speeds, *map(np.array, (period, robot, place)))


def position(u: FloatArray, v: FloatArray, a: float) -> FloatArray:
    """Distance from the stand at times after leaving it; v is the speed that is kept in the end."""
    ramp = v / a
    path_m: FloatArray = np.where(u <= 0, 0.0, np.where(u < ramp, a * u**2 / 2, v * u - v**2 / (2 * a)))
    return path_m


def fit_episodes(episodes: Episodes, noise: Noise, scatter: Scatter, guess: float) -> Ramp | None:
    """Gauss-Newton, each episode's own unknowns eliminated in each round."""
    t, y, there = episodes.t_s, episodes.along_m, episodes.there
    num = len(t)
    v, log_a = episodes.speed_mps.copy(), float(np.log(guess))
    prior_mps, expected = episodes.prior_mps, episodes.speed_mps
    s0 = np.median(y[:, :2], axis=1)
    last = there.sum(1) - 1
    rows = np.arange(num)
    moved = np.maximum(y[rows, last] - s0, 1e-3)
    a = np.exp(log_a)
    peak = np.minimum(v, np.sqrt(2 * a * moved))
    t0 = t[rows, last] - np.where(peak < v, peak / a, moved / v + v / (2 * a))
    used = np.ones(num, np.bool_)
    whiten = _whitening(episodes, t0, v, a, noise, scatter)
    scores = deviation = np.zeros(num)
    for k in range(ROUNDS):
        a = np.exp(log_a)
        if k in (3, 7):
            whiten = _whitening(episodes, t0, v, a, noise, scatter)
        u = t - t0[:, None]
        ramp = (v / a)[:, None]
        speed = np.where(u <= 0, 0.0, np.minimum(a * u, v[:, None]))
        model = s0[:, None] + position(u, v[:, None], a)
        late = u >= ramp
        by_speed = np.where(late, u - ramp, 0.0)
        by_accel = np.where(u <= 0, 0.0, np.where(late, (v**2 / (2 * a))[:, None], a * u**2 / 2))
        columns = np.stack((np.ones_like(u), -speed, by_speed, by_accel), 2) * there[:, :, None]
        residual = np.where(there, y - model, 0.0)
        r, j = whiten @ residual[:, :, None], whiten @ columns
        normal = j.transpose(0, 2, 1) @ j
        right = (j.transpose(0, 2, 1) @ r)[:, :, 0]
        normal[:, 2, 2] += prior_mps**-2.0
        right[:, 2] += (expected - v) / prior_mps**2
        normal[:, range(3), range(3)] = normal[:, range(3), range(3)] * (1 + 1e-9) + 1e-9  # a time after which all samples are at the top
        own, cross = normal[:, :3, :3], normal[:, :3, 3]
        solved = np.linalg.solve(own, np.stack((right[:, :3], cross), 2))
        information = normal[:, 3, 3] - (cross * solved[:, :, 1]).sum(1)
        gradient = right[:, 3] - (cross * solved[:, :, 0]).sum(1)
        if k >= 3:
            used = explained((r[:, :, 0] ** 2).sum(1), np.maximum(there.sum(1) - 3, 1), UNEXPLAINED)
        if used.sum() < 3:
            return None
        total = float(information[used].sum())
        if not total > 0:
            return None
        step = float(np.clip(gradient[used].sum() / total, -0.5, 0.5))
        scores = gradient / total
        deviation = np.sqrt(np.maximum(np.linalg.inv(own)[:, 1, 1], 1e-12))
        log_a += step
        away = solved[:, :, 0] - solved[:, :, 1] * step
        s0 += away[:, 0]
        t0 += np.clip(away[:, 1], -1.0, 1.0)
        v = np.clip(v + away[:, 2], 0.3 * expected, 2 * expected)
    return Ramp(float(np.exp(log_a)), np.where(used, scores, 0.0), episodes, t0, v, s0, used, deviation)


def _whitening(episodes: Episodes, t0: FloatArray, v: FloatArray, a: float, noise: Noise, scatter: Scatter) -> FloatArray:
    """[E, n, n] that make residuals independent with variance 1."""
    after = np.maximum(0.0, episodes.t_s - t0[:, None] - (v / a)[:, None])
    cov = integrated_cov(after, scatter) * (v**2)[:, None, None]
    n = episodes.t_s.shape[1]
    cov = np.where(episodes.there[:, :, None] & episodes.there[:, None, :], cov, 0.0)
    cov[:, np.arange(n), np.arange(n)] += noise.position_m**2
    whitening: FloatArray = np.linalg.inv(np.linalg.cholesky(cov))
    return whitening
