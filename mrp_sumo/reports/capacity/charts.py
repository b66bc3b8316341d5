"""The charts of a capacity study: throughput over the size of the fleet, service, what an order's time is spent on, flow over density, and
the floor with the places where robots wait.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.places import BETWEEN, places_of
from mrp_sumo.experiments.staging.set_up import SetUp
from mrp_sumo.experiments.statistics import Interval, t_mean, wilson
from mrp_sumo.maps.clearance import standing_walls
from mrp_sumo.reports.charts.chart import COLOURS, MARKERS, SOFT, Chart, draw, key, spread
from mrp_sumo.reports.pictures.map_picture import BLUE, GREEN, INK, MUTED, ORANGE, PURPLE, SKY, VERMILION
from mrp_sumo.sizing.answer import Answer
from mrp_sumo.sizing.points import Point
from mrp_sumo.sizing.reasons import PARTS, Reasons, cycle, diagram
from mrp_sumo.sizing.search import Bracket

WIDE, HALF, FLOOR = (9.6, 3.5), (4.7, 3.0), (4.7, 3.6)
PART_NAMES = {
    "empty_travel": ("to the first stop", SKY),
    "loaded_travel": ("to the stops after it", BLUE),
    "serving": ("served", GREEN),
    "queue": ("queueing at stations", ORANGE),
    "standing": ("standing for others", VERMILION),
}
SIZES = 6  # at most, in the diagram


def throughput(answer: Answer) -> Chart:
    """Orders an hour over the number of robots."""
    assert answer.limits is not None
    limits, points, demand = answer.limits, answer.points, answer.question.demand_per_h
    n = np.array([point.robots for point in points])
    means = [point.throughput for point in points]
    top = max(1.0, *(min(mean.high, 1.6 * mean.value) * 1.12 for mean in means))

    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        _with_limits(ax, n, means, BLUE, most=2 * top, label="orders done, with 95 % limits")
        first = means[0].value / n[0]
        ax.plot([0, n[-1]], [0, first * n[-1]], color=MUTED, ls=(0, (5, 3)), lw=1.2, label="if nobody were ever in the way")
        if demand:
            ax.axhline(demand, color=GREEN, lw=1.4, ls=(0, (1.2, 1.2)), label=f"demand, {demand:.0f} an hour")
        named: dict[int, list[tuple[str, str]]] = {}
        for bracket, name, colour in (
            (answer.served.smallest if answer.served else Bracket(), "enough for the demand", GREEN),
            (limits.knee, "knee", INK),
            (limits.peak, "peak", INK),
            (limits.collapse, "collapse", VERMILION),
        ):
            if bracket.estimate is None:
                continue
            if bracket.low is not None and bracket.high is not None and bracket.high > bracket.low:
                ax.axvspan(bracket.low, bracket.high, color=colour, alpha=0.08, lw=0)
            named.setdefault(bracket.estimate, []).append((name, colour))
        for robots, words in named.items():
            colour = words[-1][1]
            ax.axvline(robots, color=colour, lw=0.9)
            text = ", ".join(name for name, _ in words)
            ax.text(robots, top * 0.99, f" {text}", rotation=90, va="top", ha="right", fontsize=8, color=colour)
        ax.set(xlim=(0, n[-1] * 1.03), ylim=(0, top), xlabel="robots", ylabel="orders an hour")
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))
        key(figure, ax)

    caption = (
        "Orders done an hour when there is always work waiting; the warm-up is left out. Shaded: 95 % limits, and the intervals "
        "in which knee (95 % of the peak), peak and collapse (5 % below the peak) lie."
    )
    return draw("throughput", "Throughput by the size of the fleet", caption, paint, size=WIDE, wide=True)


def service(answer: Answer) -> Chart | None:
    """Time to done and punctuality of the fleets that were tried on the demand."""
    if answer.served is None or len(answer.served.curve.points) < 2:
        return None
    curve, target, within_s = answer.served.curve, answer.served.target, answer.served.within_s
    n = np.array(curve.sizes)
    points = [curve.points[k] for k in curve.sizes]

    def paint(figure: Figure) -> None:
        above, below = figure.subplots(2, 1, sharex=True)
        _with_limits(above, n, [t_mean(point.punctual(within_s)) for point in points], GREEN, most=1.0, scale=100)
        above.axhline(100 * target, color=MUTED, lw=1, ls=(0, (4, 3)))
        above.set(ylabel="on time (%)", ylim=(None, 101))
        times = [point.p95_s for point in points]
        _with_limits(below, n, times, PURPLE, most=3 * max(time.value for time in times), scale=1 / 60, marker="s")
        below.set(ylabel="95 % done in (min)", xlabel="robots", ylim=(0, None))
        below.xaxis.set_major_locator(MaxNLocator(integer=True))

    due = f"; without a due time, within {within_s / 60:.1f} min, three times what an order takes undisturbed" if within_s else ""
    what = f"Orders that are done when they are due{'' if points[0].has_due_times else due}"
    caption = f"{what}, and the time in which 95 % of them are done, at a demand of {answer.question.demand_per_h:.0f} an hour."
    return draw("service", "Service at the demand", caption, paint, size=HALF)


def success(answer: Answer) -> Chart:
    """One-shot draws whose plans are found and driven in time."""
    points = answer.points

    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        rates = [wilson(point.num_succeeded, len(point.records)) for point in points]
        n = np.array([point.robots for point in points])
        _with_limits(ax, n, rates, BLUE, most=1.0, scale=100)
        ax.axhline(100 * answer.question.on_time, color=MUTED, lw=1, ls=(0, (4, 3)))
        ax.set(xlabel="robots", ylabel="draws that succeed (%)", ylim=(-3, 103), xlim=(0, n[-1] * 1.03))
        ax.xaxis.set_major_locator(MaxNLocator(integer=True))

    caption = "Share of draws whose plan is found and driven in time, with 95 % Wilson limits, and the wanted share (dashed)."
    return draw("success", "Success by the size of the fleet", caption, paint, size=WIDE, wide=True)


def _with_limits(ax: Axes, n: IntArray, means: Sequence[Interval], colour: str, *, most: float, scale: float = 1.0, **look: Any) -> None:
    low, high = (scale * np.clip([getattr(mean, end) for mean in means], 0, most) for end in ("low", "high"))
    ax.fill_between(n, low, high, color=colour, alpha=0.16, lw=0)
    ax.plot(n, [scale * mean.value for mean in means], color=colour, **{"marker": "o", **look})


def parts(points: Sequence[Point]) -> Chart:
    """Parts of an order's time, from when a robot has it."""
    cycles = [cycle(point) for point in points]
    names = [name for name in PARTS if name in PART_NAMES]

    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        x, base = np.arange(len(points)), np.zeros(len(points))
        for name in names:
            label, colour = PART_NAMES[name]
            values = np.array([max(parts[name], 0.0) for parts in cycles])
            ax.bar(x, values, 0.72, base, color=colour, label=label, lw=0)
            base += values
        ax.set_xticks(x, [str(point.robots) for point in points])
        ax.grid(axis="x", visible=False)
        ax.set(xlabel="robots", ylabel="s an order")
        key(figure, ax)

    caption = "Mean time of an order from when a robot has it until it is done. What grows with the fleet is what the floor costs."
    return draw("cycle", "Where the time of an order goes", caption, paint, size=HALF)


def flow(points: Sequence[Point]) -> Chart:
    """The macroscopic fundamental diagram."""
    few = [points[i] for i in spread(len(points), SIZES)]

    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        for i, point in enumerate(few):
            k, q = diagram(point)
            ax.plot(
                100 * k, 60 * q, ls="", marker=MARKERS[i], ms=3.2, mew=0, alpha=0.55, color=COLOURS[i],
                label=f"{point.robots} robot{'s' * (point.robots > 1)}",
                rasterized=len(k) > 400,
            )  # fmt: skip
        ax.set(xlabel="robots in traffic on 100 m of lanes", ylabel="robots passing a minute", xlim=(0, None), ylim=(0, None))
        handles, labels = ax.get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower left", ncols=3, markerscale=2.2, columnspacing=1.2, handlelength=1.0)

    caption = (
        "Every minute of every run: how many robots are on the lanes, and how many pass. Where more on the floor pass less, it is full."
    )
    return draw("flow", "Flow over density", caption, paint, size=HALF)


def floor(setup: SetUp, reasons: Reasons) -> Chart:
    """The floor with the waiting of every vertex, and the places that bind."""
    graph, building = setup.problem.graph, setup.map.building
    walls = standing_walls(building, setup.map.nav.level_names) if building else None
    wait = np.zeros(graph.num_vertices)
    for vertex, seconds in reasons.vertices:
        wait[vertex] = seconds
    drawn = graph.xy if walls is None else np.concatenate([graph.xy, walls.reshape(-1, 2)])
    low, high = drawn.min(0) - 0.5, drawn.max(0) + 0.5
    tall = float(np.clip(FLOOR[0] * (high[1] - low[1]) / (high[0] - low[0]), 2.0, 4.2))
    spots = [(share, _where(setup, share.name)) for share in reasons.worst]

    def paint(figure: Figure) -> None:
        ax = figure.add_axes((0.01, 0.01, 0.98, 0.98))
        lanes = np.stack([graph.tail, graph.head], 1)[~graph.is_ride]  # rides are on no floor
        ax.add_collection(LineCollection(list(graph.xy[lanes]), colors=SOFT, linewidths=1.6, zorder=1))
        if walls is not None:
            ax.add_collection(LineCollection(list(walls), colors=MUTED, linewidths=0.8, zorder=2))
        hot = np.flatnonzero(wait > 0)[np.argsort(wait[wait > 0])]
        share = wait[hot] / wait.max() if len(hot) else wait[hot]
        x, y = graph.xy[hot].T
        ax.scatter(x, y, 6 + 110 * share, c=VERMILION, alpha=0.55, lw=0, zorder=3)
        for k, (_, xy) in enumerate(spots, 1):
            if xy is not None:
                ax.plot(*xy, marker="o", ms=15, mfc="none", mec=INK, mew=1.4, zorder=4)
                ax.annotate(
                    str(k), (xy[0], xy[1]), xytext=(10, 8), textcoords="offset points", fontsize=11, fontweight="bold", color=INK, zorder=5
                )
        ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        ax.axis("off")

    caption = (
        f"With {reasons.robots} robots: the larger the dot, the longer robots wait for others there. The numbers are those of the list."
    )
    return draw("floor", "Where robots wait", caption, paint, size=(FLOOR[0], tall))


def _where(setup: SetUp, name: str) -> FloatArray | None:
    """Where a place is: the middle of its vertices."""
    nav, graph = setup.map.nav, setup.problem.graph
    places = places_of(graph, nav)
    if name in places.name:
        middle: FloatArray = graph.xy[places.of_vertex == places.name.index(name)].mean(0)
        return middle
    ends = [nav.vertex_of_name[v] for v in name.split(BETWEEN) if v in nav.vertex_of_name]
    return nav.xy[ends].mean(0) if ends else None
