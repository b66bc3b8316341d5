"""Switching: another order of passages when robots are late, so that nobody waits for who is far away.

The graph is that of Hoenig et al. (see `traffic.schedule`) with durations: longest paths through it say when each robot will
be where. A pair of passages may be switched as long as neither robot has been granted its own (Berndt, van Duijkeren, Palmieri
and Keviczky, "A feedback scheme to reorder a multi-agent execution schedule by persistently optimizing a switchable action
dependency graph", 2020). As in Jiang et al., AAAI 2025 (switchable temporal plan graphs), only pairs on a longest path are
tried, and what has to switch together does: where a switch makes robots wait for each other, pairs of the same two robots in
the circle are switched too. The search is best first from the order in force, and bounded by how often it looks for longest paths.
"""

import heapq

import numpy as np

from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.problem import Problem
from mrp_sumo.drive import _switch
from mrp_sumo.drive._switch import CYCLIC, Net, SwitchScratch
from mrp_sumo.drive.live_plan import LivePlan
from mrp_sumo.drive.motion_plan import TURNS_RAD, lanes_along
from mrp_sumo.errors import ExecutionError
from mrp_sumo.traffic.passages import Schedule, permuted

DEEPEST = 6  # how many passages a robot is let pass at once
MOST_DRAWN = 64  # pairs that one switch may draw along
MOST_VISITS = 4_000_000  # that longest paths may go over in one decision, so that it takes a fraction of a second for any fleet
FRUITLESS = 12  # orders expanded in a row without a better one, after which the search ends


def switched(problem: Problem, plan: LivePlan, now_s: float, *, hold_s: float, least_s: float, budget: int) -> Schedule | None:
    """A better order of passages, None where none is found: one that lowers the sum of the times at which robots are done by `least_s`.

    `hold_s` is how much longer a robot that is held by a disturbance is taken to stand. Longest paths are looked for `budget` times; less
    often where that would be over more than `MOST_VISITS` visits.
    """
    schedule = plan.order
    if schedule is None:
        raise ExecutionError("passages have no order that could be switched")
    net = net_of(problem, plan, schedule, now_s, hold_s)
    budget = min(budget, MOST_VISITS // max(1, plan.num_visits))
    order = best_order(net, np.arange(schedule.num_passages), least_s, budget)
    return None if order is None else permuted(schedule, order)


def net_of(problem: Problem, plan: LivePlan, schedule: Schedule, now_s: float, hold_s: float) -> Net:
    """The rest of a plan as a graph with durations."""
    graph, fleet, robot, first = problem.graph, problem.fleet, plan.robot, plan.first[:-1]
    lane, _ = lanes_along(graph, plan)
    moved = lane >= 0
    length = np.where(moved, graph.length_m[lane], 0.0)
    limit = np.where(moved, graph.speed_mps[lane], np.inf)
    speed = np.minimum(fleet.max_speed_mps[robot], limit)
    speed_up_s = speed / fleet.accel_mps2[robot] / 2  # lost by setting out from rest
    slow_down_s = speed / fleet.decel_mps2[robot] / 2
    heading = np.where(moved, graph.heading_rad[lane], 0.0)
    bend = np.abs(wrapped(np.diff(heading, prepend=0.0)))
    known = moved & np.append(False, moved[:-1])
    bend = np.where(known & (bend > TURNS_RAD), bend, 0.0)
    rest_s = length / speed + np.where(moved, speed_up_s, 0.0)
    run_s = length / speed + bend / fleet.turn_rate_rad_s[robot] + np.where(bend > 0, speed_up_s + slow_down_s, 0.0)
    setting_out = np.minimum(first + 1, plan.num_visits - 1)
    driven_s = np.minimum(plan.driven_m / speed[setting_out], np.where(moved[setting_out], run_s[setting_out], 0.0))
    by_visit = np.argsort(schedule.visit, kind="stable")
    passages = np.arange(schedule.num_passages)
    leaving = np.minimum(schedule.left_at, plan.num_visits - 1)
    clear_m = np.where(schedule.left_at > schedule.last_visit, np.maximum(length[leaving] - fleet.separation_m, 0.0), 0.0)
    return Net(
        first=plan.first,
        ready_s=now_s - driven_s + np.where(plan.held, hold_s, 0.0),
        run_s=run_s,
        rest_s=rest_s,
        opens_first=np.searchsorted(schedule.visit[by_visit], np.arange(plan.num_visits + 1)).astype(np.int64),
        opens=passages[by_visit],
        robot=np.ascontiguousarray(schedule.robot),
        left_at=np.ascontiguousarray(schedule.left_at),
        early_s=clear_m / speed[leaving],
        fixed=plan.arrive_s[schedule.visit] < 0,
        begin=np.repeat(schedule.first[:-1], np.diff(schedule.first)),
    )


def best_order(net: Net, order: IntArray, least_s: float, budget: int) -> IntArray | None:
    """[E] the best order of passages that was found, None where none is better than this one by `least_s`."""
    scratch = scratch_for(net)
    start_s = best_s = cost_of(net, order, scratch)
    if start_s == CYCLIC:
        return None
    best, looks, fruitless = order, 1, 0
    waiting, seen = [(start_s, 0, order)], {order.tobytes()}
    while waiting and looks < budget and fruitless < FRUITLESS:
        _, _, order = heapq.heappop(waiting)
        place = placed(order)
        _switch.cost_of(net, order, place, scratch)
        count = _switch.critical(net, order, place, scratch)
        looks, fruitless = looks + 1, fruitless + 1
        for e in np.flatnonzero(count).tolist():
            for until in range(int(place[e]) - 1, max(int(net.begin[e]), int(place[e]) - DEEPEST) - 1, -1):
                if looks >= budget or not _may_pass(net, order, e, until):
                    break
                other = order.copy()
                cost_s, more = _switch.switch(net, other, placed(other), e, until, min(MOST_DRAWN, budget - looks), scratch)
                looks += more
                if cost_s == CYCLIC or (name := other.tobytes()) in seen:
                    continue
                seen.add(name)
                heapq.heappush(waiting, (cost_s, len(seen), other))
                if cost_s < best_s - 1e-9:
                    best_s, best, fruitless = cost_s, other, 0
    return best if best_s < start_s - least_s else None


def cost_of(net: Net, order: IntArray, scratch: SwitchScratch) -> float:
    """The sum of the times at which robots are done, s; inf for an order that nobody can keep."""
    return float(_switch.cost_of(net, order, placed(order), scratch))


def scratch_for(net: Net) -> SwitchScratch:
    """Room for looks at orders."""
    num_visits, num_robots = len(net.run_s), len(net.ready_s)
    at, stuck, waits = np.zeros(num_robots, np.int64), np.zeros(num_robots, np.int64), np.zeros(num_visits, np.int64)
    return SwitchScratch(np.zeros(num_visits), waits, at, stuck, np.zeros(num_robots, np.bool_))


def placed(order: IntArray) -> IntArray:
    """[E] the place of each passage in an order."""
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    return place


def _may_pass(net: Net, order: IntArray, passage: int, until: int) -> bool:
    before = int(order[until])
    return not net.fixed[before] and net.robot[before] != net.robot[passage] and net.left_at[passage] < len(net.run_s)
