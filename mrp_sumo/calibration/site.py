"""A log on a map: whether its vehicles are there at all, and which vertices they are at."""

from collections.abc import Mapping

import numpy as np
from scipy.spatial import cKDTree

from mrp_sumo.calibration.log import MotionLog
from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.maps.levels import shifts_of
from mrp_sumo.maps.map import Map

BESIDE_M, ELSEWHERE = 10.0, 0.2  # how far from a map's lanes poses may be, and which share of them may be farther


def require_here(log: MotionLog, map_: Map) -> None:
    """Refuse a log whose vehicles are elsewhere than the map is. Raises MrpSumoError."""
    nav = map_.nav
    places = nav.xy if log.is_laid_out or not map_.level_shift_m else nav.xy - shifts_of(nav.level_names, map_.level_shift_m)[nav.level]
    ends = np.concatenate([places[nav.tail] * (1 - share) + places[nav.head] * share for share in np.linspace(0, 1, 9)] + [places])
    poses = np.array([row[1:3] for rows in log.poses.values() for row in rows[:: max(1, len(rows) // 500)]])
    away = cKDTree(ends).query(poses)[0]
    if (away > BESIDE_M).mean() > ELSEWHERE:
        low, high = poses.min(0), poses.max(0)
        raise MrpSumoError(
            f"{log.source}: {(away > BESIDE_M).mean():.0%} of the poses are more than {BESIDE_M:g} m from any lane of '{map_.name}' "
            f"(x {low[0]:.1f} to {high[0]:.1f}, y {low[1]:.1f} to {high[1]:.1f}): another site, another frame, or other units than metres"
        )


def levels_on(log: MotionLog, map_: Map) -> Mapping[float, int]:
    """Levels of a map by the numbers that poses of a log have; a log that names none of them is on the first."""
    names = list(map_.nav.level_names)
    return {number: names.index(name) if name in names else 0 for number, name in log.levels.items()}


def shift_on(log: MotionLog, map_: Map) -> FloatArray:
    """[L, 2] what is added to poses of each level of a map, m, to lay levels out as the map does."""
    shift = shifts_of(map_.nav.level_names, map_.level_shift_m)
    return np.zeros_like(shift) if log.is_laid_out else shift


def assigned_places(xy: FloatArray, level: IntArray, kind: IntArray, free: list[IntArray], map_: Map, apart_m: float) -> IntArray:
    """[R] the vertex of the map nearest to each robot, such that no two are too near to each other; -1: there is none.

    Parameters
    ----------
    xy, level, kind
        [R, 2], [R], [R] of the robots, on the plane on which levels are laid out.
    free
        By kind, vertices that robots may stand at.
    apart_m
        Least distance of two robots.
    """
    nav, taken = map_.nav, np.full(len(xy), -1)
    away = [np.hypot(*(nav.xy[free[k]] - place).T) + 1e6 * (nav.level[free[k]] != on) for place, on, k in zip(xy, level, kind.tolist())]
    for r in sorted(range(len(xy)), key=lambda r: (float(away[r].min(initial=np.inf)), r)):
        for v in free[kind[r]][np.argsort(away[r], kind="stable")].tolist():
            others = taken[taken >= 0]
            same = others[nav.level[others] == nav.level[v]]
            if v not in others and (np.hypot(*(nav.xy[same] - nav.xy[v]).T) >= apart_m).all():
                taken[r] = v
                break
    return taken
