"""Plan files in any format that is read, for a problem that is known: this program's JSON, or a peer's paths.

Refuses what is no plan for the problem's robots and vertices.
"""

from pathlib import Path

from mrp_sumo.core.graph import PlanGraph
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import PlanError
from mrp_sumo.files.reading import read_text
from mrp_sumo.formats.peers import Cells, goals_reached, read_paths, read_places, shift_of
from mrp_sumo.formats.plan_json import read_plan
from mrp_sumo.traffic.referee import judge


def text_of(path: Path) -> str:
    """The text of a plan file."""
    return read_text(path, error=PlanError)


def is_json(text: str) -> bool:
    """True for a text that is meant as this program's plan file."""
    return text.lstrip()[:1] == "{"


def read_plan_file(path: Path, problem: Problem, cells: Cells | None) -> tuple[Plan, str]:
    """The plan for a problem's robots in a file, which need not be valid, and a note; `cells` are None where the graph is no grid.

    The note is a line where the plan counts cells from another corner than the map, as is seen when all its robots start equally far from
    where they are; '' else. Raises PlanError for a file that cannot be read, other robots, or a place that is not a vertex.
    """
    text = text_of(path)
    if is_json(text):
        plan = read_plan(path, problem.fleet.robot_name)
        require_on_graph(plan, problem.graph, path.name, f"'{problem.graph.name}', which has {problem.graph.num_vertices}")
        return plan, ""
    shift = (0, 0) if cells is None else shift_of(read_places(text, problem.num_robots, path.name), problem, cells)
    plan = read_paths(text, problem, cells, path.name, shift)
    columns, rows = shift
    return plan, f"{path.name} counts cells from another corner: {columns:+d} columns and {rows:+d} rows to the map's" if any(shift) else ""


def require_on_graph(plan: Plan, graph: PlanGraph, name: str, where: str) -> None:
    """Refuse a plan with a vertex that a graph does not have; raises PlanError. `name` is that of the plan's file, `where` the graph's."""
    for vertex in (plan.vertex.max(initial=0), plan.vertex.min(initial=0)):
        if not 0 <= vertex < max(1, graph.num_vertices):
            raise PlanError(f"{name}: vertex {vertex} is not on {where}")


def plan_and_goals(path: Path, problem: Problem, cells: Cells | None) -> tuple[Plan, Problem, str]:
    """The plan in a file, which solves the problem or has conflicts, the problem with the assignment that the plan is for, and a note.

    As `read_plan_file`. Where the problem has no assignment, robots may end at any of its goals. Raises PlanError also for a plan with
    other starts or goals, or that leaves the lanes.
    """
    plan, note = read_plan_file(path, problem, cells)
    if not problem.is_assigned:
        problem = problem.assigned(goals_reached(problem, plan))
    verdict = judge(problem, plan, in_seconds=True)
    if verdict.faults:
        more = f", and {len(verdict.faults) - 1} more faults" if len(verdict.faults) > 1 else ""
        raise PlanError(f"{path.name}: no plan for this problem: {verdict.faults[0]}{more}")
    return plan, problem, note
