"""Checks of the parameters that conflict-based planners share."""

from mrp_sumo.errors import PlanError


def check(memory_mb: int, w: float = 1.0) -> None:
    """Refuse parameters that make no sense.

    Raises
    ------
    PlanError
        For a factor below 1 or without end, or less than 1 MB.
    """
    if not 1 <= w < float("inf"):
        raise PlanError(f"w is {w}, expected a finite number of 1 or more")
    if memory_mb < 1:
        raise PlanError(f"memory_mb is {memory_mb}, expected 1 or more")
