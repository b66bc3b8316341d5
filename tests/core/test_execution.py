"""Executions whose samples are on the disk."""

from dataclasses import replace

import numpy as np
from worlds import record_of_four

from mrp_sumo.core.execution import let_go_of_samples


def test_samples_that_were_let_go_of_are_read_again_from_the_disk(tmp_path):
    execution = record_of_four().execution
    execution.x_m.tofile(tmp_path / "x")
    mapped = np.memmap(tmp_path / "x", np.float64, "r", shape=execution.x_m.shape).view(np.ndarray)
    on_disk = replace(execution, x_m=mapped)  # the others are in memory
    let_go_of_samples(on_disk)
    assert np.array_equal(on_disk.x_m, execution.x_m, equal_nan=True)
    assert np.array_equal(on_disk.y_m, execution.y_m, equal_nan=True)
