"""The floor of a run in matplotlib: building, lanes or cells, stations, and names that keep clear of each other."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patheffects import withStroke

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.io.outline import Outline
from mrp_sumo.io.record import RunRecord
from mrp_sumo.reports.pictures.labels import place_labels
from mrp_sumo.reports.pictures.view import crossings, drawn_lanes, furniture_and_walls, is_grid_map
from mrp_sumo.reports.replay.constants import STATE_COLOURS, THEMES

LIGHT = THEMES["light"]
STATES = tuple(LIGHT[name] for name in STATE_COLOURS)  # colours of robots
NAME_PT = 6.5  # names of stations
NO_STROKES = np.zeros((0, 2, 2))


def draw_floor(ax: Axes, record: RunRecord, outline: Outline | None, points_per_m: float, *, name_pt: float = NAME_PT) -> FloatArray:
    """Draw what stands under the robots: floors, furniture, doors, walls, lanes or cells, and stations with their names.

    Returns strokes [S, 2, 2] through the names, in m.
    """
    nav = record.drawn
    if outline is not None:
        furniture, inner, walls = furniture_and_walls(outline.walls)
        for polygons, colour in ((outline.floors, LIGHT["floor"]), (outline.holes, LIGHT["paper"]), (furniture, LIGHT["furniture"])):
            ax.add_collection(PolyCollection(list(polygons), facecolor=colour, edgecolor="none", zorder=0), autolim=False)
        ax.add_collection(LineCollection(list(inner), color=LIGHT["wall"], lw=0.5, alpha=0.5, zorder=1), autolim=False)
        lw = float(np.clip(0.1 * points_per_m, 0.6, 4))
        ax.add_collection(LineCollection(list(outline.doors), color=LIGHT["door"], lw=0.6 * lw, zorder=2), autolim=False)
        ax.add_collection(LineCollection(list(walls), color=LIGHT["wall"], lw=lw, capstyle="round", zorder=2), autolim=False)
    if is_grid_map(record):
        half = record.graph.cell_m / 2
        cells = record.graph.xy[:, None] + np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
        ax.add_collection(PolyCollection(list(cells), facecolor=LIGHT["floor"], edgecolor=LIGHT["floor"], lw=0.3, zorder=0), autolim=False)
        return NO_STROKES
    once = drawn_lanes(nav)
    ends = np.stack([nav.xy[nav.tail[once]], nav.xy[nav.head[once]]], axis=1)
    ax.add_collection(LineCollection(list(ends), color=LIGHT["lane"], lw=max(0.05 * points_per_m, 0.8), zorder=1.5), autolim=False)
    named = np.flatnonzero([bool(name) for name in nav.vertex_name] & ~crossings(nav)).tolist()
    at = nav.xy[named]
    ax.scatter(at[:, 0], at[:, 1], s=max(0.16 * points_per_m, 3) ** 2, color=LIGHT["station"], lw=0, zorder=2.5)
    through = []
    if 0 < len(named) <= 80:
        drawn = NO_STROKES if outline is None else np.concatenate([outline.walls, outline.doors])
        names = [nav.known_as(v) for v in named]
        for name, xy in zip(names, name_places(ax, names, at, name_pt, 2 + 0.08 * points_per_m, points_per_m, (ends, drawn))):
            if np.isfinite(xy[0]):
                write_name(ax, name, xy, name_pt, LIGHT["muted"], 3)
                reach = np.array([0.29 * name_pt * len(name) / points_per_m, 0.0])
                through.append((xy - reach, xy + reach))
    return np.array(through).reshape(-1, 2, 2)


def name_places(
    ax: Axes,
    names: list[str],
    xy: FloatArray,
    size_pt: float,
    gap_pt: float,
    points_per_m: float,
    strokes: tuple[FloatArray, FloatArray],
) -> FloatArray:
    """[N, 2] centres of names beside points, in m: clear of each other and, if possible, of strokes, lanes and walls; NaN without room."""
    low, high = np.array([ax.get_xlim(), ax.get_ylim()]).T
    lane, wall = ((ends - low) * points_per_m for ends in strokes)
    size = np.array([(0.58 * size_pt * len(name) + 1, 1.15 * size_pt) for name in names])
    page = np.array([(0.0, 0.0), (high - low) * points_per_m])
    centres: FloatArray = low + (place_labels((xy - low) * points_per_m, size, lane, wall, page, gap_pt) + size / 2) / points_per_m
    return centres


def write_name(ax: Axes, text: str, xy: Sequence[float] | FloatArray, size_pt: float, colour: str, zorder: float) -> None:
    """Write a name with a halo."""
    note = ax.text(xy[0], xy[1], text, fontsize=size_pt, color=colour, ha="center", va="center", zorder=zorder)
    note.set_path_effects([withStroke(linewidth=1.8, foreground=LIGHT["floor"])])
    note.set_parse_math(False)  # a name is a name
