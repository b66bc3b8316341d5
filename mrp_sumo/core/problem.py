"""A planning problem: who stands where and who has to go where, on which graph.

Refuses starts and goals off the graph, two robots on one start, one goal assigned twice, and headings that are not one for each.
Goals that are the same vertex are a problem without a solution, and that is for planners to say.
"""

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np

from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, PlanGraph, frozen, with_lanes
from mrp_sumo.core.task import Stop, Task
from mrp_sumo.errors import PlanError


@dataclass(frozen=True, eq=False)
class Standing:
    """States in which R vehicles that cannot turn in place are at their starts, while they drive; see `traffic.moves`."""

    does: IntArray  # [R] under way, standing, bound for a lane, or anywhere: it has not moved yet, or turns in place
    lane: IntArray  # [R] by which it came or for which it is bound
    gear: IntArray  # [R] 0 forward, 1 backward
    came: IntArray  # [R] lane by which it came, where it is bound for another; -1: none


@dataclass(frozen=True, eq=False)
class Problem:
    """R robots, G goals. With `goal_of` of -1 it is the planner's job to assign (CBS-TA)."""

    graph: PlanGraph
    fleet: Fleet
    start: IntArray  # [R] vertices, distinct
    goal: IntArray  # [G] vertices
    goal_of: IntArray  # [R] which goal a robot has, -1 for none yet; no goal twice
    step_s: float  # planned time for a lane
    seed: int = 0
    drivable: bool = False  # whether robots will keep the plan's order: no rotations, and nobody too close (`traffic.clashes`)
    window_steps: int = 0  # how long robots have to keep clear of each other, for planners that support 'window'; 0: to the end
    start_heading_rad: FloatArray | None = None  # [R] NaN: that of the robot's first lane; None: for all of them
    goal_heading_rad: FloatArray | None = None  # [G] of the robot that stays there, NaN: any; None: at all of them
    via: tuple[tuple[int, ...], ...] = ()  # [R] vertices to pass on the way, for planners that support 'stops'; (): nobody has any
    effort: int = 0  # labels after which planners that support 'effort' stop, on every machine alike; 0: only when time is up
    barred: BoolArray | None = None  # [K, L] lanes on which robots of each type have no room; None: all robots may drive everywhere
    since_s: FloatArray | None = None  # [R] since when each has had its goal, for planners in windows; inf: it has no work; None: unknown
    goal_kind: IntArray | None = None  # [G] type of the robots that a goal is for; None: all goals are for any
    standing: Standing | None = None  # of vehicles under way; None: all robots are at rest, as their headings say

    def __post_init__(self) -> None:
        names, num_vertices = self.fleet.robot_name, self.graph.num_vertices
        for what, at in (("start", self.start), ("goal", self.goal)):
            outside = (at < 0) | (at >= num_vertices)
            if outside.any():
                raise PlanError(f"{what} {int(at[outside][0])} is not a vertex of '{self.graph.name}'")
        values, count = np.unique(self.start, return_counts=True)
        if (count > 1).any():
            v = int(values[count > 1][0])
            i, j = np.flatnonzero(self.start == v)[:2]
            raise PlanError(f"{names[i]} and {names[j]} both start at '{self.graph.known_as(v)}'")
        if len(self.start) != len(names) or len(self.goal_of) != len(names):
            raise PlanError(f"{len(names)} robots have {len(self.start)} starts and {len(self.goal_of)} assignments")
        assigned = self.goal_of[self.goal_of >= 0]
        if (assigned >= len(self.goal)).any() or len(np.unique(assigned)) != len(assigned):
            raise PlanError("two robots are assigned the same goal, or a goal that does not exist")
        for what, heading, at in (("start", self.start_heading_rad, self.start), ("goal", self.goal_heading_rad, self.goal)):
            if heading is not None and (len(heading) != len(at) or np.isinf(heading).any()):
                raise PlanError(f"{what}_heading_rad: expected {len(at)} angles, NaN where any will do")
        if not (np.isfinite(self.step_s) and self.step_s > 0):
            raise PlanError(f"step_s is {self.step_s}, expected a number of seconds above 0")

    @property
    def num_robots(self) -> int:
        return len(self.start)

    @property
    def is_assigned(self) -> bool:
        return bool((self.goal_of >= 0).all())

    @cached_property
    def graph_of_kind(self) -> tuple[PlanGraph, ...]:
        """[K] the graph with the lanes of each type; vertices are the same."""
        return graphs_of_kinds(self.graph, self.barred, self.fleet.num_kinds)

    def for_any(self) -> "Problem":
        """The same problem with those lanes only on which every robot may drive, for planners that do not tell robots apart."""
        if self.barred is None:
            return self
        barred = self.barred[np.unique(self.fleet.kind)].any(0)
        return replace(self, graph=_without(self.graph, barred.tobytes()), barred=None)

    def for_reach(self) -> "Problem":
        """The same problem without the lanes that are barred for a type which has room at both of their ends.

        Then a robot is on its lanes as long as it stays on vertices from which its type can come to its goal.
        """
        if self.barred is None:
            return self
        graph, short = self.graph, np.zeros(self.graph.num_lanes, np.bool_)
        for k in np.unique(self.fleet.kind).tolist():
            own = self.graph_of_kind[k]
            there = np.zeros(graph.num_vertices, np.bool_)
            there[own.tail] = there[own.head] = True
            short |= self.barred[k] & there[graph.tail] & there[graph.head]
        return replace(self, graph=_without(graph, short.tobytes()), barred=self.barred[:, ~short])

    @property
    def target(self) -> IntArray:
        """[R] goal vertex of each robot; its own start where it has no goal."""
        if not len(self.goal):
            return self.start
        return np.where(self.goal_of >= 0, self.goal[np.maximum(self.goal_of, 0)], self.start)

    @property
    def heading_at_start(self) -> FloatArray:
        """[R] rad, NaN where a robot faces the way that it goes."""
        return np.full(self.num_robots, np.nan) if self.start_heading_rad is None else self.start_heading_rad

    @property
    def heading_at_target(self) -> FloatArray:
        """[R] rad, NaN where a robot stays as it comes."""
        if self.goal_heading_rad is None or not len(self.goal):
            return np.full(self.num_robots, np.nan)
        return np.where(self.goal_of >= 0, self.goal_heading_rad[np.maximum(self.goal_of, 0)], np.nan)

    @property
    def tasks(self) -> tuple[Task, ...]:
        """The goals as tasks of one stop, each for the robot that has it. A robot without a goal has to stay at its start."""
        return tuple(Task(id=r, stops=(Stop(v),), robot=r) for r, v in enumerate(self.target.tolist()))

    def assigned(self, goal_of: IntArray) -> "Problem":
        """The same problem with these assignments."""
        return replace(self, goal_of=frozen(np.asarray(goal_of, np.int64)))


def graphs_of_kinds(graph: PlanGraph, barred: BoolArray | None, num_kinds: int) -> tuple[PlanGraph, ...]:
    """[K] the graph with the lanes of each type of robots, without those that are barred [K, L]; vertices are the same."""
    return (graph,) * num_kinds if barred is None else tuple(_without(graph, each.tobytes()) for each in barred)


@lru_cache(maxsize=16)  # a run asks again and again
def _without(graph: PlanGraph, barred: bytes) -> PlanGraph:
    """The graph without some of its lanes, a byte each."""
    lanes = np.frombuffer(barred, np.bool_)
    return with_lanes(graph, ~lanes) if lanes.any() else graph
