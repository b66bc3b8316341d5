"""Turning in place: one rate fitted to the headings of vehicles that turn while they stand.

A turn is a ramp of the heading at a constant rate from one heading to another, whenever it begins: that time is integrated out, evenly.
So turns that are over between two samples tell how long a turn takes at most, and how often a sample falls into one how long it takes.
"""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.calibration.log import Track
from mrp_sumo.calibration.phases import Noise, padded
from mrp_sumo.core.graph import FloatArray

LEAST_RAD = 0.5
STEADY_SIGMA = 4.0
AROUND = 4  # steady samples on each side
NODES = 240
MOST_TURNS = 400
RATES = np.geomspace(0.03, 12.0, 90)


@dataclass(frozen=True, eq=False)
class TurnFit:
    """A rate with what each turn says of it."""

    value: float  # rad/s
    scores: FloatArray  # [T] of its logarithm, over the whole information
    angle_rad: FloatArray  # [T]
    time_s: list[FloatArray]  # [n] of samples of each turn, from its first
    turned_rad: list[FloatArray]  # [n] since the heading before


def fit_turning(tracks: list[Track], noise: Noise, speed_mps: float) -> TurnFit | None:
    """The rate; None where no log of headings shows a few turns."""
    turns = [turn for track in tracks if track.has_headings for turn in _turns(track, noise, speed_mps)]
    if len(turns) < 5:
        return None
    if len(turns) > MOST_TURNS:
        turns = [turns[k] for k in np.linspace(0, len(turns) - 1, MOST_TURNS).astype(int).tolist()]
    times, angles, totals = zip(*turns)
    time, angle, there = padded(times, angles)
    whole, last = np.array(totals), np.array([t[-1] for t in times])

    def logs(rate: float) -> FloatArray:
        begin = -whole / rate  # [T] the earliest time at which a turn may have begun
        nodes = begin[:, None] + np.linspace(0, 1, NODES) * (last - begin)[:, None]
        off = angle[:, None, :] - np.clip((time[:, None, :] - nodes[:, :, None]) * rate, 0.0, whole[:, None, None])
        log = -(np.where(there[:, None, :], off, 0.0) ** 2).sum(2) / (2 * noise.heading_rad**2)
        top = log.max(1)
        total: FloatArray = top + np.log(np.exp(log - top[:, None]).mean(1) * (last - begin))
        return total

    coarse = [np.clip(logs(rate), -60.0, None).sum() for rate in RATES[::3]]
    middle = float(np.log(RATES[::3][int(np.argmax(coarse))]))
    fine = np.linspace(middle - 0.25, middle + 0.25, 41)
    values = np.stack([logs(float(np.exp(each))) for each in fine])  # [41, T]
    sums = np.clip(values, values.max(0) - 60.0, None).sum(1)
    k = int(np.clip(np.argmax(sums), 4, len(fine) - 5))
    near = slice(k - 4, k + 5)
    bend, slope, _ = np.polyfit(fine[near] - fine[k], sums[near], 2)
    if not bend < 0:
        return None
    at = float(np.clip(-slope / (2 * bend), -0.1, 0.1))
    scores = np.stack([np.polyfit(fine[near] - fine[k] - at, each, 2)[1] for each in values[near].T]) / (-2 * bend)
    return TurnFit(float(np.exp(fine[k] + at)), scores, whole, list(times), list(angles))


def _turns(track: Track, noise: Noise, speed_mps: float) -> list[tuple[FloatArray, FloatArray, float]]:
    """Times and angles about each turn, and the whole angle, turned so that it is positive."""
    yaw, t = track.yaw_rad, track.t_s
    steady = np.abs(np.diff(yaw)) < STEADY_SIGMA * np.sqrt(2) * noise.heading_rad + 0.02
    edges = np.flatnonzero(np.diff(np.concatenate(([1], steady.astype(np.int8), [1]))))
    turns = []
    for a, b in zip(edges[::2].tolist(), edges[1::2].tolist()):  # steps a to b - 1 turn: samples a to b
        before, after = max(0, a - AROUND + 1), min(len(t), b + AROUND)
        if not (steady[max(0, a - 2) : a].all() and steady[b : b + 2].all()) or a < 2 or b > len(t) - 3:
            continue
        away_m = float(np.hypot(track.x_m[b] - track.x_m[a], track.y_m[b] - track.y_m[a]))
        if away_m > 0.35 * speed_mps * (t[b] - t[a]) + 3 * noise.position_m:
            continue
        low, high = float(np.median(yaw[before : a + 1])), float(np.median(yaw[b:after]))
        whole = high - low
        if not LEAST_RAD < abs(whole) < 3.3:
            continue
        inner = slice(a, b + 1)
        turns.append((t[inner] - t[a], (yaw[inner] - low) * np.sign(whole), abs(whole)))
    return turns
