"""Simulated time that goes on as fast as the clock on the wall, or faster by a factor, while messages are waited for."""

import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TextIO

from mrp_sumo.drive.listeners import Listener, Moment
from mrp_sumo.files.reading import json_value
from mrp_sumo.formats.vda.messages import Dialect
from mrp_sumo.wire.link import Link, Received

MOST_BEHIND_S = 1.0  # of wall time; what is lost beyond is not made up for


@dataclass
class Pace:
    """Says when a step is due."""

    speed: float  # simulated seconds a second
    begun_s: float = 0.0  # on the monotonic clock
    behind_s: float = 0.0  # the most that steps have come too late

    def __post_init__(self) -> None:
        self.begun_s = time.monotonic()

    def wait(self, now_s: float, receive: Callable[[float], list[Received]]) -> list[Received]:
        """Messages that come in before the step at a simulated time is due."""
        due = self.begun_s + now_s / self.speed
        messages = receive(0.0)
        while (left := due - time.monotonic()) > 0:
            messages += receive(left)
        self.behind_s = max(self.behind_s, -left)
        if -left > MOST_BEHIND_S:
            self.begun_s += -left
        return messages


@dataclass
class Paced(Listener):
    """A listener that lets a run be driven no faster than the clock allows."""

    pace: Pace

    def hear(self, state: Moment) -> None:
        self.pace.wait(state.now_s, _sleep)


def _sleep(wait_s: float) -> list[Received]:
    time.sleep(wait_s)
    return []


@dataclass
class Logged:
    """A link that writes down what goes over it, one line per message, as `mrp-sumo validate --vda5050` and `import` read it."""

    link: Link
    file: TextIO
    dialect: Dialect
    manufacturer: str
    now_s: Callable[[], float]

    def publish(self, serial: str, kind: str, payload: bytes) -> None:
        """See Link."""
        self.note(serial, kind, payload)
        self.link.publish(serial, kind, payload)

    def receive(self, wait_s: float) -> list[Received]:
        """See Link."""
        messages = self.link.receive(wait_s)
        for one in messages:
            self.note(*one)
        return messages

    def close(self) -> None:
        """See Link."""
        self.link.close()

    def note(self, serial: str, kind: str, payload: bytes) -> None:
        """Write a message down; what is not JSON is left out."""
        try:
            document = json_value(payload)
        except (ValueError, RecursionError):
            return
        topic = self.dialect.topic(serial, kind, self.manufacturer)
        self.file.write(json.dumps({"t_s": self.now_s(), "topic": topic, "payload": document}, separators=(",", ":")) + "\n")
