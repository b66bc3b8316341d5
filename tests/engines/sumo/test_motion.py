"""SUMO's own motion against the models of it: stepped to the last digit that SUMO keeps, closed forms by a bound for each stop."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from stepped_motion import first_step_at, stepped_way
from test_architecture import tool
from worlds import drive

from mrp_sumo.core.graph import nav_graph, plan_graph
from mrp_sumo.io.scenario.robots import robot_type
from mrp_sumo.search._motion import turn_steps

CLOSED = tool("speed_profile")  # runs as closed forms

DT_S = 0.1
STOPS_BEFORE_M = 0.001  # a robot stops this far before the end of what it may drive
ARRIVES_BEFORE_M = 0.002
FOLDER = Path(__file__).parents[3] / "robots"


def robot_of(file):
    return robot_type(file.stem, FOLDER, FOLDER)


def turns_in_place(file):
    return robot_of(file).kinematics.kind == "differential"


TYPES = sorted(filter(turns_in_place, FOLDER.glob("*.yaml")), key=lambda file: file.stem)


def route(xy, limit):
    """A street through points, lane by lane with a limit."""
    lanes = [lane for k in range(len(xy) - 1) for lane in ((k, k + 1), (k + 1, k))]
    nav = nav_graph(name="way", xy=xy, lanes=lanes, speed_mps=np.repeat(limit, 2))
    return plan_graph(nav, kind="roadmap", cell_m=float(nav.length_m.min()))


def stepped(graph, robot):
    """Arrivals, by the stepped model, of a robot that drives all lanes one after the other and stops before bends alone."""
    arrive, steps, begin_m, behind_mps, out = [0.0], 0, 0.0, np.inf, np.empty(100_000)
    for length, limit, angle in runs(graph):
        end = begin_m + np.append(0.0, np.cumsum(length))  # it begins just before a vertex, still on the lane to it
        limits = np.append(behind_mps, limit)
        num_steps = stepped_way(end, limits, end[-1] - STOPS_BEFORE_M, robot.max_speed_mps, *rates(robot), DT_S, out)
        run = out[:num_steps]
        k = 0
        for at in end[1:] - ARRIVES_BEFORE_M:
            k = first_step_at(run, num_steps, at)
            share = (run[k - 1] - at) / (run[k - 1] - (run[k - 2] if k > 1 else 0.0))
            arrive.append((steps + k - share) * DT_S)
        steps += k + turn_steps(angle, robot.turn_rate_rad_s, DT_S)
        begin_m, behind_mps = end[-1] - run[-1], limit[-1]
    return np.array(arrive)


def rates(robot):
    return robot.accel_mps2, robot.decel_mps2


def runs(graph):
    """Lengths and limits of the lanes between two turns, and the angle of the turn after them."""
    along = np.diff(graph.xy, axis=0)
    heading = np.arctan2(along[:, 1], along[:, 0])
    ahead = graph.tail < graph.head
    length, limit = np.round(graph.length_m[ahead], 6), graph.speed_mps[ahead]  # as SUMO keeps them
    bend = (np.diff(heading) + np.pi) % (2 * np.pi) - np.pi
    ends = [*(np.flatnonzero(np.abs(bend) > 0.2) + 1).tolist(), len(along)]
    for a, b in pairwise([0, *ends]):
        yield length[a:b], limit[a:b], float(bend[b - 1]) if b < len(along) else 0.0


def closed(graph, robot):
    """Arrivals by the closed forms."""
    arrive, now = [0.0], 0.0
    for length, limit, angle in runs(graph):
        profile = CLOSED.run_profile(length, limit, robot.max_speed_mps, *rates(robot))
        arrive += (now + CLOSED.time_s(profile, np.cumsum(length))).tolist()
        now += profile.end_s + abs(angle) / robot.turn_rate_rad_s
    return np.array(arrive)


def random_way(rng, robot):
    """Six lanes, some in line, with limits for half of them."""
    gap = 2 * robot.radius_m + robot.gap_m
    length = rng.uniform(1.1, 4.0, 6) * gap
    heading = rng.choice([0.0, 0.0, 0.1, 0.9, -0.8], 6)  # never back towards where it came from
    xy = np.concatenate([[[0.0, 0.0]], np.cumsum(length[:, None] * np.stack([np.cos(heading), np.sin(heading)], 1), axis=0)])
    limit = np.where(rng.random(6) < 0.5, np.inf, rng.uniform(0.2, 1.2, 6) * robot.max_speed_mps)
    return route(xy, np.round(limit, 6))


@pytest.mark.parametrize("file", TYPES, ids=lambda file: file.stem)
@pytest.mark.parametrize("seed", range(2))
def test_sumo_moves_a_robot_as_the_stepped_model_does(file, seed, tmp_path):
    robot = robot_of(file)
    graph = random_way(np.random.default_rng(seed), robot)
    driven = drive(tmp_path, graph, [list(range(graph.num_vertices))], robot=robot, step_s=60.0, time_limit_s=600.0)
    assert driven.arrived_s == pytest.approx(stepped(graph, robot), abs=1e-6)


@pytest.mark.parametrize("file", TYPES, ids=lambda file: file.stem)
def test_closed_forms_are_within_a_step_and_a_half_for_each_start_and_stop(file):
    robot = robot_of(file)
    for seed in range(40):
        graph = random_way(np.random.default_rng(seed), robot)
        num_runs = np.repeat(np.arange(1, len(list(runs(graph))) + 1), [len(length) for length, _, _ in runs(graph)])
        assert (np.abs(stepped(graph, robot) - closed(graph, robot))[1:] < 1.5 * DT_S * num_runs).all()
