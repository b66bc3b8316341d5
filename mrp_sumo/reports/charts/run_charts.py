"""The charts of one run: where it was crowded, who was where on a lane, what each robot did, who waited for whom.

Runs that were not executed have no charts.
"""

import math

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import ListedColormap, PowerNorm, to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Patch

from mrp_sumo.core.graph import FloatArray, IntArray, NavGraph
from mrp_sumo.core.near import least_distance_m
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.io.outline import Outline, read_outline
from mrp_sumo.io.record import AT_GOAL, BLOCKED, MOVING, STANDING_MPS, WAITING, RunRecord, robot_states
from mrp_sumo.io.run_reader import RunFolder
from mrp_sumo.reports.charts.chart import COLOURS, GRID, NARROW, Chart, around_zero, distribution, draw, printable, spread
from mrp_sumo.reports.charts.task_charts import task_charts
from mrp_sumo.reports.pictures.map_picture import BLUE, FLOOR, INK, MUTED, ORANGE, VERMILION, WALL, draw_strokes
from mrp_sumo.reports.pictures.view import drawn_lanes

WIDE_INCH = 10.2
MAX_TIMES = 1200  # of a chart
MANY_ROBOTS = 60  # beyond which rows are pixels and names are left out
MAX_WAITING = 24  # robots in the graph of who waited
MAX_BINS = 240  # of the heat map along its longer side
HEAT = ListedColormap(colormaps["inferno_r"](np.linspace(0.12, 1, 256)))  # its lightest colours would be lost on a floor plan
STRAIGHT = math.cos(math.radians(8))

STATES = (  # state, name, colour, height of its bar: shape tells them apart as well
    (MOVING, "moving", BLUE, 0.62),
    (WAITING, "waiting", ORANGE, 0.34),
    (BLOCKED, "blocked", VERMILION, 0.92),
    (AT_GOAL, "at goal", MUTED, 0.1),
)


def run_charts(run: RunFolder, tag: str = "run") -> list[Chart]:
    """All charts of a run. Raises MrpSumoError for a folder whose files are damaged."""
    if not run.executed:
        return []
    try:
        record, outline = run.record, read_outline(run.folder / "building.json")
    except (OSError, ValueError, LookupError, TypeError) as error:  # raised by libraries for damaged files
        raise MrpSumoError(f"{run.folder}: not a whole run folder: {type(error).__name__}: {' '.join(str(error).split())}") from None
    if not len(record.execution.t_s) or not record.execution.num_robots:
        return []
    t = record.execution.t_s
    times = t[spread(len(t), MAX_TIMES)]
    states = robot_states(record.execution, times)
    tasks, end_s = record.execution.tasks, record.execution.sim_time_s
    charts = [
        *(task_charts(tasks, end_s, run.metrics.get("warm_up_s"), tag) if tasks is not None else ()),
        *_heat_maps(record, outline, times, states, tag),
        _space_time(record, tag),
        _gantt(record, times, states, tag),
        _waits(record, tag),
        _lateness(record, tag),
        _distances(record, times, tag),
    ]
    return [chart for chart in charts if chart is not None]


def _at(record: RunRecord, times: FloatArray) -> tuple[FloatArray, FloatArray]:
    """x and y [K, R] at sample times."""
    sample = np.clip(np.searchsorted(record.execution.t_s, times - 1e-9), 0, len(record.execution.t_s) - 1)
    return record.execution.x_m[sample], record.execution.y_m[sample]


def _heat_maps(record: RunRecord, outline: Outline | None, times: FloatArray, states: np.ndarray, tag: str) -> list[Chart]:
    x, y = _at(record, times)
    step_s = np.gradient(times) if len(times) > 1 else np.ones(1)
    there = np.isfinite(x)
    weight = np.broadcast_to(step_s[:, None], x.shape)
    walls = np.zeros((0, 2)) if outline is None else outline.walls.reshape(-1, 2)
    together = np.concatenate([record.graph.xy, walls])
    low, high = together.min(0) - 0.6, together.max(0) + 0.6
    size_m = high - low
    bin_m = max(record.graph.cell_m or 0.4, float(size_m.max()) / MAX_BINS)
    bins = [low[k] + bin_m * np.arange(math.ceil(size_m[k] / bin_m) + 1) for k in (0, 1)]
    # vertices in the middle of a bin rather than on its border
    shift = ((record.graph.xy[0] - low) % bin_m) - bin_m / 2 if bin_m == record.graph.cell_m else np.zeros(2)
    bins = [b + s for b, s in zip(bins, shift)]
    charts = []
    occupied, standing = there & (states != AT_GOAL), there & ((states == WAITING) | (states == BLOCKED))
    for what, title, caption, mask in (
        ("traffic", "Traffic", "Robot-seconds for which a place was occupied, robots at their goals left out.", occupied),
        ("standing", "Congestion", "Robot-seconds spent standing away from the goal.", standing),
    ):
        heat, _, _ = np.histogram2d(x[mask], y[mask], bins=bins, weights=weight[mask])
        if not heat.any():
            continue
        wide = size_m[0] > 1.25 * size_m[1]
        width = WIDE_INCH if wide else NARROW[0]
        tall = float(np.clip(width * size_m[1] / size_m[0], 1.4, 7.0)) + 0.75

        def paint(figure: Figure, heat: FloatArray = heat) -> None:
            figure.set_layout_engine("constrained")  # for the colour bar
            ax = figure.add_subplot()
            _plan(ax, record, outline)
            seconds = np.where(heat > 0, heat, np.nan).T
            top = max(float(np.nanquantile(seconds, 0.995)), 1e-6)
            extent = (bins[0][0], bins[0][-1], bins[1][0], bins[1][-1])
            image = ax.imshow(
                seconds, origin="lower", extent=extent, cmap=HEAT, norm=PowerNorm(0.5, 0, top), zorder=1.5, interpolation="nearest"
            )
            ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xticks=[], yticks=[], aspect="equal")
            ax.grid(visible=False)
            for spine in ax.spines.values():
                spine.set_visible(False)
            bar = figure.colorbar(image, ax=ax, orientation="horizontal", shrink=0.6, aspect=34, pad=0.02, extend="max")
            bar.outline.set_visible(False)
            bar.set_label("robot-seconds per place of " + f"{bin_m:.2g} m")

        where = f"{tag}_{what}"
        charts.append(draw(where, f"{title} on the floor plan", caption, paint, size=(width, tall), wide=wide))
    return charts


def _plan(ax: Axes, record: RunRecord, outline: Outline | None) -> None:
    if outline is not None:
        ax.add_collection(PolyCollection(list(outline.floors), facecolor=FLOOR, edgecolor="none", zorder=0), autolim=False)
    else:
        ax.set_facecolor(FLOOR)
    nav = record.drawn
    once = drawn_lanes(nav)
    draw_strokes(ax, np.stack([nav.xy[nav.tail[once]], nav.xy[nav.head[once]]], axis=1), "#a9b4c2", 0.7, 1)
    if outline is not None:
        draw_strokes(ax, outline.walls, WALL, 1.0, 2)


def _space_time(record: RunRecord, tag: str) -> Chart | None:
    nav = record.nav if record.nav is not None and record.nav.num_lanes else record.graph
    if not nav.num_lanes:
        return None
    t = record.execution.t_s
    sample = spread(len(t), 3000)
    x, y = record.execution.x_m[sample], record.execution.y_m[sample]
    moving = record.execution.speed_mps[sample] > STANDING_MPS
    chain = _busiest_corridor(nav, np.where(moving, x, np.nan), np.where(moving, y, np.nan))
    line = nav.xy[chain]
    along = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
    reach = max(1.6 * (record.graph.cell_m or 0.4), float(record.fleet.width_m.max()))
    position = _along(line, along, np.stack([x, y], axis=-1), reach)  # [K, R]
    shown_robots = np.flatnonzero(np.isfinite(position).sum(0) > 1)
    if not len(shown_robots):
        return None
    inside = np.flatnonzero(np.isfinite(position[:, shown_robots]).any(1))
    span = t[sample[[inside[0], inside[-1]]]]

    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        named = len(shown_robots) <= 15
        for k, robot in enumerate(shown_robots):
            colour = COLOURS[k % len(COLOURS)]
            if record.plan is not None:
                ax.plot(*_planned(record, int(robot), line, along, reach), color=colour, lw=1.0, alpha=0.75, ls=(0, (3, 2)))
            ax.plot(
                t[sample], position[:, robot], color=colour, lw=1.8 if named else 1.0, label=printable(record.fleet.robot_name[robot], 18)
            )
        stations = [(a, nav.known_as(v) if nav.vertex_name[v] else "") for a, v in zip(along, chain)]
        for a, _ in stations:
            ax.axhline(a, color=GRID, lw=0.7, zorder=0)
        ax.grid(axis="y", visible=False)
        room = along[-1] / 18
        labels: dict[float, str] = {}
        for a, name in stations:
            if name and (not labels or a - max(labels) > room):
                labels[a] = printable(name, 18)
        if labels:
            right = ax.secondary_yaxis("right")
            right.set_yticks(list(labels), list(labels.values()))
            right.spines["right"].set_visible(False)
            right.tick_params(length=0, labelsize=8)
        late = max(5.0, 0.04 * (span[1] - span[0]))
        ax.set(
            xlabel="time (s)",
            ylabel="position along the lane (m)",
            ylim=(-0.03 * along[-1], 1.03 * along[-1]),
            xlim=(span[0] - late, span[1] + late),
        )
        if named:
            figure.legend(loc="outside lower left", ncols=6)

    ends = [nav.known_as(v) for v in (chain[0], chain[-1])]
    caption = (
        f"The busiest straight stretch of lanes, from {printable(ends[0])} to {printable(ends[1])} ({along[-1]:.1f} m). A level line "
        "stands still; lines that cross are robots that pass each other on the two ways of the lane. Dashed: as planned."
    )
    return draw(f"{tag}_space_time", "Space and time on a lane", caption, paint, size=(WIDE_INCH, 4.4), wide=True)


def _busiest_corridor(nav: NavGraph, x: FloatArray, y: FloatArray) -> IntArray:
    """[N] vertices of the straight stretch of lanes that most robots used, and among these where they spent most time."""
    once = np.flatnonzero(nav.is_once)
    tail, head = nav.tail[once], nav.head[once]
    chains, chain_of = _straight_stretches(nav, tail, head)
    there = np.isfinite(x)
    if not there.any():
        return chains[0]
    a, b = nav.xy[tail], nav.xy[head]
    pieces = np.maximum(2, np.ceil(np.hypot(*(b - a).T) / 0.5).astype(np.int64) + 1)
    edge = np.repeat(np.arange(len(once)), pieces)
    first = np.concatenate([[0], np.cumsum(pieces)[:-1]])
    u = (np.arange(len(edge)) - first[edge]) / (pieces[edge] - 1)
    from scipy.spatial import cKDTree

    tree = cKDTree(a[edge] + u[:, None] * (b - a)[edge])
    few = max(1, int(there.sum() / 400_000))
    robots = np.broadcast_to(np.arange(x.shape[1]), x.shape)[there][::few]
    near = chain_of[edge[tree.query(np.stack([x[there], y[there]], axis=1)[::few])[1]]]
    passed = np.bincount(np.unique(near * x.shape[1] + robots) // x.shape[1], minlength=len(chains))
    return chains[int(np.lexsort((-np.bincount(near, minlength=len(chains)), -passed))[0])]


def _straight_stretches(nav: NavGraph, tail: IntArray, head: IntArray) -> tuple[list[IntArray], IntArray]:
    """All straight stretches, as vertices, and [E] the stretch of each edge."""
    beside: dict[int, list[tuple[int, int]]] = {}
    for e, (a, b) in enumerate(zip(tail.tolist(), head.tolist())):
        beside.setdefault(a, []).append((b, e))
        beside.setdefault(b, []).append((a, e))
    chain_of = np.full(len(tail), -1, np.int64)
    chains: list[IntArray] = []
    for e in range(len(tail)):
        if chain_of[e] >= 0:
            continue
        chain_of[e] = len(chains)
        ends = []
        for before, here in ((int(tail[e]), int(head[e])), (int(head[e]), int(tail[e]))):
            reached = [here]
            while True:
                ahead = nav.xy[reached[-1]] - nav.xy[before]
                onward = [
                    (v, f) for v, f in beside[reached[-1]] if chain_of[f] < 0 and _is_straight(ahead, nav.xy[v] - nav.xy[reached[-1]])
                ]
                if not onward:
                    break
                before = reached[-1]
                reached.append(onward[0][0])
                chain_of[onward[0][1]] = len(chains)
            ends.append(reached)
        chains.append(np.array([*ends[1][::-1], *ends[0]], np.int64))
    return chains, chain_of


def _is_straight(ahead: FloatArray, step: FloatArray) -> bool:
    size = float(np.hypot(*step) * np.hypot(*ahead))
    return size > 0 and float(step @ ahead) / size > STRAIGHT


def _along(line: FloatArray, along: FloatArray, points: FloatArray, reach: float) -> FloatArray:
    """Position along a line of points [..., 2]; NaN farther from it than `reach`."""
    best = np.full(points.shape[:-1], np.inf)
    position = np.full(points.shape[:-1], np.nan)
    with np.errstate(invalid="ignore"):
        for k in range(len(line) - 1):
            step = line[k + 1] - line[k]
            size = float(np.hypot(*step))
            if size == 0:
                continue
            u = np.clip((points - line[k]) @ step / size**2, 0, 1)
            gap = np.hypot(*np.moveaxis(points - line[k] - u[..., None] * step, -1, 0))
            nearer = gap < best
            best = np.where(nearer, gap, best)
            position = np.where(nearer, along[k] + u * size, position)
    return np.where(best <= reach, position, np.nan)


def _planned(record: RunRecord, robot: int, line: FloatArray, along: FloatArray, reach: float) -> tuple[FloatArray, FloatArray]:
    plan = record.plan
    assert plan is not None
    visits = slice(plan.first[robot], plan.first[robot + 1])
    at = _along(line, along, record.graph.xy[plan.vertex[visits]], reach)
    depart = np.where(np.isfinite(plan.depart_s[visits]), plan.depart_s[visits], plan.arrive_s[visits])
    return np.stack([plan.arrive_s[visits], depart], axis=1).ravel(), np.repeat(at, 2)


def _gantt(record: RunRecord, times: FloatArray, states: np.ndarray, tag: str) -> Chart:
    names, num = record.fleet.robot_name, states.shape[1]
    there = np.isfinite(_at(record, times)[0])
    goal = np.where(np.isfinite(record.execution.goal_s), record.execution.goal_s, np.inf)
    order = np.lexsort((np.arange(num), goal))
    alpha = {state: 0.3 if state == AT_GOAL and num > MANY_ROBOTS else 1.0 for state, *_ in STATES}

    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        if num <= MANY_ROBOTS:
            for state, _, colour, height in STATES:
                low, boxes = -height / 2, []
                for row, robot in enumerate(order):
                    for a, b in times[_stretches((states[:, robot] == state) & there[:, robot])].tolist():
                        boxes.append([(a, row + low), (b, row + low), (b, row - low), (a, row - low)])
                ax.add_collection(PolyCollection(boxes, facecolor=colour, edgecolor="none"), autolim=False)
            ax.set_yticks(range(num), [printable(names[r], 18) for r in order])
            ax.tick_params(axis="y", length=0, labelsize=8.5 if num <= 25 else 6)
        else:
            palette = np.array([to_rgba(colour, alpha[state]) for state, _, colour, _ in sorted(STATES)] + [(0, 0, 0, 0)])
            pixels = palette[np.where(there, states, len(STATES))[:, order].T]
            ax.imshow(pixels, aspect="auto", extent=(times[0], times[-1] or 1.0, num - 0.5, -0.5), interpolation="nearest")
            ax.set_ylabel("robots, by arrival")
            ax.grid(visible=False)
        ax.grid(axis="y", visible=False)
        ax.set(xlim=(0, times[-1] or 1.0), ylim=(num - 0.4, -0.6), xlabel="time (s)")
        seen = np.unique(states[there])
        handles = [Patch(facecolor=colour, alpha=alpha[state], label=name) for state, name, colour, _ in STATES if state in seen]
        figure.legend(handles=handles, loc="outside lower left", ncols=4)

    tall = float(np.clip(0.9 + 0.24 * num, 2.2, 8.0)) if num <= MANY_ROBOTS else 6.0
    caption = "What each robot did, the first to arrive on top. Waiting: standing elsewhere than at its goal; blocked: for long."
    return draw(f"{tag}_gantt", "What each robot did", caption, paint, size=(WIDE_INCH, tall), wide=True)


def _stretches(mask: np.ndarray) -> IntArray:
    """[N, 2] first and last index of every run of True, the last one extended by a step so that bars touch."""
    edge = np.diff(np.concatenate([[0], mask.astype(np.int8), [0]]))
    return np.minimum(np.flatnonzero(edge).reshape(-1, 2), len(mask) - 1)


def waits(record: RunRecord) -> FloatArray:
    """[R, R] seconds that each robot waited for each other one, from the events."""
    num = record.execution.num_robots
    seconds = np.zeros((num, num))
    for event in record.execution.events:
        if event.kind == "waited" and 0 <= event.robot < num and 0 <= event.other < num:
            seconds[event.robot, event.other] += event.duration_s
    return seconds


def _waits(record: RunRecord, tag: str) -> Chart | None:
    seconds = waits(record)
    if not seconds.any():
        return None
    involved = seconds.sum(0) + seconds.sum(1)
    chosen = np.sort(np.argsort(-involved, kind="stable")[:MAX_WAITING])
    chosen = chosen[involved[chosen] > 0]
    within = seconds[np.ix_(chosen, chosen)]
    names = [record.fleet.robot_name[r] for r in chosen]

    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        angle = np.pi / 2 - 2 * np.pi * np.arange(len(chosen)) / len(chosen)
        place = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        top = within.max()
        pairs = np.argwhere(within > 0)
        for i, j in pairs[np.argsort(within[tuple(pairs.T)], kind="stable")]:
            share = within[i, j] / top
            look = {"lw": 0.8 + 3.2 * share, "color": VERMILION if share > 0.66 else BLUE, "alpha": 0.85}
            curve = {"arrowstyle": "-|>", "mutation_scale": 8 + 6 * share, "connectionstyle": "arc3,rad=0.16", "shrinkA": 7, "shrinkB": 7}
            ax.add_patch(FancyArrowPatch(place[i], place[j], **look, **curve))
        ax.scatter(place[:, 0], place[:, 1], s=70, facecolor=INK, edgecolor="none", zorder=3)
        caused = within.sum(0)
        for (x, y), name, s in zip(place, names, caused):
            label = printable(name, 16) + (f" ({s:.0f} s)" if s >= 0.5 else "")
            is_end = abs(x) < 0.1  # on top or below, where names of neighbours come close
            ha = "center" if is_end else "left" if x > 0 else "right"
            va = "center" if not is_end else "bottom" if y > 0 else "top"
            ax.text(1.13 * x, (1.17 if is_end else 1.13) * y, label, ha=ha, va=va, fontsize=8)
        ax.set(xlim=(-1.75, 1.75), ylim=(-1.35, 1.35), aspect="equal")
        ax.axis("off")

    caption = (
        f"An arrow leads from the robot that waited to the one it waited for; the thickest is {within.max():.1f} s. In brackets: how long "
        "others waited for a robot."
    )
    if np.count_nonzero(involved) > len(chosen):
        caption += f" The {len(chosen)} robots with the longest waits of {np.count_nonzero(involved)}."
    return draw(f"{tag}_waits", "Who waited for whom", caption, paint, size=(NARROW[0], 4.1))


def _lateness(record: RunRecord, tag: str) -> Chart | None:
    plan, arrived = record.plan, record.execution.arrived_s
    if plan is None or len(arrived) != plan.num_visits:
        return None
    driven = np.ones(plan.num_visits, np.bool_)
    driven[plan.first[:-1]] = False
    late = (arrived - plan.arrive_s)[driven & np.isfinite(arrived)].round(3)  # zero is zero
    if len(late) < 2:
        return None

    def paint(figure: Figure) -> None:
        ax = distribution(figure, late, "{:.1f} s")
        ax.set(xlabel="lateness (s)", ylabel="visits", xlim=around_zero(*ax.get_xlim()))

    return draw(
        f"{tag}_lateness", "Lateness of the visits", "Time at which each vertex was reached minus planned time; negative is early.", paint
    )


def _distances(record: RunRecord, times: FloatArray, tag: str) -> Chart | None:
    if record.execution.num_robots < 2:
        return None
    few = times[:: max(1, len(times) // 400)]
    x, y = _at(record, few)
    places = [np.stack([px, py], axis=1)[np.isfinite(px)] for px, py in zip(x, y)]
    values = np.array([least_distance_m(points) for points in places if len(points) > 1])
    if len(values) < 2:
        return None
    separation = float(record.fleet.separation_m)

    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        top = float(max(values.max(), separation)) * 1.05
        counts, edges = np.histogram(values, bins=np.linspace(0, top, 40))
        ax.stairs(counts, edges, fill=True, color=BLUE, alpha=0.85)
        ax.axvline(separation, color=VERMILION, lw=1.4, ls=(0, (4, 2)))
        ax.annotate(
            f"separation kept: {separation:.2f} m",
            (separation, 1),
            xycoords=("data", "axes fraction"),
            xytext=(4, -10),
            textcoords="offset points",
            fontsize=8,
        )
        ax.set(xlim=(0, top), xlabel="distance of the two nearest robots (m)", ylabel="moments")

    return draw(
        f"{tag}_clearance",
        "Distance of the nearest robots",
        "Least distance between two centres, at moments equally spaced over the run.",
        paint,
    )
