"""The drive without SUMO that gets kernels loaded."""

import pytest

from mrp_sumo.drive import warm


@pytest.mark.parametrize("engine", ["sumo", "kinematic"])
def test_controller_is_ready_without_sumo(engine):
    warm.prepare(engine)
