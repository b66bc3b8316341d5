"""Occupation of zones as Parquet: `zones.parquet`, a row for each zone that robots were in, the busiest first.

Columns: `zone` (name), `kind` (`crossing`, `aisle`, `door`, `lift` or `area`), `occupied_share` of the time, `robots_mean`, `robots_max`.
"""

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from mrp_sumo.core.zone_log import ZoneLog
from mrp_sumo.io.arrow import dictionary, numbers, texts

ZONES = "zones.parquet"


def write_zones(folder: Path, zones: ZoneLog) -> None:
    """Write `zones.parquet`."""
    table = {
        "zone": texts(zones.name),
        "kind": dictionary(zones.kind),
        **{name: numbers(getattr(zones, name)) for name in ("occupied_share", "robots_mean", "robots_max")},
    }
    pq.write_table(pa.table(table), folder / ZONES, compression="zstd")
