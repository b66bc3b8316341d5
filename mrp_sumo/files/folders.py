"""Folders of results, told apart by the files in them: looked at before the libraries are loaded that read them."""

from pathlib import Path

from mrp_sumo.errors import BatchError, MrpSumoError

RESULT = "result.json"  # of a run, written last
PLAN = "plan.json"  # of a batch; a run's is that of its robots


def require_run(folder: Path) -> None:
    """Refuse what is not the folder of a complete run."""
    if not (folder / RESULT).exists():
        kind = "is a file, expected a run folder" if folder.is_file() else "no such folder"
        raise MrpSumoError(f"{folder}: {f'holds no complete run (no {RESULT})' if folder.is_dir() else kind}")


def require_batch(folder: Path) -> None:
    """Refuse what is not the folder of a batch."""
    if (folder / RESULT).is_file():
        raise BatchError(f"{folder}: a run, expected a batch; `mrp-sumo analyze` and `mrp-sumo report` measure and show a run")
    if not (folder / PLAN).exists():
        raise BatchError(f"{folder}: not the folder of a batch: there is no {PLAN}")


def is_replaceable(out: Path, mark: str) -> bool:
    """True where nothing is, or a folder that is empty or holds a file by which results of this kind are known."""
    return not out.exists() or (out.is_dir() and ((out / mark).is_file() or not any(out.iterdir())))


def is_batch(folder: Path) -> bool:
    """True for the folder of a batch, and not that of a run, which has a plan, too."""
    return (folder / PLAN).is_file() and (folder / "runs").is_dir() and not (folder / RESULT).is_file()
