"""Events of an execution as JSON lines, one object per line, for `jq`, pandas and editors.

Robots and vertices appear by name, and a station by its own where that is another; a key without a value is left out. JSON has no
infinity: what lasts for good has `for_good: true` and no `duration_s`.
"""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrp_sumo.core.execution import Event, Execution
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import NavGraph
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.files.reading import json_value, read_text

if TYPE_CHECKING:
    import pandas

LATEST_S = 4e8  # no event is later: bags begin in 2023, and count seconds from 1970 in 31 bits


def event_document(event: Event, fleet: Fleet, graph: NavGraph) -> dict[str, Any]:
    """An event by names: t_s, kind, robot, and if there are any vertex, station, x_m, y_m, other, duration_s or for_good, text."""
    document: dict[str, Any] = {"t_s": float(event.t_s), "kind": event.kind}
    if event.robot >= 0:
        document["robot"] = fleet.robot_name[event.robot]
    if event.vertex >= 0:
        document["vertex"] = graph.label(event.vertex)
        if (name := graph.known_as(event.vertex)) != document["vertex"]:
            document["station"] = name
        document["x_m"], document["y_m"] = (float(c) for c in graph.xy[event.vertex])
    if event.other >= 0:
        document["other"] = fleet.robot_name[event.other]
    if event.duration_s == math.inf:
        document["for_good"] = True
    elif event.duration_s:
        document["duration_s"] = float(event.duration_s)
    if event.text:
        document["text"] = event.text
    return document


def event_documents(execution: Execution, fleet: Fleet, graph: NavGraph) -> list[dict[str, Any]]:
    """All events by names, in order of time."""
    return [event_document(event, fleet, graph) for event in sorted(execution.events, key=lambda event: event.t_s)]


def write_events(path: Path, execution: Execution, fleet: Fleet, graph: NavGraph) -> None:
    """Write all events in order of time, one per line."""
    lines = [json.dumps(document, ensure_ascii=False, allow_nan=False) for document in event_documents(execution, fleet, graph)]
    path.write_text("".join(line + "\n" for line in lines), encoding="utf-8")


def events_frame(documents: list[dict[str, Any]]) -> "pandas.DataFrame":
    """One row per event; NaN where an event lacks a value."""
    import pandas as pd

    return pd.DataFrame(documents, columns=["t_s", "kind", "robot", "vertex", "station", "x_m", "y_m", "other", "duration_s", "text"])


def read_events(path: Path) -> list[dict[str, Any]]:
    """The lines of an events file as dictionaries; what lasts for good has an infinite `duration_s`.

    Raises MrpSumoError for a line that is not a JSON object, or has a time that no event has.
    """
    events = []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        try:
            event = json_value(line)
        except (ValueError, RecursionError) as error:
            raise MrpSumoError(f"{path}:{number}: not JSON: {error}") from None
        if not isinstance(event, dict):
            raise MrpSumoError(f"{path}:{number}: found {line[:40]!r}, expected an object")
        if isinstance(event.get("t_s"), int | float) and not 0 <= event["t_s"] <= LATEST_S:
            raise MrpSumoError(f"{path}:{number}: t_s is {event['t_s']}, expected a time from 0 to {LATEST_S:g} s")
        if isinstance(lasts_s := event.get("duration_s"), int | float) and not 0 <= lasts_s < math.inf:
            raise MrpSumoError(f"{path}:{number}: duration_s is {lasts_s}, expected 0 s or more")
        if event.pop("for_good", False):
            event["duration_s"] = math.inf
        events.append(event)
    return events


def events_of_documents(documents: list[dict[str, Any]], fleet: Fleet, graph: NavGraph) -> tuple[Event, ...]:
    """Events with indices again. A name that is not known becomes -1; vertices that share a name are distinguished by place."""
    robot = {name: i for i, name in enumerate(fleet.robot_name)}
    vertex = {(graph.label(v), x, y): v for v, (x, y) in enumerate(graph.xy.tolist())} if documents else {}
    return tuple(
        Event(
            t_s=float(d["t_s"]),
            kind=str(d["kind"]),
            robot=robot.get(d.get("robot", ""), -1),
            vertex=vertex.get((d.get("vertex", ""), d.get("x_m"), d.get("y_m")), graph.vertex_of_name.get(d.get("vertex", ""), -1)),
            other=robot.get(d.get("other", ""), -1),
            duration_s=float(d.get("duration_s", 0.0)),
            text=str(d.get("text", "")),
        )
        for d in documents
    )
