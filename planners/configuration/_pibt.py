"""Kernels of priority inheritance with backtracking (PIBT): one step of all robots at once.

Source: Okumura, Machida, Défago, Tamura, "Priority inheritance with backtracking for iterative multi-agent
path finding", AIJ 2022, algorithm 1; the paper's names are in brackets. `pibt.Step` is the same algorithm in plain
Python. Here the recursion is a stack, since a compiled recursive function cannot be stored.

Where rings may not move at once, a move that would close one is refused when it is proposed. Where following is
refused, a robot still pushes whoever stands on the vertex that it wants, but waits until that robot has gone. It does so too
where somebody stands too close to its move (a clash): it waits, those who push it wait, and meanwhile nobody else comes near.
"""

from mrp_sumo.search._clashing import move_of
from mrp_sumo.search._kernel import kernel
from planners.configuration._local_guidance import guide_locally
from planners.configuration._pibt_candidates import sort_candidates

NOBODY, CHOSEN = -1, -2  # who is too close


@kernel(allocates=False)
def step(world, scratch, here, to, order, hindrance, rng):
    """Choose every robot's next vertex.

    Parameters
    ----------
    world, scratch
        See `PibtInstance` and `PibtScratch`.
    here
        [R] where robots are (Q_from).
    to
        [R] out: where they go next (Q_to). In: -1, or a vertex that is imposed on the robot.
    order
        [R] robots, the highest priority first.
    hindrance
        Whether ties are broken in favour of vertices that fewer neighbours want.
    rng
        Breaks the other ties.

    Returns
    -------
    bool
        False when the imposed vertices leave some robot without a move; `to` is then of no use.
    """
    now, reserved = scratch.now, scratch.next
    for i in range(len(here)):
        now[here[i]] = i
    valid = _impose(world, scratch, here, to)
    for i in order:
        if not valid:
            break
        if to[i] >= 0:
            continue
        led_away = scratch.onward[i] >= 0 and scratch.onward[i] != here[i]
        if here[i] == world.goal[i] and reserved[here[i]] < 0 and not led_away:  # at its goal and not pushed: it stays
            to[i] = here[i]
            reserved[here[i]] = i
        else:
            valid = _pibt(world, scratch, here, to, i, hindrance, rng)
    for i in range(len(here)):
        now[here[i]] = -1
        reserved[here[i]] = -1
        if to[i] >= 0:
            reserved[to[i]] = -1
        if world.near and scratch.wish[i] >= 0:
            _wish(world, scratch, scratch.wish[i], -1)
            scratch.wish[i] = -1
    return valid


@kernel(allocates=False)
def _pibt(world, scratch, here, to, root, hindrance, rng):
    """Find a next vertex for `root`, and for whoever it pushes (the function PIBT). False when `root` cannot even stay."""
    now, reserved, stack, choice = scratch.now, scratch.next, scratch.stack, scratch.choice
    depth = 0
    stack[0] = root
    sort_candidates(world, scratch, here, to, root, hindrance, rng)
    while depth >= 0:
        i = stack[depth]  # (a_i)
        while choice[i] < scratch.num[i] and _refused(world, scratch, here, to, i, scratch.candidate[i, choice[i]]):
            choice[i] += 1
        if choice[i] == scratch.num[i]:  # i stays (invalid); backtracking: who pushed it tries its next candidate
            reserved[here[i]] = i
            to[i] = here[i]
            depth -= 1
            if depth >= 0:
                choice[stack[depth]] += 1
            continue
        v = scratch.candidate[i, choice[i]]
        if world.near:
            k = _too_close(world, scratch, here, to, i, v)
            if k >= 0:
                if not _wait_all(scratch, here, to, depth):
                    choice[i] += 1
                    continue
                if scratch.wish[i] >= 0:
                    _wish(world, scratch, scratch.wish[i], -1)
                scratch.wish[i] = move_of(world.first, world.head, here[i], v)
                _wish(world, scratch, scratch.wish[i], i)
                reserved[here[k]] = i  # k may not stay
                depth += 1
                stack[depth] = k
                sort_candidates(world, scratch, here, to, k, hindrance, rng)
                continue
        reserved[v] = i
        to[i] = v
        k = now[v]  # (a_k) who stands there
        if world.following and k >= 0 and k != i:  # i waits; k may not stay, since v is reserved
            reserved[here[i]] = i
            to[i] = here[i]
        if k >= 0 and k != i and to[k] < 0:  # priority inheritance
            depth += 1
            stack[depth] = k
            sort_candidates(world, scratch, here, to, k, hindrance, rng)
            continue
        for d in range(depth, -1, -1):  # (valid) all on the stack move
            _pull_partner(world, scratch, here, to, stack[d])
        return True
    return False


@kernel(allocates=False)
def _pull_partner(world, scratch, here, to, i):
    """Have the robot that i swaps with follow at once, so that the two can turn round at the fork ahead."""
    p = scratch.partner[i]
    if p < 0 or to[p] >= 0 or scratch.choice[i] > 0 or world.following:
        return
    if world.near and _too_close(world, scratch, here, to, p, here[i]) != NOBODY:
        return
    if not _refused(world, scratch, here, to, p, here[i]):
        scratch.next[here[i]] = p
        to[p] = here[i]


@kernel(allocates=False)
def _impose(world, scratch, here, to):
    """Reserve the vertices that are imposed on robots. False when they collide."""
    for i in range(len(here)):
        u = to[i]
        if u < 0:
            continue
        if _refused(world, scratch, here, to, i, u) or (world.following and scratch.now[u] >= 0 and u != here[i]):
            return False
        if world.near and _too_close(world, scratch, here, to, i, u) >= 0:
            return False
        scratch.next[u] = i
    return True


@kernel(allocates=False)
def _refused(world, scratch, here, to, i, u):
    """Whether i may not go to u, given who has chosen already: taken, a swap, following, a ring or a clash."""
    if _taken(world, scratch, here, to, i, u):
        return True
    return world.near and u != here[i] and _too_close(world, scratch, here, to, i, u) == CHOSEN


@kernel(allocates=False)
def _taken(world, scratch, here, to, i, u):
    """`_refused` by the rules of MAPF."""
    if scratch.next[u] >= 0 and scratch.next[u] != i:
        return True
    j = scratch.now[u]
    if j < 0 or j == i:
        return False
    if world.following:
        return to[j] >= 0  # who has chosen has been pushed already
    if to[j] == here[i]:
        return True
    if world.rotations:
        return False
    for _ in range(len(here)):
        if j < 0 or to[j] < 0 or to[j] == here[j]:
            return False
        if to[j] == here[i]:
            return True
        j = scratch.now[to[j]]
    return False


@kernel(allocates=False)
def _too_close(world, scratch, here, to, i, u):
    """Who keeps i from going to u by being too close: NOBODY, robots that have CHOSEN, or else one that can be pushed away.

    Robots stay where they are without asking: whoever chose before kept away from them.
    """
    if u == here[i]:
        return NOBODY
    clashes, now, reserved = world.clashes, scratch.now, scratch.next
    move = move_of(world.first, world.head, here[i], u)
    if scratch.wished[u] >= 0 and scratch.wished[u] != i and scratch.wished[here[i]] < 0:
        return CHOSEN  # somebody with a higher priority waits until nobody is there
    standing = NOBODY
    for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
        w = clashes.vertex[k]
        j = now[w]
        if j >= 0 and j != i:
            if to[j] >= 0:
                return CHOSEN
            standing = j
        if reserved[w] >= 0 and reserved[w] != i:
            return CHOSEN
    for k in range(clashes.lane_first[move], clashes.lane_first[move + 1]):
        lane = clashes.lane[k]
        j = now[world.tail[lane]]
        if j >= 0 and j != i and to[j] == world.head[lane]:
            return CHOSEN
    return standing


@kernel(allocates=False)
def _wish(world, scratch, move, robot):
    """Let nobody come near a move for which a robot waits; -1 lifts that."""
    clashes = world.clashes
    scratch.wished[world.head[move]] = robot
    for k in range(clashes.vertex_first[move], clashes.vertex_first[move + 1]):
        scratch.wished[clashes.vertex[k]] = robot


@kernel(allocates=False)
def _wait_all(scratch, here, to, depth):
    """Let all on the stack stay for this step; False where somebody else is to come where the first of them stands."""
    first = scratch.stack[0]
    if scratch.next[here[first]] >= 0 and scratch.next[here[first]] != first:
        return False
    for d in range(depth + 1):
        robot = scratch.stack[d]
        scratch.next[here[robot]] = robot
        to[robot] = here[robot]
    return True


@kernel(allocates=False)
def run(world, scratch, local, path, begin, end, order, base_order, hindrance, rng):
    """PIBT over time: fill rows begin + 1 to end of `path` [T, R], or up to where all are at their goals.

    `order` [R] is the priorities at `begin` and is kept up to date: robots not yet at their goals in the order
    they have it in, those at their goals after them in `base_order`. Returns (last row filled, all at their goals).
    """
    for t in range(begin, end + 1):
        home = True
        for i in range(path.shape[1]):
            home = home and path[t, i] == world.goal[i]
        if home or t == end:
            return t, home
        if local.window > 0:
            guide_locally(world, scratch, local, path[t], order, rng)
        path[t + 1, :] = -1
        step(world, scratch, path[t], path[t + 1], order, hindrance, rng)
        reorder(world, path[t + 1], order, base_order, order)
    return end, False


@kernel(allocates=False)
def reorder(world, here, order, base_order, out):
    """Priorities after a step: elapsed time since a robot was last at its goal. `out` may be `order`."""
    k = 0
    for i in order:
        if here[i] != world.goal[i]:
            out[k] = i
            k += 1
    for i in base_order:
        if here[i] == world.goal[i]:
            out[k] = i
            k += 1
