#!/usr/bin/env python3
"""Drives work whose truth is known, and prints it beside closed formulas: loops, tandem stations, queues, machine repair, a closed network,
a dead end, shifts, a battery with a charger.

    tools/bench_truth.py [--only TEXT ...] [--drawn N] [--json]

`low` and `high` are what the formula, or a tiny simulator with the same arrivals, leaves open; `off` is how far outside the run is.
One thing after the other differs from the usual: engine, dispatcher, planner, step and budget; with --drawn N, in N runs of each
system all of them are drawn. `work` counts findings of the operations audit. The systems are those of tests/known_work.py.
"""

import argparse
import json
import sys
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

ROOT = Path(__file__).resolve().parents[1]
ENGINES, PLANNERS, STEPS_S, BUDGETS_S = ("kinematic", "sumo"), ("lacam", "prioritised", "pbs"), (0.1, 0.5, 1.0), (0.0, 1.0, 5.0)
DISPATCHERS = ("nearest", "token_passing", "tpts", "regret", "central", "hungarian", "min_cost_flow")
WIDTH = {
    "system": 32,
    "engine": 9,
    "dispatcher": 13,
    "planner": 11,
    "step_s": 6,
    "budget_s": 8,
    "driven": 9,
    "low": 9,
    "high": 9,
    "off_%": 7,
}
WIDTH |= {"status": 12, "work": 4}


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", action="append", default=[], metavar="TEXT", help="systems with this in their names")
    parser.add_argument("--drawn", type=int, default=0, metavar="N", help="runs of each system with everything drawn")
    parser.add_argument("--json", action="store_true", help="a JSON line a run")
    options = parser.parse_args()
    sys.path[:0] = [str(ROOT / "tests"), str(ROOT)]
    from floors import driven
    from known_work import Variation, systems

    choices = {"engine": ENGINES, "dispatcher": DISPATCHERS, "planner": PLANNERS, "step_length_s": STEPS_S, "budget_s": BUDGETS_S}
    variations = list(dict.fromkeys([Variation(), *(Variation(**{key: value}) for key, values in choices.items() for value in values)]))
    chance = Random(0)
    if not options.json:
        print("  ".join(name.ljust(width) for name, width in WIDTH.items()))
    within = total = 0
    for name, system in systems().items():
        drawn = [Variation(**{key: chance.choice(values) for key, values in choices.items()}) for _ in range(options.drawn)]
        for v in (drawn or variations) if not options.only or any(text in name for text in options.only) else ():
            with TemporaryDirectory(prefix="mrp_sumo_truth_") as place:
                result = driven(system.made(Path(place), v))
                value, truth, off = system.measured(result), system.truth(v, result), system.off(result, v)
            row = dict(zip(WIDTH, (name, v.engine, v.dispatcher, v.planner, v.step_length_s, v.budget_s, value, truth.low, truth.high)))
            row |= {"off_%": 100 * off, "status": result.status, "work": len(result.operations_audit["findings"])}
            within, total = within + (off <= system.exact), total + 1
            shown = (f"{x:.2f}" if isinstance(x, float) else str(x) for x in row.values())
            print(json.dumps(row) if options.json else "  ".join(x.ljust(w) for x, w in zip(shown, WIDTH.values())), flush=True)
    if not options.json:
        print(f"{within} of {total} within 2 % of the truth")
    return 0


if __name__ == "__main__":
    sys.exit(main())
