"""Reporting a plug-in that failed."""

import sys


def print_failure(what: str, line: str, details: str) -> None:
    """Print one line to stderr, after the traceback if there is one to show."""
    if details:
        print(details.rstrip(), file=sys.stderr)
    print(f"mrp-sumo: {what}: {line}", file=sys.stderr)
