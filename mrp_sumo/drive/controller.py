"""The controller: turns what the ledger allows into speeds, step by step, and the kernels' log into events."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from mrp_sumo.core.execution import Event
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.visits import Visits
from mrp_sumo.drive import _causes, _cycle, _grants
from mrp_sumo.drive.ledger import Ledger
from mrp_sumo.drive.policy import Policy
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.drive.state import Conditions, Kinematics, Rules, StepArrays, Tape, empty_log, empty_notices, for_kernels, packed
from mrp_sumo.engines.kinematic.engine import KinematicEngine
from mrp_sumo.engines.protocol import Bodies, Engine
from mrp_sumo.search.entries import Entries, enter, entries_of

A_CELL_LESS_M = 0.0100003  # robots stop a millimetre before a vertex, and have advanced by a cell; uneven, so that no distance is equal
WAIT_LEAST_S = 0.5  # shorter waits are booked, but are no events
WHY = {
    _causes.OTHER: "needs what {other} holds or is to pass first",
    _causes.ONCOMING: "{other} comes towards it on the lane",
    _causes.FOLLOWING: "behind {other}",
    _causes.DISTURBED: "disturbed",
    _causes.LETTING_PASS: "lets {other} pass",
    _causes.FACILITY: "waits for {facility}",
}


class LogRow(NamedTuple):
    """A row of the kernels' `Log`."""

    kind: int
    robot: int
    cause: int
    visit: int
    other: int
    begin_s: float
    end_s: float


class Controller:
    """Grants what the ledger allows under a policy, which may change with a new plan."""

    def __init__(self, ledger: Ledger, policy: Policy, settings: ExecutionSettings, *, paced: bool = True, books: bool = True) -> None:
        """`paced` says whether robots that are early may be slowed down where the policy asks for it, `books`, whether somebody wants to
        know what their time is spent on.
        """
        self.ledger, self._settings, self._paced, self._books = ledger, settings, paced, books
        self.load(ledger.problem.fleet)
        self._cell_m = ledger.graph.cell_m - A_CELL_LESS_M
        self.follow(policy)
        self._log, self._notices = for_kernels(empty_log(ledger.num_robots)), empty_notices(ledger.num_robots)
        self._num_changed = self._num_due = 0
        self._visits: Visits | None = None  # for whose types `_entries` are
        self._entries: Entries = {}

    def follow(self, policy: Policy) -> None:
        """Grant by this policy from now on."""
        self.policy = policy
        self.rules = Rules(
            step_s=self._settings.step_length_s,
            books=self._books,
            cell_m=self._cell_m,
            window_s=self._settings.blocking_window_s,
            wait_least_s=WAIT_LEAST_S,
            look_ahead=policy.look_ahead + self._braking_lanes(),
            paced=policy.paced and self._paced,
            asks_late=getattr(policy, "asks_late", False),
        )

    def _braking_lanes(self) -> int:
        """How many whole lanes robots may need to come to a stop: who may not claim so many never reaches full speed."""
        graph, fleet = self.ledger.graph, self.ledger.problem.fleet
        length_m = graph.length_m[~graph.is_ride]  # nobody rides fast
        reach_m = np.stack([_kinematics(each, self._settings.step_length_s).reach_m for each in (fleet, fleet.loaded or fleet)])
        return int(reach_m.max(initial=0.0) / length_m.min()) if len(length_m) else 0

    def load(self, fleet: Fleet) -> None:
        """Robots have other limits from now on; those that change stand."""
        self.kinematics = _kinematics(fleet, self._settings.step_length_s)
        self._limits = for_kernels(self.kinematics)

    def advance(self, now_s: float, bodies: Bodies, conditions: Conditions, *, observe: bool) -> list[Event]:
        """Observe the step that ended now (not before the first one), grant, and set speeds. Returns what happened."""
        step = observe, now_s, bodies.driven_m, bodies.routed
        num_logged, self._num_changed, self._num_due = self._call(_cycle.advance, *step, self._scene(conditions))
        return self._events(num_logged) if num_logged else []

    def watch(self, step: int, bodies: Bodies, conditions: Conditions, tape: Tape, *, is_last: bool) -> list[Event] | None:
        """`advance` for the step `step`, on the tape. None: nothing happened in it, and unless it `is_last` the next may follow."""
        on = step, is_last, bodies.driven_m, bodies.routed
        goes_on, num_logged, self._num_changed, self._num_due = self._call(_cycle.watch, *on, self._scene(conditions), tape)
        return None if goes_on else self._events(num_logged) if num_logged else []

    def drive_on(self, step: int, most: int, bodies: KinematicEngine, conditions: Conditions, tape: Tape) -> tuple[list[Event], int]:
        """`watch` the step that bodies have made, and at most so many more while nothing happens. Returns what then does, and how many."""
        on = step, most, bodies.bodies, bodies.routed
        made, num_logged, self._num_changed, self._num_due = self._call(_cycle.drive_on, *on, self._scene(conditions), tape)
        return self._events(num_logged) if num_logged else [], made

    def _scene(self, conditions: Conditions) -> StepArrays:
        ledger = self.ledger
        state, log = ledger.state_records, self._log
        return StepArrays(self._limits, self.rules, ledger.visits, ledger.needs, state, conditions, log, self._notices)

    def _call(self, kernel: Callable[..., Any], *arguments: Any) -> tuple[int, ...]:
        """Call a kernel with the ledger's arrays, whose types are looked at when these are new ones."""
        ledger = self.ledger
        if self._visits is not ledger.visits:
            self._entries = entries_of((*self.rules, *ledger.visits, *ledger.needs))
            self._visits = ledger.visits
        entered: tuple[int, ...] = enter(self._entries, kernel, *arguments)
        return entered

    def command(self, bodies: Engine) -> None:
        """Send the engine new speeds, and more of the way where it needs it."""
        if self._num_due:
            bodies.lengthen(self._notices.due[: self._num_due].tolist(), self.ledger.visits)
        if self._num_changed:
            bodies.command(self._notices.changed[: self._num_changed].tolist(), self.ledger.state.grants.command_mps)

    def send_again(self) -> None:
        """Speeds that were set in this step may be set again: send them all."""
        _grants.send_again(self.ledger.state.grants)

    def divert(self, replan_robots: list[int], backs: list[int], bodies: Engine) -> None:
        """Robots have been sent other ways."""
        self.send_again()
        bodies.divert(replan_robots, self.ledger.visits)
        for r in backs:
            bodies.turn_back(r, self.ledger.visits)

    def unfinished_waits(self, now_s: float, robots: list[int] | None = None) -> list[Event]:
        """Events for the waits and blockings of some robots that end now, with the run or with their way; of all by default."""
        waits = self.ledger.state.waits
        some = np.ones(self.ledger.num_robots, np.bool_)
        if robots is not None:
            some[:] = False
            some[robots] = True
        waiting, stuck = np.flatnonzero(some & (now_s - waits.since_s >= WAIT_LEAST_S)), np.flatnonzero(some & waits.stuck)
        events = [self._wait(_causes.WAITED, r, float(waits.since_s[r]), now_s) for r in waiting.tolist()]
        return events + [self._wait(_causes.STOOD_BLOCKED, r, float(waits.mark_s[r]), now_s) for r in stuck.tolist()]

    def deadlock(self, t_s: float, cycle: tuple[int, ...]) -> Event:
        """A deadlock with its cycle by robot and the vertex each wants."""
        names, wanted = self.ledger.problem.fleet.robot_name, self.ledger.state.grants.wanted
        vertex = self.ledger.visits.vertex[wanted[list(cycle)]].tolist()
        text = " waits for ".join(f"{names[r]} (to '{self.ledger.graph.known_as(v)}')" for r, v in zip(cycle, vertex))
        return Event(t_s, "deadlock", cycle[0], vertex[0], cycle[1 % len(cycle)], 0.0, f"{text} waits for {names[cycle[0]]}")

    def _wait(self, kind: int, robot: int, begin_s: float, end_s: float) -> Event:
        waits = self.ledger.state.waits
        because = int(waits.cause[robot]), int(waits.where[robot]), int(waits.other[robot])
        return self._event(LogRow(kind, robot, *because, begin_s, end_s))

    def _events(self, num_logged: int) -> list[Event]:
        return [self._event(LogRow(*entry)) for entry in self._log.entries[:num_logged].tolist()]

    def _event(self, logged: LogRow) -> Event:
        kind, robot, cause, visit, other, *times_s = logged
        begin_s, end_s = (round(t_s, 9) for t_s in times_s)
        vertex = int(self.ledger.visits.vertex[visit]) if visit >= 0 else -1
        if kind == _causes.SET_OUT:
            return Event(begin_s, "started", robot, vertex)
        if kind == _causes.ARRIVED_AT_GOAL:
            return Event(end_s, "goal", robot, vertex)
        names = self.ledger.problem.fleet.robot_name
        facility = self._facility(visit) if cause == _causes.FACILITY else ""
        text = WHY.get(cause, "").format(other=names[other] if other >= 0 else "another robot", facility=facility)
        return Event(begin_s, "waited" if kind == _causes.WAITED else "blocked", robot, vertex, other, round(end_s - begin_s, 9), text)

    def _facility(self, visit: int) -> str:
        """The lift or door for which a robot waits that is to make a visit."""
        lane = int(self.ledger.visits.lane[visit])
        options = self.ledger.graph.lane_options[lane]
        return f"door '{options['door']}'" if options.get("door") else f"lift '{options.get('cabin', '')}'"


def _kinematics(fleet: Fleet, step_s: float) -> Kinematics:
    limits = Kinematics(
        speed_mps=fleet.max_speed_mps,
        decel_mps2=fleet.decel_mps2,
        turn_rate_rad_s=fleet.turn_rate_rad_s,
        reach_m=fleet.max_speed_mps**2 / (2 * fleet.decel_mps2) + 3 * fleet.max_speed_mps * step_s + 0.02,
        radius_m=fleet.radius_m,
        behind_m=fleet.behind_m,
        gap_m=fleet.gap_m,
    )
    return packed(limits)
