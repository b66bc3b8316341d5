"""Reader of RMF Traffic Editor buildings (`*.building.yaml`), by the rules of Open-RMF's generator.

Pixels become metres by the mean of the reference level's measurements, other levels are placed by
fiducials they share with it, wgs84 goes through the file's `generate_crs`. Old key names are known;
other people's extensions are ignored. Numbers come as they are: no rounding, no repair.

Refuses what has no one meaning: broken structure, indices out of range, web_mercator (its generator is
broken), scales that cannot be computed. What Open-RMF would accept although no robot could drive on it
(no lanes, a level that is a list, a reference level without measurement) is a finding of severity
`refuse`, so that a check can report it with the rest.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.errors import nearest
from mrp_sumo.maps.building import Building, Door, Lane, Level, Lift
from mrp_sumo.maps.finding import Finding, Notes, RefusedMap
from mrp_sumo.maps.yaml_text import Text, parse, read_text

SYSTEMS = ("reference_image", "cartesian_meters", "wgs84", "web_mercator")
NUM_GRAPHS = 9  # 0..8; 9 is for human lanes, which are never exported
FARTHEST = 1e8  # no building is larger, in pixels or metres; SUMO computes with 6 decimals
LIKELY_DEFAULT_M = 1.0  # a measurement the editor has made and nobody has set


def is_building(document: Any) -> bool:
    """Whether a YAML document is meant as a building."""
    return (
        isinstance(document, Mapping) and "levels" in document and not ("building_name" in document and _is_nav_graph(document["levels"]))
    )


def read_building(path: Path, meters_per_pixel: float | None = None) -> Building:
    """Read a building file.

    Parameters
    ----------
    path
        The file.
    meters_per_pixel
        Scale of the reference level's drawing, instead of its measurements.

    Raises
    ------
    MapError
        As the module refuses, with line, level and index. Findings of severity `refuse` do not raise here.
    """
    source = read_text(path)
    return building_of(parse(source), source, meters_per_pixel)


def building_of(document: Any, source: Text, meters_per_pixel: float | None = None) -> Building:
    """The building of a parsed document; see `read_building`."""
    reader = _Reader(source, Notes())
    if not isinstance(document, Mapping):
        raise source.fault(f"a building is a mapping with 'levels', this is {_kind(document)}")
    name = document.get("building_name", document.get("name"))
    if name is None:
        raise source.fault("the building has no 'name'")
    system = str(document.get("coordinate_system", SYSTEMS[0]))
    if system not in SYSTEMS:
        raise source.fault(f"coordinate_system '{system}' is unknown{nearest(system, SYSTEMS)}", "coordinate_system")
    if system == "web_mercator":
        raise source.fault(
            "coordinate_system web_mercator is not read: Open-RMF's own generator misplaces it; export as wgs84", "coordinate_system"
        )
    if meters_per_pixel is not None:
        if system != "reference_image":
            raise source.fault(f"a scale in metres per pixel has no meaning in coordinate_system {system}")
        if not (math.isfinite(meters_per_pixel) and meters_per_pixel > 0):
            raise source.fault(f"meters per pixel is {meters_per_pixel}, expected a number above 0")
    given = document.get("levels")
    if not isinstance(given, Mapping) or not given:
        raise RefusedMap(
            str(source.fault("no levels: nothing to drive on", "levels")),
            (Finding("no_levels", "refuse", 1, ("levels: {}" if given == {} else "levels",)),),
        )
    reference = str(document.get("reference_level_name", next(iter(given))))
    if reference not in map(str, given):
        raise source.fault(
            f"reference_level_name '{reference}' is not a level{nearest(reference, map(str, given))}", "reference_level_name"
        )
    parameters = reader.options(document.get("parameters"), "parameters", ("parameters",))

    drafts = {str(key): _draft(reader, str(key), value, key, system) for key, value in given.items()}
    placements = _placements(reader, drafts, reference, system, meters_per_pixel)
    crs_name, offset = _georeference(reader, system, parameters)
    world = {n: _project(source, d.raw_xy, crs_name) if system == "wgs84" else placements[n].apply(d.raw_xy) for n, d in drafts.items()}
    on_lanes = [world[n][[lane.start, lane.end]] for n, d in drafts.items() for lane in d.lanes]
    origin = origin_of(np.concatenate(on_lanes) if on_lanes else np.zeros((0, 2)), offset)
    levels = {n: d.level(world[n], origin) for n, d in drafts.items()}
    lifts = _lifts(
        reader,
        document.get("lifts"),
        drafts,
        placements,
        reference,
        crs_name if system == "wgs84" else "",
        -1.0 if system == "reference_image" else 1.0,
    )
    _note_lanes(reader.notes, drafts)
    _note_names(reader.notes, drafts)
    if system != "reference_image":
        moved = f", {origin[0]:g}, {origin[1]:g} m subtracted" if any(origin) else ""
        reader.notes.add("not_reference_image", f"{system}{moved}")
    return Building(
        name=str(name),
        path=source.path,
        coordinate_system=system,
        reference_level=reference,
        levels=levels,
        lifts=lifts,
        crs_name=crs_name,
        offset=offset,
        origin_m=origin,
        findings=reader.notes.findings(),
    )


def origin_of(xy: FloatArray, offset: tuple[float, float] | None) -> tuple[float, float]:
    """What to subtract from coordinates [N, 2]: the file's offset, where that brings them nearer to zero.

    Files disagree whether coordinates contain the offset; a simulator wants small numbers.
    """
    if offset is None or not len(xy):
        return (0.0, 0.0)
    centre = xy.mean(axis=0)
    return offset if np.hypot(*(centre - offset)) < np.hypot(*centre) else (0.0, 0.0)


@dataclass(frozen=True)
class _Placement:
    """`world = R(turn_rad) * scale * (x, y) + shift` (transform.py, transform_point)."""

    scale: float = 1.0  # m per unit of the file
    turn_rad: float = 0.0
    shift_m: tuple[float, float] = (0.0, 0.0)

    def apply(self, raw_xy: FloatArray) -> FloatArray:
        c, s = math.cos(self.turn_rad), math.sin(self.turn_rad)
        return raw_xy @ np.array([[c, s], [-s, c]]) * self.scale + self.shift_m


@dataclass(frozen=True, eq=False)
class _Draft:
    """A level in units of its file."""

    name: str
    elevation_m: float
    raw_xy: FloatArray  # [N, 2] y up
    vertex_name: tuple[Any, ...]
    vertex_options: tuple[Mapping[str, Any], ...]
    lanes: tuple[Lane, ...]
    walls: tuple[tuple[int, int], ...]
    doors: tuple[Door, ...]
    floors: tuple[tuple[int, ...], ...]
    holes: tuple[tuple[int, ...], ...]
    measurements: tuple[tuple[int, int, float], ...]
    fiducials: tuple[tuple[float, float, str], ...]  # y up
    is_mapping: bool

    def level(self, world_xy: FloatArray, origin_m: tuple[float, float]) -> Level:
        return Level(
            name=self.name,
            elevation_m=self.elevation_m,
            raw_xy=self.raw_xy,
            world_xy=world_xy,
            xy=world_xy - origin_m,
            vertex_name=self.vertex_name,
            vertex_options=self.vertex_options,
            lanes=self.lanes,
            walls=np.array(self.walls, np.int64).reshape(-1, 2),
            doors=self.doors,
            floors=self.floors,
            holes=self.holes,
        )


class _Reader:
    """Checks values of the document; knows the file, to point at faults, and gathers findings."""

    def __init__(self, source: Text, notes: Notes) -> None:
        self.source, self.notes = source, notes

    def number(self, value: Any, what: str, keys: tuple[str | int, ...]) -> float:
        if isinstance(value, str):  # 1e-05 is text in YAML 1.1
            try:
                value = float(value)
            except ValueError:
                raise self.source.fault(f"{what} is '{value[:40]}', expected a number", *keys) from None
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.source.fault(f"{what} is {_kind(value)}, expected a number", *keys)
        if not abs(value) < FARTHEST:  # NaN too
            raise self.source.fault(f"{what} is {value:.6g}, expected a number of sensible size", *keys)
        return float(value)

    def items(self, value: Any, what: str, keys: tuple[str | int, ...]) -> list[Any]:
        if value is None:
            return []
        if not isinstance(value, list):
            raise self.source.fault(f"{what} is {_kind(value)}, expected a list", *keys)
        return value

    def options(self, value: Any, what: str, keys: tuple[str | int, ...]) -> dict[str, Any]:
        """Typed values `[tag, value]` by name; the values as they are written."""
        if not value:
            return {}
        if not isinstance(value, Mapping):
            raise self.source.fault(f"the parameters of {what} are {_kind(value)}, expected a mapping", *keys)
        plain = {}
        for name, typed in value.items():
            if not isinstance(typed, list) or len(typed) != 2 or isinstance(typed[1], list | dict):
                raise self.source.fault(f"{what}: '{name}' is {_kind(typed)}, expected [type, value]", *keys)
            tag, content = typed
            if type(content) not in _TYPES.get(tag if isinstance(tag, int) else -1, ()):
                self.notes.add("type_tag_mismatch", f"{what}: {name} [{tag}, {content}]")
            plain[str(name)] = content
        return plain

    def edge(self, value: Any, what: str, num_vertices: int, keys: tuple[str | int, ...]) -> tuple[int, int, dict[str, Any]]:
        """`[start, end, {parameters}]`."""
        if not isinstance(value, list) or len(value) not in (2, 3):
            raise self.source.fault(f"{what} is {_kind(value)}, expected [start vertex, end vertex, {{parameters}}]", *keys)
        start, end = (self.vertex(value[i], what, num_vertices, keys) for i in (0, 1))
        return start, end, self.options(value[2] if len(value) == 3 else None, what, keys)

    def vertex(self, value: Any, what: str, num_vertices: int, keys: tuple[str | int, ...]) -> int:
        if type(value) is not int:
            raise self.source.fault(f"{what} names vertex {value!r:.40}, expected a number from 0", *keys)
        if not 0 <= value < num_vertices:
            known = f"{num_vertices} (0 to {num_vertices - 1})" if num_vertices else "none"
            raise self.source.fault(f"{what} names vertex {value}, but the level has {known}", *keys)
        return value


_TYPES: Mapping[int, tuple[type, ...]] = {0: (str, int, float, bool, type(None)), 1: (str,), 2: (int,), 3: (float, int), 4: (bool,)}


def _draft(reader: _Reader, name: str, given: Any, key: Any, system: str) -> _Draft:
    at: tuple[str | int, ...] = ("levels", key)
    if given is None:
        given = {}
    is_mapping = isinstance(given, Mapping)
    if not is_mapping:
        reader.notes.add("level_not_a_mapping", f"level '{name}' is a {type(given).__name__}")
        given = {}
    up = -1.0 if system == "reference_image" else 1.0
    xy, names, options = [], [], []
    for i, value in enumerate(reader.items(given.get("vertices"), f"level {name}: vertices", (*at, "vertices"))):
        what, keys = f"level {name} vertex {i}", (*at, "vertices", i)
        if not isinstance(value, list) or not 4 <= len(value) <= 5:
            raise reader.source.fault(f"{what} is {_kind(value)}, expected [x, y, z, name, {{parameters}}]", *keys)
        xy.append((reader.number(value[0], f"{what}: x", keys), up * reader.number(value[1], f"{what}: y", keys)))
        if isinstance(value[3], list | dict):
            raise reader.source.fault(f"{what}: the name is {_kind(value[3])}", *keys)
        if isinstance(value[3], bool):
            reader.notes.add("boolean_name", f"{what}: name {str(value[3]).lower()}, put it in quotes")
        names.append("" if value[3] is None else value[3])
        options.append(reader.options(value[4] if len(value) == 5 else None, what, keys))
    num = len(xy)

    def edges(kind: str, singular: str) -> Any:
        for i, value in enumerate(reader.items(given.get(kind), f"level {name}: {kind}", (*at, kind))):
            what, keys = f"level {name} {singular} {i}", (*at, kind, i)
            yield what, keys, reader.edge(value, what, num, keys)

    def polygons(kind: str) -> tuple[tuple[int, ...], ...]:
        found = []
        for i, value in enumerate(reader.items(given.get(kind), f"level {name}: {kind}", (*at, kind))):
            what, keys = f"level {name} {kind[:-1]} {i}", (*at, kind, i)
            if not isinstance(value, Mapping):
                raise reader.source.fault(f"{what} is {_kind(value)}, expected a mapping", *keys)
            corners = reader.items(value.get("vertices"), f"{what}: vertices", keys)
            found.append(tuple(reader.vertex(v, what, num, keys) for v in corners))
        return tuple(found)

    lanes = [_lane(reader, what, keys, *edge) for what, keys, edge in edges("lanes", "lane")]
    return _Draft(
        name=name,
        elevation_m=reader.number(given.get("elevation", 0) or 0, f"level {name}: elevation", (*at, "elevation")),
        raw_xy=np.array(xy, np.float64).reshape(-1, 2),
        vertex_name=tuple(names),
        vertex_options=tuple(options),
        lanes=tuple(lane for lane in lanes if lane is not None),
        walls=tuple(edge[:2] for _, _, edge in edges("walls", "wall")),
        doors=tuple(Door(a, b, str(o.get("name", "null")), str(o.get("type", ""))) for _, _, (a, b, o) in edges("doors", "door")),
        floors=polygons("floors"),
        holes=polygons("holes"),
        measurements=tuple(_measurement(reader, *m) for m in edges("measurements", "measurement")),
        fiducials=_fiducials(reader, name, given.get("fiducials"), (*at, "fiducials"), up),
        is_mapping=is_mapping,
    )


def _lane(reader: _Reader, what: str, keys: tuple[str | int, ...], start: int, end: int, given: dict[str, Any]) -> Lane | None:
    if "graph_idx" not in given:
        raise reader.source.fault(f"{what} has no graph_idx", *keys)
    graph = reader.number(given["graph_idx"], f"{what}: graph_idx", keys)
    if graph != int(graph):
        raise reader.source.fault(f"{what}: graph_idx is {graph}, expected a whole number", *keys)
    if not 0 <= graph < NUM_GRAPHS:
        reader.notes.add("graph_out_of_range", f"{what}: graph_idx {graph:.0f} is never exported, expected 0 to {NUM_GRAPHS - 1}")
        return None
    if "bidirectional" not in given:
        reader.notes.add("lane_without_bidirectional", what)
    both_ways = given.get("bidirectional", False)
    if isinstance(both_ways, str) and both_ways.lower() in ("true", "false"):
        both_ways = both_ways.lower() == "true"
    if both_ways not in (True, False):
        raise reader.source.fault(f"{what}: bidirectional is {_kind(both_ways)}, expected true or false", *keys)
    orientation = given.get("orientation", "") or ""
    if orientation not in ("", "forward", "backward"):
        raise reader.source.fault(f"{what}: orientation is '{orientation}', expected forward, backward or nothing", *keys)
    options: dict[str, Any] = {"orientation_constraint": orientation} if orientation else {}
    if reader.number(given.get("speed_limit") or 0, f"{what}: speed_limit", keys) > 0:
        options["speed_limit"] = given["speed_limit"]
    options |= {k: given[k] for k in ("mutex", "demo_mock_floor_name", "demo_mock_lift_name") if given.get(k)}
    return Lane(start, end, int(graph), bool(both_ways), options)


def _measurement(reader: _Reader, what: str, keys: tuple[str | int, ...], edge: tuple[int, int, dict[str, Any]]) -> tuple[int, int, float]:
    start, end, options = edge
    if "distance" not in options:
        raise reader.source.fault(f"{what} has no distance", *keys)
    return start, end, reader.number(options["distance"], f"{what}: distance", keys)


def _fiducials(reader: _Reader, level: str, given: Any, keys: tuple[str | int, ...], up: float) -> tuple[tuple[float, float, str], ...]:
    found = []
    for i, value in enumerate(reader.items(given, f"level {level}: fiducials", keys)):
        what = f"level {level} fiducial {i}"
        if not isinstance(value, list) or len(value) < 3 or isinstance(value[2], list | dict):
            raise reader.source.fault(f"{what} is {_kind(value)}, expected [x, y, name]", *keys, i)
        x, y = (reader.number(value[k], f"{what}: {'xy'[k]}", (*keys, i)) for k in (0, 1))
        found.append((x, up * y, "" if value[2] is None else str(value[2])))
    return tuple(found)


def _placements(
    reader: _Reader, drafts: Mapping[str, _Draft], reference: str, system: str, meters_per_pixel: float | None
) -> dict[str, _Placement]:
    """README-level rule: the reference level by its measurements, the others by fiducials they share with it."""
    if system != "reference_image":
        return dict.fromkeys(drafts, _Placement())
    placements = {}
    for name, draft in drafts.items():
        scale = _scale(reader, draft, name == reference)
        if name == reference:
            if scale is None and meters_per_pixel is None and any(d.lanes for d in drafts.values()):
                on_lanes = draft.raw_xy[[v for lane in draft.lanes for v in (lane.start, lane.end)]]
                width, height = np.ptp(on_lanes if len(on_lanes) else draft.raw_xy, axis=0) if len(draft.raw_xy) else (0, 0)
                reader.notes.add("reference_level_without_measurement", f"level {name}: lanes span {width:.0f} x {height:.0f} pixels")
            placements[name] = _Placement(meters_per_pixel or scale or 1.0)
    for name, draft in drafts.items():
        if name != reference:
            placements[name] = _aligned(reader, draft, drafts[reference], placements[reference].scale)
    return placements


def _scale(reader: _Reader, draft: _Draft, is_reference: bool) -> float | None:
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


def _aligned(reader: _Reader, draft: _Draft, reference: _Draft, scale: float) -> _Placement:
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
                f"level {draft.name} shares {shared} fiducial{'' if shared == 1 else 's'} with {reference.name}; 2 needed",
            )
        return _Placement()
    turned = np.arctan2(dg[apart, 1], dg[apart, 0]) - np.arctan2(df[apart, 1], df[apart, 0])
    turn = -math.atan2(np.sin(turned).sum(), np.cos(turned).sum())
    ratio = float((long_g[apart] / long_f[apart]).mean())
    back = _Placement(1 / ratio, turn).apply(g)
    shift = scale * (f - back).mean(axis=0)
    return _Placement(scale / ratio, turn, (float(shift[0]), float(shift[1])))


def _georeference(reader: _Reader, system: str, parameters: Mapping[str, Any]) -> tuple[str, tuple[float, float] | None]:
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


def _project(source: Text, degrees: FloatArray, crs_name: str) -> FloatArray:
    """Longitude and latitude [N, 2] to easting and northing [N, 2] m."""
    from pyproj import Transformer
    from pyproj.exceptions import ProjError

    try:
        project = Transformer.from_crs("EPSG:4326", crs_name, always_xy=True)
        xy = np.stack(project.transform(degrees[:, 0], degrees[:, 1]), axis=1)
    except ProjError as error:
        raise source.fault(f"generate_crs '{crs_name}' is not usable: {str(error).splitlines()[0]}", "parameters", "generate_crs") from None
    if not np.isfinite(xy).all():
        raise source.fault(
            f"vertex {np.flatnonzero(~np.isfinite(xy).all(1))[0]} is outside the area of generate_crs '{crs_name}'", "parameters"
        )
    return xy


def _lifts(
    reader: _Reader,
    given: Any,
    drafts: Mapping[str, _Draft],
    placements: Mapping[str, _Placement],
    reference: str,
    crs_name: str,  # where coordinates are degrees
    up: float,
) -> dict[str, Lift]:
    lifts: dict[str, Lift] = {}
    if not given:
        return lifts
    if not isinstance(given, Mapping):
        raise reader.source.fault(f"lifts is {_kind(given)}, expected a mapping", "lifts")
    for key, value in given.items():
        name, keys = str(key), ("lifts", key)
        if not isinstance(value, Mapping):
            raise reader.source.fault(f"lift '{name}' is {_kind(value)}, expected a mapping", *keys)
        missing = [k for k in ("x", "y", "yaw", "width", "depth") if k not in value]
        if missing:
            raise reader.source.fault(f"lift '{name}' has no {missing[0]}", *keys)
        x, y, yaw, width, depth = (reader.number(value[k], f"lift '{name}': {k}", (*keys, k)) for k in ("x", "y", "yaw", "width", "depth"))

        floor, lowest, highest = (str(value.get(k) or "") for k in ("reference_floor_name", "lowest_floor", "highest_floor"))
        for k, found in (("reference_floor_name", floor), ("lowest_floor", lowest), ("highest_floor", highest)):
            if found and found not in drafts:
                raise reader.source.fault(f"lift '{name}': {k} '{found}' is not a level{nearest(found, drafts)}", *keys, k)
        raw = np.array([[x, up * y]])
        at = _project(reader.source, raw, crs_name) if crs_name else placements[floor or reference].apply(raw)
        doors = value.get("level_doors") or {}
        if not isinstance(doors, Mapping):
            raise reader.source.fault(f"lift '{name}': level_doors is {_kind(doors)}, expected a mapping", *keys, "level_doors")
        lifts[name] = Lift(
            name=name,
            x_m=float(at[0, 0]),
            y_m=float(at[0, 1]),
            yaw_rad=yaw,
            width_m=width,
            depth_m=depth,
            lowest_m=drafts[lowest].elevation_m if lowest else -math.inf,
            highest_m=drafts[highest].elevation_m if highest else math.inf,
            level_doors={str(k): tuple(map(str, v)) if isinstance(v, list) else () for k, v in doors.items()},
        )
    return lifts


def _note_lanes(notes: Notes, drafts: Mapping[str, _Draft]) -> None:
    graphs: dict[int, int] = {}
    for draft in drafts.values():
        for lane in draft.lanes:
            graphs[lane.graph] = graphs.get(lane.graph, 0) + 1
    if not graphs:
        num_vertices, num_walls = (sum(len(x) for x in xs) for xs in zip(*((d.raw_xy, d.walls) for d in drafts.values())))
        notes.add("no_lanes", f"{num_vertices} vertices, {num_walls} walls")
        return
    if max(graphs) > 0:
        for graph, count in sorted(graphs.items()):
            notes.add("several_graphs", f"graph {graph}: {count} lanes")
    for name, draft in drafts.items():
        if not draft.lanes and draft.is_mapping:
            notes.add("level_without_lanes", f"level {name}")


def _note_names(notes: Notes, drafts: Mapping[str, _Draft]) -> None:
    count: dict[str, int] = {}
    for draft in drafts.values():
        for name in draft.vertex_name:
            if name != "":
                count[str(name)] = count.get(str(name), 0) + 1
    for name in sorted(n for n, c in count.items() if c > 1):
        notes.add("duplicate_vertex_name", name)


def _is_nav_graph(levels: Any) -> bool:
    """Whether lanes carry plain options, as in nav graphs, instead of typed parameters."""
    if not isinstance(levels, Mapping):
        return False
    for level in levels.values():
        for lane in (level.get("lanes") or []) if isinstance(level, Mapping) else []:
            if isinstance(lane, list) and len(lane) == 3 and isinstance(lane[2], Mapping):
                return "graph_idx" not in lane[2]
    return not any(isinstance(level, Mapping) and ({"walls", "elevation", "drawing"} & set(level)) for level in levels.values())


def _kind(value: Any) -> str:
    """What a wrong value is, for a message."""
    if isinstance(value, Mapping):
        return "a mapping"
    if isinstance(value, list):
        return f"{str(value)[:40]}, a list" if len(value) > 0 else "an empty list"
    return "nothing" if value is None else f"'{str(value)[:40]}'"
