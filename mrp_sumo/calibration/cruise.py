"""Driving at top speed: its mean for each vehicle, its scatter and how long that lasts.

Our disturbances have a robot lose the share |u| of its speed, where u is an Ornstein-Uhlenbeck process. The covariance of |u| is that of
a folded normal pair; nearly all of it decays twice as fast as u. From the mean speed m, the scatter s and the memory tau follow those of
the model: top speed m / (1 - s sqrt(2 / pi)). Estimated by a Gaussian likelihood of the distances between samples, in which noise of
positions makes neighbours negatively and scatter of speed makes them positively correlated: that tells both apart.
"""

from dataclasses import dataclass, replace
from math import nan, pi, sqrt

import numpy as np

from mrp_sumo.calibration.phases import Noise, Phases, padded, spans_of, taken, thinned
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray
from mrp_sumo.experiments.statistics import t_quantile

MEAN_LOSS = sqrt(2 / pi)  # of |u| over the standard deviation of u
# Cov(|u(0)|, |u(t)|) = (2 / pi) s^2 (r asin r + sqrt(1 - r^2) - 1) with r = exp(-t / tau), as
# exponentials of time: weights, rates in 1 / tau.
# Two are those of the power series; the third has the rest of the variance, and the roughness of u.
REST = 1 - 3 / pi - 1 / (12 * pi)
PARTS = ((1 / pi, 2.0), (1 / (12 * pi), 4.0), (REST, (1 - 2 / pi - 1 / (3 * pi)) / REST))
LEAST_STEP_S = 0.45  # samples in between say nothing more about speeds
LONGEST = 16  # steps of a window
LEAST_STEPS = 2
FEW_WINDOWS, FEW_STEPS, TELLING_STEPS = 3, 10, 30  # of all windows: fewer tell no speed; fewer tell how fast, not how that scatters
MOST_STEPS = 4500  # of all windows
HELD = 1.15  # factor on intervals for what is held fixed while a figure is fitted; by the tuning fleets of tools/bench_calibrate.py
SCATTER_HELD = 1.5  # of the scatter and its memory, since braking and speeding up are in short windows, too; by the same fleets
FAR_OFF = 4.5  # standard deviations
LEAST_SCATTER = 1e-3
UNEXPLAINED = 4.0  # standard deviations by which a window's residuals may be larger than they should
TRIMS, MOST_FIT = 2, 0.8  # how often others are left out, and how many windows are to fit, or none is
NOISE_PRIOR = 0.1  # standard deviation of the logarithm of noise while driving, about that of standing
BLOCK_S = 60.0  # within which windows of a vehicle are taken for one


@dataclass(frozen=True)
class Scatter:
    """Scatter of the speed factor: u has this standard deviation and time constant."""

    noise: float
    tau_s: float


@dataclass(frozen=True, eq=False)
class Windows:
    """W windows of up to n steps at top speed."""

    dt_s: FloatArray  # [W, n]
    step_m: FloatArray  # [W, n]
    count: IntArray  # [W] steps
    vehicle: IntArray  # [W]
    block: IntArray  # [W] numbers of vehicle and minute


@dataclass(frozen=True, eq=False)
class Cruise:
    """Driving at top speed."""

    windows: Windows
    mean_mps: FloatArray  # [R] by vehicle, NaN: never at top speed
    mean_deviation: FloatArray  # [R] of the logarithm of it, the larger of what the fit expects and what minutes show
    noise_m: float  # of positions
    scatter: Scatter
    noise_range: tuple[float, float]  # of the scatter, at `confidence`
    tau_range: tuple[float, float]

    @property
    def num_steps(self) -> int:
        """Number of steps that it is fitted to."""
        return int(self.windows.count.sum())


def integrated_cov(x: FloatArray, scatter: Scatter) -> FloatArray:
    """[..., n, n] covariance of the integrals of |u| from 0 to each of x [..., n] s."""
    one, other = x[..., :, None], x[..., None, :]
    least, away = np.minimum(one, other), np.abs(one - other)
    cov = np.zeros(least.shape)
    for weight, rate in PARTS:
        k = rate / scatter.tau_s
        left = np.exp(-k * x)
        ends = 1 - left[..., :, None] - left[..., None, :] + np.exp(-k * away)
        cov += weight * scatter.noise**2 * (2 * least / k - ends / k**2)
    return cov


def top_windows(phases: list[Phases], vehicles: list[str], speed_mps: float, accel: float, decel: float) -> Windows:
    """Steps on straight legs, away from their ends by what speeding up and braking take."""
    rows: list[tuple[FloatArray, FloatArray, int, float]] = []
    for each in phases:
        t, vehicle = each.track.t_s, vehicles.index(each.track.vehicle)
        period_s = each.track.period_s
        low, high = (speed_mps**2 / (2 * rate) + speed_mps * period_s for rate in (accel, decel))
        for leg in each.legs:
            time, along = t[leg.first : leg.last + 1], leg.along_m
            inner = np.flatnonzero((along > along[0] + low) & (along < along[-1] - high))
            if len(inner) <= LEAST_STEPS:
                continue
            inner = np.arange(inner[0], inner[-1] + 1)[:: max(1, int(LEAST_STEP_S / period_s + 0.5))]
            if len(inner) <= LEAST_STEPS:
                continue
            dt, step = np.diff(time[inner]), np.diff(along[inner])
            parts = [(slice(k, k + LONGEST), float(time[inner[k]])) for k in range(0, len(dt) - LEAST_STEPS + 1, LONGEST)]
            rows += [(dt[part], step[part], vehicle, begin_s) for part, begin_s in parts]
    return _windows(rows)


def _windows(rows: list[tuple[FloatArray, FloatArray, int, float]]) -> Windows:
    dt_s, step_m, is_there = padded([row[0] for row in rows], [row[1] for row in rows])
    keys = [(row[2], int(row[3] // BLOCK_S)) for row in rows]
    number = {key: k for k, key in enumerate(sorted(set(keys)))}
    vehicle, block = (np.array(each, np.int64) for each in ([row[2] for row in rows], [number[key] for key in keys]))
    return Windows(np.where(is_there, dt_s, 1.0), step_m, is_there.sum(1), vehicle, block)


def of_top_speed(windows: Windows, noise: Noise, num_vehicles: int) -> Windows:
    """The windows in which a vehicle is at its own top speed: the upper mode of its speeds; what brakes or creeps in them is cut off."""
    there = np.arange(windows.dt_s.shape[1]) < windows.count[:, None]
    rows: list[tuple[FloatArray, FloatArray, int, float]] = []
    for r in range(num_vehicles):
        mine = np.flatnonzero(windows.vehicle == r)
        if not len(mine):
            continue
        means = np.array([windows.step_m[w, there[w]].sum() / windows.dt_s[w, there[w]].sum() for w in mine])
        usual = _upper_mode(means, windows.count[mine])
        steps = (windows.step_m[mine] / windows.dt_s[mine])[there[mine]]
        near = steps[np.abs(steps - usual) < 0.35 * usual]
        spread = 1.4826 * float(np.median(np.abs(near - np.median(near)))) if len(near) > 3 else 0.1 * usual
        spread = max(spread, sqrt(2) * noise.position_m / float(np.median(windows.dt_s[mine][there[mine]])), 0.01 * usual)
        for w in mine.tolist():
            n = int(windows.count[w])
            speed = windows.step_m[w, :n] / windows.dt_s[w, :n]
            fits = np.abs(speed - usual) < FAR_OFF * spread
            for a, b in spans_of(fits):
                a, b = a + (a > 0), b - (b < n)  # what is beside a dip may be on its way into it
                if b - a >= LEAST_STEPS:
                    rows.append((windows.dt_s[w, a:b], windows.step_m[w, a:b], r, float(windows.block[w]) * BLOCK_S))
    total = sum(len(row[0]) for row in rows)
    return _windows(thinned(rows, int(len(rows) * MOST_STEPS / max(total, MOST_STEPS))))


def _upper_mode(means: FloatArray, count: IntArray) -> float:
    """The highest speed about which a vehicle spends a good part of its time."""
    order = np.argsort(means)
    sorted_means, share = means[order], np.cumsum(count[order]) / count.sum()
    best = float(np.interp(0.75, share, sorted_means))
    for _ in range(5):
        near = np.abs(means - best) < 0.15 * best
        if not near.any():
            break
        best = float(np.median(np.repeat(means[near], count[near])))
    return best


@dataclass(frozen=True, eq=False)
class _Fit:
    """A maximum of the likelihood."""

    theta: FloatArray  # [3] logarithms of noise, scatter and memory
    value: float
    hessian: FloatArray  # [3, 3] minus second derivatives
    blocks: FloatArray  # [B, 3] scores


def fit_cruise(windows: Windows, noise: Noise, num_vehicles: int, confidence: float | None = 0.9) -> Cruise | None:
    """Fit noise, scatter and memory; None where there is too little to fit them to. Without a confidence, ranges are not told."""
    if len(windows.count) < FEW_WINDOWS or windows.count.sum() < FEW_STEPS:
        return None
    likelihood, usual = _Likelihood(windows, num_vehicles, float(np.log(noise.position_m))), np.log([noise.position_m, 0.05, 3.0])
    unknown = nan, nan
    if windows.count.sum() < TELLING_STEPS:
        return Cruise(windows, *likelihood.means(usual), noise.position_m, Scatter(*np.exp(usual[1:]).tolist()), unknown, unknown)
    fit = _best(likelihood, usual)
    if likelihood.total(none := np.log([noise.position_m, LEAST_SCATTER, 3.0])) > fit.value:  # blocks that are alike do not lead there
        fit = _best(likelihood, none)
    for _ in range(TRIMS):  # a vehicle that brakes or creeps in a few windows would make all scatter
        fits = explained(_Likelihood(windows, num_vehicles, likelihood.usual_noise).squares(fit.theta), windows.count, UNEXPLAINED)
        if fits.sum() == len(likelihood.windows.count) or fits.mean() < MOST_FIT:
            break
        likelihood = replace(likelihood, windows=taken(windows, fits))
        fit = _best(likelihood, fit.theta)
    mean, mean_deviation = likelihood.means(fit.theta)
    ends = (unknown if confidence is None else np.exp(_range(likelihood, fit, k, confidence)).tolist() for k in (1, 2))
    noise_range, tau_range = ((low, high) for low, high in ends)
    noise_m, relative, tau_s = np.exp(fit.theta).tolist()
    return Cruise(likelihood.windows, mean, mean_deviation, noise_m, Scatter(relative, tau_s), noise_range, tau_range)


def explained(chi2: FloatArray, freedom: IntArray, within: float) -> BoolArray:
    """[N] whether sums of squares are as large as noise makes them, or as most of them are (Wilson and Hilferty, 1931)."""
    usual = max(1.0, float(np.median(chi2 / freedom)))
    fits: BoolArray = (chi2 / freedom / usual) ** (1 / 3) < 1 - 2 / (9 * freedom) + within * np.sqrt(2 / (9 * freedom))
    return fits


def _best(likelihood: "_Likelihood", theta: FloatArray) -> _Fit:
    """Levenberg's steps with the outer products of the blocks' scores."""
    value, damping = likelihood.total(theta), 1e-2
    for _ in range(25):
        blocks, pull = likelihood.block_scores(theta), (likelihood.usual_noise - theta[0]) / NOISE_PRIOR**2
        information = blocks.T @ blocks
        information[0, 0] += NOISE_PRIOR**-2
        gradient = blocks.sum(0) + np.array([pull, 0.0, 0.0])
        gain = 0.0
        for _ in range(6):
            step = np.linalg.solve(information + damping * np.diag(np.diag(information) + 1e-6), gradient)
            ahead = np.clip(theta + np.clip(step, -1.0, 1.0), *likelihood.bounds)
            new = likelihood.total(ahead)
            if new > value + 1e-9:
                gain, theta, value, damping = new - value, ahead, new, damping / 3
                break
            damping *= 4
        if gain < 2e-3:
            break
    return _Fit(theta, value, likelihood.hessian(theta), likelihood.block_scores(theta))


def _range(likelihood: "_Likelihood", fit: _Fit, k: int, confidence: float) -> tuple[float, float]:
    """Where the profile likelihood of an unknown, scaled by what the blocks scatter, leaves its interval; the bounds where it does not."""
    low, high = (float(bound[k]) for bound in likelihood.bounds)
    if fit.theta[1] < np.log(1.01 * LEAST_SCATTER):  # at a bound scores do not add up to nothing
        return low, _most_scatter(likelihood, fit, student(confidence, likelihood.num_blocks - 1) ** 2 / 2) if k == 1 else high
    inverse = np.linalg.pinv(fit.hessian)
    robust = inverse @ (fit.blocks.T @ fit.blocks) @ inverse
    if not (inverse[k, k] > 0 and robust[k, k] > 0):
        return low, high
    blocks = int(np.count_nonzero(np.abs(fit.blocks).sum(1)))
    reach = SCATTER_HELD * student(confidence, blocks - 1)
    drop = reach**2 / 2 * float(robust[k, k] / inverse[k, k])
    ends = []
    for sign, bound in ((-1.0, low), (1.0, high)):
        inside, theta, step = 0.0, fit.theta.copy(), reach * float(np.sqrt(robust[k, k]))
        outside, low_theta, farthest = None, theta, abs(bound - float(fit.theta[k]))
        for _ in range(9):
            at = (inside + outside) / 2 if outside is not None else min(inside + step, farthest)
            value, theta = _profiled(likelihood, low_theta, fit, k, fit.theta[k] + sign * at)
            if fit.value - value < drop:
                inside, low_theta, step = at, theta, step * 1.3
                if at >= farthest:
                    break
            else:
                outside = at
            if outside is not None and outside - inside < 0.1 * step:
                break
        ends.append(float(fit.theta[k] + sign * (inside if outside is None else (inside + outside) / 2)))
    return ends[0], ends[1]


def _most_scatter(likelihood: "_Likelihood", fit: _Fit, drop: float) -> float:
    """Logarithm of the largest scatter, of any memory, that a log without any allows."""
    (_, inside, shortest), (_, outside, longest) = likelihood.bounds
    for _ in range(8):
        at = (inside + outside) / 2
        best = max(likelihood.total(np.array([fit.theta[0], at, tau])) for tau in np.linspace(shortest, longest, 9))
        inside, outside = (at, outside) if fit.value - best < drop else (inside, at)
    return float(outside)


def _profiled(likelihood: "_Likelihood", theta: FloatArray, fit: _Fit, k: int, at: float) -> tuple[float, FloatArray]:
    """The likelihood with one unknown fixed, and where: the others by a few steps from where they were."""
    others = [i for i in range(3) if i != k]
    inverse = np.linalg.pinv(fit.hessian[np.ix_(others, others)])

    def bounded(theta: FloatArray) -> FloatArray:
        theta = np.clip(theta, *likelihood.bounds)
        theta[k] = at
        return theta

    here = theta.copy()
    here[others] -= inverse @ fit.hessian[others, k] * (at - theta[k])
    here = bounded(here)
    value = likelihood.total(here)
    for _ in range(3):
        gradient = [(likelihood.total(here + h) - likelihood.total(here - h)) / 0.04 for h in 0.02 * np.eye(3)[others]]
        ahead = here.copy()
        ahead[others] += np.clip(inverse @ gradient, -0.7, 0.7)
        ahead = bounded(ahead)
        new = likelihood.total(ahead)
        if new < value + 0.02:
            return (new, ahead) if new > value else (value, here)
        value, here = new, ahead
    return value, here


def student(confidence: float, freedom: int) -> float:
    """The quantile of Student's t for a two-sided interval."""
    return t_quantile((1 + confidence) / 2, max(freedom, 1))


@dataclass(frozen=True, eq=False)
class _Likelihood:
    """Likelihood of the logarithms theta [3] of noise, scatter and memory, each vehicle at its best mean."""

    windows: Windows
    num_vehicles: int
    usual_noise: float  # its logarithm, as stands say it

    @property
    def num_blocks(self) -> int:
        return int(self.windows.block.max()) + 1

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """The least and the largest theta."""
        noise = self.usual_noise
        return np.array([noise - 1, np.log(LEAST_SCATTER), np.log(0.1)]), np.array([noise + 1.5, np.log(1.0), np.log(300.0)])

    def total(self, theta: FloatArray) -> float:
        """Of all windows, and of the noise beside that of stands."""
        return float(self.at(theta).sum()) - ((float(theta[0]) - self.usual_noise) / NOISE_PRIOR) ** 2 / 2

    def scores(self, theta: FloatArray) -> FloatArray:
        """[W, 3] of each window."""
        return np.stack([(self.at(theta + h) - self.at(theta - h)) / 0.04 for h in 0.02 * np.eye(3)], 1)

    def block_scores(self, theta: FloatArray) -> FloatArray:
        """[B, 3] of each block."""
        summed = np.zeros((self.num_blocks, 3))
        np.add.at(summed, self.windows.block, self.scores(theta))
        return summed

    def hessian(self, theta: FloatArray) -> FloatArray:
        """[3, 3] minus the second derivatives."""
        hessian = np.array([(self.scores(theta - h).sum(0) - self.scores(theta + h).sum(0)) / 0.1 for h in 0.05 * np.eye(3)])
        hessian[0, 0] += NOISE_PRIOR**-2
        symmetric: FloatArray = (hessian + hessian.T) / 2
        return symmetric

    def at(self, theta: FloatArray) -> FloatArray:
        """[W] log likelihoods."""
        _, determinant, squares, _ = self._sums(theta)
        return -determinant - squares / 2

    def squares(self, theta: FloatArray) -> FloatArray:
        """[W] sums of squares of independent residuals."""
        return self._sums(theta)[2]

    def means(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Means of vehicles [R], and deviations [R] of their logarithms."""
        weight, _, _, pull = self._sums(theta)
        mean, per_vehicle = self._mean_of(pull, weight), np.bincount(self.windows.vehicle, weight, self.num_vehicles)
        influence = np.zeros((self.num_vehicles, self.num_blocks))
        own = mean[self.windows.vehicle]
        np.add.at(influence, (self.windows.vehicle, self.windows.block), (pull - weight * own) / per_vehicle[self.windows.vehicle] / own)
        blocks = np.maximum(np.count_nonzero(influence, axis=1), 2)
        with np.errstate(invalid="ignore", divide="ignore"):
            expected = 1 / np.sqrt(per_vehicle) / mean
        return mean, np.maximum(expected, np.sqrt((influence**2).sum(1) * blocks / (blocks - 1)))

    def _mean_of(self, pull: FloatArray, weight: FloatArray) -> FloatArray:
        """[R] weighted means, NaN where there are none."""
        pulls, weights = (np.bincount(self.windows.vehicle, each, self.num_vehicles) for each in (pull, weight))
        with np.errstate(invalid="ignore", divide="ignore"):
            mean: FloatArray = pulls / weights
        return mean

    def _sums(self, theta: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Of windows [W] each: weights of their means, half the logarithm of determinants, squares with each vehicle's best mean, pulls."""
        windows = self.windows
        there = np.arange(windows.dt_s.shape[1]) < windows.count[:, None]
        speed = windows.step_m.sum(1) / np.where(there, windows.dt_s, 0.0).sum(1)
        usual = self._mean_of(speed, np.ones(len(speed)))
        top = usual[windows.vehicle] / (1 - MEAN_LOSS * min(float(np.exp(theta[1])), 0.8))
        weight, product, square, determinant = np.zeros((4, len(speed)))
        for most in range(4, LONGEST + 4, 4):  # windows of like length, or most of the numbers would be none
            rows = np.flatnonzero((windows.count <= most) & (windows.count > most - 4))
            if len(rows):
                white, determinant[rows] = self._whitened(theta, rows, min(most, there.shape[1]), top[rows])
                weight[rows], product[rows], square[rows] = ((white[:, :, i] * white[:, :, j]).sum(1) for i, j in ((0, 0), (0, 1), (1, 1)))
        own = self._mean_of(product, weight)[windows.vehicle]
        return weight, determinant, np.maximum(square - 2 * own * product + own**2 * weight, 0.0), product

    def _whitened(self, theta: FloatArray, rows: IntArray, n: int, top_mps: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Times and steps [w, n, 2] of w windows of n steps at most, made independent; and half the logarithm of their determinants."""
        noise_m, relative, tau_s = np.exp(theta).tolist()
        dt_s, step_m = self.windows.dt_s[rows, :n], self.windows.step_m[rows, :n]
        k = np.arange(n)
        there = k < self.windows.count[rows, None]
        x = np.concatenate((np.zeros((len(rows), 1)), np.cumsum(dt_s, 1)), 1)
        whole = integrated_cov(x, Scatter(relative, tau_s)) * (top_mps**2)[:, None, None]
        cov = whole[:, 1:, 1:] - whole[:, :-1, 1:] - whole[:, 1:, :-1] + whole[:, :-1, :-1]
        cov[:, k, k] += 2 * noise_m**2
        cov[:, k[1:], k[:-1]] -= noise_m**2
        cov[:, k[:-1], k[1:]] -= noise_m**2
        cov = np.where(there[:, :, None] & there[:, None, :], cov, 0.0)
        cov[:, k, k] = np.where(there, cov[:, k, k] + 1e-12, 1.0)
        lower = np.linalg.cholesky(cov)
        white = np.linalg.solve(lower, np.stack((np.where(there, dt_s, 0.0), np.where(there, step_m, 0.0)), 2))
        return white, (np.log(lower[:, k, k]) * there).sum(1)
