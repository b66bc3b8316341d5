"""Execution policies: who may set out for a vertex, and when.

A policy turns a plan into an order at the resources (or none: first come, first served), the earliest time to
leave each visit, and a pace. The controller does the rest and is the same for all. A new policy is a class in
a file of its own; see `mrp_sumo.plugins.registry`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, cast

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.core.options import option
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive.live_plan import LivePlan
from mrp_sumo.drive.outside_policy import OutsidePolicy
from mrp_sumo.plugins import registry
from mrp_sumo.plugins.face import check_face
from mrp_sumo.traffic.passages import Needs, Schedule
from mrp_sumo.traffic.schedule import schedule_of


class Policy(Protocol):
    """Rules by which a plan is executed. Implementations have no state; their fields are their parameters."""

    @property
    def look_ahead(self) -> int:
        """Number of visits ahead of its position that a robot may claim at most, beside those that it needs to brake."""

    @property
    def paced(self) -> bool:
        """True if a robot that is early drives slower."""

    @property
    def keeps_order(self) -> bool:
        """True if `order` gives one."""

    @property
    def sound_plan_only(self) -> bool:
        """True if plans with conflicts, and orders that cannot be kept, are refused."""

    def order(self, problem: Problem, plan: Plan, needs: Needs) -> Schedule | None:
        """Order in which robots pass every resource; None: first come, first served. PlanError when it cannot be kept."""

    def earliest_s(self, plan: Plan) -> FloatArray:
        """[N] before which no robot leaves a visit."""


class DecidingPolicy(Policy, Protocol):
    """A policy that may change the order of passages while robots drive: one with these two, and `keeps_order`."""

    @property
    def decides_every_s(self) -> float:
        """Simulated time between two decisions."""

    def decide(self, problem: Problem, plan: LivePlan, needs: Needs, now_s: float) -> Schedule | None:
        """Another order of the passages that are still to be made; None: as it is.

        Parameters
        ----------
        plan
            From the last visit that each robot has reached on, with planned times. What robots have been granted already has
            times below 0, and has to stay first: `traffic.passages.order_of` gives such an order.
        needs
            What these visits still need.
        """


@dataclass(frozen=True)
class OpenLoop:
    """Drive the path, whatever the clock says; right of way at a vertex goes to whoever asked first. Can deadlock."""

    sound_plan_only: ClassVar[bool] = False
    keeps_order: ClassVar[bool] = False
    paced: ClassVar[bool] = False

    look_ahead: int = option(2, "visits that a robot may claim beyond those that it needs to brake")

    def order(self, problem: Problem, plan: Plan, needs: Needs) -> Schedule | None:
        return None

    def earliest_s(self, plan: Plan) -> FloatArray:
        return np.zeros(plan.num_visits)


@dataclass(frozen=True)
class Timed(OpenLoop):
    """Leave no vertex before the plan does; right of way as in open loop. Delays can make it deadlock."""

    paced: ClassVar[bool] = True

    def earliest_s(self, plan: Plan) -> FloatArray:
        return plan.depart_s


@dataclass(frozen=True)
class Adg:
    """Enter a vertex as soon as everyone planned before has left it. Cannot deadlock."""

    sound_plan_only: ClassVar[bool] = True
    keeps_order: ClassVar[bool] = True
    paced: ClassVar[bool] = False

    look_ahead: int = option(4, "visits that a robot may claim beyond those that it needs to brake")

    def order(self, problem: Problem, plan: Plan, needs: Needs) -> Schedule | None:
        return schedule_of(problem, plan, needs)

    def earliest_s(self, plan: Plan) -> FloatArray:
        return np.zeros(plan.num_visits)


@dataclass(frozen=True)
class AdgTimed(Adg):
    """The plan's order, and no vertex left before the plan does. Cannot deadlock."""

    paced: ClassVar[bool] = True

    def earliest_s(self, plan: Plan) -> FloatArray:
        return plan.depart_s


@dataclass(frozen=True)
class AdgSwitch(Adg):
    """The plan's order until somebody is late; then, again and again, the best order that a bounded search finds. Cannot deadlock."""

    asks_late: ClassVar[bool] = True  # robots claim no more than they need to drive on: what is granted cannot be switched

    decides_every_s: float = option(1.0, "time between decisions")
    late_s: float = option(1.0, "nothing is changed while all robots are less late than this")
    hold_s: float = option(6.0, "how much longer a robot that is held by a disturbance is taken to stand")
    least_s: float = option(1.0, "what a change has to take off the sum of arrival times; the last robot may arrive later")
    budget: int = option(1000, "searches for longest paths in a decision, at most")

    def decide(self, problem: Problem, plan: LivePlan, needs: Needs, now_s: float) -> Schedule | None:
        if plan.order is None or not (plan.late_s >= self.late_s).any():
            return None
        from mrp_sumo.drive.switching import switched  # loads kernels

        return switched(problem, plan, now_s, hold_s=self.hold_s, least_s=self.least_s, budget=self.budget)


OURS: Mapping[str, type] = {"open_loop": OpenLoop, "timed": Timed, "adg": Adg, "adg_timed": AdgTimed, "adg_switch": AdgSwitch}


def policies() -> tuple[str, ...]:
    """The names of all registered policies, sorted."""
    return registry.names("policies")


def policy_of(name: str, parameters: Mapping[str, Any] | None = None) -> Policy:
    """The policy of this name, as registered or `FILE.py:CLASS`; parameters have their defaults otherwise.

    Raises ScenarioError for an unknown name or parameter (with the nearest right one) and a value that does not fit, and PlugInError for a
    plug-in that cannot be loaded, or is no policy.
    """
    policy = registry.make("policies", name, parameters or {})
    source = registry.find("policies", name)
    if source.ours:
        return cast(Policy, policy)
    if hasattr(policy, "decide") or hasattr(policy, "decides_every_s"):
        check_face(policy, DecidingPolicy, "policy that decides while driving")
    return cast(Policy, OutsidePolicy(policy, source))
