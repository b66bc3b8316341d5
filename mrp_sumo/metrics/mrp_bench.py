"""MRP-Bench's metrics, by its order of operations: under its names for any log, under ours for a run.

Definitions: boschresearch/mrp_bench at commit c39c865, `metric_collector.py` (`BagAnalyzer`) for the
execution and `bench_node.py` for the planning counts. Refuses logs without a message. Two things
differ from the analyser: a stamp of 0 is a stamp like any other, and where it would raise `TypeError`
(all arrive, nobody ever leaves the start) the execution time is None.

A run is measured by what MRP-Bench would have recorded of it: positions at 2 Hz, in float32.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrp_sumo.core.execution import Execution, positions_at
from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.near import least_distance_m
from mrp_sumo.core.plan import paths_of_plan
from mrp_sumo.errors import MrpSumoError, PlanError
from mrp_sumo.metrics.metric import (
    LESS,
    MORE,
    NONE,
    RECORDING_TIMEOUT_S,
    TOLERANCE_M,
    YES_NO,
    Evidence,
    Function,
    Metric,
    count_of,
    of,
    part,
)
from mrp_sumo.metrics.planning import steps_to_goal

NO_PAIR_M = 99999.9  # the minimum distance where there never are two robots
RATE_HZ = 2.0  # of /fleet_states


@dataclass(frozen=True)
class AnalyserConstants:
    """Constants of MRP-Bench's analyser, in its order."""

    cell_m: float = 0.35  # a sample counts for blocking farther than this from the start or nearer to the goal; progress asked for, too
    tolerance_m: float = TOLERANCE_M  # robots nearer to their goals have arrived; movement begins with any that is farther from its start
    window: int = 10  # samples
    recording_timeout_s: float = RECORDING_TIMEOUT_S  # execution time when not all arrive


DEFAULT = AnalyserConstants()


def execution_metrics(
    t_ns: IntArray, x_m: FloatArray, y_m: FloatArray, start_m: FloatArray, goal_m: FloatArray, constants: AnalyserConstants = DEFAULT
) -> dict[str, Any]:
    """Figures of MRP-Bench's analyser for T fleet states of R assigned robots. Raises MrpSumoError when there is no message.

    Stamps [T] in ns ascend; positions [T, R] are NaN where the robot is not in the message. MRP-Bench's own are float32: round first to
    compare bit for bit. `start_m` and `goal_m` [R, 2] are the planned ones.

    Figures go by MRP-Bench's names, times in s, distances in m. `timeBlockedPerAgent` maps robot indices, and has no entry for a robot
    without a sample that counts; `agentsAtGoal` is a list of indices.
    """
    cell_m, tolerance_m = constants.cell_m, constants.tolerance_m
    num_samples, num_robots = x_m.shape
    if not num_samples:
        raise MrpSumoError("there is no fleet state to compute metrics from")
    to_start = np.hypot(x_m - start_m[:, 0], y_m - start_m[:, 1])  # [T, R], NaN where absent
    to_goal = np.hypot(x_m - goal_m[:, 0], y_m - goal_m[:, 1])
    period_s = (int(t_ns[-1]) - int(t_ns[0])) / 1e9 / num_samples

    near = to_goal < tolerance_m
    arrival = np.where(near.any(0), near.argmax(0), num_samples)  # [R] first sample at the goal
    at_goal = np.flatnonzero(arrival < num_samples)
    all_arrived = len(at_goal) == num_robots
    left = (to_start > tolerance_m).any(1)
    execution_time_s: float | None = constants.recording_timeout_s
    if all_arrived and num_robots:
        execution_time_s = (int(t_ns[arrival.max()]) - int(t_ns[left.argmax()])) / 1e9 if left.any() else None

    counts = ((to_start > cell_m) | (to_goal < cell_m)) & (np.arange(num_samples)[:, None] <= arrival)
    blocked = {
        int(robot): _stuck(to_goal[counts[:, robot], robot], constants.window, cell_m) * period_s for robot in np.flatnonzero(counts.any(0))
    }

    seen = np.isfinite(x_m).sum(1)
    most_seen = np.maximum.accumulate(seen)
    least = np.minimum.accumulate(_least_distances(x_m, y_m))
    complete = (most_seen == num_robots) & np.isfinite(least)
    at_start = float(least[complete.argmax()]) if complete.any() else 0.0
    minimum = float(least[-1]) if np.isfinite(least[-1]) else NO_PAIR_M
    return {
        "messages": num_samples,
        "period": period_s,
        "numGoals": num_robots,
        "maxRobotsSeen": int(most_seen[-1]),
        "invalidRun": int(most_seen[-1]) != len(blocked),
        "goalsReached": len(at_goal),
        "allGoalReached": all_arrived,
        "executionTimeoutReached": not all_arrived,
        "totalTimeForScheduleExecution": execution_time_s,
        "timeBlockedTotal": float(sum(blocked.values())),
        "timeBlockedPerAgent": blocked,
        "minDistanceBetweenTwoAgents": minimum,
        "minDistanceBetweenTwoAgentsAtStart": at_start,
        "minDistanceBetweenTwoAgentsDelta": at_start - minimum,
        "agentsAtGoal": at_goal.tolist(),
    }


def _stuck(to_goal: FloatArray, window: int, progress_m: float) -> int:
    """Windows of samples of one robot from whose first to whose last it comes no nearer, and no farther, than this."""
    apart = min(window - 1, len(to_goal))
    return int(np.count_nonzero(np.abs(to_goal[apart:] - to_goal[: len(to_goal) - apart]) <= progress_m))


def _least_distances(x_m: FloatArray, y_m: FloatArray) -> FloatArray:
    """[T] the least centre distance of two robots in each message, inf where there are not two."""
    if x_m.shape[1] < 2:
        return np.full(len(x_m), np.inf)
    there = np.isfinite(x_m) & np.isfinite(y_m)
    return np.array([least_distance_m(np.column_stack((x[seen], y[seen]))) for x, y, seen in zip(x_m, y_m, there)])


def smoothed_counts(paths: Sequence[Sequence[int]], cell: IntArray) -> tuple[int, int]:
    """Makespan and cost after MRP-Bench's smoothing (`bench_node.py`, lines 324-338).

    `paths` have the vertices of each robot at steps 0, 1, ... until it arrives, `cell` [V, 2] where they are on the grid. Waypoint i is
    left in; where i + 2 lies as many cells across as along, i + 1 is dropped. That drops waits as well.
    """
    lengths = []
    for path in paths:
        step = np.abs(cell[np.asarray(path[2:], np.int64)] - cell[np.asarray(path[:-2], np.int64)])
        skips = [*(step[:, 0] == step[:, 1]).tolist(), False, False]
        i = num_kept = 0
        while i < len(path):
            num_kept += 1
            i += 2 if skips[i] else 1
        lengths.append(num_kept)
    return max(lengths, default=0), sum(lengths)


def fleet_states(execution: Execution) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Stamps [K] in ns from 0, x, y and yaw [K, R] as MRP-Bench records them: 2 Hz, rounded to float32."""
    period_ns = round(1e9 / RATE_HZ)
    t_ns = np.arange(0, round(float(execution.t_s[-1]) * 1e9) + 1, period_ns, dtype=np.int64)
    x, y, yaw = (a.astype(np.float32).astype(np.float64) for a in positions_at(execution, t_ns / 1e9))
    return t_ns, x, y, yaw


def _analysed(run: Evidence) -> dict[str, Any]:
    if run.execution is None:
        return {}
    t_ns, x, y, _ = fleet_states(run.execution)
    xy = run.problem.graph.xy
    constants = AnalyserConstants(run.problem.graph.cell_m, run.tolerance_m, recording_timeout_s=run.time_limit_s)
    return execution_metrics(t_ns, x, y, xy[run.problem.start], xy[run.problem.target], constants)


def _distance(which: str) -> Function:
    """A least distance; None where there never are two robots."""

    def value(run: Evidence) -> float | None:
        analysed = run.once(_analysed)
        met = analysed.get("minDistanceBetweenTwoAgents", NO_PAIR_M) != NO_PAIR_M
        return analysed[f"minDistanceBetweenTwoAgents{which}"] if met else None

    return value


def _blocked_s(analysed: dict[str, Any]) -> list[float] | None:
    return [analysed["timeBlockedPerAgent"].get(robot, 0.0) for robot in range(analysed["numGoals"])] if analysed else None


def _lengths(run: Evidence) -> FloatArray | None:
    """[R] lengths of the lists of cells; none without a plan in steps."""
    steps = run.once(steps_to_goal)
    return None if steps is None else steps + 1


def _smoothed(run: Evidence) -> dict[str, int]:
    """Makespan and cost after smoothing; nothing without a plan on a grid."""
    if run.plan is None or not run.plan.num_robots or run.problem.graph.kind != "grid":
        return {}
    try:
        paths = [path.tolist() for path in paths_of_plan(run.plan, run.problem.step_s)]
    except PlanError:  # a plan in continuous time has no list of cells to smooth
        return {}
    xy = run.problem.graph.xy
    counts = smoothed_counts(paths, np.rint((xy - xy.min(0)) / run.problem.graph.cell_m).astype(np.int64))
    return dict(zip(("makespan", "cost"), counts))


# fmt: off
METRICS = (
    Metric("plan_success", YES_NO, MORE, "there is a plan, valid or not (`validScheduleFound`)", lambda run: run.plan is not None),
    Metric("makespan_steps", "cells", LESS, "longest list", of(_lengths, lambda each: count_of(each.max())), one_goal=True),
    Metric("cost_steps", "cells", LESS, "sum of the lists' lengths", of(_lengths, lambda each: count_of(each.sum())), one_goal=True),
    Metric("makespan_smoothed_steps", "cells", LESS,
           "`makespan_steps` after MRP-Bench's smoothing: waypoint i + 1 is dropped where i + 2 lies as many cells across as "
           "along; drops double waits, too. Grids only", part(_smoothed, "makespan"), one_goal=True),
    Metric("cost_smoothed_steps", "cells", LESS, "`cost_steps` after the same smoothing. Grids only", part(_smoothed, "cost"),
           one_goal=True),
    Metric("goals_reached", "", MORE, "robots that ever had `dg < tol` (`goalsReached`)", part(_analysed, "goalsReached"), one_goal=True),
    Metric("all_goals_reached", YES_NO, MORE, "`goals_reached == n` (`allGoalReached`)", part(_analysed, "allGoalReached"), one_goal=True),
    Metric("execution_time_s", "s", LESS,
           "τ of the message in which the last robot has `dg < tol` for the first time, minus τ of the first message with any "
           "robot at `ds > tol`; the execution's time limit when not all arrive; `null` when all arrive and none ever leaves its "
           "start (`totalTimeForScheduleExecution`)", part(_analysed, "totalTimeForScheduleExecution"), one_goal=True),
    Metric("execution_timed_out", YES_NO, LESS, "not all arrived (`executionTimeoutReached`)", part(_analysed, "executionTimeoutReached"),
           one_goal=True),
    Metric("min_distance_m", "m", MORE,
           "least distance of two robots' centres over all messages, parked ones included (`minDistanceBetweenTwoAgents`)", _distance("")),
    Metric("min_distance_at_start_m", "m", NONE, "the same up to the first message with all robots (`...AtStart`)", _distance("AtStart")),
    Metric("min_distance_delta_m", "m", LESS,
           "`min_distance_at_start_m - min_distance_m`: how much nearer robots came than they started (`...Delta`)", _distance("Delta")),
    Metric("time_blocked_total_s", "s", LESS, "sum of `time_blocked_s` (`timeBlockedTotal`)", part(_analysed, "timeBlockedTotal"),
           one_goal=True),
    Metric("time_blocked_s", "s", LESS,
           "number of blocked steps x `(τ_T - τ_1) / T`. Up to the arrival, a message counts when `ds > cell` or `dg < cell`; a "
           "step is blocked when, over the last 10 that count, `dg` changed by at most `cell`. 0 for a robot without a message "
           "that counts (`timeBlockedPerAgent`)", of(_analysed, _blocked_s), per_robot=True, one_goal=True),
    Metric("run_invalid", YES_NO, LESS, "some robot never had a message that counts, or never appeared (`invalidRun`)",
           part(_analysed, "invalidRun"), one_goal=True),
)
