"""Measure videos of runs: CPU time, memory and size of 60 s of 100 robots, made up, at 1080 lines and 30 frames a second.

    python tools/bench_video.py [--robots 100] [--duration 60] [--json]

Each video is made as a user makes it, in a process of its own. With --json each row is a line.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from bench_replay import COMMAND, make_run


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=100)
    parser.add_argument("--duration", type=float, default=60.0, help="seconds, simulated and of the video")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        run = Path(scratch) / "run"
        run.mkdir()
        make_run(run, options.robots, options.duration)
        for name in ("out.mp4", "out.gif", "out.webp"):
            row = {"video": name[4:], "robots": options.robots, "duration_s": options.duration} | measured(run, Path(scratch) / name)
            print(json.dumps(row) if options.json else "  ".join(f"{key} {value}" for key, value in row.items()), flush=True)


def measured(run: Path, video: Path) -> dict[str, float]:
    """CPU time, peak memory and size of a video at real time."""
    command = [sys.executable, "-c", COMMAND, "render", str(run), "--video", str(video), "--speed", "1"]
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL)
    _, status, used = os.wait4(process.pid, 0)
    if status:
        raise SystemExit(f"{video.name}: could not be made")
    peak_mb = used.ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3)
    cpu_s = used.ru_utime + used.ru_stime
    return {"cpu_s": round(cpu_s, 1), "peak_mb": round(peak_mb), "size_mb": round(video.stat().st_size / 1e6, 2)}


if __name__ == "__main__":
    main()
