"""Suites from the front door."""

import os

import pytest

import mrp_sumo as ms

SUITE = "base: office_5\nuntil: plan\ngrid_search: {robots.count: [2, 3], planner: [cbs, pibt]}\n"


@pytest.fixture
def suite(tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text(SUITE)
    return path


def test_suite_is_made_once_in_the_folder_of_the_command_line_and_read_as_a_table(suite, tmp_path, capsys, monkeypatch):
    heard = []
    monkeypatch.chdir(tmp_path)
    batch = ms.run_suite("small.yaml", workers=1, progress=lambda done, of: heard.append((done, of)))
    assert batch.folder.as_posix() == "runs/small"
    assert heard == [(0, 4), (1, 4), (2, 4), (3, 4), (4, 4)]
    assert batch.results["planner"].tolist() == ["cbs", "pibt", "cbs", "pibt"] and batch.results["success"].all()
    assert ms.load_results(batch.folder).equals(batch.results)
    assert batch.query("select count(*) as runs from results")["runs"].tolist() == [4]
    assert repr(batch) == "<Batch small: 4 of 4 runs done, in runs/small>"
    assert batch.counts == {"planned": 4} and "planned" in str(batch) and "<table>" in batch._repr_html_()
    again = ms.run_suite(suite, tmp_path / "runs" / "small", workers=1, progress=lambda done, of: heard.append((done, of)))
    assert heard[5:] == [(4, 4)] and again.counts == batch.counts
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("more", "line"),
    [
        ({"workers": 0}, f"workers: found 0, expected 1 to {8 * len(os.sched_getaffinity(0))}, 8 for each core"),
        ({"retries": -1}, "retries: found -1, expected 0 or more"),
    ],
)
def test_bad_numbers_are_refused(suite, more, line):
    with pytest.raises(ms.MrpSumoError) as caught:
        ms.run_suite(suite, **more)
    assert str(caught.value) == line


def test_unknown_suite_is_refused_with_the_nearest():
    with pytest.raises(ms.MrpSumoError, match="did you mean 'paper_comparison'"):
        ms.run_suite("paper_comparisn")
