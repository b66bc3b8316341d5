"""Real runs whose SUMO crashes where the seed is odd, after some steps. Imported by worker processes."""

import os
import signal

from mrp_sumo.engines.sumo.session import Sumo
from mrp_sumo.experiments import worker

STEPS = 50  # before the crash


def measure(job, maps):
    steps, step = 0, Sumo.step

    def crash_or_step(sumo):
        nonlocal steps
        steps += 1
        if steps > STEPS and worker.scenario_of(job).scenario.seed % 2:
            os.kill(os.getpid(), signal.SIGSEGV)
        step(sumo)

    Sumo.step = crash_or_step
    try:
        return worker.measure(job, maps)
    finally:
        Sumo.step = step
