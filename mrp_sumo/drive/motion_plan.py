"""What robots are to do, as arrays for the controller: paths, needs, order, clock.

Refuses what `drive.fit` does. `drive.change` changes courses under way.
"""

from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, frozen
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive import _controller
from mrp_sumo.drive.fit import check_groups, check_room, lanes_along, lanes_of, lift_ride
from mrp_sumo.drive.policy import Policy
from mrp_sumo.engines.sumo.network import SHORTEST_M
from mrp_sumo.errors import ExecutionError
from mrp_sumo.traffic.passages import Needs
from mrp_sumo.traffic.resources import Resources, left_after_m, needs_of, resources_of

TURNS_RAD = 0.2  # a bend beyond this is turned in place, a lesser one while driving


@dataclass(frozen=True, eq=False)
class Course:
    """A plan made ready to be driven."""

    plan: Plan  # in simulated time
    drive: _controller.Drive
    path: _controller.Path
    need: _controller.Need
    resources: Resources
    first_turn: IntArray  # [Q] the first passage of every resource

    @property
    def num_robots(self) -> int:
        return len(self.path.first) - 1


def course_of(problem: Problem, plan: Plan, policy: Policy, step_length_s: float) -> Course:
    """Prepare a plan.

    Raises
    ------
    ExecutionError
        When it cannot be driven by these robots on this graph.
    PlanError
        When the policy needs an order and the plan's cannot be kept.
    """
    separation = problem.fleet.separation_m
    lanes_of(problem, plan)
    if ride := lift_ride(problem, plan):
        raise ExecutionError(ride)
    check_room(problem, plan, separation)
    resources = resources_of(problem.graph, separation)
    check_groups(problem, resources)
    nothing = np.zeros(plan.num_robots)
    return course_from(problem, plan, policy, step_length_s, resources, nothing, None, frozenset(), frozenset())


def course_from(
    problem: Problem,
    plan: Plan,
    policy: Policy,
    step_length_s: float,
    resources: Resources,
    driven_m: FloatArray,
    yaw: FloatArray | None,
    backs: frozenset[int],
    left_alone: frozenset[int],
) -> Course:
    """What robots that have `driven_m` [R] along their paths and look to `yaw` [R] still need. None: along their paths."""
    graph, fleet = problem.graph, problem.fleet
    lane, _ = lanes_along(problem, plan)
    moved = lane >= 0
    driven = np.round(np.maximum(graph.length_m, SHORTEST_M), 6)  # [L] as the network has it
    stretch = driven / graph.length_m
    length = np.where(moved, driven[lane], 0.0)
    at = _along(plan.first, length)
    along = graph.xy[graph.head] - graph.xy[graph.tail]
    heading = np.where(moved, np.arctan2(along[:, 1], along[:, 0])[lane], 0.0)
    begin, last = plan.first[:-1], plan.first[1:] - 1
    heading[begin] = np.where(begin < last, heading[np.minimum(begin + 1, last)], 0.0 if yaw is None else yaw)
    turns = np.zeros(plan.num_visits, np.bool_)
    turns[:-1] = np.abs(_wrapped(heading[1:] - heading[:-1])) > TURNS_RAD
    turns[last] = False
    if yaw is not None:
        turns[begin] = (np.abs(_wrapped(heading[begin] - yaw)) > TURNS_RAD) & (begin < last)
    needs = needs_of(graph, plan, lane, resources)
    left_at = left_after_m(graph, plan, lane, at, stretch, needs, resources)
    if yaw is not None:
        needs, left_at = _still_needed(plan, needs, left_at, driven_m, backs, left_alone)
    schedule = policy.order(problem, plan, needs)
    nothing = frozen(np.zeros(0, np.int64))  # read-only as the schedule's: kernels are compiled once for both
    lasts_passage = np.ones(len(needs.resource), np.bool_)
    if schedule is not None:
        lasts_passage = schedule.last_visit[schedule.passage_of_need] == needs.visit
    return Course(
        plan=plan,
        drive=_controller.Drive(
            speed=fleet.max_speed_mps,
            decel=fleet.decel_mps2,
            turn_rate=fleet.turn_rate_rad_s,
            reach=fleet.max_speed_mps**2 / (2 * fleet.decel_mps2) + 3 * fleet.max_speed_mps * step_length_s + 0.02,
        ),
        path=_controller.Path(
            first=plan.first,
            vertex=plan.vertex,
            at=at,
            lane=lane,
            heading=heading,
            turns=turns,
            earliest=np.array(policy.earliest_s(plan)),
            due=np.array(plan.arrive_s) if policy.paced else np.zeros(plan.num_visits),
            short_of=_short_of(resources, lane, at, stretch),
            reverse=graph.reverse,
        ),
        need=_controller.Need(
            first=needs.first,
            resource=needs.resource,
            left_at=left_at,
            passage=schedule.passage_of_need if schedule is not None else nothing,
            closes=lasts_passage,
            passing=schedule.robot if schedule is not None else nothing,
        ),
        resources=resources,
        first_turn=schedule.first[:-1].copy() if schedule is not None else np.zeros(needs.num_resources, np.int64),
    )


def _still_needed(
    plan: Plan, needs: Needs, left_at: FloatArray, driven_m: FloatArray, backs: frozenset[int], left_alone: frozenset[int]
) -> tuple[Needs, FloatArray]:
    """Needs without those that have been left already, or never come to be."""
    visit = needs.visit
    robot = plan.robot[visit]
    keep = left_at > driven_m[robot] + 1e-9
    for r in backs | left_alone:  # a robot that turned back is clear of the vertex that it now comes from
        of_one = robot == r
        keep &= ~of_one | ((visit != plan.first[r]) if r in backs else (visit < plan.first[r + 1] - 1))
    first = np.searchsorted(visit[keep], np.arange(plan.num_visits + 1)).astype(np.int64)
    return Needs(frozen(first), frozen(needs.resource[keep]), frozen(needs.on_lane[keep]), needs.num_resources), left_at[keep]


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
    return np.where((lane >= 0) & ~in_zone & (stop > behind + 2 * _controller.ARRIVED_M), stop, np.inf)


def _wrapped(angle: FloatArray) -> FloatArray:
    wrapped: FloatArray = (angle + np.pi) % (2 * np.pi) - np.pi
    return wrapped


def fresh_state(course: Course) -> _controller.State:
    """Robots on their first visits, holding what these need."""
    begin = course.path.first[:-1]
    state = state_on(course, np.zeros(course.num_robots), begin + 1, begin.copy(), *np.zeros((2, course.num_robots), np.bool_))
    state.arrived[begin] = 0.0
    state.goal[np.diff(course.path.first) == 1] = 0.0  # robots that never move are at their goals
    return state


def state_on(course: Course, s: FloatArray, nx: IntArray, won: IntArray, on_lane: BoolArray, turned: BoolArray) -> _controller.State:
    """Robots on their ways, holding what they have won."""
    path, need = course.path, course.need
    r, n, q, lanes = course.num_robots, len(path.vertex), len(course.first_turn), len(path.reverse)

    def of(value: float) -> FloatArray:
        return np.full(r, value)

    def index(value: int = 0) -> IntArray:
        return np.full(r, value, np.int64)

    state = _controller.State(
        s=s.copy(),
        speed=of(0.0),
        nx=nx.copy(),
        won=won.copy(),
        back=path.first[:-1].copy(),
        allowed=s.copy(),
        on_lane=on_lane.copy(),
        yaw=path.heading[path.first[:-1]],
        command=of(0.0),
        routed=won.copy(),
        cause=index(),
        other=index(-1),
        where=won.copy(),
        asked=of(np.inf),
        wait_since=of(np.inf),
        wait_cause=index(),
        wait_other=index(-1),
        wait_where=index(-1),
        mark_s=s.copy(),
        mark_t=of(0.0),
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
        turned=turned.copy(),
        pause=index(_controller.NEVER),
        pause_for=index(-1),
        gives_way=np.zeros(r, np.bool_),
        home=np.ones(r, np.bool_),
    )
    _controller.take_up(path, need, state)
    return state


def empty_log(num_robots: int) -> _controller.Log:
    """Room for what can happen in a step."""
    room = 4 * num_robots  # at most a blocking, a wait, a departure and an arrival a robot
    whole = [np.zeros(room, np.int64) for _ in range(5)]
    return _controller.Log(*whole, np.zeros(room), np.zeros(room))


def empty_news(num_robots: int) -> _controller.News:
    """Room for all robots."""
    return _controller.News(np.zeros(num_robots, np.int64), np.zeros(num_robots, np.int64))
