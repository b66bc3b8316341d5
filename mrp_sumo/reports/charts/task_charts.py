"""The charts of work that does not end: tasks done an hour over time, tasks that are not done, and how long they took."""

import numpy as np
from matplotlib.figure import Figure

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.task import TaskLog, some_tasks
from mrp_sumo.reports.charts.chart import NARROW, Chart, distribution, draw, key
from mrp_sumo.reports.pictures.map_picture import BLUE, INK, MUTED, ORANGE, VERMILION

HOUR_S = 3600.0
MOST_BARS, TASKS_A_BAR = 48, 6  # of throughput over time
THROUGHPUT, OPEN, LEAD_TIME = "throughput", "open_tasks", "lead_time"


def task_charts(tasks: TaskLog, end_s: float, warm_up_s: float | None, tag: str) -> list[Chart]:
    """Charts of the orders among the tasks of a run; the warm-up is what metrics leave out, None where nobody knows."""
    orders = some_tasks(tasks, tasks.is_order)
    if not len(orders.name) or end_s <= 0:
        return []
    charts = [_throughput(orders, end_s, warm_up_s, tag), _open(orders, end_s, tag), _service(orders, tag)]
    return [chart for chart in charts if chart is not None]


def _throughput(orders: TaskLog, end_s: float, warm_up_s: float | None, tag: str) -> Chart | None:
    done_s = orders.done_s[np.isfinite(orders.done_s) & (orders.done_s <= end_s)]
    if len(done_s) < 2:
        return None
    bars = int(np.clip(len(done_s) // TASKS_A_BAR, 2, MOST_BARS))
    counts, edges = np.histogram(done_s, bins=np.linspace(0.0, end_s, bars + 1))
    cut_s = warm_up_s or 0.0
    mean = HOUR_S * float((done_s > cut_s).sum()) / (end_s - cut_s) if end_s > cut_s else 0.0

    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        scale, unit = _scale(end_s)
        ax.stairs(counts * HOUR_S / np.diff(edges), edges / scale, fill=True, color=BLUE, alpha=0.85)
        if cut_s:
            ax.axvspan(0, cut_s / scale, color=MUTED, alpha=0.22, lw=0, label="warm-up")
        ax.axhline(mean, color=INK, lw=1.3, ls=(0, (5, 2)), label="mean afterwards" if cut_s else "mean")
        key(figure, ax)
        ax.set(xlim=(0, end_s / scale), ylim=(0, None), xlabel=f"time ({unit})", ylabel="orders done an hour")

    each_s = end_s / bars
    caption = f"By the hour, in {bars} parts of {each_s:.0f} s each. Dashed: the mean{' after the warm-up' * bool(cut_s)}, {mean:.0f}."
    return draw(f"{tag}_{THROUGHPUT}", "Orders done over time", caption, paint)


def _open(orders: TaskLog, end_s: float, tag: str) -> Chart | None:
    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        scale, unit = _scale(end_s)
        for until_s, name, colour in ((orders.done_s, "not done", BLUE), (orders.assigned_s, "of these, without a robot", ORANGE)):
            at_s, number = _known(orders.released_s, until_s, end_s)
            ax.step(at_s / scale, number, where="post", color=colour, label=name)
        key(figure, ax)
        ax.set(xlim=(0, end_s / scale), ylim=(0, None), xlabel=f"time ({unit})", ylabel="orders")

    left = int((~(orders.done_s <= end_s)).sum())
    return draw(f"{tag}_{OPEN}", "Orders that wait", f"Released and not done by then; {left} at the end.", paint)


def _service(orders: TaskLog, tag: str) -> Chart | None:
    took_s = orders.lead_time_s[np.isfinite(orders.lead_time_s)]
    if len(took_s) < 2:
        return None

    def paint(figure: Figure) -> None:
        scale, unit = _scale(float(took_s.max()))
        ax = distribution(figure, took_s / scale, f"{{:.3g}} {unit}", VERMILION)
        ax.set(xlim=(0, None), xlabel=f"from release to done ({unit})", ylabel="orders")

    return draw(f"{tag}_{LEAD_TIME}", "Lead time", f"Of the {len(took_s)} orders that were done.", paint, size=NARROW)


def _known(from_s: FloatArray, until_s: FloatArray, end_s: float) -> tuple[FloatArray, FloatArray]:
    """Times, and how many have begun and not ended from each on; NaN: not in this run."""
    ends = until_s[until_s <= end_s]  # NaN is not
    at_s = np.concatenate([[0.0], from_s, ends])
    change = np.concatenate([[0.0], np.ones(len(from_s)), -np.ones(len(ends))])
    order = np.argsort(at_s, kind="stable")
    return np.append(at_s[order], end_s), np.append(number := np.cumsum(change[order]), number[-1])


def _scale(span_s: float) -> tuple[float, str]:
    """Seconds in a unit that suits a span, and its name."""
    return (HOUR_S, "h") if span_s > 3 * HOUR_S else (60.0, "min") if span_s > 600 else (1.0, "s")
