"""Metrics of the audit: how near robots came to each other, and to walls."""

from mrp_sumo.metrics.metric import Evidence, metric


@metric("m", "more", "least distance of two footprints (rectangles with heading) at any time, also between samples; 0 when they overlap")
def min_clearance_m(run: Evidence) -> float | None:
    return run.audit["min_clearance_m"] if run.audit else None


@metric("", "less", "pairs of robots whose footprints ever overlap")
def num_overlaps(run: Evidence) -> int | None:
    return run.audit["num_overlaps"] if run.audit else None


@metric("m", "more", "least distance of a footprint from a wall of the drawing at any time; 0 when one touches it")
def min_wall_clearance_m(run: Evidence) -> float | None:
    return run.audit["min_wall_clearance_m"] if run.audit else None


@metric("", "less", "pairs of a robot and a wall that its footprint ever touches; a wall is open where a door is drawn on it")
def num_wall_contacts(run: Evidence) -> int | None:
    return run.audit["num_wall_contacts"] if run.audit else None
