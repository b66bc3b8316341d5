"""Interventions of somebody who watches a run: a broken robot, a closed lane, a new task.

Everything becomes a key of the run's scenario, with the simulated time at which it was done, so that the run can be made again from its
folder. The thread that drives takes what those that serve have asked for.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from queue import SimpleQueue
from typing import Any

from mrp_sumo.core.disturbances import Breakdown, Closure
from mrp_sumo.core.stream import TaskList
from mrp_sumo.drive.listeners import Intervention, Listener
from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments.staging.lanes import closed_lanes
from mrp_sumo.experiments.staging.set_up import SetUp
from mrp_sumo.experiments.staging.tasks import task_sources
from mrp_sumo.io.scenario.file import ScenarioFile
from mrp_sumo.io.scenario.tasks import TaskChoice

Done = Breakdown | Closure | TaskChoice  # as the scenario says it

NEVER_S = 1e9  # where a task that is only checked is released


@dataclass
class Interventions(Listener):
    """Those of one run."""

    setup: SetUp
    _asked: "SimpleQueue[Callable[[float], tuple[Done, tuple[Intervention, ...]]]]" = field(default_factory=SimpleQueue)
    _done: list[Done] = field(default_factory=list)

    def ask(self, order: Mapping[str, Any]) -> str:
        """Have something done at the next step. Returns why not, '' where it will be.

        An order has `do`: `break` with `robot`, a number; `close` with `between`, the names of two vertices; `add` with `stops`, names
        of stations. The first two also take `duration_s`, null: for good.
        """
        try:
            match order:
                case {"do": "break", "robot": int() as robot, **more} if type(robot) is int and 0 <= robot < self.setup.problem.num_robots:
                    self._ask(lambda now_s: self._broken(robot, now_s, _lasts(more)))
                case {"do": "close", "between": [str() as a, str() as b], **more}:
                    self._ask(lambda now_s: self._closed((a, b), now_s, _lasts(more)))
                case {"do": "add", "stops": [str(), *_] as stops} if len(stops) <= 100 and all(isinstance(stop, str) for stop in stops):
                    self._ask(lambda now_s: self._added(tuple(stops), now_s))
                case _:
                    return "expected break with a robot, close with two vertices, or add with stops"
        except (MrpSumoError, ValueError) as error:
            return str(error)
        return ""

    def interventions(self, now_s: float) -> list[Intervention]:
        due: list[Intervention] = []
        while not self._asked.empty():
            choice, wishes = self._asked.get()(now_s)
            self._done.append(choice)
            due += wishes
        return due

    def recorded(self, file: ScenarioFile) -> ScenarioFile:
        """The scenario with all that was done."""
        for choice in self._done:
            file = _with(file, choice)
        return file

    def _ask(self, made: Callable[[float], tuple[Done, tuple[Intervention, ...]]]) -> None:
        made(NEVER_S)  # what is wrong with it is reported to the one who asks
        self._asked.put(made)

    def _broken(self, robot: int, now_s: float, lasts_s: float | None) -> tuple[Done, tuple[Intervention, ...]]:
        return (broken := Breakdown(robot, now_s, lasts_s)), (broken,)

    def _closed(self, between: tuple[str, str], now_s: float, lasts_s: float | None) -> tuple[Done, tuple[Intervention, ...]]:
        choice = Closure(between, now_s, lasts_s)
        execution = self.setup.scenario.execution
        alone = replace(execution, disturbances=replace(execution.disturbances, closures=(choice,)))
        return choice, closed_lanes(self.setup.file.having(execution=alone), self.setup.map.nav, self.setup.problem.graph)

    def _added(self, stops: tuple[str, ...], now_s: float) -> tuple[Done, tuple[Intervention, ...]]:
        tasks = self.setup.scenario.tasks
        if tasks is None or tasks.open is not None:
            raise MrpSumoError("this run has goals instead of tasks" if tasks is None else "tasks of this run have no times of their own")
        number = len(tasks.list) + len([choice for choice in self._done if isinstance(choice, TaskChoice)])
        choice = TaskChoice(name=f"asked_{number}", stops=list(stops), release_s=now_s)
        alone = tasks.model_copy(update={"list": (choice,), "file": None, "streams": ()})
        (source,) = task_sources(self.setup.file.having(tasks=alone), self.setup.map.nav, self.setup.problem)
        assert isinstance(source, TaskList)
        return choice, source.listed


def _lasts(more: Mapping[str, Any]) -> float | None:
    duration_s = more.get("duration_s")
    if duration_s is not None and (type(duration_s) not in (int, float) or not 0 < duration_s < math.inf):
        raise ValueError("duration_s: expected seconds above 0, or null for good")
    return duration_s


def _with(file: ScenarioFile, choice: Done) -> ScenarioFile:
    scenario = file.scenario
    if isinstance(choice, TaskChoice):
        assert scenario.tasks is not None
        return file.having(tasks=scenario.tasks.model_copy(update={"list": (*scenario.tasks.list, choice)}))
    what, key = scenario.execution.disturbances, "breakdowns" if isinstance(choice, Breakdown) else "closures"
    more: dict[str, Any] = {key: (*getattr(what, key), choice)}
    return file.having(execution=replace(scenario.execution, disturbances=replace(what, **more)))
