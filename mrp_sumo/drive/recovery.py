"""What is done about robots that do not get on, mildest first: give way, drive around, plan anew.

* In a ring of waiting (first come, first served) one robot gives way at once, `drive.giving_way`.
* A robot that has stood for the patience behind something that stays (a closed lane, a robot that is broken or at its
  goal) takes the shortest way around it, first come, first served.
* If that is not to be had, or the policy keeps an order, or a ring has lasted for the patience, any registered
  planner plans anew for all robots from the vertices they have won, around what stays; the new plan's order is kept.

Robots go on driving what they have won. A robot that can reach its goal no more stays where it is until a lane opens.
Gives up trying, saying why, when there is no plan or its order cannot be kept, and tries again after twice the time.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from mrp_sumo.core.execution import Event
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import BoolArray, IntArray, NavGraph, PlanGraph, frozen, nav_graph
from mrp_sumo.core.plan import Plan, Status
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive import _controller
from mrp_sumo.drive.change import Change, Way
from mrp_sumo.drive.disturber import Disturber
from mrp_sumo.drive.giving_way import GivingWay, Surroundings, still_to_pass, who_gives_way
from mrp_sumo.drive.motion_plan import Course
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.errors import MrpSumoError, PlanError
from mrp_sumo.search.route import reach_m, shortest_route

PLANNING_LIMIT_S = 10.0  # of wall time
SAME_RING = 3  # so many times a ring of the same robots is asked to give way, before a planner is
Apply = Callable[[Change, bool], None]  # makes a change happen, whether in a new order; PlanError if that cannot be kept


@dataclass
class Recovery:
    """The recoveries of one execution."""

    problem: Problem
    settings: ExecutionSettings
    disturber: Disturber
    giving: list[GivingWay] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)  # to be told

    def __post_init__(self) -> None:
        self._barred_since = np.full(self.problem.num_robots, np.inf)  # [R] before a closed lane
        self._ring_since: dict[tuple[int, ...], float] = {}
        self._asked: Counter[frozenset[int]] = Counter()
        self._told: set[str] = set()
        self._failures = 0
        self._again_s = 0.0  # no planner is asked before
        self._cut_off = False  # a robot waits for a lane to open
        self._num_closed = 0

    def let_go(self, now: float, course: Course, state: _controller.State) -> None:
        """Robots that have let others pass go on."""
        around = Surroundings(self.problem.graph, course, state, self.disturber.closed)
        for giving in list(self.giving):
            state.pause_for[giving.robot] = still_to_pass(around, giving, self.disturber.broken)
            if state.pause_for[giving.robot] < 0:
                self._end(giving, now)
                state.pause[giving.robot] = _controller.NEVER
                state.gives_way[giving.robot] = False

    def end(self, now: float) -> None:
        """The run is over."""
        for giving in list(self.giving):
            self._end(giving, now)

    def look(self, now: float, rings: set[tuple[int, ...]], course: Course, state: _controller.State, ordered: bool, apply: Apply) -> bool:
        """Do what has to be done. Returns whether a change was made: then course and state are others."""
        around = Surroundings(self.problem.graph, course, state, self.disturber.closed)
        barred = self._barred(now, course, state)
        self._ring_since = {ring: self._ring_since.get(ring, now) for ring in sorted(rings)}
        if self.settings.give_way and not ordered:
            for ring in self._ring_since:
                if self._asked[frozenset(ring)] < SAME_RING and self._ask(now, ring, around, apply):
                    return True
        patience = self.settings.patience_s
        stuck = state.stuck & (now - state.mark_t >= patience)
        late = np.flatnonzero(barred | (stuck & self._for_good(state, barred))).tolist()
        if late and not ordered and self._drive_around(now, late, course, around, apply):
            return True
        opened = self._cut_off and np.count_nonzero(self.disturber.closed) < self._num_closed
        old = any(now - since >= patience for since in self._ring_since.values())
        if not self.settings.replanner or not (late or old or opened) or now < self._again_s:
            return False
        return self._plan_anew(now, course, around, apply)

    def _barred(self, now: float, course: Course, state: _controller.State) -> BoolArray:
        """[R] who has stood before a closed lane for the patience."""
        if not self.disturber.closed.any():
            self._barred_since[:] = np.inf
            return np.zeros(len(state.s), np.bool_)
        ahead = np.minimum(state.won + 1, course.path.first[1:] - 1)
        at_closed = (state.cause == _controller.DISTURBED) & (self.disturber.hold_until <= now) & ~state.on_lane
        at_closed &= self.disturber.closed[course.path.lane[ahead]] & (state.speed == 0)
        self._barred_since[:] = np.where(at_closed, np.minimum(self._barred_since, now), np.inf)
        waited: BoolArray = now - self._barred_since >= self.settings.patience_s
        return waited

    def _for_good(self, state: _controller.State, barred: BoolArray) -> BoolArray:
        """[R] whose chain of waiting ends at a robot that stays: broken, at its goal, or given up; not one barred itself."""
        found = np.zeros(len(state.s), np.bool_)
        stays = (
            self.disturber.broken | (state.cause == _controller.FINISHED) | ((state.cause == _controller.LETTING_PASS) & ~state.gives_way)
        )
        for r in np.flatnonzero(state.stuck).tolist():
            at, seen = r, {r}
            while state.wait_since[at] < np.inf and state.other[at] >= 0:
                at = int(state.other[at])
                if at in seen:
                    break
                seen.add(at)
            found[r] = stays[at] and not barred[at]
        return found

    def _ask(self, now: float, ring: tuple[int, ...], around: Surroundings, apply: Apply) -> bool:
        found = who_gives_way(around, ring, self.disturber.hold_until > now, now)
        if found is None:
            return False
        giving, way = found
        self._asked[frozenset(ring)] += 1
        for before in [g for g in self.giving if g.robot == giving.robot]:
            self._end(before, now)
        self.giving.append(giving)
        apply(Change({giving.robot: way}), False)
        return True

    def _end(self, giving: GivingWay, now: float) -> None:
        self.giving.remove(giving)
        names = self.problem.fleet.robot_name
        text = f"lets {', '.join(names[r] for r in giving.others)} pass at '{self.problem.graph.label(giving.place)}'"
        self.events.append(
            Event(giving.begin_s, "gave_way", giving.robot, giving.place, giving.others[0], round(now - giving.begin_s, 9), text)
        )

    def _drive_around(self, now: float, late: list[int], course: Course, around: Surroundings, apply: Apply) -> bool:
        """Shorter ways than waiting, for all of these that have one."""
        graph, state, path = self.problem.graph, around.state, course.path
        stays = self.disturber.broken | (state.cause == _controller.FINISHED)
        ways = {}
        for r in late:
            if not around.stands(r) or self.disturber.hold_until[r] > now or state.gives_way[r]:
                continue
            blocked = self.disturber.closed | _needing(
                graph, course, (state.holder >= 0) & (stays & (np.arange(len(stays)) != r))[state.holder]
            )
            ahead = path.lane[state.won[r] + 1 : path.first[r + 1]]
            if not blocked[ahead].any():
                continue
            back = bool(state.on_lane[r])
            start, goal = int(path.vertex[state.won[r]]), int(path.vertex[path.first[r + 1] - 1])
            route = shortest_route(graph, ~blocked, start, goal)
            if route is None or (back and not around.free_for(r, around.of_vertex(start))):
                continue
            follows = np.array(route if back else route[1:], np.int64)
            times = np.full(len(follows), now)
            depart = np.append(times[1:], np.inf) if len(times) else times
            ways[r] = Way(follows, times, depart, now if len(times) else np.inf, back)
            waited = now - min(float(self._barred_since[r]), float(state.mark_t[r]))
            text = "drives around " + ("a closed lane" if self.disturber.closed[ahead[0]] else f"what {self._blocker(state, r)} holds")
            self.events.append(
                Event(round(now - waited, 9), "detour", r, int(path.vertex[state.won[r] + 1]), int(state.other[r]), round(waited, 9), text)
            )
        if ways:
            apply(Change(ways), False)
        return bool(ways)

    def _blocker(self, state: _controller.State, robot: int) -> str:
        other = int(state.other[robot])
        return self.problem.fleet.robot_name[other] if other >= 0 else "another robot"

    def _plan_anew(self, now: float, course: Course, around: Surroundings, apply: Apply) -> bool:
        planner = self.settings.replanner
        try:
            change, cut_off = self._new_ways(now, course, around)
            apply(change, True)
        except PlanError as error:
            why = str(error)
            self._failures += 1
            self._again_s = now + self.settings.patience_s * 2**self._failures
            if why not in self._told:
                self._told.add(why)
                self.events.append(Event(now, "unresolved", -1, text=why))
            return False
        for giving in list(self.giving):
            self._end(giving, now)
        self._failures, self._cut_off = 0, bool(cut_off)
        self._again_s = now + self.settings.patience_s
        self._num_closed = int(np.count_nonzero(self.disturber.closed))
        self._ring_since.clear()
        text = f"{planner} planned anew"
        if cut_off:
            names = [self.problem.fleet.robot_name[r] for r in cut_off]
            text += f"; without a way to their goals: {', '.join(names[:5])}{', ...' if len(names) > 5 else ''}"
        self.events.append(Event(now, "resolved", -1, text=text))
        return True

    def _new_ways(self, now: float, course: Course, around: Surroundings) -> tuple[Change, list[int]]:
        """Ways of a new plan for all who can move, and robots that cannot reach their goals."""
        problem, graph, state, path = self.problem, self.problem.graph, around.state, course.path
        broken, taken = self.disturber.broken, state.holder.copy()
        start, back = path.vertex[state.won].copy(), np.zeros(len(broken), np.bool_)
        waits = broken | np.array([around.enters_by_itself(r) for r in range(len(broken))])
        for r in np.flatnonzero(state.on_lane & ~waits).tolist():
            ahead = int(path.vertex[state.won[r] + 1])
            on, behind = around.of_lane(int(path.lane[state.won[r] + 1])), around.of_vertex(int(start[r]))
            if ((taken[on] < 0) | (taken[on] == r)).all():
                taken[on], start[r] = r, ahead
            elif around.stands(r) and ((taken[behind] < 0) | (taken[behind] == r)).all():
                taken[behind], back[r] = r, True
            else:
                waits[r] = True
        alone = frozenset(np.flatnonzero(waits & state.on_lane).tolist())
        blocked = self.disturber.closed | _needing(graph, course, (state.holder >= 0) & waits[state.holder])
        for r in alone:
            lane = int(path.lane[state.won[r] + 1])
            blocked[[lane, *([int(graph.reverse[lane])] if graph.reverse[lane] >= 0 else [])]] = True
        robots = np.flatnonzero(~waits)
        goal, cut_off = _goals(graph, ~blocked, start[robots], problem.target[robots])
        plan = _planned(problem, graph, ~blocked, robots, start[robots], goal, self.settings.replanner) if len(robots) else None
        ways = {}
        for r in range(problem.num_robots):
            if waits[r]:
                if r in alone:
                    ways[r] = Way(path.vertex[state.won[r] + 1 : state.won[r] + 2], np.array([now]), np.array([np.inf]), now)
                else:
                    ways[r] = Way(np.zeros(0, np.int64), np.zeros(0), np.zeros(0), np.inf)
                continue
            assert plan is not None
            i = int(np.searchsorted(robots, r))
            part = slice(plan.first[i], plan.first[i + 1])
            vertex, arrive, depart = plan.vertex[part], plan.arrive_s[part] + now, plan.depart_s[part] + now
            if state.on_lane[r]:
                ways[r] = Way(vertex, arrive, depart, now - 1.0, bool(back[r]))
            else:
                ways[r] = Way(vertex[1:], arrive[1:], depart[1:], float(depart[0]))
        return Change(ways, alone), [int(robots[i]) for i in cut_off]


def _needing(graph: NavGraph, course: Course, resource: BoolArray) -> BoolArray:
    """[L] lanes for which a robot needs one of these resources [Q]."""
    found, num_vertices = course.resources, graph.num_vertices
    zones = resource[num_vertices:]
    place = np.zeros(len(found.zones_first) - 1, np.bool_)
    place[:num_vertices] = resource[:num_vertices]
    of_place = np.repeat(np.arange(len(place)), np.diff(found.zones_first))
    np.logical_or.at(place, of_place, zones[found.zones_of])
    needing: BoolArray = place[graph.head] | place[num_vertices + found.track]
    return needing


def _goals(graph: NavGraph, open_: BoolArray, start: IntArray, target: IntArray) -> tuple[IntArray, list[int]]:
    """[R] targets that can be reached, or the start, and who has to stay there."""
    reach = reach_m(graph, open_, start)
    goal = np.where(np.isfinite(reach[np.arange(len(start)), target]), target, start)
    while True:  # who stays may stand on another's goal: that one stays too
        values, count = np.unique(goal, return_counts=True)
        contested = np.isin(goal, values[count > 1]) & (goal != start)
        if not contested.any():
            return goal, np.flatnonzero(goal != target).tolist()
        goal[contested] = start[contested]


def _planned(problem: Problem, graph: PlanGraph, open_: BoolArray, robots: IntArray, start: IntArray, goal: IntArray, planner: str) -> Plan:
    """A plan for some of the robots on the open lanes.

    Raises
    ------
    PlanError
        When there is none.
    """
    from mrp_sumo.planning.registry import planner as make

    count = len(robots)
    anew = replace(
        problem,
        graph=graph if open_.all() else _reduced(graph, open_),
        fleet=_some(problem.fleet, robots),
        start=frozen(start),
        goal=frozen(goal),
        goal_of=frozen(np.arange(count)),
    )
    try:
        method = make(planner, {})
        if hasattr(method, "rotations"):  # no order can keep them
            method = make(planner, {"rotations": False})
        method.prepare()
        result = method.plan(anew, PLANNING_LIMIT_S)
    except MrpSumoError as error:
        raise PlanError(f"{planner}: {error}") from error
    if result.plan is None or result.status not in (Status.SOLVED, Status.TIMED_OUT):
        raise PlanError(f"{planner} found no plan{': ' + result.message if result.message else ''}")
    return result.plan


def _reduced(graph: PlanGraph, open_: BoolArray) -> PlanGraph:
    """The same vertices with these lanes only."""
    lanes = np.flatnonzero(open_)
    nav = nav_graph(
        name=graph.name,
        xy=graph.xy,
        lanes=np.stack([graph.tail[lanes], graph.head[lanes]], 1),
        level_names=graph.level_names,
        level=graph.level,
        vertex_name=graph.vertex_name,
        vertex_options=graph.vertex_options,
        length_m=graph.length_m[lanes],
        speed_mps=graph.speed_mps[lanes],
        lane_options=[graph.lane_options[lane] for lane in lanes.tolist()],
        source=graph.source,
    )
    fields = {name: getattr(nav, name) for name in NavGraph.__dataclass_fields__}
    own = {name: getattr(graph, name) for name in PlanGraph.__dataclass_fields__ if name not in fields}
    return PlanGraph(**fields, **own)


def _some(fleet: Fleet, robots: IntArray) -> Fleet:
    columns = {name: getattr(fleet, name)[robots] for name in Fleet.__dataclass_fields__ if name != "robot_name"}
    return Fleet(robot_name=tuple(fleet.robot_name[r] for r in robots.tolist()), **columns)
