"""Draw the speed of one robot over time, planned and driven: the picture of docs/time.md.

    python tools/speed_profile.py docs/pictures/speed_profile.png
    python tools/speed_profile.py OUT --scenario office_9 --type turtlebot3 --cell 0.4 --robot 4

The planned speed is the closed form of each run, from rest to rest, that sets out when the plan says so (`Profile`); the
driven one is SUMO's, step by step.
"""

import argparse
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import mrp_sumo as ms
from mrp_sumo.core.graph import FloatArray, IntArray, frozen

LIGHT, DARK, GREY = "#8fbfe6", "#16283a", "#7d838c"
TURNS_RAD = 0.2
SHORTEST_S = 1e-9  # of a phase
CLOSE_S = 0.25  # of a run whose planned end is farther from the closed form, something was in the way


@dataclass(frozen=True, eq=False)
class Profile:
    """Speed over time of one run, in P phases of constant acceleration."""

    t_s: FloatArray  # [P + 1] when phases begin, and the last ends; from 0
    at_m: FloatArray  # [P + 1] where
    speed_mps: FloatArray  # [P + 1] how fast

    @property
    def end_s(self) -> float:
        return float(self.t_s[-1])


def run_profile(length_m: FloatArray, limit_mps: FloatArray, speed_mps: float, accel_mps2: float, decel_mps2: float) -> Profile:
    """The fastest run from rest to rest over K lanes, one after the other.

    The speed at a lane's end is the most that both lanes' limits, accelerating from the start and braking to the stop allow; between two
    ends a robot accelerates, cruises and brakes.

    Parameters
    ----------
    length_m
        [K] above 0.
    limit_mps
        [K] of the lanes, inf without one.
    """
    top = np.minimum(limit_mps, speed_mps)
    square = np.concatenate([[0.0], np.square(np.minimum(top[:-1], top[1:])), [0.0]])  # [K + 1] of speeds at lanes' ends
    for k, length in enumerate(length_m.tolist()):
        square[k + 1] = min(square[k + 1], square[k] + 2 * accel_mps2 * length)
    for k, length in reversed(list(enumerate(length_m.tolist()))):
        square[k] = min(square[k], square[k + 1] + 2 * decel_mps2 * length)
    enters, leaves = square[:-1], square[1:]
    free = (2 * accel_mps2 * decel_mps2 * length_m + decel_mps2 * enters + accel_mps2 * leaves) / (accel_mps2 + decel_mps2)
    peak = np.minimum(np.square(top), free)
    speeds_up_m, brakes_m = (peak - enters) / (2 * accel_mps2), (peak - leaves) / (2 * decel_mps2)
    cruises_m = np.maximum(length_m - speeds_up_m - brakes_m, 0.0)
    peak, low, high = np.sqrt(peak), np.sqrt(enters), np.sqrt(leaves)
    phase_s = np.stack([(peak - low) / accel_mps2, cruises_m / peak, (peak - high) / decel_mps2], 1).reshape(-1)
    phase_m = np.stack([speeds_up_m, cruises_m, brakes_m], 1).reshape(-1)
    speed = np.append(0.0, np.stack([peak, peak, high], 1).reshape(-1))
    keep = phase_s > SHORTEST_S
    return Profile(
        t_s=frozen(np.append(0.0, np.cumsum(phase_s[keep]))),
        at_m=frozen(np.append(0.0, np.cumsum(phase_m[keep]))),
        speed_mps=frozen(np.append(0.0, speed[1:][keep])),
    )


def speed_mps(profile: Profile, t_s: FloatArray) -> FloatArray:
    """Speed of a robot `t_s` after it set out."""
    p, since = _phase(profile.t_s, t_s)
    return profile.speed_mps[p] + _rates(profile)[p] * since


def time_s(profile: Profile, at_m: FloatArray) -> FloatArray:
    """Times at which a robot comes to places along its run; inf for places beyond its end."""
    at_m = np.asarray(at_m, np.float64)
    p, along = _phase(profile.at_m, at_m)
    speed, rate = profile.speed_mps[p], _rates(profile)[p]
    then = np.sqrt(np.maximum(np.square(speed) + 2 * rate * along, 0.0))
    pace = speed + then  # of which half is the mean speed
    t_s = profile.t_s[p] + np.divide(2 * along, pace, out=np.zeros(along.shape), where=pace > 0)
    return np.where(at_m > profile.at_m[-1] + 1e-9, np.inf, t_s)


def _phase(begins: FloatArray, at: FloatArray) -> tuple[IntArray, FloatArray]:
    """The phase in which each value lies, and how far in it."""
    at = np.clip(at, 0.0, begins[-1])
    p = np.clip(np.searchsorted(begins, at, side="right") - 1, 0, len(begins) - 2)
    return p, at - begins[p]


def _rates(profile: Profile) -> FloatArray:
    """[P] accelerations."""
    rates: FloatArray = np.diff(profile.speed_mps) / np.diff(profile.t_s)
    return rates


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--scenario", default="warehouse_9")
    parser.add_argument("--type", default="amr_600", help="of all robots (default: amr_600)")
    parser.add_argument("--cell", type=float, default=1.13, help="length of a step in m (default: 1.13)")
    parser.add_argument("--robot", type=int, help="by number (default: of those that never slow down for another, the one with most runs)")
    options = parser.parse_args()
    scenario = ms.Scenario.read(options.scenario)
    problem = ms.problem(scenario.replace(robots={"type": options.type}, discretisation={"kind": "roadmap", "cell_m": options.cell}))
    solution = ms.plan(problem)
    driven = ms.simulate(problem, solution)
    every = [runs_of(solution, robot) for robot in range(solution.problem.num_robots)]
    robot = options.robot
    if robot is None:
        robot = max(range(len(every)), key=lambda r: len(every[r]) if all(abs(late) < CLOSE_S for _, _, late in every[r]) else 0)
    draw(options.out, solution, driven, robot, every[robot])


def runs_of(solution: Any, robot: int) -> list[tuple[float, Profile, float]]:
    """(when it sets out, how it drives, by how much the plan's arrival is later than that), of every run from rest to rest."""
    plan, graph, fleet = solution.plan, solution.problem.graph, solution.problem.fleet
    visits = slice(int(plan.first[robot]), int(plan.first[robot + 1]))
    vertex, arrive, depart = plan.vertex[visits], plan.arrive_s[visits], plan.depart_s[visits]
    lane = [graph.lane_between(a, b) for a, b in pairwise(vertex.tolist())]
    stops = [k for k in range(len(vertex)) if k == 0 or depart[k] > arrive[k]]
    limits = (float(column[robot]) for column in (fleet.max_speed_mps, fleet.accel_mps2, fleet.decel_mps2))
    top, accel, decel = limits
    result = []
    for a, b in pairwise(stops):
        profile = run_profile(graph.length_m[lane[a:b]], graph.speed_mps[lane[a:b]], top, accel, decel)
        result.append((float(depart[a]), profile, float(arrive[b] - depart[a]) - profile.end_s))
    return result


def draw(out: Path, solution: Any, driven: Any, robot: int, runs: list[tuple[float, Profile, float]]) -> None:
    from matplotlib import pyplot as plt

    plan = solution.plan
    visits = slice(int(plan.first[robot]), int(plan.first[robot + 1]))
    end_s = float(plan.end_s[robot]) + 1.0
    t = np.arange(0.0, end_s, 0.005)
    planned = np.zeros(len(t))
    for begin_s, profile, _ in runs:
        inside = (t >= begin_s) & (t <= begin_s + profile.end_s)
        planned[inside] = speed_mps(profile, t[inside] - begin_s)
    execution = driven.execution
    steps = execution.t_s <= end_s
    figure, (above, below) = plt.subplots(2, 1, figsize=(9.6, 4.4), height_ratios=(4, 1.3), sharex=True, layout="constrained")
    above.fill_between(t, planned, color=LIGHT, lw=0, label="planned, closed form")
    above.step(
        execution.t_s[steps], execution.speed_mps[steps, robot], where="pre", color=DARK, lw=1.1, label="driven in SUMO, steps of 0.1 s"
    )
    above.plot(plan.arrive_s[visits], np.zeros(visits.stop - visits.start), "|", color=DARK, ms=9, label="planned visits", clip_on=False)
    above.set(ylabel="speed, m/s", ylim=(0, None), xlim=(0, end_s))
    above.legend(loc="upper center", bbox_to_anchor=(0.5, 1.16), ncols=3, frameon=False)
    late_ms = 1000 * (execution.arrived_s[visits] - plan.arrive_s[visits])
    below.axhspan(-100, 100, color=LIGHT, alpha=0.35, lw=0)
    below.plot(plan.arrive_s[visits], late_ms, ".", color=DARK)
    below.set(ylabel="driven less\nplanned, ms", xlabel="time, s", ylim=(-130, 130), yticks=(-100, 0, 100))
    for axes in (above, below):
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(colors=GREY, labelcolor=DARK)
    figure.savefig(out, dpi=150)
    print(f"{out}: {solution.problem.fleet.robot_name[robot]}, {len(runs)} runs, visits within {np.abs(late_ms).max():.3f} ms")


if __name__ == "__main__":
    main()
