"""Notes on a building's drawing beyond the findings of a check, none of which changes the import.

Lanes that lie on each other, go through a wall or through several doors; vertices almost at one place; doors and
lifts that cannot be distinguished. Kept apart from the findings, which are a fixed list that others compare with.
"""

from collections.abc import Iterator

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.near import pairs_within
from mrp_sumo.errors import nearest
from mrp_sumo.maps.building import Building, Level
from mrp_sumo.maps.check import strokes_crossed

LEAST_ANGLE_RAD = np.radians(3)  # lanes that leave a vertex at less lie on each other
SAME_PLACE_M = 0.05  # vertices closer than this were probably meant to be one
MOST_NAMED = 3  # walls that one lane goes through
DOORWAY_M = 0.3  # a lane may cross a wall this close to a door: walls are often drawn through


def oddities(building: Building) -> tuple[str, ...]:
    """The notes, one line each; numbers are those of the file."""
    return (*(note for level in building.levels.values() for note in _of_level(level)), *_of_lifts(building))


def _of_level(level: Level) -> Iterator[str]:
    where = f"level {level.name}"
    lanes = np.array([(lane.start, lane.end) for lane in level.lanes], np.int64).reshape(-1, 2)
    graph = np.array([lane.graph for lane in level.lanes], np.int64)
    for g in np.unique(graph).tolist():
        which = np.flatnonzero(graph == g)
        for i, j in _lying_on_each_other(level.xy, lanes[which]):
            yield f"{where}: lanes {which[i]} and {which[j]} leave a vertex less than 3 degrees apart"
        for a, b, apart in _almost_one(level.xy, lanes[which]):
            yield f"{where}: vertices {a} and {b} are {apart:.3f} m apart and not connected; --snap joins them"
    doors = np.array([(door.start, door.end) for door in level.doors], np.int64).reshape(-1, 2)
    lane, door, _ = strokes_crossed(level.xy, lanes, doors)
    for i in np.flatnonzero(np.bincount(lane, minlength=len(lanes)) > 1).tolist():
        names = [level.doors[d].name for d in door[lane == i].tolist()]
        yield f"{where}: lane {i} goes through doors {', '.join(names)}; the nav graph knows the last one in the file"
    middle = level.xy[doors].mean(axis=1)
    through: dict[int, list[int]] = {}
    for i, w, place in zip(*strokes_crossed(level.xy, lanes, level.walls)):
        reach = np.hypot(*(level.xy[doors[:, 0]] - level.xy[doors[:, 1]]).T) / 2 + DOORWAY_M
        if not (np.hypot(*(middle - place).T) <= reach).any():
            through.setdefault(int(i), []).append(int(w))
    for i, walls in through.items():
        more = f" and {len(walls) - MOST_NAMED} more" if len(walls) > MOST_NAMED else ""
        yield f"{where}: lane {i} goes through wall{'s' * (len(walls) > 1)} {', '.join(map(str, walls[:MOST_NAMED]))}{more}"
    idle = [level.doors[d].name for d in range(len(doors)) if len(lanes) and d not in set(door.tolist())]
    if idle:
        yield f"{where}: no lane leads through {len(idle)} of {len(doors)} doors, such as '{idle[0]}'"
    names = [door.name for door in level.doors]
    if unnamed := sum(name in ("", "null", "None") for name in names):
        yield f"{where}: {unnamed} of {len(names)} doors without a name"
    for name in sorted({name for name in names if names.count(name) > 1} - {"", "null", "None"}):
        yield f"{where}: {names.count(name)} doors are named '{name}'; the nav graph knows the last one"


def _of_lifts(building: Building) -> Iterator[str]:
    lifts = [lift for lift in building.lifts.values() if lift.level_doors]
    for lift in lifts:
        for name in lift.level_doors:
            level = building.levels.get(name)
            if level is None:
                yield f"lift '{lift.name}' stops at '{name}', which is no level{nearest(name, building.levels)}"
            elif level.lanes and not lift.holds(level.world_xy[level.lane_vertices], level.elevation_m).any():
                yield f"lift '{lift.name}' stops at level {name}, where no vertex of a lane is in it: robots cannot use it there"
    for k, one in enumerate(lifts):
        for other in lifts[k + 1 :]:
            if np.hypot(one.x_m - other.x_m, one.y_m - other.y_m) < min(one.width_m, one.depth_m, other.width_m, other.depth_m) / 2:
                yield f"lifts '{one.name}' and '{other.name}' are at one place; '{one.name}' serves its vertices"


def _lying_on_each_other(xy: FloatArray, lanes: IntArray) -> list[tuple[int, int]]:
    """Pairs of lanes that leave a common vertex in almost the same direction; repeated lanes are another matter."""
    start, end = np.concatenate([lanes, lanes[:, ::-1]]).T
    lane = np.tile(np.arange(len(lanes)), 2)
    along = xy[end] - xy[start]
    long = np.hypot(*along.T) > 1e-3
    start, end, lane, along = start[long], end[long], lane[long], along[long]
    bearing = np.arctan2(along[:, 1], along[:, 0])
    order = np.lexsort((bearing, start))
    pairs = set()
    for star in np.split(order, np.flatnonzero(np.diff(start[order])) + 1):  # the lanes at one vertex, by bearing
        for a, b in zip(star.tolist(), np.roll(star, -1).tolist()):
            turn = abs((bearing[b] - bearing[a] + np.pi) % (2 * np.pi) - np.pi)
            if lane[a] != lane[b] and end[a] != end[b] and turn < LEAST_ANGLE_RAD:
                pairs.add((int(min(lane[a], lane[b])), int(max(lane[a], lane[b]))))
    return sorted(pairs)


def _almost_one(xy: FloatArray, lanes: IntArray) -> list[tuple[int, int, float]]:
    on_lanes = np.unique(lanes)
    if len(on_lanes) < 2:
        return []
    joined = {tuple(sorted(pair)) for pair in lanes.tolist()}
    close = np.sort(on_lanes[pairs_within(xy[on_lanes], SAME_PLACE_M)], axis=1)
    return [(a, b, float(np.hypot(*(xy[a] - xy[b])))) for a, b in sorted(close.tolist()) if (a, b) not in joined]
