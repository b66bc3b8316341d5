"""Places of the levels of an RMF building: pixels to metres by measurements, levels onto each other by fiducials, degrees to metres.

Refuses measurements without length, and coordinate reference systems that cannot be used.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.errors import count, first_line
from mrp_sumo.maps.readers.rmf.level import LevelDraft, LevelReader
from mrp_sumo.maps.yaml_text import Text

LIKELY_DEFAULT_M = 1.0  # a measurement the editor has made and nobody has set


@dataclass(frozen=True)
class Placement:
    """`world = R(turn_rad) * scale * (x, y) + shift` (transform.py, transform_point)."""

    scale: float = 1.0  # m per unit of the file
    turn_rad: float = 0.0
    shift_m: tuple[float, float] = (0.0, 0.0)

    def apply(self, raw_xy: FloatArray) -> FloatArray:
        c, s = math.cos(self.turn_rad), math.sin(self.turn_rad)
        xy: FloatArray = raw_xy @ np.array([[c, s], [-s, c]]) * self.scale + self.shift_m
        return xy


def placements_of(
    reader: LevelReader, drafts: Mapping[str, LevelDraft], reference: str, system: str, meters_per_pixel: float | None
) -> dict[str, Placement]:
    """The place of each level: the reference level by its measurements, the others by fiducials they share with it."""
    if system != "reference_image":
        return dict.fromkeys(drafts, Placement())
    placements = {}
    for name, draft in drafts.items():
        scale = _scale(reader, draft, name == reference)
        if name == reference:
            if scale is None and meters_per_pixel is None and any(d.lanes for d in drafts.values()):
                on_lanes = draft.raw_xy[[v for lane in draft.lanes for v in (lane.start, lane.end)]]
                width, height = np.ptp(on_lanes if len(on_lanes) else draft.raw_xy, axis=0) if len(draft.raw_xy) else (0, 0)
                reader.notes.add("reference_level_without_measurement", f"level {name}: lanes span {width:.0f} x {height:.0f} pixels")
            placements[name] = Placement(meters_per_pixel or scale or 1.0)
    for name, draft in drafts.items():
        if name != reference:
            placements[name] = _aligned(reader, draft, drafts[reference], placements[reference].scale)
    return placements


def _scale(reader: LevelReader, draft: LevelDraft, is_reference: bool) -> float | None:
    """Mean of the measurements' metres per pixel (level.py, calculate_scale_using_measurements); None without any."""
    scales = []
    for i, (start, end, distance_m) in enumerate(draft.measurements):
        what, keys = f"level {draft.name} measurement {i}", ("levels", draft.name, "measurements", i)
        pixels = float(np.hypot(*(draft.raw_xy[end] - draft.raw_xy[start])))
        if pixels <= 0 or distance_m <= 0:
            if not is_reference:
                continue
            raise reader.source.fault(f"{what} says that {pixels:g} pixels are {distance_m:g} m: no scale can be computed", *keys)
        if distance_m == LIKELY_DEFAULT_M:
            reader.notes.add("measurement_of_exactly_1_m", f"{what}: 1 m over {pixels:.1f} pixels")
        scales.append(distance_m / pixels)
    if scales and max(scales) / min(scales) > 1.05:
        reader.notes.add(
            "measurements_disagree",
            f"level {draft.name}{' (reference)' if is_reference else ''}: {len(scales)} measurements, "
            f"{min(scales):.5f}..{max(scales):.5f} m/px, ratio {max(scales) / min(scales):.2f}",
        )
    return float(np.mean(scales)) if scales else None


def _aligned(reader: LevelReader, draft: LevelDraft, reference: LevelDraft, scale: float) -> Placement:
    """The similarity that lays a level's fiducials on the reference's (transform.py, set_from_fiducials)."""
    pairs = [(f, g) for f in reference.fiducials for g in draft.fiducials if f[2] == g[2]]
    here = [g[2] for g in draft.fiducials]
    there = [f[2] for f in reference.fiducials]
    twice = sorted({n for n in here if n in there and max(here.count(n), there.count(n)) > 1})
    if twice:
        reader.notes.add("duplicate_fiducials", f"level {draft.name}: {', '.join(repr(n) for n in twice)} more than once", len(twice))
    f = np.array([p[0][:2] for p in pairs], np.float64).reshape(-1, 2)  # [P, 2] on the reference
    g = np.array([p[1][:2] for p in pairs], np.float64).reshape(-1, 2)  # [P, 2] here
    i, j = np.triu_indices(len(pairs), 1)
    df, dg = f[j] - f[i], g[j] - g[i]
    long_f, long_g = np.hypot(*df.T), np.hypot(*dg.T)
    apart = (long_f > 0) & (long_g > 0)
    if not apart.any():
        if draft.lanes:
            shared = len({n for n in here if n in there})
            reader.notes.add(
                "level_without_fiducials",
                f"level {draft.name} shares {count(shared, 'fiducial')} with {reference.name}; 2 needed",
            )
        return Placement()
    turned = np.arctan2(dg[apart, 1], dg[apart, 0]) - np.arctan2(df[apart, 1], df[apart, 0])
    turn = -math.atan2(np.sin(turned).sum(), np.cos(turned).sum())
    ratio = float((long_g[apart] / long_f[apart]).mean())
    back = Placement(1 / ratio, turn).apply(g)
    shift = scale * (f - back).mean(axis=0)
    return Placement(scale / ratio, turn, (float(shift[0]), float(shift[1])))


def georeference(reader: LevelReader, system: str, parameters: Mapping[str, Any]) -> tuple[str, tuple[float, float] | None]:
    """crs_name and offset of the nav graphs (building.py, parse_yaml)."""
    crs_name = str(parameters.get("generate_crs") or "")
    if system == "reference_image":
        return "", None
    if system == "wgs84" and not crs_name:
        raise reader.source.fault("coordinate_system wgs84 needs the parameter generate_crs, for example [1, 'EPSG:3414']", "parameters")
    prefix = "suggested_offset" if system == "wgs84" else "offset"
    names = (f"{prefix}_x", f"{prefix}_y")
    x, y = (reader.number(parameters.get(name) or 0, name, ("parameters", name)) for name in names)
    return crs_name, (x, y)


def project(source: Text, degrees: FloatArray, crs_name: str) -> FloatArray:
    """Longitude and latitude [N, 2] to easting and northing [N, 2] m."""
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    try:
        project = Transformer.from_crs("EPSG:4326", crs_name, always_xy=True)
        xy = np.stack(project.transform(degrees[:, 0], degrees[:, 1]), axis=1)
    except ProjError as error:
        raise source.fault(f"generate_crs '{crs_name}' is not usable: {first_line(error)}", "parameters", "generate_crs") from None
    if not np.isfinite(xy).all():
        raise source.fault(
            f"vertex {np.flatnonzero(~np.isfinite(xy).all(1))[0]} is outside the area of generate_crs '{crs_name}'", "parameters"
        )
    return xy


def origin_of(xy: FloatArray, offset: tuple[float, float] | None) -> tuple[float, float]:
    """The origin to subtract from coordinates [N, 2]: the file's offset, where that brings them nearer to zero.

    Files disagree whether coordinates contain the offset; a simulator wants small numbers.
    """
    if offset is None or not len(xy):
        return (0.0, 0.0)
    centre = xy.mean(axis=0)
    return offset if np.hypot(*(centre - offset)) < np.hypot(*centre) else (0.0, 0.0)
