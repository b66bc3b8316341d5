"""MovingAI's grid maps (`.map`) and problem sets (`.scen`): reader and writer.

`type octile`, `height H`, `width W`, `map`, then H rows with the highest first; `.`, `G` and `S` are free, `@`,
`O`, `T` and `W` blocked (movingai.com/benchmarks/formats.html). Lanes join the four neighbours, as MAPF
has it. Refuses other headers and characters, and rows that are missing or of a wrong length.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from mrp_sumo.core.graph import BoolArray, IntArray, frozen
from mrp_sumo.errors import MapError, MrpSumoError
from mrp_sumo.maps.grid import MAX_CELLS, grid_graph
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.readers.reader import MapFile, Selection, grid_map, map_name, refuse_choice
from mrp_sumo.maps.yaml_text import Text, read_text

LETTERS = b".GS", b"@OTW"  # of free and of blocked cells


@dataclass(frozen=True, eq=False)
class ProblemSet:
    """The rows of a `.scen` file; robot k of a problem is row k."""

    map_name: str  # as the file names its map
    width: int
    height: int
    start: IntArray  # [N, 2] column and row, the highest row is 0
    goal: IntArray  # [N, 2]


class MovingAiMap:
    """MovingAI's grids."""

    name = "MovingAI grid"
    suffixes = (".map",)

    def detects(self, file: MapFile) -> bool:
        """Its first word."""
        return is_grid(file.text)

    def read(self, file: MapFile, selection: Selection) -> Map:
        """The grid, with cells of the selection, its lower left corner at (0, 0)."""
        refuse_choice(file.source, selection)
        free = occupancy(file.source)
        if not free.any():
            raise file.source.fault("no free cell: nothing to drive on")
        nav = grid_graph(free, selection.cell_m, (0.0, 0.0), name=map_name(file.path), source=str(file.path))
        return grid_map(file.source, nav, free)


class MovingAiScen:
    """MovingAI's problem sets: the grid beside them."""

    name = "MovingAI problem set"
    suffixes = (".scen",)

    def detects(self, file: MapFile) -> bool:
        """Its first line."""
        head = file.text[:200].lstrip().splitlines()
        return bool(head) and head[0].lower().split()[:1] == ["version"] and ":" not in head[0]

    def files(self, file: MapFile) -> tuple[Path, ...]:
        """Itself, and the grid."""
        return file.path, map_of_problem_set(file.source)

    def read(self, file: MapFile, selection: Selection) -> Map:
        """The grid, with cells of the selection."""
        return MovingAiMap().read(MapFile(read_text(map_of_problem_set(file.source))), selection)


def is_grid(text: str) -> bool:
    """True for a text that is meant as a `.map`."""
    return text[:200].lstrip().lower().startswith("type ")


def occupancy(source: Text) -> BoolArray:
    """[H, W] free cells of a `.map`; row 0 is the lowest."""
    lines = source.text.splitlines()
    start, height, width = _header(source, lines)
    if height * width > MAX_CELLS:
        raise source.fault(f"{width} x {height} cells; more than {MAX_CELLS:.0e} are not read")
    rows = lines[start : start + height]
    if len(rows) < height:
        raise source.fault(f"{len(rows)} rows, but the header says {height}")
    if any(line.strip() for line in lines[start + height :]):
        raise _fault(source, start + height + 1, f"more rows than the header's {height}")
    return free_cells(rows, start, width, LETTERS, partial(_fault, source))[::-1]


def free_cells(
    rows: Sequence[str], above: int, width: int, letters: tuple[bytes, bytes], fault: Callable[[int, str], MrpSumoError]
) -> BoolArray:
    """[H, W] whether cells are free, in the order of rows of letters, those of free and of blocked cells.

    Refuses rows of another width, and other letters; `fault` makes the error about a line, which counts those above the rows, too.
    """
    for number, row in enumerate(rows, above + 1):
        if len(row) != width or not row.isascii():
            raise fault(number, f"a row of {len(row)} characters, but the header says {width}")
    cells = np.frombuffer("".join(rows).encode(), np.uint8).reshape(len(rows), width)
    is_free, is_blocked = (np.isin(cells, np.frombuffer(some, np.uint8)) for some in letters)
    strange = np.argwhere(~is_free & ~is_blocked)
    if len(strange):
        k, column = strange[0].tolist()
        known = " ".join(b"".join(letters).decode())
        raise fault(above + 1 + k, f"column {column + 1} is '{chr(cells[k, column])}', expected one of {known}")
    return is_free


def _header(source: Text, lines: Sequence[str]) -> tuple[int, int, int]:
    """How many lines the header has, and the height and width that it gives."""
    size = {}
    start = None
    for number, line in enumerate(lines[:20], 1):
        words = line.split()
        if words[:1] == ["map"]:
            start = number
            break
        if len(words) != 2 or words[0] not in ("type", "height", "width"):
            raise _fault(source, number, f"'{line[:40]}' in the header, expected type, height, width or map")
        if words[0] != "type":
            if not words[1].isdecimal() or len(words[1]) > 12 or not 0 < int(words[1]) <= MAX_CELLS:
                raise _fault(source, number, f"{words[0]} is '{words[1][:20]}', expected a whole number above 0")
            size[words[0]] = int(words[1])
    if start is None or len(size) != 2:
        missing = [key for key in ("height", "width") if key not in size]
        raise source.fault(f"the header has no '{missing[0] if missing else 'map'}' line")
    return start, size["height"], size["width"]


def read_problem_set(source: Text) -> ProblemSet:
    """The rows of a `.scen`."""
    start, goal, head = [], [], None
    for number, line in enumerate(source.text.splitlines()[1:], 2):
        if not line.strip():
            continue
        words = line.rstrip("\n").split("\t") if "\t" in line else line.split()
        if len(words) < 8 or not all(word.strip().isdecimal() and len(word) < 10 for word in words[2:8]):
            raise _fault(source, number, "expected bucket, map, width, height, start x, start y, goal x, goal y, length")
        width, height, *cells = (int(word) for word in words[2:8])
        head = head or (words[1].strip(), width, height)
        if head != (words[1].strip(), width, height):
            raise _fault(
                source, number, f"map '{words[1]}' of {width} x {height}, but the first row has '{head[0]}' of {head[1]} x {head[2]}"
            )
        if cells[0] >= width or cells[2] >= width or cells[1] >= height or cells[3] >= height:
            raise _fault(source, number, f"cell outside the {width} x {height} map")
        start.append(cells[:2])
        goal.append(cells[2:])
    if head is None:
        raise source.fault("no rows")
    return ProblemSet(*head, frozen(np.array(start, np.int64)), frozen(np.array(goal, np.int64)))


def map_of_problem_set(source: Text) -> Path:
    """The `.map` that a `.scen` belongs to, looked for beside it."""
    name = read_problem_set(source).map_name.replace("\\", "/")
    beside = source.path.parent / name.rsplit("/", 1)[-1]
    if not beside.is_file():
        raise source.fault(f"its map '{name}' is not beside it")
    return beside


def write_grid(free: BoolArray, path: Path) -> None:
    """Write free cells [H, W], row 0 the lowest, as `.map`."""
    path.write_text(grid_text(free[::-1]), encoding="ascii")


def grid_text(free: BoolArray) -> str:
    """The text of a `.map` of free cells [H, W], row 0 the uppermost."""
    height, width = free.shape
    rows = np.where(free, np.uint8(ord(".")), np.uint8(ord("@")))
    return f"type octile\nheight {height}\nwidth {width}\nmap\n" + "\n".join(row.tobytes().decode() for row in rows) + "\n"


def _fault(source: Text, line: int, message: str) -> MapError:
    return MapError(f"{source.path.name}:{line}: {message}")
