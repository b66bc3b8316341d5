"""Stops on the way that nobody ordered: their rate and how long they last.

A vehicle that is held brakes, stands and goes on. Holds that end before it stands, or before the log shows it, are not seen: the
likelihood is that of a Poisson stream of lognormal holds of which only the longer ones are. Not counted are stands at actions, where the
way bends, where many of those who pass stand, with another vehicle near, and where the log says that the way ahead was not free. Few
stops do not tell how long stops last: then they last as usual, and a weak prior keeps more of them from being too short to be seen.
"""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.calibration.log import ActionTime
from mrp_sumo.calibration.phases import BEND_RAD, Noise, Phases
from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.graph import BoolArray, FloatArray

NEAR_M = 4.0  # of another vehicle, for which one may wait
PLACE_M = 0.35
OFTEN, SHARE = 4, 0.05  # stands that make a place, where so many of those who pass stand
CHORD = 1.57  # of a disc of radius 1, on average
EDGE = 2  # samples at the ends of a leg, where a stop would not be told from its end
LEAST_PERIODS = 3.0  # of a stand that is surely seen
FEW = 5  # stops, from which on they tell how long stops last
USUAL_S, USUAL_SIGMA, SHORT_S = 6.0, 0.5, 4.0  # of stops, where nobody knows better; the median of short ones
MEDIANS, SIGMAS = np.geomspace(0.5, 300.0, 110), np.linspace(0.05, 2.0, 60)


@dataclass(frozen=True, eq=False)
class Stops:
    """Stops that were seen, and of the rate, median and sigma the best value and its range."""

    hold_s: FloatArray  # [N]
    rate_per_s: tuple[float, float, float]
    median_s: tuple[float, float, float] | None
    sigma: tuple[float, float, float] | None


def fit_stops(
    phases: list[Phases],
    visits: list[ActionTime],
    noise: Noise,
    brake_s: float,
    left_s: dict[tuple[int, int], float],
    came_s: dict[tuple[int, int], float],
    drop: float,
) -> Stops:
    """Find the stops and fit their stream.

    Parameters
    ----------
    phases, visits, noise
        Of the log.
    brake_s
        How long vehicles brake from their mean speed.
    left_s, came_s
        When vehicles left stands and came to them, as far as it was fitted, by number of track and stand.
    drop
        Of the logarithm of a profile likelihood, at which ranges end.
    """
    places = _Stands(phases)
    others = _Others(phases)
    holds, driven_s, periods = [], 0.0, []
    for number, each in enumerate(phases):
        track, t = each.track, each.track.t_s
        period_s = float(np.median(np.diff(t)))
        periods.append(period_s)
        busy = [visit for visit in visits if visit.vehicle == track.vehicle]
        before, after = {leg.to_stand: leg for leg in each.legs}, {leg.from_stand: leg for leg in each.legs}
        alone = ~others.near(track.vehicle, t, track.x_m, track.y_m)
        free = alone & ~(track.waits > 0) & ~places.often(track.x_m, track.y_m)
        for leg in each.legs:
            inner = np.arange(leg.first + EDGE, leg.last + 1 - EDGE)
            driven_s += float(((t[inner] - t[inner - 1]) * free[inner]).sum())
        for k, stand in enumerate(each.stands):
            if k not in before or k not in after or abs(wrapped(after[k].heading_rad - before[k].heading_rad)) > BEND_RAD:
                continue
            during = slice(stand.first, stand.last + 1)
            legs = before[k], after[k]
            if (
                min(leg.last - leg.first for leg in legs) < EDGE + 1
                or not free[during].all()
                or any(v.begin_s < t[stand.last] and v.end_s > t[stand.first] for v in busy)
            ):
                continue
            lasted_s = left_s.get((number, k), t[stand.last] + period_s / 2) - came_s.get((number, k), t[stand.first] - period_s / 2)
            if lasted_s > LEAST_PERIODS * period_s:
                holds.append(lasted_s + brake_s)
    seen_s = LEAST_PERIODS * float(np.median(periods)) + brake_s
    return _fit(np.array(holds), driven_s, seen_s, drop)


def _fit(hold_s: FloatArray, driven_s: float, seen_s: float, drop: float) -> Stops:
    from scipy.special import gammaincinv, ndtr

    count = len(hold_s)

    def seen_share(median_s: float) -> float:
        return float(ndtr(np.log(median_s / seen_s) / USUAL_SIGMA))

    if count < FEW:  # which say nothing of those that are too short to be seen
        driven_s = max(driven_s, 1e-9)
        high = float(gammaincinv(count + 1, 0.95)) / driven_s / seen_share(SHORT_S)
        low = float(gammaincinv(count, 0.05)) / driven_s if count else 0.0
        return Stops(hold_s, (count / driven_s / seen_share(USUAL_S), low, high), None, None)
    log_median, sigma = np.log(MEDIANS)[:, None], SIGMAS[None, :]
    longer = np.maximum(ndtr((log_median - np.log(seen_s)) / sigma), 1e-12)
    z2 = ((np.log(hold_s)[:, None, None] - log_median) ** 2).sum(0) / sigma**2
    durations = -z2 / 2 - count * (np.log(sigma) + np.log(longer))
    durations -= ((log_median - np.log(USUAL_S)) ** 2 + (np.log(sigma) - np.log(USUAL_SIGMA)) ** 2) / 2  # or all may be short ones
    best = float(durations.max())
    i, j = np.unravel_index(int(np.argmax(durations)), durations.shape)
    rate = count / (driven_s * longer[i, j])
    rates = rate * np.geomspace(0.1, 10.0, 161)
    expected = rates[:, None, None] * driven_s * longer
    joint = (durations - best + count * (np.log(expected) - np.log(count)) - expected + count).max((1, 2))
    ranges = [
        _within(rates, joint, drop),
        _within(MEDIANS, durations.max(1) - best, drop),
        _within(SIGMAS, durations.max(0) - best, drop),
    ]
    values = [float(rate), float(MEDIANS[i]), float(SIGMAS[j])]
    made = [(value, *ends) for value, ends in zip(values, ranges)]
    return Stops(hold_s, *made)


def _within(at: FloatArray, log: FloatArray, drop: float) -> tuple[float, float]:
    """Where a profile is above its maximum less `drop`."""
    inside = np.flatnonzero(log - log.max() > -drop)
    a, b = int(inside[0]), int(inside[-1])
    top = float(log.max())

    def cross(one: int, other: int) -> float:
        share = (top - drop - log[one]) / (log[other] - log[one])
        return float(at[one] + share * (at[other] - at[one]))

    return (cross(a - 1, a) if a else float(at[0])), (cross(b + 1, b) if b < len(at) - 1 else float(at[-1]))


class _Stands:
    """Places where vehicles stand, by how many of those who pass do."""

    def __init__(self, phases: list[Phases]) -> None:
        from scipy.spatial import cKDTree

        xy = np.array([(stand.x_m, stand.y_m) for each in phases for stand in each.stands]).reshape(-1, 2)
        places = [np.stack((each.track.x_m, each.track.y_m), 1) for each in phases]
        moving = np.concatenate([np.zeros((0, 2)), *(place[each.moving] for place, each in zip(places, phases))])
        steps = [np.hypot(*np.diff(place[each.moving], axis=0).T) for place, each in zip(places, phases) if each.moving.sum() > 1]
        self._tree, self._passing = (cKDTree(points) if len(points) else None for points in (xy, moving))
        self._passes = float(np.median(np.concatenate(steps))) / (CHORD * PLACE_M) if steps else 0.0  # by sample nearby

    def often(self, x_m: FloatArray, y_m: FloatArray) -> BoolArray:
        """[N] whether vehicles often stand near N points."""
        if self._tree is None or self._passing is None:
            return np.zeros(len(x_m), np.bool_)
        points = np.stack((x_m, y_m), 1)
        stands, samples = (tree.query_ball_point(points, PLACE_M, return_length=True) for tree in (self._tree, self._passing))
        often: BoolArray = (stands >= OFTEN) & (stands > SHARE * (stands + samples * self._passes))
        return often


class _Others:
    """Where all vehicles were, by second."""

    def __init__(self, phases: list[Phases]) -> None:
        self._rows: dict[int, list[tuple[str, float, float]]] = {}
        for each in phases:
            track = each.track
            whole = np.floor(track.t_s).astype(np.int64)
            for k in np.flatnonzero(np.append(True, np.diff(whole) > 0)).tolist():
                self._rows.setdefault(int(whole[k]), []).append((track.vehicle, float(track.x_m[k]), float(track.y_m[k])))

    def near(self, vehicle: str, t_s: FloatArray, x_m: FloatArray, y_m: FloatArray) -> BoolArray:
        """[N] whether another vehicle is near."""
        is_near = np.zeros(len(t_s), np.bool_)
        for k, second in enumerate(np.floor(t_s).astype(np.int64).tolist()):
            is_near[k] = any(
                other != vehicle and (x - x_m[k]) ** 2 + (y - y_m[k]) ** 2 < NEAR_M**2 for other, x, y in self._rows.get(second, ())
            )
        return is_near
