"""People around the robots of an execution: they walk while robots drive, robots heed them, and what comes of it is recorded.

The crowd itself is `crowd`; how robots heed people is in the kernels of `_people`. Where the scenario has no people but speeds that
are drawn lane by lane, these are drawn here.
"""

from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np

from mrp_sumo.core.execution import Event
from mrp_sumo.core.fleet import Fleet
from mrp_sumo.core.graph import FloatArray, IntArray, PlanGraph, frozen
from mrp_sumo.core.people import PeopleLog
from mrp_sumo.core.problem import Problem
from mrp_sumo.crowd._walk import BIN_M
from mrp_sumo.crowd.crowd import Crowd
from mrp_sumo.crowd.options import ProtectiveFields
from mrp_sumo.crowd.state import BODY_M
from mrp_sumo.drive import _people
from mrp_sumo.drive._causes import GRAINS
from mrp_sumo.drive.ledger import Ledger
from mrp_sumo.drive.listeners import Listener, Moment
from mrp_sumo.drive.settings import ExecutionSettings
from mrp_sumo.drive.state import AmongPeople, FloorLanes, PeopleState, for_kernels, packed
from mrp_sumo.drive.train import Trains
from mrp_sumo.engines.sumo.engine import SumoEngine

LANE_SPEEDS = 56  # purpose of the stream of chance


def nobody(num_robots: int) -> PeopleState:
    """No people at all."""
    return _people_of(num_robots, None, None, None, ProtectiveFields(), watches=False)


def _people_of(
    num_robots: int, graph: PlanGraph | None, fleet: Fleet | None, crowd: Crowd | None, fields: ProtectiveFields, *, watches: bool
) -> PeopleState:
    def of(value: float) -> FloatArray:
        return np.full(num_robots, value)

    none, head, along = np.zeros(0), np.zeros((0, 2)), np.zeros((0, 2))
    if graph is not None:
        head = graph.xy[graph.head]
        along = (head - graph.xy[graph.tail]) / np.maximum(graph.length_m, 1e-9)[:, None]
    bodies = fleet and (fleet.loaded or fleet)  # fields of robots with loads, which are no smaller
    return PeopleState(
        any=graph is not None,
        watches=watches,
        halted=crowd.robots.is_halted if crowd else np.zeros(num_robots, np.bool_),
        robots=packed(
            AmongPeople(
                since_s=of(0.0),
                free_since_s=of(np.inf),
                in_motion=np.zeros(num_robots, np.bool_),
                lost_s=of(0.0),
                lost_share=of(0.0),
                cap_mps=of(np.inf),
                half_length_m=bodies.length_m / 2 if bodies else of(np.nan),
                half_width_m=bodies.width_m / 2 if bodies else of(np.nan),
                body_x=of(np.nan),
                body_y=of(np.nan),
                body_yaw=of(np.nan),
            )
        ),
        lanes=packed(FloorLanes(head[:, 0], head[:, 1], along[:, 0], along[:, 1], graph.is_ride if graph else np.zeros(0, np.bool_))),
        vertex_xy=np.array(graph.xy) if graph else np.zeros((0, 2)),
        x_m=crowd.walkers.x_m if crowd else none,
        y_m=crowd.walkers.y_m if crowd else none,
        first=crowd.walkers.first if crowd else np.zeros(2, np.int64),
        member=crowd.walkers.member if crowd else np.zeros(0, np.int64),
        low_x=crowd.ground.x_m if crowd else 0.0,
        low_y=crowd.ground.y_m if crowd else 0.0,
        bin_m=BIN_M,
        columns=crowd.ground.columns if crowd else 1,
        rows=crowd.ground.rows if crowd else 1,
        body_m=BODY_M,
        reaction_s=fields.scanner_s + fields.control_s,
        extra_m=fields.extra_m,
        side_m=fields.side_m,
        slowest_mps=fields.slowest_mps,
        restart_s=fields.restart_s,
    )


class Bystanders:
    """People of one execution, as the loop uses them. Costs nothing where there are none."""

    def __init__(self, settings: ExecutionSettings, problem: Problem) -> None:
        graph, fleet, num_robots = problem.graph, problem.fleet, problem.num_robots
        people, self._lane_speeds_mps = settings.people, settings.lane_speeds_mps
        self.any, self.crowd = people is not None or self._lane_speeds_mps is not None, None
        if not self.any:
            self.seen = nobody(num_robots)
            return
        self._trains = Trains(fleet)
        if people is not None:
            vehicles = [train.vehicle for train in self._trains.of_robot.values()]
            towed = [(t.body_m or t.length_m, t.width_m or v.width_m) for v in vehicles for t in v.trailers]
            bodies = fleet.loaded or fleet
            length_m, width_m = np.concatenate([np.stack([bodies.length_m, bodies.width_m], 1), np.array(towed).reshape(-1, 2)]).T
            self.crowd = Crowd(people, length_m / 2, width_m / 2)
        fields = None if people is None else people.fields
        self.seen = _people_of(num_robots, graph, fleet, self.crowd, fields or ProtectiveFields(), watches=fields is not None)
        self._seen, self._was_halted = for_kernels(self.seen), self.seen.halted.copy()
        self.stops: list[tuple[int, float, float, bool]] = []  # robot, since, duration, whether it was in motion
        if self._lane_speeds_mps is not None:
            self._streams = [np.random.default_rng([problem.seed, LANE_SPEEDS, r]) for r in range(num_robots)]
            self._stretch = _stretches(graph)
            self._reached, self._on = np.full(num_robots, -1), np.full(num_robots, -1)

    def begin(self, dt: float, ledger: Ledger, driven_m: FloatArray) -> None:
        """People are there before robots set out."""
        if self.crowd is not None:
            self._see(dt, ledger, driven_m, self.crowd)
            self.crowd.begin()

    def settle(self, now_s: float, dt: float, ledger: Ledger, driven_m: FloatArray) -> None:
        """Robots have driven `driven_m` [R] by the time `now_s + dt`: people walk until then."""
        if self.crowd is not None:
            self._see(dt, ledger, driven_m, self.crowd)
            self.crowd.step(now_s, dt)
        elif self._lane_speeds_mps is not None:
            self._draw_speeds(self._lane_speeds_mps, ledger)

    def _see(self, dt: float, ledger: Ledger, driven_m: FloatArray, crowd: Crowd) -> None:
        """Have people see robots, and behind all of these the trailers, that have driven so far [R]."""
        robots, trailers, of_trailer = self.seen.robots, list[tuple[float, float, float]](), list[int]()
        for r, train in self._trains.of_robot.items():
            s_m = round(float(driven_m[r]) * GRAINS) / GRAINS  # people walk alike with either engine
            (robots.body_x[r], robots.body_y[r], robots.body_yaw[r]), *towed = train.bodies(ledger, r, s_m)
            trailers += towed
            of_trailer += [r] * len(towed)
        towed_by, bodies = np.array(of_trailer, np.int64), np.array(trailers, np.float64).reshape(-1, 3)
        state = ledger.state_records
        _people.see_robots(dt, driven_m, ledger.visits, state.motion, self._seen, crowd.robots, (towed_by, bodies))

    def notice(self, now_s: float) -> list[Event]:
        """Stops of robots that are over."""
        halted = self.seen.halted
        changed = np.flatnonzero(halted != self._was_halted)
        if not len(changed):
            return []
        self._was_halted = halted.copy()
        return [self._stop(r, now_s) for r in changed.tolist() if not halted[r]]

    def close(self, now_s: float) -> list[Event]:
        """Stops that last until the end."""
        return [self._stop(r, now_s) for r in np.flatnonzero(self.seen.halted).tolist()] if self.any else []

    def _stop(self, robot: int, now_s: float) -> Event:
        since_s, moved = float(self.seen.robots.since_s[robot]), bool(self.seen.robots.in_motion[robot])
        duration_s = round(now_s - since_s, 9)
        self.stops.append((robot, since_s, duration_s, moved))
        text = "somebody in its protective field" if moved else "somebody in its protective field as it was to set out"
        return Event(since_s, "person", robot, duration_s=duration_s, text=text)

    def _draw_speeds(self, speeds_mps: tuple[float, float, float], ledger: Ledger) -> None:
        """Those of robots that have come to another lane of the map."""
        visits = ledger.visits
        for r in np.flatnonzero(visits.reached != self._reached).tolist():
            self._reached[r] = visits.reached[r]
            ahead = int(visits.next[visits.reached[r]])
            stretch = self._on[r] if ahead < 0 else int(self._stretch[visits.lane[ahead]])
            if stretch != self._on[r]:
                self._on[r] = stretch
                self.seen.robots.cap_mps[r] = self._streams[r].triangular(*speeds_mps)


def _stretches(graph: PlanGraph) -> IntArray:
    """[L] the lane of the map that each lane is a part of, those of a grid themselves."""
    of_cut = np.maximum(graph.nav_lane[graph.tail], graph.nav_lane[graph.head])
    return np.where(of_cut >= 0, of_cut, len(graph.length_m) + np.arange(graph.num_lanes))


@dataclass
class PeopleRecorder(Listener):
    """Keeps where people are."""

    bystanders: Bystanders
    counts: list[int] = field(default_factory=lambda: [0])
    rows: list[tuple[Any, ...]] = field(default_factory=list)

    def hear(self, snapshot: Moment) -> None:
        crowd = self.bystanders.crowd
        if snapshot.is_sample and crowd is not None:
            who, n = crowd.walkers, crowd.count
            order = np.argsort(who.person[:n], kind="stable")
            self.rows.append(tuple(column[:n][order].astype(kind) for column, kind in zip((who.person, who.x_m, who.y_m), KINDS)))
            self.counts.append(n)

    def log(self, graph: PlanGraph) -> PeopleLog | None:
        """All of it."""
        crowd, seen = self.bystanders.crowd, self.bystanders.seen
        if crowd is None:
            return None
        none = tuple(np.zeros(0, kind) for kind in KINDS)
        person, x_m, y_m = (np.concatenate([none[k], *(row[k] for row in self.rows)]) for k in range(3))
        stops = sorted(self.bystanders.stops, key=lambda stop: (stop[1], stop[0]))
        robot, since_s, duration_s, moved = (np.array([stop[k] for stop in stops]) for k in range(4))
        level = np.zeros(len(crowd.waited_s), np.int64)
        if len(graph.level_names) > 1 and len(person):
            from scipy.spatial import cKDTree

            _, sample = np.unique(person, return_index=True)
            nearest = cKDTree(graph.xy).query(np.stack([x_m[sample], y_m[sample]], 1))[1]
            level[person[sample]] = graph.level[nearest]
        fields = crowd.people.fields
        return PeopleLog(
            first=frozen(np.cumsum(self.counts)),
            person=frozen(person),
            x_m=frozen(x_m),
            y_m=frozen(y_m),
            level=frozen(level),
            waited_s=frozen(crowd.totals()),
            radius_m=BODY_M,
            lost_s=frozen(seen.robots.lost_s),
            stop_robot=frozen(robot.astype(np.int64)),
            stop_s=frozen(since_s.astype(np.float64)),
            stop_duration_s=frozen(duration_s.astype(np.float64)),
            stop_in_motion=frozen(moved.astype(np.bool_)),
            extra_m=fields.extra_m if fields else np.nan,
            reaction_s=fields.scanner_s + fields.control_s if fields else 0.0,
            side_m=fields.side_m if fields else 0.0,
            slowest_mps=fields.slowest_mps if fields else np.inf,
        )


@dataclass(frozen=True)
class PeopleInGui(Listener):
    """Draws people in sumo-gui."""

    crowd: Crowd

    def hear(self, snapshot: Moment) -> None:
        who, n = self.crowd.walkers, self.crowd.count
        cast(SumoEngine, snapshot.bodies).show_people(np.stack([who.x_m[:n], who.y_m[:n]], 1), BODY_M)


KINDS = np.int32, np.float32, np.float32  # of person, x, y
