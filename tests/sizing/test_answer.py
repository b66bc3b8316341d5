"""Answers of capacity studies in words."""

from types import SimpleNamespace

import pytest

from mrp_sumo.errors import duration
from mrp_sumo.sizing.answer import _of_one_shot, _robots_do
from mrp_sumo.sizing.search import Bracket, Served


@pytest.mark.parametrize(
    ("largest", "says"),
    [
        (Bracket(8, 6, 9), "Plans of up to 8 robots are found and driven in time in at least 95 % of draws (certain up to 6), 10 do not."),
        (Bracket(8, 8, None), "Plans of up to 8 robots are found and driven in time in at least 95 % of draws, the most that were tried."),
        (Bracket(None, None, 3), "Not even 4 robots have plans that are found and driven in time in at least 95 % of draws."),
    ],
)
def test_the_largest_fleet_that_succeeds_is_told_with_how_sure_it_is_and_what_does_not(largest, says):
    curve = SimpleNamespace(points={4: None, 8: None}, sizes=[4, 8])
    assert _of_one_shot(SimpleNamespace(served=Served(curve, largest, 0.95))) == says


@pytest.mark.parametrize(("seconds", "words"), [(20, "20 s"), (60, "1 min"), (90, "90 s"), (150, "2 min"), (9300, "2 h 35 min")])
def test_a_time_is_said_in_minutes_unless_it_is_short(seconds, words):
    assert duration(seconds) == words


def test_one_robot_does_what_two_robots_do():
    assert (_robots_do(1), _robots_do(2, " (2 to 3)")) == ("1 robot does", "2 robots (2 to 3) do")
