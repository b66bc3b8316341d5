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
    values = {"map": "office", "robots": 4, "planner": "lacam", **({"tasks": tasks} if tasks else {})}
    return Question(scenario_of(values, Path(), "fleets"), sizes, effort, demand_per_h, **other)


def rises_and_falls(robots):
    """10 orders an hour a robot up to 30, 320 at 40 at most, half of that at 80."""
    return float(np.interp(robots, [0, 30, 40, 60, 80, 100], [0, 300, 320, 250, 160, 100]))


class Fleets:
    """Records of trials by a throughput curve; orders come by chance, the same for all fleets of a seed."""

    def __init__(self, per_h, request=None, factors=None, moved=None):
        self.per_h, self.question, self.factors = per_h, request or question(), factors or {}
        self.moved = moved or (lambda robots, values: per_h(robots))
        self.made = []

    def __call__(self, trial):
        self.made.append(trial)
        if self.factors.get(trial.change, 1.0) is None:
            return record_of({"status": "bad_input", "success": False, "reason": "no robot can reach 'b'", "metrics": {}})
        rng, horizon_s = np.random.default_rng(trial.seed), self.question.effort.horizon_s
        luck = 1 + 0.03 * rng.standard_normal()
        rate = self.moved(trial.robots, {place[-1]: value for place, value in trial.moves}) * luck * self.factors.get(trial.change, 1.0)
        capacity_s = np.cumsum(rng.gamma(8, 1 / 8, 1000)) * 3600 / max(rate, 1e-9)
        if trial.kind == DEMAND:
            released_s = np.cumsum(rng.exponential(1, 1000)) * 3600 / self.question.demand_per_h
            done_s, free_s = np.empty(1000), 0.0
            for k, (came, work) in enumerate(zip(released_s, np.diff(capacity_s, prepend=0.0))):
                free_s = done_s[k] = max(came, free_s) + work
        else:
            released_s, done_s = np.maximum(capacity_s - 60, 0), capacity_s
        there = released_s < horizon_s
        observed = {
            "released_s": released_s[there].tolist(),
            "done_s": [t if t <= horizon_s else None for t in done_s[there].tolist()],
            "stations": {"a": {"places": 1, "served_s": 36.0 * trial.robots, "queued_s": 5.0, "stops": 9, "over_s": 3600.0}},
            "causes": [["aisle", "a \N{EN DASH} b", 40.0, 0.5]],
            "vertices": [[3, 40.0]],
            "deadlocks": int(trial.robots > 45),
        }
        return record_of(_record(observed, rng.random() < np.clip((60 - trial.robots) / 20, 0, 1)))


def record_with(done_s, horizon_s):
    """The record of a saturated run in which orders were done at these times, and nothing else is known."""
    done = [t for t in np.asarray(done_s).tolist() if t <= horizon_s]
    return record_of(_record({"released_s": [max(t - 60, 0.0) for t in done], "done_s": done}))


def _record(observed, success=True):
    """A run that nothing was wrong with, but for what is observed."""
    orders = len(observed["done_s"])
    usual = {
        "assigned_s": observed["released_s"],
        "due_s": [None] * orders,
        "steady_s": 0.0,
        "stations": {},
        "vertices": [],
        "minutes": [[1.0, 10.0]] * 60,
        "lane_m": 100.0,
        "deadlocks": 0,
        "planning_share": 0.2,
    }
    metrics = {"robot_busy_share": 0.9, "cycle_serving_s": 60.0}
    return {"status": "completed", "success": success, "metrics": metrics, "observed": {**usual, **observed}}
