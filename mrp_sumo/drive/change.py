"""Other ways for some robots of a course under way: what all hold and have done is carried over, all others go on.

Paths begin anew at the last visits that robots have arrived at. Where the policy keeps an order, it is made anew too, and
what robots have won comes first in it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray, frozen
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive import _controller
from mrp_sumo.drive.motion_plan import Course, course_from, state_on
from mrp_sumo.drive.policy import Policy


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


def changed_course(
    problem: Problem, course: Course, state: _controller.State, change: Change, policy: Policy, step_length_s: float, now: float
) -> tuple[Course, _controller.State, IntArray]:
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
    new = course_from(
        problem, plan, policy, step_length_s, course.resources, s, state.yaw, frozenset(np.flatnonzero(backs).tolist()), change.left_alone
    )
    changed = np.array([r in change.way for r in range(plan.num_robots)], np.bool_)
    won = np.where(backs, first, first + state.won - behind)
    after = state_on(new, s, first + 1, won, state.on_lane, state.turned | backs)
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
    after.pause[keep] = np.where(state.pause == _controller.NEVER, _controller.NEVER, first + state.pause - behind)[keep]
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


def _changed_plan(plan: Plan, state: _controller.State, change: Change, now: float) -> tuple[Plan, IntArray]:
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
