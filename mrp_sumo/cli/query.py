"""Ask the results of a batch in SQL (DuckDB); the table is `results`, with one row per run.

    mrp-sumo query DIR "select planner, avg(makespan_s) from results group by planner"

Columns with dots are quoted: "robots.count". Without SQL the columns and the suite's views are listed.
"""

import argparse
import sys
from pathlib import Path

from mrp_sumo.cli.option_rules import only_for
from mrp_sumo.cli.printing import plain_table, print_table, say, warn
from mrp_sumo.cli.result_folder import batch_folder


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo query`."""
    parser.add_argument("folder", metavar="DIR", type=batch_folder, help="folder of a batch, or a results.parquet")
    parser.add_argument("sql", nargs="?", metavar="SQL", help="a query, or the name of a view of the suite")
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print a line of JSON for each row")
    form.add_argument("--csv", action="store_true", help="print CSV instead of a table")


def run(options: argparse.Namespace) -> int:
    """Print what the query selects."""
    from mrp_sumo.errors import BatchError, nearest, shown
    from mrp_sumo.io.results import load_results, query, read_plan

    folder = Path(options.folder)
    views = read_plan(folder)["views"] if folder.is_dir() else {}
    if options.sql is None:
        only_for("what SQL selects: add a query, or the name of a view", json=options.json, csv=options.csv)
        frame = load_results(folder, warn)
        say(f"{len(frame)} rows; columns:")
        for name, kind in frame.dtypes.items():
            say(f"  {name}  ({kind})")
        for name, sql in views.items():
            say(f"view {name}: {' '.join(sql.split())}")
        return 0
    if len(options.sql.split()) == 1 and options.sql not in views:
        raise BatchError(f"'{options.sql}' is neither SQL nor a view of the suite{nearest(options.sql, views)}")
    frame = query(folder, views.get(options.sql, options.sql), warn)
    if options.json:
        say(*frame.to_json(orient="records", lines=True).splitlines())
        return 0
    if options.csv:
        frame.to_csv(sys.stdout, index=False)
        return 0
    from rich.text import Text

    numbers = [k for k, kind in enumerate(frame.dtypes) if kind.kind in "iuf"]
    table = plain_table(*(Text(shown(str(name))) for name in frame.columns), right=numbers)
    for row in frame.itertuples(index=False):
        table.add_row(*(Text(shown(_cell(value))) for value in row))
    print_table(table, 200)
    return 0


def _cell(value: object) -> str:
    """A value as the table shows it; nothing for what is missing."""
    if isinstance(value, float):
        return "" if value != value else f"{value:.4g}"
    return "" if value is None or str(value) in ("<NA>", "NaT") else str(value)
