"""Open-RMF's formats: buildings as traffic-editor draws them, and the nav graphs that it generates."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace

from mrp_sumo.errors import ChoiceError
from mrp_sumo.maps.building import Building
from mrp_sumo.maps.check import check_building, check_graph
from mrp_sumo.maps.finding import CURE, Notes, RefusedMap, ordered
from mrp_sumo.maps.levels import joined_by_lifts, laid_out, level_choice
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.readers.nav_graph import Misplaced, graph_of_documents, note_what_changes, origin_of_document
from mrp_sumo.maps.readers.reader import GraphChoice, MapFile, Selection, map_name, refuse_choice
from mrp_sumo.maps.readers.rmf.building_yaml import building_of, is_building
from mrp_sumo.maps.readers.rmf.generated_graph import nav_graph_documents

REFUSAL = {
    "no_lanes": "no lanes in any level: nothing to drive on ({})",
    "reference_level_without_measurement": "no measurement, coordinates would be pixels ({})",
    "level_not_a_mapping": "{}, expected a mapping with vertices and lanes",
    "level_without_fiducials": "{}, so it cannot be placed",
}


class RmfBuilding:
    """Open-RMF buildings, as traffic-editor writes them."""

    name = "RMF building"
    suffixes = (".building.yaml",)

    def detects(self, file: MapFile) -> bool:
        """Levels with typed parameters."""
        return is_building(file.document)

    def read(self, file: MapFile, selection: Selection) -> Map:
        """The chosen graphs of the chosen levels."""
        refuse_choice(file.source, selection, "graph", "level", "meters_per_pixel")
        building = building_of(file.document, file.source, selection.meters_per_pixel)
        return map_of_building(building, selection.graph, selection.level)


class RmfNavGraph:
    """Open-RMF nav graphs, as its generator writes them."""

    name = "RMF nav graph"
    suffixes = (".yaml",)

    def detects(self, file: MapFile) -> bool:
        """Levels with plain options."""
        return isinstance(file.document, Mapping) and "levels" in file.document and not is_building(file.document)

    def read(self, file: MapFile, selection: Selection) -> Map:
        """The chosen levels."""
        source, document, notes = file.source, file.document, Notes()
        refuse_choice(source, selection, "level")
        levels = level_choice(document["levels"] or {}, selection.level, source.path.name)
        try:
            origin_m = origin_of_document(document)
            note_what_changes(document, levels, notes)
            nav = graph_of_documents([document], map_name(source.path), levels=levels, origin_m=origin_m, source=str(source.path))
        except Misplaced as fault:
            raise source.fault(str(fault), *fault.keys) from None
        if not nav.num_lanes:
            raise source.fault(f"no lanes: nothing to drive on ({nav.num_vertices} vertices)")
        shift = laid_out(nav, None)
        nav, documents = joined_by_lifts(nav, shift, {}, {}), {0: document}
        findings = ordered(notes.findings() + check_graph(nav))
        return Map(name=nav.name, path=source.path, nav=nav, findings=findings, documents=documents, origin_m=origin_m, level_shift_m=shift)


def map_of_building(building: Building, graph: GraphChoice = None, level: str | None = None) -> Map:
    """The chosen graphs of the chosen levels, checked. Raises RefusedMap where nothing can drive there."""
    building = replace(building, findings=ordered(building.findings + check_building(building)))
    _refuse(building, level)
    levels = level_choice(building.levels, level, building.path.name)
    counts = Counter(lane.graph for name in levels for lane in building.levels[name].lanes)
    if not counts:
        with_lanes = ", ".join(f"'{n}'" for n, lv in building.levels.items() if lv.lanes)
        raise ChoiceError(f"{building.path.name}: level '{level}' has no lane; levels with lanes: {with_lanes}")
    if graph == "all":
        chosen = tuple(sorted(counts))
    elif graph is None:
        chosen = (min(counts),)
    else:
        chosen = (graph,) if isinstance(graph, int) else tuple(sorted(set(graph)))
    if missing := [g for g in chosen if g not in counts]:
        where = f"level '{level}' of " if level else ""
        graphs = ", ".join(f"{g} ({n} lanes)" for g, n in sorted(counts.items()))
        raise ChoiceError(f"{where}{building.path.name} has no lane in graph {missing[0]}; graphs with lanes: {graphs}")
    documents = {g: d for g, d in nav_graph_documents(building).items() if g in chosen}
    name, origin_m = map_name(building.path), building.origin_m
    nav = graph_of_documents(documents.values(), name, levels=levels, origin_m=origin_m, source=str(building.path))
    shift = laid_out(nav, building)
    return Map(
        name=name,
        path=building.path,
        nav=joined_by_lifts(nav, shift, {n: lv.elevation_m for n, lv in building.levels.items()}, building.lifts),
        building=building.moved(shift),
        findings=building.findings,
        graphs=tuple(building.graphs),
        chosen=chosen,
        documents=documents,
        origin_m=origin_m,
        level_shift_m=shift,
    )


def _refuse(building: Building, level: str | None) -> None:
    for finding in building.findings:
        if finding.severity == "refuse":
            if finding.kind == "level_without_fiducials" and level is not None:
                continue  # levels are not put together
            message = ": ".join(filter(None, (REFUSAL[finding.kind].format(finding.details[0]), CURE.get(finding.kind))))
            raise RefusedMap(f"{building.path.name}: {message}", building.findings)
