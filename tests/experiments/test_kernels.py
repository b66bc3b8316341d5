"""People see what is compiled, and only then."""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from mrp_sumo.experiments.kernels import compiling
from mrp_sumo.search._kernel import kernel

pytestmark = pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled")


def double(x):
    return 2 * x


def test_kernels_are_counted_while_they_are_compiled(monkeypatch, tmp_path):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    shown = []
    with compiling(lambda *progress: shown.append(progress), execute=False):
        twice = kernel(double)
        assert twice(2) == 4
    assert shown[0][0].startswith("compiling kernels, once: ")
    assert shown[-1][1] == shown[0][1] + 1 <= shown[-1][2]
    with compiling(lambda *progress: shown.append(progress), execute=False):
        before = len(shown)
        assert twice(3) == 6
    assert len(shown) == before


@pytest.mark.skipif(sys.platform != "linux", reason="asks the system, as only Linux can be asked")
@pytest.mark.parametrize("delay_s", [0.0, 1.0])
def test_process_that_compiles_apart_ends_with_its_parent_however_that_ends(tmp_path, delay_s):
    program = (
        "import time; from mrp_sumo.experiments.kernels import _compile_apart; print(_compile_apart().pid, flush=True); time.sleep(60)"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, env={**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    )
    child = Path("/proc") / parent.stdout.readline().strip()
    time.sleep(delay_s)
    parent.kill()
    parent.communicate()
    deadline = time.monotonic() + 120
    while child.exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    assert not child.exists()
