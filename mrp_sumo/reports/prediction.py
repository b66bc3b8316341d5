"""The page of a prediction: the answer in a sentence, figures of log and simulation side by side, their distributions, what it stands on.

One HTML file without scripts that needs no network, in light and dark; beside it both as run folders, and a replay of both.
"""

import html
import json
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mrp_sumo import __version__
from mrp_sumo.calibration.prediction import NEAR_M, ComparedFigure, Prediction
from mrp_sumo.core.graph import FloatArray
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.files.writing import write_text
from mrp_sumo.io.run_reader import load_run
from mrp_sumo.reports.charts.chart import Chart, draw, key
from mrp_sumo.reports.page import chart_row, document, gap_list, grid, rows_of
from mrp_sumo.reports.pictures.map_picture import BLUE, SKY, VERMILION
from mrp_sumo.reports.replay.beside import page_of_two
from mrp_sumo.reports.replay.page import write_page

PAGE, DOCUMENT, REPLAY = "prediction.html", "prediction.json", "replay.html"
BELOW = "The bands of these pictures are what {} runs have from the least to the most."
NEAR = f"Within {NEAR_M:g} m of the place of the next service."


def write_prediction(result: Prediction, name: str, folder: Path, maps: MapCache) -> None:
    """Write page, document, both runs and the replay of both into a folder."""
    result.log_run.write(folder / "log", maps)
    result.run.write(folder / "simulation", maps)
    write_page(page_of_two(load_run(folder / "log"), load_run(folder / "simulation")), folder / REPLAY)
    write_text(folder / DOCUMENT, json.dumps(result.document, indent=2) + "\n")
    write_text(folder / PAGE, prediction_page(result, name))


def sentence_of(result: Prediction) -> str:
    """The comparison in a sentence."""
    middle, throughput = result.figures[0], next(each for each in result.figures if each.name == "throughput_per_h")
    missed = [each.label for each in result.figures if not each.holds]
    bands = "all bands hold" if not missed else f"outside of their bands: {'; '.join(missed)}"
    return (
        f"Half of the orders took {figure_text(middle.logged)} s or less, {figure_text(middle.predicted)} s were predicted"
        f"{_off(middle)}; {figure_text(throughput.logged)} an hour were done, {figure_text(throughput.predicted)} predicted"
        f"{_off(throughput)}; {bands}."
    )


def _off(each: ComparedFigure) -> str:
    return f" ({100 * each.error:+.1f} %)" if math.isfinite(each.error) else ""


def figure_text(value: float) -> str:
    """A figure for people."""
    return "not done" if value == math.inf else "" if math.isnan(value) else f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}"


def prediction_page(result: Prediction, name: str) -> str:
    held, logged, simulated = result.held, result.logged, result.simulated
    leads, waits = ([getattr(each, of) for each in (logged, *simulated)] for of in ("lead_time_s", "station_wait_s"))
    charts = [
        _shares("lead_time", "Lead time", "from release to done (s)", "orders", leads, BELOW.format(len(simulated))),
        _shares("station_wait", "Waits at stations", "stood before service (s)", "services", waits, NEAR),
        _done(held.span_s, [each.done_s for each in (logged, *simulated)]),
    ]
    body = [
        f'<header><p class="question">Does the simulation fit the log? {html.escape(name)}</p>'
        f"<h1>{html.escape(sentence_of(result))}</h1></header>",
        "<main>",
        gap_list(result.notes),
        "<h2>Side by side</h2>",
        _table(result),
        f'<p><a href="{REPLAY}">Replay of log and simulation</a> on one clock, from {held.cut_s - held.begin_s:.0f} s of the log on: '
        "<code>mrp-sumo replay log simulation</code>.</p>",
        *chart_row(charts),
        '<h2 class="second">What it stands on</h2>',
        *_calibrated(result),
        *_drift(result),
        "</main>",
        f"<footer><p>{html.escape(_small_print(result))}</p></footer>",
    ]
    return document(f"{name}: log and simulation", "mrp-sumo predict", body, Path(__file__).with_name("capacity") / "page.css")


def _table(result: Prediction) -> str:
    rows = [
        (
            html.escape(each.label),
            figure_text(each.logged),
            figure_text(each.predicted),
            f"{100 * each.error:+.1f} %" if math.isfinite(each.error) else "",
            f"{figure_text(each.low)} to {figure_text(each.high)}",
            each.unit,
            "holds" if each.holds else "does not hold",
        )
        for each in result.figures
    ]
    return grid(("", "log", "predicted", "error", "90 % band", "unit", ""), rows_of(rows, range(1, 5)), range(1, 5))


def _shares(name: str, title: str, what: str, of: str, values: Sequence[FloatArray], caption: str) -> Chart:
    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        share = np.linspace(0, 1, 201)
        logged, *of_runs = (_quantiles(each, share) for each in values)
        runs = np.stack(of_runs)
        ax.fill_betweenx(100 * share, runs.min(0), runs.max(0), color=SKY, alpha=0.45, lw=0, label="runs")
        ax.plot(np.median(runs, 0), 100 * share, color=BLUE, ls=(0, (5, 1.6)), label="predicted")
        ax.plot(logged, 100 * share, color=VERMILION, label="log")
        key(figure, ax)
        ax.set(xlim=(0, None), ylim=(0, 100), xlabel=what, ylabel=f"{of} below (%)")

    return draw(name, title, caption, paint)


def _quantiles(values: FloatArray, share: FloatArray) -> FloatArray:
    """Quantiles, NaN where they are not finite."""
    if not len(values):
        return np.full(len(share), np.nan)
    ordered = np.sort(values)
    there: FloatArray = ordered[np.minimum((share * len(ordered)).astype(int), len(ordered) - 1)]
    return np.where(np.isfinite(there), there, np.nan)


def _done(span_s: float, done_s: Sequence[FloatArray]) -> Chart:
    def paint(figure: Figure) -> None:
        ax = figure.add_subplot()
        t = np.linspace(0, span_s, 201)
        logged, *of_runs = (np.searchsorted(each, t, side="right") for each in done_s)
        runs = np.stack(of_runs)
        ax.fill_between(t / 60, runs.min(0), runs.max(0), color=SKY, alpha=0.45, lw=0, label="runs")
        ax.plot(t / 60, np.median(runs, 0), color=BLUE, ls=(0, (5, 1.6)), label="predicted")
        ax.plot(t / 60, logged, color=VERMILION, label="log")
        key(figure, ax)
        ax.set(xlim=(0, t[-1] / 60), ylim=(0, None), xlabel="time (min)", ylabel="orders done")

    return draw("done", "Orders done", "Since the cut.", paint)


def _calibrated(result: Prediction) -> list[str]:
    lines = []
    for path, one in zip(result.files, result.calibrations):
        rows = [
            (
                html.escape(each.name),
                f"{each.value:.4g}",
                f"{each.low:.4g} to {each.high:.4g}",
                each.symbol,
                html.escape(each.basis),
            )
            for each in one.quantities.values()
        ]
        lines.append(f"<h3>{html.escape(path.stem)}</h3>")
        lines.append(grid(("", "calibrated", "90 % interval", "unit", "from"), rows_of(rows, (1, 2)), (1, 2)))
    return lines


def _drift(result: Prediction) -> list[str]:
    rows = [(html.escape(name), html.escape(both)) for name, both in result.drift.items()]
    if not rows:
        return []
    table = grid(("", "beside"), rows_of(rows), ())
    return ['<h2 class="second">Drift</h2>', "<p>What the later part of the log no longer fits:</p>", table]


def _small_print(result: Prediction) -> str:
    held = result.held
    return (
        f"{held.log.source} ({held.log.kind}): {len(held.vehicles)} vehicles, {len(result.logged.lead_time_s)} orders compared, "
        f"{held.cut_s - held.begin_s:.0f} s calibrated on, {held.span_s:.0f} s predicted; {len(result.simulated)} runs, each with its own "
        f"seed and figures drawn from their intervals. mrp_sumo {__version__}"
    )
