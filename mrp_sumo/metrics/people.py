"""Metrics of people among robots; null where there are none."""

import numpy as np

from mrp_sumo.core.people import PeopleLog
from mrp_sumo.metrics.metric import Evidence, metric


@metric("", "none", "people who were there at any time")
def num_people(run: Evidence) -> int | None:
    log = _log(run)
    return log.num_people if log else None


@metric(
    "1/h",
    "less",
    "stops of robots in motion for somebody in their protective fields, per hour of a robot; counts, divided by robots and time",
)
def protective_stops_per_robot_h(run: Evidence) -> float | None:
    log = _log(run)
    if log is None or run.execution is None or not run.execution.sim_time_s or np.isnan(log.extra_m):
        return None
    return float(3600 * np.count_nonzero(log.stop_in_motion) / (run.problem.num_robots * run.execution.sim_time_s))


@metric(
    "s",
    "less",
    "time that people cost all robots: the sum of 1 - v / v0 over time, where a robot drove v and would have driven v0 without them",
)
def lost_to_people_s(run: Evidence) -> float | None:
    log = _log(run)
    return float(log.lost_s.sum()) if log else None


@metric("m", "more", "least distance of a moving robot's footprint from a person's body, also between samples; 0 when they touch")
def min_person_distance_m(run: Evidence) -> float | None:
    return run.audit["min_person_distance_m"] if run.audit else None


@metric("s", "less", "time that people stood within 1.2 m of a robot, below a fifth of the speed that they like; of all of them")
def people_waiting_s(run: Evidence) -> float | None:
    log = _log(run)
    return float(log.waited_s.sum()) if log else None


@metric("", "less", "contacts of a footprint with a person while the robot moved faster than its field allows: failures of the audit")
def num_person_contacts(run: Evidence) -> int | None:
    return run.audit["num_person_contacts"] if run.audit else None


@metric("", "none", "contacts of a footprint with a person who came to a robot that stood, or that braked as its field demands")
def num_person_touches(run: Evidence) -> int | None:
    return run.audit["num_person_touches"] if run.audit else None


def _log(run: Evidence) -> PeopleLog | None:
    return run.execution.people if run.execution else None
