"""The traffic of a crowd: the prices of steps that follow from it, and where it leaves room.

A step counts as more against the stream, and into a cell where robots wait. So streams form where the map wants them, and robots drive
round jams before these grow; where nearly all cells are full and robots wait everywhere, only streams count: traffic flow as guidance,
after Chen et al., "Traffic Flow Optimisation for Lifelong Multi-Agent Path Finding" (AAAI 2024), from its description.
"""

import numpy as np
from numpy.typing import NDArray

from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.core.step_wise import FORWARD, NOTHING, WAIT
from planners.step_wise.ground import MOST_DEAR, FreeCells

EVERY = 10  # steps, at the least, from prices to prices
SHARE = 0.006  # of the work of a step that goes into tables of new prices, at most
STAYS = 0.9  # of what was seen, after EVERY steps
FULL = 0.8  # robots per free cell from which jams, which are everywhere, count nothing:
STREAM, JAM = (2, 8), (10, 0)  # times `against`, below and above, against a stream with nobody against it, and where always somebody waits
CROWDED = 0.7  # robots per free cell from which room is made:
FIRST = 0.6  # of the robots go to their errands in the densest parts of the crowd; the others to where there is room
ROOMY = 1.75  # times as many cells are free there as elsewhere
EMPTY = 0.2  # robots per free cell below which robots are held back where jams form:
STANDING, JAMMED = 0.2, 0.05  # robots per free cell that stand where there is a jam, and share of those on their way that may be in one
HOLDS, LEAST = 0.1, 0.2  # what that share changes by after a step in which all are in jams, and its least value
AROUND = 8  # times the mean with their neighbours is taken of cells to see that
LASTS = 0.8  # of what was seen around a cell, after a step


class CrowdTraffic:
    """Moves and waits that were seen, the less the longer ago."""

    def __init__(self, ground: FreeCells, num_robots: int) -> None:
        """At first as if a robot had driven each step that is not against a row's or column's direction."""
        self._ground, ahead = ground, ground.ahead
        self._against = np.where(ahead >= 0, 4 * ahead + ((np.arange(len(ahead)) + 2) & 3), 0)  # [S] the state of who comes from there
        self._moves = np.where(ground.price > 1, 0.0, 1.0)  # [S] forward
        self._waits = np.zeros(ground.num_cells)  # [C]
        is_full = num_robots >= FULL * ground.num_cells
        self._stream, self._jam = STREAM[is_full], JAM[is_full]
        self._seen, self._since = 0.0, 0  # steps, as moves are counted, and those since the last prices

    def see(self, state: NDArray[np.int32], action: NDArray[np.int8]) -> None:
        """See what robots [R] do in a step. Now and then prices change, and the ground forgets what it knows of distances."""
        ground = self._ground
        np.add.at(self._moves, state[action == FORWARD], 1.0)
        np.add.at(self._waits, state[action == WAIT] >> 2, 1.0)
        self._seen, self._since = self._seen + 1.0, self._since + 1
        if self._since < max(EVERY, int(ground.num_tables * len(ground.ahead) / (SHARE * ground.work))):
            return
        ground.reprice(self._prices())
        stays, self._since = STAYS ** (self._since / EVERY), 0
        self._moves, self._waits, self._seen = self._moves * stays, self._waits * stays, self._seen * stays

    def _prices(self) -> NDArray[np.int32]:
        against, oncoming = self._ground.against, self._moves[self._against]
        share = np.divide(oncoming, self._moves + oncoming, out=np.full(len(oncoming), 0.5), where=self._moves + oncoming > 0)
        waiting = self._waits[np.maximum(self._ground.ahead, 0)] / self._seen
        more = against * (self._stream * np.maximum(2 * share - 1, 0.0) + self._jam * waiting)
        price: NDArray[np.int32] = 1 + np.rint(np.minimum(more, MOST_DEAR * against)).astype(np.int32)
        return price


class CrowdRoom:
    """Parts of a crowd where there is room, and how many robots go to their errands.

    Robots come to stand around errands in a crowd's midst, and those that cannot reach theirs shut others out. In halls joined by
    corridors a few robots already block the crossings, while most of the floor is empty: a jam lets fewer robots through than come to it.
    """

    def __init__(self, ground: FreeCells, num_robots: int) -> None:
        ahead, cells = ground.ahead.reshape(-1, 4), np.arange(ground.num_cells)
        self._ground, self._around = ground, np.where(ahead < 0, cells[:, None], ahead)
        share = num_robots / ground.num_cells
        self._holds = share < EMPTY and ground.against > 0
        self._most = 1 - ROOMY * (1 - share) if share >= CROWDED else STANDING if self._holds else 0.0  # robots a cell where there is room
        self._first = 1.0 if self._holds else FIRST
        self._before = np.zeros(num_robots, np.int32)
        self.in_jam = np.zeros(num_robots, np.bool_)
        self._robots = np.full(ground.num_cells, share)  # for each cell around it

    def send(self, state: NDArray[np.int32], order: IntArray) -> tuple[IntArray, IntArray]:
        """The last robots in the order, and for each the slot of a table of steps to where there is room, or NOTHING if it stays.

        In a crowd these are robots that stand where there is no room; on a floor with room, all beyond the share that jams leave.
        """
        if not self._most:
            return order[:0], order[:0]
        standing, self._before = state[state == self._before], state.copy()
        robots = np.bincount((standing if self._holds else state) >> 2, minlength=len(self._robots)).astype(np.float64)
        for _ in range(AROUND):
            robots = (robots + robots[self._around].sum(1)) / 5
        self._robots = LASTS * self._robots + (1 - LASTS) * robots
        self.in_jam = in_jam = self._robots[state >> 2] >= self._most
        if self._holds:
            self._first = min(1.0, max(LEAST, self._first + HOLDS * (JAMMED - in_jam[order[: int(self._first * len(order))]].mean())))
        late = order[int(self._first * len(order)) :]
        roomy = np.flatnonzero(self._robots < self._most)
        there = self._ground.to_nearest(roomy) if len(roomy) and in_jam[late].any() else NOTHING
        late = late if self._holds else late[in_jam[late]] if len(roomy) else late[:0]
        return late, np.where(in_jam[late], there, NOTHING)


def let_out(outward: IntArray, cell: IntArray, goal: IntArray, rank: IntArray) -> FloatArray:
    """[R] ranks of robots at cells [R], the least first; who stands on the way into a dead end comes before who has to go in.

    A robot before a dead end stays there, and the one inside, who comes later, does not get by: the first in the order would be those that
    wait before dead ends. `outward` [C] is the cell by which one leaves a dead end, NOTHING elsewhere; goals [R] are cells, or NOTHING.
    """
    at, let = np.full(len(outward), NOTHING), rank.astype(np.float64)
    at[cell] = np.arange(len(cell))
    who, before = np.flatnonzero(goal != NOTHING), 0.5
    now = goal[who]
    while len(who):
        going = (outward[now] != NOTHING) & (now != cell[who])
        who, now = who[going], now[going]
        there = at[now] != NOTHING
        np.minimum.at(let, at[now[there]], rank[who[there]] - before)
        now, before = outward[now], (1 + before) / 2  # the outermost first
    return let
