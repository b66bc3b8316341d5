"""ROS occupancy maps: the YAML and image that `map_server` reads (Nav2, nav2_map_server/src/map_io.cpp).

A robot may stand at a cell's centre when a disc of its radius touches nothing occupied or unknown there,
and drive to a neighbour when that holds all the way. Refuses turned origins, missing or huge images,
mode `raw`, and maps without any place to stand.
"""

import math
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.graph import BoolArray, FloatArray, PlanGraph
from mrp_sumo.errors import MapError, first_line, sentence
from mrp_sumo.files.reading import is_number, require_regular
from mrp_sumo.maps.costmap import Costmap
from mrp_sumo.maps.grid import grid_graph
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.readers.reader import MapFile, Selection, grid_map, map_name, refuse_choice
from mrp_sumo.maps.roadmap import check_cell
from mrp_sumo.maps.yaml_text import MAX_BYTES, Text

MAX_PIXELS = 50_000_000
MAX_CELLS = 2_000_000
MAX_RESOLUTION_M = 5.0  # maps of sites have 0.02 to 0.1
FARTHEST = 1e12  # number that is read
MODES = ("trinary", "scale")


class RosMap:
    """ROS occupancy maps."""

    name = "ROS map_server YAML"
    suffixes = (".yaml",)

    def detects(self, file: MapFile) -> bool:
        """An image and its resolution."""
        return isinstance(file.document, Mapping) and "image" in file.document and "resolution" in file.document

    def files(self, file: MapFile) -> tuple[Path, ...]:
        """Itself, and the image."""
        return file.path, image_of(file.document, file.source)

    def read(self, file: MapFile, selection: Selection) -> Map:
        """A grid over the image, where a robot of the selection's radius has room."""
        document, source = file.document, file.source
        refuse_choice(source, selection)
        resolution_m = _number(document, "resolution", source, None)
        if not 1e-4 <= resolution_m <= MAX_RESOLUTION_M:
            expected = f"metres a pixel, above 0 and at most {MAX_RESOLUTION_M:g}"
            raise source.fault(f"resolution is {resolution_m:g} m, expected {expected}", "resolution")
        origin = document.get("origin", [0, 0, 0])
        if not isinstance(origin, list) or not 2 <= len(origin) <= 3 or not all(is_number(value, FARTHEST) for value in origin):
            raise source.fault(f"origin is {str(origin)[:40]}, expected [x, y, yaw]", "origin")
        if len(origin) == 3 and abs(origin[2]) > 1e-6:
            raise source.fault(f"origin has a yaw of {origin[2]:g}: turn the image instead", "origin")
        floor = Costmap((float(origin[0]), float(origin[1])), resolution_m, ~_clear_pixels(document, source))
        return grid_map(source, *floor_grid(source, floor, map_name(file.path), selection.cell_m, selection.robot_radius_m))


def floor_grid(
    source: Text, floor: Costmap, name: str, cell_m: float, robot_radius_m: float, only: BoolArray | None = None
) -> tuple[PlanGraph, BoolArray]:
    """The grid of cells of `cell_m` where a robot has room on a floor, and those cells [H, W]; with `only`, none but these [H, W]."""
    check_cell(cell_m)
    clear, resolution_m = ~floor.occupied, floor.resolution_m
    reach = _distance_px(clear) * resolution_m - resolution_m / 2  # [h, w] m to the nearest edge that is not clear
    height, width = (max(int(n * resolution_m / cell_m + 1e-9), 0) for n in clear.shape)
    if not width or not height:
        raise source.fault(f"the map is smaller than a cell of {cell_m:g} m")
    if width * height > MAX_CELLS:
        raise source.fault(f"cells of {cell_m:g} m would make a grid of {width} x {height}; more than {MAX_CELLS:.0e} are not made")
    per_cell = cell_m / resolution_m
    rows, columns = ((np.arange(n) + 0.5) * per_cell for n in (height, width))
    free = _reach_at(reach, rows, columns) >= robot_radius_m
    if only is not None:
        free &= only
    right, up = free[:, :-1] & free[:, 1:], free[:-1] & free[1:]
    for part in np.linspace(0, per_cell, max(math.ceil(per_cell), 1) + 1)[1:-1]:
        right &= _reach_at(reach, rows, columns[:-1] + part) >= robot_radius_m
        up &= _reach_at(reach, rows[:-1] + part, columns) >= robot_radius_m
    if not free.any():
        raise source.fault(f"no place where a robot of radius {robot_radius_m:g} m can stand")
    graph = grid_graph(free, cell_m, floor.origin_m, name=name, source=str(source.path), passages=(right, up))
    if not graph.num_lanes:
        raise source.fault(f"no two cells of {cell_m:g} m that a robot of radius {robot_radius_m:g} m can drive between")
    return graph, free


def image_of(document: Mapping[str, Any], source: Text) -> Path:
    """The image of an occupancy map, beside its YAML. Raises MapError where there is none."""
    name = document["image"]
    if not isinstance(name, str) or not name or "\0" in name:
        raise source.fault(f"image is '{name}', expected the name of a PGM or PNG file", "image")
    path = source.path.parent / name
    if not os.path.isfile(path):  # noqa: PTH113  False for names that no system takes, too
        raise source.fault(f"image '{name}' is not there", "image")
    return path


def _clear_pixels(document: Mapping[str, Any], source: Text) -> BoolArray:
    """[h, w] pixels that are surely free; row 0 is the lowest."""
    mode = document.get("mode", "trinary")
    if mode not in MODES:
        raise source.fault(f"mode is '{mode}', expected {' or '.join(MODES)}", "mode")
    free_below = _number(document, "free_thresh", source, 0.25)
    pixels = picture(image_of(document, source), document["image"], lambda why: source.fault(why, "image"))
    with_alpha = pixels.ndim == 3
    shade = pixels[..., 0] if with_alpha else pixels
    occupied = shade / 255 if document.get("negate") in (1, True) else (255 - shade) / 255
    clear = occupied < free_below
    if with_alpha:
        clear &= pixels[..., 1] == 255  # see-through is unknown
    return clear[::-1]


def picture(path: Path, name: str, fault: Callable[[str], MapError], on_white: bool = False) -> np.ndarray:
    """Shades [h, w] of 0 to 255, or [h, w, 2] with how opaque each pixel is where the picture says so, unless it is laid `on_white`.

    The name is for messages; `fault` makes the error to raise of what is wrong.
    """
    from PIL import Image

    require_regular(path, MAX_BYTES, MapError)
    try:
        with Image.open(path) as image:
            if image.width * image.height > MAX_PIXELS:
                at_most = f"at most {MAX_PIXELS // 10**6} million are read"
                raise fault(f"image '{name}' has {image.width} x {image.height} pixels, too many: {at_most}")
            if on_white and ("A" in image.getbands() or "transparency" in image.info):
                opaque = image.convert("RGBA")
                return np.asarray(Image.alpha_composite(Image.new("RGBA", image.size, "white"), opaque).convert("L"))
            return np.asarray(image.convert("LA" if "A" in image.getbands() else "L"))
    except MapError:
        raise
    except Exception as error:  # Pillow's decoders raise anything on damaged files
        why = sentence(error) if isinstance(error, OSError) and error.errno is not None else first_line(error)  # Pillow's have no number
        raise fault(f"image '{name}' cannot be read: {why}") from None


def _distance_px(clear: BoolArray) -> FloatArray:
    """[h, w] pixels to the nearest centre that is not clear; the map's edge is not."""
    from scipy.ndimage import distance_transform_edt

    away_px: FloatArray = distance_transform_edt(np.pad(clear, 1))
    return away_px[1:-1, 1:-1]


def _reach_at(reach: FloatArray, rows: NDArray[np.floating], columns: NDArray[np.floating]) -> FloatArray:
    at: FloatArray = reach[np.minimum(rows.astype(int), reach.shape[0] - 1)][:, np.minimum(columns.astype(int), reach.shape[1] - 1)]
    return at


def _number(document: Mapping[str, Any], key: str, source: Text, default: float | None) -> float:
    value = document.get(key, default)
    if not is_number(value, FARTHEST):
        raise source.fault(f"{key} is {str(value)[:40]}, expected a number", key)
    return float(value)
