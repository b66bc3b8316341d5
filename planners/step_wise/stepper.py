"""A planner over operations at work on a problem: what is kept from step to step."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.graph import IntArray
from mrp_sumo.core.step_wise import FORWARD, LEFT, NOTHING, RIGHT, ActionArray, StepWiseProblem
from mrp_sumo.planning.step_wise import Decision, Observation
from planners.step_wise.ground import FAR, RESERVE, FreeCells, moved_up, operations
from planners.step_wise.tasks import Choice, InTurn, NearestGoal
from planners.step_wise.traffic import CrowdRoom, CrowdTraffic, let_out
from planners.step_wise.way_out import WayOut, way_out

SHUFFLE, KEPT = 20, 0.9  # steps that chance may put a robot before another in the order of a step; share of robots that keep theirs
MOST_VISITS = 10  # how often one robot may be pushed when another one chooses
TRY_LIMIT = 300  # operations that are looked at when a robot that is drawn changes its own
PATIENCE = 20, 3  # steps without an errand, and so many times those to the nearest one, after which a crowd is led out of where it stands


class StepEffort(NamedTuple):
    """Limits of the work of a step."""

    depth: int  # actions of an operation
    limit: tuple[int, int]  # operations that are looked at when a robot chooses, in jams and elsewhere
    tries: int  # how many times a robot is drawn that may change its operation
    fades: float  # the logarithm of how much more the cost of the first in the order counts then than that of the last


class OperationStepper:
    """Robots choose operations of `depth` actions; see `_operations`."""

    def __init__(self, problem: StepWiseProblem, seed: int, effort: StepEffort, tasks: Choice, ground: FreeCells) -> None:
        from planners.step_wise._operations import CrowdStep

        self._ground = ground
        self._traffic = CrowdTraffic(ground, problem.num_robots) if ground.against else None
        self._room = CrowdRoom(ground, problem.num_robots)
        self._tasks = InTurn(problem.num_robots) if tasks == "in_turn" or problem.own_tasks else NearestGoal()
        self._effort = effort
        self._rng = np.random.default_rng([seed, 13])
        self._luck = self._rng.integers(0, SHUFFLE, problem.num_robots)
        action = operations(effort.depth)
        place = np.arange(problem.num_robots)
        self._weight_of_place = 1 + 1000 * np.exp(-effort.fades * place / len(place))  # [R] in the order of a step
        num_robots, num_ops, num_cells = problem.num_robots, len(action), self._ground.num_cells

        def zeros(*shape: int) -> NDArray[np.int32]:
            return np.zeros(shape, np.int32)

        self._crowd = CrowdStep(
            ahead=self._ground.ahead,
            action=action,
            state=zeros(num_robots),
            path=zeros(num_robots, num_ops, effort.depth + 1),
            cost=zeros(num_robots, num_ops),
            order=np.zeros((num_robots, num_ops), np.int16),
            num=np.zeros(num_robots, np.int64),
            chosen=np.zeros(num_robots, np.int16),
            used=zeros(effort.depth + 1, num_cells),
            visits=np.zeros(num_robots, np.int64),
            on_stack=np.zeros(num_robots, np.int8),
            touched=zeros(num_robots),
            stack=zeros(num_robots),
            choice=np.zeros(num_robots, np.int64),
            before=np.zeros(num_robots, np.int16),
            moved_up=moved_up(action),
            fixed=np.zeros(num_robots, np.bool_),
            weight=np.zeros(num_robots, np.int64),
            surprised=np.zeros(num_robots, np.bool_),
            straight=problem.ticks > 0,
        )
        self._expected: NDArray[np.int32] | None = None  # [R] states after the step
        self._seed, self._ticks = seed, problem.ticks
        self._done = -1, -1  # errands done of tasks in the pool, and the sum of their numbers, which grows as they end; at first neither
        self._patient_until, self._patience = 0, 1
        self._way_out: WayOut | None = None

    def step(self, seen: Observation) -> Decision:
        """Actions of robots in the next step, and their tasks."""
        from planners.step_wise._operations import appraise, plan_step

        ground, crowd = self._ground, self._crowd
        ground.begin_step()
        crowd.state[:] = 4 * ground.number[seen.cell] + seen.heading
        if self._expected is not None:
            crowd.surprised[:] = crowd.state != self._expected
        task_of = self._tasks.choose(seen, ground, crowd.state)
        slot, goal, onward, rest = self._errands(seen, task_of)
        steps = np.where(slot[:, 0] >= 0, ground.table[slot[:, 0], crowd.state] + rest, FAR)
        if (action := self._led_out(seen, goal, slot, steps)) is not None:
            return Decision(action, task_of)
        wanted = goal.copy()
        sent, there = self._room.send(crowd.state, np.argsort(steps, kind="stable"))
        slot[sent, 0], slot[sent, 1], goal[sent] = there, NOTHING, NOTHING
        onward[sent] = 0
        appraise(crowd, ground.table, slot, goal, onward)
        luck = self._rng.integers(0, SHUFFLE, len(steps))  # else the same robots stand off for good
        self._luck = np.where(self._rng.random(len(steps)) < KEPT, self._luck, luck)
        order = np.argsort(let_out(ground.outward, crowd.state >> 2, wanted, steps + self._luck), kind="stable")
        crowd.weight[order] = self._weight_of_place
        limit = np.where(self._room.in_jam, *self._effort.limit)
        plan_step(crowd, order, limit, MOST_VISITS, self._effort.tries, TRY_LIMIT, self._rng)
        action = crowd.action[crowd.chosen, 0]
        turned = (crowd.state & ~3) | (crowd.state + (action == RIGHT) - (action == LEFT)) & 3
        self._expected = np.where(action == FORWARD, 4 * ground.ahead[crowd.state] + (crowd.state & 3), turned)
        if self._traffic is not None:
            self._traffic.see(crowd.state, action)
        return Decision(action, task_of)

    def _led_out(self, seen: Observation, goal: IntArray, slot: IntArray, steps: IntArray) -> ActionArray | None:
        """[R] actions where no errand has been done for long; None: robots choose for themselves."""
        crowd, done = self._crowd, (sum(seen.pool.values()), sum(seen.pool))
        if done != self._done:
            left = np.where(slot[:, 0] >= 0, self._ground.table[slot[:, 0], crowd.state], FAR).min()
            self._done, self._patience, self._patient_until = done, 1, seen.time + PATIENCE[0] + PATIENCE[1] * int(left)
        if self._way_out is None and seen.time > self._patient_until and not self._ticks:
            self._way_out = way_out(self._ground, crowd.state, goal, np.argsort(steps, kind="stable"), self._seed)
            self._patience *= 2
            self._patient_until = seen.time + self._patience * PATIENCE[0]
        action = self._way_out.action(crowd.state) if self._way_out else None
        if action is None:
            self._way_out = None
        else:
            self._expected = np.full(len(crowd.state), NOTHING, np.int32)  # nothing is left of what robots chose
        return action

    def _errands(self, seen: Observation, task_of: IntArray) -> tuple[IntArray, IntArray, IntArray, IntArray]:
        """Tables of the next two errands [R, 2], the cell of the next, the steps between them, and those from it to the task's end [R]."""
        ground, num_robots = self._ground, len(task_of)
        slot, (goal, onward, rest) = np.full((num_robots, 2), -1), np.array([[-1], [0], [0]]).repeat(num_robots, 1)
        for task in task_of[task_of != NOTHING].tolist():  # theirs first: what is asked for here may make others' tables forgotten
            ground.steps_left(task)
        for r in np.flatnonzero(task_of != NOTHING).tolist():
            task = int(task_of[r])
            cells, left = (known[seen.pool[task] :] for known in (ground.errands(task), ground.steps_left(task)))
            goal[r], rest[r] = cells[0], left[0]
            slot[r, 0] = ground.slot(cells[0])  # -1: it stays where it is until there is time for its table
            if len(cells) > 1:
                onward[r] = left[0] - left[1]
                slot[r, 1] = ground.slot(cells[1], RESERVE)
        return slot, goal, onward, rest
