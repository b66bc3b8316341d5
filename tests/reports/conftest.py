"""A real run, for tests of what is made of one."""

import pytest

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
