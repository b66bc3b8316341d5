"""Error bands of one run: the same run again with its quantities at other ends of their intervals, on the same orders and draws."""

import math
from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.error_bands import (
    Bounds,
    Moves,
    as_changes,
    between,
    corner,
    design,
    effects,
    most,
    quantities,
    rounded,
    spans,
    values_at,
)
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.staging.set_up import set_up
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.read import changed

if TYPE_CHECKING:
    from mrp_sumo.experiments.result import RunResult

MEASURES = {  # metrics that are told, of runs with orders and without: whether more is better, and what they are
    True: {"throughput_per_h": (True, "orders an hour"), "lead_time_mean_s": (False, "s from an order's release to its end")},
    False: {"driven_makespan_s": (False, "s until all are at their goals")},
}


def require_bounds(file: ScenarioFile, bounds: Bounds, maps: MapCache) -> None:
    """Refuse intervals that cannot be moved within. Raises MrpSumoError: one line."""
    of = quantities(file, bounds, ())
    for row in (design(len(of))[0], -design(len(of))[0]):
        set_up(changed(file, as_changes(values_at(of, row.tolist()))), maps)


def with_error_bands(result: "RunResult", bounds: Bounds, run: Callable[[ScenarioFile], "RunResult"]) -> "RunResult":
    """The result with how much its main figures move in runs of other scenarios, within intervals that the user gives and those known.

    Without figures it stays as it is.
    """
    measures = MEASURES[result.setup.scenario.tasks is not None]
    values = {name: float(value) for name in measures if (value := result.metrics.get(name)) is not None}
    if not values:
        return result
    file, made = result.setup.file, dict[tuple[Any, ...], dict[str, float]]()
    of = quantities(file, bounds, _stations(result))

    def figures(moves: Moves) -> dict[str, float]:
        if (key := tuple(sorted(moves.items(), key=str))) not in made:
            try:
                there = run(changed(file, as_changes(moves))).metrics
            except MrpSumoError:  # what a quantity makes impossible
                there = {}
            made[key] = {name: math.nan if there.get(name) is None else float(there[name]) for name in values}
        return made[key]

    settings = design(len(of))
    rows = [figures(values_at(of, row)) for row in settings.tolist()]
    figures_by_name, effects_by_name = {}, {}
    for name, value in values.items():
        by_quantity = effects(of, settings, np.zeros(len(settings)), np.array([row[name] for row in rows]))
        ends = [value, *(row[name] for row in rows)]  # what any of them shows may be
        ends += [figures(corner(by_quantity, better, measures[name][0]))[name] for better in (False, True)]
        low, high = min(ends_there := [end for end in ends if math.isfinite(end)]), max(ends_there)
        effects_by_name[name] = by_quantity
        figures_by_name[name] = {"value": value, "low": low, "high": high}
    main = max(values, key=lambda name: (figures_by_name[name]["high"] - figures_by_name[name]["low"]) / (values[name] or 1.0))
    said = ", ".join(f"{between(of['low'], of['high'], '.4g')} {measures[name][1]}" for name, of in figures_by_name.items())
    failed = sum(any(map(math.isnan, of_run.values())) for of_run in made.values())
    without = f" {failed} of {len(made)} runs have no such figures." if failed else ""
    document = {
        "sentence": f"{said} if your robots and stations are within {spans(of)}; {most(effects_by_name[main])}.{without}",
        "measures": {
            name: {**{key: rounded(end) for key, end in ends.items()}, "quantities": [effect.document for effect in effects_by_name[name]]}
            for name, ends in figures_by_name.items()
        },
        "runs": len(made),
    }
    return replace(result, error_bands=document)


def _stations(result: "RunResult") -> list[str]:
    """Groups and stations by how long robots were served there."""
    tasks, execution = result.setup.scenario.tasks, result.execution
    if tasks is None or execution is None or execution.stops is None:
        return []
    group_of = tasks.group_of
    served_s = defaultdict[str, float](float)
    stops = execution.stops
    for name, begin_s, end_s in zip(stops.station, stops.begin_s.tolist(), stops.end_s.tolist()):
        if name in tasks.stations or name in group_of or name in result.nav.vertex_of_name:
            served_s[group_of.get(name, name)] += end_s - begin_s
    return sorted((name for name in served_s if served_s[name] > 0), key=lambda name: (-served_s[name], name))
