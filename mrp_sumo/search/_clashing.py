"""Kernels that tell whether moves clash, see `core.clashes`."""

from mrp_sumo.search._kernel import kernel


@kernel
def move_of(first, head, u, v):
    """The number of the move from u to v, or of waiting at u = v; -1 where there is no lane."""
    if u == v:
        return len(head) + u
    for lane in range(first[u], first[u + 1]):
        if head[lane] == v:
            return lane
    return -1


@kernel
def too_close(clashes, move, other, u, v):
    """True if a move clashes with another robot's move `other`, which leads from u to v or is waiting at u = v."""
    close = False
    for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
        close = close or clashes.vertex[k] == u or clashes.vertex[k] == v
    for k in range(clashes.lane_first[move], clashes.lane_first[move + 1]):
        close = close or clashes.lane[k] == other
    return close
