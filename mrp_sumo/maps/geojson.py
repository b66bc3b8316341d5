"""Writer of GeoJSON (RFC 7946): vertices as points, lanes and walls as lines, with their properties.

Longitude and latitude where the map knows its place on earth (wgs84 buildings), else metres in the map's
own frame, as the member `coordinates_m`.
"""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.maps.map import Map


def write_geojson(map_: Map, path: Path) -> None:
    """Write the graph and the walls of a map."""
    nav, building = map_.nav, map_.building
    to_place = _degrees(map_)
    features: list[dict[str, Any]] = []

    def add(kind: str, places: FloatArray, properties: dict[str, Any]) -> None:
        at = to_place(places).tolist()
        geometry = {"type": "Point", "coordinates": at[0]} if len(at) == 1 else {"type": "LineString", "coordinates": at}
        features.append({"type": "Feature", "geometry": geometry, "properties": {"kind": kind, **properties}})

    for v in range(nav.num_vertices):
        add("vertex", nav.xy[[v]], {"id": v, "level": nav.level_names[nav.level[v]], "name": nav.vertex_name[v], **nav.vertex_options[v]})
    for k in range(nav.num_lanes):
        tail, head = int(nav.tail[k]), int(nav.head[k])
        if nav.reverse[k] >= 0 and tail > head:
            continue  # written with its reverse
        limit = float(nav.speed_mps[k])
        properties = {
            "tail": tail,
            "head": head,
            "is_bidirectional": bool(nav.reverse[k] >= 0),
            "length_m": float(nav.length_m[k]),
            "speed_mps": limit if math.isfinite(limit) else None,
        }
        add("lane", nav.xy[[tail, head]], dict(nav.lane_options[k]) | properties)
    for level in building.levels.values() if building else ():
        for ends in level.wall_xy:
            add("wall", ends, {"level": level.name})
    document: dict[str, Any] = {"type": "FeatureCollection", "name": map_.name, "features": features}
    if building is None or building.coordinate_system != "wgs84":
        document["coordinates_m"] = True
    path.write_text(json.dumps(document, separators=(",", ":")) + "\n", encoding="utf-8")


def _degrees(map_: Map) -> Callable[[FloatArray], FloatArray]:
    """What turns places in the map's frame [N, 2] into longitude and latitude; nothing for maps that are not on earth."""
    if map_.building is None or map_.building.coordinate_system != "wgs84":
        return lambda xy: xy
    from pyproj import Transformer

    project = Transformer.from_crs(map_.building.crs_name, "EPSG:4326", always_xy=True)
    return lambda xy: np.stack(project.transform(*(xy + map_.origin_m).T), axis=1)
