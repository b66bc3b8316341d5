"""Kernel for robots that turn on a grid: what the way from each state to a goal costs, bucket by bucket (Dial)."""

from mrp_sumo.search._kernel import kernel

FAR = 65535  # no way


@kernel
def fill_distance(ahead, price, goals, distance, bucket, size):
    """Cost of the cheapest way from each state to the nearest of goal cells, in any heading; a turn costs 1.

    Parameters
    ----------
    ahead
        [S] the cell ahead of a state, 4 x cell + heading, or -1.
    price
        [S] int32, of driving there, 1 to B - 1.
    goals
        Cells.
    distance
        [S] out, uint16; FAR where there is no way.
    bucket, size
        [B, S], [B] scratch: states by what is left to do, in turn.
    """
    num_buckets = len(size)
    distance[:] = FAR
    size[:] = 0
    for goal in goals:
        for heading in range(4):
            distance[4 * goal + heading] = 0
            bucket[0, size[0]] = 4 * goal + heading
            size[0] += 1
    spent, empty = 0, 0
    while empty < num_buckets:
        now = spent % num_buckets
        empty = empty + 1 if size[now] == 0 else 0
        i = 0
        while i < size[now]:
            state = bucket[now, i]
            i += 1
            if distance[state] != spent:
                continue
            cell, heading = state >> 2, state & 3
            behind = ahead[4 * cell + ((heading + 2) & 3)]
            for k in range(3):
                if k == 2:
                    if behind < 0:
                        continue
                    before = 4 * behind + heading
                    cost = min(spent + price[before], FAR - 1)
                else:
                    before = 4 * cell + ((heading + 1 + 2 * k) & 3)
                    cost = min(spent + 1, FAR - 1)
                if cost < distance[before]:
                    distance[before] = cost
                    to = cost % num_buckets
                    bucket[to, size[to]] = before
                    size[to] += 1
        size[now] = 0
        spent += 1
