"""Phases of a track: where a vehicle stands, and the straight legs that it drives in between.

Labels only choose which samples a fit gets; how long a vehicle accelerates or stands is for the fits to say. Everything scales with the
noise of positions, which is estimated first: at stands, where a vehicle is at one place.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np

from mrp_sumo.calibration.log import Track
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray

T = TypeVar("T")

LEAST_NOISE_M = 0.002  # of positions: steps of the log's clock, rounding
LEAST_NOISE_RAD = 0.002
LOWER_QUARTER = 0.3186  # of |N(0, 1)|
STILL_SIGMA = 4.0
SHORTEST_LEG_M = 0.3
BEND_RAD = 0.2  # as robots stop for, see drive.motion_plan


@dataclass(frozen=True, eq=False)
class Noise:
    """Standard deviations of what a log says about one pose."""

    position_m: float
    heading_rad: float


@dataclass(frozen=True)
class Stand:
    """Samples `first` to `last` of a track, at one place."""

    first: int
    last: int
    x_m: float
    y_m: float


@dataclass(frozen=True, eq=False)
class StraightLeg:
    """Samples `first` to `last` along a straight line; the first and last ones may lie around a corner or in a stand."""

    first: int
    last: int
    along_m: FloatArray  # [last - first + 1] on the line
    heading_rad: float
    from_stand: int  # index of the stand that it begins at, -1: a corner or the end of the track
    to_stand: int


@dataclass(frozen=True, eq=False)
class Phases:
    """A track with its stands and legs."""

    track: Track
    stands: list[Stand]
    legs: list[StraightLeg]
    moving: BoolArray  # [N]


def noise_of(tracks: list[Track]) -> Noise:
    """Noise of positions and headings: by how far samples are off the line between their neighbours, at the quarter that is least off."""
    off_m, off_rad = [np.zeros(0)], [np.zeros(0)]
    for track in tracks:
        t = track.t_s
        share = (t[1:-1] - t[:-2]) / (t[2:] - t[:-2])
        scale = np.sqrt(1 + share**2 + (1 - share) ** 2)
        for values, off in ((track.x_m, off_m), (track.y_m, off_m), (track.yaw_rad, off_rad)):
            off.append((values[1:-1] - (1 - share) * values[:-2] - share * values[2:]) / scale)
    position_m, heading_rad = (_quarter(np.concatenate(off)) for off in (off_m, off_rad))
    return Noise(max(position_m, LEAST_NOISE_M), max(heading_rad, LEAST_NOISE_RAD))


def _quarter(off: FloatArray) -> float:
    off = np.abs(off[np.isfinite(off)])
    return float(np.quantile(off, 0.25)) / LOWER_QUARTER if len(off) else 0.0


def refined(noise: Noise, phases: list[Phases]) -> Noise:
    """The noise at stands, where there are enough of them."""
    squares, count, turns, num_turns = 0.0, 0, 0.0, 0
    for each in phases:
        for stand in each.stands:
            inner = slice(stand.first + 1, stand.last)
            n = stand.last - stand.first - 1
            if n < 3:
                continue
            xy = np.stack((each.track.x_m[inner], each.track.y_m[inner]))
            squares, count = squares + float(((xy - xy.mean(1, keepdims=True)) ** 2).sum()), count + 2 * (n - 1)
            yaw = each.track.yaw_rad[inner]
            if np.isfinite(yaw).all() and np.ptp(yaw) < 8 * noise.heading_rad:
                turns, num_turns = turns + float(((yaw - yaw.mean()) ** 2).sum()), num_turns + n - 1
    position_m = np.sqrt(squares / count) if count > 100 else noise.position_m
    heading_rad = np.sqrt(turns / num_turns) if num_turns > 100 else noise.heading_rad
    return Noise(max(float(position_m), LEAST_NOISE_M), max(float(heading_rad), LEAST_NOISE_RAD))


def usual_speed(tracks: list[Track]) -> float:
    """The usual speed, roughly: the upper decile of what they cover in two seconds, of those that moved."""
    speeds = [np.zeros(0)]
    for track in tracks:
        lag = max(1, round(2.0 / track.period_s))
        if len(track.t_s) > lag:
            away = np.hypot(track.x_m[lag:] - track.x_m[:-lag], track.y_m[lag:] - track.y_m[:-lag])
            speeds.append(away / (track.t_s[lag:] - track.t_s[:-lag]))
    every = np.concatenate(speeds)
    moved = every[every > 0.25 * np.quantile(every, 0.99)] if len(every) else every
    return float(np.quantile(moved, 0.9)) if len(moved) else 0.0


def phases_of(track: Track, noise: Noise, speed_mps: float) -> Phases:
    """Stands and legs of a track, of a vehicle that usually drives at a speed."""
    stands = _stands(track, noise, speed_mps)
    moving = np.ones(len(track.t_s), np.bool_)
    for stand in stands:
        moving[stand.first : stand.last + 1] = False
    legs: list[StraightLeg] = []
    edges = [(-1, 0)] + [(k, stand.last) for k, stand in enumerate(stands)]
    ends = [(k, stand.first) for k, stand in enumerate(stands)] + [(-1, len(track.t_s) - 1)]
    for (before, a), (after, b) in zip(edges, ends):
        if b - a >= 2:
            legs += _legs(track, noise, (a, before), (b, after))
    return Phases(track, stands, legs, moving)


def _stands(track: Track, noise: Noise, speed_mps: float) -> list[Stand]:
    """Where samples stay together: first by how far it is to the sample `lag` later, then within a ball."""
    xy, period_s = track.xy_m, track.period_s
    least_m = STILL_SIGMA * np.sqrt(2) * noise.position_m
    lag = max(1, round(min(8.0, 3 * least_m / max(speed_mps, 1e-3), 2.0) / period_s)) if period_s else 1
    lag = min(lag, len(xy) - 1)
    near_m = max(least_m, 0.05 * speed_mps * lag * period_s)
    still = np.hypot(*(xy[lag:] - xy[:-lag]).T) < near_m
    held = np.zeros(len(xy), np.bool_)
    for k in np.flatnonzero(still).tolist():
        held[k : k + lag + 1] = True
    within_m = max(STILL_SIGMA * noise.position_m, 0.02 * speed_mps * period_s) + 0.005
    return [stand for a, b in spans_of(held) for stand in _balls(xy, a, b, within_m)]


def _balls(xy: FloatArray, a: int, b: int, near_m: float) -> list[Stand]:
    """Stands among samples a to b: each stays within `near_m` of its middle. A creeping vehicle makes none that is longer than a few."""
    stands: list[Stand] = []
    k = a
    while k < b:
        sum_xy, n, j = xy[k].copy(), 1, k + 1
        while j < b and np.hypot(*(xy[j] - sum_xy / n)) < near_m:
            sum_xy += xy[j]
            n, j = n + 1, j + 1
        if n >= 2:
            middle = np.median(xy[k:j], 0)
            stands.append(Stand(k, j - 1, float(middle[0]), float(middle[1])))
            k = j
        else:
            k += 1
    return stands


def _legs(track: Track, noise: Noise, begin: tuple[int, int], end: tuple[int, int]) -> list[StraightLeg]:
    """Straight pieces from one sample to another (Douglas and Peucker, 1973), each with the stand at its ends."""
    (a, before), (b, after) = begin, end
    xy, legs = track.xy_m[a : b + 1], []
    for first, last in pairwise(_corners(xy, STILL_SIGMA * noise.position_m + 0.02)):
        away = xy[last] - xy[first]
        length_m = float(np.hypot(*away))
        if last - first < 2 or length_m < SHORTEST_LEG_M:
            continue
        inner = xy[first : last + 1]
        direction = np.linalg.svd(inner - inner.mean(0), full_matrices=False)[2][0]
        direction = direction if direction @ away > 0 else -direction
        heading = float(np.arctan2(direction[1], direction[0]))
        stands = (before if first == 0 else -1), (after if last == len(xy) - 1 else -1)
        legs.append(StraightLeg(a + first, a + last, inner @ direction, heading, *stands))
    return legs


def _corners(xy: FloatArray, near_m: float) -> list[int]:
    """Indices of samples between which all others are near the straight line."""
    corners, stack = {0, len(xy) - 1}, [(0, len(xy) - 1)]
    while stack:
        a, b = stack.pop()
        if b - a < 2:
            continue
        along = xy[b] - xy[a]
        length = float(np.hypot(*along))
        inner = xy[a + 1 : b] - xy[a]
        off = np.abs(inner @ (-along[1], along[0])) / length if length > near_m else np.hypot(*inner.T)
        k = int(np.argmax(off))
        if off[k] > near_m:
            corners.add(a + 1 + k)
            stack += [(a, a + 1 + k), (a + 1 + k, b)]
    return sorted(corners)


def spans_of(flags: BoolArray) -> list[tuple[int, int]]:
    """Runs of flags that are true: the first of each, and the one after its last."""
    edges = np.flatnonzero(np.diff(flags.astype(np.int8), prepend=0, append=0)).tolist()
    return list(zip(edges[::2], edges[1::2]))


def thinned(rows: list[T], most: int) -> list[T]:
    """So many of the rows at most, evenly spread."""
    return rows if len(rows) <= most else [rows[k] for k in np.linspace(0, len(rows) - 1, most).astype(int).tolist()]


def taken(columns: T, rows: BoolArray | IntArray) -> T:
    """Some rows of a dataclass whose fields are columns."""
    return replace(columns, **{name: column[rows] for name, column in vars(columns).items()})  # type: ignore[type-var]


def padded(first: Sequence[FloatArray], second: Sequence[FloatArray]) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Two columns of arrays as rows [E, n], filled up with zeros, and which of these values are there."""
    count = np.array([len(each) for each in first], np.int64)
    is_there = np.arange(count.max(initial=1)) < count[:, None]
    rows, others = np.zeros(is_there.shape), np.zeros(is_there.shape)
    if len(count):
        rows[is_there], others[is_there] = np.concatenate(first), np.concatenate(second)
    return rows, others, is_there
