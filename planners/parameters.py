"""Checks of parameters that several planners have; each raises a PlanError."""

from mrp_sumo.errors import PlanError

LONGEST_LOCAL = 126  # steps of a path of local guidance: its tables have a slot for each step and vertex


def check_local(name: str, local: int) -> None:
    """Refuse a window of local guidance that there is no room for, in the name of a planner."""
    if not 0 <= local <= LONGEST_LOCAL:
        raise PlanError(f"{name}: local is {local}, expected 0 to {LONGEST_LOCAL}")
