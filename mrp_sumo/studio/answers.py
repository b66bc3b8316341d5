"""Answers while they come: the points of a capacity study, two variants seed by seed, and where robots of a run waited."""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.errors import BatchError, MrpSumoError
from mrp_sumo.experiments.statistics import paired_t
from mrp_sumo.io.record import BLOCKED, WAITING
from mrp_sumo.io.results import BatchRecord, read_record, record_files
from mrp_sumo.io.run_reader import RunFolder
from mrp_sumo.reports.pictures.view import view_record, view_states

MEASURES = (  # of variants: metric, words, whether more is better
    ("throughput_per_h", "orders done an hour", True),
    ("lead_time_mean_s", "mean time from release to done, s", False),
    ("lead_time_p95_s", "95th percentile of that time, s", False),
)
BIN_M = 0.5  # of places where robots waited


def curve(folder: Path) -> dict[str, Any]:
    """Orders done an hour by size of fleet, run by run, of the records that a study has so far: of runs in which orders always wait."""
    points = []
    for record in _records(folder):
        scenario, observed = record["scenario"], record.get("observed")
        try:
            if not observed or scenario["tasks"]["open"] is None:
                continue
            done, horizon_s = sum(t is not None for t in observed["done_s"]), float(scenario["execution"]["time_limit_s"])
        except (KeyError, TypeError, ValueError):
            continue  # of a batch that is no study
        robots = scenario["robots"]["count"] or sum(group["count"] or 0 for group in scenario["robots"].get("fleet") or ())
        points.append({"robots": robots, "per_h": round(3600 * done / horizon_s, 2), "status": record["status"]})
    return {"points": points}


def paired(folder: Path, first_map: str) -> dict[str, Any]:
    """Differences of another map from the first, a file's name, on the same seeds, with 95 % limits."""
    by_map: dict[str, dict[int, dict[str, Any]]] = {}
    for record in _records(folder):
        scenario = record["scenario"]
        by_map.setdefault(str((scenario.get("map") or {}).get("file")), {})[scenario.get("seed")] = record["metrics"]
    names = sorted(by_map, key=lambda name: Path(name).name != Path(first_map).name)
    if len(names) < 2:
        return {"maps": [Path(name).name for name in names], "rows": [], "runs": sum(map(len, by_map.values()))}
    first, second = (by_map[name] for name in names[:2])
    seeds = sorted(first.keys() & second.keys())
    rows = []
    for metric, words, is_more_better in MEASURES:
        a, b = ([_number(runs[seed].get(metric)) for seed in seeds] for runs in (first, second))
        means = paired_t(a, b)
        limits = [means.difference.value, means.difference.low, means.difference.high]
        rows.append(
            {
                "measure": words,
                "more_is_better": is_more_better,
                "first": _finite(means.first),
                "second": _finite(means.second),
                "difference": [_finite(value) for value in limits],
                "pairs": means.count,
            }
        )
    return {"maps": [Path(name).name for name in names[:2]], "rows": rows, "runs": len(first) + len(second)}


def waits(run: RunFolder) -> tuple[FloatArray, FloatArray]:
    """Places [N, 2] m in the run's map where robots waited or were blocked, each the mean of those close by, and [N] s for how long.

    Raises MrpSumoError for a run that was not driven.
    """
    record = view_record(run)
    execution = record.execution
    if not execution.x_m.size:
        raise MrpSumoError("the run was not driven")
    states = view_states(execution)
    still = (states == WAITING) | (states == BLOCKED)
    period_s = float(np.diff(execution.t_s).mean()) if len(execution.t_s) > 1 else 1.0
    xy = np.column_stack((execution.x_m[still], execution.y_m[still]))
    _, bin_of, count = np.unique(np.rint(xy / BIN_M).astype(np.int64), axis=0, return_inverse=True, return_counts=True)
    middle = np.column_stack([np.bincount(bin_of.ravel(), axis) for axis in xy.T]) / count[:, None]
    return middle, (count * period_s).astype(np.float64)


def _records(folder: Path) -> Iterator[BatchRecord]:
    for path, _ in record_files(folder):
        try:
            yield read_record(Path(path))
        except BatchError:
            continue  # which is being written


def _number(value: object) -> float:
    return float(value) if isinstance(value, int | float) else math.nan


def _finite(value: float) -> float | None:
    return round(value, 3) if math.isfinite(value) else None
