"""Metrics that users bring: of a file, `./mine.py:energy`, or of a package. What they do wrong is one line, and costs no result."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.errors import PlugInError, ScenarioError
from mrp_sumo.metrics.metric import Evidence, Metric, is_value, metric_of
from mrp_sumo.metrics.registry import BY_NAME
from mrp_sumo.plugins.face import place_of, shown
from mrp_sumo.plugins.registry import find, target
from mrp_sumo.plugins.source import Source, calling


def own_metric(name: str, beside: Path | None = None) -> tuple[Metric, Source]:
    """A user's metric, and where it is: a function of the evidence, with the decorator `metric` or without.

    It is named as `FILE.py:FUNCTION`, from a folder on (the current one by default), or as a package registers it. Raises ScenarioError
    for an unknown name, and for one that a bundled metric has, and PlugInError when it cannot be loaded, or is no function.
    """
    source, metric = find("metrics", name, beside), target("metrics", name, beside)
    if not isinstance(metric, Metric):
        if not callable(metric) or isinstance(metric, type):
            where = shown(source.path) if source.path else source.module
            raise PlugInError(f"{where}: {source.attribute} is {type(metric).__name__}, expected a function of the run's evidence")
        metric = metric_of(metric)
    if metric.name in BY_NAME and not source.ours:
        raise ScenarioError(f"metric '{name}': '{metric.name}' is the name of a bundled metric, choose another")
    return metric, source


def guarded(name: str, beside: Path | None, report: Callable[[PlugInError], None]) -> Metric:
    """A user's metric that never fails: where it raises, or returns what is no value, it is None, and the failure is reported."""
    metric, source = own_metric(name, beside)

    def value(evidence: Evidence) -> Any:
        try:
            with calling(source, metric.function):
                plain = metric(evidence)
        except PlugInError as error:
            report(error)
            return None
        plain = plain.tolist() if isinstance(plain, np.ndarray | np.generic) else plain
        if not is_value(plain):
            report(
                PlugInError(
                    f"{place_of(metric.function)}: {metric.name} is {plain!r:.60}, expected a finite number, true or false, a list, or None"
                )
            )
            return None
        return list(plain) if isinstance(plain, tuple) else plain

    return replace(metric, function=value)
