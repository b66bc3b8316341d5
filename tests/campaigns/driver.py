"""What all campaigns share: numbered trials with a seed, in a process of their own, until the time is up; started again, it goes on.

    OUT/<campaign>-<seed>.jsonl    one line per trial that ended
    OUT/failed/<campaign>-<seed>-<number>/   the files of a trial with a fault; `command.sh` shows it

A campaign is a class with `trial(number, folder)`. What a trial is follows from the seed and its number alone. Trials run one
after the other in a child process with 4 GB; a trial that takes too long or kills the process is a fault, and the next child goes on.
"""

import collections
import json
import os
import resource
import shutil
import signal
import subprocess
import time
import traceback
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

MEMORY_BYTES = 4 << 30
TRIALS_PER_CHILD = 300
STARTING_S = 900.0


@dataclass(frozen=True)
class Trial:
    """How a trial ended."""

    kind: str  # what was tried; a row of the table
    ended: str  # in a word
    faults: tuple[str, ...] = ()
    command: str = ""  # that shows the faults, in the trial's folder


class Campaign(Protocol):
    """A kind of trials."""

    size: int | None  # how many there are; None: without end

    def trial(self, number: int, folder: Path) -> Trial:
        """Make a trial in an empty folder."""


def rows_in(path: Path) -> dict[int, dict[str, Any]]:
    """Trials that ended, by number; a line that was cut off is made again."""
    rows = {}
    for line in path.read_text().splitlines() if path.is_file() else ():
        try:
            row = json.loads(line)
        except ValueError:
            continue
        rows[row["number"]] = row
    return rows


def run(command: list[str], name: str, out: Path, seed: int, minutes: float, limit_s: float) -> int:
    """Make trials until the time is up or there are no more; print what was found.

    Parameters
    ----------
    command
        Starts a child; "--child FIRST" is added.
    name, seed
        Of the campaign.
    out
        Folder of the results.
    minutes
        After which no trial begins.
    limit_s
        Wall time of a trial.

    Returns
    -------
    int
        The exit code: 1 when a trial, now or earlier, had a fault.
    """
    out.mkdir(parents=True, exist_ok=True)
    path = out / f"{name}-{seed}.jsonl"
    until = time.monotonic() + 60 * minutes
    while time.monotonic() < until:
        first = max(rows_in(path), default=-1) + 1
        child = subprocess.Popen([*command, "--child", str(first)], start_new_session=True)
        _watch(child, path, out, name, seed, limit_s, until)
        if first == max(rows_in(path), default=-1) + 1:  # there are no more
            break
    print(table(rows_in(path).values()))
    return 1 if any(row["faults"] for row in rows_in(path).values()) else 0


def _watch(child: subprocess.Popen[bytes], path: Path, out: Path, name: str, seed: int, limit_s: float, until: float) -> None:
    """Wait for a child; when it hangs or dies, record its trial."""
    size, since = -1, time.monotonic()
    patience_s = STARTING_S  # kernels may have to be compiled first
    while child.poll() is None:
        time.sleep(0.1)
        now = path.stat().st_size if path.is_file() else 0
        if now != size:
            patience_s = STARTING_S if size < 0 else limit_s + 30
            size, since = now, time.monotonic()
            if since > until:
                break
        elif time.monotonic() - since > patience_s:
            current = max(rows_in(path), default=-1) + 1
            _record(
                path,
                out,
                current,
                name,
                seed,
                Trial("?", "hang", (f"takes more than {limit_s:g} s",), _command_in(out, name, seed, current)),
            )
            break
    if child.poll() is None:
        os.killpg(child.pid, signal.SIGKILL)
    code = child.wait()
    if code > 0:
        raise SystemExit(f"{name}: the campaign itself failed")
    if code not in (0, -signal.SIGKILL):
        current = max(rows_in(path), default=-1) + 1
        _record(
            path, out, current, name, seed, Trial("?", "crash", (f"ends the process with {code}",), _command_in(out, name, seed, current))
        )


def work(campaign: Campaign, name: str, out: Path, seed: int, first: int) -> None:
    """The trials of a child process."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    path = out / f"{name}-{seed}.jsonl"
    last = first + TRIALS_PER_CHILD
    for number in range(first, last if campaign.size is None else min(last, campaign.size)):
        folder = _folder(out, name, seed, number)
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        try:
            trial = campaign.trial(number, folder)
        except Exception:
            trial = Trial("?", "the campaign failed", (traceback.format_exc(),))
        _record(path, out, number, name, seed, trial)


def _folder(out: Path, name: str, seed: int, number: int) -> Path:
    return out.resolve() / "work" / f"{name}-{seed}-{number}"


def _command_in(out: Path, name: str, seed: int, number: int) -> str:
    file = _folder(out, name, seed, number) / "command.sh"
    return file.read_text() if file.is_file() else ""


def _record(path: Path, out: Path, number: int, name: str, seed: int, trial: Trial) -> None:
    folder = _folder(out, name, seed, number)
    if trial.faults:
        print(f"{name} {number}: {trial.kind}: {trial.faults[0].strip().splitlines()[-1]}", flush=True)
        failed = out / "failed" / folder.name
        failed.parent.mkdir(exist_ok=True)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "faults.txt").write_text("\n".join(trial.faults) + "\n")
        if trial.command:
            (folder / "command.sh").write_text(trial.command.rstrip("\n") + "\n")
        shutil.rmtree(failed, ignore_errors=True)
        shutil.move(folder, failed)
    shutil.rmtree(folder, ignore_errors=True)
    with path.open("a") as file:
        file.write(json.dumps({"number": number, **asdict(trial)}) + "\n")


def table(rows: Any) -> str:
    """Trials and faults of each kind, as Markdown."""
    rows = list(rows)
    kinds = collections.defaultdict(list)
    for row in rows:
        kinds[row["kind"]].append(row)
    lines = ["| trial | trials | with faults | ended |", "|---|---|---|---|"]
    for kind, part in [*sorted(kinds.items()), ("all", rows)]:
        ended = ", ".join(f"{count} {word}" for word, count in collections.Counter(row["ended"] for row in part).most_common(8))
        lines.append(f"| {kind} | {len(part)} | {sum(bool(row['faults']) for row in part)} | {ended} |")
    return "\n".join(lines)
