"""Plans of a floor: drawings in DXF and SVG, pictures and pages of PDF files. What is drawn is wall; robots drive on a grid between.

Of a picture everything darker than three quarters of white is wall. What lies outside is left out where the walls enclose a floor: the
part that reaches the plan's edge, if what does not is at least a tenth of the plan. Of pieces that no robot can drive between, the
largest stays. Both are reported, with their areas. Refuses pictures without a scale, and plans larger than 50 million pixels.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from mrp_sumo.core.graph import BoolArray, FloatArray
from mrp_sumo.maps.costmap import Costmap
from mrp_sumo.maps.finding import Notes
from mrp_sumo.maps.grid import vertex_of_cell
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.readers.draft import LEVEL, Draft, building_of_walls
from mrp_sumo.maps.readers.reader import MapFile, Selection, map_name, plan_kind, refuse_choice
from mrp_sumo.maps.readers.ros_map import MAX_PIXELS, floor_grid, picture
from mrp_sumo.maps.yaml_text import read_text

if TYPE_CHECKING:
    from mrp_sumo.maps.readers.dxf import DxfContent
    from mrp_sumo.maps.readers.svg import SvgContent

WALL_BELOW = 0.75  # of white
RESOLUTION_M = 0.05  # of a drawing's pixels, or as coarse as it needs
COARSEST_M = 0.2
SMALLEST_M = 2.0  # of a drawing: a smaller one is in another unit
ROUNDING_OF_UNITS = 1e-6  # pixels
ENCLOSED = 0.1  # share of the plan
ROUNDING_PX = 0.25  # pixels' centres are less far from a wall than a robot may be
STRAIGHT_PX = 1.0  # a slanted wall is stairs of pixels, which lie as far off a straight line
MAX_TRACED = 10_000  # strokes of a picture's outlines


class DxfPlan:
    """Drawings in DXF."""

    name = "plan of a floor"
    suffixes = (".dxf",)

    def detects(self, file: MapFile) -> bool:
        """Its first section, or the mark of a binary one."""
        return plan_kind(file.head) == "dxf"

    def read(self, file: MapFile, selection: Selection) -> Map:
        """The strokes of the chosen layers as walls, and a grid between them."""
        from mrp_sumo.maps.readers.dxf import read_dxf

        refuse_choice(file.source, selection, "layers", "unit")
        drawing = read_dxf(file.path, selection.layers, selection.unit)
        return _drawing(file, selection, drawing.strokes, drawing, f"in {drawing.unit}: state another with mrp-sumo import --unit")


class SvgPlan:
    """Drawings in SVG."""

    name = "plan of a floor"
    suffixes = (".svg",)

    def detects(self, file: MapFile) -> bool:
        """Its root."""
        return plan_kind(file.head) == "svg"

    def read(self, file: MapFile, selection: Selection) -> Map:
        """The strokes of the chosen layers as walls, and a grid between them."""
        from mrp_sumo.maps.readers.svg import read_svg

        refuse_choice(file.source, selection, "layers", "meters_per_pixel")
        drawing = read_svg(read_text(file.path), selection.layers)
        scale_m = _scale_of(file, selection, np.ptp(drawing.strokes.reshape(-1, 2), axis=0), "an SVG drawing", "unit")
        return _drawing(file, selection, drawing.strokes * scale_m, drawing, f"at {scale_m:g} m a unit: state another --scale")


class PdfPlan:
    """Pages of PDF files."""

    name = "plan of a floor"
    suffixes = (".pdf",)

    def detects(self, file: MapFile) -> bool:
        """Its mark."""
        return plan_kind(file.head) == "pdf"

    def read(self, file: MapFile, selection: Selection) -> Map:
        """Dark pixels of a page as walls, and a grid between them."""
        from mrp_sumo.maps.readers.pdf import page_picture

        refuse_choice(file.source, selection, "meters_per_pixel", "page")
        pixels = page_picture(file.path, selection.page or 1)
        scale_m = _scale_of(file, selection, np.array(pixels.shape[1::-1]), "a page of a PDF, 150 pixels an inch,", "pixel")
        return _picture(file, selection, pixels.mean(axis=2), scale_m)


class PicturePlan:
    """Pictures."""

    name = "plan of a floor"
    suffixes = (".png", ".jpg")

    def detects(self, file: MapFile) -> bool:
        """The marks of pictures."""
        return plan_kind(file.head) == "picture"

    def read(self, file: MapFile, selection: Selection) -> Map:
        """Dark pixels as walls, and a grid between them."""
        refuse_choice(file.source, selection, "meters_per_pixel")
        if selection.meters_per_pixel is None:
            raise file.source.fault(
                "a picture has no scale: state it with --scale, 0.05 where a door of 0.9 m is 18 pixels wide, or two places in pixels and "
                "the metres between them, 120,80:920,80=20; "
                "a map that a robot recorded is named by its YAML"
            )
        scale_m = _scale_of(file, selection, np.zeros(2), "a picture", "pixel")
        return _picture(file, selection, picture(file.path, file.path.name, file.source.fault, on_white=True), scale_m)


def _scale_of(file: MapFile, selection: Selection, size: FloatArray, what: str, unit: str) -> float:
    """Metres a unit of a plan, which does not say them; `size` in units, for the refusal."""
    scale_m = selection.meters_per_pixel
    if scale_m is None:
        raise file.source.fault(
            f"{what} has no scale: state it with --scale, metres a {unit}, or two places in {unit}s and the metres between them, "
            f"120,80:920,80=20; the plan is {size[0]:.0f} x {size[1]:.0f} {unit}s"
        )
    if not (math.isfinite(scale_m) and 1e-4 <= scale_m <= 100):
        raise file.source.fault(f"{scale_m:g} m a {unit}, expected a number above 0")
    return scale_m


def _picture(file: MapFile, selection: Selection, shade: np.ndarray, scale_m: float) -> Map:
    """The plan of shades [h, w], 0 to 255."""
    clear = (shade >= WALL_BELOW * 255)[::-1]
    notes, walls, pixels = Notes(), _traced(clear) * scale_m, 1
    while len(walls) > MAX_TRACED and (pixels + 1) * scale_m <= COARSEST_M:
        pixels += 1
        walls = _traced(_coarser(clear, pixels)) * pixels * scale_m
    if len(walls) > MAX_TRACED:
        notes.add("walls_not_traced", f"{len(walls)} strokes: the grid alone keeps robots off what is dark")
        walls = walls[:0]
    elif pixels > 1:
        notes.add("walls_traced_coarsely", f"outlines of what is dark are drawn up to {pixels * scale_m:.2g} m too far out")
    return _plan(file, selection, Costmap((0.0, 0.0), scale_m, ~clear), walls, notes)


def _drawing(file: MapFile, selection: Selection, strokes: FloatArray, content: "DxfContent | SvgContent", measure: str) -> Map:
    """The plan of strokes [N, 2, 2] m; `measure` says how they are measured, and what could be done about it."""
    low, high = strokes.min((0, 1)), strokes.max((0, 1))
    width, height = (high - low).tolist()
    resolution_m = max(RESOLUTION_M, math.sqrt(width * height / MAX_PIXELS) * 1.01)
    if resolution_m > COARSEST_M or max(width, height) < SMALLEST_M:
        layers = ", ".join(list(content.layers)[:8])
        raise file.source.fault(f"the drawing is {width:.4g} x {height:.4g} m {measure}, or choose --layers ({layers})")
    columns, rows = (math.ceil(side / resolution_m - ROUNDING_OF_UNITS) + 1 for side in (width, height))
    occupied = _rasterised(strokes, low, resolution_m, columns, rows)
    notes = Notes()
    shown = ", ".join(f"{layer or 'no layer'} ({count})" for layer, count in content.layers.items())
    left = f"; left out: {', '.join(content.left_out)}" if content.left_out else "; --layers chooses" if len(content.layers) > 1 else ""
    notes.add("walls_of_layers", f"{shown}; {measure.partition(':')[0].replace('in ', 'unit ')}{left}")
    return _plan(file, selection, Costmap((float(low[0]), float(low[1])), resolution_m, occupied), strokes, notes)


def _plan(file: MapFile, selection: Selection, floor: Costmap, walls: FloatArray, notes: Notes) -> Map:
    """The grid between walls [N, 2, 2], without what is outside and the smaller pieces."""
    pixel_m2 = floor.resolution_m**2
    outside = _outside(~floor.occupied)
    if outside.any():
        notes.add("outside_left_out", f"{np.count_nonzero(outside) * pixel_m2:.0f} m2 that the walls do not enclose")
        floor = replace(floor, occupied=floor.occupied | outside)
    radius_m = selection.robot_radius_m + ROUNDING_PX * floor.resolution_m
    nav, free = floor_grid(file.source, floor, map_name(file.path), selection.cell_m, radius_m)
    pieces = np.bincount(nav.component)
    if len(pieces) > 1:
        left_m2, all_m2 = ((n * nav.cell_m**2) for n in (pieces.sum() - pieces.max(), pieces.sum()))
        notes.add(
            "pieces_left_out",
            f"{len(pieces) - 1} piece{'s' * (len(pieces) > 2)}, {left_m2:.{0 if left_m2 >= 10 else 1}f} m2 of {all_m2:.0f}, which a robot "
            f"of radius {selection.robot_radius_m:g} m cannot reach: the inside of racks, or rooms whose doors are drawn shut",
        )
        inside = free & (nav.component == pieces.argmax())[vertex_of_cell(free)]
        floor = replace(floor, occupied=~_piece(floor, nav.xy[pieces.argmax() == nav.component][0]))
        nav, free = floor_grid(file.source, floor, map_name(file.path), selection.cell_m, radius_m, inside)
    draft = Draft(file.source, level_names=[LEVEL])
    building = building_of_walls(draft, {LEVEL: walls.tolist()}) if len(walls) else None
    return Map(name=nav.name, path=file.path, nav=nav, building=building, findings=notes.findings(), free=free, floor=floor)


def _outside(clear: BoolArray) -> BoolArray:
    """[h, w] what reaches the plan's edge, where enough does not."""
    from scipy.ndimage import label

    part, _ = label(clear)
    edge = np.unique(np.concatenate([part[0], part[-1], part[:, 0], part[:, -1]]))
    outside: BoolArray = np.isin(part, edge[edge > 0])
    inside = np.count_nonzero(clear & ~outside)
    return outside if inside >= ENCLOSED * clear.size else np.zeros_like(clear)


def _piece(floor: Costmap, xy: FloatArray) -> BoolArray:
    """[h, w] the pixels that are joined to a place."""
    from scipy.ndimage import label

    part, _ = label(~floor.occupied)
    column, row = ((xy - floor.origin_m) / floor.resolution_m).astype(int)
    piece: BoolArray = part == part[row, column]
    return piece


def _rasterised(strokes: FloatArray, low: FloatArray, resolution_m: float, width: int, height: int) -> BoolArray:
    """[h, w] pixels that strokes touch."""
    from PIL import Image, ImageDraw

    image = Image.new("1", (width, height), 0)
    draw = ImageDraw.Draw(image)
    for ends in ((strokes - low) / resolution_m + ROUNDING_OF_UNITS).astype(np.int64).reshape(-1, 4).tolist():
        draw.line(ends, fill=1)
    return np.array(image, np.bool_)


def _coarser(clear: BoolArray, pixels: int) -> BoolArray:
    """The plan in squares of so many pixels, clear where all of them are."""
    height, width = clear.shape
    padded = np.pad(clear, ((0, -height % pixels), (0, -width % pixels)), constant_values=True)
    squares: BoolArray = np.logical_and.reduce(padded.reshape(padded.shape[0] // pixels, pixels, -1, pixels), axis=(1, 3))
    return squares


def _traced(clear: BoolArray) -> FloatArray:
    """[N, 2, 2] pixels: the outlines of what is not clear, straight within a pixel; the plan's edge has none."""
    upright = _runs(clear[:, 1:] != clear[:, :-1], True)
    level = _runs((clear[1:] != clear[:-1]).T, False)
    lines = [_straightened(chain) for chain in _chains(np.concatenate([upright, level]))]
    return np.concatenate([np.zeros((0, 2, 2)), *(np.stack((line[:-1], line[1:]), axis=1) for line in lines)])


def _chains(strokes: FloatArray) -> Iterator[FloatArray]:
    """[K, 2] corners of strokes that follow each other, from end to end or around."""
    beside: dict[tuple[float, float], list[tuple[float, float]]] = {}
    for (ax, ay), (bx, by) in strokes.tolist():
        beside.setdefault((ax, ay), []).append((bx, by))
        beside.setdefault((bx, by), []).append((ax, ay))
    for start in sorted(beside, key=lambda corner: len(beside[corner]) % 2 == 0):  # ends first
        while beside[start]:
            chain = [start]
            while beside[chain[-1]]:
                corner = chain[-1]
                following = beside[corner].pop()
                beside[following].remove(corner)
                chain.append(following)
            yield np.array(chain)


def _straightened(chain: FloatArray) -> FloatArray:
    """[K, 2] those corners of a line that lie more than a pixel off the straight between others (Ramer 1972, Douglas and Peucker 1973)."""
    stays, spans = np.zeros(len(chain), np.bool_), [(0, len(chain) - 1)]
    stays[[0, -1]] = True
    while spans:
        first, last = spans.pop()
        if last - first < 2:
            continue
        along, off = chain[last] - chain[first], chain[first + 1 : last] - chain[first]
        long = float(np.hypot(*along))
        away = np.abs(off @ (-along[1], along[0])) / long if long else np.hypot(*off.T)
        farthest = int(away.argmax())
        if away[farthest] > STRAIGHT_PX:
            middle = first + 1 + farthest
            stays[middle] = True
            spans += [(first, middle), (middle, last)]
    line: FloatArray = chain[stays]
    return line[:2] if len(line) == 3 and (line[0] == line[2]).all() else line  # there and back


def _runs(sides: BoolArray, upright: bool) -> FloatArray:
    """Strokes for runs along the first axis of [n, m] sides, the k-th of which lie at k + 1."""
    padded = np.zeros((sides.shape[0] + 2, sides.shape[1]), np.int8)
    padded[1:-1] = sides
    step = np.diff(padded, axis=0).T  # a row of `step` is a line of sides
    at, begin = np.nonzero(step == 1)
    _, end = np.nonzero(step == -1)
    along = np.stack([begin, end], axis=1).astype(np.float64)
    across = np.repeat(at[:, None] + 1.0, 2, axis=1)
    return np.stack([across, along] if upright else [along, across], axis=2)
