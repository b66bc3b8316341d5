"""Policies from outside, in this process: their exceptions become one line that names theirs, and their answers are checked.

A kernel drives by what a policy answers, so an index out of range there must not get through.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray, frozen
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive.live_plan import LivePlan
from mrp_sumo.errors import PlanError, PlugInError
from mrp_sumo.plugins.face import place_of
from mrp_sumo.plugins.source import Source, calling
from mrp_sumo.traffic.passages import Needs, Schedule


class OutsidePolicy:
    """A policy; see `Policy`. Every call raises PlugInError for whatever the plug-in does wrong."""

    def __init__(self, policy: Any, source: Source) -> None:
        self._policy, self._source = policy, source

    def __getattr__(self, name: str) -> Any:
        """Attributes as they are, methods guarded."""
        answer = getattr(self._policy, name)
        return self._guarded(answer) if callable(answer) else answer

    def order(self, problem: Problem, plan: Plan, needs: Needs) -> Schedule | None:
        """See `Policy`."""
        answer = self._guarded(self._policy.order)(problem, plan, needs)
        if answer is None and not self._policy.keeps_order:
            return None
        return self._checked(answer, self._policy.order, plan, needs)

    def earliest_s(self, plan: Plan) -> FloatArray:
        """See `Policy`."""
        answer = np.asarray(self._guarded(self._policy.earliest_s)(plan))
        if answer.shape != (plan.num_visits,) or answer.dtype.kind not in "iuf" or np.isnan(answer).any():
            raise PlugInError(
                f"{place_of(self._policy.earliest_s)}: earliest_s() returned an array of shape {list(answer.shape)} and {answer.dtype}, "
                f"expected a time in s for each of the {plan.num_visits} visits"
            )
        return frozen(answer.astype(np.float64))

    def decide(self, problem: Problem, plan: LivePlan, needs: Needs, now_s: float) -> Schedule | None:
        """See `DecidingPolicy`."""
        answer = self._guarded(self._policy.decide)(problem, plan, needs, now_s)
        return None if answer is None else self._checked(answer, self._policy.decide, plan, needs)

    def _checked(self, answer: Any, method: Callable[..., Any], plan: Plan, needs: Needs) -> Schedule:
        wrong = (
            ""
            if isinstance(answer, Schedule)
            else f"returned {type(answer).__name__}, expected a Schedule, since the policy keeps an order"
        )
        wrong = wrong or _fault(answer, plan, needs)
        if wrong:
            raise PlugInError(f"{place_of(method)}: {method.__name__}() {wrong}")
        return Schedule(**{name: frozen(np.asarray(value, np.int64)) for name, value in vars(answer).items()})

    def _guarded(self, method: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            with calling(self._source, method, PlanError):  # which is an order that cannot be kept
                return method(*arguments)

        return call


def _fault(schedule: Schedule, plan: Plan, needs: Needs) -> str:
    """What is wrong with the form of a schedule, '' if nothing is."""
    num_passages = len(schedule.robot)
    if len(schedule.first) != needs.num_resources + 1 or schedule.first[0] != 0 or schedule.first[-1] != num_passages:
        return f"returned {len(schedule.first)} offsets, expected {needs.num_resources + 1}, from 0 to the {num_passages} passages"
    if (np.diff(schedule.first) < 0).any():
        return "returned offsets that fall"
    expected: tuple[tuple[str, IntArray, int, int], ...] = (
        ("robot", schedule.robot, num_passages, plan.num_robots),
        ("visit", schedule.visit, num_passages, plan.num_visits),
        ("last_visit", schedule.last_visit, num_passages, plan.num_visits),
        ("left_at", schedule.left_at, num_passages, plan.num_visits + 1),
        ("passage_of_need", schedule.passage_of_need, len(needs.resource), num_passages),
    )
    for name, array, length, end in expected:
        if len(array) != length:
            return f"returned a schedule with {len(array)} of {name}, expected {length}"
        if len(array) and not 0 <= array.min() <= array.max() < end:
            return f"returned a schedule with a {name} that is not from 0 to {end - 1}"
    return ""
