"""Write a page about a batch or a run: tables and charts that stand alone, for a browser, a phone, printing or a paper.

OUT gets index.html, which needs no network, figures/ as SVG and PNG, and tables/ as CSV, Markdown and LaTeX.
"""

import argparse
from pathlib import Path

from mrp_sumo.cli.printing import say_either
from mrp_sumo.cli.result_folder import reported_folder


def arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `mrp-sumo report`."""
    parser.add_argument(
        "folder", metavar="DIR", type=reported_folder, help="folder of a batch, of a run, or of several run folders; or a results.parquet"
    )
    parser.add_argument("--json", action="store_true", help="print file and size as a line of JSON")
    parser.add_argument("--out", metavar="OUT", help="folder of the report (default: DIR/report)")


def run(options: argparse.Namespace) -> int:
    """Write the report and say where."""
    from mrp_sumo.reports.report import write_report

    page = write_report(Path(options.folder), Path(options.out) if options.out else None)
    size = page.stat().st_size
    say_either(options.json, {"file": str(page), "bytes": size}, f"{page} ({size / 1e6:.1f} MB)")
    return 0
