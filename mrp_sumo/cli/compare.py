"""Compare two result folders run by run: the same scenarios and seeds, A before and B after.

Exit code 0 when B is no worse, 1 when it is, 2 for bad input. B is worse when a metric got worse by more than
the tolerance and that is unlikely by chance; with --strict, when any single run got worse.
"""

import argparse
from pathlib import Path

from mrp_sumo.cli.option_rules import require_least
from mrp_sumo.cli.printing import plain_table, print_table, say, say_json, warn
from mrp_sumo.cli.result_folder import batch_folder


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo compare`."""
    parser.add_argument("first", metavar="A", type=batch_folder, help="folder of a batch, or a results.parquet")
    parser.add_argument("second", metavar="B", type=batch_folder, help="the one that is judged")
    parser.add_argument(
        "--metric",
        action="append",
        metavar="NAME",
        help="compare this column, or FILE.py:FUNCTION, a metric of your own; may be given several times",
    )
    parser.add_argument("--alpha", type=float, default=0.05, metavar="P", help="accepted chance of a false alarm (default: 0.05)")
    parser.add_argument(
        "--tolerance", type=float, default=1.0, metavar="PERCENT", help="worsening of a mean that does not matter (default: 1)"
    )
    parser.add_argument("--strict", action="store_true", help="count every run that got worse by more than the tolerance")
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(options: argparse.Namespace) -> int:
    """Print the differences."""
    from dataclasses import asdict

    from mrp_sumo.cli.scenario_choice import trust_named
    from mrp_sumo.errors import BatchError
    from mrp_sumo.experiments.compare import DEFAULT_METRICS, compare
    from mrp_sumo.io.results import load_results
    from mrp_sumo.metrics.own import own_metric
    from mrp_sumo.plugins.registry import names
    from mrp_sumo.plugins.source import place_in_file

    if not 0 < options.alpha < 1:
        raise BatchError(f"--alpha: found {options.alpha:g}, expected a number between 0 and 1")
    require_least("--tolerance", options.tolerance, 0)
    a, b = (load_results(Path(path), warn) for path in (options.first, options.second))
    for name in options.metric or ():
        trust_named(name)
    own = {name: own_metric(name)[0] for name in options.metric or () if place_in_file(name) or name in names("metrics")}
    metrics = [own[name].name if name in own else name for name in options.metric] if options.metric else DEFAULT_METRICS
    tolerance = options.tolerance / 100
    comparison = compare(a, b, metrics, alpha=options.alpha, tolerance=tolerance, strict=options.strict, own=tuple(own.values()))
    if options.json:
        say_json({**asdict(comparison), "worse": comparison.worse}, indent=2)
        return int(comparison.worse)
    from mrp_sumo.experiments.statistics import PairedRates

    say(f"{comparison.num_pairs} runs in common, {comparison.num_only_first} only in A, {comparison.num_only_second} only in B")
    head = ("metric", "runs", "A", "B", "B - A [95 %]", "effect", "p", "worse runs", "")
    table = plain_table(*head, right=range(1, 8), no_wrap=True)
    for d in comparison.differences:
        p = d.paired
        effect = f"{p.only_second} gained, {p.only_first} lost" if isinstance(p, PairedRates) else f"r = {p.rank_biserial:+.2f}"
        verdict = "[red]worse[/]" if d.worse else ""
        table.add_row(
            d.metric,
            str(p.count),
            f"{p.first:.4g}",
            f"{p.second:.4g}",
            f"{p.difference.value:+.4g} [{p.difference.low:+.4g}, {p.difference.high:+.4g}]".replace("[", "\\["),
            effect,
            f"{d.p_value:.2g}",
            str(d.num_worse),
            verdict,
        )
    print_table(table, 140)
    return int(comparison.worse)
