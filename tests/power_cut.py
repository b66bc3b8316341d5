"""What a power cut leaves of a folder: of each file what was synced last, of each folder the entries it had when it was synced last.

`watch` logs the syncs of this process; `cut` makes the folder what a disk would be that keeps nothing else. That is stricter than file
systems are: their journals keep more, in order. The folder itself is taken to be there.
"""

import json
import os
import shutil
import stat
from pathlib import Path
from typing import Any


def watch(folder: Path, log: Path) -> None:
    """Log every `os.fsync` in a folder from now on: copies of files and lists of entries, in `log`."""
    log.mkdir(parents=True, exist_ok=True)
    fsync, top = os.fsync, str(folder.resolve())

    def logged(target: Any) -> None:
        fsync(target)
        number = target if isinstance(target, int) else target.fileno()
        path, result = str(Path(f"/proc/self/fd/{number}").readlink()), os.fstat(number)
        if not path.startswith(top):
            return
        row: dict[str, Any] = {"inode": result.st_ino}
        if stat.S_ISDIR(result.st_mode):
            row |= {"path": path, "entries": {e.name: [e.inode(), e.is_dir(follow_symlinks=False)] for e in os.scandir(path)}}
        else:
            row["copy"] = f"{result.st_ino}.{os.getpid()}.{os.urandom(4).hex()}"
            shutil.copyfile(f"/proc/self/fd/{number}", log / row["copy"])
        line = (json.dumps(row) + "\n").encode()
        with (log / "syncs.jsonl").open("ab", buffering=0) as file:
            file.write(line)

    os.fsync = logged


def cut(folder: Path, log: Path) -> None:
    """Leave of the folder what was synced."""
    entries: dict[int, dict[str, list[Any]]] = {}
    copies: dict[int, str] = {}
    top = folder.stat().st_ino
    for line in (log / "syncs.jsonl").read_text().splitlines() if (log / "syncs.jsonl").is_file() else ():
        row = json.loads(line)
        if "copy" in row:
            copies[row["inode"]] = row["copy"]
        else:
            entries[row["inode"]] = row["entries"]

    def restore(place: Path, inode: int) -> None:
        place.mkdir()
        for name, (inner, is_folder) in entries.get(inode, {}).items():
            if is_folder:
                restore(place / name, inner)
            else:
                (place / name).write_bytes((log / copies[inner]).read_bytes() if inner in copies else b"")

    rest = folder.with_name(f"{folder.name}.kept")
    restore(rest, top)
    shutil.rmtree(folder)
    rest.rename(folder)
    shutil.rmtree(log)  # the next log begins with what is there, which is synced
    log.mkdir()
    for place in (folder, *(path for path in folder.rglob("*") if path.is_dir())):
        row = {"inode": place.stat().st_ino, "entries": {e.name: [e.inode(), e.is_dir()] for e in os.scandir(place)}}
        for name, (inode, is_folder) in row["entries"].items():
            if not is_folder:
                shutil.copyfile(place / name, log / f"{inode}.0")
                _add(log, {"inode": inode, "copy": f"{inode}.0"})
        _add(log, row)


def _add(log: Path, row: dict[str, Any]) -> None:
    with (log / "syncs.jsonl").open("a") as file:
        file.write(json.dumps(row) + "\n")
