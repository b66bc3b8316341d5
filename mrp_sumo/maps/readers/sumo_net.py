"""SUMO networks (`.net.xml`): those that this program writes, and others.

A junction is a vertex, an edge a lane, with the speed limit of its fastest lane and along its shape; internal edges and junctions are
not read. Vertices of our own networks are `n7`: they have no names. Refuses edges between unknown junctions, and documents with a DTD.
"""

import math
import re

import numpy as np

from mrp_sumo.maps.curves import Line
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.readers.draft import Draft
from mrp_sumo.maps.readers.reader import MapFile, Selection, refuse_choice
from mrp_sumo.maps.readers.xml_text import Element, parse_xml, root_name

OURS = re.compile("n[0-9]{1,10}")


class SumoNet:
    """SUMO's networks."""

    name = "SUMO network"
    suffixes = (".net.xml",)

    def detects(self, file: MapFile) -> bool:
        """Its root."""
        return root_name(file.text) == "net"

    def read(self, file: MapFile, selection: Selection) -> Map:
        """Junctions and edges."""
        refuse_choice(file.source, selection)
        root, draft = parse_xml(file.source), Draft(file.source)
        junctions = [j for j in root.all("junction") if j.get("type", "") != "internal" and not j.get("id", "").startswith(":")]
        ours = all(OURS.fullmatch(j.get("id", "")) for j in junctions)
        if ours:  # in the order of the numbers
            junctions.sort(key=lambda j: int(j.text("id")[1:]))
        for junction in junctions:
            name = junction.text("id")
            if name in draft.vertex:
                raise junction.fault(f"a second junction '{name[:60]}'")
            draft.add_vertex(name, "" if ours else name, (junction.number("x"), junction.number("y")))
        for edge in root.all("edge"):
            if edge.get("function", "") != "internal" and not edge.get("id", "").startswith(":"):
                _edge(edge, draft)
        return draft.to_map()


def _edge(edge: Element, draft: Draft) -> None:
    ends = [draft.vertex.get(edge.text(key), -1) for key in ("from", "to")]
    if -1 in ends:
        key = ("from", "to")[ends.index(-1)]
        draft.note_nowhere(f"line {edge.line}", f"edge '{edge.get('id', '')[:60]}' is {key} no junction '{edge.text(key)[:60]}'")
        return
    speed = max((lane.number("speed", math.inf) for lane in edge.all("lane")), default=math.inf)
    line: Line | None = None
    if shape := edge.get("shape", ""):
        places = [_place(edge, text) for text in shape.split()]
        ends_xy = [draft.place(v) for v in ends]
        line = Line(np.array([ends_xy[0], *places[1:-1], ends_xy[1]]))
    options = {"edge_id": edge.text("id")} | ({"class": edge.text("type")} if edge.get("type", "") else {})
    draft.add_lane(ends[0], ends[1], speed_mps=speed if speed > 0 else math.inf, options=options, line=line)


def _place(edge: Element, text: str) -> tuple[float, float]:
    parts = text.split(",")
    try:
        x, y = float(parts[0]), float(parts[1])
    except (ValueError, IndexError):
        raise edge.fault(f"shape has '{text[:40]}', expected x,y") from None
    if not (abs(x) < 1e8 and abs(y) < 1e8):
        raise edge.fault(f"shape has '{text[:40]}', expected metres")
    return x, y
