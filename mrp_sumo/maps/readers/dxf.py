"""Strokes of a drawing in DXF: the lines, polylines, arcs, curves and outlines of chosen layers, blocks taken apart, in metres.

The home of ezdxf. Text, dimensions, hatches and points are no walls. What a block draws on layer 0 is on the layer where the block is
inserted; layers that are off or frozen count when they are named. Curves are flattened within 1 cm. Refuses drawings without a unit,
layers that do not exist or hold no stroke, damaged files, and drawings of more than half a million strokes.
"""

import logging
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.errors import MapError, first_line, listed, nearest
from mrp_sumo.files.reading import read_bytes, shortened
from mrp_sumo.maps.yaml_text import MAX_BYTES

UNIT_M = {"mm": 0.001, "cm": 0.01, "dm": 0.1, "m": 1.0, "in": 0.0254, "ft": 0.3048}
OF_HEADER = {1: "in", 2: "ft", 4: "mm", 5: "cm", 6: "m", 14: "dm", 21: "ft"}  # $INSUNITS; 21: survey feet, 2 mm longer in a kilometre
CURVES = {"LINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE", "LWPOLYLINE", "POLYLINE", "HELIX"}
CORNERS = {"SOLID", "TRACE", "3DFACE"}
NESTED = {"INSERT", "MLINE"}
END = re.compile(rb"\bEOF[\s\0\x1a]*\Z")
FLAT_M = 0.01
MAX_STROKES = 500_000
MAX_DEPTH = 16  # of blocks in blocks


@dataclass(frozen=True)
class DxfContent:
    """Lines and faults of a plan."""

    strokes: FloatArray  # [N, 2, 2] m, the two ends of each
    unit: str
    layers: dict[str, int]  # strokes of each layer that was read
    left_out: dict[str, int] = field(default_factory=dict)  # strokes of the others


@dataclass(frozen=True)
class DxfLayers:
    """Lines of a plan by layer, none chosen yet."""

    strokes: dict[str, FloatArray]  # [N, 2, 2] units of the drawing, of each layer that has any
    shown: tuple[str, ...]  # layers that are neither off nor frozen, of those
    unit: str  # '' where the drawing says none
    header_unit: int  # its $INSUNITS
    known: tuple[str, ...]  # all layers of the drawing
    others: Counter[tuple[str, str]]  # (layer, kind) of what is no stroke


def read_dxf(path: Path, layers: Sequence[str] | None = None, unit: str | None = None) -> DxfContent:
    """The strokes of a drawing's layers, in any case, or of all that are shown. Raises MapError as the module refuses.

    The unit is one of `UNIT_M`; that of the file's header by default.
    """
    if unit is not None and unit not in UNIT_M:
        raise MapError(f"unit '{unit}' is none of {', '.join(UNIT_M)}{nearest(unit, UNIT_M)}")
    drawing = read_dxf_layers(path, unit)
    chosen = _chosen(path, drawing, layers)
    if not chosen:
        raise MapError(f"{shortened(path)}: nothing is drawn: no line, polyline, arc or block on a layer that is shown")
    drawn = np.concatenate([drawing.strokes[layer] for layer in chosen])
    known = unit or drawing.unit
    if not known:
        width, height = np.ptp(drawn.reshape(-1, 2), axis=0)
        raise MapError(
            f"{shortened(path)}: says no unit ($INSUNITS is {drawing.header_unit}): state it with mrp-sumo import --unit, "
            f"one of {', '.join(UNIT_M)}; in m the drawing is {width:.4g} x {height:.4g} m, in mm {width / 1e3:.4g} x {height / 1e3:.4g} m"
        )
    return DxfContent(
        strokes=drawn * UNIT_M[known],
        unit=known,
        layers={layer: len(drawing.strokes[layer]) for layer in chosen},
        left_out={layer: len(lines) for layer, lines in drawing.strokes.items() if layer not in chosen},
    )


def read_dxf_layers(path: Path, unit: str | None = None) -> DxfLayers:
    """The strokes of all layers of a drawing; `unit` is that of its curves. Raises MapError as the module refuses, but for units."""
    document = _document(path)
    header_unit = document.header.get("$INSUNITS", 0)
    flat = FLAT_M / UNIT_M[unit or OF_HEADER.get(header_unit, "m")]
    strokes: dict[str, list[np.ndarray]] = {}
    others: Counter[tuple[str, str]] = Counter()  # (layer, kind) of what is no stroke
    count = 0
    try:
        for layer, kind, line in _lines(document.modelspace(), flat):
            if line is None:
                others[layer, kind] += 1
                continue
            count += len(line) - 1
            if count > MAX_STROKES:
                raise MapError(f"{shortened(path)}: more than {MAX_STROKES} strokes: choose layers with --layers")
            strokes.setdefault(layer, []).append(np.stack([line[:-1], line[1:]], axis=1))
    except MapError:
        raise
    except Exception as error:  # ezdxf raises anything on damaged entities
        raise _damaged(path, first_line(error)) from None
    if not strokes and (sheet := _sheet(document)):
        raise MapError(f"{shortened(path)}: nothing is drawn in model space, but on the sheet '{sheet}': copy that to model space")
    layers = {layer: np.concatenate(parts) for layer, parts in strokes.items()}
    if not all(np.isfinite(lines).all() for lines in layers.values()):
        raise _damaged(path, "a coordinate is no number")
    hidden = {layer.dxf.name.lower() for layer in document.layers if not layer.is_on() or layer.is_frozen()}
    return DxfLayers(
        strokes=layers,
        shown=tuple(layer for layer in layers if layer.lower() not in hidden),
        unit=OF_HEADER.get(header_unit, ""),
        header_unit=header_unit,
        known=tuple(layer.dxf.name for layer in document.layers),
        others=others,
    )


def _sheet(document: Any) -> str:
    """A sheet of paper on which something is drawn, '' where there is none."""
    sheets = (layout for layout in document.layouts if not layout.is_modelspace)
    return next((str(sheet.name) for sheet in sheets if any(each.dxftype() != "VIEWPORT" for each in sheet)), "")


def _document(path: Path) -> Any:
    import ezdxf
    from ezdxf import recover

    if not (log := logging.getLogger("ezdxf")).handlers:
        log.addHandler(logging.NullHandler())  # what it skips of a drawing would be lines on stderr
    data = read_bytes(path, MAX_BYTES, MapError)
    if not END.search(data[-40:]):
        raise _damaged(path, "it does not end with EOF")
    try:
        if data.startswith(b"AutoCAD Binary DXF"):
            return ezdxf.readfile(path)  # type: ignore[attr-defined,unused-ignore]
        return recover.readfile(path)[0]  # whatever the encoding, and where other programs take liberties
    except OSError as error:
        raise MapError(f"{shortened(path)}: {error.strerror or first_line(error)}") from None
    except Exception as error:  # its readers raise anything on damaged files
        raise _damaged(path, first_line(error)) from None


def _damaged(path: Path, why: str) -> MapError:
    return MapError(
        f"{shortened(path)}: not a complete DXF ({why[:100]}): open it in a CAD program, have it checked, and save it as DXF again"
    )


def _lines(entities: Any, flat: float, layer: str = "", depth: int = 0) -> Iterator[tuple[str, str, np.ndarray | None]]:
    """(layer, kind, places [N, 2]) of every entity in units of the drawing, blocks taken apart; no places of what is no stroke."""
    from ezdxf.path import make_path

    for entity in entities:
        kind = entity.dxftype()
        own = entity.dxf.get("layer", "0")
        on = layer if layer and own == "0" else own
        if kind in NESTED and depth < MAX_DEPTH:
            parts = entity.multi_insert() if kind == "INSERT" and entity.mcount > 1 else (entity,)
            for part in parts:
                yield from _lines(part.virtual_entities(), flat, on, depth + 1)
        elif kind in CORNERS:
            corners = [tuple(corner)[:2] for corner in entity.wcs_vertices()]
            yield on, kind, np.array([*corners, corners[0]], np.float64)
        elif kind in CURVES and not (kind == "POLYLINE" and not (entity.is_2d_polyline or entity.is_3d_polyline)):
            places = np.array([(p.x, p.y) for p in make_path(entity).flattening(flat)], np.float64)
            yield on, kind, places if len(places) > 1 else None
        else:
            yield on, kind, None


def _chosen(path: Path, drawing: DxfLayers, layers: Sequence[str] | None) -> list[str]:
    if layers is None:
        return list(drawing.shown)
    lines, others = drawing.strokes, drawing.others
    drawn = {layer.lower(): layer for layer in lines}
    known = drawn | {layer.lower(): layer for layer, _ in others} | {layer.lower(): layer for layer in drawing.known}
    for name in layers:
        if name.lower() not in known:
            there = listed(sorted(lines), 12) or "no layer"
            raise MapError(f"{shortened(path)}: no layer '{name}'{nearest(name, known.values())}; strokes are on {there}")
        if name.lower() not in drawn:
            holds = ", ".join(f"{n} {kind}" for (layer, kind), n in others.items() if layer.lower() == name.lower())
            raise MapError(f"{shortened(path)}: layer '{name}' holds no line, polyline, arc or block ({holds or 'it is empty'})")
    return list(dict.fromkeys(drawn[name.lower()] for name in layers))
