"""Paths at which sqlite3 bags can be opened.

The library puts paths into a URI unescaped, so `#`, `?` and `%` in them would lead elsewhere. A bag is
reached through a symbolic link with a plain name instead; only the bag's own name cannot contain them.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

ODD = "#?%"


@contextmanager
def plain_path(path: Path) -> Iterator[Path]:
    """The same place through folders without odd characters; `path` itself where it has none.

    Parameters
    ----------
    path
        Its folder must exist.
    """
    if not any(character in str(path.parent) for character in ODD):
        yield path
        return
    with TemporaryDirectory(prefix="mrp_sumo_") as scratch:
        link = Path(scratch) / "bag"
        link.symlink_to(path.parent.absolute(), target_is_directory=True)
        yield link / path.name
