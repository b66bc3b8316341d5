"""Watching processes end."""

import time
from pathlib import Path


def gone(pid):
    """Whether a process ends within a minute."""
    for _ in range(1200):
        stat = Path(f"/proc/{pid}/stat")
        if not stat.exists() or stat.read_text().rpartition(")")[2].split()[0] in "ZX":
            return True
        time.sleep(0.05)
    return False
