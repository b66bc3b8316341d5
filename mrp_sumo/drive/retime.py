"""Retiming: a plan's order, driven with real motion, gives the plan's times.

Planners count steps of one length, each long enough for a turn; robots accelerate, drive through and turn where they must. So
the controller's own kernels drive the plan on undisturbed bodies, and the times that come out are the plan's from then on: what
is planned is what is driven, but for what disturbs a run. Vertices and order stay as the planner made them.
"""

import numpy as np

from mrp_sumo.core.disturbances import NONE
from mrp_sumo.core.graph import frozen
from mrp_sumo.core.plan import Plan, as_planned_in_steps
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive import _retime
from mrp_sumo.drive.controller import Controller
from mrp_sumo.drive.facilities import facilities_of
from mrp_sumo.drive.fit import resources_for
from mrp_sumo.drive.ledger import Ledger
from mrp_sumo.drive.policy import Adg, policy_of
from mrp_sumo.drive.reroute import first_of
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.drive.state import empty_log, empty_news
from mrp_sumo.drive.world import World
from mrp_sumo.errors import PlanError

LONGEST = 20.0  # times the plan's makespan; who is not there by then never will be


def retime(problem: Problem, plan: Plan, settings: ExecutionSettings, *, margin_s: float = 0.0, spread_s: float = 0.0) -> Plan:
    """The plan in seconds of real motion.

    Parameters
    ----------
    problem
        What the plan is for.
    plan
        With an order that can be kept: who passes first at each vertex and zone.
    settings
        Step length; the policy, for plans that are in seconds already: under one that keeps the plan's clock, nobody leaves a
        visit before the plan does. Plans in steps are driven as early as their order allows, and so is everything else.
    margin_s
        What a robot leaves is free this much later for the next. A plan with a margin is longer, and survives small delays.
    spread_s
        Standard deviation of a robot's delay at one visit. Delays at n visits add up to one of `spread_s` √n, and what a robot leaves
        after n visits is free two of these later for the next, beside the margin.

    Returns
    -------
    plan
        The same visits. A robot arrives at `arrive_s`, and sets out at `depart_s`; both are equal where it drives through. The first
        turn, from a start's heading, is before the first departure, the last, to a goal's, before `turned_s`.

    Raises
    ------
    ExecutionError
        When it cannot be driven at all (`drive.fit`).
    PlanError
        When its order cannot be kept.
    """
    in_steps = as_planned_in_steps(plan, problem.step_s)
    policy = policy_of(settings.policy, settings.policy_parameters)
    if in_steps is not None or not policy.keeps_order:
        policy = Adg(policy.look_ahead)
    ledger = Ledger(problem, resources_for(problem, plan))
    ledger.append(first_of(plan), policy, 0.0)
    controller, dt = Controller(ledger, policy, settings, paced=False), settings.step_length_s
    facilities = facilities_of(problem.graph, ledger.resources)
    facilities.manual[:] = False  # planned as if people were there
    world = World(NONE, problem.graph, problem.num_robots, dt, problem.step_s, float(problem.fleet.radius_m.max()), 0, facilities)
    left_s = np.zeros(ledger.num_visits)
    visits = np.arange(int(np.diff(plan.first).max(initial=0)) + 1)
    lag = np.round((margin_s + 2 * spread_s * np.sqrt(visits)) / dt).astype(np.int64)
    longest_s = LONGEST * (float(plan.end_s.max(initial=0.0)) + problem.step_s) + lag[-1] * dt * plan.num_visits
    steps = _retime.drive_out(
        *(dt, int(longest_s / dt), lag, problem.fleet.accel_mps2, problem.graph.speed_mps),
        *(controller.kinematics, controller.rules, ledger.visits, ledger.needs, ledger.state, world.conditions),
        *(empty_log(problem.num_robots), empty_news(problem.num_robots), left_s),
    )
    if steps < 0:
        raise PlanError("nobody can drive this plan to its end in the order that it has")
    ids = np.concatenate([ledger.all_ids(r) for r in range(plan.num_robots)])
    depart_s = left_s[ids]
    depart_s[plan.first[1:] - 1] = np.inf
    turned_s = None if problem.goal_heading_rad is None else frozen(ledger.state.waits.goal_s)
    return Plan(plan.first, plan.vertex, frozen(ledger.column("arrived_s")[ids]), frozen(depart_s), in_steps, turned_s)
