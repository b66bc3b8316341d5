"""The face of whatever carries messages of VDA 5050 between vehicles and their master.

Both ends are named by serial number and kind of message; how topics are written is the dialect's.
"""

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
        """Messages that have come in, waiting for the first so long."""

    def close(self) -> None:
        """Say good-bye."""
