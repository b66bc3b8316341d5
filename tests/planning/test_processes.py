"""Limits of other processes, on a clock that the test moves."""

from dataclasses import dataclass

import pytest

from mrp_sumo.planning import processes


@dataclass
class Machine:
    """A clock in s, and the part of time for which a process waits for a processor."""

    starved: float
    now_s: float = 0.0
    ends_s: float = 1e9  # when something ends

    def ended(self, wait_s):
        self.now_s = min(self.now_s + wait_s, max(self.ends_s, self.now_s))
        return self.now_s >= self.ends_s - 1e-9


def within(machine, monkeypatch):
    monkeypatch.setattr(processes, "perf_counter", lambda: machine.now_s)
    monkeypatch.setattr(processes, "_starved_s", lambda pid: machine.starved * machine.now_s)
    return processes.ends_within(1, 10.0, machine.ended)


@pytest.mark.parametrize(("starved", "ends_s", "ends"), [
    (0.0, 9.9, True), (0.0, 10.1, False),
    (0.75, 39.0, True), (0.75, 41.0, False),  # a quarter of a processor: ten seconds of its own in forty
])  # fmt: skip
def test_time_without_a_processor_does_not_count(starved, ends_s, ends, monkeypatch):
    assert within(Machine(starved, ends_s=ends_s), monkeypatch) is ends
