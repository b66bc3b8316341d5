"""Crowds of people as the program has them walk: in a closed ring, before a bottleneck, and round a vehicle that somebody recorded."""

from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.crowd import _floor, _walk
from mrp_sumo.crowd.crowd import Crowd
from mrp_sumo.crowd.floor import Floor
from mrp_sumo.crowd.model import People
from mrp_sumo.crowd.options import Group
from mrp_sumo.crowd.state import BODY_M, CELL_M

INNER_M, OUTER_M, CORNERS = 6.0, 9.0, 72  # of the ring
DT_S = 0.1


def floor_between(walls: FloatArray, width_m: float, height_m: float) -> Floor:
    """A floor with its lower left corner at 0, 0, between walls [W, 4]."""
    width, height = (round(size / CELL_M) for size in (width_m, height_m))
    first, near, away_m = _floor.walls_near(walls, 0.0, 0.0, CELL_M, width, height, 1.2)
    return Floor((0.0, 0.0), width, height, walls, first, near, away_m, away_m >= BODY_M)


def ring_speed_mps(density: float, group: Group, *, two_way: bool = False, seed: int = 0, lasts_s: float = 40.0) -> float:
    """Mean speed of a crowd of so many people a square metre that walks one way, or half of it the other, in a ring of 3 m width.

    In the second half of the time: lanes form in the first.
    """
    turn = np.arange(CORNERS + 1) * 2 * np.pi / CORNERS
    rings = [np.column_stack([10 + r * np.cos(turn), 10 + r * np.sin(turn)]) for r in (INNER_M, OUTER_M)]
    floor = floor_between(np.array([(*a, *b) for ring in rings for a, b in pairwise(ring)]), 20, 20)
    rng = np.random.default_rng(seed)
    count = round(density * np.pi * (OUTER_M**2 - INNER_M**2))
    radius = np.sqrt(rng.uniform((INNER_M + 0.3) ** 2, (OUTER_M - 0.3) ** 2, count))
    at = rng.uniform(0, 2 * np.pi, count)
    places = np.array([floor.place_at(np.array(xy)) for xy in ((17.5, 10.0), (2.5, 10.0))])
    crowd = Crowd(People(floor, places, count=count, groups=(group,), seed=seed), np.zeros(0), np.zeros(0))
    for k, (r, a) in enumerate(zip(radius.tolist(), at.tolist())):
        crowd._add(np.array([10 + r * np.cos(a), 10 + r * np.sin(a)]), (0, k % 2 if two_way else 0))
    x, y = floor.centre_of(np.arange(floor.width * floor.height)).T - 10
    for k, ways in enumerate(crowd._ways):  # the second ones against the first
        ways[:] = np.rint((np.arctan2(y, x) + (k + 0.5) * np.pi) * (_floor.NUM_ANGLES / (2 * np.pi))).astype(np.int64) % _floor.NUM_ANGLES
    direction = np.where(np.arange(count) % 2 & two_way, -1, 1)
    speeds, who = [], crowd.walkers
    for k in range(round(lasts_s / DT_S)):
        who.stuck_s[:] = 0.0  # nobody turns back
        before = np.arctan2(who.y_m - 10, who.x_m - 10)
        _walk.walk(k * DT_S, DT_S, count, who, crowd.ground, crowd.robots, crowd._ways)
        turned = (np.arctan2(who.y_m - 10, who.x_m - 10) - before + np.pi) % (2 * np.pi) - np.pi
        speeds.append((direction * turned * np.hypot(who.x_m - 10, who.y_m - 10)).mean() / DT_S)
    return float(np.mean(speeds[len(speeds) // 2 :]))


def bottleneck_flow_per_s(corridor_m: float, exit_m: float, group: Group, seed: int = 0, length_m: float = 10.0) -> float | None:
    """People a second through the exit of a corridor, from the second quarter of those who come to the third; None where nobody does.

    They stand before it at 3 a square metre, and all want to go far beyond.
    """
    wide, beyond = 6.0, 6.0
    low, high = (wide - corridor_m) / 2, (wide + corridor_m) / 2
    left, right = (wide - exit_m) / 2, (wide + exit_m) / 2
    walls = [(0, low, length_m, low), (0, high, length_m, high), (0, low, 0, high)]
    walls += [(length_m, low, length_m, left), (length_m, right, length_m, high)]
    walls += [(length_m, 0, length_m, low), (length_m, high, length_m, wide)]
    end = length_m + beyond
    walls += [(length_m, 0, end, 0), (length_m, wide, end, wide), (end, 0, end, wide)]
    floor = floor_between(np.array(walls, np.float64), end, wide)
    places = np.array([floor.place_at(np.array(xy)) for xy in ((1.0, wide / 2), (end - 1.0, wide / 2))])
    if (floor.region[places[0]] != floor.region[places[1]]) or places.min() < 0:
        return None
    rng, count = np.random.default_rng(seed), round(3.0 * corridor_m * (length_m - 1.0))
    crowd = Crowd(People(floor, places, count=count, groups=(group,), seed=seed), np.zeros(0), np.zeros(0))
    for _ in range(count):
        crowd._add(np.array([rng.uniform(0.4, length_m - 0.6), rng.uniform(low + 0.3, high - 0.3)]), (0, 1))
    passed_s: list[float] = []
    for k in range(round(240 / DT_S)):
        before = crowd.walkers.x_m[: crowd.count] > length_m + 0.5
        crowd.walkers.stuck_s[:] = 0.0
        _walk.walk(k * DT_S, DT_S, crowd.count, crowd.walkers, crowd.ground, crowd.robots, crowd._ways)
        after = crowd.walkers.x_m[: crowd.count] > length_m + 0.5
        passed_s += [k * DT_S] * int((after & ~before).sum())
        crowd._leave()
        if not crowd.count:
            break
    return flow_per_s(passed_s, count)


def flow_per_s(passed_s: list[float], count: int) -> float | None:
    """People a second between the first quarter of so many and the third."""
    first, last = count // 4, 3 * count // 4
    return (last - first) / (passed_s[last] - passed_s[first]) if len(passed_s) > last and passed_s[last] > passed_s[first] else None


def gaps_m(xy: FloatArray, vehicle: FloatArray, length_m: float, width_m: float) -> FloatArray:
    """[N] distances of points [N, 2] from the body of a vehicle, whose poses are x, y and yaw [N, 3]."""
    dx, dy = (xy - vehicle[:, :2]).T
    cos, sin = np.cos(vehicle[:, 2]), np.sin(vehicle[:, 2])
    ahead, aside = np.abs(cos * dx + sin * dy) - length_m / 2, np.abs(cos * dy - sin * dx) - width_m / 2
    return np.hypot(np.maximum(ahead, 0), np.maximum(aside, 0))


def least_gaps_m(people: Mapping[int, FloatArray], vehicle: FloatArray, size_m: tuple[float, float], frame_s: float) -> dict[int, float]:
    """Least distance of each person's centre from a vehicle that drives as it was recorded, as the program has people walk.

    Parameters
    ----------
    people
        By number, [T, 3] frames and places of each person, who walks from the first one to the last one at its own median speed.
    vehicle
        [V, 5] frames, x, y, yaw and speed.
    size_m
        Length and width of the vehicle.
    """
    every = np.concatenate([*(track[:, 1:] for track in people.values()), vehicle[:, 1:3]])
    corner = every.min(0) - 5.0
    width_m, height_m = (every.max(0) + 5.0 - corner).tolist()
    box = [(0, 0, width_m, 0), (width_m, 0, width_m, height_m), (width_m, height_m, 0, height_m), (0, height_m, 0, 0)]
    floor = floor_between(np.array(box, np.float64), width_m, height_m)
    ends = [xy for track in people.values() for xy in (track[0, 1:] - corner, track[-1, 1:] - corner)]
    places = np.array([floor.place_at(xy) for xy in ends])
    crowd = Crowd(People(floor, places, count=len(people)), np.array([size_m[0] / 2]), np.array([size_m[1] / 2]))
    waiting = sorted(people, key=lambda one: people[one][0, 0])
    number, least = dict[int, int](), dict[int, float]()
    for k in range(1, len(vehicle), 3):
        frame, x, y, yaw, speed = vehicle[k]
        while waiting and people[waiting[0]][0, 0] <= frame:
            one = waiting.pop(0)
            row, track = list(people).index(one), people[one]
            number[one] = crowd.count
            crowd._add(track[0, 1:] - corner, (2 * row, 2 * row + 1))
            steps = np.hypot(*np.diff(track[:, 1:], axis=0).T) / (np.diff(track[:, 0]) * frame_s)
            crowd.walkers.wish_mps[number[one]] = max(float(np.median(steps)), 0.3)
        crowd.robots.x_m[0], crowd.robots.y_m[0] = x - corner[0], y - corner[1]
        crowd.robots.yaw_rad[0], crowd.robots.along_mps[0] = yaw, speed
        _walk.walk(frame * frame_s, 3 * frame_s, crowd.count, crowd.walkers, crowd.ground, crowd.robots, crowd._ways)
        for one, p in number.items():
            if people[one][0, 0] <= frame <= people[one][-1, 0]:
                xy = np.array([[crowd.walkers.x_m[p], crowd.walkers.y_m[p]]]) + corner
                gap = float(gaps_m(xy, vehicle[k : k + 1, 1:4], *size_m)[0])
                least[one] = min(least.get(one, np.inf), gap)
    return least
