"""`python drive.py SUITE DIR WORKERS`: a batch of fake runs, for tests that kill it."""

import sys
from pathlib import Path

from mrp_sumo.experiments import batch
from mrp_sumo.experiments.suite import read_suite


class Silent:
    def begin(self, num_runs, num_done): ...

    def ended(self, record): ...

    def told(self, line): ...


if __name__ == "__main__":
    batch.code_version = lambda: "1"  # as the test says
    batch.run_batch(read_suite(Path(sys.argv[1])), Path(sys.argv[2]), Silent(), workers=int(sys.argv[3]), function="fake_runs:make")
