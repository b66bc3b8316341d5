"""Finishing times beside those of SMART, another author's simulator with a physics engine, for the same plan and kinematics."""

from dataclasses import replace

import numpy as np
from golden import DATA

from mrp_sumo.core.fleet import RobotType, fleet_of
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.formats.instances import problem_of_places, read_instance
from mrp_sumo.formats.peers import read_paths, read_places

ROBOT = RobotType("smart", 0.3, 0.3, 2.0, 0.5, 0.5, 1.57, 0.0757)


def warehouse():
    """MovingAI's warehouse-10-20-10-2-1: its `.map`."""
    cells = np.full((63, 161), "@")
    cells[1:-1, 1:-1] = "."
    for x in range(26, 136, 11):
        for y in range(2, 62, 3):
            cells[y : y + 2, x : x + 10] = "@"
    rows = "\n".join("".join(row) for row in cells)
    return f"type octile\nheight 63\nwidth 161\nmap\n{rows}\n"


def test_finishing_times_agree_with_smart(tmp_path):
    (tmp_path / "warehouse.map").write_text(warehouse())
    instance, text = read_instance(tmp_path / "warehouse.map", None, 0), (DATA / "smart/plan100.txt").read_text()
    problem = problem_of_places(instance, read_places(text), "plan100.txt")
    problem = replace(problem, fleet=fleet_of(ROBOT, problem.num_robots), step_s=2.0)
    ours = retime(problem, read_paths(text, problem, instance.cells), ExecutionSettings()).end_s
    theirs = np.loadtxt(DATA / "smart/finish_100.csv", delimiter=",", skiprows=1)[:, 1]
    assert np.corrcoef(ours, theirs)[0, 1] > 0.998
    assert 0.9 < ours.sum() / theirs.sum() < 1.0  # SMART's controller brakes at 0.81 of its deceleration
    assert set(np.argsort(ours)[-10:]) == set(np.argsort(theirs)[-10:])
