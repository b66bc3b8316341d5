"""First paths of all robots, one after another past those before it, in space and time.

After MAPF-LNS2 (Li et al., AAAI 2022), whose paths cross others' where it has to be. What differs: robots with short ways plan first. One
that is at its goal to stay is then in the way of longer paths only, which go around it; with longer paths first it would have to
wait until the last of them has passed its goal. Where robots use the map thinly next to nobody collides, and paths are hardly longer than
shortest ones. Those that do collide are planned again, each alone, then in neighbourhoods.
"""

from time import process_time

import numpy as np

from planners.neighbourhood import _lns
from planners.neighbourhood._collisions import find_collisions
from planners.neighbourhood._traffic import RepairTask, path_of
from planners.neighbourhood.refinement import AT_ONCE, room_bytes, room_to_repair

SPARE = 64  # steps beyond the longest shortest way
MOST_LABELS = 1 << 19  # of a search; so few stay in the processor's cache on any map
LABELS_A_STEP = 64  # of shortest ways: where paths take more to find, the map is not used thinly
MOST_DETOUR = 0.1  # of shortest ways: where paths have longer ones, first solutions of LaCAM are as cheap
REPAIRS = 32  # times AT_ONCE neighbourhoods
SIZE = 8  # robots in a neighbourhood


def first_paths(
    task: RepairTask, rng: np.random.Generator, deadline_s: float, *, following: bool, rotations: bool, effort: int, memory_mb: int
) -> tuple[np.ndarray | None, int]:
    """[T, R] paths without collisions, None where they take too much work to find or are too long; and the labels that were made.

    Parameters
    ----------
    task
        The problem.
    rng
        Chance.
    deadline_s
        On the clock of `process_time`.
    following, rotations
        See `Traffic`.
    effort
        Labels that may be made, 0: as many as are worth it.
    memory_mb
        For tables.
    """
    horizon = int(task.least.max()) + SPARE
    if room_bytes(task, horizon, MOST_LABELS) + len(task.goal) ** 2 > memory_mb * 1_000_000:
        return None, 0
    most = LABELS_A_STEP * int(task.least.sum() + len(task.goal))
    most = min(most, effort) if effort else most
    traffic, labels, hood = room = room_to_repair(task, horizon, SIZE, following=following, rotations=rotations, most_labels=MOST_LABELS)
    order = rng.permutation(len(task.least))
    order = order[np.argsort(task.least[order], kind="stable")]  # those of one length in random order
    left = MOST_DETOUR * task.least.sum()
    for a, robot in enumerate(order.tolist()):
        if left < 0 or labels.stamp[1] > most or process_time() > deadline_s:
            return None, int(labels.stamp[1])
        if not _lns.plan_all(task, traffic, labels, order, a, a + 1, False):
            return None, int(labels.stamp[1])
        left -= traffic.end[robot] - task.least[robot]
    pairs = find_collisions(task, traffic, hood)
    if 0 < pairs <= len(order):
        _lns.repair_each(task, traffic, labels, hood, pairs, rng)
        pairs = find_collisions(task, traffic, hood)
    for _ in range(REPAIRS):
        if pairs == 0 or pairs > len(order) or labels.stamp[1] > most or process_time() > deadline_s:
            break
        pairs = _lns.repair(task, *room, SIZE, pairs, AT_ONCE, rng)
    done = pairs == 0 and traffic.end.sum() - task.least.sum() <= MOST_DETOUR * task.least.sum()
    return path_of(traffic) if done else None, int(labels.stamp[1])
