"""A run at one moment as a picture, PNG or SVG by the file's suffix: the floor, robots to scale with heading and state, where they
came from, and where the plan has them. The same run and time give the same bytes. Refuses other suffixes and times outside the run.
"""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from mrp_sumo.core.execution import positions_at
from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.files.writing import writing_to
from mrp_sumo.io.outline import Outline
from mrp_sumo.io.record import RunRecord
from mrp_sumo.io.run_reader import damage_in
from mrp_sumo.reports.pictures.floor import LIGHT, NO_STROKES, STATES, draw_floor, name_places, write_name
from mrp_sumo.reports.pictures.picture import Picture, require_suffix, round_length
from mrp_sumo.reports.pictures.view import (
    ABSENT,
    AnyRun,
    drawbars,
    extent,
    forks_of,
    level_corners,
    parts_at,
    parts_of,
    planned_at,
    state_names,
    view_record,
    view_states,
)

WIDTH_IN = 12.0  # of the page
TRAIL_S = 20.0
LEVEL_PT = 10.0  # names of levels
ROBOT_PT = 7.5  # names of robots
NAMED = 60  # number of robots up to which they are named and the plan is drawn
LEAST_PT = (8.0, 4.5)  # least length of a robot on the page: up to NAMED robots, and beyond


def render_still(run: AnyRun, at_s: float, path: Path, *, dpi: float = 150) -> Path:
    """Draw the run at a moment.

    Raises MrpSumoError for another suffix, a time outside the run, a run with nothing to show, and a place that cannot be written.
    """
    require_suffix(path)
    figure = still(run, at_s)
    with writing_to(path):
        return figure.write(path, dpi)


def still(run: AnyRun, at_s: float) -> Picture:
    """The picture of a run at a moment; the parameters are those of `render_still`.

    Raises MrpSumoError for a time outside the run, and a run with nothing to show.
    """
    with damage_in(run.source):
        record, outline = view_record(run), run.outline
    execution = record.execution
    if not execution.x_m.size:
        raise MrpSumoError(f"{run.source}: nothing to draw: {execution.num_robots} robots, {len(execution.t_s)} samples")
    end_s = float(execution.t_s[-1])
    if not 0 <= at_s <= end_s + 1e-9:
        raise MrpSumoError(f"{at_s:g} s is outside the run, which lasts from 0 to {end_s:g} s")
    figure, ax, points_per_m = _page(record, outline)
    written = draw_floor(ax, record, outline, points_per_m)
    for name, x, y in level_corners(record, outline):
        ax.text(x, y + 3 / points_per_m, name, fontsize=LEVEL_PT, color=LIGHT["ink"], va="bottom", zorder=3).set_parse_math(False)
    counts = _draw_robots(ax, record, at_s, points_per_m, written)
    _write_head_and_foot(figure, ax, record, at_s, counts, planned=not run.executed)
    return figure


def _page(record: RunRecord, outline: Outline | None) -> tuple[Picture, Axes, float]:
    low, high = extent(record, outline)
    w, h = high - low
    inch_per_m = float(min((WIDTH_IN - 0.4) / w, 14 / h))
    head_in, foot_in = 0.75 if len(np.unique(record.drawn.level)) == 1 else 0.95, 0.45
    page = (max(w * inch_per_m + 0.4, 6.0), h * inch_per_m + head_in + foot_in)
    figure = Picture(*page, LIGHT["paper"])
    left = (page[0] - w * inch_per_m) / 2
    ax = figure.add_axes((left / page[0], foot_in / page[1], w * inch_per_m / page[0], h * inch_per_m / page[1]))
    ax.set_xlim(low[0], high[0])
    ax.set_ylim(low[1], high[1])
    ax.axis("off")
    return figure, ax, 72 * inch_per_m


def _draw_robots(ax: Axes, record: RunRecord, at_s: float, points_per_m: float, written: FloatArray) -> list[int]:
    execution, fleet = record.execution, record.fleet
    x, y, yaw = (c[0] for c in positions_at(execution, np.array([at_s])))
    xy = np.column_stack((x, y))
    now = int(np.clip(np.searchsorted(execution.t_s, at_s + 1e-9) - 1, 0, len(execution.t_s) - 1))
    state = view_states(execution)[now]
    there = np.flatnonzero((state != ABSENT) & np.isfinite(x))
    few = record.fleet.num_robots <= NAMED
    grow = np.maximum(1, LEAST_PT[not few] / (fleet.length_m * points_per_m))
    back = max(0, now - int(TRAIL_S / max(execution.t_s[-1] / max(len(execution.t_s) - 1, 1), 1e-9)))
    trails = [np.column_stack((execution.x_m[back : now + 1, r], execution.y_m[back : now + 1, r])) for r in there]
    colours = [STATES[s] for s in state[there]]
    trail = LineCollection(trails, colors=colours, lw=max(0.05 * points_per_m, 1), alpha=0.35, capstyle="round", zorder=4)
    ax.add_collection(trail, autolim=False)
    if few and record.plan is not None:
        ghosts = planned_at(record.plan, record.graph, np.array([at_s]))[:, 0].T[there]
        ties = np.stack([ghosts, xy[there]], axis=1)
        ax.add_collection(LineCollection(list(ties), color=LIGHT["muted"], lw=0.6, zorder=4.5), autolim=False)
        boxes = [_box(ghosts[i], yaw[r], fleet.length_m[r] * grow[r], fleet.width_m[r] * grow[r]) for i, r in enumerate(there)]
        ax.add_collection(PolyCollection(boxes, facecolor="none", edgecolor=LIGHT["muted"], lw=0.8, zorder=4.6), autolim=False)
    bars = _draw_parts(ax, record, at_s, state, xy, points_per_m)
    boxes = [_box(xy[r], yaw[r], fleet.length_m[r] * grow[r], fleet.width_m[r] * grow[r]) for r in there]
    ax.add_collection(PolyCollection(boxes, facecolor=colours, edgecolor=LIGHT["ink"], lw=0.5, zorder=5), autolim=False)
    arrows = [_box(xy[r], yaw[r], fleet.length_m[r] * grow[r], fleet.width_m[r] * grow[r], ARROW) for r in there]
    ax.add_collection(PolyCollection(arrows, facecolor="white", edgecolor="none", zorder=5.1), autolim=False)
    end = forks_of(fleet)
    forked = [(r, fleet.length_m[r] * grow[r] * end[r], fleet.width_m[r] * grow[r]) for r in there if end[r]]
    forks = [_box(xy[r], yaw[r], length, width, fork) for r, length, width in forked for fork in FORKS]
    ax.add_collection(LineCollection(forks, colors=LIGHT["ink"], lw=max(0.08 * points_per_m, 0.8), zorder=5.1), autolim=False)
    if few and len(there):
        half_pt = 0.5 * float((np.hypot(fleet.length_m, fleet.width_m) * grow).max()) * points_per_m
        names = [fleet.robot_name[r] for r in there]
        centres = name_places(ax, names, xy[there], ROBOT_PT, half_pt + 2, points_per_m, (np.concatenate([bars, written]), NO_STROKES))
        for r, at in zip(there, centres):
            beside = at if np.isfinite(at[0]) else xy[r] + (0.0, (half_pt + 6) / points_per_m)
            write_name(ax, fleet.robot_name[r], beside, ROBOT_PT, LIGHT["ink"], 6)
    count: list[int] = np.bincount(state, minlength=5)[:4].tolist()
    return count


def _draw_parts(ax: Axes, record: RunRecord, at_s: float, state: IntArray, robots: FloatArray, points_per_m: float) -> FloatArray:
    """Draw trailers with their drawbars, and loads that are larger than their robots; returns the drawbars [S, 2, 2]."""
    parts = parts_of(record.execution, record.fleet)
    xy, yaw = (column[0] for column in parts_at(parts, record.execution, np.array([at_s])))
    there = np.flatnonzero((state[parts.owner] != ABSENT) & np.isfinite(xy[:, 0]))
    bars = [line for k, line in drawbars(parts, xy, yaw, robots) if k in there]
    ax.add_collection(LineCollection(bars, colors=LIGHT["ink"], lw=max(0.08 * points_per_m, 0.8), zorder=4.7), autolim=False)
    boxes = [_box(xy[k], yaw[k], parts.length_m[k], parts.width_m[k]) for k in there]
    colours = [STATES[s] for s in state[parts.owner[there]]]
    ax.add_collection(PolyCollection(boxes, facecolor=colours, edgecolor=LIGHT["ink"], lw=0.5, zorder=4.8), autolim=False)
    strokes: FloatArray = np.array([line[k : k + 2] for line in bars for k in (0, 1)]).reshape(-1, 2, 2)
    return strokes


BOX = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) / 2
ARROW = np.array([(0.62, 0), (-0.5, 0.56), (-0.24, 0), (-0.5, -0.56)]) / 2
FORKS = np.array([[(0.34, side), (1, side)] for side in (0.56, -0.56)]) / 2


def _box(xy: FloatArray, yaw: float, length: float, width: float, shape: FloatArray = BOX) -> FloatArray:
    c, s = np.cos(yaw), np.sin(yaw)
    corners: FloatArray = shape * (length, width) @ np.array([(c, s), (-s, c)]) + xy
    return corners


def _write_head_and_foot(figure: Figure, ax: Axes, record: RunRecord, at_s: float, counts: list[int], *, planned: bool) -> None:
    width, height = figure.get_size_inches()
    title = figure.text(0.2 / width, 1 - 0.3 / height, record.name, fontsize=14, fontweight="bold", color=LIGHT["ink"], va="center")
    title.set_parse_math(False)
    what = "planned, at" if planned else "at"
    figure.text(
        0.2 / width,
        1 - 0.55 / height,
        f"{what} {at_s:.1f} s of {record.execution.t_s[-1]:.1f} s",
        fontsize=9,
        color=LIGHT["muted"],
        va="center",
    )
    names = state_names(record.execution.tasks is not None)
    keys = [
        Line2D([], [], marker="s", ls="", ms=7, mec="none", color=c, label=f"{name} {n}") for c, name, n in zip(STATES, names, counts) if n
    ]
    if record.plan is not None and record.fleet.num_robots <= NAMED and not planned:
        keys.append(Line2D([], [], marker="s", ls="", ms=7, mfc="none", mec=LIGHT["muted"], label="where the plan has it"))
    figure.legend(
        handles=keys,
        loc="lower left",
        bbox_to_anchor=(0.1 / width, 0.02 / height),
        ncol=len(keys),
        frameon=False,
        fontsize=8.5,
        labelcolor=LIGHT["ink"],
        handletextpad=0.3,
        columnspacing=1.4,
    )
    wanted = 90 / (72 * width * ax.get_position().width / float(np.ptp(ax.get_xlim())))
    length = round_length(wanted)
    right, low = ax.get_xlim()[1], ax.get_ylim()[0] - 0.12 * wanted
    ax.plot([right - length, right], [low, low], color=LIGHT["muted"], lw=2.5, solid_capstyle="butt", clip_on=False)
    ax.annotate(
        f"{length:g} m",
        (right - length, low),
        (-4, 0),
        textcoords="offset points",
        annotation_clip=False,
        fontsize=8,
        color=LIGHT["muted"],
        ha="right",
        va="center",
    )
