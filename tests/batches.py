"""Batches of fake runs, for tests of what makes and keeps them."""

import os
from pathlib import Path

import pytest
from fake_runs import Silent

from mrp_sumo.experiments import batch as batches
from mrp_sumo.experiments.batch import Making, run_batch
from mrp_sumo.experiments.suite import read_suite
from mrp_sumo.io.results import MACHINE_COLUMNS, records_in
from mrp_sumo.metrics.registry import MACHINE_DEPENDENT

DRIVER = Path(__file__).with_name("drive_batch.py")


@pytest.fixture(autouse=True)
def workers_find_fake_runs(monkeypatch, tmp_path):
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parent), prepend=os.pathsep)
    monkeypatch.setenv("FAKE_NOTES", str(tmp_path))
    monkeypatch.setattr(batches, "code_version", lambda: "1")  # whatever is edited meanwhile


def suite(folder, text):
    path = folder / "study.yaml"
    path.write_text("base: office_5\n" + text)
    return read_suite(path)


def make(file, folder, watcher=None, chooser=None, **options):
    return run_batch(file, folder, watcher or Silent(), Making(**{"workers": 1, **options}), function="fake_runs:make", chooser=chooser)


def told_by(folder):
    """What the records say, apart from clocks and machines; by key."""
    result = {}
    for record in records_in(folder, lambda line: pytest.fail(line)):
        metrics = {name: value for name, value in record["metrics"].items() if name not in MACHINE_DEPENDENT}
        result[record["key"]] = {**{k: v for k, v in record.items() if k not in MACHINE_COLUMNS}, "metrics": metrics}
    return result
