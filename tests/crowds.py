"""Rooms with people and robots in them."""

import numpy as np

from mrp_sumo.crowd import _floor, _walk
from mrp_sumo.crowd.crowd import Crowd
from mrp_sumo.crowd.floor import Floor
from mrp_sumo.crowd.model import People
from mrp_sumo.crowd.state import BODY_M, CELL_M


def floor_between(walls, width_m, height_m):
    """A floor with its lower left corner at 0, 0, between walls."""
    width, height = (round(size / CELL_M) for size in (width_m, height_m))
    walls = np.array(walls, np.float64)
    first, near, away_m = _floor.walls_near(walls, 0.0, 0.0, CELL_M, width, height, 1.2)
    return Floor((0.0, 0.0), width, height, walls, first, near, away_m, away_m >= BODY_M)


def room(width_m, height_m, *inner):
    """The walls of a room, and more of them."""
    w, h = width_m, height_m
    return floor_between([(0, 0, w, 0), (w, 0, w, h), (w, h, 0, h), (0, h, 0, 0), *inner], w, h)


def crowd_on(floor, places, starts, speed_mps=1.34, robots=()):
    """People with a speed, each at a start on its way from the first of its places to the second; robots as (x, y, length, width)."""
    cells = [floor.place_at(np.array(xy)) for xy in places]
    half = np.array([(length / 2, width / 2) for _, _, length, width in robots]).reshape(-1, 2)
    crowd = Crowd(People(floor, np.array(cells), count=len(starts)), *np.ascontiguousarray(half.T))
    for r, (x, y, _, _) in enumerate(robots):
        crowd.robots.x_m[r], crowd.robots.y_m[r], crowd.robots.yaw_rad[r], crowd.robots.along_mps[r] = x, y, 0.0, 0.0
    for xy, trip in starts:
        crowd._add(np.array(xy, np.float64), trip)
    crowd.walkers.wish_mps[: crowd.count] = speed_mps
    return crowd


def paths(crowd, seconds, dt=0.1):
    """[T, N, 2] where people are, until one has arrived."""
    result = []
    for k in range(round(seconds / dt)):
        _walk.walk(k * dt, dt, crowd.count, crowd.walkers, crowd.ground, crowd.robots, crowd._ways)
        result.append(np.stack([crowd.walkers.x_m[: crowd.count], crowd.walkers.y_m[: crowd.count]], 1))
        if crowd.walkers.is_there[: crowd.count].any():
            break
    return np.array(result)
