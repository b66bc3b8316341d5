"""Another order at zones and mutex groups where the plan's cannot be kept: planners know no zones, so their order is ours.

Vertices keep the plan's order. A robot that stays in a zone for ever comes last there, one that begins in it first.
Where visits wait for each other in a circle, the order of every two passages of the zones among them is decided again:
first the pairs for which only one order is free of circles, then, one after the other, the plan's order of the pair
planned first, and what follows from it. This is greedy: orders that it does not find exist. Leaves the schedule as it
is where that would be too much work.
"""

from collections import defaultdict

import numpy as np

from mrp_sumo.core.digraph import strong_components
from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.plan import Plan
from mrp_sumo.traffic.passages import Schedule, permuted, waiting_arcs

MOST_PAIRS = 2000  # of passages in zones with a circle
MOST_STEPS = 10_000_000  # pairs times visits


def reordered(plan: Plan, schedule: Schedule, num_vertices: int) -> Schedule:
    """A plan's schedule whose zones, resources from `num_vertices` on, let somebody else pass first, so that there are fewer circles.

    The same where nothing helps.
    """
    if len(schedule.first) - 1 <= num_vertices:
        return schedule
    resource = np.repeat(np.arange(len(schedule.first) - 1), np.diff(schedule.first))  # [E]
    zone = resource >= num_vertices
    held = plan.arrive_s[schedule.visit] <= plan.arrive_s.min()  # from the beginning
    stays = zone & (schedule.left_at == plan.num_visits) & ~held
    schedule = permuted(schedule, np.lexsort((np.arange(len(resource)), stays, resource)))
    source, target = waiting_arcs(plan, schedule)
    component = strong_components(plan.num_visits, source, target)
    in_circle = np.bincount(component)[component] > 1  # [N]
    leaves = np.minimum(schedule.left_at, plan.num_visits - 1)
    part = np.unique(resource[zone & (in_circle[schedule.visit] | in_circle[leaves])])
    undone = np.flatnonzero(np.isin(resource, part))
    pairs = _pairs(schedule, undone, resource)
    if not pairs or len(pairs) > MOST_PAIRS or len(pairs) * plan.num_visits > MOST_STEPS:
        return schedule
    first_goes = _decided(plan, schedule, pairs, _arcs(source, target, schedule, undone))
    rank = np.arange(len(resource))  # compared within a resource
    for q in part.tolist():
        block = undone[resource[undone] == q].tolist()
        wins = {e: sum(first_goes.get((e, o), not first_goes.get((o, e), o < e)) for o in block if o != e) for e in block}
        for place, e in enumerate(sorted(block, key=lambda e: (-wins[e], e))):
            rank[e] = place
    return permuted(schedule, np.lexsort((rank, resource)))


def _pairs(schedule: Schedule, undone: IntArray, resource: IntArray) -> list[tuple[int, int]]:
    """Passages of different robots at one resource."""
    pairs = []
    for q in np.unique(resource[undone]).tolist():
        block = undone[resource[undone] == q].tolist()
        pairs += [(a, b) for k, a in enumerate(block) for b in block[k + 1 :] if schedule.robot[a] != schedule.robot[b]]
        if len(pairs) > MOST_PAIRS:
            break
    return pairs


def _decided(plan: Plan, schedule: Schedule, pairs: list[tuple[int, int]], after: dict[int, list[int]]) -> dict[tuple[int, int], bool]:
    """Of each pair, whether the first goes first: an order without circles, as far as one was found."""
    visit, left = schedule.visit.tolist(), schedule.left_at.tolist()
    held = (plan.arrive_s[schedule.visit] <= plan.arrive_s.min()).tolist()

    def possible(a: int, b: int) -> bool:
        return left[a] < plan.num_visits and not held[b] and not _reaches(after, visit[b], left[a])

    decided: dict[tuple[int, int], bool] = {}
    undecided = sorted(pairs, key=lambda pair: (float(plan.arrive_s[visit[pair[0]]] + plan.arrive_s[visit[pair[1]]]), pair))
    while undecided:
        free = []
        for a, b in undecided:
            one, other = possible(a, b), possible(b, a)
            if not (one or other):
                return decided
            if one and other:
                free.append((a, b))
                continue
            decided[a, b] = one  # it may decide the next
            first, second = (a, b) if one else (b, a)
            after[left[first]].append(visit[second])
        if len(free) == len(undecided):
            a, b = free.pop(0)
            decided[a, b] = True
            after[left[a]].append(visit[b])
        undecided = free
    return decided


def _arcs(source: IntArray, target: IntArray, schedule: Schedule, undone: IntArray) -> dict[int, list[int]]:
    """Who waits for each visit, but for the waits at what is undone."""
    after: dict[int, list[int]] = defaultdict(list)
    for a, b in zip(source.tolist(), target.tolist()):
        after[a].append(b)
    follows = undone[1:][(np.diff(undone) == 1) & (schedule.robot[undone[1:]] != schedule.robot[undone[:-1]])]
    starts = set(schedule.first.tolist())
    for e in follows.tolist():
        left = int(schedule.left_at[e - 1])
        if e not in starts and left in after:
            after[left].remove(int(schedule.visit[e]))
    return after


def _reaches(after: dict[int, list[int]], start: int, end: int) -> bool:
    stack, seen = [start], {start}
    while stack:
        at = stack.pop()
        if at == end:
            return True
        for other in after.get(at, ()):
            if other not in seen:
                seen.add(other)
                stack.append(other)
    return False
