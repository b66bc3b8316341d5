"""Execution policies: who may set out for a vertex, and when.

A policy turns a plan into an order at the resources (or none: first come, first served), the earliest time to
leave each visit, and a pace. The controller does the rest and is the same for all. A new policy is a class
here or in a file of its own, listed in POLICIES.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.core.schedule import Needs, Schedule, schedule_of
from mrp_sumo.errors import ExecutionError, nearest


class Policy(Protocol):
    """How a plan is executed. Implementations have no state."""

    name: str
    look_ahead: int  # how many visits ahead of its position a robot may claim at most
    paced: bool  # whether a robot that is early drives slower
    keeps_order: bool  # whether `order` gives one
    sound_plan_only: bool  # refuses plans with conflicts, and orders that cannot be kept

    def order(self, problem: Problem, plan: Plan, needs: Needs) -> Schedule | None:
        """Who passes before whom at every resource; None: first come, first served. PlanError when it cannot be kept."""

    def earliest_s(self, plan: Plan) -> FloatArray:
        """[N] before which no robot leaves a visit."""


@dataclass(frozen=True)
class OpenLoop:
    """Drive the path, whatever the clock says; right of way at a vertex goes to who asked first. Can deadlock."""

    name: str = "open_loop"
    sound_plan_only: bool = False
    keeps_order: bool = False
    look_ahead: int = 2
    paced: bool = False

    def order(self, problem: Problem, plan: Plan, needs: Needs) -> Schedule | None:
        return None

    def earliest_s(self, plan: Plan) -> FloatArray:
        return np.zeros(plan.num_visits)


@dataclass(frozen=True)
class Timed(OpenLoop):
    """Leave no vertex before the plan does; right of way as in open loop. Delays can make it deadlock."""

    name: str = "timed"
    paced: bool = True

    def earliest_s(self, plan: Plan) -> FloatArray:
        return plan.depart_s


@dataclass(frozen=True)
class Adg:
    """Enter a vertex when everyone planned before has left it, as early as that is. Cannot deadlock."""

    name: str = "adg"
    sound_plan_only: bool = True
    keeps_order: bool = True
    look_ahead: int = 4
    paced: bool = False

    def order(self, problem: Problem, plan: Plan, needs: Needs) -> Schedule | None:
        return schedule_of(problem, plan, needs)

    def earliest_s(self, plan: Plan) -> FloatArray:
        return np.zeros(plan.num_visits)


@dataclass(frozen=True)
class AdgTimed(Adg):
    """The plan's order, and no vertex left before the plan does. Cannot deadlock."""

    name: str = "adg_timed"
    paced: bool = True

    def earliest_s(self, plan: Plan) -> FloatArray:
        return plan.depart_s


POLICIES: dict[str, Policy] = {policy.name: policy for policy in (OpenLoop(), Timed(), Adg(), AdgTimed())}


def policy_of(name: str) -> Policy:
    """The policy of this name.

    Raises
    ------
    ExecutionError
        When there is none.
    """
    if name not in POLICIES:
        raise ExecutionError(f"unknown execution policy '{name}'{nearest(name, POLICIES)}")
    return POLICIES[name]


def needs_sound_plan(name: str) -> bool:
    """Whether the policy refuses plans with conflicts, and orders that cannot be kept."""
    return policy_of(name).sound_plan_only
