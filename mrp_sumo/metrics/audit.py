"""An independent look at what was driven: did robots overlap, jump, speed or brake harder than they can.

Knows the trajectory and the robots' footprints and limits, nothing of plans, policies or SUMO, so it can
disagree with all of them. It sees samples, not what lies between them. Lengths in m, times in s.
"""

from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray

BLOCK = 8  # samples that share one search for neighbours
LISTED = 20  # findings of a kind that are told one by one
TOUCH_M = 1e-6  # rectangles that share less than this are not called overlapping
SPEED_SLACK = 1e-3  # relative: rounding in SUMO's files and steps
ACCEL_SLACK = 1e-2
JUMP_SLACK_M = 1e-3


def audit(execution: Execution, fleet: Fleet) -> dict[str, Any]:
    """Look over an execution.

    Parameters
    ----------
    execution
        T samples of R robots.
    fleet
        Footprints, rectangles of length x width turned by the yaw around the centre, and limits.

    Returns
    -------
    dict
        `passed`, whether nothing was found; `num_overlaps`, pairs of robots that ever overlap, and
        `overlaps`, each pair's first one (robots, t_s, x_m, y_m); `min_clearance_m`, the least distance of
        two footprints at any sample (0 when they overlap, None without two robots), and `min_clearance`
        with robots and time; `num_speed_violations`, `num_accel_violations` and `num_jumps`, counts of
        samples above the limits, and `violations`, the first of them. A jump is a step longer than
        the robot can drive in the time between two samples.
    """
    overlaps, clearance = _closeness(execution, fleet)
    counts, violations = _motion(execution, fleet)
    return {
        "passed": not overlaps and not any(counts.values()),
        "num_overlaps": len(overlaps),
        "overlaps": overlaps[:LISTED],
        "min_clearance_m": clearance["m"] if clearance else None,
        "min_clearance": clearance and {key: clearance[key] for key in ("robots", "t_s")},
        **counts,
        "violations": violations,
    }


def signed_distances(
    dx: FloatArray, dy: FloatArray, yaw_a: FloatArray, yaw_b: FloatArray, half_a: FloatArray, half_b: FloatArray
) -> FloatArray:
    """[P] distance of rectangles a to rectangles b; where they overlap, minus the depth they share.

    Parameters
    ----------
    dx, dy
        [P] centre of b seen from the centre of a.
    yaw_a, yaw_b
        [P] headings.
    half_a, half_b
        [P, 2] half lengths and half widths.
    """
    turn = yaw_b - yaw_a
    b_from_a = _into(dx, dy, yaw_a)
    a_from_b = _into(-dx, -dy, yaw_b)
    # separating axes of two rectangles are their own: apart unless they overlap on all four
    spread = np.abs(np.cos(turn)), np.abs(np.sin(turn))
    gap = np.stack(
        (
            np.abs(b_from_a[0]) - half_a[:, 0] - spread[0] * half_b[:, 0] - spread[1] * half_b[:, 1],
            np.abs(b_from_a[1]) - half_a[:, 1] - spread[1] * half_b[:, 0] - spread[0] * half_b[:, 1],
            np.abs(a_from_b[0]) - half_b[:, 0] - spread[0] * half_a[:, 0] - spread[1] * half_a[:, 1],
            np.abs(a_from_b[1]) - half_b[:, 1] - spread[1] * half_a[:, 0] - spread[0] * half_a[:, 1],
        )
    ).max(0)
    # two rectangles that are apart are nearest at a corner of one of them
    squared = np.minimum(_corners(b_from_a, turn, half_b, half_a), _corners(a_from_b, -turn, half_a, half_b))
    return np.where(gap > 0, np.sqrt(squared), gap)


def _into(dx: FloatArray, dy: FloatArray, yaw: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The vectors in frames turned by yaw."""
    cos, sin = np.cos(yaw), np.sin(yaw)
    return cos * dx + sin * dy, cos * dy - sin * dx


def _corners(centre: tuple[FloatArray, FloatArray], turn: FloatArray, half: FloatArray, other: FloatArray) -> FloatArray:
    """[P] least squared distance of the corners of a turned rectangle to one that lies straight around the origin."""
    cos, sin = np.cos(turn), np.sin(turn)
    least = np.full(len(turn), np.inf)
    for along, across in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        x = centre[0] + along * cos * half[:, 0] - across * sin * half[:, 1]
        y = centre[1] + along * sin * half[:, 0] + across * cos * half[:, 1]
        out = np.maximum(np.abs(x) - other[:, 0], 0) ** 2 + np.maximum(np.abs(y) - other[:, 1], 0) ** 2
        least = np.minimum(least, out)
    return least


def _closeness(execution: Execution, fleet: Fleet) -> tuple[list[dict[str, Any]], dict[str, Any] | None]:
    """The first overlap of every pair, by time, and the least clearance."""
    x, y, yaw = execution.x_m, execution.y_m, execution.yaw_rad
    radius, half = fleet.radius_m, np.column_stack((fleet.length_m, fleet.width_m)) / 2
    best, where = np.inf, (0, 0, 0)
    first: dict[tuple[int, int], int] = {}
    num_samples = len(x)
    num_there = np.isfinite(x).sum(1)
    if not num_samples or num_there.max() < 2:
        return [], None
    # a sparse first pass bounds the clearance from above, which keeps the search radius of the full pass small
    sparse = [int(num_there.argmax()), *np.linspace(0, num_samples - 1, min(num_samples, 64)).astype(np.int64).tolist()]
    blocks = [np.array([k]) for k in sparse]
    blocks += [np.arange(k, min(k + BLOCK, num_samples)) for k in range(0, num_samples, BLOCK)]
    for t in blocks:
        for i, j in _neighbours(x[t], y[t], radius, best):
            xi, xj = x[np.ix_(t, i)], x[np.ix_(t, j)]  # [B, P]
            yi, yj = y[np.ix_(t, i)], y[np.ix_(t, j)]
            apart = np.hypot(xj - xi, yj - yi) - (radius[i] + radius[j])  # a lower bound of the clearance
            b, p = np.nonzero(apart <= best)
            if not len(b):
                continue
            order = np.argsort(apart[b, p], kind="stable")
            b, p = b[order], p[order]
            for part in (slice(0, 256), slice(256, None)):  # the nearest first: most of the rest needs no second look
                keep = apart[b[part], p[part]] <= best
                bk, pk = b[part][keep], p[part][keep]
                if not len(bk):
                    continue
                a, c, k = i[pk], j[pk], t[bk]
                dx, dy = xj[bk, pk] - xi[bk, pk], yj[bk, pk] - yi[bk, pk]
                signed = signed_distances(dx, dy, yaw[k, a], yaw[k, c], half[a], half[c])
                distance = np.maximum(signed, 0)
                n = np.lexsort((c, a, k, distance))[0]
                if (distance[n], k[n]) < (best, where[0]):
                    best, where = float(distance[n]), (int(k[n]), int(a[n]), int(c[n]))
                hit = np.flatnonzero(signed < -TOUCH_M)
                hit = hit[np.argsort(k[hit], kind="stable")]
                for m in hit[np.unique(a[hit] * len(radius) + c[hit], return_index=True)[1]]:  # the first of each pair
                    pair = int(a[m]), int(c[m])
                    first[pair] = min(int(k[m]), first.get(pair, num_samples))
    overlaps = [
        {
            "robots": [fleet.robot_name[a], fleet.robot_name[c]],
            "t_s": float(execution.t_s[k]),
            "x_m": float((x[k, a] + x[k, c]) / 2),
            "y_m": float((y[k, a] + y[k, c]) / 2),
        }
        for (a, c), k in sorted(first.items(), key=lambda item: (item[1], item[0]))
    ]
    k, a, c = where
    return overlaps, {"m": best, "robots": [fleet.robot_name[a], fleet.robot_name[c]], "t_s": float(execution.t_s[k])}


def _neighbours(x: FloatArray, y: FloatArray, radius: FloatArray, best: float) -> list[tuple[IntArray, IntArray]]:
    """Pairs (i < j) that may come nearer than `best` in a block of samples [B, R], in portions of bounded size."""
    there = np.flatnonzero((np.isfinite(x) & np.isfinite(y)).any(0))
    if len(there) < 2:
        return []
    x, y = x[:, there], y[:, there]
    xy = np.column_stack((_middle(x), _middle(y)))
    strayed = np.fmax.reduce(np.hypot(x - xy[:, 0], y - xy[:, 1]), axis=0)  # [R] from the point the tree knows
    tree = cKDTree(xy)
    if not np.isfinite(best):  # nothing known yet, and a block of one sample: the nearest two will do
        distance, nearest = tree.query(xy, k=2)
        k = int(distance[:, 1].argmin())
        i, j = there[sorted((k, int(nearest[k, 1] if nearest[k, 1] != k else nearest[k, 0])))]
        return [(np.array([i]), np.array([j]))]
    pairs = tree.query_pairs(2 * radius.max() + 2 * strayed.max() + best, output_type="ndarray")
    i, j = there[pairs.min(1)], there[pairs.max(1)]
    size = max(1, 4_000_000 // len(x))
    return [(i[k : k + size], j[k : k + size]) for k in range(0, len(i), size)]


def _middle(values: FloatArray) -> FloatArray:
    """[R] middle of the range over the block, NaN left out."""
    middle: FloatArray = (np.fmin.reduce(values, axis=0) + np.fmax.reduce(values, axis=0)) / 2
    return middle


def _motion(execution: Execution, fleet: Fleet) -> tuple[dict[str, int], list[dict[str, Any]]]:
    """Counts of samples over the limits, and the first of them."""
    t, speed = execution.t_s, execution.speed_mps
    dt = np.diff(t)[:, None]
    step = np.hypot(np.diff(execution.x_m, axis=0), np.diff(execution.y_m, axis=0))  # [T - 1, R]
    accel = np.divide(np.diff(speed, axis=0), dt)
    found: dict[str, BoolArray] = {
        "speed": np.abs(speed) > fleet.max_speed_mps * (1 + SPEED_SLACK),
        "accel": _late((accel > fleet.accel_mps2 * (1 + ACCEL_SLACK)) | (accel < -fleet.decel_mps2 * (1 + ACCEL_SLACK))),
        "jump": _late(step > fleet.max_speed_mps * dt * (1 + SPEED_SLACK) + JUMP_SLACK_M),
    }
    value = {"speed": speed, "accel": _late(accel), "jump": _late(step)}
    limit = {"speed": fleet.max_speed_mps, "accel": fleet.accel_mps2, "jump": fleet.max_speed_mps * (float(dt.max()) if len(dt) else 0.0)}
    violations = []
    for kind, over in found.items():
        violations += [
            {
                "kind": kind,
                "robot": fleet.robot_name[r],
                "t_s": float(t[k]),
                "value": float(value[kind][k, r]),
                "limit": float(limit[kind][r]),
            }
            for k, r in np.argwhere(over)[:LISTED]
        ]
    counts = {f"num_{kind}{'s' if kind == 'jump' else '_violations'}": int(np.count_nonzero(over)) for kind, over in found.items()}
    return counts, violations


def _late(differences: Any) -> Any:
    """[T, R] of [T - 1, R]: a difference belongs to the later of its samples."""
    return np.concatenate((np.zeros((1, differences.shape[1]), differences.dtype), differences))
