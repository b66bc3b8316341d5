"""Trajectories and events of an execution."""

import mmap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np

from mrp_sumo.core.battery import BatteryLog
from mrp_sumo.core.facilities import FacilityLog
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray
from mrp_sumo.core.people import PeopleLog
from mrp_sumo.core.plan import Plan, plan_of_visits
from mrp_sumo.core.robot_states import RobotStateLog
from mrp_sumo.core.task import StopLog, TaskLog

# what a robot's second can be spent on, the columns of `Execution.booked_s`
BOOKINGS = ("moving", "turning", "planned_wait", "dependency_wait", "yielding", "blocked", "disturbed", "at_goal")

RECORDED = "recorded"  # in the place of a policy: the run was not driven here, but read from a log


class Outcome(StrEnum):
    """The end of an execution."""

    COMPLETED = "completed"  # every robot stands at its goal
    TIME_LIMIT = "time_limit"
    STALLED = "stalled"  # there is work, and at the end nobody had been getting on with any for a while
    PLANNER_STALLED = "planner_stalled"  # likewise, since the planner had no plans
    DEADLOCK = "deadlock"  # stopped on request when a deadlock was found
    INTERRUPTED = "interrupted"  # stopped by its user; what there is by then is kept


@dataclass(frozen=True)
class Event:
    """Something worth telling, at simulated time `t_s`. `duration_s` is 0 for what has none."""

    t_s: float
    kind: str  # 'started', 'goal', 'waited', 'blocked', 'deadlock', ...
    robot: int
    vertex: int = -1  # of the plan graph
    other: int = -1  # the robot waited for
    duration_s: float = 0.0
    text: str = ""


@dataclass(frozen=True, eq=False)
class Reply:
    """Other ways that some robots were sent while they drove: K robots, N visits in CSR form."""

    t_s: float
    reason: str  # 'give_way', 'detour' or 'replan'
    text: str  # for people
    robot: IntArray  # [K] ascending
    first: IntArray  # [K + 1] visits of the k-th robot are first[k]:first[k + 1]
    since: IntArray  # [K] the robot's visit after which they come, counted from 0 along its way
    vertex: IntArray  # [N]
    arrive_s: FloatArray  # [N] as planned
    depart_s: FloatArray  # [N] as planned, inf where the robot stays
    arrived_s: FloatArray  # [N] as driven, NaN: never


@dataclass(frozen=True, eq=False)
class GrantLog:
    """Grants of visits to robots: G rows by time."""

    t_s: FloatArray  # [G]
    robot: IntArray  # [G]
    visit: IntArray  # [G] the last visit it may drive to from then on, counted from 0 along its way
    enters: BoolArray  # [G] whether it may also enter the lane to the next one, short of which it is to stop


@dataclass(frozen=True)
class PlannerCalls:
    """Counts of the planner's answers while robots drove to tasks."""

    requests: int = 0
    late: int = 0  # used up their effort without a plan: robots kept what they had
    failed: int = 0  # found no plan, or none that could be driven from where robots were: likewise
    stepped: int = 0  # of late and failed ones, answered by PIBT instead, since the one before had failed, too
    stopped: int = 0  # of these, not even by PIBT: robots stop at the ends of what they have
    wall_time_s: float = 0.0
    cpu_time_s: float | None = None  # of all threads, and programs that have ended; None: not known, such as of a planner from outside
    plans_of: Mapping[str, int] = field(default_factory=dict)  # plans by the planner that made them


@dataclass(frozen=True, eq=False)
class Execution:
    """Time-major trajectory of R robots over T samples, and what happened. NaN: not on the floor."""

    t_s: FloatArray  # [T] simulated time of each sample, equally spaced from 0
    x_m: FloatArray  # [T, R] centre, map frame
    y_m: FloatArray  # [T, R]
    yaw_rad: FloatArray  # [T, R] counter-clockwise from +x
    speed_mps: FloatArray  # [T, R]
    arrived_s: FloatArray  # [N] when each visit of the plan was reached, NaN if never
    goal_s: FloatArray  # [R] when each robot came to stand at its goal, NaN if never, and where tasks come
    outcome: Outcome
    policy: str  # the policy that was used
    sim_time_s: float  # simulated time at the end
    wall_time_s: float  # of the loop, without start-up
    cpu_time_s: float  # of the process, in the loop
    events: tuple[Event, ...] = ()
    findings: tuple[str, ...] = field(default=())  # collisions that SUMO itself reports
    level: IntArray | None = None  # [T, R] that robots are on, in the order of the graph's names; None: all of them on one for good
    hitch_rad: Mapping[str, FloatArray] = field(default_factory=dict)  # [T, R] each: `hitch_1_rad` is the first trailer's, to the tugger
    loads: IntArray | None = None  # [T, R] on board; None: one at most, which makes no difference
    facilities: FacilityLog | None = None  # what lifts and doors did; None where there are none
    people: PeopleLog | None = None  # what people did, and what they cost robots; None where there are none
    believed: FloatArray | None = None  # [3, T, R] x, y, yaw: where robots take themselves to be; None: where they are
    sumo_t_s: FloatArray = field(default_factory=lambda: np.zeros(0))  # [K] times within the run at which SUMO was asked
    sumo_xy_m: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 2)))  # [K, R, 2] where it had the robots
    replies: tuple[Reply, ...] = ()  # by time
    grants: GrantLog | None = None  # None: not known
    tasks: TaskLog | None = None  # of a run with a stream of tasks
    stops: StopLog | None = None  # of the same
    robot_states: RobotStateLog | None = None  # of the same
    calls: PlannerCalls | None = None  # of the same
    batteries: BatteryLog | None = None  # of the same, where the robots' type has one
    booked_s: FloatArray = field(default_factory=lambda: np.zeros((0, len(BOOKINGS))))  # [R, 8] every second of every robot

    @property
    def num_robots(self) -> int:
        return int(self.x_m.shape[1])

    @property
    def period_s(self) -> float:
        """Time between samples; 1 s where there are not two."""
        return float(self.t_s[1] - self.t_s[0]) if len(self.t_s) > 1 else 1.0

    @property
    def all_at_goal(self) -> bool:
        return bool(np.isfinite(self.goal_s).all())


def plans_in_force(plan: Plan, replies: Sequence[Reply]) -> Iterator[Plan]:
    """The plan after each reply: what robots have done by then and are to do, with ids of vertices and planned times."""
    ways = [slice(a, b) for a, b in zip(plan.first[:-1].tolist(), plan.first[1:].tolist())]
    columns = [(plan.vertex[visits], plan.arrive_s[visits], plan.depart_s[visits]) for visits in ways]
    for reply in replies:
        for k, robot in enumerate(reply.robot.tolist()):
            last, new = int(reply.since[k]) + 1, slice(int(reply.first[k]), int(reply.first[k + 1]))
            vertex, arrive_s, depart_s = (column[:last] for column in columns[robot])
            if new.start == new.stop:
                depart_s = np.append(depart_s[:-1], np.inf)
            parts = (vertex, reply.vertex[new]), (arrive_s, reply.arrive_s[new]), (depart_s, reply.depart_s[new])
            columns[robot] = tuple(np.concatenate(part) for part in parts)  # type: ignore[assignment]
        yield plan_of_visits(columns)


def let_go_of_samples(execution: Execution) -> None:
    """Give back the memory of samples that are on the disk, as those of long runs are: what is needed again is read again."""
    for column in (execution.x_m, execution.y_m, execution.yaw_rad, execution.speed_mps):
        owner: object = column
        while isinstance(owner, np.ndarray):
            owner = owner.base
        if isinstance(owner, mmap.mmap) and hasattr(mmap, "MADV_DONTNEED"):
            owner.madvise(mmap.MADV_DONTNEED)


def as_believed(execution: Execution) -> Execution:
    """The execution as the robots tell it: their believed poses instead of the true ones."""
    if execution.believed is None:
        return execution
    x, y, yaw = execution.believed
    return replace(execution, x_m=x, y_m=y, yaw_rad=yaw, believed=None)


def positions_at(execution: Execution, t_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """x, y, yaw [K, R] at ascending times [K] of a run of one sample or more: linear between samples, yaw the short way round.

    Outside, the first and the last sample hold.
    """
    last = len(execution.t_s) - 1
    k = np.clip(np.searchsorted(execution.t_s, t_s + 1e-9, side="right") - 1, 0, max(last - 1, 0))
    k1 = np.minimum(k + 1, last)
    span = execution.t_s[k1] - execution.t_s[k]
    u = np.divide(t_s - execution.t_s[k], span, out=np.zeros(len(k)), where=span > 0)
    u = np.clip(np.where(np.abs(u - np.rint(u)) < 1e-9, np.rint(u), u), 0, 1)[:, None]
    x = execution.x_m[k] + u * (execution.x_m[k1] - execution.x_m[k])
    y = execution.y_m[k] + u * (execution.y_m[k1] - execution.y_m[k])
    turn = (execution.yaw_rad[k1] - execution.yaw_rad[k] + np.pi) % (2 * np.pi) - np.pi
    return x, y, execution.yaw_rad[k] + u * turn
