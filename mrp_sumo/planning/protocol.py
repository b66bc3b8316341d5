"""Planners and assigners. A plug-in is a class with one of these faces, best a frozen dataclass.

Its fields are its parameters: scenario files set them by name, and the registry refuses others.
"""

from typing import Protocol, runtime_checkable

from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.plan import PlanResult
from mrp_sumo.core.problem import Problem


@runtime_checkable
class Planner(Protocol):
    """Plans a Problem."""

    @property
    def assigns(self) -> bool:
        """True if it chooses the goals' robots itself, as CBS-TA does; a `ClassVar[bool]` will do."""

    @property
    def guarantee(self) -> str:
        """One phrase for tables, such as 'optimal', 'none', 'w-bounded'; a `ClassVar[str]` will do."""

    def prepare(self) -> None:
        """Compile or load the kernels, so that `plan` measures planning only."""

    def plan(self, problem: Problem, time_limit_s: float) -> PlanResult:
        """Solve, or say in the result why not; never raises for a hard or unsolvable problem.

        Parameters
        ----------
        problem
            With an assignment unless `assigns`.
        time_limit_s
            CPU time of all threads, so that a loaded machine gives the same answers; the result is TIMED_OUT within 5 % (at least 0.1 s)
            of it. One in a process of its own is killed once it has had so much time with a processor there for it.
        """


@runtime_checkable
class Assigner(Protocol):
    """Assigns goals to robots."""

    def assign(self, cost: FloatArray, time_limit_s: float) -> IntArray:
        """The assignment of least cost.

        Parameters
        ----------
        cost
            [R, G], inf where a robot cannot reach a goal.
        time_limit_s
            Wall time.

        Returns
        -------
        goal_of
            [R] goal of each robot, -1 for a robot left without one (only when there are fewer goals than robots).

        Raises
        ------
        PlanError
            When no assignment serves min(R, G) goals.
        """
