"""A batch on a Dask cluster says what a batch on this machine says. Scheduler and worker are real processes on loopback."""

import json
import os
import subprocess
import sys
import time
from importlib.util import find_spec

import fake_runs
import pytest
from batches import DRIVER, make, suite, told_by, workers_find_fake_runs  # noqa: F401  a fixture

from mrp_sumo.errors import BatchError
from mrp_sumo.experiments.cluster import Cluster, make_here

pytestmark = [pytest.mark.slow, pytest.mark.skipif(find_spec("distributed") is None, reason="no distributed")]


@pytest.fixture
def cluster(tmp_path, workers_find_fake_runs):  # noqa: F811
    """Address of a scheduler with a worker of two threads, and the processes of both."""
    output = tmp_path / "scheduler.json"
    options = ["--scheduler-file", str(output), "--no-dashboard"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    dask = [sys.executable, "-m", "dask"]
    scheduler = subprocess.Popen([*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", *options], **quiet)
    worker = subprocess.Popen(
        [
            *dask,
            "worker",
            "--nworkers",
            "1",
            "--nthreads",
            "2",
            "--local-directory",
            str(tmp_path),
            "--preload",
            str(DRIVER),
            *options,
        ],
        **quiet,
    )
    try:
        deadline = time.monotonic() + 120
        while not output.exists() and time.monotonic() < deadline:
            time.sleep(0.05)
        yield json.loads(output.read_text())["address"], scheduler, worker
    finally:
        for process in (worker, scheduler):
            process.kill()
            process.wait()


def drive(folder, out, scheduler, **environment):
    command = [sys.executable, str(DRIVER), str(folder / "study.yaml"), str(out), "1", scheduler]
    return subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env={**os.environ, **environment})


def test_cluster_gives_the_results_of_one_worker_and_survives_crashes(tmp_path, cluster):
    address, scheduler, _ = cluster
    file = suite(tmp_path, f"grid_search: {{seed: [0..7, {fake_runs.SEGFAULTS}]}}\n")
    make(file, tmp_path / "here")
    process = drive(tmp_path, tmp_path / "there", address)
    assert process.communicate(timeout=120)[1] == ""
    assert process.returncode == 0
    assert len(told_by(tmp_path / "there")) == 9
    assert told_by(tmp_path / "there") == told_by(tmp_path / "here")

    suite(tmp_path, "grid_search: {seed: 10..49}\n")  # then the scheduler goes away
    process = drive(tmp_path, tmp_path / "there", address, FAKE_SLEEP="0.1")
    deadline = time.monotonic() + 120
    while len(list((tmp_path / "there").glob("runs/*/*.json"))) < 11 and time.monotonic() < deadline:
        time.sleep(0.05)
    scheduler.terminate()
    assert process.communicate(timeout=120)[1] == f"the Dask scheduler at '{address}' is gone; start again to go on\n"
    assert process.returncode == 2
    assert len(told_by(tmp_path / "there")) >= 11


def test_cluster_whose_workers_are_lost_for_good_ends_the_batch(cluster, monkeypatch):
    monkeypatch.setattr("mrp_sumo.experiments.cluster.WITHOUT_WORKERS_S", 1.0)
    address, _, worker = cluster
    made = Cluster(address, "fake_runs:make")
    worker.kill()
    with pytest.raises(BatchError, match=f"^the Dask scheduler at '{address}' has no workers any more; start again to go on$"):
        for _ in range(200):
            made.wait(0.2)
    made.close()


def test_worker_with_another_version_makes_no_run():
    answer = make_here({}, "fake_runs:make", "9.9.9+0")
    assert answer["status"] == "wrong_version"
    assert "the batch 9.9.9+0; install the same on all machines" in answer["reason"]


def test_absent_scheduler_is_told_in_one_line(monkeypatch):
    monkeypatch.setattr("mrp_sumo.experiments.cluster.PATIENCE_S", 0.2)
    with pytest.raises(BatchError, match=r"^no Dask scheduler at 'tcp://127.0.0.1:9': .*$"):
        Cluster("tcp://127.0.0.1:9", "fake_runs:make")
