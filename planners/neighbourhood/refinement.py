"""Large neighbourhood search over the paths of a problem, driven by the clock or by the work done."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from time import process_time

import numpy as np

from mrp_sumo.core.problem import Problem
from mrp_sumo.search.distance import distances
from mrp_sumo.traffic.clashes import clashes_of
from planners.configuration._pibt_instance import PibtInstance
from planners.neighbourhood import _lns, _merging
from planners.neighbourhood._cells import is_sparse, slots_for
from planners.neighbourhood._collisions import find_collisions
from planners.neighbourhood._neighbourhoods import Neighbourhood, room_for_hood
from planners.neighbourhood._sipps import Labels, labels_for, room_for_labels
from planners.neighbourhood._traffic import WORD, RepairTask, Traffic, empty_traffic, path_of, traffic_of
from planners.world import MOVES_A_LANE, SLICE_S, small_problem

IN_WINDOWS = 6  # times less polishing
SPARE_STEPS = 8  # room beyond the longest path
FOREVER = 1 << 62
VERTICES_A_ROBOT = 5  # at least, where there is room for everybody
AT_ONCE = 16  # neighbourhoods between looks at the effort
MOST_AT_ONCE = 1 << 16  # neighbourhoods between looks at the clock
ROUND_LABELS = 1 << 14  # of a refiner between two times that threads bring together what they have gained, or more:
ROUND_LABELS_A_VERTEX = 1  # on large maps every search makes many
MOST_GAINS = 64  # neighbourhoods of a refiner in a round

Room = tuple[Traffic, Labels, Neighbourhood]


def task_of(problem: Problem, table: np.ndarray) -> RepairTask:
    """The problem as arrays; `table` [R, V] is the steps to each robot's goal."""
    robots = np.arange(problem.num_robots)
    return _task(problem, table[robots, problem.start].astype(np.int64), table, np.zeros((len(robots), 0), np.uint8))


def task_on(problem: Problem, world: PibtInstance) -> RepairTask:
    """The problem as arrays, with the distances that PIBT has."""
    if not world.packed:
        return task_of(problem, world.table)
    return _task(problem, world.steps, np.zeros((problem.num_robots, 0), np.int32), world.code)


def _task(problem: Problem, least: np.ndarray, table: np.ndarray, code: np.ndarray) -> RepairTask:
    graph = problem.graph
    return RepairTask(
        graph.first, graph.head, graph.reverse, np.array(problem.start), np.array(problem.target), least, table, code, clashes_of(problem)
    )


def room_to_repair(
    task: RepairTask,
    horizon: int,
    size: int,
    *,
    following: bool = False,
    rotations: bool = True,
    window: int = 0,
    most_labels: int = FOREVER,
) -> Room:
    """Traffic without paths over `horizon` steps or some more, and room to plan and repair it, `size` robots at a time.

    Robots keep clear of each other for `window` steps, 0: always. A search makes `most_labels`, or fewer on small maps.
    """
    horizon = (horizon + WORD - 1) // WORD * WORD
    traffic = empty_traffic(task, horizon, following=following, rotations=rotations, window=window)
    labels = room_for_labels(len(task.first) - 1, len(task.head), horizon, most_labels)
    return traffic, labels, room_for_hood(task, horizon, size, with_hits=True)


def is_roomy(task: RepairTask) -> bool:
    """Whether most robots have a path that crosses nobody: few moves for each lane, and vertices enough to stand on."""
    return bool(task.least.sum() < MOVES_A_LANE * len(task.head) and len(task.first) > VERTICES_A_ROBOT * len(task.goal))


def first_order(task: RepairTask, rng: np.random.Generator) -> np.ndarray:
    """[R] robots as they are planned at first: where there is room by the length of their ways, give or take a quarter.

    Those that have arrived stand in the way of others, who have the more ways round them the farther they go.
    """
    if not is_roomy(task):
        return rng.permutation(len(task.goal))
    return np.argsort(task.least * rng.uniform(0.75, 1.25, len(task.least)), kind="stable")


def plan_in_order(task: RepairTask, room: Room, order: np.ndarray, deadline_s: float) -> int:
    """Plan robots one after another, crossing others where it has to be; how many have a path when one has none, or no time is left."""
    traffic, labels, _ = room
    clear = is_roomy(task)
    for a in range(len(order)):
        if process_time() > deadline_s or not _lns.plan_all(task, traffic, labels, order, a, a + 1, clear):
            return a
    return len(order)


def repair(task: RepairTask, room: Room, size: int, rng: np.random.Generator, deadline_s: float, effort: int) -> tuple[int, int]:
    """Replan neighbourhoods of `size` robots until nobody collides; how many pairs did, and how many are left when time is up.

    Where the `effort` in labels is bounded (not 0), it is looked at as often on every machine.
    """
    first = pairs = find_collisions(task, room[0], room[2])
    at_once = AT_ONCE if effort else 1  # neighbourhoods between two looks at the clock
    while pairs and (slice_s := process_time()) <= deadline_s and not 0 < effort <= room[1].stamp[1]:
        pairs = _lns.repair(task, *room, size, pairs, at_once, rng)
        if effort:
            continue
        at_once = max(1, int(at_once * min(SLICE_S / max(process_time() - slice_s, 1e-6), 2.0)))
    return first, pairs


def room_bytes(task: RepairTask, horizon: int, most_labels: int = FOREVER) -> int:
    """Memory for traffic and searches over so many steps."""
    vertices, lanes, robots = len(task.first), len(task.head), len(task.goal)
    labels = min(labels_for(vertices, lanes), most_labels)
    clashes = horizon * (2 * vertices + 3 * lanes) if task.clashes.any else 0
    on, along = (3 * slots_for(robots * horizon) if is_sparse(rows, horizon) else rows * horizon for rows in (vertices, lanes))
    runs = 2 * slots_for(labels) if is_sparse(vertices, horizon) else vertices * horizon
    return horizon * ((vertices + lanes) // 8 + 4 * robots) + 5 * on + 3 * along + 16 * runs + 64 * labels + clashes


def prepare(threads: int) -> None:
    """Compile or load the kernels of repair, and of a refinement by so many threads."""
    problem = small_problem()
    detour = np.array([[0, 2], [0, 2], [1, 2], [3, 2], [3, 1], [3, 0], [1, 0], [2, 0]])
    task = task_of(problem, distances(problem.graph).to_all(problem.target))
    traffic, labels, hood = room_to_repair(task, 32, 2)
    _lns.plan_all(task, traffic, labels, np.arange(2), 0, 2, True)
    _lns.repair(task, traffic, labels, hood, 2, find_collisions(task, traffic, hood), 3, np.random.default_rng(0))
    refinement = Refinement(task, detour, 2, np.random.default_rng(0), threads=threads)
    refinement.until(np.inf, most_labels=20)
    for refiner in refinement.refiners[1:]:
        _merging.take_over(task, refiner.traffic, refiner.hood, refiner.gains)
        _merging.catch_up(task, refiner.traffic, refiner.hood, refinement.refiners[0].traffic)


def threads_with_room(threads: int, task: RepairTask, path: np.ndarray, memory_mb: int, taken: int) -> int:
    """How many threads, up to `threads`, can refine paths [T, R] within the memory, of which `taken` bytes are in use; at least one."""
    room = room_bytes(task, len(path) + SPARE_STEPS + WORD)
    return min(threads, max(1, (memory_mb * 1_000_000 - taken) // room))


def polishing_labels(a_robot: int, num_robots: int, window: int) -> int:
    """How many labels may be made: so many a robot for 100 robots or fewer, more, to the power of 3/4, for more.

    In a window a sixth of that: robots are planned again long before its end, and were no sooner done with tasks for more.
    The work is bounded by labels and not by time so that the same seed gives the same plan.
    """
    labels = int(a_robot * num_robots * max(1.0, num_robots / 100) ** 0.75)
    return labels // IN_WINDOWS if window else labels


class Refinement:
    """Paths without collisions that get shorter, by as many refiners at a time as there are threads.

    Refiners better copies of the same paths, each with its own chance, in rounds of counted work. After a round in which any of them
    has gained the best copy takes over what the others have gained elsewhere, in order, and the others catch up with it. So the same
    seed, threads and work lead to the same paths, whatever the scheduler does.
    """

    def __init__(
        self,
        task: RepairTask,
        path: np.ndarray,
        size: int,
        rng: np.random.Generator,
        *,
        following: bool = False,
        rotations: bool = True,
        window: int = 0,
        threads: int = 1,
        bandit: bool = False,
    ) -> None:
        """`path` is [T, R], everybody at the goal in the last row; `size` robots are planned again at a time.

        Robots keep clear of each other for `window` steps, 0: always. With a bandit, neighbourhoods are those of late robots
        that were worth it.
        """
        self._task = task
        self._least = int(task.least.sum())
        self._round_labels = max(ROUND_LABELS, ROUND_LABELS_A_VERTEX * len(task.first))
        chances = [rng, *(rng.spawn(threads - 1) if threads > 1 else ())]
        self.refiners = []
        for chance in chances:
            traffic = traffic_of(task, path, SPARE_STEPS, following=following, rotations=rotations, window=window)
            self.refiners.append(_Refiner(task, traffic, size, chance, shared=threads > 1, bandit=bandit))
        self._best = self.refiners[0]

    @property
    def cost(self) -> int:
        """Sum of costs in steps."""
        return self._best.cost

    def until(self, deadline_s: float, *, most_labels: int = FOREVER) -> None:
        """Go on until the deadline (process_time), until so many labels have been made since the beginning, or nothing is left to gain.

        All refiners' labels count.
        """
        if len(self.refiners) == 1:
            self._best.work(deadline_s, most_labels, self._least)
            return
        with ThreadPoolExecutor(len(self.refiners) - 1) as pool:
            while self.cost > self._least and (left := most_labels - self._labels) > 0 and process_time() < deadline_s:
                share = min(self._round_labels, -(-left // len(self.refiners)))
                _at_a_time(pool, [partial(refiner.work, deadline_s, refiner.labels + share, self._least) for refiner in self.refiners])
                if any(refiner.gains.num[0] for refiner in self.refiners):
                    self._bring_together(pool)

    @property
    def _labels(self) -> int:
        return sum(refiner.labels for refiner in self.refiners)

    def _bring_together(self, pool: ThreadPoolExecutor) -> None:
        """Let the best take over what others have gained, and others catch up with it."""
        self._best = best = min(self.refiners, key=lambda refiner: refiner.cost)  # the first of the best
        others = [refiner for refiner in self.refiners if refiner is not best]
        for refiner in others:
            _merging.take_over(self._task, best.traffic, best.hood, refiner.gains)
        _at_a_time(pool, [partial(_merging.catch_up, self._task, refiner.traffic, refiner.hood, best.traffic) for refiner in others])
        for refiner in self.refiners:
            refiner.gains.num[0] = 0

    def path(self) -> np.ndarray:
        """[T, R], up to the last arrival."""
        return path_of(self._best.traffic)


def _at_a_time(pool: ThreadPoolExecutor, calls: list[Callable[[], None]]) -> None:
    """Call all at a time, the first one in this thread."""
    started = [pool.submit(call) for call in calls[1:]]
    calls[0]()
    for future in started:
        future.result()


class _Refiner:
    """What one thread works on."""

    def __init__(self, task: RepairTask, traffic: Traffic, size: int, rng: np.random.Generator, *, shared: bool, bandit: bool) -> None:
        self.traffic = traffic
        horizon = traffic.at.shape[1]
        self._task, self._size, self._rng = task, size, rng
        self._room = room_for_labels(len(task.first) - 1, len(task.head), horizon)
        self.hood = room_for_hood(task, horizon, size, with_hits=False, bandit=bandit)
        self.gains = _merging.room_for_gains(task, MOST_GAINS if shared else 0, size, horizon)
        self._at_once = 1

    @property
    def cost(self) -> int:
        return int(self.traffic.end.sum())

    @property
    def labels(self) -> int:
        """Made since the beginning."""
        return int(self._room.stamp[1])

    def work(self, deadline_s: float, most_labels: int, least: int) -> None:
        """Go on until the deadline, until so many labels, until the cost is the `least`, or until there is no room for more gains."""
        full = len(self.gains.size) or -1
        while self.cost > least and self.labels < most_labels and self.gains.num[0] != full and (slice_s := process_time()) < deadline_s:
            _lns.improve(self._task, self.traffic, self._room, self.hood, self.gains, self._size, self._at_once, most_labels, self._rng)
            pace = SLICE_S / max(process_time() - slice_s, 1e-6)
            self._at_once = min(max(1, int(self._at_once * min(pace, 2.0))), MOST_AT_ONCE)
