"""Finding maps by name: those that come with the program, and files beside a scenario.

Refuses names of no map, with the nearest right one.
"""

import os
from pathlib import Path

from mrp_sumo.errors import MapError, nearest
from mrp_sumo.files.reading import require_regular, shortened

SUFFIXES = (".building.yaml", ".lif.json")


def bundled_folder(name: str) -> Path:
    """A folder that comes with the program: networks, scenarios or robots."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "bundled" / name  # in a wheel; a source tree has it beside the package
    return installed if installed.is_dir() else package.parent / name


def bundled_maps() -> dict[str, Path]:
    """The maps that come with the program, by name."""
    folders = [folder for folder in bundled_folder("networks").iterdir() if folder.is_dir()]
    files = [folder / f"{folder.name}{suffix}" for folder in folders for suffix in SUFFIXES]
    return {file.parent.name: file for file in sorted(files) if file.is_file()}


def find_map(name_or_path: str, beside: Path) -> Path:
    """The file of a map. Raises MapError when there is no such file and no such map.

    It is named by a path from `beside`, the folder of the file that names it, or from the current folder; or as a bundled map.
    """
    for path in (beside / name_or_path, Path(name_or_path)):
        if os.path.isfile(path):  # noqa: PTH113  False for names that no system takes, too
            return path
    bundled = bundled_maps()
    if name_or_path in bundled:
        return bundled[name_or_path]
    if os.path.lexists(name_or_path):
        require_regular(Path(name_or_path), error=MapError)
    raise MapError(f"no map '{shortened(Path(name_or_path))}': neither a file nor a bundled map{nearest(name_or_path, bundled)}")
