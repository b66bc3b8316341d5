"""Two result tables compared run by run: the same scenarios and seeds, under two versions, settings or machines.

Refuses tables that share no run. A difference counts when it is worse, larger than the tolerance, and
unlikely by chance, with the p-values of all metrics adjusted together; in strict mode any run that got
worse counts. The table of metrics has what is worse; a column of which neither more nor less is better
is compared, but never worse.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mrp_sumo.errors import BatchError, nearest
from mrp_sumo.experiments.statistics import PairedRates, PairedValues, holm, mcnemar, wilcoxon
from mrp_sumo.metrics.metric import YES_NO, Metric, Sense
from mrp_sumo.metrics.registry import BY_NAME

if TYPE_CHECKING:
    import pandas

DEFAULT_METRICS = ("success", "plan_success", "soc_steps", "makespan_s", "execution_time_s")
COLUMNS = {  # what is better of columns that are no metrics
    "success": Sense.MORE,
    **dict.fromkeys(("attempts", "run_wall_s", "run_cpu_s", "peak_memory_mb"), Sense.LESS),
}
WORSE_BY = {Sense.MORE: -1, Sense.LESS: 1, Sense.NONE: 0}  # the sign of a change for the worse


@dataclass(frozen=True)
class Difference:
    """Change of a metric between two batches."""

    metric: str
    paired: PairedRates | PairedValues
    p_value: float  # adjusted for the number of metrics
    num_worse: int  # runs that got worse by more than the tolerance
    worse: bool  # so much that the comparison fails


@dataclass(frozen=True)
class Comparison:
    """Two tables, compared."""

    num_pairs: int
    num_only_first: int
    num_only_second: int
    differences: tuple[Difference, ...]

    @property
    def worse(self) -> bool:
        return any(d.worse for d in self.differences)


def compare(
    first: "pandas.DataFrame",
    second: "pandas.DataFrame",
    metrics: Sequence[str] = DEFAULT_METRICS,
    *,
    alpha: float = 0.05,
    tolerance: float = 0.01,
    strict: bool = False,
    own: Sequence[Metric] = (),
) -> Comparison:
    """Compare two result tables, as `mrp_sumo.load_results` gives them, on the runs they share; the second is judged.

    `metrics` are columns of yes-or-no or numbers; senses of those that are not bundled come from `own`. `alpha` is the chance of a false
    alarm that is accepted, over all metrics, `tolerance` the relative worsening of a mean that does not matter; with `strict` every run
    that got worse counts instead. Raises BatchError when they share no run, and for a metric that a table does not have.
    """
    for metric in metrics:
        for frame in (first, second):
            if metric not in frame.columns and metric not in DEFAULT_METRICS:
                raise BatchError(f"no metric '{metric}'{nearest(metric, frame.columns)}")
    if not all("scenario_key" in frame.columns for frame in (first, second)):
        raise BatchError("no column 'scenario_key', which says the runs that the two have in common")
    a, b = first.set_index("scenario_key"), second.set_index("scenario_key")
    shared = a.index.intersection(b.index, sort=False)
    if not len(shared):
        raise BatchError("the two have no run in common: no equal scenario and seed")
    a_rows, b_rows = a.loc[shared], b.loc[shared]
    there = [metric for metric in metrics if metric in a.columns and metric in b.columns]
    of = {**BY_NAME, **{metric.name: metric for metric in own}}
    sign = {name: WORSE_BY[of[name].sense if name in of else COLUMNS.get(name, Sense.NONE)] for name in there}
    flags = {name for name in there if name == "success" or (name in of and of[name].unit == YES_NO)}
    tests = [(name, *pair) for name in there if (pair := _paired(a_rows[name], b_rows[name], name, sign=sign[name], is_flag=name in flags))]
    adjusted = holm([paired.p_value for _, paired, _ in tests])
    differences = []
    for (metric, paired, worse_by), p_value in zip(tests, adjusted, strict=True):
        allowed = 0.0 if isinstance(paired, PairedRates) else tolerance
        overall = sign[metric] * (paired.second - paired.first) > allowed * abs(paired.first)
        num_worse = int(np.count_nonzero(worse_by > allowed))
        failed = num_worse > 0 if strict else overall and p_value < alpha
        differences.append(Difference(metric, paired, p_value, num_worse, bool(failed)))
    return Comparison(len(shared), len(a) - len(shared), len(b) - len(shared), tuple(differences))


def _paired(first: Any, second: Any, metric: str, *, sign: int, is_flag: bool) -> tuple[PairedRates | PairedValues, Any] | None:
    """The paired test, and [N] by how much each run got worse, relatively; None where there are no values."""
    import pandas as pd

    try:
        if is_flag or pd.api.types.is_bool_dtype(first) or pd.api.types.is_bool_dtype(second):
            a, b = (column.astype("boolean").fillna(False).to_numpy(np.bool_) for column in (first, second))
            return mcnemar(a, b), sign * (b.astype(np.int64) - a)
        x, y = (pd.to_numeric(column).to_numpy(np.float64, na_value=np.nan) for column in (first, second))
    except (TypeError, ValueError):
        raise BatchError(f"metric '{metric}' is neither a number nor yes or no") from None
    paired = wilcoxon(x, y)
    if not paired.count:
        return None
    with np.errstate(divide="ignore", invalid="ignore"):
        worse_by = np.where((x == y) | (sign == 0), 0.0, sign * (y - x) / np.abs(x))
    return paired, np.nan_to_num(worse_by, nan=0.0, posinf=np.inf, neginf=-np.inf)
