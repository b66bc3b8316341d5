"""How the page of a capacity study puts sizes."""

import pytest

from mrp_sumo.reports.capacity.page import _bracketed
from mrp_sumo.sizing.search import Bracket


@pytest.mark.parametrize(
    ("bracket", "words"),
    [(Bracket(), "not found"), (Bracket(None, 4), "4 or more"), (Bracket(None, 4, 9), "not found"), (Bracket(5), "5 robots")],
)
def test_a_size_is_said_as_far_as_it_is_known(bracket, words):
    assert _bracketed(bracket) == words
