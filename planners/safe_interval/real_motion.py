"""The robots' real motion, for conflict-based and priority-based search: ways of `Timetable`, in conflict where two hold one resource."""

from collections.abc import Sequence
from time import process_time

import numpy as np

from mrp_sumo.core.graph import BoolArray, IntArray
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem
from mrp_sumo.planning.answers import used_up
from mrp_sumo.search._records import FOREVER
from planners.safe_interval._table import first_overlap, overlaps, settle
from planners.safe_interval.conflict_tree import OutOfTime, Split, TimedConflict, TimedTree
from planners.safe_interval.first_ways import first_ways
from planners.safe_interval.improvement import Improvement
from planners.safe_interval.priority_tree import branched_on
from planners.safe_interval.timetable import TimedPath, Timetable

Held = tuple[tuple[int, int], ...]  # (resource, step) that a robot may not hold

ORDERS = 16  # of robots that are tried
MOST_FIRST = 1_000_000  # entries in which first ways are looked for
NEIGHBOURHOOD, ENTRIES = 6, 1000  # see `continuous`
MOST_NODES = 100  # of a tree over two robots
MOST_OVERLAPS = 4096
MOST_BELOW = 200_000  # entries that a search in priority-based search looks at


class RealMotion:
    """A problem in the robots' own motion, with the ways that have been found in it."""

    nothing: Held = ()

    def __init__(self, problem: Problem, step_length_s: float, deadline_s: float) -> None:
        self.problem = problem
        self._timetable, self._deadline_s = Timetable(problem, step_length_s), deadline_s
        self._paths: list[TimedPath] = []
        self._found = np.zeros((MOST_OVERLAPS, 3), np.int64)

    def clash(self) -> str:
        """Robots that stand at their goals for ever in somebody's way there."""
        timetable, problem = self._timetable, self.problem
        for robot in range(timetable.num_robots):
            if process_time() > self._deadline_s:
                raise OutOfTime
            timetable.look_back(robot)
        for what, place in (("start", problem.start), ("have to end", problem.target)):
            holder: dict[int, int] = {}
            for robot, v in enumerate(place.tolist()):
                for resource in timetable.needed_at(robot, v).tolist():
                    other = holder.setdefault(resource, robot)
                    if other != robot:
                        names, label = problem.fleet.robot_name, problem.graph.label
                        both = f"'{label(int(place[other]))}' and '{label(v)}'"
                        return f"{names[other]} and {names[robot]} {what} at {both}, which are too close to each other"
        return ""

    def search(self, robot: int, forbidden: Held) -> int | None:
        """The earliest way of a robot. OutOfTime is raised when the problem's effort is used up."""
        if used_up(self.problem, self._timetable.work):
            raise OutOfTime
        resource, step = (np.array([place[k] for place in forbidden], np.int64) for k in range(2))
        path = self._timetable.search_without(robot, resource, step, step + 1)
        if path is None:
            return None
        self._paths.append(path)
        return len(self._paths) - 1

    def cost_s(self, path: int) -> float:
        """Time at which the robot stands at its goal."""
        return self._paths[path].steps * self._timetable.dt

    def conflicts(self, robot: int, path: int, others: Sequence[int], their_paths: Sequence[int]) -> list[TimedConflict]:
        """The first and the longest overlap with each other robot, of what both hold."""
        conflicts = []
        one = self._paths[path]
        for other, its in zip(others, their_paths):
            two = self._paths[its]
            num = overlaps(one.resource, one.begin, one.end, two.resource, two.begin, two.end, self._found)
            if num:
                resource, begin, end = self._found[:num].T
                chosen = {int(np.argmin(begin)), int(np.argmax(np.minimum(end, FOREVER - 1) - begin))}
                conflicts += [TimedConflict(robot, other, path, its, (int(resource[k]), int(end[k]) - 1)) for k in sorted(chosen)]
        return conflicts

    def splits(self, conflict: TimedConflict, ours: Held, theirs: Held) -> list[Split]:
        """Neither may hold the resource in the last step in which both do."""
        place = conflict.what[0], conflict.what[1]
        return [(((*ours, place), theirs), (ours, (*theirs, place)))]

    def least_cost_s(self, robot: int, other: int, ours: Held, theirs: Held) -> float:
        """Least cost of two robots that must not conflict, by a tree of their own."""
        tree = TimedTree(self, (robot, other), self._deadline_s, pairs=False)
        tree.best_first([ours, theirs], MOST_NODES)
        return tree.bound_s

    def some_paths(self, rng: np.random.Generator, enough_s: float, deadline_s: float) -> list[int] | None:
        """Ways without conflicts, not the best: those of `continuous`; None where efforts are bounded, for these are not."""
        if self.problem.effort:
            return None
        timetable = self._timetable
        by_length = np.argsort(timetable.alone, kind="stable")
        for k in range(ORDERS):
            order = by_length if k == 0 else rng.permutation(timetable.num_robots)
            if first_ways(timetable, order, (k + 1) * 2 * timetable.steps_of_a_lane, deadline_s, timetable.work + MOST_FIRST):
                break
        else:
            return None
        if timetable.steps.sum() * timetable.dt > enough_s and process_time() < deadline_s:
            Improvement(timetable, NEIGHBOURHOOD, rng).until(deadline_s, ENTRIES * timetable.num_robots)
        paths = [path for path in timetable.path if path is not None]
        self._paths += paths
        return list(range(len(self._paths) - len(paths), len(self._paths)))

    def plan(self, their_paths: Sequence[int]) -> Plan:
        """The robots' ways as timed visits."""
        self._timetable.clear()
        for robot, path in enumerate(their_paths):
            self._timetable.add(robot, self._paths[path])
        return self._timetable.plan()


class PrioritisedRuns:
    """A problem in the robots' own motion, for priority-based search; see `PriorityMotion`."""

    most_open = 1 << 30

    def __init__(self, problem: Problem, step_length_s: float) -> None:
        self._timetable = timetable = Timetable(problem, step_length_s)
        for robot in range(timetable.num_robots):
            timetable.look_back(robot)
        self.least_steps = float(np.maximum(timetable.alone - 1, 0).sum() * step_length_s / problem.step_s)  # arrivals are within a step

    def counters(self) -> dict[str, float]:
        return {"entries": float(self._timetable.work)}

    def alone(self) -> list[TimedPath]:
        return [self._timetable.ideal(robot) for robot in range(self._timetable.num_robots)]

    def branched(self, paths: list[TimedPath], above: BoolArray) -> list[tuple[BoolArray, list[TimedPath]]] | None:
        """For the two robots that hold one resource at once the earliest."""
        earliest, pair = FOREVER, None
        for i, one in enumerate(paths):
            for j in range(i + 1, len(paths)):
                other = paths[j]
                overlap = first_overlap(one.resource, one.begin, one.end, other.resource, other.begin, other.end)
                if overlap < earliest:
                    earliest, pair = overlap, (j, i)
        return None if pair is None else branched_on(pair, paths, above, self.replanned)

    def replanned(self, paths: list[TimedPath], above: BoolArray, robots: IntArray) -> list[TimedPath] | None:
        """See `branched_on`."""
        timetable, paths = self._timetable, list(paths)
        for robot in robots.tolist():
            timetable.clear()
            for other in np.flatnonzero(above[:, robot]).tolist():
                timetable.add(other, paths[other])
            settle(timetable.table)
            if len(timetable.hinders(robot, paths[robot])):
                path = timetable.search(robot, MOST_BELOW)
                if path is None:
                    return None
                paths[robot] = path
        return paths

    def cost(self, paths: list[TimedPath]) -> int:
        return sum(path.steps for path in paths)

    def plan(self, paths: list[TimedPath]) -> tuple[Plan, dict[str, float]]:
        timetable = self._timetable
        timetable.clear()
        for robot, path in enumerate(paths):
            timetable.add(robot, path)
        cost, bound = timetable.steps.sum(), timetable.alone.sum()
        return timetable.plan(), {"cost_s": float(cost * timetable.dt), "lower_bound_s": float(bound * timetable.dt)}
