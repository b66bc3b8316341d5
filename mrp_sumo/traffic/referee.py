"""Judges plans. Knows the rules of the game and no planner.

Rules (Stern et al., SoCS 2019, sections 2 and 3), stated on timed visits so that they hold for steps and
for continuous time: a robot occupies a vertex from its arrival to its departure, both included, and a lane
in between, ends excluded. It occupies its start from time 0 and its last vertex for ever.

* vertex conflict: two robots occupy one vertex at one time;
* edge conflict: two robots occupy a lane and its opposite, or one lane and overtake, at one time (a swap);
* following conflict: a robot sets out for a vertex before the one on it has arrived elsewhere. It does not
  make a plan invalid, but a ring of them (a rotation) cannot be executed in any order.
"""

from collections import Counter
from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, NavGraph
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import count
from mrp_sumo.traffic.turns import obstacle_to

EPSILON_S = 1e-6


@dataclass(frozen=True)
class Conflict:
    """Two robots, `robot` before `other` by number, in conflict at `vertex` (edge: on the lane to `next_vertex`)."""

    kind: str  # 'vertex', 'edge' or 'following'
    robot: int
    other: int
    vertex: int
    next_vertex: int  # -1 unless kind is 'edge': `robot` drives from vertex to next_vertex
    t_s: float  # when it begins


@dataclass(frozen=True)
class Verdict:
    """The referee's judgement. A plan is valid without faults and without vertex and edge conflicts."""

    faults: tuple[str, ...]  # not a plan for this problem at all: one line each
    conflicts: tuple[Conflict, ...]  # vertex and edge, by time
    following: tuple[Conflict, ...]  # by time

    @property
    def valid(self) -> bool:
        return not self.faults and not self.conflicts

    def count(self, kind: str) -> int:
        """Number of conflicts of a kind."""
        return Counter(c.kind for c in (*self.conflicts, *self.following))[kind]

    def summary(self, problem: Problem, limit: int = 3) -> str:
        """One line for a person: the first faults, else the first conflicts with robots, place and time."""
        if self.faults:
            return "; ".join(self.faults[:limit])
        if not self.conflicts:
            return "valid"
        listed = [describe(c, problem) for c in self.conflicts[:limit]]
        text = count(len(self.conflicts), "conflict")
        return f"{text}: " + "; ".join(listed) + ("; ..." if len(self.conflicts) > limit else "")


def judge(problem: Problem, plan: Plan, goal_of: IntArray | None = None, *, in_seconds: bool = False) -> Verdict:
    """Judge a plan for a problem. Faults end the judgement: conflicts are looked for in a plan without faults only.

    Where a plan has got other times after it was planned, those that the planner gave it are judged. `goal_of` [R] is the assignment that
    it claims, for planners that assign; the problem's by default. With `in_seconds` a lane need not take a whole step: the plan has the
    times of real motion, which `metrics.referee_in_seconds` judges.
    """
    plan = plan if in_seconds else plan.in_steps or plan
    faults = _faults(problem, plan, problem.goal_of if goal_of is None else goal_of, 0.0 if in_seconds else problem.step_s)
    if faults:
        return Verdict(tuple(faults), (), ())
    meetings = _overlaps(plan.vertex, plan.arrive_s, plan.depart_s + EPSILON_S)
    vertex = _vertex_conflicts(plan, meetings)
    edge = _edge_conflicts(plan, problem.graph.num_vertices)
    following = _following_conflicts(plan, set(meetings))
    return Verdict((), tuple(sorted(vertex + edge, key=_by_time)), tuple(sorted(following, key=_by_time)))


def describe(conflict: Conflict, problem: Problem) -> str:
    """The conflict in words, such as 'robot_1 and robot_4 meet at 'dock_2' at 12 s'."""
    name, label = problem.fleet.robot_name, problem.graph.label
    a, b, at = name[conflict.robot], name[conflict.other], f"at {conflict.t_s:g} s"
    if conflict.kind == "vertex":
        return f"{a} and {b} meet at '{label(conflict.vertex)}' {at}"
    if conflict.kind == "edge":
        return f"{a} and {b} swap between '{label(conflict.vertex)}' and '{label(conflict.next_vertex)}' {at}"
    return f"{a} and {b} follow each other into '{label(conflict.vertex)}' {at}"


def _faults(problem: Problem, plan: Plan, goal_of: IntArray, lane_s: float) -> list[str]:
    graph, names = problem.graph, problem.fleet.robot_name
    if plan.num_robots != problem.num_robots:
        return [f"the plan is for {plan.num_robots} robots, the problem has {problem.num_robots}"]
    if (np.diff(plan.first) < 1).any():
        return [f"{names[int(np.flatnonzero(np.diff(plan.first) < 1)[0])]} has no visit"]
    outside = np.flatnonzero((plan.vertex < 0) | (plan.vertex >= graph.num_vertices))
    if len(outside):
        k = int(outside[0])
        return [f"{names[plan.robot[k]]} visits vertex {plan.vertex[k]}, which the graph does not have"]
    faults = []
    if problem.barred is not None:
        faults += _on_barred(problem, plan)
    target = np.where(goal_of >= 0, problem.goal[np.maximum(goal_of, 0)], -1) if len(problem.goal) else np.full(len(names), -1)
    held = goal_of[goal_of >= 0]
    if len(np.unique(held)) != len(held):
        faults.append("two robots are assigned the same goal")
    jump = np.flatnonzero(_without_lane(plan, graph))
    faults += [
        f"{names[plan.robot[k]]} jumps from '{graph.known_as(plan.vertex[k])}' to '{graph.known_as(plan.vertex[k + 1])}' "
        f"at {plan.depart_s[k]:g} s: there is no lane"
        for k in jump[:10]
    ]
    for robot in range(problem.num_robots):
        faults += _faults_of(robot, problem, plan, int(target[robot]), lane_s)
    return faults or _impossible_turns(problem, plan)


def _impossible_turns(problem: Problem, plan: Plan) -> list[str]:
    faults, fleet = [], problem.fleet
    for robot in np.flatnonzero(fleet.is_vehicle).tolist():
        route = plan.vertex[plan.first[robot] : plan.first[robot + 1]].tolist()
        if obstacle := obstacle_to(problem.graph, fleet.types[int(fleet.kind[robot])], route):
            faults.append(f"{fleet.robot_name[robot]} cannot drive its path: {obstacle}")
    return faults


def _faults_of(robot: int, problem: Problem, plan: Plan, target: int, lane_s: float) -> list[str]:
    graph, name, faults = problem.graph, problem.fleet.robot_name[robot], list[str]()
    a, b = int(plan.first[robot]), int(plan.first[robot + 1])
    if plan.vertex[a] != problem.start[robot]:
        faults.append(f"{name} begins at '{graph.known_as(plan.vertex[a])}', not at its start '{graph.known_as(problem.start[robot])}'")
    if target >= 0 and plan.vertex[b - 1] != target:
        faults.append(f"{name} ends at '{graph.known_as(plan.vertex[b - 1])}', not at its goal '{graph.known_as(target)}'")
    if abs(plan.arrive_s[a]) > EPSILON_S:
        faults.append(f"{name} begins at {plan.arrive_s[a]:g} s, not at 0 s")
    if plan.depart_s[b - 1] != np.inf:
        faults.append(f"{name} leaves its last vertex at {plan.depart_s[b - 1]:g} s")
    moves = slice(a, b - 1)
    if not np.isfinite(plan.arrive_s[a:b]).all() or not np.isfinite(plan.depart_s[moves]).all():
        return [*faults, f"{name} has a visit without a time"]
    early = np.flatnonzero(plan.depart_s[moves] < plan.arrive_s[moves] - EPSILON_S)
    if len(early):
        k = a + int(early[0])
        faults.append(
            f"{name} leaves '{graph.known_as(plan.vertex[k])}' at {plan.depart_s[k]:g} s, before it arrives at {plan.arrive_s[k]:g} s"
        )
    fast = np.flatnonzero(plan.arrive_s[a + 1 : b] - plan.depart_s[moves] < lane_s - EPSILON_S)
    if len(fast):
        k = a + int(fast[0])
        faults.append(
            f"{name} needs {plan.arrive_s[k + 1] - plan.depart_s[k]:g} s from '{graph.known_as(plan.vertex[k])}' "
            f"to '{graph.known_as(plan.vertex[k + 1])}' at {plan.depart_s[k]:g} s, a lane takes {lane_s:g} s"
        )
    return faults


def _on_barred(problem: Problem, plan: Plan) -> list[str]:
    """Moves over lanes on which robots have no room."""
    graph, fleet, faults = problem.graph, problem.fleet, []
    assert problem.barred is not None
    for k, (robot, vertex) in enumerate(zip(plan.robot[:-1].tolist(), plan.vertex[:-1].tolist())):
        onward = int(plan.vertex[k + 1])
        lane = graph.lane_between(vertex, onward) if plan.robot[k + 1] == robot else -1
        if lane >= 0 and problem.barred[fleet.kind[robot], lane]:
            what = (
                f"{fleet.robot_name[robot]} drives from '{graph.known_as(vertex)}' to '{graph.known_as(onward)}' at {plan.depart_s[k]:g} s"
            )
            faults.append(f"{what}, where a {fleet.type_name[robot] or 'robot of its type'} has no room")
    return faults[:10]


def _without_lane(plan: Plan, graph: NavGraph) -> BoolArray:
    """[N] whether a visit is not its robot's last and no lane leads to the next."""
    lanes = graph.tail * graph.num_vertices + graph.head
    inner = np.append(plan.robot[1:] == plan.robot[:-1], False)
    return inner & ~np.isin(plan.vertex * graph.num_vertices + np.roll(plan.vertex, -1), lanes)


def _vertex_conflicts(plan: Plan, meetings: list[tuple[int, int]]) -> list[Conflict]:
    robot = plan.robot
    return [
        _conflict("vertex", robot[i], robot[j], plan.vertex[i], -1, max(plan.arrive_s[i], plan.arrive_s[j]))
        for i, j in meetings
        if robot[i] != robot[j]
    ]


def _edge_conflicts(plan: Plan, num_vertices: int) -> list[Conflict]:
    robot = plan.robot
    k = np.flatnonzero(robot[1:] == robot[:-1])  # the moves, by the visit they begin at
    tail, head = plan.vertex[k], plan.vertex[k + 1]
    depart, arrive = plan.depart_s[k], plan.arrive_s[k + 1]
    both = np.minimum(tail, head) * num_vertices + np.maximum(tail, head)
    conflicts = []
    for i, j in _overlaps(both, depart, arrive - EPSILON_S):
        if robot[k[i]] == robot[k[j]]:
            continue
        overtakes = (depart[i] - depart[j]) * (arrive[i] - arrive[j]) < 0
        if tail[i] != tail[j] or overtakes:
            first = i if robot[k[i]] < robot[k[j]] else j
            conflicts.append(_conflict("edge", robot[k[i]], robot[k[j]], tail[first], head[first], max(depart[i], depart[j])))
    return conflicts


def _following_conflicts(plan: Plan, meetings: set[tuple[int, int]]) -> list[Conflict]:
    """A visit claims its vertex from the departure towards it to the arrival at the next one; those who meet there do not follow."""
    robot = plan.robot
    inner = np.flatnonzero(robot[1:] == robot[:-1])
    begin, end = plan.arrive_s.copy(), plan.depart_s.copy()
    begin[inner + 1] = plan.depart_s[inner]
    end[inner] = plan.arrive_s[inner + 1]
    return [
        _conflict("following", robot[i], robot[j], plan.vertex[i], -1, max(begin[i], begin[j]))
        for i, j in _overlaps(plan.vertex, begin, end - EPSILON_S)
        if robot[i] != robot[j] and (i, j) not in meetings
    ]


def _overlaps(key: IntArray, begin: FloatArray, end: FloatArray) -> list[tuple[int, int]]:
    """Pairs i < j of intervals [begin, end] of one key that overlap: sorted sweep, each against the still open."""
    order = np.lexsort((begin, key))
    key, begin, end = key[order], begin[order], end[order]
    overlaps_next = (key[1:] == key[:-1]) & (begin[1:] <= end[:-1])  # where none does so, no others do; most keys have none
    pairs: list[tuple[int, int]] = []
    for value in np.unique(key[1:][overlaps_next]):
        still: list[int] = []
        for j in range(*np.searchsorted(key, [value, value + 1])):
            still = [i for i in still if end[i] >= begin[j]]
            pairs += [(int(min(order[i], order[j])), int(max(order[i], order[j]))) for i in still]
            still.append(j)
    return pairs


def _conflict(kind: str, robot: int, other: int, vertex: int, next_vertex: int, t_s: float) -> Conflict:
    return Conflict(kind, int(min(robot, other)), int(max(robot, other)), int(vertex), int(next_vertex), float(t_s))


def _by_time(conflict: Conflict) -> tuple[float, int, int, str]:
    return conflict.t_s, conflict.robot, conflict.other, conflict.kind
