"""MRP-Bench's metrics, under its names and by its order of operations.

Definitions: boschresearch/mrp_bench at commit c39c865, `metric_collector.py` (`BagAnalyzer`) for the
execution and `bench_node.py` for the planning counts. Refuses logs without a message. Two things
differ from the analyser: a stamp of 0 is a stamp like any other, and where it would raise `TypeError`
(all arrive, nobody ever leaves the start) the execution time is None.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist

from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.errors import MrpSumoError

CELL_M = 0.35  # cellSize
TOLERANCE_M = 0.7  # locationTolerance
WINDOW = 10  # samples
RECORDING_TIMEOUT_S = 600.0  # recordingTimeout
NO_PAIR_M = 99999.9  # the minimum distance where there never are two robots
RATE_HZ = 2.0  # of /fleet_states


def execution_metrics(
    t_ns: IntArray,
    x_m: FloatArray,
    y_m: FloatArray,
    start_m: FloatArray,
    goal_m: FloatArray,
    *,
    cell_m: float = CELL_M,
    tolerance_m: float = TOLERANCE_M,
    window: int = WINDOW,
    recording_timeout_s: float = RECORDING_TIMEOUT_S,
) -> dict[str, Any]:
    """What MRP-Bench's analyser says of T fleet states of R assigned robots.

    Parameters
    ----------
    t_ns
        [T] ascending stamps in ns.
    x_m, y_m
        [T, R] positions, NaN where the robot is not in the message. MRP-Bench's own are float32:
        round first to compare bit for bit.
    start_m, goal_m
        [R, 2] planned starts and goals.
    cell_m
        A sample counts for blocking when the robot is farther than this from its start or nearer than
        this to its goal; also the progress asked for over a window.
    tolerance_m
        Arrived: nearer to the goal than this. Movement begins with any robot farther from its start.
    window
        Samples in a window.
    recording_timeout_s
        Execution time when not all arrive.

    Returns
    -------
    dict
        By MRP-Bench's names, times in s, distances in m. `timeBlockedPerAgent` maps robot indices, and
        has no entry for a robot without a sample that counts; `agentsAtGoal` is a list of indices.

    Raises
    ------
    MrpSumoError
        When there is no message.
    """
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
    execution_time_s: float | None = recording_timeout_s
    if all_arrived and num_robots:
        moved = bool(left.any())
        execution_time_s = (int(t_ns[arrival.max()]) - int(t_ns[left.argmax()])) / 1e9 if moved else None

    counts = ((to_start > cell_m) | (to_goal < cell_m)) & (np.arange(num_samples)[:, None] <= arrival)
    blocked: dict[int, float] = {}
    for robot in np.flatnonzero(counts.any(0)):
        distance = to_goal[counts[:, robot], robot]
        steps = (
            np.count_nonzero(np.abs(distance[window - 1 :] - distance[: len(distance) - window + 1]) <= cell_m)
            if window <= len(distance)
            else 0
        )
        blocked[int(robot)] = int(steps) * period_s

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


def _least_distances(x_m: FloatArray, y_m: FloatArray) -> FloatArray:
    """[T] the least centre distance of two robots in each message, inf where there are not two."""
    least = np.full(len(x_m), np.inf)
    for k in range(len(x_m)):
        there = np.isfinite(x_m[k]) & np.isfinite(y_m[k])
        xy = np.column_stack((x_m[k, there], y_m[k, there]))
        if len(xy) > 64:
            least[k] = cKDTree(xy).query(xy, k=2)[0][:, 1].min()
        elif len(xy) > 1:
            least[k] = pdist(xy).min()
    return least


def planning_counts(paths: Sequence[Sequence[int]]) -> tuple[int, int]:
    """Makespan and cost before smoothing: the largest and the sum of the list lengths, starts included.

    Parameters
    ----------
    paths
        [R] vertices at steps 0, 1, ..., ending with the arrival.
    """
    lengths = [len(path) for path in paths]
    return max(lengths, default=0), sum(lengths)


def smoothed_counts(paths: Sequence[Sequence[int]], cell: IntArray) -> tuple[int, int]:
    """Makespan and cost after MRP-Bench's smoothing (`bench_node.py`, lines 324-338).

    Waypoint i is kept; where i + 2 lies as many cells across as along, i + 1 is dropped. That drops
    waits as well.

    Parameters
    ----------
    paths
        As for `planning_counts`.
    cell
        [V, 2] grid cell of each vertex.
    """
    lengths = []
    for path in paths:
        step = np.abs(cell[np.asarray(path[2:], np.int64)] - cell[np.asarray(path[:-2], np.int64)])
        skips = [*(step[:, 0] == step[:, 1]).tolist(), False, False]
        i = kept = 0
        while i < len(path):
            kept += 1
            i += 2 if skips[i] else 1
        lengths.append(kept)
    return max(lengths, default=0), sum(lengths)
