"""Costs of the batch machinery: planning and resuming a large suite, and the overhead of a run that does nothing.

.venv/bin/python tools/bench_batch.py [--runs 100000] [--small 400]
"""

import argparse
import os
import sys
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import bench

from mrp_sumo.experiments.batch import open_batch, run_batch
from mrp_sumo.experiments.identity import code_version
from mrp_sumo.experiments.suite import read_suite, runs_of
from mrp_sumo.files.folders import PLAN
from mrp_sumo.io.results import load_results, record_path, write_record
from mrp_sumo.metrics.registry import MACHINE_DEPENDENT


def nothing(job, maps):
    """A run without work, with as many metrics as a real one."""
    metrics = {**{f"metric_{i}": i * 0.1 for i in range(40)}, **dict.fromkeys(MACHINE_DEPENDENT, 0.5), "time_blocked_s": [0.0] * 9}
    return {"status": "completed", "success": True, "reason": "", "metrics": metrics}


class Silent:
    """Tells nobody."""

    def begin(self, num_runs, num_done): ...

    def ended(self, record): ...

    def report(self, line):
        print(line, file=sys.stderr)


def _fill(out, small_out, small, runs):
    """Records of all runs but the last, as a batch would have left them."""
    import json

    from mrp_sumo.io.results import read_record

    like = read_record(record_path(small_out, runs_of(small, code_version())[0].key))
    out.mkdir()
    plan = json.loads((small_out / PLAN).read_text())
    (out / PLAN).write_text(json.dumps({**plan, "suite": "large", "keys": [run.key for run in runs]}))
    sync, os.fsync = os.fsync, lambda descriptor: None  # not what is measured
    for run in runs[:-1]:
        write_record(out, {**like, "key": run.key, "scenario_key": run.scenario_key, "scenario": json.loads(run.scenario)})
    os.fsync = sync


def arguments(parser: argparse.ArgumentParser) -> None:
    """Sizes of the suites."""
    parser.add_argument("--runs", type=int, default=100_000, help="of the large suite")
    parser.add_argument("--small", type=int, default=400, help="runs that are made")


def rows(options: argparse.Namespace) -> Iterator[bench.Row]:
    """The overhead of a run, then a row for each thing that is done with the large suite."""
    os.environ["PYTHONPATH"] = str(Path(__file__).parent)
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        (folder / "small.yaml").write_text(f"base: office_9\ngrid_search: {{seed: 0..{options.small - 1}}}\n")
        small = read_suite(folder / "small.yaml")
        for workers in (1, 2):
            work = partial(run_batch, small, folder / f"small_{workers}", Silent(), workers=workers, function="bench_batch:nothing")
            _, cpu_s, wall_s = bench.timed(work)
            what = f"a run with {workers} workers, start and tables included"
            yield {"what": what, "cpu_s": cpu_s / options.small, "wall_s": wall_s / options.small}
        (folder / "large.yaml").write_text(f"base: office_9\ngrid_search: {{robots.count: [5, 9], seed: 0..{options.runs // 2 - 1}}}\n")
        large = read_suite(folder / "large.yaml")
        runs, cpu_s, wall_s = bench.timed(lambda: runs_of(large, code_version()))
        yield {"what": f"plan {options.runs} runs", "cpu_s": cpu_s, "wall_s": wall_s}
        out = folder / "large"
        _fill(out, folder / "small_1", small, runs)
        batch, cpu_s, wall_s = bench.timed(lambda: open_batch(large, out, print, quarantine=True))
        assert len(batch.todo(1)) == 1
        yield {"what": f"plan and resume {options.runs} runs, all but one done", "cpu_s": cpu_s, "wall_s": wall_s}
        _, cpu_s, wall_s = bench.timed(lambda: load_results(out))
        yield {"what": f"load the results of {options.runs} runs", "cpu_s": cpu_s, "wall_s": wall_s}


if __name__ == "__main__":
    sys.exit(bench.main(__file__))
