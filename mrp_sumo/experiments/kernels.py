"""Compiling the kernels of a run, on a machine that has never done it: two processes, and a count for people to see."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

DRIVING = ("mrp_sumo/drive", "mrp_sumo/metrics")  # rooms whose kernels a process of its own compiles while this one has the planner's
DRIVING_ONLY = "from mrp_sumo.drive import warm; from mrp_sumo.metrics import audit; warm.prepare(); audit.prepare()"
LOOK_S = 0.2


@contextmanager
def compiling(report: Callable[[str, float, float], None], *, execute: bool) -> Iterator[None]:
    """Report how many kernels are compiled while the planner is prepared inside; nothing is reported where none is missing.

    Parameters
    ----------
    report
        Called with the stage, the number of kernels that are stored and the number that are needed.
    execute
        Whether the plan will be driven, which takes kernels of its own.
    """
    from mrp_sumo.search import _kernel

    apart = [room for room in DRIVING if execute and _kernel.is_empty(room)]
    helper = _compile_apart() if apart else None
    needed = _kernel.Missing()
    shown = False

    def show() -> None:
        nonlocal shown
        shown = True
        done = needed.num_stored + sum(_kernel.num_stored(room) for room in apart)
        of = max(done, needed.num_kernels + sum(_kernel.num_defined(room) for room in apart))
        report(f"compiling kernels, once: {done} of {of}", done, of)

    try:
        with _kernel.each_compiled(show):
            yield
        if shown:
            show()
        while helper and helper.poll() is None:
            show()
            try:
                helper.wait(LOOK_S)
            except subprocess.TimeoutExpired:
                continue
    finally:
        if helper and helper.poll() is None:
            helper.terminate()
            helper.wait()


def _compile_apart() -> "subprocess.Popen[bytes]":
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    return subprocess.Popen(
        [sys.executable, "-c", DRIVING_ONLY],
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
