"""Rules for orders that go wrong: when they are withdrawn, and when they are begun anew."""

from dataclasses import dataclass

from mrp_sumo.core.options import Options, option
from mrp_sumo.errors import OptionError


@dataclass(frozen=True)
class Cancel(Options):
    """Withdrawal of orders that no robot has picked up."""

    overdue: bool = option(False, "Once they are due.")
    after_s: float | None = option(None, "Time after their release.", gt=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.overdue and self.after_s is None:
            raise OptionError("cancels nothing: give overdue: true, after_s, or both")


@dataclass(frozen=True)
class Retry(Options):
    """The fate of an order whose robot breaks down for good or runs empty with it on board; without this it fails."""

    times: int = option(0, "How often another robot begins the order anew.", ge=0, le=1000)
    hand_over: bool = option(False, "Another robot fetches the load beside the one that is lost, and makes the other stops.")

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.times and not self.hand_over:
            raise OptionError("retries nothing: give times, or hand_over: true")
        if self.times and self.hand_over:
            raise OptionError("gives times and hand_over, expected one: a load that is handed over is not begun anew")
