"""Angles in radians, counter-clockwise."""

import numpy as np

from mrp_sumo.core.graph import FloatArray


def wrapped(angle: FloatArray | float) -> FloatArray:
    """Angles from -pi to pi, the latter excluded."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi)
