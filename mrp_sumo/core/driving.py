"""Options of how a plan is driven. Parts of `execution` of a scenario."""

from dataclasses import dataclass, field
from math import inf
from typing import Literal

from mrp_sumo.core.disturbances import NONE, Disturbances
from mrp_sumo.core.options import Options, meaning, option

FEW, CROWD = 12, 60  # robots that are planned whenever anything happens, and every few steps
PERIOD_STEPS = 5


@dataclass(frozen=True, kw_only=True)
class Planning(Options):
    """Planning while robots drive, again and again, in simulated time."""

    budget_s: float = option(1.0, "Time from a request until its answer takes effect; until then robots keep their plan.", ge=0)
    period_s: float | None = option(
        None,
        "Least time between two requests; there is one when a task comes or a stop is made. By default 0 up to 12 robots and where stops "
        "take time, 5 planned steps from 60 robots on.",
        ge=0,
    )
    window_s: float | None = option(
        None,
        "How far ahead robots keep clear of each other; 0: to the end. By default the way into the longest aisle and back and 10 planned "
        "steps, at least 20; to the end for planners that do not support windows.",
        ge=0,
        le=1e6,
    )
    effort: int = option(1_000_000, "Labels that a planner may make for an answer: what ends its search.", ge=1)

    def least_period_s(self, num_robots: int, step_s: float) -> float:
        """Time in s from a request to the next one, at least."""
        if self.period_s is not None:
            return self.period_s
        longest_s = min(PERIOD_STEPS * step_s, self.window_s / 3 if self.window_s else inf)
        return longest_s * min(max((num_robots - FEW) / (CROWD - FEW), 0.0), 1.0)


@dataclass(frozen=True, kw_only=True)
class RecoveryOptions(Options):
    """Remedies of `on_deadlock: resolve`, mildest first."""

    give_way: bool = option(True, "Under policies without an order, one of a ring of waiting robots steps aside or backs out.")
    patience_s: float = option(10.0, "Time blocked for good before a robot drives around, or all are replanned.", gt=0, le=1e9)
    replanner: str | None = option("lacam", "Any planner, by name or FILE.py:CLASS; null: none.")


@dataclass(frozen=True, kw_only=True)
class DrivingOptions(Options):
    """Options that reach whoever drives as a scenario has them."""

    engine: Literal["sumo", "kinematic"] = option("sumo", "What moves the bodies: SUMO, or the robots' limits alone, which is faster.")
    planning: Planning = field(default=Planning(), metadata=meaning("Planning while robots drive, for `tasks`."))
    step_length_s: float = option(0.1, "Step of the simulation.", gt=0, le=1)
    blocking_window_s: float = option(10.0, "A robot without a cell of progress along its path for so long is blocked.", gt=0, le=1e9)
    on_deadlock: Literal["report", "stop", "resolve"] = option("report", "'resolve': see recovery.")
    recovery: RecoveryOptions = field(default=RecoveryOptions(), metadata=meaning("What `on_deadlock: resolve` does, mildest first."))
    disturbances: Disturbances = field(default=NONE, metadata=meaning("What goes wrong; the name of a set alone is short for it."))
