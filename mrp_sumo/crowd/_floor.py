"""Kernels of free space: which walls are near each cell, and which way leads to a place.

Cells are numbered row by row from the lower left; a cell's place is its centre.
"""

import heapq

import numpy as np

from mrp_sumo.search._kernel import kernel

NUM_ANGLES = 240  # directions of 1.5 degrees
THERE, NO_WAY = 254, 255  # beside them
NEAR_PLACE_M = 0.8  # on the way to a place, one is there
SLOWEST = 0.4  # of their speed, close to a wall: ways keep away from walls
ROOM_M = 0.6  # from a wall at which it no longer matters


@kernel(allocates=True)
def walls_near(walls, x_m, y_m, cell_m, width, height, within_m):
    """The walls near each cell.

    Parameters
    ----------
    walls
        [W, 4] x, y of both ends, m.
    x_m, y_m, cell_m, width, height
        Lower left corner, side of a cell, cells.
    within_m
        Walls whose distance from the centre is at most this.

    Returns
    -------
    first, near
        CSR: the walls near cell c are near[first[c]:first[c + 1]].
    away_m
        [C] distance of the centre from the nearest wall, inf beyond `within_m`.
    """
    count = np.zeros(width * height + 1, np.int64)
    away_m = np.full(width * height, np.inf)
    near = np.empty(0, np.int64)
    for fill in range(2):
        for w in range(len(walls)):
            x0, y0, x1, y1 = walls[w, 0], walls[w, 1], walls[w, 2], walls[w, 3]
            left = max(int(np.floor((min(x0, x1) - within_m - x_m) / cell_m)), 0)
            right = min(int(np.floor((max(x0, x1) + within_m - x_m) / cell_m)), width - 1)
            low = max(int(np.floor((min(y0, y1) - within_m - y_m) / cell_m)), 0)
            high = min(int(np.floor((max(y0, y1) + within_m - y_m) / cell_m)), height - 1)
            for row in range(low, high + 1):
                for column in range(left, right + 1):
                    away = distance_to_wall(x_m + (column + 0.5) * cell_m, y_m + (row + 0.5) * cell_m, x0, y0, x1, y1)
                    if away > within_m:
                        continue
                    cell = row * width + column
                    if fill:
                        near[count[cell]] = w
                        count[cell] += 1
                    else:
                        count[cell + 1] += 1
                        away_m[cell] = min(away_m[cell], away)
        if fill:
            count[1:] = count[:-1]
            count[0] = 0
        else:
            count = np.cumsum(count)
            near = np.empty(count[-1], np.int64)
    return count, near, away_m


@kernel(inline="always")
def from_wall(x, y, x0, y0, x1, y1):
    """The way from a segment to a point, m."""
    dx, dy = x1 - x0, y1 - y0
    long = dx * dx + dy * dy
    share = min(max(((x - x0) * dx + (y - y0) * dy) / long, 0.0), 1.0) if long > 0.0 else 0.0
    return x - x0 - share * dx, y - y0 - share * dy


@kernel(inline="always")
def distance_to_wall(x, y, x0, y0, x1, y1):
    """Of a point from a segment, m."""
    dx, dy = from_wall(x, y, x0, y0, x1, y1)
    return np.hypot(dx, dy)


@kernel(allocates=True)
def march(start, free, away_m, cell_m, body_m, width, direction):
    """The way to a place from everywhere, by the fast marching method, slower close to walls.

    The time of arrival T solves |grad T| = 1 / speed, to first order (Sethian, PNAS 93, 1996); one walks against its gradient.

    Parameters
    ----------
    start
        The cell of the place.
    free, away_m
        [C] whether there is room, and distance from the nearest wall.
    cell_m, body_m, width
        Side of a cell; the least distance from a wall of free cells; cells in a row.
    direction
        [C] uint8, written: a multiple of 360 / NUM_ANGLES degrees from +x, THERE, or NO_WAY.
    """
    num_cells = len(free)
    time, done = np.full(num_cells, np.inf), np.zeros(num_cells, np.bool_)
    direction[:] = NO_WAY
    time[start] = 0.0
    heap = [(0.0, start)]
    while len(heap) > 0:
        cell = heapq.heappop(heap)[1]
        if done[cell]:
            continue
        done[cell] = True
        for k in range(4):
            other = cell + (1 if k == 0 else -1 if k == 1 else width if k == 2 else -width)
            if other < 0 or other >= num_cells or done[other] or not free[other] or (k < 2 and other // width != cell // width):
                continue
            across = min(known(time, other, -1, width), known(time, other, 1, width))
            along = min(known(time, other, -width, width), known(time, other, width, width))
            share = (away_m[other] - body_m) / (ROOM_M - body_m)
            step = cell_m / (SLOWEST + (1.0 - SLOWEST) * min(max(share, 0.0), 1.0))
            low, high = min(across, along), max(across, along)
            cost = low + step  # of one neighbour, or of two
            if high - low < step:
                cost = (low + high + np.sqrt(2.0 * step * step - (high - low) ** 2)) / 2.0
            if cost < time[other]:
                time[other] = cost
                heapq.heappush(heap, (cost, other))
    for cell in range(num_cells):
        if not done[cell]:
            continue
        if time[cell] <= NEAR_PLACE_M:
            direction[cell] = THERE
            continue
        left, right = known(time, cell, -1, width), known(time, cell, 1, width)
        below, above = known(time, cell, -width, width), known(time, cell, width, width)
        dx = 0.0 if min(left, right) >= time[cell] else (time[cell] - right if right < left else left - time[cell])
        dy = 0.0 if min(below, above) >= time[cell] else (time[cell] - above if above < below else below - time[cell])
        direction[cell] = int(np.rint(np.arctan2(dy, dx) * (NUM_ANGLES / (2.0 * np.pi)))) % NUM_ANGLES


@kernel(inline="always")
def known(time, cell, step, width):
    """The time of arrival at a neighbour, inf beyond the edge."""
    other = cell + step
    if other < 0 or other >= len(time) or ((step == 1 or step == -1) and other // width != cell // width):
        return np.inf
    return time[other]
