"""A run in memory: everything that logs, exports and replays are made from."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.execution import Execution
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import BoolArray, FloatArray, IntArray, NavGraph, PlanGraph
from mrp_sumo.core.plan import Plan
from mrp_sumo.core.problem import Problem

if TYPE_CHECKING:
    from mrp_sumo.io.scenario.model import ScenarioModel
    from mrp_sumo.maps.costmap import Costmap
    from mrp_sumo.maps.lifts import Shift

MOVING, WAITING, BLOCKED, AT_GOAL = range(4)
STATE_NAMES = ("moving", "waiting", "blocked", "at goal")
STANDING_MPS = 0.01  # slower counts as standing
BLOCKING_EVENTS = ("blocked", "deadlock")


@dataclass(frozen=True, eq=False)
class RunRecord:
    """One executed run of R robots."""

    name: str  # of the scenario
    seed: int
    fleet: Fleet
    graph: PlanGraph  # whose vertices the plan names
    target: IntArray  # [R] goal vertex of each robot; [0] where tasks come instead
    plan: Plan | None
    execution: Execution
    nav: NavGraph | None = None  # the map as drawn
    costmap: "Costmap | None" = None  # walls
    levels: "Shift | None" = None  # where robots change them, as `Trajectory` has them
    goal_heading_rad: FloatArray | None = None  # [R] in which robots are to stay at their goals, NaN: any; None: all of them in any
    constants: Mapping[str, float] = field(default_factory=dict)  # MRP-Bench's, by its names, that metrics were computed with

    @property
    def drawn(self) -> NavGraph:
        """The map as drawn; the plan graph where it is not known."""
        return self.nav or self.graph

    @cached_property
    def shift_m(self) -> FloatArray:
        """[K, 2] how far each level is moved to lie beside the others."""
        return np.array(list(self.levels.values())) if self.levels else np.zeros((max(1, len(self.graph.level_names)), 2))


def record_of(
    scenario: "ScenarioModel",
    problem: Problem,
    plan: Plan | None,
    execution: Execution,
    nav: NavGraph | None,
    costmap: "Costmap | None",
    levels: "Shift | None" = None,
) -> RunRecord:
    """The record of a run that has just ended."""
    return RunRecord(
        name=scenario.name,
        seed=scenario.seed,
        fleet=problem.fleet,
        graph=problem.graph,
        target=problem.target if execution.tasks is None else problem.target[:0],
        plan=plan,
        execution=execution,
        nav=nav,
        costmap=costmap,
        levels=levels,
        goal_heading_rad=None if problem.goal_heading_rad is None else problem.heading_at_target,
        constants=constants_of(scenario.model_dump(mode="json")),
    )


def goal_name(record: RunRecord, robot: int) -> str:
    """The name of a robot's goal, '' where it has none."""
    return record.graph.label(int(record.target[robot])) if len(record.target) else ""


def task_names_at(record: RunRecord, t_s: FloatArray) -> NDArray[np.object_]:
    """[K, R] what robots do at some times: the names of their tasks, '' where they have none; those of their goals without tasks."""
    tasks, num_robots = record.execution.tasks, record.fleet.num_robots
    if tasks is None:
        return np.tile(np.array([goal_name(record, r) for r in range(num_robots)], object), (len(t_s), 1))
    names = np.full((len(t_s), num_robots), "", object)
    for name, robot, assigned_s, done_s in zip(tasks.name, tasks.robot.tolist(), tasks.assigned_s, tasks.done_s):
        if len(t_s) and assigned_s <= t_s[-1] and not done_s < t_s[0]:  # NaN: it never was
            end = np.searchsorted(t_s, done_s) if np.isfinite(done_s) else len(t_s)
            names[np.searchsorted(t_s, assigned_s) : end, robot] = name
    return names


def battery_percent_at(record: RunRecord, t_s: FloatArray) -> FloatArray:
    """[K, R] states of charge at some times; 100 where nothing is known of batteries."""
    log, num_robots = record.execution.batteries, record.fleet.num_robots
    if log is None:
        return np.full((len(t_s), num_robots), 100.0)
    return 100 * np.stack([np.interp(t_s, log.t_s, log.level[:, r]) for r in range(num_robots)], 1)


def charging_at(record: RunRecord, t_s: FloatArray) -> BoolArray:
    """[K, R] who is being charged at some times."""
    charging, tasks, stops = np.zeros((len(t_s), record.fleet.num_robots), np.bool_), record.execution.tasks, record.execution.stops
    if tasks is not None and stops is not None:
        for k in np.flatnonzero(~tasks.is_order[stops.task]).tolist():
            charging[np.searchsorted(t_s, stops.begin_s[k]) : np.searchsorted(t_s, stops.end_s[k]), stops.robot[k]] = True
    return charging


def constants_of(scenario: Mapping[str, Any]) -> dict[str, float]:
    """MRP-Bench's constants in a complete scenario; one that was not driven may have no time limit."""
    constants = {
        "cellSize": scenario["discretisation"]["cell_m"],
        "locationTolerance": scenario["execution"]["goal_tolerance_m"],
        "recordingTimeout": scenario["execution"]["time_limit_s"],
    }
    return {name: float(value) for name, value in constants.items() if value is not None}


def robot_states(execution: Execution, t_s: FloatArray) -> NDArray[np.int8]:
    """[K, R] the state of each robot at ascending times [K] of a run with samples: MOVING, WAITING, BLOCKED or AT_GOAL.

    Blocked is what the events call blocked; waiting is standing anywhere but at the goal.
    """
    sample = np.clip(np.searchsorted(execution.t_s, t_s - 1e-9), 0, len(execution.t_s) - 1)
    speed = execution.speed_mps[sample]
    state = np.where(np.abs(speed) < STANDING_MPS, WAITING, MOVING).astype(np.int8)
    for event in execution.events:
        if event.kind in BLOCKING_EVENTS and event.duration_s > 0 and 0 <= event.robot < state.shape[1]:
            a, b = np.searchsorted(t_s, (event.t_s - 1e-9, event.t_s + event.duration_s - 1e-9))
            state[a:b, event.robot] = np.where(state[a:b, event.robot] == MOVING, MOVING, BLOCKED)
    with np.errstate(invalid="ignore"):
        there = (t_s[:, None] >= execution.goal_s - 1e-9) & (state != MOVING)
    state[there] = AT_GOAL
    return state
