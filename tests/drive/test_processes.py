"""The same seed gives the same bytes, whichever process drives."""

import hashlib
import multiprocessing
import tempfile
from pathlib import Path

import pytest
from worlds import cross, drive, square_grid

from mrp_sumo.core.disturbances import Breakdown, Disturbances

CROSSING = (cross(), [[1, 0, 7, 8], [4, 4, 0, 10, 11]])
GRID = (square_grid(4), [[0, 1, 2, 3, 7, 11], [12, 8, 4, 5, 6], [15, 14, 13, 9, 10]])
CASES = [
    (world, policy, seed) for world in range(2) for policy in ("adg_timed", "open_loop") for seed in range(2)
]  # more than there are processes, so that each drives several


def digest(case):
    """Of all that an execution says."""
    world, policy, seed = case
    what = Disturbances(
        speed_spread=0.08, speed_noise=0.1, speed_noise_tau_s=2.0, stops_per_s=1 / 20, start_delay_s=2.0, delay_probability=0.1,
        latency_s=0.5, message_loss=0.2, localisation_m=0.05,
        breakdowns=(Breakdown(0, 5.0, 8.0),),
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        run = drive(Path(folder), *(CROSSING, GRID)[world], policy, seed=seed, disturbances=what, on_deadlock="resolve", time_limit_s=60.0)
    arrays = (run.t_s, run.x_m, run.y_m, run.yaw_rad, run.speed_mps, run.arrived_s, run.goal_s, run.booked_s, run.believed)
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays) + repr(run.events).encode()).hexdigest()


def digests(num_processes):
    with multiprocessing.get_context("spawn").Pool(num_processes) as pool:
        return pool.map(digest, CASES, chunksize=1)


@pytest.mark.slow
def test_two_processes_drive_as_one_does():
    here = [digest(case) for case in CASES]
    assert len(set(here)) == len(CASES)
    assert digests(2) == here


@pytest.mark.campaign
def test_eight_processes_drive_as_one_does():
    assert digests(8) == [digest(case) for case in CASES]
