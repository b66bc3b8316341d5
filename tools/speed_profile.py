"""Draw the speed of one robot over time, planned and driven: the picture of docs/time.md.

    python tools/speed_profile.py docs/pictures/speed_profile.png
    python tools/speed_profile.py OUT --scenario office_9 --type turtlebot3 --cell 0.4 --robot 4

The planned speed is the closed form of each run, from rest to rest, that sets out when the plan says so (`mrp_sumo.core.motion`); the
driven one is SUMO's, step by step.
"""

import argparse
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import mrp_sumo as ms
from mrp_sumo.core.motion import Profile, run_profile, speed_mps

LIGHT, DARK, GREY = "#8fbfe6", "#16283a", "#7d838c"
TURNS_RAD = 0.2
CLOSE_S = 0.25  # of a run whose planned end is farther from the closed form, something was in the way


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
    found = []
    for a, b in pairwise(stops):
        profile = run_profile(graph.length_m[lane[a:b]], graph.speed_mps[lane[a:b]], top, accel, decel)
        found.append((float(depart[a]), profile, float(arrive[b] - depart[a]) - profile.end_s))
    return found


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
