"""The world as it is now: which lanes are closed, what holds robots back. Makes disturbances happen, step by step.

Every kind is a method in `World._kinds`, and has its own stream of chance, `default_rng([seed, purpose])`, so that the same seed disturbs
every policy alike and one kind can be switched off without changing the others. Refuses robots and lanes that do not exist.
"""

from dataclasses import dataclass, replace

import numpy as np

from mrp_sumo.core.disturbances import BREAKS, Breakdown, ClosedLane, Failure, Obstacle, end_s
from mrp_sumo.core.execution import Event
from mrp_sumo.core.facilities import door_names, lift_names
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive import _facilities
from mrp_sumo.drive.people import nobody
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.drive.state import Conditions, Facilities, Margin, PeopleState, State, for_kernels, margin_of
from mrp_sumo.drive.visitors import Visitors
from mrp_sumo.errors import ExecutionError, count

SPREAD, NOISE, STOPS, STARTS, DELAYS, MESSAGES = range(31, 37)  # purposes of the streams of chance
SLOWEST_ROBOT = 0.7  # of its type's speed, however wide the spread
SLOWEST_MOMENT = 0.2  # of the robot's speed, however strong the noise


@dataclass(frozen=True, eq=False)
class Barrier:
    """Lanes that are to be closed for a while, as soon as nobody may enter them and nobody holds the vertices."""

    begin_s: float
    end_s: float
    lanes: IntArray
    vertices: IntArray
    text: str = ""  # for people, where it is not just lanes
    lift: int = -1  # that is then in no service, or
    door: int = -1
    service: int = _facilities.OUT_OF_SERVICE


class World:
    """The surroundings of one execution as they change; its arrays are read by the controller's kernels."""

    def __init__(
        self,
        problem: Problem,
        settings: ExecutionSettings,
        facilities: Facilities,
        people: PeopleState | None = None,
        margin: Margin | None = None,
    ) -> None:
        """Disturbed as the settings say; by default there is nobody, and what robots leave is free at once."""
        num_robots, what = problem.num_robots, settings.disturbances
        self.what, self.graph, self.facilities = what, problem.graph, facilities
        self.broken = np.zeros(num_robots, np.bool_)  # [R] whether a robot stands still for good
        self.down_until_s = np.zeros(num_robots)  # [R] when each breakdown is over, inf: never
        self.stands_until_s = np.zeros(num_robots)  # [R] until when it stands in the way
        self._pushed: dict[int, float] = {}  # robots that may be moved while they are broken, and how fast
        self._changes_s: list[float] = []  # when broken robots may be pushed, or are mended
        self._top_mps = problem.fleet.max_speed_mps
        self._num_robots, self._step_s, self._planned_step_s = num_robots, settings.step_length_s, problem.step_s
        self._radius_m = float(problem.fleet.radius_m.max())
        self._stream = {purpose: np.random.default_rng([settings.seed, purpose]) for purpose in range(SPREAD, MESSAGES + 1)}
        spread = self._stream[SPREAD].normal(1.0, what.speed_spread, num_robots)
        self._own = np.clip(spread, SLOWEST_ROBOT, 1.0) if what.speed_spread else np.ones(num_robots)
        starts_s = self._stream[STARTS].uniform(0.0, what.start_delay_s, num_robots) if what.start_delay_s else np.zeros(num_robots)
        self._u = np.zeros(num_robots)
        self._late = max(1, round(what.latency_s / self._step_s))  # steps; the loop sends what the step before allowed
        self._sent: list[FloatArray] = []
        self._next_step_s = self._planned_step_s
        self._pending: list[Breakdown | Failure] = list(what.breakdowns)
        for breakdown in self._pending:
            if not 0 <= breakdown.robot < num_robots:
                raise ExecutionError(f"disturbances: a breakdown of robot {breakdown.robot}, but there are {num_robots}")
        none = np.zeros(0, np.int64)
        self._barriers = [Barrier(c.begin_s, end_s(c), self._lanes_of(c), none) for c in settings.closed_lanes]
        self._barriers += [Barrier(o.begin_s, end_s(o), *self._near(o)) for o in what.obstacles]
        self._barriers += self._of_facilities()
        self._visitors = Visitors(what, self.facilities, settings.seed)
        self._closing: list[Barrier] = []
        early = (self._deliver, self._slow_down, self._stop_some, self._delay_some, self._break_some)
        self._kinds = (*early, self._push_some, self._visit, self._close_some)
        self._only_breaks = not (what.any or settings.closed_lanes)  # nothing comes up by itself but breakdowns that somebody adds
        self.conditions = Conditions(
            factor=self._own.copy(),
            hold_until_s=starts_s,
            told_m=np.zeros(num_robots),
            closed=np.zeros(self.graph.num_lanes, np.bool_),
            prompt=not (what.latency_s or what.message_loss),
            facilities=for_kernels(self.facilities),
            people=for_kernels(people or nobody(num_robots)),
            margin=margin or margin_of(np.zeros(0, np.int64), num_robots),
        )

    @property
    def closed(self) -> BoolArray:
        """[L] lanes nobody may set out on."""
        return self.conditions.closed

    @property
    def hold_until_s(self) -> FloatArray:
        """[R] before which robots stand still."""
        return self.conditions.hold_until_s

    def inform(self, robots: list[int], allowed_m: FloatArray) -> None:
        """These robots know how far they may drive, allowed_m [R], whatever they were sent before."""
        self.conditions.told_m[robots] = allowed_m[robots]
        for sent in self._sent:
            sent[robots] = allowed_m[robots]

    def slow(self, robot: int, factor: float) -> None:
        """A robot drives at this share of its speed."""
        self.conditions.factor[robot] = factor

    def hold(self, robot: int, until_s: float) -> None:
        """A robot stands still until then."""
        self.conditions.hold_until_s[robot] = until_s

    def update(self, now: float, state: State) -> list[Event]:
        """Bring everything up to the step that begins at `now`. Returns what happened."""
        return [] if now + 1e-9 < self.calm_until_s else [event for kind in self._kinds for event in kind(now, state)]

    @property
    def calm_until_s(self) -> float:
        """Time before which nothing comes up, nor is over; -inf if something may at any time."""
        if not self._only_breaks:
            return -np.inf
        return min((*(each.begin_s for each in self._pending), *self._changes_s), default=np.inf)

    def _slow_down(self, now: float, state: State) -> list[Event]:
        """Robots lose a share of their speed that comes and goes."""
        what, dt = self.what, self._step_s
        if what.speed_noise:
            normal = self._stream[NOISE].normal(size=self._num_robots)
            self._u += -self._u * dt / what.speed_noise_tau_s + what.speed_noise * np.sqrt(2 * dt / what.speed_noise_tau_s) * normal
            np.multiply(self._own, np.clip(1 - np.abs(self._u), SLOWEST_MOMENT, 1.0), out=self.conditions.factor)
        return []

    def _stop_some(self, now: float, state: State) -> list[Event]:
        """Robots stop at random."""
        what, chance = self.what, self._stream[STOPS]
        if not what.stops_per_s:
            return []
        stops = (chance.random((2, self._num_robots))[0] < what.stops_per_s * self._step_s) & (self.hold_until_s <= now)
        lasts_s = [float(chance.lognormal(np.log(what.stop_median_s), what.stop_sigma)) for _ in range(np.count_nonzero(stops))]
        return [self._hold(robot, now, each_s, "stops at random") for robot, each_s in zip(np.flatnonzero(stops).tolist(), lasts_s)]

    def _delay_some(self, now: float, state: State) -> list[Event]:
        what, chance = self.what, self._stream[DELAYS]
        if not what.delay_probability or now < self._next_step_s - 1e-9:
            return []
        self._next_step_s += self._planned_step_s
        delayed = chance.random(self._num_robots) < what.delay_probability
        steps = chance.integers(what.delay_steps_min, what.delay_steps_max + 1, self._num_robots)
        late = np.flatnonzero(delayed & (self.hold_until_s <= now)).tolist()
        return [self._hold(robot, now, float(steps[robot] * self._planned_step_s), "is delayed") for robot in late]

    def _break_some(self, now: float, state: State) -> list[Event]:
        """Robots break down whose time has come."""
        events = []
        begun = [breakdown for breakdown in self._pending if breakdown.begin_s <= now + 1e-9]
        self._pending = [breakdown for breakdown in self._pending if breakdown.begin_s > now + 1e-9]
        for breakdown in begun:
            robot, lasts_s = breakdown.robot, np.inf if breakdown.duration_s is None else breakdown.duration_s
            self.broken[robot] |= breakdown.duration_s is None
            self.down_until_s[robot] = max(self.down_until_s[robot], now + lasts_s)
            stands_s, text = lasts_s, BREAKS
            if isinstance(breakdown, Failure):
                stands_s, text = min(lasts_s, breakdown.stands_s), breakdown.text
                self._pushed[robot] = breakdown.speed_mps
            self.stands_until_s[robot] = max(self.stands_until_s[robot], now + stands_s)
            self._changes_s += [now + stands_s, now + lasts_s]
            events.append(replace(self._hold(robot, now, stands_s, text), duration_s=lasts_s))
        return events

    def _push_some(self, now: float, state: State) -> list[Event]:
        """Broken robots that may be moved are no faster than who pushes them."""
        factor = self.conditions.factor
        self._changes_s = [change_s for change_s in self._changes_s if change_s > now]
        for robot, speed_mps in list(self._pushed.items()):
            if now >= self.down_until_s[robot]:
                factor[robot] = self._own[robot] if not self.what.speed_noise else factor[robot]
                del self._pushed[robot]
            elif now >= self.stands_until_s[robot]:
                factor[robot] = min(factor[robot], speed_mps / self._top_mps[robot])
        return []

    def add(self, what: Breakdown | Failure | ClosedLane) -> None:
        """Have a disturbance that nobody knew of."""
        if isinstance(what, Breakdown | Failure):
            self._pending.append(what)
        else:
            self._only_breaks = False
            self._barriers.append(Barrier(what.begin_s, end_s(what), self._lanes_of(what), np.zeros(0, np.int64)))

    def strand(self, robot: int, now: float) -> Event:
        """A robot's battery is empty: it stands still for good."""
        self.broken[robot], self.conditions.hold_until_s[robot] = True, np.inf
        return Event(now, "battery_empty", robot, text="its battery is empty")

    def _deliver(self, now: float, state: State) -> list[Event]:
        """Robots hear what they may drive late, or not this time. What they know never shrinks."""
        if self.conditions.prompt:
            return []
        self._sent.append(state.grants.allowed_m.copy())
        if len(self._sent) < self._late:
            return []
        arrives = self._sent.pop(0)
        if self.what.message_loss:
            lost = self._stream[MESSAGES].random(self._num_robots) < self.what.message_loss
            arrives = np.where(lost, self.conditions.told_m, arrives)
        np.maximum(self.conditions.told_m, arrives, out=self.conditions.told_m)
        return []

    def _hold(self, robot: int, now: float, duration: float, text: str) -> Event:
        hold_until_s = self.conditions.hold_until_s
        hold_until_s[robot] = max(hold_until_s[robot], now + duration)
        return Event(now, "disturbed", robot, duration_s=duration, text=text)

    def _visit(self, now: float, state: State) -> list[Event]:
        """People ride lifts and go through doors."""
        self._visitors.update(now)
        return []

    def _close_some(self, now: float, state: State) -> list[Event]:
        """Lanes are closed when nobody may enter them, and open again."""
        events: list[Event] = []
        waiting: list[Barrier] = []
        for barrier in self._barriers:
            lanes = barrier.lanes
            if barrier.begin_s > now + 1e-9:
                waiting.append(barrier)
            elif now >= barrier.end_s:
                continue
            elif state.claims.number[lanes].any() or (state.holds.holder[barrier.vertices] >= 0).any():
                waiting.append(barrier)
            else:
                self._closing.append(barrier)
                self.conditions.closed[lanes] = True
                self._serve(barrier, barrier.service)
                head = int(self.graph.head[lanes[0]]) if len(lanes) else -1
                text = count(len(lanes), "lane is closed", "lanes are closed") if len(lanes) else "no lane is near it"
                events.append(Event(now, "closed", -1, head, duration_s=barrier.end_s - now, text=barrier.text or text))
        self._barriers = waiting
        if any(closing.end_s <= now + 1e-9 for closing in self._closing):
            for over in self._closing:
                self._serve(over, _facilities.IN_SERVICE)
            self._closing = [closing for closing in self._closing if closing.end_s > now + 1e-9]
            self.conditions.closed[:] = False
            for closing in self._closing:
                self.conditions.closed[closing.lanes] = True
                self._serve(closing, closing.service)
        return events

    def _serve(self, barrier: Barrier, service: int) -> None:
        if barrier.lift >= 0:
            self.facilities.lifts.service[barrier.lift] = service
        if barrier.door >= 0:
            self.facilities.doors.service[barrier.door] = service

    def _of_facilities(self) -> list[Barrier]:
        """Lifts out of service, locked doors, fires."""
        facilities, none, barriers = self.facilities, np.zeros(0, np.int64), []
        lifts, doors, levels = lift_names(self.graph), door_names(self.graph), self.graph.level_names
        gates = [facilities.gate_lane[facilities.gate_lift == f] for f in range(len(lifts))]
        for outage in self.what.outages:
            span = outage.begin_s, end_s(outage)
            if outage.lift:
                f = lifts.index(outage.lift)
                barriers.append(Barrier(*span, gates[f], none, f"lift '{outage.lift}' is out of service", lift=f))
            else:
                d = doors.index(outage.door)
                through = facilities.through[facilities.through_door == d]
                barriers.append(Barrier(*span, through, none, f"door '{outage.door}' is locked", door=d))
        for fire in self.what.fires:
            for f, name in enumerate(lifts):
                said = f"fire: lift '{name}' goes to {levels[facilities.lifts.recall[f]]}"
                barriers.append(Barrier(fire.begin_s, end_s(fire), gates[f], none, said, lift=f, service=_facilities.FIRE))
        return barriers

    def _lanes_of(self, closure: ClosedLane) -> IntArray:
        lanes = [self.graph.lane_between(closure.tail, closure.head), self.graph.lane_between(closure.head, closure.tail)]
        lanes = [lane for lane in lanes if lane >= 0]
        if not lanes:
            raise ExecutionError(f"disturbances: a closure of a lane from vertex {closure.tail} to {closure.head}, which does not exist")
        return np.array(lanes, np.int64)

    def _near(self, obstacle: Obstacle) -> tuple[IntArray, IntArray]:
        """Lanes and vertices on which a robot could touch the obstacle."""
        graph, place = self.graph, np.array([obstacle.x_m, obstacle.y_m])
        begin, along = graph.xy[graph.tail], graph.xy[graph.head] - graph.xy[graph.tail]
        u = np.clip(((place - begin) * along).sum(1) / (along**2).sum(1), 0, 1)
        reach = obstacle.radius_m + self._radius_m
        lanes = np.flatnonzero(np.hypot(*(begin + u[:, None] * along - place).T) < reach)
        return lanes, np.flatnonzero(np.hypot(*(graph.xy - place).T) < reach)
