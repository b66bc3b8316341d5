"""A run's plan as messages of Open-RMF's next generation, as JSON: `Plan` with departure blockers, and `PlanRelease`. Experimental.

Written against Plan.msg, Waypoint.msg, TrafficDependency.msg and PlanRelease.msg, which are not released yet. A waypoint is a visit, its
progress the planned time of arrival. Where a robot has to let another one pass, the waypoint before is blocked until the other has come
to where it has left what both need: the same order that the executor keeps. Releases are what was granted. Only the first plan is written,
and its releases until robots were sent other ways.
"""

import json
from pathlib import Path
from typing import Any
from uuid import NAMESPACE_URL, uuid5

import numpy as np

from mrp_sumo.core.problem import Problem
from mrp_sumo.drive.motion_plan import lanes_along
from mrp_sumo.errors import MrpSumoError, PlanError
from mrp_sumo.io.record import RunRecord
from mrp_sumo.reports.exports import replacing
from mrp_sumo.traffic.passages import Schedule, waits
from mrp_sumo.traffic.resources import needs_of, resources_of
from mrp_sumo.traffic.schedule import schedule_of

Json = dict[str, Any]


def write_rmf_plans(path: Path, record: RunRecord) -> None:
    """Write a JSON file: `plans` by participant, and `releases` by time.

    Raises MrpSumoError for a run without a plan, or with one whose order nobody can keep.
    """
    plan, graph = record.plan, record.graph
    if plan is None:
        raise MrpSumoError(f"the run '{record.name}' has no plan")
    start = plan.vertex[plan.first[:-1]]
    problem = Problem(graph, record.fleet, start, plan.last_vertex, np.arange(plan.num_robots), 1.0)
    resources = resources_of(graph, record.fleet.apart_m)
    needs = needs_of(graph, plan, lanes_along(graph, plan)[0], resources, record.fleet.kind)
    try:
        schedule = schedule_of(problem, plan, needs)
    except PlanError as error:
        raise MrpSumoError(f"the run '{record.name}': {error}") from None
    names, robot = record.fleet.robot_name, plan.robot
    keys = [uuid5(NAMESPACE_URL, f"{record.name}/{record.seed}/{name}") for name in names]
    ids: list[Json] = [{"destination_session": {"uuid": list(key.bytes)}, "plan_version": 0} for key in keys]
    progress = _ascending(plan.arrive_s, plan.first)
    blockers = _blockers(schedule, robot)
    waypoints: list[list[Json]] = [[] for _ in names]
    for k, (r, vertex, at) in enumerate(zip(robot.tolist(), plan.vertex.tolist(), progress.tolist())):
        before = [
            {"name": names[other], "plan_id": ids[other], "required_progress": float(progress[until])}
            for other, until in sorted(blockers.get(k, {}).items())
        ]
        waypoints[r].append(_waypoint(record, vertex, at, before))
    plans = [
        {"name": name, "plan": {"waypoints": said, "start_time": _time(0.0), "plan_id": plan_id, "workflow": ""}}
        for name, said, plan_id in zip(names, waypoints, ids)
    ]
    document = {"experimental": True, "plans": plans, "releases": _releases(record, ids)}
    with replacing(path) as partial:
        partial.write_text(json.dumps(document, allow_nan=False), encoding="utf-8")


def _blockers(schedule: Schedule, robot: np.ndarray) -> dict[int, dict[int, int]]:
    """Visit that must not be left -> other robot -> the visit that it has to come to first; without those that earlier ones imply."""
    after, left_at = waits(schedule)
    blockers: dict[int, dict[int, int]] = {}
    for passage, until in zip(after.tolist(), left_at.tolist()):
        visit = int(schedule.visit[passage])
        if until < len(robot) and visit and robot[visit - 1] == robot[visit]:
            of_visit = blockers.setdefault(visit - 1, {})
            other = int(robot[until])
            of_visit[other] = max(of_visit.get(other, 0), until)
    known: dict[tuple[int, int], int] = {}
    for visit in sorted(blockers):
        for other, until in list(blockers[visit].items()):
            if known.get((robot[visit], other), -1) >= until:
                del blockers[visit][other]
            else:
                known[robot[visit], other] = until
    return blockers


def _waypoint(record: RunRecord, vertex: int, progress: float, blockers: list[Json]) -> Json:
    graph, level = record.graph, int(record.graph.level[vertex])
    return {
        "position": (graph.xy[vertex] - record.shift_m[level]).tolist(),
        "arrival_constraints": {"regions": [], "nodes": []},
        "progress": progress,
        "maps": [graph.level_names[level]],
        "departure_blockers": blockers,
        "departure_trajectory": [],  # a straight line
        "departure_action": "",
        "arrival_action": "",
    }


def _releases(record: RunRecord, ids: list[Json]) -> list[Json]:
    """What robots were granted of their first plan, by time."""
    grants, replies = record.execution.grants, record.execution.replies
    if grants is None:
        return []
    until_s = replies[0].t_s if replies else np.inf
    return [
        {"time": _time(t_s), "name": record.fleet.robot_name[r], "release": {"waypoint_id": visit, "plan_id": ids[r]}}
        for t_s, r, visit in zip(grants.t_s.tolist(), grants.robot.tolist(), grants.visit.tolist())
        if t_s < until_s
    ]


def _time(t_s: float) -> Json:
    nanoseconds = round(t_s * 1e9)
    return {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}


def _ascending(arrive_s: np.ndarray, first: np.ndarray) -> np.ndarray:
    """[N] the times of arrival, each after the one before of its robot, as progress has to be."""
    times_s = np.array(arrive_s, np.float64)
    for begin, end in zip(first[:-1].tolist(), first[1:].tolist()):
        for k in range(begin + 1, end):
            times_s[k] = max(times_s[k], np.nextafter(np.float32(times_s[k - 1]), np.float32(np.inf)))
    return times_s
