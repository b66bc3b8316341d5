"""Metrics of lifts and doors; null where there are none."""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.facilities import DOOR_STATES, LIFT_STATES, FacilityLog
from mrp_sumo.core.graph import NavGraph
from mrp_sumo.metrics.metric import Evidence, metric

BUSY = [LIFT_STATES.index(state) for state in ("coming", "taken", "held")]


@metric("", "none", "rides of robots in lifts from one level to another")
def lift_rides(run: Evidence) -> int | None:
    level = run.execution.level if run.execution else None
    return None if level is None else int((level[1:] != level[:-1]).sum())


@metric(
    "s",
    "less",
    "time that robots waited before lifts, for the car or for others in it; waits of half a second or more",
)
def lift_wait_s(run: Evidence) -> float | None:
    use = _use(run)
    return None if use is None else float(sum(lift.waited_s for lift in use))


@metric("", "less", "most robots that waited before one lift at a time")
def lift_queue_max(run: Evidence) -> int | None:
    return max((lift.queue for lift in _use(run) or ()), default=None)


@metric("", "none", "share of the time for which the busiest lift was taken or coming to who had called it")
def lift_utilisation_max(run: Evidence) -> float | None:
    return max((lift.busy_share for lift in _use(run) or ()), default=None)


@metric("", "none", "how often doors began to open for robots")
def door_openings(run: Evidence) -> int | None:
    log = _log(run)
    return int((log.door_state == DOOR_STATES.index("opening")).sum()) if log is not None and log.door_name else None


@dataclass(frozen=True)
class LiftUse:
    """What a lift had to do."""

    name: str
    busy_share: float  # of the time: taken by a robot or people, or coming to them
    waited_s: float  # robots, before it
    queue: int  # most robots that waited at a time


def lift_use(execution: Execution, graph: NavGraph, since_s: float = 0.0) -> list[LiftUse]:
    """What the lifts of a run had to do from a time on."""
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
        changes = sorted([(e.t_s, 1) for e in waits] + [(e.t_s + e.duration_s, -1) for e in waits])
        queue = int(np.cumsum([step for _, step in changes]).max(initial=0))
        parts.append(LiftUse(name, busy_s / over_s, sum(e.duration_s for e in waits), queue))
    return parts


def _use(run: Evidence) -> list[LiftUse] | None:
    """Of lifts, where robots can ride."""
    log = _log(run)
    if log is None or run.execution is None or not log.lift_name:
        return None
    return lift_use(run.execution, run.problem.graph)


def _log(run: Evidence) -> FacilityLog | None:
    return run.execution.facilities if run.execution else None
