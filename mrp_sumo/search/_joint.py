"""Kernel of the search of all joint states: whether a few robots on a small graph can reach their goals at all."""

import numpy as np

from mrp_sumo.search._clashing import move_of, too_close
from mrp_sumo.search._kernel import kernel


@kernel(allocates=True)
def can_reach(first, head, start, goal, following, clashes, spots):
    """True if robots can go from their starts to their goals without a conflict.

    Parameters
    ----------
    first, head
        The graph, of V vertices.
    start, goal
        [R] vertices; V ** R must be a number small enough to hold that many flags.
    following
        Whether following conflicts are forbidden too.
    clashes, spots
        Of the graph.
    """
    num_vertices, num_robots = len(first) - 1, len(start)
    size = np.int64(1)
    for _ in range(num_robots):
        size *= num_vertices
    seen = np.zeros(size, np.bool_)
    queue = np.empty(size, np.int64)
    wanted, begin = np.int64(0), np.int64(0)
    for r in range(num_robots):
        wanted = wanted * num_vertices + goal[r]
        begin = begin * num_vertices + start[r]
    seen[begin] = True
    queue[0] = begin
    done, count = 0, 1
    at = np.empty(num_robots, np.int64)
    there = np.empty(num_robots, np.int64)
    move, spot_of = np.empty(num_robots, np.int64), spots.of
    while done < count:
        state = queue[done]
        done += 1
        if state == wanted:
            return True
        rest = state
        for r in range(num_robots - 1, -1, -1):
            at[r] = rest % num_vertices
            rest //= num_vertices
        r = 0
        move[0] = -1
        while r >= 0:  # robots one after the other, each through its moves
            move[r] += 1
            u = at[r]
            degree = first[u + 1] - first[u]
            if move[r] > degree:
                r -= 1
                continue
            v = u if move[r] == degree else head[first[u] + move[r]]
            clear, here, onward = True, spot_of[u], spot_of[v]
            for s in range(r):
                before, after = spot_of[at[s]], spot_of[there[s]]
                if after == onward or (after == here and before == onward):
                    clear = False
                if following and ((onward == before and after != onward) or (after == here and onward != here)):
                    clear = False
                for k in range(spots.beside_first[onward], spots.beside_first[onward + 1]):
                    clear = clear and spots.beside[k] != after
                mine, theirs = move_of(spots.first, spots.head, here, onward), move_of(spots.first, spots.head, before, after)
                if clashes.any and too_close(clashes, mine, theirs, before, after):
                    clear = False
            if not clear:
                continue
            there[r] = v
            if r + 1 < num_robots:
                r += 1
                move[r] = -1
                continue
            if not clashes.rotations and _rotate(spots.place[spot_of[at]], spots.place[spot_of[there]]):
                continue
            new = np.int64(0)
            for s in range(num_robots):
                new = new * num_vertices + there[s]
            if not seen[new]:
                seen[new] = True
                queue[count] = new
                count += 1
    return False


@kernel
def _rotate(at, there):
    """Whether some robots each go to where the next one was, in a ring."""
    for start in range(len(at)):
        r = start
        for _ in range(len(at)):
            if there[r] == at[r]:
                break
            ahead = -1
            for s in range(len(at)):
                if at[s] == there[r]:
                    ahead = s
            r = ahead
            if r < 0 or r == start:
                break
        if r == start and there[start] != at[start]:
            return True
    return False
