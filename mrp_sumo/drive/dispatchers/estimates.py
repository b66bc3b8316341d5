"""Knowledge and estimates of dispatchers: tasks that can be given, robots that can take them, and how long each would be.

Times are steps along shortest ways, each the planned time of a step, and service times: others on the way cost nothing.
"""

from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mrp_sumo.core.digraph import weak_components
from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.task import Task
from mrp_sumo.drive.crew import Crew
from mrp_sumo.drive.robot_work import NONE, RobotWork
from mrp_sumo.drive.surroundings import Surroundings
from mrp_sumo.search.distance import UNREACHABLE, distances

FAR_S = 1e7  # of what cannot be reached
LATER = 1.5  # robots at work are done so much later than if nobody were on their way, to be on the safe side
LESS_URGENT_S = 1e5  # what a task counts later for each more urgent priority that others have
IN_LINE = 4  # robots in line at each place, beside those that the place keeps on their way
EXCHANGE_STEPS = 4  # for which a place is empty between two robots


@dataclass(frozen=True, eq=False)
class Choice:
    """K orders that can be given to R robots."""

    task: Sequence[int]  # [K]
    holder: Mapping[int, int]  # robots that are on their way to the first stop of a task, by the task
    able: IntArray  # robots that can be given one of them now, ascending
    pick_up_s: FloatArray  # [R, K] until each robot would be at each task's first stop, when it has done what it has
    ready_s: FloatArray  # [R] until then, without the way there
    rest_s: FloatArray  # [K] from a task's first stop to its end, the services included
    between_s: FloatArray  # [K] mean from the ends of these tasks to the task's first stop
    later_s: FloatArray  # [K] more for tasks that are less urgent than others
    typed: bool  # whether some are not for every robot


def choice(now_s: float, context: Surroundings, most: int, *, reassign: bool, busy: bool = False) -> Choice:
    """At most so many tasks, and the robots, that can be decided on now, the most urgent first; those of one priority together.

    With `reassign`, tasks may be given to others until their first stops are made. With `busy`, robots at work count from when they will be
    done; `FAR_S` otherwise.
    """
    crew = context.crew
    num_robots, at = len(crew.robots), context.start.copy()
    holder = crew.holder if reassign else {}
    able = np.array(sorted({*free(context), *holder.values()}), np.int64)
    ready_s = np.zeros(num_robots)
    for r in sorted(set(range(num_robots)) - set(able.tolist())):
        ready_s[r] = FAR_S
        if busy and crew.robots[r].task >= 0:  # else it is lost
            remaining_s, at[r] = _remaining(now_s, context, r)
            ready_s[r] = LATER * remaining_s
    waiting = sorted([*holder, *to_give(context)], key=lambda k: (-crew.tasks[k].priority, k))
    typed = any(crew.some_cannot(k) for k in waiting)  # then those left out might be all that some robot can do
    if len(waiting) > most and not typed:
        waiting = [k for k in waiting if crew.tasks[k].priority >= crew.tasks[waiting[most]].priority]
    pick_up_s = np.minimum(ready_s[:, None] + steps_of(context, at, waiting) * context.ledger.problem.step_s, FAR_S)
    priority = np.array([crew.tasks[k].priority for k in waiting], np.int64)
    later_s: FloatArray = np.multiply(np.unique(-priority, return_inverse=True)[1].reshape(-1), LESS_URGENT_S, dtype=np.float64)
    step_s, ends = context.ledger.problem.step_s, np.array([crew.tasks[k].stops[-1].places[0] for k in waiting], np.int64)
    place, times = np.unique(ends, return_counts=True)  # thousands of tasks may wait, with few places
    between_s = times @ steps_to(context, place, waiting) / max(len(waiting), 1) * step_s
    rest_s = np.array([task_s(context, crew.tasks[k]) for k in waiting], np.float64)
    return Choice(waiting, holder, able, pick_up_s, ready_s, rest_s, between_s, later_s, typed)


def free(context: Surroundings) -> list[int]:
    """Robots without a task, ascending; of enough for all orders not those that others who charge or are broken shut in."""
    crew, graph, at, idle = context.crew, context.graph, context.start, context.crew.free
    closed = np.zeros(graph.num_vertices, np.bool_)
    closed[[at[robot.number] for robot in crew.robots if robot.is_down or (robot.is_charging and not robot.leaves)]] = True
    waiting = crew.unassigned if closed.any() else ()
    if not waiting or any(crew.some_cannot(task) for task in waiting):
        return idle
    leads = ~(closed[graph.tail] | closed[graph.head])
    piece = weak_components(graph.num_vertices, graph.tail[leads], graph.head[leads])
    places = np.array(sorted({v for task in waiting for v in crew.tasks[task].stops[0].places}), np.int64)
    taken = places[closed[places]]  # to which robots come as near as they can
    near = graph.tail[np.isin(graph.head, taken)], graph.head[np.isin(graph.tail, taken)]
    able = [r for r, leads_there in zip(idle, np.isin(piece[at[idle]], piece[np.concatenate([places, *near])]).tolist()) if leads_there]
    return able if len(able) >= len(waiting) else idle


def to_give(context: Surroundings) -> Sequence[int]:
    """Orders that no robot has and that may be given now: the most urgent first, then the oldest.

    Others are held back, since robots for which their stations have no use would crowd the ways to them: enough are bound for one already.
    Those are as many as come one after the other while one drives there, and a few in line.
    """
    crew, waiting, idle = context.crew, context.crew.unassigned, context.crew.free
    if len(crew.robots) <= IN_LINE:
        return waiting
    bound = Counter(places for robot in crew.robots if not robot.charges for places in _bound_for(crew, robot))
    admitted = []
    for task in waiting:
        stops = crew.tasks[task].stops
        full = (nth for nth, stop in enumerate(stops) if bound[stop.places] >= IN_LINE * len(stop.places))
        if not any(bound[stops[nth].places] >= _useful(context, task, nth) for nth in full):
            admitted.append(task)
            if not crew.some_cannot(task) or any(crew.can_do(r, task) for r in idle):  # others wait for robots of their own
                bound.update({stop.places for stop in stops})
    return admitted


def _bound_for(crew: Crew, robot: RobotWork) -> set[tuple[int, ...]]:
    ahead = [*robot.tour, *(crew.stops_of(robot.then) if robot.then != NONE else ())]
    return {crew.tasks[task].stops[nth].places for task, nth in ahead}


def _useful(context: Surroundings, task: int, nth: int) -> float:
    """How many robots keep the places of a stop at work: in line there, or on their way from where robots are by the stops before."""
    steps, step_s, stops = distances(context.graph), context.ledger.problem.step_s, context.crew.tasks[task].stops
    first = steps.to(stops[0].places[0])[context.start]
    drive = float(first[first < UNREACHABLE].mean()) if (first < UNREACHABLE).any() else 0.0
    drive += sum(float(steps.to(b.places[0])[a.places[0]]) for a, b in pairwise(stops[: nth + 1]))
    before_s = drive * step_s + sum(stop.service_s for stop in stops[:nth])
    return len(stops[nth].places) * (IN_LINE + before_s / (stops[nth].service_s + EXCHANGE_STEPS * step_s))


def steps_to(context: Surroundings, at: IntArray, tasks: Sequence[int]) -> FloatArray:
    """[N, K] steps from vertices to the first stops of tasks; `FAR_S` where there is no way."""
    steps, least = distances(context.graph), np.empty((len(at), len(tasks)))
    for column, k in enumerate(tasks):
        least[:, column] = np.minimum.reduce([steps.to(v)[at] for v in context.crew.tasks[k].stops[0].places])
    return np.where(least < UNREACHABLE, least, FAR_S)


def steps_of(context: Surroundings, at: IntArray, tasks: Sequence[int]) -> FloatArray:
    """[R, K] steps of robots from where they are, or will be, to the first stops of tasks; `FAR_S` for tasks that they cannot do."""
    least, crew = steps_to(context, at, tasks), context.crew
    for column, k in enumerate(tasks):
        if crew.some_cannot(k):
            least[[not crew.can_do(r, k) for r in range(len(at))], column] = FAR_S
    return least


def task_s(context: Surroundings, task: Task) -> float:
    """Time in s from the beginning of a task's first service to the end of its last."""
    place = task.stops[0].places[0]
    return task.stops[0].service_s + _onward(context, place, task, 1)[0]


def held(cost_s: FloatArray, options: Choice, context: Surroundings) -> None:
    """Of equals the robot that is on its way: tasks cost their holders a step less, in place [R, ..., K]."""
    for column, task in enumerate(options.task):
        if task in options.holder:
            cost_s[options.holder[task], ..., column] -= context.ledger.problem.step_s


def oldest_first(assigned: Mapping[int, int], context: Surroundings) -> dict[int, int]:
    """The assignment less what robots have already, with the oldest of tasks that are alike.

    Those are of the same stops, priority, robot and type of robot, and of no longer service.
    """
    crew, waiting = context.crew, dict[Hashable, list[int]]()
    passed_on = [task for task, r in crew.holder.items() if r in assigned]
    for k in sorted({*crew.unassigned, *assigned.values(), *passed_on}) if assigned else ():
        waiting.setdefault(_kind(crew.tasks[k]), []).append(k)
    oldest = {}
    for r, task in sorted(assigned.items(), key=lambda pair: pair[1]):
        alike, lasts_s = waiting[_kind(crew.tasks[task])], _service_s(crew.tasks[task])
        oldest[r] = next(k for k in alike if _service_s(crew.tasks[k]) <= lasts_s)
        alike.remove(oldest[r])
    return {r: k for r, k in oldest.items() if crew.robots[r].task != k}


def _kind(task: Task) -> Hashable:
    """The same for tasks that cost robots the same ways."""
    return task.priority, task.robot, task.robot_type, task.load_kg, tuple(stop.places for stop in task.stops)


def _service_s(task: Task) -> float:
    return sum(stop.service_s for stop in task.stops)


def _remaining(now_s: float, context: Surroundings, robot: int) -> tuple[float, int]:
    """Time in s until a robot is done with its task, and where that is."""
    at, has = int(context.start[robot]), context.crew.robots[robot]
    task = context.crew.tasks[has.task]
    if has.making is None:
        return _onward(context, at, task, has.stop)
    onward_s, place = _onward(context, at, task, has.stop + 1)
    return has.making.end_s - now_s + onward_s, place


def _onward(context: Surroundings, at: int, task: Task, stop: int) -> tuple[float, int]:
    """Time in s from a vertex through the stops of a task from one on, and where that ends."""
    steps, step_s, total_s = distances(context.graph), context.ledger.problem.step_s, 0.0
    for each in task.stops[stop:]:
        away, place = min((int(steps.to(v)[at]), v) for v in each.places)
        total_s, at = total_s + min(away * step_s, FAR_S) + each.service_s, place
    return total_s, at
