"""`python drive_batch.py SUITE DIR WORKERS [SCHEDULER]`: a batch of fake runs in a process of its own. Dask workers preload it."""

import os
import sys
from pathlib import Path

from fake_runs import Silent

from mrp_sumo.errors import MrpSumoError
from mrp_sumo.experiments import batch, cluster
from mrp_sumo.experiments.suite import read_suite

batch.code_version = cluster.code_version = lambda: "1"  # whatever is edited meanwhile

if __name__ == "__main__":
    suite, out, workers, *scheduler = sys.argv[1:]
    if log := os.environ.get("POWER_LOG"):
        import power_cut

        power_cut.watch(Path(out), Path(log))
    try:
        batch.run_batch(
            read_suite(Path(suite)),
            Path(out),
            Silent(),
            batch.Making(int(workers), *scheduler),
            function="fake_runs:make",
        )
    except MrpSumoError as error:
        print(error, file=sys.stderr)
        sys.exit(2)
