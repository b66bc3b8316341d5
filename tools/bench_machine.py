"""The speed of this machine just now: a fixed loop of compiled code, and copies of memory.

    python tools/bench_machine.py [--json]

Times of benchmarks mean something beside these figures only: another machine, or a neighbour at work, changes both.
"""

import argparse
import os
import sys
import time
from collections.abc import Iterator

import bench
import numba
import numpy as np

NUM_STEPS = 50_000_000
NUM_BYTES = 256 * 2**20
REPEATS = 5


@numba.njit
def walk(num_steps: int) -> int:
    """A chain of integer operations that neither vectorises nor ends early."""
    x = 88172645463325252
    for _ in range(num_steps):
        x ^= x << 13
        x ^= x >> 7
        x ^= x << 17
    return x


def machine() -> dict[str, float]:
    """Best of some repetitions."""
    walk(1)
    source = np.ones(NUM_BYTES, np.uint8)
    target = np.empty_like(source)
    loop, copy = [], []
    for _ in range(REPEATS):
        began = time.perf_counter()
        walk(NUM_STEPS)
        loop.append(time.perf_counter() - began)
        began = time.perf_counter()
        np.copyto(target, source)
        copy.append(time.perf_counter() - began)
    return {
        "loop_msteps_per_s": round(NUM_STEPS / min(loop) / 1e6),
        "copy_gb_per_s": round(NUM_BYTES / min(copy) / 1e9, 1),
        "cores": os.cpu_count() or 1,
        "load": round(os.getloadavg()[0], 1),  # processes that ran or waited, in the last minute
    }


def arguments(parser: argparse.ArgumentParser) -> None:
    """None."""


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """One row."""
    yield machine()


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
