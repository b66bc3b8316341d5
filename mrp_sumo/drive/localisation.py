"""Poses that robots believe to have: their true ones and an error that localisation makes.

Only what is recorded changes. Robots drive along their true poses, as robots on rails would, and so does the audit.
"""

import numpy as np

from mrp_sumo.core.disturbances import Disturbances
from mrp_sumo.core.graph import FloatArray

LOCALISATION = 37  # purpose of the stream of chance, beside those of drive.world


def believed_poses(x_m: FloatArray, y_m: FloatArray, yaw_rad: FloatArray, period_s: float, what: Disturbances, seed: int) -> FloatArray:
    """The poses [3, T, R] (x and y in m, yaw in rad), a period apart, with an error, normally distributed in each at every sample.

    Errors of successive samples are independent, or with `what.localisation_tau_s` an Ornstein-Uhlenbeck process: their correlation falls
    to 1/e within that time. The first samples are the same however long the run.
    """
    rng = np.random.default_rng([seed, LOCALISATION])
    error = rng.normal(size=(len(x_m), 3, x_m.shape[1]))
    share = np.exp(-period_s / what.localisation_tau_s) if what.localisation_tau_s else 0.0
    if share:
        for k in range(1, len(error)):
            error[k] = share * error[k - 1] + np.sqrt(1 - share**2) * error[k]
    error *= np.array([what.localisation_m, what.localisation_m, what.localisation_rad])[:, None]
    poses: FloatArray = np.stack((x_m, y_m, yaw_rad)) + error.transpose(1, 0, 2)
    poses[2] = (poses[2] + np.pi) % (2 * np.pi) - np.pi
    return poses
