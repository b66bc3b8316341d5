"""States of lifts and doors as Parquet, a row for each change.

`lifts.parquet`: `t_s`, `lift`, `state` (closed, coming, open, taken, held), `level` of the car, `target` level, `robot` for which it comes
or that is in it ('' for none, '(people)' for people), `doors` (closed, moving, open), `motion` (stopped, up, down), `mode` (agv, human,
fire, offline). `doors.parquet`: `t_s`, `door`, `state` (closed, opening, open, closing), `robot` for which it is open. The names of all
lifts and doors stand in the files' metadata.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.facilities import DOOR_STATES, LIFT_DOORS, LIFT_MODES, LIFT_STATES, MOTIONS, PEOPLE, FacilityLog
from mrp_sumo.core.graph import frozen
from mrp_sumo.io.arrow import dictionary, numbers, write_table
from mrp_sumo.io.tables import read_table

LIFTS, DOORS = "lifts.parquet", "doors.parquet"
KINDS = {"lift": LIFTS, "door": DOORS}
WHO_ELSE = {-1: "", PEOPLE: "(people)"}


def write_facilities(folder: Path, log: FacilityLog, robot_name: Sequence[str], level_name: Sequence[str]) -> None:
    """Write a table of lifts, where there are any, and one of doors."""
    for kind, file in KINDS.items():
        if names := getattr(log, f"{kind}_name"):
            words = _words(kind, names, level_name, dict(enumerate(robot_name)) | WHO_ELSE)
            columns = {name: dictionary([of[k] for k in getattr(log, _field(kind, name)).tolist()]) for name, of in words.items()}
            write_table(folder / file, {"t_s": numbers(getattr(log, f"{kind}_t_s")), **columns}, list(names))


def read_facilities(folder: Path, robot_name: Sequence[str], level_name: Sequence[str]) -> FacilityLog | None:
    """The log as it was written; None where there are neither lifts nor doors."""
    tables = {kind: read_table(folder / file) for kind, file in KINDS.items() if (folder / file).is_file()}
    robots = {name: r for r, name in enumerate(robot_name)} | {text: r for r, text in WHO_ELSE.items()}
    columns: dict[str, Any] = {}
    for kind in KINDS:
        table = tables.get(kind)
        names = table.about_texts() if table else ()
        if table and (silent := {*names} - {*table.texts(kind)}):
            raise table.fault(f"no row says how {kind} '{min(silent)[:40]}' is")
        columns |= {f"{kind}_name": names, f"{kind}_t_s": table.times("t_s") if table else frozen(np.zeros(0))}
        for name, of in _words(kind, names, level_name, robots).items():
            columns[_field(kind, name)] = table.indices(name, of) if table else frozen(np.zeros(0, np.int64))
    return FacilityLog(**columns) if tables else None


def _words(kind: str, names: Sequence[str], level_name: Sequence[str], robots: Any) -> dict[str, Any]:
    """Columns of lifts, or of doors, in the order of the table, with the words of their numbers."""
    if kind == "door":
        return {"door": names, "state": DOOR_STATES, "robot": robots}
    states = {"doors": LIFT_DOORS, "motion": MOTIONS, "mode": LIFT_MODES}
    return {"lift": names, "state": LIFT_STATES, "level": level_name, "target": level_name, "robot": robots, **states}


def _field(kind: str, column: str) -> str:
    return kind if column == kind else f"{kind}_{column}"
