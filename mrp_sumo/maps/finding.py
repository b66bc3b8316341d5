"""Findings of an import about a map, and the refusal that carries them."""

from dataclasses import dataclass
from typing import Any, Literal

from mrp_sumo.errors import MapError, shown

Severity = Literal["refuse", "warn", "info"]


@dataclass(frozen=True)
class MapFinding:
    """One kind of defect or peculiarity of a map, with all its places."""

    kind: str
    severity: Severity
    count: int  # of what the kind counts: lanes, vertices, graphs, components, ...
    details: tuple[str, ...] = ()  # one place each, with numbers as in the file

    @property
    def line(self) -> str:
        details = "; ".join(self.details[:4])
        more = f"; and {len(self.details) - 4} more" if len(self.details) > 4 else ""
        text = f"{self.kind.replace('_', ' ')}: {details}{more}" if details else self.kind.replace("_", " ")
        return shown(f"{text}: {CURE[self.kind]}" if self.kind in CURE else text)

    def document(self) -> dict[str, Any]:
        return {"kind": self.kind, "severity": self.severity, "count": self.count, "details": list(self.details)}


class RefusedMap(MapError):
    """A map that is refused for findings; they come along for those who only check."""

    def __init__(self, message: str, findings: tuple[MapFinding, ...] = ()) -> None:
        super().__init__(message)
        self.findings = findings


SEVERITY: dict[str, Severity] = {
    "not_yaml": "refuse",
    "no_levels": "refuse",
    "level_not_a_mapping": "refuse",
    "no_lanes": "refuse",
    "reference_level_without_measurement": "refuse",
    "level_without_fiducials": "refuse",
    "edge_to_nowhere": "refuse",
    "several_graphs": "warn",
    "measurements_disagree": "warn",
    "measurement_of_exactly_1_m": "warn",
    "robot_vertex_off_lanes": "warn",
    "duplicate_lanes": "warn",
    "lane_without_length": "warn",
    "graph_out_of_range": "warn",
    "duplicate_fiducials": "warn",
    "boolean_name": "warn",
    "name_twice_in_graph": "warn",
    "several_components": "warn",
    "not_strongly_connected": "warn",
    "t_junction_near_miss": "warn",
    "lanes_cross_without_vertex": "warn",
    "lift_vertices_misaligned": "warn",
    "extent_above_1_km": "warn",
    "theta_in_degrees": "warn",
    "dangling_reference": "warn",
    "station_out_of_reach": "warn",
    "unknown_version": "warn",
    "old_model_in_part": "warn",
    "places_of_the_layout": "warn",
    "several_origins": "warn",
    "several_vehicle_types": "warn",
    "limits_by_vehicle_type": "info",
    "edge_without_its_nodes": "warn",
    "edge_of_no_type": "warn",
    "speed_of_nothing": "warn",
    "very_slow_lanes": "warn",
    "turns_restricted": "warn",
    "trajectory_unusable": "warn",
    "trajectory_off_its_nodes": "warn",
    "path_length_disagrees": "warn",
    "same_direction_block": "warn",
    "several_groups": "warn",
    "parallel_lanes": "warn",
    "pieces_left_out": "warn",
    "walls_not_traced": "warn",
    "walls_traced_coarsely": "info",
    "walls_of_layers": "info",
    "outside_left_out": "info",
    "lift_cabin_mismatch": "info",
    "type_tag_mismatch": "info",
    "duplicate_vertex_name": "info",
    "lane_without_bidirectional": "info",
    "level_without_lanes": "info",
    "locked_path": "info",
    "vertices_at_one_place": "info",
    "not_reference_image": "info",
}
CURE = {  # what the user can do about it
    "reference_level_without_measurement": "state the scale with --scale",
    "level_without_fiducials": "choose --level or add fiducials",
    "no_lanes": "draw lanes with `mrp-sumo studio`, or in Open-RMF's traffic editor",
    "edge_of_no_type": "left out; vehicleTypeEdgeProperties says which vehicles may use it",
    "very_slow_lanes": "raise the limit, or leave such a direction out",
}


class Notes:
    """Gathers findings by kind while a map is read."""

    def __init__(self) -> None:
        self._places: dict[str, list[tuple[str, int]]] = {}

    def add(self, kind: str, detail: str, count: int = 1) -> None:
        self._places.setdefault(kind, []).append((detail, count))

    def findings(self) -> tuple[MapFinding, ...]:
        """One finding a kind, in the order of `ordered`."""
        columns = {kind: tuple(zip(*self._places[kind])) for kind in SEVERITY if kind in self._places}
        return tuple(MapFinding(kind, SEVERITY[kind], sum(counts), details) for kind, (details, counts) in columns.items())


def ordered(findings: tuple[MapFinding, ...]) -> tuple[MapFinding, ...]:
    """Refusals first, then warnings, then information."""
    rank = list(SEVERITY)
    return tuple(sorted(findings, key=lambda finding: rank.index(finding.kind)))
