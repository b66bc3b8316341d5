"""Real runs, for tests of what is made of them."""

import pytest

from mrp_sumo.cli.main import main
from mrp_sumo.experiments.run import run_scenario
from mrp_sumo.io.scenario.file import find_scenario
from mrp_sumo.io.scenario.read import read_scenario


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """The run folder of five robots in the office, prioritised planning, without a bag."""
    out = tmp_path_factory.mktemp("run") / "office"
    overrides = {("planner", "name"): ("--planner", "prioritised"), ("record", "bag"): ("", False)}
    run_scenario(read_scenario(find_scenario("office_5"), overrides), out)
    return out


TUGGER = """
length_m: 1.0
width_m: 0.6
max_speed_mps: 1.0
accel_mps2: 0.5
decel_mps2: 0.5
kinematics: {kind: tugger, wheelbase_m: 0.7, steering_max_rad: 0.6}
trailers: [{length_m: 0.7, hitch_m: 0.4}, {length_m: 0.7, hitch_m: 0.4}]
"""
TRAINS = """
map: ./grid.building.yaml
seed: 3
robots: {count: 2, type: ./tugger.yaml}
discretisation: {kind: roadmap, cell_m: 4.0}
planner: prioritised
execution: {engine: kinematic}
record: {bag: false}
"""


@pytest.fixture(scope="session")
def trains(tmp_path_factory):
    """The run folder of two tuggers with two trailers each, in one-way streets."""
    folder = tmp_path_factory.mktemp("trains")
    streets = ["--vertices", "24", "--spacing", "4", "--one-way"]
    assert main(["generate", "grid", *streets, "--out", str(folder / "grid.building.yaml")]) == 0
    (folder / "tugger.yaml").write_text(TUGGER)
    (folder / "trains.yaml").write_text(TRAINS)
    run_scenario(read_scenario(folder / "trains.yaml"), folder / "run")
    return folder / "run"
