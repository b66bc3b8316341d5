"""Pictures on their own, without pyplot: notebooks show them, scripts save them, PNG or SVG by the file's suffix."""

import io
import math
from pathlib import Path

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.files.writing import written_whole

NOTEBOOK_DPI = 80


class Picture(Figure):
    """A matplotlib figure that notebooks show by itself."""

    def __init__(self, width_in: float, height_in: float, facecolor: str) -> None:
        super().__init__(figsize=(width_in, height_in), facecolor=facecolor)
        FigureCanvasAgg(self)

    def write(self, path: str | Path, dpi: float = 150) -> Path:
        """Write the picture, whole or not at all, and without the date: the same picture gives the same bytes.

        Raises MrpSumoError for another suffix, and OSError as the system says; nothing of the file is left then.
        """
        path = Path(path)
        require_suffix(path)
        fast = {"compress_level": 2}  # a tenth larger, in two thirds of the time
        with written_whole(path) as part, mpl.rc_context({"svg.hashsalt": "mrp_sumo", "svg.fonttype": "none"}):
            if path.suffix == ".png":
                self.savefig(part, format="png", dpi=dpi, metadata={"Software": None}, pil_kwargs=fast)
            else:
                self.savefig(part, format="svg", dpi=dpi, metadata={"Date": None, "Creator": None})
        return path

    def _repr_png_(self) -> bytes:
        image = io.BytesIO()
        self.savefig(image, format="png", dpi=NOTEBOOK_DPI)
        return image.getvalue()


def require_suffix(path: Path, error: type[MrpSumoError] = MrpSumoError) -> None:
    """Refuse a file that is neither PNG nor SVG."""
    if path.suffix not in (".png", ".svg"):
        raise error(f"{path}: a picture ends in .png or .svg, not '{path.suffix}'")


def round_length(most: float) -> float:
    """The longest length of 1, 2 or 5 and zeros, such as 0.2 or 50, that is not longer."""
    power = 10.0 ** math.floor(math.log10(most))
    return max(m * power for m in (1, 2, 5) if m * power <= most)
