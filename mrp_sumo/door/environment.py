"""Step-wise lifelong problems as an environment of PettingZoo: every robot an agent, all act at once.

The rules are those of `mrp-sumo plan` for problems of the League of Robot Runners, and the loop is the same; but a policy that learns
may do anything, so that moves which would leave the map or collide become waits: of several robots that want one cell the first in order
gets it, if it is left or free. Robots without a task get the free one whose first errand is nearest.
"""

from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, Discrete
from pettingzoo import ParallelEnv

from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray
from mrp_sumo.core.step_wise import NOTHING, WAIT, StepWiseProblem, StepWiseSolution
from mrp_sumo.planning.step_wise import StepWiseWorld, safe, tasks_in_turn

PURPOSE = 51  # of the stream of chance
NUM_TASKS, NUM_ERRANDS = 1000, 2  # of drawn problems; tasks begin again
REVEALED = 1.5  # tasks known for each robot

Observation = dict[str, Any]


class StepWiseEnv(ParallelEnv):  # type: ignore[misc]  # PettingZoo has no types
    """R robots for so many steps; made by `mrp_sumo.parallel_env`.

    An observation has `view`, [3, 2 n + 1, 2 n + 1] of the cells around a robot, north up: blocked, other robots, its next errand;
    `errand`, rows down and columns to the right to that errand, both within -1 to 1 of the map's size, 0 for a robot without a task; and
    `heading`, 0 east, 1 south, 2 west, 3 north. Actions are 0 forward, 1 right, 2 left, 3 wait. A robot's reward is 1 for each errand that
    it does. `infos` has `tasks_done` of all robots so far.
    """

    metadata: dict[str, Any] = {"name": "mrp_sumo_step_wise_v0", "render_modes": ["ansi"], "is_parallelizable": True}  # noqa: RUF012 PettingZoo's

    def __init__(self, problem: StepWiseProblem, steps: int, view: int, *, drawn: bool, render_mode: str | None = None) -> None:
        self.possible_agents = [f"robot_{r}" for r in range(problem.num_robots)]
        self.agents: list[str] = []
        self.render_mode = render_mode
        self.steps, self._view, self._drawn, self._given = steps, view, drawn, problem
        self._rng = np.random.default_rng()
        self._world = StepWiseWorld(problem)
        side, (height, width) = 2 * view + 1, problem.free.shape
        self._padded = np.pad(~problem.free, view, constant_values=True)
        self._size = np.array([height, width], np.float32)
        spaces: dict[str, Any] = {
            "view": Box(0, 1, (3, side, side), np.int8),
            "errand": Box(-1, 1, (2,), np.float32),
            "heading": Discrete(4),
        }
        self.observation_spaces = {agent: Dict(spaces) for agent in self.possible_agents}
        self.action_spaces = {agent: Discrete(4) for agent in self.possible_agents}

    def observation_space(self, agent: str) -> Dict:
        """The space of an agent's observations."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> Discrete:
        """The space of an agent's actions."""
        return self.action_spaces[agent]

    @property
    def problem(self) -> StepWiseProblem:
        """The problem that is being solved."""
        return self._world.problem

    @property
    def solution(self) -> StepWiseSolution:
        """All that has happened since the reset, which `mrp_sumo.traffic.step_wise_referee` judges and `formats.lorr` prints."""
        return self._world.solution()

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[dict[str, Observation], dict[str, Any]]:
        """Begin again; a drawn problem is redrawn, by the seed or by the next draw after the last."""
        if seed is not None:
            self._rng = np.random.default_rng([seed, PURPOSE])
        self._world = StepWiseWorld(drawn(self._given, self._rng) if self._drawn else self._given)
        self._take_tasks()
        self.agents = list(self.possible_agents)
        return self._observations(), self._infos()

    def step(
        self, actions: dict[str, int]
    ) -> tuple[dict[str, Observation], dict[str, float], dict[str, bool], dict[str, bool], dict[str, Any]]:
        """Make a step; robots without an action wait."""
        world, agents = self._world, self.agents
        wanted = np.array([actions.get(agent, WAIT) for agent in self.possible_agents], np.int8)
        events = world.advance(safe(world, wanted), np.array(world.pool.task_of, np.int64))
        self._take_tasks()
        rewards = dict.fromkeys(agents, 0.0)
        for _, robot, _, _ in events:
            rewards[self.possible_agents[robot]] += 1.0
        over = world.time >= self.steps
        self.agents = [] if over else list(agents)
        return self._observations(), rewards, dict.fromkeys(agents, False), dict.fromkeys(agents, over), self._infos()

    def render(self) -> str | None:
        """The map with robots as arrows, with render_mode 'ansi'."""
        if self.render_mode != "ansi":
            return None
        rows = np.where(self.problem.free, ".", "@").reshape(-1)
        rows[self._world.cell] = np.array(list(">v<^"))[self._world.heading]
        return "\n".join(map("".join, rows.reshape(self.problem.free.shape).tolist()))

    def close(self) -> None:
        """Nothing is open."""

    def _take_tasks(self) -> None:
        """Robots without a task get one, so that they see where to go."""
        world = self._world
        world.pool.give(list(enumerate(tasks_in_turn(world.seen()).tolist())))

    def _infos(self) -> dict[str, Any]:
        return {agent: {"tasks_done": self._world.pool.num_finished} for agent in self.possible_agents}

    def _observations(self) -> dict[str, Observation]:
        world, n, width = self._world, self._view, self.problem.free.shape[1]
        row, column = np.divmod(world.cell, width)
        occupied = np.zeros(self._padded.shape, np.int8)
        occupied[row + n, column + n] = 1
        errands = self._errands()
        observations = {}
        for r, agent in enumerate(self.possible_agents):
            window = slice(row[r], row[r] + 2 * n + 1), slice(column[r], column[r] + 2 * n + 1)
            view = np.zeros((3, 2 * n + 1, 2 * n + 1), np.int8)
            view[0], view[1] = self._padded[window], occupied[window]
            view[1, n, n] = 0
            away = np.zeros(2, np.int64)
            if errands[r] != NOTHING:
                away = np.array(divmod(int(errands[r]), width)) - (row[r], column[r])
                if (np.abs(away) <= n).all():
                    view[2, n + away[0], n + away[1]] = 1
            observations[agent] = {"view": view, "errand": (away / self._size).astype(np.float32), "heading": int(world.heading[r])}
        return observations

    def _errands(self) -> IntArray:
        """[R] the cell of each robot's next errand, NOTHING for who has no task."""
        pool = self._world.pool
        return np.array([pool.problem.errands_of(k)[pool.done[k]] if k != NOTHING else NOTHING for k in pool.task_of], np.int64)


def drawn(problem: StepWiseProblem, rng: np.random.Generator) -> StepWiseProblem:
    """A problem on the same map, with as many robots: starts and errands drawn from the cells that are given."""
    cells = problem.errand
    start, first = rng.permutation(cells)[: problem.num_robots], np.arange(NUM_TASKS + 1) * NUM_ERRANDS
    return StepWiseProblem(problem.name, problem.free, start, first, rng.choice(cells, NUM_TASKS * NUM_ERRANDS), problem.num_revealed)


def on_map(name: str, free: BoolArray, num_robots: int) -> StepWiseProblem:
    """A problem that is to be drawn on the largest piece of a map, whose cells are its errands until then."""
    from scipy.ndimage import label

    piece, num_pieces = label(free)
    sizes: FloatArray = np.bincount(piece.reshape(-1), minlength=num_pieces + 1)[1:].astype(np.float64)
    cells = np.flatnonzero(piece.reshape(-1) == 1 + int(sizes.argmax())) if num_pieces else np.zeros(0, np.int64)
    start = cells[:num_robots]
    return StepWiseProblem(name, free, start, np.array([0, len(cells)]), cells, max(1, int(REVEALED * num_robots)))
