"""What robots are to do, as arrays for the controller: paths, needs, order, clock.

Refuses what no execution could survive, before SUMO starts: a plan that is not for this problem or leaves the
lanes, robots that do not fit the cells, starts within reach of each other.

A course can be changed under way: some robots get other ways from the last visit they have won, all others go on.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, frozen
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.resources import Resources, left_after_m, needs_of, resources_of
from mrp_sumo.core.schedule import Needs
from mrp_sumo.errors import ExecutionError
from mrp_sumo.maps.sumo import SHORTEST_M
from mrp_sumo.sim import _control
from mrp_sumo.sim.policy import Policy

TURNS_RAD = 0.2  # a bend beyond this is turned in place, a lesser one while driving


@dataclass(frozen=True, eq=False)
class Course:
    """A plan made ready to be driven."""

    plan: Plan  # in simulated time
    drive: _control.Drive
    path: _control.Path
    need: _control.Need
    resources: Resources
    first_turn: IntArray  # [Q] the first passage of every resource

    @property
    def num_robots(self) -> int:
        return len(self.path.first) - 1


@dataclass(frozen=True, eq=False)
class Way:
    """Where a robot goes from the last visit it has won, instead of on along its path."""

    vertex: IntArray  # the visits that follow
    arrive_s: FloatArray
    depart_s: FloatArray  # inf for the last
    leave_s: float  # from the visit it has won; inf where nothing follows
    back: bool = False  # it stands on a lane and turns back there: `vertex` begins with the vertex behind it
    pause: int = -1  # after how many of these visits it lets others pass; -1: it does not


@dataclass(frozen=True, eq=False)
class Change:
    """Other ways for some robots."""

    way: Mapping[int, Way]
    left_alone: frozenset[int] = field(default_factory=frozenset)  # robots that need nothing beyond what they have won


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
    _check_room(problem, plan, separation)
    resources = resources_of(problem.graph, separation)
    _check_groups(problem, resources)
    nothing = np.zeros(plan.num_robots)
    return _course(problem, plan, policy, step_length_s, resources, nothing, None, frozenset(), frozenset())


def changed_course(
    problem: Problem, course: Course, state: _control.State, change: Change, policy: Policy, step_length_s: float, now: float
) -> tuple[Course, _control.State, IntArray]:
    """The course from now on, the state on it, and [N] the visit of the old course that each of its visits is, -1: none.

    Paths begin at the last visits that robots have arrived at. Orders are made anew: what robots hold comes first.

    Raises
    ------
    PlanError
        When the policy needs an order and that of the new plan cannot be kept.
    """
    plan, was = _changed_plan(course.plan, state, change, now)
    path, behind, first = course.path, state.nx - 1, plan.first[:-1]
    backs = np.array([r in change.way and change.way[r].back for r in range(plan.num_robots)], np.bool_)
    offset = np.where(backs, 0.0, path.at[behind])
    s = state.s - offset
    if backs.any():
        ahead = np.minimum(state.nx, len(path.at) - 1)
        s[backs] = (path.at[ahead] - state.s)[backs]  # what it had before it now lies behind
    new = _course(
        problem, plan, policy, step_length_s, course.resources, s, state.yaw, frozenset(np.flatnonzero(backs).tolist()), change.left_alone
    )
    changed = np.array([r in change.way for r in range(plan.num_robots)], np.bool_)
    won = np.where(backs, first, first + state.won - behind)
    after = _state(new, s, first + 1, won, state.on_lane, state.turned | backs)
    after.allowed[:] = np.where(backs, s, state.allowed - offset)
    after.routed[:] = np.where(changed, won, first + state.routed - behind)
    after.command[:] = -1.0  # to be told again
    for mine, theirs in ((after.yaw, state.yaw), (after.speed, state.speed), (after.booked, state.booked)):
        mine[:] = theirs
    for name in ("cause", "other", "asked", "wait_since", "wait_cause", "wait_other", "stuck", "mark_t", "gives_way", "pause_for"):
        fresh, before = getattr(after, name), getattr(state, name)
        fresh[~changed] = before[~changed]
    keep = ~changed
    after.where[keep] = (first + state.where - behind)[keep]
    after.wait_where[keep] = np.where(state.wait_where >= 0, first + state.wait_where - behind, -1)[keep]
    after.pause[keep] = np.where(state.pause == _control.NEVER, _control.NEVER, first + state.pause - behind)[keep]
    after.mark_s[:] = np.where(changed, s, state.mark_s - offset)
    after.mark_t[changed] = now
    for r, way in change.way.items():
        if way.pause >= 0:
            after.pause[r] = first[r] + (0 if way.back else state.won[r] - behind[r]) + way.pause
            after.gives_way[r] = True
    for r in np.flatnonzero(backs).tolist():  # nobody is to come in behind it while it turns
        after.holder[new.need.resource[new.need.first[first[r] + 1] : new.need.first[first[r] + 2]]] = r
    for r in change.left_alone:
        after.pause[r] = won[r]
    known = was >= 0
    after.arrived[known] = state.arrived[was[known]]
    ends = plan.vertex[plan.first[1:] - 1]
    after.home[:] = ends == problem.target
    stays = after.home & (np.diff(plan.first) == 1)
    after.goal[:] = np.where(keep, state.goal, np.where(stays, np.where(np.isfinite(state.goal), state.goal, now), np.nan))
    return new, after, was


def _changed_plan(plan: Plan, state: _control.State, change: Change, now: float) -> tuple[Plan, IntArray]:
    """The plan from the last visits arrived at, and the old visit of each of its visits, -1: none. What robots have won
    they have won before everybody else.
    """
    behind, end = state.nx - 1, plan.first[1:]
    parts: list[tuple[IntArray, IntArray, FloatArray, FloatArray]] = []  # a robot each: old visits, vertices, times
    for r in range(plan.num_robots):
        way = change.way.get(r)
        until = end[r] if way is None else state.won[r] + 1
        old = np.arange(behind[r], until)
        vertex, arrive, depart = plan.vertex[old], plan.arrive_s[old], plan.depart_s[old]
        if way is not None:
            if way.back:
                old, vertex = np.array([-1]), plan.vertex[state.nx[r] : state.nx[r] + 1]
            before = np.full(len(old), now - 1.0)
            depart = np.concatenate([before, way.depart_s])
            depart[len(old) - 1] = way.leave_s
            arrive = np.concatenate([before, way.arrive_s])
            old = np.concatenate([old, np.full(len(way.vertex), -1)])
            vertex = np.concatenate([vertex, way.vertex])
        parts.append((old, vertex, arrive, depart))
    old, vertex, arrive, depart = (np.concatenate(column) for column in zip(*parts))
    first = np.concatenate([[0], np.cumsum([len(part[0]) for part in parts])])
    return Plan(frozen(first), frozen(vertex), frozen(arrive), frozen(depart)), old


def _course(
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
    lane, _ = _lanes(problem, plan)
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
            earliest=np.array(policy.earliest_s(plan)),
            due=np.array(plan.arrive_s) if policy.paced else np.zeros(plan.num_visits),
            short_of=_short_of(resources, lane, at, stretch),
            reverse=graph.reverse,
        ),
        need=_control.Need(
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
    lane, missing = _lanes(problem, plan)
    if missing.any():
        k = int(np.flatnonzero(missing)[0])
        r, tail, head = int(plan.robot[k]), int(plan.vertex[k - 1]), int(plan.vertex[k])
        raise ExecutionError(f"the plan of {names[r]} goes from '{graph.label(tail)}' to '{graph.label(head)}', where there is no lane")
    return lane


def _lanes(problem: Problem, plan: Plan) -> tuple[IntArray, BoolArray]:
    """[N] the lane by which each visit is reached, -1 for first visits, and whether there is none where there should be one."""
    graph, begin = problem.graph, plan.first[:-1]
    tail, head = np.append(-1, plan.vertex[:-1]), plan.vertex
    key = graph.tail * graph.num_vertices + graph.head
    lane = np.searchsorted(key, tail * graph.num_vertices + head)
    lane[begin] = -1
    missing = np.ones(len(lane), np.bool_)
    within = (lane >= 0) & (lane < len(key))
    missing[within] = (graph.tail[lane[within]] != tail[within]) | (graph.head[lane[within]] != head[within])
    missing[begin] = False
    return lane, missing


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


def lift_ride(problem: Problem, plan: Plan) -> str:
    """What to say of a plan that rides a lift, which is not executed; '' for others."""
    lane, graph = _lanes(problem, plan)[0], problem.graph
    rides = np.flatnonzero((lane >= 0) & np.array(["lift" in options for options in graph.lane_options], np.bool_)[lane])
    if not len(rides):
        return ""
    visit = int(rides[np.argmin(plan.arrive_s[rides])])
    ends = f"from '{graph.label(int(plan.vertex[visit - 1]))}' to '{graph.label(int(plan.vertex[visit]))}'"
    lift = graph.lane_options[int(lane[visit])]["lift"]
    name = problem.fleet.robot_name[int(plan.robot[visit])]
    return f"{name} rides lift '{lift}' {ends}, and execution has no lifts yet (choose one map.level)"


def _check_groups(problem: Problem, resources: Resources) -> None:
    """Refuse two robots that start in one mutex group."""
    inside: dict[int, int] = {}
    for r, vertex in enumerate(problem.start.tolist() if resources.group_name else ()):
        for zone in resources.zones_of[resources.zones_first[vertex] : resources.zones_first[vertex + 1]].tolist():
            other = inside.setdefault(zone, r)
            if zone >= len(resources.zone) and other != r:
                names, group = problem.fleet.robot_name, resources.group_name[zone - len(resources.zone)]
                raise ExecutionError(f"{names[other]} and {names[r]} both start in mutex group '{group}', where one robot at a time may be")


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
    begin = course.path.first[:-1]
    state = _state(course, np.zeros(course.num_robots), begin + 1, begin.copy(), *np.zeros((2, course.num_robots), np.bool_))
    state.arrived[begin] = 0.0
    state.goal[np.diff(course.path.first) == 1] = 0.0  # robots that never move are at their goals
    return state


def _state(course: Course, s: FloatArray, nx: IntArray, won: IntArray, on_lane: BoolArray, turned: BoolArray) -> _control.State:
    """Robots on their ways, holding what they have won."""
    path, need = course.path, course.need
    r, n, q, lanes = course.num_robots, len(path.vertex), len(course.first_turn), len(path.reverse)

    def of(value: float) -> FloatArray:
        return np.full(r, value)

    def index(value: int = 0) -> IntArray:
        return np.full(r, value, np.int64)

    state = _control.State(
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
        pause=index(_control.NEVER),
        pause_for=index(-1),
        gives_way=np.zeros(r, np.bool_),
        home=np.ones(r, np.bool_),
    )
    _control.take_up(path, need, state)
    return state


def empty_log(num_robots: int) -> _control.Log:
    """Room for what can happen in a step."""
    room = 4 * num_robots  # at most a blocking, a wait, a departure and an arrival a robot
    whole = [np.zeros(room, np.int64) for _ in range(5)]
    return _control.Log(*whole, np.zeros(room), np.zeros(room))


def empty_news(num_robots: int) -> _control.News:
    """Room for all robots."""
    return _control.News(np.zeros(num_robots, np.int64), np.zeros(num_robots, np.int64))
