"""Kernel for robots that turn on a grid: how many steps each state is from a goal, breadth first."""

from mrp_sumo.search._kernel import kernel

FAR = 65535  # no way


@kernel
def fill_distance(ahead, goal, distance, queue):
    """How many steps it takes at least from each state to a goal cell, in any heading.

    Parameters
    ----------
    ahead
        [S] the cell ahead of a state, 4 x cell + heading, or -1.
    goal
        A cell.
    distance
        [S] out, uint16; FAR where there is no way.
    queue
        [S] scratch.
    """
    distance[:] = FAR
    for heading in range(4):
        distance[4 * goal + heading] = 0
        queue[heading] = 4 * goal + heading
    begin, end = 0, 4
    while begin < end:
        state = queue[begin]
        begin += 1
        cell, heading = state >> 2, state & 3
        steps = min(distance[state] + 1, FAR - 1)
        behind = ahead[4 * cell + ((heading + 2) & 3)]
        for k in range(3):
            if k == 2:
                if behind < 0:
                    continue
                before = 4 * behind + heading
            else:
                before = 4 * cell + ((heading + 1 + 2 * k) & 3)
            if distance[before] == FAR:
                distance[before] = steps
                queue[end] = before
                end += 1
