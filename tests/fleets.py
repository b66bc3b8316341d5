"""Fleets whose truth is known: what runs of a study would have recorded, drawn from a throughput curve with common random numbers."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from mrp_sumo.io.scenario.read import scenario_of
from mrp_sumo.sizing.points import record_of
from mrp_sumo.sizing.question import DEMAND, QUICK, Question

TASKS = {"streams": [{"arrivals": {"rate_per_h": 60.0}, "stops": ["a", "b"]}]}
EFFORT = replace(QUICK, horizon_s=3600.0, seeds=4, most_seeds=12, precision=0.05, growth=1.5, gap=1.15, budget_s=1e6)


def question(sizes=(4, 90), effort=EFFORT, demand_per_h=None, tasks=TASKS, **other):
    values = {"map": "office", "robots": 4, **({"tasks": tasks} if tasks else {})}
    return Question(scenario_of(values, Path(), "fleets"), sizes, effort, demand_per_h, **other)


def rises_and_falls(robots):
    """10 orders an hour a robot up to 30, 320 at 40 at most, half of that at 80."""
    return float(np.interp(robots, [0, 30, 40, 60, 80, 100], [0, 300, 320, 250, 160, 100]))


class Fleets:
    """Records of trials by a throughput curve; orders come by chance, the same for all fleets of a seed."""

    def __init__(self, per_h, asked=None, factors=None):
        self.per_h, self.question, self.factors = per_h, asked or question(), factors or {}
        self.made = []

    def __call__(self, trial):
        self.made.append(trial)
        if self.factors.get(trial.change, 1.0) is None:
            return record_of({"status": "bad_input", "success": False, "reason": "no robot can reach 'b'", "metrics": {}})
        rng, horizon_s = np.random.default_rng(trial.seed), self.question.effort.horizon_s
        luck = 1 + 0.03 * rng.standard_normal()
        rate = self.per_h(trial.robots) * luck * self.factors.get(trial.change, 1.0)
        capacity_s = np.cumsum(rng.gamma(8, 1 / 8, 1000)) * 3600 / max(rate, 1e-9)
        if trial.kind == DEMAND:
            released_s = np.cumsum(rng.exponential(1, 1000)) * 3600 / self.question.demand_per_h
            done_s, free_s = np.empty(1000), 0.0
            for k, (came, work) in enumerate(zip(released_s, np.diff(capacity_s, prepend=0.0))):
                free_s = done_s[k] = max(came, free_s) + work
        else:
            released_s, done_s = np.maximum(capacity_s - 60, 0), capacity_s
        there = released_s < horizon_s
        record = {
            "status": "completed",
            "success": rng.random() < np.clip((60 - trial.robots) / 20, 0, 1),
            "metrics": {"robot_busy_share": 0.9, "cycle_serving_s": 60.0},
            "observed": {
                "released_s": released_s[there].tolist(),
                "assigned_s": released_s[there].tolist(),
                "done_s": [t if t <= horizon_s else None for t in done_s[there].tolist()],
                "due_s": [None] * int(there.sum()),
                "steady_s": 0.0,
                "stations": {"a": {"places": 1, "served_s": 36.0 * trial.robots, "queued_s": 5.0, "stops": 9, "over_s": 3600.0}},
                "lifts": {},
                "places": {"a \N{EN DASH} b": ["aisle", 40.0, 0.5]},
                "vertices": [[3, 40.0]],
                "minutes": [[1.0, 10.0]] * 60,
                "lane_m": 100.0,
                "deadlocks": int(trial.robots > 45),
                "planning_share": 0.2,
            },
        }
        return record_of(record)
