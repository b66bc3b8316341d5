"""Plans and what planners return.

A plan is a list of timed visits a robot, in seconds, so that planners on steps and planners in
continuous time meet one referee and one executor. `plan_of_paths` makes one of step-wise paths,
`paths_of_plan` goes back.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from mrp_sumo.core.graph import FloatArray, IntArray, frozen
from mrp_sumo.errors import PlanError

MOST_STEPS = 1_000_000  # of a plan that is written out step by step


class Status(StrEnum):
    """The end of planning. Every one of them is a result."""

    SOLVED = "solved"
    TIMED_OUT = "timed_out"
    INFEASIBLE = "infeasible"
    GAVE_UP = "gave_up"  # an incomplete method ran out of things to try
    PLANNER_FAILED = "planner_failed"  # a plug-in that broke its contract


@dataclass(frozen=True, eq=False)
class Plan:
    """Timed visits of R robots in CSR form; robot r's are `first[r]:first[r + 1]`.

    A robot stands on `vertex[k]` from `arrive_s[k]` to `depart_s[k]`, then drives to the next visit's
    vertex. It starts at time 0 and stays at its last visit for ever (`depart_s` inf), where it may have to turn first. A plan that
    was made in steps of one length and then given the times of real motion has the steps beside them.
    """

    first: IntArray  # [R + 1]
    vertex: IntArray  # [N]
    arrive_s: FloatArray  # [N]
    depart_s: FloatArray  # [N]
    in_steps: "Plan | None" = None  # the same visits at the times that the planner gave them, where these are others
    turned_s: FloatArray | None = None  # [R] when each robot faces as it is to stay; None: all stay as they come

    @property
    def num_robots(self) -> int:
        return len(self.first) - 1

    @property
    def num_visits(self) -> int:
        return len(self.vertex)

    @property
    def robot(self) -> IntArray:
        """[N] the robot of each visit."""
        return np.repeat(np.arange(self.num_robots), np.diff(self.first))

    @property
    def end_s(self) -> FloatArray:
        """[R] when each robot stands at its last vertex as it is to stay."""
        return self.arrive_s[self.first[1:] - 1] if self.turned_s is None else self.turned_s

    @property
    def last_vertex(self) -> IntArray:
        """[R] where each robot ends."""
        return self.vertex[self.first[1:] - 1]


@dataclass(frozen=True, eq=False)
class PlanResult:
    """A planner's answer. `plan` is there when SOLVED, and when TIMED_OUT with an anytime planner."""

    status: Status
    plan: Plan | None = None
    goal_of: IntArray | None = None  # [R] the assignment the plan is for, when the planner made it
    planning_time_s: float = 0.0  # the solver's own wall time, without compiling
    prepare_time_s: float = 0.0  # compiling or loading kernels
    lower_bound_steps: float = 0.0  # on the standard sum of costs of any plan for this problem
    stats: Mapping[str, float] = field(default_factory=dict)  # the planner's own counters
    message: str = ""  # why there is no plan
    details: str = ""  # the traceback of a plug-in that failed
    retime_time_s: float | None = None  # wall time of giving the plan the times of real motion
    planning_cpu_s: float | None = None  # CPU time of all threads and programs of the solver; None where it is not known
    chosen: str = ""  # the planner whose answer this is, where a portfolio chose
    why: str = ""  # it was chosen


def plan_of_paths(paths: Sequence[IntArray | Sequence[int]], step_s: float) -> Plan:
    """A Plan of step-wise paths.

    Parameters
    ----------
    paths
        One a robot: its vertex at steps 0, 1, ...; a repeated vertex is a wait. Trailing waits are dropped.
    step_s
        Seconds a step.

    Raises
    ------
    PlanError
        When a robot has no step 0.
    """
    if not len(paths):
        return plan_of_visits([])
    num_steps = np.array([len(path) for path in paths], np.int64)
    if not num_steps.all():
        raise PlanError(f"the path of robot {int(np.argmin(num_steps))} is empty")
    at, begin = np.concatenate(paths), np.cumsum(num_steps) - num_steps
    comes = np.append(True, at[1:] != at[:-1])
    comes[begin] = True
    visit = np.flatnonzero(comes)
    first = np.searchsorted(visit, np.append(begin, len(at))).astype(np.int64)
    vertex = at[visit].astype(np.int64)
    del at, comes  # of thousands of robots
    step = np.subtract(visit, np.repeat(begin, np.diff(first)), out=visit)
    depart_s = np.append(step[1:] - 1, 0) * float(step_s)
    depart_s[first[1:] - 1] = np.inf
    return Plan(frozen(first), frozen(vertex), frozen(step * float(step_s)), frozen(depart_s))


def side_by_side(paths: Sequence[IntArray]) -> IntArray:
    """[T, R] step-wise paths, as long as the longest; who has arrived stays."""
    longest = max(map(len, paths), default=0)
    return np.stack([np.pad(path, (0, longest - len(path)), "edge") for path in paths], axis=1) if paths else np.zeros((0, 0), np.int64)


def plan_of_visits(visits: Sequence[tuple[IntArray, FloatArray, FloatArray]]) -> Plan:
    """A Plan of each robot's vertices, arrivals and departures in s."""
    vertex, arrive_s, depart_s = zip(*visits) if visits else ((), (), ())
    none: list[FloatArray] = [np.zeros(0)]
    return Plan(
        first=frozen(np.cumsum([0, *map(len, vertex)]).astype(np.int64)),
        vertex=frozen(np.concatenate([np.zeros(0, np.int64), *vertex])),
        arrive_s=frozen(np.concatenate(none + list(arrive_s))),
        depart_s=frozen(np.concatenate(none + list(depart_s))),
    )


def as_planned_in_steps(plan: Plan, step_s: float) -> Plan | None:
    """The plan with its arrivals at whole steps: itself, or as it was before it got other times; None where it never was."""
    if plan.in_steps is not None:
        return plan.in_steps
    steps = plan.arrive_s / step_s
    return plan if bool((np.abs(steps - np.rint(steps)) < 1e-6).all()) else None


def paths_of_plan(plan: Plan, step_s: float) -> list[IntArray]:
    """The plan step by step: [R] arrays of vertices at steps 0, 1, ... up to the robot's arrival.

    Raises PlanError when a time of the plan is missing, not a whole number of steps, before an earlier one or beyond `MOST_STEPS`, or a
    robot has no visit at time 0.
    """
    paths = []
    plan = plan.in_steps or plan
    for robot in range(plan.num_robots):
        visits = slice(plan.first[robot], plan.first[robot + 1])
        steps = plan.arrive_s[visits] / step_s
        if not len(steps) or steps[0] != 0:
            raise PlanError(f"robot {robot} has no visit at 0 s")
        if not np.isfinite(steps).all() or not np.isfinite(plan.depart_s[visits][:-1]).all():
            raise PlanError(f"robot {robot} has a visit without a time")
        if steps[-1] > MOST_STEPS:
            raise PlanError(f"robot {robot} arrives after {steps[-1]:.6g} steps; at most {MOST_STEPS} are written out")
        arrive = np.rint(steps).astype(np.int64)
        depart = plan.depart_s[visits] / step_s
        whole = np.abs(steps - arrive) < 1e-6
        if not whole.all():
            raise PlanError(f"robot {robot} arrives at {plan.arrive_s[visits][~whole][0]} s, not at a whole step of {step_s} s")
        depart = np.where(np.isfinite(depart), depart, arrive)
        leaves = np.rint(depart[:-1]).astype(np.int64)
        if (leaves + 1 != arrive[1:]).any():
            k = int(np.flatnonzero(leaves + 1 != arrive[1:])[0])
            raise PlanError(f"robot {robot} needs {arrive[k + 1] - leaves[k]} steps for one lane, to visit {k + 1}")
        if (leaves < arrive[:-1]).any():
            raise PlanError(f"robot {robot} leaves visit {int(np.flatnonzero(leaves < arrive[:-1])[0])} before it arrives there")
        # a robot is at its visit's vertex from its arrival until the step before the next arrival
        paths.append(np.repeat(plan.vertex[visits], np.diff(np.append(arrive, arrive[-1] + 1))))
    return paths
