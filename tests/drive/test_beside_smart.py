"""Finishing times beside those of SMART, another author's simulator with a physics engine, for the same plan and kinematics."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from golden import DATA

from mrp_sumo.core.fleet import fleet_of
from mrp_sumo.core.robot_type import RobotType
from mrp_sumo.drive.retime import retime
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.formats.instances import problem_of_places, read_instance
from mrp_sumo.formats.peers import read_paths, read_places

SHARED = Path(__file__).resolve().parents[3] / "shared/reference/data/smart"
BOTH = pytest.mark.skipif(not SHARED.is_dir(), reason="the plan for 500 robots and SMART's times are not beside this repository")
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


@pytest.mark.parametrize(
    ("robots", "correlation", "share", "latest", "same"),
    [(100, 0.998, 0.9, 10, 10), pytest.param(500, 0.994, 0.95, 50, 44, marks=BOTH)],
)
def test_finishing_times_agree_with_smart(tmp_path, robots, correlation, share, latest, same):
    folder = DATA / "smart" if robots == 100 else SHARED
    (tmp_path / "warehouse.map").write_text(warehouse())
    instance, text = read_instance(tmp_path / "warehouse.map", None, 0), (folder / f"plan{robots}.txt").read_text()
    problem = problem_of_places(instance, read_places(text), f"plan{robots}.txt")
    problem = replace(problem, fleet=fleet_of(ROBOT, problem.num_robots), step_s=2.0)
    ours = retime(problem, read_paths(text, problem, instance.cells), ExecutionSettings()).end_s
    theirs = np.loadtxt(folder / f"finish_{robots}.csv", delimiter=",", skiprows=1)[:, 1]
    assert np.corrcoef(ours, theirs)[0, 1] > correlation
    assert share < ours.sum() / theirs.sum() < 1.0  # SMART's controller brakes at 0.81 of its deceleration
    assert len(set(np.argsort(ours)[-latest:]) & set(np.argsort(theirs)[-latest:])) >= same
