"""Kernels do the same compiled, loaded from the cache by another process, and as plain Python."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

TESTS = Path(__file__).parents[1]
NAMES = ("cbs", "ecbs", "eecbs", "cbs_ta", "ecbs_ta", "prioritised")
ASK = f"""
import sys
sys.path.insert(0, {str(TESTS)!r})
from truth import random_problem
from mrp_sumo.planning.registry import planner
for name in {NAMES!r}:
    for seed in (3, 8, 21):
        result = planner(name, {{}}).plan(random_problem(seed), 60.0)
        print(name, seed, result.status, result.plan.end_s.tolist() if result.plan else None)
"""


def answers(**environment):
    """What a new process says to the questions."""
    output = subprocess.run(
        [sys.executable, "-c", ASK], env={**os.environ, **environment}, capture_output=True, text=True, cwd=TESTS.parent, check=False
    )
    assert output.returncode == 0, output.stderr[-2000:]
    return output.stdout


@pytest.fixture(scope="module")
def compiled():
    return answers()


def test_kernels_from_the_cache_of_another_process_answer_the_same(compiled):
    assert compiled.count("solved") > 9
    assert answers() == compiled


def test_kernels_as_plain_python_answer_the_same(compiled):
    assert answers(NUMBA_DISABLE_JIT="1") == compiled
