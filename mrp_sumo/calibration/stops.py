"""Stops on the way that nobody ordered: their rate and how long they last.

A vehicle that is held brakes, stands and goes on. Holds that end before it stands, or before the log shows it, are not seen: the
likelihood is that of a Poisson stream of lognormal holds of which only the longer ones are. Not counted are stands at actions, where the
way bends, where many of those who pass stand without such a reason, beside a lift or another vehicle, while another vehicle is served at
the next stop, and where the log says that the way ahead was not free. The rate is that of stops of the best durations, with limits over
all durations that they may have; a prior has them last about as long as usual. Fewer than five stops do not tell how long they last:
theirs is the rate of stops that last as long as usual.
A rate is the median of its posterior, and its limits are the 5th and the 95th percentile, with a Gamma prior that is worth half a stop;
without any stop it is 0.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mrp_sumo.calibration.log import FASTEST_MPS, ActionTime, Track
from mrp_sumo.calibration.phases import BEND_RAD, Phases
from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.graph import BoolArray, FloatArray
from mrp_sumo.core.grouping import grouped

NEAR_M, LIFT_M = 4.0, 3.0  # of another vehicle, and of where vehicles change levels, for which one may wait
PLACE_M = 0.35
OFTEN, SHARE = 4, 0.05  # stands that make a place, where so many of those who pass stand
CHORD = 1.57  # of a disc of radius 1, on average
EDGE = 2  # samples at the ends of a leg, where a stop would not be told from its end
LEAST_PERIODS = 3.0  # of a stand that is surely seen
FEW = 5  # stops, from which on they tell how long stops last
USUAL_S, USUAL_SIGMA = 6.0, 0.5  # of stops, where nobody knows better
STANDING_S = 2.0, 4.0, 6.0  # after a stop began, when nobody else may be near or at the next stop, or it would not count
USUAL_WITHIN = 0.5, 1.0  # standard deviations of the logarithms of both
PRIOR, PRIOR_S = 0.5, 125.0  # stops, and seconds of driving, that a rate is taken to have shown before: one in four minutes, or far fewer
MEDIANS, SIGMAS = np.geomspace(0.5, 300.0, 110), np.linspace(0.05, 2.0, 60)


@dataclass(frozen=True, eq=False)
class Stops:
    """Stops that were seen, and of the rate, median and sigma the best value and its range."""

    hold_s: FloatArray  # [N]
    driven_s: float  # for which vehicles drove where a stop would be seen
    rate_per_s: tuple[float, float, float]
    median_s: tuple[float, float, float] | None
    sigma: tuple[float, float, float] | None


def fit_stops(
    phases: list[Phases],
    visits: list[ActionTime],
    all_tracks: list[Track],
    brake_s: float,
    left_s: dict[tuple[int, int], float],
    came_s: dict[tuple[int, int], float],
    drop: float,
) -> Stops:
    """Find the stops among the stands of a log and fit their stream; `all_tracks` are those of all vehicles that are there, others too.

    Vehicles brake from their mean speed for `brake_s`; they left stands and came to them at `left_s` and `came_s`, by number of track and
    stand, as far as it was fitted. Ranges end where the logarithm of a profile likelihood has dropped by `drop`.
    """
    unexplained = [_unexplained(each, visits) for each in phases]
    places, others, lifts = _Stands(phases, unexplained), _Others(all_tracks), _lifts(all_tracks)
    at = grouped((visit.station, visit) for visit in visits if visit.station)
    holds, driven_s = [], 0.0
    for number, each in enumerate(phases):
        track, t, period_s = each.track, each.track.t_s, each.track.period_s
        alone, taken = ~others.near(track.vehicle, t, track.x_m, track.y_m), _is_next_taken(track, at)
        free = alone & ~(track.waits > 0) & ~places.often(track.x_m, track.y_m) & ~taken
        if len(lifts):
            free &= (np.hypot(track.x_m[:, None] - lifts[:, 0], track.y_m[:, None] - lifts[:, 1]) > LIFT_M).all(1)
        stays = free & ~np.any([others.near(track.vehicle, t + later_s, track.x_m, track.y_m) for later_s in STANDING_S], 0)
        stays &= ~np.any([taken[np.minimum(np.searchsorted(t, t + later_s), len(t) - 1)] for later_s in STANDING_S], 0)
        for leg in each.legs:
            inner = np.arange(leg.first + EDGE, leg.last + 1 - EDGE - round(brake_s / period_s))  # who brakes already stands at the end
            driven_s += float(((t[inner] - t[inner - 1]) * stays[inner]).sum())
        for k, shortest in unexplained[number].items():
            stand = each.stands[k]
            if shortest <= EDGE or not free[stand.first : stand.last + 1].all():
                continue
            lasted_s = left_s.get((number, k), t[stand.last] + period_s / 2) - came_s.get((number, k), t[stand.first] - period_s / 2)
            if lasted_s > LEAST_PERIODS * period_s:
                holds.append(lasted_s + brake_s)
    seen_s = LEAST_PERIODS * float(np.median([each.track.period_s for each in phases])) + brake_s
    return _fit(np.array(holds), driven_s, seen_s, drop)


def _unexplained(each: Phases, visits: list[ActionTime]) -> dict[int, int]:
    """Stands of a vehicle on a straight way, without an action: the steps of the shorter leg beside each."""
    t = each.track.t_s
    busy = [visit for visit in visits if visit.vehicle == each.track.vehicle]
    before, after = {leg.to_stand: leg for leg in each.legs}, {leg.from_stand: leg for leg in each.legs}
    return {
        k: min(leg.last - leg.first for leg in (before[k], after[k]))
        for k, stand in enumerate(each.stands)
        if k in before
        and k in after
        and abs(wrapped(after[k].heading_rad - before[k].heading_rad)) <= BEND_RAD
        and not any(visit.begin_s < t[stand.last] and visit.end_s > t[stand.first] for visit in busy)
    }


def _is_next_taken(track: Track, at: Mapping[str, Sequence[ActionTime]]) -> BoolArray:
    """[N] whether another vehicle is served where this one will be served next: it may wait for that, however far away."""
    taken = np.zeros(len(track.t_s), np.bool_)
    mine = sorted((visit for visits in at.values() for visit in visits if visit.vehicle == track.vehicle), key=lambda visit: visit.begin_s)
    for since_s, visit in zip((-math.inf, *(visit.end_s for visit in mine)), mine):
        until_s = visit.begin_s
        if since_s > track.t_s[-1] or until_s < track.t_s[0]:
            continue
        for other in at[visit.station]:
            if other.vehicle != track.vehicle and since_s < other.end_s and other.begin_s < until_s:
                begin, end = np.searchsorted(track.t_s, (max(since_s, other.begin_s), min(until_s, other.end_s)))
                taken[begin:end] = True
    return taken


def _fit(hold_s: FloatArray, driven_s: float, seen_s: float, drop: float) -> Stops:
    from scipy.special import gammainc, gammaincinv, ndtr

    count, driven_s = len(hold_s), max(driven_s, 1e-9)
    if count < FEW:
        seen_share = ndtr(np.log(USUAL_S / seen_s) / USUAL_SIGMA)
        low, rate, high = (gammaincinv(count + PRIOR, (0.05, 0.5, 0.95)) / (driven_s * seen_share + PRIOR_S)).tolist()
        return Stops(hold_s, driven_s, (rate, low, high) if count else (0.0, 0.0, high), None, None)
    log_median, sigma = np.log(MEDIANS)[:, None], SIGMAS[None, :]
    longer = np.maximum(ndtr((log_median - np.log(seen_s)) / sigma), 1e-12)
    off = (log_median - np.log(USUAL_S)) / USUAL_WITHIN[0], (np.log(sigma) - np.log(USUAL_SIGMA)) / USUAL_WITHIN[1]
    durations = -(off[0] ** 2 + off[1] ** 2) / 2
    durations -= ((np.log(hold_s)[:, None, None] - log_median) ** 2).sum(0) / (2 * sigma**2) + count * np.log(sigma * longer)
    weight = np.exp(durations - durations.max()) / sigma
    cells = weight > 1e-6
    rates = np.geomspace(1e-3, 1e3, 241) * (count + PRIOR) / driven_s
    below = gammainc(count + PRIOR, rates[:, None] * (driven_s * longer[cells] + PRIOR_S)) @ weight[cells] / weight[cells].sum()
    low, high = np.interp((0.05, 0.95), below, rates).tolist()
    i, j = np.unravel_index(int(np.argmax(durations)), durations.shape)
    rate = min(max(float(gammaincinv(count + PRIOR, 0.5) / (driven_s * longer[i, j] + PRIOR_S)), low), high)
    median = float(MEDIANS[i]), *_within(MEDIANS, durations.max(1), drop)
    spread = float(SIGMAS[j]), *_within(SIGMAS, durations.max(0), drop)
    return Stops(hold_s, driven_s, (rate, low, high), median, spread)


def _within(at: FloatArray, log: FloatArray, drop: float) -> tuple[float, float]:
    """Where a profile is above its maximum less `drop`."""
    inside = np.flatnonzero(log - log.max() > -drop)
    a, b = int(inside[0]), int(inside[-1])
    top = float(log.max())

    def cross(one: int, other: int) -> float:
        share = (top - drop - log[one]) / (log[other] - log[one])
        return float(at[one] + share * (at[other] - at[one]))

    return (cross(a - 1, a) if a else float(at[0])), (cross(b + 1, b) if b < len(at) - 1 else float(at[-1]))


def _lifts(tracks: list[Track]) -> FloatArray:
    """[L, 2] m of places where vehicles change levels: they go on at once, on another level or farther away than anybody drives."""
    places = set()
    for one, other in pairwise(tracks):
        if one.vehicle != other.vehicle:
            continue
        (x, y), (then_x, then_y) = ((float(each.x_m[k]), float(each.y_m[k])) for each, k in ((one, -1), (other, 0)))
        if one.level != other.level or math.hypot(then_x - x, then_y - y) > FASTEST_MPS * abs(float(other.t_s[0] - one.t_s[-1])) + 1.0:
            places |= {(round(x), round(y)), (round(then_x), round(then_y))}
    return np.array(sorted(places), np.float64).reshape(-1, 2)


class _Stands:
    """Places where vehicles stand, by how many of those who pass do."""

    def __init__(self, phases: list[Phases], stands: list[dict[int, int]]) -> None:
        from scipy.spatial import cKDTree

        xy = np.array([(each.stands[k].x_m, each.stands[k].y_m) for each, mine in zip(phases, stands) for k in mine]).reshape(-1, 2)
        moves = [each.track.xy_m[each.moving] for each in phases]
        moving = np.concatenate([np.zeros((0, 2)), *moves])
        steps = [np.hypot(*np.diff(places, axis=0).T) for places in moves if len(places) > 1]
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
    """Where all vehicles were, by second: points of which those of different seconds are never near."""

    def __init__(self, tracks: list[Track]) -> None:
        from scipy.spatial import cKDTree

        rows: dict[str, list[FloatArray]] = {}
        for track in tracks:
            first = np.flatnonzero(np.append(True, np.diff(np.floor(track.t_s)) > 0))
            rows.setdefault(track.vehicle, []).append(_by_second(track.t_s[first], track.x_m[first], track.y_m[first]))
        self._own = {vehicle: cKDTree(np.concatenate(points)) for vehicle, points in rows.items()}
        self._all = cKDTree(np.concatenate([tree.data for tree in self._own.values()]))

    def near(self, vehicle: str, t_s: FloatArray, x_m: FloatArray, y_m: FloatArray) -> BoolArray:
        """[N] whether another vehicle is near."""
        points = _by_second(t_s, x_m, y_m)
        every, own = (tree.query_ball_point(points, NEAR_M, return_length=True) for tree in (self._all, self._own[vehicle]))
        is_near: BoolArray = every > own
        return is_near


def _by_second(t_s: FloatArray, x_m: FloatArray, y_m: FloatArray) -> FloatArray:
    return np.stack((x_m, y_m, 2 * NEAR_M * np.floor(t_s)), 1)
