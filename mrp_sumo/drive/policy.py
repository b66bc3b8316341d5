"""Execution policies: who may set out for a vertex, and when.

A policy turns a plan into an order at the resources (or none: first come, first served), the earliest time to
leave each visit, and a pace. The controller does the rest and is the same for all. A new policy is a class in
a file of its own, which its package registers under the entry-point group `mrp_sumo.policies`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import entry_points
from typing import Protocol

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.errors import ExecutionError, nearest
from mrp_sumo.traffic.passages import Needs, Schedule
from mrp_sumo.traffic.schedule import schedule_of


class Policy(Protocol):
    """How a plan is executed. Implementations have no state."""

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

    paced: bool = True

    def earliest_s(self, plan: Plan) -> FloatArray:
        return plan.depart_s


@dataclass(frozen=True)
class Adg:
    """Enter a vertex when everyone planned before has left it, as early as that is. Cannot deadlock."""

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

    paced: bool = True

    def earliest_s(self, plan: Plan) -> FloatArray:
        return plan.depart_s


GROUP = "mrp_sumo.policies"


@cache
def policies() -> Mapping[str, Policy]:
    """All policies by name: the four of this file, then those of other packages, which cannot take their names.

    Raises
    ------
    ExecutionError
        When a package's policy cannot be loaded.
    """
    found: dict[str, Policy] = {"open_loop": OpenLoop(), "timed": Timed(), "adg": Adg(), "adg_timed": AdgTimed()}
    for entry in sorted(entry_points(group=GROUP), key=lambda e: e.name):
        try:
            found.setdefault(entry.name, entry.load()())
        except (ImportError, AttributeError, TypeError) as error:
            raise ExecutionError(f"execution policy '{entry.name}' ({entry.value}) cannot be loaded: {error}") from error
    return found


def policy_of(name: str) -> Policy:
    """The policy of this name.

    Raises
    ------
    ExecutionError
        When there is none.
    """
    known = policies()
    if name not in known:
        raise ExecutionError(f"unknown execution policy '{name}'{nearest(name, known)}")
    return known[name]


def needs_sound_plan(name: str) -> bool:
    """Whether the policy refuses plans with conflicts, and orders that cannot be kept."""
    return policy_of(name).sound_plan_only
