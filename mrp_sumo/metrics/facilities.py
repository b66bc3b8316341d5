"""Metrics of lifts and doors; null where there are none."""

import numpy as np

from mrp_sumo.core.facilities import DOOR_STATES, LIFT_STATES, FacilityLog
from mrp_sumo.metrics.metric import Evidence, metric


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
    if _log(run) is None or run.execution is None or run.execution.level is None:
        return None
    cabin = run.problem.graph.having("cabin")
    return float(sum(event.duration_s for event in run.execution.events if event.kind == "waited" and cabin[event.vertex]))


@metric("", "none", "share of the time for which the busiest lift was taken or coming to who had called it")
def lift_utilisation_max(run: Evidence) -> float | None:
    log = _log(run)
    if log is None or run.execution is None or not log.lift_name or not run.execution.sim_time_s:
        return None
    busy = np.isin(log.lift_state, [LIFT_STATES.index("coming"), LIFT_STATES.index("taken")])
    shares = []
    for f in range(len(log.lift_name)):
        mine = log.lift == f
        lasts_s = np.diff(np.append(log.lift_t_s[mine], run.execution.sim_time_s))
        shares.append(float(lasts_s[busy[mine]].sum()) / run.execution.sim_time_s)
    return max(shares)


@metric("", "none", "how often doors began to open for robots")
def door_openings(run: Evidence) -> int | None:
    log = _log(run)
    return int((log.door_state == DOOR_STATES.index("opening")).sum()) if log is not None and log.door_name else None


def _log(run: Evidence) -> FacilityLog | None:
    return run.execution.facilities if run.execution else None
