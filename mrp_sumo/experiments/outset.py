"""The record of a run that is about to be driven, for those who show it while it drives."""

import numpy as np

from mrp_sumo.core.execution import Execution, Outcome
from mrp_sumo.core.task import StopLog, log_of_times
from mrp_sumo.experiments.result import levels_of
from mrp_sumo.experiments.solve import Solution
from mrp_sumo.experiments.staging.set_up import SetUp
from mrp_sumo.io.record import RunRecord, record_of


def record_at_outset(setup: SetUp, solution: Solution) -> RunRecord:
    """The record of a run in which nothing has happened yet: robots stand at their starts."""
    problem, plan, map_ = solution.problem, solution.result.plan, setup.map
    assert plan is not None
    here, none, has_tasks = problem.graph.xy[problem.start][None], np.zeros(0), bool(setup.settings.tasks)
    levels = levels_of(setup, problem.graph) if problem.graph.is_ride.any() else None
    execution = Execution(
        t_s=np.zeros(1),
        x_m=here[..., 0],
        y_m=here[..., 1],
        yaw_rad=np.zeros_like(here[..., 0]),
        speed_mps=np.zeros_like(here[..., 0]),
        arrived_s=np.full(len(plan.vertex), np.nan),
        goal_s=np.full(problem.num_robots, np.nan),
        outcome=Outcome.INTERRUPTED,
        policy=setup.settings.policy,
        sim_time_s=0.0,
        wall_time_s=0.0,
        cpu_time_s=0.0,
        tasks=log_of_times((), none.astype(np.int64), none, none, none, none) if has_tasks else None,
        stops=StopLog(*(none.astype(np.int64),) * 2, (), none.astype(np.int64), *(none,) * 6) if has_tasks else None,
        level=problem.graph.level[problem.start][None] if levels else None,
    )
    return record_of(setup.scenario, problem, plan, execution, map_.nav, None, levels)
