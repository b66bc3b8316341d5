"""The warm-up of a simulated series: how much of its beginning is left out, by MSER-5.

White, "An effective truncation heuristic for bias reduction in simulation output", Simulation 69(6), 1997; with batches of five:
White, Cobb and Spratt, "A comparison of five steady-state truncation heuristics for simulation", Winter Simulation Conference, 2000.
"""

import numpy as np
from numpy.typing import ArrayLike

BATCH = 5  # observations whose mean is one value
LEAST_BATCHES = 4  # below which nothing can be said


def warm_up_length(series: ArrayLike) -> int | None:
    """Number of observations to leave out, a multiple of five, so that the standard error of the mean of the rest is least.

    None where the series is too short to tell: half of it or more would be left out.
    """
    values = np.asarray(series, np.float64)
    num_batches = len(values) // BATCH
    if num_batches < LEAST_BATCHES:
        return None
    means = values[: num_batches * BATCH].reshape(num_batches, BATCH).mean(1)
    most = num_batches // 2
    error = [means[d:].var() / (num_batches - d) for d in range(most + 1)]
    cut = int(np.argmin(error))
    return None if cut == most else cut * BATCH
