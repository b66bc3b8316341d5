"""Signals that end a command."""

import signal
import subprocess
import sys

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
