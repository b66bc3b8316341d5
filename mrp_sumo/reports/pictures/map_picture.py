"""A picture of a map, PNG or SVG by the file's suffix: walls, lanes with direction, stations by kind, names, and rings around warnings.

One panel per level, all at one scale. Colours are those of Okabe and Ito, which people with any colour vision can tell apart; kinds
differ in shape as well. The same map gives the same bytes. Refuses other suffixes.
"""

import itertools
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import ListedColormap, to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Arc, Patch, Rectangle
from matplotlib.transforms import Affine2D

from mrp_sumo.core.graph import FloatArray, NavGraph, PlanGraph
from mrp_sumo.errors import MapError, count
from mrp_sumo.maps.building import Building, Level
from mrp_sumo.maps.check import FOUND_ON_GRAPHS
from mrp_sumo.maps.facts import num_drawn_edges, num_driven_components
from mrp_sumo.maps.map import Map
from mrp_sumo.reports.pictures.labels import place_labels
from mrp_sumo.reports.pictures.picture import Picture, require_suffix, round_length
from mrp_sumo.reports.pictures.view import furniture_and_walls

INK, MUTED, WALL, FLOOR, PAPER = "#1f2328", "#6b7280", "#3b4048", "#f4f1ea", "#ffffff"
BLUE, ORANGE, GREEN, VERMILION, SKY, PURPLE = "#0072B2", "#E69F00", "#009E73", "#D55E00", "#56B4E9", "#CC79A7"
COMPONENTS = (BLUE, ORANGE, GREEN, PURPLE, SKY, "#7f7f3f", "#8c564b")
DOOR, FURNITURE, BLOCKED = "#b5651d", "#8b8f97", "#c9ccd1"

NARROW_M = 4.0  # closed walls narrower than this are drawn as furniture
MANY = 5000  # vertices or lanes beyond which only stations of a kind are drawn, and no names


@dataclass(frozen=True)
class Symbol:
    """Look of one kind of station. The first kind whose test holds is a vertex's."""

    name: str
    options: tuple[str, ...]
    marker: str
    colour: str
    size_pt: float


KINDS = (
    Symbol("lift", ("lift",), "h", PURPLE, 8.5),
    Symbol("charger", ("is_charger",), "P", GREEN, 8.5),
    Symbol("dock", ("dock_name",), "^", VERMILION, 7.5),
    Symbol("pick-up or drop-off", ("pickup_dispenser", "dropoff_ingestor"), "D", SKY, 6.5),
    Symbol("parking", ("is_parking_spot",), "s", BLUE, 6.5),
    Symbol("holding point", ("is_holding_point",), "o", ORANGE, 6.5),
)
NAMED = Symbol("station", (), "o", INK, 5.0)
JUNCTION = Symbol("junction", (), "o", PAPER, 3.0)


@dataclass(frozen=True)
class Panel:
    """A level on the page: its part of the nav graph, and the rectangle that it fills, in m, with a margin."""

    name: str
    level: Level | None
    vertices: np.ndarray  # [N] of the nav graph
    lanes: np.ndarray  # [N]
    extent: FloatArray  # [2] of walls and lanes
    low: FloatArray  # [2]
    high: FloatArray  # [2]

    @property
    def size(self) -> FloatArray:
        return self.high - self.low


def draw_map(map_: Map, path: Path, *others: Path) -> Path:
    """Draw the map, PNG or SVG, into one file and others; returns the first. Raises MapError for another suffix.

    Walls, doors and lifts are drawn where there is a building, blocked cells where there is a grid.
    """
    for file in (path, *others):
        require_suffix(file, MapError)
    figure = map_picture(map_)
    for file in (*others, path):
        figure.write(file)
    return path


def map_picture(map_: Map, *, findings: bool = True) -> Picture:
    """The picture of a map; see `draw_map`."""
    nav = map_.nav
    panels = _panels(map_)
    figure, axes, inch_per_m = _page(panels)
    legend: dict[str, Artist] = {}
    colours = _component_colours(nav, legend)
    points_per_m = 72 * inch_per_m
    for ax, panel in zip(axes, panels):
        if map_.building is not None and panel.level is not None:
            _draw_building(ax, panel, map_.building, points_per_m, legend)
        _draw_blocked(ax, map_, legend)
        _draw_lanes(ax, panel, nav, colours, points_per_m, legend)
        _draw_stations(ax, panel, nav, colours, points_per_m, legend)
        if findings:
            _mark_findings(ax, panel, map_, legend)
        if len(panels) > 1:
            ax.set_title(panel.name, fontsize=11, color=INK, loc="left", pad=4)
    _draw_scale(axes[0], panels[0], points_per_m)
    _title(figure, map_, panels, findings)
    _draw_legend(figure, legend)
    return figure


def _panels(map_: Map) -> list[Panel]:
    nav, building = map_.nav, map_.building
    panels = []
    for i, name in enumerate(nav.level_names):
        level = building.levels.get(name) if building else None
        vertices = np.flatnonzero(nav.level == i)
        lanes = np.flatnonzero((nav.level[nav.tail] == i) & (nav.level[nav.head] == i))
        seen = [nav.xy[vertices]]
        if level is not None:
            seen.append(level.wall_xy.reshape(-1, 2))
        if (box := _grid_box(map_)) is not None:
            seen.append(box)
        points = np.concatenate(seen)
        if len(points):
            low, high = points.min(0), points.max(0)
            pad = max(0.6, 0.02 * float((high - low).max()))
            panels.append(Panel(name, level, vertices, lanes, high - low, low - pad, high + pad))
    return panels


def _grid_box(map_: Map) -> FloatArray | None:
    """Lower left and upper right corner of the cells, where the map is a grid, whose vertex 0 is the first free cell."""
    if map_.free is None or not isinstance(map_.nav, PlanGraph):
        return None
    side = map_.nav.cell_m
    row, column = np.argwhere(map_.free)[0]
    low = map_.nav.xy[0] - (np.array([column, row]) + 0.5) * side
    return np.array([low, low + np.array(map_.free.shape[::-1]) * side])


def _page(panels: list[Panel]) -> tuple[Picture, list[Axes], float]:
    """A figure with one axes per panel, in a row or a column, and the scale in inches per metre."""
    sizes = np.array([p.size for p in panels])
    row = np.array([sizes[:, 0].sum(), sizes[:, 1].max()])
    column = np.array([sizes[:, 0].max(), sizes[:, 1].sum()])
    in_row = abs(np.log(row[0] / row[1] / 1.6)) <= abs(np.log(column[0] / column[1] / 1.6))
    width, height = row if in_row else column
    inch_per_m = float(min(20 / width, 13 / height, 0.6, np.sqrt(130 / (width * height))))
    side, top, bottom, between = 0.35, 0.95 if len(panels) == 1 else 1.25, 1.0, 0.45
    gaps = between * (len(panels) - 1)
    plan_w, plan_h = width * inch_per_m + gaps * in_row, height * inch_per_m + gaps * (not in_row)
    page_w, page_h = max(plan_w + 2 * side, 8.0), plan_h + top + bottom
    figure = Picture(page_w, page_h, PAPER)
    x, y = (page_w - plan_w) / 2, page_h - top
    axes = []
    for w, h in sizes * inch_per_m:
        axes.append(figure.add_axes((x / page_w, (y - h) / page_h, w / page_w, h / page_h)))
        x, y = (x + w + between, y) if in_row else (x, y - h - between)
    for ax, panel in zip(axes, panels):
        ax.set_xlim(panel.low[0], panel.high[0])
        ax.set_ylim(panel.low[1], panel.high[1])
        ax.axis("off")
    return figure, axes, inch_per_m


def _component_colours(nav: NavGraph, legend: dict[str, Artist]) -> np.ndarray:
    """[V] the colour of each vertex's component; all alike when there is one. Vertices without lanes do not count."""
    colours = np.full(nav.num_vertices, BLUE, dtype="<U7")
    on_lanes = np.zeros(nav.num_vertices, np.bool_)
    on_lanes[nav.tail] = on_lanes[nav.head] = True
    names, size = np.unique(nav.component[on_lanes], return_counts=True)
    if len(names) < 2:
        return colours
    order = np.argsort(-size, kind="stable")
    for rank, i in enumerate(order):
        colour = COMPONENTS[min(rank, len(COMPONENTS) - 1)]
        colours[nav.component == names[i]] = colour
        if rank < len(COMPONENTS) - 1:
            legend[f"component of {size[i]} vertices" + f" ({rank + 1})"] = Line2D([], [], color=colour, lw=2)
    if len(names) >= len(COMPONENTS):
        legend[f"{len(names) - len(COMPONENTS) + 1} smaller components"] = Line2D([], [], color=COMPONENTS[-1], lw=2)
    return colours


def _draw_building(ax: Axes, panel: Panel, building: Building, points_per_m: float, legend: dict[str, Artist]) -> None:
    level = panel.level
    assert level is not None
    floors = [level.xy[list(polygon)] for polygon in level.floors if len(polygon) > 2]
    holes = [level.xy[list(polygon)] for polygon in level.holes if len(polygon) > 2]
    ax.add_collection(PolyCollection(floors, facecolor=FLOOR, edgecolor="none", zorder=0), autolim=False)
    ax.add_collection(PolyCollection(holes, facecolor=PAPER, edgecolor="none", zorder=0.5), autolim=False)
    width_pt = float(np.clip(0.1 * points_per_m, 0.6, 2.8))
    _, furniture, walls = furniture_and_walls(level.xy[level.walls], NARROW_M)
    draw_strokes(ax, np.concatenate([furniture, level.furniture_xy]), FURNITURE, max(0.35 * width_pt, 0.4), 2)
    draw_strokes(ax, walls, WALL, width_pt, 2)
    for door in level.doors:
        _draw_door(ax, level.xy[door.start], level.xy[door.end], door.kind, points_per_m)
        legend.setdefault("door", Line2D([], [], color=DOOR, lw=2.2))
    if len(level.xy):
        shift = level.xy[0] - level.world_xy[0]
        for lift in building.lifts.values():
            if not lift.level_doors or not lift.lowest_m <= level.elevation_m <= lift.highest_m:
                continue
            turn = Affine2D().rotate(lift.yaw_rad).translate(lift.x_m + shift[0], lift.y_m + shift[1])
            corner = (-lift.width_m / 2, -lift.depth_m / 2)
            cabin = Rectangle(corner, lift.width_m, lift.depth_m, facecolor=PURPLE, edgecolor=PURPLE, alpha=0.28, lw=1.0, zorder=1)
            cabin.set_transform(turn + ax.transData)
            ax.add_patch(cabin)
            legend.setdefault("lift cabin", Patch(facecolor=PURPLE, edgecolor=PURPLE, alpha=0.28, lw=1.0))


def _draw_blocked(ax: Axes, map_: Map, legend: dict[str, Artist]) -> None:
    box = _grid_box(map_)
    if box is None or map_.free is None or map_.free.all():
        return
    (left, bottom), (right, top) = box
    paint = ListedColormap([(0, 0, 0, 0), to_rgba(BLOCKED)])
    edges = (left, right, bottom, top)
    ax.imshow(~map_.free, cmap=paint, vmin=0, vmax=1, extent=edges, origin="lower", interpolation="nearest", aspect="auto", zorder=1)
    legend.setdefault("blocked", Patch(facecolor=BLOCKED, edgecolor="none"))


def draw_strokes(ax: Axes, ends: FloatArray, colour: str, lw: float, zorder: float) -> None:
    """Many straight lines [N, 2, 2] as one element: one element per line makes large maps slow to write and to open."""
    broken = np.concatenate([ends, np.full((len(ends), 1, 2), np.nan)], axis=1).reshape(-1, 2)
    ax.add_line(Line2D(broken[:, 0], broken[:, 1], color=colour, lw=lw, solid_capstyle="projecting", zorder=zorder))


def _draw_door(ax: Axes, hinge: FloatArray, end: FloatArray, kind: str, points_per_m: float) -> None:
    """The opening, and for hinged doors the leaf with its swing. Which side it opens to is not in the map."""
    lw = float(np.clip(0.08 * points_per_m, 0.9, 2.2))
    ax.plot(*zip(hinge, end), color=DOOR, lw=lw, zorder=2.5, solid_capstyle="butt", ls="-" if "sliding" in kind else (0, (1.5, 1)))
    if "hinged" not in kind or np.hypot(*(end - hinge)) * points_per_m < 9:
        return
    middle = (hinge + end) / 2
    for post, stop in ((hinge, middle), (end, middle)) if "double" in kind else ((hinge, end),):
        span = stop - post
        radius = float(np.hypot(*span))
        bearing = float(np.degrees(np.arctan2(span[1], span[0])))
        turn = 90 if np.array_equal(post, hinge) else -90
        leaf = post + radius * np.array([np.cos(np.radians(bearing + turn)), np.sin(np.radians(bearing + turn))])
        ax.plot(*zip(post, leaf), color=DOOR, lw=lw, zorder=2.5, solid_capstyle="butt")
        low, high = sorted((bearing, bearing + turn))
        ax.add_patch(Arc((post[0], post[1]), 2 * radius, 2 * radius, theta1=low, theta2=high, color=DOOR, lw=0.6, zorder=2.5))


def _draw_lanes(ax: Axes, panel: Panel, nav: NavGraph, colours: np.ndarray, points_per_m: float, legend: dict[str, Artist]) -> None:
    lanes = panel.lanes
    paired = nav.reverse[lanes] >= 0
    drawn = lanes[~paired | (nav.tail[lanes] < nav.head[lanes])]
    ends = np.stack([nav.xy[nav.tail[drawn]], nav.xy[nav.head[drawn]]], axis=1)
    lw = float(np.clip(0.12 * points_per_m, 0.5, 2.4 * _shrink(nav, points_per_m)))
    colour_of = colours[nav.tail[drawn]]
    for colour in np.unique(colour_of):
        draw_strokes(ax, ends[colour_of == colour], str(colour), lw, 3)
    if paired.any():
        legend.setdefault("lane, both ways", Line2D([], [], color=_lane_key(colours), lw=2))
    bend = nav.having("is_bend")
    one_way = lanes[~paired & ~bend[nav.head[lanes]]]  # a curve has one arrow, at its end
    if not len(one_way):
        return
    legend.setdefault("lane, one way", Line2D([], [], color=_lane_key(colours), lw=2, marker=">", ms=6))
    start, step = nav.xy[nav.tail[one_way]], nav.xy[nav.head[one_way]] - nav.xy[nav.tail[one_way]]
    length = np.hypot(*step.T)[:, None]
    along = step / np.maximum(length, 1e-9)
    across = along[:, ::-1] * [-1, 1]
    reach = np.where(bend[nav.tail[one_way]][:, None], 7 / points_per_m, np.minimum(7 / points_per_m, 0.6 * length))
    tip = start + step * 0.55 + along * reach / 2
    heads = np.stack([tip, tip - along * reach + across * reach * 0.42, tip - along * reach - across * reach * 0.42], axis=1)
    ax.add_collection(PolyCollection(list(heads), facecolors=list(colours[nav.tail[one_way]]), edgecolor="none", zorder=3.2), autolim=False)


def _shrink(nav: NavGraph, points_per_m: float) -> float:
    """Factor for the size of signs where vertices are close on the page."""
    bend = nav.having("is_bend")
    drawn = ~(bend[nav.tail] | bend[nav.head])
    spacing_pt = float(np.median(nav.length_m[drawn])) * points_per_m if drawn.any() else 28.0
    return float(np.clip(spacing_pt / 28, 0.35, 1.0))


def _lane_key(colours: np.ndarray) -> str:
    """The colour of lanes in the legend: grey if there are several."""
    return BLUE if (colours == BLUE).all() else MUTED


def _draw_stations(ax: Axes, panel: Panel, nav: NavGraph, colours: np.ndarray, points_per_m: float, legend: dict[str, Artist]) -> None:
    groups: dict[str, tuple[Symbol, list[int]]] = {}
    for v in panel.vertices[~nav.having("is_bend")[panel.vertices]]:
        kind = _kind(nav, int(v))
        groups.setdefault(kind.name, (kind, []))[1].append(int(v))
    shrink = _shrink(nav, points_per_m)
    for kind in (JUNCTION, NAMED, *reversed(KINDS)):
        if kind.name not in groups or (kind in (JUNCTION, NAMED) and len(panel.vertices) > MANY):
            continue
        at = np.array(groups[kind.name][1])
        edge = colours[at] if kind is JUNCTION else PAPER
        x, y = nav.xy[at].T
        size, zorder = (kind.size_pt * shrink) ** 2, 4 if kind is JUNCTION else 5
        ax.scatter(x, y, size, marker=kind.marker, facecolor=kind.colour, edgecolor=edge, lw=0.9 * shrink, zorder=zorder)
        outline = BLUE if kind is JUNCTION else PAPER
        legend.setdefault(kind.name, Line2D([], [], marker=kind.marker, ls="", ms=kind.size_pt, mfc=kind.colour, mec=outline, mew=0.8))
    if len(panel.vertices) <= MANY:
        ranked = [v for kind in (*KINDS[:-1], NAMED, KINDS[-1]) for v in groups.get(kind.name, (kind, []))[1] if _name(nav, v)]
        ranked = list({(_name(nav, v), *nav.xy[v].round(2)): v for v in reversed(ranked)}.values())[::-1]  # once a place
        _write_names(ax, panel, nav, ranked, points_per_m, shrink)


def _name(nav: NavGraph, v: int) -> str:
    """What is written at a vertex: its station's name, its own, or its lift's."""
    options = nav.vertex_options[v]
    return str(options.get("station", "")) or nav.vertex_name[v] or str(options.get("lift", ""))


def _kind(nav: NavGraph, v: int) -> Symbol:
    options = nav.vertex_options[v]
    for kind in KINDS:
        if any(options.get(option) for option in kind.options):
            return kind
    return NAMED if nav.vertex_name[v] and ("station" in options or not nav.has_stations) else JUNCTION


def _write_names(ax: Axes, panel: Panel, nav: NavGraph, ranked: list[int], points_per_m: float, shrink: float) -> None:
    font_pt = float(np.clip(7.2 * shrink + 0.6, 4.6, 7.2))
    on_page = (nav.xy - panel.low) * points_per_m
    room = float(np.prod(panel.size)) * points_per_m**2 / (1.15 * font_pt) ** 2  # in characters, roughly two for each
    if sum(len(_name(nav, v)) for v in ranked) > room / 2:
        ranked = [v for v in ranked if _kind(nav, v) is not NAMED]
    if not ranked:
        return
    names = [_name(nav, v) for v in ranked]
    size = np.array([(0.58 * font_pt * len(name) + 1, 1.15 * font_pt) for name in names])
    lines = np.stack([on_page[nav.tail[panel.lanes]], on_page[nav.head[panel.lanes]]], axis=1)
    walls = np.zeros((0, 2, 2)) if panel.level is None else (_walls_and_doors(panel.level) - panel.low) * points_per_m
    page = np.array([(0.0, 0.0), panel.size * points_per_m])
    corner = place_labels(on_page[ranked], size, lines, walls, page, 3.2 * shrink + 1.6)
    placed = np.isfinite(corner[:, 0])
    low, high = (panel.low + c[placed] / points_per_m for c in (corner, corner + size))
    ground = [((x0, y0), (x1, y0), (x1, y1), (x0, y1)) for (x0, y0), (x1, y1) in zip(low, high)]
    ax.add_collection(PolyCollection(ground, facecolor=FLOOR, edgecolor="none", alpha=0.9, zorder=6.5), autolim=False)
    for at, name in zip((low + high) / 2, itertools.compress(names, placed)):  # centred: the width is an estimate
        ax.text(at[0], at[1], name, fontsize=font_pt, color=INK, ha="center", va="center", zorder=7)


def _walls_and_doors(level: Level) -> FloatArray:
    """[S, 2, 2] what a name should not lie on."""
    return np.concatenate([level.wall_xy, *([[level.xy[door.start], level.xy[door.end]]] for door in level.doors)])


def _mark_findings(ax: Axes, panel: Panel, map_: Map, legend: dict[str, Artist]) -> None:
    """Rings around the places that warnings name: vertices and coordinates, of the file or of the graph. Notes get none."""
    nav, level = map_.nav, panel.level
    in_file = np.zeros((0, 2)) if level is None else level.xy
    shift = in_file[0] - level.world_xy[0] if level is not None and len(in_file) else np.zeros(2)
    labelled = {nav.label(v): nav.xy[v] for v in panel.vertices.tolist()} if map_.findings else {}
    places = []
    for finding in map_.findings:
        if finding.severity != "warn":
            continue
        of_graph = map_.building is None or (bool(map_.changes) and finding.kind in FOUND_ON_GRAPHS)
        for detail in finding.details:
            if f"level {panel.name} " not in detail + " ":
                continue
            if at := re.search(r"at \((-?[\d.]+), (-?[\d.]+)\)", detail):
                places.append(np.array([float(at[1]), float(at[2])]) + (0.0 if of_graph else shift))
            elif vertex := re.search(r"\bvertex (.+?)(?: near |[:,]| '|$)", detail):
                if of_graph and vertex[1] in labelled:
                    places.append(labelled[vertex[1]])
                elif not of_graph and vertex[1].isdecimal() and int(vertex[1]) < len(in_file):
                    places.append(in_file[int(vertex[1])])
    if places:
        x, y = np.array(places).T
        ax.scatter(x, y, 90, facecolor="none", edgecolor=VERMILION, lw=1.6, zorder=6)
        legend.setdefault("warning", Line2D([], [], marker="o", ls="", ms=9, mfc="none", mec=VERMILION, mew=1.6))


def _draw_scale(ax: Axes, panel: Panel, points_per_m: float) -> None:
    """A bar of a round length, below the plan at the right."""
    length = round_length(110 / points_per_m)
    right, y = panel.high[0], panel.low[1] - 12 / points_per_m
    tick = 3 / points_per_m
    for k, colour in enumerate((INK, PAPER)):
        box = Rectangle((right - length + k * length / 2, y - tick), length / 2, 1.4 * tick, facecolor=colour, edgecolor=INK, lw=0.8)
        box.set_clip_on(False)
        ax.add_patch(box)
    ax.text(
        right - length - 5 / points_per_m, y - 0.3 * tick, f"{length:g} m", ha="right", va="center", fontsize=8, color=INK, clip_on=False
    )


def _title(figure: Figure, map_: Map, panels: list[Panel], findings: bool) -> None:
    nav = map_.nav
    height = figure.get_figheight()

    bends = int(nav.having("is_bend").sum())  # of curves, which are one edge each
    facts = [
        count(nav.num_vertices - bends, "vertex", "vertices"),
        count(num_drawn_edges(nav) - bends, "edge", "edges"),
    ]
    facts.append(count(num_driven_components(nav), "component", "components"))
    facts.append("{:.1f} x {:.1f} m".format(*panels[0].extent) if len(panels) == 1 else count(len(panels), "level", "levels"))
    num_findings = sum(finding.severity == "warn" for finding in map_.findings)
    if findings and num_findings:
        facts.append(count(num_findings, "warning", "warnings"))
    left = 0.35 / figure.get_figwidth()
    figure.text(left, 1 - 0.42 / height, map_.name, fontsize=17, fontweight="bold", color=INK, va="center")
    figure.text(left, 1 - 0.70 / height, "   ·   ".join(facts), fontsize=9.5, color=MUTED, va="center")


def _draw_legend(figure: Figure, legend: dict[str, Artist]) -> None:
    width = figure.get_figwidth()
    columns = max(1, min(len(legend), int((width - 0.6) / (0.55 + 0.075 * max(map(len, legend), default=1)))))
    figure.legend(
        list(legend.values()),
        list(legend),
        loc="lower left",
        bbox_to_anchor=(0.2 / width, 0.08 / figure.get_figheight()),
        ncol=columns,
        frameon=False,
        fontsize=8,
        labelcolor=INK,
        handletextpad=0.5,
        columnspacing=1.6,
    )
