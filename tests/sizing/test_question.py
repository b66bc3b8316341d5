"""The runs of a capacity study."""

import pytest

from mrp_sumo.io.scenario.read import read_scenario
from mrp_sumo.sizing.question import QUICK, SATURATED, Question, Trial, values_of


@pytest.mark.parametrize(("robots", "counts"), [(1, [1]), (2, [1, 1]), (5, [3, 2]), (10, [6, 4]), (33, [20, 13])])
def test_a_mixed_fleet_grows_in_the_shares_of_its_types(tmp_path, robots, counts):
    fleet = "[{type: turtlebot3, count: 6}, {type: amr_600, count: 4}]"
    (tmp_path / "mixed.yaml").write_text(f"map: office\nrobots: {fleet}\n")
    question = Question(read_scenario(tmp_path / "mixed.yaml"), (1, 40), QUICK)
    (_, groups) = values_of(Trial(SATURATED, robots, 0), question, {})[("robots", "fleet")]
    assert [group["count"] for group in groups] == counts
