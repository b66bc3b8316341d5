"""Metrics of the audit: how near robots came to each other."""

from mrp_sumo.metrics.metric import Evidence, metric


@metric("m", "more", "least distance of two footprints (rectangles with heading) at any time, also between samples; 0 when they overlap")
def min_clearance_m(run: Evidence) -> float | None:
    return run.audit["min_clearance_m"] if run.audit else None


@metric("", "less", "pairs of robots whose footprints ever overlap")
def num_overlaps(run: Evidence) -> int | None:
    return run.audit["num_overlaps"] if run.audit else None
