"""GeoJSON: what this program writes, read back, and the route graphs of Nav2 (nav2_route, geojson_graph_file_loader.cpp).

Ours says `coordinates_m`; its vertices, lanes and walls are features of that `kind`. Nav2's nodes are points with an `id`, its edges
lines with `startid` and `endid`, in metres of the map's frame; edges are directed, `metadata` of nodes and edges become options.
Nav2 never reads an edge's line. Here an edge follows it where it leads from node to node, and is straight where it does not.
Refuses longitudes and latitudes, of which both formats know nothing: convert from the building instead.
"""

import math
from collections.abc import Iterator, Mapping
from itertools import chain, pairwise
from typing import Any

import numpy as np

from mrp_sumo.errors import MapError
from mrp_sumo.maps.building import Building
from mrp_sumo.maps.curves import Line
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.readers.draft import LEVEL, Draft, building_of_walls, plain_options
from mrp_sumo.maps.readers.json_fields import Fields
from mrp_sumo.maps.readers.reader import MapFile, Selection, refuse_choice

OFF_END_M = 0.05  # a drawn line that begins further from its vertex is not followed
LANE_KEYS = ("kind", "tail", "head", "is_bidirectional", "length_m", "speed_mps")


class GeoJson:
    """This program's own GeoJSON."""

    name = "GeoJSON of mrp-sumo"
    suffixes = (".geojson",)

    def detects(self, file: MapFile) -> bool:
        """A collection whose features are of our kinds."""
        return _collection(file.document) and any("kind" in properties for properties in _head(file.document))

    def read(self, file: MapFile, selection: Selection) -> Map:
        """Vertices, lanes and walls."""
        refuse_choice(file.source, selection, "level")
        fields, draft = Fields(file.source), Draft(file.source)
        if file.document.get("coordinates_m") is not True:
            raise fields.fault("coordinates_m", "missing, so these are degrees, which are not read: convert the building to another format")
        walls: dict[str, list[Any]] = {}
        lanes = []
        for at, properties, geometry in _features(fields, file.document):
            kind = fields.text(properties, "kind", f"{at}.properties")
            if kind == "vertex":
                _our_vertex(fields, draft, at, properties, geometry)
            elif kind == "wall":
                strokes = walls.setdefault(fields.text(properties, "level", at, LEVEL), [])
                for part in _parts(fields, geometry, at):
                    strokes += pairwise(fields.point(p, f"{at}.geometry.coordinates[{i}]") for i, p in enumerate(part))
            elif kind == "lane":
                lanes.append((at, properties))
        for at, properties in lanes:
            _our_lane(fields, draft, at, properties)
        building: Building | None = building_of_walls(draft, walls) if walls else None
        return draft.to_map(selection.level, building)


class Nav2Graph:
    """Nav2's route graphs."""

    name = "Nav2 route graph"
    suffixes = (".geojson",)

    def detects(self, file: MapFile) -> bool:
        """A collection whose features have identifiers."""
        return _collection(file.document) and any("startid" in properties or "id" in properties for properties in _head(file.document))

    def read(self, file: MapFile, selection: Selection) -> Map:
        """Nodes and edges."""
        refuse_choice(file.source, selection)
        fields, draft = Fields(file.source), Draft(file.source)
        edges = []
        known: dict[int, str] = {}
        for at, properties, geometry in _features(fields, file.document):
            if "startid" in properties or "endid" in properties:
                edges.append((at, properties, geometry))
                continue
            number = _number(fields, properties, "id", at)
            fields.unique(known, number, f"{at}.properties.id")
            known[number] = at
            about = fields.object(properties, "metadata", f"{at}.properties", {})
            name = about.get("name") if isinstance(about.get("name"), str) else None
            xy = fields.point(fields.list(geometry, "coordinates", f"{at}.geometry"), f"{at}.geometry.coordinates")
            draft.add_vertex(number, name or f"node_{number}", xy, **plain_options(about, ("name", "mutex", "is_bend", "lift")))
        for at, properties, geometry in edges:
            _nav2_edge(fields, draft, at, properties, geometry)
        return draft.to_map()


def _our_vertex(fields: Fields, draft: Draft, at: str, properties: Mapping[str, Any], geometry: Mapping[str, Any]) -> None:
    number = _number(fields, properties, "id", at)
    fields.unique(draft.path_of, number, f"{at}.properties.id")
    draft.path_of[number] = at
    xy = fields.point(fields.list(geometry, "coordinates", f"{at}.geometry"), f"{at}.geometry.coordinates")
    name, level = fields.text(properties, "name", at, ""), fields.text(properties, "level", at, LEVEL)
    draft.add_vertex(number, name, xy, level, **plain_options(properties, ("kind", "id", "name", "level")))


def _our_lane(fields: Fields, draft: Draft, at: str, properties: Mapping[str, Any]) -> None:
    where = f"{at}.properties"
    numbers = [_number(fields, properties, key, at) for key in ("tail", "head")]
    ends = [draft.vertex.get(number, -1) for number in numbers]
    if -1 in ends:
        key = ("tail", "head")[ends.index(-1)]
        draft.note_nowhere(f"{where}.{key}", f"no vertex {properties[key]}")
        return
    speed = fields.number(properties, "speed_mps", where, math.inf)
    options = plain_options(properties, LANE_KEYS)
    for tail, head in (ends, ends[::-1]) if properties.get("is_bidirectional") is True else (ends,):
        draft.add_lane(tail, head, speed_mps=speed if speed > 0 else math.inf, options=options)


def _nav2_edge(fields: Fields, draft: Draft, at: str, properties: Mapping[str, Any], geometry: Mapping[str, Any]) -> None:
    where = f"{at}.properties"
    numbers = [_number(fields, properties, key, at) for key in ("startid", "endid")]
    ends = [draft.vertex.get(number, -1) for number in numbers]
    if -1 in ends:
        key = ("startid", "endid")[ends.index(-1)]
        draft.note_nowhere(f"{where}.{key}", f"no node {properties[key]}{draft.nearest(str(properties[key]))}")
        return
    about = fields.object(properties, "metadata", where, {})
    limit = fields.number(about, "abs_speed_limit", f"{where}.metadata", math.inf)  # speed_limit is per cent of the robot's
    options = {"edge_id": str(properties.get("id", ""))} | plain_options(about, ("mutex", "lift", "abs_speed_limit"))
    drawn: Line | None = None
    try:
        line = np.array([fields.point(p, f"{at}.geometry.coordinates[{i}]") for i, p in enumerate(_line(fields, geometry, at))])
    except MapError:
        draft.notes.add("trajectory_unusable", f"edge {properties.get('id')}; read as straight")
        line = np.zeros((0, 2))
    if len(line) > 2:
        off = max(math.dist(line[0], draft.place(ends[0])), math.dist(line[-1], draft.place(ends[1])))
        if off > OFF_END_M:
            draft.notes.add("trajectory_off_its_nodes", f"edge {properties.get('id')}: {off:.2f} m; read as straight")
        else:
            drawn = Line(line)
    draft.add_lane(ends[0], ends[1], speed_mps=limit if limit > 0 else math.inf, options=options, line=drawn)


def _features(fields: Fields, document: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any], Mapping[str, Any]]]:
    """Path, properties and geometry of every feature."""
    for at, feature in fields.each(document, "features", ""):
        yield at, fields.object(feature, "properties", at), fields.object(feature, "geometry", at, {})


def _line(fields: Fields, geometry: Mapping[str, Any], at: str) -> list[Any]:
    """The places of a line, or of a line of several parts."""
    return list(chain.from_iterable(_parts(fields, geometry, at)))


def _parts(fields: Fields, geometry: Mapping[str, Any], at: str) -> list[list[Any]]:
    places: list[Any] = fields.list(geometry, "coordinates", f"{at}.geometry", [])
    several = bool(places) and all(
        isinstance(part, list) and part and isinstance(part[0], list) for part in places
    )  # whatever its type says
    return places if several else [places]


def _number(fields: Fields, properties: Mapping[str, Any], key: str, at: str) -> int:
    """A whole number that identifies something."""
    value = fields.number(properties, key, f"{at}.properties")
    if value != int(value):
        raise fields.fault(f"{at}.properties.{key}", f"found {value:g}, expected a whole number")
    return int(value)


def _collection(document: Any) -> bool:
    return isinstance(document, Mapping) and document.get("type") == "FeatureCollection" and isinstance(document.get("features"), list)


def _head(document: Mapping[str, Any]) -> Iterator[Mapping[str, Any]]:
    """The properties of the first features."""
    for feature in document["features"][:100]:
        if isinstance(feature, Mapping) and isinstance(feature.get("properties"), Mapping):
            yield feature["properties"]
