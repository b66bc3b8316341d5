"""Large neighbourhood search over the paths of a problem, driven by the clock or by the work done.

`Repair` plans robots past each other and brings collisions down to none, `first_paths` does so where that is easy, `Refinement` makes paths
without collisions shorter.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from time import process_time

import numpy as np

from mrp_sumo.core.graph import IntArray, frozen
from mrp_sumo.core.problem import Problem
from mrp_sumo.search.distance import distances
from mrp_sumo.traffic.clashes import clashes_of
from planners.configuration._pibt_instance import PibtInstance
from planners.configuration.guides import MOVES_A_LANE
from planners.neighbourhood import _lns
from planners.neighbourhood._neighbourhoods import find_collisions, room_for_gains, room_for_hood
from planners.neighbourhood._sipps import labels_for, room_for_labels
from planners.neighbourhood._traffic import WORD, RepairTask, Traffic, empty_traffic, is_sparse, path_of, slots_for, traffic_of
from planners.world import SLICE_S, small_problem

IN_WINDOWS = 6  # times less polishing
SPARE_STEPS = 8  # room beyond the longest path
FOREVER = 1 << 62
VERTICES_A_ROBOT = 5  # at least, where there is room for everybody
AT_ONCE = 16  # neighbourhoods between looks at the effort
MOST_AT_ONCE = 1 << 16  # neighbourhoods between looks at the clock
ROUND_LABELS = 1 << 14  # of a refiner between two times that threads bring together what they have gained, or more:
ROUND_LABELS_A_VERTEX = 1  # on large maps every search makes many
MOST_GAINS = 64  # neighbourhoods of a refiner in a round
LOOKS = 32  # at what was gained while paths are polished
PARTS, WORTH_IT = 2, 0.01  # a plan that gained this share of its cost in the last half of its labels gets half as many again
PATIENCE = 20  # times the share of its cost that a plan may gain at most: the share of the labels without a gain that it is worth
# of first paths:
SPARE = 64  # steps beyond the longest shortest way
MOST_LABELS = 1 << 19  # of a search; so few stay in the processor's cache on any map
LABELS_A_STEP = 64  # of shortest ways: where paths take more to find, the map is not used thinly
MOST_DETOUR = 0.1  # of shortest ways: where paths have longer ones, first solutions of LaCAM are as cheap
MOST_LOAD = 0.9  # of the slots of a hashed table
REPAIRS = 32  # times AT_ONCE neighbourhoods
SIZE = 8  # robots in a neighbourhood


def task_of(problem: Problem, table: np.ndarray, *, following: bool = False, rotations: bool = True) -> RepairTask:
    """The problem as arrays, with the steps [R, V] to each robot's goal; in a window, robots keep clear of each other until it ends.

    `following` is whether following conflicts count, `rotations` whether rings of robots may move at once.
    """
    robots = np.arange(problem.num_robots)
    least = table[robots, problem.start].astype(np.int64)
    return _task(problem, (least, table, np.zeros((len(robots), 0), np.uint8)), following, rotations)


def task_on(problem: Problem, world: PibtInstance) -> RepairTask:
    """The problem as arrays, with the distances that PIBT has, and its rules."""
    rules = bool(world.following), bool(world.rotations)
    if not world.packed:
        return task_of(problem, world.table, following=rules[0], rotations=rules[1])
    return _task(problem, (world.steps, frozen(np.zeros((problem.num_robots, 0), np.int32)), world.compass.code), *rules)


def _task(problem: Problem, steps: tuple[np.ndarray, np.ndarray, np.ndarray], following: bool, rotations: bool) -> RepairTask:
    graph, (clashes, spots) = problem.graph, clashes_of(problem)
    rings = not (rotations and clashes.rotations) and not following
    ends = np.array(problem.start), np.array(problem.target)
    return RepairTask(graph.first, graph.head, *ends, *steps, clashes, spots, following, rings, problem.window_steps)


class Repair:
    """Paths that may collide: planned one by one, past each other where it has to be, then again until nobody collides."""

    def __init__(self, task: RepairTask, horizon: int, size: int, most_labels: int = FOREVER, most_steps: int | None = None) -> None:
        """Paths may take `horizon` steps or some more, all together `most_steps` where that is given; `size` robots are planned again
        at a time.

        A search makes `most_labels`, or fewer on small maps.
        """
        horizon = -(-horizon // WORD) * WORD
        self.traffic = empty_traffic(task, horizon, most_steps)
        self.room = room_for_labels(len(task.first) - 1, len(task.head), horizon, most_labels)
        self._hood = room_for_hood(task, horizon, size, with_hits=True)

    @property
    def labels(self) -> int:
        """Made since the beginning."""
        return int(self.room.stamp[1])

    def plan(self, robots: IntArray, *, clear: bool = False) -> bool:
        """Plan robots one after another; False when one has no path or room. See `_lns.plan_all` for `clear`."""
        return bool(_lns.plan_all(self.traffic, self.room, robots, clear))

    def num_pairs(self) -> int:
        """Pairs of robots in collision."""
        return int(find_collisions(self.traffic, self._hood))

    def has_room(self, robots: int) -> bool:
        """True if so many robots can be planned again, however long their paths get."""
        on, task, horizon = self.traffic.on, self.traffic.task, self.traffic.at.shape[1]
        steps = int(self.traffic.end.sum()) + robots * horizon
        return len(on.key) == 0 or steps * (2 if task.following else 1) <= MOST_LOAD * len(on.key) / 2

    def repair_each(self, pairs: int, rng: np.random.Generator) -> int:
        """Plan each robot of the `pairs` in collision again; how many are left."""
        return int(_lns.repair_each(self.traffic, self.room, self._hood, pairs, rng))

    def repair(self, pairs: int, times: int, rng: np.random.Generator) -> int:
        """Plan so many neighbourhoods again, or until nobody collides; how many `pairs` are left."""
        return int(_lns.repair(self.traffic, self.room, self._hood, pairs, times, rng))


def is_roomy(task: RepairTask) -> bool:
    """True if most robots have a path that crosses nobody: few moves for each lane, and vertices enough to stand on."""
    return bool(task.least.sum() < MOVES_A_LANE * len(task.head) and len(task.first) > VERTICES_A_ROBOT * len(task.goal))


def first_order(task: RepairTask, rng: np.random.Generator) -> np.ndarray:
    """[R] robots as they are planned at first: where there is room by the length of their ways, give or take a quarter.

    Those that have arrived stand in the way of others, who have the more ways round them the farther they go.
    """
    if not is_roomy(task):
        return rng.permutation(len(task.goal))
    return np.argsort(task.least * rng.uniform(0.75, 1.25, len(task.least)), kind="stable")


def room_bytes(task: RepairTask, horizon: int, most_labels: int = FOREVER, most_steps: int | None = None) -> int:
    """Memory for traffic and searches over so many steps, see `Repair`."""
    vertices, spots, moves, robots = len(task.first), len(task.spots.first), len(task.spots.head), len(task.goal)
    labels = min(labels_for(vertices, len(task.head)), most_labels)
    clashes = horizon * (2 * spots + 3 * moves) if task.clashes.any else 0
    steps = robots * horizon if most_steps is None else most_steps
    held = 13 * slots_for(steps) if is_sparse(spots, horizon) else 5 * spots * horizon
    runs = 2 * slots_for(labels) if is_sparse(vertices, horizon) else vertices * horizon
    return horizon * ((spots + moves) // 8 + 4 * robots) + held + 16 * runs + 64 * labels + clashes


def first_paths(
    task: RepairTask, rng: np.random.Generator, deadline_s: float, effort: int, memory_mb: int
) -> tuple[np.ndarray | None, int]:
    """[T, R] paths without collisions, None where they take too much work to find or are too long; and the labels that were made.

    After MAPF-LNS2 (Li et al., AAAI 2022), whose paths cross others' where it has to be. What differs: robots with short ways plan first.
    One that is at its goal to stay is then in the way of longer paths only, which go around it; with longer paths first it would have to
    wait until the last of them has passed its goal. Where robots use the map thinly next to nobody collides, and paths are hardly longer
    than shortest ones. Those that do collide are planned again, each alone, then in neighbourhoods. The deadline is on the clock of
    `process_time`, `effort` the labels that may be made, 0: as many as are worth it.
    """
    horizon = int(task.least.max()) + SPARE
    least_steps = int(task.least.sum())
    room = MOST_LABELS, int((1 + MOST_DETOUR) * least_steps) + AT_ONCE * SIZE * (horizon + WORD)
    if room_bytes(task, horizon, *room) + len(task.goal) ** 2 > memory_mb * 1_000_000:
        return None, 0
    most = LABELS_A_STEP * (least_steps + len(task.goal))
    most = min(most, effort) if effort else most
    paths = Repair(task, horizon, SIZE, *room)
    order = rng.permutation(len(task.least))
    order = order[np.argsort(task.least[order], kind="stable")]  # those of one length in random order
    left = MOST_DETOUR * least_steps
    for robot in order:
        if left < 0 or paths.labels > most or process_time() > deadline_s or not paths.plan(np.array([robot])):
            return None, paths.labels
        left -= paths.traffic.end[robot] - task.least[robot]
    pairs = paths.num_pairs()
    if 0 < pairs <= len(order) and paths.has_room(2 * pairs):
        pairs = paths.repair_each(pairs, rng)
    for _ in range(REPAIRS):
        if pairs == 0 or pairs > len(order) or paths.labels > most or process_time() > deadline_s or not paths.has_room(AT_ONCE * SIZE):
            break
        pairs = paths.repair(pairs, AT_ONCE, rng)
    at, end, labels = paths.traffic.at, paths.traffic.end, paths.labels
    del paths  # the paths are copied when its memory is free again
    return path_of(at, end) if pairs == 0 and end.sum() - least_steps <= MOST_DETOUR * least_steps else None, labels


def prepare(threads: int) -> None:
    """Compile or load the kernels of repair, and of a refinement by so many threads."""
    problem, rng = small_problem(), np.random.default_rng(0)
    detour = np.array([[0, 2], [0, 2], [1, 2], [3, 2], [3, 1], [3, 0], [1, 0], [2, 0]])
    task = task_of(problem, distances(problem.graph).to_all(problem.target))
    paths = Repair(task, 32, 2)
    paths.plan(np.arange(2), clear=True)
    paths.repair(paths.num_pairs(), 3, rng)
    refinement = Refinement(task, detour, 2, rng, threads=threads)
    refinement.until(np.inf, most_labels=20)
    for refiner in refinement.refiners[1:]:
        _lns.take_over(refiner.traffic, refiner.hood, refiner.gains)
        _lns.catch_up(refiner.traffic, refiner.hood, refinement.refiners[0].traffic)


def threads_with_room(threads: int, task: RepairTask, path: np.ndarray, memory_mb: int, taken: int) -> int:
    """Threads, up to `threads`, that can refine paths [T, R] within the memory, of which `taken` bytes are in use; at least one."""
    room = room_bytes(task, len(path) + SPARE_STEPS + WORD)
    return min(threads, max(1, (memory_mb * 1_000_000 - taken) // room))


def polishing_labels(a_robot: int, num_robots: int, window: int) -> int:
    """Number of labels that may be made: so many a robot for 100 robots or fewer, more, to the power of 3/4, for more.

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
        self, task: RepairTask, path: np.ndarray, size: int, rng: np.random.Generator, *, threads: int = 1, bandit: bool = False
    ) -> None:
        """`path` is [T, R], everybody at the goal in the last row; `size` robots are planned again at a time.

        With a bandit, neighbourhoods are those of late robots that were worth it.
        """
        self.least = int(task.least.sum())
        self._round_labels = max(ROUND_LABELS, ROUND_LABELS_A_VERTEX * len(task.first))
        chances = [rng, *(rng.spawn(threads - 1) if threads > 1 else ())]
        self.refiners = [
            _Refiner(traffic_of(task, path, SPARE_STEPS), size, chance, shared=threads > 1, bandit=bandit) for chance in chances
        ]
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
            self._best.work(deadline_s, most_labels, self.least)
            return
        with ThreadPoolExecutor(len(self.refiners) - 1) as pool:
            while self.cost > self.least and (left := most_labels - self._labels) > 0 and process_time() < deadline_s:
                share = min(self._round_labels, -(-left // len(self.refiners)))
                _at_a_time(pool, [partial(refiner.work, deadline_s, refiner.labels + share, self.least) for refiner in self.refiners])
                if any(refiner.gains.num[0] for refiner in self.refiners):
                    self._bring_together(pool)

    def polish(self, deadline_s: float, labels: int, most_labels: int = FOREVER) -> None:
        """Go on like `until` for so many labels, longer while the last half of them has paid, but not where for long nothing was gained.

        So a plan that costs a hundredth more than the least is left when a fifth of the labels have gained nothing.
        """
        best, made, gained = self.cost, 0, 0
        end, part, before = min(labels, most_labels), max(1, labels // PARTS), best
        turn = max(1, labels // LOOKS, self._round_labels * len(self.refiners) if len(self.refiners) > 1 else 0)
        while made < end and (made - gained) * self.least <= PATIENCE * (best - self.least) * labels:
            made = min(made + turn, end)
            self.until(deadline_s, most_labels=made)
            if self.cost < best:
                best, gained = self.cost, made
            if made <= end - part:
                before = best
            elif made == end and before - best > WORTH_IT * before:
                end, before = min(end + part, most_labels), best

    @property
    def _labels(self) -> int:
        return sum(refiner.labels for refiner in self.refiners)

    def _bring_together(self, pool: ThreadPoolExecutor) -> None:
        """Let the best take over what others have gained, and others catch up with it."""
        self._best = best = min(self.refiners, key=lambda refiner: refiner.cost)  # the first of the best
        others = [refiner for refiner in self.refiners if refiner is not best]
        for refiner in others:
            _lns.take_over(best.traffic, best.hood, refiner.gains)
        _at_a_time(pool, [partial(_lns.catch_up, refiner.traffic, refiner.hood, best.traffic) for refiner in others])
        for refiner in self.refiners:
            refiner.gains.num[0] = 0

    def path(self) -> np.ndarray:
        """[T, R], up to the last arrival."""
        return path_of(self._best.traffic.at, self._best.traffic.end)


def _at_a_time(pool: ThreadPoolExecutor, calls: list[Callable[[], None]]) -> None:
    """Call all at a time, the first one in this thread."""
    started = [pool.submit(call) for call in calls[1:]]
    calls[0]()
    for future in started:
        future.result()


class _Refiner:
    """What one thread works on."""

    def __init__(self, traffic: Traffic, size: int, rng: np.random.Generator, *, shared: bool, bandit: bool) -> None:
        task, horizon = traffic.task, traffic.at.shape[1]
        self.traffic, self._rng, self._at_once = traffic, rng, 1
        self._room = room_for_labels(len(task.first) - 1, len(task.head), horizon)
        self.hood = room_for_hood(task, horizon, size, with_hits=False, bandit=bandit)
        self.gains = room_for_gains(task, MOST_GAINS if shared else 0, size, horizon)

    @property
    def cost(self) -> int:
        return int(self.traffic.end.sum())

    @property
    def labels(self) -> int:
        """Made since the beginning."""
        return int(self._room.stamp[1])

    def work(self, deadline_s: float, most_labels: int, least: int) -> None:
        """Go on until the deadline, until so many labels, until the cost is the `least`, or until there is no room for more gains."""
        num, full = self.gains.num, len(self.gains.size) or -1
        while self.cost > least and self.labels < most_labels and num[0] != full and (slice_s := process_time()) < deadline_s:
            _lns.improve(self.traffic, self._room, self.hood, self.gains, self._at_once, most_labels, self._rng)
            pace = SLICE_S / max(process_time() - slice_s, 1e-6)
            self._at_once = min(max(1, int(self._at_once * min(pace, 2.0))), MOST_AT_ONCE)
