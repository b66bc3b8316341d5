"""States of lifts and doors as Parquet, a row for each change.

`lifts.parquet`: `t_s`, `lift`, `state` (closed, coming, open, taken, held), `level` of the car, `target` level, `robot` for which it comes
or that is in it ('' for none, '(people)' for people), `doors` (closed, moving, open), `motion` (stopped, up, down), `mode` (agv, human,
fire, offline). `doors.parquet`: `t_s`, `door`, `state` (closed, opening, open, closing), `robot` for which it is open. The names of all
lifts and doors stand in the files' metadata.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mrp_sumo.core.facilities import DOOR_STATES, LIFT_DOORS, LIFT_MODES, LIFT_STATES, MOTIONS, PEOPLE, FacilityLog
from mrp_sumo.core.graph import IntArray, frozen
from mrp_sumo.io.arrow import dictionary, numbers, write_table
from mrp_sumo.io.tables import Names, Table, read_table

LIFTS, DOORS = "lifts.parquet", "doors.parquet"
WHO_ELSE = {-1: "", PEOPLE: "(people)"}


def write_facilities(folder: Path, log: FacilityLog, robot_name: Sequence[str], level_name: Sequence[str]) -> None:
    """Write a table of lifts, where there are any, and one of doors."""

    def who(robots: IntArray) -> list[str]:
        return [WHO_ELSE.get(r) or (robot_name[r] if r >= 0 else "") for r in robots.tolist()]

    lifts = {
        "t_s": numbers(log.lift_t_s),
        "lift": dictionary([log.lift_name[f] for f in log.lift.tolist()]),
        "state": dictionary([LIFT_STATES[k] for k in log.lift_state.tolist()]),
        "level": dictionary([level_name[k] for k in log.lift_level.tolist()]),
        "target": dictionary([level_name[k] for k in log.lift_target.tolist()]),
        "robot": dictionary(who(log.lift_robot)),
        "doors": dictionary([LIFT_DOORS[k] for k in log.lift_doors.tolist()]),
        "motion": dictionary([MOTIONS[k] for k in log.lift_motion.tolist()]),
        "mode": dictionary([LIFT_MODES[k] for k in log.lift_mode.tolist()]),
    }
    doors = {
        "t_s": numbers(log.door_t_s),
        "door": dictionary([log.door_name[d] for d in log.door.tolist()]),
        "state": dictionary([DOOR_STATES[k] for k in log.door_state.tolist()]),
        "robot": dictionary(who(log.door_robot)),
    }
    for name, columns, known in ((LIFTS, lifts, log.lift_name), (DOORS, doors, log.door_name)):
        if known:
            write_table(folder / name, columns, list(known))


def read_facilities(folder: Path, robot_name: Sequence[str], level_name: Sequence[str]) -> FacilityLog | None:
    """The log as it was written; None where there are neither lifts nor doors."""
    lifts, doors = (read_table(path) if (path := folder / name).is_file() else None for name in (LIFTS, DOORS))
    if lifts is None and doors is None:
        return None
    robots = {name: r for r, name in enumerate(robot_name)} | {text: r for r, text in WHO_ELSE.items()}
    lift_name, door_name = (table.about_texts() if table else () for table in (lifts, doors))

    def column(table: Table | None, name: str, known: Names) -> IntArray:
        return table.indices(name, known) if table else frozen(np.zeros(0, np.int64))

    for table, key, known in ((lifts, "lift", lift_name), (doors, "door", door_name)):
        if table and (silent := {*known} - {*table.texts(key)}):
            raise table.fault(f"no row says how {key} '{min(silent)[:40]}' is")

    return FacilityLog(
        lift_name=lift_name,
        lift_t_s=lifts.times("t_s") if lifts else frozen(np.zeros(0)),
        lift=column(lifts, "lift", lift_name),
        lift_state=column(lifts, "state", LIFT_STATES),
        lift_level=column(lifts, "level", level_name),
        lift_target=column(lifts, "target", level_name),
        lift_robot=column(lifts, "robot", robots),
        lift_doors=column(lifts, "doors", LIFT_DOORS),
        lift_motion=column(lifts, "motion", MOTIONS),
        lift_mode=column(lifts, "mode", LIFT_MODES),
        door_name=door_name,
        door_t_s=doors.times("t_s") if doors else frozen(np.zeros(0)),
        door=column(doors, "door", door_name),
        door_state=column(doors, "state", DOOR_STATES),
        door_robot=column(doors, "robot", robots),
    )
