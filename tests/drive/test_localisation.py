"""Localisation noise changes what robots take to be true, and nothing else."""

import numpy as np
import pytest
from worlds import cross, drive

from mrp_sumo.core.disturbances import Disturbances
from mrp_sumo.core.execution import as_believed
from mrp_sumo.drive.localisation import believed_poses
from mrp_sumo.errors import OptionError

PATHS = [[1, 0, 7], [4, 4, 0, 10]]


def test_robots_drive_the_same_whatever_they_believe(tmp_path):
    sure = drive(tmp_path, cross(), PATHS, seed=3)
    noisy = {"disturbances": Disturbances(localisation_m=0.05, localisation_rad=0.1)}
    unsure, again, other = (drive(tmp_path, cross(), PATHS, seed=seed, **noisy) for seed in (3, 3, 4))
    assert sure.believed is None and as_believed(sure) is sure
    for name in ("x_m", "y_m", "yaw_rad", "speed_mps", "goal_s"):
        assert getattr(unsure, name).tobytes() == getattr(sure, name).tobytes()
    assert unsure.events == sure.events
    assert again.believed.tobytes() == unsure.believed.tobytes() != other.believed.tobytes()
    output = as_believed(unsure)
    assert output.x_m.tobytes() == unsure.believed[0].tobytes() and output.speed_mps is unsure.speed_mps
    assert 0.03 < (output.x_m - unsure.x_m).std() < 0.07


@pytest.mark.parametrize("tau_s", [0.0, 0.5])
def test_errors_are_as_large_and_as_lasting_as_they_should_be(tau_s):
    still = np.zeros((20_000, 2))
    what = Disturbances(localisation_m=0.1, localisation_rad=0.02, localisation_tau_s=tau_s)
    poses = believed_poses(still, still + 5.0, still + np.pi, 0.1, what, 1)
    assert poses[2].max() < np.pi  # wrapped
    error = np.stack((poses[0], poses[1] - 5.0, (poses[2] + 2 * np.pi) % (2 * np.pi) - np.pi))
    assert error.std(axis=1) == pytest.approx(np.array([[0.1] * 2, [0.1] * 2, [0.02] * 2]), rel=0.08)
    assert abs(error.mean(axis=1)).max() < 0.01
    next_to_each_other = [np.corrcoef(error[i, 1:, r], error[i, :-1, r])[0, 1] for i in range(3) for r in range(2)]
    assert next_to_each_other == pytest.approx(np.full(6, np.exp(-0.1 / tau_s) if tau_s else 0.0), abs=0.05)
    shorter = believed_poses(still[:50], still[:50] + 5.0, still[:50] + np.pi, 0.1, what, 1)
    assert (shorter == poses[:, :50]).all()


def test_negative_errors_are_refused():
    with pytest.raises(OptionError, match=r"localisation_m is -0\.1, expected at least 0"):
        Disturbances(localisation_m=-0.1)
    assert not Disturbances(localisation_m=0.1).any
