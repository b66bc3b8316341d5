"""Time that execution policies lose to delays: the same plans, the same delays, one policy after the other.

    python tools/bench_policies.py                              adg and adg_switch on three maps, 9 to 50 robots
    python tools/bench_policies.py --map warehouse --robots 9 --rate 0.05 --plans 20 --draws 5
    python tools/bench_policies.py --engine sumo --plans 4
    python tools/bench_policies.py --policy adg --policy '{name: adg_switch, parameters: {budget: 100}}'
    python tools/bench_policies.py --json                       a line per case, for machines

Delays are those of the suite `robustness`: in each planned step a robot is held for one to five steps with a probability of `rate`.
A loss is what a run takes longer than its plan: `makespan` until all robots are at their goals, `flowtime` the mean over robots.
`saved` is the share of the first policy's loss that the other one does not have: the ratio of sums, with an interval of 95 %
over plans by bootstrap (all draws of delays for one plan stay together). `held` is how long a robot
itself is held under the first policy, on average. No order gives that back, but where a robot had to wait anyway; what flowtime loses
beyond it is what orders can save.
"""

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import bench
import numpy as np
import yaml

from mrp_sumo.core.disturbances import Disturbances
from mrp_sumo.core.execution import BOOKINGS
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.policy import policy_of
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.map_cache import MapCache
from mrp_sumo.experiments.solve import solve
from mrp_sumo.experiments.staging.set_up import set_up, with_time_limit
from mrp_sumo.io.scenario.read import scenario_of
from mrp_sumo.metrics.audit import audit

MAPS = ("warehouse", "office", "airport")
ROBOTS = (9, 20, 50)
CASE: dict[str, Any] = {
    "discretisation": {"kind": "grid", "cell_m": 0.4},
    "robots": {"type": "turtlebot3"},
    "assignment": {"mode": "fixed"},
}
HELD = BOOKINGS.index("disturbed")
RESAMPLES = 10_000

Row = bench.Row
Case = tuple[Problem, Plan, ExecutionSettings, Path]


def planned(options: argparse.Namespace, map_name: str, robots: int, maps: MapCache) -> Iterator[Case]:
    """Problems with plans whose order can be kept, and how to drive them."""
    num_plans, seed = 0, 0
    while num_plans < options.plans and seed < 3 * options.plans:
        seed += 1
        scenario = {
            **CASE,
            "map": map_name,
            "robots": {**CASE["robots"], "count": robots},
            "seed": options.seed + seed,
            "planner": {"name": options.planner, "time_limit_s": 30},
            "execution": {"engine": options.engine, "time_limit_s": 3000},
        }
        if options.roadmap:
            scenario["discretisation"] = {"kind": "roadmap"}
        try:
            setup = set_up(scenario_of(scenario, Path.cwd(), "bench"), maps)
            solution = solve(setup, execute=True)
            plan = solution.plan
            if plan is None or plan.in_steps is None:  # none, or its order cannot be kept
                continue
            network = maps.network(solution.problem.graph, None)
            yield solution.problem, plan, with_time_limit(setup, plan).settings, network
            num_plans += 1
        except MrpSumoError as error:
            print(f"{map_name}, {robots} robots, seed {options.seed + seed}: {error}", file=sys.stderr)


def losses(case: Case, policies: Sequence[tuple[str, dict[str, Any]]], rate: float, draws: int) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """[draws, policies, 3] loss of makespan and of flowtime a robot, how long it was held, s; [policies] CPU time, s; what went wrong."""
    problem, plan, settings, network = case
    lost, cpu, wrong = np.zeros((draws, len(policies), 3)), np.zeros(len(policies)), []
    for draw in range(draws):
        for p, (name, parameters) in enumerate(policies):
            delays = Disturbances(delay_probability=rate)
            how = replace(settings, policy=name, policy_parameters=parameters, disturbances=delays, seed=1000 + draw)
            begun = time.process_time()
            run = simulate(problem, plan, how, network)
            cpu[p] += time.process_time() - begun
            held_s = run.booked_s[:, HELD].mean()
            lost[draw, p] = run.goal_s.max() - plan.end_s.max(), (run.goal_s - plan.end_s).mean(), held_s
            wrong += faults(run, problem.fleet, name)
    return lost, cpu, wrong


def faults(run: Any, fleet: Fleet, policy: str) -> list[str]:
    """A run that did not end, or in which robots touched."""
    stuck = [] if run.all_at_goal else [f"{policy}: {run.outcome}"]
    return stuck + ([] if audit(run, fleet)["num_overlaps"] == 0 else [f"{policy}: overlaps"])


def of_case(
    options: argparse.Namespace, map_name: str, robots: int, rate: float, cases: list[Case], policies: list[tuple[str, dict[str, Any]]]
) -> Iterator[Row]:
    """Of one case."""
    if not cases:
        return
    each_case = [losses(case, policies, rate, options.draws) for case in cases]
    lost = np.stack([each[0] for each in each_case])  # [plans, draws, policies, 3]
    cpu = np.sum([each[1] for each in each_case], axis=0)
    driven_s = sum(float(case[1].end_s.max()) for case in cases) * options.draws
    for p in range(1, len(policies)):
        row: Row = {"map": map_name, "robots": robots, "rate": rate, "plans": len(cases), "runs": lost[:, :, p, 0].size}
        row["policy"] = policies[p][0] + ("" if not policies[p][1] else f" {policies[p][1]}")
        for k, what in enumerate(("makespan", "flowtime")):
            first, other = lost[:, :, 0, k], lost[:, :, p, k]
            row[f"{what}_loss_s"] = round(float(first.mean()), 2)
            row[f"{what}_loss_switch_s"] = round(float(other.mean()), 2)
            row[f"{what}_saved"], row[f"{what}_saved_95"] = saved(first.mean(1), other.mean(1))
            row[f"{what}_better_worse"] = [int((other < first - 0.05).sum()), int((other > first + 0.05).sum())]
        row["held_s"] = round(float(lost[:, :, 0, 2].mean()), 2)
        row["cpu_s_per_plan_s"] = [round(float(cpu[0] / driven_s), 4), round(float(cpu[p] / driven_s), 4)]
        row["wrong"] = [fault for each in each_case for fault in each[2]]
        yield row


def saved(first: np.ndarray, other: np.ndarray) -> tuple[float, list[float]]:
    """The share of the first policy's loss that the other saves, and its interval."""
    rng = np.random.default_rng([0, len(first)])
    drawn = rng.integers(0, len(first), (RESAMPLES, len(first)))
    share = 1 - other[drawn].sum(1) / first[drawn].sum(1)
    return round(float(1 - other.sum() / first.sum()), 3), np.round(np.percentile(share, [2.5, 97.5]), 3).tolist()


def policy(text: str) -> tuple[str, dict[str, Any]]:
    """A policy by name, or as in a scenario."""
    content = yaml.safe_load(text)
    name, parameters = (content, {}) if isinstance(content, str) else (content["name"], content.get("parameters", {}))
    policy_of(name, parameters)
    return name, parameters


def arguments(parser: argparse.ArgumentParser) -> None:
    """Maps, fleets, delays and policies."""
    parser.add_argument("--map", action="append")
    parser.add_argument("--robots", type=int, action="append")
    parser.add_argument("--rate", type=float, action="append", help="of delays in each planned step")
    parser.add_argument("--policy", action="append", help="the first is what the others are compared with")
    parser.add_argument("--planner", default="lns2")
    parser.add_argument("--roadmap", action="store_true", help="drive on the map's own lanes instead of a grid of 0.4 m")
    parser.add_argument("--engine", default="kinematic", choices=("kinematic", "sumo"))
    parser.add_argument("--plans", type=int, default=10)
    parser.add_argument("--seed", type=int, default=3000, help="after which the seeds of the plans come (default: 3000)")
    parser.add_argument("--draws", type=int, default=4, help="of delays for each plan")


def rows(options: argparse.Namespace) -> Iterator[Row]:
    """A row for each map, number of robots, rate, and policy but the first."""
    policies = [policy(text) for text in options.policy or ("adg", "adg_switch")]
    with MapCache() as maps:
        for map_name in options.map or MAPS:
            for robots in options.robots or ROBOTS:
                cases = list(planned(options, map_name, robots, maps))
                for rate in options.rate or (0.01, 0.05, 0.1):
                    yield from of_case(options, map_name, robots, rate, cases, policies)


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
