"""A picture to draw on again and again: filled shapes and lines by matplotlib's Agg, and words, in pixels from the lower left."""

import io
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.path import Path as Outline
from matplotlib.transforms import IdentityTransform
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from mrp_sumo.core.graph import FloatArray

Pixels = NDArray[np.uint8]  # [H, W, 4] RGBA, the upper row first
SAME = IdentityTransform()


class Canvas:
    """A picture of W x H pixels that begins each time as its background."""

    def __init__(self, width: int, height: int, background: str) -> None:
        self.width, self.height = width, height
        self._agg = RendererAgg(width, height, 72)
        self.pixels: Pixels = np.asarray(self._agg.buffer_rgba())
        self.background = np.empty_like(self.pixels)
        self.background[:] = [round(255 * c) for c in to_rgba(background)]
        self.clear()

    def clear(self) -> None:
        """Begin again."""
        np.copyto(self.pixels, self.background)

    def keep(self) -> None:
        """Make what was drawn so far the background."""
        np.copyto(self.background, self.pixels)

    def fill(self, shapes: FloatArray, colour: str, *, alpha: float = 1.0, edge: str = "", width: float = 1.0, clip: Any = None) -> None:
        """Fill closed shapes [N, K, 2] of one colour, with a line around each where an edge is given."""
        if not len(shapes):
            return
        closed = np.concatenate([shapes, shapes[:, :1]], axis=1)
        codes = np.tile([1, *[2] * (shapes.shape[1] - 1), 79], len(shapes)).astype(np.uint8)
        pen = self._pen(edge or colour, width if edge else 0.0, clip)
        self._agg.draw_path(pen, Outline(closed.reshape(-1, 2), codes), SAME, to_rgba(colour, alpha))

    def stroke(self, lines: list[FloatArray], colour: str, *, alpha: float = 1.0, width: float = 1.0, clip: Any = None) -> None:
        """Draw lines [K, 2] of one colour."""
        if not lines:
            return
        codes = np.full(sum(map(len, lines)), 2, np.uint8)
        codes[np.cumsum([0, *map(len, lines[:-1])])] = 1
        self._agg.draw_path(self._pen(colour, width, clip, alpha), Outline(np.concatenate(lines), codes), SAME, None)

    def paste(self, image: Pixels, left: int, bottom: int) -> None:
        """Lay a picture over what is there; what does not fit is left out."""
        h, w = image.shape[:2]
        top = self.height - bottom - h
        a, b, c, d = max(0, top), min(self.height, top + h), max(0, left), min(self.width, left + w)
        if a >= b or c >= d:
            return
        over = image[a - top : b - top, c - left : d - left].astype(np.uint16)
        under = self.pixels[a:b, c:d, :3]
        alpha = over[..., 3:]
        under[:] = (over[..., :3] * alpha + under * (255 - alpha) + 127) // 255

    def write(self, text: str, at: tuple[float, float], size: float, colour: str, *, align: str = "left", **look: Any) -> None:
        """Write a line of text whose middle is at a height; to the left, centre or right of a point. `look` is that of `words`."""
        x, y = at
        image = words(text, round(size), colour, **look)
        shift = {"left": 0.0, "center": image.shape[1] / 2, "right": image.shape[1]}[align]
        self.paste(image, round(x - shift), round(y - image.shape[0] / 2))

    def embed(self, figure: Figure) -> None:
        """Lay a figure of the same size under everything."""
        file = io.BytesIO()
        figure.savefig(file, format="rgba", dpi=72)
        self.pixels[:] = np.frombuffer(file.getvalue(), np.uint8).reshape(self.pixels.shape)

    def _pen(self, colour: str, width: float, clip: Any, alpha: float = 1.0) -> Any:
        pen = self._agg.new_gc()
        pen.set_foreground(to_rgba(colour, alpha), isRGBA=True)
        pen.set_linewidth(width)
        pen.set_joinstyle("round")
        pen.set_capstyle("round")
        pen.set_clip_rectangle(clip)
        return pen


@cache
def font(size: int, bold: bool = False) -> ImageFont.FreeTypeFont:
    """The font that matplotlib brings with it."""
    file = Path(mpl.get_data_path()) / "fonts" / "ttf" / f"DejaVuSans{'-Bold' if bold else ''}.ttf"
    return ImageFont.truetype(str(file), size)


@cache
def words(text: str, size: int, colour: str, bold: bool = False, halo: str = "") -> Pixels:
    """A line of text as a picture, as high for every text."""
    stroke = max(2, size // 7) if halo else 0
    face = font(size, bold)
    width, height = round(face.getlength(text)) + 2 * stroke + 2, round(1.3 * size) + 2 * stroke
    image = Image.new("RGBA", (max(width, 1), height), (halo or colour)[:7] + "00")
    pen = ImageDraw.Draw(image)
    pen.text((stroke + 1, height / 2), text, font=face, fill=colour, anchor="lm", stroke_width=stroke, stroke_fill=halo or None)
    return np.asarray(image)


def shortened_to(text: str, size: float, width: float, *, bold: bool = False) -> str:
    """As much of a text as fits into a width."""
    face = font(round(size), bold)
    if face.getlength(text) <= width:
        return text
    while text and face.getlength(f"{text}…") > width:
        text = text[:-1]
    return f"{text.rstrip()}…"
