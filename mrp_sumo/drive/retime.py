"""Retiming: a plan's order, driven with real motion, gives the plan's times.

Planners count steps of one length, each long enough for a turn; robots accelerate, drive through and turn where they must. So
the controller's own kernels drive the plan on undisturbed bodies, and the times that come out are the plan's from then on: what
is planned is what is driven, but for what disturbs a run. Vertices and order stay as the planner made them.
"""

from dataclasses import replace

import numpy as np

from mrp_sumo.core.disturbances import NONE
from mrp_sumo.core.graph import FloatArray, frozen
from mrp_sumo.core.plan import Plan, as_planned_in_steps
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive._causes import FACILITY, PLANNED
from mrp_sumo.drive.controller import Controller
from mrp_sumo.drive.cycle import DriveCycle
from mrp_sumo.drive.facilities import facilities_of
from mrp_sumo.drive.fit import resources_for
from mrp_sumo.drive.ledger import Ledger
from mrp_sumo.drive.policy import Adg, policy_of
from mrp_sumo.drive.reroute import first_of
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.drive.state import NEVER, margin_of, tape_for
from mrp_sumo.drive.world import World
from mrp_sumo.engines.kinematic.engine import KinematicEngine
from mrp_sumo.errors import PlanError

LONGEST = 20.0  # times the plan's makespan; who is not there by then never will be
MANY_STEPS = 1000  # after which it is asked whether anybody moves


def retime(problem: Problem, plan: Plan, settings: ExecutionSettings, *, margin_s: float = 0.0, spread_s: float = 0.0) -> Plan:
    """The plan in seconds of real motion: the same visits, at which a robot arrives at `arrive_s`, and sets out at `depart_s`.

    Both are equal where it drives through. The first turn, from a start's heading, is before the first departure, the last, to a goal's,
    before `turned_s`. Under a policy that keeps the plan's clock, nobody leaves a visit of a plan in seconds before the plan does; all
    others are driven as early as their order allows.

    What a robot leaves is free `margin_s` later for the next: such plans are longer, and survive small delays. `spread_s` is the standard
    deviation of a robot's delay at one visit. Delays at n visits add up to one of `spread_s` √n, and what a robot leaves after n visits is
    free two of these later for the next, beside the margin.

    Raises ExecutionError when it cannot be driven at all (`drive.fit`), and PlanError when its order cannot be kept.
    """
    in_steps = as_planned_in_steps(plan, problem.step_s)
    policy = policy_of(settings.policy, settings.policy_parameters)
    if in_steps is not None or not policy.keeps_order:
        policy = Adg(policy.look_ahead)
    ledger = Ledger(problem, resources_for(problem, plan))
    ledger.append(first_of(plan), policy, 0.0)
    controller, dt = Controller(ledger, policy, settings, paced=False, books=False), settings.step_length_s
    facilities = facilities_of(problem.graph, ledger.resources, people_open=False)  # planned as if people were there
    visits = np.arange(int(np.diff(plan.first).max(initial=0)) + 1)
    lag = np.round((margin_s + 2 * spread_s * np.sqrt(visits)) / dt).astype(np.int64)
    margin = margin_of(lag if lag[-1] else lag[:0], problem.num_robots)
    world = World(problem, replace(settings, disturbances=NONE, closed_lanes=()), facilities, margin=margin)
    bodies = KinematicEngine(problem.graph, problem.fleet, dt)
    bodies.place(ledger.visits)
    longest_s = LONGEST * (float(plan.end_s.max(initial=0.0)) + problem.step_s) + lag[-1] * dt * plan.num_visits
    left_s = _drive_out(DriveCycle(world, controller, bodies), int(longest_s / dt), int(lag[-1]) + 3)
    ids = np.concatenate([ledger.all_ids(r) for r in range(plan.num_robots)])
    depart_s = left_s[ids]
    depart_s[plan.first[1:] - 1] = np.inf
    turned_s = None if problem.goal_heading_rad is None else frozen(ledger.state.waits.goal_s)
    return Plan(plan.first, plan.vertex, frozen(ledger.visits.arrived_s[ids]), frozen(depart_s), in_steps, turned_s)


def _drive_out(cycle: DriveCycle, most_steps: int, stuck_after: int) -> FloatArray:
    """[N] When robots leave their visits, as they all drive until everybody has made its last, and stands there as it is to.

    Raises PlanError when nobody has been able to go on for `stuck_after` steps, or some are not there after `most_steps`.
    """
    ledger, bodies = cycle.ledger, cycle.bodies
    visits, num_robots = ledger.visits, ledger.num_robots
    left_s = np.zeros(ledger.num_visits)
    tape = tape_for(num_robots, 0, NEVER)._replace(left_s=left_s, look_every=NEVER)
    is_stuck = False
    cycle.look()
    while not ((visits.next[visits.reached] < 0) & ledger.turned).all():
        before_m, before = bodies.driven_m.copy(), visits.reached.copy()
        cycle.go(sent=False)
        cycle.go_on(min(stuck_after if is_stuck else MANY_STEPS, max(0, most_steps - cycle.step)), tape)
        happened = bool(cycle.look()) or (bodies.driven_m != before_m).any() or (visits.reached != before).any()
        was_stuck, is_stuck = is_stuck and not happened, not _can_go_on(ledger)
        if (was_stuck and is_stuck) or cycle.step >= most_steps:
            raise PlanError("nobody can drive this plan to its end in the order that it has")
    return left_s


def _can_go_on(ledger: Ledger) -> bool:
    """True if a robot that has not come to its end moves, or will by itself."""
    visits, motion, grants = ledger.visits, ledger.state.motion, ledger.state.grants
    under_way = (visits.next[visits.reached] >= 0) | ~ledger.turned
    goes = (grants.command_mps > 0) | (motion.speed_mps > 0) | motion.turning | np.isin(grants.cause, (PLANNED, FACILITY))
    return bool((under_way & goes).any())
