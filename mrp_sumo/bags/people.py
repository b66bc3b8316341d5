"""/people, as people_msgs/People, and /people_markers: where people are, as spheres for RViz and Foxglove."""

import numpy as np

from mrp_sumo.bags.messages import EPOCH_NS, Messages
from mrp_sumo.bags.streams import Samples
from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.people import PeopleLog

PEOPLE, MARKERS = ("/people", "people_msgs/People"), ("/people_markers", "visualization_msgs/MarkerArray")
PERIOD_NS = 200_000_000
SPHERES = 7
COLOUR = (0.80, 0.47, 0.65, 1.0)  # that no state of a robot has
CHEST_M = 1.0  # above the floor


class _Sightings:
    """Who is where at the times of a topic: at the samples before."""

    def __init__(self, m: Messages, samples: Samples) -> None:
        execution = m.record.execution
        assert execution.people is not None
        self.m, self.log = m, execution.people
        self.stamps: list[int] = (EPOCH_NS + samples.t_ns).tolist()
        self.period_s = execution.period_s
        rows = np.searchsorted(execution.t_s, samples.t_ns / 1e9 + 1e-9, side="right") - 1
        self.sample: IntArray = np.clip(rows, 0, len(execution.t_s) - 1)

    def at(self, k: int) -> tuple[PeopleLog, slice]:
        """The log, and its rows at the k-th time."""
        sample = int(self.sample[k])
        return self.log, slice(int(self.log.first[sample]), int(self.log.first[sample + 1]))

    def velocity(self, k: int) -> FloatArray:
        """[N, 2] m/s, from where people are a sample later; 0 for those who are gone then."""
        log, rows = self.at(k)
        sample = min(int(self.sample[k]) + 1, len(log.first) - 2)
        after = slice(int(log.first[sample]), int(log.first[sample + 1]))
        velocities = np.zeros((rows.stop - rows.start, 2))
        _, here, there = np.intersect1d(log.person[rows], log.person[after], assume_unique=True, return_indices=True)
        for axis, column in enumerate((log.x_m, log.y_m)):
            velocities[here, axis] = (column[after][there] - column[rows][here]) / self.period_s
        return velocities


class PeopleTopic(_Sightings):
    """/people."""

    def message(self, k: int) -> bytes:
        """The message at the k-th time."""
        m, (log, rows) = self.m, self.at(k)
        people = [
            m.make("people_msgs/Person", f"person_{p}", m.point(x, y), m.point(vx, vy), 1.0, [], [])
            for p, x, y, (vx, vy) in zip(*(c[rows].tolist() for c in (log.person, log.x_m, log.y_m)), self.velocity(k).tolist())
        ]
        return m.message("people_msgs/People", m.header(self.stamps[k], "map"), people)


class Markers(_Sightings):
    """/people_markers: one marker with a sphere for each person."""

    def message(self, k: int) -> bytes:
        """The message at the k-th time."""
        m, (log, rows) = self.m, self.at(k)
        points = [m.point(x, y, CHEST_M) for x, y in zip(log.x_m[rows].tolist(), log.y_m[rows].tolist())]
        marker = m.marker(self.stamps[k], "map", "people", 0, SPHERES, scale=(2 * log.radius_m,) * 3, color=COLOUR, points=points)
        return m.message(MARKERS[1], [marker])
