"""Finds deadlocks in who waits for whom, and turns the controller's log into events."""

from dataclasses import dataclass, field

import numpy as np

from mrp_sumo.core.execution import Event
from mrp_sumo.core.graph import IntArray
from mrp_sumo.drive import _controller

LOOK_EVERY_S = 0.5  # simulated; so a deadlock is in the log within a second of its making
WHY = {
    _controller.OTHER: "needs what {other} holds or is to pass first",
    _controller.ONCOMING: "{other} comes towards it on the lane",
    _controller.FOLLOWING: "behind {other}",
    _controller.DISTURBED: "disturbed",
    _controller.LETTING_PASS: "lets {other} pass",
}


@dataclass
class DeadlockWatch:
    """Knows the deadlocks there are, so that each is told once."""

    known: set[tuple[int, ...]] = field(default_factory=set)

    def look(self, state: _controller.State) -> list[tuple[int, ...]]:
        """Wait-for cycles that were not there at the last look: robots, each waiting for the next, the lowest first."""
        if not (state.wait_since < np.inf).any():
            self.known.clear()
            return []
        label = _controller.waiting_cycles(state)
        found = {_cycle(label, state.other, number) for number in range(1, int(label.max()) + 1)}
        new = sorted(found - self.known)
        self.known = found
        return new


def _cycle(label: IntArray, other: IntArray, number: int) -> tuple[int, ...]:
    start = at = int(np.flatnonzero(label == number)[0])
    robots = [start]
    while (at := int(other[at])) != start:
        robots.append(at)
    return tuple(robots)


def events_of(log: _controller.Log, count: int, path: _controller.Path, names: tuple[str, ...]) -> list[Event]:
    """The log's entries of one step as events."""
    columns = (column[:count].tolist() for column in log)
    return [_event(path, names, *entry) for entry in zip(*columns)]


def waits_at_the_end(
    now: float, state: _controller.State, path: _controller.Path, names: tuple[str, ...], wait_least: float, of: list[int] | None = None
) -> list[Event]:
    """Events for the waits and blockings that the run's end cut off, or the end of the ways of some robots."""
    events, some = [], np.ones(len(names), np.bool_)
    if of is not None:
        some[:] = False
        some[of] = True
    for r in np.flatnonzero(some & (now - state.wait_since >= wait_least)).tolist():
        wait = (int(state.wait_cause[r]), int(state.wait_where[r]), int(state.wait_other[r]))
        events.append(_event(path, names, _controller.WAITED, r, *wait, float(state.wait_since[r]), now))
    for r in np.flatnonzero(some & state.stuck).tolist():
        wait = (int(state.wait_cause[r]), int(state.wait_where[r]), int(state.wait_other[r]))
        events.append(_event(path, names, _controller.STOOD_BLOCKED, r, *wait, float(state.mark_t[r]), now))
    return events


def deadlock_event(
    t_s: float, cycle: tuple[int, ...], state: _controller.State, path: _controller.Path, labels: list[str], names: tuple[str, ...]
) -> Event:
    """A deadlock with its cycle by robot and the vertex each wants."""
    told = " waits for ".join(f"{names[r]} (to '{labels[int(path.vertex[state.where[r]])]}')" for r in cycle)
    return Event(
        t_s,
        "deadlock",
        cycle[0],
        int(path.vertex[state.where[cycle[0]]]),
        cycle[1 % len(cycle)],
        0.0,
        f"{told} waits for {names[cycle[0]]}",
    )


def _event(
    path: _controller.Path, names: tuple[str, ...], kind: int, robot: int, cause: int, visit: int, other: int, begin: float, end: float
) -> Event:
    begin, end = round(begin, 9), round(end, 9)
    vertex = int(path.vertex[visit]) if visit >= 0 else -1
    if kind == _controller.SET_OUT:
        return Event(begin, "started", robot, vertex)
    if kind == _controller.ARRIVED_AT_GOAL:
        return Event(end, "goal", robot, vertex)
    text = WHY.get(cause, "").format(other=names[other] if other >= 0 else "another robot")
    return Event(begin, "waited" if kind == _controller.WAITED else "blocked", robot, vertex, other, round(end - begin, 9), text)
