"""Replies to requests: ways for some robots, from the last visits that they have been granted, which at first are their starts."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.plan import Plan


@dataclass(frozen=True, eq=False)
class Reroute:
    """The way of a robot from the last visit it has been granted, instead of on as it was to."""

    vertex: IntArray  # the visits that follow
    arrive_s: FloatArray
    depart_s: FloatArray  # inf for the last
    leave_s: float  # from the visit it has been granted; inf where nothing follows
    back: bool = False  # it stands on a lane and turns back there: `vertex` begins with the vertex behind it
    pause: int = -1  # after how many of these visits it lets others pass; -1: it does not


@dataclass(frozen=True, eq=False)
class Replan:
    """Other ways for some robots, all decided together."""

    reroute: Mapping[int, Reroute]
    reason: str  # 'plan', 'give_way', 'detour' or 'replan'
    text: str = ""  # for people
    reordered: bool = False  # whether a plan of all robots, which is driven in its own order if that can be kept
    ends: Mapping[int, int] = field(default_factory=dict)  # vertices where the tasks of these robots end from now on
    left_alone: frozenset[int] = field(default_factory=frozenset)  # robots that need nothing beyond what they have been granted
    planner: str = ""  # who planned it


def first_of(plan: Plan) -> Replan:
    """A plan for robots at their starts, as the first reply."""
    parts = [slice(a, b) for a, b in zip((plan.first[:-1] + 1).tolist(), plan.first[1:].tolist())]
    leave_s = plan.depart_s[plan.first[:-1]].tolist()
    ways = [Reroute(plan.vertex[part], plan.arrive_s[part], plan.depart_s[part], leaves) for part, leaves in zip(parts, leave_s)]
    return Replan(dict(enumerate(ways)), "plan")
