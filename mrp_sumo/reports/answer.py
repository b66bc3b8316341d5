"""The answer to a study's question in two sentences: who is ahead, by how much, within which limits, and on which maps."""

import numpy as np
import pandas as pd

from mrp_sumo.errors import listed
from mrp_sumo.experiments.statistics import Interval, bootstrap_mean, mcnemar, wilcoxon
from mrp_sumo.reports.study import ReportedRuns

MEASURES = (("driven_flowtime_s", "flowtime as driven"), ("execution_time_s", "execution time"))  # of runs that were driven
PLANNED = (("soc_steps", "sum of costs"), ("planning_time_s", "planning time"))
SURE = 0.05


def answer(study: ReportedRuns) -> str:
    """Two sentences about the series of a study, on the same instances; '' where there is nothing to compare.

    The first is about success, of the series with most of it and the next. The second is about the first measure that both have, of
    the series with most success and the one that is least behind it, or most ahead, where both succeed. What neither limits nor
    test decide is called undecided.
    """
    if len(study.series) < 2 or not study.is_planned:
        return ""
    outcome, of = study.outcome, study.by_instance
    everywhere = [rows.index for rows in of.values()]
    shared = everywhere[0]
    for index in everywhere[1:]:
        shared = shared.intersection(index)
    if not len(shared):
        return ""
    best, *others = sorted(study.series, key=lambda name: -float(of[name].loc[shared, outcome].mean()))
    one, two = (of[name].loc[shared, outcome].to_numpy(np.bool_) for name in (best, others[0]))
    rate, where = mcnemar(two, one), f"{len(shared)} instances ({listed(study.maps, 4)})"
    word = "succeeds" if study.is_executed else "finds valid plans"
    if (by := rate.difference).value == 0:
        word = "succeed" if study.is_executed else "find valid plans"
        first = f"{best} and {others[0]} {word} equally often, in {100 * rate.second:.0f} % of {where}."
    else:
        limits = f"{100 * by.value:.0f} points ({100 * by.low:.0f} to {100 * by.high:.0f})"
        sure = "" if by.low > 0 else ", which decides nothing yet"
        first = f"{best} {word} most often, in {100 * rate.second:.0f} % of {where}: {limits} more than {others[0]}{sure}."
    return f"{first} {_about_values(study, best, others)}".strip()


def _about_values(study: ReportedRuns, best: str, others: list[str]) -> str:
    """The second sentence."""
    of = study.by_instance
    for column, what in MEASURES if study.is_executed else PLANNED:
        compared = {name: there for name in others if (there := _beside(of[best], of[name], study.outcome, column)) is not None}
        if not compared:
            continue
        name, (ratio, p_value) = min(compared.items(), key=lambda item: item[1][0].value)
        both = f"Where {best} and {name} both succeed ({ratio.count} instances)"
        if p_value > SURE or ratio.low <= 0 <= ratio.high:
            by = f"{100 * ratio.value:+.1f} % ({100 * ratio.low:+.1f} to {100 * ratio.high:+.1f})"
            return f"{both}, it is undecided who has the lower {what}: that of {name} differs from that of {best} by {by}."
        if ratio.value > 0:
            return f"{both}, {best} has the lower {what}: that of {name}, the nearest, is {_percent(ratio)} higher."
        return f"{both}, {name} has the lower {what}, by {_percent(ratio)}."
    return ""


def _beside(one: pd.DataFrame, two: pd.DataFrame, outcome: str, column: str) -> tuple[Interval, float] | None:
    """By how much the second is above the first, as a share, on instances in which both succeed, and Wilcoxon's p; None where unknown."""
    if column not in one:
        return None
    shared = one.index.intersection(two.index)
    one, two = one.loc[shared], two.loc[shared]
    both = (one[outcome] & two[outcome]).to_numpy(np.bool_)
    a, b = (frame.loc[both, column].to_numpy(np.float64, na_value=np.nan) for frame in (one, two))
    there = np.isfinite(a) & np.isfinite(b) & (a > 0)
    if there.sum() < 2:
        return None
    return bootstrap_mean(b[there] / a[there] - 1), wilcoxon(a[there], b[there]).p_value


def _percent(ratio: Interval) -> str:
    """A share that is surely above or below 0, without its sign."""
    low, high = sorted((abs(ratio.low), abs(ratio.high)))
    return f"{100 * abs(ratio.value):.1f} % ({100 * low:.1f} to {100 * high:.1f})"
