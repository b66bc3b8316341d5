"""Signals that end a command."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

COMMAND = """
import ctypes, os, sys, time
from mrp_sumo.cli.ending import without_loss
from mrp_sumo.core.interrupts import exit_code, heed_signals

def within_callback():
    os.kill(os.getpid(), {number})
    time.sleep(0.01)

def command():
    ctypes.CFUNCTYPE(None)(within_callback)()  # what is raised in it goes nowhere
    {after}
    return 0

heed_signals()
try:
    sys.exit(without_loss(command))
except KeyboardInterrupt as error:
    sys.exit(exit_code(error))
"""


@pytest.mark.parametrize("after", ["time.sleep(600)", "raise RuntimeError('no compiled object yet')"])
@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signal_within_a_callback_of_a_library_ends_the_command(number, code, after):
    program = COMMAND.format(number=int(number), after=after)
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=300)
    assert (ended.returncode, ended.stderr) == (code, "")


def test_failure_without_a_signal_is_raised():
    program = COMMAND.format(number=0, after="raise RuntimeError('mine')")
    ended = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert ended.returncode == 1 and ended.stderr.endswith("RuntimeError: mine\n")


INTERRUPTED = """
import mrp_sumo.cli.main as main

main._dispatch = lambda arguments: exec("import os, signal, time; os.kill(os.getpid(), signal.SIGTERM); time.sleep(600)")
"""


def test_module_is_ended_by_the_signal_that_came_while_it_ran_a_text(tmp_path):
    (tmp_path / "sitecustomize.py").write_text(INTERRUPTED)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(Path(__file__).parents[2])])}
    ended = subprocess.run([sys.executable, "-P", "-m", "mrp_sumo", "list"], capture_output=True, text=True, env=environment, check=False)
    assert (ended.returncode, ended.stderr) == (143, "mrp-sumo: ended by SIGTERM\n")


LOADING = """
import os, sys, time
from llvmlite.binding.executionengine import ExecutionEngine
from mrp_sumo.cli.ending import without_loss
from mrp_sumo.core.interrupts import exit_code, heed_signals
from stored import kernel

find, numbers = ExecutionEngine._find_module_ptr, [int(word) for word in sys.argv[1:]]

def interrupted(engine, pointer):
    module = find(engine, pointer)
    if numbers and module.name == "kernel":  # whose machine code the compiler asks for
        os.kill(os.getpid(), numbers.pop())
    return module

def command():
    kernel(1)
    time.sleep(600 if sys.argv[1:] else 0)
    return 0

ExecutionEngine._find_module_ptr = interrupted
heed_signals()
try:
    sys.exit(without_loss(command))
except KeyboardInterrupt as error:
    sys.exit(exit_code(error))
"""


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signal_while_a_kernel_is_loaded_ends_the_command(tmp_path, number, code):
    (tmp_path / "stored.py").write_text("from numba import njit\n\n@njit(cache=True)\ndef kernel(n):\n    return n + 1\n")
    (tmp_path / "loading.py").write_text(LOADING)
    environment = os.environ | {
        "NUMBA_CACHE_DIR": str(tmp_path),
        "PYTHONPATH": os.pathsep.join([str(tmp_path), str(Path(__file__).parents[2])]),
    }
    for words, ended in (((), 0), ((str(int(number)),), code)):
        process = subprocess.run([sys.executable, "loading.py", *words], cwd=tmp_path, capture_output=True, text=True, env=environment)
        assert (process.returncode, process.stderr) == (ended, "")
