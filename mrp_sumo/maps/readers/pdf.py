"""Pages of PDF files as pictures, 150 pixels an inch.

The home of pypdfium2, which is PDFium, as browsers have it: permissively licensed, kept, and one wheel without anything else. Refuses pages
beyond the end, files that need a password, damaged ones, and pages of too many pixels.
"""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mrp_sumo.errors import MapError, first_line
from mrp_sumo.files.reading import read_bytes, shortened
from mrp_sumo.maps.yaml_text import MAX_BYTES

if TYPE_CHECKING:
    from pypdfium2 import PdfDocument

PIXELS_AN_INCH = 150
POINTS_AN_INCH = 72
MAX_PIXELS = 50_000_000


def page_picture(path: Path, page: int = 1) -> np.ndarray:
    """[h, w, 3] the page of a number, from 1. Raises MapError as the module refuses."""
    import pypdfium2

    with _opened(path) as document:
        if not 1 <= page <= len(document):
            raise MapError(f"{shortened(path)}: no page {page}, expected 1 to {len(document)}")
        try:
            sheet = document[page - 1]
            scale = PIXELS_AN_INCH / POINTS_AN_INCH
            width, height = (size * scale for size in sheet.get_size())
            if not 1 <= width * height <= MAX_PIXELS:
                raise MapError(
                    f"{shortened(path)}: page {page} has {width:.0f} x {height:.0f} pixels, expected at most {MAX_PIXELS // 10**6} million"
                )
            return np.array(sheet.render(scale=scale, rev_byteorder=True).to_numpy()[..., :3])
        except pypdfium2.PdfiumError as error:
            raise MapError(f"{shortened(path)}: page {page} cannot be read ({first_line(error)}): save it as PNG") from None


def num_pages(path: Path) -> int:
    """The number of pages. Raises MapError for files that cannot be read."""
    with _opened(path) as document:
        return len(document)


def _opened(path: Path) -> "PdfDocument":
    import pypdfium2

    data = read_bytes(path, MAX_BYTES, MapError)
    try:
        return pypdfium2.PdfDocument(data)
    except pypdfium2.PdfiumError as error:
        why = "it needs a password" if "assword" in str(error) else first_line(error)
        raise MapError(f"{shortened(path)}: cannot be read ({why}): print it as a new PDF, or save the page as PNG") from None
