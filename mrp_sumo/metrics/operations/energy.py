"""Rules about batteries: what was driven is drawn, what was charged is filled, and nobody drives with an empty one."""

from collections.abc import Iterator

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.robot_type import Battery
from mrp_sumo.metrics.metric import TOGETHER
from mrp_sumo.metrics.operations.evidence import LOST, Finding, Logs

ROUNDED = 2e-6  # shares of the capacity, as tables keep them
OFF = (0.01, 0.05)  # by which what is drawn may be off in the whole run and between two levels: poses are samples,
OFF_A_S = (0.2, 0.4)  # and more for each second between two
OFF_SHARE = 3e-4  # of the capacity, likewise
LATE_S = 2.0  # for which charging may be off


def batteries(logs: Logs) -> Iterator[Finding]:
    """Levels balance with what was driven and charged; none rises but at a charger; they begin where the scenario says."""
    log, of_robot = logs.execution.batteries, _of_each(logs, logs.terms.fleet.batteries)
    if log is None or not of_robot or not len(logs.execution.t_s):
        return
    energy_j = np.array([battery.energy_j for battery in of_robot])
    full_s = np.array([logs.terms.swap_s or battery.charge_s(1.0) for battery in of_robot])
    lifted, before = (lifted_j(logs, of_robot, log.t_s - ago_s) / energy_j for ago_s in (0.0, LATE_S))
    share = drawn_j(logs, of_robot, log.t_s) / energy_j + lifted  # [K, R]
    charging_s = charged_s(logs, log.t_s)
    low, high = logs.terms.start_level
    for robot in range(logs.fleet.num_robots):
        who, level = logs.robot(robot), log.level[:, robot]
        if not low - ROUNDED <= level[0] <= high + ROUNDED:
            yield Finding("batteries", 0.0, f"{who} begins with {100 * level[0]:.2f} %, expected {100 * low:g} to {100 * high:g} %", who)
        ends = level[0] + (log.charged_j[robot] - log.used_j[robot]) / energy_j[robot]
        if abs(ends - level[-1]) > ROUNDED:
            text = f"{who} ends with {100 * level[-1]:.4f} %, but what was drawn and charged leaves {100 * ends:.4f} %"
            yield Finding("batteries", logs.end_s, text, who)
        slack = lifted[:, robot] - before[:, robot]
        filled, late = charging_s[:, robot] / full_s[robot], LATE_S / full_s[robot]
        yield from _balance(logs, robot, level, share[:, robot], filled, (late, slack))


def _balance(
    logs: Logs, robot: int, level: FloatArray, drawn: FloatArray, filled: FloatArray, tolerance: tuple[float, FloatArray]
) -> Iterator[Finding]:
    """The levels [K] of a robot beside what it drew and was given until then [K], shares of the capacity.

    `tolerance` is what charging may be off by, and what lifts shortly before each level [K] may.
    """
    late, slack = tolerance
    log, who = logs.execution.batteries, logs.robot(robot)
    assert log is not None
    off, off_between = (a + b * logs.period_s for a, b in zip(OFF, OFF_A_S))
    change, drew, gave = np.diff(level), np.diff(drawn), np.diff(filled)
    too_much = change - gave + drew
    limit = drew * off_between + OFF_SHARE + late * (gave > 0) + slack[1:] + slack[:-1]
    rises = (too_much > limit) & (level[1:] > 0)
    was_full = (gave > 0) & (level[:-1] + gave >= 1 - limit) & (level[1:] >= 1 - drew - limit)  # before the end of the charging
    falls = (too_much < -limit) & (level[1:] < 1 - ROUNDED) & (level[1:] > 0) & ~was_full
    for k in np.flatnonzero(rises | falls).tolist()[:1]:
        t_s, end_s = float(log.t_s[k]), float(log.t_s[k + 1])
        balance = f"but drew {100 * drew[k]:.3f} % and could take {100 * gave[k]:.3f} % from a charger"
        text = f"{who} goes from {100 * level[k]:.3f} % at {t_s:.0f} s to {100 * level[k + 1]:.3f} % at {end_s:.0f} s, {balance}"
        yield Finding("batteries", end_s, text, who)
    total, uncharged = float(level[0] - level[-1]), not gave.any()
    if uncharged and level[-1] > 0 and abs(total - drawn[-1]) > off * drawn[-1] + OFF_SHARE + slack[-1]:
        text = f"{who} has used {100 * total:.3f} % of its battery, but drove for {100 * drawn[-1]:.3f} %"
        yield Finding("batteries", logs.end_s, text, who)


def _of_each(logs: Logs, of_kind: tuple[Battery, ...]) -> tuple[Battery, ...]:
    """[R] the battery of each robot, of those of the types; empty where there are none."""
    return tuple(of_kind[k] for k in logs.terms.fleet.kind.tolist()) if of_kind else ()


def drawn_j(logs: Logs, of_robot: tuple[Battery, ...], t_s: FloatArray) -> FloatArray:
    """[K, R] drawn by each robot until times [K], by its poses; nothing at chargers."""
    run, period_s = logs.execution, logs.period_s
    at, so_far = np.zeros((len(t_s), logs.fleet.num_robots)), np.zeros(logs.fleet.num_robots)
    with_load = _of_each(logs, logs.terms.fleet.batteries_loaded) or of_robot
    pairs = list(zip(of_robot, with_load))
    kinds = {pair: np.flatnonzero([mine == pair for mine in pairs]) for pair in dict.fromkeys(pairs)}
    at_chargers = charges(logs)
    for first in range(0, len(run.t_s) - 1, TOGETHER):
        block = slice(first, first + TOGETHER + 1)
        power_w = np.zeros((len(run.t_s[block]) - 1, len(so_far)))
        for (battery, loaded), mine in kinds.items():
            power_w[:, mine] = _power_w(battery, run.speed_mps[block], run.yaw_rad[block], mine, period_s)
            if run.loads is not None and loaded != battery:
                power_loaded_w = _power_w(loaded, run.speed_mps[block], run.yaw_rad[block], mine, period_s)
                power_w[:, mine] = np.where(run.loads[block][1:, mine] > 0, power_loaded_w, power_w[:, mine])
        for robot, begin_s, end_s in at_chargers:
            power_w[(run.t_s[block][1:] > begin_s) & (run.t_s[block][1:] <= end_s), robot] = 0.0
        until = so_far + np.cumsum(np.nan_to_num(power_w) * period_s, axis=0)
        some = np.flatnonzero((t_s > run.t_s[first] + 1e-9) & (t_s <= run.t_s[block][-1] + period_s / 2))
        k = np.clip(np.rint(t_s[some] / period_s).astype(np.int64) - first - 1, 0, len(until) - 1)
        at[some] = until[k]
        so_far = until[-1]
    return at


def lifted_j(logs: Logs, of_robot: tuple[Battery, ...], t_s: FloatArray) -> FloatArray:
    """[K, R] energy for which each robot has lifted loads until times [K]: at the end of the first stop of each order with several."""
    so_far, stops = np.zeros((len(t_s), logs.fleet.num_robots)), logs.stops
    several = {task for task, order in logs.ordered.items() if len(order.stops) > 1}
    first: dict[tuple[int, int], float] = {}
    for task, robot, end_s in zip(stops.task.tolist(), stops.robot.tolist(), stops.end_s.tolist()):
        if task in several:
            first.setdefault((task, robot), end_s)
    for (_, robot), end_s in first.items():
        so_far[:, robot] += of_robot[robot].lift_j * (t_s >= end_s)
    return so_far


def _power_w(battery: Battery, speed_mps: FloatArray, yaw_rad: FloatArray, mine: IntArray, period_s: float) -> FloatArray:
    """[T - 1, K] drawn by some robots between samples [T, R]."""
    speed, turn = speed_mps[:, mine], wrapped(np.diff(yaw_rad[:, mine], axis=0))
    rate = turn / period_s
    turning = np.diff(rate, axis=0, prepend=rate[:1]) / period_s
    return battery.power_w((speed[1:] + speed[:-1]) / 2, np.diff(speed, axis=0) / period_s, rate, turning)


def charged_s(logs: Logs, t_s: FloatArray) -> FloatArray:
    """[K, R] for how long each robot was at a charger until times [K]."""
    so_far_s = np.zeros((len(t_s), logs.fleet.num_robots))
    for robot, begin_s, end_s in charges(logs):
        so_far_s[:, robot] += np.clip(t_s - begin_s, 0.0, max(end_s - begin_s, 0.0))
    return so_far_s


def charges(logs: Logs) -> list[tuple[int, float, float]]:
    """Robots, and from when until when they were at chargers and in order: a broken one is not charged."""
    parts = []
    there = [bool(name) and name in logs.terms.charges for name in logs.stops.station]
    for row in np.flatnonzero(~logs.tasks.is_order[logs.stops.task] | np.array(there, np.bool_)).tolist():
        robot, at_s = int(logs.stops.robot[row]), float(logs.stops.begin_s[row])
        for begin_s, end_s in logs.times_in(LOST, robot):
            if at_s < begin_s < logs.stops.end_s[row]:
                parts.append((robot, at_s, begin_s))
                at_s = end_s
        parts.append((robot, at_s, float(logs.stops.end_s[row])))
    return parts


def empty(logs: Logs) -> Iterator[Finding]:
    """No robot drives on with an empty battery."""
    log, run = logs.execution.batteries, logs.execution
    if log is None or not len(run.t_s):
        return
    brakes_s = logs.fleet.max_speed_mps / logs.fleet.decel_mps2 + 1.0 + 2 * logs.period_s
    for robot in np.flatnonzero((log.level <= 0).any(0)).tolist():
        since_s = float(log.t_s[int((log.level[:, robot] <= 0).argmax())])
        some = logs.samples_between(since_s + float(brakes_s[robot]), logs.end_s)
        moves = np.flatnonzero(np.abs(run.speed_mps[some, robot]) > 1e-3)
        if len(moves):
            who, t_s = logs.robot(robot), float(run.t_s[some][moves[0]])
            yield Finding("batteries", t_s, f"{who} drives at {t_s:.2f} s with a battery that was empty at {since_s:.0f} s", who)
