"""Drives work whose truth is known, and prints it beside closed formulas: loops, tandem stations, queues, machine repair, a closed network,
a dead end, shifts, a battery with a charger.

    tools/bench_truth.py [--only TEXT ...] [--drawn N] [--json]

`low` and `high` are what the formula, or a tiny simulator with the same arrivals, leaves open; `off` is how far outside the run is.
One thing after the other differs from the usual: engine, dispatcher, planner, step and budget; with --drawn N, in N runs of each
system all of them are drawn. `work` counts findings of the operations audit. The systems are those of tests/known_work.py.
"""

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import bench

ROOT = Path(__file__).resolve().parents[1]
ENGINES, PLANNERS, STEPS_S, BUDGETS_S = ("kinematic", "sumo"), ("lacam", "prioritised", "pbs"), (0.1, 0.5, 1.0), (0.0, 1.0, 5.0)
DISPATCHERS = ("nearest", "token_passing", "tpts", "regret", "central", "hungarian", "min_cost_flow")
COLUMNS = ("system", "engine", "dispatcher", "planner", "step_s", "budget_s", "driven", "low", "high")


def arguments(parser: argparse.ArgumentParser) -> None:
    """Systems."""
    parser.add_argument("--only", action="append", default=[], metavar="TEXT", help="systems with this in their names")
    parser.add_argument("--drawn", type=int, default=0, metavar="N", help="runs of each system with everything drawn")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """A row a run."""
    sys.path[:0] = [str(ROOT / "tests"), str(ROOT)]
    from floors import driven
    from known_work import Variation, systems

    choices = {"engine": ENGINES, "dispatcher": DISPATCHERS, "planner": PLANNERS, "step_length_s": STEPS_S, "budget_s": BUDGETS_S}
    variations = list(dict.fromkeys([Variation(), *(Variation(**{key: value}) for key, values in choices.items() for value in values)]))
    chance = Random(0)
    for name, system in systems().items():
        drawn = [Variation(**{key: chance.choice(values) for key, values in choices.items()}) for _ in range(options.drawn)]
        for v in (drawn or variations) if not options.only or any(text in name for text in options.only) else ():
            with TemporaryDirectory(prefix="mrp_sumo_truth_") as place:
                result = driven(system.made(Path(place), v))
                value, truth, off = system.measured(result), system.truth(v, result), system.off(result, v)
            row = dict(zip(COLUMNS, (name, v.engine, v.dispatcher, v.planner, v.step_length_s, v.budget_s, value, truth.low, truth.high)))
            row |= {"off_%": 100 * off, "status": result.status, "work": len(result.operations_audit["findings"])}
            yield row | {"within": bool(off <= system.exact)}


def summary(rows: list[bench.Row], options: argparse.Namespace) -> str:
    """A sentence."""
    return f"{sum(row['within'] for row in rows)} of {len(rows)} within 2 % of the truth"


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
