"""Paths at which sqlite3 bags can be opened.

The library puts paths into a URI unescaped, so `#`, `?` and `%` in them would lead elsewhere. A bag is
reached through a symbolic link with a plain name instead; only the bag's own name cannot contain them. So is a folder `*.bag`, which
it takes for a file of ROS 1.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

ODD = "#?%"


@contextmanager
def plain_path(path: Path) -> Iterator[Path]:
    """The same place through folders without odd characters; `path` itself, whose folder exists, where it has none."""
    is_misnamed = path.suffix == ".bag" and path.is_dir()
    if not is_misnamed and not any(character in str(path.parent) for character in ODD):
        yield path
        return
    with TemporaryDirectory(prefix="mrp_sumo_") as scratch:
        link = Path(scratch) / "bag"
        link.symlink_to((path if is_misnamed else path.parent).absolute(), target_is_directory=True)
        yield link if is_misnamed else link / path.name
