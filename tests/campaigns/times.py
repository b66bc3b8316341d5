"""Undisturbed executions of retimed plans, on all worlds of the noise campaign: every visit when it is planned, to one step, and every turn
at a goal.

Everything follows from the trial's number: world, robots, headings, planner, policy. SUMO drives; the kinematic engine drives the same
again and is compared in the same way. Plans that nobody can keep are counted, not compared.
"""

import json
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from campaigns.driver import Trial
from campaigns.noise import BOX, BURGER, World, Worlds, plain

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive.loop import simulate
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.errors import ExecutionError, MrpSumoError, PlanError
from mrp_sumo.planning.registry import planner
from mrp_sumo.traffic.draw import uniform_draw

PLANNERS = ("cbs", "ecbs", "eecbs", "prioritised", "pibt", "lacam", "lns2", "continuous")
POLICIES = ("adg", "adg_timed")
STEPS_S = (0.1, 0.2, 0.5)
LONGEST_S = 1500.0  # longer plans are not driven
ENGINES = ("sumo", "kinematic")
TIME_LIMIT_S = 5.0


class Times:
    """One plan a trial, driven by both engines."""

    size = None

    def __init__(self, seed: int) -> None:
        self._scratch = tempfile.TemporaryDirectory(prefix="times-")
        self._worlds, self._seed = Worlds(None, Path(self._scratch.name)), seed

    def trial(self, number: int, folder: Path) -> Trial:
        rng = np.random.default_rng([self._seed, number, 79])
        world, method = self._worlds.draw(rng, number), str(rng.choice(PLANNERS))
        policy, dt = str(rng.choice(POLICIES)), float(rng.choice(STEPS_S))
        num_robots, boxes = int(rng.choice([1, 3, 5, 9, 20, 50])), rng.random() < 0.5
        what = {"world": world, "planner": method, "policy": policy, "robots": num_robots, "dt_s": dt, "headings": rng.random() < 0.5}
        (folder / "trial.json").write_text(json.dumps(what))
        try:
            graph = self._worlds.graph(world)
            robot = BOX if boxes and fleet_of(BOX, 1).separation_m <= graph.cell_m else BURGER
            fleet = fleet_of(robot, num_robots)
            start, goal = uniform_draw(graph, num_robots, number, fleet.separation_m)
        except MrpSumoError:
            return Trial(method, "no room")
        step_s = float(np.ceil((graph.length_m.max() / robot.max_speed_mps + 1.0) / dt)) * dt
        problem = Problem(graph, fleet, start, goal, np.arange(num_robots), step_s, number)
        if what["headings"]:
            start_rad, goal_rad = rng.choice([np.nan, 0.0, 1.0, np.pi / 2, np.pi, -np.pi / 2], (2, num_robots))
            problem = replace(problem, start_heading_rad=start_rad, goal_heading_rad=goal_rad)
        plan = planner(method, {}).plan(problem, TIME_LIMIT_S).plan
        if plan is None:
            return Trial(method, "no plan")
        settings = ExecutionSettings(policy=policy, step_length_s=dt, record_period_s=dt, time_limit_s=LONGEST_S)
        try:
            retimed = retime(problem, plan, settings)
        except (ExecutionError, PlanError) as error:
            return Trial(method, f"refused: {plain(error)}")
        if retimed.end_s.max() > LONGEST_S - 10:
            return Trial(method, "too long")
        faults = [off for engine in ENGINES if (off := self._off(engine, world, problem, retimed, settings))]
        return Trial(method, "driven", tuple(faults), "cat trial.json  # all follows from seed and number")

    def _off(self, engine: str, world: World, problem: Problem, plan: Plan, settings: ExecutionSettings) -> str:
        """What is wrong with an execution: a visit more than a step from its time, or none; '' for nothing."""
        robot = BOX if problem.fleet.length_m[0] == BOX.length_m else BURGER
        run = simulate(problem, plan, replace(settings, engine=engine), self._worlds.network(world, problem.graph, robot))
        off = np.abs(np.concatenate([run.arrived_s - plan.arrive_s, run.goal_s - plan.end_s]))
        if not np.isfinite(off).all():
            return f"{engine}: {int(np.isnan(off).sum())} visits or last turns were never made ({run.outcome})"
        late = off > settings.step_length_s + 1e-6
        return f"{engine}: {late.sum()} of {len(off)} visits and last turns off, by {off.max():.3f} s" if late.any() else ""
