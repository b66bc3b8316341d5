"""The folder that a workbench works in: what is in it, maps and plans opened as drawings, and files saved whole.

Refuses places outside of the folder, and to write over a file that another program has changed since it was read.
"""

import hashlib
import io
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrp_sumo.errors import MapError, MrpSumoError
from mrp_sumo.files.reading import read_bytes, read_head
from mrp_sumo.files.writing import write_whole
from mrp_sumo.maps.building_file import building_document
from mrp_sumo.maps.catalogue import bundled_maps
from mrp_sumo.maps.load import load_map
from mrp_sumo.maps.map import Map
from mrp_sumo.maps.readers.dxf import UNIT_M, read_dxf_layers
from mrp_sumo.maps.readers.pdf import num_pages, page_picture
from mrp_sumo.maps.readers.reader import HEAD, map_name, plan_kind
from mrp_sumo.maps.readers.rmf.building_yaml import is_building
from mrp_sumo.maps.readers.svg import read_svg
from mrp_sumo.maps.yaml_edit import document_of, edited, text_of
from mrp_sumo.maps.yaml_text import MAX_BYTES, Text

BUNDLED = "bundled:"  # before the name of a map that comes with the program
BOM = b"\xef\xbb\xbf"
MAPS = (".building.yaml", ".nav.yaml", ".lif.json", ".site.json", ".json", ".xml", ".geojson", ".csv", ".map", ".scen", ".yaml", ".yml")
PLANS = (".dxf", ".svg", ".pdf", ".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".gif", ".webp", ".pgm")
MOST_FILES, DEEPEST = 2000, 3
MOST_SHOWN = 6000  # strokes of a plan while its layers are chosen, or some more
MOST_VERTICES = 20_000  # of a map of another format: more are not drawn by hand
SHOWN_BY_BROWSERS = ("PNG", "JPEG", "GIF", "WEBP")
BATCH, SCENARIO_KEYS = "plan.json", ("map:", "robots:")
HOLDS = {"run": "result.json", "study": "answer.json", "comparison": BATCH}  # kind of a folder -> a file in it
VARIANTS = "variants"  # the folder of comparisons


class Stale(MrpSumoError):
    """A file is not as it was when it was read."""


@dataclass(frozen=True)
class Workspace:
    """A folder of the user."""

    root: Path

    def path(self, name: str) -> Path:
        """The path of a file in the folder. Raises MrpSumoError for places outside."""
        if not name or "\0" in name:
            raise MrpSumoError("expected the name of a file")
        path = (self.root / name).resolve()
        if not path.is_relative_to(self.root):
            raise MrpSumoError(f"{name[:80]}: is outside of {self.root}")
        return path

    def files(self) -> list[dict[str, Any]]:
        """Maps, plans, scenarios, runs and studies in the folder, newest first."""
        entries: list[dict[str, Any]] = []
        self._look(self.root, 0, entries)
        return sorted(entries, key=lambda entry: -entry["changed"])

    def _look(self, folder: Path, depth: int, entries: list[dict[str, Any]]) -> None:
        for path in sorted(folder.iterdir()):
            if path.name.startswith(".") or len(entries) >= MOST_FILES:
                continue
            try:
                kind = _kind(path)
                if kind:
                    entries.append({"path": path.relative_to(self.root).as_posix(), "kind": kind, "changed": path.stat().st_mtime})
                elif path.is_dir() and depth < DEEPEST and not (path / BATCH).is_file():
                    self._look(path, depth + 1, entries)
            except OSError:
                continue  # which nobody may read, or has just gone

    def open(self, name: str, chosen: Mapping[str, Any]) -> dict[str, Any]:
        """A map or a plan as a drawing, with the digest of the file that it is saved to. Raises MrpSumoError for what is neither.

        It is a file in the folder, or `bundled:NAME`; layers, unit, scale and page of a plan are chosen as `load_map` has them.
        """
        path = bundled_maps().get(name.removeprefix(BUNDLED)) if name.startswith(BUNDLED) else self.path(name)
        if path is None:
            raise MrpSumoError(f"no bundled map '{name.removeprefix(BUNDLED)[:80]}'")
        head = read_head(path, HEAD, MapError)
        kind = plan_kind(head)
        if kind == "pdf":
            return self._picture(self._page(path, chosen.get("page") or 1))
        if kind == "picture":
            return self._picture(path)
        if not kind:
            text = _text(path)
            document = document_of(text) if path.suffix.lower() in (".yaml", ".yml") else None
            if is_building(document):
                if name.startswith(BUNDLED):
                    return self._copy(path, document)
                return {"path": name, "digest": self.digest(name), "from": name, "document": document, "notes": []}
            if isinstance(document, Mapping) and {"image", "resolution"} <= document.keys():
                return self._occupancy(path, document)
        map_ = load_map(path, **chosen)
        if map_.nav.num_vertices > MOST_VERTICES and map_.floor is None:
            raise MrpSumoError(
                f"{path.name}: {map_.nav.num_vertices} vertices, expected at most {MOST_VERTICES} to draw on; it runs as it is"
            )
        drawing = self._copy(path, building_document(map_, with_lanes=map_.floor is None))
        return {**drawing, "notes": [finding.line for finding in map_.findings]}

    def layers(self, name: str) -> dict[str, Any]:
        """Layers of a DXF or SVG, or `pages`, the number of those of a PDF, to choose from. Raises MrpSumoError for others.

        `unit` that the drawing says, '' where none, metres of the `units` that there are, `size` in units, and of each layer `name`, number
        of `strokes`, `shown`, and some `lines`, x, y, x, y in thousandths of the longer side from the upper left.
        """
        path = self.path(name)
        kind = plan_kind(read_head(path, HEAD, MapError))
        if kind == "pdf":
            return {"pages": num_pages(path)}
        if kind == "dxf":
            dxf = read_dxf_layers(path)
            strokes, shown, unit, units = dxf.strokes, dxf.shown, dxf.unit, dict(UNIT_M)
        elif kind == "svg":
            svg = read_svg(_text(path))
            parts = np.split(svg.strokes, np.cumsum(list(svg.layers.values()))[:-1])
            strokes, shown, unit, units = dict(zip(svg.layers, parts)), tuple(svg.layers), "", {}
        else:
            raise MrpSumoError(f"{name[:80]}: has no layers")
        if not strokes:
            raise MapError(f"{path.name}: nothing is drawn")
        places = np.concatenate([lines.reshape(-1, 2) for lines in strokes.values()])
        low, size = places.min(0), np.ptp(places, axis=0)
        scale, each = 1000 / max(size.max(), 1e-9), math.ceil(len(places) / 2 / MOST_SHOWN)
        layers = []
        for layer, lines in strokes.items():
            shares = np.stack([lines[::each, :, 0] - low[0], low[1] + size[1] - lines[::each, :, 1]], axis=2) * scale
            about = {"name": layer, "strokes": len(lines), "shown": layer in shown}
            layers.append({**about, "lines": np.rint(shares).astype(int).reshape(-1, 4).tolist()})
        return {"unit": unit, "units": units, "size": size.tolist(), "layers": layers}

    def _copy(self, path: Path, document: Any) -> dict[str, Any]:
        """A drawing of a file that is saved as another, beside it or in the folder."""
        folder = path.parent if path.parent.is_relative_to(self.root) else self.root
        name = (folder / f"{map_name(path)}.building.yaml").relative_to(self.root).as_posix()
        return {"path": name, "digest": "", "from": path.name, "document": document, "notes": []}

    def _picture(self, path: Path) -> dict[str, Any]:
        """A drawing over a picture, without a scale yet."""
        from PIL import Image

        try:
            with Image.open(path) as image:
                size = image.size
        except Exception as error:  # Pillow's decoders raise anything on damaged files
            raise MapError(f"image '{path.name}' cannot be read: {error}") from None
        level = {"drawing": {"filename": path.name}, "elevation": 0, "lanes": [], "measurements": [], "vertices": [], "walls": []}
        about = {"coordinate_system": "reference_image", "graphs": {}, "levels": {"L1": level}, "lifts": {}, "name": map_name(path)}
        return {**self._copy(path, about), "size": size}

    def _page(self, path: Path, page: int) -> Path:
        """The picture of a page of a PDF, a file beside it."""
        from PIL import Image

        made = path.with_name(f"{path.stem}_page{page}.png")
        if not made.exists():
            buffer = io.BytesIO()
            Image.fromarray(page_picture(path, page)).save(buffer, "PNG")
            write_whole(made, buffer.getvalue())
        return made

    def _occupancy(self, path: Path, about: Mapping[str, Any]) -> dict[str, Any]:
        """A drawing over a map that a robot recorded, which says its scale."""
        drawing = self._picture((path.parent / str(about["image"])).resolve())
        width = drawing["size"][0]
        level = drawing["document"]["levels"]["L1"]
        level["vertices"] = [[0, 0, 0, ""], [width, 0, 0, ""]]
        level["measurements"] = [[0, 1, {"distance": [3, round(width * float(about["resolution"]), 6)]}]]
        return drawing

    def digest(self, name: str) -> str:
        """The SHA-256 of a file; '' where there is none."""
        path = self.path(name)
        return hashlib.sha256(read_bytes(path, MAX_BYTES)).hexdigest() if path.is_file() else ""

    def save_drawing(self, name: str, document: Any, digest: str, like: str = "") -> str:
        """Save a drawing to a file that is as it was when its digest was taken. Returns the new digest.

        A new file has the text of another, `like`, wherever both say the same.
        """
        path = self.path(name)
        if not name.endswith((".yaml", ".yml")):
            raise MrpSumoError(f"{name}: expected a name that ends in .building.yaml")

        def text(before: bytes | None) -> bytes:
            if before is None and like and self.digest(like):
                before = self.path(like).read_bytes()
            if before is None:
                return text_of(document).encode()
            mark = BOM if before.startswith(BOM) else b""
            return mark + edited(Text(path, before.removeprefix(BOM).decode()), document).encode()

        return self._save(name, text, digest)

    def save_text(self, name: str, text: str, digest: str) -> str:
        """Save a text; as `save_drawing`."""
        if not name.endswith((".yaml", ".yml", ".csv")):
            raise MrpSumoError(f"{name}: expected a name that ends in .yaml or .csv")
        return self._save(name, lambda _: text.encode(), digest)

    def add(self, name: str, data: bytes) -> None:
        """A plan or a map from elsewhere as a new file of the folder. Raises MrpSumoError for other names, and Stale where it is there."""
        if "/" in name or "\\" in name or not name.lower().endswith((*MAPS, *PLANS)) or name.startswith("."):
            raise MrpSumoError(f"{name[:80]}: expected a plan or a map, such as hall.png or hall.dxf")
        if self.digest(name):
            raise Stale(f"{name}: is there already: nothing was written")
        write_whole(self.path(name), data)

    def _save(self, name: str, text: Callable[[bytes | None], bytes], digest: str) -> str:
        path = self.path(name)
        if self.digest(name) != digest:
            what = "is there already, from somebody else" if not digest else "was changed by another program since it was opened"
            raise Stale(f"{name}: {what}: nothing was written")
        before = path.read_bytes() if path.is_file() else None
        data = text(before)
        if data != before:
            write_whole(path, data)
        return hashlib.sha256(data).hexdigest()

    def picture(self, name: str) -> tuple[str, bytes]:
        """Kind and bytes of a picture, such as browsers show. Raises MrpSumoError for files that are none."""
        from PIL import Image

        path = self.path(name)
        if plan_kind(read_head(path, HEAD)) != "picture":
            raise MrpSumoError(f"{name[:80]}: no picture")
        try:
            with Image.open(path) as image:
                if image.format in SHOWN_BY_BROWSERS:
                    return f"image/{image.format.lower()}", path.read_bytes()
                buffer = io.BytesIO()
                image.convert("RGB").save(buffer, "PNG")
                return "image/png", buffer.getvalue()
        except Exception as error:  # Pillow's decoders raise anything on damaged files
            raise MrpSumoError(f"{name[:80]}: cannot be read: {error}") from None


def lanes_over_floor(workspace: Workspace, name: str, chosen: Mapping[str, Any], pitch_m: float, radius_m: float) -> dict[str, Any]:
    """Lanes in a grid wherever a robot has room over a plan, `pitch_m` apart, and walls of a picture; in units of its drawing.

    Layers, unit and scale are chosen as `load_map` has them. Raises MapError where there is no room for a circle of `radius_m`.
    """
    path = workspace.path(name)
    map_: Map = load_map(path, **chosen, cell_m=pitch_m, robot_radius_m=radius_m)
    if map_.nav.num_vertices > MOST_VERTICES:
        raise MrpSumoError(f"{map_.nav.num_vertices} crossings, expected at most {MOST_VERTICES}: choose lanes farther apart")
    assert map_.floor is not None
    height, width = map_.floor.occupied.shape
    is_picture = plan_kind(read_head(path, HEAD, MapError)) == "picture"
    level = next(iter(building_document(map_, picture=(path.name, width, height) if is_picture else None)["levels"].values()))
    if not is_picture:
        level["walls"] = []  # which its drawing has
    lines = [*level["lanes"], *level["walls"]]
    used = {v: k for k, v in enumerate(sorted({v for line in lines for v in line[:2]}))}  # without the ends of the ruler
    lanes, walls = ([[used[a], used[b], *rest] for a, b, *rest in level[kind]] for kind in ("lanes", "walls"))
    notes = [finding.line for finding in map_.findings if finding.severity != "info"]
    return {"vertices": [level["vertices"][v] for v in used], "lanes": lanes, "walls": walls, "notes": notes}


def _text(path: Path) -> Text:
    try:
        return Text(path, read_bytes(path, MAX_BYTES, MapError).removeprefix(BOM).decode())
    except UnicodeDecodeError:
        return Text(path, "")


def _kind(path: Path) -> str:
    """What a path is for a workbench; '' for what it has no use for."""
    name = path.name.lower()
    if path.is_dir():
        holds = [kind for kind, file in HOLDS.items() if (path / file).is_file()]
        return holds[0] if holds and (holds[0] != "comparison" or path.parent.name == VARIANTS) else ""
    if name.endswith(PLANS):
        return "plan"
    if name.endswith((".yaml", ".yml")) and not name.endswith((".building.yaml", ".nav.yaml")):
        text = read_head(path, HEAD).decode(errors="replace")
        if "\nbase:" in f"\n{text}":
            return "suite"
        return "scenario" if all(f"\n{key}" in f"\n{text}" for key in SCENARIO_KEYS) else "map" if "image:" in text else ""
    return "map" if name.endswith(MAPS[:-2]) and name not in ("facts.json",) else ""
