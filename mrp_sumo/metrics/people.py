"""Metrics of people among robots; null where there are none."""

import numpy as np

from mrp_sumo.metrics.metric import LESS, MORE, NONE, Evidence, Metric, logged, of_audit


def _stops_per_robot_h(run: Evidence) -> float | None:
    log = run.execution.people if run.execution else None
    if log is None or run.execution is None or not run.execution.sim_time_s or np.isnan(log.extra_m):
        return None
    return float(3600 * np.count_nonzero(log.stop_in_motion) / (run.problem.num_robots * run.execution.sim_time_s))


# fmt: off
METRICS = (
    Metric("num_people", "", NONE, "people who were there at any time", logged("people", lambda log: log.num_people)),
    Metric("protective_stops_per_robot_h", "1/h", LESS,
           "stops of robots in motion for somebody in their protective fields, per hour of a robot; counts, divided by robots and time",
           _stops_per_robot_h),
    Metric("lost_to_people_s", "s", LESS,
           "time that people cost all robots: the sum of 1 - v / v0 over time, where a robot drove v and would have driven v0 "
           "without them", logged("people", lambda log: float(log.lost_s.sum()))),
    Metric("min_person_distance_m", "m", MORE,
           "least distance of a moving robot's footprint from a person's body, also between samples; 0 when they touch",
           of_audit("min_person_distance_m")),
    Metric("people_waiting_s", "s", LESS,
           "time that all people together spent within 1.2 m of a robot, below a fifth of the speed that they prefer",
           logged("people", lambda log: float(log.waited_s.sum()))),
    Metric("num_person_contacts", "", LESS,
           "contacts of a footprint with a person while the robot moved faster than its field allows: failures of the audit",
           of_audit("num_person_contacts")),
    Metric("num_person_touches", "", NONE,
           "contacts of a footprint with a person who came to a robot that stood, or that braked as its field demands",
           of_audit("num_person_touches")),
)
