"""Robots on a line with the tasks that they have or could have, for dispatchers, where what robots drive is left out."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from worlds import line, problem_on

from mrp_sumo.core.stream import TaskList
from mrp_sumo.core.task import NOBODY, Station, Stop, Task
from mrp_sumo.drive.crew import Crew
from mrp_sumo.drive.dispatcher import dispatcher_of
from mrp_sumo.drive.dispatchers.estimates import choice
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.drive.state import state_at_rest
from mrp_sumo.drive.work import Work
from mrp_sumo.traffic.resources import resources_of


class Fleet:
    """Robots on a line of 20 vertices or another graph, a step of a second each, and the tasks that they have or could have."""

    def __init__(self, at, *tasks, service_s=1.0, types=(), graph=None):
        problem = problem_on(graph or line(20), at, at)
        problem = replace(problem, fleet=replace(problem.fleet, type_name=types))
        stations = [[Station(f"at {v}", (v,)) for v in stops] for _, stops, *_ in tasks]
        listed = [
            Task(
                *(k, tuple(Stop(s.places[0], float(each_s), "", s) for s in of), task[0]),
                priority=task[2] if len(task) > 2 else 0,
                robot_type=task[3] if len(task) > 3 else "",
                robot=task[4] if len(task) > 4 else NOBODY,
            )
            for k, (task, of, each_s) in enumerate(zip(tasks, stations, np.broadcast_to(service_s, len(tasks))))
        ]
        self.state, number = state_at_rest(len(at), 1, 1, np.arange(len(at))), np.arange(len(at))
        columns = dict.fromkeys(("reached", "last", "granted"), number)
        zeros = dict.fromkeys(("arrived_s", "at_m"), np.zeros(len(at)))
        self.visits = SimpleNamespace(**columns, **zeros, vertex=np.array(at), next=np.full(len(at), -1))
        about = {"problem": problem, "resources": resources_of(problem.graph, problem.fleet.apart_m)}
        ledger = SimpleNamespace(**about, committed=[(v,) for v in at], visits=self.visits, state=self.state)
        self.crew = Crew(ledger, ExecutionSettings(tasks=(TaskList(tuple(listed)),)))
        self.work = Work(self.crew)
        self.context = SimpleNamespace(
            work=self.work,
            crew=self.crew,
            ledger=ledger,
            graph=problem.graph,
            closed=np.zeros(problem.graph.num_lanes, np.bool_),
            start=np.array(at),
        )

    def decides(self, dispatcher, now_s=0.0, **parameters):
        """Who has which task after a decision, before anybody moves."""
        self.crew.orders.reveal(now_s)
        self.crew.is_changed = True
        (request,) = dispatcher_of(dispatcher, parameters).due(now_s, self.context)
        self.work.accepted(request, now_s)
        return {r: k for r, k in enumerate(robot.task for robot in self.crew.robots) if k >= 0}

    def choice(self, now_s=0.0, most=99, **options):
        """What can be decided."""
        self.crew.orders.reveal(now_s)
        return choice(now_s, self.context, most, **{"reassign": False, **options})
