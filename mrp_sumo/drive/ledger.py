"""The ledger: every visit that robots have been given and that is not over, and who passes whom.

Visits are appended under ids that do not change until the ledger forgets those that are over; that happens between two steps, and
callers that keep ids for longer ask for them again. What was planned and driven is kept by entry, for logs. Where a robot is sent
another way, its visits beyond the last one it has been granted, or beyond a cut, are cut off, and the new ones are linked in their
place; what it holds, has done and has been booked stays as it is. The order of passages is that of the policy over all visits that
are still to be made; what robots hold comes first in it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.execution import Reply
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, PlanGraph, frozen
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem, Standing
from mrp_sumo.core.task import Task
from mrp_sumo.core.visits import Visits
from mrp_sumo.drive import _grants, _observe
from mrp_sumo.drive._causes import DISTURBED, TURNED_RAD
from mrp_sumo.drive.live_plan import LivePlan, in_grains
from mrp_sumo.drive.motion_plan import Departure, MotionPlan, motion_plan
from mrp_sumo.drive.policy import DecidingPolicy, Policy
from mrp_sumo.drive.reroute import Replan, Reroute
from mrp_sumo.drive.state import NEVER, Kinematics, VisitNeeds, for_kernels, state_at_rest
from mrp_sumo.errors import PlanError
from mrp_sumo.search._bodies import TIE_M
from mrp_sumo.traffic.moves import ANYWHERE, BOUND, STANDING, UNDER_WAY, standing_at_starts
from mrp_sumo.traffic.passages import Needs, Schedule, in_places, order_of
from mrp_sumo.traffic.resources import Resources
from mrp_sumo.traffic.schedule import check_order
from mrp_sumo.traffic.turns import stands_bent, turns_of

NO_VISIT = {  # what a place in the arrays [N] of `Visits` holds where there is no visit
    **dict.fromkeys(("next", "lane"), -1),
    **dict.fromkeys(("rank", "vertex", "gear"), 0),
    **dict.fromkeys(
        ("from_m", "at_m", "heading_rad", "arrive_s", "depart_s", "earliest_s", "due_s", "short_of_m", "tangent_m", "bend_m"), 0.0
    ),
    **dict.fromkeys(("bend_mps", "limit_mps"), np.inf),
    "turns": False,
    "arrived_s": np.nan,
}
NO_NEED = {"resource": 0, "on_lane": False, "left_at_m": 0.0, "freed": False, "passage": 0, "closes": True}  # the same of `VisitNeeds` [M]
LOGGED = ("vertex", "arrive_s", "depart_s", "arrived_s")
MANY = 20_000  # visits, before which nothing is forgotten


@dataclass(frozen=True)
class TurnBack:
    """A robot that turned round on a lane: where on its way, and on the floor."""

    robot: int
    at_m: float
    xy: FloatArray  # [2]


@dataclass(eq=False)
class Entry:
    """An answer of the dispatcher as the ledger has it: the visits `begin` to `end`, but for those that are forgotten."""

    t_s: float
    reason: str
    text: str
    begin: int
    end: int
    robot: IntArray  # [K] ascending
    since: IntArray  # [K] number of the visit along the robot's way after which its new ones come
    count: IntArray  # [K] of its new visits
    past: dict[str, NDArray[Any]] | None = None  # [N] `LOGGED` of all its visits, since some are forgotten
    live: IntArray | None = None  # [M] places in `past` of those that are not


class Ledger:
    """Visits that R robots have been given to make, and the state they are in.

    Kernels see `visits`, `needs` and `state_records`, which are `state` by records. The arrays of visits and needs may be longer than
    there are visits.
    """

    def __init__(self, problem: Problem, resources: Resources) -> None:
        """Begin with robots that stand at their starts, hold them, and have nothing to do yet."""
        num_robots, graph = problem.num_robots, problem.graph
        self.problem = problem
        self.resources = resources
        self.tasks: tuple[Task, ...] = problem.tasks
        self.num_visits = self.num_needs = self._num_kept = 0
        self.entries: list[Entry] = []
        self.turn_backs: list[TurnBack] = []
        self.end_of_tasks = np.full(num_robots, -1)  # [R] vertex where each robot is to stay
        for task in self.tasks:
            self.end_of_tasks[task.robot] = task.end
        self._cut: IntArray | None = None  # [R] the visits beyond which nobody is granted anything, while there is a cut
        self._cut_m = np.zeros(num_robots)  # [R] how far robots may have come when it is lifted
        self._pause_before = np.zeros(0, np.int64)
        self._pieces = [[(r, r + 1)] for r in range(num_robots)]  # of each robot's way: ids [a, b)
        start = np.arange(num_robots)
        self.visits = Visits(
            **_room(NO_VISIT), first=start, last=start.copy(), reached=start.copy(), granted=start.copy(), reverse=graph.reverse
        )
        self.needs = VisitNeeds(first=np.zeros(1, np.int64), **_room(NO_NEED), passing=frozen(np.zeros(0, np.int64)))
        self.is_vehicle = problem.fleet.is_vehicle  # [R] who cannot turn in place
        self._goal, self._facing_rad = problem.target, np.where(self.is_vehicle, np.nan, problem.heading_at_target)
        self._at_start = standing_at_starts(problem)
        self._tows = problem.fleet.behind_m > 0
        self._behind = np.where(self._tows, graph.tail[self._at_start.lane], -1)  # [R] where trailers stand at first
        at_rest = Departure.at_rest(problem.heading_at_start, self._behind)
        laid_out = motion_plan(
            graph, resources, _at_starts(problem.start), at_rest, np.zeros(0, np.int64), problem.fleet.kind, problem.fleet.vehicle_of_kind
        )
        self._write(laid_out, np.ones(num_robots, np.bool_))
        self.state = state_at_rest(num_robots, laid_out.needs.num_resources, graph.num_lanes, start)
        self.state_records = for_kernels(self.state)
        _observe.begin(self.visits, self.state.motion, problem.heading_at_start)
        for r in range(num_robots):
            _grants.hold(self.state.holds, r, self._resources_of(r))

    @property
    def graph(self) -> PlanGraph:
        return self.problem.graph

    @property
    def num_robots(self) -> int:
        return self.problem.num_robots

    def ids(self, robot: int, since: int) -> IntArray:
        """Visits of a robot from one of them on, in the order in which it makes them."""
        pieces = self._pieces[robot]
        k = next(i for i, (a, b) in enumerate(pieces) if a <= since < b)
        parts = [np.arange(since, pieces[k][1]), *(np.arange(a, b) for a, b in pieces[k + 1 :])]
        return np.concatenate(parts)

    def all_ids(self, robot: int) -> IntArray:
        """All visits of a robot that it has made or is still to make."""
        return self.ids(robot, int(self.visits.first[robot]))

    def resources_from(self, robot: int, since: int) -> IntArray:
        """Resources that a robot holds, or needs on its way from a visit on."""
        needs = self._needs_of(self.ids(robot, since))[1]
        resource: IntArray = self.needs.resource[needs]
        return resource

    @property
    def turned(self) -> BoolArray:
        """[R] whether each robot faces as it is to stay at the end of its way; so does who may stay as it comes."""
        away = (self.state.facing_rad - self.state.motion.yaw_rad + np.pi) % (2 * np.pi) - np.pi
        return ~(np.abs(away) > TURNED_RAD)

    @property
    def yaw_rad(self) -> FloatArray:
        """[R] headings of the robots: of vehicles about, along their lane or backward."""
        visits, yaw = self.visits, self.state.motion.yaw_rad
        ahead = visits.next[visits.reached]
        under_way = (ahead >= 0) & (self.state.motion.s_m > visits.at_m[visits.reached])
        return yaw + np.pi * visits.gear[np.where(under_way, ahead, visits.reached)] if self.is_vehicle.any() else yaw

    @property
    def joint(self) -> IntArray:
        """[R] the visits after which new ways begin: those of the cut while there is one, else the last that robots have been granted."""
        return self.visits.granted.copy() if self._cut is None else self._cut

    @property
    def behind(self) -> IntArray:
        """[R] vertices on which trailers stand when new ways begin, -1: none."""
        lane = self.visits.lane[self.joint]
        return np.where(self._tows, np.where(lane >= 0, self.graph.tail[lane], self._behind), -1)

    @property
    def come_m(self) -> FloatArray:
        """[R] how far robots have come; while there is a cut, how far they may have come when new ways begin."""
        return self.state.motion.s_m if self._cut is None else self._cut_m

    @property
    def standing(self) -> Standing:
        """States in which vehicles are at their joints, or come to them, when new ways begin."""
        first = self._at_start
        if not self.is_vehicle.any():
            return first
        visits, joint, s_m = self.visits, self.joint, self.come_m
        has_moved = visits.lane[joint] >= 0
        does = np.where(has_moved, ANYWHERE, first.does)
        lane, gear = np.where(has_moved, visits.lane[joint], first.lane), np.where(has_moved, visits.gear[joint], first.gear)
        onward = visits.next[joint]
        is_bound = (visits.tangent_m[joint] > 0) & (onward >= 0)
        before_m = self.room_to_turn_m(lane)
        moved = self.is_vehicle & has_moved
        does[moved] = np.where(s_m >= visits.at_m[joint] - before_m, np.where(is_bound, BOUND, STANDING), UNDER_WAY)[moved]
        bound = moved & (does == BOUND)
        lane, gear = np.where(bound, visits.lane[onward], lane), np.where(bound, visits.gear[onward], gear)
        for r in np.flatnonzero(moved & (does == STANDING) & (visits.tangent_m[joint] > 0)).tolist():  # it ends on an arc
            vehicle = self.problem.fleet.types[int(self.problem.fleet.kind[r])]
            if (ahead := stands_bent(turns_of(self.graph, vehicle), int(lane[r]), int(gear[r]))) is not None:
                does[r], lane[r], gear[r] = BOUND, *ahead
        return Standing(does, lane, gear, visits.lane[joint])

    def room_to_turn_m(self, lane: IntArray) -> FloatArray:
        """[R] Distance before the end of its lane until which each vehicle has not begun to turn there."""
        half: FloatArray = np.where(lane >= 0, self.graph.length_m[lane] / 2, 0.0) + self.problem.fleet.axle_m
        return half

    @property
    def is_driving_back(self) -> BoolArray:
        """[R] whether a robot has turned round on its lane, and has not been granted the vertex behind it yet, to which it is to come."""
        visits, joint = self.visits, self.joint
        ahead = visits.next[joint]
        again: BoolArray = self.state.grants.turned_back & (ahead >= 0) & (visits.vertex[ahead] == visits.vertex[joint])
        return again

    @property
    def committed(self) -> tuple[tuple[int, ...], ...]:
        """[R] vertices that each robot is to pass whatever comes, from the last that it has come to, to where new ways begin."""
        visits, ways = self.visits, []
        for k, end in zip(visits.reached.tolist(), self.joint.tolist()):
            route = [int(visits.vertex[k])]
            while k != end:
                k = int(visits.next[k])
                route.append(int(visits.vertex[k]))
            ways.append(tuple(route))
        return tuple(ways)

    def cut(self, lead_s: float, kinematics: Kinematics, closed: BoolArray, stays: BoolArray) -> None:
        """Freeze what robots have been granted, and what they will be in some time; nobody is granted more until `lift`.

        Only where an order is kept. Everybody who passes a frozen visit's resources before has it frozen that he has left them, so that
        robots come to stand at the ends of what is frozen however late they are: a plan may begin there. For `lead_s` robots need not brake
        for the cut. Nobody may set out on lanes that are `closed` [L]; robots that stay [R] are granted nothing more.
        """
        motion, fleet = self.state.motion, self.problem.fleet
        accel_mps2 = fleet.accel_mps2 if fleet.loaded is None else np.maximum(fleet.accel_mps2, fleet.loaded.accel_mps2)
        faster_mps = np.minimum(motion.speed_mps + accel_mps2 * lead_s, np.maximum(kinematics.speed_mps, motion.speed_mps))
        self._cut_m = motion.s_m + (motion.speed_mps + faster_mps) / 2 * lead_s
        self._cut = self._grown(lead_s, kinematics, closed, stays) if len(self.needs.passing) else self.visits.granted.copy()
        pause = self.state.yielding.pause
        self._pause_before = pause.copy()
        np.minimum(pause, self.visits.rank[self._cut], out=pause)

    def give_back(self, robots: IntArray) -> None:
        """Robots that stand for good give back what they have been granted beyond the visit to which they are under way."""
        visits, grants, s_m = self.visits, self.state.grants, self.state.motion.s_m
        for r in robots.tolist():
            last, granted = int(visits.reached[r]), int(visits.granted[r])
            if last != granted and s_m[r] > visits.at_m[last] + TIE_M:
                last = int(visits.next[last])
            if last == granted:
                continue
            beyond = self.ids(r, last)[1:]
            beyond = beyond[visits.rank[beyond] <= visits.rank[granted]]
            needs = self._needs_of(beyond)[1]
            entered = visits.next[[granted]] if grants.on_lane[r] else beyond[:0]
            lanes = visits.lane[np.append(beyond, entered)]
            _grants.give_back(self.state, visits, r, last, self.needs.resource[needs[~self.needs.freed[needs]]], lanes)
            self.state.yielding.pause[r] = visits.rank[last]

    def lift(self) -> None:
        """Robots may be granted what comes after the cut."""
        if self._cut is not None:
            self.state.yielding.pause[:] = self._pause_before
            self._cut = None

    def _grown(self, lead_s: float, kinematics: Kinematics, closed: BoolArray, stays: BoolArray) -> IntArray:
        """[R] the cut: visits are added as long as those who pass before are within it."""
        visits, grants = self.visits, self.state.grants
        rank, following, at_m, lane = visits.rank, visits.next, visits.at_m, visits.lane
        cut = visits.granted.copy()
        top, pause = kinematics.speed_mps, self.state.yielding.pause
        to_m = self.state.motion.s_m + top * lead_s + top**2 / (2 * kinematics.decel_mps2) + kinematics.reach_m
        needs, turn = self.needs, self.state.holds.turn
        left = self._left_ranks()
        growing = [r for r in range(self.num_robots) if not stays[r]]
        grown = True
        while grown and growing:
            grown, still = False, []
            for r in growing:
                while True:
                    m = int(cut[r])
                    k = int(following[m])
                    entered = m == visits.granted[r] and grants.on_lane[r]
                    if k < 0 or rank[m] >= pause[r] or (at_m[m] >= to_m[r] - TIE_M and not entered) or (closed[lane[k]] and not entered):
                        break
                    mine = slice(needs.first[k], needs.first[k + 1])
                    before = (
                        j for q, p in zip(needs.resource[mine].tolist(), needs.passage[mine].tolist()) for j in range(int(turn[q]), p)
                    )
                    if not all((other := int(needs.passing[j])) == r or rank[cut[other]] >= left[j] for j in before):
                        still.append(r)
                        break
                    cut[r], grown = k, True
            growing = still
        return cut

    def _left_ranks(self) -> IntArray:
        """[E] rank of the visit at whose arrival each passage is over; 0 where it is."""
        ids = np.concatenate([self.ids(r, oldest) for r, oldest in enumerate(self.state.grants.oldest.tolist())])
        first, at = self._needs_of(ids)
        needs, rank = self.needs, np.repeat(self.visits.rank[ids], np.diff(first))
        closes = needs.closes[at]
        left = np.zeros(len(self.needs.passing), np.int64)
        left[needs.passage[at[closes]]] = (rank + ~needs.on_lane[at])[closes]
        return left

    def append(self, replan: Replan, policy: Policy, now_s: float) -> None:
        """Send robots on their ways, or other ways from the last visits that they have been granted, or from the cut, which is lifted.

        Raises PlanError when the policy keeps an order and the new one cannot be kept; then nothing has changed.
        """
        robots = np.array(sorted(replan.reroute), np.int64)
        ways = [replan.reroute[r] for r in robots.tolist()]
        joints = self.joint
        joint = joints[robots]
        plan = _from_joints(ways, self.visits.vertex[joint], now_s)
        does = self.standing.does[robots]
        departure = self._departure(robots, joint, ways, does)
        needless = np.flatnonzero(np.isin(robots, sorted(replan.left_alone)))
        laid_out = motion_plan(
            self.graph, self.resources, plan, departure, needless, self.problem.fleet.kind[robots], self.problem.fleet.vehicle_of_kind
        )
        fresh = np.ones(plan.num_visits, np.bool_)  # all but the joints, which are here already
        fresh[plan.first[:-1]] = False
        before = self.num_visits, self.num_needs
        ids = self._write(laid_out, fresh)
        ids[~fresh] = joint
        new = {r: ids[plan.first[i] + 1 : plan.first[i + 1]] for i, r in enumerate(robots.tolist())}
        leave_s = dict(zip(robots.tolist(), plan.depart_s[plan.first[:-1]].tolist()))
        # what robots hold comes first in the order; a first plan has them at their starts from 0 s on
        live, at = self._live(new, joints, leave_s, now_s - 1.0 if self.entries else now_s)
        try:
            schedule = policy.order(self.problem, live, self._plan_needs(at))
        except PlanError:
            self.num_visits, self.num_needs = before
            raise
        self.lift()
        since, count = self.visits.rank[joint], np.diff(plan.first) - 1
        self.entries.append(Entry(now_s, replan.reason, replan.text, before[0], self.num_visits, robots, since, count))
        self._face(robots, laid_out.heading_rad[plan.first[:-1]], np.diff(plan.first) > 1)
        self._turn_back([r for r, route in zip(robots.tolist(), ways) if route.back])
        self._take_over_joints(laid_out, ids, does)
        for r, visits in new.items():
            self._link(r, int(joints[r]), visits)
        self._keep_order(policy, live, at, schedule)
        for r, route in zip(robots.tolist(), ways):
            self._set_out_anew(r, route, now_s)
        for r, vertex in replan.ends.items():
            self.end_of_tasks[r] = vertex
        self.state.home[:] = self.visits.vertex[self.visits.last] == self.end_of_tasks
        self.state.facing_rad[:] = np.where(self.state.home & (self.end_of_tasks == self._goal), self._facing_rad, np.nan)
        goal_s = self.state.waits.goal_s[robots]
        stays = (self.state.home & (self.visits.last == self.visits.reached) & self.turned)[robots]
        _observe.stand_at_goal(self.state.waits, robots, np.where(stays, np.where(np.isfinite(goal_s), goal_s, now_s), np.nan))
        for r in sorted(replan.left_alone):
            self.state.yielding.pause[r] = self.visits.rank[self.visits.granted[r]]

    @property
    def is_full(self) -> bool:
        """True if most visits are over, and there are many."""
        return self.num_visits > max(MANY, 4 * self._num_kept)

    def forget(self, needed: IntArray) -> None:
        """Forget visits that are over or cut off, but not `needed` [R] and those after them. Ids change, those of `needed` in place."""
        visits, needs, ids = self.visits, self.needs, []
        for r, oldest in enumerate(self.state.grants.oldest.tolist()):
            mine, reached = self.all_ids(r), int(visits.reached[r])
            since = int(np.searchsorted(visits.rank[mine], min(visits.rank[reached], visits.rank[oldest], visits.rank[needed[r]])))
            ids.append(mine[max(0, since - 1) :])  # robots stop a little short of what they have reached
        keep = np.zeros(self.num_visits, np.bool_)
        keep[np.concatenate(ids)] = True
        for entry in self.entries:
            self._log(entry, keep)
        new = np.append(np.where(keep, np.cumsum(keep) - 1, -1), -1)  # the last place is that of -1, no visit
        new_begin = np.append(0, np.cumsum(keep))
        for entry in self.entries:
            entry.begin, entry.end = int(new_begin[entry.begin]), int(new_begin[entry.end])
        for r, mine in enumerate(ids):
            breaks = np.flatnonzero(np.diff(mine) != 1) + 1
            self._pieces[r] = [(int(new[part[0]]), int(new[part[-1]]) + 1) for part in np.split(mine, breaks)]
        count = np.diff(needs.first[: self.num_visits + 1])
        need = np.repeat(keep, count)
        of_visit = {name: getattr(visits, name)[: self.num_visits][keep] for name in NO_VISIT}
        of_robot = {name: new[getattr(visits, name)] for name in ("last", "reached", "granted")}
        first = np.array([new[mine[0]] for mine in ids], np.int64)
        self.visits = Visits(**of_visit | {"next": new[of_visit["next"]]}, first=first, **of_robot, reverse=visits.reverse)
        of_need = {name: getattr(needs, name)[: self.num_needs][need] for name in NO_NEED}
        self.needs = needs._replace(first=np.concatenate([[0], np.cumsum(count[keep])]).astype(np.int64), **of_need)
        _grants.renumber(self.state.grants, new)
        _observe.renumber(self.state.waits, new)
        needed[:] = new[needed]
        if self._cut is not None:
            self._cut = new[self._cut]
        self.num_visits = self._num_kept = int(keep.sum())
        self.num_needs = int(need.sum())

    def _log(self, entry: Entry, keep: BoolArray) -> None:
        """Write down what is forgotten of an entry."""
        mine = slice(entry.begin, entry.end)
        if keep[mine].all():
            return
        if entry.past is None:
            entry.past, entry.live = {name: getattr(self.visits, name)[mine].copy() for name in LOGGED}, np.arange(entry.end - entry.begin)
        assert entry.live is not None
        for name in ("depart_s", "arrived_s"):
            entry.past[name][entry.live] = getattr(self.visits, name)[mine]
        entry.live = entry.live[keep[mine]]

    def logged(self, entry: Entry) -> dict[str, NDArray[Any]]:
        """[N] `LOGGED` of the visits of an entry, as they are now or were when they were forgotten."""
        mine = slice(entry.begin, entry.end)
        if entry.past is None or entry.live is None:
            return {name: getattr(self.visits, name)[mine] for name in LOGGED}
        columns = {name: column.copy() for name, column in entry.past.items()}
        for name in ("depart_s", "arrived_s"):
            columns[name][entry.live] = getattr(self.visits, name)[mine]
        return columns

    def decide(self, policy: DecidingPolicy, now_s: float) -> bool:
        """Let a policy change the order of the passages that are still to be made. Returns whether it did.

        Raises PlanError when its order cannot be kept, or lets somebody pass before a robot that has been granted the passage already.
        """
        granted_ids = self.visits.granted.tolist()
        ahead = {r: self.ids(r, visit)[1:] for r, visit in enumerate(granted_ids)}
        leave_s = dict(enumerate(self.visits.depart_s[granted_ids].tolist()))
        live, ids = self._live(ahead, self.visits.granted, leave_s, -1.0)
        needs = self._plan_needs(ids)
        schedule = policy.decide(self.problem, self._under_way(live, ids, needs, now_s), needs, now_s)
        if schedule is None:
            return False
        check_order(self.problem, live, schedule)
        granted = self.visits.rank[ids] <= self.visits.rank[self.visits.granted][live.robot]
        behind = schedule.robot[1:] != schedule.robot[:-1]
        behind[schedule.first[1:-1][(schedule.first[1:-1] > 0) & (schedule.first[1:-1] < schedule.num_passages)] - 1] = False
        late = np.flatnonzero(behind & granted[schedule.visit[1:]] & ~granted[schedule.visit[:-1]])
        if len(late):
            names, k = self.problem.fleet.robot_name, int(late[0])
            one, other = names[schedule.robot[k]], names[schedule.robot[k + 1]]
            raise PlanError(f"the new order lets {one} pass before {other}, which is on its way already")
        self._take_order(ids, schedule)
        return True

    def _under_way(self, plan: Plan, ids: IntArray, needs: Needs, now_s: float) -> LivePlan:
        visits, reached, motion = self.visits, self.visits.reached, self.state.motion
        ahead = visits.next[reached]
        late_s = visits.arrived_s[reached] - visits.arrive_s[reached]
        place = self.needs.passage[self._needs_of(ids)[1]]
        return LivePlan(
            **vars(plan),
            order=in_places(order_of(plan, needs), place) if len(self.needs.passing) else None,
            driven_m=frozen(in_grains(motion.s_m - visits.at_m[reached])),
            late_s=frozen(in_grains(np.where(ahead >= 0, np.maximum(late_s, now_s - visits.arrive_s[ahead]), late_s))),
            held=frozen(self.state.grants.cause == DISTURBED),
        )

    def _write(self, laid_out: MotionPlan, fresh: BoolArray) -> IntArray:
        """Append the fresh visits with their needs. Returns [N] the ids of the plan's visits, where fresh."""
        plan, needs = laid_out.plan, laid_out.needs
        begin, count = self.num_visits, int(fresh.sum())
        needed = fresh[needs.visit]
        need_begin, need_count = self.num_needs, int(needed.sum())
        self._make_room(begin + count, need_begin + need_count)
        part = slice(begin, begin + count)
        visits = self.visits
        visits.vertex[part], visits.arrive_s[part], visits.depart_s[part] = plan.vertex[fresh], plan.arrive_s[fresh], plan.depart_s[fresh]
        visits.lane[part], visits.from_m[part], visits.at_m[part] = laid_out.lane[fresh], laid_out.from_m[fresh], laid_out.at_m[fresh]
        visits.heading_rad[part], visits.turns[part] = laid_out.heading_rad[fresh], laid_out.turns[fresh]
        visits.short_of_m[part] = laid_out.short_of_m[fresh]
        visits.gear[part], visits.limit_mps[part] = laid_out.gear[fresh], laid_out.limit_mps[fresh]
        visits.tangent_m[part] = laid_out.tangent_m[fresh]
        visits.bend_m[part], visits.bend_mps[part] = laid_out.bend_m[fresh], laid_out.bend_mps[fresh]
        of_visit = np.bincount(needs.visit, minlength=plan.num_visits)[fresh]
        self.needs.first[begin + 1 : begin + count + 1] = need_begin + np.cumsum(of_visit)
        part = slice(need_begin, need_begin + need_count)
        self.needs.resource[part] = needs.resource[needed]
        self.needs.on_lane[part] = needs.on_lane[needed]
        self.needs.left_at_m[part] = laid_out.left_at_m[needed]
        self.num_visits, self.num_needs = begin + count, need_begin + need_count
        ids: IntArray = begin + np.cumsum(fresh) - 1
        return ids

    def _make_room(self, num_visits: int, num_needs: int) -> None:
        """Arrays twice as long where they do not suffice, so that appending takes constant time a visit."""
        if num_visits > len(self.visits.next):
            self.visits = self.visits._replace(**{k: _longer(getattr(self.visits, k), num_visits, empty) for k, empty in NO_VISIT.items()})
            self.needs = self.needs._replace(first=_longer(self.needs.first, num_visits + 1, 0))
        if num_needs > len(self.needs.resource):
            self.needs = self.needs._replace(**{k: _longer(getattr(self.needs, k), num_needs, empty) for k, empty in NO_NEED.items()})

    def _live(self, new: Mapping[int, IntArray], joints: IntArray, leave_s: Mapping[int, float], before_s: float) -> tuple[Plan, IntArray]:
        """The plan from the last visits that robots have reached on, and [N] the ids of its visits.

        Robots with an entry in `new` leave their joints at `leave_s` for these. What they have been granted is planned for
        `before_s`, so that it comes first; what they have not been granted up to their joints comes next, in its order, within a second.
        """
        visits, reached, granted = self.visits, self.visits.reached, self.visits.granted
        ids, granted_already, not_granted, leaves, first = [], [], [], [], [0]
        for r in range(self.num_robots):
            route = self.ids(r, int(reached[r]))
            if r in new:
                ranks = visits.rank[route]
                begun = route[: int(np.searchsorted(ranks, visits.rank[joints[r]])) + 1]
                num_granted = int(np.searchsorted(ranks, visits.rank[granted[r]])) + 1
                route = np.concatenate([begun, new[r]])
                granted_already.append(np.arange(len(route)) < num_granted)
                not_granted.append((np.arange(len(route)) >= num_granted) & (np.arange(len(route)) < len(begun)))
                leaves.append((first[-1] + len(begun) - 1, leave_s[r]))
            else:
                granted_already.append(np.zeros(len(route), np.bool_))
                not_granted.append(np.zeros(len(route), np.bool_))
            ids.append(route)
            first.append(first[-1] + len(route))
        at, before = np.concatenate(ids), np.concatenate(granted_already)
        arrive_s = np.where(before, before_s, visits.arrive_s[at])
        depart_s = np.where(before, before_s, visits.depart_s[at])
        due = np.flatnonzero(np.concatenate(not_granted))
        if len(due):
            entry = np.searchsorted([entry.begin for entry in self.entries], at[due], side="right")
            squeezed = _squeezed(np.tile(entry, 2), np.concatenate([arrive_s[due], depart_s[due]]), before_s)
            arrive_s[due], depart_s[due] = squeezed[: len(due)], squeezed[len(due) :]
        for place, time_s in leaves:
            depart_s[place] = time_s
        plan = Plan(
            first=frozen(np.array(first, np.int64)),
            vertex=frozen(visits.vertex[at]),
            arrive_s=frozen(arrive_s),
            depart_s=frozen(depart_s),
        )
        return plan, at

    def _needs_of(self, ids: IntArray) -> tuple[IntArray, IntArray]:
        """Of some visits [K], what they still need: CSR offsets [K + 1], and the needs."""
        begin, end = self.needs.first[ids], self.needs.first[ids + 1]
        count = end - begin
        needs = np.repeat(begin - np.cumsum(count) + count, count) + np.arange(int(count.sum()))
        needed = ~self.needs.freed[needs]
        left = np.bincount(np.repeat(np.arange(len(ids)), count)[needed], minlength=len(ids))
        return np.concatenate([[0], np.cumsum(left)]).astype(np.int64), needs[needed]

    def _plan_needs(self, ids: IntArray) -> Needs:
        """What some visits still need, as policies see it."""
        first, needed = self._needs_of(ids)
        return Needs(frozen(first), self.needs.resource[needed], self.needs.on_lane[needed], len(self.state.holds.holder))

    def _keep_order(self, policy: Policy, plan: Plan, ids: IntArray, schedule: Schedule | None) -> None:
        """Let the visits that are still to be made be driven as the policy says."""
        self.visits.earliest_s[ids] = policy.earliest_s(plan)
        self.visits.due_s[ids] = plan.arrive_s if policy.paced else 0.0
        self._take_order(ids, schedule)

    def _take_order(self, ids: IntArray, schedule: Schedule | None) -> None:
        """Robots pass in this order from now on; without one, first come, first served."""
        needs = self.needs = self.needs._replace(passing=frozen(np.zeros(0, np.int64)) if schedule is None else schedule.robot)
        first, at = self._needs_of(ids)
        if schedule is None:
            needs.closes[at] = True
            _grants.take_turns(self.state.holds, 0)
            return
        needs.passage[at] = schedule.passage_of_need
        needs.closes[at] = schedule.last_visit[schedule.passage_of_need] == np.repeat(np.arange(len(ids)), np.diff(first))
        _grants.take_turns(self.state.holds, schedule.first[:-1])

    def _departure(self, robots: IntArray, joint: IntArray, ways: Sequence[Reroute], does: IntArray) -> Departure:
        visits, motion = self.visits, self.state.motion
        stands = self.visits.reached[robots] == joint
        back, turned = np.array([route.back for route in ways], np.bool_), self.is_driving_back[robots]
        ahead = np.where(back | turned, visits.next[joint], joint)  # a last visit has no next one, and no lane to it
        lane = np.where(back, self.graph.reverse[visits.lane[ahead]], np.where(turned, visits.lane[ahead], -1))
        is_vehicle, has_moved = self.is_vehicle[robots], visits.lane[joint] >= 0
        heading = np.where(stands & ~(is_vehicle & has_moved), motion.yaw_rad[robots], visits.heading_rad[joint])
        return Departure(
            at_m=visits.at_m[joint],
            heading_rad=np.where(is_vehicle & ~has_moved, self.problem.heading_at_start[robots], heading),
            lane=visits.lane[joint],
            back_lane=lane,
            back_m=motion.s_m[robots] - visits.at_m[joint],  # it stands where it turned
            gear=visits.gear[joint],
            behind=self.behind[robots],
            may_turn=does != STANDING,
        )

    def _face(self, robots: IntArray, heading_rad: FloatArray, goes: BoolArray) -> None:
        """Robots whose headings are not known face the way that they go [K]; those that go nowhere, as they are to stay, or east."""
        motion = self.state.motion
        new = np.isnan(motion.yaw_rad[robots])
        heading_rad = np.where(goes | np.isnan(self._facing_rad[robots]), heading_rad, self._facing_rad[robots])
        _observe.face(motion, robots[new], heading_rad[new])
        _observe.face(motion, np.flatnonzero(np.isnan(motion.yaw_rad)), 0.0)
        self.visits.heading_rad[self.visits.first[robots[new]]] = heading_rad[new]

    def _turn_back(self, robots: Sequence[int]) -> None:
        """Remember where robots turn round on their lanes."""
        visits, xy = self.visits, self.graph.xy
        for r in robots:
            behind = int(self.visits.granted[r])
            ahead = int(visits.next[behind])
            at_m = float(self.state.motion.s_m[r])
            share = (at_m - visits.at_m[behind]) / (visits.at_m[ahead] - visits.at_m[behind])
            begin, end = xy[visits.vertex[behind]], xy[visits.vertex[ahead]]
            self.turn_backs.append(TurnBack(r, at_m, begin + share * (end - begin)))

    def _take_over_joints(self, laid_out: MotionPlan, ids: IntArray, does: IntArray) -> None:
        """Robots leave joints by other lanes: where they turn there, and when they have left what they need there, is new."""
        visits, needs, plan = self.visits, self.needs, laid_out.plan
        for i, place in enumerate(plan.first[:-1].tolist()):
            joint = int(ids[place])
            visits.depart_s[joint] = plan.depart_s[place]
            visits.turns[joint] = laid_out.turns[place]
            if does[i] != BOUND:
                visits.tangent_m[joint] = laid_out.tangent_m[place]
                visits.bend_m[joint], visits.bend_mps[joint] = laid_out.bend_m[place], laid_out.bend_mps[place]
            mine = np.arange(self.needs.first[joint], self.needs.first[joint + 1])
            mine = mine[~needs.on_lane[mine]]
            needs.left_at_m[mine] = laid_out.left_at_m[laid_out.needs.first[place] : laid_out.needs.first[place + 1]]

    def _link(self, robot: int, joint: int, new: IntArray) -> None:
        """Put visits in the place of those that came after a joint."""
        visits, pieces, oldest = self.visits, self._pieces[robot], int(self.state.grants.oldest[robot])
        if visits.rank[oldest] > visits.rank[joint]:  # it is among those that are cut off
            _grants.may_hold_from(self.state.grants, robot, joint)
        k = next(i for i, (a, b) in enumerate(pieces) if a <= joint < b)
        pieces[k:] = [(pieces[k][0], joint + 1)] + ([(int(new[0]), int(new[-1]) + 1)] if len(new) else [])
        visits.next[joint] = new[0] if len(new) else -1
        visits.next[new[:-1]] = new[1:]
        visits.next[new[-1:]] = -1
        visits.rank[new] = visits.rank[joint] + 1 + np.arange(len(new))
        self.visits.last[robot] = new[-1] if len(new) else joint

    def _set_out_anew(self, robot: int, route: Reroute, now_s: float) -> None:
        """What a robot waited for is over; it asks again on its new way."""
        granted, yielding, grants = int(self.visits.granted[robot]), self.state.yielding, self.state.grants
        yielding.gives_way[robot], yielding.pause_for[robot] = route.pause >= 0, -1
        yielding.pause[robot] = self.visits.rank[granted] + route.pause if route.pause >= 0 else NEVER
        s_m = float(self.state.motion.s_m[robot])
        if route.back:
            behind = int(self.visits.next[granted])
            _grants.turn_back(self.state, robot, s_m, int(self.visits.lane[behind]), self._resources_of(behind))
        _grants.ask_anew(grants, robot, granted)
        _observe.go_elsewhere(self.state.waits, robot, s_m, now_s)

    def let_pass(self, robot: int, other: int) -> None:
        """A robot that gives way lets another one pass; -1: it goes on."""
        yielding = self.state.yielding
        yielding.pause_for[robot] = other
        if other < 0:
            yielding.pause[robot], yielding.gives_way[robot] = NEVER, False

    def stay_facing(self, robot: int, yaw_rad: float) -> None:
        """A robot is to face so at the end of its way, NaN: as it comes."""
        self.state.facing_rad[robot] = yaw_rad

    def _resources_of(self, visit: int) -> IntArray:
        return self.needs.resource[self.needs.first[visit] : self.needs.first[visit + 1]]


def planned_arrivals(ledger: Ledger) -> FloatArray:
    """[N] when robots arrived at the visits of the first plan, which begin with their starts; NaN: not."""
    entry = ledger.entries[0]
    return np.insert(ledger.logged(entry)["arrived_s"], np.cumsum(entry.count) - entry.count, 0.0)


def replies_of(ledger: Ledger) -> tuple[Reply, ...]:
    """Replies after the first plan, as they were driven."""
    replies = []
    for entry in ledger.entries[1:]:
        columns = {name: frozen(column) for name, column in ledger.logged(entry).items()}
        first = frozen(np.concatenate([[0], np.cumsum(entry.count)]).astype(np.int64))
        replies.append(Reply(entry.t_s, entry.reason, entry.text, entry.robot, first, frozen(entry.since), **columns))
    return tuple(replies)


def _at_starts(start: IntArray) -> Plan:
    num_robots = len(start)
    return Plan(frozen(np.arange(num_robots + 1)), start, frozen(np.zeros(num_robots)), frozen(np.full(num_robots, np.inf)))


def _from_joints(ways: Sequence[Reroute], vertex: IntArray, now_s: float) -> Plan:
    """The plan of K robots that leave the vertices [K] of their joints."""
    first = np.cumsum([0] + [len(route.vertex) + 1 for route in ways])
    before = now_s - 1.0
    return Plan(
        first=frozen(first.astype(np.int64)),
        vertex=frozen(np.concatenate([part for v, route in zip(vertex.tolist(), ways) for part in ([v], route.vertex)]).astype(np.int64)),
        arrive_s=frozen(np.concatenate([part for route in ways for part in ([before], route.arrive_s)]).astype(np.float64)),
        depart_s=frozen(np.concatenate([part for route in ways for part in ([route.leave_s], route.depart_s)]).astype(np.float64)),
    )


def _squeezed(entry: IntArray, time_s: FloatArray, begin_s: float) -> FloatArray:
    """[N] times of visits by entry, of which several may still have some, in their order within the second from `begin_s` on."""
    order = np.lexsort((time_s, entry))
    later = (time_s[order[1:]] > time_s[order[:-1]]) | (entry[order[1:]] > entry[order[:-1]])
    place = np.concatenate([[0], np.cumsum(later)])
    squeezed = np.empty(len(order))
    squeezed[order] = begin_s + 0.05 + 0.9 * place / (place[-1] + 1)
    return squeezed


def _room(empty: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Arrays without places, of the types of what these will hold."""
    return {name: np.zeros(0, np.asarray(value).dtype) for name, value in empty.items()}


def _longer(column: NDArray[Any], needed: int, empty: Any) -> NDArray[Any]:
    longer = np.full(max(needed, 2 * len(column)), empty, column.dtype)
    longer[: len(column)] = column
    return longer
