"""Kernel of trailers: how they follow the axle in front of them, which do not slip to the side."""

import numpy as np

from mrp_sumo.search._kernel import kernel

STEP_M = 0.01


@kernel(allocates=True)
def follow(node, hitch, length, begin):
    """Headings of N trailers behind a vehicle, by the midpoint rule.

    Parameters
    ----------
    node
        [K, 3] x, y and heading of the vehicle's fixed axle along its way.
    hitch, length
        [N] from each axle back to the hitch, and from there to the trailer's axle.
    begin
        [N] headings at the first node.

    Returns
    -------
    towed
        [K, N]
    """
    num_nodes, num_trailers = len(node), len(hitch)
    towed = np.empty((num_nodes, num_trailers))
    now, middle = begin.copy(), begin.copy()
    towed[0] = now
    for k in range(1, num_nodes):
        across, along = node[k, 0] - node[k - 1, 0], node[k, 1] - node[k - 1, 1]
        moved = np.sqrt(across * across + along * along)
        forward = across * np.cos(node[k, 2]) + along * np.sin(node[k, 2]) >= 0.0
        turned = node[k, 2] - node[k - 1, 2]
        steps = max(1, int(np.ceil(moved / STEP_M)))
        ds, dyaw = (moved if forward else -moved) / steps, turned / steps
        for i in range(steps):
            yaw = node[k - 1, 2] + i * dyaw
            for half in range(2):
                here = now if half == 0 else middle
                ahead, rate, pace = (yaw if half == 0 else yaw + dyaw / 2), dyaw, ds
                for n in range(num_trailers):
                    off = ahead - here[n]
                    mine = (pace * np.sin(off) - hitch[n] * rate * np.cos(off)) / length[n]
                    pace = pace * np.cos(off) + hitch[n] * rate * np.sin(off)
                    ahead, rate = here[n], mine
                    if half == 0:
                        middle[n] = now[n] + mine / 2
                    else:
                        now[n] += mine
        towed[k] = now
    return towed
