"""People see what is compiled, and only then."""

import os

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
