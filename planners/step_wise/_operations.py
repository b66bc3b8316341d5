"""Kernels of PIBT over operations: in each step, every robot chooses a few actions, and carries out the first.

All robots always hold operations that do not collide: at first those of the step before, moved up by one and ended by waiting. In
order of priority, each one takes the best operation that collides with nobody, or with one robot that can take another operation
itself, pushing at most one more, and so on; with backtracking. Then, for a counted number of tries, a robot that is drawn changes
its operation, and pushes others, where the costs of all fall by it; those of who chose early count most. The recursion is a stack,
since a compiled recursive function cannot be stored.
"""

from typing import NamedTuple

import numpy as np

from mrp_sumo.search._kernel import kernel

NOBODY, MANY = -1, -2
LATE = 16  # how many times more what is left after an operation counts than what is left during it


class CrowdStep(NamedTuple):
    """All robots in a step: R robots, O operations of D actions, S states, C cells."""

    ahead: np.ndarray  # [S] int32, the cell ahead of a state, or -1
    action: np.ndarray  # [O, D] int8
    state: np.ndarray  # [R] int32, now
    path: np.ndarray  # [R, O, D + 1] int32, cells
    cost: np.ndarray  # [R, O] int32
    order: np.ndarray  # [R, O] int16, operations that can be done, the cheapest first
    num: np.ndarray  # [R] int64, of them
    chosen: np.ndarray  # [R] int16
    used: np.ndarray  # [D + 1, C] int32, which robot is where, or -1
    visits: np.ndarray  # [R] int64, scratch: 0 between calls, as `on_stack`
    on_stack: np.ndarray  # [R] int8
    touched: np.ndarray  # [R] int32, scratch
    stack: np.ndarray  # [R] int32, scratch: who pushes whom
    choice: np.ndarray  # [R] int64, scratch: position in the order, for each robot on the stack
    before: np.ndarray  # [R] int16, scratch: what it had chosen
    moved_up: np.ndarray  # [O] int16, what is left of each operation after a step
    fixed: np.ndarray  # [R] bool, scratch: robots that may not be pushed
    weight: np.ndarray  # [R] int64, of a robot's cost among those of all
    surprised: np.ndarray  # [R] bool, robots whose state is not the one that they chose
    straight: bool  # whether a robot follows another one only straight ahead


@kernel
def appraise(crowd, table, slot, goal, onward):
    """Cost and order of all operations of all robots.

    Parameters
    ----------
    crowd
        `state` is read; `path`, `cost`, `order` and `num` are written.
    table
        [slots, S] steps to goals.
    slot
        [R, 2] the tables of a robot's next goal and of the one after; -1 for none.
    goal
        [R] the next goal, a cell; -1 for none.
    onward
        [R] steps from the next goal to the one after.
    """
    for r in range(len(crowd.state)):
        n = 0
        for o in range(len(crowd.action)):
            cost = _cost(crowd, table, slot[r], goal[r], onward[r], r, o)
            if cost < 0:
                continue
            crowd.cost[r, o] = cost
            k = n
            while k > 0 and crowd.cost[r, crowd.order[r, k - 1]] > cost:
                crowd.order[r, k] = crowd.order[r, k - 1]
                k -= 1
            crowd.order[r, k] = o
            n += 1
        crowd.num[r] = n


@kernel
def _cost(crowd, table, slots, goal, onward, r, o):
    """The steps left after an operation, and a little for those left during it; -1 where it cannot be done. Writes its path."""
    depth, slot, next_slot = crowd.action.shape[1], slots[0], slots[1]
    state = crowd.state[r]
    crowd.path[r, o, 0] = state >> 2
    left, late, reached = 0, 0, False
    for d in range(depth):
        a = crowd.action[o, d]
        if a == 0:
            cell = crowd.ahead[state]
            if cell < 0:
                return -1
            state = 4 * cell + (state & 3)
        elif a < 3:
            state = (state & ~3) | ((state + 2 * a - 1) & 3)
        crowd.path[r, o, d + 1] = state >> 2
        if slot < 0:
            left = 1 if state != crowd.state[r] else 0  # nothing to do: better not to move
        else:
            reached = reached or state >> 2 == goal
            if not reached:
                left = table[slot, state] + onward
            elif next_slot >= 0:
                left = table[next_slot, state]
            else:
                left = 0
        late += left
    return LATE * depth * left + late


@kernel(allocates=True)
def plan_step(crowd, priority, limit, most_visits, num_tries, try_limit, rng):
    """Choose an operation for each robot; `crowd` is appraised.

    Parameters
    ----------
    priority
        [R] robots, the first first.
    limit
        [R] how many operations are looked at when a robot chooses.
    most_visits
        See `_push`.
    num_tries
        How many times a robot is drawn that may change its operation where all gain by it.
    try_limit
        How many operations are looked at in each of these.
    rng
        Draws.
    """
    num_robots, fixed = len(crowd.state), crowd.fixed
    _inherit(crowd)
    fixed[:] = False
    for r in priority:
        _push(crowd, r, False, limit[r], most_visits)
        fixed[r] = True
    fixed[:] = False
    for _ in range(num_tries):
        _push(crowd, rng.integers(0, num_robots), True, try_limit, most_visits)


@kernel
def _inherit(crowd):
    """Have robots hold what is left of their operations; who is surprised waits, and so does who would collide with one that waits."""
    num_robots = len(crowd.state)
    for r in range(num_robots):
        crowd.chosen[r] = 0 if crowd.surprised[r] else crowd.moved_up[crowd.chosen[r]]
    apart = False
    while not apart:
        apart = True
        crowd.used[:] = -1
        for r in range(num_robots):
            crowd.used[0, crowd.state[r] >> 2] = r
            if crowd.surprised[r]:
                _occupy(crowd, r, 0)
        for r in range(num_robots):
            if crowd.surprised[r]:
                continue
            if _in_the_way(crowd, r, crowd.chosen[r]) == NOBODY:
                _occupy(crowd, r, crowd.chosen[r])
            else:
                crowd.surprised[r], crowd.chosen[r], apart = True, 0, False


@kernel
def _push(crowd, root, all_gain, limit, most_visits):
    """Have `root` take the best operation that it can, if it is not worse than what it has, and others make way.

    Parameters
    ----------
    all_gain
        Whether the costs of all together, by their weights, have to fall.
    limit
        How many operations are looked at.
    most_visits
        How often one robot may be pushed.
    """
    stack, choice, before = crowd.stack, crowd.choice, crowd.before
    if crowd.order[root, 0] == crowd.chosen[root]:
        return
    depth, looks, touched, gained, done = 0, 0, 0, 0, False
    stack[0], choice[0], before[0] = root, 0, crowd.chosen[root]
    _vacate(crowd, root)
    crowd.on_stack[root] = 1
    while depth >= 0 and not done:
        r = stack[depth]
        pushed = NOBODY
        while choice[depth] < crowd.num[r] and looks < limit:
            o = crowd.order[r, choice[depth]]
            change = crowd.weight[r] * (crowd.cost[r, o] - crowd.cost[r, before[depth]])
            if depth == 0 and o == before[0]:  # the rest is no better for the root; what is as good ends stand-offs
                choice[0] = crowd.num[r]
                break
            looks += 1
            j = _in_the_way(crowd, r, o)
            if j == NOBODY:
                if not all_gain or gained + change < 0:
                    done = True
                    break
            elif j >= 0 and not crowd.on_stack[j] and not crowd.fixed[j] and crowd.visits[j] < most_visits:
                pushed = j
                break
            choice[depth] += 1
        if done:
            _occupy(crowd, r, crowd.order[r, choice[depth]])
        elif pushed >= 0:  # it inherits the priority
            o = crowd.order[r, choice[depth]]
            gained += crowd.weight[r] * (crowd.cost[r, o] - crowd.cost[r, before[depth]])
            _vacate(crowd, pushed)
            _occupy(crowd, r, o)
            if crowd.visits[pushed] == 0:
                crowd.touched[touched] = pushed
                touched += 1
            crowd.visits[pushed] += 1
            crowd.on_stack[pushed] = 1
            depth += 1
            stack[depth], choice[depth], before[depth] = pushed, 0, crowd.chosen[pushed]
        else:  # r finds nothing: who pushed it looks on
            crowd.on_stack[r] = 0
            depth -= 1
            if depth >= 0:
                pusher = stack[depth]
                gained -= crowd.weight[pusher] * (crowd.cost[pusher, crowd.chosen[pusher]] - crowd.cost[pusher, before[depth]])
                _vacate(crowd, pusher)
                choice[depth] += 1
            _occupy(crowd, r, before[depth + 1])
    for k in range(depth + 1):
        crowd.on_stack[stack[k]] = 0
    for k in range(touched):
        crowd.visits[crowd.touched[k]] = 0


@kernel
def _occupy(crowd, r, o):
    """Take the cells of an operation."""
    crowd.chosen[r] = o
    for d in range(1, crowd.path.shape[2]):
        crowd.used[d, crowd.path[r, o, d]] = r


@kernel
def _vacate(crowd, r):
    """Give the cells of the chosen operation back."""
    for d in range(1, crowd.path.shape[2]):
        crowd.used[d, crowd.path[r, crowd.chosen[r], d]] = -1


@kernel
def _in_the_way(crowd, r, o):
    """The one robot that an operation collides with, NOBODY or MANY."""
    rival = NOBODY
    cell = crowd.path[r, o, 0]
    for d in range(1, crowd.path.shape[2]):
        before = cell
        cell = crowd.path[r, o, d]
        j = crowd.used[d, cell]
        if j >= 0 and j != rival:
            if rival >= 0:
                return MANY
            rival = j
        if before != cell:
            j = crowd.used[d, before]
            if j >= 0 and j != rival and crowd.used[d - 1, cell] == j:
                if rival >= 0:
                    return MANY
                rival = j
    return _round_a_corner(crowd.ahead, crowd.used, crowd.path[r, o], r, rival) if crowd.straight else rival


@kernel
def _round_a_corner(ahead, used, path, r, rival):
    """The same, with who follows a robot or is followed by it not straight ahead."""
    for d in range(1, len(path)):
        before, cell = path[d - 1], path[d]
        if before == cell:
            continue
        j = used[d, before]
        if j >= 0 and j != rival and not _follows(ahead, used, j, d, cell, before):
            if rival >= 0:
                return MANY
            rival = j
        j = used[d - 1, cell]
        if j >= 0 and j != r and j != rival and not _follows(ahead, used, j, d, before, cell):
            if rival >= 0:
                return MANY
            rival = j
    return rival


@kernel
def _follows(ahead, used, j, d, one, other):
    """Whether the step between two cells, continued beyond the other, is the one that robot j makes, from it or to it, at depth d."""
    for heading in range(4):
        if ahead[4 * one + heading] == other:
            beyond = ahead[4 * other + heading]
            return beyond >= 0 and (used[d, beyond] == j or used[d - 1, beyond] == j)
    return False
