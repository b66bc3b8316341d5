"""Plans as JSON: per robot its timed visits, with the vertices' names and places so that a reader needs no map.

`{"schema_version", "step_s", "units", "robots": [{"name", "start", "goal", "visits": [{"vertex", "name",
"x", "y", "arrive_s", "depart_s"}]}]}`; `depart_s` is null at the end, where the robot stays. Visits of a plan that was made in
steps and then retimed have `arrive_step` and `depart_step` too. Where starts or goals have headings, robots have `start_heading_rad` or
`goal_heading_rad`, null where any will do, and in plans with the times of the last turns `turned_s`. Refuses files of another
schema, and plans whose robots are not the fleet's.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray, frozen
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.files.names import fault_of
from mrp_sumo.files.reading import is_number, read_json

SCHEMA_VERSION = 1
STEPS = ("arrive_step", "depart_step")
FARTHEST = 1e15  # of times and numbers of vertices


def write_plan(path: Path, problem: Problem, plan: Plan, *, has_goals: bool = True) -> None:
    """Write a plan, one line per robot; where tasks come instead of goals, `goal` is null."""
    graph, lines = problem.graph, []
    for r in range(plan.num_robots):
        visits = slice(int(plan.first[r]), int(plan.first[r + 1]))
        columns = [plan.vertex[visits], plan.arrive_s[visits], plan.depart_s[visits]]
        if plan.in_steps is not None:
            columns += [np.rint(times[visits] / problem.step_s) for times in (plan.in_steps.arrive_s, plan.in_steps.depart_s)]
        document = {
            "name": problem.fleet.robot_name[r],
            "start": graph.label(int(problem.start[r])),
            "goal": graph.label(int(problem.target[r])) if has_goals else None,
            **_headings(problem, plan, r),
            "visits": [
                {
                    "vertex": v,
                    "name": graph.label(v),
                    "x": float(graph.xy[v, 0]),
                    "y": float(graph.xy[v, 1]),
                    "arrive_s": arrive,
                    "depart_s": depart if np.isfinite(depart) else None,
                    **{key: int(step) if np.isfinite(step) else None for key, step in zip(STEPS, steps)},
                }
                for v, arrive, depart, *steps in zip(*(column.tolist() for column in columns))
            ],
        }
        lines.append(json.dumps(document, separators=(",", ":"), ensure_ascii=False, allow_nan=False))
    head = json.dumps({"schema_version": SCHEMA_VERSION, "step_s": problem.step_s, "units": "m, s"}, allow_nan=False)
    path.write_text(head[:-1] + ', "robots": [\n' + ",\n".join(lines) + "\n]}\n", encoding="utf-8")


def _headings(problem: Problem, plan: Plan, robot: int) -> dict[str, float | None]:
    headings = {}
    if problem.start_heading_rad is not None:
        headings["start_heading_rad"] = float(problem.heading_at_start[robot])
    if problem.goal_heading_rad is not None:
        headings["goal_heading_rad"] = float(problem.heading_at_target[robot])
    if plan.turned_s is not None:
        headings["turned_s"] = float(plan.turned_s[robot])
    return {key: None if np.isnan(value) else value for key, value in headings.items()}


def read_plan(path: Path, robot_name: Sequence[str] | None = None) -> Plan:
    """Read a plan back, on the vertices of the graph it was made for; checked against the fleet's names, and in their order, if given.

    Raises PlanError for a file that is missing, damaged, of another schema, or for other robots.
    """
    document = read_json(path, error=PlanError)
    version = document.get("schema_version") if isinstance(document, dict) else None
    if version != SCHEMA_VERSION:
        raise PlanError(f"{path}: schema version {version}, expected {SCHEMA_VERSION}")
    robots = document.get("robots")
    if not isinstance(robots, list):
        raise PlanError(f"{path}: damaged: robots is {robots!r:.40}, expected a list")
    for k, robot in enumerate(robots):
        _require_robot(path, k, robot)
    step_s = document.get("step_s")
    if not is_number(step_s, FARTHEST) or step_s <= 0:
        raise PlanError(f"{path}: damaged: step_s is {step_s!r:.40}, expected a number of seconds above 0")
    if robot_name is not None:
        by_name = {robot["name"]: robot for robot in robots}
        if set(by_name) != set(robot_name):
            odd = sorted(set(by_name) ^ set(robot_name))[0]
            raise PlanError(f"{path}: robot '{odd}' is not in both the plan and the fleet")
        robots = [by_name[name] for name in robot_name]
    visits = [visit for robot in robots for visit in robot["visits"]]
    first = frozen(np.cumsum([0, *(len(robot["visits"]) for robot in robots)]).astype(np.int64))
    vertex = frozen(np.array([visit["vertex"] for visit in visits], np.int64))

    def times(key: str, unit_s: float = 1.0) -> FloatArray:
        return frozen(np.array([np.inf if visit[key] is None else visit[key] * unit_s for visit in visits], np.float64))

    in_steps = None
    if visits and all(STEPS[0] in visit for visit in visits):
        in_steps = Plan(first, vertex, times(STEPS[0], step_s), times(STEPS[1], step_s))
    turned_s = None
    if robots and all("turned_s" in robot for robot in robots):
        turned_s = frozen(np.array([robot["turned_s"] for robot in robots], np.float64))
    return Plan(first, vertex, times("arrive_s"), times("depart_s"), in_steps, turned_s)


def _require_robot(path: Path, k: int, robot: Any) -> None:
    """Refuse the k-th robot of a plan where its name, its times or its visits are damaged."""
    if not isinstance(robot, dict) or not isinstance(robot.get("name"), str) or not isinstance(robot.get("visits"), list):
        raise PlanError(f"{path}: damaged: robots[{k}] has no name or no visits")
    if not is_number(turned_s := robot.get("turned_s", 0.0), FARTHEST):
        raise PlanError(f"{path}: damaged: robots[{k}].turned_s is {turned_s!r:.40}, expected a time in s")
    if not is_number(heading := robot.get("goal_heading_rad") or 0.0, FARTHEST):
        raise PlanError(f"{path}: damaged: robots[{k}].goal_heading_rad is {heading!r:.40}, expected an angle in rad")
    if fault := fault_of(robot["name"]):
        raise PlanError(f"{path}: robots[{k}].name: {fault}")
    for i, visit in enumerate(robot["visits"]):
        if fault := _fault(visit):
            raise PlanError(f"{path}: damaged: robots[{k}].visits[{i}] {fault}")


def goal_headings(path: Path, robot_name: Sequence[str]) -> FloatArray | None:
    """[R] headings in which robots are to stay, by a plan file that `read_plan` takes; NaN where any will do, None for all of them."""
    if b'"goal_heading_rad"' not in path.read_bytes():  # the common case, quickly
        return None
    named = {robot["name"]: robot.get("goal_heading_rad") for robot in read_json(path, error=PlanError)["robots"]}
    return frozen(np.array([np.nan if named[name] is None else named[name] for name in robot_name], np.float64))


def _fault(visit: Any) -> str:
    """What is wrong with a visit as read; nothing is ''."""
    if not isinstance(visit, dict):
        return f"is {visit!r:.40}, expected a visit"
    for key, kinds, expected in (
        ("vertex", int, "a vertex's number"),
        ("arrive_s", int | float, "a time in s"),
        ("depart_s", int | float | None, "a time in s, or null"),
    ):
        value = visit.get(key, "missing")
        if not isinstance(value, kinds) or isinstance(value, bool) or (value is not None and not abs(value) < FARTHEST):
            return f"has the {key} {value!r:.40}, expected {expected}"
    steps = [visit[key] for key in STEPS if key in visit]
    odd = any(not isinstance(step, int | None) or isinstance(step, bool) or abs(step or 0) >= FARTHEST for step in steps)
    if steps and (len(steps) < 2 or odd or steps[0] is None):
        return f"has the {' and '.join(STEPS)} {steps!r:.40}, expected numbers of steps, or null where it stays"
    return ""
