"""Occupation of the zones of a building in a run."""

from dataclasses import dataclass

from mrp_sumo.core.graph import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class ZoneLog:
    """Z zones that robots were in, the one that was most often occupied first."""

    name: tuple[str, ...]
    kind: tuple[str, ...]  # 'crossing', 'aisle', 'door', 'lift' or 'area'
    occupied_share: FloatArray  # [Z] of the time for which at least one robot was there
    robots_mean: FloatArray  # [Z] over the whole run
    robots_max: IntArray  # [Z] at a time
