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
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np

from mrp_sumo.errors import nearest
from mrp_sumo.maps.building import Building, Lift, Model
from mrp_sumo.maps.finding import MapFinding, Notes, RefusedMap
from mrp_sumo.maps.readers.rmf.level import LevelDraft, LevelReader, draft_of, shown
from mrp_sumo.maps.readers.rmf.placement import Placement, georeference, origin_of, placements_of, project
from mrp_sumo.maps.yaml_text import Text

HUMAN_GRAPH = 9
SYSTEMS = ("reference_image", "cartesian_meters", "wgs84", "web_mercator")


def is_building(document: Any) -> bool:
    """True for a YAML document that is meant as a building."""
    return isinstance(document, Mapping) and "levels" in document and not ("name" not in document and _is_nav_graph(document["levels"]))


def building_of(document: Any, source: Text, meters_per_pixel: float | None = None) -> Building:
    """The building of a parsed document; `meters_per_pixel` is the scale of the reference level's drawing, instead of its measurements.

    Raises MapError as the module refuses, with line, level and index. Findings of severity `refuse` do not raise here.
    """
    name, system, reference, documents = _header(document, source, meters_per_pixel)
    reader = LevelReader(source, Notes())
    parameters = reader.options(document.get("parameters"), "parameters", ("parameters",))

    drafts = {str(key): draft_of(reader, str(key), value, key, system) for key, value in documents.items()}
    placements = placements_of(reader, drafts, reference, system, meters_per_pixel)
    crs_name, offset = georeference(reader, system, parameters)
    world = {n: project(source, d.raw_xy, crs_name) if system == "wgs84" else placements[n].apply(d.raw_xy) for n, d in drafts.items()}
    on_lanes = [world[n][[lane.start, lane.end]] for n, d in drafts.items() for lane in d.lanes]
    origin = origin_of(np.concatenate(on_lanes) if on_lanes else np.zeros((0, 2)), offset)
    models = {n: _models(source, d, placements[n], crs_name if system == "wgs84" else "") for n, d in drafts.items()}
    levels = {n: d.level(world[n], origin, models[n]) for n, d in drafts.items()}
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
        name=name,
        path=source.path,
        coordinate_system=system,
        levels=levels,
        lifts=lifts,
        crs_name=crs_name,
        offset=offset,
        origin_m=origin,
        findings=reader.notes.findings(),
        unused=_unused(document, documents, system),
    )


def _models(source: Text, draft: LevelDraft, placement: Placement, crs_name: str) -> tuple[Model, ...]:
    """Things in metres (model.py, generate): a level's turn is added to theirs."""
    if not draft.models:
        return ()
    raw = np.array([[model.x_m, model.y_m] for model in draft.models])
    at = project(source, raw, crs_name) if crs_name else placement.apply(raw)
    turned = [model.yaw_rad + placement.turn_rad for model in draft.models]
    return tuple(Model(model.name, x, y, yaw_rad) for model, (x, y), yaw_rad in zip(draft.models, at.tolist(), turned))


def _unused(document: Mapping[str, Any], levels: Mapping[Any, Any], system: str) -> tuple[str, ...]:
    """What is drawn for people and other programs."""
    drawn = [level for level in levels.values() if isinstance(level, Mapping)]

    def listed(key: str) -> int:
        return sum(len(level[key]) for level in drawn if isinstance(level.get(key), list | dict))

    lanes = [lane for level in drawn for lane in level.get("lanes") or () if isinstance(lane, list) and len(lane) == 3]
    human = sum(isinstance(lane[2], Mapping) and lane[2].get("graph_idx") in ([2, HUMAN_GRAPH], HUMAN_GRAPH) for lane in lanes)
    crowd = document.get("crowd_sim")
    groups = crowd.get("agent_groups") if isinstance(crowd, Mapping) else None
    counts = {
        "zones": listed("zones") + (len(document["zones"]) if isinstance(document.get("zones"), list | dict) else 0),
        "human lanes": human,
        "groups of crowd_sim": sum(isinstance(g, Mapping) and bool(g.get("agents_number")) for g in groups)
        if isinstance(groups, list)
        else 0,
        "models": listed("models"),
        "fiducials": 0 if system == "reference_image" and len(levels) > 1 else listed("fiducials"),
    }
    return tuple(f"{name}: {count}" for name, count in counts.items() if count)


def _header(document: Any, source: Text, meters_per_pixel: float | None) -> tuple[str, str, str, Mapping[Any, Any]]:
    """Name, coordinate system, reference level, and levels as they are given, where all four have a meaning."""
    if not isinstance(document, Mapping):
        raise source.fault(f"a building is a mapping with 'levels', this is {shown(document)}")
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
    levels = document.get("levels")
    if not isinstance(levels, Mapping) or not levels:
        raise RefusedMap(
            str(source.fault("no levels: nothing to drive on", "levels")),
            (MapFinding("no_levels", "refuse", 1, ("levels: {}" if levels == {} else "levels",)),),
        )
    reference = str(document.get("reference_level_name", next(iter(levels))))
    if reference not in map(str, levels):
        raise source.fault(
            f"reference_level_name '{reference}' is not a level{nearest(reference, map(str, levels))}", "reference_level_name"
        )
    return str(name), system, reference, levels


def _lifts(
    reader: LevelReader,
    document: Any,
    drafts: Mapping[str, LevelDraft],
    placements: Mapping[str, Placement],
    reference: str,
    crs_name: str,  # where coordinates are degrees
    up: float,
) -> dict[str, Lift]:
    lifts: dict[str, Lift] = {}
    if not document:
        return lifts
    if not isinstance(document, Mapping):
        raise reader.source.fault(f"lifts is {shown(document)}, expected a mapping", "lifts")
    for key, value in document.items():
        name, keys = str(key), ("lifts", key)
        if not isinstance(value, Mapping):
            raise reader.source.fault(f"lift '{name}' is {shown(value)}, expected a mapping", *keys)
        missing = [k for k in ("x", "y", "yaw", "width", "depth") if k not in value]
        if missing:
            raise reader.source.fault(f"lift '{name}' has no {missing[0]}", *keys)
        x, y, yaw, width, depth = (reader.number(value[k], f"lift '{name}': {k}", (*keys, k)) for k in ("x", "y", "yaw", "width", "depth"))

        floors = ("reference_floor_name", "lowest_floor", "highest_floor", "initial_floor_name")
        floor, lowest, highest, initial = (str(value.get(k) or "") for k in floors)
        for k, floor_name in zip(floors[:3], (floor, lowest, highest)):
            if floor_name and floor_name not in drafts:
                raise reader.source.fault(f"lift '{name}': {k} '{floor_name}' is not a level{nearest(floor_name, drafts)}", *keys, k)
        raw = np.array([[x, up * y]])
        at = project(reader.source, raw, crs_name) if crs_name else placements[floor or reference].apply(raw)
        doors = value.get("level_doors") or {}
        if not isinstance(doors, Mapping):
            raise reader.source.fault(f"lift '{name}': level_doors is {shown(doors)}, expected a mapping", *keys, "level_doors")
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
            door_width_m=_door_widths(reader, name, value.get("doors") or {}),
            initial_level=initial,
        )
    return lifts


def _door_widths(reader: LevelReader, lift: str, document: Any) -> dict[str, float]:
    """By the names of a lift's doors; those without a width are left out."""
    if not isinstance(document, Mapping):
        raise reader.source.fault(f"lift '{lift}': doors is {shown(document)}, expected a mapping", "lifts", lift, "doors")
    return {
        str(name): reader.number(door["width"], f"lift '{lift}': door '{name}': width", ("lifts", lift, "doors", name, "width"))
        for name, door in document.items()
        if isinstance(door, Mapping) and "width" in door
    }


def _note_lanes(notes: Notes, drafts: Mapping[str, LevelDraft]) -> None:
    graphs = Counter(lane.graph for draft in drafts.values() for lane in draft.lanes)
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


def _note_names(notes: Notes, drafts: Mapping[str, LevelDraft]) -> None:
    names = Counter(str(name) for draft in drafts.values() for name in draft.vertex_name if name != "")
    for name in sorted(name for name, times in names.items() if times > 1):
        notes.add("duplicate_vertex_name", name)


def _is_nav_graph(levels: Any) -> bool:
    """True if vertices have options where those of buildings have a height, or where there is nothing of a building."""
    if not isinstance(levels, Mapping):
        return False
    contents = [level for level in levels.values() if isinstance(level, Mapping)]
    for level in contents:
        vertices = level.get("vertices")
        for vertex in vertices[:1] if isinstance(vertices, list) else []:
            return isinstance(vertex, list) and (len(vertex) == 2 or (len(vertex) == 3 and isinstance(vertex[2], Mapping | None)))
    return not any({"walls", "elevation", "drawing"} & set(level) for level in contents)
