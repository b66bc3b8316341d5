"""The people of one run: who comes when, who has arrived, and their ways.

Same seed, same people; each kind of chance has a stream of its own. People appear where they come from as soon as there is room
beside robots and other people, and are gone where they arrive.
"""

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.crowd import _floor, _walk
from mrp_sumo.crowd.model import People, joint_places
from mrp_sumo.crowd.state import BODY_M, CELL_M, Ground, Machines, Walkers

ARRIVALS, TRIPS, SPEEDS, PLACES = range(51, 55)  # purposes of the streams of chance
MOST_PEOPLE = 5000  # at a time; others wait outside
KEPT_BYTES = 64_000_000  # of ways to places
APPEAR_WITHIN_M = 1.0  # of the place that people come from
ROOM_M = 0.2  # between people who appear and others
ROBOT_ROOM_M, ROBOT_ROOM_S = 0.8, 1.5  # from robots, and what these drive in this time
TRIES = 4  # to find room
LOOK_EVERY_S = 0.5
SLOWEST_MPS = 0.3


class Crowd:
    """People, and the robots that they see."""

    def __init__(self, people: People, half_length_m: FloatArray, half_width_m: FloatArray) -> None:
        """`half_length_m`, `half_width_m` [R]: of the robots' footprints."""
        floor, num_robots = people.floor, len(half_length_m)
        self.people = people
        columns, rows = (max(1, int(np.ceil(cells * CELL_M / _walk.BIN_M))) for cells in (floor.width, floor.height))
        self.ground = Ground(
            *floor.corner_m, floor.width, floor.height, floor.walls, floor.first, floor.near, floor.free, floor.back, columns, rows
        )
        room = max(people.count, MOST_PEOPLE if people.flows else 1)
        self.walkers = Walkers(
            x_m=np.zeros(room),
            y_m=np.zeros(room),
            vx_mps=np.zeros(room),
            vy_mps=np.zeros(room),
            ax_mps2=np.zeros(room),
            ay_mps2=np.zeros(room),
            wish_mps=np.zeros(room),
            headway_s=np.zeros(room),
            spacing_m=np.zeros(room),
            person=np.zeros(room, np.int64),
            goal=np.zeros(room, np.int64),
            home=np.zeros(room, np.int64),
            away_until_s=np.zeros(room),
            stuck_s=np.zeros(room),
            waited_s=np.zeros(room),
            is_there=np.zeros(room, np.bool_),
            first=np.zeros(columns * rows + 1, np.int64),
            member=np.zeros(room, np.int64),
        )
        self.robots = Machines(
            x_m=np.full(num_robots, np.nan),
            y_m=np.full(num_robots, np.nan),
            yaw_rad=np.full(num_robots, np.nan),
            along_mps=np.full(num_robots, np.nan),
            half_length_m=half_length_m,
            half_width_m=half_width_m,
            side_m=people.fields.side_m if people.fields else 0.0,
            is_halted=np.zeros(num_robots, np.bool_),
            first=np.zeros(columns * rows + 1, np.int64),
            member=np.zeros(num_robots, np.int64),
        )
        self.count = 0  # of people who are there
        self.waited_s: list[float] = []  # by person
        self._stream = {purpose: np.random.default_rng([people.seed, purpose]) for purpose in (TRIPS, SPEEDS, PLACES)}
        self._reachable = joint_places(people)
        shares = np.array([group.share for group in people.groups])
        self._shares = shares / shares.sum()
        self._ways: NDArray[np.uint8] = np.zeros((0, floor.width * floor.height), np.uint8)
        self._row: dict[int, int] = {}  # of the ways to a place, the least recently used first
        self._look_again_s = 0.0
        self._outside: list[tuple[int, int]] = []  # trips of those who have not found room yet: from place to place
        times = [
            flow.arrivals.times(np.random.default_rng([people.seed, ARRIVALS, k]), clock_s=people.clock_s)
            for k, flow in enumerate(people.flows)
        ]
        self._next = [(next(some), some) for some in times]  # by flow: when somebody sets out, and those after it

    def begin(self) -> None:
        """People who are there from the start appear anywhere between the places, as far as there is room."""
        people, stream = self.people, self._stream[PLACES]
        region = people.floor.region[people.place]
        used = np.unique(region[[bool(ends) for ends in self._reachable]])
        cells = np.flatnonzero(np.isin(people.floor.region, used)) if people.count else np.zeros(0, np.int64)
        for _ in range(TRIES * people.count):
            cell = cells[stream.integers(len(cells))]
            xy = people.floor.centre_of(cell)
            if self.count < people.count and self._has_room(xy):
                near = np.flatnonzero(region == people.floor.region[cell])
                self._add(xy, self._trip_from(near.tolist()))
        _walk.walk(0.0, 0.0, 0, self.walkers, self.ground, self.robots, self._ways)  # the kernel is loaded before time is measured

    def step(self, now_s: float, dt: float) -> None:
        """Let people walk until `now_s + dt`; `robots` says where these are then."""
        if self.count:
            there = _walk.walk(now_s, dt, self.count, self.walkers, self.ground, self.robots, self._ways)
            if there:
                self._leave()
        self._come(now_s + dt)

    def totals(self) -> FloatArray:
        """[N] how long each person has stood before robots so far, s."""
        waited_s = np.array(self.waited_s)
        waited_s[self.walkers.person[: self.count]] = self.walkers.waited_s[: self.count]
        return waited_s

    def _trip_from(self, places: list[int]) -> tuple[int, int]:
        stream = self._stream[TRIPS]
        origin = places[stream.integers(len(places))]
        ends = self._reachable[origin]
        return origin, ends[stream.integers(len(ends))]

    def _come(self, now_s: float) -> None:
        """Those who set out, as far as there is room."""
        stream, anywhere = self._stream[TRIPS], None
        for k, flow in enumerate(self.people.flows):
            while self._next[k][0] <= now_s:
                origin = flow.origins[stream.integers(len(flow.origins))]
                ends = [place for place in flow.destinations if place in self._reachable[origin]]
                if ends:
                    self._outside.append((origin, ends[stream.integers(len(ends))]))
                self._next[k] = next(self._next[k][1]), self._next[k][1]
        while self.people.count > self.count + len(self._outside):
            anywhere = anywhere or [k for k, ends in enumerate(self._reachable) if ends]
            self._outside.append(self._trip_from(anywhere))
        if not self._outside or now_s < self._look_again_s:
            return
        waiting = []
        for trip in self._outside:
            xy = self._room_near(trip[0]) if self.count < len(self.walkers.x_m) else None
            if xy is not None:
                self._add(xy, trip)
            elif self.people.flows:
                waiting.append(trip)  # else somebody comes from another place
        self._outside, self._look_again_s = waiting, now_s + LOOK_EVERY_S

    def _room_near(self, place: int) -> FloatArray | None:
        """Where somebody may appear near a place, None where there is no room now."""
        floor, row = self.people.floor, self._way_to(place)
        middle = floor.centre_of(self.people.place[place])
        points: FloatArray = middle + self._stream[PLACES].uniform(-APPEAR_WITHIN_M, APPEAR_WITHIN_M, (TRIES, 2))
        cells = floor.cell_of(points)
        inside = (cells >= 0) & (self._ways[row, cells] == _floor.THERE)
        return next((point for point in points[inside] if self._has_room(point)), None)

    def _has_room(self, xy: FloatArray) -> bool:
        """True if nobody is near a point, and no robot, the less so the faster it drives."""
        walkers, robots = self.walkers, self.robots
        if np.hypot(walkers.x_m[: self.count] - xy[0], walkers.y_m[: self.count] - xy[1]).min(initial=np.inf) < 2 * BODY_M + ROOM_M:
            return False
        away = np.hypot(robots.x_m - xy[0], robots.y_m - xy[1]) - np.hypot(robots.half_length_m, robots.half_width_m)
        return not (away < ROBOT_ROOM_M + ROBOT_ROOM_S * np.abs(robots.along_mps)).any()

    def _add(self, xy: FloatArray, trip: tuple[int, int]) -> None:
        walkers, p = self.walkers, self.count
        group = self.people.groups[int(self._stream[SPEEDS].choice(len(self._shares), p=self._shares))]
        likes = group.speed_mps + group.spread_mps * np.clip(self._stream[SPEEDS].normal(), -2.0, 2.0)
        for column in walkers[:16]:
            column[p] = 0
        walkers.x_m[p], walkers.y_m[p] = xy
        walkers.wish_mps[p] = max(likes, SLOWEST_MPS)
        walkers.headway_s[p], walkers.spacing_m[p] = group.headway_s, group.spacing_m
        walkers.person[p] = len(self.waited_s)
        self.waited_s.append(0.0)
        self.count += 1
        walkers.goal[p] = self._way_to(trip[1])  # first: a row that is in use stays
        walkers.home[p] = self._way_to(trip[0])

    def _leave(self) -> None:
        """Those who have arrived are gone; the last ones take their rows."""
        walkers = self.walkers
        for p in range(self.count - 1, -1, -1):
            if walkers.is_there[p]:
                self.waited_s[walkers.person[p]] = float(walkers.waited_s[p])
                self.count -= 1
                for column in walkers[:16]:
                    column[p] = column[self.count]
        _walk.put_in_bins(walkers.x_m, walkers.y_m, self.count, self.ground, walkers.first, walkers.member)

    def _way_to(self, place: int) -> int:
        """The row of the ways to a place. The least recently used row that nobody needs is used again once there are many."""
        if place in self._row:
            row = self._row.pop(place)
        else:
            floor = self.people.floor
            most = max(4, KEPT_BYTES // max(1, floor.width * floor.height))
            used = {*self.walkers.goal[: self.count].tolist(), *self.walkers.home[: self.count].tolist()}
            free = next((old for old, row in self._row.items() if row not in used), None) if len(self._row) >= most else None
            row = len(self._row) if free is None else self._row.pop(free)
            if row >= len(self._ways):
                more = max(1, min(len(self._ways), most - len(self._ways)))
                self._ways = np.concatenate([self._ways, np.full((more, floor.width * floor.height), _floor.NO_WAY, np.uint8)])
            start = int(self.people.place[place])
            _floor.march(start, floor.free, floor.away_m, CELL_M, BODY_M, floor.width, self._ways[row])
        self._row[place] = row
        return row
