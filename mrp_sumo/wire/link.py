"""What carries messages of VDA 5050 between vehicles and their master, whatever it is: the face, and one within a process.

Both ends are named by serial number and kind of message; how topics are written is the dialect's.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

TO_VEHICLES = ("order", "instantActions")
FROM_VEHICLES = ("connection", "factsheet", "state", "visualization")


class Received(NamedTuple):
    """A message that has come in."""

    serial: str
    kind: str
    payload: bytes


class Link(Protocol):
    """One end: of all vehicles, or of their master."""

    def publish(self, serial: str, kind: str, payload: bytes) -> None:
        """Send a message of or to a vehicle. One that cannot be sent now is lost, as the standard has it."""

    def receive(self, wait_s: float) -> list[Received]:
        """What has come in, waiting for the first so long."""

    def close(self) -> None:
        """Say good-bye."""


@dataclass
class Loopback:
    """One of two ends within a process, for tests and for those who have no broker."""

    inbox: deque[Received] = field(default_factory=deque)
    other: "Loopback | None" = None

    def publish(self, serial: str, kind: str, payload: bytes) -> None:
        """See Link."""
        assert self.other is not None
        self.other.inbox.append(Received(serial, kind, payload))

    def receive(self, wait_s: float) -> list[Received]:
        """See Link."""
        messages = list(self.inbox)
        self.inbox.clear()
        return messages

    def close(self) -> None:
        """See Link."""


def loopback() -> tuple[Loopback, Loopback]:
    """Two ends that are joined."""
    one, other = Loopback(), Loopback()
    one.other, other.other = other, one
    return one, other
