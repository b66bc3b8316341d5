"""What all campaigns share: numbered trials with a seed, in a process of their own, until the time is up; started again, it goes on.

    OUT/<campaign>-<seed>.jsonl    one line per trial that ended
    OUT/failed/<campaign>-<seed>-<number>/   the files of a trial with a fault; `command.sh` shows it

A campaign is a class with `trial(number, folder)`. What a trial is follows from the seed and its number alone. The campaign's process
loads modules and starts no thread; it forks a child with 6 GB, which makes some thousand trials, one after the other. A trial that
takes too long or kills the process is a fault, and the next child goes on.
"""

import collections
import json
import os
import resource
import shutil
import signal
import sys
import time
import traceback
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

MEMORY_BYTES = 6 << 30
GROWTH_BYTES = 3 << 29  # after which a child ends, so that no trial suffers for those before it
TRIALS_PER_CHILD = 5000
STARTING_S = 900.0
MEMORY_DISK = Path("/dev/shm")  # trials write there, where syncing costs nothing


@dataclass(frozen=True)
class Trial:
    """How a trial ended."""

    kind: str  # what was tried; a row of the table
    ended: str  # in a word
    faults: tuple[str, ...] = ()
    command: str = ""  # that shows the faults, in the trial's folder
    num_runs: int = 1  # that were driven or made


class Campaign(Protocol):
    """A kind of trials."""

    size: int | None  # how many there are; None: without end

    def trial(self, number: int, folder: Path) -> Trial:
        """Make a trial in an empty folder."""


@dataclass(frozen=True)
class Places:
    """Where a campaign writes."""

    name: str
    seed: int
    out: Path

    @property
    def rows(self) -> Path:
        return self.out / f"{self.name}-{self.seed}.jsonl"

    def work(self, number: int) -> Path:
        """Folder of a trial under way."""
        top = MEMORY_DISK / f"campaign-{os.getuid()}" if MEMORY_DISK.is_dir() else self.out.resolve() / "work"
        return top / f"{self.name}-{self.seed}-{number}"

    def failed(self, number: int) -> Path:
        """Folder of a trial with a fault."""
        return self.out / "failed" / f"{self.name}-{self.seed}-{number}"


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


def run(campaign: Campaign, places: Places, minutes: float, limit_s: float) -> int:
    """Make trials until the time is up, there are no more, or a signal comes; print what was found.

    Parameters
    ----------
    campaign
        Whose trials they are.
    places
        Where they are written.
    minutes
        After which no trial begins.
    limit_s
        Wall time of a trial.

    Returns
    -------
    int
        The exit code: 1 when a trial, now or earlier, had a fault.
    """
    places.out.mkdir(parents=True, exist_ok=True)
    begin = time.monotonic()
    first = done = max(rows_in(places.rows), default=-1) + 1
    signals: list[int] = []
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: signals.append(number))
    while not signals and time.monotonic() < begin + 60 * minutes and (campaign.size is None or done < campaign.size):
        sys.stdout.flush()
        child = os.fork()
        if child == 0:
            _be_child(campaign, places, done)
        _watch(child, places, done, limit_s, begin + 60 * minutes, signals)
        done = _next_number(places.rows)
        shutil.rmtree(places.work(done), ignore_errors=True)
    rows, took_s = rows_in(places.rows), time.monotonic() - begin
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu_s = used.ru_utime + used.ru_stime
    print(table(rows.values()))
    num = done - first
    print(f"{num} trials in {took_s / 60:.1f} min, {num / took_s:.3g} per second, {num / cpu_s:.3g} per CPU second")
    return 1 if any(row["faults"] for row in rows.values()) else 0


def _be_child(campaign: Campaign, places: Places, first: int) -> None:
    """Make trials, and end the process."""
    code = 3
    try:
        os.setsid()
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
        last = first + TRIALS_PER_CHILD if campaign.size is None else min(first + TRIALS_PER_CHILD, campaign.size)
        size = 0
        for number in range(first, last):
            folder = places.work(number)
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir(parents=True)
            began_s = _cpu_s()
            try:
                trial = campaign.trial(number, folder)
            except Exception:
                trial = Trial("?", "the campaign failed", (traceback.format_exc(),))
            _record(places, number, trial, _cpu_s() - began_s)
            if number == first + 200:
                size = _memory_bytes()
            elif number > first + 200 and _memory_bytes() > size + GROWTH_BYTES:
                break
        code = 0
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def _cpu_s() -> float:
    """CPU time of this process, and of those that it started and that ended."""
    return sum(os.times()[:4])


def _memory_bytes() -> int:
    return int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()


def _watch(child: int, places: Places, first: int, limit_s: float, until: float, signals: list[int]) -> None:
    """Wait for a child; when it hangs or dies, record its trial. It is ended after the time and at a signal."""
    path = places.rows
    size, since = -1, time.monotonic()
    patience_s = STARTING_S  # kernels may have to be compiled first
    while True:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            break
        time.sleep(0.1)
        now = path.stat().st_size if path.is_file() else 0
        if now != size:
            patience_s = STARTING_S if size < 0 else limit_s + 30
            size, since = now, time.monotonic()
        hangs = time.monotonic() - since > patience_s
        if hangs:
            number = max(_next_number(path), first)
            _record(places, number, Trial("?", "hang", (f"takes more than {limit_s:g} s",), _command_in(places, number)))
        if hangs or since > until or signals:
            os.killpg(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return
    code = os.waitstatus_to_exitcode(status)
    if code > 0:
        raise SystemExit(f"{places.name}: the campaign itself failed")
    if code < 0:
        number = max(_next_number(path), first)
        _record(places, number, Trial("?", "crash", (f"ends the process with {code}",), _command_in(places, number)))


def _next_number(path: Path) -> int:
    """After the last line's; the file may be long."""
    if not path.is_file():
        return 0
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 200_000))
        lines = file.read().splitlines()
    for line in reversed(lines):
        try:
            return int(json.loads(line)["number"]) + 1
        except ValueError:
            continue
    return 0


def _command_in(places: Places, number: int) -> str:
    file = places.work(number) / "command.sh"
    return file.read_text() if file.is_file() else ""


def _record(places: Places, number: int, trial: Trial, cpu_s: float = 0.0) -> None:
    folder = places.work(number)
    if trial.faults:
        print(f"{places.name} {number}: {trial.kind}: {trial.faults[0].strip().splitlines()[-1]}", flush=True)
        failed = places.failed(number)
        failed.parent.mkdir(exist_ok=True)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "faults.txt").write_text("\n".join(trial.faults) + "\n", errors="replace")
        if trial.command:
            (folder / "command.sh").write_text(trial.command.rstrip("\n") + "\n", errors="surrogateescape")
        shutil.rmtree(failed, ignore_errors=True)
        shutil.move(folder, failed)
    shutil.rmtree(folder, ignore_errors=True)
    with places.rows.open("a") as file:
        file.write(json.dumps({"number": number, **asdict(trial), "cpu_s": round(cpu_s, 3)}) + "\n")


def table(rows: Any) -> str:
    """Trials, their CPU time and faults of each kind, as Markdown."""
    rows = list(rows)
    kinds = collections.defaultdict(list)
    for row in rows:
        kinds[row["kind"]].append(row)
    lines = ["| trial | trials | runs | CPU-s | with faults | ended |", "|---|---|---|---|---|---|"]
    for kind, part in [*sorted(kinds.items()), ("all", rows)]:
        ended = ", ".join(f"{count} {word}" for word, count in collections.Counter(row["ended"] for row in part).most_common(8))
        cpu_s, faults = sum(row.get("cpu_s", 0.0) for row in part), sum(bool(row["faults"]) for row in part)
        num_runs = sum(row.get("num_runs", 1) for row in part)
        lines.append(f"| {kind} | {len(part)} | {num_runs} | {cpu_s:.0f} | {faults} | {ended} |")
    return "\n".join(lines)
