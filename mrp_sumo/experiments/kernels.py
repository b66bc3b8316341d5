"""Compiling the kernels of a run, on a machine that has never done it: two processes, and a count for people to see."""

import os
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from mrp_sumo.core import children

ROOMS = ("mrp_sumo/drive", "mrp_sumo/metrics", "mrp_sumo/search")  # that kernels are in
DRIVING = ("mrp_sumo/drive", "mrp_sumo/metrics")  # rooms whose kernels a process of its own compiles while this one has the planner's
LOOK_S = 0.2


@contextmanager
def compiling(report: Callable[[str, float, float], None], *, execute: bool) -> Iterator[None]:
    """Report how many kernels are compiled while the planner is prepared inside; nothing is reported where none is missing.

    Reported are the stage, the number of kernels that are stored and of those that are needed: more of them where the plan will be driven.
    """
    from mrp_sumo.search import _kernel

    apart = [room for room in DRIVING if execute and _kernel.is_empty(room)]
    helper = _compile_apart() if apart else None
    needed = _kernel.UnstoredKernels()
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


def stored_kernels() -> tuple[int, int]:
    """The number of kernels that are stored, by whichever process, and of those that there are."""
    from mrp_sumo.search import _kernel

    return sum(_kernel.num_stored(room) for room in ROOMS), sum(_kernel.num_defined(room) for room in ROOMS)


def why_not_kept() -> str:
    """Why compiled kernels cannot be kept, and what to do; '' where they can."""
    from mrp_sumo.search import _kernel

    if not _kernel.is_compiled() or _kernel.room_folder("mrp_sumo/search") is not None:
        return ""
    setting = next((name for name in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME") if os.environ.get(name)), "")
    place = f"{setting}={os.environ[setting]}" if setting else "~/.cache"
    return (
        f"{place}: no folder that you alone can write to, so kernels are compiled anew each time, for minutes: set NUMBA_CACHE_DIR to one"
    )


def prepare_driving() -> None:
    """Compile or load the kernels that driving a plan takes."""
    from mrp_sumo.drive import warm
    from mrp_sumo.metrics import audit

    warm.prepare()
    audit.prepare()


def prepare_driving_apart() -> None:
    """The same in a process of its own, which ends with its parent."""
    children.end_with_parent()
    prepare_driving()


def _compile_apart() -> "subprocess.Popen[bytes]":
    return subprocess.Popen(
        children.command("mrp_sumo.experiments.kernels:prepare_driving_apart", str(os.getpid())),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
