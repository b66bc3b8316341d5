"""Runs for tests of batches: what happens is decided by the seed. Imported by worker processes."""

import errno
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from mrp_sumo.errors import MrpSumoError

EXITS, SEGFAULTS, HANGS, GROWS, RAISES, FAILS_ONCE, FULL = 101, 102, 103, 104, 105, 106, 107


def make(job, maps):
    import json

    scenario = json.loads(job["scenario"])
    seed = scenario["seed"]
    notes = os.environ.get("FAKE_NOTES")
    if notes:
        with Path(notes, "pids").open("a") as file:
            file.write(f"{os.getpid()}\n")
    time.sleep(float(os.environ.get("FAKE_SLEEP", "0")))
    match seed:
        case 101:
            print("about to leave", file=sys.stderr)
            os._exit(3)
        case 102:
            os.kill(os.getpid(), signal.SIGSEGV)
        case 103:
            child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"], start_new_session=True)  # as planners are
            Path(notes, "child").write_text(str(child.pid))
            time.sleep(600)
        case 104:
            rest = bytearray(b"x" * 600_000_000)
            time.sleep(600)
            del rest
        case 105:
            raise ZeroDivisionError("one over none")
        case 106:
            marker = Path(notes, "tried")
            if not marker.exists():
                marker.touch()
                os._exit(1)
        case 107:
            try:
                raise OSError(errno.ENOSPC, "No space left on device")
            except OSError:
                raise MrpSumoError("network: cannot be written: the disk is full") from None
    metrics = {
        "num_robots": scenario["robots"]["count"],
        "plan_success": seed % 5 != 4,
        "soc_steps": 10 * seed + scenario["robots"]["count"],
        "planning_time_s": time.perf_counter(),
        "min_distance_m": float("nan") if seed == 1 else 0.5,
        "time_blocked_s": [0.0, float(seed)],
    }
    solved = seed % 5 != 4
    return {"status": "completed" if solved else "planning_timed_out", "success": solved, "reason": "", "metrics": metrics}


class Silent:
    """A watcher that says nothing."""

    def begin(self, num_runs, num_done): ...

    def ended(self, record): ...

    def report(self, line): ...
