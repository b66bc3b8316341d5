"""A run of four robots on two crossing corridors, for tests of what logs make of it."""

import numpy as np

from mrp_sumo.bags.writer import write_recorded_bag
from mrp_sumo.core.execution import Event, Execution, Outcome
from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.core.graph import PlanGraph, nav_graph
from mrp_sumo.core.plan import PlanResult, Status, plan_of_paths
from mrp_sumo.core.problem import Problem
from mrp_sumo.io.record import Record
from mrp_sumo.io.run_folder import write_run
from mrp_sumo.io.scenario import Scenario
from mrp_sumo.maps.costmap import Costmap
from mrp_sumo.traffic.referee import judge

CART = RobotType("cart", 0.6, 0.4, max_speed_mps=1.0, accel_mps2=1.0, decel_mps2=1.0, turn_rate_rad_s=1.0)
LENGTH = 8  # cells of 1 m in a corridor


def record_of_four(seconds=12.0, costmap=True, absent=False):
    """Robots drive along four corridors at 1 m/s; robot_1 is blocked from 3 s to 6 s, robot_3 stays at its start."""
    xy = [(float(x), float(y)) for y in range(4) for x in range(LENGTH)]
    pairs = [(LENGTH * row + i, LENGTH * row + i + 1) for row in range(4) for i in range(LENGTH - 1)]
    names = ["dock <1>", *[""] * (len(xy) - 2), "Tür 9"]
    nav = nav_graph(name="four", xy=xy, lanes=pairs + [(b, a) for a, b in pairs], vertex_name=names)
    graph = PlanGraph(**vars(nav), kind="grid", cell_m=1.0, vertex_of_station=np.arange(len(xy)))
    starts = [0, LENGTH, 2 * LENGTH, 3 * LENGTH]
    ends = [LENGTH - 1, 2 * LENGTH - 1, 3 * LENGTH - 1, 3 * LENGTH]
    plan = plan_of_paths([list(range(a, b + 1)) for a, b in zip(starts, ends)], 1.0)
    t = np.arange(round(seconds * 10) + 1) * 0.1
    held = np.clip(t - 3, 0, 3)
    x = np.stack((np.clip(t, 0, 7), np.clip(t - held, 0, 7), np.clip(t - 0.05, 0, 7), np.zeros(len(t))), 1)
    y = np.broadcast_to([0.0, 1.0, 2.0, 3.0], x.shape).copy()
    speed = np.diff(x, axis=0, prepend=x[:1]) / 0.1
    yaw = np.broadcast_to([0.0, 0.1, 0.0, np.pi / 2], x.shape).copy()
    if absent:
        for column in (x, y, yaw, speed):
            column[:20, 2] = np.nan
    events = (
        Event(0.0, "started", 0, vertex=0),
        Event(3.0, "blocked", 1, vertex=LENGTH + 3, other=2, duration_s=3.0, text="behind 'robot_2' <b>"),
        Event(7.0, "goal", 0, vertex=LENGTH - 1),
    )
    goal_s = np.array([7.0, 10.0, 7.1, 0.0])
    arrived = plan.arrive_s.copy()
    execution = Execution(t, x, y, yaw, speed, arrived, goal_s, Outcome.COMPLETED, "adg", seconds, 0.1, 0.1, events)
    occupied = np.zeros((30, 50), np.bool_)
    occupied[0] = occupied[:, 0] = True
    walls = Costmap((-1.0, -1.5), 0.2, occupied) if costmap else None
    return Record("four", 7, fleet_of(CART, 4), graph, np.array(ends), plan, execution, nav, walls)


def run_of_four(out, network, *, executed=True, **changes):
    record = record_of_four(seconds=3.0)
    problem = Problem(
        graph=record.graph, fleet=record.fleet, start=np.array([0, 8, 16, 24]), goal=record.target, goal_of=np.arange(4), step_s=1.0, seed=7
    )
    network.write_text("<net/>")
    given = {
        "status": "completed",
        "note": "",
        "scenario": Scenario.model_validate({"name": "four", "seed": 7, "map": "four", "robots": {"count": 4}}),
        "problem": problem,
        "result": PlanResult(Status.SOLVED, plan=record.plan) if executed else PlanResult(Status.TIMED_OUT, message="no time"),
        "verdict": judge(problem, record.plan) if executed else None,
        "execution": record.execution if executed else None,
        "metrics": {"min_distance_m": np.float64(1.5), "real_time_factor": float("inf"), "time_blocked_s": [0.0, 1.0], "flag": np.True_},
        "audit": {"passed": True} if executed else None,
        "network": network,
        "nav": record.nav,
        "costmap": record.costmap,
        "write_bag": write_recorded_bag,
    }
    return write_run(out, **{**given, **changes})
