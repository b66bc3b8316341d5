"""Folders of results that commands are told to read: looked for before libraries are loaded that read them."""

from pathlib import Path

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.files.folders import PLAN, RESULT, require_batch, require_run
from mrp_sumo.files.reading import shortened
from mrp_sumo.maps.catalogue import bundled_folder

RUNS = "runs"  # where commands write by default


def result_folder(text: str) -> str:
    """The type of an argument that names a folder or file of results.

    Raises MrpSumoError where there is none: with the place under `runs/` that may be meant, or how a bundled scenario comes to results.
    """
    path, there = Path(text), Path(RUNS) / text
    try:
        if path.exists():
            return text
        hint = f" (did you mean '{there}'?)" if text and there.is_dir() else ""
        if not hint and any((bundled_folder("scenarios") / f"{name}.yaml").is_file() for name in (text, path.name)):
            hint = f"; `mrp-sumo run {path.name}` makes {RUNS}/{path.name}"
    except (OSError, ValueError):  # no path at all: whoever reads it says why
        return text
    raise MrpSumoError(f"{shortened(path)}: no such folder{hint}")


def run_folder(text: str) -> str:
    """As `result_folder`, for a run."""
    require_run(Path(result_folder(text)))
    return text


def batch_folder(text: str) -> str:
    """As `result_folder`, for a batch or its table."""
    if not Path(result_folder(text)).is_file():
        require_batch(Path(text))
    return text


def reported_folder(text: str) -> str:
    """As `result_folder`, for a run, a batch or its table, or a folder of runs."""
    path = Path(result_folder(text))
    if path.is_dir() and not any(any(path.glob(pattern)) for pattern in (PLAN, RESULT, f"*/{RESULT}", f"*/*/{RESULT}")):
        raise MrpSumoError(f"{shortened(path)}: neither a batch nor a run: there is no {PLAN} and no {RESULT}")
    return text
