"""Plain graphs: CSV with a row per lane, and node-link JSON as networkx and d3 write it.

CSV has the columns `from, to, from_x_m, from_y_m, to_x_m, to_y_m`, in any order, and may have `both_ways` (yes or no; no by default) and
`speed_mps`. A node of node-link JSON has an `id` and `x_m`, `y_m` (or `x`, `y`, or `pos`), in m; a link (or edge) `source` and `target`;
the edges of a graph that is not `directed` are lanes in both directions. More members become options.
"""

import csv
import io
import math
from collections.abc import Mapping
from typing import Any

from mrp_sumo.errors import MapError, nearest
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.readers.draft import LEVEL, Draft, plain_options
from mrp_sumo.maps.readers.json_fields import Fields
from mrp_sumo.maps.readers.reader import MapFile, Selection, refuse_choice
from mrp_sumo.maps.readers.rmf.level import FARTHEST

NEEDED = ("from", "to", "from_x_m", "from_y_m", "to_x_m", "to_y_m")
KNOWN = (*NEEDED, "both_ways", "speed_mps", "class")
YES, NO = ("yes", "true", "1"), ("no", "false", "0", "")
NODE_KEYS = ("id", "name", "level", "x", "y", "x_m", "y_m", "pos", "is_bend")


class LaneTable:
    """CSV with a row per lane."""

    name = "CSV of lanes"
    suffixes = (".csv",)

    def detects(self, file: MapFile) -> bool:
        """Its first line has most of the columns."""
        head = [word.strip().lower() for word in file.text[:500].split("\n", 1)[0].split(",")]
        return sum(column in head for column in NEEDED) >= 4

    def read(self, file: MapFile, selection: Selection) -> Map:
        """A vertex for each name."""
        refuse_choice(file.source, selection)
        draft = Draft(file.source)
        rows = csv.reader(io.StringIO(file.text), strict=True)
        head: list[str] = []
        try:
            for row in rows:
                if not head:
                    head = [word.strip().lower() for word in row]
                    self._check(head, file)
                elif any(word.strip() for word in row):
                    self._row(dict(zip(head, (word.strip() for word in row))), rows.line_num, file, draft)
        except csv.Error as error:
            raise MapError(f"{file.path.name}:{rows.line_num}: not CSV: {error}") from None
        return draft.to_map()

    def _check(self, head: list[str], file: MapFile) -> None:
        for column in NEEDED:
            if column not in head:
                raise MapError(f"{file.path.name}:1: no column '{column}'; needed are {', '.join(NEEDED)}")
        for column in head:
            if column not in KNOWN:
                raise MapError(f"{file.path.name}:1: column '{column[:40]}'{nearest(column, KNOWN)}")

    def _row(self, row: Mapping[str, str], line: int, file: MapFile, draft: Draft) -> None:
        def number(key: str, default: float | None = None) -> float:
            if default is not None and not row.get(key):
                return default
            try:
                value = float(row[key])
            except (ValueError, KeyError):
                value = math.nan
            if not abs(value) < FARTHEST:
                raise MapError(f"{file.path.name}:{line}: {key} is '{row.get(key, '')[:40]}', expected a number")
            return value

        ends = []
        for end in ("from", "to"):
            name, xy = row.get(end, ""), (number(f"{end}_x_m"), number(f"{end}_y_m"))
            if not name:
                raise MapError(f"{file.path.name}:{line}: no name in column '{end}'")
            v = draft.vertex[name] if name in draft.vertex else draft.add_vertex(name, name, xy)
            if math.dist(draft.place(v), xy) > 1e-3:
                at = "({:g}, {:g})".format(*draft.place(v))
                raise MapError(f"{file.path.name}:{line}: '{name[:60]}' is at ({xy[0]:g}, {xy[1]:g}), but at {at} before")
            ends.append(v)
        both = row.get("both_ways", "").lower()
        if both not in YES + NO:
            raise MapError(f"{file.path.name}:{line}: both_ways is '{both[:40]}', expected yes or no")
        speed = number("speed_mps", math.inf) if row.get("speed_mps") else math.inf
        if not speed > 0:
            raise MapError(f"{file.path.name}:{line}: speed_mps is {speed:g}, expected a number above 0")
        for tail, head in (ends, ends[::-1]) if both in YES else (ends,):
            draft.add_lane(tail, head, speed_mps=speed, options={"class": row["class"]} if row.get("class") else {})


class NodeLink:
    """Node-link JSON."""

    name = "node-link JSON"
    suffixes = (".json",)

    def detects(self, file: MapFile) -> bool:
        """Nodes, and links or edges, in lists."""
        document = file.document
        return (
            isinstance(document, Mapping)
            and isinstance(document.get("nodes"), list)
            and any(isinstance(document.get(key), list) for key in ("links", "edges"))
        )

    def read(self, file: MapFile, selection: Selection) -> Map:
        """Nodes and links."""
        refuse_choice(file.source, selection, "level")
        fields, draft, document = Fields(file.source), Draft(file.source), file.document
        for at, node in fields.each(document, "nodes", ""):
            key = _key(fields, node, "id", at)
            fields.unique(draft.path_of, key, f"{at}.id")
            draft.path_of[key] = at
            name = node["name"] if isinstance(node.get("name"), str) else key if isinstance(key, str) else ""
            level = node["level"] if isinstance(node.get("level"), str) else LEVEL
            draft.add_vertex(key, name, _place_of(fields, node, at), level, **plain_options(node, NODE_KEYS))
        links = "links" if isinstance(document.get("links"), list) else "edges"
        both = document.get("directed") is False
        for at, link in fields.each(document, links, ""):
            ends = [draft.vertex.get(_key(fields, link, key, at), -1) for key in ("source", "target")]
            if -1 in ends:
                key = ("source", "target")[ends.index(-1)]
                draft.note_nowhere(f"{at}.{key}", f"no node {str(link[key])[:60]!r}")
                continue
            speed = fields.number(link, "speed_mps", at, math.inf)
            options = plain_options(link, ("source", "target", "key", "speed_mps", "length_m"))
            for tail, head in (ends, ends[::-1]) if both else (ends,):
                draft.add_lane(tail, head, speed_mps=speed if speed > 0 else math.inf, options=options)
        return draft.to_map(selection.level)


def _place_of(fields: Fields, node: Mapping[str, Any], at: str) -> tuple[float, float]:
    if "pos" in node:
        return fields.point(node["pos"], f"{at}.pos")
    x, y = ("x_m", "y_m") if "x_m" in node else ("x", "y")
    return fields.number(node, x, at), fields.number(node, y, at)


def _key(fields: Fields, holder: Mapping[str, Any], key: str, at: str) -> str | int:
    value = holder.get(key)
    if not isinstance(value, str | int) or isinstance(value, bool):
        raise fields.fault(f"{at}.{key}", f"found {str(value)[:40]!r}, expected text or a whole number")
    return value
