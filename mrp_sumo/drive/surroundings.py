"""Knowledge while robots drive: the ledger, the world, and whom to ask for a plan."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mrp_sumo.core.graph import BoolArray, IntArray, PlanGraph
from mrp_sumo.core.request import Request
from mrp_sumo.drive._causes import ARRIVED_M
from mrp_sumo.drive.crew import INTO_M, Crew
from mrp_sumo.drive.ledger import Ledger
from mrp_sumo.drive.reroute import Replan
from mrp_sumo.drive.state import State
from mrp_sumo.drive.work import Work
from mrp_sumo.drive.world import World
from mrp_sumo.search._bodies import TIE_M
from mrp_sumo.traffic.resources import Resources

Planning = Callable[[Request], Replan]  # raises PlanError where there is no plan


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Knowledge of those who decide what robots do next."""

    ledger: Ledger
    world: World
    work: Work
    plan: Planning  # asks the planner of this run

    @property
    def closed(self) -> BoolArray:
        """[L] lanes that nobody may set out on."""
        return self.world.closed

    @property
    def crew(self) -> Crew:
        """Robots and the tasks that are known."""
        return self.work.crew

    @property
    def graph(self) -> PlanGraph:
        return self.ledger.graph

    @property
    def state(self) -> State:
        return self.ledger.state

    @property
    def resources(self) -> Resources:
        return self.ledger.resources

    @property
    def start(self) -> IntArray:
        """[R] vertices that robots are committed to reach: where a new plan begins."""
        start: IntArray = self.ledger.visits.vertex[self.ledger.joint]
        return start

    def granted(self, robot: int) -> int:
        """The last visit that a robot may drive to."""
        return int(self.ledger.visits.granted[robot])

    def ahead(self, robot: int) -> int:
        """The visit after that, -1: none."""
        return int(self.ledger.visits.next[self.granted(robot)])

    def rest_of_lane_m(self, robot: int) -> float:
        """Distance to the visit ahead."""
        return float(self.ledger.visits.at_m[self.ahead(robot)] - self.state.motion.s_m[robot])

    def of_lane(self, robot: int, lane: int) -> IntArray:
        """Resources that a robot needs to drive on a lane to its end."""
        head, track = int(self.graph.head[lane]), int(self.resources.track[lane])
        return np.concatenate([self.of_vertex(robot, head), self._zones(robot, self.graph.num_vertices + track)])

    def of_vertex(self, robot: int, vertex: int) -> IntArray:
        """Resources that a robot needs to stand on a vertex."""
        return np.concatenate([[vertex], self._zones(robot, vertex)])

    def _zones(self, robot: int, place: int) -> IntArray:
        kind = int(self.ledger.problem.fleet.kind[robot])
        return self.graph.num_vertices + self.resources.zones_at(place, kind)

    def barred(self, robot: int) -> BoolArray:
        """[L] lanes that are closed, or on which a robot of this type has no room."""
        problem = self.crew.site
        return self.closed if problem.barred is None else self.closed | problem.barred[problem.fleet.kind[robot]]

    def free_for(self, robot: int, needs: IntArray) -> bool:
        holder = self.state.holds.holder[needs]
        return bool(((holder < 0) | (holder == robot)).all())

    def still_needed(self, robot: int) -> IntArray:
        """Resources a robot holds or will need on the rest of its way."""
        return self.ledger.resources_from(robot, int(self.state.grants.oldest[robot]))

    def can_turn_back(self, robot: int) -> bool:
        """True if a robot that waits on a lane has the lane for itself and may drive back; vehicles that cannot turn in place may not."""
        if self.ledger.is_vehicle[robot]:
            return False
        visits, claims = self.ledger.visits, self.state.claims.number
        lane = int(visits.lane[self.ahead(robot)])
        back = int(visits.reverse[lane])
        return back >= 0 and not self.closed[back] and claims[lane] == 1 and claims[back] == 0

    @property
    def entering(self) -> BoolArray:
        """[R] `enters_by_itself` of each."""
        visits = self.ledger.visits
        waits: BoolArray = visits.granted == visits.first
        for r in np.flatnonzero(waits).tolist():
            waits[r] = self.enters_by_itself(r)
        return waits

    def enters_by_itself(self, robot: int) -> bool:
        """True if a robot has not left its start, and no lane leads there: then SUMO has it on its first lane already."""
        visits, visit = self.ledger.visits, self.granted(robot)
        return visit == visits.first[robot] and not (self.graph.head == visits.vertex[visit]).any()

    def stands(self, robot: int) -> bool:
        """True if a robot stands at a vertex, or on a lane on which it can turn back, with nothing ahead that it may drive."""
        visits, motion, granted = self.ledger.visits, self.state.motion, self.granted(robot)
        if self.enters_by_itself(robot) or motion.speed_mps[robot] > 0 or visits.reached[robot] != granted or visits.next[granted] < 0:
            return False
        beyond = float(motion.s_m[robot] - visits.at_m[granted])
        return beyond > INTO_M and self.can_turn_back(robot) if self.state.grants.on_lane[robot] else abs(beyond) <= ARRIVED_M + TIE_M
