"""Dotted keys of scenarios: setting one, and scenarios as rows of a table with one column per key.

A key is dotted (`robots.count`), except where the short form of scenario files has a shorter word: `map`, `planner`,
`discretisation`, `execution.policy`, `execution.dispatcher` and `execution.disturbances` are the file, the name, the kind and the names.
"""

import json
from collections.abc import Iterator, Sequence
from typing import Any

MAIN_KEYS = {  # what a short form stands for
    **{"map": "file", "planner": "name", "discretisation": "kind"},
    **{"execution.policy": "name", "execution.dispatcher": "name", "execution.disturbances": "name"},
}
OWNERS = {  # whose other choice drops the parameters
    **{"planner": "name", "assignment": "solver"},
    **{"execution.policy": "name", "execution.dispatcher": "name"},
}
WHOLE = (("map", "file"), ("execution.disturbances", "name"))  # keys whose choice drops the rest of their section
SECTIONS = ("seed", "map", "discretisation", "robots", "assignment", "planner", "execution", "record")  # first parts of scenario columns


def parameter_columns(scenario: dict[str, Any]) -> dict[str, Any]:
    """A complete scenario as columns; lists as JSON text, the scenario's name left out."""
    return dict(_leaves(scenario, ""))


def short_key(key: str) -> str:
    """The column of a key: `planner` for `planner.name`."""
    section, _, inner = key.rpartition(".")
    return section if MAIN_KEYS.get(section) == inner else key


def put(data: dict[str, Any], key: Sequence[str | int], value: Any, above: str = "") -> None:
    """Set a dotted key in `data`, whose inner mappings are shared and therefore copied.

    Naming another map, planner, assigner, policy or set of disturbances drops what belonged to the one before: level, graph, parameters.
    `above` is the dotted key of `data`.
    """
    first = str(key[0])
    section = f"{above}.{first}" if above else first
    main = MAIN_KEYS.get(section)
    if len(key) == 1 and main and isinstance(value, str):
        key = [first, main]
    old = data.get(first)
    if isinstance(old, str) and main:
        old = {main: old}
    if len(key) == 1:
        if isinstance(old, dict) and isinstance(value, dict) and section != "map":
            value = {k: v for k, v in old.items() if not (k == "parameters" and OWNERS.get(section) in value)} | value
        data[first] = value
        return
    inner: dict[str, Any] = dict(old) if isinstance(old, dict) and (section, key[1]) not in WHOLE else {}
    if OWNERS.get(section) == key[1] and len(key) == 2:
        inner.pop("parameters", None)
    put(inner, key[1:], value, section)
    data[first] = inner


def _leaves(mapping: dict[str, Any], above: str) -> Iterator[tuple[str, Any]]:
    for key, value in mapping.items():
        if isinstance(value, dict):
            yield from _leaves(value, f"{above}{key}.")
        elif MAIN_KEYS.get(above[:-1]) == key:
            yield above[:-1], value
        elif above or key != "name":
            yield above + key, json.dumps(value) if isinstance(value, list) else value
