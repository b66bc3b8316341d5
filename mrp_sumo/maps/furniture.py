"""Furniture: models of a building whose sizes a scenario knows. Their meshes, which building files only name, are not here.

A model is a rectangle around its place, its length along the model's x. Its four sides are walls to robots, audits and pictures.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.errors import MapError, nearest
from mrp_sumo.maps.building import Level
from mrp_sumo.maps.map import Map

CORNERS = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) / 2


def with_furniture(map_: Map, size_m: Mapping[str, tuple[float, float]]) -> Map:
    """The map with its models of these names as rectangles of a length and a width. Raises MapError for a name that no model has."""
    if not size_m:
        return map_
    building = map_.building
    known = {model.name for level in building.levels.values() for model in level.models} if building else set()
    for name in size_m:
        if name not in known:
            raise MapError(f"'{name}' is no model of '{map_.name}'{nearest(name, sorted(known))}")
    assert building is not None
    shift = {name: np.array(map_.level_shift_m.get(name, (0.0, 0.0))) - building.origin_m for name in building.levels}
    levels = {name: replace(level, furniture_xy=_sides(level, size_m) + shift[name]) for name, level in building.levels.items()}
    left = sum(model.name not in size_m for level in levels.values() for model in level.models)
    unused = [line for line in building.unused if not line.startswith("models: ")] + ([f"models: {left}"] if left else [])
    return replace(map_, building=replace(building, levels=levels, unused=tuple(unused)))


def _sides(level: Level, size_m: Mapping[str, tuple[float, float]]) -> FloatArray:
    """[F, 2, 2] m, in the frame of Open-RMF's nav graphs."""
    sides = [np.zeros((0, 2, 2))]
    for model in level.models:
        if model.name in size_m:
            c, s = np.cos(model.yaw_rad), np.sin(model.yaw_rad)
            corners = CORNERS * size_m[model.name] @ np.array([[c, s], [-s, c]]) + (model.x_m, model.y_m)
            sides.append(np.stack([corners, np.roll(corners, -1, axis=0)], axis=1))
    return np.concatenate(sides)
