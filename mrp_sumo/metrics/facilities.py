"""Metrics of lifts and doors; null where there are none."""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.facilities import DOOR_STATES, LIFT_STATES
from mrp_sumo.core.graph import NavGraph
from mrp_sumo.metrics.metric import LESS, NONE, Evidence, Metric, logged, most_at_once, of

BUSY = [LIFT_STATES.index(state) for state in ("coming", "taken", "held")]
OPENING = DOOR_STATES.index("opening")


@dataclass(frozen=True)
class LiftUse:
    """The work of a lift."""

    name: str
    busy_share: float  # of the time: taken by a robot or people, or coming to them
    waited_s: float  # robots, before it
    queue: int  # most robots that waited at a time


def lift_use(execution: Execution, graph: NavGraph, since_s: float = 0.0) -> list[LiftUse]:
    """The work of the lifts of a run from a time on."""
    log, parts = execution.facilities, []
    over_s = execution.sim_time_s - since_s
    if log is None or over_s <= 0:
        return []
    cabin = [options.get("cabin") for options in graph.vertex_options]
    for f, name in enumerate(log.lift_name):
        mine = log.lift == f
        begin_s = log.lift_t_s[mine]
        lasts_s = np.append(begin_s[1:], execution.sim_time_s).clip(since_s) - begin_s.clip(since_s)
        busy_s = float(lasts_s[np.isin(log.lift_state[mine], BUSY)].sum())
        waits = [e for e in execution.events if e.kind == "waited" and e.t_s >= since_s and e.vertex >= 0 and cabin[e.vertex] == name]
        queue = most_at_once([e.t_s for e in waits], [e.t_s + e.duration_s for e in waits])
        parts.append(LiftUse(name, busy_s / over_s, sum(e.duration_s for e in waits), queue))
    return parts


def _use(run: Evidence) -> list[LiftUse]:
    """Of lifts, where robots can ride."""
    return lift_use(run.execution, run.problem.graph) if run.execution else []


# fmt: off
METRICS = (
    Metric("lift_rides", "", NONE, "rides of robots in lifts from one level to another",
           logged("level", lambda level: int((level[1:] != level[:-1]).sum()))),
    Metric("lift_wait_s", "s", LESS,
           "time that robots waited before lifts, for the car or for others in it; waits of half a second or more",
           of(_use, lambda lifts: float(sum(lift.waited_s for lift in lifts)) if lifts else None)),
    Metric("lift_queue_max", "", LESS, "most robots that waited before one lift at a time",
           of(_use, lambda lifts: max((lift.queue for lift in lifts), default=None))),
    Metric("lift_utilisation_max", "", NONE, "share of the time for which the busiest lift was taken or on its way to a caller",
           of(_use, lambda lifts: max((lift.busy_share for lift in lifts), default=None))),
    Metric("door_openings", "", NONE, "how often doors began to open for robots",
           logged("facilities", lambda log: int((log.door_state == OPENING).sum()) if log.door_name else None)),
)
