"""Strokes of a drawing in SVG: lines, polylines, polygons, rectangles, circles, ellipses and paths, in units of the drawing.

Layers are those of Inkscape, or groups with an id. Curves are flattened within 0.2 % of the drawing's extent. Text, pictures, clipping and
what `<use>` repeats are left out, and so is what is not displayed. Refuses paths that cannot be read and more than half a million strokes.
"""

import itertools
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from mrp_sumo.core.graph import FloatArray
from mrp_sumo.errors import nearest
from mrp_sumo.maps.readers.xml_text import Element, parse_xml
from mrp_sumo.maps.yaml_text import Text

MAX_STROKES = 500_000
PIECES = 16  # of a curve
TOKENS = re.compile(r"([MmLlHhVvCcSsQqTtAaZz])|([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)")
TRANSFORM = re.compile(r"(matrix|translate|scale|rotate|skewX|skewY)\s*\(([^)]*)\)")
NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
HIDDEN = re.compile(r"display\s*:\s*none")
APART = ("defs", "symbol", "clipPath", "mask", "pattern", "marker", "metadata")
TAKES = {"M": 2, "L": 2, "H": 1, "V": 1, "C": 6, "S": 4, "Q": 4, "T": 2, "A": 7, "Z": 0}
Line = list[complex]


@dataclass(frozen=True)
class SvgContent:
    """Lines of a drawing."""

    strokes: FloatArray  # [N, 2, 2] units of the drawing, y up
    layers: dict[str, int]  # strokes of each layer that was read
    left_out: dict[str, int] = field(default_factory=dict)  # strokes of the others


def read_svg(source: Text, layers: Sequence[str] | None = None) -> SvgContent:
    """The strokes of a drawing, of chosen layers, in any case; by default of all. Raises MapError as the module refuses."""
    strokes: dict[str, list[tuple[complex, complex]]] = {}
    count = 0
    for layer, line in _lines(parse_xml(source), np.eye(3), ""):
        count += len(line) - 1
        if count > MAX_STROKES:
            raise source.fault(f"more than {MAX_STROKES} strokes: choose layers with --layers")
        strokes.setdefault(layer, []).extend(itertools.pairwise(line))
    strokes = {layer: lines for layer, lines in strokes.items() if lines}
    if not strokes:
        raise source.fault("nothing is drawn: no line, rectangle, circle or path that is shown")
    known = {layer.lower(): layer for layer in strokes}
    for name in layers or ():
        if name.lower() not in known:
            shown = ", ".join(sorted(filter(None, strokes))[:12]) or "no layer"
            raise source.fault(f"no layer '{name}'{nearest(name, known.values())}; strokes are on {shown}")
    chosen = list(strokes) if layers is None else list(dict.fromkeys(known[name.lower()] for name in layers))
    ends = np.array([pair for layer in chosen for pair in strokes[layer]], np.complex128)
    xy = np.stack([ends.real, -ends.imag], axis=2)
    if not np.isfinite(xy).all():
        raise source.fault("a coordinate is no number")
    counts = {layer: len(lines) for layer, lines in strokes.items()}
    return SvgContent(xy, {x: counts[x] for x in chosen}, {x: n for x, n in counts.items() if x not in chosen})


def _lines(element: Element, frame: np.ndarray, layer: str) -> Iterator[tuple[str, Line]]:
    name, attributes = element.name.rpartition(":")[2], element.attributes
    if name in APART or attributes.get("display") == "none" or HIDDEN.search(attributes.get("style", "")):
        return
    if "transform" in attributes:
        frame = frame @ _transform(attributes["transform"])
    if name == "g":
        layer = next((attributes[key] for key in ("inkscape:label", "label", "id") if attributes.get(key)), layer)
    for line in _shape(element, name):
        places = frame @ np.array([[z.real for z in line], [z.imag for z in line], [1.0] * len(line)])
        yield layer, (places[0] + 1j * places[1]).tolist()
    for child in element.children:
        yield from _lines(child, frame, layer)


def _shape(element: Element, name: str) -> Iterator[Line]:
    def number(key: str) -> float:
        match = NUMBER.match(element.get(key, "0").strip())
        if not match:
            raise element.fault(f"<{name}>: {key} is '{element.get(key, '')[:40]}', expected a number")
        return float(match[0])

    if name == "line":
        yield [complex(number("x1"), number("y1")), complex(number("x2"), number("y2"))]
    elif name in ("polyline", "polygon"):
        values = [float(text) for text in NUMBER.findall(element.get("points", ""))]
        line = [complex(x, y) for x, y in zip(values[::2], values[1::2])]
        yield line + line[:1] if name == "polygon" else line
    elif name == "rect":
        x, y, width, height = (number(key) for key in ("x", "y", "width", "height"))
        corners = [complex(x, y), complex(x + width, y), complex(x + width, y + height), complex(x, y + height)]
        yield [*corners, corners[0]]
    elif name in ("circle", "ellipse"):
        rx, ry = (number("r"), number("r")) if name == "circle" else (number("rx"), number("ry"))
        angles = np.linspace(0, 2 * math.pi, 4 * PIECES + 1).tolist()
        yield [complex(number("cx") + rx * math.cos(angle), number("cy") + ry * math.sin(angle)) for angle in angles]
    elif name == "path":
        yield from _path(element)


def _path(element: Element) -> Iterator[Line]:  # noqa: C901  one case a letter of the format
    """The lines of a path, curves flattened."""
    tokens = TOKENS.findall(element.get("d", ""))
    at = start = control = 0j
    line: Line = []
    letter, before, k = "", "", 0
    while k < len(tokens):
        if tokens[k][0]:
            letter, k = tokens[k][0], k + 1
        elif letter in ("", "Z", "z"):
            raise element.fault("a path begins with a number, expected M")
        kind, base = letter.upper(), at if letter.islower() else 0j
        values = [float(text) for command, text in tokens[k : k + TAKES[kind]] if not command]
        if len(values) < TAKES[kind]:
            raise element.fault(f"a path breaks off in '{letter}'")
        k += TAKES[kind]
        points = [base + complex(x, y) for x, y in zip(values[::2], values[1::2])]
        if kind == "M":
            if len(line) > 1:
                yield line
            at = start = points[0]
            line, letter = [at], "l" if letter == "m" else "L"
        elif kind == "Z":
            if len(line) > 1:
                yield [*line, start]
            at, line = start, [start]
        else:
            if kind == "H":
                points = [complex(base.real + values[0], at.imag)]
            elif kind == "V":
                points = [complex(at.real, base.imag + values[0])]
            elif kind == "A":
                points = _arc(at, values, base + complex(values[5], values[6]))
            elif kind in "CSQT":
                mirrored = 2 * at - control if before in ("CS" if kind in "CS" else "QT") else at
                curve = [at, *([mirrored] if kind in "ST" else []), *points]
                control, points = curve[-2], _bezier(curve)
            line += points
            at = points[-1]
        before = kind
    if len(line) > 1:
        yield line


def _bezier(points: Line) -> Line:
    """Places on a curve after its first, by de Casteljau."""
    t = np.linspace(0, 1, PIECES + 1)[1:, None]
    rows = np.repeat(np.array(points)[None], PIECES, axis=0)
    while rows.shape[1] > 1:
        rows = rows[:, :-1] * (1 - t) + rows[:, 1:] * t
    places: Line = rows[:, 0].tolist()
    return places


def _arc(start: complex, values: Sequence[float], end: complex) -> Line:
    """Places on an elliptical arc after its first (SVG 1.1, appendix F.6)."""
    rx, ry, turn = abs(values[0]), abs(values[1]), complex(math.cos(math.radians(values[2])), math.sin(math.radians(values[2])))
    if not rx or not ry or start == end:
        return [end]
    half = (start - end) / 2 / turn
    x, y = half.real, half.imag
    grown = max(1.0, math.sqrt((x / rx) ** 2 + (y / ry) ** 2))
    rx, ry = rx * grown, ry * grown
    root = max(0.0, (rx * ry) ** 2 - (rx * y) ** 2 - (ry * x) ** 2) / ((rx * y) ** 2 + (ry * x) ** 2)
    side = math.sqrt(root) * (-1 if bool(values[3]) == bool(values[4]) else 1)
    middle = complex(side * rx * y / ry, -side * ry * x / rx)
    first = math.atan2((y - middle.imag) / ry, (x - middle.real) / rx)
    sweep = math.atan2((-y - middle.imag) / ry, (-x - middle.real) / rx) - first
    sweep += 2 * math.pi if values[4] and sweep < 0 else -2 * math.pi if not values[4] and sweep > 0 else 0
    centre = middle * turn + (start + end) / 2
    angles = first + sweep * np.linspace(0, 1, 2 * PIECES + 1)[1:]
    return [centre + complex(rx * math.cos(a), ry * math.sin(a)) * turn for a in angles.tolist()]


def _transform(text: str) -> np.ndarray:
    """[3, 3] the matrix of a transform attribute."""
    whole = np.eye(3)
    for kind, inside in TRANSFORM.findall(text):
        v = [float(number) for number in NUMBER.findall(inside)]
        part = np.eye(3)
        if kind == "matrix" and len(v) == 6:
            part[:2] = np.array(v).reshape(3, 2).T
        elif kind == "translate" and v:
            part[:2, 2] = v[0], v[1] if len(v) > 1 else 0.0
        elif kind == "scale" and v:
            part[0, 0], part[1, 1] = v[0], v[-1]
        elif kind == "rotate" and v:
            c, s = math.cos(math.radians(v[0])), math.sin(math.radians(v[0]))
            part[:2, :2] = [[c, -s], [s, c]]
            if len(v) == 3:
                part[:2, 2] = np.array(v[1:]) - part[:2, :2] @ v[1:]
        elif kind.startswith("skew") and v:
            part[(0, 1) if kind == "skewX" else (1, 0)] = math.tan(math.radians(v[0]))
        whole = whole @ part
    return whole
