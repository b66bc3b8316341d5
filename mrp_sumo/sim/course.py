"""What robots are to do, as arrays for the controller: paths, needs, order, clock.

Refuses what no execution could survive, before SUMO starts: a plan that is not for this problem or leaves the
lanes, robots that do not fit the cells, starts within reach of each other.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.resources import Resources, left_after_m, needs_of, resources_of
from mrp_sumo.errors import ExecutionError
from mrp_sumo.maps.sumo import SHORTEST_M
from mrp_sumo.sim import _control
from mrp_sumo.sim.policy import Policy

TURNS_RAD = 0.2  # a bend beyond this is turned in place, a lesser one while driving


@dataclass(frozen=True, eq=False)
class Course:
    """A plan made ready to be driven."""

    drive: _control.Drive
    path: _control.Path
    need: _control.Need
    resources: Resources
    first_turn: IntArray  # [Q] the first passage of every resource

    @property
    def num_robots(self) -> int:
        return len(self.path.first) - 1


def course_of(problem: Problem, plan: Plan, policy: Policy, step_length_s: float, begin_s: float = 0.0) -> Course:
    """Prepare a plan whose time 0 is `begin_s` of the execution.

    Raises
    ------
    ExecutionError
        When it cannot be driven by these robots on this graph.
    PlanError
        When the policy needs an order and the plan's cannot be kept.
    """
    graph, fleet = problem.graph, problem.fleet
    separation = fleet.separation_m
    lane = lanes_of(problem, plan)
    _check_room(problem, plan, separation)
    resources = resources_of(graph, separation)
    needs = needs_of(graph, plan, lane, resources)
    schedule = policy.order(problem, plan, needs)
    moved = lane >= 0
    driven = np.round(np.maximum(graph.length_m, SHORTEST_M), 6)  # [L] as the network has it
    stretch = driven / graph.length_m
    length = np.where(moved, driven[lane], 0.0)
    at = _along(plan.first, length)
    along = graph.xy[graph.head] - graph.xy[graph.tail]
    heading = np.where(moved, np.arctan2(along[:, 1], along[:, 0])[lane], 0.0)
    begin, last = plan.first[:-1], plan.first[1:] - 1
    heading[begin] = np.where(begin < last, heading[np.minimum(begin + 1, last)], 0.0)
    turns = np.zeros(plan.num_visits, np.bool_)
    turns[:-1] = np.abs(_wrapped(heading[1:] - heading[:-1])) > TURNS_RAD
    turns[last] = False
    nothing = np.zeros(0, np.int64)
    lasts_passage = np.ones(len(needs.resource), np.bool_)
    if schedule is not None:
        lasts_passage = schedule.last_visit[schedule.passage_of_need] == needs.visit
    return Course(
        drive=_control.Drive(
            speed=fleet.max_speed_mps,
            decel=fleet.decel_mps2,
            turn_rate=fleet.turn_rate_rad_s,
            reach=fleet.max_speed_mps**2 / (2 * fleet.decel_mps2) + 3 * fleet.max_speed_mps * step_length_s + 0.02,
        ),
        path=_control.Path(
            first=plan.first,
            vertex=plan.vertex,
            at=at,
            lane=lane,
            heading=heading,
            turns=turns,
            earliest=policy.earliest_s(plan) + begin_s,
            due=plan.arrive_s + begin_s if policy.paced else np.zeros(plan.num_visits),
            short_of=_short_of(resources, lane, at, stretch),
            reverse=graph.reverse,
        ),
        need=_control.Need(
            first=needs.first,
            resource=needs.resource,
            left_at=left_after_m(graph, plan, lane, at, stretch, needs, resources),
            passage=schedule.passage_of_need if schedule is not None else nothing,
            closes=lasts_passage,
            passing=schedule.robot if schedule is not None else nothing,
        ),
        resources=resources,
        first_turn=schedule.first[:-1].copy() if schedule is not None else np.zeros(needs.num_resources, np.int64),
    )


def lanes_of(problem: Problem, plan: Plan) -> IntArray:
    """[N] the lane by which each visit is reached, -1 for robots' first visits.

    Raises
    ------
    ExecutionError
        When the plan is for other robots, begins elsewhere, or jumps between vertices without a lane.
    """
    graph, names = problem.graph, problem.fleet.robot_name
    if plan.num_robots != problem.num_robots:
        raise ExecutionError(f"the plan has {plan.num_robots} robots, the problem {problem.num_robots}")
    begin = plan.first[:-1]
    elsewhere = np.flatnonzero(plan.vertex[begin] != problem.start)
    if len(elsewhere):
        r = int(elsewhere[0])
        found, expected = graph.label(int(plan.vertex[begin[r]])), graph.label(int(problem.start[r]))
        raise ExecutionError(f"the plan of {names[r]} begins at '{found}', expected its start '{expected}'")
    tail, head = np.append(-1, plan.vertex[:-1]), plan.vertex
    key = graph.tail * graph.num_vertices + graph.head
    lane = np.searchsorted(key, tail * graph.num_vertices + head)
    lane[begin] = -1
    missing = np.ones(len(lane), np.bool_)
    within = (lane >= 0) & (lane < len(key))
    missing[within] = (graph.tail[lane[within]] != tail[within]) | (graph.head[lane[within]] != head[within])
    missing[begin] = False
    if missing.any():
        k = int(np.flatnonzero(missing)[0])
        r = int(plan.robot[k])
        raise ExecutionError(
            f"the plan of {names[r]} goes from '{graph.label(int(tail[k]))}' to '{graph.label(int(head[k]))}', where there is no lane"
        )
    return lane


def _check_room(problem: Problem, plan: Plan, separation: float) -> None:
    graph, fleet = problem.graph, problem.fleet
    if not problem.num_robots:
        raise ExecutionError("there are no robots to execute a plan with")
    if separation > graph.cell_m + 1e-9:
        raise ExecutionError(
            f"the robots do not fit: with their gap they need {separation:.3f} m from centre to centre, "
            f"and cells of '{graph.name}' are {graph.cell_m:g} m"
        )
    served = np.zeros(graph.num_vertices, np.bool_)
    served[graph.tail] = served[graph.head] = True
    stranded = np.flatnonzero(~served[problem.start])
    if len(stranded):
        r = int(stranded[0])
        raise ExecutionError(f"{fleet.robot_name[r]} starts at '{graph.label(int(problem.start[r]))}', which has no lane")
    where = graph.xy[problem.start]
    pairs = cKDTree(where).query_pairs(separation - 1e-9, output_type="ndarray")
    pairs = pairs[graph.level[problem.start[pairs[:, 0]]] == graph.level[problem.start[pairs[:, 1]]]]
    if len(pairs):
        i, j = sorted(pairs.tolist())[0]
        apart = float(np.hypot(*(where[i] - where[j])))
        raise ExecutionError(
            f"{fleet.robot_name[i]} and {fleet.robot_name[j]} start {apart:.3f} m apart, at '{graph.label(int(problem.start[i]))}' "
            f"and '{graph.label(int(problem.start[j]))}', expected {separation:.3f} m or more"
        )


def _along(first: IntArray, length: FloatArray) -> FloatArray:
    """[N] sums of lengths, from 0 for each robot."""
    total = np.cumsum(length)
    return total - np.repeat(total[first[:-1]], np.diff(first))


def _short_of(resources: Resources, lane: IntArray, at: FloatArray, stretch: FloatArray) -> FloatArray:
    """[N] how far a robot may drive towards a vertex that is not free: clear of it and of the vertex behind. inf where a
    lane has no such place, or is in a zone.
    """
    num_vertices = len(resources.zones_first) - 1 - len(resources.ends)
    in_zone = np.diff(resources.zones_first)[num_vertices + resources.track[lane]] > 0
    stop = at - (resources.enter_m * stretch)[lane]
    behind = np.append(0.0, at[:-1]) + (resources.leave_m * stretch)[lane]
    return np.where((lane >= 0) & ~in_zone & (stop > behind + 2 * _control.ARRIVED_M), stop, np.inf)


def _wrapped(angle: FloatArray) -> FloatArray:
    wrapped: FloatArray = (angle + np.pi) % (2 * np.pi) - np.pi
    return wrapped


def fresh_state(course: Course) -> _control.State:
    """Robots on their first visits, holding what these need."""
    path, need = course.path, course.need
    r, n, q, lanes = course.num_robots, len(path.vertex), len(course.first_turn), len(path.reverse)
    begin = path.first[:-1]

    def zeros() -> FloatArray:
        return np.zeros(r)

    def of(value: float) -> FloatArray:
        return np.full(r, value)

    def index(value: int = 0) -> IntArray:
        return np.full(r, value, np.int64)

    state = _control.State(
        s=zeros(),
        speed=zeros(),
        nx=begin + 1,
        won=begin.copy(),
        back=begin.copy(),
        allowed=zeros(),
        on_lane=np.zeros(r, np.bool_),
        yaw=path.heading[begin],
        command=zeros(),
        routed=begin.copy(),
        cause=index(),
        other=index(-1),
        where=begin.copy(),
        asked=of(np.inf),
        wait_since=of(np.inf),
        wait_cause=index(),
        wait_other=index(-1),
        wait_where=index(-1),
        mark_s=zeros(),
        mark_t=zeros(),
        stuck=np.zeros(r, np.bool_),
        arrived=np.full(n, np.nan),
        goal=of(np.nan),
        booked=np.zeros((r, 8)),
        freed=np.zeros(len(need.resource), np.bool_),
        holder=np.full(q, -1, np.int64),
        held=np.zeros(q, np.int64),
        turn=course.first_turn.copy(),
        claims=np.zeros(lanes, np.int64),
        claimer=np.full(lanes, -1, np.int64),
    )
    _control.begin(path, need, state)
    alone = path.first[1:] - begin == 1  # robots that never move are at their goals
    state.goal[alone] = 0.0
    return state


def continued(course: Course, before: _control.State, path: _control.Path, now: float) -> _control.State:
    """Robots on the first visits of a new course, where they stand on the last visits of an old one they arrived at."""
    state, stands = fresh_state(course), before.nx - 1
    state.s[:] = before.s - path.at[stands]  # a millimetre or so before the vertex
    state.yaw[:] = before.yaw
    state.command[:] = before.command
    state.booked[:] = before.booked
    state.mark_s[:] = state.s
    state.mark_t[:] = now
    state.arrived[course.path.first[:-1]] = now
    alone = np.diff(course.path.first) == 1
    there = path.first[1:] - 1 == stands
    state.goal[:] = np.where(alone, np.where(there, before.goal, now), np.nan)
    return state


def empty_log(num_robots: int) -> _control.Log:
    """Room for what can happen in a step."""
    room = 4 * num_robots  # at most a blocking, a wait, a departure and an arrival a robot
    whole = [np.zeros(room, np.int64) for _ in range(5)]
    return _control.Log(*whole, np.zeros(room), np.zeros(room))


def empty_news(num_robots: int) -> _control.News:
    """Room for all robots."""
    return _control.News(np.zeros(num_robots, np.int64), np.zeros(num_robots, np.int64))
