"""Recovery: a dispatcher that sees who does not get on, and asks for other ways, the mildest first.

* In a ring of waiting (first come, first served) one robot gives way at once, `drive.giving_way`.
* A robot that has stood for the patience behind something that stays (a closed lane, a robot that is broken or at its
  goal) takes the shortest way around it, first come, first served.
* If that is not to be had, or the policy keeps an order, or a ring has lasted for the patience, any registered
  planner replans all robots, `drive.replanning`; the new plan's order is kept.

A robot that can reach its goal no more stays where it is until a lane opens. Gives up trying, saying why, when there is no plan
or its order cannot be kept, and tries again after twice the time.
"""

from collections import Counter
from collections.abc import Iterator

import numpy as np

from mrp_sumo.core.execution import Event
from mrp_sumo.core.graph import BoolArray
from mrp_sumo.core.request import Request
from mrp_sumo.drive import _causes
from mrp_sumo.drive.deadlock import DeadlockWatch
from mrp_sumo.drive.giving_way import GivingWay, still_to_pass, who_gives_way
from mrp_sumo.drive.ledger import Ledger
from mrp_sumo.drive.replanning import AnswerLimits, lanes_needing, replan, request_for, situation
from mrp_sumo.drive.reroute import Replan, Reroute
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.drive.surroundings import Surroundings
from mrp_sumo.drive.world import World
from mrp_sumo.errors import PlanError
from mrp_sumo.search.route import shortest_route

GIVE_WAY, DETOUR, REPLAN = "give_way", "detour", "replan"
MOST_DOUBLINGS = 30  # of the time until a planner is asked again: longer than any run
SAME_RING = 3  # so many times a ring of the same robots is asked to give way, before a planner is


class Recovery:
    """Requests, and answers to them, where robots do not get on in the course of one execution; see `drive.dispatcher.Dispatcher`."""

    def __init__(self, ledger: Ledger, world: World, settings: ExecutionSettings) -> None:
        self.ledger, self.world, self.settings = ledger, world, settings
        self.watch = DeadlockWatch()
        self._events: list[Event] = []
        self._giving: list[GivingWay] = []
        self._barred_since = np.full(ledger.num_robots, np.inf)  # [R] before a closed lane
        self._ring_since: dict[tuple[int, ...], float] = {}
        self._asked: Counter[frozenset[int]] = Counter()
        self._reported: set[str] = set()
        self._reported_blocked = np.zeros(ledger.num_robots, np.bool_)  # [R]
        self._failures = 0
        self._again_s = 0.0  # no planner is asked before
        self._cut_off = False  # a robot waits for a lane to open
        self._num_closed = 0

    def finished(self, now_s: float, context: Surroundings) -> bool:
        """It has no work of its own."""
        return True

    @property
    def is_quiet(self) -> bool:
        """True if nobody gives way, and nobody is in a ring of waiting or blocked for good."""
        return not (self._giving or self.watch.known or self._ring_since or self._reported_blocked.any())

    def finally_blocked(self, now_s: float) -> list[Event]:
        """Robots that have come to be blocked for good since the last look: by one that is broken, done, or has given up."""
        if not self.ledger.state.waits.stuck.any():
            self._reported_blocked[:] = False
            return []
        for_good = self._for_good(np.zeros(self.ledger.num_robots, np.bool_)) & (self.ledger.state.grants.cause == _causes.OTHER)
        new = np.flatnonzero(for_good & ~self._reported_blocked).tolist()
        self._reported_blocked = for_good
        return [self._blocked_for_good(now_s, r) for r in new]

    def _blocked_for_good(self, now_s: float, robot: int) -> Event:
        state, names = self.ledger.state, self.ledger.problem.fleet.robot_name
        other, last = int(state.grants.other[robot]), self._end_of_chain(robot, self._stays())
        why = "is broken" if self.world.broken[last] else "stays at its goal" if self.ledger.state.home[last] else "stays"
        behind = f"behind {names[other]}" + (f", which waits for {names[last]}" if last != other else "")
        vertex = int(self.ledger.visits.vertex[state.grants.wanted[robot]])
        return Event(now_s, "blocked_for_good", robot, vertex, other, 0.0, f"{behind}, which {why}")

    def due(self, now_s: float, context: Surroundings) -> Iterator[Request]:
        """See Dispatcher; the mildest first."""
        if self.settings.on_deadlock != "resolve":
            return
        self._let_go(now_s, context)
        state, keeps_order = self.ledger.state, len(self.ledger.needs.passing) > 0
        barred = self._barred(now_s)
        self._ring_since = {ring: self._ring_since.get(ring, now_s) for ring in sorted(self.watch.known)}
        can_step_aside = not self.ledger.is_vehicle.any()
        if self.settings.recovery.give_way and not keeps_order and can_step_aside:
            for ring in self._ring_since:
                if self._asked[frozenset(ring)] < SAME_RING:
                    yield request_for(now_s, context, ring, GIVE_WAY)
        patience_s = self.settings.recovery.patience_s
        stuck = state.waits.stuck & (now_s - state.waits.mark_s >= patience_s)
        late = np.flatnonzero(barred | (stuck & self._for_good(barred))).tolist()
        if late and not keeps_order and can_step_aside:
            yield request_for(now_s, context, late, DETOUR)
        opened = self._cut_off and np.count_nonzero(self.world.closed) < self._num_closed
        old = any(now_s - since >= patience_s for since in self._ring_since.values())
        if self.settings.recovery.replanner and (late or old or opened) and now_s >= self._again_s:
            yield request_for(now_s, context, range(self.ledger.num_robots), REPLAN)

    def answer(self, request: Request, context: Surroundings) -> Replan | None:
        """See Dispatcher."""
        now_s, robots = request.now_s, tuple(request.robot.tolist())
        if request.reason == GIVE_WAY:
            return self._give_way(now_s, robots, context)
        if request.reason == DETOUR:
            return self._drive_around(now_s, robots, context)
        try:
            standing = situation(now_s, context, self.world.broken | context.crew.serving, self.ledger.end_of_tasks)
            answer = replan(standing, context, self.settings.recovery.replanner or "", {}, AnswerLimits())
        except PlanError as error:
            self.refused(error, now_s)
            return None
        self._cut_off_then = bool(standing.cut_off)
        return answer

    def accepted(self, answer: Replan, now_s: float) -> None:
        """The ledger has it."""
        self.watch.forget(set(answer.reroute))
        if not answer.reordered:
            return
        self._end_all(now_s)
        if answer.reason != REPLAN:  # another dispatcher's
            self._ring_since.clear()
            return
        self._failures, self._cut_off = 0, self._cut_off_then
        self._again_s = now_s + self.settings.recovery.patience_s
        self._num_closed = int(np.count_nonzero(self.world.closed))
        self._ring_since.clear()
        self._events.append(Event(now_s, "resolved", -1, text=answer.text))

    def refused(self, error: PlanError, now_s: float) -> None:
        """There is no new plan, or nobody can keep its order."""
        why = str(error)
        self._failures += 1
        self._again_s = now_s + self.settings.recovery.patience_s * 2 ** min(self._failures, MOST_DOUBLINGS)
        if why not in self._reported:
            self._reported.add(why)
            self._events.append(Event(now_s, "unresolved", -1, text=why))

    def close(self, now_s: float) -> list[Event]:
        """The run is over. Returns what has not been reported yet."""
        self._end_all(now_s)
        return self.drain()

    def drain(self) -> list[Event]:
        """Events since this was last asked."""
        events, self._events = self._events, []
        return events

    def _let_go(self, now_s: float, context: Surroundings) -> None:
        for giving in list(self._giving):
            other = still_to_pass(context, giving, self.world.broken)
            self.ledger.let_pass(giving.robot, other)
            if other < 0:
                self._end(giving, now_s)

    def _barred(self, now_s: float) -> BoolArray:
        """[R] who has stood before a closed lane for the patience."""
        state, visits, closed = self.ledger.state, self.ledger.visits, self.world.closed
        if not closed.any():
            self._barred_since[:] = np.inf
            return np.zeros(self.ledger.num_robots, np.bool_)
        ahead = visits.next[visits.granted]
        ahead = np.where(ahead >= 0, ahead, visits.last)
        at_closed = (state.grants.cause == _causes.DISTURBED) & (self.world.hold_until_s <= now_s) & ~state.grants.on_lane
        at_closed &= closed[visits.lane[ahead]] & (state.motion.speed_mps == 0)
        self._barred_since[:] = np.where(at_closed, np.minimum(self._barred_since, now_s), np.inf)
        waited: BoolArray = now_s - self._barred_since >= self.settings.recovery.patience_s
        return waited

    def _for_good(self, barred: BoolArray) -> BoolArray:
        """[R] whose chain of waiting ends at a robot that stays: broken, at its goal, or given up; not one barred itself."""
        for_good, stays = np.zeros(self.ledger.num_robots, np.bool_), self._stays()
        for r in np.flatnonzero(self.ledger.state.waits.stuck).tolist():
            last = self._end_of_chain(r, stays)
            for_good[r] = stays[last] and not barred[last]
        return for_good

    def _stays(self) -> BoolArray:
        """[R] who is broken, at its goal, or has given up."""
        state = self.ledger.state
        given_up = (state.grants.cause == _causes.LETTING_PASS) & ~state.yielding.gives_way
        return np.asarray(self.world.broken | (state.grants.cause == _causes.FINISHED) | given_up)

    def _end_of_chain(self, robot: int, stays: BoolArray) -> int:
        """The first of those for whom a robot waits, one behind the other, that stays or waits for nobody; in a ring, any."""
        waits, other = self.ledger.state.waits.since_s < np.inf, self.ledger.state.grants.other
        at, seen = robot, set[int]()
        while waits[at] and other[at] >= 0 and at not in seen and not (seen and stays[at]):
            seen.add(at)
            at = int(other[at])
        return at

    def _give_way(self, now_s: float, ring: tuple[int, ...], context: Surroundings) -> Replan | None:
        agreed = who_gives_way(context, ring, (self.world.hold_until_s > now_s) | context.crew.serving, now_s)
        if agreed is None:
            return None
        giving, route = agreed
        self._asked[frozenset(ring)] += 1
        for before in [g for g in self._giving if g.robot == giving.robot]:
            self._end(before, now_s)
        self._giving.append(giving)
        return Replan({giving.robot: route}, GIVE_WAY, self._lets_pass(giving))

    def _end(self, giving: GivingWay, now_s: float) -> None:
        self._giving.remove(giving)
        duration_s = round(now_s - giving.begin_s, 9)
        text = self._lets_pass(giving)
        self._events.append(Event(giving.begin_s, "gave_way", giving.robot, giving.place, giving.others[0], duration_s, text))

    def _end_all(self, now_s: float) -> None:
        for giving in list(self._giving):
            self._end(giving, now_s)

    def _lets_pass(self, giving: GivingWay) -> str:
        names = self.ledger.problem.fleet.robot_name
        return f"lets {', '.join(names[r] for r in giving.others)} pass at '{self.ledger.graph.known_as(giving.place)}'"

    def _drive_around(self, now_s: float, late: tuple[int, ...], context: Surroundings) -> Replan | None:
        """Shorter ways than waiting, for all of these that have one."""
        graph, state, visits, closed = context.graph, context.state, context.ledger.visits, self.world.closed
        holder, stays = state.holds.holder, self.world.broken | (state.grants.cause == _causes.FINISHED)
        ways = {}
        for r in late:
            if not context.stands(r) or self.world.hold_until_s[r] > now_s or state.yielding.gives_way[r]:
                continue
            held = (holder >= 0) & (stays & (np.arange(len(stays)) != r))[holder]
            blocked = context.barred(r) | lanes_needing(graph, context.resources, held)
            granted = context.granted(r)
            ahead = visits.lane[self.ledger.ids(r, granted)[1:]]
            if not blocked[ahead].any():
                continue
            back = bool(state.grants.on_lane[r])
            start, goal = int(visits.vertex[granted]), int(visits.vertex[visits.last[r]])
            route = shortest_route(graph, ~blocked, start, goal)
            if route is None or (back and not context.free_for(r, context.of_vertex(r, start))):
                continue
            follows = np.array(route if back else route[1:], np.int64)
            times = np.full(len(follows), now_s)
            depart_s = np.append(times[1:], np.inf) if len(times) else times
            ways[r] = Reroute(follows, times, depart_s, now_s if len(times) else np.inf, back)
            waited_s = round(now_s - min(float(self._barred_since[r]), float(state.waits.mark_s[r])), 9)
            other = int(state.grants.other[r])
            names = self.ledger.problem.fleet.robot_name
            what = "a closed lane" if closed[ahead[0]] else f"what {names[other] if other >= 0 else 'another robot'} holds"
            vertex = int(visits.vertex[context.ahead(r)])
            self._events.append(Event(round(now_s - waited_s, 9), "detour", r, vertex, other, waited_s, f"drives around {what}"))
        return Replan(ways, DETOUR, "drives around what stays") if ways else None
