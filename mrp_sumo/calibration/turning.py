"""Turning in place: one rate fitted to the headings of vehicles that turn while they stand.

A turn is a ramp of the heading at a constant rate from one heading to another, whenever it begins: that time is integrated out, evenly.
So turns that are over between two samples tell how long a turn takes at most, and how often a sample falls into one how long it takes.
"""

import math
from dataclasses import dataclass

import numpy as np

from mrp_sumo.calibration.log import Track
from mrp_sumo.calibration.phases import Noise, padded, spans_of, thinned
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray

LEAST_RAD = 0.5
STEADY_SIGMA = 4.0
AROUND = 8  # steady samples on each side, but for the one next to the turn, which may be in it
MOST_TURNS = 400
RATES = np.geomspace(0.03, 12.0, 60)
ROUGH_RAD = 0.02  # noise of headings, with less of which most rates would explain nothing of a turn: the maximum is near first
ROUNDS, WITHIN = 16, 2.5  # closer and closer about the maximum, to that many standard deviations, within which it is a parabola


@dataclass(frozen=True, eq=False)
class TurnFit:
    """A rate with what each turn says of it."""

    value: float  # rad/s
    scores: FloatArray  # [T] of its logarithm, over the whole information
    angle_rad: FloatArray  # [T]
    vehicle: IntArray  # [T] whose turn it is, as a number
    time_s: list[FloatArray]  # [n] of samples of each turn, from its first
    turned_rad: list[FloatArray]  # [n] since the heading before


def fit_turning(tracks: list[Track], noise: Noise, speed_mps: float) -> TurnFit | None:
    """The rate; None where no log of headings shows a few turns."""
    number = {vehicle: k for k, vehicle in enumerate(sorted({track.vehicle for track in tracks}))}
    turns = [(*turn, number[track.vehicle]) for track in tracks if track.has_headings for turn in _turns(track, noise, speed_mps)]
    if len(turns) < 5:
        return None
    times, angles, totals, vehicle = zip(*thinned(turns, MOST_TURNS))
    time, angle, there = padded(times, angles)
    whole = np.array(totals)

    def logs(rate: float, noise_rad: float) -> FloatArray:
        return _log_marginal(time, angle, there, whole, rate, noise_rad)

    rough_rad = max(noise.heading_rad, ROUGH_RAD)
    coarse = [np.clip(logs(rate, rough_rad), -60.0, None).sum() for rate in RATES]
    log_rate, width = float(np.log(RATES[int(np.argmax(coarse))])), float(np.log(RATES[1] / RATES[0]))
    for noise_rad in sorted({rough_rad, noise.heading_rad}, reverse=True):
        for _ in range(ROUNDS):
            off = width * np.linspace(-1, 1, 7)
            values = np.stack([logs(float(np.exp(log_rate + each)), noise_rad) for each in off])  # [7, T]
            values = np.maximum(values, values.max(0) - 60.0)
            sums = values.sum(1)
            bend, slope, _ = np.polyfit(off, sums, 2)
            if bend < 0 and width < WITHIN / math.sqrt(-2 * bend):
                break
            log_rate, width = log_rate + float(off[np.argmax(sums)]), width / 2
    if not bend < 0:
        return None
    at = float(np.clip(-slope / (2 * bend), -width, width))
    scores = np.polyfit(off - at, values, 2)[1] / (-2 * bend)
    return TurnFit(float(np.exp(log_rate + at)), scores, whole, np.array(vehicle), list(times), list(angles))


def _log_marginal(time_s: FloatArray, angle: FloatArray, there: BoolArray, whole: FloatArray, rate: float, noise: float) -> FloatArray:
    """[T] logarithms of likelihoods at a rate, integrated over when turns begin.

    Between times at which a sample enters the ramp or leaves it, squares add up to a parabola: so integrals are those of a normal density.
    """
    from scipy.special import log_ndtr

    enters, leaves = np.where(there, time_s, np.nan), np.where(there, time_s - whole[:, None] / rate, np.nan)
    edges = np.sort(np.concatenate((enters, leaves), 1), 1)  # those that are not there come last
    begin, end = edges[:, :-1, None], edges[:, 1:, None]
    middle = (begin + end) / 2
    with np.errstate(invalid="ignore"):
        on_ramp, after = (middle < enters[:, None, :]) & (middle > leaves[:, None, :]), middle <= leaves[:, None, :]
    flat, on_ramp = there[:, None, :] & ~on_ramp, on_ramp & there[:, None, :]
    off = np.where(flat, angle[:, None, :] - np.where(after, whole[:, None, None], 0.0), 0.0)
    ahead = np.where(on_ramp, time_s[:, None, :] * rate - angle[:, None, :], 0.0)  # of the beginning, as angles
    count = on_ramp.sum(2)
    mean = ahead.sum(2) / np.maximum(count, 1)
    squares = (off**2).sum(2) + (np.where(on_ramp, ahead - mean[:, :, None], 0.0) ** 2).sum(2)
    deviation = noise / np.sqrt(np.maximum(count, 1))
    low, high = ((each[:, :, 0] * rate - mean) / deviation for each in (begin, end))
    low, high = np.where(low > 0, -high, low), np.where(low > 0, -low, high)
    with np.errstate(divide="ignore", invalid="ignore"):
        normal = log_ndtr(high) + np.log1p(-np.exp(log_ndtr(low) - log_ndtr(high))) + np.log(deviation / rate * math.sqrt(2 * math.pi))
        pieces = -squares / (2 * noise**2) + np.where(count > 0, normal, np.log(end - begin)[:, :, 0])
    pieces = np.where(edges[:, 1:] > edges[:, :-1], pieces, -np.inf)
    top = pieces.max(1)
    total: FloatArray = top + np.log(np.exp(pieces - top[:, None]).sum(1))
    return total


def _turns(track: Track, noise: Noise, speed_mps: float) -> list[tuple[FloatArray, FloatArray, float]]:
    """Times and angles about each turn, and the whole angle, turned so that it is positive."""
    yaw, t = track.yaw_rad, track.t_s
    steady = np.abs(np.diff(yaw)) < STEADY_SIGMA * np.sqrt(2) * noise.heading_rad + 0.02
    spans, turns = spans_of(~steady), []
    for (a, b), (_, earlier), (later, _) in zip(spans, [(0, -1), *spans], [*spans[1:], (len(t), 0)]):
        # steps a to b - 1 turn: samples a to b
        before, after = slice(max(earlier + 1, a - AROUND), a), slice(b + 1, min(later, b + 1 + AROUND))
        if not (steady[max(0, a - 2) : a].all() and steady[b : b + 2].all()) or a < 2 or b > len(t) - 3:
            continue
        away_m = float(np.hypot(track.x_m[b] - track.x_m[a], track.y_m[b] - track.y_m[a]))
        if away_m > 0.35 * speed_mps * (t[b] - t[a]) + 3 * noise.position_m:
            continue
        low, high = float(np.median(yaw[before])), float(np.median(yaw[after]))
        whole = high - low
        if not LEAST_RAD < abs(whole) < 3.3:
            continue
        inner = slice(a, b + 1)
        turns.append((t[inner] - t[a], (yaw[inner] - low) * np.sign(whole), abs(whole)))
    return turns
