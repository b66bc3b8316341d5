"""Talking to other people's planners: instances as they read them, plans as they write them.

Instances: MovingAI `.map` and `.scen`, and libMultiRobotPlanning's YAML (grid, or roadmap for graphs that are no grid).
Plans, recognised by their content: libMultiRobotPlanning's YAML `schedule` (read by position in the list, since its
ECBS-TA repeats time stamps), `Agent 0: (row,col)->...` of EECBS, CBSH2-RTC and MAPF-LNS2, lacam's `result.txt`, and
SMART's `Agent 0:(x,y,t)->...`. Cells are counted from the upper left corner. Refuses cells that are not free,
gaps in time and robots that are missing; jumps and collisions are for the referee.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.graph import IntArray, PlanGraph
from mrp_sumo.core.plan import Plan, paths_of_plan, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import MapError, PlanError, nearest
from mrp_sumo.maps.readers.movingai import grid_text
from mrp_sumo.maps.yaml_text import Text, parse

FORMATS = {"yaml": "libMultiRobotPlanning schedule", "paths": "EECBS paths.txt", "lacam": "lacam result.txt", "smart": "SMART paths"}
_STEP = re.compile(r"\(\s*(-?\d{1,12})\s*,\s*(-?\d{1,12})\s*(?:,\s*(-?\d{1,12}(?:\.\d{0,12})?)\s*)?\)")
MAX_STEPS = 10_000_000  # of a robot: a path is a list


@dataclass(frozen=True, eq=False)
class Cells:
    """Cells of a grid's vertices, counted from the upper left corner."""

    column: IntArray  # [V]
    row: IntArray  # [V]
    width: int
    height: int

    @cached_property
    def vertex(self) -> Mapping[tuple[int, int], int]:
        """Vertex by (column, row)."""
        return {place: v for v, place in enumerate(zip(self.column.tolist(), self.row.tolist()))}


def cells_of(graph: PlanGraph) -> Cells | None:
    """The cells of a graph, as its map counts them; None when it is not a grid.

    A grid whose frame is not known is counted from its lowest and leftmost cells.
    """
    if graph.kind != "grid" or len(graph.level_names) > 1 or not graph.num_vertices:
        return None
    low, high = (graph.xy.min(axis=0), graph.xy.max(axis=0)) if graph.frame_m is None else graph.frame_m
    half = graph.cell_m / 2 if graph.frame_m is None else 0.0
    column, up = np.floor((graph.xy - low + half) / graph.cell_m + 1e-6).astype(np.int64).T
    width, height = np.rint((high - low + 2 * half) / graph.cell_m).astype(np.int64).tolist()
    return Cells(column, height - 1 - up, width, height)


def movingai_map(cells: Cells) -> str:
    """The text of a `.map`."""
    free = np.zeros((cells.height, cells.width), np.bool_)
    free[cells.row, cells.column] = True
    return grid_text(free)


def movingai_scen(problem: Problem, cells: Cells, map_name: str) -> str:
    """The text of a `.scen`; its optimal lengths are not computed."""
    rows = [
        f"0\t{map_name}\t{cells.width}\t{cells.height}\t{cells.column[s]}\t{cells.row[s]}\t{cells.column[g]}\t{cells.row[g]}\t0"
        for s, g in zip(problem.start, problem.target)
    ]
    return "\n".join(["version 1", *rows]) + "\n"


def yaml_instance(problem: Problem, cells: Cells | None, *, free: bool = False) -> str:
    """The text of a libMultiRobotPlanning instance: a grid, or with no cells a roadmap; `free` lets every robot take every goal."""
    graph = problem.graph
    places: list[Any]
    if cells:
        blocked = sorted({(x, y) for x in range(cells.width) for y in range(cells.height)} - cells.vertex.keys())
        places = [[int(x), int(y)] for x, y in zip(cells.column, cells.row)]
        obstacles = "".join(f"\n  - [{x}, {y}]" for x, y in blocked) or " []"
        head = f"map:\n  dimensions: [{cells.width}, {cells.height}]\n  obstacles:{obstacles}\n"
    else:
        places = [json.dumps(name) for name in _names(graph)]
        vertices = "".join(f"\n    {place}: [{x!r}, {y!r}]" for place, (x, y) in zip(places, graph.xy.tolist()))
        edges = "".join(f"\n  - [{places[a]}, {places[b]}]" for a, b in zip(graph.tail, graph.head)) or " []"
        head = f"roadmap:\n  undirected: false\n  allow_wait_actions: true\n  vertices:{vertices}\n  edges:{edges}\n"
    goal = [f"goal: {places[g]}" for g in problem.target]
    if free:
        goal = ["potentialGoals: [" + ", ".join(str(places[g]) for g in problem.goal) + "]"] * problem.num_robots
    agents = "".join(f"\n- name: agent{r}\n  start: {places[s]}\n  {to}" for r, (s, to) in enumerate(zip(problem.start, goal)))
    return f"{head}agents:{agents or ' []'}\n"


def read_paths(text: str, problem: Problem, cells: Cells | None, name: str = "plan", shift: tuple[int, int] = (0, 0)) -> Plan:
    """The plan in a peer's output, in any of the formats; agent k is robot k, and columns and rows are shifted by so many.

    `cells` are those of the problem's graph, None for a roadmap, on which only YAML makes sense; `name` is the file's, for messages. Raises
    PlanError for a format that is not known, a robot without a path, a place that is not a vertex, a time that is skipped.
    """
    places = read_places(text, problem.num_robots, name)
    paths = []
    for robot, path in enumerate(places):
        if not path:
            raise PlanError(f"{name}: {problem.fleet.robot_name[robot]} has no path")
        moved = [(place[0] + shift[0], place[1] + shift[1]) if isinstance(place, tuple) else place for place in path]
        paths.append([_vertex(place, problem, cells, name, robot, t) for t, place in enumerate(moved)])
    return plan_of_paths(paths, problem.step_s)


def read_places(text: str, num_robots: int | None = None, name: str = "plan") -> list[list[Any]]:
    """The (column, row), or on a roadmap the vertex's name, of each robot at each step; of all robots in the file by default."""
    format_ = format_of(text)
    if format_ is None:
        raise PlanError(f"{name}: not a plan in a known format ({', '.join(FORMATS.values())}, or this program's JSON)")
    reader = {"yaml": _read_yaml, "paths": _read_arrows, "smart": _read_arrows, "lacam": _read_lacam}[format_]
    return reader(text, name, num_robots)


def shift_of(places: list[list[Any]], problem: Problem, cells: Cells) -> tuple[int, int]:
    """By how many columns and rows all robots of a plan start away from where they are; (0, 0) where they do not agree.

    A planner that was given a part of the map counts cells from that part's corner.
    """
    shifts = {(int(cells.column[v]) - path[0][0], int(cells.row[v]) - path[0][1]) for path, v in zip(places, problem.start) if path}
    return shifts.pop() if len(shifts) == 1 else (0, 0)


def goals_reached(problem: Problem, plan: Plan) -> IntArray:
    """[R] the goals at which a plan ends, for a plan whose planner assigned without saying so.

    -1 where a robot ends elsewhere, as long as there are fewer goals than robots; other robots that end elsewhere are
    given the goals that are left, so that the referee says where they should be.
    """
    free: dict[int, list[int]] = {}
    for g, v in enumerate(problem.goal.tolist()):
        free.setdefault(v, []).append(g)
    goal_of = np.array([free[v].pop(0) if free.get(v) else -1 for v in plan.last_vertex.tolist()], np.int64)
    missing = min(problem.num_robots, len(problem.goal)) - np.count_nonzero(goal_of >= 0)
    left = [g for goals in free.values() for g in goals]
    for robot in np.flatnonzero(goal_of < 0)[: max(0, missing)]:
        goal_of[robot] = left.pop(0)
    return goal_of


def own_time_s(text: str) -> float | None:
    """The solver's time in a peer's output: `runtime` of libMultiRobotPlanning, `comp_time` of lacam; None without."""
    if match := re.search(r"^\s+runtime:\s*(\d{1,12}(?:\.\d*)?(?:[eE][+-]?\d\d?)?)\s*$", text, re.MULTILINE):
        return float(match[1])
    match = re.search(r"^comp_time=(\d{1,12}(?:\.\d*)?)\s*$", text, re.MULTILINE)
    return float(match[1]) / 1000 if match else None


def print_paths(problem: Problem, plan: Plan, cells: Cells | None, kind: str) -> str:
    """A plan in a peer's format.

    Raises PlanError for an unknown format, a plan that is not in whole steps, or one on a roadmap for a format of cells.
    """
    paths = paths_of_plan(plan, problem.step_s)
    names = _names(problem.graph)
    return print_places([[(int(cells.column[v]), int(cells.row[v])) if cells else names[v] for v in path.tolist()] for path in paths], kind)


def print_places(places: list[list[Any]], kind: str) -> str:
    """The text of a plan, as `print_paths`; `places` as `read_places` has them."""
    if kind not in FORMATS:
        raise PlanError(f"no plan format '{kind}'{nearest(kind, FORMATS)}")
    makespan = max((len(path) - 1 for path in places), default=0)
    cost = sum(len(path) - 1 for path in places)
    if kind == "yaml":
        lines = ["statistics:", f"  cost: {cost}", f"  makespan: {makespan}", "schedule:" if places else "schedule: {}"]
        for robot, path in enumerate(places):
            lines.append(f"  agent{robot}:")
            for t, place in enumerate(path):
                lines += [f"    - x: {place[0]}", f"      y: {place[1]}"] if isinstance(place, tuple) else [f"    - v: {place}"]
                lines.append(f"      t: {t}")
        return "\n".join(lines) + "\n"
    if any(not isinstance(path[0], tuple) for path in places if path):
        raise PlanError(f"{FORMATS[kind]} holds cells, but the plan is not on a grid: use yaml")
    if kind == "paths":
        return "".join(f"Agent {r}: " + "".join(f"({y},{x})->" for x, y in path) + "\n" for r, path in enumerate(places))
    if kind == "smart":
        lines = [f"Agent {r}:" + "".join(f"({x},{y},{t})->" for t, (x, y) in enumerate(path)) for r, path in enumerate(places)]
        return "".join(line + "\n" for line in lines)
    steps = [f"{t}:" + "".join("({},{}),".format(*path[min(t, len(path) - 1)]) for path in places) for t in range(makespan + 1)]
    head = [f"agents={len(places)}", "solved=1", f"soc={cost}", f"makespan={makespan}", "solution="]
    return "\n".join([*head, *steps]) + "\n"


def format_of(text: str) -> str | None:
    """The one of FORMATS that a text is in; None for none."""
    if re.search(r"^solution=", text, re.MULTILINE):
        return "lacam"
    if re.search(r"^\s*schedule\s*:", text, re.MULTILINE):
        return "yaml"
    agent = re.search(r"^\s*Agent\s+\d+\s*:(.*)$", text, re.MULTILINE)
    if agent is None:
        return None
    step = _STEP.search(agent[1])
    return "smart" if step and step[3] is not None else "paths"


def _names(graph: PlanGraph) -> list[str]:
    """[V] a name each, by which `vertex_of_name` finds it."""
    return [label if graph.vertex_of_name[label] == v else f"v{v}" for v, label in enumerate(map(graph.label, range(graph.num_vertices)))]


def _vertex(place: Any, problem: Problem, cells: Cells | None, name: str, robot: int, t: int) -> int:
    """The vertex of a (column, row), or of a vertex's name on a roadmap."""
    who = problem.fleet.robot_name[robot]
    if isinstance(place, tuple) and cells:
        vertex = cells.vertex.get(place)
        if vertex is None:
            inside = 0 <= place[0] < cells.width and 0 <= place[1] < cells.height
            raise PlanError(f"{name}: {who} is at cell {place} at step {t}, which is {'blocked' if inside else 'off the map'}")
        return vertex
    vertex = problem.graph.vertex_of_name.get(place) if isinstance(place, str) else None
    if vertex is None:
        raise PlanError(f"{name}: {who} is at {place!r} at step {t}, which is not a vertex of '{problem.graph.name}'")
    return vertex


def _read_yaml(text: str, name: str, num_robots: int | None) -> list[list[Any]]:
    try:
        document = parse(Text(Path(name), text))
    except MapError as error:
        raise PlanError(str(error)) from None
    schedule = document.get("schedule") if isinstance(document, Mapping) else None
    if not isinstance(schedule, Mapping):
        raise PlanError(f"{name}: schedule is not a mapping of agents to their steps")
    num_robots = len(schedule) if num_robots is None else num_robots
    paths: list[list[Any]] = []
    for robot in range(num_robots):
        steps = schedule.get(f"agent{robot}")
        if not isinstance(steps, Sequence) or not steps:
            raise PlanError(f"{name}: schedule has no agent{robot}, expected {num_robots} agents")
        path: list[Any] = []
        last = -1
        for k, step in enumerate(steps):
            t = step.get("t", k) if isinstance(step, Mapping) else k
            if not isinstance(t, int) or not max(last, 0) <= t <= last + 1:
                raise PlanError(f"{name}: schedule.agent{robot}[{k}] has t {t!r:.20}, expected {last + 1}")
            last = t
            if isinstance(step, Mapping) and isinstance(step.get("x"), int) and isinstance(step.get("y"), int):
                path.append((step["x"], step["y"]))
            elif isinstance(step, Mapping) and isinstance(step.get("v"), str):
                path.append(step["v"])
            else:
                raise PlanError(f"{name}: schedule.agent{robot}[{k}] is {step!r:.60}, expected x, y, t or v, t")
        paths.append(path)
    if len(schedule) != num_robots:
        raise PlanError(f"{name}: schedule has {len(schedule)} agents, the problem {num_robots} robots")
    return paths


def _read_arrows(text: str, name: str, num_robots: int | None) -> list[list[Any]]:
    """EECBS: (row, column); SMART: (x, y, t), where steps without a change may be left out."""
    paths: dict[int, list[Any]] = {}
    for number, line in enumerate(text.splitlines(), 1):
        if not line.strip():
            continue
        head = re.match(r"\s*Agent\s+(\d{1,9})\s*:", line)
        if not head:
            raise PlanError(f"{name}:{number}: '{line[:40]}', expected 'Agent K: ...'")
        robot = int(head[1])
        if robot in paths:
            raise PlanError(f"{name}:{number}: agent {robot} comes twice")
        rest = line[head.end() :]
        path: list[Any] = []
        odd = re.sub(r"->|\s", "", _STEP.sub("", rest))
        if odd:
            raise PlanError(f"{name}:{number}: agent {robot} has '{odd[:20]}' in its path")
        for k, step in enumerate(_STEP.finditer(rest)):
            if step[3] is None:
                path.append((int(step[2]), int(step[1])))
                continue
            t = round(float(step[3]))
            if abs(t - float(step[3])) > 1e-6 or not len(path) <= t < MAX_STEPS or (k == 0 and t != 0):
                raise PlanError(f"{name}:{number}: agent {robot} has time {step[3]} at position {k}, expected whole steps from 0 up")
            if t > len(path) and path[-1] != (int(step[1]), int(step[2])):
                raise PlanError(f"{name}:{number}: agent {robot} has nothing between times {len(path) - 1} and {t} and moves")
            path += [(int(step[1]), int(step[2]))] * (t + 1 - len(path))
        paths[robot] = path
    num_robots = len(paths) if num_robots is None else num_robots
    if sorted(paths) != list(range(num_robots)):
        missing = next((r for r in range(num_robots) if r not in paths), len(paths) - 1)
        raise PlanError(f"{name}: paths of {len(paths)} agents, the problem has {num_robots} robots (see agent {missing})")
    return [paths[r] for r in range(num_robots)]


def _read_lacam(text: str, name: str, num_robots: int | None) -> list[list[Any]]:
    solution = re.split(r"^solution=", text, maxsplit=1, flags=re.MULTILINE)[1]  # not comp_time_initial_solution=
    if num_robots is None:
        num_robots = len(_STEP.findall(solution.strip().split("\n")[0]))
        agents = re.search(r"^agents=(.*)$", text, re.MULTILINE)
        if agents and agents[1].strip() != "0" and not num_robots:
            raise PlanError(f"{name}: the solution is empty: not solved")
        if agents and agents[1].strip() != str(num_robots):
            raise PlanError(f"{name}: agents={agents[1].strip():.20}, but the solution begins with {num_robots}")
    paths: list[list[Any]] = [[] for _ in range(num_robots)]
    expected = 0
    for line in solution.splitlines():
        if not line.strip():
            continue
        head, colon, rest = line.partition(":")
        if not colon or not head.strip().isdecimal():
            break  # key=value lines may follow
        if len(head) > 12 or int(head) != expected:
            raise PlanError(f"{name}: step {head.strip():.20} follows step {expected - 1} of the solution")
        steps = [(int(step[1]), int(step[2])) for step in _STEP.finditer(rest)]
        if len(steps) != num_robots:
            raise PlanError(f"{name}: {len(steps)} agents at step {expected}, the problem has {num_robots} robots")
        for path, place in zip(paths, steps):
            path.append(place)
        expected += 1
    if not expected and num_robots:
        raise PlanError(f"{name}: the solution is empty: not solved")
    return paths
