"""Batches keep every result once, whatever happens to them, and say the same whoever made the runs."""

import json
import os
import random
import signal
import subprocess
import sys
import time
import zlib

import fake_runs
import pytest
from batches import DRIVER, make, suite, told_by, workers_find_fake_runs  # noqa: F401  a fixture
from fake_runs import Silent
from processes import gone

from mrp_sumo import load_results
from mrp_sumo.errors import BatchError
from mrp_sumo.experiments import batch as batches
from mrp_sumo.experiments.batch import FINISH, GO_ON, Making, open_batch, run_batch
from mrp_sumo.experiments.suite import read_suite
from mrp_sumo.files.writing import written_whole
from mrp_sumo.io.results import MACHINE_COLUMNS, drop_tables, read_record, record_path, records_in, write_record
from mrp_sumo.metrics.registry import MACHINE_DEPENDENT


def record_of(batch, seed):
    return next(r for r in records_in(batch.folder, print) if r["scenario"]["seed"] == seed)


class Telling(Silent):
    def __init__(self):
        self.lines, self.begun = [], None

    def begin(self, num_runs, num_done):
        self.begun = (num_runs, num_done)

    def report(self, line):
        self.lines.append(line)


def test_one_and_two_workers_give_equal_results(tmp_path):
    file = suite(tmp_path, "grid_search: {robots.count: [1, 2], seed: 0..9}\n")
    make(file, tmp_path / "one", workers=1)
    make(file, tmp_path / "two", workers=2)
    assert len(told_by(tmp_path / "one")) == 20
    assert told_by(tmp_path / "one") == told_by(tmp_path / "two")
    tables = [load_results(tmp_path / name) for name in ("one", "two")]
    differing = {column for column in tables[0] if not tables[0][column].equals(tables[1][column])}
    assert differing <= {*MACHINE_COLUMNS, *MACHINE_DEPENDENT}


def test_finished_batch_is_not_run_again(tmp_path):
    file = suite(tmp_path, "grid_search: {seed: 0..4}\n")
    make(file, tmp_path / "out")
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "out").rglob("*") if path.suffix in (".json", ".parquet")}
    watcher = Telling()
    make(file, tmp_path / "out", watcher)
    assert watcher.begun == (5, 5)
    assert before == {path: path.stat().st_mtime_ns for path in before}


def test_longer_suite_keeps_the_results_there_are(tmp_path):
    make(suite(tmp_path, "grid_search: {seed: 0..4}\n"), tmp_path / "out")
    watcher = Telling()
    make(suite(tmp_path, "grid_search: {seed: 3..6}\n"), tmp_path / "out", watcher)
    assert watcher.begun == (4, 2)
    assert list(load_results(tmp_path / "out")["seed"]) == [3, 4, 5, 6]
    assert any("3 results are of runs that the suite does not have" in line for line in watcher.lines)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "status", "reason"),
    [
        (fake_runs.EXITS, "crashed", "worker exit code 3: about to leave"),
        (fake_runs.SEGFAULTS, "crashed", "worker killed by SIGSEGV"),
        (fake_runs.RAISES, "crashed", "ZeroDivisionError: one over none (fake_runs.py"),
    ],
)
def test_run_that_crashes_is_tried_again_and_told_of(tmp_path, seed, status, reason):
    batch = make(suite(tmp_path, f"grid_search: {{seed: [0, {seed}, 1]}}\n"), tmp_path / "out", retries=2)
    record = record_of(batch, seed)
    assert (record["status"], record["success"], record["attempts"]) == (status, False, 3)
    assert record["reason"].startswith(reason)
    assert [record_of(batch, other)["status"] for other in (0, 1)] == ["completed", "completed"]


def test_run_that_crashes_once_succeeds(tmp_path):
    batch = make(suite(tmp_path, f"grid_search: {{seed: [{fake_runs.FAILS_ONCE}]}}\n"), tmp_path / "out")
    assert (record_of(batch, fake_runs.FAILS_ONCE)["status"], record_of(batch, fake_runs.FAILS_ONCE)["attempts"]) == ("completed", 2)


def test_crashes_are_counted_over_sessions(tmp_path):
    file = suite(tmp_path, f"grid_search: {{seed: [{fake_runs.RAISES}]}}\n")
    make(file, tmp_path / "out", retries=1)
    assert record_of(make(file, tmp_path / "out", retries=1), fake_runs.RAISES)["attempts"] == 2
    assert record_of(make(file, tmp_path / "out", retries=2), fake_runs.RAISES)["attempts"] == 3


@pytest.mark.slow
def test_run_that_takes_too_long_is_killed_with_its_children(tmp_path):
    batch = make(suite(tmp_path, f"grid_search: {{seed: [{fake_runs.HANGS}, 0]}}\n"), tmp_path / "out", wall_s=1.0)
    record = record_of(batch, fake_runs.HANGS)
    assert (record["status"], record["reason"]) == ("out_of_time", "killed after 1 s")
    assert gone(int((tmp_path / "child").read_text()))
    assert record_of(batch, 0)["status"] == "completed"


@pytest.mark.slow
def test_run_that_takes_too_much_memory_is_killed(tmp_path):
    batch = make(suite(tmp_path, f"grid_search: {{seed: [0, {fake_runs.GROWS}, 1]}}\n"), tmp_path / "out", memory_mb=500, wall_s=60)
    assert record_of(batch, fake_runs.GROWS)["status"] == "out_of_memory"
    assert record_of(batch, 1)["status"] == "completed"


def test_results_have_a_row_a_run_with_parameters_and_failures(tmp_path):
    make(suite(tmp_path, f"grid_search: {{seed: [0, 1, {fake_runs.RAISES}, 4]}}\n"), tmp_path / "out", retries=0)
    for table in (load_results(tmp_path / "out"), load_results(tmp_path / "out" / "results.parquet")):
        assert list(table["seed"]) == [0, 1, fake_runs.RAISES, 4]
        assert list(table["status"]) == ["completed", "completed", "crashed", "planning_timed_out"]
        assert list(table["success"]) == [True, True, False, False]
        assert list(table["planner"]) == ["cbs"] * 4
        assert list(table["num_robots"]) == [5] * 4
        assert list(table["soc_steps"].isna()) == [False, False, True, False]
        assert list(table["min_distance_m"].isna()) == [False, True, True, False]
        assert list(table["time_blocked_s"].iloc[1]) == [0.0, 1.0]
    assert len((tmp_path / "out" / "results.csv").read_text().splitlines()) == 5


def test_unfinished_batch_can_be_read(tmp_path):
    answers = iter([GO_ON] * 6 + [FINISH] * 1000)
    batch = make(suite(tmp_path, "grid_search: {seed: 0..9}\n"), tmp_path / "out", stop=lambda: next(answers))
    assert 0 < len(batch.status) < 10
    assert len(load_results(tmp_path / "out")) == len(batch.status)
    assert not (tmp_path / "out" / "results.parquet").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    "spoil",
    [
        lambda data: data[: len(data) // 2],
        lambda data: b"",
        lambda data: data.replace(b'"success":false', b'"success":true ', 1) if b'"success":false' in data else data + b" ",
        lambda data: bytes([data[0] ^ 1]) + data[1:],
    ],
)
def test_spoiled_record_is_put_aside_and_made_again(tmp_path, spoil):
    file = suite(tmp_path, "grid_search: {seed: 0..4}\n")
    batch = make(file, tmp_path / "out")
    whole = told_by(tmp_path / "out")
    path = record_path(tmp_path / "out", batch.runs[4].key)
    path.write_bytes(spoil(path.read_bytes()))
    (tmp_path / "out" / "results.parquet").unlink()
    assert len(load_results(tmp_path / "out")) == 4  # the rest is used
    watcher = Telling()
    make(file, tmp_path / "out", watcher)
    assert watcher.begun == (5, 4)
    assert len(watcher.lines) == 1
    assert path.name in watcher.lines[0]
    assert "moved to quarantine" in watcher.lines[0]
    assert (tmp_path / "out" / "quarantine" / path.name).exists()
    assert told_by(tmp_path / "out") == whole


@pytest.mark.slow
@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("metrics", []),
        ("scenario", {"robots": 3}),
        ("scenario", {"robots": {"count": None, "starts": None}}),
        ("success", "yes"),
        ("reason", None),
        ("run_wall_s", "long"),
        ("repeat", 2.5),
        ("status", "completed\n"),
    ],
)
def test_record_with_right_checksum_and_wrong_content_is_put_aside_and_made_again(tmp_path, key, value):
    file = suite(tmp_path, "grid_search: {seed: 0..2}\n")
    batch = make(file, tmp_path / "out")
    whole = told_by(tmp_path / "out")
    record = read_record(record_path(tmp_path / "out", batch.runs[1].key))
    write_record(tmp_path / "out", record | {key: value})
    assert len(list(records_in(tmp_path / "out", lambda line: None))) == 2  # status, load_results and report read the rest
    watcher = Telling()
    make(file, tmp_path / "out", watcher)
    assert watcher.begun == (3, 2)
    assert "moved to quarantine, the run is made again" in watcher.lines[0]
    assert told_by(tmp_path / "out") == whole


def test_records_of_mixed_fleets_are_kept(tmp_path):
    fleet = "[{type: turtlebot3, count: 2}, {type: amr_600, starts: [lobby]}]"
    (tmp_path / "study.yaml").write_text(f"base: {{map: office, robots: {fleet}}}\ngrid_search: {{seed: 0..1}}\n")
    make(read_suite(tmp_path / "study.yaml"), tmp_path / "out")
    assert load_results(tmp_path / "out")["num_robots"].tolist() == [3, 3]


def test_nested_too_deep_is_no_record(tmp_path):
    batch = make(suite(tmp_path, "grid_search: {seed: 0..1}\n"), tmp_path / "out")
    path = record_path(tmp_path / "out", batch.runs[0].key)
    begin, _, rest = path.read_bytes()[len(b'{"crc32":"00000000","record":') : -2].partition(b'"metrics":{')
    body = begin + b'"metrics":{"deep":' + b"[" * 100_000 + b"]" * 100_000 + b"," + rest
    path.write_bytes(b'{"crc32":"%08x","record":' % zlib.crc32(body) + body + b"}\n")
    lines = []
    assert len(list(records_in(tmp_path / "out", lines.append))) == 1
    assert "not a record" in lines[0]


def test_files_of_strangers_among_the_records_are_left_alone(tmp_path):
    file = suite(tmp_path, "grid_search: {seed: 0..2}\n")
    runs = make(file, tmp_path / "out").folder / "runs"
    whole = told_by(tmp_path / "out")
    strange = [runs / ".DS_Store", runs / "README", next(runs.iterdir()) / "notes.txt"]
    for path in strange:
        path.write_text("by somebody else")
    (next(path for path in runs.iterdir() if path.is_dir()) / "folder.json").mkdir()
    watcher = Telling()
    make(file, tmp_path / "out", watcher)
    assert (watcher.begun, watcher.lines) == ((3, 3), [])
    assert told_by(tmp_path / "out") == whole
    assert all(path.read_text() == "by somebody else" for path in strange)


def test_damaged_table_of_a_finished_batch_is_not_believed_and_written_again(tmp_path):
    file = suite(tmp_path, "grid_search: {seed: 0..2}\n")
    make(file, tmp_path / "out")
    for path in (tmp_path / "out" / "results.parquet", tmp_path / "out" / "results.csv"):
        whole = path.read_bytes()
        middle = len(whole) // 2
        flipped = whole[:middle] + bytes([whole[middle] ^ 4]) + whole[middle + 1 :]
        for spoilt in (whole[:middle], flipped, b"", None):
            path.unlink()
            if spoilt is not None:
                path.write_bytes(spoilt)
            assert list(load_results(tmp_path / "out")["seed"]) == [0, 1, 2]
            watcher = Telling()
            make(file, tmp_path / "out", watcher)
            assert watcher.begun == (3, 3)
            assert path.read_bytes() == whole


def test_metrics_of_any_kind_have_a_column(tmp_path):
    batch = make(suite(tmp_path, "grid_search: {seed: 0..1}\n"), tmp_path / "out")
    record = read_record(record_path(tmp_path / "out", batch.runs[0].key))
    write_record(tmp_path / "out", record | {"metrics": {"soc_steps": 2**70, "mixed": [1, "a"], "within": {"a": 1}}})
    drop_tables(tmp_path / "out")
    table = load_results(tmp_path / "out")
    assert next(iter(table["mixed"])) == '[1, "a"]'
    assert next(iter(table["soc_steps"])) == str(2**70)


def test_record_under_the_name_of_another_is_put_aside(tmp_path):
    batch = make(suite(tmp_path, "grid_search: {seed: 0..1}\n"), tmp_path / "out")
    a, b = (record_path(tmp_path / "out", run.key) for run in batch.runs)
    b.write_bytes(a.read_bytes())
    with pytest.raises(BatchError, match="the record of another run"):
        read_record(b)


def test_folder_of_another_suite_is_refused_and_left_alone(tmp_path):
    make(suite(tmp_path, "grid_search: {seed: 0..1}\n"), tmp_path / "out")
    with pytest.raises(BatchError, match=r"holds the batch 'study', not 'other'; give another --out"):
        make(suite(tmp_path, "name: other\ngrid_search: {seed: 0..1}\n"), tmp_path / "out")
    assert len(load_results(tmp_path / "out")) == 2


def test_folder_of_another_version_is_refused(tmp_path, monkeypatch):
    file = suite(tmp_path, "grid_search: {seed: 0..1}\n")
    make(file, tmp_path / "out")
    monkeypatch.setattr(batches, "code_version", lambda: "9.9.9+0")
    with pytest.raises(BatchError, match=r"made by mrp_sumo 1, this is 9.9.9\+0"):
        make(file, tmp_path / "out")


def test_folder_with_other_files_is_refused(tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "letter.txt").write_text("dear")
    with pytest.raises(BatchError, match="holds files, but is not the folder of a batch"):
        make(suite(tmp_path, "grid_search: {seed: 0..1}\n"), tmp_path / "out")


def test_files_half_written_by_a_killed_batch_are_removed(tmp_path):
    file = suite(tmp_path, "grid_search: {seed: 0..1}\n")
    (tmp_path / "out" / "runs" / "ab").mkdir(parents=True)
    (tmp_path / "out" / "floors").mkdir()
    for name in ("plan.json", "floors/12.json.gz", "runs/ab/ab12.json", "runs/ab/ab12.trace"):
        with written_whole(tmp_path / "out" / name) as part:
            part.write_text("{")
            os.link(part, tmp_path / "left")
        (tmp_path / "left").rename(part)  # as it is when the process is killed then
        (tmp_path / "out" / name).unlink()
    (tmp_path / "out" / "plan.json").write_text("{}")
    with pytest.raises(BatchError, match=r"plan.json: not the plan of a batch; move it away and start the batch again, no result is lost"):
        make(file, tmp_path / "out")
    (tmp_path / "out" / "plan.json").unlink()
    make(file, tmp_path / "out")
    assert not list((tmp_path / "out").rglob(".*"))


def test_refused_suite_leaves_no_folder(tmp_path):
    file = suite(tmp_path, "grid_search: {map: [ofice]}\n")
    with pytest.raises(Exception, match="no map 'ofice'"):
        make(file, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_two_batches_do_not_share_a_folder(tmp_path):
    file = suite(tmp_path, "grid_search: {seed: 0..1}\n")

    class Second(Silent):
        def begin(self, num_runs, num_done):
            with pytest.raises(BatchError, match="another batch is under way there"):
                make(file, tmp_path / "out")

    make(file, tmp_path / "out", Second())


def test_full_disk_ends_the_batch_in_one_line_and_keeps_results(tmp_path, monkeypatch):
    file = suite(tmp_path, "grid_search: {seed: 0..9}\n")
    real, count = os.fsync, iter(range(1000))

    def full(descriptor):
        if next(count) > 8:
            raise OSError(28, "No space left on device")
        real(descriptor)

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(BatchError, match=r"the disk is full; \d of 10 results are kept, start again to go on"):
        make(file, tmp_path / "out")
    monkeypatch.setattr(os, "fsync", real)
    remaining = told_by(tmp_path / "out")
    assert 0 < len(remaining) < 10
    assert not list((tmp_path / "out").rglob(".*"))
    make(file, tmp_path / "out")
    assert remaining.items() <= told_by(tmp_path / "out").items()


def test_run_without_room_for_its_files_is_no_result_and_ends_the_batch(tmp_path):
    file = suite(tmp_path, f"grid_search: {{seed: [0, 1, {fake_runs.FULL}, 2, 3, 4, 5, 6, 7, 8]}}\n")
    with pytest.raises(
        BatchError, match=r"files of a run cannot be written: the disk is full; \d of 10 results are kept, start again to go on"
    ):
        make(file, tmp_path / "out")
    assert not any(record["scenario"]["seed"] == fake_runs.FULL for record in records_in(tmp_path / "out", print))


def test_function_that_cannot_be_loaded_is_no_result(tmp_path):
    file = suite(tmp_path, "grid_search: {seed: 0..1}\n")
    with pytest.raises(BatchError, match=r"a worker process cannot start: ModuleNotFoundError: No module named 'nowhere'"):
        run_batch(file, tmp_path / "out", Silent(), Making(1), function="nowhere:make")
    assert not told_by(tmp_path / "out")


def test_estimate_comes_from_the_runs_there_are(tmp_path):
    make(suite(tmp_path, "grid_search: {seed: 0..1}\n"), tmp_path / "out")
    batch = open_batch(suite(tmp_path, "grid_search: {seed: 0..9}\n"), tmp_path / "out", print)
    seconds, source = batches.estimate_s(batch, 2, 1)
    assert source == "from 2 runs in the folder"
    assert seconds > 0


def killed_again_and_again(tmp_path, times, seed):
    """A batch that is killed at random moments and started again until it ends."""
    rng = random.Random(seed)
    file = suite(tmp_path, "grid_search: {robots.count: [1, 2], seed: 0..19}\n")
    make(file, tmp_path / "whole", workers=2)
    out = tmp_path / "killed"
    command = [sys.executable, str(DRIVER), str(tmp_path / "study.yaml"), str(out), "2"]
    kills, grown = 0, []
    while True:
        process = subprocess.Popen(command, env={**os.environ, "FAKE_SLEEP": "0.08"})
        try:
            code = process.wait(rng.uniform(0.6, 1.6) if kills < times else 600)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL)
            process.wait()
            kills += 1
            grown.append(len(list((out / "runs").glob("*/*.json"))))
            continue
        assert code == 0
        break
    return kills, grown, told_by(tmp_path / "whole"), told_by(out)


@pytest.mark.slow
def test_batch_that_is_killed_at_random_moments_ends_with_the_same_results(tmp_path):
    kills, grown, whole, killed = killed_again_and_again(tmp_path, 2, seed=5)
    assert kills == 2
    assert grown == sorted(grown)  # no result was lost
    assert killed == whole
    assert all(gone(int(pid)) for pid in set((tmp_path / "pids").read_text().split()))


@pytest.mark.campaign
def test_batch_that_is_killed_twenty_times_ends_with_the_same_results(tmp_path):
    kills = 0
    for attempt in range(40):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        killed, grown, whole, ended = killed_again_and_again(folder, 4, seed=attempt)
        assert grown == sorted(grown)
        assert ended == whole
        kills += killed
        if kills >= 20:
            return
    pytest.fail(f"only {kills} kills hit a running batch")


@pytest.mark.slow
def test_workers_end_with_a_killed_batch(tmp_path):
    suite(tmp_path, f"grid_search: {{seed: [{fake_runs.HANGS}]}}\n")
    command = [sys.executable, str(DRIVER), str(tmp_path / "study.yaml"), str(tmp_path / "out"), "1"]
    process = subprocess.Popen(command)
    deadline = time.monotonic() + 120
    while not (tmp_path / "pids").exists() and time.monotonic() < deadline:
        time.sleep(0.05)
    process.kill()
    process.wait()
    assert gone(int((tmp_path / "pids").read_text()))
    if (tmp_path / "child").exists():
        os.kill(int((tmp_path / "child").read_text()), signal.SIGKILL)


def test_plan_names_the_runs_in_order(tmp_path):
    batch = make(suite(tmp_path, "grid_search: {seed: 0..2}\nviews: {mean: select avg(seed) from results}\n"), tmp_path / "out")
    plan = json.loads((tmp_path / "out" / "plan.json").read_text())
    assert plan["keys"] == [run.key for run in batch.runs]
    assert plan["axes"] == {"seed": [0, 1, 2]}
    assert plan["views"] == {"mean": "select avg(seed) from results"}


def test_chosen_runs_follow_from_those_before_and_are_made_once(tmp_path):
    """Each run's result names the next seed; ended after two and started again, the batch makes the rest."""
    from mrp_sumo.experiments.suite import Variations
    from mrp_sumo.io.scenario.file import find_scenario
    from mrp_sumo.io.scenario.read import read_scenario

    runs = Variations(read_scenario(find_scenario("office_5")), "chosen", "1")

    def choose(lookup):
        wanted = [runs.run({("seed",): ("seed", 1)})]
        while (record := lookup(wanted[-1].key)) and len(wanted) < 5:
            wanted.append(runs.run({("seed",): ("seed", record["metrics"]["soc_steps"] % 60)}))
        return wanted

    ended = []

    class Counting(Telling):
        def ended(self, record):
            ended.append(record["scenario"]["seed"])

    def session(enough):
        return make(
            runs.suite, tmp_path / "out", Counting(), workers=2, chooser=choose, stop=lambda: FINISH if len(ended) >= enough else GO_ON
        )

    session(2)
    assert ended == [1, 15]
    batch = session(99)
    assert ended == [1, 15, 35, 55]  # a seed that comes again is no new run
    assert len(load_results(tmp_path / "out")) == len(batch.status)
