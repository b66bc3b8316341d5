"""`mrp-sumo capacity` says how many robots fit, the same however often it is interrupted, or in one line why it cannot."""

import json
import shlex

import pytest

from mrp_sumo.cli.main import main

SMALL = ["capacity", "warehouse_lifelong", "--robots", "1..2", "--horizon", "3min", "--quick", "--budget", "90s", "--json"]
SMALL += ["--set", "execution.dispatcher=hungarian"]


def output(capsys, *arguments):
    code = main(list(arguments))
    return code, capsys.readouterr()


@pytest.mark.slow
def test_the_answer_is_the_same_after_an_interruption(tmp_path, capsys):
    code, first = output(capsys, *SMALL, "--out", str(tmp_path / "out"))
    assert code == 0
    answer = json.loads(first.out)["answer"]
    for name in ("peak_robots", "knee_robots", "collapse_robots", "smallest_for_demand"):
        assert {"estimate", "low", "high"} <= set(answer[name])
    assert set(answer["limit"]) == {"kind", "name", "utilisation"}
    columns = {"robots", "throughput_per_h", "low", "high", "replications", "unanswered_share", "counts", "why_not"}
    assert [set(row) for row in answer["curve"]] == [columns] * len(answer["curve"]) and answer["planner"] == "lacam"
    assert [row["robots"] for row in answer["curve"]] == [1, 2] and answer["seeds"][0] == 3000
    assert answer["command"].startswith("mrp-sumo capacity warehouse_lifelong --set execution.dispatcher=hungarian ")
    page = (tmp_path / "out" / "capacity.html").read_bytes()
    assert answer["sentence"].encode() in page and b"<script" not in page
    records = sorted((tmp_path / "out" / "runs").rglob("*.json"))
    assert all('"dispatcher":"hungarian"' in record.read_text() for record in records)
    for record in records[::4]:
        record.unlink()
    code, again = output(capsys, *SMALL, "--out", str(tmp_path / "out"), "--workers", "1")
    assert (code, again.out) == (0, first.out)
    assert (tmp_path / "out" / "capacity.html").read_bytes() == page
    assert sorted((tmp_path / "out" / "runs").rglob("*.json")) == records


@pytest.mark.slow
def test_the_line_for_going_on_has_all_that_was_typed(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("mrp_sumo.sizing.study.Study.run", lambda *_, **__: None)  # as it ends when it is interrupted
    typed = [*SMALL, "--replays", "--workers", "1", "--out", str(tmp_path / "of two")]
    _, said = output(capsys, *typed)
    assert said.err.splitlines()[-1] == f"mrp-sumo: interrupted; to go on: {shlex.join(['mrp-sumo', *typed])}"


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (["warehouse_9", "--demand", "100/h"], "'warehouse_9' has no orders to count; give it tasks"),
        (["warehouse_9", "--horizon", "10"], "--horizon: 'warehouse_9' has no orders: its runs end once all robots are at their goals"),
        (["warehouse_lifelong", "--robots", "5..2"], "--robots 5..2: expected at least one robot, and the smaller number first"),
        (["warehouse_lifelong", "--robots", "0..2"], "--robots 0..2: expected at least one robot"),
        (["warehouse_lifelong", "--robots", "5..2000"], "robots.count: 857 fits); 5..857 would do"),
        (["warehouse_lifelong", "--budget", "1s"], "--budget 1s: too little to say anything"),
        (["warehouse_lifelong", "--what-if", "stations.pak: +1"], "'pak' is no station or group (did you mean 'pack'?)"),
        (["warehouse_lifelong", "--what-if", "planer: pibt"], "unknown key (did you mean 'planner'?)"),
        (["warehouse_lifelong", "--what-if", f"planner: {'[' * 3000}"], "expected a key and a value, such as 'planner: lacam'"),
        (["warehouse_lifelong", "--set", "planner=lakam"], "--set planner: unknown planner 'lakam' (did you mean 'lacam'?)"),
        (["warehouse_lifelong", "--engine", "sumo", "--confirm", "sumo"], "every run is driven in SUMO already"),
        (["warehouse_lifelong", "--demand", "fast"], "expected orders in a time, such as 180/h"),
        (["warehouse_lifelong", "--on-time", "100%"], "--on-time: found '100%', expected a share from 1e-06 to 0.999999"),
        (["nowhere", "--on-time", "99.95%"], "nowhere"),  # the share is one
    ],
)
def test_what_cannot_be_answered_is_refused_in_a_line(arguments, line, tmp_path, capsys):
    code, said = output(capsys, "capacity", *arguments, "--out", str(tmp_path / "out"))
    assert code == 2 and line in said.err and said.err.count("\n") == 1
    assert not (tmp_path / "out").exists()
