"""PIBT in plain Python, after the papers that `planners/configuration/pibt.py` names: what its kernels have to choose, too."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field


@dataclass
class Step:
    """One step of all robots on an undirected graph."""

    neighbours: Sequence[Sequence[int]]  # of each vertex
    steps: Sequence[Sequence[int]]  # [R][V] to each robot's goal
    goal: Sequence[int]  # [R]
    here: Sequence[int]  # [R] where robots are: Q_from
    chance: Callable[[], float]  # breaks ties, in [0, 1)
    to: dict[int, int] = field(default_factory=dict)  # robot -> where it goes: Q_to

    def __post_init__(self) -> None:
        self.robot_at = {v: i for i, v in enumerate(self.here)}

    def choose(self, order: Sequence[int]) -> list[int]:
        """[R] the next vertex of each robot; `order` has the highest priority first."""
        for i in order:
            if i in self.to:
                continue
            if self.here[i] == self.goal[i] and self.here[i] not in self.to.values():
                self.to[i] = self.here[i]  # its first candidate, and nobody pushes it
            else:
                self.pibt(i)
        return [self.to[i] for i in range(len(self.here))]

    def pibt(self, i: int) -> bool:
        """Choose for robot i, and for whoever it pushes. False (invalid) when it has to stay where its pusher goes."""
        v = self.here[i]
        candidates = sorted([*self.neighbours[v], v], key=lambda u: (self.steps[i][u], self.chance()))
        partner = self.swap_partner(i, candidates[0])
        if partner is not None:
            candidates.reverse()  # make way, and let the partner follow
        for u in candidates:
            k = self.robot_at.get(u)
            if u in self.to.values() or (k is not None and k != i and self.to.get(k) == v):
                continue  # a vertex conflict, or an edge conflict
            self.to[i] = u
            if k is not None and k not in self.to and not self.pibt(k):
                continue  # k inherited the priority of i and stays
            if u == candidates[0] and partner is not None and partner not in self.to and v not in self.to.values():
                self.to[partner] = v
            return True
        self.to[i] = v
        return False

    def swap_partner(self, i: int, ahead: int) -> int | None:
        """The robot that i has to change places with in a corridor, and can, at a fork behind i."""
        v = self.here[i]
        if ahead == v or not self.swap_possible(ahead, v):
            return None
        k = self.robot_at.get(ahead)
        if k is not None and k not in self.to and self.swap_required(i, k, v, ahead):
            return k
        beside = [self.robot_at[u] for u in self.neighbours[v] if u in self.robot_at and u != ahead]
        return next((k for k in beside if self.swap_required(k, i, v, ahead)), None)

    def swap_required(self, pusher: int, puller: int, at: int, ahead: int) -> bool:
        """Follow the corridor through which the pusher would push the puller: does each want to get to the other's side?

        Not where both have the same goal: each would make way for the other again and again.
        """
        if self.goal[pusher] == self.goal[puller]:
            return False
        wants = self.steps[pusher]
        while wants[ahead] < wants[at]:
            onward = self.ways_on(at, ahead)
            if len(onward) > 1:
                return False
            if not onward:
                break
            at, ahead = ahead, onward[0]
        puller_wants_back = self.steps[puller][at] < self.steps[puller][ahead]
        return puller_wants_back and (at == self.goal[pusher] or wants[ahead] < wants[at])

    def swap_possible(self, begin: int, at: int) -> bool:
        """Follow the corridor the other way: is there a fork where one of the two can step aside?"""
        before = begin
        while at != begin and len(onward := self.ways_on(before, at)) < 2:
            if not onward:
                return False
            before, at = at, onward[0]
        return at != begin

    def ways_on(self, before: int, at: int) -> list[int]:
        """Where `at` leads to, not back to `before`, nor into a dead end whose robot is at its goal."""
        full = [u for u in self.neighbours[at] if len(self.neighbours[u]) == 1 and u in self.robot_at and self.goal[self.robot_at[u]] == u]
        return [u for u in self.neighbours[at] if u != before and u not in full]
