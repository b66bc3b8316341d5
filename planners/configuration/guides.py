"""Guidance of robots beside their distances: ways of their own where lanes are little used, the traffic flow where they are much used, and
before each step local guidance."""

from time import process_time

import numpy as np

from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.problem import Problem
from mrp_sumo.planning.answers import check_time
from planners.configuration import _flow, _ways
from planners.configuration._flow import LaneFlow
from planners.configuration._local_guidance import DEAREST, LocalGuidance
from planners.configuration._pibt_instance import PibtInstance
from planners.configuration._ways import StepPaths

MOVES_A_LANE = 2.25  # along shortest ways, from which on there is no way past the others
MOST_MOVES = 10_000_000  # of all ways in all rounds; more take too much memory
GUIDE_CELLS = 40_000_000  # robots times vertices; guides by flow that are larger take too long
LONGEST_WAY = 4096  # lanes of a way that count in the flow
ENTRIES = 1024  # of a search for a path of local guidance
AT_ONCE = 64  # robots between looks at the clock


def are_thin(problem: Problem, steps: IntArray) -> bool:
    """True if robots that are `steps` [R] from their goals use lanes so little that each can have a way of its own.

    Not where they take more than every second vertex.
    """
    graph = problem.graph
    return bool(2 * problem.num_robots <= graph.num_vertices and steps.sum() < MOVES_A_LANE * graph.num_lanes)


def is_room_for_flow(problem: Problem) -> bool:
    """True if what is left to each goal from everywhere is found soon enough."""
    return problem.num_robots * problem.graph.num_vertices <= GUIDE_CELLS


def guide_of(problem: Problem, world: PibtInstance, ways: int, flow: int, deadline_s: float, rng: np.random.Generator) -> PibtInstance:
    """The instance with ways where robots are thin or there is no room for the flow, else with flow; as it was without room or time for it.

    `ways` and `flow` are rounds of giving ways of their own, and ways for the flow, 0 for none; `deadline_s` is on the clock of
    `process_time`, and half of the time until then is left to the search.
    """
    room_for_flow = is_room_for_flow(problem)
    few = ways * int(world.steps.sum()) < MOST_MOVES
    try:
        if ways and few and (are_thin(problem, world.steps) or not room_for_flow):
            return world._replace(path=own_ways(problem, ways, world, 0.5 * (process_time() + deadline_s), rng))
        if flow and room_for_flow:
            guide, toll = flow_guide(problem, flow, deadline_s, rng)
            return world._replace(guided=True, guide=guide, toll=toll)
    except TimeoutError:
        pass
    return world


def own_ways(problem: Problem, rounds: int, world: PibtInstance, deadline_s: float, rng: np.random.Generator) -> np.ndarray:
    """[R, N + 1] int32 a shortest way for each robot that meets few others, see `_ways`; TimeoutError when the deadline passes.

    All robots are given ways in one or more `rounds`; the order of robots, and the choice among equally good ways, are left to chance.
    """
    graph, num_robots, steps = problem.graph, problem.num_robots, world.steps
    num_held = rounds * int((2 * steps + 1).sum())  # what rounds before held stays in the table, by nobody
    slots = 1 << (2 * num_held).bit_length()
    ways = StepPaths(
        first=graph.first,
        head=graph.head,
        start=np.array(problem.start),
        goal=world.goal,
        steps=steps,
        table=world.table,
        packed=world.packed,
        code=world.compass.code,
        shared=world.shared,
        spot=world.spot,
        move=world.move,
        back=world.back,
        path=np.full((num_robots, int(steps.max()) + 1), -1, np.int32),
        held=np.zeros(slots, np.int64),
        held_from=np.full(len(world.spot_first) - 1, _ways.NEVER, np.int32),
        stamp=np.full(graph.num_vertices, -1, np.int64),
        step=np.empty(graph.num_vertices, np.int32),
        met=np.empty(graph.num_vertices, np.int32),
        before=np.empty(graph.num_vertices, np.int32),
        bucket=np.empty(_ways.MOST_MET + 1, np.int64),
        entry_vertex=np.empty(graph.num_lanes + 1, np.int32),
        entry_met=np.empty(graph.num_lanes + 1, np.int32),
        entry_next=np.empty(graph.num_lanes + 1, np.int64),
    )
    for n in range(rounds):
        order = rng.permutation(num_robots)
        for a in range(0, num_robots, AT_ONCE):
            check_time(deadline_s)
            _ways.give_ways(ways, order[a : a + AT_ONCE], n * num_robots + a, rng)
    return ways.path


def local_guidance(world: PibtInstance, window: int) -> LocalGuidance:
    """Local guidance by paths of so many steps, none of which is there yet; 0 for no guidance."""
    num_slots, sizes = 1 << (window + 1).bit_length(), (world.goal, world.spot, world.spot_first, world.spot_head)
    num_robots, num_vertices, num_spots, num_moves = (len(each) if window else 1 for each in sizes)
    return LocalGuidance(
        window=window,
        path=np.full((num_robots, num_slots), -1, np.int32),
        num_at=np.zeros((num_slots, num_spots), np.uint8),
        num_on=np.zeros((num_slots, num_moves), np.uint8),
        seen=np.zeros((num_slots, num_vertices), np.int32),
        entry=np.empty((ENTRIES, 4), np.int32),
        bucket=np.full(DEAREST + 1, -1, np.int64),
        count=np.zeros(3, np.int64),
    )


def flow_guide(problem: Problem, rounds: int, deadline_s: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """[R, V] int32 what is left to each goal and [L] int64 what lanes cost, see `_flow`; TimeoutError when the deadline passes.

    All robots are given ways in one or more `rounds`, in an order left to chance.
    """
    num_robots = problem.num_robots
    flow = _flow_of(problem, num_robots)
    at_once = max(1, 200_000 // problem.graph.num_vertices)
    for _ in range(rounds):
        order = rng.permutation(num_robots)
        for a in range(0, num_robots, at_once):
            check_time(deadline_s)
            _flow.give_ways(flow, order[a : a + at_once])
    return _guide_by(flow, deadline_s), flow.cost


def traffic_guide(problem: Problem, toll: IntArray, deadline_s: float) -> np.ndarray:
    """[R, V] int32 what is left to each goal where lanes cost `toll` [L]; TimeoutError when the deadline passes."""
    return _guide_by(_flow_of(problem, 0)._replace(cost=toll), deadline_s)


def _flow_of(problem: Problem, num_ways: int) -> LaneFlow:
    """No flow yet, with room for so many ways."""
    graph = problem.graph
    num_lanes, num_vertices = graph.num_lanes, graph.num_vertices
    return LaneFlow(
        first=graph.first,
        head=graph.head,
        reverse=graph.reverse,
        first_in=np.concatenate(([0], np.cumsum(np.bincount(graph.head, minlength=num_vertices)))),
        entering=np.argsort(graph.head, kind="stable"),
        tail=graph.tail,
        start=np.array(problem.start),
        goal=np.array(problem.target),
        cost=np.full(num_lanes, _flow.STEP, np.int64),
        num=np.zeros(num_lanes, np.int64),
        path_lanes=np.empty((num_ways, min(num_vertices, LONGEST_WAY)), np.int32),
        length=np.zeros(num_ways, np.int64),
        bucket=np.empty(_flow.MOST + 1, np.int64),
        entry_vertex=np.empty(num_lanes + 1, np.int64),
        entry_next=np.empty(num_lanes + 1, np.int64),
        left=np.empty(num_vertices, np.int32),
    )


def _guide_by(flow: LaneFlow, deadline_s: float) -> np.ndarray:
    num_robots, num_vertices = len(flow.goal), len(flow.left)
    guide = np.empty((num_robots, num_vertices), np.int32)
    at_once = max(1, 200_000 // num_vertices)
    for a in range(0, num_robots, at_once):
        check_time(deadline_s)
        _flow.write_guide(flow, guide, a, min(a + at_once, num_robots))
    return guide
