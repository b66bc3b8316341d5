"""Logs of a fleet as calibration sees them, wherever they come from: where vehicles were when, and what they did at stops.

Times are each vehicle's own, and clocks of two may be seconds apart. A track has no gap and no jump of the clock; what lies between two
tracks of a vehicle is unknown.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.errors import MrpSumoError, listed
from mrp_sumo.maps.levels import shifts_of

if TYPE_CHECKING:
    from mrp_sumo.maps.map import Map

MOST_HZ = 5.0  # beyond which samples say the same again
GAP_PERIODS = 3.5  # a longer time without a sample, in usual periods, is a gap
LEAST_GAP_S = 1.0
FASTEST_MPS = 12.0  # beyond it a pose is not where the vehicle was, or is that of another one
SHORTEST = 4  # samples of a track
BESIDE_M, ELSEWHERE = 10.0, 0.2  # how far from a map's lanes poses may be, and which share of a vehicle's may be farther
BESIDE_LANES_M, BETWEEN_M = 0.5, 0.5  # how far half of them may be off lanes, and between points that lanes are taken for
NAMED = 3  # vehicles in a message
LEAP_RAD, LEAPS = 7.0, 3  # between two headings, farther than once round; how many of them make degrees
SAME_M, ALWAYS = 0.3, 0.8  # two vehicles nearer to each other than bodies are for so much of the time are one
NO_ORDER = 0.02  # share of poses before the one that precedes them, which no clock makes
TWO_AT_ONCE = 0.05  # share of steps beyond `FASTEST_MPS` that two vehicles of one name make


@dataclass(frozen=True, eq=False)
class Track:
    """N poses of one vehicle on one level, without a gap."""

    vehicle: str
    t_s: FloatArray  # [N] ascending
    x_m: FloatArray  # [N]
    y_m: FloatArray  # [N]
    yaw_rad: FloatArray  # [N] unwrapped; NaN where it is not said
    waits: FloatArray  # [N] 1: it has no way ahead that it may drive, 0: it has, NaN: not said
    level: float = 0.0  # its number

    @property
    def has_headings(self) -> bool:
        return bool(np.isfinite(self.yaw_rad).all())

    @cached_property
    def period_s(self) -> float:
        """The usual time between two poses."""
        return float(np.median(np.diff(self.t_s)))

    @property
    def xy_m(self) -> FloatArray:
        """[N, 2]"""
        return np.stack((self.x_m, self.y_m), 1)


@dataclass(frozen=True)
class ActionTime:
    """An action of a vehicle at a stop."""

    vehicle: str
    action: str
    station: str  # '': not said
    begin_s: float
    end_s: float
    told_s: float = math.nan  # when the vehicle was told to; NaN: not said


@dataclass(frozen=True)
class LoggedOrder:
    """An order, as far as a log tells of it. Times in s, NaN: never, or not said."""

    name: str
    stops: tuple[str, ...]  # names of stations or vertices
    release_s: float
    assigned_s: float = math.nan
    vehicle: str = ""  # that had it last
    services: tuple[tuple[float, float], ...] = ()  # begin and end, of the stops that were made
    done_s: float = math.nan
    ended_s: float = math.nan  # done, failed or cancelled
    asks: Mapping[str, Any] = field(default_factory=dict)  # more of a scenario's task, such as `priority`; `due_s` as a time of the log
    where: str = ""  # file and line, of an order of a file


@dataclass(frozen=True)
class Charge:
    """State of charge that a vehicle reported."""

    vehicle: str
    t_s: float
    share: float  # of the capacity, 0 to 1
    charging: bool


@dataclass
class MotionLog:
    """A log as a whole."""

    source: str  # its name, for messages
    kind: str  # 'VDA 5050', 'bag', 'CSV' or 'run folder'
    poses: dict[str, list[tuple[float, ...]]] = field(default_factory=dict)  # by vehicle: t_s, x_m, y_m, yaw_rad, waits, level
    visits: list[ActionTime] = field(default_factory=list)
    orders: list[LoggedOrder] = field(default_factory=list)  # by release
    charges: list[Charge] = field(default_factory=list)
    body: dict[str, float] = field(default_factory=dict)  # length_m and width_m, where the log says them
    types: dict[str, str] = field(default_factory=dict)  # of vehicles, where the log names them
    levels: dict[float, str] = field(default_factory=dict)  # names by the number that poses have
    is_laid_out: bool = False  # levels lie side by side, as those of maps do
    is_commanded: bool = False  # poses are where vehicles were told to be, not where they were
    notes: list[str] = field(default_factory=list)  # what was left out, and why

    def number_of(self, level: str) -> float:
        """The number that poses on a level have."""
        number = next((number for number, name in self.levels.items() if name == level), float(len(self.levels)))
        self.levels[number] = level
        return number

    def set_clock(self, vehicle: str, off_s: float) -> None:
        """Move all times that a vehicle says by so much."""
        self.poses[vehicle] = [(row[0] + off_s, *row[1:]) for row in self.poses[vehicle]]
        self.visits = [
            replace(visit, begin_s=visit.begin_s + off_s, end_s=visit.end_s + off_s) if visit.vehicle == vehicle else visit
            for visit in self.visits
        ]
        self.charges = [replace(each, t_s=each.t_s + off_s) if each.vehicle == vehicle else each for each in self.charges]

    def tracks(self) -> "list[Track]":
        """The poses without gaps, jumps of clocks and repeated samples. Raises MrpSumoError where two vehicles share a name."""
        made: list[Track] = []
        for vehicle, rows in sorted(self.poses.items()):
            tracks = _tracks_of(vehicle, np.array(rows, np.float64).reshape(-1, 6), self)
            if not tracks:
                self.notes.append(f"{vehicle} has no {SHORTEST} poses in a row without a gap: left out")
            made += tracks
        return made


def _tracks_of(vehicle: str, rows: FloatArray, log: MotionLog) -> list[Track]:
    back = np.flatnonzero(np.diff(rows[:, 0]) < 0) + 1
    far_back = [k for k in back.tolist() if rows[k - 1, 0] - rows[k, 0] > LEAST_GAP_S]
    if len(far_back) > max(3.0, NO_ORDER * len(rows)):
        raise MrpSumoError(f"{log.source}: poses of '{vehicle}' go back in time {len(far_back)} times, expected them in order of time")
    if len(far_back):
        log.notes.append(
            f"the clock of {vehicle} jumps back {'once' if len(far_back) == 1 else f'{len(far_back)} times'}: the log is cut there"
        )
    tracks: list[Track] = []
    too_fast = steps = 0
    leaps: list[float] = []
    for a, b in pairwise([0, *far_back, len(rows)]):
        part = rows[a:b]
        part = part[np.argsort(part[:, 0], kind="stable")]
        is_later, away = np.diff(part[:, 0]) > 1e-6, np.hypot(*np.diff(part[:, 1:3], axis=0).T)
        too_fast, steps = too_fast + int((~is_later & (away > 1.0)).sum()), steps + int((~is_later).sum())
        part = part[np.append(True, is_later)]
        if len(part) < SHORTEST:
            continue
        dt = np.diff(part[:, 0])
        period_s = float(np.median(dt))
        jumps = (np.diff(part[:, 5]) == 0) & (np.hypot(*np.diff(part[:, 1:3], axis=0).T) > FASTEST_MPS * np.maximum(dt, period_s) + 1.0)
        too_fast, steps = too_fast + int(jumps.sum()), steps + len(dt)
        gaps = (dt > max(GAP_PERIODS * period_s, LEAST_GAP_S)) | jumps | (np.diff(part[:, 5]) != 0)
        turned = np.abs(np.diff(part[:, 3]))
        leaps += turned[~gaps & (turned > LEAP_RAD)].tolist()
        step = max(1, int(1 / (MOST_HZ * period_s) + 0.5)) if period_s > 0 else 1
        for c, d in pairwise([0, *(np.flatnonzero(gaps) + 1).tolist(), len(part)]):
            if d - c >= SHORTEST:
                t_s, x_m, y_m, yaw, waits, level = part[c:d:step].T
                tracks.append(Track(vehicle, t_s, x_m, y_m, np.unwrap(yaw), waits, float(level[0])))
    if steps and too_fast > max(3.0, TWO_AT_ONCE * steps):
        raise MrpSumoError(
            f"{log.source}: vehicle '{vehicle}' is at two places at once, {too_fast} times: two vehicles of one name, or other units "
            "than metres and seconds"
        )
    if len(leaps) > LEAPS:
        raise MrpSumoError(
            f"{log.source}: the heading of '{vehicle}' leaps by {max(leaps):.0f} rad: degrees, expected radians "
            "(a column of degrees is called yaw_deg), or two vehicles of one name"
        )
    if too_fast:
        log.notes.append(f"{vehicle} jumps {too_fast} times farther than any vehicle drives: the log is cut there")
    return tracks


def require_different(log: MotionLog) -> None:
    """Refuse one vehicle of two names: both are at the same places all the time. Raises MrpSumoError."""
    by_time = {name: sorted(rows, key=lambda row: row[0]) for name, rows in sorted(log.poses.items()) if len(rows) > 1}
    tables = {name: np.array(rows)[:, [0, 1, 2, 5]] for name, rows in by_time.items()}
    for (one, a), (other, b) in combinations(tables.items(), 2):
        t = np.linspace(max(a[:, 0].min(), b[:, 0].min()), min(a[:, 0].max(), b[:, 0].max()), 200)
        here, there = (np.stack([np.interp(t, table[:, 0], table[:, k]) for k in (1, 2, 3)]) for table in (a, b))
        together = (np.hypot(*(here - there)[:2]) < SAME_M) & (here[2] == there[2])
        if t[-1] > t[0] and np.ptp(here[:2]) > 1.0 and together.mean() > ALWAYS:
            raise MrpSumoError(f"{log.source}: '{one}' and '{other}' are at the same places all the time: one vehicle of two names")


def require_here(log: MotionLog, map_: "Map", *, on_grid: bool = False) -> None:
    """Refuse a log of which vehicles are elsewhere than the map is, or half of the poses off its lanes. Raises MrpSumoError.

    Who drives `on_grid` is noted where the log's vehicles keep to lanes.
    """
    if log.is_commanded:
        raise MrpSumoError(
            f"{log.source}: found commanded speeds alone, expected poses: they do not say where on '{map_.name}' vehicles were"
        )
    poses = {name: np.array(rows[:: max(1, len(rows) // 500)])[:, 1:3] for name, rows in log.poses.items() if len(rows) >= SHORTEST}
    away_m = _away_from_lanes(log, map_, poses)
    share = {name: float((away > BESIDE_M).mean()) for name, away in away_m.items()}
    strangers = [name for name in share if share[name] > ELSEWHERE]
    if strangers:
        low, high = (end(np.concatenate([poses[name] for name in strangers]), 0) for end in (np.min, np.max))
        whose = "the poses" if len(strangers) == len(poses) else f"the poses of {listed(strangers, NAMED)}"
        raise MrpSumoError(
            f"{log.source}: {np.mean([share[name] for name in strangers]):.0%} of {whose} are more than {BESIDE_M:g} m from any lane of "
            f"'{map_.name}' (x {low[0]:.1f} to {high[0]:.1f}, y {low[1]:.1f} to {high[1]:.1f}): another site, another frame, or other "
            "units than metres"
        )
    usual_m, most_m = np.quantile(np.concatenate([*away_m.values(), [0.0]]), (0.5, 0.95)).tolist()
    if usual_m > BESIDE_LANES_M:
        raise MrpSumoError(
            f"{log.source}: half of the poses are more than {usual_m:.1f} m from any lane of '{map_.name}', "
            f"expected {BESIDE_LANES_M:g} m or less: another site, or another frame"
        )
    if on_grid and most_m < BETWEEN_M / 2:
        log.notes.append(
            f"vehicles keep to the lanes of '{map_.name}', and the scenario has them on a grid, whose ways are others: "
            "`discretisation: {kind: roadmap}` is nearer to them"
        )


def _away_from_lanes(log: MotionLog, map_: "Map", poses: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """[N] how far poses [N, 2] of vehicles are from the nearest lane of a map."""
    from scipy.spatial import cKDTree

    nav = map_.nav
    places = nav.xy if log.is_laid_out or not map_.level_shift_m else nav.xy - shifts_of(nav.level_names, map_.level_shift_m)[nav.level]
    begin, end = places[nav.tail], places[nav.head]
    count = 1 + np.ceil(np.hypot(*(end - begin).T) / BETWEEN_M).astype(np.int64)
    lane = np.repeat(np.arange(len(count)), count)
    share = ((np.arange(len(lane)) - (np.cumsum(count) - count)[lane]) / count[lane])[:, None]
    tree = cKDTree(np.concatenate((begin[lane] * (1 - share) + end[lane] * share, places)))
    return {name: tree.query(xy)[0] for name, xy in poses.items()}


def levels_on(log: MotionLog, map_: "Map") -> Mapping[float, int]:
    """Levels of a map by the numbers that poses of a log have; a log that names none of them is on the first."""
    names = list(map_.nav.level_names)
    return {number: names.index(name) if name in names else 0 for number, name in log.levels.items()}


def shift_on(log: MotionLog, map_: "Map") -> FloatArray:
    """[L, 2] what is added to poses of each level of a map, m, to lay levels out as the map does."""
    shift = shifts_of(map_.nav.level_names, map_.level_shift_m)
    return np.zeros_like(shift) if log.is_laid_out else shift
