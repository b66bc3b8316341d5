"""Scenarios and results as rows of a table: one column a key.

A scenario's keys are dotted (`robots.count`), except where the short form of scenario files has a
shorter word: `map`, `planner` and `discretisation` are the file, the name and the kind.
"""

import json
from collections.abc import Iterator
from typing import Any

MAIN_KEYS = {"map": "file", "planner": "name", "discretisation": "kind"}  # what a section's short form stands for
SECTIONS = ("seed", "map", "discretisation", "robots", "assignment", "planner", "execution", "record")  # first parts of scenario columns


def parameter_columns(scenario: dict[str, Any]) -> dict[str, Any]:
    """A complete scenario as columns; lists as JSON text, the scenario's name left out."""
    return dict(_leaves(scenario, ""))


def _leaves(mapping: dict[str, Any], above: str) -> Iterator[tuple[str, Any]]:
    for key, value in mapping.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{above}{key}.")
        elif MAIN_KEYS.get(above[:-1]) == key:
            yield above[:-1], value
        elif above or key != "name":
            yield above + key, json.dumps(value) if isinstance(value, list) else value
