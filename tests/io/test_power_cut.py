"""What was written is there after a power cut, on a disk that keeps nothing but what was synced."""

import os

import pytest
from power_cut import cut, watch

from mrp_sumo.files.writing import write_whole
from mrp_sumo.io.results import CSV, SUMS, TABLE, drop_tables


@pytest.fixture
def disk(tmp_path, monkeypatch):
    """A folder and the log of its syncs."""
    monkeypatch.setattr(os, "fsync", os.fsync)  # put back at the end
    (tmp_path / "batch").mkdir()
    watch(tmp_path / "batch", tmp_path / "log")
    return tmp_path / "batch", tmp_path / "log"


def test_file_in_a_new_folder_is_kept(disk):
    folder, log = disk
    write_whole(folder / "runs" / "ab" / "abc.json", b"one")
    write_whole(folder / "runs" / "cd" / "cde.json", b"two")
    write_whole(folder / "runs" / "ab" / "abc.json", b"three")
    cut(folder, log)
    assert {path.name: path.read_bytes() for path in folder.rglob("*.json")} == {"abc.json": b"three", "cde.json": b"two"}


def test_file_that_was_not_synced_is_lost(disk):
    folder, log = disk
    write_whole(folder / "a", b"one")
    (folder / "a").write_bytes(b"two")
    (folder / "b").write_bytes(b"three")
    cut(folder, log)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == {"a": b"one"}


def test_dropped_tables_do_not_come_back(disk):
    folder, log = disk
    for name in (CSV, TABLE, SUMS):
        write_whole(folder / name, b"old")
    drop_tables(folder)
    write_whole(folder / "runs" / "ab" / "abc.json", b"new")
    cut(folder, log)
    assert [path.name for path in folder.iterdir()] == ["runs"]
