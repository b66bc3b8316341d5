"""Options of how a plan is driven: of planning while robots drive, and of recovery. Parts of `execution` of a scenario."""

from dataclasses import dataclass

from mrp_sumo.core.options import Options, option


@dataclass(frozen=True, kw_only=True)
class Planning(Options):
    """Planning while robots drive, again and again, in simulated time."""

    budget_s: float = option(1.0, "An answer takes effect so long after it was asked for; until then robots keep their plan.", ge=0)
    period_s: float = option(0.0, "The least time between two requests; else there is one when a task comes or a stop is made.", ge=0)
    window_s: float | None = option(
        None,
        "Plans reach so far ahead: beyond, robots need not keep clear of each other. 0: to the end. By default the way into the longest "
        "aisle and back and 10 planned steps, at least 20, for planners that support windows, to the end for others.",
        ge=0,
        le=1e6,
    )
    effort: int = option(1_000_000, "Labels that a planner may make for an answer: what ends its search.", ge=1)


@dataclass(frozen=True, kw_only=True)
class RecoveryOptions(Options):
    """Remedies of `on_deadlock: resolve`, mildest first."""

    give_way: bool = option(True, "First come first served, one of a ring of waiting robots steps aside or backs out.")
    patience_s: float = option(10.0, "Time blocked for good before a robot drives around, or all are replanned.", gt=0, le=1e9)
    replanner: str | None = option("lacam", "Any planner, by name or FILE.py:CLASS; null: none.")
