"""The cycle of a world in which robots drive: update, observe, grant; dispatch; command, step.

Whoever drives robots takes it: runs, retimings, virtual fleets. `look` is its first half, `go` its last; in between the caller
hears what happened, and sends robots on.
"""

from collections.abc import Sequence

from mrp_sumo.core.execution import Event
from mrp_sumo.core.graph import IntArray
from mrp_sumo.drive.controller import Controller
from mrp_sumo.drive.ledger import Ledger
from mrp_sumo.drive.people import Bystanders
from mrp_sumo.drive.state import Tape
from mrp_sumo.drive.world import World
from mrp_sumo.engines.kinematic.engine import KinematicEngine
from mrp_sumo.engines.protocol import Engine


class DriveCycle:
    """Steps of one world, from 0 s on."""

    def __init__(self, world: World, controller: Controller, bodies: Engine, people: Bystanders | None = None) -> None:
        """Without `people` nobody walks; where there are some, bodies have been placed."""
        self.world, self.controller, self.bodies = world, controller, bodies
        self.step, self.now_s = 0, 0.0
        self._people = people if people is not None and people.any else None
        self._seen: list[Event] | None = None  # what happened in this step, where the controller has seen it already
        if self._people is not None:
            self._people.begin(self._step_s, self.ledger, bodies.driven_m)

    @property
    def ledger(self) -> Ledger:
        return self.controller.ledger

    @property
    def _step_s(self) -> float:
        return self.controller.rules.step_s

    def look(self) -> list[Event]:
        """Bring the world up to now, observe the step that has ended, and grant what robots may enter. Returns what happened."""
        events = self.world.update(self.now_s, self.ledger.state)
        if self._seen is None:
            events += self.controller.advance(self.now_s, self.bodies, self.world.conditions, observe=self.step > 0)
        else:
            events, self._seen = events + self._seen, None
        return events if self._people is None else events + self._people.notice(self.now_s)

    def go(self, *, sent: bool) -> Sequence[str]:
        """Command speeds, and let a step pass; where robots were `sent` elsewhere, grant anew first. Returns what is wrong with bodies."""
        state = self.ledger.state
        if sent:
            self.controller.advance(self.now_s, self.bodies, self.world.conditions, observe=False)
        self.controller.command(self.bodies)
        wrong = self.bodies.step((state.grants.command_mps > 0) | (state.motion.speed_mps > 0))
        if self._people is not None:
            self._people.settle(self.now_s, self._step_s, self.ledger, self.bodies.driven_m)
        self._pass(1)
        return wrong

    def go_on(self, most: int, tape: Tape) -> Sequence[str]:
        """Let as many more steps pass, at most, as nothing happens in but on the tape. Returns what is wrong with bodies after the last.

        For a calm world without people.
        """
        if isinstance(self.bodies, KinematicEngine):
            self._seen, made = self.controller.drive_on(self.step, most, self.bodies, self.world.conditions, tape)
            self._pass(made)
            return ()
        last = self.step + most
        while True:
            self._seen = self.controller.watch(self.step, self.bodies, self.world.conditions, tape, is_last=self.step == last)
            if self._seen is not None:
                return ()
            if wrong := self.go(sent=False):
                return wrong

    def forget(self, needed: IntArray) -> None:
        """Have the ledger forget what is over, but for the visits `needed` [R] and what comes after them."""
        self.ledger.forget(needed)
        self.bodies.divert((), self.ledger.visits)

    def _pass(self, num_steps: int) -> None:
        self.step += num_steps
        self.now_s = round(self.step * self._step_s, 9)
