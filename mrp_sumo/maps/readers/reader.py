"""Map readers: one class for each format, which recognises it by content and makes a `Map` of it."""

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Protocol

from mrp_sumo.core.graph import BoolArray, PlanGraph
from mrp_sumo.errors import ChoiceError, MapError
from mrp_sumo.files.reading import read_head, shortened
from mrp_sumo.maps.check import check_graph
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.readers.strangers import advice
from mrp_sumo.maps.yaml_text import Text, parse, parse_json, read_text

GraphChoice = int | tuple[int, ...] | Literal["all"] | None

HEAD = 4096
DXF = re.compile(rb"AutoCAD Binary DXF|(?:\xef\xbb\xbf)?\s*(?:999\s*?\n[^\n]*\n\s*)*0\s*?\r?\n\s*SECTION\b")
SVG = re.compile(rb"(?:\xef\xbb\xbf)?(?:<\?xml[^>]*\?>|<!--.*?-->|<!DOCTYPE[^\[>]*(?:\[[^\]]*\][^>]*)?>|\s)*<(?:\w+:)?svg\b", re.DOTALL)
PICTURE = re.compile(rb"\x89PNG\r\n|\xff\xd8\xff|GIF8[79]a|BM.{4}\0{4}|II\*\0|MM\0\*|P[2-6]\s|RIFF....WEBP", re.DOTALL)
SUFFIXES = ".yaml .json .xml .geojson .csv .building .nav .map .lif .site .net .dxf .png .jpg .pdf .svg"  # in the order they go
ROBOT_RADIUS_M = 0.1126  # circumscribed circle of a TurtleBot3 Burger, 0.138 x 0.178 m


@dataclass(frozen=True)
class Selection:
    """The part of a map file that is taken; see `load_map`."""

    graph: GraphChoice = (
        None  # of a building; several, or "all", are united as MRP-Bench does; by default the only or lowest one with lanes
    )
    level: str | None = None  # by default all that the graph is on, joined by lifts and laid side by side
    meters_per_pixel: float | None = None  # of a building's drawing, instead of its measurements
    cell_m: float = 0.4  # side of the cells of a MovingAI grid, which has no unit, and of those laid over an occupancy map
    robot_radius_m: float = ROBOT_RADIUS_M  # the room that a robot needs on an occupancy map
    vehicle_type: str | None = None  # only the lanes of this type of vehicle, where a format knows types; those of all by default
    driven: tuple[str, ...] = ()  # types of vehicles that are driven: their lanes and limits count where the map knows them
    layers: tuple[str, ...] | None = None  # of a DXF, those that hold its walls; by default all that are shown
    unit: str | None = None  # of a DXF: mm, cm, dm, m, in or ft; by default as it says
    page: int | None = None  # of a PDF, from 1; the first by default


@dataclass(frozen=True)
class MapFile:
    """A map file as readers see it."""

    source: Text  # its text; '' of plans of a floor
    head: bytes = b""  # its first bytes

    @property
    def path(self) -> Path:
        return self.source.path

    @property
    def text(self) -> str:
        return self.source.text

    @cached_property
    def document(self) -> Any:
        """The text as YAML, which JSON is too; None where it is neither."""
        return None if isinstance(self._parsed, MapError) else self._parsed

    @property
    def fault(self) -> MapError | None:
        """Why it is no YAML."""
        return self._parsed if isinstance(self._parsed, MapError) else None

    @cached_property
    def _parsed(self) -> Any:
        if (document := parse_json(self.source.text)) is not None:
            return document
        try:
            return parse(self.source)
        except MapError as error:
            return error


class Reader(Protocol):
    """A map format. A reader may also have `files(file)`, the paths that the map is read from where there are more than its own."""

    @property
    def name(self) -> str:
        """In messages: 'RMF building'."""

    @property
    def suffixes(self) -> tuple[str, ...]:
        """Of its files, for people: the content decides."""

    def detects(self, file: MapFile) -> bool:
        """True for a file that is meant as this format."""

    def read(self, file: MapFile, selection: Selection) -> Map:
        """The map. Raises MapError where the format allows none."""


def map_file(path: Path) -> MapFile:
    """A file to be read. Raises MapError when it is missing, or neither text nor a plan; with what could be done about it."""
    head = read_head(path, HEAD, MapError)
    if plan_kind(head):
        return MapFile(Text(path, ""), head)
    try:
        return MapFile(read_text(path), head)
    except MapError as error:
        if stranger := advice(head):
            raise MapError(f"{shortened(path)}: {stranger}") from None
        raise error


def plan_kind(head: bytes) -> str:
    """'dxf', 'picture', 'pdf' or 'svg' for what begins like a plan of a floor, else ''."""
    kinds = {"dxf": DXF.match(head), "picture": PICTURE.match(head), "pdf": head.startswith(b"%PDF"), "svg": SVG.match(head)}
    return next((kind for kind, match in kinds.items() if match), "")


def map_name(path: Path) -> str:
    """The name a map goes by: its file's, without the suffixes."""
    name = path.name
    for suffix in SUFFIXES.split():
        name = name.removesuffix(suffix)
    return name


def grid_map(source: Text, nav: PlanGraph, free: BoolArray) -> Map:
    """The map of a grid and its free cells [H, W]."""
    pieces = tuple(finding for finding in check_graph(nav) if finding.kind == "several_components")
    return Map(name=nav.name, path=source.path, nav=nav, findings=pieces, free=free)


def refuse_choice(source: Text, selection: Selection, *known: str) -> None:
    """Refuse to choose what this kind of map does not have; `known` are the fields of a selection that it does have."""
    names = {"graph": "graph", "level": "level", "meters_per_pixel": "scale in metres per pixel", "vehicle_type": "vehicle types"}
    names |= {"layers": "layers", "unit": "unit", "page": "page"}
    for field, what in names.items():
        choice = getattr(selection, field)
        if field not in known and choice is not None and not (field == "graph" and choice in (0, "all")):
            raise ChoiceError(f"{source.path.name}: this kind of map has no {what} to choose")
