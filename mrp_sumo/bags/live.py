"""/clock, /fleet_states, and states of lifts and doors and requests for them while a run drives: the messages that its bag will have."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from mrp_sumo.bags import streams
from mrp_sumo.bags.facility_states import TOPICS, facility_states
from mrp_sumo.bags.messages import EPOCH_NS, Messages
from mrp_sumo.bags.writer import FLEET_STATES_NS
from mrp_sumo.core.angles import wrapped
from mrp_sumo.core.battery import BatteryLog
from mrp_sumo.core.execution import Execution
from mrp_sumo.core.graph import FloatArray, IntArray
from mrp_sumo.drive.facilities import FacilityRecorder
from mrp_sumo.drive.ledger import Ledger
from mrp_sumo.drive.listeners import Moment, way_of
from mrp_sumo.drive.robot_work import stop_log
from mrp_sumo.io.record import RunRecord

CLOCK, FLEET = ("/clock", "rosgraph_msgs/Clock"), ("/fleet_states", "rmf_fleet_msgs/FleetState")
TYPE = dict(TOPICS)
DEPTH = {CLOCK[0]: 1, FLEET[0]: 10, **dict.fromkeys(TYPE, 100)}  # of the queues that Open-RMF gives these topics


class LiveMessages:
    """Makes messages of moments of one run."""

    def __init__(self, record: RunRecord, generation: str = "jazzy") -> None:
        """`record`: of the run before it is driven. Raises MrpSumoError for an unknown generation of rmf_fleet_msgs."""
        self.messages = Messages(record, generation)
        self._at_outset = record
        self._facilities: FacilityRecorder | None = None
        self._num_states = 0
        self._ways: list[tuple[FloatArray, FloatArray, IntArray]] = []  # of robots, as far as the ledger knew them when they last changed
        self._ways_since = (-1, -1)
        self._until_s = -1.0  # to which lifts and doors have been reported

    def of(self, state: Moment) -> Iterator[tuple[str, str, bytes]]:
        """(topic, type, message) of what is due at a moment. All moments have to come, since lifts and doors change between samples."""
        m, now_s, now_ns = self.messages, state.now_s, round(state.now_s * 1e9)
        if state.is_sample:
            yield *CLOCK, m.message(CLOCK[1], m.time(EPOCH_NS + now_ns))
        if state.facilities.any:
            self._facilities = self._facilities or FacilityRecorder(state.ledger.graph, state.facilities)
            self._facilities.hear(state)
            m.record = replace(self._at_outset, execution=replace(self._at_outset.execution, facilities=self._facilities.log()))
            for _, topic, message in facility_states(m, now_s, self._until_s):
                yield topic, TYPE[topic], message
            self._until_s = now_s
        if now_ns >= self._num_states * FLEET_STATES_NS:
            m.record = replace(self._at_outset, execution=self.now(state))
            states = streams.fleet_states(m, streams.Samples(m.record, np.array([now_ns]), self._num_states)).message(0)
            assert states is not None
            yield *FLEET, states
            self._num_states += 1

    def now(self, state: Moment) -> Execution:
        """An execution that consists of this moment."""
        ledger, motion, execution = state.ledger, state.ledger.state.motion, self._at_outset.execution
        x, y, level = self._places(ledger)
        none = np.zeros(0)
        return replace(
            execution,
            t_s=np.array([state.now_s]),
            x_m=x[None],
            y_m=y[None],
            yaw_rad=wrapped(ledger.yaw_rad)[None],
            speed_mps=motion.speed_mps[None].copy(),
            goal_s=np.where(ledger.state.home, ledger.state.waits.goal_s, np.nan) if execution.tasks is None else execution.goal_s,
            level=None if execution.level is None else level[None],
            tasks=None if execution.tasks is None else state.crew.orders.log(),
            stops=None if execution.tasks is None else stop_log(state.crew.robots),
            batteries=BatteryLog(np.array([state.now_s]), state.crew.level[None].copy(), none, none, 0.0),
        )

    def _places(self, ledger: Ledger) -> tuple[FloatArray, FloatArray, IntArray]:
        """[R] x and y of robots, as they are recorded, and the levels on which they are."""
        since = len(ledger.entries), len(ledger.turn_backs)
        if since != self._ways_since:  # what the ledger forgets later does no harm
            self._ways, self._ways_since = [way_of(ledger, r) for r in range(ledger.num_robots)], since
        s_m = ledger.state.motion.s_m
        x, y, level = np.empty_like(s_m), np.empty_like(s_m), np.empty(len(s_m), np.int64)
        for r, (at_m, xy, on) in enumerate(self._ways):
            k = max(int(at_m.searchsorted(s_m[r], side="right")) - 1, 0)
            near = slice(k, k + 2)
            x[r], y[r] = np.interp(s_m[r], at_m[near], xy[near, 0]), np.interp(s_m[r], at_m[near], xy[near, 1])
            level[r] = on[k]
        return x, y, level
