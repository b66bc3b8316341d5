"""Signals that end a command."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

COMMAND = """
import ctypes, os, sys, time
from mrp_sumo.cli.ending import exit_code, heed_signals, without_loss

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
