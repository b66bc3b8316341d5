"""Passages: which resources the visits of a plan need, and in which order robots pass each of them.

A resource is a vertex, or a zone where robots could touch without meeting at a vertex. `traffic.schedule` proves that an
order can be kept, `traffic.reorder` looks for another one.
"""

from dataclasses import dataclass, replace

import numpy as np

from mrp_sumo.core.graph import BoolArray, IntArray, frozen
from mrp_sumo.core.plan import Plan


@dataclass(frozen=True, eq=False)
class Needs:
    """The resources every visit of a plan needs, M in all; vertices are 0 to V - 1, zones follow.

    A robot holds them from before it sets out for the visit's vertex, and has left them when it arrives at
    the next visit's; those needed `on_lane` only, when it arrives at the visit's vertex itself.
    """

    first: IntArray  # [N + 1] CSR: visit k needs resource[first[k]:first[k + 1]]
    resource: IntArray  # [M]
    on_lane: BoolArray  # [M]
    num_resources: int

    @property
    def visit(self) -> IntArray:
        """[M] the visit of each need."""
        return np.repeat(np.arange(len(self.first) - 1), np.diff(self.first))


@dataclass(frozen=True, eq=False)
class Schedule:
    """The order of passages at Q resources, E passages in all, resource by resource, each in its order.

    A passage is a longest run of consecutive visits of one robot that need one resource, without a wait where it does not.
    """

    first: IntArray  # [Q + 1] CSR: passages of resource q are first[q]:first[q + 1], in order
    robot: IntArray  # [E]
    visit: IntArray  # [E] the passage's first visit
    last_visit: IntArray  # [E] and last
    left_at: IntArray  # [E] the visit at whose arrival the resource has been left, N where that is never
    passage_of_need: IntArray  # [M]

    @property
    def num_passages(self) -> int:
        return len(self.robot)


def vertex_needs(plan: Plan, num_vertices: int) -> Needs:
    """Every visit needs its vertex, nothing else."""
    return Needs(frozen(np.arange(plan.num_visits + 1)), plan.vertex, frozen(np.zeros(plan.num_visits, np.bool_)), num_vertices)


def order_of(plan: Plan, needs: Needs) -> Schedule:
    """The plan's order at every resource, whether or not it can be kept."""
    visit, resource, robot = needs.visit, needs.resource, plan.robot
    by_resource = np.lexsort((visit, resource))
    q, k = resource[by_resource], visit[by_resource]
    opens = np.ones(len(q), np.bool_)  # a need that continues no passage
    outside = needs.on_lane[by_resource[:-1]] & (plan.depart_s[k[:-1]] > plan.arrive_s[k[:-1]])  # it waits beside the resource
    opens[1:] = (q[1:] != q[:-1]) | (k[1:] != k[:-1] + 1) | (robot[k[1:]] != robot[k[:-1]]) | outside
    passage = np.cumsum(opens) - 1
    begin = np.flatnonzero(opens)
    end = np.append(begin[1:], len(q)) - 1 if len(q) else begin
    visit_of, last_of, resource_of = k[begin], k[end], q[begin]
    on_lane = needs.on_lane[by_resource[end]]
    ends = plan.first[1:] - 1
    never = ~on_lane & (ends[robot[last_of]] == last_of)
    left_at = np.where(never, plan.num_visits, last_of + ~on_lane)
    # a zone is needed from setting out, and may have been left before the arrival; vertices are not
    sets_out_s = np.where(visit_of == plan.first[robot[visit_of]], -np.inf, plan.depart_s[np.maximum(visit_of - 1, 0)])
    enters_s = np.where(plan.vertex[visit_of] == resource_of, plan.arrive_s[visit_of], sets_out_s)
    order = np.lexsort((robot[visit_of], plan.depart_s[last_of], plan.arrive_s[visit_of], enters_s, resource_of))
    rank = np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    passage_of_need = np.empty(len(q), np.int64)
    passage_of_need[by_resource] = rank[passage]
    return Schedule(
        first=frozen(np.searchsorted(resource_of[order], np.arange(needs.num_resources + 1)).astype(np.int64)),
        robot=frozen(robot[visit_of[order]]),
        visit=frozen(visit_of[order]),
        last_visit=frozen(last_of[order]),
        left_at=frozen(left_at[order]),
        passage_of_need=frozen(passage_of_need),
    )


def joined(schedule: Schedule) -> Schedule:
    """The schedule with one passage where a robot makes two at consecutive visits, and nobody passes between them.

    It waits beside the resource then and would have to stop there, since its turn comes when the first passage has ended.
    """
    begins = np.ones(schedule.num_passages, np.bool_)
    begins[1:] = (schedule.robot[1:] != schedule.robot[:-1]) | (schedule.visit[1:] != schedule.last_visit[:-1] + 1)
    begins[schedule.first[:-1][np.diff(schedule.first) > 0]] = True
    ends = np.roll(begins, -1)
    number = np.append(0, np.cumsum(begins))
    return Schedule(
        first=frozen(number[schedule.first]),
        robot=frozen(schedule.robot[begins]),
        visit=frozen(schedule.visit[begins]),
        last_visit=frozen(schedule.last_visit[ends]),
        left_at=frozen(schedule.left_at[ends]),
        passage_of_need=frozen(number[schedule.passage_of_need + 1] - 1),
    )


def in_places(schedule: Schedule, place: IntArray) -> Schedule:
    """The schedule in another order: place [M] of each need among all, equal for the needs of one passage."""
    resource = np.repeat(np.arange(len(schedule.first) - 1), np.diff(schedule.first))
    of_passage = np.empty(schedule.num_passages, np.int64)
    of_passage[schedule.passage_of_need] = place
    return permuted(schedule, np.lexsort((of_passage, resource)))


def permuted(schedule: Schedule, order: IntArray) -> Schedule:
    """The schedule with its passages in another order [E]; resources keep theirs."""
    place = np.empty(len(order), np.int64)
    place[order] = np.arange(len(order))
    columns = {name: frozen(getattr(schedule, name)[order]) for name in ("robot", "visit", "last_visit", "left_at")}
    return replace(schedule, **columns, passage_of_need=frozen(place[schedule.passage_of_need]))


def waiting_arcs(plan: Plan, schedule: Schedule) -> tuple[IntArray, IntArray]:
    """Arcs between visits: the second of each waits for the first. See `waiting_cycle`."""
    after, left_at = waits(schedule)
    ever = left_at < plan.num_visits
    along = np.ones(plan.num_visits, np.bool_)
    along[plan.first[1:] - 1] = False
    source = np.concatenate([np.flatnonzero(along), left_at[ever]])
    target = np.concatenate([np.flatnonzero(along) + 1, schedule.visit[after][ever]])
    return source, target


def waits(schedule: Schedule) -> tuple[IntArray, IntArray]:
    """Passages that are directly after another robot's, and the visit at whose arrival that one has left."""
    follows = np.ones(schedule.num_passages, np.bool_)
    follows[schedule.first[:-1][np.diff(schedule.first) > 0]] = False
    after = np.flatnonzero(follows)
    after = after[schedule.robot[after] != schedule.robot[after - 1]]
    return after, schedule.left_at[after - 1]
