"""The least cover of what groups of robots cost more, against all covers there are."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planners.conflict_based._cover import cover

pytestmark = pytest.mark.kernel


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(st.sets(st.integers(0, 5), min_size=2, max_size=4), st.integers(1, 3)), min_size=1, max_size=7),
)
def test_cover_is_the_least_that_gives_each_group_what_it_costs(groups):
    robots = sorted(set().union(*(group for group, _ in groups)))
    first = np.cumsum([0, *(len(group) for group, _ in groups)])
    member = np.array([robots.index(robot) for group, _ in groups for robot in sorted(group)])
    least = np.array([cost for _, cost in groups])
    best = min(
        sum(more)
        for more in product(range(4), repeat=len(robots))
        if all(sum(more[robots.index(robot)] for robot in group) >= cost for group, cost in groups)
    )
    assert cover(len(robots), first, member, least) == best
