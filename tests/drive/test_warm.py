"""The drive without SUMO that gets kernels loaded."""

from mrp_sumo.drive import warm


def test_controller_is_ready_without_sumo():
    warm.prepare()
