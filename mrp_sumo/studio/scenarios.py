"""A scenario as forms and as text: the fields come from the one declaration of options, the errors are those of a command."""

import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from mrp_sumo.errors import MapError, MrpSumoError
from mrp_sumo.io.scenario.model import ScenarioModel
from mrp_sumo.io.scenario.read import read_scenario
from mrp_sumo.maps.yaml_edit import document_of, edited
from mrp_sumo.maps.yaml_text import Text
from mrp_sumo.plugins.registry import names

UNITS = {
    "_s": "s",
    "_m": "m",
    "_mps": "m/s",
    "_mps2": "m/s²",
    "_per_h": "an hour",
    "_kg": "kg",
    "_w": "W",
    "_wh": "Wh",
    "_deg": "°",
    "_pct": "%",
}
NAMED = {"planner.name": "planners", "execution.dispatcher.name": "dispatchers", "execution.policy.name": "policies"}  # kinds of plug-ins
SIMPLE = ("integer", "number", "boolean", "string")  # types of values
DEEPEST = 5
MOST_BYTES = 4_000_000


def fault_of(path: Path, text: str) -> str:
    """The first fault of a scenario's text, as a command says it; '' where there is none."""
    try:
        with tempfile.NamedTemporaryFile("w", dir=path.parent, prefix=".", suffix=f"-{path.name}", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            try:
                read_scenario(Path(file.name))
            except MrpSumoError as error:
                return str(error).replace(Path(file.name).name, path.name)
    except OSError as error:
        return f"{path.name}: {error.strerror}"
    return ""


def with_value(path: Path, text: str, key: str, value: Any) -> str:
    """A scenario's text with another value of a dotted key, `tasks.streams.0.arrivals.rate_per_h`; None drops the key or item.

    The number after a list's last adds an item. Raises MrpSumoError for text that is no mapping, and keys of lists that are not there.
    """
    source = Text(path, text)
    document = document_of(source)
    if not isinstance(document, dict):
        raise MapError(f"{path.name}: expected keys and values")
    holder: Any = document
    *before, last = key.split(".")
    for name in before:
        if isinstance(holder, list):
            if not name.isdecimal() or int(name) >= len(holder):
                raise MapError(f"{path.name}: {key}: no item {name}")
            holder = holder[int(name)]
            continue
        if not isinstance(holder.get(name), dict | list):  # a short form, such as `robots: 4`
            holder[name] = _long_form(name, holder.get(name))
        holder = holder[name]
    if isinstance(holder, list):
        if not last.isdecimal() or int(last) > len(holder):
            raise MapError(f"{path.name}: {key}: no item {last}")
        holder[int(last) : int(last) + 1] = [] if value is None else [value]
    elif value is None:
        holder.pop(last, None)
    else:
        holder[last] = value
    return edited(source, document)


def _long_form(name: str, value: Any) -> dict[str, Any]:
    main = {"robots": "count", "planner": "name", "map": "file", "discretisation": "kind", "policy": "name", "dispatcher": "name"}
    return {} if value is None else {main.get(name, "name"): value}


def fields() -> list[dict[str, Any]]:
    """All options that have one value: key, meaning, unit, default, bounds, choices."""
    schema = ScenarioModel.model_json_schema()
    return list(_fields(schema, schema.get("$defs", {}), "", 0))


def _fields(schema: Mapping[str, Any], definitions: Mapping[str, Any], above: str, depth: int) -> Iterator[dict[str, Any]]:
    for name, declared in schema.get("properties", {}).items():
        key = f"{above}{name}"
        options = [declared, *declared.get("anyOf", ()), *declared.get("oneOf", ()), *declared.get("allOf", ())]
        options = [_resolved(option, definitions) for option in options]
        for option in options:
            if option.get("properties") and depth < DEEPEST:
                yield from _fields(option, definitions, f"{key}.", depth + 1)
            if (item := _resolved(option.get("items") or {}, definitions)).get("properties") and depth < DEEPEST:
                yield from _fields(item, definitions, f"{key}.0.", depth + 1)
        simple = next((o for o in options if o.get("type") in SIMPLE or "enum" in o or "const" in o), None)
        if simple is None:
            continue
        listed = [value for o in options for value in (*o.get("enum", ()), *([o["const"]] if "const" in o else []))]
        yield {
            "key": key,
            "says": declared.get("description", ""),
            "type": simple.get("type", "string"),
            "unit": next((unit for end, unit in sorted(UNITS.items(), key=lambda pair: -len(pair[0])) if name.endswith(end)), ""),
            "default": declared.get("default"),
            "least": simple.get("minimum", simple.get("exclusiveMinimum")),
            "most": simple.get("maximum", simple.get("exclusiveMaximum")),
            "choices": list(names(NAMED[key]) if key in NAMED else dict.fromkeys(listed)),
        }


def _resolved(schema: Mapping[str, Any], definitions: Mapping[str, Any]) -> Mapping[str, Any]:
    name = str(schema.get("$ref", "")).rpartition("/")[2]
    return definitions.get(name, {}) if name else schema


def values_of(path: Path, text: str) -> Any:
    """Values of a scenario's text; None where it is no YAML."""
    try:
        return document_of(Text(path, text))
    except MrpSumoError:
        return None
